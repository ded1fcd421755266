"""Positions and velocities of the body markers where the body crosses a section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import require_choice

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

METHODS = ("split_fit", "savitzky_golay")
GRAVITIES = ("auto", "known", "free")
GRAVITY_M_S2 = 9.80665
BALLISTIC_WINDOW_S, WINDOW_S = 0.1, 0.06
NO_LARGER = 1.1  # ratio of rms residuals up to which flight counts as ballistic
STANCE_DEGREE = 3
LEAST_FRAMES = 6
FILTER_FRAMES, FILTER_DEGREE = 7, 3
NEWTON_STEPS = 8


@dataclass(frozen=True)
class SectionStates:
    """States of B body markers at L crossings of a section, in the world; NaN where not determined.

    Parameters
    ----------
    time : (L,) array
        Instants at which the mean height of the fitted markers equals the section's, s.
    position, velocity : (L, B, 3) array
        Positions, m, and velocities, m/s.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray


@dataclass(frozen=True)
class _Fit:
    """Polynomials in scaled time, coefficients (L, B, 3, K), and their rms residual, m."""

    coefficients: FloatArray
    scale: float
    rms: float


def section_states(
    time: FloatArray,
    body: FloatArray,
    near: FloatArray,
    *,
    height_m: float,
    side: str,
    contact: FloatArray,
    method: str = "split_fit",
    window_s: float | None = None,
    gravity: str = "auto",
) -> SectionStates:
    """Fit the motion of each marker about each crossing and evaluate it on the section.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    body : (N, B, 3) array
        Body markers in the world, z up, m; NaN where unseen.
    near : (L,) array
        Approximate instants of the crossings, s.
    height_m : float
        Height of the section, m.
    side : {"before", "after"}
        On which side of the contacts the section lies.
    contact : (L,) array
        The first contact for the pre section, the last one for the post section, s. Frames beyond
        it are not used by the split fit.
    method : {"split_fit", "savitzky_golay"}
        Polynomials over the window on the right side of the contacts; or a cubic over the seven
        nearest frames, whatever happens in them.
    window_s : float, optional
        Frames used on either side of the crossing by the split fit, s; on the free side it is
        widened until the frames suffice. By default 0.1 s in ballistic flight and 0.06 s else.
    gravity : {"auto", "known", "free"}
        Flight before the contacts as straight lines under gravity (`known`), or with an
        acceleration of its own for each marker and landing (`free`). `auto` takes gravity where the
        residuals are then no larger.

    Returns
    -------
    SectionStates

    Raises
    ------
    ConfigError
        If `method` or `gravity` is unknown.
    """
    require_choice("states.method", method, METHODS)
    require_choice("states.gravity", gravity, GRAVITIES)
    if method == "savitzky_golay":
        start = _nearest(time, near) - FILTER_FRAMES // 2
        scale = FILTER_FRAMES / 2 * float(np.median(np.diff(time)))
        fit = _fit(time, body, near, start, start + FILTER_FRAMES, scale, FILTER_DEGREE)
    elif side == "before":
        fit = _flight_fit(time, body, near, contact, window_s, gravity)
    else:
        window = window_s or WINDOW_S
        start, stop = _stance_frames(time, near, contact, window)
        fit = _fit(time, body, near, start, stop, window, STANCE_DEGREE)
    return _on_section(fit, near, height_m)


def _flight_fit(
    time: FloatArray,
    body: FloatArray,
    near: FloatArray,
    contact: FloatArray,
    window_s: float | None,
    gravity: str,
) -> _Fit:
    """Straight lines under gravity, or parabolas, over frames before the first contact."""

    def fit(window: float, degree: int, fall_m_s2: float) -> _Fit:
        stop = np.searchsorted(time, np.minimum(near + window, contact))
        start = np.minimum(np.searchsorted(time, near - window), stop - LEAST_FRAMES)
        return _fit(time, body, near, start, stop, window, degree, fall_m_s2)

    if gravity == "known":
        return fit(window_s or BALLISTIC_WINDOW_S, 1, GRAVITY_M_S2)
    free = fit(window_s or WINDOW_S, 2, 0.0)
    if gravity == "free":
        return free
    ballistic = fit(window_s or BALLISTIC_WINDOW_S, 1, GRAVITY_M_S2)
    return ballistic if ballistic.rms <= NO_LARGER * free.rms else free


