"""`solve_ivp`: what is refused, what is counted, and what is kept between calls."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp as scipys

from hopdata.hybrid import SlowCallbackWarning, solve_ivp
from hopdata.hybrid.ivp import _systems


def oscillates(t, y, rate, powers):
    return [rate * y[1], -rate * y[0] ** powers]


def crosses(t, y, rate, powers):
    return y[0]


crosses.terminal = 3
ARGS = (2.0, 1)
START = [1.0, 0.0]


def solved(**options):
    return solve_ivp(oscillates, (0, 10), START, args=ARGS, **options)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"method": "RK46"}, "method: expected one of RK23, RK45"),
        ({"min_step": 1e-3}, "min_step: cannot be given here; there is no smallest"),
        ({"jac_sparsity": np.eye(2)}, "jac_sparsity: cannot be given here"),
        ({"rtoll": 1e-3}, "rtoll: cannot be given here; it is no option"),
        ({"events": 3}, "events: expected a function, or a list of functions"),
        ({"jac": np.eye(3), "method": "Radau"}, r"jac: expected shape \(2, 2\)"),
        ({"t_eval": [11.0]}, "t_eval: expected increasing times within"),
    ],
)
def test_what_cannot_be_had_is_refused_in_one_sentence(options, said):
    with pytest.raises(ValueError, match=said) as caught:
        solved(**options)
    assert "\n" not in str(caught.value)


def test_wrong_states_and_arguments():
    with pytest.raises(ValueError, match="y0: expected real numbers, found complex"):
        solve_ivp(oscillates, (0, 1), [1j, 0.0], args=ARGS)
    with pytest.raises(ValueError, match="y0: expected numbers, found"):
        solve_ivp(oscillates, (0, 1), [[1.0], [0.0, 1.0]], args=ARGS)
    hidden = np.ma.masked_array(START, [True, False])
    with pytest.raises(ValueError, match="y0: expected finite numbers"):
        solve_ivp(oscillates, (0, 1), hidden, args=ARGS)
    with pytest.raises(ValueError, match=r"y0: expected shape \(n,\)"):
        solve_ivp(oscillates, (0, 1), [[1.0], [0.0]], args=ARGS)
    with pytest.raises(ValueError, match="the 1 values in args, found one of 4"):
        solve_ivp(oscillates, (0, 1), START, args=(1.0,))
    with pytest.raises(ValueError, match=r"args: .*; one value is written \(value,\)"):
        solve_ivp(oscillates, (0, 1), START, args=2.0)


def test_the_third_crossing_ends_it_as_in_scipy():
    options = {"args": ARGS, "events": crosses, "rtol": 1e-9, "atol": 1e-9}
    ours = solve_ivp(oscillates, (0, 10), START, **options)
    theirs = scipys(oscillates, (0, 10), START, **options)
    assert (ours.status, ours.success) == (theirs.status, theirs.success) == (1, True)
    exact = np.pi / 4 * np.array([1.0, 3.0, 5.0])
    assert ours.t_events[0] == pytest.approx(exact, rel=1e-8)
    assert theirs.t_events[0] == pytest.approx(exact, rel=1e-6)
    assert ours.y_events[0].shape == theirs.y_events[0].shape == (3, 2)
    assert ours["t"] is ours.t
    assert "t_events" in repr(ours)
    assert not hasattr(ours, "nothing")


def test_other_numbers_are_the_same_system_and_other_functions_are_not():
    _systems.clear()
    ends = []
    for rate in (1.0, 2.0):
        run = solve_ivp(oscillates, (0, 1), START, args=(rate, 1), rtol=1e-10)
        ends.append(run.y[0, -1])
    assert ends == pytest.approx(np.cos([1.0, 2.0]), abs=1e-5)
    assert len(_systems) == 1
    solve_ivp(oscillates, (0, 1), START, args=ARGS, events=crosses)
    assert len(_systems) == 2


def explodes(t, y):
    return y**2


def test_backward_and_failing():
    back = solve_ivp(
        oscillates, (1, 0), START, args=ARGS, t_eval=[0.5, 0.0], rtol=1e-10
    )
    assert back.y[0] == pytest.approx(np.cos([-1.0, -2.0]), abs=1e-5)
    failed = solve_ivp(explodes, (0, 2), [1.0])
    assert (failed.status, failed.success) == (-1, False)
    assert failed.t[-1] == pytest.approx(1.0, abs=1e-3)


def test_what_is_not_compiled_runs_as_python():
    table = {"rate": -1.0}

    def slow(t, y):
        return [table["rate"] * y[0]]

    def half(t, y):
        return y[0] - table.get("half", 0.5)

    with pytest.warns(SlowCallbackWarning):
        run = solve_ivp(slow, (0, 1), [1.0], events=half, rtol=1e-8, atol=1e-10)
    assert run.t_events[0] == pytest.approx([np.log(2.0)], rel=1e-6)


def test_matrices_and_constants_among_the_arguments():
    matrix = np.array([[0.0, 1.0], [-4.0, 0.0]])

    def linear(t, y, a, sign, name):
        return sign * (a @ y) if name == "linear" else y

    options = {"rtol": 1e-9, "atol": 1e-9}
    run = solve_ivp(linear, (0, 1), START, args=(matrix, True, "linear"), **options)
    assert run.y[0, -1] == pytest.approx(np.cos(2.0), abs=1e-6)
    assert run.nfev > 0
    implicit = solve_ivp(
        linear, (0, 1), START, "Radau", args=(matrix, 1, "linear"), jac=None, **options
    )
    assert implicit.y[0, -1] == pytest.approx(np.cos(2.0), abs=1e-6)
    assert implicit.nlu >= implicit.njev > 0
