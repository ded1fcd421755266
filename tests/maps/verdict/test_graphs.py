import numpy as np
import pytest

from hopdata.maps.verdict.graphs import _arc_lengths


def rotated_pair(angles, seed):
    """Two spaces of eight dimensions with these angles, in a turned frame."""
    k = len(angles)
    first = np.eye(8)[:, :k]
    second = np.zeros((8, k))
    second[:k], second[k : 2 * k] = np.diag(np.cos(angles)), np.diag(np.sin(angles))
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((8, 8)))[0]
    return turn @ first, turn @ second


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("angles", "error"),
    [
        ([0.1, 0.5, 1.2], 1e-14),
        ([0.0, np.pi / 2, np.pi / 2], 1e-7),
        ([1e-3, 1.0, np.pi / 2 - 1e-3], 1e-7),
        ([0.0, 0.0, 0.0], 1e-7),
    ],
)
def test_arc_lengths_are_those_of_the_angles(angles, error, seed):
    length = _arc_lengths(*rotated_pair(angles, seed))
    assert length == pytest.approx(np.linalg.norm(angles), abs=error)
