"""Code with whole arrays for duals and ranges: against differences, and against samples."""

from __future__ import annotations

import os

import numpy as np
import pytest
from numba import njit
from range_harness import COMPARED, OUTSIDE, RATES_OUTSIDE, UNKNOWN, Ranged, boxes

from hopdata.hybrid.compiled.memory import array_at
from hopdata.hybrid.numbers import duals

WIDTH = 2
A = np.array([[1.0, 2.0, 3.0], [0.0, 1.0, -1.0], [2.0, 0.5, 0.0]])
W = np.array([0.7, -1.0, 0.2])
NAMES = {"np": np, "A": A, "W": W}

# Bodies that fill out (3,) from t, y (3,) and numbers. Each compiles for a second, so a
# test takes some of them. The last have no meaning for ranges.
BODIES = (
    "out[:] = y * 3.0",
    "out[:] = 2 * y - W / (1.0 + y ** 2)",
    "out[0] = t; out[1:] = y[1:] * 3 - y[:2]",
    "out[:] = np.sin(y) * t + y[::-1]",
    "dy = np.zeros(3); dy[0] = y[1]; out[:] = dy",
    "dy = np.empty(3); dy[:] = y; out[:] = dy + np.ones(3)",
    "dy = np.zeros_like(y); dy[1] = y[0]; out[:] = dy",
    "out[:] = A @ y",
    "out[:] = np.dot(y, A) + np.dot(A, y)",
    "out[0] = np.dot(y, W); out[1] = np.sum(y); out[2] = np.linalg.norm(y)",
    "out[:] = np.array([y[0], 1.0, y[2] * y[1]])",
    "R = np.array([[np.cos(y[0]), -np.sin(y[0])], [np.sin(y[0]), np.cos(y[0])]]); "
    "out[:2] = R @ y[1:]; out[2] = 0.0",
    "a = np.array([0.0, 0.0, 1.0]); a[0] = y[1]; out[:] = a",
    "a = np.full(3, 2.0); a[0] = y[1]; out[:] = a * np.full(3, y[2])",
    "out[:] = y; out += 2.0 * y; out *= W; out -= t",
    "out[:] = np.maximum(y, 0.1) + np.minimum(W, y)",
    "out[:] = np.where(y > 0.1, y, y * y) + np.where(y < W, y, 0.0)",
    "out[:] = np.clip(y, 0.0, 0.5) + np.abs(y)",
    "out[0] = y.sum(); out[1] = y.max(); out[2] = y.mean() * np.min(y)",
    "out[:] = np.array((y[2], y[0], 1.0)) + y.copy()",
    "M = np.zeros((3, 3)); M[0, 0] = y[0]; M[1] = y; out[:] = M @ y",
    "M = np.eye(3); M[0, 1] = y[0]; out[:] = M.T @ y",
    "out[:] = np.cross(y, W) + np.outer(y, y)[1]",
    "out[:] = np.cumsum(y); out[1:] += np.diff(y)",
    "out[:] = np.concatenate((y[:1], W[1:] * y[1:]))",
    "out[:] = np.sqrt(np.sum(y ** 2)) * y / (1.0 + np.linalg.norm(y))",
    "d = y[0] - W; out[:] = np.exp(-d ** 2) * d",
    "n = np.zeros(2, dtype=np.int64); n[1] = 2; out[:] = y[n[1]]",
    "out[:] = helper(y[:2], t) * np.prod(y)",
    "s = 0.0\n    for v in y:\n        s += v * v\n    out[:] = s",
    "for i, v in enumerate(y):\n        out[i] = v * i",
    "for v, w in zip(y, W):\n        out[0] = v * w\n    out[1:] = [v * 2 for v in y][1]",
    "out[:] = 0.0\n    for i in range(3):\n        out[i] += (A[i] * y).sum() - y.dot(W)",
)  # fmt: skip
ONLY_DUALS = (
    "out[:] = np.linalg.solve(A + np.outer(y, y), W * t)",
    "out[:] = np.linalg.inv(A * (2.0 + y[0])) @ y",
)


@njit
def helper(part, t):
    made = np.zeros(2)
    made[0] = part[1] * t
    made[1] = part[0]
    return made[0] - made[1]


