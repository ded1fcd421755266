"""`gradient`: the derivative of a loss by the start and by all parameters, at once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import ArgumentError, Told, told_call
from hopdata.hybrid import arguments, layout
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.derived import goes_back
from hopdata.hybrid.first_order.linearise import Instant, field_at, guards_at
from hopdata.hybrid.gradients import backward as passed
from hopdata.hybrid.gradients.extended import (
    with_all_crossings,
    with_integral,
    without_search,
)
from hopdata.hybrid.gradients.recorders import Recorders, recorders
from hopdata.hybrid.gradients.tape import CELLS, HEAD, RECORD
from hopdata.hybrid.gradients.timed import (
    Timed,
    reason_unsought,
    timed,
    with_instants_told,
)
from hopdata.hybrid.methods.explicit import Tableau
from hopdata.hybrid.methods.table import TABLEAUS
from hopdata.hybrid.sliding import sliding_system
from hopdata.hybrid.solution import Solution
from hopdata.hybrid.solve import solve
from hopdata.hybrid.system import System

Function = Callable[..., Any]

#: Places of a tape at first; it doubles until a step fits.
#: Unit: 1. Origin: chosen.
PLACES = 4096


@dataclass(frozen=True, repr=False)
class Gradient(Told):
    """A loss and its derivatives.

    Parameters
    ----------
    status : int
        That of the solution; negative if it failed, or if there is no derivative.
    message : str
        How it ended, in words.
    value : float
        The loss; NaN if the status is negative.
    by_start : (n,) array
        Derivative by the initial state; NaN if the status is negative.
    by_params : (p,) array
        Derivative by the parameters; NaN if the status is negative.
    solution : Solution
        The trajectory. Its log also has crossings that are no events of the system, and
        with `along` the integral is its last state.
    """

    status: int
    message: str
    value: float
    by_start: FloatArray
    by_params: FloatArray
    solution: Solution

    @property
    def success(self) -> bool:
        """Whether the loss and its derivatives are known."""
        return self.status >= 0

    def __repr__(self) -> str:
        return (
            f"Gradient: status {self.status}. {self.message}\n"
            f"  value = {self.value:.9g}, by_start = {self.by_start}, "
            f"by_params = {self.by_params}"
        )


@told_call
def gradient(  # noqa: PLR0913 (each parameter is an option of the user's)
    system: System,
    t_span: tuple[float, float],
    y0: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int] | None = None,
    memory: ArrayLike | None = None,
    at_end: Function | None = None,
    at_event: Function | None = None,
    along: Function | None = None,
    rtol: float = 1e-9,
    atol: ArrayLike = 1e-12,
    max_step: float = np.inf,
    first_step: float | None = None,
    max_steps: int = arguments.MOST,
    max_events: int = arguments.MOST,
    method: str = "dop853",
) -> Gradient:
    """Integrate a system, and differentiate a loss by its start and parameters.

    The loss is the sum of the functions that are given: one of the end, one of each
    event, and the integral of one along the way. Its derivatives come from one pass
    backward through the steps that were taken (discrete adjoint), and through events by
    the transposes of saltation matrices. The cost of the pass does not depend on the
    number of parameters. The system's functions stay as they are: they are compiled
    once more, for numbers that record how they were computed.

    Parameters
    ----------
    system : System
        Vector field, guards and handler.
    t_span : tuple of float
        Start and end, s; the end is not before the start.
    y0 : (n,) array_like
        Initial state.
    params : (p,) array_like
        Numbers handed to the system's functions, by which the loss is differentiated.
    mode, memory, rtol, atol, max_step, first_step, max_steps, max_events
        As in `solve`. All crossings count as events for `max_events`.
    at_end : callable, optional
        Loss ``at_end(t, y, params)`` of the final time and state. If an event ends the
        integration, the final time depends on start and parameters.
    at_event : callable, optional
        Loss ``at_event(t, before, after, guard, direction, params)`` of each event:
        time, states before and after its handler, index of the guard, and direction.
    along : callable, optional
        Function ``along(t, y, mode, params)`` that is integrated over time.
    method : str
        "dop853" or "dopri5".

    Returns
    -------
    Gradient
        The loss, its derivatives, and the trajectory. Where there is no derivative (a
        guard is grazed, or several handlers change the state at one instant), the
        status says so.

    Raises
    ------
    ValueError
        If an argument is out of range or of the wrong shape, or if a function does not
        compile. `params` in `at_end`, `at_event` and `along` are followed by the
        memory, as in the system's functions.

    Examples
    --------
    >>> import numpy as np
    >>> from hopdata.hybrid import field, guards, on_event
    >>> @field
    ... def fall(t, y, mode, params, dy):
    ...     dy[0] = y[1]
    ...     dy[1] = -params[0]
    >>> @guards
    ... def floor(t, y, dy, mode, params, h, hdot):
    ...     h[0] = -y[0]
    ...     hdot[0] = -dy[0]
    >>> @on_event
    ... def bounce(t, y, mode, params, guard, direction):
    ...     if direction > 0:
    ...         y[1] *= -params[1]
    ...     return 0
    >>> ball = System(fall, floor, bounce, n_states=2, guard_names=("floor",))
    >>> height = lambda t, y, params: y[0]
    >>> found = gradient(
    ...     ball, (0.0, 0.8), [1.0, 0.0], params=[9.81, 0.8], at_end=height
    ... )
    >>> found.by_params.round(6)
    array([0.005097, 1.543558])
    """
    expect(isinstance(system, System), "system", "a System", system)
    wanted = "a system without together=, whose law has no derivative"
    expect(system.together is None, "system", wanted, system)
    wanted = "'stop': there is no derivative where a guard comes to rest"
    expect(system.on_zeno == "stop", "on_zeno", wanted, repr(system.on_zeno))
    given = any(one is not None for one in (at_end, at_event, along))
    expect(given, "at_end, at_event, along", "at least one of them", "none")
    known = isinstance(method, str) and method in TABLEAUS
    expect(known, "method", f"one of {', '.join(TABLEAUS)}", repr(method))
    forward = not goes_back(t_span)
    expect(forward, "t_span", "an end not before the start", t_span)
    system = system.current()
    start = arguments.check_shape("y0", y0, system.n_states)
    numbers = arguments.numbers_of("params", params).ravel()
    tolerance = np.zeros(system.n_states)
    arguments.set_tolerance(tolerance, atol)
    given_atol = atol
    whole = with_all_crossings(system)
    if along is not None:
        whole = with_integral(whole, along)
        start = np.append(start, 0.0)
        tolerance = np.append(tolerance, tolerance.min())
        given_atol = tolerance
    if whole.sliding:
        whole = sliding_system(without_search(whole))
    given_mode, given_memory = _for_driver(whole, system, mode, memory)
    code = recorders(whole, system.n_states, at_event, at_end)
    solution = solve(
        whole,
        t_span,
        start,
        params=numbers,
        mode=given_mode,
        memory=given_memory,
        rtol=rtol,
        atol=given_atol,
        max_step=max_step,
        first_step=first_step,
        max_steps=max_steps,
        max_events=max_events,
        method=method,
    )
    if not solution.success:
        return _without(solution, solution.status, system, len(numbers))
    plain = replace(solution, form=replace(solution.form, slides=None))
    at_start = _at_start(system, solution, t_span, numbers, mode, memory)
    if whole.slides is not None:
        own = np.zeros(whole.n_memory - system.n_memory)
        locks = whole.slides.start_mode(at_start[0])
        at_start = locks, np.concatenate([at_start[1], own])
    allowed = passed.Tolerance(np.array([rtol]), tolerance)
    instants = timed(system, at_start[1], system.n_states, solution.t)
    found, status = _backward(
        code, whole, system, (solution, plain), at_start, instants, allowed, method
    )
    if status == passed.NOT_REPEATED:
        raise ArgumentError(
            "on_event: expected the same state each time it is called with the same "
            "arguments, found another one"
        )
    if status != layout.RUNNING:
        return _without(solution, status, system, len(numbers))
    n = system.n_states
    first_param = 1 + whole.n_states
    held = int(instants.held[0])
    message = with_instants_told(solution.message, reason_unsought(system), held)
    return Gradient(
        status=solution.status,
        message=message,
        value=float(found[0]),
        by_start=found[1 : 1 + n],
        by_params=found[first_param : first_param + len(numbers)],
        solution=solution,
    )


def _without(
    solution: Solution, status: int, system: System, n_params: int
) -> Gradient:
    """Return the answer where there is no gradient."""
    message = solution.message
    if status != solution.status:
        message = NO_GRADIENT[status]
    return Gradient(
        status=status,
        message=message,
        value=np.nan,
        by_start=np.full(system.n_states, np.nan),
        by_params=np.full(n_params, np.nan),
        solution=solution,
    )


def _for_driver(
    whole: System, system: System, mode: Sequence[int] | None, memory: ArrayLike | None
) -> tuple[Any, Any]:
    """Return mode and memory at the start, as the system that slides has them."""
    if whole.slides is None:
        return mode, memory
    full = np.zeros(system.n_modes, dtype=np.int64)
    if mode is not None:
        arguments.set_mode(full, system.n_guards, mode)
    numbers = arguments.with_memory(np.empty(0), memory, system.n_memory)
    own = np.zeros(whole.n_memory - system.n_memory)
    return whole.slides.start_mode(full), np.concatenate([numbers, own])


NO_GRADIENT = {
    layout.INSTANTS_IN_JACOBIAN: "The field jumps at an instant that moves with the "
    "parameters in more than one way: two such instants meet, or t_span begins there. "
    "The loss has no derivative by the parameters.",
    layout.GRAZING_IN_JACOBIAN: "A guard is grazed: its rate is zero to within the "
    "tolerance, and the loss has no derivative at a graze.",
    layout.TIE_IN_JACOBIAN: "Several guards flip at one instant, and their handlers "
    "change the field or the state, or one of them turns another back, or they end the "
    "integration: the loss has no derivative there.",
    layout.JACOBIAN_NOT_FINITE: "The loss or a derivative is NaN or infinite.",
}


def _at_start(
    system: System,
    solution: Solution,
    t_span: tuple[float, float],
    params: FloatArray,
    mode: Sequence[int] | None,
    memory: ArrayLike | None,
) -> tuple[IntArray, FloatArray]:
    """Return mode and parameters (with the memory) at the start.

    A lock that was left open is decided by the sign of h. On the surface, it is the one
    from which the guard first flips, or the last one if it never does.
    """
    numbers = arguments.with_memory(params, memory, system.n_memory)
    full = np.zeros(system.n_modes, dtype=np.int64)
    if mode is not None:
        arguments.set_mode(full, system.n_guards, mode)
    locks = full[: system.n_guards]
    is_open = locks == 0
    if is_open.any():
        trial = np.where(full == 0, -1, full)
        trial[system.n_guards :] = full[system.n_guards :]
        state = solution.y[: system.n_states, 0].copy()
        log = solution.events
        if len(log) and log.time[0] == solution.t[0]:
            state = log.before[0, : system.n_states].copy()
        here = Instant(float(t_span[0]), state, trial, numbers.copy())
        h, _ = guards_at(system, here, field_at(system, here))
        for k in np.flatnonzero(is_open):
            flips = log.direction[log.guard == k]
            lock = np.sign(h[k])
            if lock == 0 and len(flips):
                lock = -np.sign(flips[0])
            elif lock == 0:
                lock = solution.mode[k]
            locks[k] = lock
    return full, numbers


def _backward(
    code: Recorders,
    whole: System,
    system: System,
    solutions: tuple[Solution, Solution],
    at_start: tuple[IntArray, FloatArray],
    instants: Timed,
    allowed: passed.Tolerance,
    method: str,
) -> tuple[FloatArray, int]:
    """Run the backward pass on a tape that is long enough; return it and a status.

    The solution is given as the user sees it, and as the driver of a system that slides
    has it.
    """
    told = solutions[0].events
    solution = solutions[1]
    log = solution.events
    t = np.ascontiguousarray(solution.t)
    directions = np.array(system.directions or (0,) * system.n_guards, dtype=np.int64)
    n_ends = whole.n_guards - system.n_guards  # guards by which sliding ends
    directions = np.append(np.zeros(n_ends, dtype=np.int64), directions)
    ways = directions[log.guard]
    flips = passed.Flips(
        row=np.searchsorted(t, log.time).astype(np.int64),
        guard=log.guard,
        direction=log.direction,
        counts=((ways == 0) | (ways == log.direction)).astype(np.int64),
        told_guard=told.guard,
        told_direction=told.direction,
        before=log.before,
        after=log.after,
    )
    steps = passed.Steps(t, np.ascontiguousarray(solution.y.T))
    first_mode, first_params = at_start
    all_of = passed.Replayed(
        np.tile(first_mode, (len(log) + 1, 1)),
        np.tile(first_params, (len(log) + 1, 1)),
    )
    tableau = TABLEAUS[method]
    found = np.zeros(1 + whole.n_states + len(first_params))
    places = PLACES + len(first_params)
    while True:
        room = _room(whole, len(first_params), len(tableau.weights), places)
        status = passed.compiled_backward()(
            code,
            room,
            _coefficients(tableau),
            allowed,
            steps,
            flips,
            all_of,
            instants,
            system.n_states,
            solution.status == layout.TERMINATED,
            found,
        )
        if status != passed.TAPE_FULL:
            return found, status
        places *= 2


@cache
def _coefficients(tableau: Tableau) -> passed.Tableau:
    """Return an explicit method's coefficients as arrays."""
    n = len(tableau.weights)
    a = np.zeros((n, n))
    for k, row in enumerate(tableau.stages, start=1):
        a[k, : len(row)] = row
    return passed.Tableau(a, np.array(tableau.weights), np.array([0.0, *tableau.nodes]))


