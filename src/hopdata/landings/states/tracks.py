"""Frames of the markers about given instants, summed up for fits of polynomials in time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import Legendre, Polynomial

from hopdata.arrays import BoolArray, FloatArray, IntArray

#: Entries of the largest array that is made at once.
LARGEST = 4_000_000


@dataclass(frozen=True)
class Windows:
    """Frames start:stop about each of L instants.

    Parameters
    ----------
    near : (L,) array
        Instants, s, at which the scaled time u is zero.
    start, stop : (L,) array of int
        First and last-plus-one frame.
    scale : float
        Unit of u, s.
    """

    near: FloatArray
    start: IntArray
    stop: IntArray
    scale: float

    def some(self, rows: IntArray | slice) -> Windows:
        """Return the windows of some of the instants."""
        return Windows(self.near[rows], self.start[rows], self.stop[rows], self.scale)


@dataclass(frozen=True)
class Moments:
    """Sums over the frames of each window: all that a fit by least squares needs.

    They are over 1, u, and u^2 times orthogonal polynomials: as good as powers of u, but not close
    to linearly dependent.

    Coordinates are those of the landing's own frame, turned about the vertical, relative to the
    mean of the marker's track; with the fall under gravity taken off where it was asked for.

    Parameters
    ----------
    gram : (L, B, K, K) array
        Products of these polynomials.
    product : (L, B, 3, K) array
        Products of polynomials and coordinates, m.
    square : (L, B, 3) array
        Squared coordinates, m^2.
    frames : (L, B) array
        Number of usable frames.
    centre : (L, B, 3) array
        Mean of each marker's track, m, in the landing's frame.
    direction : (L, 2) array
        x axis of the landing's frame in the world.
    fall : float
        Coefficient of u^2 in the vertical that was taken off, m.
    scale : float
        Unit of u, s.
    powers : (K, K) array
        Coefficients of the powers of u in each polynomial; a column each.
    """

    gram: FloatArray
    product: FloatArray
    square: FloatArray
    frames: FloatArray
    centre: FloatArray
    direction: FloatArray
    fall: float
    scale: float
    powers: FloatArray

    @property
    def terms(self) -> int:
        """Number of polynomials, K."""
        return self.gram.shape[-1]

    def lower(self, degree: int) -> Moments:
        """Return the moments of the polynomials up to a degree."""
        kept = slice(0, degree + 1)
        gram, product = self.gram[..., kept, kept], self.product[..., kept]
        return replace(self, gram=gram, product=product, powers=self.powers[kept, kept])

    def some(self, rows: IntArray) -> Moments:
        """Return the moments of some of the windows."""
        return replace(self, **{name: getattr(self, name)[rows] for name in _ARRAYS})


_ARRAYS = ("gram", "product", "square", "frames", "centre", "direction")


def moments(
    time: FloatArray, body: FloatArray, windows: Windows, *, degree: int, gravity_m_s2: float = 0.0
) -> Moments:
    """Sum up the frames of the windows.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    body : (N, B, 3) array
        Markers in the world, z up, m; NaN where unseen.
    windows : Windows
        Of L instants.
    degree : int
        Highest power of time.
    gravity_m_s2 : float
        The fall under it is taken off.

    Returns
    -------
    Moments
    """
    width = int(np.max(windows.stop - windows.start, initial=1))
    powers = _polynomials(degree, *_span(time, windows))
    rows = max(1, LARGEST // (width * body[0].size * (degree + 1)))
    parts = [
        _moments(time, body, windows.some(slice(at, at + rows)), powers, gravity_m_s2)
        for at in range(0, max(len(windows.near), 1), rows)
    ]
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS
    }
    return replace(parts[0], **arrays)


def _moments(
    time: FloatArray, body: FloatArray, windows: Windows, powers: FloatArray, gravity_m_s2: float
) -> Moments:
    frames, inside = _frames(windows, len(time))
    u = (time[frames] - windows.near[:, None]) / windows.scale
    points = np.moveaxis(body[frames], 2, 1)  # (L, B, W, 3)
    usable = inside[:, None] & ~np.isnan(points).any(axis=3)
    count = usable.sum(axis=2).astype(float)
    points = np.where(usable[..., None], points, 0.0)
    centre = points.sum(axis=2) / np.maximum(count, 1.0)[..., None]
    direction = _directions(centre)
    values = turned(points - centre[:, :, None], direction)
    values[..., 2] += 0.5 * gravity_m_s2 * windows.scale**2 * u[:, None] ** 2
    values *= usable[..., None]
    terms = (u[..., None] ** np.arange(len(powers)) @ powers)[:, None]
    gram = np.swapaxes(usable[..., None] * terms, 2, 3) @ terms
    product = np.swapaxes(values, 2, 3) @ terms
    return Moments(
        gram=gram,
        product=product,
        square=(values**2).sum(axis=2),
        frames=count,
        centre=turned(centre, direction),
        direction=direction,
        fall=-0.5 * gravity_m_s2 * windows.scale**2,
        scale=windows.scale,
        powers=powers,
    )


def _span(time: FloatArray, windows: Windows) -> tuple[float, float]:
    """First and last scaled time of all windows."""
    first, last = (np.clip(f, 0, len(time) - 1) for f in (windows.start, windows.stop - 1))
    early, late = ((time[frame] - windows.near) / windows.scale for frame in (first, last))
    return float(np.min(early, initial=0.0)), float(np.max(late, initial=0.0))


def _polynomials(degree: int, first: float, last: float) -> FloatArray:
    """Powers in 1, u, and u^2 times Legendre's polynomials on [first, last], (K, K)."""
    powers = np.eye(degree + 1)
    domain = [first, last if last > first else first + 1]
    for k in range(2, degree + 1):
        found = Legendre.basis(k - 2, domain=domain).convert(kind=Polynomial).coef
        powers[2:, k] = np.pad(found, (0, degree - 1 - len(found)))
    return powers


def _frames(windows: Windows, n_frames: int) -> tuple[IntArray, BoolArray]:
    """Frame numbers of all windows, padded to one length, and which of them count, (L, W)."""
    width = int(np.max(windows.stop - windows.start, initial=1))
    frames = windows.start[:, None] + np.arange(width)
    inside = (frames < windows.stop[:, None]) & (frames >= 0) & (frames < n_frames)
    return np.clip(frames, 0, n_frames - 1), inside


def _directions(centre: FloatArray) -> FloatArray:
    """Return unit vectors (L, 2) to the marker that is farthest from the middle of the body."""
    arms = (centre - centre.mean(axis=1, keepdims=True))[..., :2]
    lengths = np.hypot(arms[..., 0], arms[..., 1])
    ray = arms[:, int(np.argmax(np.median(lengths, axis=0)))] if len(arms) else arms[:, 0]
    length = np.hypot(ray[:, 0], ray[:, 1])[:, None]
    return np.where(length > 0, ray / np.where(length > 0, length, 1.0), [1.0, 0.0])


def turned(vectors: FloatArray, direction: FloatArray, *, back: bool = False) -> FloatArray:
    """Turn vectors (L, ..., 3) into frames with these x axes (L, 2), or back into the world."""
    c, s = (direction[:, k].reshape(-1, *[1] * (vectors.ndim - 2)) for k in (0, 1))
    s = -s if back else s
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x + s * y, c * y - s * x, vectors[..., 2]], axis=-1)
