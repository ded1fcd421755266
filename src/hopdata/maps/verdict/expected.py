"""Contact instants foretold from the state and the feet before a landing.

The instants that place a landing among the contact orders are those expected from its
inputs, not those measured: measured ones share errors with the states, and would move
landings across the kinks. What the inputs do not foretell has a covariance, which the
kinks are averaged over (`averaged`). It has two sources: noise of the inputs, which is
known from the markers, and posture that the inputs do not show, which is what the
measured instants miss beyond that and beyond their own errors.
"""

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import SD_PER_MAD, BoolArray, FloatArray
from hopdata.errors import AnalysisError
from hopdata.maps import coordinates
from hopdata.maps.coordinates import monomials
from hopdata.maps.verdict.linear import (
    FLAT,
    left_out_errors,
    positive_part,
    regular,
    whitened,
)
from hopdata.maps.verdict.noise import unforetold_by_noise
from hopdata.messages import Message

#: Least share of the contact instants' mean square that the preceding states must
#: predict.
#: Unit: 1. Origin: chosen.
LEAST_FORETOLD = 0.1

#: Contact instants farther from the fit than this are left out.
#: Unit: robust standard deviations. Origin: chosen.
OUTLYING = 5.0


@dataclass(frozen=True)
class Unforetold:
    """Covariances (feet, feet) of the true contact instants about those expected.

    Attributes
    ----------
    by_noise
        What noise of the inputs hides.
    by_posture
        What the inputs do not show, such as the length of the legs.
    """

    by_noise: FloatArray
    by_posture: FloatArray

    @property
    def total(self) -> FloatArray:
        """Both together."""
        return np.asarray(self.by_noise + self.by_posture)


@dataclass(frozen=True)
class Expected:
    """Contact instants of n landings, relative to their mean over the feet.

    Attributes
    ----------
    instants
        (n, feet) instants expected from the inputs.
    missed
        (feet, feet) covariance of the measured instants about those expected when the
        landing itself is left out.
    good
        (n,) whether a landing's instants lie near those of the others.
    square, left
        Mean square of the measured instants, and of what the inputs miss of them.
    varied
        Mean square of the measured instants about their mean over the landings: the
        same order in every landing needs no foretelling.
    """

    instants: FloatArray
    missed: FloatArray
    good: BoolArray
    square: float
    left: float
    varied: float

    def foretold(self, errors: FloatArray | None = None) -> float:
        """Return the share of the variation that the inputs foretell, from 0 to 1.

        What the standard errors (n, feet) of the measured instants explain belongs to
        neither. Independent errors of F feet have 1 - 1 / F of their mean square about
        the mean over the feet.
        """
        by_errors = 0.0
        if errors is not None:
            n_feet = errors.shape[1]
            by_errors = float(np.mean(errors**2)) * (1.0 - 1.0 / n_feet)
        if not self.varied > by_errors:
            return 0.0
        share_missed = (self.left - by_errors) / (self.varied - by_errors)
        return float(np.clip(1.0 - share_missed, 0.0, 1.0))


def expected_contacts(x: FloatArray, instants: FloatArray) -> Expected:
    """Return contact instants expected from the inputs (n, p), and how well.

    They are a polynomial of the inputs fitted to the measured instants (n, feet). The
    degree is the one with the least leave-one-out error. Landings with outlying
    instants are left out of the fit.

    Raises
    ------
    AnalysisError
        If the inputs predict less than `LEAST_FORETOLD` of the instants' mean square.
    """
    t = instants - instants.mean(axis=1, keepdims=True)
    highest = max(1, coordinates.affordable_degree(len(x), x.shape[1], t.shape[1]))
    scaled = whitened(x)

    fitted = np.median(t, axis=0)
    best = t
    errors = t
    good_of_best = np.ones(len(x), dtype=bool)
    least = np.inf
    # Few terms first, since wrong instants then stand out more.
    for degree in range(1, highest + 1):
        degrees = tuple(range(1, degree + 1))
        design = np.column_stack([np.ones(len(x)), monomials(scaled, degrees)])
        miss = np.abs(t - fitted).max(axis=1)
        good = miss <= OUTLYING * SD_PER_MAD * np.median(miss)
        if good.sum() <= design.shape[1]:
            # Too few landings to identify outliers.
            good = np.ones(len(x), dtype=bool)
        basis, root = np.linalg.qr(design[good])
        fitted = design @ np.linalg.solve(root, basis.T @ t[good])
        missed = left_out_errors(design[good], t[good])
        error = float(np.mean(missed**2))
        if error < least:
            best = fitted
            errors = missed
            good_of_best = good
            least = error

    of_good = t[good_of_best]
    square = float(np.mean(of_good**2))
    foretold = 0.0
    if square > FLAT:
        foretold = 1.0 - least / square
    if not foretold >= LEAST_FORETOLD:
        values = {
            "wanted": f"{100 * LEAST_FORETOLD:g} %",
            "found": f"{100 * max(0.0, foretold):.0f} %",
        }
        raise AnalysisError(Message("maps.orders_not_foretold", values))
    return Expected(
        instants=np.asarray(best - best.mean(axis=1, keepdims=True)),
        missed=errors.T @ errors / len(errors),
        good=good_of_best,
        square=square,
        left=least,
        varied=float(np.mean((of_good - of_good.mean(axis=0)) ** 2)),
    )


def unforetold(
    inputs: FloatArray,
    noise: FloatArray,
    expected: Expected,
    errors: FloatArray | None,
) -> Unforetold:
    """Return the covariance of the true instants about those expected.

    It is what noise of the inputs hides, and what the measured instants miss beside
    that and beside their own errors. If these are not known they count as none, so the
    covariance is too large rather than too small.

    Parameters
    ----------
    inputs
        (n, p) inputs from which the instants are expected.
    noise
        (p, p) covariance of their errors.
    expected
        Of these inputs.
    errors
        (n, feet) standard errors of the measured instants; None if not known.
    """
    hidden = unforetold_by_noise(inputs, expected.instants, noise)
    hidden = _at_most(hidden, expected.missed)
    n_feet = len(hidden)
    measured = np.zeros((n_feet, n_feet))
    if errors is not None:
        level = np.eye(n_feet) - 1.0 / n_feet
        own = np.diag(np.mean(errors[expected.good] ** 2, axis=0))
        measured = level @ own @ level
    return Unforetold(hidden, positive_part(expected.missed - measured - hidden))


def _at_most(covariance: FloatArray, largest: FloatArray) -> FloatArray:
    """Return the covariance, weakened so far that it is nowhere above the largest.

    Soft markers show more noise than the motion of the body has; the contacts tell.
    """
    if not np.trace(largest) > 0.0:
        return np.zeros_like(covariance)
    # Relative instants have no common part, so a little of it changes nothing.
    root = np.linalg.cholesky(regular(largest))
    ratio = np.linalg.solve(root, np.linalg.solve(root, covariance).T)
    return np.asarray(covariance / max(1.0, float(np.linalg.eigvalsh(ratio)[-1])))
