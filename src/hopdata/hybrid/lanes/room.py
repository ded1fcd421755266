"""The memory of the lanes, and the calls of the system's functions.

All that the lanes know is in a record of rows and tables, the room. It is read from an
argument block, which `batch` fills.
"""

from itertools import accumulate
from typing import Any

from numba import types

from hopdata.hybrid.compiled.kernel import FLOATS, ON_EVENT, TABLE, caller, kernel
from hopdata.hybrid.compiled.memory import View
from hopdata.hybrid.compiled.records import Record, reader_of
from hopdata.hybrid.lanes import method, vectors
from hopdata.hybrid.lanes.vectors import ALL, WIDTH, fma

# Rows of `book`, integers by lane: the system, events, samples written, guards that
# flip now as bits, guards whose locks are open as bits, the guard that ended the run,
# and its status. For each group of lanes with the same modes: its first lane, and its
# members as bits. The number of groups.
INDEX = 0
EVENTS = 1
SAMPLES = 2
DUE = 3
OPEN = 4
CULPRIT = 5
STATUS = 6
LEAD = 7
MEMBERS = 8
N_GROUPS = 9

# Of the present instant: the guard that flipped last (-1: none yet), whether its
# handler changed the state, and the guards that have flipped once and twice, as bits.
LAST = 10
JUMPED = 11
ONCE = 12
TWICE = 13
BOOK_ROWS = 14

# Rows of `course`, numbers by lane: time; length of the next step and of the last one;
# the length to resume after a flip that is aimed at; tries of this step; net number of
# steps too near the stability limit; tries and steps of the run; idle steps in a row;
# steps that ended in a flip; time of the last flip; steps cut on the interpolant.
TIME = 0
NEXT_STEP = 1
LAST_STEP = 2
RESUME = 3
TRIES = 4
STIFF = 5
TRIED = 6
TAKEN = 7
IDLE = 8
LANDED = 9
HIT = 10
CUTS = 11
COURSE_ROWS = 12

RANGE = 4  # rows of a range: lower and upper end of the value, and of the rate

# Rows of `aim`: where the first guard flips, as a fraction of the step.
AIM_ROWS = 1
LOCATION = 0

GIVEN_UP = -100  # status of a system left to the driver

# The rows that are as long as the state, and how many of each.
#
# y, end: states at the start and at the end of the step; k: slopes of the stages, of
# the end, and of the dense stages; moved: the end, moved to the flip; dense: the
# interpolant; ranges: ranges of value and slope over the step (four rows for each
# component); work, other: scratch.
STATES = {
    "y": 1,
    "k": method.SLOPES,
    "end": 1,
    "moved": 1,
    "work": 1,
    "other": 1,
    "dense": method.DENSE,
    "ranges": RANGE,
}

# The rows that are as long as there are guards.
#
# h0, rate0 at the start, h1, rate1 at the end of the step, h, rate at another place;
# size: largest recent value, the scale of rounding; leaving: 1 where a guard is at its
# surface, on its new side; lock; bend: change of the rate in the last step; other_h,
# other_rate: scratch.
GUARDS = (
    "h0", "rate0", "h", "rate", "h1", "rate1", "size", "leaving", "lock", "bend",
    "other_h", "other_rate",
)  # fmt: skip

# Other rows: `aim`; and ranges of guards over the step (four rows for each), and of
# other lanes.
SCRATCH = ("aim", "limits", "other_limits")

ROWS = vectors.Rows(None)
INTS = View(types.int64, 2)

