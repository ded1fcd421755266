"""Angles and arc lengths between subspaces, many pairs at once.

Björck and Golub (1973): the cosines of the principal angles are the singular values of
``a.T @ b`` and their sines those of ``b - a @ (a.T @ b)``. A cosine near one has lost half the
digits of a small angle, a sine near one those of an angle near a right angle, so each angle is
taken from the form that is good for it. The arc length is the 2-norm of the angles (Edelman,
Arias and Smith 1998, Sec. 4.3), the geodesic distance on the Grassmann manifold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import chosen

#: Arc lengths below this need the sines: an error e in each cosine moves a length d by k e / d.
_SMALL_ARC_LENGTH = 0.5


def principal_angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the principal angles between subspaces.

    Parameters
    ----------
    a, b
        (..., D, k) and (..., D, m) orthonormal bases; leading axes broadcast.

    Returns
    -------
    ndarray
        (..., min(k, m)) angles in rad, increasing, in [0, pi/2]; absolute error a few 1e-16 times
        the departure of the bases from orthonormality.
    """
    a, b = _ordered(a, b)
    overlap = a.swapaxes(-1, -2) @ b
    cosines = np.linalg.svd(overlap, compute_uv=False)
    sines = np.linalg.svd(b - a @ overlap, compute_uv=False)[..., ::-1]
    small = cosines**2 > 0.5
    return np.where(small, np.arcsin(np.minimum(sines, 1)), np.arccos(np.minimum(cosines, 1)))


