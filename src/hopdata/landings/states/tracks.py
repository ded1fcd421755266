"""Frames of the markers about given instants, summed for polynomials in time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Self, TypeVar

import numpy as np
from numpy.polynomial import Legendre, Polynomial

from hopdata.arrays import BoolArray, FloatArray, IntArray

LARGEST = 4_000_000  # entries of the largest array allocated at once, to bound memory

#: Landings, evenly sampled, where these show as much as all of them.
#: Unit: landings. Origin: chosen.
LOOK_AT = 300

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
    direction : (L, 2) array, optional
        x axes of the landings' frames in the world. By default they follow from the
        markers: see `Moments`.
    """

    near: FloatArray
    start: IntArray
    stop: IntArray
    scale: float
    direction: FloatArray | None = None

    def some(self, rows: IntArray | slice) -> Self:
        """Return the windows of some of the instants."""
        direction = self.direction
        if direction is not None:
            direction = direction[rows]
        return replace(
            self,
            near=self.near[rows],
            start=self.start[rows],
            stop=self.stop[rows],
            direction=direction,
        )


@dataclass(frozen=True)
class Moments:
    """Sums over the frames of each window: everything that a least-squares fit needs.

    The basis is 1, u, and u^2 times orthogonal polynomials. It spans the same space as
    the powers of u without being nearly linearly dependent, and its first two
    coefficients are still position and velocity at u = 0.

    Coordinates are those of the landing's own frame, turned about the vertical,
    relative to the mean of the marker's track. Its x axis is that of the windows, or
    points from the middle of the markers to the farthest one. The fall under gravity is
    subtracted if requested.

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
        return replace(
            self,
            gram=self.gram[..., kept, kept],
            product=self.product[..., kept],
            powers=self.powers[kept, kept],
        )

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
    width = _longest(windows)
    first, last = _span(time, windows)
    basis = _Basis(
        powers=_polynomials(degree, first, last),
        marker=_farthest_out(time, body, windows),
        fall=-0.5 * gravity_m_s2 * windows.scale**2,
        scale=windows.scale,
    )
    entries_per_window = width * body[0].size * (degree + 1)
    size = max(1, LARGEST // entries_per_window)
    n_windows = len(windows.near)
    # Without any windows there is one empty block, since callers join the blocks.
    for first_row in range(0, max(n_windows, 1), size):
        block = np.arange(n_windows)[first_row : first_row + size]
        # Sums round by their length, so all blocks have that of the longest window.
        seen = _seen(time, body, windows.some(block), width)
        yield _moments(seen, block, basis)


def kept(sums: Callable[[], Iterator[Moments]]) -> Callable[[], Iterator[Moments]]:
    """Sum frames once if one block holds all windows, and otherwise each time anew.

    `sums` makes the blocks. Several of them together might fill the memory.
    """
    blocks = sums()
    first = next(blocks)
    if next(blocks, None) is not None:
        return sums
    return lambda: iter([first])


def joined(parts: Iterable[Part], names: Iterable[str] = _ARRAYS) -> Part:
    """Join blocks of moments, or other dataclasses whose arrays have these names."""
    parts = list(parts)
    arrays: dict[str, Any] = {}
    for name in names:
        arrays[name] = np.concatenate([getattr(part, name) for part in parts])
    return replace(parts[0], **arrays)


def evenly(n: int, count: int) -> IntArray:
    """Return at most `count` of the integers below n, evenly spaced."""
    return np.unique(np.linspace(0, max(n - 1, 0), count).round().astype(int))[:n]


@dataclass(frozen=True)
class _Basis:
    """What all blocks of windows share: see `Moments` for `powers`, `fall`, `scale`.

    `marker` is the number of the marker that gives each landing's frame its x axis.
    """

    powers: FloatArray
    marker: int
    fall: float
    scale: float


@dataclass(frozen=True)
class _Seen:
    """Frames of L windows of W frames.

    Parameters
    ----------
    u : (L, W) array
        Scaled times.
    points : (L, B, W, 3) array
        Markers in the world, m; 0 where not usable.
    usable : (L, B, W) bool array
        Whether the marker is seen in a frame of the window.
    centre : (L, B, 3) array
        Mean of each marker's track, m.
    arms : (L, B, 2) array
        Horizontal vectors from the middle of the body to these means, m.
    direction : (L, 2) array, optional
        x axes of the landings' frames, if they are given.
    """

    u: FloatArray
    points: FloatArray
    usable: BoolArray
    centre: FloatArray
    arms: FloatArray
    direction: FloatArray | None

    @property
    def lengths(self) -> FloatArray:
        """Lengths of the arms, (L, B), m."""
        return np.hypot(self.arms[..., 0], self.arms[..., 1])

    def along_arm(self, marker: int) -> FloatArray:
        """Return unit vectors (L, 2) along the arm of a marker."""
        arm = self.arms[:, marker]
        length = self.lengths[:, marker, None]
        is_known = length > 0
        return np.where(is_known, arm / np.where(is_known, length, 1.0), [1.0, 0.0])


def _farthest_out(time: FloatArray, body: FloatArray, windows: Windows) -> int:
    """Return the number of the marker with the longest arm in the usual window.

    The longest arm gives the most accurate direction.
    """
    some = windows.some(evenly(len(windows.near), LOOK_AT))
    lengths = _seen(time, body, some, _longest(some)).lengths
    if not len(lengths):
        return 0
    return int(np.argmax(np.median(lengths, axis=0)))


def _moments(seen: _Seen, rows: IntArray, basis: _Basis) -> Moments:
    """Sum the frames of a block of windows, in each landing's own frame."""
    direction = seen.direction
    if direction is None:
        direction = seen.along_arm(basis.marker)
    values = turned(seen.points - seen.centre[:, :, None], direction)
    values[..., 2] -= basis.fall * seen.u[:, None] ** 2
    values *= seen.usable[..., None]
    exponents = np.arange(len(basis.powers))
    terms = (seen.u[..., None] ** exponents @ basis.powers)[:, None]
    usable_terms = seen.usable[..., None] * terms
    return Moments(
        gram=np.swapaxes(usable_terms, 2, 3) @ terms,
        product=np.swapaxes(values, 2, 3) @ terms,
        square=(values**2).sum(axis=2),
        rows=rows,
        frames=seen.usable.sum(axis=2).astype(float),
        centre=turned(seen.centre, direction),
        direction=direction,
        fall=basis.fall,
        scale=basis.scale,
        powers=basis.powers,
    )


