"""The user's functions: declared by decorators, compiled one by one."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextvars import ContextVar, Token
from functools import cached_property, partial, update_wrapper
from math import inf, nan
from types import FunctionType
from typing import Any

import numba
import numpy as np
from numba import types

from hopdata.code_cache import compiled_in_cache, function_digest
from hopdata.hybrid.compiled import declare
from hopdata.hybrid.compiled.declare import place, return_error
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.compiled.kernel import SIGNATURES, Signature
from hopdata.hybrid.compiled.memory import built, lower_call_of_python

# Catch what a user's function raises: machine code has no way to pass it on.
#
# Each thread collects its own, so that integrations in threads do not see each other's exceptions.


class Caught(list[BaseException]):
    """Exceptions of the functions called by this thread within a ``with`` block, in their order.

    Functions called through Python append theirs; those of machine code, which Numba can only
    print, arrive through ``sys.unraisablehook``. All others are left to the hook that was there.
    """

    __slots__ = ("_token", "witness")

    def __init__(self, witness: Callable[[], None] | None = None) -> None:
        self.witness = witness  # called at the first exception: machine code may go on after it

    def append(self, error: BaseException) -> None:
        """Take an exception."""
        if not self and self.witness is not None:
            self.witness()
        super().append(error)

    def __enter__(self) -> Caught:
        self._token = catch(self)
        return self

    def __exit__(self, *_: object) -> None:
        stop_catching(self._token)


def catch(caught: Caught) -> Token[Caught | None]:
    """Begin what a ``with`` block would, for a caller in a hurry; `stop_catching` ends it."""
    if sys.unraisablehook is not _hook:
        _hook.install()
    return _caught.set(caught)


class _Hook:
    """Stands in as ``sys.unraisablehook`` from the first integration on.

    It stays there: to take it away after each integration would need a lock among the threads.
    """

    def __init__(self) -> None:
        self._previous: Any = sys.unraisablehook
        self._passing_on = False

    def install(self) -> None:
        self._previous = sys.unraisablehook
        sys.unraisablehook = self

    def __call__(self, unraisable: Any) -> None:
        caught, error = current(), unraisable.exc_value
        # Numba names itself in a string; what a destructor raises comes with the object.
        if caught is not None and error is not None and isinstance(unraisable.object, str):
            caught.append(error)
        elif self._passing_on:  # the hook that was there has called this one
            sys.__unraisablehook__(unraisable)
        else:
            self._passing_on = True
            try:
                self._previous(unraisable)
            finally:
                self._passing_on = False


_caught: ContextVar[Caught | None] = ContextVar("caught", default=None)  # one for each thread
_hook = _Hook()
current, stop_catching = _caught.get, _caught.reset


# The way from machine code back into Python, for functions that Numba cannot compile.
#
# A trampoline is a compiled function of the same signature, so the driver calls it like any other.
# It takes the interpreter's lock, hands over arrays that are the driver's own memory, and calls the
# Python function. Numba's object mode does the same in half as much time again, and takes five
# times longer to compile.

# A NaN that no arithmetic makes, by which an element that was not filled is told from a NaN.
UNFILLED = np.int64(0x7FF8_0000_0BAD_F111)
FILLS_ALL = ("field", "guards")  # elements of their arrays, each time


def protected(function: Function, signature: Signature) -> Function:
    """Return `function` with its exceptions kept for the caller of the driver.

    After the first exception the function is not called again: its arrays are filled with NaN, and
    an event handler stops, so that the driver soon gives up.
    """
    first = True

    def call(*arguments: Any) -> Any:
        nonlocal first
        caught = current()
        try:
            if caught:
                return _give_up(signature, arguments)
            if first:
                first = False
                return _checked(function, signature, arguments)
            return _converted(function(*arguments), function, signature)
        except BaseException as error:
            if caught is None:
                raise
            error.add_note(f"in {place(function, signature)}")
            caught.append(error)
            return _give_up(signature, arguments)

    return call


def _converted(result: Any, function: Function, signature: Signature) -> Any:
    """Return the result in the type of the signature, as compiled code would convert it."""
    kind = signature.native.return_type
    if kind == types.none and result is None:
        return None
    if kind != types.none and isinstance(result, int | float | np.number | np.bool_):
        return int(result) if kind == types.int64 else float(result)
    raise return_error(function, signature, type(result).__name__)


def _checked(function: Function, signature: Signature, arguments: tuple[Any, ...]) -> Any:
    """Call the function, and see that it fills all of its arrays."""
    arrays = _filled_by(signature, arguments) if signature.name in FILLS_ALL else {}
    for array in arrays.values():
        array.view(np.int64).fill(UNFILLED)
    result = _converted(function(*arguments), function, signature)
    for name, array in arrays.items():
        left = np.flatnonzero(array.view(np.int64) == UNFILLED)
        if len(left) > 0:
            raise ValueError(f"{place(function, signature)} does not fill {name}[{left[0]}]")
    return result


def _filled_by(signature: Signature, arguments: tuple[Any, ...]) -> dict[str, Any]:
    named = dict(zip(signature.arguments, arguments, strict=True))
    return {name: named[name] for name in signature.fills}


def _give_up(signature: Signature, arguments: tuple[Any, ...]) -> Any:
    for array in _filled_by(signature, arguments).values():
        array.fill(nan)
    if signature.native.return_type == types.none:
        return None
    return 1 if signature.name == "on_event" else inf


def trampoline(function: Function, signature: Signature) -> Any:
    """Return a Python function that Numba compiles into a call of `function`.

    The object is written into the machine code by its address: the caller keeps it alive.
    """
    names, lower = ", ".join(signature.arguments), lower_call_of_python(function)
    returns = signature.native.return_type
    call = built(len(signature.arguments), lambda *kinds: (returns(*kinds), lower))
    scope = {"call": call}
    exec(f"def trampoline({names}):\n    return call({names})\n", scope)
    return scope["trampoline"]


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

    kept = True  # whether the machine code may be used in other processes

    def __init__(self, function: Function, signature: Signature, compiled: bool = True) -> None:
        function = getattr(function, "py_func", function)
        declare.check_declaration(function, signature)
        self.function = function
        self.signature = signature
        self._wanted = compiled
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Run the Python function."""
        return self.function(*arguments)

    def __repr__(self) -> str:
        return f"<hybrid callback {declare.function_name(self.function)}>"

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
        named = declare.elements_named(self.function, self.signature.arguments.index(argument))
        return tuple(range(length)) if named is None else tuple(sorted(named))

    @cached_property
    def _subscripts(self) -> dict[int, int]:
        """Largest literal subscript of each argument, by its position."""
        largest = declare.largest_subscripts(self.function)
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
    def address(self) -> int:
        """Address of the machine code."""
        if self._compiled is None:
            compiler: Any = numba.cfunc(self.signature.native)
            self._back = compiler(trampoline(self._protected, self.signature))
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
            declare.warn_slow(self.function, self.signature, f"it is a {kind} object", advice)
            return None

        def compile_it(cached: bool) -> Any:
            native, kept = self.signature.native, cached and self.kept
            compiler = numba.cfunc(native, cache=kept, error_model="numpy")
            return compiler(with_digest(self.function))

        try:
            return compiled_in_cache(self.function, function_digest(self.function), compile_it)
        except Exception as error:  # Numba's own, and whatever it stumbles over
            declare.raise_if_mistaken(self.function, self.signature, error)
            declare.warn_slow(self.function, self.signature, *declare.reason_and_advice(error))
            return None


