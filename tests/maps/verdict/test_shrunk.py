"""Third-order terms that are shrunk as far as the landings ask for."""

import numpy as np
import pytest

from hopdata.maps.coordinates import monomials
from hopdata.maps.verdict.shrunk import VARIANCES, whitening

N = 120
KINDS = np.array([0, 0, 1, 1, 1, 1])


def _unit(terms):
    """Return terms whose mean squares add up to one in each kind."""
    squares = np.mean(terms**2, axis=0)
    totals = np.array([squares[kind == KINDS].sum() for kind in (0, 1)])
    return terms / np.sqrt(totals[KINDS])


def _study(seed, first, others):
    """Return terms, fixed terms and outcomes whose random terms have these sizes."""
    rng = np.random.default_rng(seed)
    terms = rng.standard_normal((N, len(KINDS))) * [1, 5, 1, 0.2, 1, 1]
    fixed = np.column_stack([np.ones(N), rng.standard_normal((N, 4))])
    unit = _unit(terms)
    sizes = np.array([first, others])[KINDS][:, None]
    coefficients = sizes * rng.standard_normal((len(KINDS), 11))
    outcomes = unit @ coefficients + fixed @ rng.standard_normal((5, 11))
    outcomes += rng.standard_normal((N, 11))
    scales = 10.0 ** np.arange(-5, 6)  # units of the outcomes do not matter
    return terms, fixed, outcomes * scales


def test_rows_are_multiplied_with_the_inverse_root_of_their_covariance():
    terms, fixed, outcomes = _study(1, 1.0, 0.3)
    found = whitening(terms, KINDS, fixed, outcomes)
    unit = _unit(terms)
    covariance = np.eye(N) + unit * found.variances @ unit.T
    values, vectors = np.linalg.eigh(covariance)
    inverse_root = vectors / np.sqrt(values) @ vectors.T
    np.testing.assert_allclose(found.of(outcomes), inverse_root @ outcomes, rtol=1e-6)


def test_the_variances_are_the_most_likely():
    """No other pair has a larger density of the residuals of the fixed terms."""
    terms, fixed, outcomes = _study(2, 1.0, 0.1)
    found = whitening(terms, KINDS, fixed, outcomes)
    unit = _unit(terms)
    left, _, _ = np.linalg.svd(fixed)
    rest = left[:, fixed.shape[1] :].T

    def likelihood(first, others):
        variances = np.array([first, others])[KINDS]
        seen = rest @ (np.eye(N) + unit * variances @ unit.T) @ rest.T
        residuals = rest @ outcomes
        noise = np.linalg.slogdet(residuals.T @ np.linalg.solve(seen, residuals))[1]
        determinant = np.linalg.slogdet(seen)[1]
        return -0.5 * (len(seen) * noise + residuals.shape[1] * determinant)

    pairs = [(a, b) for a in VARIANCES for b in VARIANCES]
    best = max(pairs, key=lambda pair: likelihood(*pair))
    np.testing.assert_array_equal(found.variances, np.array(best)[KINDS])
    assert 0.25 <= best[0] <= 4.0, "the first add 1"
    assert best[1] < 0.1, "and the others 0.01"


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_the_axes_of_the_outcomes_do_not_matter(seed):
    """Nor an outcome that is a combination of others, or is not there."""
    terms, fixed, outcomes = _study(seed, 1.0, 0.1)
    rng = np.random.default_rng(seed)
    mixed = outcomes / np.linalg.norm(outcomes, axis=0) @ rng.standard_normal((11, 11))
    more = np.column_stack([outcomes, outcomes[:, 0], np.zeros(N)])
    found = whitening(terms, KINDS, fixed, outcomes).variances
    for other in (mixed, more):
        variances = whitening(terms, KINDS, fixed, other).variances
        np.testing.assert_array_equal(variances, found)


@pytest.mark.parametrize("size", [0.0, 100.0])
def test_terms_are_gone_without_any_effect_and_free_with_a_large_one(size):
    terms, fixed, outcomes = _study(3, size, size)
    found = whitening(terms, KINDS, fixed, outcomes)
    left = np.linalg.norm(found.of(terms)) / np.linalg.norm(terms)
    if size:
        assert left < 0.01
    else:
        assert left > 0.5


def test_what_fixed_terms_explain_is_not_explained_by_shrunk_ones():
    """A kink that looks much like a cube stays a kink."""
    rng = np.random.default_rng(4)
    x = rng.standard_normal((400, 2))
    kink = np.abs(x[:, :1]) * np.sign(x[:, :1])
    cubes = monomials(x, (3,))
    outcomes = 5.0 * kink + rng.standard_normal((400, 11))
    kinds = np.zeros(cubes.shape[1], dtype=np.int64)
    constant = np.ones((400, 1))
    beside = whitening(cubes, kinds, np.column_stack([constant, kink]), outcomes)
    alone = whitening(cubes, kinds, constant, outcomes)
    assert beside.variances.max() < 0.01 < 0.1 < alone.variances.max()
