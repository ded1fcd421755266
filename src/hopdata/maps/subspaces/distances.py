"""Arc-length distances between subspaces, and the two baselines of Fig. 2.5.

Four kinds: in-class (two draws of one mode schedule), cross-class (draws of two schedules),
noised identity (the identity and the identity, both with noise: what equal matrices look like
when they are estimated) and random (what unrelated ones look like).

Draws of one schedule are taken from one pool and share landings, so in-class distances are
smaller than those of independent draws and an AUC against them is above 0.5 even where all
schedules have one map. The AUC is reported as a description, not as a test.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.maps.draws import named_generator
from hopdata.maps.subspaces.baselines import noised_identity, random
from hopdata.maps.subspaces.pair_lengths import PairLengths

if TYPE_CHECKING:
    import pandas as pd

#: Kinds of distance, in the order of Fig. 2.5.
KINDS = ("in_class", "cross_class", "noised_identity", "random")
_SUMMARY_COLUMNS = (
    *("kind", "n", "mean", "mean_se", "sd", "q05", "q25", "median", "q75", "q95"),
    "auc_against_in_class",
)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class DistanceStudy:
    """Distances of a study.

    Attributes
    ----------
    distances
        ``kind, schedule_a, schedule_b, distance_rad``.
    summary
        One row per kind: see `summarise_distances`.
    notes
        Kinds that could not be measured, each ``{"what": ..., "reason": ...}``.
    """

    distances: pd.DataFrame
    summary: pd.DataFrame
    notes: list[dict[str, str]]


@one_blas_thread()
def measure_distances(
    bases: Mapping[str, Floats],
    shape: tuple[int, int],
    *,
    seed: int,
    pairs: int = 1000,
    noise_sd: float = 0.1,
    all_pairs: bool = False,
    workers: int = 1,
    progress: bool = False,
) -> DistanceStudy:
    """Measure in-class, cross-class and baseline distances.

    Parameters
    ----------
    bases
        Schedule -> (bootstraps, D, k) orthonormal bases; may be empty.
    shape
        (D, k) of the bases and of the baselines.
    seed
        Seed of the study; each schedule, pair of schedules and baseline has its own stream.
    pairs
        Pairs per schedule, per pair of schedules and per baseline; all pairs of draws where
        there are fewer.
    noise_sd
        Sd of the noise on each entry of both identity matrices.
    all_pairs
        Whether the summary of in-class and cross-class distances is of all pairs of draws; the
        table has `pairs` of them all the same.
    workers
        Threads, for all pairs; results do not depend on them.
    progress
        Whether to say on stderr how far all pairs are.
    """
    notes = [] if bases else [_note("in-class distances", "no schedule has subspaces")]
    if len(bases) < 2:
        reason = f"{len(bases)} of the 2 schedules needed have subspaces"
        notes.append(_note("cross-class distances", reason))
    found = PairLengths(
        bases, all_pairs=all_pairs, workers=workers, progress=progress and all_pairs
    )
    blocks = []
    for name in bases:
        generator = named_generator(seed, "in_class", name)
        blocks.append(("in_class", name, name, found.in_class(generator, name, pairs)))
    for a, b in combinations(bases, 2):
        generator = named_generator(seed, "cross_class", a, b)
        blocks.append(("cross_class", a, b, found.cross_class(generator, a, b, pairs)))
    noised = noised_identity(named_generator(seed, "noised_identity"), shape, pairs, noise_sd)
    unrelated = random(named_generator(seed, "random"), shape, pairs)
    blocks += [("noised_identity", "", "", noised), ("random", "", "", unrelated)]
    lengths = {kind: found.lengths(kind) for kind in found.sums}
    lengths |= {"noised_identity": noised, "random": unrelated}
    errors = {kind: sums.standard_error for kind, sums in found.sums.items()}
    return DistanceStudy(_table(blocks), summarise_distances(lengths, errors), notes)


def summarise_distances(
    lengths: Mapping[str, Floats], standard_errors: Mapping[str, float]
) -> pd.DataFrame:
    """Summarise each kind.

    Parameters
    ----------
    lengths
        Kind -> distances, rad; kinds without any are left out.
    standard_errors
        Kind -> Monte-Carlo standard error of the mean; where not given, that of independent
        distances.

    Returns
    -------
    DataFrame
        ``kind, n, mean, mean_se, sd, q05, q25, median, q75, q95`` in rad and
        ``auc_against_in_class``: the probability that a distance of this kind exceeds an in-class
        one (NaN without any).
    """
    import pandas as pd

    own = np.sort(lengths.get("in_class", np.zeros(0)))
    rows = []
    for kind in [kind for kind in KINDS if len(lengths.get(kind, ()))]:
        values = np.sort(lengths[kind])
        spread = values.std(ddof=1) if len(values) > 1 else np.nan
        error = standard_errors.get(kind, spread / np.sqrt(len(values)))
        quantiles = np.quantile(values, [0.05, 0.25, 0.5, 0.75, 0.95])
        levels = (len(values), values.mean(), error, spread, *quantiles, auc(values, own))
        rows.append((kind, *levels))
    return pd.DataFrame(rows, columns=list(_SUMMARY_COLUMNS))


def auc(values: Floats, reference: Floats) -> float:
    """Return the probability that a value exceeds a reference value; ties count half."""
    if not (len(values) and len(reference)):
        return float("nan")
    ordered = np.sort(reference)  # quick where it is sorted already
    below = np.searchsorted(ordered, values, "left") + np.searchsorted(ordered, values, "right")
    return float(below.mean() / (2 * len(reference)))


def _note(what: str, reason: str) -> dict[str, str]:
    return {"what": what, "reason": reason}


def _table(blocks: list[tuple[str, str, str, Floats]]) -> pd.DataFrame:
    import pandas as pd

    columns = ("schedule_a", "schedule_b", "distance_rad")
    frames = [
        pd.DataFrame({"kind": kind, **dict(zip(columns, block, strict=True))})
        for kind, *block in blocks
    ]
    return pd.concat(frames, ignore_index=True)
