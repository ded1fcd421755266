"""The trajectory of the printed method, and how it is put together from its legs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.layout import FINISHED
from hopdata.hybrid.printed.region import Region
from hopdata.hybrid.printed.resolution import Crossing
from hopdata.hybrid.printed.solvers import Mesh
from hopdata.hybrid.solution import EventLog
from hopdata.hybrid.system import System


@dataclass(frozen=True)
class PrintedSolution:
    """A trajectory with the attributes of `hopdata.hybrid.Solution`.

    Parameters
    ----------
    t : (N,) array
        Times of the mesh, s, including the instants of events.
    y : (n, N) array
        States at these times.
    events : EventLog
        All events.
    mode : (m,) array of int
        Mode at the end.
    step_modes : (N - 1, m) array of int
        Mode in each step of the mesh.
    status : int
        As in `hopdata.hybrid.Solution`: 0 if it reached the end of its span, 1 if an
        event ended it, -5 if there were as many events as were allowed.
    """

    t: FloatArray
    y: FloatArray
    events: EventLog
    mode: IntArray
    step_modes: IntArray
    status: int = FINISHED

    @property
    def t_end(self) -> float:
        """Time reached, s."""
        return float(self.t[-1])

    @property
    def y_end(self) -> FloatArray:
        """State reached, (n,)."""
        return self.y[:, -1]


@dataclass(frozen=True)
class Leg:
    """What one run of a classical solver adds to a trajectory.

    Parameters
    ----------
    mesh : Mesh
        The points after the start, with the instants of events.
    crossings : tuple of Crossing
        Events, in order of time.
    n_behind : int
        Number of points behind the first crossing.
    """

    mesh: Mesh
    crossings: tuple[Crossing, ...] = ()
    n_behind: int = 0

    def until(self, number: int) -> Leg:
        """Return the leg up to a crossing, 0 for the first."""
        last = len(self.mesh.t) - self.n_behind + number
        mesh = Mesh(self.mesh.t[:last], self.mesh.y[:last])
        return Leg(mesh, self.crossings[: number + 1], number)


@dataclass
class Trail:
    """Legs and events so far; the first leg is the start alone."""

    system: System
    legs: list[Mesh]
    #: Time, guard, direction, state and mode of each event.
    events: list[tuple[float, int, int, FloatArray, IntArray]] = field(
        default_factory=list
    )
    #: Mode in each step of the mesh.
    step_modes: list[IntArray] = field(default_factory=list)

    def add(self, leg: Leg, region: Region, locks: IntArray) -> None:
        """Append a leg with its crossings, given the locks (m,) at its start."""
        self.add_mesh(leg, region, locks)
        for one in leg.crossings:
            direction = int(region.orientation[one.guard])
            self.log(one, direction, region.mode(one.locks))

    def add_mesh(self, leg: Leg, region: Region, locks: IntArray) -> None:
        """Append a leg without logging its crossings."""
        self.legs.append(leg.mesh)
        n_first = len(leg.mesh.t) - leg.n_behind
        self.step_modes += [region.mode(locks)] * n_first
        # Each crossing but the last leads to another one, and the last to the tail.
        behind = leg.crossings[: leg.n_behind]
        self.step_modes += [region.mode(one.locks) for one in behind]

    def log(self, one: Crossing, direction: int, mode: IntArray) -> None:
        """Log a crossing as an event, with the mode after it."""
        self.events.append((one.time, one.guard, direction, one.state, mode))

    def cut(self, t: float, y: FloatArray) -> None:
        """Let the last leg end earlier, at a point within its last step."""
        last = self.legs[-1]
        times = np.append(last.t[:-1], t)
        states = np.vstack([last.y[:-1], y])
        self.legs[-1] = Mesh(times, states)

    def last_step(self) -> Mesh:
        """Return the last two points."""
        legs = self.legs[-2:]
        times = np.concatenate([leg.t[-2:] for leg in legs])
        states = np.concatenate([leg.y[-2:] for leg in legs])
        return Mesh(times[-2:], states[-2:])

    def solution(self, mode: IntArray, status: int = FINISHED) -> PrintedSolution:
        """Return the whole trajectory, with the mode (m,) at its end."""
        instants: list[float] = []
        guards: list[int] = []
        directions: list[int] = []
        met: list[FloatArray] = []
        entered: list[IntArray] = []
        for time, guard, direction, state, its_mode in self.events:
            instants.append(time)
            guards.append(guard)
            directions.append(direction)
            met.append(state)
            entered.append(its_mode)
        # With no events, too, each array has its number of columns.
        states = np.array(met).reshape(-1, self.system.n_states)
        modes = np.array(entered, dtype=np.int64).reshape(-1, self.system.n_modes)
        log = EventLog.of_columns(
            time=np.array(instants),
            guard=np.array(guards, dtype=np.int64),
            direction=np.array(directions, dtype=np.int64),
            before=states,
            after=states,  # nothing is reset
            mode=modes,
            guard_names=self.system.guard_names,
        )
        times = np.concatenate([leg.t for leg in self.legs])
        whole = np.concatenate([leg.y for leg in self.legs])
        n_modes = self.system.n_modes
        steps = np.array(self.step_modes, dtype=np.int64).reshape(-1, n_modes)
        return PrintedSolution(times, whole.T.copy(), log, mode, steps, status)
