"""How soft a contact may be beside what the law says, and what that does to instants.

Few landings cannot distinguish a hard contact from a soft one, which shifts all
instants of a foot. The likelihoods of other compliances limit what it can be.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.landings.contacts.kink import KinkFits
from hopdata.landings.contacts.law import (
    TELLING_LOSS,
    Laws,
    Trials,
    changed,
    noises,
    taken,
)
from hopdata.landings.contacts.learning import FEW
from hopdata.landings.contacts.springs_back import springs_back, springs_back_errors

#: Landings, evenly spaced, whose likelihood decides on stance and softness.
#: Unit: landings. Origin: chosen.
STANCE_LANDINGS = 120

#: Compliances whose likelihood is taken beside 0 and the law's own.
#: Unit: s. Origin: chosen.
SOFTNESS_S = (0.001, 0.002, 0.003, 0.0045, 0.0065, 0.009, 0.013)

#: Smallest step from the law's own compliance to the next that is tried.
#: Unit: s. Origin: chosen.
LEAST_STEP_S = 3e-4

#: The same step, as a share of the law's own compliance.
#: Unit: 1. Origin: chosen.
STEP_SHARE = 0.1

#: A compliance of the list is left out if it is nearer than this to the law's own, in
#: such steps.
#: Unit: steps. Origin: chosen.
APART_STEPS = 1.5

#: Number of compliances, evenly spaced, at which the posterior is evaluated.
#: Unit: 1. Origin: chosen.
SOFTNESS_NODES = 1001

#: Prior odds of a soft against a hard contact.
#: Unit: 1. Origin: chosen: docs/contacts_method.md, "Two errors".
SOFTNESS_ODDS = 6.0

#: Standard deviations from zero at which a contact is surely soft; instants then move
#: to the mean compliance.
#: Unit: standard deviations. Origin: chosen.
SURE_OF_SOFT = 2.0

#: Factor on the standard deviation of the compliance, since the likelihood takes the
#: learned law for known.
#: Unit: 1. Origin: measured: on three simulated animals (`few_rows` of
#: benchmarks/contact_instants.py, table in docs/contacts_method.md).
OVERSURE = 1.3

#: Share of the compliance added to the common error, since no foot stops exactly
#: exponentially.
#: Unit: 1. Origin: measured: on the same animals
#: (benchmarks/contact_instants.py).
SHAPE_SHARE = 0.03

#: An instant that moves by this much more than the compliance explains lies in a gap,
#: so it does not speak.
#: Unit: s. Origin: chosen.
JUMP_S = 1e-3


def with_softness(
    trials: Trials,
    fits: KinkFits,
    laws: Laws,
    *,
    alike: bool,
    of_frames_m: FloatArray | None = None,
) -> tuple[KinkFits, FloatArray]:
    """Add the uncertainty of the compliance to the errors.

    If feet are `alike`, the likelihoods of all of them limit one compliance, in all
    recordings whose laws have the same one. Else each foot has its own, in each
    recording of enough landings.

    What the laws leave beyond the noise of the heights by their frames, `of_frames_m`
    (R,), m, is the same in all landings, so that more of them tell no more.

    If feet are alike and surely soft, their instants are those of the mean compliance.

    Returns
    -------
    fits : KinkFits
        With the part of the error that differs between landings in `unit_se`.
    common : (R, n) array
        The error that all landings of a foot share, s.
    """
    own_s = np.array([law.compliance_s for law in laws])
    instant = fits.instant.copy()
    unit_se = fits.unit_se.copy()
    common = np.zeros((len(laws), instant.shape[1]))
    for one_s in np.unique(own_s):
        same = own_s == one_s
        rows = trials.at(same)
        of_same = tuple(law for law in laws if law.compliance_s == one_s)
        repeated = np.zeros(len(of_same))
        if of_frames_m is not None:
            repeated = _repeated(of_same, of_frames_m[same])
        found = _of_one_stance(
            trials.only(same), taken(fits, rows), of_same, repeated, alike=alike
        )
        instant[rows], unit_se[rows], common[same] = found
    return replace(fits, instant=instant, unit_se=unit_se), common


def _repeated(laws: Laws, of_frames_m: FloatArray) -> FloatArray:
    """Return the share (R,) of the variance about the laws that is not noise."""
    return np.maximum(1.0 - (of_frames_m / noises(laws)) ** 2, 0.0)


def _of_one_stance(
    trials: Trials, fits: KinkFits, laws: Laws, repeated: FloatArray, *, alike: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return instants, their errors and common errors where the laws are as soft."""
    own_s = laws[0].compliance_s
    trials_s = _trials(own_s)
    softer = [changed(laws, compliance_s=time_s) for time_s in trials_s.tolist()]
    gains = _gains(trials, fits, softer)
    if alike:
        gains[:] = gains.sum(axis=(1, 2), keepdims=True)
    else:
        few = trials.landings < FEW
        gains[:, few] = gains.sum(axis=1, keepdims=True)
    mean, sd = _posterior(trials_s, gains)
    allowed_s = np.hypot(mean - own_s, sd).max()
    moved = _moved(trials, fits, softer, own_s, allowed_s)
    shift = _usual(trials, moved, alike=alike)
    moved = np.where(np.isfinite(moved), moved, trials.at(shift))

    surely_soft = alike & (mean > SURE_OF_SOFT * sd)
    better = np.where(surely_soft, mean, own_s)
    instant = fits.instant + moved * trials.at(better - own_s)
    doubt = np.hypot(mean - better, sd)

    centre = shift
    if alike:  # feet that shift differently may swap places
        centre = np.broadcast_to(shift.mean(axis=1, keepdims=True), shift.shape)
    noise_m = trials.at(noises(laws))[:, None]
    beside = (moved - trials.at(centre)) * trials.at(doubt)
    error = np.hypot(fits.unit_se, beside / noise_m)
    if alike:
        # The law was learned from a finite number of landings, so it errs itself.
        landings = np.isfinite(instant).any(axis=1).sum()
        error *= np.sqrt(1 + 1 / max(landings, 1))
    common = np.hypot(shift * doubt, SHAPE_SHARE * mean)
    if repeated.any():
        # The errors of single landings are kept: they scatter by no more than stated.
        told_once = gains / _landings_of_one(trials, fits, repeated)
        mean, sd = _posterior(trials_s, told_once)
        doubt = np.hypot(mean - own_s, sd)
        moved = _moved(trials, fits, softer, own_s, doubt.max())
        shift = _usual(trials, moved, alike=alike)
        wider = np.hypot(shift * doubt, SHAPE_SHARE * mean)
        common = np.maximum(common, wider)
    yields_s = _of_soles_that_yield(trials, fits, instant, laws, better)
    return instant, error, np.hypot(common, yields_s)


