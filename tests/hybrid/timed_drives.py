"""Drives that jump in time, of a linear oscillator whose motion is known exactly.

Between two instants each drive is a straight line, so the exact motion is a product of
exponentials of matrices.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from hopdata.hybrid import System

# Parameters of a drive: frequency and damping ratio of the oscillator, period, a part
# of the period, and an instant.
OMEGA, ZETA, PERIOD, PART, START = range(5)
SPAN = 10.0
TABLE = np.array([0.0, 1.1, 2.0, 2.0 + 1e-6, 2.0 + 2e-6, 4.7, 5.0, 8.0])
VALUES = np.array([0.0, 1.0, 0.3, 4e3, 0.3, -1.0, 0.5, 0.0])


def square(t, p):
    return 1.0 if t % p[PERIOD] < p[PART] * p[PERIOD] else -1.0


def sign_of_sine(t, p):
    return np.sign(np.sin(2.0 * math.pi * (t - p[START]) / p[PERIOD]))


def sawtooth(t, p):
    turns = t / p[PERIOD]
    return 2.0 * (turns - np.floor(turns)) - 1.0


def triangle(t, p):
    turns = t / p[PERIOD]
    return abs(2.0 * (turns - math.floor(turns)) - 1.0)


def pulses(t, p):
    if t < p[START]:
        return 0.0
    since = (t - p[START]) % p[PERIOD]
    return 5.0 if since <= 0.1 * p[PART] * p[PERIOD] else 0.0


def ramp(t, p):
    return min(max((t - p[START]) / p[PERIOD], 0.0), 1.0)


def ramp_of_branches(t, p):
    if t <= p[START]:
        return 0.0
    if t > p[START] + p[PERIOD]:
        return 1.0
    return (t - p[START]) / p[PERIOD]


def narrow(t, p):
    """Return a pulse of a millionth of the span, with an area of 1."""
    width = 1e-6 * SPAN
    return 1.0 / width if p[START] < t < p[START] + width else 0.0


def pulse_widths(t, p):
    """Return a signal of pulses whose widths vary."""
    k = np.floor(t / p[PERIOD])
    width = p[PART] * (1.0 + 0.5 * np.sin(0.7 * k))
    return 1.0 if t / p[PERIOD] - k < width else 0.0


def table(t, p):
    return np.interp(t, TABLE, VALUES)


def _every(p, *parts):
    count = math.ceil(SPAN / p[PERIOD]) + 1
    return [(k + part) * p[PERIOD] for k in range(count) for part in parts]


def _of_square(p):
    return _every(p, 0.0, p[PART])


def _of_sine(p):
    return [p[START] + 0.5 * k * p[PERIOD] for k in range(-20, 400)]


def _of_sawtooth(p):
    return _every(p, 0.0)


def _of_triangle(p):
    return _every(p, 0.0, 0.5)


def _of_pulses(p):
    return [p[START] + one for one in _every(p, 0.0, 0.1 * p[PART])]


def _of_ramp(p):
    return [p[START], p[START] + p[PERIOD]]


def _of_narrow(p):
    return [p[START], p[START] + 1e-6 * SPAN]


def _of_pulse_widths(p):
    count = math.ceil(SPAN / p[PERIOD]) + 1
    found = []
    for k in range(count):
        width = p[PART] * (1.0 + 0.5 * np.sin(0.7 * k))
        found += [k * p[PERIOD], (k + width) * p[PERIOD]]
    return found


def _of_table(p):
    return TABLE.tolist()


class Drive(NamedTuple):
    """A drive, and its instants for given parameters."""

    function: Callable[..., float]
    instants: Callable[..., list[float]]


DRIVES = {
    "square": Drive(square, _of_square),
    "sign of sine": Drive(sign_of_sine, _of_sine),
    "sawtooth": Drive(sawtooth, _of_sawtooth),
    "triangle": Drive(triangle, _of_triangle),
    "pulses": Drive(pulses, _of_pulses),
    "ramp": Drive(ramp, _of_ramp),
    "ramp of branches": Drive(ramp_of_branches, _of_ramp),
    "narrow pulse": Drive(narrow, _of_narrow),
    "pulse widths": Drive(pulse_widths, _of_pulse_widths),
    "table": Drive(table, _of_table),
}


def parameters(seed):
    """Return random parameters."""
    rng = np.random.default_rng(np.random.SeedSequence([2026, seed]))
    omega = rng.uniform(0.5, 6.0)
    zeta = rng.uniform(0.0, 0.3)
    period = rng.uniform(0.2, 2.0)
    return np.array(
        [omega, zeta, period, rng.uniform(0.15, 0.6), rng.uniform(1.0, 6.0)]
    )


def oscillator(drive, **options):
    """Return the system of an oscillator with a drive."""
    push = drive.function

    def field(t, y, p):
        return y[1], push(t, p) - p[0] * p[0] * y[0] - 2.0 * p[1] * p[0] * y[1]

    return System(field, n_states=2, **options)


def instants_within(drive, p):
    """Return the instants of a drive within the span, and its ends."""
    inside = {one for one in drive.instants(p) if 0.0 < one < SPAN}
    return np.array([0.0, *sorted(inside), SPAN])


def exact_end(drive, p, y0):
    """Return the exact state at the end of the span."""
    matrix = np.zeros((4, 4))
    matrix[0, 1] = 1.0
    matrix[1] = [-(p[OMEGA] ** 2), -2.0 * p[ZETA] * p[OMEGA], 1.0, 0.0]
    matrix[2, 3] = 1.0
    state = np.asarray(y0, dtype=np.float64)
    times = instants_within(drive, p)
    for begin, end in pairwise(times):
        length = end - begin
        first = drive.function(begin + length / 3.0, p)
        second = drive.function(end - length / 3.0, p)
        slope = (second - first) / (length / 3.0)
        push = [first - slope * length / 3.0, slope]
        state = (expm(length * matrix) @ [*state, *push])[:2]
    return state
