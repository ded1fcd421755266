"""Third-order terms that are shrunk as far as the landings ask for.

A study of a few hundred landings cannot determine all 120 third-order terms, and
without them they are scatter. Their coefficients are therefore taken as random, normal
with mean zero. Terms of one kind have one variance, relative to the noise of each
outcome. The variances are those under which the outcomes are most likely (restricted
maximum likelihood; Patterson and Thompson 1971). The noise has any covariance, so that
they do not depend on the axes of the outcomes. With many landings they determine
terms that matter as if these were free.

The landings then have a covariance V = 1 + C C', where C (n, m) are the terms times the
root of their variance. Rows of outcomes and of all other terms are multiplied with its
inverse root, which makes least squares the best linear estimate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.maps.verdict.linear import FLAT

#: Variances that are tried for the terms of a kind: what they add to an outcome,
#: relative to its noise.
#: Unit: 1. Origin: chosen: zero, and from where terms change nothing (a thousandth of
#: the noise) to where they are free, in steps that likelihoods can tell apart.
VARIANCES = (0.0, *(4.0**power for power in range(-5, 9)))


@dataclass(frozen=True)
class Whitening:
    """The inverse root of V, 1 + U diag(changes) U'.

    Attributes
    ----------
    directions
        (n, m) orthonormal columns U.
    changes
        (m,) factor along each direction, less one: from -1 to 0.
    variances
        (m,) what the terms of each term's kind add to the variance of an outcome,
        relative to its noise.
    """

    directions: FloatArray
    changes: FloatArray
    variances: FloatArray

    def of(self, columns: FloatArray) -> FloatArray:
        """Return the columns (n, k) with their rows mixed by the inverse root of V."""
        along = self.directions.T @ columns
        return np.asarray(columns + self.directions @ (self.changes[:, None] * along))


def whitening(
    terms: FloatArray, kinds: IntArray, fixed: FloatArray, outcomes: FloatArray
) -> Whitening:
    """Return the whitening of landings whose terms are shrunk.

    Parameters
    ----------
    terms
        (n, m) terms that are shrunk. Their sizes relative to others of their kind say
        how much each is expected to matter.
    kinds
        (m,) number, from 0, of the kind of each; all of one kind share a variance.
    fixed
        (n, k) terms that are not shrunk, the kinks and steps among them, which third
        orders must not explain.
    outcomes
        (n, q) outcomes.
    """
    total_of_kinds = np.bincount(kinds, weights=np.mean(terms**2, axis=0))
    scaled = terms / np.sqrt(total_of_kinds[kinds])
    fixed_basis, singular, _ = np.linalg.svd(fixed, full_matrices=False)
    fixed_basis = fixed_basis[:, singular > FLAT * singular[0]]
    likelihood = _Likelihood.of(scaled, kinds, fixed_basis, outcomes)
    variances = likelihood.best()
    weighted = scaled * np.sqrt(variances)
    directions, sizes, _ = np.linalg.svd(weighted, full_matrices=False)
    changes = 1.0 / np.sqrt(1.0 + sizes**2) - 1.0
    return Whitening(np.asarray(directions), np.asarray(changes), variances)


@dataclass(frozen=True)
class _Likelihood:
    """Restricted likelihood of the variances.

    Attributes
    ----------
    products
        (m, m) products of the terms beside the fixed ones.
    with_outcomes
        (m, q) their products with an orthonormal basis of the outcomes beside the fixed
        terms, q of them if none is a combination of others.
    freedom
        Number of landings less that of fixed terms.
    kinds
        (m,) kind of each term.
    """

    products: FloatArray
    with_outcomes: FloatArray
    freedom: int
    kinds: IntArray

    @classmethod
    def of(
        cls,
        terms: FloatArray,
        kinds: IntArray,
        fixed: FloatArray,
        outcomes: FloatArray,
    ) -> _Likelihood:
        """Return the likelihood beside an orthonormal basis `fixed` (n, k)."""
        terms_beside = terms - fixed @ (fixed.T @ terms)
        outcomes_beside = outcomes - fixed @ (fixed.T @ outcomes)
        return cls(
            products=np.asarray(terms_beside.T @ terms_beside),
            with_outcomes=np.asarray(terms_beside.T @ _basis(outcomes_beside)),
            freedom=len(terms) - fixed.shape[1],
            kinds=kinds,
        )

    def logarithm(self, steps: IntArray) -> float:
        """Return the logarithm of the likelihood, but for a constant.

        `steps` (kinds,) are numbers in `VARIANCES`. The covariance of the noise is the
        one under which the outcomes are most likely.
        """
        from scipy.linalg import solve_triangular

        roots = np.sqrt(np.array(VARIANCES)[steps])[self.kinds]
        inner = roots[:, None] * self.products * roots
        inner[np.diag_indices_from(inner)] += 1.0
        triangle = np.linalg.cholesky(inner)
        shared = roots[:, None] * self.with_outcomes
        part = solve_triangular(triangle, shared, lower=True)
        determinant = 2.0 * float(np.sum(np.log(np.diag(triangle))))
        return self._logarithm_of(part.T @ part, determinant)

    def _logarithm_of(self, explained: FloatArray, determinant: float) -> float:
        """Return it from what the terms explain (q, q) of the basis of the outcomes."""
        n_outcomes = len(explained)
        _, noise = np.linalg.slogdet(np.eye(n_outcomes) - explained)
        return -0.5 * float(self.freedom * noise + n_outcomes * determinant)

    def best(self) -> FloatArray:
        """Return the most likely variance of each term (m,).

        At first all are equal. Then that of each kind in turn moves up or down in
        `VARIANCES`, step by step, as long as this is more likely.
        """
        steps = np.full(int(self.kinds.max()) + 1, self._best_of_all_equal())
        most = self.logarithm(steps)
        before = -np.inf
        while most > before:
            before = most
            for kind in range(len(steps)):
                steps, most = self._moved(steps, most, kind)
        return np.asarray(np.array(VARIANCES)[steps][self.kinds])

    def _best_of_all_equal(self) -> int:
        """Return the most likely number in `VARIANCES` if all kinds share it."""
        eigenvalues, axes = np.linalg.eigh(self.products)
        along = axes.T @ self.with_outcomes
        likelihoods = []
        for variance in VARIANCES:
            inner = 1.0 + variance * eigenvalues.clip(0.0)
            explained = variance * along.T @ (along / inner[:, None])
            determinant = float(np.sum(np.log(inner)))
            likelihoods.append(self._logarithm_of(explained, determinant))
        return int(np.argmax(likelihoods))

    def _moved(self, steps: IntArray, most: float, kind: int) -> tuple[IntArray, float]:
        """Return the steps with that of one kind moved to where it is most likely."""
        for way in (1, -1):
            while 0 <= steps[kind] + way < len(VARIANCES):
                tried = steps.copy()
                tried[kind] += way
                likelihood = self.logarithm(tried)
                if likelihood <= most:
                    break
                steps = tried
                most = likelihood
        return steps, most


def _basis(outcomes: FloatArray) -> FloatArray:
    """Return an orthonormal basis (n, r) of the outcomes, whatever their units."""
    sizes = np.linalg.norm(outcomes, axis=0)
    known = outcomes[:, sizes > 0.0] / sizes[sizes > 0.0]
    basis, singular, _ = np.linalg.svd(known, full_matrices=False)
    return np.asarray(basis[:, singular > FLAT * singular.max(initial=0.0)])