def _of_soles_that_yield(
    trials: Trials,
    fits: KinkFits,
    instant: FloatArray,
    laws: Laws,
    compliance_s: FloatArray,
) -> FloatArray:
    """Return the common error (R, n), s, of feet that sink and spring back.

    `compliance_s` (R, n) is that of the instants (L, n), s.
    """
    errors = []
    falls = trials.each(np.abs(fits.velocity))
    parts = zip(trials.feet, trials.each(instant), laws, strict=True)
    for number, (feet, own, law) in enumerate(parts):
        depth_m = springs_back(feet.time, feet.heights, own, law.noise_m)
        fall_m_s = np.array([median_of_known(of_foot) for of_foot in falls[number].T])
        fall_m_s = np.where(fall_m_s > 0, fall_m_s, np.inf)
        errors.append(springs_back_errors(depth_m, fall_m_s, compliance_s[number]))
    return np.array(errors)


def _moved(
    trials: Trials,
    fits: KinkFits,
    softer: list[Laws],
    own_s: float,
    allowed_s: float,
) -> FloatArray:
    """Return how far instants (L, n) move with the compliance, 1.

    By the trial whose distance from the law's own compliance, s, is most like the
    distance that the posterior allows.
    """
    trials_s = np.array([laws[0].compliance_s for laws in softer])
    away = np.where(trials_s == own_s, np.inf, np.abs(trials_s - own_s))
    nearest = int(np.argmin(np.abs(away - allowed_s)))
    moved = trials.fits(fits.instant, softer[nearest], widely=True).instant
    moved -= fits.instant
    return np.asarray(moved / (float(trials_s[nearest]) - own_s))


def _landings_of_one(
    trials: Trials, fits: KinkFits, repeated: FloatArray
) -> FloatArray:
    """Return how many landings tell as much as one that repeats nothing, (R, n).

    Of residuals of which a share is the same in all landings, the mean over n landings
    has the variance of one times (1 + (n - 1) share) / n.
    """
    known = np.isfinite(fits.instant)
    count = np.stack([own.sum(axis=0) for own in trials.each(known)])
    count[trials.landings < FEW] = count.sum(axis=0)
    count = np.clip(count, 1, STANCE_LANDINGS)
    return np.asarray(1.0 + (count - 1) * repeated[:, None])


def _usual(trials: Trials, values: FloatArray, *, alike: bool) -> FloatArray:
    """Return the usual value of each foot in each recording, (R, n), from (L, n).

    It is that of all recordings if they are `alike`, or where one has few landings.
    """
    of_all = np.array([median_of_known(of_foot) for of_foot in values.T])
    usual = np.tile(of_all, (len(trials.feet), 1))
    if alike:
        return usual
    for number, own in enumerate(trials.each(values)):
        if len(own) >= FEW:
            usual[number] = [median_of_known(of_foot) for of_foot in own.T]
    return usual


