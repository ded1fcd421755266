"""The user's functions, declared by decorators and compiled one by one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, partial, update_wrapper
from importlib import import_module
from types import FunctionType
from typing import Any

import numba

from hopdata.code_cache import compiled_in_cache, function_digest
from hopdata.errors import ArgumentError
from hopdata.hybrid.compiled import declare, naming
from hopdata.hybrid.compiled.constants import Constants, renew_called
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.compiled.in_python import protected, trampoline
from hopdata.hybrid.compiled.kernel import SIGNATURES, Signature

Function = Callable[..., Any]


class Callback:
    """A user's function, compiled when its address is first requested, then cached.

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
        name = naming.name_of(
            self.function, self.signature, compiled=self._wanted, holder=self
        )
        return callback_by_name, name

    @property
    def wanted(self) -> bool:
        """Whether the user wants it compiled."""
        return self._wanted

    @property
    def compiled(self) -> bool:
        """Whether the machine code is the function's own, not a call into Python."""
        return self._compiled is not None

    def check_lengths(self, **lengths: int) -> None:
        """Raise ValueError if the code uses a literal index beyond an array's end."""
        for position, number in self._subscripts.items():
            name = self.signature.arguments[position]
            if name in lengths and number >= lengths[name]:
                where = declare.place(self.function, self.signature)
                raise ValueError(
                    f"{where} uses {name}[{number}], but {name} has the length "
                    f"{lengths[name]}"
                )

    @cached_property
    def n_params(self) -> int:
        """Smallest number of parameters that the function's code requires."""
        return self._subscripts.get(self.signature.arguments.index("params"), -1) + 1

    def elements_of(self, argument: str, length: int) -> tuple[int, ...]:
        """Return the elements of an argument of this length that may matter."""
        position = self.signature.arguments.index(argument)
        named = declare.elements_named(self.function, position)
        if named is None:
            return tuple(range(length))
        return tuple(sorted(named))

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
        if self._wanted:
            found = Constants(functions)
        else:
            found = Constants(in_python=functions)
        renew_called(found)
        return found

    def anew(self) -> Callback:
        """Return itself or, if what it was made from has changed, a new callback."""
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
        """The function, callable from code in Numba with ranges for states and time."""
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
            reason = f"it is a {type(self.function).__name__} object"
            advice = "write a function around it"
            declare.warn_slow(self.function, self.signature, reason, advice)
            return None

        def compile_it(cached: bool) -> Any:
            kept = cached and self.kept
            native = self.signature.native
            compiler = numba.cfunc(native, cache=kept, error_model="numpy")
            return compiler(with_digest(self.function))

        digest = function_digest(self.function)
        try:
            return compiled_in_cache(self.function, digest, compile_it)
        # Numba's own exceptions, and others raised within it.
        except Exception as error:
            declare.raise_if_mistaken(self.function, self.signature, error)
            reason, advice = declare.reason_and_advice(error)
            declare.warn_slow(self.function, self.signature, reason, advice)
            return None


def callback_by_name(
    module: str, name: str, kind: str, compiled: bool, constants: Mapping[str, str]
) -> Callback:
    """Return the callback of a function that a module holds; see `naming.name_of`.

    Raises
    ------
    ArgumentError
        If the module holds no such function, or if its constants have other values
        here.
    """
    full = f"{module}.{name}"
    held = naming.held(import_module(module), name)
    if isinstance(held, Callback) and held.signature.name == kind:
        found = held
    elif callable(held) and not isinstance(held, Callback):
        found = Callback(held, SIGNATURES[kind], compiled)
    else:
        wanted = f"a function declared by @{kind}, as in the process that pickled it"
        raise ArgumentError.at(full, wanted, held)
    if compiled:
        naming.require_same_constants(full, found.function, constants)
    return found


def _declared(kind: str, function: Function | None, compiled: bool) -> Any:
    """Return the callback or, if used as ``@field(compiled=False)``, the decorator."""
    if function is None:
        return partial(_declared, kind, compiled=compiled)
    return Callback(function, SIGNATURES[kind], compiled)


def field(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare a vector field ``field(t, y, mode, params, dy)``, which fills `dy`.

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
    """Declare one event function of many.

    It is called as ``guard(t, y, dy, mode, params, k, h, hdot)``.

    Parameters
    ----------
    function : callable
        Fills, in place, only ``h[k]`` with the event function of guard k at y, and
        ``hdot[k]`` with its rate of change when y changes at the rate `dy`.
    """
    return _declared("guard", function, compiled)


def rate_bound(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare a bound on the rates of all guards.

    It is called as ``rate_bound(t, y, dy, mode, params) -> float``.

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


def together(function: Function | None = None, *, compiled: bool = True) -> Any:
    """Declare a law for several guards at once, ``together(t, y, mode, params, due)``.

    It is called instead of the handler where the events of several guards are due.

    Parameters
    ----------
    function : callable
        Receives `due` (n_guards,) with the direction of the flip of each guard that is
        due, +1 or -1, and 0 for the others. All their locks have flipped. May change y
        and mode in place. Returns 0 to continue, 1 to stop.
    """
    return _declared("together", function, compiled)


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
    """Declare an affine field, which equals a y + b in this mode.

    It is called as ``affine(mode, params, a, b)``.

    Parameters
    ----------
    function : callable
        Fills `a` (n, n) and `b` (n,) in place.
    """
    return _declared("affine", function, compiled)
