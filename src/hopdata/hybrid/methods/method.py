# ruff: noqa: ARG001 (specialised and generic code is called alike)
"""What a method of integration is to the driver, and how its code is made for a scene.

A method is two functions (three with Jacobians), made for a scene so that the scene's field stands
within them and the number of states is a constant: for a small field, calls and loops would cost
more than the evaluations.

    step(t, dt, rtol, s, mode, params, atol) -> error in units of the tolerance
    interpolant(t, dt, s, mode, params) -> its degree

The table s holds state and slope at the start of the step in the rows Y and K1; the step fills END
and KEND with those at its end; the interpolant fills P1 ... (see `driver.dense`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numba import cfunc

from hopdata.code_cache import compiled_in_cache, is_in_cache
from hopdata.hybrid.compiled.calls import (
    INTERPOLANT_NATIVE,
    REFRESH_NATIVE,
    STEP_NATIVE,
    TANGENT_NATIVE,
)
from hopdata.hybrid.compiled.digest import driver_digest, function_digest, with_digest
from hopdata.hybrid.compiled.kernel import ENTRY, kernel_in_loop
from hopdata.hybrid.compiled.views import array_of, float_table, float_vector, int_vector

Function = Callable[..., Any]


@dataclass(frozen=True)
class Method:
    """A method, made for a scene.

    Parameters
    ----------
    name : str
        Its name.
    order : int
        Order of the error estimate, by which the step is controlled: the error of a step goes
        with this power of its length.
    evaluations : int
        Field evaluations of a step.
    interpolant_evaluations : int
        Field evaluations of the interpolant.
    interpolant_error : int
        Its error at the middle of a step, in units of the step's estimated error.
    in_powers : bool
        Whether the interpolant is in powers of theta.
    step, interpolant : callable
        The functions, for Numba to compile.
    tangent : callable, optional
        ``tangent(t, dt, rtol, s, mode, params, atol, phi)`` writes the product of the step's
        Jacobian and that in the first rows of phi into the next rows; returns its error in units
        of the tolerance.
    tangent_evaluations : int
        Field evaluations that this takes.
    tangent_rows : int
        Rows of phi that the tangent needs.
    short_tangent : callable, optional
        The same for a short step, along its interpolant (see `methods.short_tangent`).
    short_tangent_evaluations : int
        Field evaluations that this takes.
    refresh : callable, optional
        ``refresh(s, mode, params)`` is called whenever the mode may have changed; returns by how
        much what the method knows of the field differs from it, relatively.
    last_slope_row : int
        Of an explicit method, the row with the slope of its last stage, by which stiffness shows.
    """

    name: str
    order: int
    evaluations: int
    interpolant_evaluations: int
    interpolant_error: int
    in_powers: bool
    step: Function
    interpolant: Function
    tangent: Function | None = None
    tangent_evaluations: int = 0
    tangent_rows: int = 0
    short_tangent: Function | None = None
    short_tangent_evaluations: int = 0
    refresh: Function | None = None
    last_slope_row: int = 0


# Names that stand for what differs between scenes; the values are put in with the scene.
FUNCTION: Any = None
N = 0


def _enter_step(
    t: float, dt: float, rtol: float, s: int, n: int, mode: int, n_modes: int,
    params: int, n_params: int, atol: int, field: int,
) -> float:  # fmt: skip
    return FUNCTION(
        t, dt, rtol, float_table(s, N), array_of(int_vector(mode, n_modes)),
        array_of(float_vector(params, n_params)), float_vector(atol, N),
    )  # fmt: skip


def _enter_interpolant(
    t: float, dt: float, s: int, n: int, mode: int, n_modes: int,
    params: int, n_params: int, field: int,
) -> int:  # fmt: skip
    return FUNCTION(
        t, dt, float_table(s, N), array_of(int_vector(mode, n_modes)),
        array_of(float_vector(params, n_params)),
    )  # fmt: skip


def _enter_tangent(
    t: float, dt: float, rtol: float, s: int, mode: int, n_modes: int,
    params: int, n_params: int, atol: int, phi: int,
) -> float:  # fmt: skip
    result: float = FUNCTION(
        t, dt, rtol, float_table(s, N), array_of(int_vector(mode, n_modes)),
        array_of(float_vector(params, n_params)), float_vector(atol, N), float_table(phi, N),
    )  # fmt: skip
    return result


def _enter_refresh(s: int, mode: int, n_modes: int, params: int, n_params: int) -> float:
    result: float = FUNCTION(
        float_table(s, N), array_of(int_vector(mode, n_modes)),
        array_of(float_vector(params, n_params)),
    )  # fmt: skip
    return result


def compiled_entry(
    template: Function, native: Any, function: Function, *, cache: bool, n_states: int = 0
) -> Any:
    """Compile the entry to a method's function, or take it from the cache, if that is wanted."""
    entry, digest = _entry(template, function, n_states)

    def compile_it(cached: bool) -> Any:
        return cfunc(native, cache=cache and cached, **ENTRY)(entry)

    return compiled_in_cache(entry, digest, compile_it)


def _entry(template: Function, function: Function, n_states: int) -> tuple[Function, str]:
    """Return the entry to a method's function, to be compiled, and its digest."""
    inner = kernel_in_loop(with_digest(function))
    entry = with_digest(template, FUNCTION=inner, N=n_states)
    return entry, f"{function_digest(entry)}-{driver_digest()}"


def is_compiled(method: Method, n_states: int) -> bool:
    """Tell whether a method's step and interpolant were made for this scene before."""
    step = _entry(_enter_step, method.step, n_states)
    interpolant = _entry(_enter_interpolant, method.interpolant, n_states)
    return is_in_cache(*step) and is_in_cache(*interpolant)


def compiled_step(method: Method, n_states: int, *, cache: bool) -> Any:
    """Return the machine code of a method's step."""
    return compiled_entry(_enter_step, STEP_NATIVE, method.step, cache=cache, n_states=n_states)


def compiled_interpolant(method: Method, n_states: int, *, cache: bool) -> Any:
    """Return the machine code of a method's interpolant."""
    return compiled_entry(
        _enter_interpolant, INTERPOLANT_NATIVE, method.interpolant, cache=cache, n_states=n_states
    )


def compiled_tangent(tangent: Function, n_states: int, *, cache: bool) -> Any:
    """Return the machine code of a tangent."""
    return compiled_entry(_enter_tangent, TANGENT_NATIVE, tangent, cache=cache, n_states=n_states)


def compiled_refresh(method: Method, n_states: int, *, cache: bool) -> Any:
    """Return the machine code that a method runs when the mode has changed."""
    assert method.refresh is not None
    return compiled_entry(
        _enter_refresh, REFRESH_NATIVE, method.refresh, cache=cache, n_states=n_states
    )
