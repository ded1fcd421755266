"""The passes of the kink fit: one law where it holds, each foot alone where not.

The law is that feet fly freely, push one another through the body, and then stand. It
may fail in the whole recording (a runner's foot rolls) or in single contacts (a leg
still swings, toes lift while the heel comes down). The passes are, in this order:

1. all contacts by one law, again from the earliest possible instant where the search
   began too late;
2. if the law does not hold, each foot alone in short windows, and that is all;
3. all contacts again, without the odd landings that have bent the law;
4. the contacts that still break the law alone, in short windows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.landings.contacts import kink_law
from hopdata.landings.contacts.judged import REFUTED, is_odd
from hopdata.landings.contacts.kink import WINDOW_FRAMES, KinkFits
from hopdata.landings.contacts.law import FRAMES_AFTER, FootHeights, merged
from hopdata.landings.contacts.learning import pooled_noise

#: Windows before and after a contact if the law holds. Longer ones hold more frames,
#: and so give smaller errors.
#: Unit: s. Origin: chosen.
LONG_WINDOWS_S = (0.08, 0.05)

#: Windows before and after a contact if the law does not hold: half as long.
#: Unit: s. Origin: chosen.
SHORT_WINDOWS_S = (0.04, 0.027)

#: Share of the contacts that must have frames after them for the feet to stand.
#: Unit: 1. Origin: chosen.
LEAST_STANDING = 0.5

#: Share of landings with odd contacts from which on they are not the exception: the
#: law is then learned from all landings.
#: Unit: 1. Origin: chosen.
MOST_ODD = 0.5

Fit = Callable[[FootHeights, FloatArray], tuple[KinkFits, FloatArray]]


@dataclass(frozen=True)
class Fitted:
    """Kink fits of L landings and n feet after a pass.

    Parameters
    ----------
    feet : FootHeights
        The data, and the windows about a contact.
    near : (L, n) array
        Rough instants about which contacts were searched, s.
    fits : KinkFits
        One for each contact.
    common : (n,) array
        Error that all contacts of a foot may share, s.
    rises : (L, n) array or False
        Whether the foot leaves the floor right after its contact.
    """

    feet: FootHeights
    near: FloatArray
    fits: KinkFits
    common: FloatArray
    rises: BoolArray | bool = False


def fit_contacts(
    feet: FootHeights,
    near: FloatArray,
    landed: BoolArray,
    *,
    short_windows_s: tuple[float, float],
    noise_m: float,
    gravity: str,
) -> Fitted:
    """Fit contacts by one law where it holds, and alone in short windows where not.

    Parameters
    ----------
    feet : FootHeights
        The data, with the windows in which the law should hold.
    near : (L, n) array
        Rough instants of the contacts, s; NaN for none.
    landed : (L, n) bool array
        Where a foot came down from above.
    short_windows_s : tuple of float
        Windows before and after a contact of a foot that is fitted alone, s.
    noise_m : float
        Standard deviation of a height, m.
    gravity : str
        See `hopdata.landings.contacts.find.find_contacts`.
    """
    fit_together = partial(kink_law.joint_fits, noise_m=noise_m, gravity=gravity)
    fit_alone = partial(kink_law.single_fits, noise_m=noise_m, gravity=gravity)

    first = _fit_by_one_law(feet, near, fit_together)
    stands = first.fits.n_after[landed] >= FRAMES_AFTER
    most_stand = stands.sum() > LEAST_STANDING * stands.size
    refuted = pooled_noise(first.fits) > REFUTED * noise_m
    if refuted or not most_stand:
        short = _in_short_windows(first.feet, short_windows_s)
        alone, common = fit_alone(short, first.near)
        return Fitted(short, first.near, alone, common)

    lawful = _without_odd_landings(first, fit_together)
    some_rise = stands.mean() < 1 - kink_law.UNDETERMINED_SHARE  # more than by chance
    return _with_exceptions_alone(lawful, some_rise, short_windows_s, fit_alone)


def windows_of_at_least(
    time: FloatArray,
    asked_s: tuple[float | None, float | None],
    default_s: tuple[float, float],
) -> tuple[float, float]:
    """Return the windows about a contact, s, widened to hold `WINDOW_FRAMES`."""
    before_s, after_s = asked_s
    if before_s is None:
        before_s = default_s[0]
    if after_s is None:
        after_s = default_s[1]
    frame_s = float(np.median(np.diff(time)))
    least_before_s = WINDOW_FRAMES[0] * frame_s
    least_after_s = WINDOW_FRAMES[1] * frame_s
    return max(before_s, least_before_s), max(after_s, least_after_s)


def _fit_by_one_law(feet: FootHeights, near: FloatArray, fit: Fit) -> Fitted:
    """Fit all contacts, and again from the earliest instant where the search missed."""
    fits, common = fit(feet, near)
    # A kink upwards comes after the contact: the search began too late.
    missed = (fits.velocity > 0) & np.isfinite(feet.earliest)
    if not missed.any():
        return Fitted(feet, near, fits, common)
    earlier = np.where(missed, feet.earliest, near)
    fits, common = fit(feet, earlier)
    return Fitted(feet, earlier, fits, common)


def _without_odd_landings(first: Fitted, fit: Fit) -> Fitted:
    """Fit again where a few odd landings have bent the law of the others."""
    odd_landings = np.asarray(is_odd(first.fits).any(axis=1, keepdims=True))
    if not 0 < odd_landings.sum() < MOST_ODD * len(odd_landings):
        return first
    others = replace(first.feet, odd=odd_landings)
    fits, common = fit(others, first.near)
    return Fitted(others, first.near, fits, common)


def _with_exceptions_alone(
    lawful: Fitted, some_rise: bool, short_windows_s: tuple[float, float], fit: Fit
) -> Fitted:
    """Fit alone the contacts that break the law of the others.

    A marker may also rise right after its contact, such as toes while the heel comes
    down, so that too few frames are left for the law.
    """
    odd = is_odd(lawful.fits)
    rises = (lawful.fits.n_after < FRAMES_AFTER) & some_rise
    exceptions = np.asarray(rises | odd)
    if not exceptions.any():
        return lawful
    short = _in_short_windows(lawful.feet, short_windows_s)
    alone, _ = fit(short, lawful.near)
    fits = merged(lawful.fits, alone, exceptions)
    return replace(lawful, fits=fits, rises=rises)


def _in_short_windows(
    feet: FootHeights, short_windows_s: tuple[float, float]
) -> FootHeights:
    """Return the data with shorter windows, in which no foot leaves the floor again."""
    return replace(feet, windows_s=short_windows_s, leaves_m=np.inf)
