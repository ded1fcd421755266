"""Guards that bend: windows in which values and rates agree, also where numbers underflow."""

from __future__ import annotations

import math

import pytest

from hopdata.hybrid import System, field, guards, solve
from hopdata.hybrid.layout import RATE_DIFFERS


@field
def advance(t, y, mode, params, dy):
    dy[0] = 1.0


@guards
def steep(t, y, dy, mode, params, h, hdot):
    """Exponential less a level; far away it is the level, to all digits, and its rate is 0."""
    power = params[2] * math.exp(params[0] * (y[0] - 1))
    h[0] = power - params[1]
    hdot[0] = params[3] * params[0] * power * dy[0]


SYSTEM = System(advance, steep, n_states=1, guard_names=("g",))


def events(gain, level, size, right=1.0):
    end = min(1.2, 1 + 600 / gain)
    return solve(SYSTEM, (0, end), [0.0], params=[gain, level * size, size, right])


@pytest.mark.parametrize("gain", [10, 300, 700, 1000, 3000, 1e5])
@pytest.mark.parametrize("size", [1e10, 1.0, 1e-10])
@pytest.mark.parametrize(
    "level", [0.5, 1e-30, 1e-100, 1e-250, 1e-290, 1e-300, 1e-305, 1e-307]
)
def test_an_honest_rate_is_not_blamed_where_numbers_underflow(gain, level, size):
    if level * size < 1e-307:
        size = 1.0  # the level itself would be rounded
    crossed = 1 + math.log(level) / gain
    found = events(gain, level, size)
    assert found.success, found.message
    assert found.events.time == pytest.approx(
        [crossed] if crossed > 0 else [], abs=1e-7
    )


@pytest.mark.parametrize(
    ("gain", "level"), [(10, 0.5), (300, 0.5), (300, 1e-30), (1000, 1e-200)]
)
def test_a_wrong_rate_is_still_blamed(gain, level):
    assert events(gain, level, 1.0, right=1.5).status == RATE_DIFFERS
    assert events(gain, level, 1.0).success
