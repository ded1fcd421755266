"""How a body lands on its legs: equations of motion, integrated by RK4 in steps of 1 ms.

It shares no code with the scenes, the synthesis and the integrator of hopdata. Numba
compiles it. A state holds position, yaw, pitch, roll, velocity (world) and spin (body);
`bodies` draws the bodies, and says what inputs and outcomes hold.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

GRAVITY = 9.81
STEP_S = 1e-3
LONGEST_S = 0.4
SLOW_SLIP_M_S = 0.15  # below it friction is viscous
ROUNDING_S = 1e-15

SLIDING, PIVOTING, HERTZ, TELESCOPIC = range(4)
LEGS = ["sliding", "pivoting", "hertz", "telescopic"]

MECHANISMS = [
    "c1",
    "clutch",  # legs push more until all feet stand
    "reflex",  # a foot pushes the more, the later it comes
    "damping",  # a foot that stands alone damps more
    "side",  # a foot that stands alone pushes outwards
    "twist",  # the body is turned from the first contact until all feet stand
    "friction",  # a foot that stands alone has more friction
    "stick",  # a foot that stands alone sticks, after a few milliseconds
    "sated",  # a reflex that is full after 5 ms
    "decay",  # legs push more until all feet stand, less so after 5 ms
    "rank",  # a leg pushes the more, the more feet stand when it lands
    "latch",  # the first leg becomes stiffer for good when the second foot lands
    "impact",  # a foot loses a share of its speed at its contact
]
(
    C1,
    CLUTCH,
    REFLEX,
    DAMPING,
    SIDE,
    TWIST,
    FRICTION,
    STICK,
    SATED,
    DECAY,
    RANK,
    LATCH,
    IMPACT,
) = range(len(MECHANISMS))


class Build(NamedTuple):
    """What the equations of motion need: a body of F legs.

    `hips` (F, 3), m, in the body about its centre of mass; `leg` and `mechanism` are
    numbers of `LEGS` and `MECHANISMS`; `load` is the mean force of a leg, N.
    """

    mass: float
    inertia: np.ndarray
    centre: np.ndarray
    hips: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    preload: np.ndarray
    friction: float
    leg: int
    mechanism: int
    strength: float
    load: float
    reach: float


# The equations of motion. A state holds position, yaw, pitch, roll, velocity (world) and
# spin (body). `touched` (F,) are the contact instants, inf before; `anchors` (F, 2) the
# places of the contacts. `wear` holds factors of the legs' force and of friction.


@njit(cache=True)
def rotation(yaw, pitch, roll):
    cy, sy = np.cos(yaw), np.sin(yaw)
    cp, sp = np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    turn = np.empty((3, 3))
    turn[0] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    turn[1] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    turn[2] = -sp, cp * sr, cp * cr
    return turn


@njit(cache=True)
def turned(turn, v):
    return (
        turn[0, 0] * v[0] + turn[0, 1] * v[1] + turn[0, 2] * v[2],
        turn[1, 0] * v[0] + turn[1, 1] * v[1] + turn[1, 2] * v[2],
        turn[2, 0] * v[0] + turn[2, 1] * v[1] + turn[2, 2] * v[2],
    )


@njit(cache=True)
def crossed(a, b):
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@njit(cache=True)
def point_motion(s, turn, point):
    """Return place and velocity in the world of a point of the body."""
    arm = turned(turn, point)
    swing = turned(turn, crossed(s[9:12], point))
    place = (s[0] + arm[0], s[1] + arm[1], s[2] + arm[2])
    velocity = (s[6] + swing[0], s[7] + swing[1], s[8] + swing[2])
    return place, velocity


@njit(cache=True)
def mechanism_of_push(i, t, touched, build):
    """Return an extra force (share of the load), and factors of push and damping."""
    standing = np.sum(touched < np.inf)
    not_all = standing < len(touched)
    first = touched.min()
    delay = touched[i] - first
    strength = build.strength
    extra = 0.0
    factor = 1.0
    damping = 1.0
    if build.mechanism == CLUTCH and not_all:
        extra = strength
    elif build.mechanism == REFLEX:
        extra = strength * min(delay / 0.010, 4.0)
    elif build.mechanism == SATED:
        extra = strength * min(delay / 0.005, 1.0)
    elif build.mechanism == DECAY and not_all:
        extra = strength * np.exp(-(t - first) / 0.005)
    elif build.mechanism == DAMPING and standing == 1:
        damping = 1.0 + strength
    elif build.mechanism == RANK:
        factor = 1.0 + strength * (np.sum(touched < touched[i]) - 1)
    elif build.mechanism == LATCH and delay == 0.0 and standing > 1:
        factor = 1.0 + strength
    return extra, max(0.0, factor), damping


@njit(cache=True)
def push_of(i, depth, rate, modified, wear, build):
    """Return the force along a leg that is compressed by `depth` at this rate, N."""
    extra, factor, damping = modified
    stiffness = build.stiffness[i]
    damping = damping * build.damping[i]
    if build.leg == HERTZ:
        depth = max(0.0, depth)
        # As stiff as the others at a depth of 0.1 m, and damped in proportion.
        onset = stiffness * depth * np.sqrt(depth / 0.1)
        push = onset * (1.0 + 0.3 * rate) + 0.3 * (damping - build.damping[i]) * rate
    else:
        push = build.preload[i] + stiffness * depth * (1.0 + 2.0 * depth)
        push += damping * rate
    return wear[0] * max(0.0, (push + extra * build.load) * factor)


@njit(cache=True)
def drag_of(velocity, push, alone, wear, build):
    """Return the horizontal force of the floor on a foot that moves over it, N."""
    speed = np.sqrt(velocity[0] ** 2 + velocity[1] ** 2 + SLOW_SLIP_M_S**2)
    friction = wear[1] * build.friction
    if build.mechanism == FRICTION and alone:
        friction = friction * (1.0 + build.strength)
    viscous = friction * push / speed
    if build.mechanism == STICK and alone:
        viscous += build.strength * 0.2 * build.mass / 0.004
    return -viscous * velocity[0], -viscous * velocity[1]


@njit(cache=True)
def leg_force(i, t, s, turn, feet, contacts, wear, build):
    """Return the force of leg i on the body (world), and where it acts (body)."""
    touched, anchors = contacts
    modified = mechanism_of_push(i, t, touched, build)
    standing = np.sum(touched < np.inf)
    if build.leg == PIVOTING:
        at = build.hips[i]
        hip, velocity = point_motion(s, turn, at)
        along = (hip[0] - anchors[i, 0], hip[1] - anchors[i, 1], hip[2])
        length = np.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
        rest = np.sqrt(np.sum((at - feet[i]) ** 2))
        axis = (along[0] / length, along[1] / length, along[2] / length)
        rate = -(axis[0] * velocity[0] + axis[1] * velocity[1] + axis[2] * velocity[2])
        push = push_of(i, rest - length, rate, modified, wear, build)
        force = (push * axis[0], push * axis[1], push * axis[2])
    else:
        at = feet[i]
        foot, velocity = point_motion(s, turn, at)
        axis = (0.0, 0.0, 1.0)
        if build.leg == TELESCOPIC:
            own = build.hips[i] - at
            axis = turned(turn, own / np.sqrt(np.sum(own**2)))
        depth = -foot[2] / axis[2]
        rate = -velocity[2] / axis[2]
        push = push_of(i, depth, rate, modified, wear, build)
        drag = drag_of(velocity, push, standing == 1, wear, build)
        force = (push * axis[0] + drag[0], push * axis[1] + drag[1], push * axis[2])
    if build.mechanism == SIDE and standing == 1:
        outward = turned(turn, np.array([feet[i, 0], feet[i, 1], 0.0]))
        size = build.strength * build.load / build.reach
        force = (force[0] + size * outward[0], force[1] + size * outward[1], force[2])
    return force, at


@njit(cache=True)
def rate_of_change(s, t, feet, contacts, wear, build):
    touched = contacts[0]
    turn = rotation(s[3], s[4], s[5])
    w = s[9:12]
    pull = np.array([0.0, 0.0, -build.mass * GRAVITY])
    torque = np.zeros(3)
    for i in range(len(touched)):
        if touched[i] < np.inf:
            force, at = leg_force(i, t, s, turn, feet, contacts, wear, build)
            own = turned(turn.T, force)
            moment = crossed(at, own)
            for k in range(3):
                pull[k] += force[k]
                torque[k] += moment[k]
    standing = np.sum(touched < np.inf)
    if build.mechanism == TWIST and 0 < standing < len(touched):
        torque[2] += build.strength * build.load * build.reach

    momentum = build.inertia * w
    gyration = crossed(w, momentum)
    ds = np.empty(12)
    ds[0:3] = s[6:9]
    across = w[1] * np.sin(s[5]) + w[2] * np.cos(s[5])
    ds[3] = across / np.cos(s[4])
    ds[4] = w[1] * np.cos(s[5]) - w[2] * np.sin(s[5])
    ds[5] = w[0] + across * np.tan(s[4])
    ds[6:9] = pull / build.mass
    for k in range(3):
        ds[9 + k] = (torque[k] - gyration[k]) / build.inertia[k]
    return ds


@njit(cache=True)
def stepped(s, t, h, feet, contacts, wear, build):
    """Return the state a time h later (RK4)."""
    half = t + h / 2
    a = rate_of_change(s, t, feet, contacts, wear, build)
    b = rate_of_change(s + h / 2 * a, half, feet, contacts, wear, build)
    c = rate_of_change(s + h / 2 * b, half, feet, contacts, wear, build)
    d = rate_of_change(s + h * c, t + h, feet, contacts, wear, build)
    return s + h / 6 * (a + 2 * b + 2 * c + d)


@njit(cache=True)
def height(s, point):
    """Return the height of a point of the body, and its rate."""
    turn = rotation(s[3], s[4], s[5])
    place, velocity = point_motion(s, turn, point)
    return place[2], velocity[2]


@njit(cache=True)
def crossing(s, t, point, level, motion):
    """Return when a point reaches a level within the next step (Newton)."""
    feet, contacts, wear, build = motion
    h = STEP_S / 2
    for _ in range(12):
        later = stepped(s, t, h, feet, contacts, wear, build)
        above, rate = height(later, point)
        change = (above - level) / rate
        h -= change
        if abs(change) < ROUNDING_S:
            break
    return h


@njit(cache=True)
def strike(s, foot, build):
    """Return the state after a foot has lost a share of its speed at its contact."""
    turn = rotation(s[3], s[4], s[5])
    up = turned(turn.T, (0.0, 0.0, 1.0))
    lever = crossed(foot, up)
    mobility = 1.0 / build.mass
    for k in range(3):
        mobility += lever[k] ** 2 / build.inertia[k]
    impulse = -build.strength * height(s, foot)[1] / mobility
    after = s.copy()
    after[8] += impulse / build.mass
    for k in range(3):
        after[9 + k] += impulse * lever[k] / build.inertia[k]
    return after


@njit(cache=True)
def start_of(u, top, build):
    """Return the state in which the markers' centre is at the height `top`."""
    s = np.zeros(12)
    s[4] = u[0]
    s[5] = u[1]
    s[9:12] = u[5:8]
    turn = rotation(0.0, s[4], s[5])
    arm = turned(turn, build.centre)
    swing = turned(turn, crossed(s[9:12], build.centre))
    for k in range(3):
        s[k] = -arm[k]
        s[6 + k] = u[2 + k] - swing[k]
    s[2] += top
    return s


