"""The user's functions, declared by decorators and compiled one by one."""

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
from hopdata.hybrid.compiled import declare, naming
from hopdata.hybrid.compiled.constants import Constants, renew_called
from hopdata.hybrid.compiled.declare import place, return_error
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.compiled.kernel import SIGNATURES, Signature
from hopdata.hybrid.compiled.memory import built, lower_call_of_python

# Exceptions of the user's functions are collected, because machine code cannot pass
# them on.
#
# Each thread collects its own, so that integrations in threads do not see each other's
# exceptions.


class Caught(list[BaseException]):
    """Exceptions of the functions called by this thread in a ``with`` block, in order.

    Functions called through Python append their exceptions. Those of machine code,
    which Numba can only print, arrive through ``sys.unraisablehook``. All others go to
    the previous hook.
    """

    __slots__ = ("_token", "witness")

    def __init__(self, witness: Callable[[], None] | None = None) -> None:
        self.witness = (
            witness  # called at the first exception: machine code may continue after it
        )

    def append(self, error: BaseException) -> None:
        """Add an exception."""
        if not self and self.witness is not None:
            self.witness()
        super().append(error)

    def __enter__(self) -> Caught:
        self._token = catch(self)
        return self

    def __exit__(self, *_: object) -> None:
        stop_catching(self._token)


def catch(caught: Caught) -> Token[Caught | None]:
    """Start catching as a ``with`` block would, but faster; `stop_catching` ends it."""
    if sys.unraisablehook is not _hook:
        _hook.install()
    return _caught.set(caught)


class _Hook:
    """Replacement of ``sys.unraisablehook`` from the first integration on.

    It is never removed: removing it after each integration would require a lock among
    threads.
    """

    def __init__(self) -> None:
        self._previous: Any = sys.unraisablehook
        self._passing_on = False

    def install(self) -> None:
        self._previous = sys.unraisablehook
        sys.unraisablehook = self

    def __call__(self, unraisable: Any) -> None:
        caught, error = current(), unraisable.exc_value
        # For Numba the object is a string; an exception in a destructor comes with the
        # object.
        if (
            caught is not None
            and error is not None
            and isinstance(unraisable.object, str)
        ):
            caught.append(error)
        elif self._passing_on:  # the previous hook has called this one
            sys.__unraisablehook__(unraisable)
        else:
            self._passing_on = True
            try:
                self._previous(unraisable)
            finally:
                self._passing_on = False


_caught: ContextVar[Caught | None] = ContextVar(
    "caught", default=None
)  # one per thread
_hook = _Hook()
current, stop_catching = _caught.get, _caught.reset


# Calls from machine code back into Python, for functions that Numba cannot compile.
#
# A trampoline is a compiled function of the same signature, so the driver calls it like
# any other. It takes the interpreter's lock, passes arrays that are the driver's own
# memory, and calls the Python function. Numba's object mode would take half as long
# again, and five times as long to compile.

# A NaN that no arithmetic produces, which distinguishes an unfilled element from a
# computed NaN.
UNFILLED = np.int64(0x7FF8_0000_0BAD_F111)
FILLS_ALL = (
    "field",
    "guards",
)  # kinds that must fill all elements of their arrays in each call


def protected(function: Function, signature: Signature) -> Function:
    """Return `function` with its exceptions collected for the caller of the driver.

    After the first exception the function is not called again: its arrays are filled
    with NaN, and an event handler stops the integration, so that the driver soon ends.
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
    """Return the result converted to the signature's type, as compiled code would convert it."""
    kind = signature.native.return_type
    if kind == types.none and result is None:
        return None
    if kind != types.none and isinstance(result, int | float | np.number | np.bool_):
        return int(result) if kind == types.int64 else float(result)
    raise return_error(function, signature, type(result).__name__)


