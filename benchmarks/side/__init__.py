# ruff: noqa: ARG001, ARG005 (the solvers prescribe the signatures)
"""Ten hybrid systems that are not ours, written once for every solver.

Formulas use the arithmetic of their arguments and receive the elementary functions
(math, numpy, jax.numpy, heyoka or mpmath), so all solvers integrate the same systems.
What changes only at events is the mode, a tuple of numbers. Every guard is positive
until its event, at which it falls through zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hopdata.arrays import FloatArray

Formula = Callable[..., Any]
REFERENCES = Path(__file__).with_name("references.csv")
MOST_EVENTS = 10_000


@dataclass(frozen=True, eq=False)
class Scene:
    """A hybrid system.

    Parameters
    ----------
    name, source : str
        Its name, and where it is from.
    t_span : tuple of float
        Start and end.
    y0, mode : tuple of float
        State and mode at the start.
    n_guards : int
        Number of guards.
    rates : callable
        ``rates(m)(t, y, c)`` is the rate of the state in mode c, with elementary
        functions of the module m.
    heights : callable
        ``heights(m)(t, y, c)`` are the guards.
    after : callable
        ``after(m)(t, y, c, k)`` are state and mode after an event of guard k.
    """

    name: str
    source: str
    t_span: tuple[float, float]
    y0: tuple[float, ...]
    mode: tuple[float, ...]
    n_guards: int
    rates: Formula
    heights: Formula
    after: Formula

    @property
    def start(self) -> FloatArray:
        """State at the start, (n,)."""
        return np.array(self.y0, dtype=np.float64)

    @cached_property
    def _reference(self) -> Any:
        table = pd.read_csv(REFERENCES, dtype={"value": str})
        return table[table["system"] == self.name]

    @property
    def end(self) -> FloatArray:
        """State at the end, from `references.py`, (n,)."""
        return np.array([float(one) for one in self._reference["value"]])

    @property
    def events(self) -> int:
        """Number of events, from `references.py`."""
        return int(self._reference["events"].iloc[0])


# A ball: DifferentialEquations.jl's, but for the restitution (there 1).
BALL_GRAVITY, BALL_RESTITUTION = 9.8, 0.8


def ball() -> Scene:
    """Return a ball that is dropped from 50 m."""

    def rates(_: Any) -> Formula:
        return lambda t, y, c: (y[1], 0.0 * y[0] - BALL_GRAVITY)

    def heights(_: Any) -> Formula:
        return lambda t, y, c: (y[0],)

    def after(_: Any) -> Formula:
        return lambda t, y, c, k: ((y[0], -BALL_RESTITUTION * y[1]), c)

    return Scene(
        "bouncing_ball", "documentation of DifferentialEquations.jl and of heyoka",
        (0.0, 25.0), (50.0, 0.0), (), 1, rates, heights, after,
    )  # fmt: skip


# A ball on a table that shakes (Holmes 1982): table A sin(w t), partly elastic.
SHAKE_M, SHAKE_RATE, SHAKE_RESTITUTION = 0.02, 25.0, 0.8


def shaken_ball() -> Scene:
    """Return a ball on a table that shakes."""

    def rates(_: Any) -> Formula:
        return lambda t, y, c: (y[1], 0.0 * y[0] - 9.81)

    def heights(m: Any) -> Formula:
        return lambda t, y, c: (y[0] - SHAKE_M * m.sin(SHAKE_RATE * t),)

    def after(m: Any) -> Formula:
        def bounced(t: Any, y: Any, c: Any, k: Any) -> Any:
            table = SHAKE_M * SHAKE_RATE * m.cos(SHAKE_RATE * t)
            faster = (1.0 + SHAKE_RESTITUTION) * table
            return (y[0], faster - SHAKE_RESTITUTION * y[1]), c

        return bounced

    return Scene(
        "shaken_ball", "Holmes, J. Sound Vib. 84 (1982)",
        (0.0, 4.0), (0.3, 0.0), (), 1, rates, heights, after,
    )  # fmt: skip


def thermostat() -> Scene:
    """Return a room whose heating a relay with hysteresis switches."""

    def rates(_: Any) -> Formula:
        return lambda t, y, c: (0.1 * (15.0 - y[0]) + c[0],)

    def heights(_: Any) -> Formula:
        return lambda t, y, c: (y[0] - 19.0, 21.0 - y[0])

    def after(_: Any) -> Formula:
        return lambda t, y, c, k: ((y[0],), (1.0 - k,))

    return Scene(
        "thermostat", "Henzinger, The theory of hybrid automata (1996)",
        (0.0, 60.0), (20.0,), (1.0,), 2, rates, heights, after,
    )  # fmt: skip


NEURON_CURRENT = 10.0


def neuron() -> Scene:
    """Return Izhikevich's neuron that spikes regularly; mV and ms."""

    def rates(_: Any) -> Formula:
        def slope(t: Any, y: Any, c: Any) -> Any:
            drive = 0.04 * y[0] * y[0] + 5.0 * y[0] + 140.0
            return drive - y[1] + NEURON_CURRENT, 0.02 * (0.2 * y[0] - y[1])

        return slope

    def heights(_: Any) -> Formula:
        return lambda t, y, c: (30.0 - y[0],)

    def after(_: Any) -> Formula:
        return lambda t, y, c, k: ((-65.0 + 0.0 * y[0], y[1] + 8.0), c)

    return Scene(
        "spiking_neuron", "Izhikevich, IEEE Trans. Neural Netw. 14 (2003)",
        (0.0, 200.0), (-65.0, -13.0), (), 1, rates, heights, after,
    )  # fmt: skip


