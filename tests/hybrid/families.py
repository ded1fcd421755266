"""Kinds of guards that are hard to watch, random members of each, and the true flips.

The guards are passive: nothing depends on their locks, so the path is known whatever is
found. What a run has found is compared with a dense sampling of its own path.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import cos, exp, pi, sin, sqrt, tan
from typing import Any

import numpy as np
import plain_families as plain
from numba import njit

from hopdata.code_cache import kept_njit
from hopdata.hybrid import Solution, System, field, guards, solve

GRAVITY = 9.81
SAMPLES = 200_000
#: Fraction of the largest |h| of a run below which a sample has no sign.
#: Unit: 1. Origin: rounding: some thousand units in the last place of a double, for the
#: dense output is evaluated by another formula than the steps.
GREY = 2.0**-40
KNOTS = np.linspace(0.0, 8.0, 41)
HEIGHTS = np.random.default_rng(3).uniform(0.0, 0.4, 41)


@field
def flight(t, y, mode, params, dy):
    dy[0], dy[1], dy[2], dy[3] = y[2], y[3], 0.0, -9.81


@field
def orbit(t, y, mode, params, dy):
    dy[0], dy[1] = -y[1], y[0]


@field
def clock(t, y, mode, params, dy):
    dy[0] = 1.0


@field
def tumbling(t, y, mode, params, dy):  # a plate: place, height, tilt, and their rates
    dy[0], dy[1], dy[2], dy[3], dy[4], dy[5] = y[3], y[4], y[5], 0.0, -9.81, 0.0


@field
def rocking(t, y, mode, params, dy):
    dy[0], dy[1] = y[2], y[3]
    dy[2], dy[3] = 60.0 * (0.5 - y[0]), -25.0 * y[1]


@field
def growth(t, y, mode, params, dy):
    dy[0] = y[0]


# The guards: h and its rate, from time, state, its rate, and parameters.


def box(t, y, dy, p):
    inside = p[1] < y[0] < p[1] + p[2]
    return y[1] - (p[0] if inside else 0.0), dy[1]


def stone(t, y, dy, p):
    if p[1] < y[0] < p[1] + p[2]:
        turn = 2.0 * pi / p[2]
        angle = turn * (y[0] - p[1]) - pi
        top = 0.5 * p[0] * (1.0 + cos(angle))
        return y[1] - top, dy[1] + 0.5 * p[0] * sin(angle) * turn * dy[0]
    return y[1], dy[1]


def roof(t, y, dy, p):
    away = y[0] - p[1] - 0.5 * p[2]
    slope = 0.0
    if abs(away) < 0.5 * p[2]:
        slope = p[0] / (0.5 * p[2])
    if away > 0.0:
        slope = -slope
    top = max(0.0, p[0] * (1.0 - abs(away) / (0.5 * p[2])))
    return y[1] - top, dy[1] - slope * dy[0]


def two_sines(t, y, dy, p):
    first = sin(p[0] * t)
    second = sin(p[2] * t + p[3])
    rate = p[0] * cos(p[0] * t) + p[1] * p[2] * cos(p[2] * t + p[3])
    return first + p[1] * second + p[4], rate


def sawtooth(t, y, dy, p):
    return t % 1.0 - p[0], 1.0


def sharp_cosine(t, y, dy, p):
    angle = p[0] * t + p[1]
    rate = 400.0 * cos(angle) ** 399 * sin(angle) * p[0]
    return p[2] - cos(angle) ** 400, rate


def bump(t, y, dy, p):
    away = (y[0] - p[1]) / p[4]
    top = exp(-(away**2))
    return p[3] - top, 2.0 * top * away / p[4] * dy[0]


def sine_of_state(t, y, dy, p):
    return sin(p[0] * y[0] + p[1]), p[0] * cos(p[0] * y[0] + p[1]) * dy[0]


def near_roots(t, y, dy, p):
    first = y[0] - p[0]
    second = y[0] - p[0] - p[1]
    return first * second, (first + second) * dy[0]


def plate(t, y, dy, p):
    slope = tan(y[2])
    reach = p[0] - y[0]
    rate = dy[1] + (1.0 + slope**2) * dy[2] * reach - slope * dy[0]
    return y[1] + slope * reach, rate


def foot(t, y, dy, p):
    return 0.5 - y[0] - p[0] * y[1], -dy[0] - p[0] * dy[1]


def sine_of_growth(t, y, dy, p):
    return sin(p[0] * y[0]), p[0] * cos(p[0] * y[0]) * dy[0]


def bars(t, y, dy, p):
    rate = dy[0]
    if y[0] < p[0]:
        rate = -rate
    return abs(y[0] - p[0]) - p[1], rate


def table(t, y, dy, p):
    ahead = np.interp(y[0] + 1e-6, KNOTS, HEIGHTS)
    behind = np.interp(y[0] - 1e-6, KNOTS, HEIGHTS)
    rise = (ahead - behind) / 2e-6
    return y[1] - np.interp(y[0], KNOTS, HEIGHTS), dy[1] - rise * dy[0]


def terrain(t, y, dy, p):
    x = y[0]
    top = 0.2 * cos(3.0 * x) + 0.1 * cos(p[2] + 11.0 * x) + 0.1 * cos(23.0 * x)
    slope = 0.6 * sin(3.0 * x) + 1.1 * sin(p[2] + 11.0 * x) + 2.3 * sin(23.0 * x)
    return y[1] - top, dy[1] + slope * dy[0]


def circle(t, y, dy, p):
    x = y[0] - p[0]
    z = y[1] - p[1]
    return x**2 + z**2 - p[2] ** 2, 2.0 * (x * dy[0] + z * dy[1])


def energy(t, y, dy, p):
    return y[0] * y[0] + y[1] * y[1] - p[0], 2.0 * (y[0] * dy[0] + y[1] * dy[1])


def double_root(t, y, dy, p):
    return (y[0] - p[0]) ** 2, 2.0 * (y[0] - p[0]) * dy[0]


def flat_root(t, y, dy, p):
    return (y[0] - p[0]) ** 5, 5.0 * (y[0] - p[0]) ** 4 * dy[0]


def dead_zone(t, y, dy, p):
    if y[0] > p[0]:
        return y[0] - p[0], dy[0]
    return 0.0, 0.0


# Members.

Draw = Callable[[np.random.Generator], float]
Member = tuple[list[float], list[float], float]  # start, parameters, time


@dataclass(frozen=True)
class Family:
    """A kind of guard, and how its members are drawn.

    Parameters
    ----------
    field, guard : callable
        Vector field, and guard with its rate.
    draw : callable
        Returns a member, drawn by a generator.
    n_states : int
        Length of the state.
    can_be_proven : bool
        Whether the guard's flips are never undecidable: no double root, and not zero
        over a stretch.
    is_plain : bool
        Whether field and guard are plain functions, and the guard returns its value
        only.
    """

    field: Any
    guard: Any
    draw: Callable[[np.random.Generator], Member]
    n_states: int
    can_be_proven: bool = True
    is_plain: bool = False


def between(low: float, high: float) -> Draw:
    return lambda rng: rng.uniform(low, high)


def power_of_ten(low: float, high: float) -> Draw:
    return lambda rng: 10.0 ** rng.uniform(low, high)


def thrown(part: float) -> Callable[[np.random.Generator], Member]:
    """Return members: a flight over something that is `part` of it wide."""

    def draw(rng):
        height, forward, up = rng.uniform(0.3, 1), rng.uniform(2, 8), rng.uniform(0, 3)
        landing = (up + sqrt(up * up + 2.0 * GRAVITY * height)) / GRAVITY
        begin = forward * rng.uniform(0.1, 0.9 - part) * landing
        width = forward * part * landing
        params = [10.0, begin, width, rng.uniform(0.05, 0.95), part]
        return [0.0, height, forward, up], params, landing + 0.3

    return draw


def turning(*params: float | Draw) -> Callable[[np.random.Generator], Member]:
    """Return members: a turn on the unit circle with these parameters."""

    def draw(rng):
        start = rng.uniform(0, 6)
        drawn = [one(rng) if callable(one) else one for one in params]
        return [cos(start), sin(start)], drawn, 7.0

    return draw


def near_a_circle(rng):
    start, place, radius = rng.uniform(0, 6), rng.uniform(0, 6), rng.uniform(0.03, 0.2)
    gap = rng.choice((-1, 1)) * 10.0 ** rng.uniform(-10, -2)
    far = 1.0 + radius * (1.0 + gap)
    return [cos(start), sin(start)], [far * cos(place), far * sin(place), radius], 7.0


def over_an_edge(rng):
    rates = rng.uniform(-1, 1, 4)
    return [0.0, rng.uniform(0.3, 1.0), *rates], [0.3], 0.8


def over_bumps(width: float) -> Callable[[np.random.Generator], Member]:
    def draw(rng):
        start, params, end = thrown(0.1)(rng)
        return start, [*params[:4], width], end

    return draw


def on_two_circles(*params: float | Draw) -> Callable[[np.random.Generator], Member]:
    """Return members: two oscillators, of amplitudes 1 and 0.9."""

    def draw(rng):
        a, b = rng.uniform(0, 6, 2)
        drawn = [one(rng) if callable(one) else one for one in params]
        return [cos(a), -sin(a), 0.9 * cos(b), -0.9 * sin(b)], drawn, 9.0

    return draw


def tossed(*params: Draw) -> Callable[[np.random.Generator], Member]:
    """Return members: a flight of 1.4 s."""

    def draw(rng):
        start = [0.0, rng.uniform(0.5, 1.2), rng.uniform(1, 4), rng.uniform(0, 4)]
        return start, [one(rng) for one in params], 1.4

    return draw


def tumbling_body(rng):
    turn = rng.normal(size=4)
    turn /= sqrt(turn @ turn)
    return [*turn, *rng.normal(0.0, 3.0, 3)], [rng.uniform(-1, 1)], 6.0


def swinging(rng):
    start = [rng.uniform(1, 3), rng.uniform(1, 3), 0.0, rng.uniform(-3, 3)]
    return start, [rng.uniform(-3, 3)], 3.0


def spiking(rng):
    params = [rng.uniform(0.1, 2.0), 10.0 ** rng.uniform(0, 4)]
    return [rng.uniform(-3, 3)], params, 30.0


def turning_over(rng):
    rates = [rng.uniform(1, 4), rng.uniform(0, 3), rng.uniform(-20, 20)]
    return [0.0, 0.8, 0.0, *rates], [0.0], 1.0


def _plain(field: Any, guard: Any, draw: Any, n_states: int = 4) -> Family:
    return Family(field, guard, draw, n_states, is_plain=True)


ONE, ANY_TURN = between(-0.8, 0.8), between(-3, 3)
WILD = {
    "polygon": _plain(plain.flight, plain.polygon, tossed(between(0.02, 0.2))),
    "platform": _plain(
        plain.flight, plain.platform, tossed(between(0.1, 0.5), between(10, 60))
    ),
    "capsules": _plain(plain.oscillators, plain.capsules, on_two_circles(ONE, ONE, ONE)),
    "jagged spline": _plain(plain.oscillators, plain.jagged_spline, on_two_circles()),
    "wrapped angle": _plain(
        plain.oscillators, plain.wrapped_angle,
        on_two_circles(between(3, 40), ANY_TURN, ANY_TURN),
    ),
    "flips": _plain(plain.double_pendulum, plain.flips, swinging),
    "pitch": _plain(plain.rigid_body, plain.pitch, tumbling_body, 7),
    "sawtooth of state": _plain(
        plain.oscillators, plain.sawtooth_of_state,
        on_two_circles(between(0.05, 2.0), between(-0.5, 0.5)),
    ),
    "pulse width": _plain(
        plain.oscillators, plain.pulse_width, on_two_circles(between(0.05, 2.0))
    ),
    "nested": _plain(plain.oscillators, plain.nested, on_two_circles(ONE, ONE)),
    "window": _plain(
        plain.oscillators, plain.window, on_two_circles(ONE, power_of_ten(-6, -1))
    ),
    "spikes": _plain(plain.theta_neuron, plain.spikes, spiking, 1),
    "three feet": _plain(plain.somersault, plain.three_feet, turning_over, 6),
    "fourier": _plain(
        plain.oscillators, plain.fourier,
        on_two_circles(between(0, 6), between(0, 6), between(0, 6)),
    ),
    "rounded": _plain(
        plain.oscillators, plain.rounded, on_two_circles(between(0.1, 1.1))
    ),
}  # fmt: skip
FAMILIES = {
    **{f"box {w:g}": Family(flight, box, thrown(w), 4) for w in (0.2, 0.1, 0.05, 0.01)},
    **{
        f"stone {w:g}": Family(flight, stone, thrown(w), 4)
        for w in (0.2, 0.1, 0.05, 0.01)
    },
    "roof": Family(flight, roof, thrown(0.05), 4),
    "two sines": Family(
        orbit,
        two_sines,
        turning(
            between(20, 80),
            between(0.1, 0.9),
            between(80, 300),
            between(0, 6),
            between(-0.5, 0.5),
        ),
        2,
    ),
    "sawtooth": Family(
        clock, sawtooth, lambda rng: ([0.0], [rng.uniform(0.2, 0.8)], 100.25), 1
    ),
    "cos^400": Family(
        orbit,
        sharp_cosine,
        turning(between(1, 20), between(0, 6), between(0.3, 0.95)),
        2,
    ),
    **{f"bump {w:g}": Family(flight, bump, over_bumps(w), 4) for w in (0.1, 0.02)},
    "sine of state": Family(
        orbit, sine_of_state, turning(between(2, 40), between(0, 6)), 2
    ),
    "near roots": Family(
        orbit, near_roots, turning(between(-0.9, 0.9), power_of_ten(-5, -1)), 2
    ),
    "plate": Family(tumbling, plate, over_an_edge, 6),
    "foot": Family(
        rocking, foot, lambda rng: ([0.7, *rng.uniform(-1, 1, 3)], [0.2], 4.0), 4
    ),
    "growth": Family(
        growth, sine_of_growth, lambda rng: ([rng.uniform(0.2, 1.8)], [pi], 4.0), 1
    ),
    "bars": Family(orbit, bars, turning(between(-0.5, 0.5), power_of_ten(-5, -0.5)), 2),
    "table": Family(flight, table, thrown(0.1), 4),
    "terrain": Family(flight, terrain, thrown(0.1), 4),
    "graze": Family(orbit, circle, near_a_circle, 2),
    "constant 0.01": Family(orbit, energy, turning(0.99), 2),
    "constant 0.0001": Family(orbit, energy, turning(0.9999), 2),
    "constant 0": Family(orbit, energy, turning(1.0), 2, can_be_proven=False),
    "double root": Family(
        orbit, double_root, turning(between(-0.9, 0.9)), 2, can_be_proven=False
    ),
    "flat root": Family(orbit, flat_root, turning(between(-0.9, 0.9)), 2),
    "dead zone": Family(
        orbit, dead_zone, turning(between(-0.9, 0.9)), 2, can_be_proven=False
    ),
}


ALL = {**FAMILIES, **WILD}


@cache
def guard_of(name: str) -> Any:
    """Return the guard of a family, compiled; the rate of a plain one is not known."""
    family = ALL[name]
    if not family.is_plain:
        return kept_njit()(family.guard)
    value = njit(family.guard)

    @njit
    def with_rate(t, y, dy, p):
        return value(t, y, p), np.nan

    return with_rate


@cache
def system_of(name: str) -> System:
    """Return the system of a family."""
    family = ALL[name]
    if family.is_plain:
        return System(
            family.field, family.guard, n_states=family.n_states, guard_names=("h",)
        )
    height = guard_of(name)

    @guards
    def one(t, y, dy, mode, params, h, hdot):
        h[0], hdot[0] = height(t, y, dy, params)

    return System(family.field, one, n_states=family.n_states, guard_names=("h",))


@cache
def sampler(name: str) -> Any:
    height = guard_of(name)

    @kept_njit()
    def sample(t, y, p, h):
        for j in range(len(t)):
            h[j] = height(t[j], y[:, j], y[:, j], p)[0]

    return sample


def run(name: str, rtol: float, rng: np.random.Generator, **options: Any) -> Solution:
    """Return the solution of a random member."""
    start, params, end = ALL[name].draw(rng)
    return solve(
        system_of(name), (0.0, end), start, params=params, rtol=rtol, atol=1e-3 * rtol,
        **options,
    )  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """What a run has found, compared with samples of its own path."""

    events: int
    missed: int
    spurious: int
    displaced: int
    solution: Solution


def judged(
    name: str,
    rtol: float,
    rng: np.random.Generator,
    samples: int = SAMPLES,
    **options: Any,
) -> Verdict:
    """Solve a random member, and compare its events with samples of its path.

    The side of the guard is sampled, and compared with its lock. Where they differ over
    a stretch, a crossing and its return are missed, if no flip is at its ends;
    spurious, if there is one at both; and if there is one at one of them, it is
    displaced: a step that is taken again up to a flip has errors of its own.
    """
    start, params, end = ALL[name].draw(rng)
    solution = solve(
        system_of(name), (0.0, end), start, params=params, rtol=rtol, atol=1e-3 * rtol,
        dense_output=True, **options,
    )  # fmt: skip
    log = solution.events
    # Also between each two events, however near they are.
    middles = 0.5 * (log.time[1:] + log.time[:-1])
    times = np.sort(
        np.concatenate([np.linspace(0.0, solution.t_end, samples), middles])
    )
    h = np.empty(len(times))
    states = np.ascontiguousarray(solution(times))
    sampler(name)(times, states, np.asarray(params), h)
    number = np.searchsorted(log.time, times, side="right")
    directions = np.concatenate([[0], log.direction])
    directions[0] = -directions[1] if len(log) > 0 else np.sign(h[np.argmax(abs(h))])
    lock = directions[number]
    wrong = (np.sign(h) != lock) & (abs(h) > GREY * abs(h).max())
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wrong, [False]])))
    missed, spurious, displaced = 0, 0, 0
    padded = np.concatenate([[0], number, [len(log)]])
    for first, after in edges.reshape(-1, 2):
        flips_before = padded[first + 1] != padded[first]
        flips_after = padded[after + 1] != padded[after]
        if flips_before != flips_after:  # a flip is only not where the samples have it
            displaced += 1
        elif flips_before:
            spurious += 2
        else:
            missed += 2
    return Verdict(len(log), missed, spurious, displaced, solution)
