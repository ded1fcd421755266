"""Constraint subspaces of the mode schedules, and the arc lengths between them (Fig. 2.5).

The cosines of the principal angles are the singular values of ``a.T @ b``, and their
sines are those of ``b - a @ (a.T @ b)`` (Björck and Golub 1973). A cosine near one
loses half the digits of a small angle, and a sine near one loses half those of an angle
near a right angle, so each angle is computed from the more accurate of the two. The arc
length is the 2-norm of the angles (Edelman, Arias and Smith 1998, Sec. 4.3), which is
the geodesic distance on the Grassmann manifold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.arrays import BoolArray, FloatArray, IntArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.maps.draws import (
    Notes,
    chunks,
    distinct_draws,
    grouped,
    named_generator,
    rare_notes,
    schedule_stream,
)

#: Arc lengths d below this need the sines: an error e in each cosine changes d by k e /
#: d.
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
        (..., k) angles in rad, increasing, in [0, pi/2]; absolute error a few 1e-16
        times the deviation of the bases from orthonormality.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    overlap = a.swapaxes(-1, -2) @ b
    cosines = np.linalg.svd(overlap, compute_uv=False)
    sines = np.linalg.svd(b - a @ overlap, compute_uv=False)[..., ::-1]
    small = cosines**2 > 0.5
    return np.where(
        small, np.arcsin(np.minimum(sines, 1)), np.arccos(np.minimum(cosines, 1))
    )


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
        a, b = (
            np.broadcast_to(part, (*lengths.shape, *part.shape[-2:])) for part in (a, b)
        )
        lengths[close] = np.linalg.norm(principal_angles(a[close], b[close]), axis=-1)
    return lengths


def orthonormalised(matrices: FloatArray) -> FloatArray:
    """Return orthonormal bases of the column spaces of (..., D, k) matrices of full rank."""
    return np.linalg.qr(np.asarray(matrices, float))[0]


# Baselines: distances between equal but noisy subspaces and between unrelated ones,
# without data.


def noised_identity(
    generator: np.random.Generator, shape: tuple[int, int], count: int, noise_sd: float
) -> FloatArray:
    """Return the arc lengths between `count` pairs of (D, k) identities with normal noise.

    The dissertation compares with "noised identical matrices ... with a signal-to-noise
    ratio of 10" (Sec. 2.3). It does not say what the noise is added to or how the ratio
    is defined. Of all possible readings, noise of sd 0.1 on every entry of both
    matrices gives distances like the printed ones.
    """
    noise = noise_sd * generator.standard_normal((2, count, *shape))
    return arc_length(*orthonormalised(np.eye(*shape) + noise))


def random(
    generator: np.random.Generator, shape: tuple[int, int], count: int
) -> FloatArray:
    """Return the arc lengths between `count` pairs of uniform (Haar) random subspaces."""
    return arc_length(*orthonormalised(generator.standard_normal((2, count, *shape))))


# Constraint subspaces of the landing map: bootstrapped principal components of pairs.
#
# A pair (pre state, post state) has 12B coordinates. The two section conditions make
# two of its principal components nearly constant. A map from 6B - 1 to 6B - 1
# dimensions then appears as 6B - 1 large and 6B - 1 small components among the
# remaining 12B - 2 (Sec. 2.2.4 of the dissertation). The printed text compares the
# small ones. But 30 landings have rank 29 at most, which leaves several small
# components arbitrary, so the *leading* ones are kept here. The arc length between two
# subspaces equals that between their complements.

#: Number of principal components that the two Poincaré sections use up.
SECTION_COMPONENTS = 2
#: A draw lacks the components whose singular values are below this fraction of the
#: largest.
_RANK_TOLERANCE = 1e-10


@dataclass(frozen=True)
class SubspaceStudy:
    """Bootstrapped subspaces of a study.

    Attributes
    ----------
    bases
        Schedule -> (bootstraps, D, k) orthonormal bases of the leading components, in
        the axes of `pooled_frame`.
    shape
        (D, k) of the bases, known even if no class has any.
    notes
        Omissions, each ``{"what": ..., "reason": ...}``.
    streams
        Schedule -> name of its random stream (see
        `hopdata.maps.draws.schedule_stream`).
    """

    bases: dict[str, FloatArray]
    shape: tuple[int, int]
    notes: Notes
    streams: dict[str, str] = field(default_factory=dict)


def pooled_frame(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the principal components of pairs without the two that vary least, (12B, 12B - 2).

    Those two are the section conditions.

    Parameters
    ----------
    x, y
        (n, 6B) normalised pairs of all usable landings.
    """
    pairs = np.hstack([x, y])
    right = np.linalg.svd(
        np.linalg.qr(pairs - pairs.mean(0), mode="r"), full_matrices=True
    )[2]
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
        (n,) mode schedules; landings without one (empty) are used only for the pooled
        frame.
    seed
        Seed of the study; each schedule has its own stream.
    bootstraps
        Number of draws per schedule.
    samples
        Number of distinct landings per draw, centred on their own mean. Smaller classes
        are left out.
    components
        Dimension k of the subspaces; by default the smaller of 6B - 1 and `samples` -
        1.

    Raises
    ------
    AnalysisError
        If there are fewer than two landings, or if one has a value that is not finite.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    unknown = np.flatnonzero(~np.isfinite(np.hstack([x, y])).all(axis=1))
    if len(x) < 2 or unknown.size:
        there = (
            f"{unknown.size} others, the first in row {unknown[0]}"
            if unknown.size
            else len(x)
        )
        raise AnalysisError.at("subspaces", "at least 2 landings, all finite", there)
    classes, rare = grouped(np.asarray(schedule, str), samples)
    pairs = np.hstack([x, y]) @ pooled_frame(x, y)
    k = components or min(x.shape[1] - 1, samples - 1)
    bases: dict[str, FloatArray] = {}
    streams: dict[str, str] = {}
    notes = []
    if (
        not components and k < x.shape[1] - 1
    ):  # the markers need more than a draw's landings span
        what = f"{k} components instead of {x.shape[1] - 1}"
        notes.append(
            _note(what, f"{samples} landings span no more: set subspaces.samples")
        )
    for name, rows in classes.items():
        what = f"subspaces of schedule {name}"
        if k >= samples or k > pairs.shape[1]:
            span = f"{samples} landings span at most {samples - 1} of {pairs.shape[1]} dimensions"
            wanted = f"{k} wanted: set subspaces.samples or subspaces.components"
            notes.append(_note(what, f"{span}, {wanted}"))
            continue
        streams[name] = schedule_stream(rows)
        generator = named_generator(seed, "subspaces", streams[name])
        (draws,) = distinct_draws(generator, len(rows), (samples,), bootstraps)
        found, full = leading_subspaces(pairs[rows], draws, k)
        if full.any():
            bases[name] = found[full]
        if not full.all():
            lacking = (
                f"{np.sum(~full)} of {bootstraps} draws have fewer than {k} components"
            )
            notes.append(_note(what, lacking))
    notes += rare_notes(
        "subspaces", rare, f"{samples} distinct ones wanted in each draw"
    )
    return SubspaceStudy(bases, (pairs.shape[1], k), notes, streams)


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
        (R, D, k) orthonormal bases.
    full
        (R,) whether the draw has k components; if not, part of the basis is arbitrary.
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