def _trials(own_s: float) -> FloatArray:
    """Return compliances to try, (K,), s: the law's own, those beside it, others."""
    step_s = max(STEP_SHARE * own_s, LEAST_STEP_S)
    trials = {max(own_s - step_s, 0.0), own_s, own_s + step_s}
    for time_s in (0.0, *SOFTNESS_S):
        if abs(time_s - own_s) > APART_STEPS * step_s:
            trials.add(time_s)
    return np.array(sorted(trials))


def _gains(trials: Trials, fits: KinkFits, softer: list[Laws]) -> FloatArray:
    """Return the log likelihood of each trial, recording and foot, (K, R, n)."""
    noise_m = noises(softer[0])
    some, instant = trials.some(trials.telling(fits), STANCE_LANDINGS)
    found = [some.fits(instant, laws) for laws in softer]
    each = np.array([one.evidence for one in found])
    each /= -2 * some.at(noise_m)[:, None] ** 2
    instants = np.array([one.instant for one in found])
    compliances = np.array([laws[0].compliance_s for laws in softer])
    # Jumps of instants count only between likely trials: at far too soft ones they jump
    # anyway.
    total = np.nansum(each, axis=(1, 2))
    likely = total > total.max() - TELLING_LOSS
    steady = _steady(compliances[likely], instants[likely])
    speaks = steady & np.isfinite(each).all(axis=0)
    spoken = np.where(speaks, each, 0.0)
    return np.stack(
        [
            spoken[:, some.of_landing == number].sum(axis=1)
            for number in range(len(noise_m))
        ],
        axis=1,
    )


def _steady(compliances_s: FloatArray, instants: FloatArray) -> BoolArray:
    """Mark contacts (L, n) whose instants (K, L, n) follow the compliance (K,)."""
    moves = np.abs(np.diff(instants, axis=0))
    explained = 2 * np.diff(compliances_s)[:, None, None]
    return np.asarray((moves < explained + JUMP_S).all(axis=0))


def median_of_known(values: FloatArray) -> float:
    """Return the median of the values that are known, 0 if none is."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0
    return float(np.median(known))


def _posterior(
    trials_s: FloatArray, gains: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return means and sds (...) of compliances, s.

    The log likelihoods (K, ...) of trials (K,) are interpolated by a cubic spline. Its
    third derivative jumps at the inner trials except the outermost (not-a-knot).
    Loading SciPy's spline would take a short study longer than judging all its
    contacts.
    """
    time_s = np.linspace(0, trials_s[-1], SOFTNESS_NODES)
    of_each = gains.reshape(len(trials_s), -1)
    coefficients = np.linalg.solve(_spline_basis(trials_s, trials_s), of_each)
    spline = _spline_basis(trials_s, time_s) @ coefficients
    gain = _held(spline, time_s, trials_s, of_each) / OVERSURE**2
    prior = np.full(len(time_s), SOFTNESS_ODDS / len(time_s))
    prior[0] = 1.0
    weights = prior[:, None] * np.exp(gain - gain.max(axis=0))
    weights /= weights.sum(axis=0)
    mean = time_s @ weights
    variance = ((time_s[:, None] - mean) ** 2 * weights).sum(axis=0)
    sd = np.sqrt(variance)
    return mean.reshape(gains.shape[1:]), sd.reshape(gains.shape[1:])


def _held(
    spline: FloatArray, time_s: FloatArray, trials_s: FloatArray, of_each: FloatArray
) -> FloatArray:
    """Return a spline (N, C) of log likelihoods, held between its trials (K, C).

    Beside a trial that is far less likely a spline overshoots, by more than any data
    gain: between hard and 0.3 ms if 1 ms costs a thousand. Only beside the likeliest of
    the inner trials may the maximum lie, and by as much as its neighbours lack.
    """
    next_one = np.searchsorted(trials_s, time_s, side="right")
    next_one = np.clip(next_one, 1, len(trials_s) - 1)
    ends = of_each[next_one - 1], of_each[next_one]
    most = np.maximum(*ends)
    for column, gains in enumerate(of_each.T):
        best = int(np.argmax(gains))
        if 0 < best < len(gains) - 1:
            lack = gains[best] - max(gains[best - 1], gains[best + 1])
            is_beside = (next_one == best) | (next_one == best + 1)
            most[is_beside, column] += lack
    return np.clip(spline, np.minimum(*ends), most)


def _spline_basis(trials_s: FloatArray, at_s: FloatArray) -> FloatArray:
    """Return the columns of a cubic spline through K trials at other times, (., K)."""
    share = at_s[:, None] / trials_s[-1]
    jumps = trials_s[2:-2] / trials_s[-1]
    return np.hstack([share ** np.arange(4), np.maximum(share - jumps, 0.0) ** 3])
