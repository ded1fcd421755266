"""Constraint subspaces of the mode schedules, and arc lengths between them (Fig. 2.5).

The cosines of the principal angles are the singular values of ``a.T @ b``, and their
sines are those of ``b - a @ (a.T @ b)`` (Björck and Golub 1973). A cosine near one
loses half the digits of a small angle, and a sine near one loses half those of an angle
near a right angle, so each angle is computed from the more accurate of the two. The arc
length is the 2-norm of the angles (Edelman, Arias and Smith 1998, Sec. 4.3), which is
the geodesic distance on the Grassmann manifold.

`scipy.linalg.subspace_angles` is not used: it decides between sine and cosine by the
wrong angle where small and large angles meet, and then errs by up to 3e-8.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.arrays import BoolArray, FloatArray, IntArray, one_blas_thread, pd
from hopdata.errors import AnalysisError, require_choice
from hopdata.maps.draws import (
    Notes,
    chunks,
    distinct_draws,
    grouped,
    named_generator,
    rare_notes,
    resampled_draws,
    schedule_stream,
)

#: Arc length below which the sines are needed.
#: Unit: rad. Origin: chosen: an error e in each of k cosines changes an arc length d by
#: about k e / d.
SMALL_ARC_LENGTH = 0.5


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
    a = np.asarray(a, float)
    b = np.asarray(b, float)
    overlap = a.swapaxes(-1, -2) @ b
    cosines = np.linalg.svd(overlap, compute_uv=False)
    sines = np.linalg.svd(b - a @ overlap, compute_uv=False)[..., ::-1]

    # Rounding may leave sines and cosines slightly above one.
    by_sine = np.arcsin(np.minimum(sines, 1))
    by_cosine = np.arccos(np.minimum(cosines, 1))
    below_45_degrees = cosines**2 > 0.5
    return np.where(below_45_degrees, by_sine, by_cosine)


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
    a = np.asarray(a, float)
    b = np.asarray(b, float)
    cosines = np.linalg.svd(a.swapaxes(-1, -2) @ b, compute_uv=False)
    angles = np.arccos(np.minimum(cosines, 1))
    lengths = np.asarray(np.linalg.norm(angles, axis=-1))

    close = lengths < SMALL_ARC_LENGTH
    if close.any():
        a = np.broadcast_to(a, (*lengths.shape, *a.shape[-2:]))
        b = np.broadcast_to(b, (*lengths.shape, *b.shape[-2:]))
        accurate_angles = principal_angles(a[close], b[close])
        lengths[close] = np.linalg.norm(accurate_angles, axis=-1)
    return lengths


def orthonormalised(matrices: FloatArray) -> FloatArray:
    """Return orthonormal bases of the columns of (..., D, k) matrices of full rank."""
    return np.linalg.qr(np.asarray(matrices, float))[0]


# Baselines: distances between equal but noisy subspaces and between unrelated ones,
# without data.


def noised_identity(
    generator: np.random.Generator, shape: tuple[int, int], count: int, noise_sd: float
) -> FloatArray:
    """Return arc lengths between `count` pairs of (D, k) identities with normal noise.

    The dissertation compares with "noised identical matrices ... with a signal-to-noise
    ratio of 10" (Sec. 2.3). It does not say what the noise is added to or how the ratio
    is defined. Of all possible readings, noise of sd 0.1 on every entry of both
    matrices gives distances like the printed ones.
    """
    noise = noise_sd * generator.standard_normal((2, count, *shape))
    first, second = orthonormalised(np.eye(*shape) + noise)
    return arc_length(first, second)


def random(
    generator: np.random.Generator, shape: tuple[int, int], count: int
) -> FloatArray:
    """Return arc lengths between `count` pairs of uniform (Haar) random subspaces."""
    first, second = orthonormalised(generator.standard_normal((2, count, *shape)))
    return arc_length(first, second)


# Constraint subspaces of the landing map: bootstrapped principal components of pairs.
#
# A pair (pre state, post state) has 12B coordinates. The two section conditions make
# two of its principal components nearly constant. A map from 6B - 1 to 6B - 1
# dimensions then appears as 6B - 1 large and 6B - 1 small components among the
# remaining 12B - 2 (Sec. 2.2.4 of the dissertation). The printed text compares the
# small ones (and in Sec. 2.3 "the most significant half"). But 30 landings have rank 29
# at most, which leaves several small components arbitrary, so the *leading* ones are
# kept here. The arc length between two subspaces equals that between their complements.

# Principal components that the two Poincaré sections use up, one each.
SECTION_COMPONENTS = 2

#: A draw lacks the components whose singular values are below this fraction of the
#: largest.
#: Unit: 1. Origin: chosen.
RANK_TOLERANCE = 1e-10


def _last(of: int, k: int) -> slice:
    return slice(of - k, of)


#: Which components span a subspace -> their rows, of a complete set of components in
#: order of falling variance, given the rank of the draw and the dimension k.
#:
#: ``smallest`` takes the last k of the space: where k is half of its dimension, they
#: are the complement of the leading ones, and equally far apart. ``smallest_spanned``
#: takes the last k of those in which the draw varies at all, which is what remains if a
#: program returns no more components than there are landings; it is no complement.
COMPONENTS: dict[str, Callable[[int, int, int], slice]] = {
    "leading": lambda _dimension, _rank, k: slice(0, k),
    "smallest": lambda dimension, _rank, k: _last(dimension, k),
    "smallest_spanned": lambda _dimension, rank, k: _last(max(rank, k), k),
}

#: How the landings of a subspace are drawn: each once, or with replacement.
SUBSPACE_DRAWS = {"distinct": distinct_draws, "resampled": resampled_draws}

#: What becomes of draws in which the components are not determined, in words.
INCOMPLETE = {
    "leave_out": "left out",
    "redraw": "drawn again",
    "keep": "kept, though a part of each subspace is arbitrary",
}

#: Rounds in which incomplete draws are drawn again before they are left out.
#: Unit: 1. Origin: chosen.
MOST_REDRAWS = 20


@dataclass(frozen=True)
class SubspaceStudy:
    """Bootstrapped subspaces of a study.

    Attributes
    ----------
    bases
        Schedule -> (bootstraps, D, k) orthonormal bases of the chosen components, in
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
    """Return all but the two least principal components of pairs, (12B, 12B - 2).

    Those two are the section conditions.

    Parameters
    ----------
    x, y
        (n, 6B) normalised pairs of all usable landings.
    """
    pairs = np.hstack([x, y])
    centred = pairs - pairs.mean(0)
    # With fewer landings than dimensions, rows of zeros make the components complete.
    n_missing = max(0, pairs.shape[1] - len(pairs))
    complete = np.pad(centred, ((0, n_missing), (0, 0)))
    # scikit-learn's `PCA` finds the same, but takes longer to load than to compute.
    _, _, components = np.linalg.svd(complete, full_matrices=False)
    # As there, the largest entry of each component is positive.
    largest = np.argmax(np.abs(components), axis=1)
    sign = np.sign(components[np.arange(len(components)), largest])
    components *= sign[:, None]
    return np.asarray(components[:-SECTION_COMPONENTS].T)


