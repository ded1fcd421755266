"""Made-up hops, in which it is known whether the contact order matters."""

import numpy as np

from hopdata.steering.frame_changes import FrameChanges
from hopdata.steering.strides import USED
from hopdata.steering.true_hops import TrueHops
from steering.steered_hops import LIMIT, smooth_change

ORDERS = np.array(["1>2>3", "2>3>1", "3>1>2"])
OFFSETS = np.array([[0.01, 0.0, 0.0], [-0.01, 0.01, 0.02], [0.0, -0.01, -0.02]])


def made_hops(
    n, *, by_state=0.0, by_order=0.0, order_of_state=True, noise=1e-3, seed=0
):
    """Return hops whose change depends on inputs, a hidden state and the landing order.

    The order follows from the state, or is drawn by chance.
    """
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, n)
    swing = rng.uniform(-LIMIT, LIMIT, n)
    apex = rng.standard_normal((n, 12))
    number = rng.integers(3, size=n)
    if order_of_state:
        number = np.digitize(apex[:, 4], [-0.4, 0.4])
    change = smooth_change(angle, swing) + noise * rng.standard_normal((n, 3))
    change += by_state * apex[:, 4:5] * [0.02, -0.02, 0.05]
    change += by_order * OFFSETS[number]
    changes = FrameChanges.hops(
        recording=np.full(n, "made"),
        time_s=0.6 * np.arange(n),
        boom_angle_rad=angle,
        swing_rad=swing,
        change=change,
        reason=np.full(n, USED),
    )
    return TrueHops(
        changes=changes,
        previous_swing_rad=rng.uniform(-LIMIT, LIMIT, n),
        apex=apex,
        lift_off=ORDERS[rng.integers(3, size=n)],
        landing=ORDERS[number],
    )
