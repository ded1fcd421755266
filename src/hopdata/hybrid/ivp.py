"""`solve_ivp`: the call and the results of `scipy.integrate.solve_ivp`.

A program for SciPy changes only its import. The functions are compiled, events are
localised to rounding, and each is a guard of a `System` that is made here.
"""

from __future__ import annotations

import inspect
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property
from types import FunctionType
from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import ArgumentError, told_call
from hopdata.hybrid import arguments
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.constants import Constants, renew_called
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.compiled.forms import ORDINARY, Form
from hopdata.hybrid.compiled.helpers import with_helpers
from hopdata.hybrid.compiled.kernel import FIELD, GUARDS, JACOBIAN
from hopdata.hybrid.compiled.written import native_arguments
from hopdata.hybrid.solution import Solution
from hopdata.hybrid.solve import solve
from hopdata.hybrid.system import System

Function = Callable[..., Any]

#: SciPy's methods, and those that take their places: of the same order or a higher
#: one, explicit or implicit alike. LSODA changes between both kinds, as "auto" does.
METHODS = {
    "RK23": "dopri5",
    "RK45": "dopri5",
    "DOP853": "dop853",
    "Radau": "rosenbrock",
    "BDF": "rosenbrock",
    "LSODA": "auto",
    "auto": "auto",
    "dopri5": "dopri5",
    "dop853": "dop853",
    "rosenbrock": "rosenbrock",
}
# Options of SciPy's that do not exist here, and what to do.
REFUSED = {
    "min_step": "there is no smallest step: a step that underflows ends with a message",
    "jac_sparsity": "the Jacobian is dense: leave it out",
    "lband": "the Jacobian is full: leave it out",
    "uband": "the Jacobian is full: leave it out",
}
LARGEST_WHOLE = 2**53  # floats hold every whole number up to it
KEPT_SYSTEMS = 64


class OdeResult(dict[str, Any]):
    """What `solve_ivp` returns: a dictionary whose entries are attributes as well.

    Attributes
    ----------
    t : (N,) array
        Times, s.
    y : (n, N) array
        States at these times.
    sol : DenseOutput or None
        The state at any time, if dense output was asked for.
    t_events, y_events : list of array, or None
        Instants of each event, and the states at them.
    nfev, njev, nlu : int
        Numbers of evaluations of the field, of Jacobians and of decompositions; the
        last two are counted for implicit methods only.
    status : int
        0: reached the end; 1: ended by an event; -1: failed.
    message : str
        How it ended, in words.
    success : bool
        Whether it reached the end or an event that ends it.
    solution : Solution
        The result in this package's own form.
    """

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(name) from None

    def __repr__(self) -> str:
        width = max(len(name) for name in self)
        shown = (name for name in self if name != "solution")
        return "\n".join(f"{name:>{width}}: {self[name]!r}" for name in shown)


class DenseOutput:
    """The state at any time of an integration, named as in SciPy.

    Parameters
    ----------
    solution : Solution
        A result with dense output.
    """

    def __init__(self, solution: Solution) -> None:
        self._solution = solution
        self.ts = solution.t
        self.t_min = float(min(self.ts[0], self.ts[-1]))
        self.t_max = float(max(self.ts[0], self.ts[-1]))

    def __call__(self, t: ArrayLike) -> FloatArray:
        """Return the state at a time, (n,), or at times, (n, N).

        Raises
        ------
        ValueError
            If a time is out of range: a solution is not extrapolated.
        """
        return self._solution(t)


