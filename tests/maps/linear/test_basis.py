import numpy as np
import pytest

from hopdata.maps.linear.basis import cross_product, pooled_basis, row_product


@pytest.mark.parametrize("count", [30, 256, 257, 700])
@pytest.mark.parametrize("condition", [1.0, 1e5, 1e10])
def test_columns_are_orthogonal_and_span_the_inputs(count, condition):
    rng = np.random.default_rng(0)
    twist = np.linalg.qr(rng.normal(size=(9, 9)))[0]
    x = rng.normal(size=(count, 9)) * np.geomspace(1, 1 / condition, 9) @ twist + 1.0
    design = pooled_basis(x)
    assert design.shape == (count, 10)
    assert (design[:, 0] == 1).all()
    np.testing.assert_allclose(design.T @ design / count, np.eye(10), atol=1e-13)
    rest = x - design @ (design.T @ x / count)
    assert np.abs(rest).max() < 1e-14


def test_directions_that_are_not_there_are_left_out():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(400, 4)) @ rng.normal(size=(4, 7))
    more = np.column_stack([x, np.full(400, 0.499), x[:, 0]])
    assert pooled_basis(x).shape == pooled_basis(more).shape == (400, 5)
    assert pooled_basis(np.full((400, 3), 0.288)).shape == (400, 1)
    assert pooled_basis(x[:3]).shape == (3, 3)


def test_products_in_blocks_are_products():
    a, b = np.random.default_rng(2).normal(size=(2, 600, 5))
    np.testing.assert_allclose(cross_product(a, b), a.T @ b, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(row_product(a, b[:5]), a @ b[:5], rtol=1e-13)
    assert cross_product(a[:0], b[:0]).tolist() == np.zeros((5, 5)).tolist()
    assert row_product(a[:0], b[:5]).shape == (0, 5)
