import numpy as np
import pytest

from hopdata.maps.unseen import leave_one_order_out
from plain_columns import shadowed

ORDERS = np.array(["1>2>3", "1>3>2", "2>1>3", "2>3>1", "3>1>2", "3>2>1"])


def landings(*, difference, bend=0.0, noise=0.01, n=600, seed=0):
    """Return landings of one map, of maps that differ by order, or that bends."""
    rng = np.random.default_rng(seed)
    labels = rng.integers(0, 6, n)
    x = rng.normal(size=(n, 8))
    shared = rng.normal(size=(8, 11))
    own = rng.normal(size=(6, 8, 11))
    y = x @ shared + difference * np.einsum("np,npq->nq", x, own[labels])
    y += bend * (x[:, :1] ** 2) + noise * rng.normal(size=y.shape)
    return x, y, ORDERS[labels]


def test_an_unseen_order_of_one_map_is_predicted_to_the_noise():
    found = leave_one_order_out(*landings(difference=0.0), seed=1)
    assert found["schedule"].tolist() == ORDERS.tolist()
    np.testing.assert_allclose(found["unseen"], 1e-4, rtol=0.1)
    np.testing.assert_allclose(found["unseen"], found["seen"], rtol=0.1)
    assert (found["of_mean"] > 5).all()
    assert shadowed(found) == []


def test_an_unseen_order_of_another_map_is_not():
    x, y, schedule = landings(difference=0.3)
    found = leave_one_order_out(x, y, schedule, seed=1)
    # The order's own map differs from the mean of five others by 0.3 sqrt(1.2), in
    # eight directions; with a sixth of its landings in the fit by five sixths of it.
    expected = 0.3**2 * 1.2 * 8
    assert found["unseen"].mean() == pytest.approx(expected, rel=0.25)
    assert found["seen"].mean() < 0.85 * found["unseen"].mean()


def test_curvature_alone_makes_no_order_special():
    found = leave_one_order_out(*landings(difference=0.0, bend=1.0), seed=1)
    assert (found["unseen"] > 100 * 1e-4).all()
    np.testing.assert_allclose(found["unseen"], found["seen"], rtol=0.1)


def test_rows_of_one_order_do_not_depend_on_which_others_are_measured():
    x, y, schedule = landings(difference=0.1)
    found = leave_one_order_out(x, y, schedule, seed=1).set_index("schedule")
    renamed = np.where(schedule == ORDERS[5], "", schedule)
    fewer = leave_one_order_out(x, y, renamed, seed=1).set_index("schedule")
    assert list(fewer.index) == ORDERS[:5].tolist()
    for order in fewer.index:
        assert fewer.loc[order].equals(found.loc[order])


def test_too_few_other_landings_leave_an_order_out():
    x, y, _ = landings(difference=0.0, n=60)
    schedule = np.repeat(ORDERS[:2], [52, 8])
    found = leave_one_order_out(x, y, schedule, seed=1)
    assert found["schedule"].tolist() == [ORDERS[1]]
    assert leave_one_order_out(x[:5], y[:5], schedule[:5], seed=1).empty


def test_arrays_that_do_not_match_are_refused():
    x, y, schedule = landings(difference=0.0)
    with pytest.raises(ValueError, match="one length"):
        leave_one_order_out(x, y[1:], schedule, seed=1)
