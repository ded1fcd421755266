"""Systems derived from a user's system, so that the driver needs no variants.

Their functions are machine code that wraps the user's. A *backward* system has the time
s = -t: the time changes sign before each call, and all rates change sign after it.
Locks and crossing directions refer to the crossings as they occur along the way. A
system *with its parameters as states*, which are constant, extends the derivative of
the flow to them. For *debugging*, Python runs all functions, which checks every index.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from hopdata.errors import ArgumentError
from hopdata.hybrid import arguments
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.constants import Constants
from hopdata.hybrid.compiled.kernel import SIGNATURES
from hopdata.hybrid.compiled.stored import WrongResultError
from hopdata.hybrid.known_instants import (
    Instants,
    backward_instants,
    instants_of,
)
from hopdata.hybrid.methods import tangent
from hopdata.hybrid.methods.explicit import compose
from hopdata.hybrid.methods.method import put_in
from hopdata.hybrid.numbers.switches import field_for_ranges, may_switch
from hopdata.hybrid.numbers.values import value_of
from hopdata.hybrid.sliding import Slides, no_handler, sliding_system
from hopdata.hybrid.system import System

Answer = TypeVar("Answer")
RATES = ("dy", "hdot", "jac", "a", "b")  # arguments that change sign when time does
NO_PAST = (
    "t_span: expected the end not before the start, because a state that slides along "
    "a guard has no unique past: all states that arrive there go on alike"
)
NO_LAW_BACK = (
    "t_span: expected the end not before the start, because the effect of the law for "
    "several guards at once (System(together=...)) is not known backward"
)
NO_MOVING_INSTANTS = (
    "jacobian: expected True or False, because System(tstops=...) is a function of the "
    "parameters, and how the instants move is not known: "
)
WITH_PARAMS = "params"  # choice of `jacobian` that includes the parameters


class Around(Callback):
    """Machine code that wraps a user's function, which it calls by the name INNER.

    Parameters
    ----------
    inner : Callback
        The user's function.
    body : list of str
        Lines of code, in terms of the arguments of `inner`.
    n_params : int
        Number of parameters that the code uses.
    ranged, for_duals : list of str, optional
        The same lines for ranges and for duals of states; by default `body`.
    **names : object
        Other names that the code uses.
    """

    def __init__(
        self,
        inner: Callback,
        body: list[str],
        n_params: int,
        ranged: list[str] | None = None,
        for_duals: list[str] | None = None,
        **names: Any,
    ) -> None:
        kind = inner.signature
        names = {"INNER": inner.dispatcher, "np": np, **names}
        function = compose(kind.name, ", ".join(kind.arguments), body, names)
        super().__init__(function, kind)
        self.inner = inner
        # Otherwise the code contains the address of a Python function.
        self.kept = inner.compiled
        self.n_params = n_params
        self._body = body
        self._ranged = body if ranged is None else ranged
        self._for_duals = body if for_duals is None else for_duals
        self._names = names

    def check_result(self, *arguments: Any) -> None:
        """Raise TypeError if the user's function returns what has a wrong shape.

        It is called with the arguments that the code here gives it.
        """
        kind = self.signature
        names = {**self._names, "INNER": self.inner.check_result}
        check = compose(kind.name, ", ".join(kind.arguments), self._body, names)
        with np.errstate(all="ignore"):
            try:
                check(*arguments)
            except WrongResultError:
                raise
            except Exception:  # as in `Callback.check_result`
                return

    @cached_property
    def ranged(self) -> Any:
        """The code for ranges, around that of the user's function."""
        from hopdata.hybrid.numbers.ranges import part, turned

        kind = self.signature
        known = {"INNER": self.inner.ranged, "PART": part, "TURNED": turned}
        names = {**self._names, **known}
        made = compose(kind.name, ", ".join(kind.arguments), self._ranged, names)
        return put_in(made)

    @property
    def no_dual(self) -> str:  # type: ignore[override]
        """Why the user's function has no code for duals."""
        return self.inner.no_dual

    @cached_property
    def dual(self) -> Any:
        """The code for duals, around that of the user's function."""
        kind = self.signature
        names = {**self._names, "INNER": self.inner.dual}
        made = compose(kind.name, ", ".join(kind.arguments), self._for_duals, names)
        return put_in(made)

    @cached_property
    def constants(self) -> Constants:
        """Nothing of its own.

        The system from which it is derived looks at the user's function.
        """
        return Constants()

    @property
    def compiled(self) -> bool:
        """Whether the user's function is compiled."""
        return self.inner.compiled

    def check_lengths(self, **lengths: int) -> None:
        """Check the parameters of the wrapped function; see `Callback.check_lengths`.

        Its other arguments were checked in the system from which this one is derived;
        here they may be parts of longer ones.
        """
        if "params" in lengths:
            self.inner.check_lengths(params=lengths["params"])


