"""The plain-Python Dormand-Prince stepper."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import RK45

from hopdata.hybrid.printed.dopri5 import Dopri5, dopri5_step


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
