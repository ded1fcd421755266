"""Algorithm 7 for many guards: each looks to the side on which it is not.

`hopdata.hybrid.printed.alternate` parts its two regions by the sign of a velocity. Here
a guard turns once it is crossed, so that no velocity is needed. Between two regions a
handler may choose the next one's mode, and a terminal guard ends the trajectory.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import layout as at
from hopdata.hybrid.arguments import check_shape, expect
from hopdata.hybrid.layout import FINISHED, TERMINATED, TOO_MANY_EVENTS
from hopdata.hybrid.printed.integrate import (
    RegionStop,
    default_solver,
    locks_at,
    one_leg,
)
from hopdata.hybrid.printed.options import PrintedOptions
from hopdata.hybrid.printed.region import Region, region_with_handler
from hopdata.hybrid.printed.resolution import Crossing
from hopdata.hybrid.printed.solvers import ClassicalSolver, Mesh
from hopdata.hybrid.printed.trajectory import Leg, PrintedSolution, Trail
from hopdata.hybrid.system import System


def integrate_both_ways(
    system: System,
    t_span: tuple[float, float],
    y0: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: ArrayLike | None = None,
    max_events: int | None = None,
    solver: ClassicalSolver | None = None,
    options: PrintedOptions | None = None,
) -> PrintedSolution:
    """Integrate a system whose guards are crossed to and fro, such as feet on a floor.

    After each step with events a new region begins, in which every guard is oriented
    away from the side on which it is. So each guard has a partition of its own, and a
    body may land on some feet while others leave the floor. The dissertation does not
    say how its plate (section 4.4.4) chooses regions; with Algorithm 7, feet that touch
    while the body rises would be lost.

    The dissertation has no terminal guards and no handlers. Here the trajectory ends at
    the crossing of a guard that is due by the system's `terminal`. Crossings other than
    in the system's `directions` turn the guard, but are no events. With
    ``tail="restart"`` a region ends at each crossing. A handler is then called between
    two regions: it may change the scene's own integers in the mode, and thereby the
    guards of the next region, and end the trajectory. It may not change the state.

    Parameters
    ----------
    system : System
        Its guards are crossed in both directions.
    t_span : tuple of float
        Start and end, s.
    y0 : (n,) array_like
        Initial state.
    params : (p,) array_like
        Parameters passed to its functions.
    mode : (m,) array_like of int, optional
        Mode at the start; by default locks follow from the event functions and the
        scene's own integers are 0.
    max_events : int, optional
        Number of crossings at which to stop, with the status -5.
    solver, options
        As for `integrate`. A guard that is crossed twice within one step is not seen.

    Returns
    -------
    PrintedSolution
        Mesh and events of all regions.

    Raises
    ------
    ArithmeticError
        If the classical solver fails, or the handler changes the state.
    ArgumentError
        If there is a handler without ``tail="restart"``.
    """
    options = options or PrintedOptions()
    solver = solver or default_solver()
    _check_handler(system, options)
    t, t_end = float(t_span[0]), float(t_span[1])
    y = check_shape("y0", y0, system.n_states)
    trail = Trail(system, [Mesh(np.array([t]), y[None])])
    door = Door(trail, np.zeros(system.n_guards, dtype=np.int64))
    rising = region_with_handler(system, params)
    if mode is None:
        sides = locks_at(rising, t, y, options)
    else:
        start = check_shape("mode", mode, system.n_modes).astype(np.int64)
        sides = start[: system.n_guards]
        rising = rising.with_modes(start[system.n_guards :])
    n_crossings = 0
    status = FINISHED
    while t < t_end and status == FINISHED:
        # Seen from its own side, no guard is crossed yet.
        region = rising.turned(-sides)
        locks = -np.abs(sides)
        stop = RegionStop(region, locks)
        leg, resolved = one_leg(stop, solver, t, y, t_end, options)
        leg, own_modes, has_ended = door.passed(leg, region, locks)
        rising = rising.with_modes(own_modes)
        t = float(leg.mesh.t[-1])
        y = leg.mesh.y[-1]
        locks = resolved.locks
        if has_ended:
            locks = leg.crossings[-1].locks
            status = TERMINATED
        sides = region.orientation * locks
        if not options.keep_locks:
            sides = rising.signs(t, y)
        n_crossings += len(leg.crossings)
        if n_crossings == max_events and not has_ended:
            status = TOO_MANY_EVENTS
    return trail.solution(rising.mode(sides), status)


def _check_handler(system: System, options: PrintedOptions) -> None:
    """Raise an ArgumentError if a system has what the method cannot call or keep."""
    suits = system.on_event is None or options.tail == "restart"
    wanted = "no on_event, unless the options have tail='restart'"
    expect(suits, "system", wanted, f"tail='{options.tail}'")
    wanted = "no n_memory, which the printed method does not keep"
    expect(system.n_memory == 0, "system", wanted, system.n_memory)


@dataclass
class Door:
    """What happens between two regions: events are logged, and handlers are called.

    Parameters
    ----------
    trail : Trail
        The trajectory so far.
    counts : (m,) array of int
        Number of events of each guard so far.
    """

    trail: Trail
    counts: IntArray

    def passed(
        self, leg: Leg, region: Region, locks: IntArray
    ) -> tuple[Leg, IntArray, bool]:
        """Append a leg with its events, up to one that ends the trajectory.

        Returns
        -------
        leg : Leg
            As appended.
        own_modes : (e,) array of int
            The scene's own integers in the next region.
        has_ended : bool
            Whether the last event ends the trajectory.
        """
        own_modes = region.own_modes
        has_ended = False
        for number, one in enumerate(leg.crossings):
            direction = int(region.orientation[one.guard])
            directions = self.trail.system.rules[at.DIRECTION]
            if directions[one.guard] not in (0, direction):
                continue
            mode = region.mode(one.locks)
            has_ended = self._handled(one, direction, mode, region.params)
            own_modes = mode[region.system.n_guards :]
            self.trail.log(one, direction, mode)
            if has_ended:
                leg = leg.until(number)
                break
        self.trail.add_mesh(leg, region, locks)
        return leg, own_modes, has_ended

    def _handled(
        self, one: Crossing, direction: int, mode: IntArray, params: FloatArray
    ) -> bool:
        """Call the handler, which may change the mode; return whether this ends it."""
        system = self.trail.system
        has_ended = False
        if system.on_event is not None:
            state = one.state.copy()
            call = system.on_event.function
            answer = call(one.time, state, mode, params, one.guard, direction)
            has_ended = bool(answer)
            if not np.array_equal(state, one.state):
                name = system.guard_names[one.guard]
                raise ArithmeticError(
                    f"the handler changes the state at {name}, t = {one.time}; "
                    "the printed method has no resets"
                )
        self.counts[one.guard] += 1
        terminal = system.rules[at.TERMINAL]
        return has_ended or bool(self.counts[one.guard] == terminal[one.guard])
