"""The user's functions: declared by decorators, compiled one by one."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial, update_wrapper
from types import FunctionType
from typing import Any

import numba

from hopdata.code_cache import compiled_in_cache
from hopdata.hybrid.compiled.declaration import check_declaration, function_name, place
from hopdata.hybrid.compiled.diagnosis import raise_if_mistaken, reason_and_advice, warn_slow
from hopdata.hybrid.compiled.digest import function_digest, with_digest
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
from hopdata.hybrid.compiled.subscripts import elements_named, largest_subscripts
from hopdata.hybrid.compiled.trampoline import compiled_trampoline, protected, trampoline

Function = Callable[..., Any]


class Callback:
    """A user's function, compiled when its address is first asked for, then cached on disk.

    Where Numba cannot compile it, the machine code is a way back into Python: slower by far, with
    the same results. Calling the object runs the plain Python function, for a debugger or
    another solver.

    Parameters
    ----------
    function : callable
        The function; of a Numba dispatcher, the Python function in it.
    signature : Signature
        What it is called with.
    compiled : bool
        Whether to try to compile it.
    """

    def __init__(self, function: Function, signature: Signature, compiled: bool = True) -> None:
        function = getattr(function, "py_func", function)
        check_declaration(function, signature)
        self.function = function
        self.signature = signature
        self._wanted = compiled
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Run the Python function."""
        return self.function(*arguments)

    def __repr__(self) -> str:
        return f"<hybrid callback {function_name(self.function)}>"

    @property
    def address(self) -> int:
        """Address of the machine code."""
        return self._address

    @property
    def compiled(self) -> bool:
        """Whether the machine code is that of the function itself."""
        return self._compiled is not None

    def check_lengths(self, **lengths: int) -> None:
        """Raise ValueError if the function's code names an element beyond an array's length."""
        for position, number in self._subscripts.items():
            name = self.signature.arguments[position]
            if number >= lengths.get(name, number + 1):
                raise ValueError(
                    f"{place(self.function, self.signature)} uses {name}[{number}], but {name} has "
                    f"the length {lengths[name]}"
                )

    @cached_property
    def n_params(self) -> int:
        """How many parameters the function's code names."""
        return self._subscripts.get(self.signature.arguments.index("params"), -1) + 1

    def elements_of(self, argument: str, length: int) -> tuple[int, ...]:
        """Return which elements of an argument of this length may matter to the function."""
        named = elements_named(self.function, self.signature.arguments.index(argument))
        return tuple(range(length)) if named is None else tuple(sorted(named))

    @cached_property
    def _subscripts(self) -> dict[int, int]:
        """Largest literal subscript of each argument, by its position."""
        largest = largest_subscripts(self.function)
        if not largest:
            return {}
        names = self.function.__code__.co_varnames[: len(self.signature.arguments)]
        return {names.index(name): number for name, number in largest.items() if name in names}

    @cached_property
    def dispatcher(self) -> Any:
        """The function, or the way back to it, to be called from other code in Numba."""
        if self._compiled is None:
            return numba.njit(trampoline(self._protected, self.signature))
        return numba.njit(error_model="numpy")(with_digest(self.function))

    @cached_property
    def _address(self) -> int:
        if self._compiled is None:
            self._back = compiled_trampoline(self._protected, self.signature)
            return int(self._back.address)
        return int(self._compiled.address)

    @cached_property
    def _protected(self) -> Function:
        return protected(self.function, self.signature)

    @cached_property
    def _compiled(self) -> Any:
        """Machine code of the function, None if it is to be run by Python."""
        if not self._wanted:
            return None
        if not isinstance(self.function, FunctionType):
            kind = type(self.function).__name__
            advice = "write a function around it"
            warn_slow(self.function, self.signature, f"it is a {kind} object", advice)
            return None
        try:
            return self._compile()
        except Exception as error:  # Numba's own, and whatever it stumbles over
            raise_if_mistaken(self.function, self.signature, error)
            warn_slow(self.function, self.signature, *reason_and_advice(error))
            return None

    def _compile(self) -> Any:
        def compile_it(cached: bool) -> Any:
            compiler = numba.cfunc(self.signature.native, cache=cached, error_model="numpy")
            return compiler(with_digest(self.function))

        return compiled_in_cache(self.function, function_digest(self.function), compile_it)


def _declared(signature: Signature, function: Function | None, compiled: bool) -> Any:
    """Return the callback or, used as ``@field(compiled=False)``, what makes it."""
    if function is None:
        return partial(_declared, signature, compiled=compiled)
    return Callback(function, signature, compiled)


def field(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare a vector field ``field(t, y, mode, params, dy)``, which fills `dy` in place.

    Parameters
    ----------
    function : callable
        Takes t (float, s), y (n,), mode (n_guards + n_extra_modes,) of int64, params (p,) and
        the (n,) array `dy` to fill.
    compiled : bool
        False: run it as plain Python, to use a debugger or what Numba does not know. As it
        stands, it is compiled in nopython mode or, where that fails, run by Python with a
        `SlowCallbackWarning`. The same holds for all decorators here.
    """
    return _declared(FIELD, function, compiled)


def guards(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare event functions ``guards(t, y, dy, mode, params, h, hdot)``.

    Parameters
    ----------
    function : callable
        Fills `h` (n_guards,), the event functions at y, and `hdot` (n_guards,), their rates of
        change when y changes at the rate `dy`, both in place.
    """
    return _declared(GUARDS, function, compiled)


def guard(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare one event function of many, ``guard(t, y, dy, mode, params, k, h, hdot)``.

    Parameters
    ----------
    function : callable
        Fills only ``h[k]``, the event function of guard k at y, and ``hdot[k]``, its rate of
        change when y changes at the rate `dy`, in place.
    """
    return _declared(GUARD, function, compiled)


def rate_bound(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare a bound on the guards' rates, ``rate_bound(t, y, dy, mode, params) -> float``.

    Parameters
    ----------
    function : callable
        Returns a number that no ``abs(hdot[k])`` exceeds near y, in units of h per second.
    """
    return _declared(RATE_BOUND, function, compiled)


def on_event(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare what happens at an event: ``on_event(t, y, mode, params, guard, direction)``.

    Parameters
    ----------
    function : callable
        Is told the guard's number and the direction in which its event function crossed zero
        (+1 upwards, -1 downwards). May change y and mode in place. Returns 0 to go on, 1 to stop.
    """
    return _declared(ON_EVENT, function, compiled)


def jacobian(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare the derivative of the field, ``jacobian(t, y, mode, params, jac)``.

    Parameters
    ----------
    function : callable
        Fills `jac` (n, n) in place: ``jac[i, j]`` is the derivative of ``dy[i]`` by ``y[j]``. It
        begins as zeros.
    """
    return _declared(JACOBIAN, function, compiled)


def affine(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare an affine field, ``affine(mode, params, a, b)``: in this mode it is a y + b.

    Parameters
    ----------
    function : callable
        Fills `a` (n, n) and `b` (n,) in place.
    """
    return _declared(AFFINE, function, compiled)
