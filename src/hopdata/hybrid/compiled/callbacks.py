"""The user's functions: declared by decorators, compiled one by one."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial, update_wrapper
from typing import Any

import numba

from hopdata.hybrid.compiled.cache import cache_directory
from hopdata.hybrid.compiled.digest import function_digest
from hopdata.hybrid.compiled.signatures import (
    AFFINE,
    FIELD,
    GUARD,
    GUARDS,
    JACOBIAN,
    ON_EVENT,
    RATE_BOUND,
    Signature,
)

Function = Callable[..., Any]


class Callback:
    """A user's function, compiled when its address is first asked for, then cached on disk.

    Calling it runs the plain Python function, for a debugger or another solver.
    """

    def __init__(self, function: Function, signature: Signature) -> None:
        self.function = function
        self.signature = signature
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Run the Python function."""
        return self.function(*arguments)

    def __repr__(self) -> str:
        return f"<hybrid callback {self.function.__qualname__}>"

    @cached_property
    def address(self) -> int:
        """Address of the machine code."""
        return int(self._compiled.address)

    @cached_property
    def _compiled(self) -> Any:
        with cache_directory(self.function, function_digest(self.function)) as cached:
            compiler = numba.cfunc(self.signature.native, cache=cached, error_model="numpy")
            return compiler(self.function)


def _declared(signature: Signature, function: Function | None) -> Any:
    return partial(_declared, signature) if function is None else Callback(function, signature)


def field(function: Function | None = None) -> Any:
    """Declare a vector field ``field(t, y, mode, params, dy)``, which fills `dy` in place.

    Parameters
    ----------
    function : callable
        Takes t (float, s), y (n,), mode (n_guards + n_extra_modes,) of int64, params (p,) and
        the (n,) array `dy` to fill. It is compiled by Numba in nopython mode.
    """
    return _declared(FIELD, function)


def guards(function: Function | None = None) -> Any:
    """Declare event functions ``guards(t, y, dy, mode, params, h, hdot)``.

    Parameters
    ----------
    function : callable
        Fills `h` (n_guards,), the event functions at y, and `hdot` (n_guards,), their rates of
        change when y changes at the rate `dy`, both in place.
    """
    return _declared(GUARDS, function)


def guard(function: Function | None = None) -> Any:
    """Declare one event function of many, ``guard(t, y, dy, mode, params, k, h, hdot)``.

    Parameters
    ----------
    function : callable
        Fills only ``h[k]``, the event function of guard k at y, and ``hdot[k]``, its rate of
        change when y changes at the rate `dy`, in place.
    """
    return _declared(GUARD, function)


def rate_bound(function: Function | None = None) -> Any:
    """Declare a bound on the guards' rates, ``rate_bound(t, y, dy, mode, params) -> float``.

    Parameters
    ----------
    function : callable
        Returns a number that no ``abs(hdot[k])`` exceeds near y, in units of h per second.
    """
    return _declared(RATE_BOUND, function)


def on_event(function: Function | None = None) -> Any:
    """Declare what happens at an event: ``on_event(t, y, mode, params, guard, direction)``.

    Parameters
    ----------
    function : callable
        Is told the guard's number and the direction in which its event function crossed zero
        (+1 upwards, -1 downwards). May change y and mode in place. Returns 0 to go on, 1 to stop.
    """
    return _declared(ON_EVENT, function)


def jacobian(function: Function | None = None) -> Any:
    """Declare the derivative of the field, ``jacobian(t, y, mode, params, jac)``.

    Parameters
    ----------
    function : callable
        Fills `jac` (n, n) in place: ``jac[i, j]`` is the derivative of ``dy[i]`` by ``y[j]``.
    """
    return _declared(JACOBIAN, function)


def affine(function: Function | None = None) -> Any:
    """Declare an affine field, ``affine(mode, params, a, b)``: in this mode it is a y + b.

    Parameters
    ----------
    function : callable
        Fills `a` (n, n) and `b` (n,) in place.
    """
    return _declared(AFFINE, function)
