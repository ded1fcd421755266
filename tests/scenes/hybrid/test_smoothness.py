"""Table 1.1 on the scenes, whose verdict is known."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid import System, field
from hopdata.hybrid.first_order import check_c1
from hopdata.hybrid.first_order.event_selected import (
    CONTINUOUS,
    EVENT_FUNCTIONS,
    KEPT,
    ONCE,
)
from hopdata.hybrid.first_order.smoothness import ONE_PRODUCT
from hopdata.scenes.body import flight_mode
from hopdata.scenes.hopper import hopper_system
from hopdata.scenes.hopper_control import control_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.octant import octant, octant_guards
from hopdata.scenes.scene import Control
from hopdata.scenes.vertical_hopper import VerticalHopper

HOPPER = HopperParameters()
FEET = ("foot1", "foot2", "foot3")
SPEEDS = [0.05, -0.03, -2.1, 0.1, -0.2, 0.05]


def landing_report(control=None, n_legs=3, **options):
    hopper = HopperParameters(n_legs=n_legs)
    y = np.zeros(12)
    y[2], y[6:] = 0.27, SPEEDS
    system, params = hopper_system(n_legs), hopper.vector()
    if control is not None:
        system, params = control_system(n_legs), hopper.vector(variant=control)
        if control.delay_s:
            y[2], y[9:] = 0.27 + 2.1 * control.delay_s, 0.0
    feet = [f"foot{k + 1}" for k in range(n_legs)]
    mode = flight_mode(hopper_system(n_legs), -1.0)
    return check_c1(system, y, params=params, mode=mode, guards=feet, **options)


@pytest.mark.parametrize("n_legs", [2, 3, 4])
def test_the_hopper_lands_c1(n_legs):
    report = landing_report(n_legs=n_legs)
    assert report.verdict == "C1"
    assert report.reasons == ()
    assert report.products.value < 1e-13


def test_the_hopper_takes_off_c1():
    """All legs are released at full extension; each is re-armed when it leaves the floor."""
    y = np.zeros(12)
    y[2], y[6:] = 0.27 + HOPPER.release_extension_m, [0.05, -0.03, 2.0, 0.1, -0.2, 0.05]
    mode = [1, 1, 1, 1, -1, 1, 1, 1, 1]
    report = check_c1(hopper_system(), y, params=HOPPER.vector(), mode=mode)
    assert report.guards == FEET
    assert report.verdict == "C1"
    assert report.reasons == ()


@pytest.mark.parametrize(
    ("control", "apart"),
    [(Control(coupling=0.1), 0.149), (Control(delay_s=0.005), 0.049)],
)
def test_controls_are_event_selected_and_not_c1(control, apart):
    report = landing_report(control)
    assert report.verdict == "event-selected, not C1"
    assert report.reasons == (ONE_PRODUCT,)
    assert report.products.value == pytest.approx(apart, abs=1e-3)


def test_the_impulse_leaves_states_that_depend_on_the_order():
    """Liveness holds, but the flow is not even continuous where the feet land together."""
    report = landing_report(Control(impulse=0.1))
    assert report.verdict == "not event-selected"
    assert [f.condition for f in report.selection if not f.passed] == [
        "trajectories are continuous"
    ]
    assert report.products.value == pytest.approx(0.285, abs=1e-3)
    assert report.products.detail.endswith("the states after them differ by 0.0395")


def test_a_control_of_no_strength_is_the_hopper():
    assert str(landing_report(Control())) == str(landing_report())


@pytest.mark.parametrize(("state", "lock"), [([1.0, -3.0], 1), ([1.0, 3.0], -1)])
def test_the_vertical_hopper_lands_and_takes_off_c1(state, lock):
    hopper = VerticalHopper(rest_length_m=1.1, damping_n_s_m=3.0)
    report = check_c1(hopper.system(), state, params=hopper.params, mode=[lock])
    assert report.verdict == "C1"
    assert report.reasons == ()


def test_octant_is_event_selected_and_not_c1():
    report = check_c1(octant(), [0, 0, 0], mode=[-1, -1, -1])
    assert report.verdict == "event-selected, not C1"
    assert report.products.value == pytest.approx(1.0)


def test_the_table_reads_as_a_checklist():
    report = landing_report(Control(coupling=0.1))
    lines = str(report).split("\n")
    assert lines[0] == (
        "event-selected, not C1 (does not hold: all orders have one saltation product)"
    )
    assert lines[1] == "guards foot1, foot2, foot3"
    assert [line[:3] for line in lines[4:7]] == ["yes"] * 3
    assert "(ESS)" in lines[7]
    assert [line[:3] for line in lines[8:12]] == ["yes"] * 4
    assert lines[13].startswith("NO ")
    assert "(FoPAS), sufficient for C1 and not necessary" in lines[14]
    assert [line[:3].strip() for line in lines[15:19]] == ["yes", "yes", "yes", "no"]
    assert lines[19:] == [report.of_second_column]
    assert len({line.find("<=") for line in lines if "<=" in line}) == 1


FREE = [-1, -1, -1]


def selected(system, state, *, scale=None, **options):
    """Return values of the conditions of event-selection, and names of those that fail."""
    report = check_c1(system, state, scale=scale, **options)
    wanted = (EVENT_FUNCTIONS, CONTINUOUS, ONCE, KEPT)
    own = [f for f in report.selection if f.condition in wanted]
    return {f.condition: f.value for f in own}, [
        f.condition for f in own if not f.passed
    ]


def test_octant_farther_out_is_not():
    """dx/dt = 1 - 2 y beyond x, so the trajectory turns back where y > 1/2."""
    found, failed = selected(octant(), [0, 0.6, 0], mode=FREE, guards=("x", "y", "z"))
    assert failed == [EVENT_FUNCTIONS, ONCE, KEPT]
    assert found[EVENT_FUNCTIONS] < 0


def test_one_mode_of_four_suffices_to_break_it():
    @field
    def coupled(t, y, mode, params, dy):
        both = mode[0] > 0 and mode[1] < 0
        dy[0], dy[1], dy[2] = 1.0, (-1.0 if both else 1.0), -1.0

    system = System(coupled, octant_guards, n_states=3, guard_names=("x", "y", "z"))
    found, failed = selected(system, np.zeros(3), mode=FREE)
    assert (found[EVENT_FUNCTIONS], found[KEPT]) == (-1, -1)
    assert failed == [EVENT_FUNCTIONS, ONCE, KEPT]


def test_there_must_be_a_guard():
    with pytest.raises(ValueError, match="guards"):
        check_c1(octant(), [1, 1, 1], mode=FREE)
