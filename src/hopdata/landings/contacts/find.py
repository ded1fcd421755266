"""Contact instants of every foot in every landing, by the method chosen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import chosen, require_choice
from hopdata.landings.contacts import descents, kink_law
from hopdata.landings.contacts.kink import KinkFits
from hopdata.landings.contacts.velocity_minimum import velocity_minima

LONG_WINDOWS_S = (0.08, 0.05)  # before and after the contact, where the flight law holds
SHORT_WINDOWS_S = (0.04, 0.027)  # where it does not
REFUTED = 2.0  # rms residual over measurement noise from which the flight law does not hold
FRAMES_BEFORE, FRAMES_AFTER = 3, 2  # the least that determine a kink


@dataclass(frozen=True)
class Contacts:
    """Contact instants of L landings and n feet.

    Parameters
    ----------
    instant, se : (L, n) array
        Contact instant and its standard error, s; NaN where none was found.
    status : (L, n) int array
        Codes of `hopdata.landings.contacts.descents`: ``LANDED``, or why no instant is to be
        trusted.
    noise_m : float
        Standard deviation of a foot's height in this recording, m.
    """

    instant: FloatArray
    se: FloatArray
    status: IntArray
    noise_m: float


def find_contacts(
    time: FloatArray,
    heights: FloatArray,
    transitions: descents.Transitions,
    *,
    down_height_m: float,
    method: str = "kink",
    gravity: str = "learned",
    window_before_s: float | None = None,
    window_after_s: float | None = None,
    maximum_misfit: float = 5.0,
) -> Contacts:
    """Find when each foot touched in each transition.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet above the levelled floor, m; NaN where unseen.
    transitions : Transitions
        The descents of the body.
    down_height_m : float
        A foot that never sinks below this height has not landed, m.
    method : {"kink", "velocity_minimum", "velocity_minimum_parabola"}
        Maximum-likelihood kink; or the least vertical velocity in the transition (the printed
        method, Sec. 2.2.3), as a whole frame or at the vertex of a parabola through it.
    gravity : {"learned", "free", "known"}
        Acceleration of a foot in free flight, for the kink fit: its distribution taken from the
        recording, unknown in each landing, or that of gravity.
    window_before_s, window_after_s : float, optional
        Frames used by the kink fit before and after the contact, s (at least 5 and 3 frames). By
        default 0.08 and 0.05 s where feet fly freely and then stand still to within the noise, and
        0.04 and 0.027 s where they do not (a runner's foot rolls).
    maximum_misfit : float
        Largest ratio of a kink fit's rms residual to that of the whole recording.

    Returns
    -------
    Contacts

    Raises
    ------
    ConfigError
        If `method` or `gravity` is unknown.
    """
    find = chosen("touchdowns.method", method, METHODS)
    require_choice("touchdowns.gravity", gravity, kink_law.GRAVITIES)
    noise_m = descents.height_noise(heights)
    near, status = descents.approaches(
        time,
        heights,
        transitions,
        noise_m=noise_m,
        down_height_m=down_height_m,
        lead_s=window_before_s or SHORT_WINDOWS_S[0],
        trail_s=window_after_s or SHORT_WINDOWS_S[1],
    )
    if find is not None:
        instant, se = find(time, heights, transitions, noise_m=noise_m)
        landed = status == descents.LANDED
        instant, se = np.where(landed, instant, np.nan), np.where(landed, se, np.nan)
        status = np.where(landed & np.isnan(instant), descents.MISSING, status)
        return Contacts(instant, se, status, noise_m)
    asked = (window_before_s, window_after_s)
    feet = kink_law.FootHeights(time, heights, _windows(time, asked, LONG_WINDOWS_S))
    fits = kink_law.joint_fits(feet, near, noise_m=noise_m, gravity=gravity)
    if not kink_law.pooled_noise(fits) <= REFUTED * noise_m:
        feet = kink_law.FootHeights(time, heights, _windows(time, asked, SHORT_WINDOWS_S))
        fits = kink_law.single_fits(feet, near, noise_m=noise_m, gravity=gravity)
    return _judged(fits, status, kink_law.pooled_noise(fits), maximum_misfit)


METHODS: dict[str, Callable[..., tuple[FloatArray, FloatArray]] | None] = {
    "kink": None,
    "velocity_minimum": partial(velocity_minima, parabola=False),
    "velocity_minimum_parabola": partial(velocity_minima, parabola=True),
}


def _windows(
    time: FloatArray, asked: tuple[float | None, float | None], default: tuple[float, float]
) -> tuple[float, float]:
    """Windows before and after a contact, s: as asked, else the default; never too few frames."""
    frame_s = float(np.median(np.diff(time)))
    before, after = (d if a is None else a for a, d in zip(asked, default, strict=True))
    return max(before, 5 * frame_s), max(after, 3 * frame_s)


def _judged(fits: KinkFits, status: IntArray, noise_m: float, maximum_misfit: float) -> Contacts:
    """Mark the fits with too few frames or too large a misfit; widen errors by the misfit."""
    thin = (fits.n_before < FRAMES_BEFORE) | (fits.n_after < FRAMES_AFTER) | (fits.dof <= 0)
    thin |= ~np.isfinite(fits.unit_se)
    ratio = np.sqrt(fits.misfit / np.maximum(fits.dof, 1.0)) / noise_m
    poor = (ratio > maximum_misfit) | ~(fits.velocity < 0)
    landed = status == descents.LANDED
    status = np.where(
        landed & thin, descents.MISSING, np.where(landed & poor, descents.POOR_FIT, status)
    )
    # A misfit beyond three standard deviations of its chance value is no chance: Birge's ratio.
    chance = 1 + 3 / np.sqrt(2 * np.maximum(fits.dof, 1.0))
    se = fits.unit_se * noise_m * np.where(ratio > chance, ratio, 1.0)
    seen = status != descents.MISSING
    return Contacts(
        np.where(seen, fits.instant, np.nan), np.where(seen, se, np.nan), status, noise_m
    )
