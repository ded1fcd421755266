"""Results of an integration.

They keep the driver's records as they are and unpack each part only when it is
requested: for a short integration, making all the arrays would take longer than the
integration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import Told
from hopdata.hybrid import layout
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.zeno import Limit, limit_of

if TYPE_CHECKING:
    from hopdata.hybrid.sliding import Slides
    from hopdata.hybrid.system import System

SMALLER = 2.0**-10  # more than the sum of the weights of an interpolation
MOST_SHOWN = 10  # most events in the text of a log
COUNTS = int(layout.CLOCK_SLOTS)  # index of the first counter in the end record
MODE = COUNTS + int(layout.COUNT_SLOTS)  # index of the first entry of the mode
BYTES = 8  # bytes of a number
# Columns of the log.
CHANGES = int(layout.LOG_CHANGES)
STATES = int(layout.LOG_STATES)

# What the directions in the log mean.
WORDS = {
    1: "rises",
    -1: "falls",
    2: "rises to zero and slides",
    -2: "falls to zero and slides",
    3: "leaves zero upward",
    -3: "leaves zero downward",
    4: "rises to zero and rests",
    -4: "falls to zero and rests",
}


@dataclass(frozen=True, repr=False)
class EventLog(Told):
    """The E events of an integration, in chronological order.

    Parameters
    ----------
    rows : (E, 4 + 2 n) array
        Time, guard, direction, number of changes of the mode up to and including the
        event, and the states before and after its handler, side by side; integers are
        stored by their bits.
    changes : (C, 2) array of int
        Changes of the mode in chronological order: place in the mode, and new value.
        The first event that is logged has one for each place.
    n_states, n_modes : int
        Lengths of the state, n, and of the mode that is logged, m.
    guard_names : tuple of str
        Names of all guards of the system.
    """

    rows: FloatArray
    changes: IntArray
    n_states: int
    n_modes: int
    guard_names: tuple[str, ...]

    @classmethod
    def of_columns(
        cls,
        *,
        time: FloatArray,
        guard: IntArray,
        direction: IntArray,
        before: FloatArray,
        after: FloatArray,
        mode: IntArray,
        guard_names: tuple[str, ...],
    ) -> EventLog:
        """Return the log of events that were found in another way."""
        n_events, n_modes = np.shape(mode)
        places = np.tile(np.arange(n_modes), n_events)
        values = np.asarray(mode, dtype=np.int64).ravel()
        totals = n_modes * np.arange(1, n_events + 1)
        integers = np.column_stack([guard, direction, totals]).astype(np.int64)
        rows = np.column_stack([time, integers.view(np.float64), before, after])
        changes = np.column_stack([places, values])
        return cls(rows, changes, np.shape(before)[1], n_modes, guard_names)

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        lines = [f"EventLog of {len(self)} events"]
        shown = zip(self.time[:MOST_SHOWN], self.guard, self.direction, strict=False)
        for time, guard, direction in shown:
            lines.append(
                f"  t = {time:.9g}: {self.guard_names[guard]} {WORDS[int(direction)]}"
            )
        if len(self) > MOST_SHOWN:
            lines.append(f"  and {len(self) - MOST_SHOWN} more")
        return "\n".join(lines)

    def _floats(self, first: int, count: int) -> FloatArray:
        return self.rows[:, first : first + count].copy()

    def _integers(self, first: int, count: int) -> IntArray:
        return self.rows.view(np.int64)[:, first : first + count].copy()

    @cached_property
    def time(self) -> FloatArray:
        """Instant of each event, s; (E,)."""
        return self._floats(0, 1).ravel()

    @cached_property
    def guard(self) -> IntArray:
        """Index of the guard; (E,)."""
        return self._integers(1, 1).ravel()

    @cached_property
    def direction(self) -> IntArray:
        """+1 where the event function rose through zero, -1 where it fell; (E,).

        Of a guard that may slide also +2 and -2, where the solution arrived from below
        and above and began to slide, +3 and -3, where it left upward and downward, and
        +4 and -4, where its events piled up and it came to rest.
        """
        return self._integers(2, 1).ravel()

    @cached_property
    def before(self) -> FloatArray:
        """State immediately before the event's handler; (E, n)."""
        return self._floats(STATES, self.n_states)

    @cached_property
    def after(self) -> FloatArray:
        """State immediately after the event's handler; (E, n)."""
        return self._floats(STATES + self.n_states, self.n_states)

    @cached_property
    def mode(self) -> IntArray:
        """Mode after the event; (E, m). Without the locks if guards come one by one."""
        totals = self._integers(CHANGES, 1).ravel()
        return modes_of(totals, self.changes, self.n_modes)

    @cached_property
    def records(self) -> FloatArray:
        """All properties side by side, (E, 3 + 2 n + m); integers by their bits."""
        modes = self.mode.view(np.float64)
        return np.hstack([self.rows[:, :CHANGES], self.before, self.after, modes])

    def of(self, guard: str, *, direction: int = 0) -> EventLog:
        """Return the events of one guard, in one direction unless that is 0.

        Raises
        ------
        ValueError
            If no guard has this name.
        """
        known = guard in self.guard_names
        expect(known, "guard", f"one of {self.guard_names}", repr(guard))
        chosen = self.guard == self.guard_names.index(guard)
        if direction != 0:
            chosen &= self.direction == direction
        return replace(self, rows=self.rows[chosen])


