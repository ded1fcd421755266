"""The home frame: it moves the plane so that place and heading do not matter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.landings.contacts.descents import longest_gap_s, longest_gaps
from hopdata.landings.states.tracks import turned

#: Smallest distance of the home marker from the origin; nearer, it has no direction.
#: Unit: m. Origin: chosen.
LEAST_RADIUS_M = 1e-6


@dataclass(frozen=True)
class HomeFrames:
    """Planar frames of L touchdowns.

    Parameters
    ----------
    origin : (L, 2) array
        Origins in the world, m.
    direction : (L, 2) array
        Unit vectors along the x axes.
    """

    origin: FloatArray
    direction: FloatArray

    def points(self, positions: FloatArray) -> FloatArray:
        """Bring positions (L, B, 3) from the world to the home frame; heights stay."""
        moved = positions.copy()
        moved[:, :, :2] -= self.origin[:, None, :]
        return self.vectors(moved)

    def vectors(self, vectors: FloatArray) -> FloatArray:
        """Turn free vectors (L, B, 3), such as velocities, into the home frame."""
        return turned(vectors, self.direction)

    def standard_errors(self, covariance: FloatArray) -> FloatArray:
        """Return standard errors (L, B, 3) along the axes, from (L, B, 3, 3)."""
        cos = self.direction[:, :1]
        sin = self.direction[:, 1:]
        xx, yy, zz = (covariance[:, :, k, k] for k in range(3))
        xy = 2 * cos * sin * covariance[:, :, 0, 1]
        along = cos**2 * xx + xy + sin**2 * yy
        across = sin**2 * xx - xy + cos**2 * yy
        return np.sqrt(np.stack([along, across, zz], axis=2))


def home_frames(
    time: FloatArray,
    body: FloatArray,
    t_pre: FloatArray,
    t_post: FloatArray,
    *,
    marker: int | Sequence[int],
    time_scale: float = 1.0,
) -> HomeFrames:
    """Find the home frame of each touchdown (Sec. 2.2.4 of the dissertation).

    The origin is the mean body position during the touchdown, and the x axis runs from
    it through the mean position of one marker, or of several. Means are time averages
    of the markers' tracks between the two instants. Tracks are linear between frames,
    so the means do not depend on where the frames fall. Short gaps are bridged by a
    straight line; a touchdown with a longer gap has no home frame (NaN).

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    body : (N, B, 3) array
        Body markers in the world, m; NaN where unseen.
    t_pre, t_post : (L,) array
        Beginning and end of each touchdown, s.
    marker : int or sequence of int
        Number of the body marker on the x axis, or of those whose middle is on it.
    time_scale : float
        Time scale of the recording.

    Returns
    -------
    HomeFrames

    Raises
    ------
    AnalysisError
        If the marker, or the middle, lies at the origin in some touchdown.
    """
    means = track_means(time, body[:, :, :2], t_pre, t_post, time_scale)
    origin = means.mean(axis=1)
    ray = means[:, np.atleast_1d(marker)].mean(axis=1) - origin
    length = np.hypot(ray[:, 0], ray[:, 1])
    if (length < LEAST_RADIUS_M).any():
        worst = np.argmin(np.where(np.isnan(length), np.inf, length))
        raise AnalysisError.at(
            "home.marker",
            "body markers whose middle is away from the mean body position",
            f"it there in the touchdown at {float(t_pre[worst]):.3f} s",
        )
    return HomeFrames(origin, ray / length[:, None])


def track_means(
    time: FloatArray,
    tracks: FloatArray,
    t_pre: FloatArray,
    t_post: FloatArray,
    time_scale: float = 1.0,
) -> FloatArray:
    """Average tracks (N, B, k) over time between instants (L,), (L, B, k).

    Short gaps are bridged by a straight line; NaN where a gap is longer than
    `longest_gap_s`.
    """
    means = np.full((len(t_pre), *tracks.shape[1:]), np.nan)
    longest_gap = longest_gap_s(time, time_scale) * (1 + 1e-9)
    spans = np.column_stack([t_pre, t_post])
    seen = np.asarray(np.isfinite(tracks).all(axis=2))
    for b in range(tracks.shape[1]):
        t = time[seen[:, b]]
        if len(t) < 2:
            continue
        is_seen = longest_gaps(t, spans) <= longest_gap
        for c in range(tracks.shape[2]):
            track = tracks[seen[:, b], b, c]
            # Integrals of places far from the origin would lose digits.
            middle = track.mean()
            before, after = _integral(t, track - middle, np.stack([t_pre, t_post]))
            mean = middle + (after - before) / (t_post - t_pre)
            means[:, b, c] = np.where(is_seen, mean, np.nan)
    return means


def _integral(t: FloatArray, track: FloatArray, at: FloatArray) -> FloatArray:
    """Integrate a track that is linear between frames, from the first frame to `at`."""
    of_steps = 0.5 * np.diff(t) * (track[1:] + track[:-1])
    until_frame = np.append(0.0, np.cumsum(of_steps))
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    step = t[k + 1] - t[k]
    u = (at - t[k]) / step
    mean_in_step = track[k] + 0.5 * u * (track[k + 1] - track[k])
    return np.asarray(until_frame[k] + step * u * mean_in_step)
