"""Numba's long messages in one line, with what to do."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from hopdata.hybrid import SlowCallbackWarning, field
from hopdata.hybrid.compiled.diagnosis import LONGEST, reason_and_advice

TABLE = {"gravity": 9.81}
HISTORY = [1.0]


def helper(x):
    return 2.0 * x


class Robot:
    mass = 2.0


ROBOT = Robot()


def with_dictionary(t, y, mode, params, dy):
    dy[0] = TABLE["gravity"]


def with_helper(t, y, mode, params, dy):
    dy[0] = helper(y[0])


def with_object(t, y, mode, params, dy):
    dy[0] = ROBOT.mass


def with_format(t, y, mode, params, dy):
    print(f"{t:.3f}")
    dy[0] = 1.0


def with_list(t, y, mode, params, dy):
    HISTORY.append(t)
    dy[0] = 1.0


def with_unknown_function(t, y, mode, params, dy):
    dy[0] = np.busday_count("2020-01-01", "2020-01-02")


CASES = [
    (with_dictionary, "TABLE", "numba.njit"),
    (with_helper, "helper", "decorate 'helper' by @numba.njit"),
    (with_object, "ROBOT", "numba.njit"),
    (with_format, "f-strings", "numba.njit"),
    (with_list, "HISTORY", "numba.njit"),
    (with_unknown_function, "busday_count", "numba.njit"),
]


@pytest.mark.parametrize(
    ("function", "reason", "advice"), CASES, ids=lambda one: getattr(one, "__name__", one)
)
def test_reason_and_advice_in_one_line(function, reason, advice):
    with pytest.warns(SlowCallbackWarning) as seen:
        assert field(function).address > 0
    assert len(seen) == 1
    text = str(seen[0].message)
    for word in (function.__name__, "test_diagnosis.py:", reason, advice, "compiled=False"):
        assert word in text
    assert "\n" not in text
    assert seen[0].filename == __file__
    assert seen[0].lineno == function.__code__.co_firstlineno


def test_the_warning_comes_once():
    one = field(with_dictionary)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        assert one.address == one.address
        assert not one.compiled
    assert len(seen) == 1


def test_no_warning_if_python_is_asked_for():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert field(with_dictionary, compiled=False).address > 0


def test_errors_without_words():
    reason, _ = reason_and_advice(AssertionError())
    assert reason == "AssertionError inside Numba"


def test_colours_and_length():
    reason, _ = reason_and_advice(ValueError("Failed in mode\n\x1b[1mTell" + 500 * " me"))
    assert reason.startswith("Tell me")
    assert reason.endswith("...")
    assert len(reason) <= LONGEST + 4
