"""What integrates a simulated hop: hopdata's driver, or the dissertation's method.

`INTEGRATORS` is the table of the key ``simulation.integrator``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.hybrid import System, solve
from hopdata.hybrid.layout import SLIDING, TERMINATED, TOO_MANY_EVENTS, ZENO
from hopdata.hybrid.solution import EventLog

#: Relative tolerance of the driver.
#: Unit: 1. Origin: chosen.
RTOL = 1e-10
#: Absolute tolerance of the driver, for a relative one of 1.
#: Unit: m, rad, m/s, rad/s. Origin: chosen.
ATOL_PER_RTOL = 1e-2
# A foot with so many contact events in one hop neither stands nor flies.
MOST_EVENTS = 100_000

#: Longest step of the classical solver around which the printed method is put. A foot
#: that touches and lifts within one step is not seen.
#: Unit: s. Origin: chosen. Half a frame at 100 Hz. With 2 and 20 ms, hops agree with
#: the driver's as well (tests/synthesis/test_integrators.py).
LONGEST_STEP_S = 5e-3
#: Relative tolerance of that solver.
#: Unit: 1. Origin: measured: contacts are within 1e-8 s and poses within 1e-7 m and rad
#: of the driver's in six hops; tests/synthesis/test_integrators.py has the bounds.
PRINTED_RTOL = 1e-8
#: Absolute tolerance of that solver, for a relative one of 1.
#: Unit: m, rad, m/s, rad/s. Origin: chosen.
PRINTED_ATOL_PER_RTOL = 1e-3
#: Crossings in one hop after which the printed method calls the hopper stuck.
#: Unit: crossings. Origin: chosen. A hop of three legs has 9: 6 contacts, and the climb
#: rate's 3 zeros.
MOST_CROSSINGS = 1000


@dataclass(frozen=True)
class Flown:
    """One integrated hop.

    Parameters
    ----------
    frame_times_s : (K,) array
        Frame times up to the end, s.
    states : (K, n) array
        States then.
    end_time_s : float
        Time reached, s.
    end_state : (n,) array
        State reached.
    events : EventLog
        All events.
    is_stuck : bool
        Whether it slides on a guard or has events without end.
    has_ended : bool
        Whether an event ended it.
    """

    frame_times_s: FloatArray
    states: FloatArray
    end_time_s: float
    end_state: FloatArray
    events: EventLog
    is_stuck: bool
    has_ended: bool


def by_driver(
    system: System,
    state: FloatArray,
    *,
    params: FloatArray,
    mode: IntArray,
    frame_times_s: FloatArray,
    limit_s: float,
    rtol: float | None = None,
) -> Flown:
    """Integrate a hop by `hopdata.hybrid.solve`.

    Parameters
    ----------
    system : System
    state : (n,) array
        State at the start.
    params : (p,) array
        Parameters of the system.
    mode : (m,) array of int
        Mode at the start.
    frame_times_s : (K,) array
        Times at which states are returned, s.
    limit_s : float
        Time at which to stop, s.
    rtol : float, optional
        Relative tolerance; by default `RTOL`.

    Raises
    ------
    AnalysisError
        If the integration fails.
    """
    if rtol is None:
        rtol = RTOL
    solution = solve(
        system,
        (0.0, limit_s),
        state,
        params=params,
        mode=mode.tolist(),
        t_eval=frame_times_s[frame_times_s < limit_s],
        rtol=rtol,
        atol=ATOL_PER_RTOL * rtol,
        max_events=MOST_EVENTS,
    )
    is_stuck = solution.status in (SLIDING, ZENO, TOO_MANY_EVENTS)
    if not is_stuck and not solution.success:
        raise AnalysisError(f"hop: the integration failed: {solution.message}")
    return Flown(
        frame_times_s=solution.t,
        states=solution.y.T,
        end_time_s=solution.t_end,
        end_state=solution.y_end,
        events=solution.events,
        is_stuck=is_stuck,
        has_ended=solution.status == TERMINATED,
    )


def by_printed(
    system: System,
    state: FloatArray,
    *,
    params: FloatArray,
    mode: IntArray,
    frame_times_s: FloatArray,
    limit_s: float,
    rtol: float | None = None,
) -> Flown:
    """Integrate a hop by Algorithms 5 to 7 around Dormand and Prince's method.

    Regions are chained by `hopdata.hybrid.printed.integrate_both_ways`, since one
    velocity does not tell the landings of several feet from their lift-offs. The tail
    is "restart" and not the printed third-order step: all legs are released once they
    stand, which moves the surface of their lift-offs, and that can happen between two
    regions only. States at the frames follow from the method's Hermite splines.

    Parameters and errors are those of `by_driver`; `rtol` is that of the classical
    solver, by default `PRINTED_RTOL`.
    """
    from scipy.integrate import RK45

    from hopdata.hybrid.printed import (
        PrintedOptions,
        Stepping,
        integrate_both_ways,
        states_at,
    )

    if rtol is None:
        rtol = PRINTED_RTOL
    tolerances = {"rtol": rtol, "atol": PRINTED_ATOL_PER_RTOL * rtol}
    try:
        solution = integrate_both_ways(
            system,
            (0.0, limit_s),
            state,
            params=params,
            mode=mode,
            max_events=MOST_CROSSINGS,
            solver=Stepping(RK45, {"max_step": LONGEST_STEP_S, **tolerances}),
            options=PrintedOptions(tail="restart"),
        )
    except ArithmeticError as error:
        raise AnalysisError(f"hop: the integration failed: {error}") from None
    is_within = (frame_times_s <= solution.t_end) & (frame_times_s < limit_s)
    times = frame_times_s[is_within]
    return Flown(
        frame_times_s=times,
        states=states_at(solution, system, times, params=params),
        end_time_s=solution.t_end,
        end_state=solution.y_end,
        events=solution.events,
        is_stuck=solution.status == TOO_MANY_EVENTS,
        has_ended=solution.status == TERMINATED,
    )


Integrator = Callable[..., Flown]

# The integrators by the names of the key ``simulation.integrator``, the default first.
INTEGRATORS: dict[str, Integrator] = {"driver": by_driver, "printed": by_printed}
