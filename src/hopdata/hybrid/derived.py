"""Systems derived from a user's system, so that the driver needs no variants.

Their functions are machine code that wraps the user's. A *backward* system has the time
s = -t: the time changes sign before each call, and all rates change sign after it.
Locks and crossing directions refer to the crossings as they occur along the way. A
system *with its parameters as states*, which are constant, extends the derivative of
the flow to them. For *debugging*, Python runs all functions, which checks every index.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from hopdata.errors import ArgumentError
from hopdata.hybrid import arguments
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.constants import Constants
from hopdata.hybrid.compiled.kernel import SIGNATURES
from hopdata.hybrid.methods import tangent
from hopdata.hybrid.methods.explicit import compose
from hopdata.hybrid.methods.method import put_in
from hopdata.hybrid.system import System

Answer = TypeVar("Answer")
RATES = ("dy", "hdot", "jac", "a", "b")  # arguments that change sign when time does
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
    ranged : list of str, optional
        The same lines for ranges of states; by default `body`.
    **names : object
        Other names that the code uses.
    """

    def __init__(
        self, inner: Callback, body: list[str], n_params: int, ranged: list[str] | None = None,
        **names: Any,
    ) -> None:  # fmt: skip
        self.inner, kind = inner, inner.signature
        names = {"INNER": inner.dispatcher, "np": np, **names}
        super().__init__(
            compose(kind.name, ", ".join(kind.arguments), body, names), kind
        )
        self.kept = (
            inner.compiled
        )  # otherwise the code contains the address of a Python function
        self.n_params = n_params
        self._ranged = body if ranged is None else ranged
        self._names = names

    @cached_property
    def ranged(self) -> Any:
        """The code for ranges, around that of the user's function."""
        from hopdata.hybrid.branches.ranges import part

        kind = self.signature
        names = {**self._names, "INNER": self.inner.ranged, "PART": part}
        made = compose(kind.name, ", ".join(kind.arguments), self._ranged, names)
        return put_in(made)

    @cached_property
    def constants(self) -> Constants:
        """Nothing of its own: the system from which it is derived looks at the user's function."""
        return Constants()

    @property
    def compiled(self) -> bool:
        """Whether the user's function is compiled."""
        return self.inner.compiled

    def check_lengths(self, **lengths: int) -> None:
        """Check the wrapped function; see `Callback.check_lengths`."""
        self.inner.check_lengths(**lengths)


def _made(
    system: System, key: Any, derive: Callable[[Callback], Callback | None],
    given_too: dict[str, Any], **seen: Any,
) -> System:  # fmt: skip
    """Return the derived system, made once; `seen` holds the properties that differ."""
    if key not in system.made:
        names = [
            name for name in (*SIGNATURES, "undo") if getattr(system, name) is not None
        ]
        functions: dict[str, Any] = {
            name: derive(getattr(system, name)) for name in names
        }
        system.made[key] = replace(system, **functions, **given_too)
        vars(system.made[key]).update(
            {"way": system.way, "n_shown": system.n_shown, **seen}
        )
    derived: System = system.made[key]
    return derived


def _backward(inner: Callback) -> Around:
    kind = inner.signature
    # One guard of many: the others' rates may be stored there as well
    one = "hdot[k] = -hdot[k]"
    # a matrix by rows; lanes can do it, too
    each = "for i in range(len({0})): {0}[i] = -{0}[i]"
    turned = {
        name: one if name == "hdot" and "k" in kind.arguments else each.format(name)
        for name in kind.arguments
        if name in RATES
    }
    call = ", ".join("-t" if name == "t" else name for name in kind.arguments)
    before = [line for name, line in turned.items() if name not in kind.fills]
    body = [*before, f"result = INNER({call})", *turned.values(), "return result"]
    return Around(inner, body, inner.n_params)


def backward(system: System) -> System:
    """Return the system in the time s = -t.

    Raises
    ------
    ValueError
        If the system has a handler but no `undo`.
    """
    if system.on_event is not None and system.undo is None:
        raise ArgumentError(
            "t_span: expected the end not before the start, because the effect of on_event on the "
            "state, the mode and the memory is not known backward. Give System(undo=...), declared "
            "by @on_event, which undoes it when the same guard is crossed from the other side; or "
            "on_event itself, if it changes nothing that matters"
        )
    is_new = "backward" not in system.made
    turned = _made(system, "backward", _backward, {}, way=-system.way)
    if is_new and system.undo is not None:
        vars(turned).update(on_event=turned.undo, undo=turned.on_event)
    return turned


