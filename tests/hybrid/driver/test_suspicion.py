"""Which guards are suspect by their cubics: none that comes near is passed over."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.driver.hermite import cubic
from hopdata.hybrid.driver.suspicion import CROSSING, DIP, GRAZE, PASS, UNSURE, suspect


def test_a_guard_that_stays_clear_is_not_suspect():
    """Against the cubic on a grid: nothing that comes near the surface is passed over."""
    rng = np.random.default_rng(11)
    kinds = {PASS: 0, CROSSING: 0, DIP: 0}
    grid = np.linspace(0, 1, 401)
    for _ in range(3000):
        g0, d0, g1, d1 = rng.uniform(0, 1), rng.normal() * 2, rng.uniform(-0.1, 1), rng.normal() * 2
        kind = suspect(g0, d0, g1, d1, 0.0)[0]
        kinds[kind] += 1
        lowest = cubic(g0, d0, g1, d1, grid).min()
        assert (kind == CROSSING) == (g1 < 0)
        if g1 >= 0:
            inside = lowest < min(g0, g1) - 1e-12
            near = lowest < max(GRAZE * max(g0, g1), UNSURE * (min(g0, g1) - lowest))
            assert (kind == DIP) == (inside and near)
    assert min(kinds.values()) > 100


@pytest.mark.parametrize("size", [1.0, 1e3, 1e9])
def test_what_does_not_turn_is_no_dip_whatever_its_size(size):
    """An inclined guard far from its surface: there is no place in the step to look at."""
    assert suspect(1.0 * size, -0.6 * size, 0.3 * size, -0.8 * size, 0.0)[0] == PASS
