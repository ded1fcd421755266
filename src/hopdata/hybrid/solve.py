"""`solve`: integrate an event-selected system, with a call like SciPy's `solve_ivp`."""

import sys
from collections.abc import Sequence
from contextlib import suppress
from time import monotonic, thread_time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.errors import told_call
from hopdata.hybrid import arguments
from hopdata.hybrid import layout as at
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.compiled.caught import catch, stop_catching
from hopdata.hybrid.derived import ask_derived, goes_back
from hopdata.hybrid.known_instants import Instants
from hopdata.hybrid.solution import Solution
from hopdata.hybrid.system import System
from hopdata.hybrid.workspace import Sink, Workspace

# Time until the first progress message on a terminal's stderr, and interval of others.
SILENT_S = 5.0
EVERY_S = 0.5
# Statuses of functions that may have left their arrays as they were.
NOT_FILLED = (at.FIELD_NOT_FINITE, at.GUARD_NOT_FINITE)
BEYOND = (1e-6, 1e-3, 0.1, 1.0, 10.0)  # in steps
UNFINISHED = (at.NEEDS_ROOM, at.NEEDS_METHOD, at.PAUSED)


@told_call
def solve(  # noqa: PLR0913 (each parameter is an option of the user's)
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
    max_steps: int = arguments.MOST,
    max_events: int = arguments.MOST,
    method: str = "auto",
    jacobian: bool | str = False,
    memory: ArrayLike | None = None,
    dense_output: bool = False,
    events: str | Sink = "all",
    debug: bool = False,
    tstops: Any = None,
) -> Solution:
    """Integrate an event-selected system from t_span[0] to t_span[1].

    One-step methods with error control are used. Events are localised on the
    interpolant, and the step is then repeated up to the event's instant, so that time
    and state have the method's order. Guards that are due at one instant flip one after
    the other, by their number; field and guards are evaluated again after each flip.

    Parameters
    ----------
    system : System
        Vector field, guards and handler.
    t_span : tuple of float
        Start and end, s. If the end is before the start, time runs backward; locks and
        event directions then refer to the crossings as they occur along the way. The
        end may be infinite if an event, the handler or a limit ends the integration.
    y0 : (n,) array_like
        Initial state.
    params : (p,) array_like
        Numbers handed to the system's functions.
    mode : sequence of int, optional
        Initial mode: the scene's integers, or the locks followed by the scene's
        integers. A lock that is 0 or not given is decided by the sign of h and, on the
        surface, by its rate. By default all are zero.
    rtol, atol : float, (n,) array_like
        Relative and absolute tolerance of a step's error, as in `solve_ivp`.
    max_step, first_step : float
        Largest step and first step, s. By default unlimited, and chosen automatically.
    t_eval : (N,) array_like, optional
        Times to report, s, increasing, within `t_span`. By default every step and every
        event.
    max_steps, max_events : int
        Largest number of steps and events; beyond it the integration stops with a
        status.
    method : str
        "dopri5" (best where events limit the steps), "dop853" (where events are
        sparse), "taylor" (affine modes, to rounding), "rosenbrock" (stiff fields), or
        "auto": Taylor series if the system has an affine form, otherwise each of the
        other methods where it is best.
    jacobian : bool or "params"
        Whether to propagate the derivative of the state with respect to the initial
        state, through events by saltation matrices (not with "rosenbrock"). With
        "params", the derivative with respect to the parameters is included (not with
        "taylor", and not with `n_memory`).
    memory : (n_memory,) array_like, optional
        Initial value of the scene's memory; by default zeros.
    dense_output : bool
        Whether to store what `solution(t)` needs, including some points within each
        step.
    events : str or callable
        What to keep of the events: "all", or only their number ("count"). A function
        receives them in an `EventLog` whenever some thousands have accumulated, and
        none are kept.
    debug : bool
        Whether to run all functions as plain Python, which checks every index and
        allows breakpoints in a debugger. This is many times slower and gives the same
        results.
    tstops : array_like, Every or list, optional
        Instants at which the field, or a derivative of it, jumps: times,
        `hopdata.hybrid.every` for periodic ones, or a list of both, besides those of
        the system. A step ends at each, and the next one begins anew.

    Returns
    -------
    Solution
        Trajectory, events, and how the integration ended.

    Raises
    ------
    ValueError
        If an argument is out of range or of the wrong shape.
    Exception
        Whatever the system's functions raise, and KeyboardInterrupt. The attribute
        `solution` of the exception holds the result up to that point.

    Examples
    --------
    >>> from hopdata.hybrid import field, guards
    >>> @field
    ... def hopper(t, y, mode, params, dy):  # a mass on a springy leg: height, velocity
    ...     dy[0] = y[1]
    ...     dy[1] = -9.81
    ...     if mode[0] < 0:
    ...         dy[1] += params[0] * (1.0 - y[0])
    >>> @guards
    ... def contact(t, y, dy, mode, params, h, hdot):
    ...     h[0] = y[0] - 1.0
    ...     hdot[0] = dy[0]
    >>> system = System(hopper, contact, n_states=2, guard_names=("contact",))
    >>> hops = solve(system, (0.0, 1.0), [2.0, 0.0], params=[1000.0])
    >>> hops.events.time.round(6), hops.events.direction  # touchdown, lift-off
    (array([0.451524, 0.555292]), array([-1,  1]))
    """
    expect(isinstance(system, System), "system", "a System", system)
    system = _current(system, tstops)
    work = system.take_workspace()
    try:
        keep_events = events == "all"
        # The usual request has nothing but numbers, which are written unchecked.
        counted = events == "count" and dense_output is False
        usual = debug is False and memory is None and (keep_events or counted)
        usual = usual and type(jacobian) is type(dense_output) is bool
        usual = usual and _is_plain(system, work, tstops)
        if not usual or not work.ask_again(
            t_span, y0, params, rtol, atol, max_step, first_step, max_steps, max_events,
            method, jacobian, t_eval, dense_output, keep_events,
        ):  # fmt: skip
            derived = debug is not False or isinstance(jacobian, str)
            if goes_back(t_span) or derived or not _is_plain(system, work, tstops):
                return ask_derived(
                    solve,
                    system,
                    t_span=t_span,
                    y0=y0,
                    params=params,
                    t_eval=t_eval,
                    atol=atol,
                    jacobian=jacobian,
                    debug=debug,
                    mode=mode,
                    rtol=rtol,
                    max_step=max_step,
                    first_step=first_step,
                    max_steps=max_steps,
                    max_events=max_events,
                    method=method,
                    memory=memory,
                    dense_output=dense_output,
                    events=events,
                    tstops=tstops,
                )
            work.sink = _sink(events, dense_output)
            limits = rtol, max_step, first_step, max_steps, max_events
            work.ask(
                system,
                t_span,
                y0,
                params,
                limits,
                atol,
                t_eval,
                method,
                jacobian,
                memory,
                dense_output,
                keep_events or callable(events),
            )
        flags = _set_mode(system, work, mode)
        caught = work.caught
        caught.clear()
        token = catch(caught)
        try:
            before = monotonic()  # in a tenth of the time of `thread_time`
            status = work.drive(work.block_address, flags)
            if work.methods.generic:
                work.methods.seconds += monotonic() - before
            if status > at.TERMINATED:
                status = _go_on(work, flags | at.RESUMED, status)
        # An interrupt, no memory, or what the sink has raised.
        except BaseException as error:
            caught.append(error)
        finally:
            stop_catching(token)
        if caught:
            first = caught[0]
            caught.clear()
            raise _with_what_was_reached(first, work)
        if status in NOT_FILLED:
            _check_results(system, work)
        elif status > at.TERMINATED:  # it has not started
            limits = rtol, max_step, first_step, max_steps, max_events
            _refuse(status, t_span, limits, work)
        if work.sink is not None:
            work.hand_over()
        solution = work.solution(status)
        if jacobian and work.counts[at.ON_SURFACE] > 0:
            _look_at_start(solution, system, t_span[0], y0, params, mode, memory)
        return solution
    finally:
        work.sink = None
        system.idle.append(work)


