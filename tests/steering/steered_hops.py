"""Tables of frame changes for tests: smooth maps with known values, and a chain of hops."""

import numpy as np

from hopdata.steering.frame_changes import FrameChanges
from hopdata.steering.strides import USED

LIMIT = 3 * np.pi / 8


def smooth_change(angle, swing):
    """Return frame changes of the hopper's size, periodic in the boom angle; (n, 3)."""
    return np.column_stack(
        [
            0.05 + 0.02 * np.cos(angle) + 0.01 * np.sin(swing),
            0.02 * np.sin(angle + swing),
            0.12 * np.sin(swing) + 0.03 * np.cos(angle),
        ]
    )


def chained_hops(n=120, *, noise=0.0, seed=0):
    """Return hops in one chain."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    swing = rng.uniform(-LIMIT, LIMIT, n)
    angle = np.append(0.0, np.cumsum(swing))[:-1] % (2 * np.pi)
    change = smooth_change(angle, swing) + noise * rng.standard_normal((n, 3))
    return FrameChanges.hops(
        recording=np.full(n, "chain"),
        time_s=0.6 * np.arange(n),
        boom_angle_rad=angle,
        swing_rad=swing,
        change=change,
        reason=np.full(n, USED),
    )
