import numpy as np

from hopdata.maps.truth.scoring import MATCH_WITHIN_S, match_landings


def test_each_landing_is_matched_once_with_the_closest():
    true = np.array([[1.0, 1.02], [2.0, 2.02], [3.0, 3.02]])
    found = np.array(
        [[2.05, 2.06], [1.0, 1.0], [2.01, 2.02], [9.0, 9.0], [np.nan, np.nan]]
    )
    assert match_landings(found, true).tolist() == [-1, 0, 1, -1, -1]


def test_limit_and_empty_sides():
    true = np.array([[1.0]])
    near, far = (
        np.array([[1.0 + 0.9 * MATCH_WITHIN_S]]),
        np.array([[1.0 + 1.1 * MATCH_WITHIN_S]]),
    )
    assert match_landings(near, true).tolist() == [0]
    assert match_landings(far, true).tolist() == [-1]
    assert match_landings(near, np.empty((0, 1))).tolist() == [-1]
    assert match_landings(np.empty((0, 1)), true).shape == (0,)