def lines_of(body):
    return body.replace("; ", "\n    ") if "\n" not in body else body


def filler(body):
    """Return the function that fills out."""
    scope = {**NAMES, "helper": helper}
    exec(f"def fill(t, y, out):\n    {lines_of(body)}", scope)
    return scope["fill"]


#: Each compiles for a second.
EVERY = 4 if "ALL" in os.environ else 16


@pytest.mark.parametrize("body", BODIES[::EVERY] + BODIES[18:19] + ONLY_DUALS[:1])
def test_duals_have_the_slopes_of_differences(body):
    fill = filler(body)
    inner = njit(error_model="numpy")(fill)
    rows = array_at(duals.Dual(WIDTH))

    @njit
    def through(t, given, address):
        inner(t, rows(given, 3), rows(address, 3))

    draw = np.random.default_rng(np.random.SeedSequence(581))
    for _ in range(4):
        y = draw.uniform(-1.0, 1.0, 3)
        seeds = draw.normal(size=(3, WIDTH))
        given = np.hstack([y[:, None], seeds])
        found = np.full((3, 1 + WIDTH), np.nan)
        through(0.3, given.ctypes.data, found.ctypes.data)
        expected = np.full(3, np.nan)
        fill(0.3, y, expected)
        np.testing.assert_allclose(found[:, 0], expected, rtol=1e-13, atol=1e-14)
        step = 1e-6
        for slopes, direction in zip(found[:, 1:].T, seeds.T, strict=True):
            ends = np.zeros((2, 3))
            fill(0.3, y + step * direction, ends[0])
            fill(0.3, y - step * direction, ends[1])
            difference = (ends[0] - ends[1]) / (2.0 * step)
            np.testing.assert_allclose(slopes, difference, rtol=1e-6, atol=1e-7)


def many(bodies):
    """Return guards, one for each body: the sum of what it fills, with weights."""
    text = ["def many(t, y, dy, mode, params, k, h, hdot):", "    hdot[k] = 0.0"]
    scope = {**NAMES, "helper": helper}
    for k, body in enumerate(bodies):
        exec(f"def fill{k}(t, y, out):\n    {lines_of(body)}", scope)
        scope[f"fill{k}"] = njit(error_model="numpy")(scope[f"fill{k}"])
        text += [
            f"    if k == {k}:",
            "        out = np.zeros(3)",
            f"        fill{k}(t, y, out)",
            f"        h[{k}] = out[0] - 2.0 * out[1] + 0.5 * out[2]",
        ]
    exec("\n".join(text), scope)
    return Ranged(scope["many"], len(bodies))


def test_unit_matrices_of_a_given_type_hold_ranges():
    body = (
        "M = np.eye(3, dtype=np.float64); K = np.identity(3, np.float64); "
        "L = np.identity(3, dtype=float); M[0, 1] = y[0]; K[1, 0] = y[1]; "
        "L[2] = y; out[0] = M[0, 1] + M[0, 0]; out[1] = K[1, 0] - K[2, 2]; "
        "out[2] = L[2, 2] * L[1, 1]"
    )
    ranged = many((body,))
    draw = np.random.default_rng(np.random.SeedSequence(583))
    found = ranged.over(boxes(draw, 20), 0, draw).sum(axis=0)
    assert found[OUTSIDE] == 0
    assert found[RATES_OUTSIDE] == 0
    assert found[COMPARED] > 400
    assert found[UNKNOWN] == 0


#: They compile for 2 s each.
SOME_BODIES = BODIES[2 :: 5 if "ALL" in os.environ else 20] + BODIES[18:19]


def test_no_sample_is_outside_of_ranges():
    ranged = many(SOME_BODIES)
    draw = np.random.default_rng(np.random.SeedSequence(582))
    for k, body in enumerate(SOME_BODIES):
        found = ranged.over(boxes(draw, 150), k, draw).sum(axis=0)
        assert found[OUTSIDE] == 0, body
        assert found[RATES_OUTSIDE] == 0, body
        assert found[COMPARED] > 3000
        assert found[UNKNOWN] < 75, body