def _longest(windows: Windows) -> int:
    """Return the number of frames of the longest window."""
    return int(np.max(windows.stop - windows.start, initial=1))


def _seen(time: FloatArray, body: FloatArray, windows: Windows, width: int) -> _Seen:
    """Cut the frames of the windows, at most `width` of each, out of a recording."""
    frames = windows.start[:, None] + np.arange(width)
    inside = (frames < windows.stop[:, None]) & (frames >= 0) & (frames < len(time))
    frames = np.clip(frames, 0, len(time) - 1)
    u = (time[frames] - windows.near[:, None]) / windows.scale
    points = np.moveaxis(body[frames], 2, 1)
    usable = inside[:, None] & ~np.isnan(points).any(axis=3)
    points = np.where(usable[..., None], points, 0.0)
    count = np.maximum(usable.sum(axis=2), 1.0)
    centre = points.sum(axis=2) / count[..., None]
    arms = (centre - centre.mean(axis=1, keepdims=True))[..., :2]
    return _Seen(u, points, usable, centre, arms, windows.direction)


def _span(time: FloatArray, windows: Windows) -> tuple[float, float]:
    """Return the first and last scaled time of all windows; 0 lies between them."""
    first_frame = np.clip(windows.start, 0, len(time) - 1)
    last_frame = np.clip(windows.stop - 1, 0, len(time) - 1)
    first = (time[first_frame] - windows.near) / windows.scale
    last = (time[last_frame] - windows.near) / windows.scale
    return float(np.min(first, initial=0.0)), float(np.max(last, initial=0.0))


@lru_cache
def _polynomials(degree: int, first: float, last: float) -> FloatArray:
    """Return the powers in each polynomial of the basis, (K, K).

    The polynomials are 1, u, and u^2 times Legendre polynomials on [first, last].
    """
    powers = np.eye(degree + 1)
    if last <= first:
        last = first + 1
    for k in range(2, degree + 1):
        legendre = Legendre.basis(k - 2, domain=[first, last])
        coefficients = legendre.convert(kind=Polynomial).coef
        powers[2:, k] = np.pad(coefficients, (0, degree - 1 - len(coefficients)))
    powers.flags.writeable = False  # the same for all who ask
    return powers


def turned(
    vectors: FloatArray, direction: FloatArray, *, back: bool = False
) -> FloatArray:
    """Turn vectors (L, ..., 3) into frames with these x axes (L, 2), or back."""
    per_landing = (-1, *[1] * (vectors.ndim - 2))
    cos = direction[:, 0].reshape(per_landing)
    sin = direction[:, 1].reshape(per_landing)
    if back:
        sin = -sin
    x = vectors[..., 0]
    y = vectors[..., 1]
    return np.stack([cos * x + sin * y, cos * y - sin * x, vectors[..., 2]], axis=-1)