@one_blas_thread()
def bootstrap_subspaces(  # noqa: PLR0913 - the data, and the method's options
    x: FloatArray,
    y: FloatArray,
    schedule: ArrayLike,
    *,
    seed: int,
    bootstraps: int = 1000,
    samples: int = 30,
    components: int | None = None,
    which: str = "leading",
    draws: str = "distinct",
    incomplete: str = "leave_out",
) -> SubspaceStudy:
    """Draw principal subspaces of each mode schedule.

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
        Number of landings per draw, centred on their own mean. Smaller classes are left
        out.
    components
        Dimension k of the subspaces; by default the smaller of 6B - 1 and `samples` -
        1.
    which
        ``"leading"``, ``"smallest"`` or ``"smallest_spanned"``: see `COMPONENTS`.
    draws
        ``"distinct"`` (no landing twice in a draw) or ``"resampled"`` (with
        replacement).
    incomplete
        What becomes of draws whose landings do not determine the components, as those
        with k distinct landings or fewer: ``"leave_out"``, ``"redraw"`` or ``"keep"``.

    Raises
    ------
    ConfigError
        If one of the last three is not among `COMPONENTS`, `SUBSPACE_DRAWS` or
        `INCOMPLETE`.
    AnalysisError
        If there are fewer than two landings, or if one has a value that is not finite.
    """
    require_choice("subspaces.which", which, COMPONENTS)
    require_choice("subspaces.draws", draws, SUBSPACE_DRAWS)
    require_choice("subspaces.incomplete", incomplete, INCOMPLETE)
    x = np.asarray(x, float)
    y = np.asarray(y, float)
    _require_landings(x, y)
    pairs = np.hstack([x, y]) @ pooled_frame(x, y)
    map_dimension = x.shape[1] - 1  # of a section
    span_of_draw = samples - 1  # of landings that are centred on their mean
    k = components or min(map_dimension, span_of_draw)
    notes = []
    if not components and k < map_dimension:
        what = f"{k} components instead of {map_dimension}"
        reason = f"{samples} landings span no more: set subspaces.samples"
        notes.append(_note(what, reason))

    bases: dict[str, FloatArray] = {}
    streams: dict[str, str] = {}
    classes, rare = grouped(np.asarray(schedule, str), samples)
    for name, rows in classes.items():
        what = f"subspaces of schedule {name}"
        if k >= samples or k > pairs.shape[1]:
            span = (
                f"{samples} landings span at most {span_of_draw} of {pairs.shape[1]} "
                "dimensions"
            )
            wanted = f"{k} wanted: set subspaces.samples or subspaces.components"
            notes.append(_note(what, f"{span}, {wanted}"))
            continue
        streams[name] = schedule_stream(rows)
        generator = named_generator(seed, "subspaces", streams[name])
        spanned = partial(
            _drawn_subspaces, generator, pairs[rows], samples, k, which, draws
        )
        found, full = spanned(bootstraps)
        lacking = int(np.sum(~full))
        if incomplete == "redraw":
            _draw_again(spanned, found, full)
        kept = full | (incomplete == "keep")
        if kept.any():
            bases[name] = found[kept]
        if lacking:
            done = f"{lacking} of {bootstraps} draws have fewer than {k} components"
            notes.append(_note(what, done + _what_was_done(incomplete)))
    wanted = f"{samples} distinct ones wanted in each draw"
    notes += rare_notes("subspaces", rare, wanted)
    return SubspaceStudy(bases, (pairs.shape[1], k), notes, streams)