# A boost converter under current-mode control; mA, V, ms, mH and uF.
BOOST_V, BOOST_MH, BOOST_MF, BOOST_OHM, BOOST_PEAK, BOOST_MS = (
    10.0,
    1.0,
    0.012,
    20.0,
    1.0,
    0.125,
)


def boost_converter() -> Scene:
    """Return a boost converter: a clock closes its switch, the current opens it.

    The mode is whether the switch is closed, and the next tick of the clock.
    """

    def rates(_: Any) -> Formula:
        def slope(t: Any, y: Any, c: Any) -> Any:
            is_open = 1.0 - c[0]
            rise = (BOOST_V - is_open * y[1]) / BOOST_MH
            return rise, (is_open * y[0] - y[1] / BOOST_OHM) / BOOST_MF

        return slope

    def heights(_: Any) -> Formula:
        return lambda t, y, c: (BOOST_PEAK - y[0], c[1] - t)

    def after(_: Any) -> Formula:
        return lambda t, y, c, k: (
            (y[0], y[1]), (0.0 + k, c[1] + k * BOOST_MS),
        )  # fmt: skip

    return Scene(
        "boost_converter", "Deane, IEEE Trans. Circuits Syst. I 39 (1992)",
        (0.0, 3.0625), (0.5, 15.0), (1.0, BOOST_MS), 2, rates, heights, after,
    )  # fmt: skip


def billiard() -> Scene:
    """Return a ball in an ellipse with the semiaxes 2 and 1."""

    def rates(_: Any) -> Formula:
        return lambda t, y, c: (y[2], y[3], 0.0 * y[0], 0.0 * y[1])

    def heights(_: Any) -> Formula:
        return lambda t, y, c: (1.0 - 0.25 * y[0] * y[0] - y[1] * y[1],)

    def after(_: Any) -> Formula:
        def reflected(t: Any, y: Any, c: Any, k: Any) -> Any:
            a, b = 0.25 * y[0], 1.0 * y[1]
            push = 2.0 * (a * y[2] + b * y[3]) / (a * a + b * b)
            return (y[0], y[1], y[2] - push * a, y[3] - push * b), c

        return reflected

    return Scene(
        "billiard", "Birkhoff's ellipse; heyoka's notebook on billiards",
        (0.0, 20.0), (0.1, 0.3, 0.8, 0.6), (), 1, rates, heights, after,
    )  # fmt: skip


WALL_RAD, WALL_RESTITUTION = -0.3, 0.8


