"""The trajectory of the printed method, and how it is put together from its legs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hopdata.arrays import FloatArray, IntArray
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
    """

    t: FloatArray
    y: FloatArray
    events: EventLog
    mode: IntArray

    @property
    def t_end(self) -> float:
        """Time reached, s."""
        return float(self.t[-1])

    @property
    def y_end(self) -> FloatArray:
        """State reached, (n,)."""
        return self.y[:, -1]


@dataclass
class Trail:
    """Legs and events so far; the first leg is the start alone."""

    system: System
    legs: list[Mesh]
    #: Time, guard, direction, state and mode of each event.
    events: list[tuple[float, int, int, FloatArray, IntArray]] = field(
        default_factory=list
    )

    def add(self, leg: Mesh, crossings: tuple[Crossing, ...], region: Region) -> None:
        """Append a leg, which is without its start, and its crossings."""
        self.legs.append(leg)
        for one in crossings:
            direction = int(region.orientation[one.guard])
            mode = region.mode(one.locks)
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

    def solution(self, mode: IntArray) -> PrintedSolution:
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
        return PrintedSolution(times, whole.T.copy(), log, mode)
