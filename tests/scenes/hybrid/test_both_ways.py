"""Regions in a chain: terminal guards, handlers between regions, states in between."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import RK45

from hopdata.hybrid import on_event, solve
from hopdata.hybrid.printed import (
    FixedSteps,
    PrintedOptions,
    Stepping,
    dopri5_step,
    integrate_alternating,
    integrate_both_ways,
    region_of,
    states_at,
)
from hopdata.scenes.plate import Plate
from hopdata.scenes.vertical_hopper import VerticalHopper

HOPPER = VerticalHopper()
SYSTEM = HOPPER.system()
START = (2.0, 0.0)
SPAN = (0.0, 2.0)
STEP_S = 0.002
RESTART = PrintedOptions(tail="restart")


def run(system=SYSTEM, span=SPAN, step=STEP_S, **options):
    solver = Stepping(RK45, {"rtol": 1e-9, "atol": 1e-12, "max_step": step})
    return integrate_both_ways(
        system, span, START, params=HOPPER.params, solver=solver, **options
    )


def exact(system=SYSTEM, **options):
    return solve(
        system, SPAN, START, params=HOPPER.params, rtol=1e-11, atol=1e-13, **options
    )


@pytest.mark.parametrize("tail", ["heun", "restart"])
@pytest.mark.parametrize("count", [1, 3])
def test_a_terminal_guard_ends_the_trajectory_at_its_event(tail, count):
    ending = replace(SYSTEM, terminal=(count,))
    found = run(ending, options=PrintedOptions(tail=tail))
    wanted = exact(ending)
    assert wanted.status == found.status == 1
    assert len(found.events) == count
    assert found.t_end == found.events.time[-1] == pytest.approx(wanted.t_end, abs=1e-6)
    assert found.y_end == pytest.approx(wanted.y_end, abs=1e-5)
    assert found.mode.tolist() == wanted.mode.tolist()
    assert len(found.step_modes) == len(found.t) - 1
    assert run().status == 0


def test_of_several_events_in_a_step_those_after_the_terminal_one_are_cut():
    plate = Plate(5)
    start = plate.initial_states(1, seed=4)[0]
    system = plate.system()
    first = int(solve(system, (0, 1), start, params=plate.params).events.guard[0])
    ends = replace(system, terminal=tuple(k == first for k in range(5)))
    # Several springs are touched in one step.
    solver = Stepping(RK45, {"rtol": 1e-3, "atol": 1e-3, "max_step": 0.1})
    options = {"params": plate.params, "solver": solver}
    whole = integrate_both_ways(system, (0.0, 1.0), start, **options)
    cut = integrate_both_ways(ends, (0.0, 1.0), start, **options)
    n = len(cut.t)
    assert cut.events.guard.tolist() == [first]
    assert cut.t_end == cut.events.time[0] == whole.events.time[0]
    assert cut.t.tolist() == whole.t[:n].tolist()
    assert cut.step_modes.tolist() == whole.step_modes[: n - 1].tolist()
    assert whole.step_modes[n - 1, first] == -cut.step_modes[-1, first]


def test_crossings_in_a_silent_direction_turn_the_guard_only():
    one_way = replace(SYSTEM, directions=(1,))
    found, wanted = run(one_way), exact(one_way)
    assert found.events.direction.tolist() == wanted.events.direction.tolist() == [1, 1]
    assert found.y_end == pytest.approx(run().y_end, abs=0)
    assert len(run().events) == 4


@on_event
def third_ends(_t, _y, mode, _p, guard, direction):
    mode[1] += 1
    if mode[1] == 3:
        return 1
    return 0


@on_event
def reset(_t, y, _mode, _p, guard, direction):
    y[1] = -y[1]
    return 0


COUNTED = replace(SYSTEM, on_event=third_ends, n_extra_modes=1)


def test_a_handler_chooses_the_mode_of_the_next_region_and_may_end_it():
    found, wanted = run(COUNTED, options=RESTART), exact(COUNTED)
    assert found.mode.tolist() == wanted.mode.tolist() == [-1, 3]
    assert found.t_end == pytest.approx(wanted.t_end, abs=1e-6)
    assert found.status == 1
    assert sorted(set(found.step_modes[:, 1])) == [0, 1, 2]


def test_a_given_mode_is_where_it_starts():
    side = run(span=(0.0, 0.1)).mode[0]
    found = run(COUNTED, mode=[side, 2], options=RESTART)
    assert found.mode.tolist() == [-side, 3]
    assert len(found.events) == 1
    # A guard that is past its surface is crossed at once.
    past = run(COUNTED, mode=[-side, 2], options=RESTART)
    assert past.events.time.tolist() == [0.0]


def test_what_a_handler_may_not_do_is_refused():
    resets = replace(SYSTEM, on_event=reset)
    with pytest.raises(ArithmeticError, match=r"changes the state at .*no resets"):
        run(resets, options=RESTART)
    with pytest.raises(ValueError, match=r"no on_event, unless .*tail='restart'"):
        run(COUNTED)
    with pytest.raises(ValueError, match="no n_memory"):
        run(replace(SYSTEM, n_memory=1))
    with pytest.raises(ValueError, match="mode"):
        run(COUNTED, mode=[1], options=RESTART)


def test_the_number_of_crossings_may_be_limited():
    assert run(max_events=3).status == -5
    assert len(run(max_events=3).events) == 3
    assert run(max_events=5).status == 0


# States between mesh points.


def test_states_between_mesh_points_have_the_order_of_the_splines():
    times = np.linspace(0.0, 2.0, 301)
    truth = exact(t_eval=times).y.T
    errors = []
    for step in (0.02, 0.01, 0.005):
        solver = FixedSteps(dopri5_step, step)
        found = integrate_both_ways(
            SYSTEM, SPAN, START, params=HOPPER.params, solver=solver, options=RESTART
        )
        states = states_at(found, SYSTEM, times, params=HOPPER.params)
        errors.append(np.abs(states - truth).max())
    ratios = np.divide(errors[:-1], errors[1:])
    assert np.all((ratios > 8) & (ratios < 32))
    on_mesh = states_at(found, SYSTEM, found.t, params=HOPPER.params)
    assert on_mesh == pytest.approx(found.y.T, abs=1e-12)


def test_times_outside_are_refused():
    with pytest.raises(ValueError, match="times_s"):
        states_at(run(), SYSTEM, [2.1], params=HOPPER.params)


@pytest.mark.parametrize("tail", ["heun", "restart"])
def test_two_regions_keep_the_mode_of_each_step_too(tail):
    falling, rising = (
        region_of(SYSTEM, HOPPER.params, orientation=(way,)) for way in (-1, 1)
    )
    solver = Stepping(RK45, {"rtol": 1e-9, "atol": 1e-12, "max_step": STEP_S})
    found = integrate_alternating(
        falling, rising, SPAN, START, solver=solver, options=PrintedOptions(tail=tail)
    )
    times = np.linspace(0.0, 2.0, 100)
    states = states_at(found, SYSTEM, times, params=HOPPER.params)
    assert states == pytest.approx(exact(t_eval=times).y.T, abs=1e-4)
