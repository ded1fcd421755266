"""The interpolant: fourth order inside a step, exact at its ends, and its derivative."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import growth

from hopdata.hybrid import solve


def error_between_mesh_points(step, *, where):
    """Largest error of samples at a fraction of each step, relative to the error at its end."""
    times = np.arange(0.0, 1.0 - step / 2, step) + where * step
    solution = solve(
        growth(), (0, 1), [1.0, 0.0], params=(1.0, 4.0), rtol=0.9, atol=1e9,
        max_step=step, first_step=step, t_eval=times,
    )  # fmt: skip
    return np.abs(solution.y[0] - np.exp(times)).max()


@pytest.mark.parametrize("where", [0.25, 0.5, 0.8])
def test_samples_converge_with_order_four_or_better(where):
    steps = 1.0 / np.array([8, 16, 32, 64])
    errors = [error_between_mesh_points(step, where=where) for step in steps]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 3.9 < order < 5.6


def test_the_interpolant_meets_the_mesh():
    bare = solve(growth(), (0, 1), [1.0, 0.0], params=(1.0, 4.0))
    near = np.nextafter(bare.t[1:-1], 0.0)
    sampled = solve(growth(), (0, 1), [1.0, 0.0], params=(1.0, 4.0), t_eval=near)
    assert np.abs(sampled.y - bare.y[:, 1:-1]).max() < 1e-14
