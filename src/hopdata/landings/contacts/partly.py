"""How much of its velocity a foot may lose at once, and what that does to instants.

A light foot on a damper loses part of its velocity at once, and sinks on with the rest.
Its height hardly tells that from a foot that loses none at once but sinks less long,
whose contact would be more than a millisecond earlier.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.landings.contacts.kink import KinkFits
from hopdata.landings.contacts.law import (
    Laws,
    Trials,
    changed,
    known_gains,
    likeliest_trial,
    log_likelihood,
)
from hopdata.landings.contacts.softness import (
    OVERSURE,
    STANCE_LANDINGS,
    median_of_known,
)

#: Shares of the velocity that a contact does not take at once but as a soft one. They
#: are as close as likelihoods of 240 contacts tell. Before the data, all of them
#: together count as likely as a foot that loses nothing at once.
#: Unit: 1. Origin: chosen.
WEIGHED = (0.85, 0.7, 0.55, 0.4, 0.3, 0.2, 0.1)

#: Power of the share with which the likeliest compliance goes.
#: Unit: 1. Origin: measured: 0.33 in feet that sink by 1 to 8 mm at 1.6 m/s.
GOES_WITH = -0.33

#: Factors on that compliance which are tried first.
#: Unit: 1. Origin: chosen.
FACTORS = (0.8, 1.0, 1.25)

#: Compliances that are tried between these, each the likeliest by those before.
#: Unit: 1. Origin: chosen.
BETWEEN = 3

#: Compliances tried first of feet that are hard by the law.
#: Unit: s. Origin: chosen.
OF_HARD_S = (0.003, 0.006, 0.012)


def partly_errors(trials: Trials, fits: KinkFits, laws: Laws) -> FloatArray:
    """Return the common error (R, n), s, since feet may lose other shares at once.

    It is the root of the mean square by which instants of a foot move, over the shares
    as likely as the landings let them be. Recordings of one law share what they tell.
    """
    common = np.zeros((len(laws), fits.instant.shape[1]))
    stances = [(law.compliance_s, law.kept) for law in laws]
    for stance in sorted(set(stances)):
        same = np.array([one == stance for one in stances])
        if not np.isfinite(fits.instant[trials.at(same)]).any():
            continue
        of_same = tuple(law for law, is_one in zip(laws, same, strict=True) if is_one)
        instant = fits.instant[trials.at(same)]
        some, of_some = trials.only(same).some(instant, STANCE_LANDINGS)
        common[same] = _of_one_stance(some, of_some, of_same)
    return common


def _of_one_stance(trials: Trials, instant: FloatArray, laws: Laws) -> FloatArray:
    """Return the common error of each foot (n,), s."""
    own = log_likelihood(trials, instant, laws, widely=True)
    # How soft such a foot is, is doubted elsewhere (`softness`).
    gains = [max(_likeliest(trials, instant, laws, 1.0, own)[1], 0.0)]
    moves = [np.zeros(instant.shape[1])]
    prior = np.array([1.0, *np.full(len(WEIGHED), 1.0 / len(WEIGHED))])
    for kept in WEIGHED:
        likeliest, gain = _likeliest(trials, instant, laws, kept, own)
        moved = trials.fits(instant, likeliest, widely=True).instant - instant
        gains.append(gain)
        moves.append(np.array([median_of_known(of_foot) for of_foot in moved.T]))
    weights = prior * np.exp((np.array(gains) - max(gains)) / OVERSURE**2)
    weights /= weights.sum()
    return np.asarray(np.sqrt(weights @ np.array(moves) ** 2))


def _likeliest(
    trials: Trials, instant: FloatArray, laws: Laws, kept: float, own: FloatArray
) -> tuple[Laws, float]:
    """Return the likeliest laws with this share, and what they gain over the own."""
    tried_s = list(OF_HARD_S)
    law = laws[0]
    if law.compliance_s > 0.0:
        guess_s = law.compliance_s * (kept / law.kept) ** GOES_WITH
        tried_s = [guess_s * factor for factor in FACTORS]
    gains = [_gain(trials, instant, laws, kept, one_s, own) for one_s in tried_s]
    for _ in range(BETWEEN):
        between_s = likeliest_trial(tried_s, gains)
        if between_s in tried_s:
            break
        gain = _gain(trials, instant, laws, kept, between_s, own)
        place = int(np.searchsorted(tried_s, between_s))
        tried_s.insert(place, between_s)
        gains.insert(place, gain)
    best = int(np.argmax(gains))
    return changed(laws, compliance_s=tried_s[best], kept=kept), gains[best]


def _gain(
    trials: Trials,
    instant: FloatArray,
    laws: Laws,
    kept: float,
    compliance_s: float,
    own: FloatArray,
) -> float:
    trial = changed(laws, compliance_s=compliance_s, kept=kept)
    likelihood = log_likelihood(trials, instant, trial, widely=True)
    return float(known_gains(likelihood, own).sum())
