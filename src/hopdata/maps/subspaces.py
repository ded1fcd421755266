"""Constraint subspaces of the mode schedules, and the arc lengths between them (Fig. 2.5).

Björck and Golub (1973): the cosines of the principal angles are the singular values of
``a.T @ b`` and their sines those of ``b - a @ (a.T @ b)``. A cosine near one has lost half the
digits of a small angle, a sine near one those of an angle near a right angle, so each angle is
taken from the form that is good for it. The arc length is the 2-norm of the angles (Edelman,
Arias and Smith 1998, Sec. 4.3), the geodesic distance on the Grassmann manifold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.arrays import BoolArray, FloatArray, IntArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.maps.draws import Notes, chunks, distinct_draws, named_generator, rare_notes

#: Arc lengths below this need the sines: an error e in each cosine moves a length d by k e / d.
_SMALL_ARC_LENGTH = 0.5


def principal_angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the principal angles between subspaces.

    Parameters
    ----------
    a, b
        (..., D, k) orthonormal bases; leading axes broadcast.

    Returns
    -------
    ndarray
        (..., k) angles in rad, increasing, in [0, pi/2]; absolute error a few 1e-16 times
        the departure of the bases from orthonormality.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
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


# What distances between subspaces are without any data: equal but noisy, or unrelated ones.


def noised_identity(
    generator: np.random.Generator, shape: tuple[int, int], count: int, noise_sd: float
) -> FloatArray:
    """Return arc lengths of `count` pairs of (D, k) identities with normal noise on each entry.

    The dissertation compares with "noised identical matrices ... with a signal-to-noise ratio of
    10" (Sec. 2.3) and does not say what is noised or how the ratio is counted. Of all ways to read
    it, noise of sd 0.1 on every entry of both gives distances like the printed ones.
    """
    noise = noise_sd * generator.standard_normal((2, count, *shape))
    return arc_length(*orthonormalised(np.eye(*shape) + noise))


def random(generator: np.random.Generator, shape: tuple[int, int], count: int) -> FloatArray:
    """Return arc lengths of `count` pairs of uniform (Haar) random subspaces."""
    return arc_length(*orthonormalised(generator.standard_normal((2, count, *shape))))


# Constraint subspaces of the landing map: bootstrapped principal components of pairs.
#
# A pair (pre state, post state) has 12B coordinates; the two section conditions make two of its
# principal components nearly constant, and a map from 6B - 1 to 6B - 1 dimensions then shows as
# 6B - 1 large and 6B - 1 small components in the 12B - 2 that remain (Sec. 2.2.4 of the
# dissertation). The printed text compares the small ones; 30 landings have rank 29 at most, which
# leaves several of those arbitrary, so the *leading* ones are kept here. The arc length between
# two subspaces is that between their complements.

#: Principal components taken for the two Poincaré sections.
SECTION_COMPONENTS = 2
#: Singular values below this share of the largest leave a draw without that component.
_RANK_TOLERANCE = 1e-10


@dataclass(frozen=True)
class SubspaceStudy:
    """Bootstrapped subspaces of a study.

    Attributes
    ----------
    bases
        Schedule -> (bootstraps, D, k) orthonormal bases of the leading components, in axes along
        those of the pooled pairs: see `pooled_frame`.
    shape
        (D, k) of the bases, known even where no class has any.
    notes
        What was left out, each ``{"what": ..., "reason": ...}``.
    """

    bases: dict[str, FloatArray]
    shape: tuple[int, int]
    notes: Notes


def pooled_frame(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the principal components of pairs but for the two that vary least, (12B, 12B - 2).

    These two are the section conditions.

    Parameters
    ----------
    x, y
        (n, 6B) normalised pairs of all usable landings.
    """
    pairs = np.hstack([x, y])
    right = np.linalg.svd(np.linalg.qr(pairs - pairs.mean(0), mode="r"), full_matrices=True)[2]
    return np.asarray(right[:-SECTION_COMPONENTS].T)


