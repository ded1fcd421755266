"""Distances between subspaces, and how each of them responds to noise.

The dissertation compares subspaces by their arc length because it is the most sensitive
to noise of the distances collated by Edelman, Arias and Smith (1998) (Sec. 2.2.4): if a
distance makes equal but noisy subspaces look far apart, the finding that two mode
schedules are alike carries more weight. `noise_sensitivity` repeats that choice: equal
subspaces get more and more noise, and two things are measured for each distance: its
size, and how well a single value distinguishes one level of noise from twice that
level.

`snr_readings` shows what its "signal-to-noise ratio of 10" (Sec. 2.3) may mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.maps.draws import named_generator
from hopdata.maps.subspaces import arc_length, orthonormalised, principal_angles

# The distances between subspaces that Edelman, Arias and Smith (1998, Sec. 4.3)
# collate.
#
# All are functions of the principal angles, under the names of that paper. Others call
# the chordal F-norm the Procrustes distance (the least ``norm(a q - b)`` over rotations
# q), the projection F-norm the chordal distance, and the projection 2-norm the gap.


def arc_length_of(angles: FloatArray) -> FloatArray:
    """Return the geodesic distance, the 2-norm of the angles, rad."""
    return _norm(angles)


def fubini_study(angles: FloatArray) -> FloatArray:
    """Return the angle between the subspaces' exterior products, rad.

    It is the arc cosine of the product of the cosines, computed from ``1 -
    prod(cos^2)`` by logarithms, so that small angles keep their digits.
    """
    # A right angle gives minus infinity, whose exponential is zero.
    with np.errstate(divide="ignore"):
        logarithm = np.sum(np.log1p(-(np.sin(angles) ** 2)), axis=-1)
    cosine = np.exp(logarithm / 2)
    sine = np.sqrt(-np.expm1(logarithm))
    return np.arctan2(sine, cosine)


def chordal_2(angles: FloatArray) -> FloatArray:
    """Return the least 2-norm of the difference of two orthonormal bases."""
    return np.asarray(2 * np.sin(angles.max(axis=-1) / 2))


def chordal_f(angles: FloatArray) -> FloatArray:
    """Return the least Frobenius norm of the difference of two bases (Procrustes)."""
    return 2 * _norm(np.sin(angles / 2))


def projection_2(angles: FloatArray) -> FloatArray:
    """Return the sine of the largest angle: the 2-norm between the projections."""
    return np.asarray(np.sin(angles.max(axis=-1)))


def projection_f(angles: FloatArray) -> FloatArray:
    """Return the Frobenius norm between the projections, divided by sqrt(2)."""
    return _norm(np.sin(angles))


#: Name -> function of (..., k) principal angles in rad, as returned by
#: `principal_angles`.
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


#: Sd of the noise on each entry, in steps of 2^(1/2); 0.1, that of Fig. 2.5, is one.
#: Unit: 1. Origin: chosen.
NOISE_SDS = tuple(0.1 * 2.0 ** (step / 2) for step in range(-12, 7))
_LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
_SENSITIVITY_COLUMNS = (
    "distance",
    "noise_sd",
    "mean_distance",
    "sd",
    "q05",
    "q95",
    "share_of_random",
    "doubling",
)


@one_blas_thread()
def noise_sensitivity(
    shape: tuple[int, int],
    *,
    seed: int,
    pairs: int = 400,
    noise_sds: Sequence[float] = NOISE_SDS,
) -> pd.DataFrame:
    """Measure each distance between equal subspaces under increasing noise.

    Parameters
    ----------
    shape
        Dimensions (D, k) of the subspaces.
    seed
        Seed of the study; each level of noise has its own random stream.
    pairs
        Number of pairs of noisy subspaces at each level, and of random ones.
    noise_sds
        Sd of the noise on each entry of both bases.

    Returns
    -------
    DataFrame
        One row per distance and level: ``distance, noise_sd, mean_distance, sd, q05,
        q95``; ``share_of_random``, the mean divided by that of random subspaces; and
        ``doubling``, the change of the mean when the noise doubles, in units of the sd
        (root mean square of both), NaN if the doubled noise is not among the levels.
    """
    generator = named_generator(seed, "sensitivity", "random")
    first, second = orthonormalised(generator.standard_normal((2, pairs, *shape)))
    unrelated = principal_angles(first, second)
    angles = {sd: _noised_angles(seed, shape, pairs, sd) for sd in noise_sds}
    rows = []
    for name, distance in DISTANCES.items():
        found = {sd: distance(of_level) for sd, of_level in angles.items()}
        of_random = distance(unrelated).mean()
        for noise_sd, values in found.items():
            mean = values.mean()
            low, high = np.quantile(values, [0.05, 0.95])
            row = {
                "distance": name,
                "noise_sd": noise_sd,
                "mean_distance": mean,
                "sd": values.std(ddof=1),
                "q05": low,
                "q95": high,
                "share_of_random": mean / of_random,
                "doubling": _separation(values, _at(found, 2 * noise_sd)),
            }
            rows.append(row)
    return pd.DataFrame(rows, columns=list(_SENSITIVITY_COLUMNS))


def _at(found: dict[float, FloatArray], level: float) -> FloatArray | None:
    """Return the values at a level of noise, or None if it is not among the levels."""
    for noise_sd, values in found.items():
        if np.isclose(noise_sd, level):
            return values
    return None


# Readings of "a signal-to-noise ratio of 10".
#
# The dissertation does not explain that ratio (Sec. 2.3): neither what receives noise,
# nor how the ratio is counted. `READINGS` lists every reading; the one taken for Fig.
# 2.5 gives distances like the printed ones.

# Powers of the ratio and of the number of rows to which the noise of an entry is
# proportional.
RATIOS = {"amplitude": -1.0, "power": -0.5}
SIGNALS = {"entry": 0.0, "matrix": -0.5}
#: The signal-to-noise ratio of the noised identity.
#: Unit: 1. Origin: table: Sec. 2.3 of the dissertation.
PRINTED_SNR = 10.0


@dataclass(frozen=True)
class Reading:
    """A reading of "a signal-to-noise ratio of 10".

    Attributes
    ----------
    ratio
        ``amplitude``: the noise is 1/10 of the signal; ``power``: 1/10 of its power, or
        10 dB.
    signal
        ``entry``: the ones of the identity; ``matrix``: the rms of all its entries,
        zeros included, so that the ratio is that of Frobenius norms (or of the norms of
        columns).
    noised
        Number of noisy matrices in a pair, one or two.
    """

    ratio: str
    signal: str
    noised: int

    def noise_sd(self, shape: tuple[int, int], snr: float = PRINTED_SNR) -> float:
        """Return the sd of the noise on each entry of a (D, k) identity."""
        level = snr ** RATIOS[self.ratio]
        return level * shape[0] ** SIGNALS[self.signal]


READINGS = tuple(
    Reading(ratio, signal, noised)
    for ratio in RATIOS
    for signal in SIGNALS
    for noised in (2, 1)
)
#: Noise of sd 0.1 on every entry of both matrices, the reading of Fig. 2.5.
PRINTED_READING = READINGS[0]


def noised_identities(
    generator: np.random.Generator,
    shape: tuple[int, int],
    count: int,
    noise_sd: float,
    noised: int = 2,
) -> tuple[FloatArray, FloatArray]:
    """Return (count, D, k) bases of pairs of identities with noise on each entry.

    In each pair, `noised` bases have independent normal noise of sd `noise_sd`; both
    are orthonormalised.
    """
    noise = noise_sd * generator.standard_normal((2, count, *shape))
    noise[noised:] = 0.0
    a, b = orthonormalised(np.eye(*shape) + noise)
    return a, b


@one_blas_thread()
def snr_readings(
    shape: tuple[int, int], *, seed: int, pairs: int = 1000
) -> pd.DataFrame:
    """Measure the arc lengths of random subspaces, and of noised identities as read.

    Parameters
    ----------
    shape
        Dimensions (D, k) of the subspaces.
    seed
        Seed of the study; each reading has its own random stream.
    pairs
        Number of pairs of each reading, and of random ones.

    Returns
    -------
    DataFrame
        One row per reading, and one for random subspaces: ``kind, ratio, signal,
        noised, noise_sd, printed, mean_distance, mean_se, sd, q05, q25,
        median_distance, q75, q95``,
        lengths in rad; ``printed`` marks the reading of Fig. 2.5.
    """
    rows = []
    for reading in READINGS:
        names = (reading.ratio, reading.signal, str(reading.noised))
        sd = reading.noise_sd(shape)
        generator = named_generator(seed, "snr", *names)
        a, b = noised_identities(generator, shape, pairs, sd, reading.noised)
        lengths = arc_length(a, b)
        known = ("noised_identity", *names, sd, reading == PRINTED_READING)
        rows.append((*known, *_summary(lengths)))
    generator = named_generator(seed, "snr", "random")
    a, b = orthonormalised(generator.standard_normal((2, pairs, *shape)))
    lengths = arc_length(a, b)
    rows.append(("random", "", "", "", np.nan, False, *_summary(lengths)))
    columns = ("kind", "ratio", "signal", "noised", "noise_sd", "printed")
    levels = (
        *("mean_distance", "mean_se", "sd"),
        *("q05", "q25", "median_distance", "q75", "q95"),
    )
    return pd.DataFrame(rows, columns=[*columns, *levels])


def _noised_angles(
    seed: int, shape: tuple[int, int], pairs: int, noise_sd: float
) -> FloatArray:
    """Return the principal angles (pairs, k) of noised identities, rad."""
    generator = named_generator(seed, "sensitivity", f"{noise_sd:.9g}")
    a, b = noised_identities(generator, shape, pairs, noise_sd)
    return principal_angles(a, b)


def _separation(values: FloatArray, twice: FloatArray | None) -> float:
    """Return the change of the mean in units of the sd; NaN without a second."""
    if twice is None:
        return float("nan")
    spread = np.sqrt((values.var(ddof=1) + twice.var(ddof=1)) / 2)
    return float((twice.mean() - values.mean()) / spread)


def _summary(values: FloatArray) -> tuple[float, ...]:
    """Return mean, its standard error, sd, and the quantiles of `_LEVELS`."""
    spread = values.std(ddof=1)
    return (
        values.mean(),
        spread / len(values) ** 0.5,
        spread,
        *np.quantile(values, _LEVELS),
    )