@njit(cache=True)
def outcome_of(s, build):
    """Return the 11 numbers at the post section."""
    turn = rotation(s[3], s[4], s[5])
    place, velocity = point_motion(s, turn, build.centre)
    y = np.empty(11)
    y[0], y[1] = place[0], place[1]
    y[2:5] = s[3:6]
    for k in range(3):
        y[5 + k] = velocity[k]
    y[8:11] = s[9:12]
    return y


@njit(cache=True)
def next_event(s, t, bottom, motion):
    """Return which foot touches first within the next step, and after what time.

    The number of feet means that the markers' centre reaches the post section, a larger
    number that nothing happens.
    """
    feet, contacts, wear, build = motion
    n = len(feet)
    end = stepped(s, t, STEP_S, feet, contacts, wear, build)
    which = n + 1
    soonest = STEP_S
    for i in range(n + 1):
        point = build.centre
        level = bottom
        if i < n:
            point = feet[i]
            level = 0.0
        waits = i == n or contacts[0][i] == np.inf
        if waits and height(end, point)[0] < level:
            h = crossing(s, t, point, level, motion)
            if h <= soonest:
                which = i
                soonest = h
    return which, soonest


@njit(cache=True)
def landing(u, wear, feet, top, bottom, build):
    """Return outcome, contact instants, end, and whether all feet touched before it."""
    n = len(feet)
    touched = np.full(n, np.inf)
    contacts = (touched, np.zeros((n, 2)))
    motion = (feet, contacts, wear, build)
    t = 0.0
    s = start_of(u, top, build)
    for i in range(n):
        if height(s, feet[i])[0] < 0.0:
            return np.zeros(11), touched, t, False
    while t < LONGEST_S:
        which, h = next_event(s, t, bottom, motion)
        s = stepped(s, t, h, feet, contacts, wear, build)
        t += h
        if which < n:
            s = touching(s, t, which, motion)
        if which == n:
            return outcome_of(s, build), touched, t, bool(touched.max() < np.inf)
        if height(s, build.centre)[1] >= 0.0:
            break
    return np.zeros(11), touched, t, False


