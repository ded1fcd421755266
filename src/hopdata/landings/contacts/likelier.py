"""Contacts sought once more by the learned law, from where a foot can touch on.

The likelihood of an instant may have several tops. The first fit knows no law yet, and
after a gap that hides most of the flight, a soft contact looks to it like a flight that
is slowed. Later fits search about its instant only, and so stay at the wrong top.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.landings.contacts.judged import frames_missing, is_odd
from hopdata.landings.contacts.kink import KinkFits
from hopdata.landings.contacts.law import (
    FRAMES_AFTER,
    FRAMES_BEFORE,
    UNDETERMINED_S,
    WIDE_SEARCH_S,
    Laws,
    Trials,
    noises,
    taken,
)

#: Instants that differ by less lie at one top of the likelihood.
#: Unit: s. Origin: chosen: some four standard errors.
SAME_TOP_S = 2e-3


def likelier_fits(trials: Trials, fits: KinkFits, laws: Laws) -> KinkFits:
    """Return the fits by the laws, at other instants where these are likelier.

    Contacts (L, n) that lack frames, or break the law, are sought from their earliest
    instant on. All feet of a landing are fitted anew if one of them moves, since each
    acts on the others. The error of a contact with a second top contains the choice.
    """
    earliest = trials.earliest_until(fits.instant)
    asked = _lack_frames(trials, fits.instant)
    asked |= is_odd(fits, trials.at(noises(laws))[:, None])
    asked &= np.isfinite(earliest) & np.isfinite(fits.instant)
    rows = np.asarray(asked.any(axis=1))
    if not rows.any():
        return fits
    asked = asked[rows]
    some = Trials(trials.feet, trials.of_landing[rows])
    first = taken(fits, rows)
    near = np.where(asked, earliest[rows] + WIDE_SEARCH_S, first.instant)
    other = some.fits(some.fits(near, laws, widely=True).instant, laws)
    apart_s = np.abs(other.instant - first.instant)
    two_tops = asked & (apart_s > SAME_TOP_S) & _is_seen(some, other, laws)
    # Before all that the first fit sees of the flight, another landing may lie.
    two_tops &= apart_s < some.at(_windows_before(some))[:, None]
    if not two_tops.any():
        return fits
    of_other = np.where(two_tops, _share_of_other(some, first, other, laws), 0.0)
    instant = np.where(of_other > 0.5, other.instant, first.instant)
    chosen = some.fits(instant, laws)
    wrong = np.minimum(of_other, 1.0 - of_other)
    choice_s = np.sqrt(wrong) * np.nan_to_num(apart_s)
    unit_choice = choice_s / some.at(noises(laws))[:, None]
    chosen = replace(chosen, unit_se=np.hypot(chosen.unit_se, unit_choice))
    moves = np.asarray(two_tops.any(axis=1))
    rows[rows] = moves
    return _with_rows(fits, taken(chosen, moves), rows)


def _is_seen(trials: Trials, fits: KinkFits, laws: Laws) -> BoolArray:
    """Mark the contacts (L, n) with frames on both sides that determine the instant."""
    enough = (fits.n_before >= FRAMES_BEFORE) & (fits.n_after >= FRAMES_AFTER)
    se = fits.unit_se * trials.at(noises(laws))[:, None]
    return np.asarray(enough & (se < UNDETERMINED_S))


def _windows_before(trials: Trials) -> FloatArray:
    """Return how long before a contact each recording (R,) is looked at, s."""
    return np.array([feet.windows_s[0] for feet in trials.feet])


def _lack_frames(trials: Trials, instant: FloatArray) -> BoolArray:
    """Mark the contacts (L, n) with hidden frames in the windows about them."""
    parts = zip(trials.feet, trials.each(instant), strict=True)
    return np.concatenate(
        [
            frames_missing(feet.time, feet.heights, own, feet.windows_s)
            for feet, own in parts
        ]
    )


def _share_of_other(
    trials: Trials, first: KinkFits, other: KinkFits, laws: Laws
) -> FloatArray:
    """Return the probability (L, n) of the other of two tops of the likelihood.

    A top weighs as much as its likelihood times its width.
    """
    from scipy.special import expit

    noise_m = trials.at(noises(laws))[:, None]
    gain = (first.evidence - other.evidence) / (2 * noise_m**2)
    with np.errstate(invalid="ignore", divide="ignore"):  # undetermined: infinite
        gain += np.log(other.unit_se / first.unit_se)
    return np.asarray(np.nan_to_num(expit(gain)))


def _with_rows(fits: KinkFits, others: KinkFits, rows: BoolArray) -> KinkFits:
    """Return the fits with those of some landings (L,) replaced."""
    together = {}
    for name, value in vars(fits).items():
        both = value.copy()
        both[rows] = vars(others)[name]
        together[name] = both
    return KinkFits(**together)
