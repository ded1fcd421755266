"""A wrong declaration is told in one line, where it stands."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from numba import njit

from hopdata.hybrid import (
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
from hopdata.hybrid.compiled.signatures import SIGNATURES

DECORATORS = (field, guards, guard, rate_bound, on_event, jacobian, affine)


def test_too_few_arguments():
    with pytest.raises(TypeError, match=r"field 'f' .* takes 4 arguments") as caught:

        @field
        def f(t, y, mode, params):
            params[0] = 1.0

    assert "expected f(t, y, mode, params, dy)" in str(caught.value)
    assert "test_declaration.py:" in str(caught.value)
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
    with pytest.raises(TypeError, match=r"gives something else the name dy; .* dy\[:\] = "):

        @field
        def f(t, y, mode, params, dy):
            dy = np.array([y[1], -9.81])
            return dy  # noqa: RET504


def test_a_returned_array_is_told_when_it_is_compiled():
    @field
    def f(t, y, mode, params, dy):
        dy[0] = y[1]
        return dy

    with pytest.raises(TypeError, match=r"field 'f' .* returns an array; fill dy in place"):
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

    with pytest.raises(TypeError, match="field: expected a function declared by @field"):
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
    assert kind.call("one") in decorator.__doc__.replace(f"{decorator.__name__}(", "one(")


def test_matrices_reach_python_in_their_shape():
    @jacobian(compiled=False)
    def j(t, y, mode, params, jac):
        jac[0, 1] = y[0]
        jac[1, 0] = jac.shape[0]

    jac = np.zeros((2, 2))
    j.dispatcher(0.0, np.array([3.0, 4.0]), np.zeros(0, np.int64), np.zeros(0), jac)
    assert jac.tolist() == [[0.0, 3.0], [2.0, 0.0]]
