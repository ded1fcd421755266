"""Frames of the markers about given instants, summed for fits of polynomials in time."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

import numpy as np
from numpy.polynomial import Legendre, Polynomial

from hopdata.arrays import BoolArray, FloatArray, IntArray

#: Entries of the largest array allocated at once, to bound memory.
LARGEST = 4_000_000
LOOK_AT = 300  # evenly sampled landings, where these show as much as all of them


Seen = tuple[FloatArray, FloatArray, BoolArray, FloatArray, FloatArray, FloatArray]
Part = TypeVar("Part", bound=Any)


@dataclass(frozen=True)
class Windows:
    """Windows of frames, start:stop, about L instants.

    Parameters
    ----------
    near : (L,) array
        Instants, s, at which the scaled time u is zero.
    start, stop : (L,) array of int
        First frame, and the frame after the last.
    scale : float
        Unit of u, s.
    """

    near: FloatArray
    start: IntArray
    stop: IntArray
    scale: float

    def some(self, rows: IntArray | slice) -> Self:
        """Return the windows of some of the instants."""
        return replace(
            self, near=self.near[rows], start=self.start[rows], stop=self.stop[rows]
        )


@dataclass(frozen=True)
class Moments:
    """Sums over the frames of each window: everything that a least-squares fit needs.

    The basis is 1, u, and u^2 times orthogonal polynomials. It spans the same space as
    the powers of u without being nearly linearly dependent.

    Coordinates are those of the landing's own frame, turned about the vertical,
    relative to the mean of the marker's track. The fall under gravity is subtracted if
    requested.

    Parameters
    ----------
    gram : (L, B, K, K) array
        Products of these polynomials.
    product : (L, B, 3, K) array
        Products of polynomials and coordinates, m.
    square : (L, B, 3) array
        Squared coordinates, m^2.
    rows : (L,) array of int
        Indices of the windows.
    frames : (L, B) array
        Number of usable frames.
    centre : (L, B, 3) array
        Mean of each marker's track, m, in the landing's frame.
    direction : (L, 2) array
        x axis of the landing's frame in the world.
    fall : float
        Coefficient of u^2 that was subtracted from the vertical, m.
    scale : float
        Unit of u, s.
    powers : (K, K) array
        Coefficients of the powers of u, with one column for each polynomial.
    """

    gram: FloatArray
    product: FloatArray
    square: FloatArray
    rows: IntArray
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

    def lower(self, degree: int) -> Self:
        """Return the moments of the polynomials up to a degree."""
        kept = slice(0, degree + 1)
        gram, product = self.gram[..., kept, kept], self.product[..., kept]
        return replace(self, gram=gram, product=product, powers=self.powers[kept, kept])

    def some(self, rows: IntArray) -> Self:
        """Return the moments of some of the windows."""
        return replace(self, **{name: getattr(self, name)[rows] for name in _ARRAYS})


_ARRAYS = ("gram", "product", "square", "rows", "frames", "centre", "direction")


def moments(
    time: FloatArray,
    body: FloatArray,
    windows: Windows,
    *,
    degree: int,
    gravity_m_s2: float = 0.0,
) -> Iterator[Moments]:
    """Sum the frames of the windows, block by block.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    body : (N, B, 3) array
        Markers in the world, z up, m; NaN where unseen.
    windows : Windows
        Windows about L instants.
    degree : int
        Highest power of time.
    gravity_m_s2 : float
        Acceleration whose fall is subtracted, m/s^2.

    Yields
    ------
    Moments
        Moments of as many windows as fit into `LARGEST` entries, all with the same
        polynomials.
    """
    width = int(np.max(windows.stop - windows.start, initial=1))
    powers = _polynomials(degree, *_span(time, windows))
    lengths = _seen(time, body, windows.some(evenly(len(windows.near), LOOK_AT)))[-1]
    marker = int(np.argmax(np.median(lengths, axis=0))) if len(lengths) else 0
    fall = -0.5 * gravity_m_s2 * windows.scale**2
    size = max(1, LARGEST // (width * body[0].size * (degree + 1)))
    for at in range(0, max(len(windows.near), 1), size):
        block = np.arange(len(windows.near))[at : at + size]
        seen = _seen(time, body, windows.some(block))
        yield _moments(seen, block, marker, powers, fall, windows.scale)


def joined(parts: Iterable[Part], names: Iterable[str] = _ARRAYS) -> Part:
    """Join blocks of moments, or other dataclasses whose arrays have these names."""
    parts = list(parts)
    arrays: dict[str, Any] = {
        k: np.concatenate([getattr(p, k) for p in parts]) for k in names
    }
    return replace(parts[0], **arrays)


def evenly(n: int, count: int) -> IntArray:
    """Return at most `count` of the integers below n, evenly spaced."""
    return np.unique(np.linspace(0, max(n - 1, 0), count).round().astype(int))[:n]


def _moments(
    seen: Seen,
    rows: IntArray,
    marker: int,
    powers: FloatArray,
    fall: float,
    scale: float,
) -> Moments:
    u, points, usable, centre, arms, lengths = seen
    ray, length = arms[:, marker], lengths[:, marker, None]
    direction = np.where(
        length > 0, ray / np.where(length > 0, length, 1.0), [1.0, 0.0]
    )
    values = turned(points - centre[:, :, None], direction)
    values[..., 2] -= fall * u[:, None] ** 2
    values *= usable[..., None]
    terms = (u[..., None] ** np.arange(len(powers)) @ powers)[:, None]
    gram = np.swapaxes(usable[..., None] * terms, 2, 3) @ terms
    product = np.swapaxes(values, 2, 3) @ terms
    square, frames = (values**2).sum(axis=2), usable.sum(axis=2).astype(float)
    centre = turned(centre, direction)
    return Moments(
        gram, product, square, rows, frames, centre, direction, fall, scale, powers
    )


def _seen(time: FloatArray, body: FloatArray, windows: Windows) -> Seen:
    """Return scaled times (L, W), points (L, B, W, 3), which are usable, and means (L, B, 3).

    Also return the horizontal vectors from the middle of the body to these means, and
    their lengths.
    """
    frames = windows.start[:, None] + np.arange(
        np.max(windows.stop - windows.start, initial=1)
    )
    inside = (frames < windows.stop[:, None]) & (frames >= 0) & (frames < len(time))
    frames = np.clip(frames, 0, len(time) - 1)
    u = (time[frames] - windows.near[:, None]) / windows.scale
    points = np.moveaxis(body[frames], 2, 1)
    usable = inside[:, None] & ~np.isnan(points).any(axis=3)
    points = np.where(usable[..., None], points, 0.0)
    centre = points.sum(axis=2) / np.maximum(usable.sum(axis=2), 1.0)[..., None]
    arms = (centre - centre.mean(axis=1, keepdims=True))[..., :2]
    return u, points, usable, centre, arms, np.hypot(arms[..., 0], arms[..., 1])


def _span(time: FloatArray, windows: Windows) -> tuple[float, float]:
    """Return the first and last scaled time of all windows."""
    first, last = (
        np.clip(f, 0, len(time) - 1) for f in (windows.start, windows.stop - 1)
    )
    early, late = (
        (time[frame] - windows.near) / windows.scale for frame in (first, last)
    )
    return float(np.min(early, initial=0.0)), float(np.max(late, initial=0.0))


def _polynomials(degree: int, first: float, last: float) -> FloatArray:
    """Return the powers in 1, u, and u^2 times Legendre polynomials on [first, last], (K, K)."""
    powers = np.eye(degree + 1)
    domain = [first, last if last > first else first + 1]
    for k in range(2, degree + 1):
        found = Legendre.basis(k - 2, domain=domain).convert(kind=Polynomial).coef
        powers[2:, k] = np.pad(found, (0, degree - 1 - len(found)))
    return powers


def turned(
    vectors: FloatArray, direction: FloatArray, *, back: bool = False
) -> FloatArray:
    """Turn vectors (L, ..., 3) into frames with these x axes (L, 2), or back into the world."""
    c, s = (direction[:, k].reshape(-1, *[1] * (vectors.ndim - 2)) for k in (0, 1))
    s = -s if back else s
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x + s * y, c * y - s * x, vectors[..., 2]], axis=-1)
