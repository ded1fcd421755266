"""Tables of frame changes for tests: smooth maps with known values, and a chain of hops."""

import numpy as np

from hopdata.steering.frame_changes import FrameChanges
from hopdata.steering.strides import USED, Input, State, StrideAxes, Strides

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


# A robot with a state of each kind: moved or set by an input, or to be learned.
WALKER = StrideAxes(
    periodic=(State(name="phase", moved_by="leg_angle"), State(name="gait")),
    linear=(
        State(name="speed", unit="m_s"),
        State(name="last_push", unit="n", set_by="push"),
    ),
    inputs=(
        Input(name="leg_angle", lower=-0.5, upper=0.5),
        Input(name="push", unit="n", lower=0.0, upper=20.0),
    ),
)


def walked_strides(n, *, seed=0):
    """Return strides of a walker from random states, by smooth laws."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    state = rng.uniform(0, [2 * np.pi, 2 * np.pi, 1, 20], (n, 4))
    inputs = rng.uniform(WALKER.lower, WALKER.upper, (n, 2))
    phase, gait, speed, _ = state.T
    leg, push = inputs.T
    after = WALKER.next_state(state, inputs)
    after[:, 1] = (gait + 1.0 + 0.3 * np.sin(phase)) % (2 * np.pi)
    after[:, 2] = 0.5 * speed + 0.02 * push - 0.3 * leg
    change = np.column_stack(
        [
            0.2 * speed + 0.002 * push,
            0.05 * leg + 0.01 * np.sin(phase),
            0.3 * leg + 0.05 * np.cos(gait),
        ]
    )
    return Strides(
        axes=WALKER,
        recording=np.full(n, "walk"),
        time_s=0.5 * np.arange(n),
        state=state,
        inputs=inputs,
        change=change,
        next_state=after,
        reason=np.full(n, USED),
    )