@njit(cache=True)
def touching(s, t, which, motion):
    """Enter a contact, and return the state after it."""
    feet, contacts, _, build = motion
    place, _ = point_motion(s, rotation(s[3], s[4], s[5]), feet[which])
    contacts[1][which, 0] = place[0]
    contacts[1][which, 1] = place[1]
    contacts[0][which] = t
    if build.mechanism == IMPACT:
        s = strike(s, feet[which], build)
    return s


@njit(cache=True)
def land_all(us, wear, base, top, bottom, build):
    """Return outcomes (N, 11), instants (N, F), ends (N,), and which are whole."""
    n = len(base)
    ys = np.zeros((len(us), 11))
    instants = np.zeros((len(us), n))
    ends = np.zeros(len(us))
    whole = np.zeros(len(us), np.bool_)
    for k in range(len(us)):
        feet = base + us[k, 8:].copy().reshape(n, 3)
        ys[k], instants[k], ends[k], whole[k] = landing(
            us[k], wear[k], feet, top, bottom, build
        )
    return ys, instants, ends, whole


@njit(cache=True)
def advanced(s, t, until, motion):
    """Return the state at a later time, without contacts in between."""
    feet, contacts, wear, build = motion
    steps = int(np.ceil((until - t) / STEP_S))
    for k in range(steps):
        h = (until - t) / steps
        s = stepped(s, t + k * h, h, feet, contacts, wear, build)
    return s


