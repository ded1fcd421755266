"""What a law of constant acceleration hides of feet whose fall is curved.

The swing of a leg may end with a jerk, which bends the fall before the contact. The law
of the fall, a parabola, then times all contacts of a foot late or early. Here the same
contacts are fitted with an acceleration that is free in each landing, and with a jerk
that a foot's contacts have in common. How far the instants move, beyond chance, is what
the law hides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hopdata.arrays import SD_PER_MAD, BoolArray, FloatArray
from hopdata.landings.contacts.kink import WIDEST, FlightPriors, KinkFits
from hopdata.landings.contacts.law import FootHeights, Laws, Trials, noises
from hopdata.landings.contacts.learning import FEW

#: Standard deviation of an acceleration that is free.
#: Unit: m/s^2. Origin: chosen.
FREE_SD = 1e4

#: Landings, evenly spaced, that tell the jerk of a study's feet.
#: Unit: landings. Origin: chosen.
JERK_LANDINGS = 120

#: Jerk that is tried, in units of the noise over the window's length cubed. It bends
#: the heights away from any parabola by about the noise.
#: Unit: 1. Origin: derived: the Legendre polynomial of degree 3 in a cubic.
BENDS = 120.0

#: Newton's steps towards the likeliest jerk.
#: Unit: 1. Origin: chosen.
NEWTON_STEPS = 4

#: Longest of these steps, in units of the jerk that is tried.
#: Unit: 1. Origin: chosen.
LONGEST_STEP = 5.0

#: Least curvature of the log likelihood by the jerk, in the same units: with less, no
#: jerk is told.
#: Unit: 1. Origin: chosen.
LEAST_BEND = 1.0

#: Shares of the law's compliance that are tried with a jerk.
#: Unit: 1. Origin: chosen.
SHARES_OF_SOFTNESS = (0.0, 0.5, 1.0)

#: Length of the heights that are freed of a jerk, over the widest window that a fit
#: takes before the contact, so that none of its frames is left out.
#: Unit: 1. Origin: chosen.
REACH = 1.1

#: Variance of a median over that of a mean, of normal errors.
#: Unit: 1. Origin: derived: the half of pi.
OF_MEDIAN = np.pi / 2

#: Standard deviations by which a foot's instants must move together, to exceed chance.
#: Unit: standard deviations. Origin: chosen.
MOVES_SIGMAS = 2.0


def curved_errors(
    trials: Trials, fits: KinkFits, laws: Laws, softly: FloatArray
) -> FloatArray:
    """Return the error that all contacts of a foot share, (R, n), s.

    A fall that is slowed before the contact looks like a soft contact. So harder ones
    are tried as well, and each counts as far as the data prefer it.

    Parameters
    ----------
    trials : Trials
        The R recordings.
    fits : KinkFits
        Their contacts (L, n) by the laws.
    laws : tuple of Law
        The law of each recording.
    softly : (L, n) array
        The instants with the softness that the data ask for (`with_softness`), s.
    """
    told = np.where(np.isfinite(trials.telling(fits)), softly, np.nan)
    some, instant = trials.some(told, JERK_LANDINGS)
    # Instants are earlier by as much as contacts are softer.
    earlier_s, _ = _medians(trials, fits.instant - softly, np.isfinite(told))
    soft_s = [law.compliance_s for law in laws] + earlier_s.mean(axis=1)
    soft_s = np.maximum(soft_s, 0.0)
    shares = SHARES_OF_SOFTNESS if soft_s.any() else (1.0,)
    free = _free(laws)
    squares = []
    gains = []
    for share in shares:
        own_s = (share * soft_s).tolist()
        harder = [
            replace(law, compliance_s=time_s)
            for law, time_s in zip(free, own_s, strict=True)
        ]
        bent = _with_jerk(some, instant, tuple(harder))
        excess = bent.shift**2 - bent.variance
        moves = bent.shift**2 > MOVES_SIGMAS**2 * bent.variance
        squares.append(np.where(moves, excess, 0.0))
        gains.append(bent.gain)
    weights = np.exp(np.array(gains) - max(gains))
    weights /= weights.sum()
    return np.asarray(np.sqrt(np.tensordot(weights, np.array(squares), axes=1)))


def _free(laws: Laws) -> Laws:
    """Return the laws with an acceleration that is free in each landing."""
    free = []
    for law in laws:
        sd = law.priors.sd.copy()
        sd[:, 0] = FREE_SD
        priors = FlightPriors(law.priors.mean, sd, law.priors.foot_of)
        free.append(replace(law, priors=priors))
    return tuple(free)


@dataclass(frozen=True)
class _Bent:
    """What a jerk that all contacts of a foot have does to them.

    Parameters
    ----------
    gain : float
        Log likelihood of all contacts with the likeliest jerks, but a constant.
    shift, variance : (R, n) array
        How far the instants of each foot move, s, and its variance by chance, s^2.
    """

    gain: float
    shift: FloatArray
    variance: FloatArray


def _with_jerk(some: Trials, instant: FloatArray, free: Laws) -> _Bent:
    """Fit contacts (L, n) with the likeliest jerk of each foot, by Newton's steps."""
    jerk = np.zeros((len(free), instant.shape[1]))  # in units of `_unit`
    for _ in range(NEWTON_STEPS):
        about = _about(some, instant, free, jerk)
        jerk = jerk + about.step
        if np.all(np.abs(about.step) < 1):
            break
    by_jerk, _ = _medians(some, about.moves, about.known)
    moved, by_chance = _medians(some, about.fits.instant - instant, about.known)
    rest = about.slope - some.at(about.step) * about.bend
    scatter = _sums(some, rest**2, about.known) / about.total_bend**2
    jerk_variance = np.maximum(scatter, 1 / about.total_bend)
    at_step = float((about.step**2 * about.total_bend).sum() / 2)
    return _Bent(
        gain=about.likelihood + at_step,
        shift=moved + about.step * by_jerk,
        variance=by_chance + jerk_variance * by_jerk**2,
    )