# Derivative of a guard with respect to a parameter: how the guard would change if it
# moved.
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
KNOWN = {"ROOT": tangent.FIFTH_ROOT_OF_EPS} | {
    name: getattr(tangent, name) for name in ("ATTEMPTS", "SHIFTS", "SHORTER", "settle")
}


def with_parameters(system: System, n_params: int) -> System:
    """Return the system whose states are the user's, followed by the constant parameters."""
    wanted = "no n_memory with 'params', because params contains the memory"
    arguments.expect(system.n_memory == 0, "jacobian", wanted, system.n_memory)
    system.check_params_length(n_params)
    n = system.n_states

    def around(inner: Callback) -> Around | None:
        kind = inner.signature
        if kind.name in ("jacobian", "affine"):
            return None
        taken = {"y": "y[:N]", "dy": "dy[:N]", "params": "y[N:]"}
        call = ", ".join(taken.get(name, name) for name in kind.arguments)
        body, ranged = [f"result = INNER({call})"], None
        if kind.name == "field":
            body.append("dy[N:] = 0.0")
        if "hdot" in kind.arguments:
            guards = "range(k, k + 1)" if "k" in kind.arguments else "range(n)"
            taken = {
                "y": "PART(y, 0, N)",
                "dy": "PART(dy, 0, N)",
                "params": "PART(y, N, len(y))",
            }
            parts = ", ".join(taken.get(name, name) for name in kind.arguments)
            ranged = [f"return INNER({parts})"]
            call = call.replace("hdot", "rates").replace("h, ", "values[side], ")
            body += BY_PARAMETERS.format(call=call, guards=guards).strip().splitlines()
        return Around(inner, [*body, "return result"], 0, ranged, N=n, **KNOWN)

    return _made(
        system, (WITH_PARAMS, n_params), around, {"n_states": n + n_params}, n_shown=n
    )


def in_python(system: System) -> System:
    """Return the system with all functions run by Python."""
    return _made(
        system, "debug", lambda one: Callback(one.function, one.signature, False), {}
    )


def goes_back(t_span: Any) -> bool:
    """Return whether a time span ends before its start; False if it is not a time span."""
    try:
        start, end = t_span
        return float(end) < float(start)
    except (TypeError, ValueError):
        return False


def ask_derived(
    ask: Callable[..., Answer], system: System, *, t_span: Any, y0: Any, params: Any, t_eval: Any,
    atol: Any, jacobian: Any, debug: Any = False, **others: Any,
) -> Answer:  # fmt: skip
    """Solve with the derived system that the options require, and return the answer."""
    if arguments.check_flag("debug", debug):
        system = in_python(system)
    if isinstance(jacobian, str):
        known = jacobian == WITH_PARAMS
        arguments.expect(
            known, "jacobian", "True or False, or 'params'", repr(jacobian)
        )
        states = arguments.numbers_of("y0", y0)
        fits = states.shape[-1:] == (system.n_states,)
        arguments.expect(
            fits, "y0", f"{system.n_states} states", f"shape {states.shape}"
        )
        rows = states.shape[:-1]
        given = arguments.numbers_of("params", params).ravel()
        if rows:
            given = arguments.check_rows(params, len(states))
        arguments.expect(np.isfinite(given).all(), "params", "finite numbers", given)
        given = np.broadcast_to(given, (*rows, given.shape[-1]))
        full = np.zeros(system.n_states)
        arguments.set_tolerance(full, atol)
        atol = np.concatenate([full, np.zeros(given.shape[-1])])
        system = with_parameters(system, given.shape[-1])
        y0, params, jacobian = np.concatenate([states, given], axis=-1), (), True
    if goes_back(t_span):
        system, whole = backward(system), t_span
        t_span = tuple(-float(one) for one in t_span)
        if t_eval is not None:
            try:
                t_eval = arguments.check_times(
                    -arguments.numbers_of("t_eval", t_eval), *t_span
                )
            except ValueError:
                arguments.expect(
                    False, "t_eval", f"decreasing times within {whole}", t_eval
                )
    return ask(
        system,
        t_span,
        y0,
        params=params,
        t_eval=t_eval,
        atol=atol,
        jacobian=jacobian,
        **others,
    )
