"""Landings of a rigid body under a map whose derivative is known on every schedule."""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from hopdata.maps.coordinates import kinks
from hopdata.maps.verdict.expected import Unforetold
from hopdata.maps.verdict.inputs import (
    Contacts,
    Posture,
    SectionLandings,
    section_landings,
)
from hopdata.maps.verdict.saturation import (
    durations,
    kinks_of_durations,
    saturated,
)
from hopdata.maps.verdict.session import Session

SHAPE = np.array([[0.13, 0.03, -0.01], [-0.07, 0.11, 0.02], [-0.06, -0.14, -0.01]])
SPREAD_S = 0.01
FALL = 1.5  # speed, m/s, that makes a height of the foot an instant
BENDS_OF_LEGS = np.random.default_rng(77).standard_normal((4, 11))


@dataclass(frozen=True)
class Landings:
    """Marker states before and after, contact instants, and the true inputs and outputs."""

    before: np.ndarray
    after: np.ndarray
    instants: np.ndarray
    x: np.ndarray
    y: np.ndarray


def landings(
    n=900,
    strength=0.0,
    noise=0.02,
    curvature=0.1,
    seed=1,
    feet=3,
    constant=None,
    cubic=0.0,
    faster=0.0,
    of_these=0.5,
    jump=0.0,
    spent_within=np.inf,
    parallel=False,
):
    """Draw landings; `strength` scales the kinks, whose slopes are those of the linear part.

    `cubic` scales a term in the cube of the first foot's instant relative to the mean,
    with the slopes of a kink. Input number `constant` does not vary. The outcome jumps
    by twice `jump` times the slopes of a kink where two feet exchange their order. A
    The kinks of three feet saturate if they are `spent_within` some contact spreads. A
    fraction `of_these` of the landings is faster by `faster` standard deviations. Feet 4
    and 3 are apart as feet 1 and 2 if they are `parallel`, but for little.
    """
    rng = np.random.default_rng(seed)
    fixed = np.random.default_rng(99)  # the same map for all seeds
    linear = fixed.standard_normal((8, 11))
    bends = fixed.standard_normal((kinks(np.zeros((1, feet))).shape[1], 11))
    square = fixed.standard_normal((8, 8, 11)) * curvature / 8
    onto = fixed.standard_normal((8, feet))
    if parallel:
        onto[:, 3] = onto[:, 2] + onto[:, 0] - onto[:, 1] + 0.02 * onto[:, 3]
    onto = SPREAD_S * (onto - onto.mean(axis=1, keepdims=True)) / np.sqrt(8)
    x = rng.standard_normal((n, 8))
    if constant is not None:
        x[:, constant] = 0.0
    x[: int(of_these * n), 2:4] += faster / np.sqrt(2)
    instants = x @ onto
    y = x @ linear + np.einsum("ni,nj,ijk->nk", x, x, square)
    bent = kinks(instants / SPREAD_S)
    if np.isfinite(spent_within):
        of_durations = np.linalg.pinv(kinks_of_durations(feet).T)
        bent = saturated(durations(instants / SPREAD_S), spent_within) @ of_durations
    y += strength * bent @ bends
    y += jump * np.sign(instants[:, :1] - instants[:, 1:2]) * bends[0]
    if cubic:
        y += cubic * (instants[:, :1] / instants[:, 0].std()) ** 3 * bends[0]
    y += noise * rng.standard_normal(y.shape)
    scale = np.array([0.03, 0.03, 0.07, 0.07, 0.07, 0.3, 0.3, 0.2])
    out = np.array([0.01, 0.01, 0.02, *(0.01, 0.01, 0.05, 0.05, 0.05, 0.2, 0.2, 0.2)])
    before, after = marker_states(x * scale, y * out, rng)
    times = 1.0 + instants + 0.0004 * rng.standard_normal(instants.shape)
    return Landings(before, after, times, x * scale, y * out)


