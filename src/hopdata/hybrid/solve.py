"""`solve`: integrate an event-selected system, as `scipy.integrate.solve_ivp` would be called."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid import layout as at
from hopdata.hybrid.arguments import Limits, check_flag, check_numbers, check_times, set_mode
from hopdata.hybrid.compiled.callbacks import catch, stop_catching
from hopdata.hybrid.derived import asked_backward, goes_back
from hopdata.hybrid.solution import Solution
from hopdata.hybrid.system import System
from hopdata.hybrid.workspace import Workspace

UNFINISHED = (at.NEEDS_ROOM, at.NEEDS_METHOD, at.PAUSED)


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
        Start and end, s. If the end is before the start, time runs backward: locks, and the
        directions of events, are then those that are met on the way.
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
    try:
        work = system.idle.pop()
    except IndexError:
        work = system.new_workspace()
    try:
        usual = jacobian is False and t_eval is memory is first_step is None
        if not usual or not work.ask_again(
            t_span, y0, params, rtol, atol, max_step, max_steps, max_events, method
        ):
            limits = rtol, max_step, first_step, max_steps, max_events
            if goes_back(t_span):
                turned, t_span, t_eval = asked_backward(system, t_span, t_eval)
                return solve(
                    turned, t_span, y0, params=params, mode=mode, rtol=rtol, atol=atol,
                    max_step=max_step, first_step=first_step, t_eval=t_eval, max_steps=max_steps,
                    max_events=max_events, method=method, jacobian=jacobian, memory=memory,
                )  # fmt: skip
            _ask(system, work, t_span, y0, params, limits, atol, t_eval, method, jacobian, memory)
        flags = 0
        if mode is not None:
            set_mode(work.mode, system.n_guards, mode)
            flags = at.GIVEN_MODE
        caught = work.caught
        caught.clear()
        token = catch(caught)
        try:
            status = work.drive(work.desk_address, flags)
            if status > at.TERMINATED:
                status = _go_on(work, flags | at.RESUMED, status)
        finally:
            stop_catching(token)
        if work.methods.generic:
            work.methods.steps += work.counts.item(at.STEPS)
        if caught:
            first = caught[0]
            caught.clear()
            raise first
        if status > at.TERMINATED:
            _refuse(status, work, t_span, (rtol, max_step, first_step, max_steps, max_events))
        return work.solution(status)
    finally:
        system.idle.append(work)


def _ask(
    system: System, work: Workspace, t_span: tuple[float, float], y0: ArrayLike,
    params: ArrayLike, limits: Limits, atol: ArrayLike, t_eval: ArrayLike | None, method: str,
    jacobian: bool, memory: ArrayLike | None,
) -> None:  # fmt: skip
    """Get the workspace ready for an integration of any kind."""
    options = check_numbers(t_span, *limits)
    as_before = type(method) is str and method == work.ready_for
    if not as_before or jacobian is not False or t_eval is not None:
        times = None if t_eval is None else check_times(t_eval, *options[:2])
        wanted = check_flag("jacobian", jacobian)
        work.begin(system.methods(method, wanted), times, wanted)
    work.methods.specialise()
    work.ask(system, y0, params, memory, (*options, t_eval is None))
    work.set_tolerance(atol)


def _go_on(work: Workspace, flags: int, status: int) -> int:
    """Give the driver what it asks for, if anything, and call it again, until it has ended."""
    methods = work.methods
    while status in UNFINISHED and not work.caught:
        if status == at.NEEDS_ROOM:
            work.enlarge()
        elif status == at.NEEDS_METHOD:
            methods.provide(int(work.counts[at.METHOD]))
        methods.specialise(int(work.counts[at.STEPS]))
        status = work.drive(work.desk_address, flags)
    return status


def _refuse(status: int, work: Workspace, t_span: tuple[float, float], limits: Limits) -> None:
    """Raise ValueError for what the driver did not begin with."""
    if status == at.BAD_START:
        raise ValueError(f"y0: expected finite numbers, found {work.state}")
    if status == at.BAD_NUMBERS:
        check_numbers(t_span, *limits)
