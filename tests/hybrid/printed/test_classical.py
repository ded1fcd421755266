"""Regions of the printed method: locks at a start, orientation, what cannot be done."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball, ladder, throw
from octant_scene import octant

from hopdata.hybrid.printed import PrintedOptions, region_of


def test_locks_are_signs():
    region = region_of(octant())
    assert region.first_locks(0.0, np.array([-0.4, 0.15, 0.3])).tolist() == [-1, 1, -1]


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_a_guard_at_zero_has_the_mode_it_moves_into(zero):
    rising = region_of(throw(), (10.0, 1.0))
    assert rising.first_locks(0.0, np.array([1.0 + zero, 2.0])).tolist() == [1]
    assert rising.first_locks(0.0, np.array([1.0 + zero, -2.0])).tolist() == [-1]
    falling = region_of(throw(), (10.0, 1.0), orientation=(-1,))
    assert falling.first_locks(0.0, np.array([1.0 + zero, -2.0])).tolist() == [1]


def test_a_guard_at_rest_at_zero_is_not_crossed():
    assert region_of(throw(), (10.0, 1.0)).first_locks(0.0, np.array([1.0, 0.0])).tolist() == [-1]


def test_the_orientation_turns_events_and_mode():
    region, y = region_of(octant(), orientation=(1, -1, 1)), np.array([0.1, 0.2, 0.3])
    h, rates = region.events(0.0, y, np.array([1.0, 2.0, 3.0]), np.array([1, -1, -1]))
    assert h.tolist() == [0.1, -0.2, -0.3]
    assert rates.tolist() == [1.0, -2.0, -3.0]
    assert region.mode(np.array([1, -1, -1])).tolist() == [1, 1, -1]


def test_what_cannot_be_done_is_said():
    with pytest.raises(ValueError, match="on_event"):
        region_of(ball())
    for wrong in ((1,), (1, 0), (1, 1, 1)):
        with pytest.raises(ValueError, match="orientation"):
            region_of(ladder(2), orientation=wrong)
    with pytest.raises(ValueError, match="root_finder"):
        PrintedOptions(root_finder="newton")
