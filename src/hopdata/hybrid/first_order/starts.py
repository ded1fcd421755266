"""A start on the surface of a guard, at which the flow may have no derivative."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.first_order import linearise as local
from hopdata.hybrid.first_order.crossings import NoDerivativeError
from hopdata.hybrid.first_order.linearise import Instant
from hopdata.hybrid.first_order.saltation import (
    NotTransversalError,
    crossing,
    with_lock,
)
from hopdata.hybrid.sliding.system import Mixed
from hopdata.hybrid.system import System

#: A saltation matrix that differs less from the identity counts as the identity.
#: Unit: 1, of its largest entry. Origin: chosen.
NO_CHANGE = 1e-9


def surfaces_at_start(
    system: System,
    t: float,
    state: ArrayLike,
    params: ArrayLike = (),
    mode: ArrayLike | None = None,
    memory: ArrayLike | None = None,
) -> tuple[str, ...]:
    """Return the guards that leave the flow from a state without a derivative.

    The state lies on their surfaces, and the caller has left their locks open. Starts
    on one side then meet the event and those on the other do not. The derivative exists
    if that makes no difference: the handler moves no state, and the field is the same
    on both sides. A terminal guard is left out, as are all guards of a system of which
    one may slide: its functions are compiled only.

    Parameters
    ----------
    system : System
    t : float
        Time, s.
    state : (n,) array_like
    params, mode, memory : array_like, optional
        As of `hopdata.hybrid.solve`.
    """
    if isinstance(system.field, Mixed):
        return ()
    n_guards = system.n_guards
    locks = np.zeros(system.n_modes, dtype=np.int64)
    if mode is not None:
        given = np.asarray(mode, dtype=np.int64)
        locks[: len(given)] = given
    kept = np.zeros(system.n_memory) if memory is None else np.asarray(memory)
    numbers = np.concatenate([np.ravel(params), np.ravel(kept)]).astype(np.float64)
    at = Instant(float(t), np.array(state, dtype=np.float64), locks, numbers)
    is_open = locks[:n_guards] == 0
    h, rates = _settle(system, at, is_open)
    found = []
    for k in np.flatnonzero(is_open & (h == 0.0) & (rates != 0.0)):
        ends = system.terminal is not None and system.terminal[k]
        if ends:
            continue
        way = int(np.sign(rates[k]))
        before = replace(at, mode=with_lock(at.mode, int(k), -way))
        if _changes(system, before, int(k), way):
            found.append(system.guard_names[k])
    return tuple(found)


def _settle(
    system: System, at: Instant, is_open: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Set the open locks as the driver does; return the guards and their rates."""
    n_guards = len(is_open)
    locks = at.mode[:n_guards]
    locks[is_open] = -1
    h, _ = local.guards_at(system, at, np.zeros(len(at.y)))
    locks[is_open & (h > 0.0)] = 1
    h, rates = local.guards_at(system, at, local.field_at(system, at))
    on_surface = is_open & (h == 0.0)
    locks[on_surface] = np.where(rates[on_surface] > 0.0, 1, -1)
    return h, rates


def _changes(system: System, before: Instant, guard: int, way: int) -> bool:
    """Return whether crossing a guard moves the state, or bends its path."""
    scale = np.maximum(np.abs(before.y), 1.0)
    meant = 0 if system.directions is None else system.directions[guard]
    if meant * way < 0:  # no event: only the lock flips
        system = replace(system, on_event=None)
    here = local.linearise(system, before, scale)
    try:
        matrix, there = crossing(system, here, guard, scale)
    except (NotTransversalError, NoDerivativeError):
        return True
    if (there.instant.y != before.y).any():
        return True
    off = np.abs(matrix - np.eye(len(matrix))).max()
    return bool(off > NO_CHANGE * np.abs(matrix).max())
