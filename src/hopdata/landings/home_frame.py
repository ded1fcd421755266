"""The home frame: it moves the plane so that where and which way a landing was does not matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError

FloatArray = NDArray[np.float64]

LEAST_RADIUS_M = 1e-6
LONGEST_GAP_S = 0.04  # a body on a curved path leaves the straight line by a tenth of a millimetre
LONGEST_GAP_FRAMES = 2.5  # one missing frame may be bridged at any rate


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
        """Bring positions (L, B, 3) in the world to the home frame; heights are kept."""
        moved = positions.copy()
        moved[:, :, :2] -= self.origin[:, None, :]
        return self.vectors(moved)

    def vectors(self, vectors: FloatArray) -> FloatArray:
        """Turn free vectors (L, B, 3), such as velocities, into the home frame."""
        c, s = self.direction[:, :1], self.direction[:, 1:]
        x, y = vectors[:, :, 0], vectors[:, :, 1]
        return np.stack([c * x + s * y, c * y - s * x, vectors[:, :, 2]], axis=2)

    def standard_errors(self, covariance: FloatArray) -> FloatArray:
        """Return standard errors (L, B, 3) along the axes; covariances are (L, B, 3, 3)."""
        c, s = self.direction[:, :1], self.direction[:, 1:]
        xx, yy, zz = (covariance[:, :, k, k] for k in range(3))
        xy = 2 * c * s * covariance[:, :, 0, 1]
        along, across = c**2 * xx + xy + s**2 * yy, s**2 * xx - xy + c**2 * yy
        return np.sqrt(np.stack([along, across, zz], axis=2))


def home_frames(
    time: FloatArray,
    body: FloatArray,
    t_pre: FloatArray,
    t_post: FloatArray,
    *,
    marker: int,
) -> HomeFrames:
    """Find the home frame of each touchdown (Sec. 2.2.4 of the dissertation).

    The origin is the mean body position during the touchdown, the x axis runs from it through the
    mean position of one marker. Means are time averages of the markers' tracks between the two
    instants, linear between frames, so that they do not depend on how the frames fall. Short
    gaps are bridged by the straight line; a touchdown with a longer one has no frame (NaN).

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    body : (N, B, 3) array
        Body markers in the world, m; NaN where unseen.
    t_pre, t_post : (L,) array
        Beginning and end of each touchdown, s.
    marker : int
        Number of the body marker on the x axis.

    Returns
    -------
    HomeFrames

    Raises
    ------
    AnalysisError
        If the marker lies at the origin in some touchdown.
    """
    means = track_means(time, body[:, :, :2], t_pre, t_post)
    origin = means.mean(axis=1)
    ray = means[:, marker] - origin
    length = np.hypot(ray[:, 0], ray[:, 1])
    if (length < LEAST_RADIUS_M).any():
        when = float(t_pre[np.argmin(np.where(np.isnan(length), np.inf, length))])
        raise AnalysisError(
            f"home.marker: expected a body marker away from the mean body position, found it there "
            f"in the touchdown at {when:.3f} s"
        )
    return HomeFrames(origin, ray / length[:, None])


def track_means(
    time: FloatArray, tracks: FloatArray, t_pre: FloatArray, t_post: FloatArray
) -> FloatArray:
    """Time averages of tracks (N, B, k) between instants (L,), (L, B, k).

    Short gaps are bridged by a straight line; NaN where a gap is longer than `LONGEST_GAP_S` and
    `LONGEST_GAP_FRAMES`.
    """
    seen = np.asarray(np.isfinite(tracks).all(axis=2))
    means = np.full((len(t_pre), *tracks.shape[1:]), np.nan)
    longest_gap = max(LONGEST_GAP_S, LONGEST_GAP_FRAMES * float(np.median(np.diff(time))))
    for b in range(tracks.shape[1]):
        t, values = time[seen[:, b]], tracks[seen[:, b], b]
        if len(t) < 2:
            continue
        before = np.searchsorted(t, t_pre, side="right")
        after = np.searchsorted(t, t_post)
        for row, (i, j) in enumerate(zip(before, after, strict=True)):
            piece = slice(max(i - 1, 0), j + 1)
            if np.diff(t[piece]).max(initial=0.0) > longest_gap * (1 + 1e-9):
                continue
            means[row, b] = _mean_of_chords(t[piece], values[piece], t_pre[row], t_post[row])
    return means


def _mean_of_chords(t: FloatArray, values: FloatArray, begin: float, end: float) -> FloatArray:
    """Average of the polygon through `values` (n, k) at `t` (n,) over [begin, end]."""
    nodes = np.concatenate([[begin], t[(t > begin) & (t < end)], [end]])
    middle = np.column_stack([np.interp(nodes, t, column) for column in values.T])
    chords = 0.5 * (middle[1:] + middle[:-1]) * np.diff(nodes)[:, None]
    return chords.sum(axis=0) / (end - begin)
