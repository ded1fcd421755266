"""The noise of the cameras: its size, how long it lasts, what it does to a fit."""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.recordings.quality.rigid import frame_noise

#: Least standard deviation of a height: cameras do no better, and noise-free data do
#: not follow the model exactly.
#: Unit: m. Origin: chosen.
LEAST_NOISE_M = 5e-5

#: Ratio of the variances of fourth differences over two frames and over one from which
#: on noise counts as correlated. White noise has 1.0 to 1.1 (docs/decisions.md).
#: Unit: 1. Origin: chosen.
NEARLY_WHITE = 1.2

#: The same ratio from which on it tells of motion or of a filter: autoregressive noise
#: gives up to 2, real runners 3 and more (docs/decisions.md).
#: Unit: 1. Origin: chosen.
NO_LONGER_NOISE = 2.5

#: Largest correlation of consecutive frames that is stated.
#: Unit: 1. Origin: chosen.
MOST_CORRELATED = 0.85

MOST_FRAMES = 200_000  # frames from which the noise is estimated, to bound memory

#: Median of |z| for a standard normal z.
#: Unit: 1. Origin: derived: its quartile.
NORMAL_MEDIAN = 0.6744897501960817

# Standard deviation of a third difference of white noise of unit variance, which is
# 1 + 9 + 9 + 1.
THIRD_DIFFERENCE_SD = np.sqrt(20.0)

# Variance of a fourth difference over the noise variance times 70, as a polynomial in
# the correlation of consecutive frames.
FOURTH_DIFFERENCE = np.array([70.0, -112.0, 56.0, -16.0, 2.0]) / 70.0


def height_noise(heights: FloatArray, *, scale: float = 1.0) -> float:
    """Estimate the standard deviation of the noise of heights (N, n), m.

    Third differences of a smooth motion almost vanish, while those of white noise have
    variance 20 sigma^2. The few frames about the contacts do not affect their median.
    If only every k-th frame is seen, the differences span k frames. Longer recordings
    are sampled at `MOST_FRAMES` evenly spaced frames. The result is never less than
    `LEAST_NOISE_M` times the scale of the recording.
    """
    seen = np.flatnonzero(~np.isnan(heights).all(axis=1))
    step = 1
    if len(seen) > 1:
        step = int(np.median(np.diff(seen)))
    if len(heights) <= 3 * step:
        return float("nan")
    every = -(-len(heights) // MOST_FRAMES)
    z0, z1, z2, z3 = (
        heights[k * step : len(heights) - (3 - k) * step : every] for k in range(4)
    )
    third = z3 - 3 * z2 + 3 * z1 - z0
    known = np.abs(third[~np.isnan(third)])
    if known.size == 0:
        return float("nan")
    noise_m = float(np.median(known) / NORMAL_MEDIAN / THIRD_DIFFERENCE_SD)
    return max(noise_m, LEAST_NOISE_M * scale)


def noise_correlation(body: FloatArray) -> float:
    """Estimate the correlation of a coordinate's noise between consecutive frames.

    The estimate compares fourth differences of the body's markers (N, m, 3) over one
    frame and over two. Their variances are equal if the noise is white; their ratio
    approaches two if it is autoregressive. Motion and filters give larger ratios, which
    cannot be told apart: the result is then 0.
    """
    over_one = frame_noise(body, lag=1)
    over_two = frame_noise(body, lag=2)
    known = over_one > 0
    if not known.any():
        return 0.0
    ratio = float(np.median(over_two[known] / over_one[known])) ** 2
    if not NEARLY_WHITE < ratio < NO_LONGER_NOISE:
        return 0.0
    trial = np.linspace(0.0, MOST_CORRELATED, 100)
    variance = np.polynomial.Polynomial(FOURTH_DIFFERENCE)
    ratios = variance(trial**2) / variance(trial)
    return float(np.interp(ratio, ratios, trial))


def widening(correlation: float, before: int, after: int) -> float:
    """Return the factor by which correlated noise widens the error of a contact.

    The reference is white noise with the same residuals. The fit is least squares of a
    flight with free acceleration in `before` frames before the contact and a constant
    height in `after` frames after it.
    """
    frame = np.arange(-before, after) + 0.5
    flies = frame < 0
    law = np.stack([flies, flies * frame, flies * frame**2, ~flies], axis=1)
    fit = np.linalg.pinv(law)
    contact = fit[0] - fit[-1]  # height of the flight over that of the floor
    residual = np.eye(len(frame)) - law @ fit
    alike = correlation ** np.abs(frame[:, None] - frame)
    residual_ratio = np.trace(residual @ alike) / np.trace(residual)
    error_ratio = contact @ alike @ contact / (contact @ contact)
    return float(np.sqrt(error_ratio / residual_ratio))
