"""`solution(t)`: the state at any time, on both sides of an event, as accurate as the method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hybrid_systems import ball, growth, ladder
from test_derived import bounce_undone

from hopdata.hybrid import System, field, solve


@field
def swing_field(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], -y[0] - np.sin(y[0]) + np.cos(2.0 * t)


SWING = System(swing_field, n_states=2)
TIMES = np.linspace(0.0, 4.0, 3001)


@pytest.mark.parametrize(
    ("method", "order"), [("dopri5", 5), ("dop853", 8), ("rosenbrock", 5)]
)
def test_it_has_the_order_of_the_method(method, order):
    exact = solve(SWING, (0, 4), [1.0, 0.0], rtol=2.3e-15, atol=1e-15, t_eval=TIMES).y
    steps, errors = 4.0 / np.array([16, 24, 32, 48]), []
    for step in steps:
        options = {"rtol": 0.5, "atol": 0.1, "first_step": step, "max_step": step}
        solution = solve(
            SWING, (0, 4), [1.0, 0.0], method=method, dense_output=True, **options
        )
        assert solution.n_steps == round(4.0 / step)
        errors.append(np.abs(solution(TIMES) - exact).max())
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope > order - 0.6, errors


@pytest.mark.parametrize("backward", [False, True])
def test_both_sides_of_an_event(backward):
    system, options = replace(ball(), undo=bounce_undone), {"params": (2.0, 0.0, 0.5)}
    solution = solve(system, (0.0, 2.5), [1.0, 0.0], dense_output=True, **options)
    if backward:
        solution = solve(
            system, (2.5, 0.0), solution.y_end, dense_output=True, **options
        )
    first = np.sort(np.unique(solution.events.time))[0]
    assert first == pytest.approx(1.0, abs=1e-13)
    assert solution(first, side="left") == pytest.approx([0.0, -2.0], abs=1e-12)
    assert solution(first, side="right") == pytest.approx([0.0, 1.0], abs=1e-12)
    around = first + np.array([-1e-9, 1e-9])
    assert solution(around)[1] == pytest.approx([-2.0, 1.0], abs=1e-8)
    times = np.array([0.2, 0.5, 1.3, 1.9, 2.2])
    height = np.where(times < 1, 1 - times**2, (times - 1) * (2 - times))
    height = np.where(times > 2, (times - 2) * (2.5 - times), height)
    assert solution(times)[0] == pytest.approx(height, abs=1e-12)


def test_only_when_asked_for_and_only_within():
    plain = solve(ladder(1), (0, 1), [0.0, 0.0], params=(5.0, 1.0))
    assert plain.dense is None
    with pytest.raises(ValueError, match="dense_output=True"):
        plain(0.5)
    dense = solve(ladder(1), (0, 1), [0.0, 0.0], params=(5.0, 1.0), dense_output=True)
    for wrong, told in (
        (-0.1, "-0.1"),
        (1.1, "1.1"),
        (np.nan, "nan"),
        ([0.5, 2.0], "2."),
    ):
        with pytest.raises(
            ValueError, match=rf"times within \(0.0, 1.0\), found \[ *{told}\]"
        ):
            dense(wrong)
    with pytest.raises(ValueError, match="side"):
        dense(0.5, side="above")
    with pytest.raises(ValueError, match="dense_output: expected True or False"):
        solve(ladder(1), (0, 1), [0.0, 0.0], params=(5.0, 1.0), dense_output="yes")
    assert dense(0.5).shape == (2,)
    assert dense([0.5]).shape == (2, 1)
    assert dense([]).shape == (2, 0)


def test_long_ones_failed_ones_and_ones_without_a_step():
    long = solve(
        ball(), (0, 301), [1.0, 0.0], params=(2.0, 0.0, 1.0), dense_output=True
    )
    times = np.linspace(0, 301, 1001)[:-1]
    part = (times + 1) % 2 - 1
    assert np.abs(long(times)[0] - (1 - part**2)).max() < 1e-9
    failed = solve(growth(), (0, 9), [1.0, 0.0], params=(0.7, 4.0), dense_output=True)
    assert failed.status < 0
    assert failed(failed.t_end).tolist() == failed.y_end.tolist()
    assert failed(1.0)[0] == pytest.approx(np.exp(0.7), rel=1e-8)
    still = solve(ladder(1), (1, 1), [0.2, 0.0], params=(5.0, 1.0), dense_output=True)
    assert still(1.0).tolist() == [0.2, 0.0]


def turns(t, y, p):
    return p[0] * y[1], -p[0] * y[0]


@pytest.mark.parametrize("method", ["dopri5", "dop853"])
def test_states_near_the_largest_number_are_never_nan_with_success(method):
    """Polynomials overflow before states do; the control is of moderate size."""
    system = System(turns, n_states=2)
    rng = np.random.default_rng(31)
    ended = []
    for size in (1.0, *10.0 ** rng.uniform(305.5, 308.2, 12)):
        pace = 10.0 ** rng.uniform(-3.0, 1.0)
        end = 10.0 / pace
        times = np.linspace(0.0, end, 57)
        options = {"params": [pace], "rtol": 1e-6, "method": method}
        sampled = solve(system, (0, end), [size, 0.0], t_eval=times, **options)
        dense = solve(system, (0, end), [size, 0.0], dense_output=True, **options)
        expected = np.cos(pace * times)
        if sampled.success:
            np.testing.assert_allclose(sampled.y[0] / size, expected, atol=1e-3)
        if dense.success:
            np.testing.assert_allclose(dense(times)[0] / size, expected, atol=1e-3)
        ended.append(sampled.success and dense.success)
    assert ended[0]
    assert 1 < sum(ended) < len(ended)