@one_blas_thread()
def bootstrap_subspaces(
    x: FloatArray,
    y: FloatArray,
    schedule: ArrayLike,
    *,
    seed: int,
    bootstraps: int = 1000,
    samples: int = 30,
    components: int | None = None,
) -> SubspaceStudy:
    """Draw leading principal subspaces of each mode schedule.

    Parameters
    ----------
    x, y
        (n, 6B) normalised pairs.
    schedule
        (n,) mode schedules; landings without one (empty) serve the pooled frame only.
    seed
        Seed of the study; each schedule has its own stream.
    bootstraps
        Draws per schedule.
    samples
        Distinct landings per draw, centred on their own mean. Smaller classes are left out.
    components
        Dimension k of the subspaces, by default 6B - 1 and less than `samples`.

    Raises
    ------
    AnalysisError
        If there are fewer than two landings, or if one has a value that is not finite.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    unknown = np.flatnonzero(~np.isfinite(np.hstack([x, y])).all(axis=1))
    if len(x) < 2 or unknown.size:
        there = f"{unknown.size} others, the first in row {unknown[0]}" if unknown.size else len(x)
        raise AnalysisError.at("subspaces", "at least 2 landings, all finite", there)
    names = np.asarray(schedule, str)
    pairs = np.hstack([x, y]) @ pooled_frame(x, y)
    k = components or min(x.shape[1] - 1, samples - 1)
    bases: dict[str, FloatArray] = {}
    notes, rare = _fewer_components(k, x.shape[1] - 1, components, samples), {}
    for name in sorted(set(names.tolist()) - {""}):
        rows = np.flatnonzero(names == name)
        if len(rows) < samples:
            rare[name] = len(rows)
            continue
        reason = _problem(samples, k, pairs.shape[1])
        if not reason:
            generator = named_generator(seed, "subspaces", name)
            (draws,) = distinct_draws(generator, len(rows), (samples,), bootstraps)
            found, full = leading_subspaces(pairs[rows], draws, k)
            if full.any():
                bases[name] = found[full]
            if not full.all():
                reason = f"{np.sum(~full)} of {bootstraps} draws have fewer than {k} components"
        if reason:
            notes.append({"what": f"subspaces of schedule {name}", "reason": reason})
    notes += rare_notes("subspaces", rare, f"{samples} distinct ones wanted in each draw")
    return SubspaceStudy(bases, (pairs.shape[1], k), notes)


def leading_subspaces(
    pairs: FloatArray, draws: NDArray[np.integer], k: int
) -> tuple[FloatArray, BoolArray]:
    """Return the k leading principal components of each draw.

    Parameters
    ----------
    pairs
        (n, D) points of one class.
    draws
        (R, m) row numbers, m > k.
    k
        Number of components.

    Returns
    -------
    bases
        (R, D, k) orthonormal.
    full
        (R,) whether the draw has k components; otherwise some of the basis is arbitrary.
    """
    bases = np.empty((len(draws), pairs.shape[1], k))
    full = np.empty(len(draws), bool)
    for some in chunks(len(draws), draws.shape[1] * pairs.shape[1]):
        points = pairs[draws[some]]
        points -= points.mean(axis=1, keepdims=True)
        _, values, right = np.linalg.svd(points, full_matrices=False)
        bases[some] = right[:, :k].swapaxes(1, 2)
        full[some] = values[:, k - 1] > _RANK_TOLERANCE * values[:, 0]
    return bases, full


def _fewer_components(k: int, printed: int, components: int | None, samples: int) -> Notes:
    """Note that many body markers ask for more components than a draw's landings span."""
    if components or k == printed:
        return []
    reason = f"{samples} landings span no more: set subspaces.samples"
    return [{"what": f"{k} components instead of {printed}", "reason": reason}]


def _problem(samples: int, k: int, dimension: int) -> str:
    """Return why no class can have subspaces, or an empty string."""
    if k >= samples or k > dimension:
        return (
            f"{samples} landings span at most {samples - 1} of {dimension} dimensions, {k} "
            "wanted: set subspaces.samples or subspaces.components"
        )
    return ""


# Arc-length distances between subspaces, and the two baselines of Fig. 2.5.
#
# Four kinds: in-class (two draws of one mode schedule), cross-class (draws of two schedules),
# noised identity (the identity and the identity, both with noise: what equal matrices look like
# when they are estimated) and random (what unrelated ones look like).
#
# Draws of one schedule are taken from one pool and share landings, so in-class distances are
# smaller than those of independent draws and an AUC against them is above 0.5 even where all
# schedules have one map. The AUC is reported as a description, not as a test.


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
    notes: Notes


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