def _checked(
    function: Function, signature: Signature, arguments: tuple[Any, ...]
) -> Any:
    """Call the function, and check that it fills all of its arrays."""
    arrays = _filled_by(signature, arguments) if signature.name in FILLS_ALL else {}
    for array in arrays.values():
        array.view(np.int64).fill(UNFILLED)
    result = _converted(function(*arguments), function, signature)
    for name, array in arrays.items():
        left = np.flatnonzero(array.view(np.int64) == UNFILLED)
        if len(left) > 0:
            raise ValueError(
                f"{place(function, signature)} does not fill {name}[{left[0]}]"
            )
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

    The machine code contains the object's address, so the caller must keep the object
    alive.
    """
    names, lower = ", ".join(signature.arguments), lower_call_of_python(function)
    returns = signature.native.return_type
    call = built(len(signature.arguments), lambda *kinds: (returns(*kinds), lower))
    scope = {"call": call}
    exec(f"def trampoline({names}):\n    return call({names})\n", scope)
    return scope["trampoline"]


Function = Callable[..., Any]


class Callback:
    """A user's function, compiled when its address is first requested, then cached on disk.

    If Numba cannot compile it, the machine code calls back into Python, which is much
    slower and gives the same results. Calling the object runs the plain Python
    function, for a debugger or another solver.

    Parameters
    ----------
    function : callable
        The function; for a Numba dispatcher, the Python function in it.
    signature : Signature
        Its arguments and result.
    compiled : bool
        Whether to try to compile it.
    """

    kept = True  # whether the machine code may be used in other processes

    def __init__(
        self, function: Function, signature: Signature, compiled: bool = True
    ) -> None:
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

    def __copy__(self) -> Callback:
        """Return itself: like a function, it does not change."""
        return self

    def __deepcopy__(self, _: object) -> Callback:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickle stores: the name by which a module holds the function."""
        return naming.callback_by_name, naming.name_of(self)

    @property
    def wanted(self) -> bool:
        """Whether the user wants it compiled."""
        return self._wanted

    @property
    def compiled(self) -> bool:
        """Whether the machine code is that of the function itself, not a call into Python."""
        return self._compiled is not None

    def check_lengths(self, **lengths: int) -> None:
        """Raise ValueError if the code uses a literal index beyond an array's length."""
        for position, number in self._subscripts.items():
            name = self.signature.arguments[position]
            if number >= lengths.get(name, number + 1):
                raise ValueError(
                    f"{place(self.function, self.signature)} uses {name}[{number}], but {name} has "
                    f"the length {lengths[name]}"
                )

    @cached_property
    def n_params(self) -> int:
        """Smallest number of parameters that the function's code requires."""
        return self._subscripts.get(self.signature.arguments.index("params"), -1) + 1

    def elements_of(self, argument: str, length: int) -> tuple[int, ...]:
        """Return the elements of an argument of this length that may affect the function."""
        named = declare.elements_named(
            self.function, self.signature.arguments.index(argument)
        )
        return tuple(range(length)) if named is None else tuple(sorted(named))

    @cached_property
    def _subscripts(self) -> dict[int, int]:
        """Largest literal index into each argument, by the argument's position."""
        largest = declare.largest_subscripts(self.function)
        if not largest:
            return {}
        names = self.function.__code__.co_varnames[: len(self.signature.arguments)]
        return {
            names.index(name): number
            for name, number in largest.items()
            if name in names
        }

    @cached_property
    def constants(self) -> Constants:
        """What its machine code is made from, besides its own text."""
        if not isinstance(self.function, FunctionType):
            return Constants()
        functions = [self.function]
        found = Constants(functions) if self._wanted else Constants(in_python=functions)
        renew_called(found)
        return found

    def anew(self) -> Callback:
        """Return itself or, if what it was made from has changed, a callback to be compiled."""
        if self.constants.are_current():
            return self
        return Callback(self.function, self.signature, self._wanted)

    @cached_property
    def dispatcher(self) -> Any:
        """The function, or its trampoline, callable from other code in Numba."""
        if self._compiled is None:
            return numba.njit(trampoline(self._protected, self.signature))
        return numba.njit(error_model="numpy")(with_digest(self.function))

    @cached_property
    def ranged(self) -> Any:
        """The function, callable from other code in Numba with ranges for states and time."""
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
        """Machine code of the function, or None if Python is to run it."""
        _ = self.constants  # remembered before they are made part of the code
        if not self._wanted:
            return None
        if not isinstance(self.function, FunctionType):
            kind = type(self.function).__name__
            advice = "write a function around it"
            declare.warn_slow(
                self.function, self.signature, f"it is a {kind} object", advice
            )
            return None

        def compile_it(cached: bool) -> Any:
            native, kept = self.signature.native, cached and self.kept
            compiler = numba.cfunc(native, cache=kept, error_model="numpy")
            return compiler(with_digest(self.function))

        try:
            return compiled_in_cache(
                self.function, function_digest(self.function), compile_it
            )
        except (
            Exception
        ) as error:  # Numba's own exceptions, and others raised within it
            declare.raise_if_mistaken(self.function, self.signature, error)
            declare.warn_slow(
                self.function, self.signature, *declare.reason_and_advice(error)
            )
            return None


