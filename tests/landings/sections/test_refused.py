import numpy as np
import pytest

from hopdata.landings.sections.refused import feet_in_turn


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_diagonals_that_land_in_turn_are_two_groups(seed):
    rng = np.random.default_rng(seed)
    landed = np.zeros((100, 4), dtype=bool)
    landed[::2, [0, 3]] = True
    landed[1::2, [1, 2]] = True
    landed &= rng.random(landed.shape) > 0.05  # some are not seen
    assert feet_in_turn(landed) == [[0, 3], [1, 2]]
    # A foot that hardly lands, a run and a pronk are no such groups.
    rare = landed.copy()
    rare[4:, 2] = False
    assert feet_in_turn(rare) == []
    assert feet_in_turn(landed[:, [0, 1]]) == []
    assert feet_in_turn(rng.random((100, 4)) > 0.1) == []
    assert feet_in_turn(np.zeros((0, 4), dtype=bool)) == []