def _made(
    system: System,
    key: Any,
    derive: Callable[[Callback], Callback | None],
    *,
    n_states: int | None = None,
    way: float | None = None,
    n_shown: int | None = None,
) -> System:
    """Return the derived system, made once; what is not given is as in the system."""
    if key not in system.made:
        functions: dict[str, Any] = {}
        for name in (*SIGNATURES, "undo"):
            given = getattr(system, name)
            if given is not None:
                functions[name] = derive(given)
        if n_states is None:
            n_states = system.n_states
        made = replace(system, **functions, n_states=n_states)
        # Set as the cached properties that they are.
        vars(made)["way"] = system.way if way is None else way
        vars(made)["n_shown"] = system.n_shown if n_shown is None else n_shown
        system.made[key] = made
    derived: System = system.made[key]
    return derived


def _backward(inner: Callback) -> Around:
    """Return a function of the system in the time s = -t."""
    kind = inner.signature
    one_by_one = "k" in kind.arguments
    turned = {}  # the line that changes the sign of each rate
    for name in kind.arguments:
        if name == "hdot" and one_by_one:
            # The other guards' rates may be stored there as well.
            turned[name] = "hdot[k] = -hdot[k]"
        elif name in RATES:
            # A matrix by rows; lanes can do it, too.
            turned[name] = f"for i in range(len({name})): {name}[i] = -{name}[i]"
    call = ", ".join("-t" if name == "t" else name for name in kind.arguments)
    before = [line for name, line in turned.items() if name not in kind.fills]
    body = [*before, f"result = INNER({call})", *turned.values(), "return result"]
    turned_around = {"t": "-t"}
    if "dy" not in kind.fills:
        turned_around["dy"] = "TURNED(dy)"  # rates of ranges follow -t
    call = ", ".join(turned_around.get(name, name) for name in kind.arguments)
    return Around(inner, body, inner.n_params, ranged=[f"return INNER({call})"])


def backward(system: System) -> System:
    """Return the system in the time s = -t.

    Raises
    ------
    ValueError
        If the system has a handler but no `undo`.
    """
    if system.on_event is not None and system.undo is None:
        raise ArgumentError(
            "t_span: expected the end not before the start, because the effect of "
            "on_event on the state, the mode and the memory is not known backward. "
            "Give System(undo=...), declared by @on_event, which undoes it when the "
            "same guard is crossed from the other side; or on_event itself, if it "
            "changes nothing that matters"
        )
    is_new = "backward" not in system.made
    turned = _made(system, "backward", _backward, way=-system.way)
    if is_new and system.undo is not None:
        vars(turned).update(on_event=turned.undo, undo=turned.on_event)
    return turned


# Derivative, by differences, of a guard that does not compile for duals with respect to
# a parameter: how the guard would change if it moved.
BY_PARAMETERS = """
n = len(h)
for j in range(N, len(y)):
    if dy[j] != 0.0:
        q, values, rates = y[j], np.zeros((6, n)), np.empty(n)
        step, slopes = ROOT * (abs(q) if q != 0.0 else 1.0), np.empty((n, 1))
        for attempt in range(ATTEMPTS):
            for side in range(4):
                y[j] = q + SHIFTS[side] * step
                INNER({call})
            if settle(values, 0, attempt, step, slopes, 0, 0, n):
                break
            step *= SHORTER
        for i in {guards}:
            hdot[i] += slopes[i, 0] * dy[j]
        y[j] = q
"""
KNOWN = {
    "ROOT": tangent.FIFTH_ROOT_OF_EPS,
    "ATTEMPTS": tangent.ATTEMPTS,
    "SHIFTS": tangent.SHIFTS,
    "SHORTER": tangent.SHORTER,
    "settle": tangent.settle,
}


