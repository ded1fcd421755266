"""`gradient`: the derivative of a loss by the start and by all parameters, at once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import ArgumentError, Told, told_call
from hopdata.hybrid import arguments, layout
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.compiled.aloud import said_if_long
from hopdata.hybrid.derived import goes_back
from hopdata.hybrid.gradients.backward import compiled_backward
from hopdata.hybrid.gradients.extended import (
    with_all_crossings,
    with_integral,
    without_search,
)
from hopdata.hybrid.gradients.known import (
    Known,
    known_of,
    reason_unsought,
    with_instants_told,
)
from hopdata.hybrid.gradients.recorders import Recorders, recorders
from hopdata.hybrid.gradients.run import (
    given_to_driver,
    run_of,
    start_of,
    with_sliding,
)
from hopdata.hybrid.gradients.workspace import (
    NOT_REPEATED,
    TAPE_FULL,
    Run,
    Tolerance,
    coefficients,
    room_for,
)
from hopdata.hybrid.methods.table import TABLEAUS
from hopdata.hybrid.sliding import sliding_system
from hopdata.hybrid.solution import Solution
from hopdata.hybrid.solve import solve
from hopdata.hybrid.system import System

Function = Callable[..., Any]

#: Places of a tape at first; it doubles until a step fits.
#: Unit: 1. Origin: chosen.
PLACES = 4096

# What a status of the pass means to the user.
NO_GRADIENT = {
    layout.INSTANTS_IN_JACOBIAN: "The field jumps at an instant that moves with the "
    "parameters in more than one way: two such instants meet, or t_span begins there. "
    "The loss has no derivative by the parameters.",
    layout.UNSOUGHT_IN_JACOBIAN: "The field may jump in time at instants that were not "
    "found apart (`solution.n_unsought`): how they move with the parameters is "
    "unknown, and so are the loss's derivatives by these.",
    layout.GRAZING_IN_JACOBIAN: "A guard is grazed: its rate is zero to within the "
    "tolerance, and the loss has no derivative at a graze.",
    layout.TIE_IN_JACOBIAN: "Several guards flip at one instant, and their order may "
    "matter: the flow depends on it, their handlers change the field or the state, one "
    "of them turns another back, they end the integration, or a handler leaves the "
    "state on the surface of another guard from this start only. So the loss's "
    "derivative there does not exist or is unknown.",
    layout.JACOBIAN_NOT_FINITE: "The loss or a derivative is NaN or infinite.",
}


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
    _check(system, t_span, (at_end, at_event, along), method)
    system = system.current()
    start = arguments.check_shape("y0", y0, system.n_states)
    numbers = arguments.numbers_of("params", params).ravel()
    tolerance = np.zeros(system.n_states)
    arguments.set_tolerance(tolerance, atol)
    extended = with_all_crossings(system)
    if along is not None:
        extended = with_integral(extended, along)
        start = np.append(start, 0.0)
        tolerance = np.append(tolerance, tolerance.min())
    if extended.sliding:
        extended = sliding_system(without_search(extended))
    given_mode, given_memory = given_to_driver(extended, system, mode, memory)
    with said_if_long("the functions of a system for gradients"):
        code = recorders(extended, system.n_states, at_event, at_end)
    solution = solve(
        extended,
        t_span,
        start,
        params=numbers,
        mode=given_mode,
        memory=given_memory,
        rtol=rtol,
        atol=tolerance,
        max_step=max_step,
        first_step=first_step,
        max_steps=max_steps,
        max_events=max_events,
        method=method,
    )
    if not solution.success:
        return _without(solution, solution.status, system, len(numbers))
    if solution.n_unsought > 0 and len(numbers) > 0:
        unsought = layout.UNSOUGHT_IN_JACOBIAN
        return _without(solution, unsought, system, len(numbers))
    at_start = start_of(system, solution, float(t_span[0]), numbers, mode, memory)
    at_start = with_sliding(extended, system, at_start)
    allowed = Tolerance(np.array([rtol]), tolerance)
    run = run_of(extended, system, solution, at_start, allowed)
    known = known_of(system, at_start.params, len(numbers), system.n_states, solution.t)
    found, status = _backward(code, extended, run, known, method)
    if status == NOT_REPEATED:
        raise ArgumentError(
            "on_event: expected the same state each time it is called with the same "
            "arguments, found another one"
        )
    if status != layout.RUNNING:
        return _without(solution, status, system, len(numbers))
    reason = reason_unsought(system)
    message = with_instants_told(solution.message, reason, int(known.n_held[0]))
    first_param = 1 + extended.n_states
    return Gradient(
        status=solution.status,
        message=message,
        value=float(found[0]),
        by_start=found[1 : 1 + system.n_states],
        by_params=found[first_param : first_param + len(numbers)],
        solution=solution,
    )


def _check(
    system: Any, t_span: tuple[float, float], losses: tuple[Any, ...], method: Any
) -> None:
    """Raise an ArgumentError unless there is a gradient for these arguments."""
    expect(isinstance(system, System), "system", "a System", system)
    wanted = "a system without together=, whose law has no derivative"
    expect(system.together is None, "system", wanted, system)
    wanted = "'stop': there is no derivative where a guard comes to rest"
    expect(system.on_zeno == "stop", "on_zeno", wanted, repr(system.on_zeno))
    given = any(one is not None for one in losses)
    expect(given, "at_end, at_event, along", "at least one of them", "none")
    is_known = isinstance(method, str) and method in TABLEAUS
    expect(is_known, "method", f"one of {', '.join(TABLEAUS)}", repr(method))
    forward = not goes_back(t_span)
    expect(forward, "t_span", "an end not before the start", t_span)


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


def _backward(
    code: Recorders, extended: System, run: Run, known: Known, method: str
) -> tuple[FloatArray, int]:
    """Run the backward pass on a tape that is long enough.

    Returns the loss with its derivatives, as `backward` fills them in, and a status.
    """
    tableau = TABLEAUS[method]
    p = run.replayed.params.shape[1]
    found = np.zeros(1 + extended.n_states + p)
    places = PLACES + p
    while True:
        room = room_for(extended, p, len(tableau.weights), places)
        given = (code, room, coefficients(tableau), run, known, found)
        status = compiled_backward(*given)(*given)
        if status != TAPE_FULL:
            return found, status
        places *= 2
