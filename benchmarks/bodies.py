"""Bodies that land on two to six legs, with their true differences between contact orders.

A bench for the verdict. It shares no code with the scenes, the synthesis and the
integrator of hopdata: a rigid body on massless legs, integrated by RK4 in steps of 1 ms
with located contacts. Only the coordinates in which a verdict measures are hopdata's
(`marker_states`, `marker_motions`, `contrasts`, `relative_size`).

A body is drawn from its seed. Seeds 0 to 99 (`CHOOSE`) are for choosing how the verdict
works, seeds from 1000 on (`REPORT`) only for reporting how often it errs.

An input u of a landing holds 8 numbers of the body at the pre section (pitch, roll,
velocity, spin) and the displacements (X, Y, Z) of its n feet in the body, which are the
posture. The outcome holds 11 numbers at the post section (`hopdata.rigid.OUTPUT_NAMES`).
SI units, z up; angles are intrinsic ZYX.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np
from numba import njit

from hopdata.maps.truth.maps import marker_motions, marker_states
from hopdata.maps.verdict.effect import contrasts, relative_size
from hopdata.maps.verdict.inputs import halves

CHOOSE = range(100)
REPORT = range(1000, 2000)

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
#: Mechanisms whose difference is a kink that fades within milliseconds.
SATURATING = ["friction", "stick", "sated", "decay"]
#: Mechanisms after which two orders lead to different states at the same contact.
JUMPING = ["rank", "latch", "impact"]
#: Mechanisms that need feet that move over the floor.
OF_SLIDING_FEET = ["friction", "stick"]

# The strength from which that of a wanted size is extrapolated, and the largest.
TRIAL_STRENGTH = 0.3
STRONGEST = {"impact": 0.4, "rank": 0.8, "latch": 1.0}
STRONGEST_OF_OTHERS = 4.0


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


@dataclass(frozen=True)
class Truth:
    """The exact differences between contact orders, as docs/verdict.md measures them.

    Attributes
    ----------
    kink
        Size of the difference of derivatives at the simultaneous contact.
    jump
        Size of the jump of the outcome there.
    averaged
        Size of the difference of derivatives that the mechanism makes, averaged over
        the landings of each order: less than `kink` if it saturates. NaN if not asked.
    """

    kink: float
    jump: float
    averaged: float = float("nan")


@dataclass(frozen=True)
class Landings:
    """Exact landings of a body.

    Attributes
    ----------
    inputs
        (N, 8 + 3 F) state and posture at the pre section.
    outcomes
        (N, 11) at the post section.
    instants
        (N, F) contact instants after the pre section, s.
    ends
        (N,) instants of the post section, s.
    wear
        (N, 2) factors of the legs' force and of friction.
    time, blocks
        (N,) place in the session from 0 to 1, and label of the surface.
    """

    inputs: np.ndarray
    outcomes: np.ndarray
    instants: np.ndarray
    ends: np.ndarray
    wear: np.ndarray
    time: np.ndarray
    blocks: np.ndarray

    def __len__(self) -> int:
        return len(self.inputs)

    def some(self, rows: np.ndarray | slice) -> "Landings":
        """Return the landings of these rows."""
        return Landings(*(column[rows] for column in vars(self).values()))


Session = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def steady(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return wear and surfaces of a session in which nothing changes."""
    return np.ones((len(time), 2)), np.zeros(len(time), int)


