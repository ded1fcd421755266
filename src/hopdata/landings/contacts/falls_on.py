"""Feet that are timed when another part of them touches, and still fall.

As the toe of a foot touches, its heel slows within a frame, some centimetres above the
floor, and falls on: its height has two kinks, and the second is the contact. A foot on
a soft floor slows the less, the slower it is, so that it has one kink only. The heights
after the first kink tell the two apart. Everything here is of an animal of 1 m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.landings.contacts import approach, glides
from hopdata.landings.contacts.law import LEAVES, UNDETERMINED_S

#: Time after a contact in which the foot is seen to stop, and how it stops.
#: Unit: s. Origin: chosen: simulated heels touch 0.01 to 0.03 after their toes.
STOPS_S = 0.06

#: Fewest frames in this time.
#: Unit: frames. Origin: derived: twice the four numbers that each course has.
LEAST_FRAMES = 8

#: Speed of the fall after the first kink, at least: slower feet roll, or yield.
#: Unit: m/s. Origin: measured: after 500 contacts of a runner whose feet roll, feet
#: that fall on evenly to within the noise do so at less than 0.3; simulated heels at
#: 1.0 and more.
FALLS_M_S = 0.5

#: How much likelier two kinks are than one, at least.
#: Unit: nats. Origin: chosen: noise does so once in 3,000 contacts.
CLEARLY_LIKELIER = 8.0

#: Frames after the first kink that may still belong to it, as it is timed early.
#: Unit: frames. Origin: chosen.
MOST_SKIPPED = 1

#: Acceleration of a foot between its kinks, as far as it is known before.
#: Unit: m/s^2. Origin: chosen: that of gravity.
ACCELERATION_M_S2 = 10.0

#: Time constants of a contact that are tried.
#: Unit: s. Origin: derived: none to `approach.SOFTEST_S` and a fifth more.
SOFTNESS_S = approach.SOFTEST_S * np.array([0.05, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2])

#: Instants of the second kink that are tried, in each frame.
#: Unit: 1. Origin: chosen: some 0.5 ms at 250 frames/s.
INSTANTS_OF_FRAME = 8


@dataclass(frozen=True)
class _Courses:
    """How well courses of one kind, in an array of any shape (...), fit heights.

    Parameters
    ----------
    coefficients : (..., k) array
        Those of the columns of each.
    square : (...) array
        Sum of the squared residuals, in squares of the noise.
    logarithm : (...) array
        Logarithm of the likelihood, with all coefficients integrated out.
    """

    coefficients: FloatArray
    square: FloatArray
    logarithm: FloatArray


def later_contact(
    time: FloatArray, height: FloatArray, contact_s: float, noise_m: float
) -> tuple[float, float] | None:
    """Return the contact and its error, s, of a foot (N,) that falls on after one.

    None if the foot stops at `contact_s` (s), or is not seen to do otherwise. NaN and
    NaN if it falls on, and when it stops cannot be told. `noise_m` (m) is the standard
    deviation of a height.
    """
    since_s, frames_m = _frames_after(time, height, contact_s, noise_m)
    for skipped in range(MOST_SKIPPED + 1):
        later_s = _second_kink(since_s[skipped:], frames_m[skipped:], noise_m)
        if later_s is not None:
            return contact_s + later_s[0], later_s[1]
    return None


def _second_kink(
    since_s: FloatArray, frames_m: FloatArray, noise_m: float
) -> tuple[float, float] | None:
    """Return when a foot stops that falls on, and its error, s, since its first kink.

    `since_s` and `frames_m` (n,) are its frames after that; see `later_contact`.
    """
    least_m = glides.GLIDED_M + glides.LOWEST_SIGMAS * noise_m
    if len(since_s) < LEAST_FRAMES or frames_m[0] - frames_m.min() < least_m:
        return None
    scaled = frames_m / noise_m
    degrees = len(since_s) - 4
    soft = float(_stops(since_s, scaled).square.min())
    frame_s = float(np.median(np.diff(since_s)))
    instants = np.arange(since_s[1], since_s[-2], frame_s / INSTANTS_OF_FRAME)
    falls = _falls_and_stops(since_s, scaled, instants, noise_m)
    best = np.unravel_index(falls.square.argmin(), falls.square.shape)
    best_s = float(instants[best[0]])
    square = float(falls.square[best])
    fall_m_s = -float(falls.coefficients[best][1]) * noise_m
    falls_on = (
        fall_m_s > FALLS_M_S
        and fall_m_s * best_s > least_m
        and square < glides.EVENLY_SIGMAS**2 * degrees
        and soft - square > 2 * CLEARLY_LIKELIER
    )
    if not falls_on:
        return None
    likelihood = np.exp(falls.logarithm - falls.logarithm.max())
    weight = likelihood.sum(axis=1)
    weight /= weight.sum()
    mean_s = float(weight @ instants)
    variance = float(weight @ (instants - mean_s) ** 2)
    misfit = max(1.0, square / degrees)
    # The instants tried are apart.
    sd_s = (variance * misfit + (frame_s / INSTANTS_OF_FRAME) ** 2 / 12) ** 0.5
    if sd_s > UNDETERMINED_S:
        return float("nan"), float("nan")
    return mean_s, sd_s


def _frames_after(
    time: FloatArray, height: FloatArray, contact_s: float, noise_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return times since a contact, s, and heights, m, until the foot rises again."""
    begin, end = np.searchsorted(time, [contact_s, contact_s + STOPS_S])
    end = max(end, begin + LEAST_FRAMES)
    frames_m = height[begin:end]
    seen = np.isfinite(frames_m)
    since_s = time[begin:end][seen] - contact_s
    frames_m = frames_m[seen]
    rises = frames_m > np.minimum.accumulate(frames_m) + LEAVES * noise_m
    if rises.any():
        stays = int(np.argmax(rises))
        return since_s[:stays], frames_m[:stays]
    return since_s, frames_m


