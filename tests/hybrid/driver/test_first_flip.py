"""The first flip in a step is the first of all guards, whichever is looked at first."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid import System, affine, field, guards, solve

# params: the two instants, and half the width of the dip


@field
def turning(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], -y[0]


@affine
def turning_affine(mode, params, a, b):
    a[0, 1], a[1, 0] = 1.0, -1.0
    b[:] = 0.0


@guards
def one_crossing_and_a_dip(t, y, dy, mode, params, h, hdot):
    """With y = (cos t, -sin t): sin(t - params[0]), and cos(params[2]) - cos(t - params[1])."""
    s, c = np.sin(params[0]), np.cos(params[0])
    h[0], hdot[0] = -s * y[0] - c * y[1], -s * dy[0] - c * dy[1]
    s, c = np.sin(params[1]), np.cos(params[1])
    h[1], hdot[1] = np.cos(params[2]) - c * y[0] + s * y[1], -c * dy[0] + s * dy[1]


SYSTEM = System(
    turning, one_crossing_and_a_dip, affine=turning_affine, n_states=2, guard_names=("line", "dip")
)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_a_dip_beside_a_crossing_is_neither_lost_nor_late(method):
    rng = np.random.default_rng(8)
    for _ in range(500):
        half = 10.0 ** rng.uniform(-3, -0.5)
        dip = rng.uniform(half, 3.0 - half)
        line = dip + half * rng.uniform(-2.0, 2.0)
        if not 0.01 < line < 2.99 or min(abs(abs(line - dip) - half), 3 - half - dip) < 1e-4:
            continue
        start = rng.uniform(0.0, 6.0)
        solution = solve(
            SYSTEM, (start, start + 3.0), [np.cos(start), -np.sin(start)],
            params=[start + line, start + dip, half], method=method, rtol=1e-10, atol=1e-12,
        )  # fmt: skip
        wanted = sorted([(line, 0), (dip - half, 1), (dip + half, 1)])
        assert solution.events.guard.tolist() == [guard for _, guard in wanted], (start, wanted)
        times = solution.events.time - start
        assert times == pytest.approx([time for time, _ in wanted], abs=1e-6), (start, wanted)