@dataclass(frozen=True)
class _About:
    """The log likelihood about a jerk of each foot, in units of `_unit`.

    Parameters
    ----------
    fits : KinkFits
        The contacts (L, n) with this jerk.
    known : (L, n) bool array
        Contacts that tell something of it.
    slope, bend : (L, n) array
        First derivative of each contact's log likelihood, and its negative second one.
    moves : (L, n) array
        How far an instant moves by a unit more, s.
    total_bend, step : (R, n) array
        The sum of `bend` over a foot's contacts, and Newton's step from here.
    likelihood : float
        Log likelihood of all contacts, but a constant.
    """

    fits: KinkFits
    known: BoolArray
    slope: FloatArray
    bend: FloatArray
    moves: FloatArray
    total_bend: FloatArray
    step: FloatArray
    likelihood: float


def _about(some: Trials, instant: FloatArray, free: Laws, jerk: FloatArray) -> _About:
    """Fit contacts (L, n) with a jerk (R, n) of each foot, a unit less, and more."""
    unit = _unit(some, free)[:, None]
    less, fits, more = [
        _bent(some, instant, (jerk + step) * unit).fits(instant, free, widely=True)
        for step in (-1.0, 0.0, 1.0)
    ]
    # The evidence is a sum of squares.
    variance = 2 * some.at(noises(free))[:, None] ** 2
    slope = (less.evidence - more.evidence) / (2 * variance)
    bend = (less.evidence + more.evidence - 2 * fits.evidence) / variance
    known = np.isfinite(slope) & np.isfinite(bend)
    total_bend = np.maximum(_sums(some, bend, known), LEAST_BEND)
    step = _sums(some, slope, known) / total_bend
    return _About(
        fits=fits,
        known=known,
        slope=slope,
        bend=bend,
        moves=(more.instant - less.instant) / 2,
        total_bend=total_bend,
        step=np.clip(step, -LONGEST_STEP, LONGEST_STEP),
        likelihood=float(np.where(known, -fits.evidence / variance, 0.0).sum()),
    )


def _unit(some: Trials, free: Laws) -> FloatArray:
    """Return the jerk that is tried in each recording (R,), m/s^3."""
    return np.array(
        [
            BENDS * law.noise_m / feet.windows_s[0] ** 3
            for law, feet in zip(free, some.feet, strict=True)
        ]
    )


def _bent(trials: Trials, instant: FloatArray, jerk: FloatArray) -> Trials:
    """Return the recordings without jerks (R, n), m/s^3, before instants (L, n), s."""
    feet = []
    for one, own, jerk_m_s3 in zip(
        trials.feet, trials.each(instant), jerk, strict=True
    ):
        feet.append(_without_jerk(one, own, jerk_m_s3))
    return replace(trials, feet=tuple(feet))


def _without_jerk(
    feet: FootHeights, instant: FloatArray, jerk: FloatArray
) -> FootHeights:
    """Return the heights of one recording without the jerk (n,) of each foot."""
    heights = feet.heights.copy()
    reach_s = WIDEST * feet.windows_s[0]
    for landing, foot in np.argwhere(np.isfinite(instant)).tolist():
        touch_s = instant[landing, foot]
        span = slice(*np.searchsorted(feet.time, [touch_s - REACH * reach_s, touch_s]))
        since = feet.time[span] - touch_s
        heights[span, foot] = feet.heights[span, foot] - jerk[foot] * since**3 / 6
    return replace(feet, heights=heights)


def _sums(trials: Trials, values: FloatArray, known: BoolArray) -> FloatArray:
    """Return each foot's sum in each recording (R, n); in all, where one has few."""
    parts = trials.each(np.where(known, values, 0.0))
    sums = np.stack([own.sum(axis=0) for own in parts])
    few = trials.landings < FEW
    sums[few] = sums.sum(axis=0)
    return sums


def _medians(
    trials: Trials, values: FloatArray, known: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return medians (R, n) of each foot, and their variances; of all, where few."""
    medians = np.zeros((len(trials.feet), values.shape[1]))
    variances = np.zeros_like(medians)
    for number, own in enumerate(trials.each(np.where(known, values, np.nan))):
        if len(own) < FEW:
            own = np.where(known, values, np.nan)
        for foot, column in enumerate(own.T):
            each = column[np.isfinite(column)]
            if len(each) < 2:
                continue
            middle = np.median(each)
            sd = SD_PER_MAD * np.median(np.abs(each - middle))
            medians[number, foot] = middle
            variances[number, foot] = OF_MEDIAN * sd**2 / len(each)
    return medians, variances
