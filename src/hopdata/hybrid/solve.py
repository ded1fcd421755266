"""`solve`: integrate an event-selected system, as `scipy.integrate.solve_ivp` would be called."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid.arguments import (
    Limits,
    check_flag,
    check_numbers,
    check_times,
    set_mode,
)
from hopdata.hybrid.compiled.unraisable import catch, stop_catching
from hopdata.hybrid.driver.layout import GIVEN_MODE, METHOD, RESUMED, STEPS
from hopdata.hybrid.methods import table
from hopdata.hybrid.solution import Solution
from hopdata.hybrid.status import BAD_NUMBERS, BAD_START, NEEDS_METHOD, NEEDS_ROOM, PAUSED
from hopdata.hybrid.system import System
from hopdata.hybrid.workspace import Workspace

UNFINISHED = (NEEDS_ROOM, NEEDS_METHOD, PAUSED)


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
    method: str = "auto",
    jacobian: bool = False,
    memory: ArrayLike | None = None,
) -> Solution:
    """Integrate an event-selected system from t_span[0] to t_span[1].

    One-step methods with error control. Events are localised on the interpolant, and the step
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
    method : str
        "dopri5" (best where events limit the steps), "dop853" (where they are sparse), "taylor"
        (affine modes, to rounding), "rosenbrock" (stiff fields), or "auto": Taylor series if the
        system has an affine form, else each of the others where it is best.
    jacobian : bool
        Whether to carry the derivative of the state by the initial state along, through events by
        saltation matrices (not with "rosenbrock", and not through resets of the state).
    memory : (n_memory,) array_like, optional
        Initial value of the scene's memory; by default zeros.

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
    if not isinstance(system, System):
        raise TypeError(f"system: expected a System, found {system!r}")
    limits = rtol, max_step, first_step, max_steps, max_events
    work, flags = system.take_workspace(), 0
    try:
        as_before = type(method) is str and method == work.ready_for
        if jacobian is not False or t_eval is not None or not as_before:
            _begin(system, work, t_span, limits, method, t_eval, jacobian)
        work.ask(system, t_span, y0, params, memory, limits, t_eval is None)
        work.set_tolerance(atol)
        if mode is not None:
            set_mode(work.mode, system.n_guards, mode)
            flags = GIVEN_MODE
        status = _run(work, flags)
        if status >= BAD_START:
            _refuse(status, work, t_span, limits)
        return work.solution(status)
    finally:
        system.idle.append(work)


def _begin(
    system: System, work: Workspace, t_span: tuple[float, float], limits: Limits, method: str,
    t_eval: ArrayLike | None, jacobian: bool,
) -> None:  # fmt: skip
    """Get the workspace ready for an integration of another kind than its last one."""
    t_start, t_end, *_ = check_numbers(t_span, *limits)
    times = None if t_eval is None else check_times(t_eval, t_start, t_end)
    wanted = check_flag("jacobian", jacobian)
    work.begin(system.methods(method, wanted), times, wanted)


def _run(work: Workspace, flags: int) -> int:
    """Call the driver until it has ended, with as much room as it asks for; return its status."""
    drive, methods, caught = work.drive, work.methods, work.caught
    assert methods is not None
    if methods.generic and methods.steps >= table.WORTH_COMPILING:
        methods.specialise()
    caught.clear()
    token = catch(caught)
    try:
        status = drive(work.desk_address, flags)
        while status in UNFINISHED and not caught:
            if status == NEEDS_ROOM:
                work.enlarge()
            elif status == NEEDS_METHOD:
                methods.provide(int(work.counts[METHOD]))
            methods.specialise(int(work.counts[STEPS]))
            status = drive(work.desk_address, flags | RESUMED)
    finally:
        stop_catching(token)
    if methods.generic:
        methods.steps += work.counts.item(STEPS)
    if caught:
        first = caught[0]
        caught.clear()
        raise first
    return status


def _refuse(status: int, work: Workspace, t_span: tuple[float, float], limits: Limits) -> None:
    """Raise ValueError for what the driver did not begin with."""
    if status == BAD_START:
        raise ValueError(f"y0: expected finite numbers, found {work.state}")
    if status == BAD_NUMBERS:
        check_numbers(t_span, *limits)