def modes_of(totals: IntArray, changes: IntArray, n_modes: int) -> IntArray:
    """Return the mode after each event, (E, m), from the changes of the mode.

    Parameters
    ----------
    totals : (E,) array of int
        Number of changes up to and including each event.
    changes : (C, 2) array of int
        Place in the mode and new value, in chronological order.
    n_modes : int
        Length of the mode, m.
    """
    modes = np.full((len(totals), n_modes), layout.UNKNOWN)
    last = np.zeros(modes.shape, dtype=np.int64)  # event of each entry's last change
    of_event = np.searchsorted(totals, np.arange(len(changes)), side="right")
    inside = of_event < len(totals)
    events = of_event[inside]
    places = changes[inside, layout.CHANGE_PLACE]
    # Of several changes at one event, the last stays.
    modes[events, places] = changes[inside, layout.CHANGE_VALUE]
    last[events, places] = events
    np.maximum.accumulate(last, axis=0, out=last)
    return np.take_along_axis(modes, last, axis=0)


def event_log(rows: FloatArray, changes: IntArray, form: Form) -> EventLog:
    """Return the log of the driver's records, with the user's states and times only."""
    if form.way < 0.0 or form.shown < form.state:
        columns = np.arange(rows.shape[1])
        after = STATES + form.state
        shown = [columns[: STATES + form.shown], columns[after : after + form.shown]]
        rows = rows[:, np.concatenate(shown)]
        rows[:, 0] *= form.way
    if form.slides is not None:
        return _sliding_log(rows, changes, form, form.slides)
    return EventLog(rows, changes, form.shown, form.logged, form.guard_names)


def _sliding_log(
    rows: FloatArray, changes: IntArray, form: Form, slides: Slides
) -> EventLog:
    """Return the log of a system in which guards may slide."""
    raw = EventLog(rows, changes, form.shown, form.logged, form.guard_names)
    modes = raw.mode
    return EventLog.of_columns(
        time=raw.time,
        guard=slides.guards(raw.guard),
        direction=slides.directions(raw.guard, raw.direction, modes),
        before=raw.before,
        after=raw.after,
        mode=slides.modes(modes),
        guard_names=form.guard_names,
    )


@dataclass(frozen=True)
class Form:
    """Layout shared by the records of all integrations of a system.

    Parameters
    ----------
    state, mode : int
        Lengths of state (n) and mode (m).
    logged : int
        Number of entries of the mode that the log has, its last ones.
    guard_names : tuple of str
        Names of all guards of the system.
    way : float
        Factor of the driver's times: -1 where time runs backward.
    shown : int
        Number of states that are the user's; parameters follow them.
    unproven : str
        Why nothing can be proven of the guards.
    slides : Slides, optional
        How the records show what the user knows, if guards may slide.
    unsought : str
        Why the field's own instants were not sought though the derivative by the
        parameters may depend on them; "" if they were.
    has_handler : bool
        Whether the system has a handler of events.
    """

    state: int
    mode: int
    logged: int
    guard_names: tuple[str, ...]
    way: float
    shown: int
    unproven: str = ""
    slides: Slides | None = None
    unsought: str = ""
    has_handler: bool = True

    @classmethod
    def of(cls, system: System) -> Form:
        """Return the layout for a system."""
        # With guards one by one there may be thousands: the log leaves out their locks.
        logged = system.n_modes if system.guard is None else system.n_extra_modes
        return cls(
            system.n_states,
            system.n_modes,
            logged,
            system.shown_guard_names,
            system.way,
            system.n_shown,
            system.branches.reason,
            system.slides,
            system.unsought,
            system.on_event is not None,
        )


