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
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.jobs import whole_file
from hopdata.maps.draws import distinct_draws, named_generator
from hopdata.maps.rare_schedules import Notes, rare_notes
from hopdata.maps.subspaces.grassmann import principal_angles

#: Principal components taken for the two Poincaré sections.
SECTION_COMPONENTS = 2
#: Singular values below this share of the largest leave a draw without that component.
_RANK_TOLERANCE = 1e-10
_CHUNK_BYTES = 2 * 2**20

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PooledFrame:
    """Principal frame of all pairs of a study.

    Attributes
    ----------
    kept, dropped
        (12B, 12B - 2) and (12B, 2) orthonormal components; the dropped vary least.
    standard_deviations
        (12B,) of the pairs along the components, decreasing, normalised units.
    section_angles_rad
        (2,) principal angles between the dropped components and the section normals: zero if
        the dropped components are the section conditions, as the method supposes.
    """

    kept: Floats
    dropped: Floats
    standard_deviations: Floats
    section_angles_rad: Floats


@dataclass(frozen=True)
class SubspaceStudy:
    """Bootstrapped subspaces of a study.

    Attributes
    ----------
    bases
        Schedule -> (bootstraps, D, k) orthonormal bases of the leading components.
    frame
        The pooled frame in which they stand.
    shape
        (D, k) of the bases, known even where no class has any.
    samples
        Distinct landings per draw.
    notes
        What was left out, each ``{"what": ..., "reason": ...}``.
    """

    bases: dict[str, Floats]
    frame: PooledFrame
    shape: tuple[int, int]
    samples: int
    notes: list[dict[str, str]]


def section_normals(n_markers: int) -> Floats:
    """Return the (12B, 2) unit normals of the two sections in pair coordinates.

    A section fixes the mean height of the B body markers: the normal has equal parts in their
    z coordinates, those of the pre state in the first column, of the post state in the second.
    """
    normals = np.zeros((12 * n_markers, 2))
    for column in (0, 1):
        start = 6 * n_markers * column
        normals[start + 2 : start + 3 * n_markers : 3, column] = n_markers**-0.5
    return normals


def pooled_frame(x: Floats, y: Floats) -> PooledFrame:
    """Split the space of pairs into its two least varying components and the others.

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
    _, values, right = np.linalg.svd(np.linalg.qr(centred, mode="r"), full_matrices=True)
    deviations = np.zeros(pairs.shape[1])
    deviations[: len(values)] = values / np.sqrt(len(pairs))
    kept, dropped = right[:-SECTION_COMPONENTS].T, right[-SECTION_COMPONENTS:].T
    angles = principal_angles(dropped, section_normals(pairs.shape[1] // 12))
    return PooledFrame(kept, dropped, deviations, angles)


@one_blas_thread()
def bootstrap_subspaces(
    x: Floats,
    y: Floats,
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
    pairs = np.hstack([x, y]) @ frame.kept
    bases: dict[str, Floats] = {}
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
    pairs: Floats, draws: NDArray[np.integer], k: int
) -> tuple[Floats, NDArray[np.bool_]]:
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


def write_subspaces(path: str | Path, study: SubspaceStudy) -> None:
    """Write a study to HDF5, one dataset (bootstraps, D, k) per schedule; whole or not at all."""
    import h5py

    with whole_file(path) as temporary, h5py.File(temporary, "w") as file:
        group = file.create_group("bases")
        for name, bases in study.bases.items():
            group.create_dataset(name, data=bases)
        for field in ("kept", "dropped", "standard_deviations", "section_angles_rad"):
            file.create_dataset(f"frame/{field}", data=getattr(study.frame, field))
        file.attrs["shape"] = study.shape
        file.attrs["samples"] = study.samples


def read_bases(path: str | Path) -> tuple[dict[str, Floats], tuple[int, int]]:
    """Read schedule -> (bootstraps, D, k) bases and their shape (D, k)."""
    import h5py

    with h5py.File(path) as file:
        dimension, k = (int(size) for size in file.attrs["shape"])
        return {name: np.asarray(data) for name, data in file["bases"].items()}, (dimension, k)


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
