"""An inconsistent system is refused when it is made."""

from __future__ import annotations

import numpy as np
import pytest
from bent_systems import (
    bent,
    bent_bound,
    bent_field,
    bent_guard,
    bent_guards,
    bent_jacobian,
    bent_sparse,
    landing_affine,
    turn_back,
)

from hopdata.hybrid import System, jacobian, solve, solve_batch

ONE = {"n_states": 2, "guard_names": ("bar0",)}


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (
            {"guards": bent_guards, "guard": bent_guard},
            "guards, guard: expected one of them",
        ),
        ({"rate_bound": bent_bound}, "guards: expected a function declared by @guards"),
        (
            {"guards": bent_guards, "rate_bound": bent_bound},
            "rate_bound: expected guards .* @guard",
        ),
        ({"guards": bent_guard}, "guards: expected a function declared by @guards"),
        ({"guard": bent_guards}, "guard: expected a function declared by @guard"),
        (
            {"guard": bent_guard, "rate_bound": bent_guard},
            "rate_bound: .* by @rate_bound",
        ),
        ({"guards": bent_guards, "guard_names": ()}, "guard_names: expected one name"),
        ({"guard": bent_guard, "guard_names": ()}, "guard_names: expected one name"),
        ({}, "guards: expected a function declared by @guards"),
        ({"guards": bent_guards, "jacobian": bent_field}, "jacobian: .* by @jacobian"),
        ({"guards": bent_guards, "affine": bent_jacobian}, "affine: .* by @affine"),
        (
            {"guards": bent_guards, "on_event": landing_affine},
            "on_event: .* by @on_event",
        ),
        (
            {"guards": bent_guards, "terminal": (True, False)},
            "terminal: expected 1 entries",
        ),
        ({"guards": bent_guards, "directions": (2,)}, "directions: expected -1, 0 or"),
        (
            {"guards": bent_guards, "n_states": 0},
            "n_states: expected a whole number, at least 1",
        ),
    ],
)
def test_parts_that_do_not_fit(parts, message):
    with pytest.raises((TypeError, ValueError), match=message):
        System(bent_field, **{**ONE, **parts})


@jacobian
def far_reaching(t, y, mode, params, jac):
    jac[:] = params[4]


@jacobian
def far_looking(t, y, mode, params, jac):
    jac[:] = y[7]


def test_elements_that_a_jacobian_names():
    system = System(bent_field, bent_guards, jacobian=far_reaching, **ONE)
    with pytest.raises(ValueError, match=r"uses params\[4\]"):
        system.check_params_length(4)
    with pytest.raises(ValueError, match=r"uses y\[7\]"):
        System(bent_field, bent_guards, jacobian=far_looking, **ONE)


def level(t, y):
    return y[0]


def needs_four(t, y, mode, params):
    return [-params[3] * y[0]]


def jumps_and_needs_four(t, y, mode, params):
    return [-params[3] if t < params[0] else params[1]]


@pytest.mark.parametrize(
    ("function", "options"),
    [
        (needs_four, {}),
        (needs_four, {"tstops": 0.05}),
        (jumps_and_needs_four, {}),
        (jumps_and_needs_four, {"n_memory": 1}),
        (needs_four, {"sliding": ("level",)}),
    ],
)
def test_missing_parameters_are_told_whatever_is_derived_from_the_system(
    function, options
):
    """A derived system may have further parameters, which the user's do not see."""
    system = System(function, level, n_states=1, guard_names=("level",), **options)
    with pytest.raises(
        ValueError, match=r"uses params\[3\], but params has the length"
    ):
        solve(system, (0.0, 0.1), [1.0], params=[1.0, 2.0])
    with pytest.raises(
        ValueError, match=r"uses params\[3\], but params has the length"
    ):
        solve_batch(system, (0.0, 0.1), [[1.0]], params=[[1.0, 2.0]])


def test_a_plain_function_needs_no_decorator():
    plain = System(bent_field.function, n_states=2)
    assert plain.field.function is bent_field.function
    with pytest.raises(
        TypeError, match="field: expected a function declared by @field"
    ):
        System("bent_field", n_states=2)


def test_names_of_guards_differ():
    with pytest.raises(ValueError, match="guard_names"):
        System(bent_field, bent_guards, n_states=2, guard_names=("bar", "bar"))


@pytest.mark.parametrize("name", ["n_extra_modes", "n_memory"])
def test_counts_are_not_negative(name):
    with pytest.raises(ValueError, match=name):
        System(bent_field, n_states=2, **{name: -1})


def test_a_bound_is_not_needed():
    """Guards evaluated one by one without a bound are all evaluated at each step."""
    system = System(bent_field, guard=bent_guard, **ONE)
    assert system.n_guards == 1


def test_what_it_is_made_of():
    assert bent(3).callbacks == (bent_field, bent_guards)
    assert bent_sparse(3, on_event=turn_back).callbacks == (
        bent_field, bent_guard, bent_bound, turn_back,
    )  # fmt: skip
    assert bent(3, n_extra_modes=2).n_modes == 5
    rules = bent(2, directions=(1, -1), terminal=(False, True)).rules
    assert np.array_equal(rules, [[1, -1], [0, 1], [1, 1], [0, 0], [0, 0], [0, 0]])