def pendulum() -> Scene:
    """Return a driven pendulum that hits a wall."""

    def rates(m: Any) -> Formula:
        def slope(t: Any, y: Any, c: Any) -> Any:
            return y[1], -m.sin(y[0]) - 0.1 * y[1] + 0.5 * m.cos(1.6 * t)

        return slope

    def heights(_: Any) -> Formula:
        return lambda t, y, c: (y[0] - WALL_RAD,)

    def after(_: Any) -> Formula:
        return lambda t, y, c, k: ((y[0], -WALL_RESTITUTION * y[1]), c)

    return Scene(
        "wall_pendulum", "Moore and Shaw, Int. J. Non-Linear Mech. 25 (1990)",
        (0.0, 30.0), (0.8, 0.0), (), 1, rates, heights, after,
    )  # fmt: skip


MOON = 0.012277471
ORBIT_SPEED = -2.00158510637908252240537862224


def three_body() -> Scene:
    """Return Arenstorf's orbit; it crosses a plane, which changes nothing."""

    def rates(m: Any) -> Formula:
        def slope(t: Any, y: Any, c: Any) -> Any:
            from_earth, from_moon = y[0] + MOON, y[0] - (1.0 - MOON)
            earth = from_earth * from_earth + y[1] * y[1]
            moon = from_moon * from_moon + y[1] * y[1]
            pull = (1.0 - MOON) / (earth * m.sqrt(earth))
            tug = MOON / (moon * m.sqrt(moon))
            ax = y[0] + 2.0 * y[3] - pull * from_earth - tug * from_moon
            ay = y[1] - 2.0 * y[2] - pull * y[1] - tug * y[1]
            return y[2], y[3], ax, ay

        return slope

    def heights(_: Any) -> Formula:
        return lambda t, y, c: (c[0] * y[0],)

    def after(_: Any) -> Formula:
        return lambda t, y, c, k: ((y[0], y[1], y[2], y[3]), (-c[0],))

    return Scene(
        "three_body", "Arenstorf; Hairer, Norsett and Wanner, section II.0",
        (0.0, 16.0), (0.994, 0.0, 0.0, ORBIT_SPEED), (1.0,), 1, rates, heights, after,
    )  # fmt: skip


SPOKE, SLOPE = 0.3, 0.06  # half of the angle between spokes, and slope; rad


def wheel() -> Scene:
    """Return a wheel without a rim that rolls down a slope."""

    def rates(m: Any) -> Formula:
        return lambda t, y, c: (y[1], m.sin(y[0]))

    def heights(_: Any) -> Formula:
        return lambda t, y, c: (SLOPE + SPOKE - y[0],)

    def after(_: Any) -> Formula:
        keeps = float(np.cos(2.0 * SPOKE))
        return lambda t, y, c, k: ((y[0] - 2.0 * SPOKE, keeps * y[1]), c)

    return Scene(
        "rimless_wheel", "McGeer, Int. J. Robot. Res. 9 (1990)",
        (0.0, 30.0), (SLOPE - SPOKE, 0.6), (), 1, rates, heights, after,
    )  # fmt: skip


BELT, STATIC, KINETIC, FADES = 0.2, 1.0, 0.7, 3.0


def stick_slip() -> Scene:
    """Return a mass on a belt that sticks and slips; the mode is whether it sticks."""

    def rates(_: Any) -> Formula:
        def slope(t: Any, y: Any, c: Any) -> Any:
            friction = KINETIC / (1.0 + FADES * (BELT - y[1]))
            return y[1], (1.0 - c[0]) * (friction - y[0])

        return slope

    def heights(_: Any) -> Formula:
        def guards(t: Any, y: Any, c: Any) -> Any:
            return 1.0 - c[0] + c[0] * (STATIC - y[0]), c[0] + (1.0 - c[0]) * (
                BELT - y[1]
            )

        return guards

    def after(_: Any) -> Formula:
        return lambda t, y, c, k: ((y[0], BELT + 0.0 * y[1]), (0.0 + k,))

    return Scene(
        "stick_slip", "Leine et al., Nonlinear Dyn. 16 (1998)",
        (0.0, 50.0), (0.0, BELT), (1.0,), 2, rates, heights, after,
    )  # fmt: skip


def scenes() -> list[Scene]:
    """Return all systems that are not ours."""
    return [
        ball(), shaken_ball(), thermostat(), neuron(), boost_converter(), billiard(),
        pendulum(), three_body(), wheel(), stick_slip(),
    ]  # fmt: skip
