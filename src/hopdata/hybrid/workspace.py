"""The arrays in which an integration works, allocated once per system and reused.

The driver finds them through a table of addresses (the argument block), because passing
an array from Python to machine code costs as much as a field evaluation. Its results
are copied out.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from math import inf, nan
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike, NDArray

from hopdata.arrays import FloatArray
from hopdata.hybrid import arguments, layout
from hopdata.hybrid.arguments import Limits, Numbers
from hopdata.hybrid.compiled.caught import Caught
from hopdata.hybrid.driver.loop import compiled_first_order, driver_entry
from hopdata.hybrid.known_instants import NONE, Instants
from hopdata.hybrid.methods.table import MethodTable
from hopdata.hybrid.numbers.derivatives import Table
from hopdata.hybrid.solution import EventLog, Form, Solution, event_log

# Room at first, for rows of output, for events, and for changes of the mode besides one
# whole mode; it grows when it is full.
FIRST_ROWS = 256
FIRST_EVENTS = 64
FIRST_CHANGES = 256
# Most rows of output or events that are written before they are set aside, and most
# that a workspace keeps room for until the next integration.
LARGEST_CHUNK = 1 << 16
LARGEST_KEPT = 1 << 13
# Most numbers in a table of rows or events: long states get fewer rows.
LARGEST_ROOM = 1 << 23

# Steps until control returns to Python: at first, and at most.
FIRST_PATIENCE = 16
MOST_PATIENCE = 200_000
PAUSE_S = 0.05  # intended time until control returns to Python

Sink = Callable[[EventLog], object]
# Types that are written without a check: others might have any shape.
PLAIN = (tuple, list)
OPTIONS = "5d4q"  # struct format of the options, in the order of `layout`
WRITE_OPTIONS = struct.Struct(OPTIONS).pack_into
COUNTED = struct.Struct("2q").unpack_from  # numbers of rows and events
COUNTED_CHANGES = struct.Struct("q").unpack_from
# Offsets and lengths in bytes.
CHANGES_AT = 8 * int(layout.CLOCK_SLOTS + layout.CHANGES)
CHANGE_BYTES = 8 * layout.CHANGE_WIDTH
ROWS_AT = 8 * int(layout.CLOCK_SLOTS + layout.ROWS)  # the number of events follows
ASKED_AT = 8 * int(layout.BLOCK_ASKED)
UNKNOWN = -1  # number of parameters before any are given
NOTHING = object()  # equal to no choice of methods
NO_TIMES = np.empty(0)


def _kind_of_stops(system: Any) -> int:
    """Return the value of HAS_STOPS for a system."""
    if not system.takes_instants:
        return 0
    in_all = system.switches.in_all_modes
    return layout.STOPS_IN_ALL_MODES if in_all else layout.STOPS


class Workspace:
    """Memory of one integration at a time.

    Parameters
    ----------
    system : System
        System to integrate.

    Attributes
    ----------
    clock, counts, mode, state : array
        The driver's times and counters, and the present mode and state.
    block_address : int
        Address of the argument block.
    drive : callable
        The driver's entry point.
    caught : Caught
        Collects exceptions of the user's functions.
    methods : MethodTable
        Methods for which room is laid out, available after the first `begin`.
    ready_for : object
        Choice of methods with which an integration may start at once.
    ready_with : bool
        Whether this integration has a Jacobian.
    """

    methods: MethodTable
    _known: Instants | None = None

    def __init__(self, system: Any) -> None:
        n_states = system.n_states
        n_modes = system.n_modes
        n_guards = system.n_guards
        self.block = np.array(system.addresses, dtype=np.int64)
        self._n_states = n_states
        self._n_params = UNKNOWN
        self._n_memory = system.n_memory
        self._n_modes = n_modes
        self._n_guards = n_guards
        self._derivatives = system.derivatives
        self._along: Table | None = None
        self._n_shown = system.n_shown
        self._by_law = system.by_law
        self._rows_per_step = 1
        self._no_memory = (0.0,) * system.n_memory
        self._make_argument_block(0)
        self.block[layout.PATIENCE] = FIRST_PATIENCE
        self.block[layout.BRANCHES] = system.branches.address
        self.block[layout.SWITCHES] = system.switches.address
        self.block[layout.HAS_STOPS] = _kind_of_stops(system)
        self.block[layout.N_VARYING] = system.n_shown
        self._make_clockwork(n_modes)
        self._make_states(layout.W1, n_states)
        self._atol = np.zeros(n_states)
        self._atol_of_all = 0.0
        self._guards = np.zeros((layout.GUARD_ROWS, n_guards))
        self._flags = np.zeros((layout.FLAG_ROWS, n_guards), dtype=np.int64)
        self._lists = np.zeros((layout.LIST_ROWS, n_guards), dtype=np.int64)
        self._wake_at = np.zeros(n_guards)
        self.drive = driver_entry()
        self.caught = Caught(self._remember)
        self.ready_for: object = NOTHING
        self.ready_with = False
        self.tangent: FloatArray | None = None
        self._row_width = 1 + n_states
        self._event_width = int(layout.LOG_STATES) + 2 * n_states
        self._make_rows(FIRST_ROWS)
        self._form = Form.of(system)
        self._make_log(self._form.logged, FIRST_EVENTS)
        self._wanted = np.empty(0)
        self._samples = np.empty((0, n_states))
        self._kept_rows: list[memoryview] = []  # full chunks
        self._kept_events: list[memoryview] = []
        self.sink: Sink | None = None
        self._lay_out(layout.RULES, system.rules, self._atol)
        self._lay_out(
            layout.GUARD_TABLE, self._guards, self._flags, self._lists, self._wake_at
        )
        self._lay_out(layout.WANTED, self._wanted, self._samples)
        self.set_instants(NONE)

    def set_instants(self, known: Instants) -> None:
        """Lay out the known instants of one integration, unless they are laid out."""
        if known is self._known:
            return
        self._known = known
        self._lay_out(layout.SINGLES, known.singles, known.periods)

    def _make_clockwork(self, n_modes: int) -> None:
        """Make times, counters and mode side by side: they are copied out together."""
        lengths = (layout.CLOCK_SLOTS, layout.COUNT_SLOTS, n_modes)
        numbers = np.zeros(sum(lengths))
        self.clock, counts, mode = np.split(numbers, np.cumsum(lengths)[:-1])
        self.counts = counts.view(np.int64)
        self.mode = mode.view(np.int64)
        self._end_bytes = numbers.data.cast("B")
        self._lay_out(layout.MODE, self.mode)
        self._lay_out(layout.CLOCK, self.clock, self.counts)

    def _make_states(self, n_rows: int, n_states: int) -> None:
        """Make the table of states."""
        self._states = np.zeros((n_rows, n_states))
        self.state = self._states[layout.Y]
        self.shown = self.state[: self._n_shown]
        self._lay_out(layout.STATE_TABLE, self._states)

    def _make_argument_block(self, n_params: int) -> None:
        """Make an argument block, then room for state, parameters and memory."""
        n_slots = layout.BLOCK_SLOTS
        n_constants = n_params + self._n_memory
        numbers = np.zeros(n_slots + self._n_states + n_constants)
        # And the parameters with which guards are left out (see `driver.sleep`), and
        # those with which instants were sought (see `driver.known`).
        kept = 2 * (self._n_modes + n_constants) + 2 * n_constants
        self._before_and_after = np.zeros(kept)
        slots = numbers[:n_slots].view(np.int64)
        slots[: len(self.block)] = self.block
        self.block = slots
        self.block_address = numbers.ctypes.data
        self.block[layout.HERE] = self.block_address
        self._start = numbers[n_slots : n_slots + self._n_states]
        self._params = numbers[n_slots + self._n_states :]
        self._block_bytes = numbers.data.cast("B")
        self._write = struct.Struct(f"{OPTIONS}{len(numbers) - n_slots}d").pack_into
        self._lay_out(layout.START_STATE, self._start)
        self._lay_out(layout.PARAMS, self._params)
        self._lay_out(layout.KEPT, self._before_and_after)
        if self._along is not None:
            self._along.make_memory(n_constants)

    def make_params_room(self, count: int) -> None:
        """Make room for `count` parameters of the caller's."""
        if count != self._n_params:
            self._make_argument_block(count)
            self._n_params = count

    def ask_again(  # noqa: C901, PLR0913 (calls would take as long as the request)
        self,
        t_span: Any,
        y0: Any,
        params: Any,
        rtol: Any,
        atol: Any,
        max_step: Any,
        first_step: Any,
        max_steps: Any,
        max_events: Any,
        method: Any,
        jacobian: bool | str,
        t_eval: Any,
        dense: bool,
        keep_events: bool,
    ) -> bool:
        """Write the request if only plain numbers differ from the last one.

        The numbers are written unchecked: the driver checks them in a hundredth of the
        time that Python would take. Whether steps and events are recorded are two of
        these numbers, so a request for less costs no more. Returns whether the request
        was written.
        """
        ready = type(method) is str and method == self.ready_for
        ready = ready and jacobian is self.ready_with
        if not ready or (self.methods.generic and self.methods.wants_own_code()):
            return False
        if type(y0) is ndarray:
            y0 = y0.tolist()
        if type(params) is ndarray:
            params = params.tolist()
        plain = type(y0) in PLAIN and type(params) in PLAIN
        if not plain or len(y0) != self._n_states or len(params) != self._n_params:
            return False
        if first_step is None:
            first_step = 0.0  # to be chosen
        elif type(first_step) is not float or not first_step > 0.0:
            return False
        rows_per_step = 1
        if dense:
            rows_per_step = self.methods.degree
        elif t_eval is not None:
            rows_per_step = 0
        try:
            if not (isinstance(atol, float) and atol == self._atol_of_all):
                self.set_tolerance(atol)
            start, end = t_span
            if not start <= end < inf:
                return False
            self._write(
                self._block_bytes, ASKED_AT,
                start, end, rtol, max_step, first_step,
                max_steps, max_events, rows_per_step, keep_events,
                *y0, *params, *self._no_memory,
            )  # fmt: skip
        except (struct.error, TypeError, ValueError, OverflowError):
            return False
        if t_eval is not None or len(self._wanted) > 0:
            self._want(_times(t_eval, start, end))
        if dense or self._rows_per_step > 1:
            self._record_inside(dense)
        if self.tangent is not None:
            self.tangent[: self._n_states] = self._identity
        return True

    def ask(  # noqa: PLR0913 (each parameter is an option of the user's)
        self,
        system: Any,
        t_span: tuple[float, float],
        y0: ArrayLike,
        params: ArrayLike,
        limits: Limits,
        atol: ArrayLike,
        t_eval: ArrayLike | None,
        method: str,
        jacobian: bool | str,
        memory: ArrayLike | None,
        dense_output: bool,
        keep_events: bool,
    ) -> None:
        """Prepare an integration of any kind, and write the request."""
        options = arguments.check_numbers(t_span, *limits)
        arguments.check_infinite_end(system, options[1], *options[5:])
        dense = arguments.check_flag("dense_output", dense_output)
        times = _times(t_eval, *options[:2])
        wanted = arguments.check_flag("jacobian", jacobian)
        self.begin(system.methods(method, wanted), times, wanted, dense)
        self.methods.specialise()
        state = arguments.check_shape("y0", y0, self._n_states)
        given = arguments.numbers_of("params", params).ravel()
        full = arguments.with_memory(given, memory, self._n_memory)
        system.check_params_length(len(full))
        self.make_params_room(len(given))
        if dense:
            rows_per_step = self.methods.degree
        else:
            rows_per_step = 1 if t_eval is None else 0
        self.write_options(options, rows_per_step, keep_events)
        self._start[:] = state
        self._params[:] = full
        self.set_tolerance(atol)

    def write_options(
        self, options: Numbers, rows_per_step: int, keep_events: bool
    ) -> None:
        """Write the numbers of a request, as `arguments.check_numbers` returns them."""
        WRITE_OPTIONS(self._block_bytes, ASKED_AT, *options, rows_per_step, keep_events)

    def check_pattern(self, n_guards: int, given_mode: bool) -> None:
        """Compare the field with the pattern of its Jacobian, at the start."""
        mode = self.mode.copy()
        if not given_mode:
            mode.fill(0)
        start = float(self.block.view(np.float64)[layout.T_START])
        self.methods.check_pattern(start, self._start, mode, n_guards, self._params)

    def set_tolerance(self, atol: ArrayLike) -> None:
        """Write the absolute tolerance, unless it is unchanged."""
        if isinstance(atol, float) and atol == self._atol_of_all:
            return
        arguments.set_tolerance(self._atol, atol)
        self._atol_of_all = float(atol) if isinstance(atol, float) else nan

    def begin(
        self,
        methods: MethodTable,
        times: FloatArray,
        jacobian: bool,
        dense: bool = False,
    ) -> None:
        """Discard the last integration and prepare output at `times`.

        If `dense`, as many points within each step are recorded as its polynomial
        needs.
        """
        self.ready_for = NOTHING
        if methods is not self.__dict__.get("methods"):
            self._take(methods)
        self._record_inside(dense)
        if jacobian:
            self._begin_tangent(methods)
        elif self.tangent is not None:
            self.tangent = None
            self.block[layout.TANGENT_TABLE] = 0
            self.block[layout.FIRST_ORDER] = 0
        self._kept_rows = []
        self._kept_events = []
        if len(self._rows) > LARGEST_KEPT:
            self._make_rows(LARGEST_KEPT)
        most_changes = len(self._logged) + LARGEST_KEPT
        if len(self._log) > LARGEST_KEPT or len(self._changes) > most_changes:
            self._make_log(len(self._logged), LARGEST_KEPT)
        if len(times) > 0 or len(self._wanted) > 0:
            self._want(times)
        self.ready_for = methods.choice
        self.ready_with = jacobian

    def _record_inside(self, dense: bool) -> None:
        """Record the points within each step, or only its end."""
        self._rows_per_step = self.methods.degree if dense else 1
        if len(self._rows) <= self._rows_per_step:
            self._make_rows(FIRST_ROWS)

    def _want(self, times: FloatArray) -> None:
        """Make room for the states at these times."""
        if len(times) != len(self._wanted):
            self._wanted = np.empty(len(times))
            self._samples = np.empty((len(times), self._n_states))
            self._lay_out(layout.WANTED, self._wanted, self._samples)
        self._wanted[:] = times

    def _begin_tangent(self, methods: MethodTable) -> None:
        """Make room for the flow's Jacobian, which starts as the identity."""
        n = len(self.state)
        if self.tangent is None:
            self.tangent = np.zeros((methods.tangent_rows, n))
            rate_inputs = list(methods.scene.rate_inputs)
            self.tangent[3 * n + layout.RATE_INPUTS, rate_inputs] = 1.0
            self._lay_out(layout.TANGENT_TABLE, self.tangent)
            self.block[layout.FIRST_ORDER] = compiled_first_order().address
            self._along = Table(
                self._derivatives,
                by_field=methods.by_field,
                n_states=n,
                n_guards=self._n_guards,
                n_modes=self._n_modes,
            )
            self._along.make_memory(len(self._params))
            self._lay_out(layout.DUAL_TABLE, self._along.slots)
            self._identity = np.eye(n)
        self.tangent[:n] = self._identity

    def _take(self, methods: MethodTable) -> None:
        """Lay out the room that a new table of methods needs."""
        self.methods = methods
        self.tangent = None
        self.block[layout.TANGENT_TABLE] = 0
        self.block[layout.FIRST_ORDER] = 0
        self._lay_out(layout.METHOD_TABLE, methods.rows)
        needed = layout.W1 + methods.work_rows
        if len(self._states) < needed:
            self._make_states(needed, len(self.state))
        self._states[layout.STRUCTURE, 0] = methods.structure_address

    def enlarge(self) -> None:
        """Set aside what the driver has written where room is short, and make new room.

        Events are handed to the sink if there is one.
        """
        self.ready_for = NOTHING
        rows = int(self.counts[layout.ROWS])
        n_logged = len(self._logged)
        if rows + self._rows_per_step > len(self._rows):
            self._kept_rows.append(self._row_bytes[: rows * self._row_size])
            self.counts[layout.ROWS] = 0
            self._make_rows(min(2 * len(self._rows), LARGEST_CHUNK))
        events, changes = self.counts[[layout.EVENT_ROWS, layout.CHANGES]].tolist()
        due = 1  # events that may be logged at once
        if self._by_law:
            due = max(1, int(self.counts[layout.N_DUE]))
        has_row = events + due <= len(self._log)
        has_change = changes + n_logged <= len(self._changes)
        if has_row and has_change:
            return
        if self.sink is not None:
            self.hand_over()
        elif not has_row:
            self._kept_events.append(self._log_bytes[: events * self._log_size])
            self.counts[layout.EVENT_ROWS] = 0
        if not has_row:
            self._make_event_room(max(due, min(2 * len(self._log), LARGEST_CHUNK)))
        if not has_change:
            self._make_change_room(2 * changes + n_logged)

    def _remember(self) -> None:
        """Store times, counters, mode and state after the last step."""
        self._remembered = self._end_bytes.tobytes(), self.state.copy()

    def reached(self) -> Solution:
        """Return the result of the steps before an exception."""
        self._end_bytes[:], self.state[:] = self._remembered
        return self.solution(layout.RAISED)

    def hand_over(self) -> None:
        """Pass the events in the log to the sink, if there is one."""
        events = int(self.counts[layout.EVENT_ROWS])
        if self.sink is not None and events > 0:
            changes = self._changes[: int(self.counts[layout.CHANGES])].copy()
            log = event_log(self._log[:events].copy(), changes, self._form)
            self.counts[[layout.EVENT_ROWS, layout.CHANGES]] = 0
            self._logged.fill(layout.UNKNOWN)
            self.sink(log)

    @property
    def slope(self) -> FloatArray:
        """The rates of the state."""
        return self._states[layout.K1]

    @property
    def constants(self) -> FloatArray:
        """The parameters and the memory, as the functions see them."""
        return self._params

    @property
    def progress(self) -> str:
        """Progress of the integration, in words."""
        time = self._form.way * self.clock[layout.T]
        n_events = self.counts[layout.EVENTS]
        n_steps = self.counts[layout.STEPS]
        return f"t = {time:.6g}, {n_events} events, {n_steps} steps"

    def be_patient(self, elapsed_s: float) -> None:
        """Set the steps until the next return from the time that the last ones took."""
        steps = int(self.block[layout.PATIENCE]) * PAUSE_S / max(elapsed_s, 1e-9)
        self.block[layout.PATIENCE] = min(max(1, int(steps)), MOST_PATIENCE)

    def solution(self, status: int) -> Solution:
        """Return the result of the integration.

        Its fields are set one by one because the `__init__` of a frozen dataclass takes
        1 us.
        """
        end = self._end_bytes.tobytes()
        n_rows, n_events = COUNTED(end, ROWS_AT)
        (n_changes,) = COUNTED_CHANGES(end, CHANGES_AT)
        rows = self._row_bytes[: n_rows * self._row_size]
        log = self._log_bytes[: n_events * self._log_size]
        changes = self._change_bytes[: n_changes * CHANGE_BYTES].tobytes()
        if self._form.slides is not None:
            status = int(self._form.slides.status(np.array(status), self.mode))
        solution = object.__new__(Solution)
        fields = solution.__dict__
        fields["status"] = status
        fields["y_end"] = self.shown.copy()
        fields["form"] = self._form
        trajectory: bytes | None = rows.tobytes()
        events = log.tobytes()
        if self._kept_rows or self._kept_events:
            trajectory = b"".join([*self._kept_rows, rows])
            events = b"".join([*self._kept_events, log])
        if self._rows_per_step > 1:
            fields["dense"] = self._rows_per_step, trajectory
            trajectory = None  # its rows are among those of `dense`
        if len(self._wanted) > 0:
            trajectory = self._sampled()
        fields["parts"] = end, trajectory, events, changes
        fields["jacobian"] = None
        if self.methods.by_differences:
            fields["by_differences"] = self.methods.by_differences
        if self.tangent is not None:
            shown = self._n_shown
            fields["jacobian"] = self.tangent[:shown, :shown].copy()
            fields["jacobian_error"] = grown_error(self.tangent)
            if shown < self._n_states:
                fields["sensitivity"] = self.tangent[:shown, shown:].copy()
            assert self._along is not None
            told = self.methods.by_differences, self._along.told
            fields["by_differences"] = "; ".join(one for one in told if one)
        return solution

    def _sampled(self) -> bytes:
        """Return the requested times that were reached and the states there."""
        count = int(self.counts[layout.SAMPLES])
        table = np.empty((count, self._row_width))
        table[:, 0] = self._wanted[:count]
        table[:, 1:] = self._samples[:count]
        return table.tobytes()

    def _make_rows(self, count: int) -> None:
        """Make and lay out room for rows, with fewer of them if the states are long."""
        most = max(1 + self._rows_per_step, LARGEST_ROOM // self._row_width)
        self._rows = np.empty((min(count, most), self._row_width))
        self._row_size = self._rows.strides[0]
        self._row_bytes = self._rows.data.cast("B")
        self.block[layout.N_ROWS] = len(self._rows)
        self._lay_out(layout.ROW_TABLE, self._rows)

    def _make_log(self, n_logged: int, n_events: int) -> None:
        """Make and lay out the log: room for events, and for changes of the mode."""
        self._logged = np.full(n_logged, layout.UNKNOWN)
        self._changes = np.empty((0, layout.CHANGE_WIDTH), dtype=np.int64)
        self._make_event_room(n_events)
        self._make_change_room(n_logged + FIRST_CHANGES)
        self._lay_out(layout.LOGGED, self._logged)

    def _make_event_room(self, count: int) -> None:
        """Make and lay out room for events, for fewer if the states are long."""
        most = max(1, LARGEST_ROOM // self._event_width)
        if self._by_law:
            most = max(most, self._flags.shape[1])
        self._log = np.empty((min(count, most), self._event_width))
        self._log_size = self._log.strides[0]
        self._log_bytes = self._log.data.cast("B")
        self.block[layout.N_LOG_ROWS] = len(self._log)
        self._lay_out(layout.LOG_TABLE, self._log)

    def _make_change_room(self, count: int) -> None:
        """Make and lay out room for changes of the mode, after those that are there."""
        room = np.empty((count, layout.CHANGE_WIDTH), dtype=np.int64)
        room[: len(self._changes)] = self._changes
        self._changes = room
        self._change_bytes = room.data.cast("B")
        self.block[layout.N_CHANGES] = len(room)
        self._lay_out(layout.CHANGE_TABLE, room)

    def _lay_out(self, first: int, *arrays: NDArray[Any]) -> None:
        """Write address and width of each array to the block, from slot `first` on."""
        for slot, array in enumerate(arrays):
            place = first + 2 * slot
            self.block[place] = array.ctypes.data
            self.block[place + 1] = array.shape[-1]


def _times(t_eval: Any, start: float, end: float) -> FloatArray:
    """Return the requested times; none if only the end is wanted, or each step."""
    if t_eval is None or (type(t_eval) in PLAIN and len(t_eval) == 0):
        return NO_TIMES
    return arguments.check_times(t_eval, start, end)


class Pool(list[Workspace]):
    """Workspaces not in use. A thread takes one, or makes one, and gives it back.

    A copy of a pool is empty, because a workspace holds the addresses of its own
    arrays.
    """

    def __reduce__(self) -> tuple[type[Pool], tuple[()]]:
        return Pool, ()


def grown_error(tangent: FloatArray) -> float:
    """Return the largest error of a column of the Jacobian, in the column's size.

    The errors of all steps have grown since as that column of the state has that grew
    most: an error need not lie along its own column.
    """
    n = tangent.shape[1]
    singles = 3 * n
    sizes = tangent[singles + layout.PHI_SIZE]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        columns = (np.abs(tangent[:n]) / sizes[:, None]).max(axis=0)
        grown = tangent[singles + layout.PHI_GROWN :][:n] * columns
        relative = grown.max(axis=1) / columns
    own = tangent[singles + layout.PHI_ERROR]
    found = np.where(columns > 0.0, relative, 0.0)
    return float(np.fmax(found, own).max())
