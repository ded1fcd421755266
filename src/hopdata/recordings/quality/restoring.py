"""Positions as they were before a filter or a resampling that is recognised in them.

A filter only weakens what is quick. Files keep so many digits that most of it can be
strengthened again, as far as it stands above the rounding. Frames that were made up
between recorded ones are a linear function of these, which has fewer unknowns than
frames. What is restored serves to say what the processing did, and nothing else.
"""

from dataclasses import replace
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.recording import Recording
from hopdata.recordings.quality.processing import (
    LowPass,
    frames_of_pattern,
    low_pass,
    low_pass_of,
    middle,
)
from hopdata.recordings.quality.rigid import frame_noise
from hopdata.recordings.quality.stretches import runs

#: Frames of a stretch without gaps from which on it is restored.
#: Unit: frames. Origin: chosen.
LEAST_FRAMES = 64

#: Share of the known frequencies that are restored fully; the others fade.
#: Unit: 1. Origin: chosen.
FULLY = 0.6

#: Largest numerator and denominator of the ratio of two frame rates.
#: Unit: 1. Origin: chosen.
LARGEST_RATIO = 25

#: Misfit of the restored frames to those of the file at which they are believed,
#: relative to the noise that a marker has from frame to frame.
#: Unit: 1. Origin: chosen.
BELIEVED = 0.05

#: Frames from which rate and phase of the recorded ones are found.
#: Unit: frames. Origin: chosen.
TRIED_FRAMES = 400

# Degrees of the splines by which programs make frames up.
DEGREES = (1, 3)


def filter_of(body: FloatArray, *, scale: float = 1.0) -> LowPass | None:
    """Return the filter of a body (N, m, 3), m, that has less noise than a camera."""
    if not low_pass(body, scale=scale):
        return None
    return low_pass_of(middle(body))


def unfiltered(positions: FloatArray, found: LowPass) -> FloatArray:
    """Return positions (N, M, 3) as they were before a filter.

    What does not stand above the rounding floor stays weakened. Stretches that are
    shorter than `LEAST_FRAMES` become NaN.
    """
    restored = np.full_like(positions, np.nan)
    for m in range(positions.shape[1]):
        track = positions[:, m]
        for start, stop in runs(_all_seen(track)):
            if stop - start >= LEAST_FRAMES:
                restored[start:stop, m] = _strengthened(track[start:stop], found)
    return restored


def _all_seen(track: FloatArray) -> BoolArray:
    """Tell in which frames of (n, 3) all coordinates are seen."""
    return np.asarray(np.isfinite(track).all(axis=1))


def _strengthened(track: FloatArray, found: LowPass) -> FloatArray:
    """Return a stretch (n, 3), m, with its quick motion restored."""
    n = len(track)
    # Continued as the filters do: turned about both ends.
    before = 2 * track[0] - track[n - 1 : 0 : -1]
    after = 2 * track[-1] - track[n - 2 :: -1][: n - 1]
    whole = np.concatenate([before, track, after])
    # Both ends of the whole meet without a step.
    ramp = np.linspace(whole[0], whole[-1], len(whole))
    spectrum = np.fft.rfft(whole - ramp, axis=0)
    frequency = np.asarray(np.fft.rfftfreq(len(whole)), dtype=np.float64)
    gain = _inverse_gain(frequency, found)
    strong = np.fft.irfft(spectrum * gain[:, None], n=len(whole), axis=0) + ramp
    return np.asarray(strong[n - 1 : 2 * n - 1])


def _inverse_gain(frequency: FloatArray, found: LowPass) -> FloatArray:
    """Return the gains that undo a filter at frequencies (K,), cycles per frame.

    Beyond `known_to` of the filter nothing is restored: they fall to 0 from `FULLY` of
    it on, since a sharp end would ring at each contact.
    """
    # The gain of a filter is 0 at half the frame rate.
    at = np.minimum(frequency, 0.499)
    least = found.gain(np.array([found.known_to]))[0]
    faded = np.clip((at / found.known_to - FULLY) / (1.0 - FULLY), 0.0, 1.0)
    taper = 0.5 * (1.0 + np.cos(np.pi * faded))
    return np.asarray(taper / np.maximum(found.gain(at), least))


