"""The functions of a scene, compiled by Numba for the peers that take callbacks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numba import njit

from peers.problems import Problem
from peers.solver import HYSTERESIS, FloatArray


@dataclass(frozen=True, eq=False)
class Compiled:
    """Compiled functions on ``data``, which holds the coefficients, then the locks.

    Parameters
    ----------
    data : array
        Coefficients and locks at the start.
    field : callable
        ``field(y, data)`` returns the rate of the state; ``fill(y, data, dy)`` fills it.
    nearest : callable
        ``nearest(y, data)`` is least distance to a guard, positive until one is crossed.
    flip : callable
        ``flip(y, data)`` flips the locks of the guards that are crossed, and sets the coefficients.
    """

    data: FloatArray
    field: Any
    fill: Any
    nearest: Any
    flip: Any


@cache
def compiled(problem: Problem) -> Compiled:
    """Compile a scene (at the first call of each function)."""
    rate, height = njit(problem.slope(math)), njit(problem.height(math))
    coefficients, n_guards = njit(problem.coefficients), problem.n_guards
    start = np.array(problem.coefficients(problem.locks), dtype=np.float64)
    first = len(start)

    @njit(error_model="numpy")
    def field(y: FloatArray, data: FloatArray) -> FloatArray:
        return np.array(rate(y, data))

    @njit(error_model="numpy")
    def fill(y: FloatArray, data: FloatArray, dy: FloatArray) -> None:
        rates = rate(y, data)
        for i in range(len(rates)):
            dy[i] = rates[i]

    @njit(error_model="numpy")
    def nearest(y: FloatArray, data: FloatArray) -> float:
        least = np.inf
        for k in range(n_guards):
            least = min(least, data[first + k] * height(y, k))
        return least + HYSTERESIS

    @njit(error_model="numpy")
    def flip(y: FloatArray, data: FloatArray) -> None:
        locks = data[first:]
        for k in range(n_guards):
            if locks[k] * height(y, k) <= 0.0:
                locks[k] = -locks[k]
        values = coefficients(locks)
        for i in range(first):
            data[i] = values[i]

    return Compiled(np.concatenate([start, problem.locks]), field, fill, nearest, flip)
