from fractions import Fraction

import numpy as np
import pytest

from hopdata.maps.linear.compensated import centred_product


@pytest.mark.parametrize("cancelled", [1.0, 1e8, 1e14])
def test_what_cancels_leaves_the_digits_of_the_data(cancelled):
    rng = np.random.default_rng(0)
    x, matrix = rng.normal(size=(8, 6)), rng.normal(size=(6, 3))
    x[:, 5] = -(x[:, :5] @ matrix[:5, 0]) / matrix[5, 0] * (1 + 1 / cancelled)
    centre = 1e-3 * rng.normal(size=6)
    exact = [
        [
            float(
                sum(
                    (Fraction(float(value)) - Fraction(float(level))) * Fraction(float(factor))
                    for value, level, factor in zip(row, centre, column, strict=True)
                )
            )
            for column in matrix.T
        ]
        for row in x
    ]
    found = centred_product(x, centre, matrix)
    np.testing.assert_allclose(found, exact, rtol=1e-15)
    assert np.array_equal(centred_product(x, centre, matrix, compiled=True), found)


def test_no_rows_and_no_columns():
    assert centred_product(np.zeros((0, 3)), np.zeros(3), np.eye(3)).shape == (0, 3)
    assert centred_product(np.zeros((4, 3)), np.zeros(3), np.zeros((3, 0))).shape == (4, 0)
