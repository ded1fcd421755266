"""Algorithm 7 on the hopper in one dimension, as printed and corrected, and many guards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import RK45

from hopdata.hybrid import solve
from hopdata.hybrid.printed import (
    AS_PRINTED,
    Ivp,
    PrintedOptions,
    Stepping,
    integrate_alternating,
    integrate_both_ways,
    region_of,
)
from hopdata.hybrid.printed.alternate import heading
from hopdata.scenes.plate import Plate
from hopdata.scenes.vertical_hopper import VerticalHopper, hopper_end

HOPPER = VerticalHopper()
START, END = (2.0, 0.0), 2.0
PRINTED_THAT_ENDS = replace(AS_PRINTED, end="before")


def regions():
    """Touchdown, where the height above contact falls, and take-off, where it rises."""
    return tuple(
        region_of(HOPPER.system(), HOPPER.params, orientation=(k,)) for k in (-1, 1)
    )


def stepping(max_step):
    return Stepping(RK45, {"rtol": 1e-9, "atol": 1e-12, "max_step": max_step})


def hop(max_step, t_span=(0.0, END), start=START, **options):
    return integrate_alternating(
        *regions(), t_span, start, solver=stepping(max_step),
        options=PrintedOptions(**options),
    )  # fmt: skip


@pytest.fixture(scope="module")
def truth():
    """Instants of touchdown and take-off, and the state at the end."""
    g, k = HOPPER.gravity_m_s2, HOPPER.stiffness_n_m / HOPPER.mass_kg
    fall, speed, omega = np.sqrt(2 / g), np.sqrt(2 * g), np.sqrt(k)
    stance = 2 * np.arctan2(speed / omega, -g / k) / omega
    times = np.array([fall, fall + stance, 3 * fall + stance])
    return times, hopper_end(HOPPER, START[0], END)


@pytest.mark.parametrize("boundary", ["localised", "mesh"])
def test_two_hops(truth, boundary):
    times, end = truth
    solution = hop(0.002, boundary=boundary)
    assert solution.events.direction.tolist() == [-1, 1, -1, 1]
    assert solution.events.time[:3] == pytest.approx(times, abs=1e-6)
    assert solution.y_end == pytest.approx(end, abs=1e-5)
    assert solution.t_end == END
    assert (np.diff(solution.t) > 0).all()
    assert solution.events.mode.ravel().tolist() == [-1, 1, -1, 1]


def test_around_solve_ivp(truth):
    solver = Ivp({"rtol": 1e-9, "atol": 1e-12, "max_step": 0.01})
    solution = integrate_alternating(*regions(), (0.0, END), START, solver=solver)
    assert solution.events.direction.tolist() == [-1, 1, -1, 1]
    assert solution.y_end == pytest.approx(truth[1], abs=1e-4)


def test_fourth_order(truth):
    steps = 0.004 / 2.0 ** np.arange(4)
    errors = [np.abs(hop(step).y_end - truth[1]).max() for step in steps]
    # It scatters with where the events fall in their steps.
    assert np.log2(errors[0] / errors[-1]) / 3 > 3.0
    assert errors[-1] < 1e-6


def test_as_printed_it_does_not_end():
    with pytest.raises(ArithmeticError, match="does not end"):
        integrate_alternating(
            *regions(), (0.0, END), START, solver=stepping(0.01), options=AS_PRINTED
        )
    solution = hop(0.01, t_span=(0.5, 0.5))
    assert solution.t.tolist() == [0.5]
    assert solution.y_end.tolist() == list(START)
    assert len(solution.events) == 0


def test_from_rest_the_sign_is_that_of_the_acceleration():
    down, _ = regions()
    corrected, printed = PrintedOptions(), PrintedOptions(rest="rising")
    above, below = np.array([2.0, 0.0]), np.array([0.9, 0.0])
    assert heading(down, 0.0, above, 1, corrected) == -1
    assert heading(down, 0.0, below, 1, corrected) == 1
    assert heading(down, 0.0, above, 1, printed) == 1
    flight = hop(0.05, t_span=(0.0, 0.4))
    assert flight.y_end == pytest.approx([2 - 9.81 * 0.08, -9.81 * 0.4], abs=1e-12)


def test_from_rest_as_printed_a_long_first_step_falls_through_the_floor():
    """At rest it is in the rising region, which has no touchdown, for one step."""
    options = {"rtol": 0.9, "atol": 1e9, "first_step": 0.6, "max_step": 0.6}
    solver = Stepping(RK45, options)
    ends = [
        integrate_alternating(
            *regions(), (0.0, 0.6), START, solver=solver,
            options=PrintedOptions(tail="restart", rest=rest, boundary="mesh"),
        )
        for rest in ("rising", "acceleration")
    ]  # fmt: skip
    assert len(ends[0].events) == 0
    assert ends[0].y_end[0] == pytest.approx(2 - 9.81 * 0.36 / 2)
    assert ends[1].events.direction[0] == -1


def test_in_equilibrium_it_ends():
    balance = 1.0 - 9.81 / 1000
    solution = hop(0.05, t_span=(0.0, 0.2), start=(balance, 0.0))
    assert solution.t_end == 0.2
    assert solution.y_end == pytest.approx([balance, 0.0], abs=1e-12)


def test_a_step_of_one_second_is_ruined_by_the_tail_alone(truth):
    """The maximum step of section 4.4.3; from each event anew, the end is right."""
    wrong = np.abs(hop(1.0, boundary="mesh").y_end - truth[1]).max()
    right = np.abs(hop(1.0, tail="restart").y_end - truth[1]).max()
    assert wrong > 5.0
    assert right < 1e-5


def test_a_step_over_apex_and_touchdown_loses_the_touchdown_as_printed():
    """Seen on the mesh alone, the velocity has changed sign when the leg is on the floor."""
    start, span = (1.01, 0.3), (0.0, 0.12)
    options = {"rtol": 0.9, "atol": 1e9, "max_step": 0.12, "first_step": 0.12}
    solver = Stepping(RK45, options)
    lost, found = (
        integrate_alternating(
            *regions(), span, start, solver=solver,
            options=PrintedOptions(boundary=boundary, tail="restart"),
        )
        for boundary in ("mesh", "localised")
    )  # fmt: skip
    seen = hop(0.001, t_span=span, start=start)
    assert seen.events.direction.tolist() == [-1]
    assert len(lost.events) == 0
    assert found.events.direction.tolist() == [-1]
    assert found.events.time == pytest.approx(seen.events.time, abs=1e-9)


# Guards that are crossed to and fro, each with a partition of its own.


def test_the_hopper_without_a_velocity(truth):
    solution = integrate_both_ways(
        HOPPER.system(), (0.0, END), START, params=HOPPER.params, solver=stepping(0.002)
    )
    assert solution.events.direction.tolist() == [-1, 1, -1, 1]
    assert solution.y_end == pytest.approx(truth[1], abs=1e-5)
    assert solution.mode.tolist() == [1]


@pytest.mark.parametrize("tail", ["heun", "restart"])
def test_a_plate_on_its_bed(tail):
    plate = Plate(5)
    start = plate.initial_states(1, seed=4)[0]
    exact = solve(plate.system(), (0, 1.5), start, params=plate.params, rtol=1e-11)
    found = integrate_both_ways(
        plate.system(), (0, 1.5), start, params=plate.params, solver=stepping(0.01),
        options=PrintedOptions(tail=tail),
    )  # fmt: skip
    assert found.events.guard.tolist() == exact.events.guard.tolist()
    assert found.events.direction.tolist() == exact.events.direction.tolist()
    assert np.abs(found.events.time - exact.events.time).max() < 1e-4
    assert np.abs(found.y_end - exact.y_end).max() < 1e-3


def test_two_regions_lose_springs_that_touch_while_the_plate_rises():
    """One velocity does not part the landings from the lift-offs of a tilted plate."""
    plate = Plate(2)
    start = (0.0, 2.0, 0.3, 0.0, 0.0, 0.0)
    exact = solve(plate.system(), (0, 1.2), start, params=plate.params, rtol=1e-11)
    both = integrate_both_ways(
        plate.system(), (0, 1.2), start, params=plate.params, solver=stepping(0.005)
    )
    parts = (
        region_of(plate.system(), plate.params, orientation=(k, k)) for k in (1, -1)
    )
    two = integrate_alternating(
        *parts, (0, 1.2), start, velocity=4, solver=stepping(0.005)
    )
    rising = exact.events.before[:, 4] * exact.events.direction > 0
    assert rising.any()
    assert len(both.events) == len(exact.events)
    errors = [np.abs(one.y_end - exact.y_end).max() for one in (both, two)]
    assert errors[0] < 1e-4
    assert errors[1] > 5e-3
    lost = two.events.before[:, 4] * two.events.direction > 0
    assert lost.sum() < rising.sum()
