"""Systems made from a system, so that the driver stays as it is: here, time that runs backward.

A backward system has the time s = -t. Its functions are machine code around the user's: the time
changes its sign before the call, and whatever is a rate after it. Locks, and the directions in
which guards are crossed, are those that are met on the way.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.hybrid.arguments import check_times, numbers_of
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.kernel import SIGNATURES
from hopdata.hybrid.methods.explicit import compose
from hopdata.hybrid.system import System

RATES = ("dy", "hdot", "jac", "a", "b")  # arguments that change their sign with that of time


class Around(Callback):
    """Machine code around a function of the user's, which it knows as INNER.

    Parameters
    ----------
    inner : Callback
        That function.
    body : list of str
        Lines of the code, with the arguments of `inner`.
    """

    def __init__(self, inner: Callback, body: list[str]) -> None:
        self.inner, kind = inner, inner.signature
        names = {"INNER": inner.dispatcher, "negative": np.negative}
        super().__init__(compose(kind.name, ", ".join(kind.arguments), body, names), kind)
        self.kept = inner.compiled  # else the address of a Python function stands in the code
        self.n_params = inner.n_params

    @property
    def compiled(self) -> bool:
        """Whether the user's function is compiled."""
        return self.inner.compiled

    def check_lengths(self, **lengths: int) -> None:
        """See `Callback.check_lengths`."""
        self.inner.check_lengths(**lengths)


def _backward(inner: Callback) -> Around:
    """Return a function of the backward system."""
    kind = inner.signature
    one = "hdot[k] = -hdot[k]"  # of many guards: the others' rates may stand there
    turned = {
        name: one if name == "hdot" and "k" in kind.arguments else f"negative({name}, {name})"
        for name in kind.arguments
        if name in RATES
    }
    call = ", ".join("-t" if name == "t" else name for name in kind.arguments)
    before = [line for name, line in turned.items() if name not in kind.fills]
    return Around(inner, [*before, f"result = INNER({call})", *turned.values(), "return result"])


class BackwardSystem(System):
    """A system with the time s = -t."""

    way = -1.0


def backward(system: System) -> System:
    """Return the system with the time s = -t; made once.

    Raises
    ------
    ValueError
        If there is a handler, and none that undoes what it does.
    """
    if system.on_event is not None and system.undo is None:
        raise ValueError(
            "t_span: expected the end not first, as what on_event does to the state, the mode and "
            "the memory is not known backward. Give System(undo=...), declared by @on_event, which "
            "undoes it when the same guard is crossed from the other side; or on_event itself, if "
            "it changes nothing that matters"
        )
    if "backward" not in system.derived:
        given = {one.name: getattr(system, one.name) for one in fields(System)}
        given |= {"on_event": system.undo, "undo": None}
        turned = {k: _backward(given[k]) for k in SIGNATURES if given[k] is not None}
        system.derived["backward"] = BackwardSystem(**{**given, **turned})
    return system.derived["backward"]


def goes_back(t_span: Any) -> bool:
    """Tell whether the end of a time span is before its start; False if it is none."""
    try:
        start, end = t_span
        return float(end) < float(start)
    except (TypeError, ValueError):
        return False


def asked_backward(
    system: System, t_span: tuple[float, float], t_eval: Any
) -> tuple[System, tuple[float, float], FloatArray | None]:
    """Return the backward system, and time span and wanted times in its own time."""
    start, end = (-float(one) for one in t_span)
    if t_eval is None:
        return backward(system), (start, end), None
    try:
        times = check_times(-numbers_of("t_eval", t_eval), start, end)
    except ValueError:
        raise ValueError(f"t_eval: expected decreasing times within {t_span}") from None
    return backward(system), (start, end), times