def fading_one_side(n=600, strength=2.0, *, within=0.4, jump=0.0, seed=1, feet=3):
    """Return landings whose outcome changes while one foot of a pair is the later one.

    The change is continuous, and constant beyond some `within` contact spreads; all
    pairs have one, whose slopes are `strength` times those of kinks. The outcome may
    jump, too, as in `landings`.
    """
    data = landings(n, seed=seed, feet=feet, jump=jump)
    rng = np.random.default_rng(98)
    t = (data.instants - data.instants.mean(axis=1, keepdims=True)) / SPREAD_S
    y = data.y.copy()
    out = np.array([0.01, 0.01, 0.02, *(0.01, 0.01, 0.05, 0.05, 0.05, 0.2, 0.2, 0.2)])
    for first, second in combinations(range(feet), 2):
        later = np.maximum(t[:, first] - t[:, second], 0.0)
        slopes = strength * out * rng.standard_normal(11)
        y += saturated(later, within)[:, None] * slopes
    before, after = marker_states(data.x, y, rng)
    return replace(data, before=before, after=after, y=y)


def smooth_steps(width, n=600, *, feet=4, strength=0.5, seed=1):
    """Return landings of a C1 map that bends where two feet exchange their order.

    Each pair has a smooth step of this width, in contact spreads, whose half is
    `strength` times what the outcomes vary.
    """
    data = landings(n, seed=seed, feet=feet)
    rng = np.random.default_rng(97)
    t = (data.instants - data.instants.mean(axis=1, keepdims=True)) / SPREAD_S
    y = data.y.copy()
    out = np.array([0.01, 0.01, 0.02, *(0.01, 0.01, 0.05, 0.05, 0.05, 0.2, 0.2, 0.2)])
    for first, second in combinations(range(feet), 2):
        step = np.tanh((t[:, first] - t[:, second]) / width)
        y += step[:, None] * strength * out * rng.standard_normal(11)
    before, after = marker_states(data.x, y, rng)
    return replace(data, before=before, after=after, y=y)


def kinks_of_feet(seed, *, feet=3, pair=0.0, jump=0.0, last=0.0, first=0.0):
    """Return states and instants of a C1 map, with kinks of feet 1 and 2, or others.

    `pair` scales |t_1 - t_2|, `jump` its sign, `last` and `first` the delay of the last
    foot and the lead of the first.
    """
    data = landings(450, seed=seed, feet=feet, curvature=0.0)
    t = data.instants - data.instants.mean(axis=1, keepdims=True)
    apart = t[:, 0] - t[:, 1]
    change = pair * np.abs(apart) + last * t.max(axis=1) - first * t.min(axis=1)
    change = change + jump * 0.01 * np.sign(apart)
    # All markers move, and move faster, along x.
    after = data.after.copy()
    after[:, 0:9:3] += 1.0 * change[:, None]
    after[:, 9::3] += 20.0 * change[:, None]
    return data.before, after, data.instants


def with_a_rare_order(n=400, size=6.0):
    """Return landings on three feet; an order of 28 landings moves on as no other does.

    Its velocities after the landing are larger by `size` standard deviations.
    """
    data = landings(n)
    is_rare = (np.argsort(data.instants, axis=1) == [0, 1, 2]).all(axis=1)
    rare = np.flatnonzero(is_rare)
    after = data.after.copy()
    after[rare[:28], 9:] += size * np.tile(data.after[:, 9:12].std(axis=0), 3)
    kept = np.setdiff1d(np.arange(n), rare[28:])
    return Landings(
        data.before[kept],
        after[kept],
        data.instants[kept],
        data.x[kept],
        data.y[kept],
    )


