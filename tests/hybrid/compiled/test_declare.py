"""A wrong declaration is reported in one line, at its place."""

from __future__ import annotations

import functools
import warnings

import numpy as np
import pytest
from numba import njit

from hopdata.hybrid import (
    SlowCallbackWarning,
    System,
    affine,
    field,
    guard,
    guards,
    jacobian,
    on_event,
    rate_bound,
    solve,
)
from hopdata.hybrid.compiled.declare import (
    LONGEST,
    elements_named,
    largest_subscripts,
    reason_and_advice,
)
from hopdata.hybrid.compiled.kernel import SIGNATURES

DECORATORS = (field, guards, guard, rate_bound, on_event, jacobian, affine)


def test_too_few_arguments():
    with pytest.raises(TypeError, match=r"field 'f' .* takes 4 arguments") as caught:

        @field
        def f(t, y, mode, params):
            params[0] = 1.0

    assert "expected f(t, y, mode, params, dy)" in str(caught.value)
    assert "test_declare.py:" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_arguments_of_another_decorator():
    with pytest.raises(TypeError, match=r"takes 7 arguments.*those of @guards"):

        @field
        def h(t, y, dy, mode, params, h, hdot):
            h[0] = hdot[0] = 0.0

    with pytest.raises(TypeError, match="has the arguments of @jacobian"):

        @field
        def j(t, y, mode, params, jac):
            jac[0, 0] = 1.0


def test_an_array_that_is_never_filled():
    with pytest.raises(TypeError, match="never uses dy; fill it in place"):

        @field
        def f(t, y, mode, params, dy):
            return np.array([y[1], -9.81])

    with pytest.raises(TypeError, match="never uses hdot"):

        @guards
        def g(t, y, dy, mode, params, h, hdot):
            h[0] = y[0]


def test_an_array_whose_name_is_given_away():
    with pytest.raises(TypeError, match=r"reassigns dy; .* dy\[:\] = "):

        @field
        def f(t, y, mode, params, dy):
            dy = np.array([y[1], -9.81])
            return dy  # noqa: RET504


def test_a_returned_array_is_told_when_it_is_compiled():
    @field
    def f(t, y, mode, params, dy):
        dy[0] = y[1]
        return dy

    with pytest.raises(
        TypeError, match=r"field 'f' .* returns an array; fill dy in place"
    ):
        solve(System(f, n_states=2), (0, 1), [0.0, 0.0])


def test_a_handler_that_returns_on_some_paths_only():
    @on_event
    def e(t, y, mode, params, guard, direction):
        if guard > 0:
            return None
        return 1

    with pytest.raises(TypeError, match="returns None; return 0 to go on, 1 to stop"):
        _ = e.address


def test_names_that_nobody_has_defined():
    @field
    def f(t, y, mode, params, dy):
        dy[0] = gravitty  # noqa: F821

    with pytest.raises(NameError, match=r"field 'f' .* name 'gravitty' is not defined"):
        _ = f.address


def test_not_a_function():
    with pytest.raises(TypeError, match="@field: expected a function, found 3"):
        field(3)


def test_one_callback_for_another():
    @guards
    def g(t, y, dy, mode, params, h, hdot):
        h[0] = hdot[0] = 0.0

    with pytest.raises(
        TypeError, match="field: expected a function declared by @field"
    ):
        System(g, n_states=1)


def test_what_is_allowed():
    def f(time, state, mode, numbers, rates):  # other names
        rates += state

    def nested(t, y, mode, params, dy):
        def fill():
            dy[0] = 1.0

        fill()

    def more(factor, t, y, mode, params, dy, extra=1.0):
        dy[0] = factor * extra

    def any_number(*arguments):
        arguments[-1][0] = 1.0

    for one in (f, nested, any_number, functools.partial(more, 2.0), njit(f)):
        assert callable(field(one, compiled=False))
        assert callable(field(compiled=False)(one))


@pytest.mark.parametrize("decorator", DECORATORS, ids=lambda one: one.__name__)
def test_every_decorator_compiles_a_function_of_its_signature(decorator):
    kind = SIGNATURES[decorator.__name__]
    names, result = ", ".join(kind.arguments), ""
    if not kind.fills:
        result = "return 1"
    scope: dict = {}
    body = "; ".join(f"{name}[:] = 1.0" for name in kind.fills) or "pass"
    exec(f"def one({names}):\n    {body}\n    {result}\n", scope)
    compiled, plain = decorator(scope["one"]), decorator(scope["one"], compiled=False)
    assert compiled.signature is plain.signature is kind
    assert min(compiled.address, plain.address) > 0
    assert compiled.compiled
    assert not plain.compiled
    assert kind.call("one") in decorator.__doc__.replace(
        f"{decorator.__name__}(", "one("
    )