@told_call
def solve_ivp(  # noqa: PLR0913 (the options are SciPy's)
    fun: Function,
    t_span: tuple[float, float],
    y0: ArrayLike,
    method: str = "RK45",
    t_eval: ArrayLike | None = None,
    dense_output: bool = False,
    events: Function | Sequence[Function] | None = None,
    vectorized: bool = False,
    args: Sequence[Any] | None = None,
    *,
    rtol: float = 1e-3,
    atol: ArrayLike = 1e-6,
    max_step: float = np.inf,
    first_step: float | None = None,
    jac: Function | ArrayLike | None = None,
    tstops: Any = None,
    **options: Any,
) -> OdeResult:
    """Integrate an initial value problem, with the call of SciPy's `solve_ivp`.

    Parameters
    ----------
    fun : callable
        ``fun(t, y, *args)`` returns the rates of the state: a tuple, a list, an array,
        or a number for one state.
    t_span : tuple of float
        Start and end, s. If the end is before the start, time runs backward.
    y0 : (n,) array_like
        Initial state, of real numbers.
    method : str
        One of SciPy's: "RK45" and "RK23" stand for "dopri5", "DOP853" for "dop853",
        "Radau" and "BDF" for "rosenbrock", "LSODA" for "auto" (see
        `hopdata.hybrid.solve`, whose own names are taken as well).
    t_eval : (N,) array_like, optional
        Times to report, within `t_span`. By default every step and every event.
    dense_output : bool
        Whether the result has `sol`, the state at any time.
    events : callable or sequence of callable, optional
        ``event(t, y, *args)`` returns a number, and an event is where it is zero. Its
        attribute `terminal` (True, or a count) ends the integration; `direction` (> 0
        or < 0) selects rising or falling crossings. A number that is zero at the start
        is no event there.
    vectorized : bool
        Ignored: such a function also takes one state at a time.
    args : sequence, optional
        Further arguments of `fun`, `events` and `jac`. Numbers and arrays of floats may
        vary from call to call without being compiled anew.
    rtol, atol : float, (n,) array_like
        Tolerances, which default to SciPy's 1e-3 and 1e-6.
    max_step, first_step : float
        Largest and first step.
    jac : callable or (n, n) array_like, optional
        ``jac(t, y, *args)`` returns the derivative of the rates; or a constant matrix.
    tstops : array_like, Every or list, optional
        Instants at which `fun` jumps, as in `hopdata.hybrid.solve`; SciPy has none.
    **options
        Options of SciPy's that do not exist here are refused by one sentence.

    Returns
    -------
    OdeResult
        SciPy's fields, and `solution`, the result in this package's form.

    Raises
    ------
    ValueError
        If an argument is out of range or of the wrong shape, or an option is not known.
    Exception
        Whatever the functions raise.

    Examples
    --------
    >>> def upward_throw(t, y):
    ...     return [y[1], -9.81]
    >>> def lands(t, y):
    ...     return y[0]
    >>> lands.terminal, lands.direction = True, -1
    >>> result = solve_ivp(upward_throw, (0, 100), [0, 50], events=lands)
    >>> result.t_events[0].round(6)
    array([10.19368])
    """
    for name in options:
        why = REFUSED.get(name, "it is no option of solve_ivp: leave it out")
        raise ArgumentError(f"{name}: cannot be given here; {why}")
    known = isinstance(method, str) and method in METHODS
    expect(known, "method", f"one of {', '.join(METHODS)}", repr(method))
    arguments.check_flag("vectorized", vectorized)
    is_complex = False
    with suppress(ValueError):  # rows of different lengths, which are refused below
        is_complex = np.iscomplexobj(y0)
    if is_complex:
        hint = "; write real and imaginary parts as states of their own"
        expect(False, "y0", "real numbers", "complex ones", hint)
    state = arguments.numbers_of("y0", y0)
    expect(state.ndim == 1 and len(state) > 0, "y0", "shape (n,)", state.shape)
    functions = _listed(events)
    given = _given(args)
    system = _system(fun, functions, jac, given, len(state))
    solution = solve(
        system,
        t_span,
        state,
        params=given.params,
        rtol=rtol,
        atol=atol,
        max_step=max_step,
        first_step=first_step,
        t_eval=t_eval,
        method=METHODS[method],
        dense_output=dense_output,
        tstops=tstops,
    )
    return _result(solution, METHODS[method], events is not None)


def _result(solution: Solution, method: str, has_events: bool) -> OdeResult:
    """Return a solution in SciPy's form."""
    t_events = None
    y_events = None
    if has_events:
        log = solution.events
        rows = [log.guard == k for k in range(len(log.guard_names))]
        t_events = [log.time[chosen] for chosen in rows]
        y_events = [log.before[chosen] for chosen in rows]
    sol = None
    if solution.dense is not None:
        sol = DenseOutput(solution)
    is_implicit = method == "rosenbrock"
    return OdeResult(
        t=solution.t,
        y=solution.y,
        sol=sol,
        t_events=t_events,
        y_events=y_events,
        nfev=solution.nfev,
        njev=solution.n_steps if is_implicit else 0,
        nlu=solution.n_steps + solution.n_rejected if is_implicit else 0,
        status=max(solution.status, -1),
        message=solution.message,
        success=solution.success,
        solution=solution,
    )


# Arguments of the functions besides time and state.


