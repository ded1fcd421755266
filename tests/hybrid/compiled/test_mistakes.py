# ruff: noqa: F841, RET503, RUF059 (mistakes as people make them)
"""Mistakes that people make in plain functions: which line, and why, in one sentence."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import interp1d

from hopdata.hybrid import SlowCallbackWarning, System, on_event, solve

TABLE = {"k": 2.0}
SEEN = []
CURVE = interp1d([0.0, 1.0], [0.0, 1.0], fill_value="extrapolate")
A = np.array([[0, 1], [1, 0]])


class Robot:
    mass = 2.0


ROBOT = Robot()


def reads_a_dictionary(t, y):
    return [TABLE["k"] * y[0]]


def reads_an_object(t, y):
    return [ROBOT.mass * y[0]]


def collects(t, y):
    SEEN.append(t)
    return [y[0]]


def interpolates(t, y):
    return [CURVE(t)]


def multiplies_whole_numbers(t, y):
    return (A @ np.array([y[0], 1.0]))[:1]


def catches(t, y):
    try:
        return [1.0 / y[0]]
    except ZeroDivisionError:
        return [0.0]


def sums_by_keyword(t, y):
    return [np.sum(y, where=[True])]


SLOW = [
    (reads_a_dictionary, "line {}: return [TABLE", "as params"),
    (reads_an_object, "line {}: return [ROBOT.mass", "out of 'ROBOT'"),
    (collects, "line {}: SEEN.append(t)", "the solution has them"),
    (interpolates, "line {}: return [CURVE(t)]", "np.interp"),
    (multiplies_whole_numbers, "line {}: return (A @", "arrays of floats"),
    (catches, "exception_match", "compiled=False"),
    (sums_by_keyword, "line {}: return [np.sum(y, where", "compiled=False"),
]


def name_of(function):
    return getattr(function, "__name__", None)


@pytest.mark.parametrize(("function", "line", "advice"), SLOW, ids=name_of)
def test_what_runs_slowly_is_told_with_its_line(function, line, advice):
    system = System(function)
    with pytest.warns(SlowCallbackWarning) as seen:
        assert solve(system, (0.0, 0.1), [1.0]).success
    text = str(seen[0].message)
    assert line.format(function.__code__.co_firstlineno + 1) in text
    assert advice in text
    assert "\n" not in text


def forgets_to_return(t, y):
    rates = [y[0]]


def forgets_to_fill(t, y, p):
    rates = p[0] * y


def yields(t, y):
    yield y[0]


def returns_on_one_path(t, y):
    if t < 0.5:
        return [y[0]]


def returns_text(t, y):
    return "fast"


def returns_a_matrix(t, y):
    return np.array([[1.0]])


def returns_complex_numbers(t, y):
    return [1j * y[0]]


def misspells(t, y):
    return [gravitty * y[0]]  # noqa: F821


def misspells_a_function(t, y):
    return [math.sinn(y[0])]


def unpacks_too_many(t, y):
    angle, rate = y
    return [angle]


def returns_too_many(t, y):
    return y[0], 1.0


WRONG = [
    (forgets_to_return, TypeError, "returns nothing; return the rates of the state"),
    (forgets_to_fill, TypeError, "returns nothing; return the rates of the state"),
    (yields, TypeError, "is a generator"),
    (returns_on_one_path, TypeError, "returns None on some path"),
    (returns_text, TypeError, "returns text; expected a tuple"),
    (returns_a_matrix, TypeError, "expected a tuple, a list or an array of numbers"),
    (returns_complex_numbers, TypeError, "expected a tuple, a list or an array"),
    (misspells, NameError, "'gravitty' is not defined"),
    (misspells_a_function, AttributeError, "module 'math' has no 'sinn'"),
    (unpacks_too_many, ValueError, "unpacks y into 2 names, but y has the length 1"),
    (returns_too_many, ValueError, "returns 2 numbers; expected 1, the number of stat"),
]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("function", "error", "said"), WRONG, ids=name_of)
def test_what_is_wrong_is_an_error_at_its_place(function, error, said):
    with pytest.raises(error) as caught:
        solve(System(function), (0.0, 1.0), [1.0])
    text = str(caught.value).partition("\n")[0]
    assert said in text
    assert f"field '{function.__name__}' (" in text
    assert f"test_mistakes.py:{function.__code__.co_firstlineno})" in text


def test_a_handler_that_returns_a_whole_number():
    @on_event
    def stop(t, y):
        return 0

    with pytest.raises(TypeError, match=r"on_event 'stop' .*0\.0 and not 0"):
        _ = stop.address
