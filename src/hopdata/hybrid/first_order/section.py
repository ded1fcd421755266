"""Derivative of the state at which trajectories meet a section, from that of the flow."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid.first_order.local import FloatArray
from hopdata.hybrid.first_order.saltation import NotTransversalError


def project_onto_section(
    flow: ArrayLike, rate: ArrayLike, gradient: ArrayLike, *, time_rate: float = 0.0
) -> FloatArray:
    """Return the derivative of the impact state, (I - f Dh / (Dh f + dh/dt)) Phi.

    The flow's derivative tells where a neighbour is at the same time, this one where it meets the
    surface h = 0: that differs by the time which it still needs, at the rate f.

    Parameters
    ----------
    flow : (n, k) array_like
        Derivative Phi of the state at the instant of the event, before its handler.
    rate : (n,) array_like
        Field f there.
    gradient : (n,) array_like
        Derivative Dh of the event function with respect to the state.
    time_rate : float
        Its derivative with respect to time.

    Returns
    -------
    (n, k) array

    Raises
    ------
    NotTransversalError
        If the event function does not change along f.
    """
    phi, f, slope = (np.asarray(v, dtype=np.float64) for v in (flow, rate, gradient))
    speed = slope @ f + time_rate
    if speed == 0 or not np.isfinite(speed):
        raise NotTransversalError(f"expected a rate of the guard other than 0, found {speed}")
    return phi - np.outer(f, slope @ phi) / speed
