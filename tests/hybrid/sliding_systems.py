"""Systems that slide along their guards, with exact answers."""

import numpy as np

from hopdata.hybrid import System, field, guards, on_event


@field
def relay_field(t, y, mode, params, dy):
    dy[0] = params[0] * np.sin(t) - mode[0]


@guards
def first_state(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0], dy[0]
    if t > 0.9:
        h[0] += params[1]


@field
def dry_field(t, y, mode, params, dy):  # place (m), velocity
    # params: kinetic friction, speed of the belt, static friction
    friction = params[0]
    if mode[1] > 0:
        friction = params[2]
    dy[0] = y[1]
    dy[1] = -y[0] - friction * mode[0]


@guards
def slip(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[1] - params[1], dy[1]


@on_event
def sticks(t, y, mode, params, guard, direction):
    # Static friction may hold where the kinetic one lets the block cross (1 or -1).
    mode[1] = 0
    if abs(direction) <= 2 and abs(y[0]) < params[2]:
        mode[1] = 1
    return 0


# A block of 1 kg on a spring of 1 N/m, on a belt.
dry = System(
    dry_field,
    slip,
    sticks,
    n_states=2,
    guard_names=("slip",),
    sliding=("slip",),
    n_extra_modes=1,
)


@field
def foot_field(t, y, mode, params, dy):  # x and z (m) of a foot of 1 kg, their rates
    # params: friction, speed of the body that draws it (m/s), a blow (m/s), a mark
    lift = -12.0 * np.sin(6.0 * t)  # N
    dy[0], dy[1], dy[2] = y[2], y[3], 40.0 * (params[1] * t - y[0])
    dy[3] = lift - 9.81
    if mode[0] > 0:
        dy[2] -= params[0] * (9.81 - lift) * mode[1]
        dy[3] = 0.0


@guards
def floor_and_slip(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = -y[1], -dy[1]
    if mode[0] > 0:  # how hard the floor presses
        h[0], hdot[0] = 9.81 + 12.0 * np.sin(6.0 * t), 72.0 * np.cos(6.0 * t)
    h[1], hdot[1] = y[2], dy[2]


@on_event
def plastic(t, y, mode, params, guard, direction):
    if guard == 0 and direction > 0:
        most = -params[0] * y[3]
        blow = min(max(y[2], -most), most)
        if params[2] != 0.0:
            blow = params[2]
        y[2] -= blow
        y[3] = 0.0
    elif guard == 1:
        mode[2] += int(params[3])
    return 0


# A foot that lands with a plastic impact, sticks or slips, and is lifted again.
foot = System(
    foot_field,
    floor_and_slip,
    plastic,
    n_states=4,
    guard_names=("floor", "slip"),
    sliding=("slip",),
    n_extra_modes=1,
)


@field
def folded_field(t, y, mode, params, dy):  # params: bend of the surface
    if mode[0] > 0:
        dy[0], dy[1] = 1.0, y[0] - 1.0
    else:
        dy[0], dy[1] = 2.0, 1.0
    dy[1] += 2.0 * params[0] * y[0] * dy[0]


@guards
def parabola(t, y, dy, mode, params, h, hdot):
    h[0] = y[1] - params[0] * y[0] ** 2
    hdot[0] = dy[1] - 2.0 * params[0] * y[0] * dy[0]


# Slides along the parabola where x < 1, up to the fold of the upper field, with
# x' = (3 - 2 x) / (2 - x).
folded = System(
    folded_field, parabola, n_states=2, guard_names=("line",), sliding=("line",)
)


@field
def corner_field(t, y, mode, params, dy):
    dy[0] = -2.0 * mode[0] + params[0] * mode[1]
    dy[1] = -1.0 * mode[1] + params[1] * mode[0] + params[2] * mode[0] * mode[1]
    dy[2] = 1.0 + mode[0] + mode[1]


@guards
def both_states(t, y, dy, mode, params, h, hdot):
    h[0], h[1] = y[0], y[1]
    hdot[0], hdot[1] = dy[0], dy[1]


corner = System(
    corner_field,
    both_states,
    n_states=3,
    guard_names=("x", "y"),
    sliding=("x", "y"),
)


@on_event
def note(t, y, mode, params, guard, direction):
    mode[1] = 10 * mode[1] + direction
    mode[2] = mode[0]
    return 0


# y' = a sin(t) - sign(y): at rest while abs(a sin(t)) < 1. Its guard has a second
# parameter added to it from 0.9 s on, which is zero but in one test.
relay = System(
    relay_field,
    first_state,
    note,
    n_states=1,
    guard_names=("zero",),
    sliding=("zero",),
    n_extra_modes=2,
)
