"""Constraint subspaces of the landing map: bootstrapped principal components of pairs.

A pair (pre state, post state) has 12B coordinates; the two section conditions make two of its
principal components nearly constant, and a map from 6B - 1 to 6B - 1 dimensions then shows as
6B - 1 large and 6B - 1 small components in the 12B - 2 that remain (Sec. 2.2.4 of the
dissertation). The printed text compares the small ones; 30 landings have rank 29 at most, which
leaves several of those arbitrary, so the *leading* ones are kept here. The arc length between
two subspaces is that between their complements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.arrays import FloatArray
from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.maps.draws import Notes, distinct_draws, named_generator, rare_notes

#: Principal components taken for the two Poincaré sections.
SECTION_COMPONENTS = 2
#: Singular values below this share of the largest leave a draw without that component.
_RANK_TOLERANCE = 1e-10
_CHUNK_BYTES = 2 * 2**20


@dataclass(frozen=True)
class SubspaceStudy:
    """Bootstrapped subspaces of a study.

    Attributes
    ----------
    bases
        Schedule -> (bootstraps, D, k) orthonormal bases of the leading components.
    frame
        (12B, D) orthonormal components of the pooled pairs, in which they stand.
    shape
        (D, k) of the bases, known even where no class has any.
    samples
        Distinct landings per draw.
    notes
        What was left out, each ``{"what": ..., "reason": ...}``.
    """

    bases: dict[str, FloatArray]
    frame: FloatArray
    shape: tuple[int, int]
    samples: int
    notes: list[dict[str, str]]


def pooled_frame(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the principal components of pairs but for the two that vary least, (12B, 12B - 2).

    These two are the section conditions.

    Parameters
    ----------
    x, y
        (n, 6B) normalised pairs of all usable landings.

    Raises
    ------
    AnalysisError
        If there are fewer than two landings, or if one has a value that is not finite.
    """
    if len(x) < 2:
        raise AnalysisError(f"subspaces: at least 2 usable landings are needed, found {len(x)}")
    pairs = np.hstack([x, y])
    unknown = np.flatnonzero(~np.isfinite(pairs).all(axis=1))
    if unknown.size:
        raise AnalysisError(
            f"subspaces: expected finite pairs, found others in {unknown.size} landings, the first "
            f"in row {unknown[0]}"
        )
    centred = pairs - pairs.mean(0)
    right = np.linalg.svd(np.linalg.qr(centred, mode="r"), full_matrices=True)[2]
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
        If there are fewer than two landings.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    names = np.asarray(schedule, str)
    frame = pooled_frame(x, y)
    k = components or min(x.shape[1] - 1, samples - 1)
    pairs = np.hstack([x, y]) @ frame
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
    return SubspaceStudy(bases, frame, (pairs.shape[1], k), samples, notes)


def leading_subspaces(
    pairs: FloatArray, draws: NDArray[np.integer], k: int
) -> tuple[FloatArray, NDArray[np.bool_]]:
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
    step = max(1, _CHUNK_BYTES // (8 * draws.shape[1] * pairs.shape[1]))
    for start in range(0, len(draws), step):
        points = pairs[draws[start : start + step]]
        points -= points.mean(axis=1, keepdims=True)
        _, values, right = np.linalg.svd(points, full_matrices=False)
        bases[start : start + step] = right[:, :k].swapaxes(1, 2)
        full[start : start + step] = values[:, k - 1] > _RANK_TOLERANCE * values[:, 0]
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
