# ruff: noqa: ARG001 (a handler has the arguments of handlers)
"""Systems derived from a user's system for its gradient.

In one, crossings that are no events are in the log, too, because they change the mode;
its handler knows which ones are events. In another, the integral of a function along
the way is one more state.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numba

from hopdata.errors import ArgumentError
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.compiled.kernel import ON_EVENT
from hopdata.hybrid.derived import Around
from hopdata.hybrid.numbers.switches import may_switch
from hopdata.hybrid.system import System

Function = Callable[..., Any]


def _nothing(
    t: float, y: Any, mode: Any, params: Any, guard: int, direction: int
) -> int:
    """Handle events of a system without a handler."""
    return 0


def without_search(system: System) -> System:
    """Return the system whose field's own instants are not sought.

    The pass backward does not know those of a system that slides: it takes its steps
    as they are.
    """
    if not may_switch(system.field):
        return system
    key = "without_search"
    if key not in system.made:
        system.made[key] = replace(system, find_tstops=False)
    found: System = system.made[key]
    return found


def with_all_crossings(system: System) -> System:
    """Return the system in which every crossing of a guard is logged.

    Raises
    ------
    ArgumentError
        If a guard with a direction ends the integration at a later event than its
        first.
    """
    directions = system.directions or ()
    if not any(directions):
        return system
    key = "with_all_crossings"
    if key in system.made:
        known: System = system.made[key]
        return known
    ends = system.terminal or (0,) * system.n_guards
    one_way = [bool(way) for way in directions]
    kept = []
    stops = []
    for way, end in zip(one_way, ends, strict=True):
        if way and int(end) > 1:
            raise ArgumentError(
                "terminal: expected True or 1 for a guard with a direction, for the "
                f"gradient, found {end}"
            )
        stops.append(int(end) if way else 0)
        kept.append(0 if way else int(end))
    inner = system.on_event or Callback(_nothing, ON_EVENT)
    body = [
        "if WAYS[guard] != 0 and WAYS[guard] != direction:",
        "    return 0",
        "result = INNER(t, y, mode, params, guard, direction)",
        "return result | STOPS[guard]",
    ]
    names: dict[str, Any] = {
        "WAYS": tuple(map(int, directions)),
        "STOPS": tuple(stops),
    }
    handler = Around(inner, body, inner.n_params, **names)
    made = replace(system, on_event=handler, directions=None, terminal=tuple(kept))
    system.made[key] = made
    return made


def with_integral(system: System, along: Function) -> System:
    """Return the system whose last state is the integral of a function along the way.

    It is called as ``along(t, y, mode, params)``.
    """
    n = system.n_states
    plain = getattr(along, "py_func", along)
    key = ("with_integral", plain)
    if key in system.made:
        known: System = system.made[key]
        return known
    rate = numba.njit(error_model="numpy")(with_digest(plain))
    slices = {"y": "y[:N]", "dy": "dy[:N]"}
    parts = {"y": "PART(y, 0, N)", "dy": "PART(dy, 0, N)"}
    functions: dict[str, Any] = {"jacobian": None, "affine": None}
    for name in ("field", "guards", "guard", "rate_bound", "on_event"):
        inner = getattr(system, name)
        if inner is None:
            continue
        taken = inner.signature.arguments
        call = ", ".join(slices.get(one, one) for one in taken)
        body = [f"result = INNER({call})"]
        names: dict[str, Any] = {"N": n}
        ranged = None
        if name == "field":
            body.append("dy[N] = RATE(t, y[:N], mode, params)")
            names["RATE"] = rate
        if "hdot" in taken:
            within = ", ".join(parts.get(one, one) for one in taken)
            ranged = [f"return INNER({within})"]
        body.append("return result")
        functions[name] = Around(inner, body, inner.n_params, ranged, **names)
    made = replace(system, **functions, n_states=n + 1)
    system.made[key] = made
    return made
