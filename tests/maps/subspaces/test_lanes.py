import numpy as np
from numba import njit

from hopdata.maps.subspaces.lanes import LANES, any_above, load, root, spread, store, where_above


@njit
def compute(a, b, out):
    """Do one of everything, and return whether some sum of squares is above 4."""
    x, y = load(a, 0), load(b, LANES)
    total = x * x + y * y
    store(out, 0, root(total))
    store(out, LANES, (x - y) / spread(3.0))
    store(out, 2 * LANES, where_above(x, y, x, y))
    return any_above(total, spread(4.0))


def test_every_lane_is_computed_as_a_number_would_be():
    a, b = np.random.default_rng(0).normal(size=(2, 2, LANES))
    out = np.zeros((3, LANES))
    above = compute(a.ravel(), b.ravel(), out)
    x, y = a[0], b[1]
    assert np.array_equal(out[0], np.sqrt(x * x + y * y))
    assert np.array_equal(out[1], (x - y) / 3.0)
    assert np.array_equal(out[2], np.maximum(x, y))
    assert above == (x * x + y * y > 4).any()


def test_nothing_is_above_nan():
    a, b = np.zeros(2 * LANES), np.zeros(2 * LANES)
    a[0] = np.nan
    out = np.zeros((3, LANES))
    assert not compute(a, b, out)
    assert out[2, 0] == 0.0
    a[1] = 3.0
    assert compute(a, b, out)
