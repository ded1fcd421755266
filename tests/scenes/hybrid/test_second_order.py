"""Table 1.1's second column on hoppers and octants."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.first_order import check_c1
from hopdata.hybrid.first_order.second_order import ADDITIVE, BY_POSITION, GROUPED
from hopdata.scenes.body import flight_mode
from hopdata.scenes.hopper import hopper_system
from hopdata.scenes.hopper_control import control_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.octant import octant
from hopdata.scenes.scene import Control


def missing(found):
    return [finding.condition for finding in found.fopas if not finding.passed]


def test_a_system_of_first_order():
    found = check_c1(octant(), [0, 0, 0], mode=[-1, -1, -1])
    assert missing(found)[:2] == [GROUPED, BY_POSITION]
    assert found.fopas[1].value == 0
    assert np.isnan(found.fopas[2].value)


def landing(n_legs=3, control=None):
    """Return the report on a hopper all of whose feet touch the floor."""
    hopper = HopperParameters(n_legs=n_legs)
    system, params = hopper_system(n_legs), hopper.vector()
    if control is not None:
        system, params = control_system(n_legs), hopper.vector(variant=control)
    y = np.zeros(12)
    y[2], y[6:] = 0.27, [0.05, -0.03, -2.1, 0.1, -0.2, 0.05]
    names = [f"foot{leg + 1}" for leg in range(n_legs)]
    return check_c1(
        system,
        y,
        params=params,
        mode=flight_mode(hopper_system(n_legs), -1.0),
        guards=names,
    )


@pytest.mark.parametrize("n_legs", [2, 3, 4])
def test_the_hopper_has_the_form(n_legs):
    found = landing(n_legs)
    assert missing(found) == []
    assert found.is_fopas


def test_forces_of_velocity_add_like_any_others():
    """Dampers and friction leave all lines standing: they are no matter of the table."""
    assert missing(landing()) == []
    damped = HopperParameters(damping_n_s_m=48.0, friction=1.0)
    y = np.zeros(12)
    y[2], y[6:] = 0.27, [0.5, -0.3, -2.1, 0.1, -0.2, 0.05]
    found = check_c1(
        hopper_system(),
        y,
        params=damped.vector(),
        mode=flight_mode(hopper_system(), -1.0),
        guards=("foot1", "foot2", "foot3"),
    )
    assert missing(found) == []
    assert found.products.value < 1e-12


def test_a_control_that_couples_the_feet_has_not():
    assert missing(landing(control=Control(coupling=0.1))) == [ADDITIVE]
    assert missing(landing(control=Control())) == []