def test_matrices_reach_python_in_their_shape():
    @jacobian(compiled=False)
    def j(t, y, mode, params, jac):
        jac[0, 1] = y[0]
        jac[1, 0] = jac.shape[0]

    jac = np.zeros((2, 2))
    j.dispatcher(0.0, np.array([3.0, 4.0]), np.zeros(0, np.int64), np.zeros(0), jac)
    assert jac.tolist() == [[0.0, 3.0], [2.0, 0.0]]


# Numba's long messages are reduced to one line with a remedy.

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


def slow_helper(x):
    return helper(x) + TABLE["gravity"]


def with_slow_helper(t, y, mode, params, dy):
    dy[0] = slow_helper(y[0])


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
    (with_dictionary, "TABLE", "as params"),
    (with_slow_helper, "TABLE", "as params"),
    (with_object, "ROBOT", "numba.njit"),
    (with_format, "f-strings", "numba.njit"),
    (with_list, "HISTORY", "numba.njit"),
    (with_unknown_function, "busday_count", "numba.njit"),
]


@pytest.mark.parametrize(
    ("function", "reason", "advice"),
    CASES,
    ids=lambda one: getattr(one, "__name__", one),
)
def test_reason_and_advice_in_one_line(function, reason, advice):
    with pytest.warns(SlowCallbackWarning) as seen:
        assert field(function).address > 0
    assert len(seen) == 1
    text = str(seen[0].message)
    for word in (
        function.__name__,
        "test_declare.py:",
        reason,
        advice,
        "compiled=False",
    ):
        assert word in text
    assert "\n" not in text
    assert seen[0].filename == __file__
    assert seen[0].lineno == function.__code__.co_firstlineno


def test_a_helper_is_compiled_with_the_function_that_calls_it():
    callback = field(with_helper)
    solution = solve(System(callback, n_states=1), (0.0, 1.0), [1.0])
    assert callback.compiled
    assert solution.y_end[0] == pytest.approx(np.exp(2.0), rel=1e-8)


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
    reason, _ = reason_and_advice(
        ValueError("Failed in mode\n\x1b[1mTell" + 500 * " me")
    )
    assert reason.startswith("Tell me")
    assert reason.endswith("...")
    assert len(reason) <= LONGEST + 4


# Elements named by number are compared with the system's lengths.


def test_reading_writing_and_changing():
    def f(t, y, mode, params, dy):
        dy[0], dy[1] = y[1], -params[3]
        if mode[2] > 0:
            dy[4] += 1.0

    assert largest_subscripts(f) == {"y": 1, "params": 3, "dy": 4, "mode": 2}


def test_numbers_that_are_no_subscripts():
    def f(t, y, mode, params, dy):
        dy[0] = y[-1] * 7 + max(t, 9) + (t < 5 < params[len(params) - 1])
        dy[1:3] = 0.0

    def g(t, y, mode, params, dy):
        y = np.append(y, 1.0)
        dy[0] = y[8] * 7 + max(t, 9) + (t < 5 < params[t])
        dy[1:3] = 0.0

    assert largest_subscripts(f) == {}  # it may look at the length before it reads
    assert largest_subscripts(g) == {"dy": 0}
    assert largest_subscripts(print) == {}


def test_elements_that_alone_can_matter():
    def g(t, y, dy, mode, params, h, hdot):
        for k in range(len(h)):
            h[k], hdot[k] = y[k] + params[0], dy[0] + y[1] * dy[3]

    assert elements_named(g, 2) == {0, 3}
    assert elements_named(g, 0) == frozenset()  # the time
    assert elements_named(g, 1) is None  # by a variable
    assert elements_named(print, 0) is None


def test_elements_that_may_all_matter():
    def handed_on(t, y, dy):
        return np.dot(y, dy) + dy[0]

    def from_the_end(t, y, dy):
        return dy[0] + dy[-1]

    def sliced(t, y, dy):
        return dy[0] + dy[1:3].sum()

    def renamed(t, y, dy):
        rate = dy
        return rate[4] + dy[0]

    def enclosed(t, y, dy):
        return dy[0] + sum(dy[k] for k in (1, 2))

    def replaced(t, y, dy):
        dy = y
        return dy[0]

    for function in (handed_on, from_the_end, sliced, renamed, enclosed, replaced):
        assert elements_named(function, 2) is None


@field
def spring(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -params[1] * y[0]


@guards
def walls(t, y, dy, mode, params, h, hdot):
    h[1] = y[0]
    hdot[1] = dy[0]


def test_too_few_states_or_guards():
    with pytest.raises(
        ValueError, match=r"field 'spring' .* uses y\[1\], but y has the length 1"
    ):
        System(spring, n_states=1)
    with pytest.raises(
        ValueError, match=r"guards 'walls' .* uses h\[1\], but h has the length 1"
    ):
        System(spring, walls, n_states=2, guard_names=("wall",))


def test_too_few_parameters():
    system = System(spring, n_states=2)
    with pytest.raises(
        ValueError, match=r"uses params\[1\], but params has the length 1"
    ):
        solve(system, (0, 1), [1.0, 0.0], params=(1.0,))
    assert solve(system, (0, 1), [1.0, 0.0], params=(1.0, 4.0)).success
