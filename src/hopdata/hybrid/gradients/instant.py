"""Back across the flips of one instant.

Several flips at one instant are a sequence. A line belongs here if it decides how many
guards met their surfaces: the other flips only follow. What is then done stands in
`event`, for one guard, and in `together`, for several.
"""

from hopdata.arrays import FloatArray
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.gradients.event import event_back
from hopdata.hybrid.gradients.onto_surface import flips_before, neighbours_follow
from hopdata.hybrid.gradients.recorders import Recorders
from hopdata.hybrid.gradients.surface import MET, has_met
from hopdata.hybrid.gradients.sweep import begin_tape, is_full
from hopdata.hybrid.gradients.together import together_back
from hopdata.hybrid.gradients.user_functions import field_value, guards
from hopdata.hybrid.gradients.workspace import (
    F_BEFORE,
    TAPE_FULL,
    FlipInstant,
    Flips,
    Room,
    Run,
)


@kernel
def first_of_instant(flips: Flips, last: int) -> int:
    """Return the number of the first flip at the instant of flip `last` - 1."""
    first = last - 1
    while first > 0 and flips.row[first - 1] == flips.row[last - 1]:
        first -= 1
    return first


@kernel
def instant_of(run: Run, last: int) -> FlipInstant:
    """Return the instant of flip `last` - 1."""
    times = run.steps.t
    rows = run.flips.row
    first = first_of_instant(run.flips, last)
    t = times[rows[first]]
    before = 0
    if first > 0:
        before = rows[first - 1]
    span = times[len(times) - 1] - times[0]
    return FlipInstant(t, t - times[before], span, first, last)


@kernel_apart
def n_met(code: Recorders, room: Room, run: Run, instant: FlipInstant) -> int:
    """Return how many guards met their surfaces at an instant."""
    first = instant.first
    y = run.flips.before[first]
    mode = run.replayed.mode[first]
    begin_tape(room, run.replayed.params[first])
    field_value(code, room, instant.t, y, mode, F_BEFORE)
    total = 1
    for e in range(first + 1, instant.last):
        k = run.flips.guard[e]
        is_new = not flips_before(run.flips, instant, e)
        if is_new and has_met(code, room, k, instant, y, mode):
            total += 1
    return total


@kernel
def flips_here(flips: Flips, instant: FlipInstant, k: int) -> bool:
    """Return whether guard k flips at an instant."""
    found = False
    for e in range(instant.first, instant.last):
        found = found or flips.guard[e] == k
    return found


@kernel_apart
def turns_another_back(
    code: Recorders, room: Room, run: Run, instant: FlipInstant
) -> bool:
    """Return whether a guard has met its surface at an instant, and does not flip.

    The flip of another one turns it back. Neighbours that meet it first cross it.
    """
    first = instant.first
    y = run.flips.before[first]
    mode = run.replayed.mode[first]
    begin_tape(room, run.replayed.params[first])
    field_value(code, room, instant.t, y, mode, F_BEFORE)
    guards(code, room, instant.t, y, mode)
    for k in range(len(room.h)):
        rate = room.hdot[k, 0]
        approaches = rate * mode[k] < 0.0
        met = abs(room.h[k, 0]) <= MET * instant.since * abs(rate)
        if approaches and met and not flips_here(run.flips, instant, k):
            return True
    return False


@kernel_apart
def instant_back(
    code: Recorders,
    room: Room,
    run: Run,
    instant: FlipInstant,
    ends: bool,
    by_end: float,
    found: FloatArray,
) -> int:
    """Carry the derivatives across an instant; return a status.

    `ends` says whether the run ends there, and `by_end` is the derivative of the loss
    by the run's end. The losses of events are added to `found[0]`.
    """
    together = False
    if instant.last - instant.first > 1:
        together = n_met(code, room, run, instant) > 1
    if (together and ends) or turns_another_back(code, room, run, instant):
        status = at.TIE_IN_JACOBIAN
    elif together:
        status = together_back(code, room, run, instant, found)
    elif not neighbours_follow(code, room, run, instant):
        status = at.TIE_IN_JACOBIAN
    else:
        status = event_back(code, room, run, instant, ends, by_end, found)
    if is_full(room):
        return TAPE_FULL
    return status