def _look_at_start(solution: Solution, system: System, *start: Any) -> None:
    """Note the guards at the start that leave the flow without a derivative."""
    # Imported here, since few starts lie on a surface.
    from hopdata.hybrid.first_order.starts import surfaces_at_start

    solution.__dict__["surfaces_at_start"] = surfaces_at_start(system, *start)


def _current(system: System, tstops: Any) -> System:
    """Return the system as its functions are now.

    One that is derived for known instants is so: it was made from one that is current.
    """
    return system if type(tstops) is Instants else system.current()


def _is_plain(system: System, work: Workspace, tstops: Any) -> bool:
    """Return whether the driver takes a system as it is, without a derived one.

    The known instants of a derived system are laid out.
    """
    if type(tstops) is Instants:
        work.set_instants(tstops)
        return system.is_plain
    return tstops is None and system.is_plain and not system.has_instants


def _set_mode(system: System, work: Workspace, mode: Any) -> int:
    """Write the initial mode, and return the flags of the run.

    The field is compared with the pattern of its Jacobian if that is still to be done.
    """
    flags = 0
    if mode is not None:
        arguments.set_mode(work.mode, system.n_guards, mode)
        flags = int(at.GIVEN_MODE)
    if work.methods.unchecked:
        work.check_pattern(system.n_guards, mode is not None)
    return flags


