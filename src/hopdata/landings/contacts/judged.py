"""Which contacts can be trusted: the fits of a recording, judged by their residuals."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.contacts import descents
from hopdata.landings.contacts.kink import KinkFits
from hopdata.landings.contacts.law import FRAMES_AFTER, FRAMES_BEFORE

#: Residuals, in units of the measurement noise, above which the law of flight and
#: stance does not hold: of a whole recording (then each foot is fitted alone) or of
#: one contact (then only this one is).
#: Unit: 1. Origin: chosen.
REFUTED = 2.0

#: Standard deviations beyond which a misfit is no chance.
#: Unit: 1. Origin: convention: three sigmas.
CHANCE_SIGMAS = 3.0

# The marker of a foot of which none is known to touch.
NO_MARKER = -1


@dataclass(frozen=True)
class Contacts:
    """Contact instants of L landings and n feet.

    Parameters
    ----------
    instant, se : (L, n) array
        Contact instant and its standard error, s; NaN where none was found.
    status : (L, n) int array
        Codes of `hopdata.landings.contacts.descents`: ``LANDED``, or why the instant
        cannot be trusted.
    noise_m : float
        Standard deviation of a foot's height in this recording, m.
    common : (n,) array
        Error that all instants of a foot may share, s, because its contact may be
        softer or harder than it appears; not in `se`, and empty for the printed
        methods.
    earliest : (L, n) array
        Last instant at which the foot was still too high to touch, s; empty for the
        printed methods.
    down : (L, n) array
        When the foot reached the floor, by its height alone, s; empty for the kink fit,
        whose instants say it better. The printed methods need it, since the minima of a
        smoothed velocity lie some 20 ms ahead of the contact.
    marker : (L, n) int array
        Place of the marker that touches first among those of its foot; `NO_MARKER`
        where none does. Empty where each foot has one marker, and for the printed
        methods, to which a foot of several is one height.
    marker_probability : (L, n) array
        Probability that it is the first; NaN where none is, or the foot has no other.
        Empty where `marker` is.
    """

    instant: FloatArray
    se: FloatArray
    status: IntArray
    noise_m: float
    common: FloatArray = field(default_factory=lambda: np.empty(0))
    earliest: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    down: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    marker: IntArray = field(default_factory=lambda: np.empty((0, 0), dtype=np.int64))
    marker_probability: FloatArray = field(default_factory=lambda: np.empty((0, 0)))


def frames_missing(
    time: FloatArray,
    heights: FloatArray,
    near: FloatArray,
    windows_s: tuple[float, float],
) -> BoolArray:
    """Mark the contacts (L, n) with frames missing in the windows about `near`, s."""
    lost_so_far = np.cumsum(np.isnan(heights), axis=0)
    last_frame = len(time) - 1
    begin = np.searchsorted(time, near - windows_s[0]).clip(max=last_frame)
    end = np.searchsorted(time, near + windows_s[1]).clip(max=last_frame)
    lost_before = np.take_along_axis(lost_so_far, begin, axis=0)
    lost_by_then = np.take_along_axis(lost_so_far, end, axis=0)
    return np.asarray(lost_by_then > lost_before)


def is_odd(fits: KinkFits, noise_m: FloatArray) -> BoolArray:
    """Mark contacts (L, n) that break the law of the others, as of a swinging leg.

    `noise_m` (L, 1) is the noise of a height about its fit, m.
    """
    ratio, limit_of_chance = _misfits(fits, noise_m)
    return np.asarray(ratio > np.maximum(REFUTED, limit_of_chance))


def judge_fits(
    fits: KinkFits,
    status: IntArray,
    hidden: BoolArray,
    *,
    noise_m: float,
    maximum_misfit: float,
) -> Contacts:
    """Say which fits cannot be trusted, and why; widen the errors of poor ones.

    Where several reasons hold, the last one below is told.

    Parameters
    ----------
    fits : KinkFits
        Fits of L landings and n feet.
    status : (L, n) int array
        What is known of each foot before the fit: see `approach.approaches`.
    hidden : (L, n) bool array
        Whether frames are missing about the contact: see `frames_missing`.
    noise_m : float
        Standard deviation of a height about its fit, m.
    maximum_misfit : float
        Largest accepted ratio of a fit's rms residual to the noise.
    """
    landed = status == descents.LANDED
    ratio, limit_of_chance = _misfits(fits, noise_m)
    too_few = (
        (fits.n_before < FRAMES_BEFORE)
        | (fits.n_after < FRAMES_AFTER)
        | (fits.dof <= 0)
        | ~np.isfinite(fits.unit_se)
    )
    rising = ~(fits.velocity < 0)  # also where there is no fit

    judged = status.copy()
    judged[landed & (ratio > maximum_misfit)] = descents.POOR_FIT
    judged[landed & rising] = descents.RISES
    judged[landed & too_few & hidden] = descents.MISSING
    judged[landed & too_few & ~hidden] = descents.THIN

    # Birge's ratio widens the error where the misfit exceeds what chance explains.
    birge = np.where(ratio > limit_of_chance, ratio, 1.0)
    se = fits.unit_se * noise_m * birge
    untimed = np.isin(judged, (descents.MISSING, descents.THIN))
    return Contacts(
        instant=np.where(untimed, np.nan, fits.instant),
        se=np.where(untimed, np.nan, se),
        status=judged,
        noise_m=noise_m,
    )


def _misfits(
    fits: KinkFits, noise_m: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Return rms residuals over the noise (L, n), and the largest by chance."""
    dof = np.maximum(fits.dof, 1.0)
    rms_m = np.sqrt(fits.misfit / dof)
    # The rms of `dof` residuals has the relative standard deviation 1 / sqrt(2 dof).
    limit_of_chance = 1 + CHANCE_SIGMAS / np.sqrt(2 * dof)
    return rms_m / noise_m, limit_of_chance