def _room(system: System, p: int, n_stages: int, places: int) -> passed.Room:
    """Return the memory of a backward pass."""
    n = system.n_states
    tape = np.zeros(HEAD + RECORD * places)
    guards = max(system.n_guards, 1)
    return passed.Room(
        tape=tape,
        links=tape.view(np.int64),
        adjoint=np.zeros(places + n + 2),
        full=np.zeros(1, dtype=np.int64),
        y=np.zeros((n, CELLS)),
        other=np.zeros((n, CELLS)),
        dy=np.zeros((n, CELLS)),
        params=np.zeros((p, CELLS)),
        changed=np.zeros((p, CELLS)),
        h=np.zeros((guards, CELLS)),
        hdot=np.zeros((guards, CELLS)),
        one=np.zeros((2, CELLS)),
        slopes=np.zeros((n_stages, n)),
        parts=np.zeros((n_stages, n)),
        places=np.zeros((n_stages, n), dtype=np.int64),
        bounds=np.zeros((n_stages, 2), dtype=np.int64),
        kept=np.zeros(p),
        mode=np.zeros(system.n_modes, dtype=np.int64),
        lock=np.zeros(system.n_modes, dtype=np.int64),
        limits=np.array([-np.inf, np.inf]),
        losses=np.zeros((2, n)),
        rows=np.zeros((6, n)),
    )