def _refuse(
    status: int, t_span: Any, limits: arguments.Limits, work: Workspace
) -> None:
    """Raise ValueError for what the driver has not accepted."""
    expect(status != at.BAD_START, "y0", "finite numbers", work.state)
    arguments.check_numbers(t_span, *limits)


def _check_results(system: System, work: Workspace) -> None:
    """Raise TypeError if a plain function did not return what was wanted of it.

    It is asked at the state that was reached, and at some beyond it, as Python runs it.
    """
    n_states, n_guards = system.n_states, system.n_guards
    rates, mode, params = np.empty(n_states), work.mode.copy(), work.constants
    h, hdot = np.empty(n_guards), np.empty(n_guards)
    time, slope = float(work.clock[at.T]), work.slope
    for ahead in (0.0, *BEYOND):
        step = ahead * float(work.clock[at.NEXT_DT])
        moved = work.state.copy()
        if step > 0.0:
            with np.errstate(over="ignore", invalid="ignore"):
                moved += step * slope
        if not np.isfinite(moved).all():
            return
        system.field.check_result(time + step, moved, mode, params, rates)
        if system.guards is not None:
            given = time + step, moved, slope, mode, params, h, hdot
            system.guards.check_result(*given)


def _sink(events: Any, dense_output: bool) -> Sink | None:
    """Return the consumer of the events; None if they are kept or only counted."""
    if isinstance(events, str) and events == "all":
        return None
    expect(not dense_output, "events", "'all' with dense_output", repr(events))
    known = callable(events) or (isinstance(events, str) and events == "count")
    expect(known, "events", "'all', 'count' or a function", repr(events))
    return events if callable(events) else None


def _with_what_was_reached(error: BaseException, work: Workspace) -> BaseException:
    """Attach the result so far to an exception that ended the integration."""
    reached = work.reached()
    with suppress(AttributeError):
        error.solution = reached  # type: ignore[attr-defined]
    error.add_note(
        f"{reached.message} The result so far is this exception's `solution`."
    )
    return error


def _go_on(work: Workspace, flags: int, status: int) -> int:
    """Call the driver until it has ended, each time with what it has asked for."""
    methods = work.methods
    first_message = monotonic() + SILENT_S
    next_message = first_message
    while status in UNFINISHED and not work.caught:
        if status == at.NEEDS_ROOM:
            work.enlarge()
        elif status == at.NEEDS_METHOD:
            methods.provide(int(work.counts[at.METHOD]))
        methods.specialise()
        before = monotonic()
        spent_before = thread_time()
        status = work.drive(work.block_address, flags)
        now = monotonic()
        if methods.generic:
            methods.seconds += thread_time() - spent_before
        if status == at.PAUSED:
            work.be_patient(now - before)
        if now > next_message and sys.stderr.isatty():
            next_message = now + EVERY_S
            print(f"\r{work.progress}", end="", file=sys.stderr, flush=True)
    if next_message > first_message:
        print(file=sys.stderr)
    return status
