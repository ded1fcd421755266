"""The plain-Python Dormand-Prince stepper."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball, ladder, throw
from scipy.integrate import RK45

from hopdata.hybrid.printed import PrintedOptions, region_of
from hopdata.hybrid.printed.classical import Dopri5, dopri5_step
from hopdata.scenes.small import octant


def slope(t, y):
    return y * np.cos(t)


def run(stepper):
    times = [stepper.t]
    while stepper.status == "running":
        stepper.step()
        times.append(stepper.t)
    return np.array(times)


def test_one_step_is_of_fifth_order():
    steps, errors, estimates = 0.4 / 2.0 ** np.arange(5), [], []
    for dt in steps:
        end, last, error = dopri5_step(slope, 0.0, np.ones(1), np.ones(1), dt)
        errors.append(abs(end[0] - np.exp(np.sin(dt))))
        estimates.append(abs(error[0]))
        assert last == pytest.approx(slope(dt, end))
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] > 5.8
    assert np.polyfit(np.log(steps), np.log(estimates), 1)[0] == pytest.approx(5.0, abs=0.4)


def test_one_step_is_that_of_scipy():
    dt, y = 0.3, np.array([0.7, -1.2])
    theirs = RK45(slope, 0.5, y, 0.5 + dt, first_step=dt, rtol=1.0, atol=1e9)
    theirs.step()
    end, _, _ = dopri5_step(slope, 0.5, y, slope(0.5, y), dt)
    assert theirs.status == "finished"
    assert end == pytest.approx(theirs.y, abs=1e-15)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-7, 1e-10])
def test_the_error_follows_the_tolerance(tolerance):
    stepper = Dopri5(slope, 0.0, np.ones(1), 6.0, rtol=tolerance, atol=tolerance)
    run(stepper)
    assert stepper.t == 6.0
    error = abs(stepper.y[0] - np.exp(np.sin(6.0)))
    assert error < 20 * tolerance
    assert error > 1e-4 * tolerance


def test_longest_and_first_step():
    times = run(Dopri5(slope, 0.0, np.ones(1), 1.0, max_step=0.125, first_step=0.05, atol=1e9))
    assert np.diff(times)[0] == pytest.approx(0.05)
    assert np.diff(times)[1:-1] == pytest.approx(0.125)
    assert times[-1] == 1.0
    with pytest.raises(ValueError, match="max_step"):
        Dopri5(slope, 0.0, np.ones(1), 1.0, max_step=0.0)


def test_a_pole_is_a_failure():
    stepper = Dopri5(lambda _, y: y * y, 0.0, np.ones(1), 2.0)
    with np.errstate(over="ignore", invalid="ignore"):
        run(stepper)
    assert stepper.status == "failed"
    assert stepper.t == pytest.approx(1.0)


def test_nothing_to_do_is_finished():
    assert Dopri5(slope, 1.0, np.ones(1), 1.0).status == "finished"


# Locks at a start, and orientation.


def test_locks_are_signs():
    region = region_of(octant())
    assert region.first_locks(0.0, np.array([-0.4, 0.15, 0.3])).tolist() == [-1, 1, -1]


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_a_guard_at_zero_has_the_mode_it_moves_into(zero):
    rising = region_of(throw(), (10.0, 1.0))
    assert rising.first_locks(0.0, np.array([1.0 + zero, 2.0])).tolist() == [1]
    assert rising.first_locks(0.0, np.array([1.0 + zero, -2.0])).tolist() == [-1]
    falling = region_of(throw(), (10.0, 1.0), orientation=(-1,))
    assert falling.first_locks(0.0, np.array([1.0 + zero, -2.0])).tolist() == [1]


def test_a_guard_at_rest_at_zero_is_not_crossed():
    assert region_of(throw(), (10.0, 1.0)).first_locks(0.0, np.array([1.0, 0.0])).tolist() == [-1]


def test_the_orientation_turns_events_and_mode():
    region, y = region_of(octant(), orientation=(1, -1, 1)), np.array([0.1, 0.2, 0.3])
    h, rates = region.events(0.0, y, np.array([1.0, 2.0, 3.0]), np.array([1, -1, -1]))
    assert h.tolist() == [0.1, -0.2, -0.3]
    assert rates.tolist() == [1.0, -2.0, -3.0]
    assert region.mode(np.array([1, -1, -1])).tolist() == [1, 1, -1]


def test_what_cannot_be_done_is_said():
    with pytest.raises(ValueError, match="on_event"):
        region_of(ball())
    for wrong in ((1,), (1, 0), (1, 1, 1)):
        with pytest.raises(ValueError, match="orientation"):
            region_of(ladder(2), orientation=wrong)
    with pytest.raises(ValueError, match="root_finder"):
        PrintedOptions(root_finder="newton")
