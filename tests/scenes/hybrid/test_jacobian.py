"""The flow's Jacobian through the landings of hoppers and plates."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from jacobian_checks import carried, differences, gap, saltation_product
from scipy.integrate import solve_ivp

from hopdata.hybrid import solve
from hopdata.hybrid.first_order import bouligand_derivative
from hopdata.hybrid.methods.table import TABLEAUS
from hopdata.scenes.body import flight_mode
from hopdata.scenes.hopper import hopper_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.plate import Plate
from hopdata.scenes.vertical_hopper import VerticalHopper

METHODS = pytest.mark.parametrize("method", ["auto", *TABLEAUS])


def test_vertical_hopper():
    hopper = VerticalHopper()
    system = hopper.system()
    options = {"params": hopper.params, "method": "taylor"}
    found = carried(system, (0, 1.2), [1.5, 0.0], **options)
    assert len(found.events) >= 2
    assert (
        gap(found.jacobian, differences(system, (0, 1.2), [1.5, 0.0], **options)) < 1e-8
    )


HOPPER = hopper_system()
LANDING = {
    "params": HopperParameters().vector(),
    "mode": flight_mode(hopper_system(), -1.0),
}
OBLIQUE = np.array(
    [0.0, 0.0, 0.32, 0.0, 0.03, -0.04, 0.05, -0.03, -1.5, 0.1, -0.2, 0.05]
)


@METHODS
def test_three_legs_land_one_after_another(method):
    found = carried(HOPPER, (0, 0.06), OBLIQUE, method=method, **LANDING)
    assert [HOPPER.guard_names[k] for k in found.events.guard] == [
        "foot1",
        "foot2",
        "foot3",
    ]
    assert (
        gap(found.jacobian, differences(HOPPER, (0, 0.06), OBLIQUE, **LANDING)) < 1e-8
    )


TOUCHING = np.array([0.0, 0.0, 0.27, 0.3, 0.0, 0.0, 0.05, -0.03, -2.1, 0.1, -0.2, 0.05])


def test_three_legs_at_once_are_the_saltation_matrices_of_any_order():
    there = carried(HOPPER, (0, 1e-300), TOUCHING, **LANDING)
    assert there.events.guard.tolist() == [0, 1, 2]
    for order in permutations(range(3)):
        product = saltation_product(HOPPER, TOUCHING, order, **LANDING)
        assert gap(there.jacobian, product) < 1e-13
    pieces = bouligand_derivative(
        HOPPER, TOUCHING, guards=("foot1", "foot2", "foot3"), **LANDING
    ).pieces()
    for piece in pieces:
        assert gap(there.jacobian, piece.matrix) < 1e-13


@pytest.mark.parametrize("end", [1e-300, 1e-230, 1e-161, 1e-100])
def test_a_span_as_short_as_a_number_can_be_takes_one_step(end):
    """The errors of the Jacobian are so small there that their squares vanish."""
    found = carried(HOPPER, (0, end), TOUCHING, **LANDING)
    assert found.status == 0
    assert found.n_steps <= 4
    assert np.isfinite(found.jacobian).all()


def extrapolated(system, t_span, y0, **options):
    """Return differences without their first-order error across the kinks of a C1 flow."""
    coarse, fine = (
        differences(system, t_span, y0, step=h, **options) for h in (2e-5, 1e-5)
    )
    return 2 * fine - coarse


def test_three_legs_at_once_and_on():
    """The flight rotates, and all feet land at one instant."""

    def back(t, y):
        rate = np.empty(12)
        HOPPER.field.function(0.01 - t, y, LANDING["mode"], LANDING["params"], rate)
        return -rate

    options = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15}
    start = solve_ivp(back, (0, 0.01), TOUCHING, **options).y[:, -1]
    found = carried(HOPPER, (0, 0.03), start, **LANDING)
    assert len(found.events) == 3
    assert np.ptp(found.events.time) < 1e-13
    assert gap(found.jacobian, extrapolated(HOPPER, (0, 0.03), start, **LANDING)) < 1e-8


def test_three_legs_at_once_without_spin():
    start = np.array([0.1, 0.2, 0.29, 0.3, 0.0, 0.0, 0.05, -0.03, -2.1, 0.0, 0.0, 0.0])
    found = carried(HOPPER, (0, 0.03), start, **LANDING)
    assert len(set(found.events.time)) == 1
    assert gap(found.jacobian, extrapolated(HOPPER, (0, 0.03), start, **LANDING)) < 1e-5


PLATE = Plate(12)
FLAT = np.array([0.1, 1.2, 0.0, 0.2, -1.0, 0.0])


def plate_jacobian(**form):
    return carried(PLATE.system(**form), (0, 0.15), FLAT, params=PLATE.params)


def test_a_plate_that_lands_flat():
    plain = plate_jacobian()
    assert len(plain.events) == 12
    assert np.ptp(plain.events.time) < 1e-14
    reference = extrapolated(PLATE.system(), (0, 0.15), FLAT, params=PLATE.params)
    assert gap(plain.jacobian, reference) < 1e-6


@pytest.mark.parametrize("form", ["sums", "sparse"])
def test_a_plate_that_lands_flat_with_a_memory(form):
    """The handlers change the field, all at one instant, so their shares are unknown."""
    found = plate_jacobian_of(form)
    assert found.status == -11
    assert "Several guards flip at t = " in found.message


def plate_jacobian_of(form):
    system = PLATE.system(**{form: True})
    options = {"params": PLATE.params, "method": "dop853"}
    return solve(system, (0, 0.15), FLAT, jacobian=True, **options)