def softening(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Legs have lost 30 % of their force at the end."""
    wear, surface = steady(time)
    wear[:, 0] = 1.2 - 0.36 * time
    return wear, surface


def _on(surface: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    wear = np.where(surface[:, None] == 1, [0.8, 0.5], [1.2, 1.5])
    return wear, surface


def two_surfaces(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First a stiff and rough surface, then a soft and smooth one."""
    return _on((time >= 0.5).astype(int))


def by_turns(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the two surfaces, landing by landing in turn."""
    return _on(np.arange(len(time)) % 2)


SESSIONS: dict[str, Session] = {
    "steady": steady,
    "softening": softening,
    "two surfaces": two_surfaces,
    "by turns": by_turns,
}


@dataclass(frozen=True)
class Body:
    """A body drawn from a seed.

    Attributes
    ----------
    seed
        Seed of the body.
    mechanism
        One of `MECHANISMS`.
    feet
        Number of feet, two to six.
    spread_s
        Root mean square of the contact instants about their mean that tilt alone would
        give if no leg pushed, s. The first feet right the body, so it is less.
    scatter_m
        Standard deviation of each coordinate of each foot from landing to landing, m.
    leg
        One of `LEGS`; drawn from the seed if empty.
    strength
        Strength of the mechanism.
    """

    seed: int
    mechanism: str = "c1"
    feet: int = 3
    spread_s: float = 0.010
    scatter_m: float = 0.0
    leg: str = ""
    strength: float = 0.0
    build: Build = field(init=False, repr=False)
    base: np.ndarray = field(init=False, repr=False)
    markers: np.ndarray = field(init=False, repr=False)
    mean: np.ndarray = field(init=False, repr=False)
    sd: np.ndarray = field(init=False, repr=False)
    top_m: float = field(init=False)
    bottom_m: float = field(init=False)

    def __post_init__(self) -> None:
        """Draw the body."""
        n = self.feet
        rng = np.random.default_rng([self.seed, n, 55])
        leg = self.leg or self._leg()
        mass = rng.uniform(1.5, 4.0)
        speed = rng.uniform(1.4, 2.0)
        reach = rng.uniform(0.16, 0.26)
        length = rng.uniform(0.22, 0.32)
        inertia = mass * (reach * rng.uniform(0.55, 0.85, 3)) ** 2
        angle = 2 * np.pi * np.arange(n) / n + rng.uniform(0, 2 * np.pi)
        angle += rng.normal(0.0, 0.1, n)
        away = reach * rng.uniform(0.9, 1.1, n)
        across = np.column_stack([away * np.cos(angle), away * np.sin(angle)])
        base = np.column_stack([across, np.full(n, -length)])
        hips = np.column_stack([0.7 * across, np.zeros(n)])

        # The post section is as deep as the last contacts, the nadir much deeper.
        out = np.hypot(self.spread_s * speed, self.scatter_m)
        depth = max(0.025, 2.2 * out)
        travel = max(0.11, 1.8 * depth)
        load = mass * (speed**2 / 2 / travel + GRAVITY) / n
        uneven = rng.uniform(0.8, 1.2, (3, n))
        forward = rng.uniform(0.0, 0.8)

        ring = [[0.10, 0.02, 0.02], [-0.05, 0.09, 0.03], [-0.06, -0.08, 0.00]]
        markers = np.array(ring) + rng.normal(0.0, 0.01, (3, 3))
        centre = markers.mean(axis=0)
        build = Build(
            mass=mass,
            inertia=inertia,
            centre=centre,
            hips=hips,
            stiffness=load / travel * 1.1 * uneven[0],
            damping=load * 0.4 / speed * uneven[1],
            preload=load * 0.2 * uneven[2],
            friction=rng.uniform(0.3, 0.6),
            leg=LEGS.index(leg),
            mechanism=MECHANISMS.index(self.mechanism),
            strength=float(self.strength),
            load=load,
            reach=reach,
        )
        tilt = self.spread_s * speed / reach
        of_state = [tilt, tilt, 0.15, 0.15, 0.08, 0.35, 0.35, 0.3]
        level = length + centre[2]
        drawn = {
            "build": build,
            "base": base,
            "markers": markers - centre,
            "mean": np.array([0, 0, forward, 0, -speed, 0, 0, 0] + [0.0] * (3 * n)),
            "sd": np.array(of_state + [self.scatter_m] * (3 * n)),
            "top_m": level + max(0.008, 2.7 * out),
            "bottom_m": level - depth,
        }
        for name, value in drawn.items():
            object.__setattr__(self, name, value)

    @property
    def drawn_leg(self) -> str:
        """Return the kind of its legs."""
        return LEGS[self.build.leg]

    def _leg(self) -> str:
        able = list(LEGS)
        if self.mechanism in OF_SLIDING_FEET:
            able.remove("pivoting")
        return able[self.seed % len(able)]

    def landings(
        self, n: int, rng: np.random.Generator, session: Session = steady
    ) -> Landings:
        """Return n whole landings.

        Raises
        ------
        ValueError
            If fewer than a fifth of the body's landings are whole.
        """
        time = np.arange(n) / max(n - 1, 1)
        wear, blocks = session(time)
        us = np.zeros((n, len(self.sd)))
        ys = np.zeros((n, 11))
        instants = np.zeros((n, self.feet))
        ends = np.zeros(n)
        missing = np.arange(n)
        for _ in range(20):
            drawn = rng.standard_normal((len(missing), len(self.sd)))
            us[missing] = self.mean + self.sd * drawn
            found = self.land(us[missing], wear[missing])
            ys[missing], instants[missing], ends[missing], whole = found
            missing = missing[~whole]
            if not len(missing):
                return Landings(us, ys, instants, ends, wear, time, blocks)
        raise ValueError(f"{self}: few of its landings are whole")

    def land(
        self, us: np.ndarray, wear: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return outcomes (N, 11), instants (N, F), ends (N,), and which are whole."""
        if wear is None:
            wear = np.ones((len(us), 2))
        return land_all(us, wear, self.base, self.top_m, self.bottom_m, self.build)

    def derivatives(
        self, us: np.ndarray, wear: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return outcomes (N, 11) and their derivatives (N, 11, p) by differences.

        Derivatives with respect to inputs that do not vary in this body, other than the
        heights of its feet, are left out as zero.
        """
        n, p = us.shape
        if wear is None:
            wear = np.ones((n, 2))
        wanted = self.sd > 0.0
        wanted[10::3] = True  # heights of the feet
        varying = np.flatnonzero(wanted)
        count = len(varying)
        steps = np.full(p, 1e-6)
        steps[2:8] = 1e-5
        moves = np.diag(steps)[varying]
        moves = np.vstack([np.zeros(p), moves, -moves])
        around = (us[:, None] + moves).reshape(-1, p)
        ys = self.land(around, np.repeat(wear, len(moves), axis=0))[0]
        ys = ys.reshape(n, len(moves), 11)
        changes = ys[:, 1 : count + 1] - ys[:, count + 1 :]
        slopes = np.zeros((n, 11, p))
        slopes[:, :, varying] = np.swapaxes(changes / (2 * steps[varying, None]), 1, 2)
        return ys[:, 0], slopes

    def truth(self, landings: Landings, over: int = 0, most: int = 240) -> Truth:
        """Return the exact differences for these landings.

        `over` is the number of landings over which the size is averaged; none if 0.
        With more than three feet, the orders are those of the first `most` landings.
        """
        orders, counts = self._orders(landings, most)
        at = np.tile(self.mean, (len(orders), 1))
        for k, order in enumerate(orders):
            # Each foot 20 um above the one that touches before it.
            at[k, 8 + 2 + 3 * order] += 2e-5 * np.arange(self.feet)
        wear = np.tile(landings.wear.mean(axis=0), (len(orders), 1))
        values, slopes = self.derivatives(at, wear)
        values = values - np.einsum("kyp,kp->ky", slopes, at - self.mean)
        motions = marker_motions(self.markers)
        root = _root(np.cov(landings.inputs.T))
        moved = motions @ slopes @ root
        weights = contrasts(orders, counts)
        averaged = float("nan")
        if over:
            averaged = self._averaged(landings.some(slice(over)), moved, root)
        return Truth(
            kink=relative_size(moved, weights),
            jump=_jump(orders, values @ motions.T, moved.mean(axis=0)),
            averaged=averaged,
        )

    def _orders(self, landings: Landings, most: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the orders (S, F) that are compared, and how often they occur (S,).

        With up to three feet all orders count alike; with more, those of the first
        `most` landings.
        """
        if self.feet <= 3:
            orders = np.array(list(permutations(range(self.feet))))
            return orders, np.full(len(orders), 100)
        seen = np.argsort(landings.instants[:most], axis=1)
        orders, counts = np.unique(seen, axis=0, return_counts=True)
        return orders, counts * len(landings) // min(most, len(landings))

    def _averaged(
        self, landings: Landings, moved: np.ndarray, root: np.ndarray
    ) -> float:
        """Return the size of the difference that the mechanism makes, over landings."""
        plain = replace(self, mechanism="c1", strength=0.0, leg=self.drawn_leg)
        _, own = self.derivatives(landings.inputs, landings.wear)
        _, without = plain.derivatives(landings.inputs, landings.wear)
        changes = marker_motions(self.markers) @ (own - without) @ root
        seen = np.argsort(landings.instants, axis=1)
        orders, which, counts = np.unique(
            seen, axis=0, return_inverse=True, return_counts=True
        )
        which = which.ravel()
        of_orders = [changes[which == k].mean(axis=0) for k in range(len(orders))]
        common = moved.mean(axis=0)
        maps = np.array(of_orders)
        # The differences of the changes, relative to the map at the simultaneous contact.
        maps = maps - np.tensordot(contrasts(orders, counts)[1], maps, axes=1) + common
        return relative_size(maps, contrasts(orders, counts))


def _root(covariance: np.ndarray) -> np.ndarray:
    squares, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(squares.clip(0.0))


def _jump(orders: np.ndarray, values: np.ndarray, mean: np.ndarray) -> float:
    """Return the size of the jumps of the outcome `values` (S, 11) between orders."""
    place = np.argsort(orders, axis=1)
    pairs = list(combinations(range(orders.shape[1]), 2))
    signs = [np.sign(place[:, i] - place[:, j]) for i, j in pairs]
    design = np.column_stack([np.ones(len(orders)), *signs])
    # From -1 to 1 the outcome changes by twice the coefficient.
    jumps = 2.0 * np.linalg.lstsq(design, values, rcond=None)[0][1:]
    variance = np.sum(mean**2, axis=1)
    return float(np.sqrt(np.mean(jumps**2 @ halves(variance))))


def body_of_size(size: float, landings: int = 400, **drawn) -> Body:
    """Return a body whose mechanism makes a difference of about this size.

    The difference is the jump of mechanisms that jump, the average over landings of
    those that saturate, and that of the derivatives at the simultaneous contact of the
    others. The mechanism is not made stronger than `STRONGEST`; its exact size is that
    of `Body.truth`.
    """
    trial = Body(strength=TRIAL_STRENGTH, **drawn)
    if trial.mechanism == "c1":
        return replace(trial, strength=0.0)
    strongest = STRONGEST.get(trial.mechanism, STRONGEST_OF_OTHERS)
    over = 0
    if trial.mechanism in SATURATING:
        over = 30
    body = trial
    for _ in range(2):
        rng = np.random.default_rng([body.seed, 56])
        drawn_landings = body.landings(landings, rng)
        made = leading(body.mechanism, body.truth(drawn_landings, over, most=60))
        strength = body.strength * size / max(made, 1e-6)
        body = replace(body, strength=min(strongest, strength))
    return body


def leading(mechanism: str, truth: Truth) -> float:
    """Return the size by which a mechanism differs most."""
    if mechanism in JUMPING:
        return truth.jump
    if mechanism in SATURATING:
        return truth.averaged
    return truth.kink


# What a camera shows.


@dataclass(frozen=True)
class Seen:
    """How landings are seen.

    Attributes
    ----------
    noise_m
        Noise of the cameras, m. Errors of states, feet and instants follow from it as
        hopdata states them at 100 Hz.
    alike
        Correlation of the errors of consecutive landings.
    blur_s
        Width of a low-pass filter, s: 1 / (2 pi cut-off frequency); 0 for none.
    drift_rad
        Tilt of the cameras at the end of the session, rad.
    fault
        One of `FAULTS`.
    """

    noise_m: float = 0.0006
    alike: float = 0.0
    blur_s: float = 0.0
    drift_rad: float = 0.0
    fault: str = ""


#: Standard errors per metre of camera noise: of positions and velocities before and
#: after, of instants (s) and of feet.
PER_NOISE = {
    "before": (0.42, 8.3),
    "after": (0.67, 83.0),
    "instants": 1.25,
    "feet": 0.42,
}


@dataclass(frozen=True)
class Study:
    """What `judge` is given, for n landings of F feet.

    `x`, `y` (n, 18) marker states, `feet` (n, F, 3) at the pre section in the frame of
    `x`; the standard errors have the shapes of what they belong to.
    """

    x: np.ndarray
    y: np.ndarray
    instants: np.ndarray
    instants_se: np.ndarray
    feet: np.ndarray
    feet_se: np.ndarray
    time: np.ndarray
    blocks: np.ndarray


def study(
    body: Body, landings: Landings, rng: np.random.Generator, seen: Seen = Seen()
) -> Study:
    """Return what a recording of these landings shows."""
    n = len(landings)
    before = np.hstack([np.zeros((n, 3)), landings.inputs[:, :8]])
    exact = {
        "before": marker_states(before, body.markers),
        "after": marker_states(landings.outcomes, body.markers),
        "instants": landings.instants.copy(),
        "feet": feet_of(body, landings),
    }
    if seen.blur_s:
        exact |= _blurred(body, landings, seen.blur_s)
    errors = {
        "before": np.repeat(PER_NOISE["before"], 9) * seen.noise_m,
        "after": np.repeat(PER_NOISE["after"], 9) * seen.noise_m,
        "instants": PER_NOISE["instants"] * seen.noise_m,
        "feet": PER_NOISE["feet"] * seen.noise_m,
    }
    shown = {}
    for name, values in exact.items():
        noise = _noise(values.shape, seen.alike, rng)
        shown[name] = values + errors[name] * noise
    if seen.drift_rad:
        _tilt(shown, seen.drift_rad * landings.time)
    if seen.fault:
        FAULTS[seen.fault](shown, rng)
    return Study(
        x=shown["before"],
        y=shown["after"],
        instants=shown["instants"],
        instants_se=np.full(landings.instants.shape, errors["instants"]),
        feet=shown["feet"],
        feet_se=np.full(shown["feet"].shape, errors["feet"]),
        time=landings.time.copy(),
        blocks=landings.blocks.copy(),
    )


def _blurred(body: Body, landings: Landings, width_s: float) -> dict[str, np.ndarray]:
    """Return marker states that a Gaussian low-pass of this width has smoothed."""
    offsets = width_s * np.linspace(-3.0, 3.0, 25)
    weights = np.exp(-0.5 * (offsets / width_s) ** 2)
    kernel = np.column_stack([offsets, weights / weights.sum()])
    smoothed = {}
    for name, centres in (
        ("before", np.zeros(len(landings))),
        ("after", landings.ends),
    ):
        smoothed[name] = filtered_markers(
            landings.inputs,
            landings.wear,
            body.base,
            body.top_m,
            body.build,
            landings.instants,
            centres,
            body.markers + body.build.centre,
            kernel,
        )
    return smoothed


def feet_of(body: Body, landings: Landings) -> np.ndarray:
    """Return the feet (n, F, 3) at the pre section, in the frame of the marker states."""
    u = landings.inputs
    feet = body.base + u[:, 8:].reshape(len(u), -1, 3) - body.build.centre
    turns = np.array([rotation(0.0, pitch, roll) for pitch, roll in u[:, :2]])
    return np.einsum("nij,nfj->nfi", turns, feet)


def _noise(
    shape: tuple[int, ...], alike: float, rng: np.random.Generator
) -> np.ndarray:
    """Return normal errors whose consecutive rows correlate by `alike`."""
    noise = rng.standard_normal(shape)
    if alike:
        fresh = np.sqrt(1.0 - alike**2)
        for row in range(1, len(noise)):
            noise[row] = alike * noise[row - 1] + fresh * noise[row]
    return noise


def _tilt(shown: dict[str, np.ndarray], angles: np.ndarray) -> None:
    """Turn states and feet about the x axis."""
    turns = np.array([rotation(0.0, 0.0, angle) for angle in angles])
    for name in ("before", "after", "feet"):
        points = shown[name].reshape(len(angles), -1, 3)
        points = np.einsum("nij,nkj->nki", turns, points)
        shown[name] = points.reshape(shown[name].shape)


def _some(n: int, share: float, rng: np.random.Generator) -> np.ndarray:
    """Return the numbers of a share of n rows, in random order."""
    return rng.permutation(n)[: round(share * n)]


def swapped(shown: dict[str, np.ndarray], rng: np.random.Generator) -> None:
    """Exchange two body markers in 3 % of the landings, before or after."""
    n = len(shown["before"])
    for row in _some(n, 0.03, rng):
        side = shown[("before", "after")[rng.integers(2)]]
        points = side[row].reshape(2, 3, 3)
        side[row] = points[:, [1, 0, 2]].ravel()


def slipped(shown: dict[str, np.ndarray], rng: np.random.Generator) -> None:
    """Let the body slip in 2 % of the landings: it goes on by 1 m/s and turns."""
    n = len(shown["before"])
    for row in _some(n, 0.02, rng):
        points = shown["after"][row].reshape(2, 3, 3)
        push = np.append(rng.normal(0.0, 1.0, 2), rng.normal(0.0, 0.3))
        spin = rng.normal(0.0, 5.0, 3)
        arms = points[0] - points[0].mean(axis=0)
        points[1] += push + np.cross(spin, arms)


def bounced(shown: dict[str, np.ndarray], rng: np.random.Generator) -> None:
    """Let 2 % of the landings have instants and outcome of another one."""
    n = len(shown["before"])
    rows = _some(n, 0.02, rng)
    others = rng.integers(0, n, len(rows))
    for name in ("instants", "after"):
        shown[name][rows] = shown[name][others].copy()


def outlying(shown: dict[str, np.ndarray], rng: np.random.Generator) -> None:
    """Shift the contact of one foot by 30 to 80 ms in 3 % of the landings."""
    n, feet = shown["instants"].shape
    rows = _some(n, 0.03, rng)
    signs = rng.choice([-1.0, 1.0], len(rows))
    shifts = signs * rng.uniform(0.03, 0.08, len(rows))
    shown["instants"][rows, rng.integers(0, feet, len(rows))] += shifts


FAULTS = {
    "swapped markers": swapped,
    "slips": slipped,
    "double bounces": bounced,
    "outlying instants": outlying,
}
