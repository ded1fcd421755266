"""Landings on three feet whose difference fades with the delay, in a shape that is known.

A body lands with a tilt that sets its contact instants, some 10 ms apart. Its outcomes
are linear in its state, except for a multiple of the delay, passed through a function
that has the slope 1 at zero and is spent after some milliseconds. So the derivatives of
each order at the simultaneous contact, and their average over the landings, are exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from hopdata.maps.truth.maps import marker_motions, marker_states
from hopdata.maps.verdict.effect import contrasts, relative_size

MARKERS_M = np.array([[0.13, 0.03, -0.01], [-0.07, 0.11, 0.02], [-0.06, -0.14, -0.01]])
# Spreads and means of tilt, velocity and spin before the landing.
SPREADS = np.array([0.03, 0.03, 0.07, 0.07, 0.07, 0.3, 0.3, 0.2])
FALLING = np.array([0, 0, 0, 0, 0, 0, 0, -1.5, 0, 0, 0])
CONTACT_SPREAD_S = 0.01
ORDERS = np.array(list(permutations(range(3))))
# Change of the outcomes by a second of delay, in shares of that by a unit of tilt.
STRENGTH = 150.0
NOISE = 0.03

# Function of delay over time constant, and its derivative.
Pair = tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]
SHAPES: dict[str, Pair] = {
    "lasting": (lambda d: d, np.ones_like),
    "tanh": (np.tanh, lambda d: 1.0 / np.cosh(d) ** 2),
    "clip": (lambda d: np.minimum(d, 1.0), lambda d: (d < 1.0).astype(float)),
    "rational": (lambda d: d / (1.0 + d), lambda d: (1.0 + d) ** -2),
    "exponential": (lambda d: -np.expm1(-d), lambda d: np.exp(-d)),
    "atan": (np.arctan, lambda d: 1.0 / (1.0 + d**2)),
}
# Delays, and the sum of their slopes over those of "latest - mean".
DELAYS = {"latest - mean": 1.0, "latest - earliest": 2.0, "pairs": 3.0}


@dataclass(frozen=True)
class Fading:
    """Landings as `judge` takes them, and what is true of them.

    Attributes
    ----------
    before, after
        (n, 18) marker states at the two sections.
    instants
        (n, 3) contact instants, s.
    at_contact, average
        Size of the difference at the simultaneous contact, and of the derivatives
        averaged over the landings of each order.
    """

    before: np.ndarray
    after: np.ndarray
    instants: np.ndarray
    at_contact: float
    average: float


def parts(delay: str, order: np.ndarray) -> list[np.ndarray]:
    """Return the weights (3,) of the instants in each part of a delay, in one order."""
    each = np.eye(3)
    if delay == "latest - mean":
        return [each[order[2]] - 1.0 / 3.0]
    if delay == "latest - earliest":
        return [each[order[2]] - each[order[0]]]
    return [each[late] - each[early] for early, late in combinations(order, 2)]


def fading_landings(
    shape: str,
    delay: str,
    time_constant_s: float,
    seed: int,
    *,
    landings: int = 900,
    strength: float = STRENGTH,
    noise: float = NOISE,
) -> Fading:
    """Return landings whose difference fades in this shape of this delay.

    `strength` and `noise` are as `STRENGTH` and `NOISE`; noise is in standard
    deviations of the outcomes.
    """
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((landings, 8))
    angle = 2.0 * np.pi * np.arange(3) / 3.0
    onto = np.zeros((8, 3))
    onto[:2] = CONTACT_SPREAD_S * np.array([np.sin(angle), np.cos(angle)])
    instants = x @ onto
    smooth = rng.standard_normal((8, 11)) * np.repeat([0.01, 0.05, 0.2], [5, 3, 3])
    errors = noise * smooth.std(axis=0) * rng.standard_normal((landings, 11))
    bend = strength / DELAYS[delay] * smooth[0]

    function, derivative = SHAPES[shape]
    of_landing = np.argsort(instants, axis=1)
    added = np.zeros(landings)
    at_contact = []
    average = []
    for order in ORDERS:
        own = (of_landing == order).all(axis=1)
        slopes = np.zeros(3)
        mean_slopes = np.zeros(3)
        for weights in parts(delay, order):
            scaled = instants[own] @ weights / time_constant_s
            added[own] += time_constant_s * function(scaled)
            slopes += weights
            mean_slopes += weights * derivative(scaled).mean()
        at_contact.append(smooth.T + np.outer(bend, onto @ slopes))
        average.append(smooth.T + np.outer(bend, onto @ mean_slopes))
    outcomes = x @ smooth + np.outer(added, bend) + errors
    state = np.hstack([np.zeros((landings, 3)), x * SPREADS]) + FALLING
    sizes = [
        relative_size(
            marker_motions(MARKERS_M) @ np.array(maps), contrasts(ORDERS, np.ones(6))
        )
        for maps in (at_contact, average)
    ]
    return Fading(
        marker_states(state, MARKERS_M),
        marker_states(outcomes, MARKERS_M),
        instants,
        *sizes,
    )