def _stops(since_s: FloatArray, scaled: FloatArray) -> _Courses:
    """Fit a foot that touched before, yields and creeps: for each of `SOFTNESS_S`."""
    yields = np.exp(-since_s / SOFTNESS_S[:, np.newaxis])
    return _fitted([np.ones_like(since_s), since_s, yields], scaled)


def _falls_and_stops(
    since_s: FloatArray, scaled: FloatArray, instants: FloatArray, noise_m: float
) -> _Courses:
    """Fit a foot that falls until an instant, then yields and creeps.

    The courses (k, s) are those of all instants (k,), s, with all but the longest time
    of `SOFTNESS_S`.
    """
    at_s = instants[:, np.newaxis, np.newaxis]
    softness_s = SOFTNESS_S[:-1, np.newaxis]
    before_s = np.minimum(since_s - at_s, 0.0)
    after_s = np.maximum(since_s - at_s, 0.0)
    falls = before_s + softness_s * (1 - np.exp(-after_s / softness_s))
    curves = 0.5 * before_s**2 * (ACCELERATION_M_S2 / noise_m)
    return _fitted([np.ones_like(since_s), falls, after_s, curves], scaled, known=1)


def _fitted(
    columns: list[FloatArray], scaled: FloatArray, *, known: int = 0
) -> _Courses:
    """Fit columns (..., n) to heights (n,) in units of the noise, all at once.

    The coefficients of the last `known` columns are N(0, 1).
    """
    design = np.stack(np.broadcast_arrays(*columns), axis=-1)
    transposed = np.swapaxes(design, -1, -2)
    normal = transposed @ design
    first_known = len(columns) - known
    for own in range(first_known, len(columns)):
        normal[..., own, own] += 1.0
    moments = (transposed @ scaled)[..., np.newaxis]
    solved = np.linalg.solve(normal, moments)
    residual = scaled - (design @ solved)[..., 0]
    coefficients: FloatArray = np.asarray(solved[..., 0], dtype=np.float64)
    square = (residual**2).sum(axis=-1)
    square += (coefficients[..., first_known:] ** 2).sum(axis=-1)
    logarithm = -0.5 * square - 0.5 * np.linalg.slogdet(normal)[1]
    return _Courses(coefficients, square, logarithm)
