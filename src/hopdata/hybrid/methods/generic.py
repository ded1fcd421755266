"""Explicit methods for any scene: they call its field by its address.

Compiled once per install, as the driver is, for any number of states. A scene's own code (see
`scene`) is faster and takes a second or two to compile; its results have the same bytes.
"""

from __future__ import annotations

from functools import cache
from math import nan, sqrt
from typing import Any

from hopdata.hybrid.compiled.calls import INTERPOLANT_NATIVE, STEP_NATIVE, call_field
from hopdata.hybrid.compiled.views import float_table, float_vector, int_vector
from hopdata.hybrid.methods.explicit import (
    TINY,
    Tableau,
    by_address,
    compose,
    interpolant_code,
    step_code,
)
from hopdata.hybrid.methods.method import compiled_entry

FUNCTION: Any = None  # put in for each method

KNOWN = {"TINY": TINY, "sqrt": sqrt, "nan": nan, "call_field": call_field}
ANY_SIZE = ["N = s.width"]


def _enter_step(
    t: float, dt: float, rtol: float, s: int, n: int, mode: int, n_modes: int,
    params: int, n_params: int, atol: int, field: int,
) -> float:  # fmt: skip
    result: float = FUNCTION(
        t, dt, rtol, float_table(s, n), int_vector(mode, n_modes), float_vector(params, n_params),
        float_vector(atol, n), field,
    )  # fmt: skip
    return result


def _enter_interpolant(
    t: float, dt: float, s: int, n: int, mode: int, n_modes: int,
    params: int, n_params: int, field: int,
) -> int:  # fmt: skip
    result: int = FUNCTION(
        t, dt, float_table(s, n), int_vector(mode, n_modes), float_vector(params, n_params), field
    )
    return result


@cache
def generic_step(tableau: Tableau) -> Any:
    """Return the machine code of a method's step for any scene."""
    body = ANY_SIZE + step_code(tableau, by_address)
    function = compose("generic_step", "t, dt, rtol, s, mode, params, atol, field", body, KNOWN)
    return compiled_entry(_enter_step, STEP_NATIVE, function, cache=True)


@cache
def generic_interpolant(tableau: Tableau) -> Any:
    """Return the machine code of a method's interpolant for any scene."""
    body = ANY_SIZE + interpolant_code(tableau, by_address)
    function = compose("generic_interpolant", "t, dt, s, mode, params, field", body, KNOWN)
    return compiled_entry(_enter_interpolant, INTERPOLANT_NATIVE, function, cache=True)
