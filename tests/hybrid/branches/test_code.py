"""Which guards are known to be smooth from their source, and which are compiled for ranges."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from numba import njit

from hopdata.hybrid import System, field, guard, guards
from hopdata.hybrid.branches import source
from hopdata.hybrid.branches.code import NO_CODE, branches_of
from hopdata.hybrid.branches.source import may_branch

VARYING = (0, 1, 2, 5, 6)  # t, y, dy, h, hdot


@njit
def bend(u, kind):
    if kind > 0:
        return math.sin(u)
    return u * u


@njit
def fold(u, kind):
    return u if u > 0.0 else -u * kind


def smooth(t, y, dy, mode, params, h, hdot):
    gain = 1.0 if mode[0] > 0 else params[0]
    for k in range(len(h)):
        if k > 0 and params[1] > 0.5:
            gain = 2.0
        h[k] = gain * np.cos(y[k]) + bend(t, mode[1])
        hdot[k] = -gain * np.sin(y[k]) * dy[k]


def compares(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] if y[0] > params[0] else 0.0
    hdot[0] = dy[0]


def compares_later(t, y, dy, mode, params, h, hdot):
    u = params[0]
    for _ in range(2):
        u = u + t
    h[0] = 1.0
    if u > 0.0:
        h[0] = 2.0
    hdot[0] = dy[0]


def compares_what_it_wrote(t, y, dy, mode, params, h, hdot):
    h[0] = y[0]
    while h[0] > 1.0:
        h[0] -= 1.0
    hdot[0] = dy[0]


def has_a_rest(t, y, dy, mode, params, h, hdot):
    h[0] = t % 1.0
    hdot[0] = dy[0]


def has_a_corner(t, y, dy, mode, params, h, hdot):
    h[0] = max(0.0, y[0])
    hdot[0] = dy[0]


def reads_a_table(t, y, dy, mode, params, h, hdot):
    h[0] = params[int(y[0])]
    hdot[0] = dy[0]


def has_a_helper(t, y, dy, mode, params, h, hdot):
    h[0] = fold(y[0], 1.0)
    hdot[0] = dy[0]


def has_a_logical_value(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] * (y[0] > 0.0)
    hdot[0] = dy[0]


def has_a_method(t, y, dy, mode, params, h, hdot):
    h[0] = y.max() - 1.0
    hdot[0] = dy[0]


def has_an_index_of_the_largest(t, y, dy, mode, params, h, hdot):
    h[0] = 1.0 * y.argmax()
    hdot[0] = dy[0]


def has_whole_numbers(t, y, dy, mode, params, h, hdot):
    h[0] = y.astype(int)[0]
    hdot[0] = dy[0]


def has_a_list(t, y, dy, mode, params, h, hdot):
    sizes = [abs(v) for v in y]
    h[0] = sizes[0]
    hdot[0] = dy[0]


def has_a_list_by_number(t, y, dy, mode, params, h, hdot):
    sizes = [abs(v) for v in [t, 1.0]]
    h[0] = sizes[0]
    hdot[0] = dy[0]


def has_a_shorter_list(t, y, dy, mode, params, h, hdot):
    h[0] = 1.0 * len([1.0 for k in range(2) if y[k]])
    hdot[0] = dy[0]


def hides_a_helper(t, y, dy, mode, params, h, hdot):
    bend = max
    h[0] = bend(y[0], 0.0)
    hdot[0] = dy[0]


def has_a_root_of_a_square(t, y, dy, mode, params, h, hdot):
    h[0] = (y[0] ** 2) ** 0.5
    hdot[0] = dy[0]


def has_a_power_by_parameter(t, y, dy, mode, params, h, hdot):
    h[0] = (y[0] * y[0]) ** params[0]
    hdot[0] = dy[0]


def has_a_power_in_place(t, y, dy, mode, params, h, hdot):
    u = y[0] * y[0]
    u **= 0.5
    h[0] = u
    hdot[0] = dy[0]


def has_a_square_root(t, y, dy, mode, params, h, hdot):
    h[0] = np.sqrt(y[0] ** 2)
    hdot[0] = dy[0]


def has_a_length(t, y, dy, mode, params, h, hdot):
    h[0] = math.hypot(y[0], y[1])
    hdot[0] = dy[0]


def has_a_zigzag(t, y, dy, mode, params, h, hdot):
    h[0] = math.acos(math.cos(t))
    hdot[0] = dy[0]


def has_no_zero(t, y, dy, mode, params, h, hdot):
    h[0] = not t
    hdot[0] = dy[0]


def writes_by_another_name(t, y, dy, mode, params, h, hdot):
    room = np.zeros(2)
    part = room[:1]
    part[0] = y[0]
    h[0] = 1.0 if room[0] > 0.0 else 0.0
    hdot[0] = dy[0]


@njit
def put(room, u):
    room[0] = u


def writes_by_a_helper(t, y, dy, mode, params, h, hdot):
    room = np.zeros(2)
    put(room, y[0])
    h[0] = 1.0 if room[0] > 0.0 else 0.0
    hdot[0] = dy[0]


def has_a_function_inside(t, y, dy, mode, params, h, hdot):
    def height():
        return y[0]

    h[0] = 1.0 if height() > 0.0 else 0.0
    hdot[0] = dy[0]


NOT_SMOOTH = (
    has_a_method, has_an_index_of_the_largest, has_whole_numbers, has_a_list, has_a_list_by_number,
    has_a_root_of_a_square, has_a_power_by_parameter, has_a_power_in_place, has_a_square_root,
    has_a_length, has_a_zigzag, has_no_zero, writes_by_another_name, writes_by_a_helper,
    has_a_function_inside, has_a_shorter_list, hides_a_helper,
)  # fmt: skip


def has_smooth_roots(t, y, dy, mode, params, h, hdot):
    h[0] = np.sqrt(2.0) * y[0] - params[0] ** 0.5 + y[1] ** 3 + 2.0**t
    h[1] = math.sqrt(1.0 + y[0] ** 2 + y[1] * y[1]) + math.hypot(1.0, y[0])
    h[2] = sum([params[k] for k in range(2)]) + math.exp(t) ** 0.5
    put(h, y[0])
    doubled = [2.0 * v for v in y]
    h[3] = doubled[0]
    hdot[0] = dy[0]


def positional_only(t, y, /, mode):
    return 1.0 if mode > 0.0 else t + y


def any_number(*u):
    return abs(u[0])


@njit
def again(u, n):
    return again(0.5 * u, n - 1) + u


@njit
def there(u):
    return back(u)


@njit
def back(u):
    return there(u)


def wrapped(function):
    @functools.wraps(function)
    def folded(t, y, dy, mode, params, h, hdot):
        h[0] = abs(y[0])

    return folded


BRANCHING = (
    compares, compares_later, compares_what_it_wrote, has_a_rest, has_a_corner, reads_a_table,
    has_a_helper, has_a_logical_value,
)  # fmt: skip


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
    monkeypatch.setitem(globals(), "bend", fold)
    assert may_branch(smooth, VARYING)


def test_a_function_without_source_may_branch():
    made: dict[str, object] = {}
    exec("def g(t, y, dy, mode, params, h, hdot):\n    h[0] = y[0]\n", made)
    assert may_branch(made["g"], VARYING)


@field
def still(t, y, mode, params, dy):
    dy[0] = 0.0


@guards
def sums(t, y, dy, mode, params, h, hdot):
    h[0] = np.sum(np.where(params > y[0], 1.0, 0.0))
    hdot[0] = 0.0


@guard
def one_of_many(t, y, dy, mode, params, k, h, hdot):
    h[k], hdot[k] = abs(y[0]) - k, dy[0]


def test_code_for_ranges():
    assert branches_of(guards(smooth)).address == 0
    assert branches_of(None).address == 0
    for function in BRANCHING:
        if function is not reads_a_table:
            made = branches_of(guards(function))
            assert made.address > 0, made.reason
    assert branches_of(one_of_many).address > 0


def test_why_there_is_none_for_guards_that_use_arrays():
    made = branches_of(sums)
    assert made.address == NO_CODE
    assert "Range" in made.reason
    system = System(still, sums, n_states=1, guard_names=("sum",))
    assert system.branches.address == NO_CODE


def whole_power_of_a_parameter(t, y, dy, mode, params, h, hdot):
    h[0] = (y[0] - 1.0) ** int(params[0])
    hdot[0] = 0.0


def power_of_a_parameter(t, y, dy, mode, params, h, hdot):
    h[0] = (y[0] ** 2) ** params[0]
    hdot[0] = 0.0


def test_a_power_is_smooth_only_if_its_exponent_is_whole():
    assert not may_branch(whole_power_of_a_parameter, (0, 1, 2))
    assert may_branch(power_of_a_parameter, (0, 1, 2))
