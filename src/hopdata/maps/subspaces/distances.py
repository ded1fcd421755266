"""Arc-length distances between subspaces, and the two baselines of Fig. 2.5.

Four kinds: in-class (two draws of one mode schedule), cross-class (draws of two schedules),
noised identity (the identity and the identity, both with noise: what equal matrices look like
when they are estimated) and random (what unrelated ones look like).

Draws of one schedule are taken from one pool and share landings, so in-class distances are
smaller than those of independent draws and an AUC against them is above 0.5 even where all
schedules have one map. The AUC is reported as a description, not as a test.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray, IntArray, pd
from hopdata.blas import one_blas_thread
from hopdata.maps.draws import named_generator
from hopdata.maps.subspaces.grassmann import arc_length, noised_identity, random


def pair_mean_error(values: FloatArray, first: IntArray, second: IntArray) -> float:
    """Return the standard error of the mean over pairs of numbered draws; NaN of one pair.

    A mean over pairs is a U-statistic: pairs that share a draw are not independent. Two pairs with
    a draw in common are taken to covary, no others (Aronow, Samii and Assenova 2015). It is not
    less than if all pairs were independent, which a sample can make it seem.

    Parameters
    ----------
    values
        (N,) of the pairs.
    first, second
        (N,) numbers of the draws of each pair.
    """
    if len(values) < 2:
        return float("nan")
    deviations = values - values.mean()
    independent = float(deviations @ deviations)
    of_draws = np.bincount(np.r_[first, second], np.r_[deviations, deviations])
    shared = float(of_draws @ of_draws) - independent
    return float(np.sqrt(max(shared, independent))) / len(values)


def in_class_pairs(
    generator: np.random.Generator, draws: int, pairs: int
) -> tuple[IntArray, IntArray]:
    """Choose up to `pairs` different pairs of different draws."""
    first, second = np.triu_indices(draws, 1)
    chosen = _some(generator, len(first), pairs)
    return first[chosen], second[chosen]


def cross_class_pairs(
    generator: np.random.Generator, first: int, second: int, pairs: int
) -> tuple[IntArray, IntArray]:
    """Choose up to `pairs` different pairs of one draw from each of two sets."""
    return np.divmod(_some(generator, first * second, pairs), second)


def _some(generator: np.random.Generator, population: int, count: int) -> IntArray:
    return np.sort(generator.choice(population, min(count, population), replace=False))


#: Kinds of distance, in the order of Fig. 2.5.
KINDS = ("in_class", "cross_class", "noised_identity", "random")
_SUMMARY_COLUMNS = (
    *("kind", "n", "mean", "mean_se", "sd", "q05", "q25", "median", "q75", "q95"),
    "auc_against_in_class",
)


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
    bases: Mapping[str, FloatArray],
    shape: tuple[int, int],
    *,
    seed: int,
    pairs: int = 1000,
    noise_sd: float = 0.1,
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
    """
    notes = [] if bases else [_note("in-class distances", "no schedule has subspaces")]
    if len(bases) < 2:
        reason = f"{len(bases)} of the 2 schedules needed have subspaces"
        notes.append(_note("cross-class distances", reason))
    starts = dict(zip(bases, np.cumsum([0, *map(len, bases.values())]).tolist(), strict=False))
    blocks, ends = [], {}
    kinds: dict[str, tuple[Callable[..., tuple[IntArray, IntArray]], list[tuple[str, ...]]]] = {
        "in_class": (in_class_pairs, [(name,) for name in bases]),
        "cross_class": (cross_class_pairs, list(combinations(bases, 2))),
    }
    for kind, (choose, classes) in kinds.items():
        numbers = [np.zeros((2, 0), int)]
        for names in classes:
            a, b = names[0], names[-1]
            generator = named_generator(seed, kind, *names)
            first, second = choose(generator, *(len(bases[name]) for name in names), pairs)
            blocks.append((kind, a, b, arc_length(bases[a][first], bases[b][second])))
            numbers.append(np.array([first + starts[a], second + starts[b]]))
        ends[kind] = np.hstack(numbers)
    noised = noised_identity(named_generator(seed, "noised_identity"), shape, pairs, noise_sd)
    unrelated = random(named_generator(seed, "random"), shape, pairs)
    blocks += [("noised_identity", "", "", noised), ("random", "", "", unrelated)]
    found = {kind for kind, *_ in blocks}
    lengths = {kind: np.concatenate([b[-1] for b in blocks if b[0] == kind]) for kind in found}
    errors = {kind: pair_mean_error(lengths[kind], *ends[kind]) for kind in found & ends.keys()}
    return DistanceStudy(_table(blocks), summarise_distances(lengths, errors), notes)


def summarise_distances(
    lengths: Mapping[str, FloatArray], standard_errors: Mapping[str, float]
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


def auc(values: FloatArray, reference: FloatArray) -> float:
    """Return the probability that a value exceeds a reference value; ties count half."""
    if not (len(values) and len(reference)):
        return float("nan")
    ordered = np.sort(reference)  # quick where it is sorted already
    below = np.searchsorted(ordered, values, "left") + np.searchsorted(ordered, values, "right")
    return float(below.mean() / (2 * len(reference)))


def _note(what: str, reason: str) -> dict[str, str]:
    return {"what": what, "reason": reason}


def _table(blocks: list[tuple[str, str, str, FloatArray]]) -> pd.DataFrame:
    columns = ("schedule_a", "schedule_b", "distance_rad")
    frames = [
        pd.DataFrame({"kind": kind, **dict(zip(columns, block, strict=True))})
        for kind, *block in blocks
    ]
    return pd.concat(frames, ignore_index=True)