def field_of_parameters(system: System) -> Around:
    """Return the field whose states are the user's, followed by the parameters."""
    inner = system.field
    arguments_of = "t, PART(y, 0, N), mode, PART(y, N, len(y)), dy"
    ranged = [f"return INNER({arguments_of})"]
    body = ["return INNER(t, y[:N], mode, y[N:], dy)"]
    return Around(inner, body, 0, ranged, N=system.n_states)


def with_parameters(system: System, n_params: int) -> System:
    """Return the system whose states are the user's, followed by the parameters."""
    wanted = "no n_memory with 'params', because params contains the memory"
    arguments.expect(system.n_memory == 0, "jacobian", wanted, system.n_memory)
    system.check_params_length(n_params)
    n = system.n_states

    def around(inner: Callback, by_differences: bool = False) -> Around | None:
        kind = inner.signature
        if kind.name in ("jacobian", "affine"):
            return None
        slices = {"y": "y[:N]", "dy": "dy[:N]", "params": "y[N:]"}
        call = ", ".join(slices.get(name, name) for name in kind.arguments)
        body = [f"result = INNER({call})"]
        plain = None
        ranged = None
        if kind.name == "field":
            body.append("dy[N:] = 0.0")
            ranged = ["return INNER(t, PART(y, 0, N), mode, PART(y, N, len(y)), dy)"]
        if "hdot" in kind.arguments:
            guards = "range(k, k + 1)" if "k" in kind.arguments else "range(n)"
            parts = {
                "y": "PART(y, 0, N)",
                "dy": "PART(dy, 0, N)",
                "params": "PART(y, N, len(y))",
            }
            ranged_call = ", ".join(parts.get(name, name) for name in kind.arguments)
            ranged = [f"return INNER({ranged_call})"]
            plain = [f"return INNER({call})"]
        if "hdot" in kind.arguments and by_differences:
            call = call.replace("hdot", "rates").replace("h, ", "values[side], ")
            body += BY_PARAMETERS.format(call=call, guards=guards).strip().splitlines()
        body.append("return result")
        return Around(inner, body, 0, ranged, plain, N=n, **KNOWN)

    key: tuple[Any, ...] = (WITH_PARAMS, n_params)
    shape = {"n_states": n + n_params, "n_shown": n}
    made = _made(system, key, around, **shape)
    needed = made
    if system.sliding:  # the guards by which sliding ends need second derivatives
        needed = sliding_system(made)
    if needed.derivatives.guards.reason:
        key = (WITH_PARAMS, n_params, "by differences")
        made = _made(system, key, partial(around, by_differences=True), **shape)
    return made


def in_python(system: System) -> System:
    """Return the system with all functions run by Python."""

    def uncompiled(given: Callback) -> Callback:
        return given.uncompiled()

    return _made(system, "debug", uncompiled)


def goes_back(t_span: Any) -> bool:
    """Return whether a time span ends before its start; False if it is none."""
    try:
        start, end = t_span
        return float(end) < float(start)
    except (TypeError, ValueError):
        return False


def ask_derived(
    ask: Callable[..., Answer],
    system: System,
    *,
    t_span: Any,
    t_eval: Any,
    jacobian: Any,
    debug: Any = False,
    tstops: Any = None,
    **others: Any,
) -> Answer:
    """Solve with the derived system that the options require, and return the answer."""
    _check_params_length(system, others["params"])
    known = None
    seeks = False
    if tstops is not None or system.has_instants:
        known = instants_of(system, tstops, others["params"])
        seeks = bool(system.find_tstops) and system.field.compiled
    own_are_functions = callable(system.tstops)
    if arguments.check_flag("debug", debug):
        system = in_python(system)
    if isinstance(jacobian, str):
        wanted = "True or False, or 'params'"
        arguments.expect(jacobian == WITH_PARAMS, "jacobian", wanted, repr(jacobian))
        system, others = _parameters_as_states(system, others)
        jacobian = True
    if goes_back(t_span):
        system = _turned(system)
        known = backward_instants(known)
        t_span, t_eval = _turned_times(t_span, t_eval)
    if system.sliding:
        system, others = _sliding(system, others)
    elif system.together is not None:
        system, others = _by_law(system, others)
    unsought = ""
    if system.n_shown < system.n_states:
        unsought = why_unsought(system)
        if unsought and own_are_functions:
            raise ArgumentError(NO_MOVING_INSTANTS + unsought)
    if known is not None:
        system, others = _with_known(system, others, known, seeks)
    if unsought:
        vars(system)["unsought"] = unsought
    return ask(system, t_span, t_eval=t_eval, jacobian=jacobian, **others)


