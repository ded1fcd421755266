"""Saltation matrices: what a guard's crossing makes of a small deviation of the state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid.first_order.local import (
    FloatArray,
    Instant,
    Linearisation,
    cross,
    differentiate,
    instant,
    linearise,
    state_scale,
)
from hopdata.hybrid.system import System


class NotTransversalError(ValueError):
    """A guard is not crossed: its event function has no rate along the field."""


def saltation_matrix(
    before: ArrayLike,
    after: ArrayLike,
    gradient: ArrayLike,
    *,
    time_rate: float = 0.0,
    reset: ArrayLike | None = None,
    reset_rate: ArrayLike | None = None,
) -> FloatArray:
    """Return the saltation matrix of one crossing (Aizerman and Gantmacher 1958).

    With r the reset and h the event function,
    Dr + (f+ - Dr f- - dr/dt) Dh / (Dh f- + dh/dt).

    Parameters
    ----------
    before, after : (n,) array_like
        Field f- before and f+ after the crossing, the latter at the state after the reset.
    gradient : (n,) array_like
        Derivative Dh of the event function with respect to the state.
    time_rate : float
        Its derivative with respect to time.
    reset, reset_rate : (n, n) and (n,) array_like, optional
        Derivatives of the reset with respect to state and time. By default the state is kept.

    Returns
    -------
    (n, n) array

    Raises
    ------
    NotTransversalError
        If the event function does not change along f-.
    """
    f, g, slope = (np.asarray(v, dtype=np.float64) for v in (before, after, gradient))
    rate = slope @ f + time_rate
    if rate == 0 or not np.isfinite(rate):
        raise NotTransversalError(f"expected a rate of the guard other than 0, found {rate}")
    kept = np.eye(len(f)) if reset is None else np.asarray(reset, dtype=np.float64)
    moved = kept @ f + (0.0 if reset_rate is None else np.asarray(reset_rate, dtype=np.float64))
    return kept + np.outer(g - moved, slope) / rate


def crossing(
    system: System, here: Linearisation, guard: int, scale: FloatArray
) -> tuple[FloatArray, Linearisation]:
    """Return the saltation matrix of a guard's crossing, and the linearisation after it.

    A handler that leaves the state alone here is taken to do so nearby; the derivative of one that
    changes it is found by differences.
    """
    at = here.instant
    there = linearise(system, cross(system, at, guard), scale)
    reset = reset_rate = None
    if not np.array_equal(there.instant.y, at.y):

        def after(p: Instant) -> FloatArray:
            return cross(system, p, guard).y

        reset, reset_rate = differentiate(after, at, scale)
    matrix = saltation_matrix(
        here.rate,
        there.rate,
        here.gradients[guard],
        time_rate=float(here.time_rates[guard]),
        reset=reset,
        reset_rate=reset_rate,
    )
    return matrix, there


def saltation_product(
    system: System,
    state: ArrayLike,
    order: Sequence[int],
    *,
    params: ArrayLike = (),
    mode: Sequence[int],
    t: float = 0.0,
    scale: ArrayLike | None = None,
) -> FloatArray:
    """Return the product of the saltation matrices of guards that are crossed at one instant.

    Parameters
    ----------
    system : System
        Field, guards and handler; the handler is run at each crossing.
    state : (n,) array_like
        State at the crossing.
    order : sequence of int
        Numbers of the guards, the first crossed first.
    params, mode, t
        As for `solve`; `mode` is that before the first crossing, with all locks set.
    scale : (n,) array_like, optional
        Size of each coordinate, for the steps of differences. By default 1.

    Returns
    -------
    (n, n) array
    """
    sizes = state_scale(system, scale)
    here = linearise(system, instant(system, state, params=params, mode=mode, t=t), sizes)
    product = np.eye(system.n_states)
    for guard in order:
        matrix, here = crossing(system, here, guard, sizes)
        product = matrix @ product
    return product