def legs_and_feet(n, scatter, strength, seed=1):
    """Return landings whose legs scatter by `scatter` spreads, and their feet.

    Kinks follow the true instants, of state and legs.
    """
    data = landings(n=n, seed=seed, noise=0.02)
    rng = np.random.default_rng([seed, 5])
    lower = scatter * SPREAD_S * FALL * rng.standard_normal((n, 3))
    instants = data.instants - lower / FALL
    relative = instants - instants.mean(axis=1, keepdims=True)
    bent = strength * kinks(relative / SPREAD_S) @ BENDS_OF_LEGS
    out = np.array([0.01, 0.01, 0.02, *(0.01, 0.01, 0.05, 0.05, 0.05, 0.2, 0.2, 0.2)])
    x, y = data.x, data.y + bent * out
    before, after = marker_states(x, y, np.random.default_rng(seed))
    centre = before[:, :9].reshape(n, 3, 3).mean(axis=1)
    feet = np.tile(3.0 * SHAPE - [0.0, 0.0, 0.5], (n, 1, 1)) + centre[:, None]
    feet[:, :, 2] += lower
    return replace(data, before=before, after=after, instants=instants), feet


def marker_states(x, y, rng):
    """Return marker states (n, 18) of inputs (n, 8) and outputs (n, 11), anywhere in the plane."""
    yaw = rng.uniform(-0.4, 0.4, len(x))
    place = np.column_stack([rng.uniform(-1, 1, (len(x), 2)), np.full(len(x), 0.5)])
    step = np.column_stack([turned(y[:, :2], -yaw), np.full(len(x), -0.2)])
    return _markers(x, place, yaw, yaw), _markers(
        y[:, 3:], place + step, yaw + y[:, 2], yaw
    )


def _markers(states, place, yaw, frame):
    rotation = rotations(yaw, states[:, 0], states[:, 1])
    velocity = np.column_stack([turned(states[:, 2:4], -frame), states[:, 4]])
    arms = np.einsum("nij,bj->nbi", rotation, SHAPE)
    turning = np.einsum("nij,nj->ni", rotation, states[:, 5:])
    positions = place[:, None] + arms
    velocities = velocity[:, None] + np.cross(turning[:, None], arms)
    return np.column_stack(
        [positions.reshape(len(states), -1), velocities.reshape(len(states), -1)]
    )


def turned(vectors, angle):
    """Return components of plane vectors in a frame rotated by `angle`."""
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack(
        [c * vectors[:, 0] + s * vectors[:, 1], c * vectors[:, 1] - s * vectors[:, 0]]
    )


def rotations(yaw, pitch, roll):
    """Return rotations Rz(yaw) Ry(pitch) Rx(roll), (n, 3, 3)."""
    zero, one = np.zeros_like(yaw), np.ones_like(yaw)

    def stack(rows):
        return np.moveaxis(np.array(rows), 2, 0)

    z = [
        [np.cos(yaw), -np.sin(yaw), zero],
        [np.sin(yaw), np.cos(yaw), zero],
        [zero, zero, one],
    ]
    y = [
        [np.cos(pitch), zero, np.sin(pitch)],
        [zero, one, zero],
        [-np.sin(pitch), zero, np.cos(pitch)],
    ]
    x = [
        [one, zero, zero],
        [zero, np.cos(roll), -np.sin(roll)],
        [zero, np.sin(roll), np.cos(roll)],
    ]
    return stack(z) @ stack(y) @ stack(x)


def steady(n):
    """Return a session of one block."""
    return Session.of(np.arange(n, dtype=float), np.zeros(n, dtype=np.int64))


def seen_at_section(data, session=None, **contacts):
    """Return landings in the coordinates of the verdict."""
    seen = Contacts(data.instants, **contacts)
    return section_landings(
        data.before, data.after, seen, session or steady(len(data.instants))
    )


def in_section(instants, outputs, inputs, *, unforetold=None, session=None):
    """Return landings whose coordinates are given, of a body without posture."""
    n, feet = instants.shape
    nothing = np.zeros((feet, feet))
    of_posture = nothing if unforetold is None else unforetold
    return SectionLandings(
        inputs=inputs,
        outputs=outputs,
        expected=instants - instants.mean(axis=1, keepdims=True),
        missed=np.zeros_like(instants),
        foretold=1.0,
        unforetold=Unforetold(nothing, of_posture),
        noise=np.zeros((inputs.shape[1], inputs.shape[1])),
        session=session or steady(n),
        n_bent=inputs.shape[1],
        posture=Posture.NOT_NEEDED,
        kept=np.ones(n, dtype=bool),
    )