# What the room holds, in the order of the argument block.
#
# By lane: the rows above; table: all rows, from y on; locks; params, or one row that
# all share; modes: a row for each; own_params: the parameters as a row for each; book;
# blocks: address of an argument block of the driver for each lane, with the memory in
# which its steps are proven. Of one lane, for the handler: own.
# read: places of the mode that are read; rules: of the layout. The next are given to
# `solve_batch` or returned by it, as in `driver.loop`: `given` are the parameters, and
# `mode` is the mode at the start. n_own: number of parameters of each lane, 0 if
# shared; n_given: number of rows of `given`; handler, field,
# guards, ranged: addresses (ranged: of the guards for ranges of lanes, 0: none).
ITEMS = {
    **dict.fromkeys((*STATES, *SCRATCH, "course", *GUARDS), ROWS),
    **dict.fromkeys(("table", "locks", "params", "own", "own_params"), TABLE),
    **dict.fromkeys(("modes", "book", "blocks", "read", "rules"), INTS),
    "y0": TABLE,
    "given": TABLE,
    "mode": INTS,
    "status": INTS,
    "ends": TABLE,
    "end_modes": INTS,
    "counts": INTS,
    "samples": TABLE,
    "times": FLOATS,
    "atol": FLOATS,
    "t_start": types.float64,
    "t_end": types.float64,
    "rtol": types.float64,
    "max_step": types.float64,
    "first_step": types.float64,
    "max_steps": types.int64,
    "max_events": types.int64,
    "n": types.int64,
    "n_guards": types.int64,
    "n_own": types.int64,
    "n_given": types.int64,
    "handler": types.int64,
    "field": types.int64,
    "guards": types.int64,
    "ranged": types.int64,
}


def _places_in_block() -> dict[str, tuple[Any, int]]:
    """Return type and first slot of each item; a view takes two: address and width."""
    places = {}
    slot = 0
    for name, kind in ITEMS.items():
        places[name] = (kind, slot)
        slot += 2 if isinstance(kind, View) else 1
    return places


ROOM = Record("Room", _places_in_block())
room = reader_of(ROOM)
state = vectors.part(None)


def first_rows(n: int, n_guards: int) -> dict[str, int]:
    """Return the first row of each part of the table.

    The parameters are the last part.
    """
    lengths = {name: count * n for name, count in STATES.items()}
    lengths["aim"] = AIM_ROWS
    lengths["limits"] = RANGE * n_guards
    lengths["other_limits"] = RANGE * n_guards
    lengths["course"] = COURSE_ROWS
    for name in GUARDS:
        lengths[name] = n_guards
    first = accumulate(lengths.values(), initial=0)
    return dict(zip([*lengths, "params"], first, strict=True))


# The system's functions.


def natives(states: Any, margins: Any) -> tuple[Any, Any]:
    """Return the signatures of field and guards, for rows of states and of guards."""
    field = types.void(vectors.lanes, states, ROOM, states)
    guards = types.void(vectors.lanes, states, states, ROOM, margins, margins)
    return field, guards


_FIELD, _GUARDS = natives(ROWS, ROWS)
call_field = caller(_FIELD)
call_guards = caller(_GUARDS)
RANGED = types.void(vectors.lanes, vectors.lanes, ROOM)  # start and end of the step
call_ranged = caller(RANGED)
call_on_event = caller(ON_EVENT.native)


@kernel
def group(r: Any) -> None:
    """Group the lanes by the entries of the mode that are read."""
    left = ALL
    count = 0
    for first in range(WIDTH):
        if left >> first & 1:
            same = left
            for q in range(r.read.width):
                i = r.read[0, q]
                unlike = 0
                for j in range(WIDTH):
                    unlike |= 1 << j if r.modes[j, i] != r.modes[first, i] else 0
                same &= ~unlike
            r.book[LEAD, count] = first
            r.book[MEMBERS, count] = same
            left &= ~same
            count += 1
    r.book[N_GROUPS, 0] = count


@kernel
def interpolate(theta: Any, r: Any) -> None:
    """Write the states at `theta` of the steps into `work`."""
    count = method.DENSE
    rest = 1.0 - theta
    for i in range(r.n):
        value = r.dense[count * i + count - 1]
        for q in range(count - 2, -1, -1):
            factor = rest if q % 2 == 0 else theta
            value = fma(factor, value, r.dense[count * i + q])
        r.work[i] = fma(theta, value, r.y[i])


@kernel
def give_up(lanes: int, r: Any) -> int:
    """Leave these lanes' systems to the driver; return the lanes."""
    for j in range(WIDTH if lanes != 0 else 0):
        if lanes >> j & 1:
            r.book[STATUS, j] = GIVEN_UP
    return lanes
