"""The choice of the method on the octants."""

from __future__ import annotations

import numpy as np
import pytest
from bent_systems import affine_landing

from hopdata.hybrid import solve
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant


@pytest.mark.parametrize("rtol", [1e-3, 1e-9, 1e-13])
def test_taylor_is_exact_to_rounding_where_modes_are_affine(rtol):
    """At any tolerance, for a pendulum without its sine, and for the octants against DOP853."""
    found = solve(octant(), T_SPAN, INITIAL_STATE, rtol=rtol, atol=rtol)
    other = solve(
        octant(), T_SPAN, INITIAL_STATE, method="dop853", rtol=2.3e-15, atol=1e-17
    )
    assert found.events.time == pytest.approx(other.events.time, abs=1e-14)
    assert found.y_end == pytest.approx(other.y_end, abs=2e-14)
    assert found.n_steps == 4
    free = (0.0, 0.0, -1.0, 0.0)  # has the spring after the release from the start
    swing = solve(
        affine_landing(), (0, 1.0), [1.0, 0.0], params=free, rtol=rtol, atol=rtol
    )
    rest = -9.81 / 400.0
    amplitude = 1.0 - rest
    exact = [rest + amplitude * np.cos(20.0), -20.0 * amplitude * np.sin(20.0)]
    assert swing.y_end == pytest.approx(exact, rel=1e-12)