def arc_length(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the arc-length (geodesic) distance between subspaces, in rad.

    Parameters
    ----------
    a, b
        (..., D, k) orthonormal bases of equal shape.

    Returns
    -------
    ndarray
        (...) distances in [0, sqrt(k) pi/2]; absolute error below 1e-12.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    cosines = np.linalg.svd(a.swapaxes(-1, -2) @ b, compute_uv=False)
    lengths = np.asarray(np.linalg.norm(np.arccos(np.minimum(cosines, 1)), axis=-1))
    close = lengths < _SMALL_ARC_LENGTH
    if close.any():
        a, b = (np.broadcast_to(part, (*lengths.shape, *part.shape[-2:])) for part in (a, b))
        lengths[close] = np.linalg.norm(principal_angles(a[close], b[close]), axis=-1)
    return lengths


def orthonormalised(matrices: FloatArray) -> FloatArray:
    """Return orthonormal bases of the column spaces of (..., D, k) matrices of full rank."""
    return np.linalg.qr(np.asarray(matrices, float))[0]


def _ordered(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the bases with the wider one first, so that sines and cosines pair up."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    return (a, b) if a.shape[-1] >= b.shape[-1] else (b, a)


# What distances between subspaces are without any data: equal but noisy, or unrelated ones.
#
# The dissertation compares with "noised identical matrices ... with a signal-to-noise ratio of 10"
# (Sec. 2.3) and does not say what is noised or how the ratio is counted. `READINGS` has every way
# to read it; the one that is taken for Fig. 2.5 gives distances like the printed ones.

# Powers of the ratio, and of the number of rows, by which the noise of an entry goes.
RATIOS = {"amplitude": -1.0, "power": -0.5}
SIGNALS = {"entry": 0.0, "matrix": -0.5}
#: The signal-to-noise ratio that is printed.
PRINTED_SNR = 10.0


@dataclass(frozen=True)
class Reading:
    """One way to read "a signal-to-noise ratio of 10".

    Attributes
    ----------
    ratio
        ``amplitude``: the noise is 1/10 of the signal; ``power``: 1/10 of its power, or 10 dB.
    signal
        ``entry``: the ones of the identity; ``matrix``: the rms of all its entries, zeros
        included, so that the ratio is that of Frobenius norms (or of the norms of columns).
    noised
        How many of the two matrices of a pair have noise.
    """

    ratio: str
    signal: str
    noised: int

    def noise_sd(self, shape: tuple[int, int], snr: float = PRINTED_SNR) -> float:
        """Return the sd of the noise on each entry of a (D, k) identity."""
        level = snr ** chosen("ratio", self.ratio, RATIOS)
        return level * shape[0] ** chosen("signal", self.signal, SIGNALS)


READINGS = tuple(
    Reading(ratio, signal, noised) for ratio in RATIOS for signal in SIGNALS for noised in (2, 1)
)
#: Noise of sd 0.1 on every entry of both matrices: the reading of Fig. 2.5.
PRINTED_READING = READINGS[0]


def noised_identities(
    generator: np.random.Generator,
    shape: tuple[int, int],
    count: int,
    noise_sd: float,
    noised: int = 2,
) -> tuple[FloatArray, FloatArray]:
    """Return (count, D, k) bases of pairs of identities with normal noise on each entry.

    Of a pair, `noised` have noise, independent of each other; both are orthonormalised.
    """
    noise = noise_sd * generator.standard_normal((2, count, *shape))
    noise[noised:] = 0.0
    a, b = orthonormalised(np.eye(*shape) + noise)
    return a, b


def random_subspaces(
    generator: np.random.Generator, shape: tuple[int, int], count: int
) -> tuple[FloatArray, FloatArray]:
    """Return (count, D, k) bases of pairs of uniform (Haar) random subspaces."""
    a, b = orthonormalised(generator.standard_normal((2, count, *shape)))
    return a, b


def noised_identity(
    generator: np.random.Generator,
    shape: tuple[int, int],
    count: int,
    noise_sd: float,
    noised: int = 2,
) -> FloatArray:
    """Return arc lengths of `count` pairs: see `noised_identities`."""
    return arc_length(*noised_identities(generator, shape, count, noise_sd, noised))


def random(generator: np.random.Generator, shape: tuple[int, int], count: int) -> FloatArray:
    """Return arc lengths of `count` pairs: see `random_subspaces`."""
    return arc_length(*random_subspaces(generator, shape, count))


# The distances between subspaces that Edelman, Arias and Smith (1998, Sec. 4.3) collate.
#
# All are functions of the principal angles. In the names of that paper; others call the chordal
# F-norm the Procrustes distance (the least ``norm(a q - b)`` over rotations q), the projection
# F-norm the chordal distance, and the projection 2-norm the gap.


def arc_length_of(angles: FloatArray) -> FloatArray:
    """Return the geodesic distance, the 2-norm of the angles, rad."""
    return _norm(angles)


def fubini_study(angles: FloatArray) -> FloatArray:
    """Return the angle between the subspaces' exterior products, acos of the product of cosines.

    From ``1 - prod(cos^2)`` by logarithms, so that small angles keep their digits.
    """
    with np.errstate(divide="ignore"):  # a right angle: minus infinity, of which exp is zero
        logarithm = np.sum(np.log1p(-(np.sin(angles) ** 2)), axis=-1)
    return np.arctan2(np.sqrt(-np.expm1(logarithm)), np.exp(logarithm / 2))


def chordal_2(angles: FloatArray) -> FloatArray:
    """Return the least 2-norm of the difference of two orthonormal bases."""
    return np.asarray(2 * np.sin(angles.max(axis=-1) / 2))


def chordal_f(angles: FloatArray) -> FloatArray:
    """Return the least Frobenius norm of the difference of two orthonormal bases (Procrustes)."""
    return 2 * _norm(np.sin(angles / 2))


def projection_2(angles: FloatArray) -> FloatArray:
    """Return the 2-norm of the difference of the projections, the sine of the largest angle."""
    return np.asarray(np.sin(angles.max(axis=-1)))


def projection_f(angles: FloatArray) -> FloatArray:
    """Return the Frobenius norm of the difference of the projections over the root of two."""
    return _norm(np.sin(angles))


#: Name -> function of (..., k) principal angles in rad, as `principal_angles` finds them.
DISTANCES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "arc_length": arc_length_of,
    "chordal_f": chordal_f,
    "projection_f": projection_f,
    "fubini_study": fubini_study,
    "chordal_2": chordal_2,
    "projection_2": projection_2,
}


def _norm(values: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(values, axis=-1))