def _stance_frames(
    time: FloatArray, near: FloatArray, contact: FloatArray, window: float
) -> tuple[IntArray, IntArray]:
    """First and last-plus-one frame about each crossing, after the last contact."""
    start = np.searchsorted(time, np.maximum(near - window, contact))
    stop = np.searchsorted(time, near + window, side="right")
    return start, np.maximum(stop, start + LEAST_FRAMES)


def _nearest(time: FloatArray, at: FloatArray) -> IntArray:
    right = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    return right - (at - time[right - 1] < time[right] - at)


def _frames(start: IntArray, stop: IntArray, n_frames: int) -> tuple[IntArray, BoolArray]:
    """Frame numbers of all windows, padded to one length, and which of them count, (L, W)."""
    width = int(np.max(stop - start, initial=1))
    frames = start[:, None] + np.arange(width)
    inside = (frames < stop[:, None]) & (frames >= 0) & (frames < n_frames)
    return np.clip(frames, 0, n_frames - 1), inside


def _fit(
    time: FloatArray,
    body: FloatArray,
    near: FloatArray,
    start: IntArray,
    stop: IntArray,
    scale: float,
    degree: int,
    fall_m_s2: float = 0.0,
) -> _Fit:
    """Fit polynomials in (t - near) / scale to the frames start:stop of each marker's track."""
    frames, inside = _frames(start, stop, len(time))
    u = (time[frames] - near[:, None]) / scale
    points = body[frames]  # (L, W, B, 3)
    usable = inside[:, :, None] & ~np.isnan(points).any(axis=3)
    enough = usable.sum(axis=1) > degree + 1
    weight = np.moveaxis(usable, 2, 1).astype(float)[..., None]  # (L, B, W, 1)
    values = np.moveaxis(np.where(usable[..., None], points, 0.0), 2, 1)
    centre = values.sum(axis=2, keepdims=True) / np.maximum(weight.sum(axis=2, keepdims=True), 1.0)
    values = (values - centre) * weight
    quadratic = -0.5 * fall_m_s2 * scale**2
    values[..., 2] -= quadratic * weight[..., 0] * u[:, None, :] ** 2
    design = weight * u[:, None, :, None] ** np.arange(degree + 1)
    design[~enough] = np.eye(design.shape[2], degree + 1)
    q, r = np.linalg.qr(design)
    solved = np.linalg.solve(r, np.swapaxes(q, 2, 3) @ values)  # (L, B, degree + 1, 3)
    residuals = (values - design @ solved)[enough]
    freedom = 3 * (weight.sum(axis=2)[enough] - degree - 1).sum()
    coefficients = np.zeros((*solved.shape[:2], 3, max(degree, 2) + 1))
    coefficients[..., : degree + 1] = np.swapaxes(solved, 2, 3)
    coefficients[..., 0] += centre[:, :, 0]
    coefficients[:, :, 2, 2] += quadratic
    coefficients[~enough] = np.nan
    rms = float(np.sqrt((residuals**2).sum() / freedom)) if freedom > 0 else np.inf
    return _Fit(coefficients, scale, rms)


def _on_section(fit: _Fit, near: FloatArray, height_m: float) -> SectionStates:
    """Evaluate at the instant at which the mean height is that of the section."""
    powers = np.arange(fit.coefficients.shape[-1])
    slopes = fit.coefficients[..., 1:] * powers[1:]
    mean = fit.coefficients[:, :, 2].mean(axis=1)
    mean_slope = slopes[:, :, 2].mean(axis=1)
    u = np.zeros(len(near))
    for _ in range(NEWTON_STEPS):
        miss = (mean * u[:, None] ** powers).sum(axis=1) - height_m
        slope = (mean_slope * u[:, None] ** powers[:-1]).sum(axis=1)
        u = u - miss / np.where(slope == 0, np.nan, slope)
        u = np.where(np.abs(u) <= 1.0, u, np.nan)
    at = u[:, None, None, None]
    return SectionStates(
        near + u * fit.scale,
        (fit.coefficients * at**powers).sum(axis=3),
        (slopes * at ** powers[:-1]).sum(axis=3) / fit.scale,
    )