def _turned(system: System) -> System:
    """Return the system in the time s = -t; some have no unique past."""
    if system.sliding:
        raise ArgumentError(NO_PAST)
    if system.together is not None:
        raise ArgumentError(NO_LAW_BACK)
    return backward(system)


def _turned_times(t_span: Any, t_eval: Any) -> tuple[tuple[float, ...], Any]:
    """Return the time span and the times to report, in the time s = -t."""
    turned = tuple(-float(one) for one in t_span)
    if t_eval is not None:
        times = -arguments.numbers_of("t_eval", t_eval)
        try:
            t_eval = arguments.check_times(times, *turned)
        except ValueError:
            wanted = f"decreasing times within {t_span}"
            arguments.expect(False, "t_eval", wanted, t_eval)
    return turned, t_eval


def why_unsought(system: System) -> str:
    """Return why the field's own instants are not sought; "" if they are.

    It is "" as well if the field has none by its source.
    """
    if not may_switch(system.field):
        return ""
    if not system.find_tstops:
        return "System(find_tstops=False) turns that off"
    if not system.field.compiled:
        return "it runs as plain Python"
    return with_instants(system, True).switches.reason


def _check_params_length(system: System, params: Any) -> None:
    """Raise ValueError if one of the user's functions needs more parameters.

    A derived system may have further ones, which the user's functions do not see.
    """
    numbers = np.atleast_1d(arguments.numbers_of("params", params))
    system.check_params_length(numbers.shape[-1] + system.n_memory)


def _with_known(
    system: System, options: dict[str, Any], known: Instants, seeks: bool
) -> tuple[System, dict[str, Any]]:
    """Return the system that ends steps at known instants, and the options for it."""
    derived = with_instants(system, seeks)
    own = system.n_memory
    params = arguments.numbers_of("params", options["params"])
    count = params.shape[-1] if params.ndim else 1
    system.check_params_length(count + own)  # before two more follow them
    changed: dict[str, Any] = {"tstops": known}
    if options["memory"] is not None or system.sparsity is not None:
        given = np.zeros(own)
        if options["memory"] is not None:
            given = arguments.numbers_of("memory", options["memory"]).ravel()
            wanted = f"{own} numbers"
            arguments.expect(len(given) == own, "memory", wanted, len(given))
        changed["memory"] = np.append(given, [-np.inf, np.inf])
    return derived, options | changed


# The field sees the time within limits, the last two parameters (see `driver.known`).
HELD = "min(max(t, params[len(params) - 2]), params[len(params) - 1])"
# The same for a dual, whose slope is that of the time.
HELD_DUAL = (
    "t + (min(max(VALUE(t), params[len(params) - 2]), params[len(params) - 1])"
    " - VALUE(t))"
)
USERS = {"params": "params[: len(params) - 2]"}


def with_instants(system: System, seeks: bool) -> System:
    """Return the system whose field sees only times between two known instants.

    Parameters
    ----------
    system : System
        The system.
    seeks : bool
        Whether jumps of its field in time are sought.
    """
    key = ("instants", seeks)
    if key in system.made:
        derived: System = system.made[key]
        return derived

    def around(inner: Callback) -> Around:
        taken = inner.signature.arguments
        plain = ", ".join(USERS.get(name, name) for name in taken)
        ranged = [f"return INNER({plain})"]
        body = ranged
        for_duals = ranged
        if inner.signature.name in ("field", "jacobian"):
            held = USERS | {"t": HELD}
            body = [f"return INNER({', '.join(held.get(one, one) for one in taken)})"]
            held = USERS | {"t": HELD_DUAL}
            call = ", ".join(held.get(one, one) for one in taken)
            for_duals = [f"return INNER({call})"]
        return Around(inner, body, inner.n_params, ranged, for_duals, VALUE=value_of)

    functions: dict[str, Any] = {}
    for name in (*SIGNATURES, "undo"):
        given = getattr(system, name)
        if given is not None:
            functions[name] = around(given)
    made = replace(
        system,
        **functions,
        n_memory=system.n_memory + 2,
        tstops=None,
        find_tstops=False,
    )
    for name in ("way", "n_shown", "slides", "by_law", "rests"):
        vars(made)[name] = getattr(system, name)
    vars(made).update(takes_instants=True, has_instants=False)
    if seeks and may_switch(system.field):
        vars(made)["switches"] = field_for_ranges(system.field)
    system.made[key] = made
    return made


