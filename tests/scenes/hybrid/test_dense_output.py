"""`solution(t)` on the scenes: the state at any time, on both sides of an event."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid import solve
from hopdata.hybrid.methods.table import choices
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant
from hopdata.scenes.vertical_hopper import VerticalHopper


@pytest.mark.parametrize("method", choices())
@pytest.mark.parametrize("backward", [False, True])
def test_it_is_the_polynomial_of_the_samples(method, backward):
    hopper = VerticalHopper()
    for system, t_span, y0, params in (
        (octant(), T_SPAN, INITIAL_STATE, ()),
        (hopper.system(), (0.0, 1.3), (1.3, 0.2), hopper.params),
    ):
        span = t_span[::-1] if backward else t_span
        start = solve(system, t_span, y0, params=params).y_end if backward else y0
        times = np.linspace(*span, 333)
        options = {"params": params, "method": method}
        dense = solve(system, span, start, dense_output=True, t_eval=times, **options)
        plain = solve(system, span, start, **options)
        assert dense(times) == pytest.approx(dense.y, rel=1e-13, abs=1e-13)
        assert dense.y_end.tobytes() == plain.y_end.tobytes()
        assert dense.n_steps == plain.n_steps
        assert dense(span[1]).tolist() == dense.y_end.tolist()
        again = solve(system, span, start, dense_output=True, **options)
        assert again.t.tobytes() == plain.t.tobytes()
        assert again.y.tobytes() == plain.y.tobytes()
        assert again(times).tobytes() == dense(times).tobytes()
        assert again(plain.t).tobytes() == plain.y.tobytes()