def _declared(kind: str, function: Function | None, compiled: bool) -> Any:
    """Return the callback or, used as ``@field(compiled=False)``, what makes it."""
    if function is None:
        return partial(_declared, kind, compiled=compiled)
    return Callback(function, SIGNATURES[kind], compiled)


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
    return _declared("field", function, compiled)


def guards(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare event functions ``guards(t, y, dy, mode, params, h, hdot)``.

    Parameters
    ----------
    function : callable
        Fills `h` (n_guards,), the event functions at y, and `hdot` (n_guards,), their rates of
        change when y changes at the rate `dy`, both in place.
    """
    return _declared("guards", function, compiled)


def guard(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare one event function of many, ``guard(t, y, dy, mode, params, k, h, hdot)``.

    Parameters
    ----------
    function : callable
        Fills only ``h[k]``, the event function of guard k at y, and ``hdot[k]``, its rate of
        change when y changes at the rate `dy`, in place.
    """
    return _declared("guard", function, compiled)


def rate_bound(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare a bound on the guards' rates, ``rate_bound(t, y, dy, mode, params) -> float``.

    Parameters
    ----------
    function : callable
        Returns a number that no ``abs(hdot[k])`` exceeds near y, in units of h per second.
    """
    return _declared("rate_bound", function, compiled)


def on_event(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare what happens at an event: ``on_event(t, y, mode, params, guard, direction)``.

    Parameters
    ----------
    function : callable
        Is told the guard's number and the direction in which its event function crossed zero
        (+1 upwards, -1 downwards). May change y and mode in place. Returns 0 to go on, 1 to stop.
    """
    return _declared("on_event", function, compiled)


def jacobian(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare the derivative of the field, ``jacobian(t, y, mode, params, jac)``.

    Parameters
    ----------
    function : callable
        Fills `jac` (n, n) in place: ``jac[i, j]`` is the derivative of ``dy[i]`` by ``y[j]``. It
        begins as zeros.
    """
    return _declared("jacobian", function, compiled)


def affine(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare an affine field, ``affine(mode, params, a, b)``: in this mode it is a y + b.

    Parameters
    ----------
    function : callable
        Fills `a` (n, n) and `b` (n,) in place.
    """
    return _declared("affine", function, compiled)