def _drawn_subspaces(
    generator: np.random.Generator,
    pairs: FloatArray,
    samples: int,
    k: int,
    which: str,
    draws: str,
    count: int,
) -> tuple[FloatArray, BoolArray]:
    """Draw landings of one class `count` times; see `principal_subspaces`."""
    (drawn,) = SUBSPACE_DRAWS[draws](generator, len(pairs), (samples,), count)
    return principal_subspaces(pairs, drawn, k, which)


def _draw_again(
    spanned: Callable[[int], tuple[FloatArray, BoolArray]],
    found: FloatArray,
    full: BoolArray,
) -> None:
    """Replace bases that are not `full` by those of new draws, in place."""
    for _ in range(MOST_REDRAWS):
        rows = np.flatnonzero(~full)
        if not rows.size:
            return
        found[rows], full[rows] = spanned(len(rows))


def _what_was_done(incomplete: str) -> str:
    """Return the end of a note on incomplete draws; leaving out is what notes tell."""
    if incomplete == "leave_out":
        return ""
    return f"; they were {INCOMPLETE[incomplete]}"


def _require_landings(x: FloatArray, y: FloatArray) -> None:
    unknown = np.flatnonzero(~np.isfinite(np.hstack([x, y])).all(axis=1))
    if len(x) >= 2 and not unknown.size:
        return
    found: object = len(x)
    if unknown.size:
        found = f"{unknown.size} others, the first in row {unknown[0]}"
    raise AnalysisError.at("subspaces", "at least 2 landings, all finite", found)