@dataclass(frozen=True, repr=False)
class Solution(Told):
    """Trajectory, events and outcome, named as in `scipy.integrate.solve_ivp`.

    Parameters
    ----------
    status : int
        0: reached the end; 1: ended by an event; negative: failed, see `message`.
    y_end : (n,) array
        Final state.
    jacobian : (n, n) array, optional
        Derivative of `y_end` with respect to the initial state at fixed times, through
        all events, if requested.
    parts : tuple of bytes
        The driver's times and counters and the final mode, side by side; times and
        states of the trajectory, (N, 1 + n), None if they are those between the steps
        in `dense`; events and changes of the mode, in the
        form of `EventLog`.
    form : Form
        Layout of these records.
    dense : tuple, optional
        Number of rows per step, and times and states at its Chebyshev points, for
        `__call__`.
    sensitivity : (n, p) array, optional
        Derivative of `y_end` with respect to the parameters, if requested.
    jacobian_error : float, optional
        Estimated error of `jacobian` and `sensitivity`, if a Jacobian was requested:
        the largest sum of a column's errors over all steps, in the column's own size.
        Each has grown since as the column of the state that grew most. How errors of
        the state change the derivative is not counted.
    surfaces_at_start : tuple of str
        Guards on whose surfaces the start lies, and whose crossing moves the state or
        bends its path, so that no derivative exists there; looked for only if a
        Jacobian was requested.
    by_differences : str
        Functions whose derivatives are by finite differences, because they do not
        compile for dual numbers, and why; empty if there are none.
    """

    status: int
    y_end: FloatArray
    jacobian: FloatArray | None
    parts: tuple[bytes, bytes | None, bytes, bytes]
    form: Form
    dense: tuple[int, bytes] | None = None
    sensitivity: FloatArray | None = None
    jacobian_error: float | None = None
    surfaces_at_start: tuple[str, ...] = ()
    by_differences: str = ""

    def __call__(self, t: ArrayLike, *, side: str = "right") -> FloatArray:
        """Return the state at times within the integration, (n,) or (n, N).

        It takes dense output.

        Parameters
        ----------
        t : float, (N,) array_like
            Times, s.
        side : str
            At the instant of an event, "right" gives the state after it and "left" the
            one before.

        Raises
        ------
        ValueError
            If there is no dense output, or if a time is out of range.
        """
        if self.dense is None:
            raise ValueError("solution(t): expected solve(..., dense_output=True)")
        expect(side in ("left", "right"), "side", "'left' or 'right'", repr(side))
        way = self.form.way
        boundaries, before, after, steps = self._pieces
        times = way * np.asarray(t, dtype=np.float64)
        outside = ~((times >= boundaries[0]) & (times <= boundaries[-1]))
        ends = tuple((way * boundaries[[0, -1]]).tolist())
        found = way * times[outside]
        expect(not outside.any(), "t", f"times within {ends}", found)
        at_boundaries = before if (side == "left") == (way > 0.0) else after
        place = np.searchsorted(boundaries, times.ravel())
        states = at_boundaries[place]
        inside = boundaries[place] != times.ravel()
        states[inside] = _interpolated(
            times.ravel()[inside], place[inside] - 1, boundaries, steps
        )
        return np.ascontiguousarray(states.T).reshape(self.form.shown, *times.shape)

    @cached_property
    def _pieces(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Times between steps, states before and after them, (N, K + 1, n) inside."""
        assert self.dense is not None
        count, rows = self.dense
        table = np.frombuffer(rows).reshape(-1, 1 + self.form.state)
        table = table[:, : 1 + self.form.shown]
        boundaries = table[::count, 0]
        after = table[::count, 1:]
        before = after.copy()
        log = self.events
        instants, first = np.unique(self.form.way * log.time, return_index=True)
        before[np.searchsorted(boundaries, instants)] = log.before[first]
        inside = table[:-1, 1:].reshape(-1, count, self.form.shown)
        steps = np.concatenate([inside, before[1:, None]], axis=1)
        return boundaries, before, after, steps

    def __repr__(self) -> str:
        return (
            f"Solution: status {self.status}. {self.message}\n"
            f"  {self.n_events} events, {self.n_steps} steps, {self.nfev} evaluations\n"
            f"  t_end = {self.t_end:.9g}, y_end = {self.y_end}"
        )

    @cached_property
    def events(self) -> EventLog:
        """The log of all events."""
        width = STATES + 2 * self.form.state
        rows = np.frombuffer(self.parts[2]).reshape(-1, width)
        numbers = np.frombuffer(self.parts[3], np.int64)
        changes = numbers.reshape(-1, layout.CHANGE_WIDTH)
        return event_log(rows, changes, self.form)

    @cached_property
    def mode(self) -> IntArray:
        """Final mode; (m,)."""
        end_record = self.parts[0]
        mode = np.frombuffer(end_record, np.int64, self.form.mode, BYTES * MODE)
        if self.form.slides is not None:
            return self.form.slides.modes(mode)
        return mode.copy()

    @property
    def t_end(self) -> float:
        """Final time, s."""
        return float(self.form.way * self.clock[layout.T])

    @cached_property
    def t(self) -> FloatArray:
        """Times, s; (N,): `t_eval` up to the final time, or every step and event."""
        return self.form.way * self._table[:, 0]

    @cached_property
    def y(self) -> FloatArray:
        """States at the times `t`, (n, N); at an event's instant the one after it."""
        return self._table[:, 1 : 1 + self.form.shown].T.copy()

    @property
    def success(self) -> bool:
        """Whether it reached the end of the time span or a terminal event."""
        return self.status >= 0

    @property
    def message(self) -> str:
        """How it ended, in words, and what is not proven or not exact."""
        ended = layout.describe(
            self.status,
            time=self.t_end,
            culprit=self.culprit,
            names=self.form.guard_names,
            rates=self.clock[[layout.RATE_BELOW, layout.RATE_ABOVE]],
            has_handler=self.form.has_handler,
        )
        told = [ended]
        if self.limit is not None:
            told += self._told_of_pile_up(self.limit)
        if self.status == layout.ZENO and self.form.slides is not None:
            told.append(layout.DEPENDENT_SURFACES)
        if self.n_unproven > 0:
            told.append(layout.why_unproven(self.n_unproven, self.form.unproven))
        if self.n_close > 0:
            told.append(layout.CLOSE_CALLS.format(count=self.n_close))
        if self.surfaces_at_start:
            names = ", ".join(f"'{name}'" for name in self.surfaces_at_start)
            told.append(layout.START_ON_SURFACE.format(guards=names))
        if self.by_differences:
            told.append(layout.BY_DIFFERENCES.format(reasons=self.by_differences))
        if self.form.unsought:
            told.append(layout.UNSOUGHT_INSTANTS.format(reason=self.form.unsought))
        if self.n_fixed_instants > 0:
            told.append(layout.HELD_INSTANTS.format(count=self.n_fixed_instants))
        if self.n_unsought > 0 and self.sensitivity is not None:
            told.append(layout.MISSED_INSTANTS.format(count=self.n_unsought))
        return " ".join(told)

    def _told_of_pile_up(self, limit: Limit) -> list[str]:
        """Return sentences on where events pile up, and on what to do."""
        where = layout.LIMIT_OF_EVENTS.format(time=limit.time, error=limit.time_error)
        if self.status == layout.GRAZING_IN_JACOBIAN:
            count = int((self.events.guard == self.culprit).sum())
            return [layout.PILE_UP_IN_JACOBIAN.format(count=count), where]
        guard = self.form.guard_names[self.culprit]
        return [where, layout.PILE_UP.format(guard=guard)]

    @cached_property
    def limit(self) -> Limit | None:
        """Where the events pile up that ended the run, if it is known.

        Its status is -7; or -8 with a Jacobian, which is lost before the limit, where
        the events nearly graze. It is not known if the events were not kept, or if the
        gaps between them do not shrink like those of a series that converges.
        """
        if self.status not in (layout.ZENO, layout.GRAZING_IN_JACOBIAN):
            return None
        if not self.form.way > 0.0:
            return None
        found = limit_of(self.events, self.culprit)
        if found is None or self.status == layout.ZENO:
            return found
        # A graze that is none of the series comes after its limit.
        if self.t_end <= found.time + found.time_error:
            return found
        return None

    @property
    def culprit(self) -> int:
        """Index of the guard that the message is about, -1 if none."""
        culprit = int(self.counts[layout.CULPRIT])
        if self.form.slides is not None:
            return int(self.form.slides.guards(np.array(culprit)))
        return culprit

    @property
    def nfev(self) -> int:
        """Number of field evaluations."""
        return int(self.counts[layout.NFEV])

    @property
    def n_events(self) -> int:
        """Number of events, including those that were not kept."""
        return int(self.counts[layout.EVENTS])

    @property
    def n_guard_evaluations(self) -> int:
        """Number of guard evaluations (of single guards, if they come one by one)."""
        return int(self.counts[layout.NGEV])

    @property
    def n_unproven(self) -> int:
        """Number of steps in which it is not proven that no guard flips unseen."""
        return int(self.counts[layout.UNPROVEN])

    @property
    def proven(self) -> bool:
        """Whether it is proven of all steps that no guard flips unseen.

        This holds for the interpolant of each step; see docs/integrator.md, Limits.
        """
        return self.n_unproven == 0

    @property
    def n_close(self) -> int:
        """Number of steps in which the tolerance cannot tell whether a guard flips."""
        return int(self.counts[layout.CLOSE])

    @property
    def n_fixed_instants(self) -> int:
        """Number of jumps in time that the derivative by the parameters takes as fixed.

        It cannot be told of these instants how they depend on the parameters.
        """
        return int(self.counts[layout.HELD_FIXED])

    @property
    def n_unsought(self) -> int:
        """Number of stretches of time in which jumps of the field were not found.

        Steps pass over these jumps as over any other part of the field. The derivative
        by the parameters leaves out how they move.
        """
        return int(self.counts[layout.UNSOUGHT])

    @property
    def n_steps(self) -> int:
        """Number of accepted steps."""
        return int(self.counts[layout.STEPS])

    @property
    def n_rejected(self) -> int:
        """Number of rejected steps."""
        return int(self.counts[layout.REJECTED])

    @property
    def _table(self) -> FloatArray:
        width = 1 + self.form.state
        trajectory = self.parts[1]
        if trajectory is not None:
            return np.frombuffer(trajectory).reshape(-1, width)
        assert self.dense is not None
        count, rows = self.dense
        return np.frombuffer(rows).reshape(-1, width)[::count]

    @property
    def clock(self) -> FloatArray:
        """The driver's final times, indexed as in `layout`."""
        return np.frombuffer(self.parts[0])[:COUNTS]

    @property
    def counts(self) -> IntArray:
        """The driver's final counters, indexed as in `layout`."""
        return np.frombuffer(self.parts[0], np.int64)[COUNTS:MODE]


def _interpolated(
    times: FloatArray, piece: IntArray, boundaries: FloatArray, steps: FloatArray
) -> FloatArray:
    """Return the states (N, n) at times inside steps, by the barycentric formula."""
    last = steps.shape[1] - 1
    # Chebyshev points, and their weights.
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(last + 1) / last)
    weights = np.where(np.arange(last + 1) % 2 == 0, 1.0, -1.0)
    weights[[0, -1]] *= 0.5
    start = boundaries[piece]
    off = ((times - start) / (boundaries[piece + 1] - start))[:, None] - nodes
    shares = weights / np.where(off == 0.0, 1.0, off)
    # At a node, the state there is the result.
    hit = (off == 0.0).any(axis=1)
    shares[hit] = off[hit] == 0.0
    total = shares.sum(axis=1, keepdims=True)
    with np.errstate(over="ignore", invalid="ignore"):
        states = np.einsum("mj,mjn->mn", shares, steps[piece]) / total
    bad = ~np.isfinite(states).all(axis=1)
    if bad.any():  # states near the largest number: their sum is too large
        weights = shares[bad] / total[bad]
        scaled = SMALLER * steps[piece[bad]]
        with np.errstate(over="ignore", invalid="ignore"):
            states[bad] = np.einsum("mj,mjn->mn", weights, scaled) / SMALLER
    return states
