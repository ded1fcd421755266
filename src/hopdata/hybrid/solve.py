"""`solve`: integrate an event-selected system, as `scipy.integrate.solve_ivp` would be called."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid.arguments import Request, check
from hopdata.hybrid.driver import compiled_driver
from hopdata.hybrid.layout import (
    CULPRIT,
    NFEV,
    NGEV,
    RATE_ABOVE,
    RATE_BELOW,
    REJECTED,
    STEPS,
    FloatArray,
    IntArray,
    T,
    Y,
    fresh_memory,
)
from hopdata.hybrid.solution import Solution
from hopdata.hybrid.status import NEEDS_ROOM, describe
from hopdata.hybrid.storage import Storage
from hopdata.hybrid.system import System
from hopdata.hybrid.unraisable import caught_exceptions


def solve(
    system: System,
    t_span: tuple[float, float],
    y0: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int] | None = None,
    rtol: float = 1e-9,
    atol: ArrayLike = 1e-12,
    max_step: float = np.inf,
    first_step: float | None = None,
    t_eval: ArrayLike | None = None,
    max_steps: int = 10_000_000,
    max_events: int = 10_000_000,
) -> Solution:
    """Integrate an event-selected system from t_span[0] to t_span[1].

    Dormand-Prince 5(4) with error control. Events are localised on the interpolant, and the step
    is then taken again to the event's instant, so that time and state have the method's order.
    Guards that flip at one instant do so together; the field is evaluated anew after each instant.

    Parameters
    ----------
    system : System
        Vector field, guards and handler.
    t_span : tuple of float
        Start and end, s; the end not before the start.
    y0 : (n,) array_like
        Initial state.
    params : (p,) array_like
        Numbers handed to the system's functions.
    mode : sequence of int, optional
        Initial mode: the scene's own integers, or locks and the scene's own. A lock that is 0 or
        not given is decided by the sign of h, on the surface by its rate. By default zeros.
    rtol, atol : float, (n,) array_like
        Relative and absolute tolerance of a step's error, as in `solve_ivp`.
    max_step, first_step : float
        Largest step and first step, s. By default not limited, and chosen.
    t_eval : (N,) array_like, optional
        Times to report, s, increasing, within `t_span`. By default each step and each event.
    max_steps, max_events : int
        Give up, with a status, after so many.

    Returns
    -------
    Solution
        Trajectory, events, and the way it ended.

    Raises
    ------
    ValueError
        If an argument is out of range or of the wrong shape.
    Exception
        Whatever the system's functions raise.
    """
    request = check(
        system, t_span, y0, params=params, mode=mode, rtol=rtol, atol=atol, max_step=max_step,
        first_step=first_step, t_eval=t_eval, max_steps=max_steps, max_events=max_events,
    )  # fmt: skip
    return integrate(system, request)


def integrate(system: System, request: Request) -> Solution:
    """Run the driver on checked arguments, with as much room as it asks for."""
    states, _, _, clock, counts = memory = fresh_memory(
        request.t_start, request.y0, system.n_guards, request.first_step
    )
    storage = Storage(system, request.t_eval)
    fixed = (
        *system.addresses, request.params, request.mode, system.rules,
        request.rtol, request.atol, request.max_step, request.t_end,
        request.max_steps, request.max_events, request.t_eval is None, *memory,
    )  # fmt: skip
    driver = compiled_driver()
    with caught_exceptions() as caught:
        status = NEEDS_ROOM
        while status == NEEDS_ROOM and not caught:
            status = driver(*fixed, *storage.room())
            storage.collect(counts)
    if caught:
        raise caught[0]
    return _solution(system, request, storage, status, states[Y], clock, counts)


def _solution(
    system: System,
    request: Request,
    storage: Storage,
    status: int,
    y_end: FloatArray,
    clock: FloatArray,
    counts: IntArray,
) -> Solution:
    culprit = int(counts[CULPRIT])
    t, y = storage.trajectory()
    return Solution(
        t=t,
        y=y,
        events=storage.events(),
        status=status,
        message=describe(
            status,
            time=clock[T],
            guard=system.guard_names[culprit] if culprit >= 0 else "",
            rates=(clock[RATE_BELOW], clock[RATE_ABOVE]),
        ),
        nfev=int(counts[NFEV]),
        n_guard_evaluations=int(counts[NGEV]),
        n_steps=int(counts[STEPS]),
        n_rejected=int(counts[REJECTED]),
        mode=request.mode,
        t_end=float(clock[T]),
        y_end=y_end.copy(),
    )