def principal_subspaces(
    pairs: FloatArray, draws: NDArray[np.integer], k: int, which: str = "leading"
) -> tuple[FloatArray, BoolArray]:
    """Return k principal components of each draw.

    They are those of scikit-learn's `PCA`, of many draws at once.

    Parameters
    ----------
    pairs
        (n, D) points of one class.
    draws
        (R, m) row numbers, m > k.
    k
        Number of components.
    which
        One of `COMPONENTS`.

    Returns
    -------
    bases
        (R, D, k) orthonormal bases.
    full
        (R,) whether the draw determines the components; if not, part of the basis is
        arbitrary.
    """
    dimension = pairs.shape[1]
    bases = np.empty((len(draws), dimension, k))
    full = np.empty(len(draws), bool)
    # The components that a draw must span for the chosen ones to be determined.
    needed = k
    if which == "smallest":
        needed = dimension - k
    for chunk in chunks(len(draws), draws.shape[1] * dimension):
        points = pairs[draws[chunk]]
        points -= points.mean(axis=1, keepdims=True)
        complete = which == "smallest"
        _, singular, right = np.linalg.svd(points, full_matrices=complete)
        rank = np.sum(singular > RANK_TOLERANCE * singular[:, :1], axis=1)
        for number, components in enumerate(right):
            rows = COMPONENTS[which](dimension, int(rank[number]), k)
            bases[chunk.start + number] = components[rows].T
        full[chunk] = rank >= needed
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
    """Return the standard error of a mean over pairs of draws; NaN for one pair.

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
    # The square of a draw's sum has the products of all pairs with this draw. Over all
    # draws, each pair is multiplied with itself twice: once for each of its two draws.
    sum_of_draw = np.bincount(np.r_[first, second], np.r_[deviations, deviations])
    shared = float(sum_of_draw @ sum_of_draw) - independent
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
    "kind",
    "n",
    "mean_distance",
    "mean_se",
    "sd",
    "q05",
    "q25",
    "median_distance",
    "q75",
    "q95",
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


@dataclass(frozen=True)
class _Distances:
    """Distances of one kind between draws of one or two schedules, or of a baseline.

    `first` and `second` are the numbers of the two draws of each distance, counted over
    all schedules; a baseline has none.
    """

    kind: str
    schedule_a: str
    schedule_b: str
    lengths: FloatArray
    first: IntArray = field(default_factory=lambda: np.zeros(0, int))
    second: IntArray = field(default_factory=lambda: np.zeros(0, int))

    def table(self) -> pd.DataFrame:
        columns = {
            "kind": self.kind,
            "schedule_a": self.schedule_a,
            "schedule_b": self.schedule_b,
            "distance_rad": self.lengths,
        }
        return pd.DataFrame(columns)


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
    notes = []
    if not bases:
        notes.append(_note("in-class distances", "no schedule has subspaces"))
    if len(bases) < 2:
        reason = f"{len(bases)} of the 2 schedules needed have subspaces"
        notes.append(_note("cross-class distances", reason))

    stream_of = streams or {name: name for name in bases}
    noise_generator = named_generator(seed, "noised_identity")
    random_generator = named_generator(seed, "random")
    noised = noised_identity(noise_generator, shape, pairs, noise_sd)
    unrelated = random(random_generator, shape, pairs)
    measured = [
        *_between_draws(bases, stream_of, seed, pairs),
        _Distances("noised_identity", "", "", noised),
        _Distances("random", "", "", unrelated),
    ]

    lengths = {}
    errors = {}
    for kind in KINDS:
        of_kind = [one for one in measured if one.kind == kind]
        if not of_kind:
            continue
        lengths[kind] = np.concatenate([one.lengths for one in of_kind])
        if kind in ("in_class", "cross_class"):
            first = np.concatenate([one.first for one in of_kind])
            second = np.concatenate([one.second for one in of_kind])
            errors[kind] = pair_mean_error(lengths[kind], first, second)
    table = pd.concat([one.table() for one in measured], ignore_index=True)
    return DistanceStudy(table, summarise_distances(lengths, errors), notes)


def _between_draws(
    bases: Mapping[str, FloatArray], stream_of: Mapping[str, str], seed: int, pairs: int
) -> Iterator[_Distances]:
    """Yield the distances within each schedule, then those between two schedules."""
    first_number = {}
    n_draws = 0
    for name, drawn in bases.items():
        first_number[name] = n_draws
        n_draws += len(drawn)

    for name, drawn in bases.items():
        generator = named_generator(seed, "in_class", stream_of[name])
        i, j = in_class_pairs(generator, len(drawn), pairs)
        lengths = arc_length(drawn[i], drawn[j])
        start = first_number[name]
        yield _Distances("in_class", name, name, lengths, i + start, j + start)

    for a, b in combinations(bases, 2):
        # The draws do not depend on which of two schedules is named first.
        in_order = sorted((a, b), key=stream_of.__getitem__)
        one, other = in_order
        generator = named_generator(
            seed, "cross_class", stream_of[one], stream_of[other]
        )
        i, j = cross_class_pairs(generator, len(bases[one]), len(bases[other]), pairs)
        if in_order != [a, b]:
            i, j = j, i
        lengths = arc_length(bases[a][i], bases[b][j])
        first = i + first_number[a]
        second = j + first_number[b]
        yield _Distances("cross_class", a, b, lengths, first, second)


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
        ``kind, n, mean_distance, mean_se, sd, q05, q25, median_distance, q75, q95``
        in rad and
        ``auc_against_in_class``: the probability that a distance of this kind exceeds
        an in-class one (NaN if there are no in-class distances).
    """
    in_class = np.sort(lengths.get("in_class", np.zeros(0)))
    rows = []
    for kind in KINDS:
        values = np.sort(lengths.get(kind, np.zeros(0)))
        if not len(values):
            continue
        sd = np.nan
        if len(values) > 1:
            sd = values.std(ddof=1)
        independent = sd / np.sqrt(len(values))
        error = standard_errors.get(kind, independent)
        quantiles = np.quantile(values, [0.05, 0.25, 0.5, 0.75, 0.95])
        exceeds = auc(values, in_class)
        rows.append((kind, len(values), values.mean(), error, sd, *quantiles, exceeds))
    return pd.DataFrame(rows, columns=list(_SUMMARY_COLUMNS))


def auc(values: FloatArray, reference: FloatArray) -> float:
    """Return the probability that a value exceeds a reference; ties count half."""
    if not len(values) or not len(reference):
        return float("nan")
    # It is the area under the curve of scikit-learn's `roc_auc_score`, which takes
    # longer to load than the distances take to compute.
    ordered = np.sort(reference)
    below = np.searchsorted(ordered, values, side="left").sum()
    up_to = np.searchsorted(ordered, values, side="right").sum()
    return float((below + up_to) / (2 * len(values) * len(ordered)))


def _note(what: str, reason: str) -> dict[str, str]:
    return {"what": what, "reason": reason}
