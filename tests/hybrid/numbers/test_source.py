"""Which guards are known to be smooth from their source."""

from __future__ import annotations

import math

import guard_sources
import pytest
from guard_sources import (
    BRANCHING,
    NOT_SMOOTH,
    VARYING,
    again,
    any_number,
    back,
    bend,
    fold,
    has_smooth_roots,
    positional_only,
    smooth,
    there,
    wrapped,
)

from hopdata.hybrid.numbers import source
from hopdata.hybrid.numbers.source import may_branch


def test_a_choice_by_mode_parameters_or_number_is_smooth():
    assert not may_branch(smooth, VARYING)


def test_roots_and_powers_that_stay_off_zero_are_smooth():
    assert not may_branch(has_smooth_roots, VARYING)


@pytest.mark.parametrize("function", BRANCHING + NOT_SMOOTH)
def test_a_choice_by_what_varies_is_found(function):
    assert may_branch(function, VARYING)


def test_a_helper_is_judged_by_the_arguments_that_vary():
    assert not may_branch(bend.py_func, (0,))
    assert may_branch(bend.py_func, (1,))


def test_positional_only_arguments_have_their_places():
    assert may_branch(positional_only, (2,))
    assert not may_branch(positional_only, (0, 1))


def test_what_cannot_be_followed_may_branch():
    assert may_branch(any_number, (0,))
    assert may_branch(again.py_func, (0,))
    assert may_branch(there.py_func, (0,))
    assert may_branch(wrapped(smooth), VARYING)


def test_a_recursive_function_is_read_once(monkeypatch):
    read = []
    definition = source.definition

    def counted(function):
        read.append(function)
        return definition(function)

    monkeypatch.setattr(source, "definition", counted)
    assert may_branch(there.py_func, (0,))
    assert read == [there.py_func, back.py_func]


@pytest.mark.parametrize(("terms", "expected"), [(10, False), (900, True)])
def test_an_expression_too_deep_to_be_followed_may_branch(tmp_path, terms, expected):
    path = tmp_path / "deep.py"
    path.write_text(f"def deep(t):\n    return math.sin({' + '.join(terms * ['t'])})\n")
    made: dict[str, object] = {"math": math}
    exec(compile(path.read_text(), str(path), "exec"), made)
    assert may_branch(made["deep"], (0,)) is expected


def test_the_answer_follows_a_helper_that_is_defined_anew(monkeypatch):
    assert not may_branch(smooth, VARYING)
    monkeypatch.setattr(guard_sources, "bend", fold)
    assert may_branch(smooth, VARYING)


def test_a_function_without_source_may_branch():
    made: dict[str, object] = {}
    exec("def g(t, y, dy, mode, params, h, hdot):\n    h[0] = y[0]\n", made)
    assert may_branch(made["g"], VARYING)


def whole_power_of_a_parameter(t, y, dy, mode, params, h, hdot):
    h[0] = (y[0] - 1.0) ** int(params[0])
    hdot[0] = 0.0


def power_of_a_parameter(t, y, dy, mode, params, h, hdot):
    h[0] = (y[0] ** 2) ** params[0]
    hdot[0] = 0.0


def test_a_power_is_smooth_only_if_its_exponent_is_whole():
    assert not may_branch(whole_power_of_a_parameter, (0, 1, 2))
    assert may_branch(power_of_a_parameter, (0, 1, 2))
