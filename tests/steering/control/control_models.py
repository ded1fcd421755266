"""Frame changes in closed form, for the tests of controllers."""

import numpy as np

from hopdata.steering.frame_changes import hopper_axes
from hopdata.steering.models.stride_table import StrideTable
from hopdata.steering.strides import turn_nodes

LIMIT = 3 * np.pi / 8


class ClosedForm:
    """A model like the plant: moves forward, turns with the swing, slows near a boom of pi."""

    axes = hopper_axes(LIMIT)
    next_state = axes.next_state

    def change(self, state, inputs):
        return self.change_and_gradient(np.ravel(state), np.ravel(inputs))[0]

    def change_and_gradient(self, boom_angle, swing):
        phi, u = np.asarray(boom_angle, float), np.asarray(swing, float)
        middle, zero = phi + u / 2, np.zeros_like(phi)
        pace = np.cos(middle)
        change = np.stack(
            [0.05 + 0.03 * pace, -0.025 * np.sin(middle), -0.11 * u * (1 + 0.8 * pace)],
            axis=-1,
        )
        by_middle = np.stack(
            [-0.03 * np.sin(middle), -0.025 * pace, 0.088 * u * np.sin(middle)], axis=-1
        )
        by_swing = by_middle / 2 + np.stack(
            [zero, zero, -0.11 * (1 + 0.8 * pace)], axis=-1
        )
        return change, np.stack([by_middle, by_swing], axis=-1)


def table(angles=96, swings=33):
    """Return the model as a table."""
    grid = np.meshgrid(
        turn_nodes(angles), np.linspace(-LIMIT, LIMIT, swings), indexing="ij"
    )
    values = ClosedForm().change_and_gradient(*grid)[0]
    return StrideTable.evenly_spaced(hopper_axes(LIMIT), values)


def random_states(n, seed, *, reach_m=1.0):
    """Return poses (n, 3) about the origin and boom angles (n,)."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    poses = rng.uniform(-1, 1, (n, 3)) * np.array([reach_m, reach_m, np.pi])
    return poses, rng.uniform(0, 2 * np.pi, n)
