"""Where table 4.3 ends, by matrix exponentials, and when its guards are crossed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

START, END = (-0.4, -0.15, 0.3), 0.5


def flow(rows, time, state):
    whole = np.zeros((4, 4))
    whole[:3, :3], whole[:3, 3] = rows, (1.0, 1.0, -1.0)
    return (expm(whole * time) @ np.append(state, 1.0))[:3]


@pytest.fixture(scope="session")
def octant_truth():
    """Instants at which y, z and x are crossed, and the state at 0.5."""
    modes = (
        ([[0, -1, 0], [1, 0, 0], [0, 0, -1]], 1),
        ([[0, 1, 0], [-1, 0, 0], [0, 0, -1]], 2),
        ([[0, 1, 0], [-1, 0, 0], [0, 0, 3]], 0),
    )
    state, times = np.array(START), [0.0]
    for rows, axis in modes:
        span = brentq(lambda t: flow(rows, t, state)[axis], 1e-9, 0.3, xtol=1e-16)  # noqa: B023
        state = flow(rows, span, state)
        times.append(times[-1] + span)
    last = [[10, 0, 0], [0, 1, 0], [0, 0, 3]]
    return np.array(times[1:]), flow(last, END - times[-1], state)