@njit(cache=True)
def motion_at(u, wear, feet, top, build, instants, times):
    """Return the states (T, 12) of one landing at increasing times, s.

    Times are relative to the pre section; before it the body flies. The contacts are
    those that have been found.
    """
    n = len(feet)
    contacts = (np.full(n, np.inf), np.zeros((n, 2)))
    motion = (feet, contacts, wear, build)
    order = np.argsort(instants)
    states = np.zeros((len(times), 12))
    s = start_of(u, top, build)
    t = 0.0
    for k in range(len(times) - 1, -1, -1):
        if times[k] < 0.0:
            s = stepped(s, t, times[k] - t, feet, contacts, wear, build)
            t = times[k]
            states[k] = s
    s = start_of(u, top, build)
    t = 0.0
    down = 0
    for k in range(len(times)):
        if times[k] >= 0.0:
            while down < n and instants[order[down]] <= times[k]:
                touch = instants[order[down]]
                s = advanced(s, t, touch, motion)
                t = touch
                s = touching(s, t, order[down], motion)
                down += 1
            s = advanced(s, t, times[k], motion)
            t = times[k]
            states[k] = s
    return states


@njit(cache=True)
def filtered_markers(us, wear, base, top, build, instants, centres, points, kernel):
    """Return marker states (N, 6 B) about the times `centres`, smoothed by a kernel.

    The kernel holds offsets, s, and weights, (K, 2).
    """
    n_points = len(points)
    half = 3 * n_points
    seen = np.zeros((len(us), 2 * half))
    for k in range(len(us)):
        feet = base + us[k, 8:].copy().reshape(len(base), 3)
        times = centres[k] + kernel[:, 0]
        states = motion_at(us[k], wear[k], feet, top, build, instants[k], times)
        for m in range(len(times)):
            s = states[m]
            turn = rotation(s[3], s[4], s[5])
            for j in range(n_points):
                place, velocity = point_motion(s, turn, points[j])
                for a in range(3):
                    seen[k, 3 * j + a] += kernel[m, 1] * place[a]
                    seen[k, half + 3 * j + a] += kernel[m, 1] * velocity[a]
    return seen
