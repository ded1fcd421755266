"""How distances between subspaces answer to noise, and what "a signal-to-noise ratio of 10" is.

The dissertation takes the arc length since, of the distances that Edelman, Arias and Smith (1998)
collate, it is the most sensitive to noise (Sec. 2.2.4): one that makes equal but noisy subspaces
look far apart has the better right to call two schedules alike. Here equal subspaces get more and
more noise, and two things are measured of each distance: how large it is, and how well a single
value tells one level of noise from twice that level.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.maps.draws import named_generator
from hopdata.maps.subspaces.baselines import (
    PRINTED_READING,
    READINGS,
    noised_identities,
    noised_identity,
    random,
    random_subspaces,
)
from hopdata.maps.subspaces.grassmann import principal_angles
from hopdata.maps.subspaces.subspace_distances import DISTANCES

if TYPE_CHECKING:
    import pandas as pd

#: Sd of the noise on each entry, each 2^(1/2) times the last: 0.1 is one of them.
NOISE_SDS = tuple(0.1 * 2.0 ** (step / 2) for step in range(-12, 7))
_LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)

Floats = NDArray[np.float64]


@one_blas_thread()
def noise_sensitivity(
    shape: tuple[int, int],
    *,
    seed: int,
    pairs: int = 400,
    noise_sds: Sequence[float] = NOISE_SDS,
) -> pd.DataFrame:
    """Measure each distance between equal subspaces with more and more noise.

    Parameters
    ----------
    shape
        (D, k) of the subspaces.
    seed
        Seed of the study; each level of noise has its own stream.
    pairs
        Pairs of noisy subspaces at each level, and of random ones.
    noise_sds
        Sd of the noise on each entry of both bases.

    Returns
    -------
    DataFrame
        One row a distance and level: ``distance, noise_sd, mean, sd, q05, q95``;
        ``share_of_random``, the mean over that of random subspaces; and ``doubling``, the change
        of the mean from this noise to twice as much in units of the sd (root mean square of both),
        NaN where twice as much is not among the levels.
    """
    import pandas as pd

    generator = named_generator(seed, "sensitivity", "random")
    unrelated = principal_angles(*random_subspaces(generator, shape, pairs))
    angles = {sd: _noised_angles(seed, shape, pairs, sd) for sd in noise_sds}
    rows = []
    for name, distance in DISTANCES.items():
        found = {sd: distance(part) for sd, part in angles.items()}
        scale = distance(unrelated).mean()
        for sd, values in found.items():
            twice = next((part for other, part in found.items() if np.isclose(other, 2 * sd)), None)
            spread = np.quantile(values, [0.05, 0.95])
            level = (values.mean(), values.std(ddof=1), *spread, values.mean() / scale)
            rows.append((name, sd, *level, np.nan if twice is None else _separation(values, twice)))
    columns = ("distance", "noise_sd", "mean", "sd", "q05", "q95", "share_of_random", "doubling")
    return pd.DataFrame(rows, columns=list(columns))


@one_blas_thread()
def snr_readings(shape: tuple[int, int], *, seed: int, pairs: int = 1000) -> pd.DataFrame:
    """Measure the arc lengths of the two baselines, the noised identity in every reading.

    Returns
    -------
    DataFrame
        One row a reading, and one of random subspaces: ``kind, ratio, signal, noised, noise_sd,
        printed, mean, mean_se, sd, q05, q25, median, q75, q95``, lengths in rad; ``printed`` marks
        the reading of Fig. 2.5.
    """
    import pandas as pd

    rows = []
    for reading in READINGS:
        names = (reading.ratio, reading.signal, str(reading.noised))
        sd = reading.noise_sd(shape)
        generator = named_generator(seed, "snr", *names)
        lengths = noised_identity(generator, shape, pairs, sd, reading.noised)
        known = ("noised_identity", *names, sd, reading == PRINTED_READING)
        rows.append((*known, *_summary(lengths)))
    lengths = random(named_generator(seed, "snr", "random"), shape, pairs)
    rows.append(("random", "", "", "", np.nan, False, *_summary(lengths)))
    columns = ("kind", "ratio", "signal", "noised", "noise_sd", "printed")
    levels = ("mean", "mean_se", "sd", "q05", "q25", "median", "q75", "q95")
    return pd.DataFrame(rows, columns=[*columns, *levels])


def _noised_angles(seed: int, shape: tuple[int, int], pairs: int, noise_sd: float) -> Floats:
    generator = named_generator(seed, "sensitivity", f"{noise_sd:.9g}")
    return principal_angles(*noised_identities(generator, shape, pairs, noise_sd))


def _separation(values: Floats, twice: Floats) -> float:
    spread = np.sqrt((values.var(ddof=1) + twice.var(ddof=1)) / 2)
    return float((twice.mean() - values.mean()) / spread)


def _summary(values: Floats) -> tuple[float, ...]:
    spread = values.std(ddof=1)
    return (values.mean(), spread / len(values) ** 0.5, spread, *np.quantile(values, _LEVELS))
