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

from hopdata.maps.draws import named_generator
from hopdata.maps.grassmann import arc_length, orthonormalised

if TYPE_CHECKING:
    import pandas as pd

#: Kinds of distance, in the order of Fig. 2.5.
KINDS = ("in_class", "cross_class", "noised_identity", "random")
_SUMMARY_COLUMNS = (
    *("kind", "n", "mean", "sd", "q05", "q25", "median", "q75", "q95"),
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


def measure_distances(
    bases: Mapping[str, Floats],
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
    blocks = []
    for name, draws in bases.items():
        generator = named_generator(seed, "in_class", name)
        blocks.append(("in_class", name, name, in_class(generator, draws, pairs)))
    for a, b in combinations(bases, 2):
        generator = named_generator(seed, "cross_class", a, b)
        lengths = cross_class(generator, bases[a], bases[b], pairs)
        blocks.append(("cross_class", a, b, lengths))
    noised = noised_identity(named_generator(seed, "noised_identity"), shape, pairs, noise_sd)
    blocks.append(("noised_identity", "", "", noised))
    blocks.append(("random", "", "", random(named_generator(seed, "random"), shape, pairs)))
    table = _table(blocks)
    return DistanceStudy(table, summarise_distances(table), notes)


def in_class(generator: np.random.Generator, bases: Floats, pairs: int) -> Floats:
    """Return distances of up to `pairs` different pairs of different draws of (R, D, k) bases."""
    first, second = np.triu_indices(len(bases), 1)
    chosen = _some(generator, len(first), pairs)
    return arc_length(bases[first[chosen]], bases[second[chosen]])


def cross_class(generator: np.random.Generator, a: Floats, b: Floats, pairs: int) -> Floats:
    """Return distances of up to `pairs` different pairs, one draw from `a` and one from `b`."""
    first, second = np.divmod(_some(generator, len(a) * len(b), pairs), len(b))
    return arc_length(a[first], b[second])


def noised_identity(
    generator: np.random.Generator, shape: tuple[int, int], count: int, noise_sd: float
) -> Floats:
    """Return distances of `count` pairs of noised identities of a (D, k) shape.

    Both matrices get independent normal noise on every entry and are orthonormalised.
    """
    noise = noise_sd * generator.standard_normal((2, count, *shape))
    a, b = orthonormalised(np.eye(*shape) + noise)
    return arc_length(a, b)


def random(generator: np.random.Generator, shape: tuple[int, int], count: int) -> Floats:
    """Return distances of `count` pairs of uniform (Haar) random subspaces of a (D, k) shape."""
    a, b = orthonormalised(generator.standard_normal((2, count, *shape)))
    return arc_length(a, b)


def summarise_distances(distances: pd.DataFrame) -> pd.DataFrame:
    """Summarise each kind.

    Returns
    -------
    DataFrame
        ``kind, n, mean, sd, q05, q25, median, q75, q95`` in rad and ``auc_against_in_class``:
        the probability that a distance of this kind exceeds an in-class one (NaN without any).
    """
    import pandas as pd

    lengths = dict(iter(distances.groupby("kind")["distance_rad"]))
    own = np.asarray(lengths.get("in_class", []), float)
    rows = []
    for kind in [kind for kind in KINDS if kind in lengths]:
        values = np.asarray(lengths[kind], float)
        spread = values.std(ddof=1) if len(values) > 1 else np.nan
        quantiles = np.quantile(values, [0.05, 0.25, 0.5, 0.75, 0.95])
        rows.append((kind, len(values), values.mean(), spread, *quantiles, auc(values, own)))
    return pd.DataFrame(rows, columns=list(_SUMMARY_COLUMNS))


def auc(values: Floats, reference: Floats) -> float:
    """Return the probability that a value exceeds a reference value; ties count half."""
    if not (len(values) and len(reference)):
        return float("nan")
    ordered = np.sort(reference)
    below = np.searchsorted(ordered, values, "left") + np.searchsorted(ordered, values, "right")
    return float(below.mean() / (2 * len(reference)))


def _some(generator: np.random.Generator, population: int, count: int) -> NDArray[np.int64]:
    return np.sort(generator.choice(population, min(count, population), replace=False))


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