# Arc-length distances between subspaces, and the two baselines of Fig. 2.5.
#
# There are four kinds: in-class (two draws of one mode schedule), cross-class (draws of
# two schedules), noised identity (two identities with noise, as equal matrices look
# when estimated) and random (as unrelated subspaces look).
#
# Draws of one schedule come from one pool and share landings. In-class distances are
# therefore smaller than those of independent draws, and an AUC against them is above
# 0.5 even if all schedules have one map. The AUC is reported as a description, not as a
# test.


def pair_mean_error(values: FloatArray, first: IntArray, second: IntArray) -> float:
    """Return the standard error of the mean over pairs of numbered draws; NaN for one pair.

    A mean over pairs is a U-statistic: pairs that share a draw are not independent. Two
    pairs are assumed to covary only if they have a draw in common (Aronow, Samii and
    Assenova 2015). The result is at least the error for independent pairs, although the
    estimate from a sample can be smaller.

    Parameters
    ----------
    values
        (N,) values of the pairs.
    first, second
        (N,) numbers of the two draws of each pair.
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
    """Choose up to `pairs` distinct pairs of different draws."""
    first, second = np.triu_indices(draws, 1)
    chosen = _some(generator, len(first), pairs)
    return first[chosen], second[chosen]


def cross_class_pairs(
    generator: np.random.Generator, first: int, second: int, pairs: int
) -> tuple[IntArray, IntArray]:
    """Choose up to `pairs` distinct pairs with one draw from each of two sets."""
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
        One row per distance: ``kind, schedule_a, schedule_b, distance_rad``.
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
    streams: Mapping[str, str] | None = None,
) -> DistanceStudy:
    """Measure in-class, cross-class and baseline distances.

    Parameters
    ----------
    bases
        Schedule -> (bootstraps, D, k) orthonormal bases; may be empty.
    shape
        (D, k) of the bases and of the baselines.
    seed
        Seed of the study; each schedule, pair of schedules and baseline has its own
        stream.
    pairs
        Number of pairs per schedule, per pair of schedules and per baseline; if there
        are fewer pairs of draws, all are used.
    noise_sd
        Sd of the noise on each entry of both identity matrices.
    streams
        Schedule -> name of its random stream, from `bootstrap_subspaces`; by default
        its own name.
    """
    stream_of = streams or {name: name for name in bases}
    notes = [] if bases else [_note("in-class distances", "no schedule has subspaces")]
    if len(bases) < 2:
        reason = f"{len(bases)} of the 2 schedules needed have subspaces"
        notes.append(_note("cross-class distances", reason))
    starts = dict(
        zip(bases, np.cumsum([0, *map(len, bases.values())]).tolist(), strict=False)
    )
    blocks, ends = [], {}
    kinds: dict[
        str, tuple[Callable[..., tuple[IntArray, IntArray]], list[tuple[str, ...]]]
    ] = {
        "in_class": (in_class_pairs, [(name,) for name in bases]),
        "cross_class": (cross_class_pairs, list(combinations(bases, 2))),
    }
    for kind, (choose, classes) in kinds.items():
        numbers = [np.zeros((2, 0), int)]
        for names in classes:
            a, b = names[0], names[-1]
            # The draws do not depend on which of two schedules is named first.
            in_order = sorted(names, key=stream_of.__getitem__)
            generator = named_generator(
                seed, kind, *(stream_of[name] for name in in_order)
            )
            first, second = choose(
                generator, *(len(bases[name]) for name in in_order), pairs
            )
            if in_order != list(names):
                first, second = second, first
            blocks.append((kind, a, b, arc_length(bases[a][first], bases[b][second])))
            numbers.append(np.array([first + starts[a], second + starts[b]]))
        ends[kind] = np.hstack(numbers)
    noised = noised_identity(
        named_generator(seed, "noised_identity"), shape, pairs, noise_sd
    )
    unrelated = random(named_generator(seed, "random"), shape, pairs)
    blocks += [("noised_identity", "", "", noised), ("random", "", "", unrelated)]
    found = {kind for kind, *_ in blocks}
    lengths = {
        kind: np.concatenate([b[-1] for b in blocks if b[0] == kind]) for kind in found
    }
    errors = {
        kind: pair_mean_error(lengths[kind], *ends[kind])
        for kind in found & ends.keys()
    }
    return DistanceStudy(_table(blocks), summarise_distances(lengths, errors), notes)


def summarise_distances(
    lengths: Mapping[str, FloatArray], standard_errors: Mapping[str, float]
) -> pd.DataFrame:
    """Summarise the distances of each kind.

    Parameters
    ----------
    lengths
        Kind -> distances, rad; kinds without any are left out.
    standard_errors
        Kind -> Monte-Carlo standard error of the mean; by default that of independent
        distances.

    Returns
    -------
    DataFrame
        ``kind, n, mean, mean_se, sd, q05, q25, median, q75, q95`` in rad and
        ``auc_against_in_class``: the probability that a distance of this kind exceeds
        an in-class one (NaN if there are no in-class distances).
    """
    own = np.sort(lengths.get("in_class", np.zeros(0)))
    rows = []
    for kind in [kind for kind in KINDS if len(lengths.get(kind, ()))]:
        values = np.sort(lengths[kind])
        spread = values.std(ddof=1) if len(values) > 1 else np.nan
        error = standard_errors.get(kind, spread / np.sqrt(len(values)))
        quantiles = np.quantile(values, [0.05, 0.25, 0.5, 0.75, 0.95])
        levels = (
            len(values),
            values.mean(),
            error,
            spread,
            *quantiles,
            auc(values, own),
        )
        rows.append((kind, *levels))
    return pd.DataFrame(rows, columns=list(_SUMMARY_COLUMNS))


def auc(values: FloatArray, reference: FloatArray) -> float:
    """Return the probability that a value exceeds a reference value; ties count half."""
    if not (len(values) and len(reference)):
        return float("nan")
    ordered = np.sort(reference)  # fast if it is sorted already
    below = np.searchsorted(ordered, values, "left") + np.searchsorted(
        ordered, values, "right"
    )
    return float(below.mean() / (2 * len(reference)))


def _note(what: str, reason: str) -> dict[str, str]:
    return {"what": what, "reason": reason}


def _table(blocks: list[tuple[str, str, str, FloatArray]]) -> pd.DataFrame:
    columns = ("kind", "schedule_a", "schedule_b", "distance_rad")
    frames = [pd.DataFrame(dict(zip(columns, block, strict=True))) for block in blocks]
    return pd.concat(frames, ignore_index=True)
