"""The interpolant on the octants."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid import solve
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant


@pytest.mark.parametrize("method", ["auto", "taylor", "dop853"])
def test_octants(method):
    """Taylor's series takes one step from event to event and is exact to rounding."""
    times = np.linspace(*T_SPAN, 401)
    found = solve(octant(), T_SPAN, INITIAL_STATE, method=method, t_eval=times)
    truth = solve(
        octant(), T_SPAN, INITIAL_STATE, method="dop853", rtol=1e-14, atol=1e-16,
        max_step=0.01, t_eval=times,
    )  # fmt: skip
    assert np.abs(found.y - truth.y).max() < (1e-8 if method == "dop853" else 1e-13)
