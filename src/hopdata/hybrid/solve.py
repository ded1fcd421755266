"""`solve`: integrate an event-selected system, as `scipy.integrate.solve_ivp` would be called."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid.arguments import (
    check_numbers,
    check_params,
    check_shape,
    check_times,
    set_mode,
    set_tolerance,
    with_memory,
)
from hopdata.hybrid.compiled.unraisable import Caught
from hopdata.hybrid.driver.entry import driver_entry
from hopdata.hybrid.driver.layout import METHOD, STEPS
from hopdata.hybrid.methods import table
from hopdata.hybrid.methods.table import MethodTable
from hopdata.hybrid.solution import Solution, filled
from hopdata.hybrid.status import BAD_START, NEEDS_METHOD, NEEDS_ROOM, PAUSED
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
    t_start, t_end, rtol, max_step, step = check_numbers(
        t_span, rtol, max_step, first_step, max_steps, max_events
    )
    state, numbers = check_shape("y0", y0, system.n_states), check_params(params)
    times = None if t_eval is None else check_times(t_eval, t_start, t_end)
    if system.n_memory > 0 or memory is not None:
        numbers = with_memory(numbers, memory, system.n_memory)
    system.check_params_length(len(numbers))
    methods, work = system.methods(method, jacobian), system.take_workspace()
    try:
        work.begin(methods, times, jacobian)
        set_mode(work.mode, system.n_guards, mode)
        set_tolerance(work.atol, atol)
        status = _run(
            methods, work, state, numbers, t_start, t_end, rtol, max_step, step,
            int(max_steps), int(max_events), times is None,
        )  # fmt: skip
        if status == BAD_START:
            raise ValueError(f"y0: expected finite numbers, found {state}")
        return _solution(system, work, status, times is None)
    finally:
        system.idle.append(work)


def _run(methods: MethodTable, work: Workspace, *arguments: object) -> int:
    """Call the driver until it has ended, with as much room as it asks for; return its status."""
    drive = driver_entry()
    if methods.generic and methods.steps >= table.WORTH_COMPILING:
        methods.specialise()
    with Caught() as caught:
        status = drive(work.desk, *arguments, False)
        while status in UNFINISHED and not caught:
            if status == NEEDS_ROOM:
                work.enlarge()
            elif status == NEEDS_METHOD:
                methods.provide(int(work.counts[METHOD]))
            methods.specialise(int(work.counts[STEPS]))
            status = drive(work.desk, *arguments, True)
    if methods.generic:
        methods.steps += work.counts.item(STEPS)
    if caught:
        raise caught[0]
    return status


def _solution(system: System, work: Workspace, status: int, every_step: bool) -> Solution:
    return filled(
        Solution,
        status=status,
        mode=work.mode.copy(),
        y_end=work.state.copy(),
        jacobian=None if work.tangent is None else work.tangent[: system.n_states].copy(),
        rows=work.trajectory() if every_step else work.samples(),
        records=work.events(),
        counts=work.counts.copy(),
        clock=work.clock.copy(),
        guard_names=system.guard_names,
    )