def recorded(recording: Recording) -> Recording | None:
    """Return the frames from which those of a recording were made up.

    None if no rate and no spline explain the frames, or if there were more recorded
    frames than made-up ones, which they do not determine.
    """
    found = _making_of(recording.body)
    if found is None:
        return None
    step, degree, phase = found
    n_frames = len(recording.time)
    at = np.asarray(np.arange(n_frames) * float(step) + phase, dtype=np.float64)
    whole = np.arange(int(np.ceil(at[0])), int(np.floor(at[-1])) + 1)
    positions = np.full((len(whole), *recording.positions.shape[1:]), np.nan)
    for m in range(positions.shape[1]):
        track = recording.positions[:, m]
        for start, stop in runs(_all_seen(track)):
            if stop - start < LEAST_FRAMES:
                continue
            spline = _spline(at[start:stop], track[start:stop], degree)
            inside = (whole >= at[start]) & (whole <= at[stop - 1])
            positions[inside, m] = spline(whole[inside])
    seconds = np.interp(whole, at, recording.time)
    return replace(
        recording,
        time=seconds,
        positions=positions,
        rate_hz=recording.rate_hz * float(step),
        filled=None,
    )


def _making_of(body: FloatArray) -> tuple[Fraction, int, float] | None:
    """Return step, degree and phase by which frames were made up; None if unknown.

    The step is that of the made-up frames in recorded ones, the phase the place of the
    first of them.
    """
    period = frames_of_pattern(middle(body))
    if not period:
        return None
    stretch = _stretch(body)
    if stretch is None:
        return None
    track, first = stretch
    limit = BELIEVED * float(np.nanmedian(frame_noise(track[:, None])))
    frames = np.arange(len(track), dtype=np.float64) + first
    for step, degree in product(_steps(period), DEGREES):
        for k in range(step.denominator):
            phase = k / step.denominator
            misfit = _misfit(frames * float(step) + phase, track, degree)
            if misfit < limit:
                return step, degree, phase
    return None


def _steps(period: float) -> list[Fraction]:
    """Return the steps below 1 that may leave a pattern of a period, frames.

    The smallest is first: a finer grid may hold the recorded frames as well.
    """
    share = 1.0 / period
    likely = (1.0 - share, share, (1.0 - share) / 2, (1.0 + share) / 2, share / 2)
    steps = [Fraction(one).limit_denominator(LARGEST_RATIO) for one in likely]
    return sorted(step for step in set(steps) if 0 < step < 1)


def _stretch(body: FloatArray) -> tuple[FloatArray, int] | None:
    """Return the first long stretch (n, 3) of a marker without gaps, and its start."""
    for m in range(body.shape[1]):
        for start, stop in runs(_all_seen(body[:, m])):
            if stop - start >= TRIED_FRAMES:
                return body[start : start + TRIED_FRAMES, m], int(start)
    return None


def _misfit(at: FloatArray, track: FloatArray, degree: int) -> float:
    """Return the rms misfit of a spline with knots at the whole numbers, (n, 3)."""
    try:
        spline = _spline(at, track, degree)
    except (ValueError, np.linalg.LinAlgError):
        return np.inf
    return float(np.sqrt(np.mean((spline(at) - track) ** 2)))


def _spline(at: FloatArray, track: FloatArray, degree: int) -> Any:
    """Return the spline through made-up frames (n, 3) with knots at recorded ones."""
    from scipy.interpolate import make_lsq_spline

    inside = np.arange(np.floor(at[0]) + 1, np.ceil(at[-1]))
    ends = degree + 1
    knots = np.concatenate([np.repeat(at[0], ends), inside, np.repeat(at[-1], ends)])
    return make_lsq_spline(at, track, knots, k=degree)
