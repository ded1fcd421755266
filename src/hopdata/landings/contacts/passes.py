"""The passes of the kink fit: one law where it holds, each foot alone where not.

All recordings of a study are fitted together. A recording in which the law fails takes
no part in learning that of the others.

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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray
from hopdata.landings.contacts import kink_law
from hopdata.landings.contacts.judged import REFUTED, is_odd
from hopdata.landings.contacts.kink import WINDOW_FRAMES, KinkFits
from hopdata.landings.contacts.law import FRAMES_AFTER, Trials, merged, taken
from hopdata.landings.contacts.learning import FEW, pooled_noise, pooled_noises

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

Windows = tuple[float, float]
FitTogether = Callable[..., kink_law.JointFits]
FitAlone = Callable[..., tuple[KinkFits, FloatArray]]

#: Computes the errors (R, n), s, that all contacts of a foot may share. It takes as
#: long as the fits, so it is called only for those that are kept.
CommonErrors = Callable[[], FloatArray]


@dataclass(frozen=True)
class Fitted:
    """Kink fits of L landings and n feet after a pass.

    Parameters
    ----------
    trials : Trials
        The R recordings, with their windows about a contact.
    near : (L, n) array
        Rough instants about which contacts were searched, s.
    fits : KinkFits
        One for each contact.
    rises : (L, n) bool array
        Whether the foot leaves the floor right after its contact.
    """

    trials: Trials
    near: FloatArray
    fits: KinkFits
    rises: BoolArray


def fit_contacts(
    trials: Trials,
    near: FloatArray,
    landed: BoolArray,
    *,
    short_windows_s: Sequence[Windows],
    noise_m: FloatArray,
    gravity: str,
) -> tuple[Fitted, CommonErrors]:
    """Fit contacts by one law where it holds, and alone in short windows where not.

    Parameters
    ----------
    trials : Trials
        The R recordings, with the windows in which the law should hold.
    near : (L, n) array
        Rough instants of the contacts, s; NaN for none.
    landed : (L, n) bool array
        Where a foot came down from above.
    short_windows_s : sequence of tuple of float
        Windows before and after a contact of a foot that is fitted alone, s, in each
        recording.
    noise_m : (R,) array
        Standard deviation of a height in each recording, m.
    gravity : str
        See `hopdata.landings.contacts.timing.find_contacts`.
    """
    fit_together = partial(kink_law.joint_fits, noise_m=noise_m, gravity=gravity)
    fit_alone = partial(kink_law.single_fits, noise_m=noise_m, gravity=gravity)

    first, joint = _fit_by_one_law(trials, near, fit_together)
    stands = first.fits.n_after >= FRAMES_AFTER
    holds = _law_holds(first, stands, landed, noise_m)
    if not holds.any():
        short = _in_short_windows(first.trials, short_windows_s)
        alone, common = fit_alone(short, first.near)
        return Fitted(short, first.near, alone, first.rises), lambda: common
    if not holds.all():
        parts = []
        for some in (holds, ~holds):
            numbers = np.flatnonzero(some).tolist()
            part = fit_contacts(
                trials.only(some),
                near[trials.at(some)],
                landed[trials.at(some)],
                short_windows_s=[short_windows_s[number] for number in numbers],
                noise_m=noise_m[some],
                gravity=gravity,
            )
            parts.append(part)
        return _side_by_side(holds, *parts)

    lawful, joint = _without_odd_landings(first, joint, fit_together, noise_m)
    fitted = _with_exceptions_alone(lawful, short_windows_s, fit_alone, noise_m)
    return fitted, partial(kink_law.common_errors, lawful.trials, joint)


def _law_holds(
    first: Fitted, stands: BoolArray, landed: BoolArray, noise_m: FloatArray
) -> BoolArray:
    """Tell in which recordings (R,) feet follow the law and stand after contacts.

    A recording of few landings goes with the contacts of all.
    """
    trials = first.trials
    relative = replace(
        first.fits, misfit=first.fits.misfit / trials.at(noise_m)[:, None] ** 2
    )
    holds = []
    for number, landings in enumerate(trials.landings):
        rows = trials.of_landing == number
        if landings < FEW:
            rows = np.ones_like(rows)
        standing = stands[rows][landed[rows]]
        most_stand = standing.sum() > LEAST_STANDING * standing.size
        refuted = pooled_noise(taken(relative, rows)) > REFUTED
        holds.append(most_stand and not refuted)
    return np.array(holds)


def _side_by_side(
    which: BoolArray,
    of_some: tuple[Fitted, CommonErrors],
    of_others: tuple[Fitted, CommonErrors],
) -> tuple[Fitted, CommonErrors]:
    """Put the fits of some of the recordings (R,) and of the others in their order."""
    some, common_of_some = of_some
    others, common_of_others = of_others
    feet = np.empty(len(which), dtype=object)
    feet[which] = some.trials.feet
    feet[~which] = others.trials.feet
    landings = _in_order(which, some.trials.landings, others.trials.landings)
    trials = Trials.of(feet.tolist(), landings)
    rows = trials.at(which)
    fits = {
        name: _in_order(rows, value, vars(others.fits)[name])
        for name, value in vars(some.fits).items()
    }
    fitted = Fitted(
        trials,
        near=_in_order(rows, some.near, others.near),
        fits=KinkFits(**fits),
        rises=_in_order(rows, some.rises, others.rises),
    )
    return fitted, lambda: _in_order(which, common_of_some(), common_of_others())


def _in_order(
    which: BoolArray, some: NDArray[Any], others: NDArray[Any]
) -> NDArray[Any]:
    """Return values of some and of the others, as `which` says."""
    both = np.empty((len(which), *some.shape[1:]), dtype=some.dtype)
    both[which] = some
    both[~which] = others
    return both


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


def _fit_by_one_law(
    trials: Trials, near: FloatArray, fit: FitTogether
) -> tuple[Fitted, kink_law.JointFits]:
    """Fit all contacts, and again from the earliest instant where the search missed."""
    none_rises = np.zeros(near.shape, dtype=bool)
    joint = fit(trials, near)
    # A kink upwards comes after the contact: the search began too late.
    earliest = trials.earliest
    missed = (joint.fits.velocity > 0) & np.isfinite(earliest)
    if missed.any():
        near = np.where(missed, earliest, near)
        joint = fit(trials, near)
    return Fitted(trials, near, joint.fits, none_rises), joint


def _are_odd(fitted: Fitted, noise_m: FloatArray) -> BoolArray:
    """Mark the contacts (L, n) that break the law of the others."""
    trials = fitted.trials
    about_fit_m = pooled_noises(fitted.fits, trials, noise_m)
    return is_odd(fitted.fits, trials.at(about_fit_m)[:, None])


def _without_odd_landings(
    first: Fitted, joint: kink_law.JointFits, fit: FitTogether, noise_m: FloatArray
) -> tuple[Fitted, kink_law.JointFits]:
    """Fit again where a few odd landings have bent the law of the others."""
    odd_landings = np.asarray(_are_odd(first, noise_m).any(axis=1, keepdims=True))
    if not 0 < odd_landings.sum() < MOST_ODD * len(odd_landings):
        return first, joint
    others = replace(first.trials, odd=odd_landings)
    again = fit(others, first.near)
    return replace(first, trials=others, fits=again.fits), again


def _with_exceptions_alone(
    lawful: Fitted,
    short_windows_s: Sequence[Windows],
    fit: FitAlone,
    noise_m: FloatArray,
) -> Fitted:
    """Fit alone the contacts that break the law of the others.

    A marker may also rise right after its contact, such as toes while the heel comes
    down, so that too few frames are left for the law.
    """
    odd = _are_odd(lawful, noise_m)
    rises = lawful.fits.n_after < FRAMES_AFTER
    if not (rises | odd).any():
        return lawful
    short = _in_short_windows(lawful.trials, short_windows_s)
    alone, _ = fit(short, lawful.near)
    # A foot that rises may come down again, which is no contact of this landing.
    after_s = lawful.trials.at(np.array([after_s for _, after_s in short_windows_s]))
    rises &= np.abs(alone.instant - lawful.fits.instant) < after_s[:, None]
    fits = merged(lawful.fits, alone, rises | odd)
    return replace(lawful, fits=fits, rises=rises)


def _in_short_windows(trials: Trials, short_windows_s: Sequence[Windows]) -> Trials:
    """Return the data with shorter windows, in which no foot leaves the floor again."""
    feet = tuple(
        replace(one, windows_s=own, leaves_m=np.inf)
        for one, own in zip(trials.feet, short_windows_s, strict=True)
    )
    return replace(trials, feet=feet)
