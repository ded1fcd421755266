"""Forward once more: the mode and the parameters after each flip.

A solution keeps the states of its events, but neither the mode nor the memory, which
handlers change. So the handlers are called again, in order, before the pass begins.
"""

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import copy, kernel_apart
from hopdata.hybrid.gradients.recorders import Recorders
from hopdata.hybrid.gradients.sweep import begin_tape, is_full
from hopdata.hybrid.gradients.user_functions import handler
from hopdata.hybrid.gradients.workspace import (
    NOT_REPEATED,
    TAPE_FULL,
    Flips,
    Room,
    Run,
)

#: Largest difference of the state after a handler from that of the solution.
#: Unit: 1, of the state. Origin: rounding: both are the same code on the same numbers.
SAME = 1e-12


@kernel_apart
def repeats(room: Room, flips: Flips, e: int) -> bool:
    """Return whether the state that a handler left is that of the solution."""
    for i in range(flips.after.shape[1]):
        off = abs(room.y[i, 0] - flips.after[e, i])
        if not off <= SAME * (abs(flips.after[e, i]) + abs(flips.before[e, i])):
            return False
    return True


@kernel_apart
def replay(code: Recorders, room: Room, run: Run) -> int:
    """Fill the modes and parameters after the first; return a status."""
    flips = run.flips
    modes = run.replayed.mode
    params = run.replayed.params
    for e in range(len(flips.row)):
        begin_tape(room, params[e])
        mode = modes[e + 1]
        copy(modes[e], mode)
        k = flips.guard[e]
        mode[k] = flips.direction[e]
        copy(params[e], params[e + 1])
        if flips.counts[e] == 0:
            continue
        t = run.steps.t[flips.row[e]]
        handler(code, room, t, flips.before[e], mode, k, flips.direction[e])
        if is_full(room):
            return TAPE_FULL
        if not repeats(room, flips, e):
            return NOT_REPEATED
        for j in range(len(room.changed)):
            params[e + 1, j] = room.changed[j, 0]
    return at.RUNNING
