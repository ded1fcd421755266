# ruff: noqa: ARG001 (the solvers prescribe the signatures)
"""Our integrator, with the systems written as a user writes them: plain functions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from peers import Found, LostEventError, Run, Solver

from hopdata.hybrid import System, solve, solve_batch
from side import (
    BALL_GRAVITY,
    BALL_RESTITUTION,
    BELT,
    BOOST_MF,
    BOOST_MH,
    BOOST_MS,
    BOOST_OHM,
    BOOST_PEAK,
    BOOST_V,
    FADES,
    KINETIC,
    MOON,
    NEURON_CURRENT,
    SHAKE_M,
    SHAKE_RATE,
    SHAKE_RESTITUTION,
    SLOPE,
    SPOKE,
    STATIC,
    WALL_RAD,
    WALL_RESTITUTION,
    Scene,
)

METHODS = ("auto", "dopri5", "dop853")
BATCH = 200


@dataclass(frozen=True)
class Ours:
    """A system, and the options of its solve."""

    system: System
    options: dict[str, Any]


def ball() -> Ours:
    def fall(t, y):
        return y[1], -BALL_GRAVITY

    def floor(t, y):
        return y[0]

    def bounce(t, y):
        return y[0], -BALL_RESTITUTION * y[1]

    return Ours(
        System(
            fall, floor, bounce, n_states=2, guard_names=("floor",), directions=(-1,)
        ),
        {},
    )


def shaken_ball() -> Ours:
    def fall(t, y):
        return y[1], -9.81

    def table(t, y):
        return y[0] - SHAKE_M * math.sin(SHAKE_RATE * t)

    def bounce(t, y):
        speed = SHAKE_M * SHAKE_RATE * math.cos(SHAKE_RATE * t)
        return y[0], (1.0 + SHAKE_RESTITUTION) * speed - SHAKE_RESTITUTION * y[1]

    return Ours(
        System(
            fall, table, bounce, n_states=2, guard_names=("table",), directions=(-1,)
        ),
        {},
    )


def thermostat() -> Ours:
    def room(t, y, mode):
        return 0.1 * (15.0 - y[0]) + mode[2]

    def thresholds(t, y):
        return y[0] - 19.0, 21.0 - y[0]

    def switch(t, y, mode, guard):
        mode[2] = 1 - guard

    names = ("cold", "warm")
    return Ours(
        System(room, thresholds, switch, n_states=1, guard_names=names, n_extra_modes=1,
               directions=(-1, -1)),
        {"mode": [1]},
    )  # fmt: skip


def neuron() -> Ours:
    def membrane(t, y):
        v, u = y
        drive = 0.04 * v * v + 5.0 * v + 140.0
        return drive - u + NEURON_CURRENT, 0.02 * (0.2 * v - u)

    def threshold(t, y):
        return y[0] - 30.0

    def spike(t, y):
        return -65.0, y[1] + 8.0

    return Ours(
        System(
            membrane,
            threshold,
            spike,
            n_states=2,
            guard_names=("spike",),
            directions=(1,),
        ),
        {},
    )


def boost_converter() -> Ours:
    def circuit(t, y, mode):
        is_open = 1.0 - mode[2]
        rise = (BOOST_V - is_open * y[1]) / BOOST_MH
        return rise, (is_open * y[0] - y[1] / BOOST_OHM) / BOOST_MF

    def thresholds(t, y, mode):
        return BOOST_PEAK - y[0], (1 + mode[3]) * BOOST_MS - t

    def switch(t, y, mode, guard):
        mode[2] = guard
        mode[3] += guard

    names = ("peak", "clock")
    return Ours(
        System(circuit, thresholds, switch, n_states=2, guard_names=names, n_extra_modes=2,
               directions=(-1, -1)),
        {"mode": [1, 0]},
    )  # fmt: skip


def billiard() -> Ours:
    def straight(t, y):
        return y[2], y[3], 0.0, 0.0

    def wall(t, y):
        return 1.0 - 0.25 * y[0] * y[0] - y[1] * y[1]

    def reflect(t, y):
        a, b = 0.25 * y[0], y[1]
        push = 2.0 * (a * y[2] + b * y[3]) / (a * a + b * b)
        return y[0], y[1], y[2] - push * a, y[3] - push * b

    return Ours(
        System(
            straight, wall, reflect, n_states=4, guard_names=("wall",), directions=(-1,)
        ),
        {},
    )


def pendulum() -> Ours:
    def swing(t, y):
        return y[1], -math.sin(y[0]) - 0.1 * y[1] + 0.5 * math.cos(1.6 * t)

    def wall(t, y):
        return y[0] - WALL_RAD

    def bounce(t, y):
        return y[0], -WALL_RESTITUTION * y[1]

    return Ours(
        System(
            swing, wall, bounce, n_states=2, guard_names=("wall",), directions=(-1,)
        ),
        {},
    )


def three_body() -> Ours:
    def bodies(t, y):
        from_earth, from_moon = y[0] + MOON, y[0] - (1.0 - MOON)
        earth = from_earth * from_earth + y[1] * y[1]
        moon = from_moon * from_moon + y[1] * y[1]
        pull = (1.0 - MOON) / (earth * math.sqrt(earth))
        tug = MOON / (moon * math.sqrt(moon))
        ax = y[0] + 2.0 * y[3] - pull * from_earth - tug * from_moon
        ay = y[1] - 2.0 * y[2] - pull * y[1] - tug * y[1]
        return y[2], y[3], ax, ay

    def plane(t, y):
        return y[0]

    return Ours(System(bodies, plane, n_states=4, guard_names=("plane",)), {})


def wheel() -> Ours:
    keeps = float(np.cos(2.0 * SPOKE))

    def roll(t, y):
        return y[1], math.sin(y[0])

    def spoke(t, y):
        return y[0] - SLOPE - SPOKE

    def step(t, y):
        return y[0] - 2.0 * SPOKE, keeps * y[1]

    return Ours(
        System(roll, spoke, step, n_states=2, guard_names=("spoke",), directions=(1,)),
        {},
    )


def stick_slip() -> Ours:
    def mass(t, y, mode):
        if mode[2] > 0:
            return y[1], 0.0
        return y[1], KINETIC / (1.0 + FADES * (BELT - y[1])) - y[0]

    def limits(t, y, mode):
        if mode[2] > 0:
            return STATIC - y[0], 1.0
        return 1.0, BELT - y[1]

    def change(t, y, mode, guard):
        mode[2] = guard
        return y[0], BELT

    names = ("slips", "sticks")
    return Ours(
        System(mass, limits, change, n_states=2, guard_names=names, n_extra_modes=1,
               directions=(-1, -1)),
        {"mode": [1]},
    )  # fmt: skip


SYSTEMS: dict[str, Callable[[], Ours]] = {
    "bouncing_ball": ball,
    "shaken_ball": shaken_ball,
    "thermostat": thermostat,
    "spiking_neuron": neuron,
    "boost_converter": boost_converter,
    "billiard": billiard,
    "wall_pendulum": pendulum,
    "three_body": three_body,
    "rimless_wheel": wheel,
    "stick_slip": stick_slip,
}


def solvers(scene: Scene) -> list[Solver]:
    """Return three methods in single calls and in batches, and lanes."""
    ours = SYSTEMS[scene.name]()
    calls = [
        Solver(
            "hopdata", "hopdata, call", method, partial(prepare, scene, ours, method)
        )
        for method in METHODS
    ]
    batches = [
        Solver("hopdata", "hopdata, batch", method,
               partial(prepare_batch, scene, ours, method), BATCH)
        for method in METHODS
    ]  # fmt: skip
    return calls + batches


def prepare(scene: Scene, ours: Ours, method: str, tolerance: float) -> Run:
    """Return a function that makes one call."""
    ours.system.compile(method)

    def run() -> Found:
        found = solve(
            ours.system, scene.t_span, scene.y0, rtol=tolerance, atol=tolerance,
            method=method, **ours.options,
        )  # fmt: skip
        if found.status != 0:
            raise LostEventError(found.message)
        return found.y_end, found.n_events

    return run


def prepare_batch(scene: Scene, ours: Ours, method: str, tolerance: float) -> Run:
    """Return a function that integrates a batch of copies on one thread."""
    ours.system.compile(method)
    starts = np.tile(scene.start, (BATCH, 1))

    def run() -> Found:
        batch = solve_batch(
            ours.system, scene.t_span, starts, rtol=tolerance, atol=tolerance,
            method=method, workers=1, **ours.options,
        )  # fmt: skip
        return batch.y_end[-1], int(batch.n_events[-1])

    return run