class _Given:
    """The values in `args`: numbers that may vary, and constants.

    Parameters
    ----------
    values : tuple
        What the caller gives.

    Attributes
    ----------
    params : list of float
        Numbers that become parameters of the system.
    expressions : list of str
        Each of the values in terms of the parameters, or its name in `bound`.
    bound : dict
        Values that are constants of the code.
    """

    def __init__(self, values: tuple[Any, ...]) -> None:
        self.params: list[float] = []
        self.expressions: list[str] = []
        self.bound: dict[str, Any] = {}
        for value in values:
            self.expressions.append(self._expression(value))

    def _expression(self, value: Any) -> str:
        first = len(self.params)
        if isinstance(value, bool | np.bool_):
            self.params.append(float(value))
            return f"params[{first}] != 0.0"
        if isinstance(value, int | np.integer) and abs(int(value)) <= LARGEST_WHOLE:
            self.params.append(float(value))
            return f"int(params[{first}])"
        if isinstance(value, float | np.floating):
            self.params.append(float(value))
            return f"params[{first}]"
        array = np.asarray(value) if isinstance(value, list | np.ndarray) else None
        if array is not None and array.dtype == np.float64 and array.ndim in (1, 2):
            self.params += array.ravel().tolist()
            part = f"params[{first}:{len(self.params)}]"
            return part if array.ndim == 1 else f"{part}.reshape({array.shape})"
        name = f"constant{len(self.bound)}"
        self.bound[name] = value
        return name

    def form(self, kind: str, function: Function) -> Form:
        """Return the form of a function that takes time, state and these arguments."""
        expressions = ["t", "y", *self.expressions]
        bound = {name: self.bound[name] for name in self.bound}
        try:
            parameters = list(inspect.signature(function).parameters.values())
        except (TypeError, ValueError):
            names = tuple(f"argument{k}" for k in range(len(expressions)))
            return Form(kind, tuple(expressions), True, names, bound)
        ordinary = [one for one in parameters if one.kind in ORDINARY]
        names = tuple(one.name for one in ordinary[: len(expressions)])
        open_ended = [one for one in parameters if one.kind == one.VAR_POSITIONAL]
        if open_ended:
            rest = expressions[len(names) :]
            expressions = expressions[: len(names)]
            inside = "".join(f"{one}, " for one in rest)
            expressions.append(f"*({inside})")
            names = (*names, open_ended[0].name)
        n_needed = sum(one.default is one.empty for one in ordinary)
        label = getattr(function, "__name__", type(function).__name__)
        fits = len(names) == len(expressions) and n_needed <= len(expressions)
        wanted = f"a function of t, y and the {len(self.expressions)} values in args"
        found = f"one of {len(ordinary)} arguments"
        expect(fits, label, wanted, found)
        for one in ordinary[len(names) :]:
            bound[one.name] = one.default
            expressions.append(one.name)
            names = (*names, one.name)
        return Form(kind, tuple(expressions), True, names, bound)


def _given(args: Sequence[Any] | None) -> _Given:
    if args is None:
        return _Given(())
    hint = "; one value is written (value,)"
    listed = isinstance(args, tuple | list | np.ndarray)
    expect(listed, "args", "a tuple of values", repr(args), hint)
    return _Given(tuple(args))


# Events.


def _listed(events: Any) -> list[Function]:
    if events is None:
        return []
    if callable(events):
        return [events]
    listed = isinstance(events, list | tuple) and all(map(callable, events))
    expect(listed, "events", "a function, or a list of functions", repr(events))
    return list(events)


class _Events(Callback):
    """Separate event functions as the guards of a system.

    Parameters
    ----------
    functions : list of callable
        The user's functions, each of which returns one number.
    forms : list of Form
        How each is called.
    """

    def __init__(
        self, functions: list[Function], forms: list[Form], compiled: bool = True
    ) -> None:
        self._functions = [getattr(one, "py_func", one) for one in functions]
        self._forms = forms
        names = native_arguments("guards")
        fills = Form("guards", names, False, names)
        super().__init__(self._together(self._functions), GUARDS, compiled, fills)

    def _together(self, functions: list[Any]) -> FunctionType:
        """Return a function that fills `h` by calling these."""
        first = self._functions[0]
        known: dict[str, Any] = {"__name__": getattr(first, "__module__", __name__)}
        lines = []
        for k, (function, form) in enumerate(zip(functions, self._forms, strict=True)):
            known[f"EVENT_{k}"] = function
            taken = []
            for one in form.arguments:
                if one in form.bound:
                    known[f"BOUND_{k}_{one}"] = form.bound[one]
                    taken.append(f"BOUND_{k}_{one}")
                else:
                    taken.append(one)
            lines.append(f"    h[{k}] = EVENT_{k}({', '.join(taken)})")
        name = getattr(first, "__name__", "events")
        if not name.isidentifier() or len(functions) > 1:
            name = "events"
        head = f"def {name}({', '.join(native_arguments('guards'))}):"
        code = getattr(first, "__code__", None)
        file = __file__ if code is None else code.co_filename
        exec(compile("\n".join([head, *lines]), file, "exec"), known)
        made: FunctionType = known[name]
        if code is not None:
            line = code.co_firstlineno
            made.__code__ = made.__code__.replace(co_firstlineno=line)
        return made

    @cached_property
    def constants(self) -> Constants:
        """What the machine code of all of them is made from."""
        plain = [one for one in self._functions if isinstance(one, FunctionType)]
        found = Constants(plain) if self.wanted else Constants(in_python=plain)
        renew_called(found)
        return found

    @cached_property
    def _written(self) -> Any:
        """The guards for machine code."""
        if not all(isinstance(one, FunctionType) for one in self._functions):
            return None
        inner = []
        for one in self._functions:
            assert isinstance(one, FunctionType)
            inner.append(
                numba.njit(error_model="numpy")(with_digest(with_helpers(one)))
            )
        return _Together(self._together(inner))

    def anew(self, *, always: bool = False) -> Callback:
        """Return itself, or a new one if a constant of a function has changed."""
        if not always and self.constants.are_current():
            return self
        return _Events(self._functions, self._forms, self.wanted)

    def uncompiled(self) -> Callback:
        """Return the same guards, run by Python."""
        return _Events(self._functions, self._forms, False)


