"""The user's functions, declared by decorators and compiled one by one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, cached_property, partial, update_wrapper
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
import numpy as np

from hopdata.code_cache import compiled_in_cache, function_digest
from hopdata.errors import ArgumentError
from hopdata.hybrid.compiled import (
    added,  # noqa: F401 (what users' functions may call)
    declare,
    naming,
)
from hopdata.hybrid.compiled.constants import Constants, renew_called
from hopdata.hybrid.compiled.digest import sources_digest, with_digest
from hopdata.hybrid.compiled.forms import Form, form_of
from hopdata.hybrid.compiled.helpers import with_helpers, within
from hopdata.hybrid.compiled.in_python import in_own_form, protected, trampoline
from hopdata.hybrid.compiled.kernel import SIGNATURES, Signature
from hopdata.hybrid.compiled.rates import values_only, with_rates
from hopdata.hybrid.compiled.stored import WrongResultError
from hopdata.hybrid.compiled.written import Written

Function = Callable[..., Any]


def _largest_by_meaning(function: Function, meant: dict[str, str]) -> dict[str, int]:
    """Return the largest literal index into each argument, by what it is."""
    found = declare.largest_subscripts(function)
    return {meant[name]: number for name, number in found.items() if name in meant}


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
    form : Form, optional
        Plain form in which it is written; by default it is recognised.

    Attributes
    ----------
    users : callable
        The user's Python function.
    form : Form or None
        Its plain form; None if it has the arguments of its kind.
    function : callable
        A Python function with the arguments of its kind, which fills arrays: the
        user's, or one that calls it.
    """

    kept = True  # whether the machine code may be used in other processes
    no_dual: str = ""  # why it has no meaning for duals, though it may compile for them

    def __init__(
        self,
        function: Function,
        signature: Signature,
        compiled: bool = True,
        form: Form | None = None,
    ) -> None:
        function = getattr(function, "py_func", function)
        if form is None:
            form = form_of(function, signature)
        if form is None:
            declare.check_declaration(function, signature)
        self.users = function
        self.form = form
        self.function = function
        if form is not None:
            self.function = in_own_form(function, form)
        self.signature = signature
        # What gives guards without rates exact ones.
        self._exact: Function | None = None
        self._wanted = compiled
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Run the Python function."""
        return self.users(*arguments)

    def __repr__(self) -> str:
        return f"<hybrid callback {declare.function_name(self.users)}>"

    def __copy__(self) -> Callback:
        """Return itself: like a function, it does not change."""
        return self

    def __deepcopy__(self, _: object) -> Callback:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickle stores: the name by which a module holds the function."""
        name = naming.name_of(
            self.users, self.signature, compiled=self._wanted, holder=self
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
        for name, number in self._unpacked.items():
            if name in lengths and number != lengths[name]:
                where = declare.place(self.users, self.signature)
                raise ValueError(
                    f"{where} unpacks {name} into {number} names, but {name} has the "
                    f"length {lengths[name]}"
                )
        for position, number in self._subscripts.items():
            name = self.signature.arguments[position]
            if name in lengths and number >= lengths[name]:
                where = declare.place(self.users, self.signature)
                raise ValueError(
                    f"{where} uses {name}[{number}], but {name} has the length "
                    f"{lengths[name]}"
                )
        if self.form is None or not self.form.returns or self.count is None:
            return
        result = self.form.result
        if result in lengths and self.count != lengths[result]:
            where = declare.place(self.users, self.signature)
            what = declare.LENGTHS[self.signature.name]
            found = "1 number" if self.count == 1 else f"{self.count} numbers"
            raise ValueError(
                f"{where} returns {found}; expected {lengths[result]}, {what}"
            )

    def check_result(self, *arguments: Any) -> None:
        """Raise TypeError if the result of a plain function has a wrong shape.

        The machine code does not fill the arrays then.

        Parameters
        ----------
        *arguments
            The arguments of its kind.
        """
        if self.form is None or not self.form.returns:
            return
        with np.errstate(all="ignore"):
            try:
                self.function(*arguments)
            except WrongResultError:
                raise
            except Exception:  # the user's own, which machine code may not raise
                return

    @cached_property
    def _written(self) -> Written | None:
        """A plain function that Numba may compile, in the integrator's form."""
        if self.form is None or not isinstance(self.users, FunctionType):
            return None
        return Written(self.users, self.form)

    @property
    def count(self) -> int | None:
        """Number of elements that a plain function returns, if its source shows it."""
        return None if self._written is None else self._written.count

    @property
    def _to_compile(self) -> Function:
        """The function for machine code, as the globals are now."""
        if self._written is None:
            if isinstance(self.function, FunctionType):
                return with_helpers(self.function)
            return self.function
        if self.signature.name == "guards":
            return with_rates(self._written.function, self._exact)
        return with_helpers(self._written.function)

    def with_exact_rates(self, exact: Function) -> Callback:
        """Return guards whose rates are exact, if they return only their values.

        Others return themselves.

        Parameters
        ----------
        exact : callable
            Makes guards with rates from a function of compiled code that fills `h`.
        """
        if self.form is None or self.signature.name != "guards":
            return self
        made = self.anew(always=True)
        made._exact = exact
        return made

    def uncompiled(self) -> Callback:
        """Return a callback of the same function that Python runs."""
        return Callback(self.users, self.signature, False, self.form)

    def source_and_places(
        self, names: frozenset[str]
    ) -> tuple[Function, tuple[int, ...]]:
        """Return the user's function, and the positions of arguments of these names."""
        given = self.signature.arguments
        if self.form is not None:
            given = self.form.arguments
        places = [place for place, name in enumerate(given) if name in names]
        return self.users, tuple(places)

    @cached_property
    def n_params(self) -> int:
        """Smallest number of parameters that the function's code requires."""
        return self._subscripts.get(self.signature.arguments.index("params"), -1) + 1

    def elements_of(self, argument: str, length: int) -> tuple[int, ...]:
        """Return the elements of an argument of this length that may matter."""
        function, position = self._argument(argument)
        named = declare.elements_named(function, position)
        if named is None:
            return tuple(range(length))
        return tuple(sorted(named))

    def _argument(self, argument: str) -> tuple[Function, int]:
        """Return a function whose code shows the use of an argument, and its place."""
        if self._written is None:
            return self.function, self.signature.arguments.index(argument)
        if argument == "dy" and self.signature.name == "guards":
            argument = "y"  # the rates of its values follow from those of the state
        return self._written.function, self._written.arguments.index(argument)

    @cached_property
    def _unpacked(self) -> dict[str, int]:
        """Number of names into which an argument is unpacked, by the argument."""
        found = declare.names_unpacked(self.users)
        meant = self._meant_by_user
        return {meant[name]: found[name] for name in found if name in meant}

    @cached_property
    def _meant_by_user(self) -> dict[str, str]:
        """What each of the user's own arguments is, by the name of the user's."""
        if not isinstance(self.users, FunctionType):
            return {}
        given: tuple[str, ...] = self.signature.arguments
        names = self.users.__code__.co_varnames
        if self.form is not None:
            given, names = self.form.arguments, self.form.names
        return dict(zip(names, given, strict=False))

    @cached_property
    def _subscripts(self) -> dict[int, int]:
        """Largest literal index into each argument, by the argument's position."""
        found = _largest_by_meaning(self.users, self._meant_by_user)
        if self._written is not None:
            # It also shows which parameters stand for single arguments. Where the
            # user's source is not known, it only calls the user's function.
            function, given = self._written.function, self._written.arguments
            names = function.__code__.co_varnames[: len(given)]
            meant = dict(zip(names, given, strict=True))
            for name, number in _largest_by_meaning(function, meant).items():
                found[name] = max(number, found.get(name, -1))
        places = self.signature.arguments
        return {places.index(name): found[name] for name in found if name in places}

    @cached_property
    def constants(self) -> Constants:
        """What its machine code is made from, besides its own text."""
        if not isinstance(self.users, FunctionType):
            return Constants()
        functions = [self.users]
        if self._wanted:
            found = Constants(functions)
        else:
            found = Constants(in_python=functions)
        renew_called(found)
        return found

    def anew(self, *, always: bool = False) -> Callback:
        """Return itself or, if what it was made from has changed, a new callback."""
        if not always and self.constants.are_current():
            return self
        return Callback(self.users, self.signature, self._wanted, self.form)

    @cached_property
    def dispatcher(self) -> Any:
        """The function, or its trampoline, callable from other code in Numba."""
        if self._compiled is None:
            return numba.njit(trampoline(self._protected, self.signature))
        return numba.njit(error_model="numpy")(with_digest(self._to_compile))

    @property
    def _of_other_numbers(self) -> Function:
        """The function for ranges or duals; guards without rates fill only `h`."""
        function = self._to_compile
        if self._written is not None and self.signature.name == "guards":
            function = values_only(self._written.function)
        if isinstance(function, FunctionType):
            return with_helpers(function, decorated=True)
        return function

    @cached_property
    def ranged(self) -> Any:
        """The function, callable from code in Numba with ranges for states and time."""
        return within(with_digest(self._of_other_numbers))

    @cached_property
    def dual(self) -> Any:
        """The function, callable from code in Numba with duals (`numbers.duals`)."""
        return within(with_digest(self._of_other_numbers))

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
        if not isinstance(self.users, FunctionType):
            reason, advice = declare.reason_of_object(self.users)
            declare.warn_slow(self.users, self.signature, reason, advice)
            return None
        try:
            return self._made()
        # Numba's own exceptions, and others raised within it.
        except Exception as error:
            declare.raise_if_mistaken(self.users, self.signature, error)
            reason, advice = declare.reason_and_advice(error, self.users)
            declare.warn_slow(self.users, self.signature, reason, advice)
            return None

    def _made(self) -> Any:
        """Return the machine code, from the cache or compiled now.

        Guards that do not compile for duals have their rates from differences.
        """
        if self._exact is not None:
            try:
                return self._compiled_now()
            # Numba's own exceptions, and others raised within it.
            except Exception:
                self._exact = None
        return self._compiled_now()

    def _compiled_now(self) -> Any:
        function = self._to_compile

        def compile_it(cached: bool) -> Any:
            kept = cached and self.kept
            native = self.signature.native
            compiler = numba.cfunc(native, cache=kept, error_model="numpy")
            return compiler(with_digest(function))

        digest = function_digest(function)
        if self.form is not None:
            digest = f"{digest}-{_digest_of_forms()}"
        return compiled_in_cache(function, digest, compile_it)


@cache
def _digest_of_forms() -> str:
    """Return a digest of the sources by which plain functions are rewritten."""
    package = Path(__file__).parents[1]
    return sources_digest(package, "compiled") + sources_digest(package, "numbers")


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
        naming.require_same_constants(full, found.users, constants)
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
        respect to ``y[j]``. It is zero on entry. Of a System with `sparsity`, it has
        the derivatives of the pattern only: with bandwidths (lower, upper) one row for
        each diagonal, ``jac[upper + i - j, j]``; with a matrix one row, ``jac[0, k]``,
        with the entries of the pattern row by row, from left to right.
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