def by_law(system: System) -> System:
    """Return the system whose handler is also the law for several guards at once.

    The driver calls it for guard -1, with the directions of all guards that are due in
    further integers at the end of the mode, which the user's functions do not see.
    """
    if "law" in system.made:
        derived: System = system.made["law"]
        return derived
    assert system.together is not None
    own: dict[str, Any] = {"N_MODES": system.n_modes}

    def shorter(inner: Callback) -> Around:
        call = ", ".join(inner.signature.arguments).replace("mode", "mode[:N_MODES]")
        body = [f"return INNER({call})"]
        return Around(inner, body, inner.n_params, **own)

    functions: dict[str, Any] = {}
    for name in ("field", "guards", "jacobian", "affine"):
        given = getattr(system, name)
        if given is not None:
            functions[name] = shorter(given)
    handler = system.on_event or Callback(no_handler, SIGNATURES["on_event"])
    arguments_of = "t, y, mode[:N_MODES], params"
    body = [
        "if guard < 0:",
        f"    return LAW({arguments_of}, mode[N_MODES:])",
        f"return INNER({arguments_of}, guard, direction)",
    ]
    n_params = max(handler.n_params, system.together.n_params)
    law = system.together.dispatcher
    functions["on_event"] = Around(handler, body, n_params, LAW=law, **own)
    n_extra = system.n_extra_modes + system.n_guards
    made = replace(system, **functions, n_extra_modes=n_extra, together=None, undo=None)
    vars(made).update(
        way=system.way,
        n_shown=system.n_shown,
        by_law=True,
        slides=Slides((), system.n_guards, system.n_modes),
    )
    system.made["law"] = made
    return made


def _by_law(system: System, options: dict[str, Any]) -> tuple[System, dict[str, Any]]:
    """Return the system whose handler is also the law, and the options for it."""
    derived = by_law(system)
    if options["mode"] is None:
        return derived, options
    full = np.zeros(system.n_modes, dtype=np.int64)
    arguments.set_mode(full, system.n_guards, options["mode"])
    none = np.zeros(system.n_guards, dtype=np.int64)
    return derived, options | {"mode": np.concatenate([full, none])}


def _sliding(system: System, options: dict[str, Any]) -> tuple[System, dict[str, Any]]:
    """Return the system that slides along its guards, and the options for it."""
    derived = sliding_system(system)
    slides = derived.slides
    changed: dict[str, Any] = {}
    if options["mode"] is not None:
        full = np.zeros(system.n_modes, dtype=np.int64)
        arguments.set_mode(full, system.n_guards, options["mode"])
        changed["mode"] = slides.start_mode(full)
    if options["memory"] is not None:
        given = arguments.numbers_of("memory", options["memory"]).ravel()
        wanted = f"{system.n_memory} numbers"
        fits = len(given) == system.n_memory
        arguments.expect(fits, "memory", wanted, len(given))
        own = np.zeros(derived.n_memory - system.n_memory)
        changed["memory"] = np.concatenate([given, own])
    return derived, options | changed


def _parameters_as_states(
    system: System, options: dict[str, Any]
) -> tuple[System, dict[str, Any]]:
    """Return the system with its parameters as states, and the options for it."""
    states = arguments.numbers_of("y0", options["y0"])
    fits = states.shape[-1:] == (system.n_states,)
    arguments.expect(fits, "y0", f"{system.n_states} states", f"shape {states.shape}")
    rows = states.shape[:-1]
    params = arguments.numbers_of("params", options["params"]).ravel()
    if rows:
        params = arguments.check_rows(options["params"], len(states))
    arguments.expect(np.isfinite(params).all(), "params", "finite numbers", params)
    params = np.broadcast_to(params, (*rows, params.shape[-1]))
    tolerance = np.zeros(system.n_states)
    arguments.set_tolerance(tolerance, options["atol"])
    n_params = params.shape[-1]
    extended = {
        "y0": np.concatenate([states, params], axis=-1),
        "params": (),
        # Parameters are constant, so they have no error.
        "atol": np.concatenate([tolerance, np.zeros(n_params)]),
    }
    return with_parameters(system, n_params), options | extended
