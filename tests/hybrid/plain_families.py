"""Further kinds of guards, written as plain functions that return only a value.

They are for `benchmarks/proofs.py`; `families.WILD` has their members.
"""

from __future__ import annotations

import math
from math import pi

import numpy as np

POLYGON = np.array(
    [
        [-0.5, 0.0], [0.4, 0.05], [0.6, 0.3], [0.9, 0.3], [0.95, -0.1], [1.6, 0.1],
        [2.1, 0.45], [2.15, 0.0], [9.0, 0.0],
    ]
)  # fmt: skip
KNOTS = np.linspace(-1.57, 1.57, 13)
COEFFICIENTS = np.array([0.4, 0.8, 3.0, 9.0]) * np.random.default_rng(5).uniform(
    -1.0, 1.0, (14, 4)
)
SHARES = np.array([0.0, 2.0, 4.0]) * pi / 3.0


def flight(t, y):
    return y[2], y[3], 0.0, -9.81


def oscillators(t, y):
    return y[1], -y[0], 2.3 * y[3], -2.3 * y[2]


def double_pendulum(t, y):
    a, b, u, v = y
    s = np.sin(a - b)
    c = np.cos(a - b)
    falling_a = 9.81 * (2.0 * np.sin(a) - np.sin(b) * c)
    falling_b = 9.81 * 2.0 * (np.sin(a) * c - np.sin(b))
    rate_u = (-falling_a - s * (v * v + u * u * c)) / (2.0 - c * c)
    rate_v = (falling_b + s * (2.0 * u * u + v * v * c)) / (2.0 - c * c)
    return u, v, rate_u, rate_v


def rigid_body(t, y):  # a quaternion, and the rates about axes of inertia 1, 2, 3
    w, x, z, q, a, b, c = y
    return (
        0.5 * (-x * a - z * b - q * c), 0.5 * (w * a + z * c - q * b),
        0.5 * (w * b - x * c + q * a), 0.5 * (w * c + x * b - z * a),
        -b * c, a * c, -a * b / 3.0,
    )  # fmt: skip


def theta_neuron(t, y, p):
    return 1.0 - np.cos(y[0]) + (1.0 + np.cos(y[0])) * p[0]


def somersault(t, y):
    return y[3], y[4], y[5], 0.0, -9.81, 0.0


def polygon(t, y, p):
    best = 1e9
    for i in range(len(POLYGON) - 1):
        x, z = POLYGON[i]
        along, up = POLYGON[i + 1] - POLYGON[i]
        share = ((y[0] - x) * along + (y[1] - z) * up) / (along**2 + up**2)
        share = np.clip(share, 0.0, 1.0)
        best = min(best, math.hypot(y[0] - x - share * along, y[1] - z - share * up))
    return best - p[0]


def platform(t, y, p):
    return y[1] - p[0] * np.sin(p[1] * t) - 0.1 * np.sin(3.1 * p[1] * t)


def capsules(t, y, p):
    best = np.inf
    for k in range(3):
        along = y[0] + 0.8 - 0.7 * k
        up = y[2] - p[k]
        share = np.clip((0.5 * along + 0.2 * up) / 0.29, 0.0, 1.0)
        away = np.sqrt((along - 0.5 * share) ** 2 + (up - 0.2 * share) ** 2)
        best = np.minimum(best, away - 0.1)
    return best


def jagged_spline(t, y, p):
    i = np.searchsorted(KNOTS, y[0])
    s = y[0] - KNOTS[max(i - 1, 0)]
    c = COEFFICIENTS[i]
    return y[2] - (c[0] + s * (c[1] + s * (c[2] + s * c[3])))


def wrapped_angle(t, y, p):
    return (p[0] * y[0] + p[1] + pi) % (2.0 * pi) - pi - p[2]


def flips(t, y, p):
    return (y[1] + np.pi) % (2.0 * np.pi) - np.pi - p[0]


def pitch(t, y, p):
    return np.arcsin(np.clip(2.0 * (y[0] * y[2] - y[3] * y[1]), -1.0, 1.0)) - p[0]


def sawtooth_of_state(t, y, p):
    return y[0] - (t % p[0]) / p[0] * y[2] - p[1]


def pulse_width(t, y, p):
    on = t % p[0] < p[0] * (0.5 + 0.4 * y[0])
    return (1.0 if on else -1.0) - 0.3 * y[2]


def nested(t, y, p):
    if y[0] > p[0]:
        if y[1] > p[1]:
            return y[2] - 0.5
        if y[3] < 0.0:
            return y[2] + y[0] - 0.5
        return y[2] - 0.5 * y[3]
    x = y[2]
    while x < 0.3:
        x += 0.37
    return x - 0.5 - 0.1 * y[3]


def window(t, y, p):
    return 1.0 if abs(y[0] - p[0]) < p[1] and y[3] > 0.0 else -1.0


def spikes(t, y, p):
    return np.tan(0.5 * y[0]) - p[1]


def three_feet(t, y, p):
    x = y[0] + 0.3 * np.sin(y[2] + SHARES)
    z = y[1] - 0.3 * np.cos(y[2] + SHARES)
    return np.min(z - 0.05 * np.sin(20.0 * x))


def fourier(t, y, p):
    height = 0.0
    for k in range(1, 9):
        height += np.sin(3.0 * k * y[0] + p[k % 3]) / k
    return y[2] - 0.5 * height


def rounded(t, y, p):
    return np.sin(40.0 * (y[0] - round(y[0], 1))) - p[0] * y[2]