def _declared(kind: str, function: Function | None, compiled: bool) -> Any:
    """Return the callback or, if used as ``@field(compiled=False)``, the decorator."""
    if function is None:
        return partial(_declared, kind, compiled=compiled)
    return Callback(function, SIGNATURES[kind], compiled)


def field(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare a vector field ``field(t, y, mode, params, dy)``, which fills `dy` in place.

    Parameters
    ----------
    function : callable
        Takes t (float, s), y (n,), mode (n_guards + n_extra_modes,) of int64, params
        (p,) and the (n,) array `dy` to fill.
    compiled : bool
        If False, run it as plain Python, for debugging or for features that Numba
        lacks. By default it is compiled in nopython mode or, if that fails, run by
        Python with a `SlowCallbackWarning`. This applies to all decorators here.
    """
    return _declared("field", function, compiled)


def guards(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare event functions ``guards(t, y, dy, mode, params, h, hdot)``.

    Parameters
    ----------
    function : callable
        Fills, in place, `h` (n_guards,) with the event functions at y, and `hdot`
        (n_guards,) with their rates of change when y changes at the rate `dy`.
    """
    return _declared("guards", function, compiled)


def guard(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare one event function of many, ``guard(t, y, dy, mode, params, k, h, hdot)``.

    Parameters
    ----------
    function : callable
        Fills, in place, only ``h[k]`` with the event function of guard k at y, and
        ``hdot[k]`` with its rate of change when y changes at the rate `dy`.
    """
    return _declared("guard", function, compiled)


def rate_bound(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare a bound on the guards' rates, ``rate_bound(t, y, dy, mode, params) -> float``.

    Parameters
    ----------
    function : callable
        Returns a bound on ``abs(hdot[k])`` near y for all k, in units of h per second.
    """
    return _declared("rate_bound", function, compiled)


def on_event(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare an event handler ``on_event(t, y, mode, params, guard, direction)``.

    Parameters
    ----------
    function : callable
        Receives the index of the guard and the direction in which its event function
        crossed zero (+1 upwards, -1 downwards). May change y and mode in place. Returns
        0 to continue, 1 to stop.
    """
    return _declared("on_event", function, compiled)


def jacobian(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare the derivative of the field, ``jacobian(t, y, mode, params, jac)``.

    Parameters
    ----------
    function : callable
        Fills `jac` (n, n) in place: ``jac[i, j]`` is the derivative of ``dy[i]`` with
        respect to ``y[j]``. It is zero on entry.
    """
    return _declared("jacobian", function, compiled)


def affine(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare an affine field ``affine(mode, params, a, b)``, which equals a y + b in this mode.

    Parameters
    ----------
    function : callable
        Fills `a` (n, n) and `b` (n,) in place.
    """
    return _declared("affine", function, compiled)
