"""Back from the end of a step to its start.

A line belongs here if it knows the stages of a method. They are recorded again from the
state at the start of the step, one after the other, and read in the opposite order.
"""

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.compiled.memory import int_table
from hopdata.hybrid.gradients.recorders import Recorders
from hopdata.hybrid.gradients.sweep import clear, is_full, rewind, sweep
from hopdata.hybrid.gradients.tape import CELLS, IN_USE
from hopdata.hybrid.gradients.user_functions import field
from hopdata.hybrid.gradients.workspace import BY_STATE, SCRATCH, Room, Tableau


@kernel_apart
def record_stages(
    code: Recorders,
    room: Room,
    method: Tableau,
    t: float,
    dt: float,
    y: FloatArray,
    mode: IntArray,
) -> None:
    """Record the stages of a step, one after the other."""
    n = len(y)
    state = room.rows[SCRATCH]
    places = int_table(room.dy.ctypes.data, CELLS)
    for k in range(len(method.b)):
        for i in range(n):
            total = 0.0
            for j in range(k):
                total += method.a[k, j] * room.slopes[j, i]
            state[i] = y[i] + dt * total
        room.stage_bounds[k, 0] = room.links[IN_USE]
        field(code, room, t + method.c[k] * dt, state, mode)
        room.stage_bounds[k, 1] = room.links[IN_USE]
        for i in range(n):
            room.slopes[k, i] = room.dy[i, 0]
            room.slope_places[k, i] = places[i, 1]


@kernel_apart
def sweep_stages(room: Room, method: Tableau, dt: float, n: int) -> None:
    """Read the stages of a step backward, and carry the derivative to its start."""
    by_state = room.rows[BY_STATE]
    n_stages = len(method.b)
    for k in range(n_stages - 1, -1, -1):
        begins = room.stage_bounds[k, 0]
        for i in range(n):
            weight = method.b[k] * by_state[i]
            for j in range(k + 1, n_stages):
                weight += method.a[j, k] * room.by_stage[j, i]
            if room.slope_places[k, i] > 0:
                room.adjoint[room.slope_places[k, i]] += dt * weight
        sweep(room, begins + n, room.stage_bounds[k, 1])
        for i in range(n):
            room.by_stage[k, i] = room.adjoint[begins + i]
    for k in range(n_stages):
        for i in range(n):
            by_state[i] += room.by_stage[k, i]


@kernel
def step_back(
    code: Recorders,
    room: Room,
    method: Tableau,
    t: float,
    dt: float,
    y: FloatArray,
    mode: IntArray,
) -> bool:
    """Go back from the end of a step to its start; False if it was in vain.

    It is in vain if the tape is too short.
    """
    first = rewind(room, len(room.params))
    record_stages(code, room, method, t, dt, y, mode)
    if is_full(room):
        return False
    clear(room, first)
    sweep_stages(room, method, dt, len(y))
    return True
