"""Gaps of the body markers: fill them where it is safe, and mark what was filled."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, one_blas_thread, pd
from hopdata.landings import exclusion
from hopdata.landings.states.fits import WINDOWS_S
from hopdata.messages import Message
from hopdata.recording import Recording
from hopdata.recordings.quality.stretches import runs, seen
from hopdata.rigid import rigid_fit

FILLED_COLUMNS = (
    "recording",
    "marker",
    "role",
    "frames",
    "gaps",
    "longest_s",
    "missing",
    "filled",
    "left",
)

#: Fewest other markers from which a marker is placed.
#: Unit: markers. Origin: derived: three points determine a rigid body.
LEAST_SEEN = 3

#: Fewest frames with the whole body from which its shape is learned.
#: Unit: frames. Origin: chosen.
LEAST_FRAMES = 20

#: Most frames from which the shape is learned.
#: Unit: frames. Origin: chosen.
SAMPLE_FRAMES = 4000

#: Largest noise of a placed marker, relative to that of the seen ones.
#: Unit: 1. Origin: chosen.
LARGEST_GAIN = 4.0

#: Largest misfit of seen markers, relative to the rms of the whole body.
#: Unit: 1. Origin: chosen.
LARGEST_MISFIT = 4.0

#: Rounds in which frames are aligned with the mean shape.
#: Unit: 1. Origin: chosen.
ALIGNMENTS = 5

#: Relative singular value below which markers are too close to a line.
#: Unit: 1. Origin: chosen.
COLLINEAR = 1e-6

#: Longest gap that is filled, for an animal of 1 m.
#: Unit: s. Origin: chosen.
LONGEST_S = 0.1

#: Time about the sections in which frames may be used for states.
#: Unit: s. Origin: derived: the widest window of a fit.
REACH_S = max(WINDOWS_S)

TOO_MUCH_FILLED = Message(exclusion.TOO_MUCH_FILLED).text()


def filled_table(recordings: Iterable[Recording]) -> pd.DataFrame:
    """Count the gaps of every marker, and how much of them was filled.

    Parameters
    ----------
    recordings : iterable of Recording
        With gaps filled or not.

    Returns
    -------
    pandas.DataFrame
        One row for each marker of each recording: recording, marker, role, frames,
        gaps, longest_s, missing, filled, left. Gaps are those of the cameras, filled or
        not. The last three count frames, with missing = filled + left.
    """
    rows = []
    for recording in recordings:
        unseen = ~seen(recording.positions)
        filled = recording.filled
        if filled is None:
            filled = np.zeros_like(unseen)
        markers = zip(recording.markers, recording.roles, strict=True)
        for m, (marker, role) in enumerate(markers):
            lengths = np.diff(runs(unseen[:, m] | filled[:, m]), axis=1)
            row = (
                recording.name,
                marker,
                role,
                len(unseen),
                len(lengths),
                float(lengths.max(initial=0)) / recording.rate_hz,
                int(lengths.sum()),
                int(filled[:, m].sum()),
                int(unseen[:, m].sum()),
            )
            rows.append(row)
    return pd.DataFrame(rows, columns=list(FILLED_COLUMNS))


# Where an unseen body marker must be, from the other markers on the same rigid body.


@dataclass(frozen=True)
class BodyShape:
    """Shape of a rigid body, as its markers show it.

    Parameters
    ----------
    points : (B, 3) array
        Mean places of the markers in the body, centred, m.
    misfit_m : float
        Rms distance of markers from the shape per degree of freedom, from their noise
        and from bending of the body, m.
    """

    points: FloatArray
    misfit_m: float


def learn_shape(body: FloatArray) -> BodyShape | None:
    """Learn the shape of a body from the frames that show all of it.

    The method is generalised Procrustes alignment without scaling (Gower 1975), over at
    most `SAMPLE_FRAMES` frames.

    Parameters
    ----------
    body : (N, B, 3) array
        Body markers, m; NaN where unseen.

    Returns
    -------
    BodyShape or None
        None with fewer than four markers, or fewer than `LEAST_FRAMES` frames of the
        whole body.
    """
    whole = np.flatnonzero(seen(body).all(axis=1))
    if body.shape[1] <= LEAST_SEEN or len(whole) < LEAST_FRAMES:
        return None
    frames = body[whole[:: -(-len(whole) // SAMPLE_FRAMES)]]
    points = frames[0] - frames[0].mean(axis=0)
    for _ in range(ALIGNMENTS):
        fit = rigid_fit(frames, points)
        inside = np.einsum("nji,nbj->nbi", fit.rotation, frames - fit.centre[:, None])
        points = np.nanmedian(inside, axis=0)
        points -= points.mean(axis=0)
    misfit_m = float(np.nanmedian(rigid_fit(frames, points).residual_m))
    return BodyShape(points, misfit_m)


def rigid_places(body: FloatArray, wanted: BoolArray, shape: BodyShape) -> FloatArray:
    """Place the wanted markers from those seen in the same frame.

    Parameters
    ----------
    body : (N, B, 3) array
        Body markers, m; NaN where unseen.
    wanted : (N, B) bool array
        Which markers to place; none of them is seen.
    shape : BodyShape
        Shape of the same markers.

    Returns
    -------
    (N, B, 3) array
        Places, m. NaN where not wanted, where fewer than three others are seen, where
        these are too close to collinear, and where they do not fit the shape.
    """
    fit = rigid_fit(body, shape.points)
    patterns, which = np.unique(seen(body), axis=0, return_inverse=True)
    is_placeable = np.empty(patterns.shape, dtype=bool)
    for row, pattern in enumerate(patterns):
        for marker, target in enumerate(shape.points):
            gain = noise_gain(shape.points[pattern], target)
            is_placeable[row, marker] = gain <= LARGEST_GAIN
    fits_shape = fit.residual_m <= LARGEST_MISFIT * shape.misfit_m
    use = wanted & is_placeable[which.reshape(-1)] & fits_shape[:, None]
    there = np.einsum("nij,bj->nbi", fit.rotation, shape.points) + fit.centre[:, None]
    return np.where(use[..., None], there, np.nan)


def noise_gain(points: FloatArray, target: FloatArray) -> float:
    """Return the worst noise of a placed marker, per unit of the others' noise.

    The `points` (m, 3) determine six small motions of the body, which are propagated to
    `target` (3,). The result is infinite if the points are collinear or fewer than
    three.
    """
    if len(points) < LEAST_SEEN:
        return float("inf")
    design = np.concatenate([_motions(point) for point in points])
    scale = np.repeat([1.0, max(float(np.abs(points).max()), 1e-9)], 3)
    _, values, right = np.linalg.svd(design / scale, full_matrices=False)
    if values[-1] < COLLINEAR * values[0]:
        return float("inf")
    return float(np.linalg.norm(_motions(target) / scale @ (right.T / values), 2))


def _motions(point: FloatArray) -> FloatArray:
    """Return displacements of a point by small shifts and turns of the body, (3, 6)."""
    x, y, z = point
    turns = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return np.hstack([np.eye(3), turns])


@one_blas_thread()
def fill_gaps(
    recording: Recording, *, longest_s: float | None = None, overwrite: bool = False
) -> Recording:
    """Fill short gaps of the body markers.

    A marker is placed from three or more others of the body in the same frame. Feet are
    never filled: a contact must be seen, not made up.

    Parameters
    ----------
    recording : Recording
        Levelled: feet rest at height 0.
    longest_s : float, optional
        Longest gap that is filled, s; by default 0.1 s for an animal of 1 m.
    overwrite : bool
        Write the places into the positions of the recording itself.

    Returns
    -------
    Recording
        The same recording with the places filled in and marked in `filled`. Seen places
        stay as they are.
    """
    positions = recording.positions
    if not overwrite:
        positions = positions.copy()
    if longest_s is None:
        longest_s = LONGEST_S * recording.time_scale
    filled = np.zeros(positions.shape[:2], bool)
    longest_frames = int(longest_s * recording.rate_hz + 1e-6)
    wanted = _short_gaps(~seen(recording.body), longest_frames)
    frames = np.flatnonzero(wanted.any(axis=1))
    shape = None
    if len(frames):
        shape = learn_shape(recording.body)
    if shape is not None:
        places = rigid_places(recording.body[frames], wanted[frames], shape)
        at, marker = np.nonzero(seen(places))
        bodies = np.array(recording.indices("body"))[marker]
        positions[frames[at], bodies] = places[at, marker]
        filled[frames[at], bodies] = True
    return replace(recording, positions=positions, filled=filled)


def mark_filled(
    recording: Recording, table: pd.DataFrame, *, largest_share: float = 1.0
) -> pd.DataFrame:
    """Add the filled share of each touchdown, and exclude those with too much.

    Parameters
    ----------
    recording : Recording
        Recording with filled gaps; if `filled` is None, the table is returned
        unchanged.
    table : pandas.DataFrame
        Its touchdowns.
    largest_share : float
        Filled share above which a touchdown is excluded, 0 to 1.

    Returns
    -------
    pandas.DataFrame
        The table with a column filled_share: the share of filled places among all
        places of the body markers, from 0.22 s before the pre section to 0.22 s after
        the post section (or after the pre section if the post section was not reached).
    """
    if recording.filled is None:
        return table
    t_pre = table["t_pre_s"].to_numpy(float)
    reach_s = REACH_S * recording.time_scale
    t_end = np.fmax(table["t_post_s"].to_numpy(float), t_pre) + reach_s
    body = recording.filled[:, recording.indices("body")]
    total = np.append(0, body.sum(axis=1).cumsum())
    start = np.searchsorted(recording.time, t_pre - reach_s)
    stop = np.searchsorted(recording.time, t_end)
    places = (stop - start) * body.shape[1]
    share = (total[stop] - total[start]) / np.maximum(places, 1)
    table = table.assign(filled_share=share)
    too_much = (share > largest_share) & ~table["excluded"].to_numpy(bool)
    table.loc[too_much, ["reason", "excluded"]] = TOO_MUCH_FILLED, True
    return table


def _short_gaps(unseen: BoolArray, longest: int) -> BoolArray:
    """Mark the gaps of markers (N, B) that last at most `longest` frames."""
    short = np.zeros_like(unseen)
    for marker in range(unseen.shape[1]):
        for start, stop in runs(unseen[:, marker]):
            short[start:stop, marker] = stop - start <= longest
    return short
