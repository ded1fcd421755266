"""The least that a step can cost: DOPRI5 for one scene, written by hand for its two states.

No tables, no events, no dense output, no step control: the sums of the stages, the error norm, and
the hopper's field in the middle of them, all in registers. Nobody would write an integrator like
this; it is what the time of ours is compared with where the field costs next to nothing.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from bare import TINY_STEP, best_time
from numba import njit
from numpy.typing import NDArray

from hopdata.hybrid.methods.explicit import DOPRI5

STEPS = 20_000  # in a row
(A21,), (A31, A32), (A41, A42, A43), (A51, A52, A53, A54), A6 = DOPRI5.stages
A61, A62, A63, A64, A65 = A6
B1, _, B3, B4, B5, B6 = DOPRI5.weights
E1, _, E3, E4, E5, E6, E7 = DOPRI5.errors[0]


@njit(error_model="numpy")
def _rate(z: float, v: float, lock: int, p: NDArray[np.float64]) -> tuple[float, float]:
    """Return the field of `hopdata.scenes.small`, of numbers."""
    gravity, stiffness, rest_length, damping = p[0], p[1], p[2], p[3]
    push = stiffness * (rest_length - z) - damping * v if lock < 0 else 0.0
    return v, push - gravity


@njit(error_model="numpy")
def _steps(count: int, z: float, v: float, lock: int, p: NDArray[np.float64], dt: float) -> float:
    """Take so many steps; return the sum of their errors, so that nothing may be left out."""
    tolerance, total = 1e-9, 0.0
    k1, m1 = _rate(z, v, lock, p)
    for _ in range(count):
        k2, m2 = _rate(z + dt * (A21 * k1), v + dt * (A21 * m1), lock, p)
        k3, m3 = _rate(
            z + dt * (A31 * k1 + A32 * k2), v + dt * (A31 * m1 + A32 * m2), lock, p
        )  # fmt: skip
        k4, m4 = _rate(
            z + dt * (A43 * k3 + (A41 * k1 + A42 * k2)),
            v + dt * (A43 * m3 + (A41 * m1 + A42 * m2)), lock, p,
        )  # fmt: skip
        k5, m5 = _rate(
            z + dt * ((A51 * k1 + A52 * k2) + (A53 * k3 + A54 * k4)),
            v + dt * ((A51 * m1 + A52 * m2) + (A53 * m3 + A54 * m4)), lock, p,
        )  # fmt: skip
        k6, m6 = _rate(
            z + dt * (A65 * k5 + ((A61 * k1 + A62 * k2) + (A63 * k3 + A64 * k4))),
            v + dt * (A65 * m5 + ((A61 * m1 + A62 * m2) + (A63 * m3 + A64 * m4))), lock, p,
        )  # fmt: skip
        z_end = z + dt * (B6 * k6 + ((B1 * k1 + B3 * k3) + (B4 * k4 + B5 * k5)))
        v_end = v + dt * (B6 * m6 + ((B1 * m1 + B3 * m3) + (B4 * m4 + B5 * m5)))
        k7, m7 = _rate(z_end, v_end, lock, p)
        z_error = (E1 * k1 + E3 * k3) + (E4 * k4 + E5 * k5) + (E6 * k6 + E7 * k7)
        v_error = (E1 * m1 + E3 * m3) + (E4 * m4 + E5 * m5) + (E6 * m6 + E7 * m7)
        e0 = dt * z_error / (tolerance + tolerance * max(abs(z), abs(z_end)))
        e1 = dt * v_error / (tolerance + tolerance * max(abs(v), abs(v_end)))
        total += sqrt(0.5 * (e0 * e0 + e1 * e1))
        z, v, k1, m1 = z_end, v_end, k7, m7
    return total


@njit(error_model="numpy")
def _rates(states: NDArray[np.float64], lock: int, p: NDArray[np.float64], rounds: int) -> float:
    """Evaluate the field along states, with nothing around it."""
    total = 0.0
    for _ in range(rounds):
        for i in range(len(states)):
            dz, dv = _rate(states[i, 0], states[i, 1], lock, p)
            total += dz + dv
    return total


def hopper_times_ns(params: tuple[float, ...], repeats: int) -> tuple[float, float]:
    """Return the times of a step and of an evaluation that is compiled into its loop, in stance."""
    p = np.array(params)
    states = np.ascontiguousarray(np.linspace([0.9, -1.0], [1.0, 1.0], 64))
    rounds = STEPS // len(states)

    def steps() -> float:
        return float(_steps(STEPS, 0.95, 0.0, -1, p, TINY_STEP))

    def rates() -> float:
        return float(_rates(states, -1, p, rounds))

    steps(), rates()
    step_s, rates_s = best_time(steps, repeats), best_time(rates, repeats)
    return 1e9 * step_s / STEPS, 1e9 * rates_s / (rounds * len(states))