class _Together:
    """Several event functions as they are compiled; named as in `Written`."""

    arguments = native_arguments("guards")
    count = None

    def __init__(self, function: FunctionType) -> None:
        self.function = function


# Systems, kept for the next call with the same functions.

_systems: OrderedDict[Any, System] = OrderedDict()


def _system(
    fun: Function, events: list[Function], jac: Any, given: _Given, n_states: int
) -> System:
    """Return the system of these functions: made now, or in an earlier call."""
    expect(callable(fun), "fun", "a function of t, y", repr(fun))
    directions = tuple(int(np.sign(getattr(one, "direction", 0))) for one in events)
    terminal = tuple(_terminal(one) for one in events)
    constants = None if jac is None or callable(jac) else _matrix(jac, n_states)
    derivative = jac
    if constants is not None:
        derivative = constants.tobytes()
    key: Any = (
        fun,
        tuple(events),
        directions,
        terminal,
        derivative,
        tuple(given.expressions),
        tuple(given.bound.items()),
        n_states,
    )
    try:
        system = _systems.get(key)
    except TypeError:  # a constant that cannot be compared
        key = None
        system = None
    if system is not None:
        _systems.move_to_end(key)
        return system
    guards = None
    if events:
        forms = [given.form("guards", one) for one in events]
        guards = _Events(events, forms)
    system = System(
        Callback(fun, FIELD, True, given.form("field", fun)),
        guards,
        jacobian=_jacobian(jac, constants, given),
        n_states=n_states,
        guard_names=_names(events),
        directions=directions,
        terminal=terminal,
    )
    if key is not None:
        _systems[key] = system
        while len(_systems) > KEPT_SYSTEMS:
            _systems.popitem(last=False)
    return system


def _terminal(event: Function) -> int:
    """Return after how many events the integration ends; 0 for never."""
    terminal = getattr(event, "terminal", False)
    if terminal is None:
        return 0
    known = isinstance(terminal, bool | np.bool_ | int | float | np.number)
    whole = known and terminal >= 0 and terminal == int(terminal)
    expect(whole, "terminal", "a boolean or a count", repr(terminal))
    return int(terminal)


def _names(events: list[Function]) -> tuple[str, ...]:
    """Return a name for each event: that of its function, numbered if it is not one."""
    names: list[str] = []
    for k, event in enumerate(events):
        name = getattr(event, "__name__", type(event).__name__)
        if name in names or not name.isidentifier():
            name = f"event {k}"
        names.append(name)
    return tuple(names)


def _matrix(jac: Any, n_states: int) -> FloatArray:
    """Return a constant Jacobian as an array."""
    if hasattr(jac, "toarray"):
        jac = jac.toarray()
    matrix = arguments.numbers_of("jac", jac)
    shape = (n_states, n_states)
    expect(matrix.shape == shape, "jac", f"shape {shape}", matrix.shape)
    return matrix


def _jacobian(jac: Any, matrix: FloatArray | None, given: _Given) -> Callback | None:
    if jac is None:
        return None
    if matrix is None:
        return Callback(jac, JACOBIAN, True, given.form("jacobian", jac))

    def constant(t, y):  # type: ignore[no-untyped-def]  # noqa: ARG001 (a Jacobian's)
        return matrix

    return Callback(constant, JACOBIAN, True)
