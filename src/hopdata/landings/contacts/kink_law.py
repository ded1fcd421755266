"""Kink fits of a whole recording, with laws of flight and stance learned from it.

`joint_fits` fits all feet by one law. `single_fits` fits each foot alone, by the
simplest law that determines its contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, BoolArray, FloatArray
from hopdata.errors import chosen
from hopdata.landings.contacts.kink import FlightPriors, KinkFits
from hopdata.landings.contacts.law import (
    TELLING_LOSS,
    UNDETERMINED_S,
    FootHeights,
    Law,
    known_gains,
    log_likelihood,
    merged,
    some_landings,
)
from hopdata.landings.contacts.learning import learn, pooled_noise
from hopdata.landings.contacts.softness import STANCE_LANDINGS, with_softness

# --- Priors before anything is learned, wide enough for a few landings to overrule ----

#: Standard deviation of an acceleration that is no prior at all.
#: Unit: m/s^2. Origin: chosen.
FLAT_SD = 1e4

#: Standard deviation of an acceleration that is known.
#: Unit: m/s^2. Origin: chosen.
SHARP_SD = 1e-3

# Mean and standard deviation of a foot's own acceleration in flight, m/s^2, by the
# user's choice.
GRAVITIES = {
    "learned": (0.0, FLAT_SD),
    "free": (0.0, FLAT_SD),
    "known": (-GRAVITY_M_S2, SHARP_SD),
}

#: Standard deviation of the change of a foot's acceleration when another touches:
#: about three times gravity.
#: Unit: m/s^2. Origin: chosen.
WEAK_CHANGE_SD = 30.0

#: Standard deviation of the change of its jerk: it would build up three times gravity
#: in 60 ms.
#: Unit: m/s^3. Origin: chosen.
WEAK_JERK_SD = 500.0

#: Standard deviation of the velocity at which a standing foot sinks or rises.
#: Unit: m/s. Origin: chosen.
WEAK_CREEP_SD = 0.1

#: Standard deviation of the change of a marker's velocity when another marker of its
#: foot touches: the speed after a fall from half a metre.
#: Unit: m/s. Origin: chosen.
WEAK_KINK_SD = 3.0

# --- Learning -------------------------------------------------------------------------

#: Rounds of fitting and learning.
#: Unit: 1. Origin: chosen.
LEARNING_STEPS = 6

# Round in which stance is decided.
STEP_OF_STANCE = 2

#: Landings, evenly spaced, that teach flight; more would sharpen no prior that matters.
#: Unit: landings. Origin: chosen.
LEARNING_LANDINGS = 400

#: Compliances tried for the law of stance. One of more than 10 ms is not believed
#: (docs/contacts.md), so the last lies just beyond.
#: Unit: s. Origin: chosen.
COMPLIANCES_S = (0.0, 0.002, 0.004, 0.006, 0.009, 0.013)

#: Gain of log likelihood that a soft or creeping contact needs in total, to exceed
#: chance.
#: Unit: 1 (log likelihood). Origin: chosen.
STANCE_GAIN = 6.0

#: Gain that it needs per fit as well: a smaller one moves an instant by only a small
#: part of its standard error.
#: Unit: 1 (log likelihood). Origin: chosen.
STANCE_GAIN_PER_FIT = 0.15

#: Factors on a compliance that are tried once the law with it is learned, round by
#: round.
#: Unit: 1. Origin: chosen.
REFINEMENTS = ((0.7, 1.0, 1.4), (0.9, 1.0, 1.1))

# --- Common errors --------------------------------------------------------------------

#: Common error for a law that leaves residuals beyond the noise, as of a foot that
#: rolls: this many times the time in which the foot falls by them.
#: Unit: 1. Origin: chosen.
MISFIT_HIDES = 2.0

#: Common error of a foot that turns about its toes: the time in which it falls by this
#: share of its creep in the window after the contact.
#: Unit: 1. Origin: chosen.
TURN_HIDES = 0.5

# --- Feet fitted alone ----------------------------------------------------------------

#: Share of undetermined contacts above which a foot's law is rejected.
#: Unit: 1. Origin: chosen.
UNDETERMINED_SHARE = 0.025

#: Number of contacts from which on one undetermined contact is forgiven.
#: Unit: contacts. Origin: chosen.
ODD_ONE_OF = 10

#: Compliances tried for a foot whose first law is rejected; the median over them is
#: taken.
#: Unit: s. Origin: chosen.
SOFTER_S = (0.0, 0.003, 0.006, 0.009, 0.013)

#: Times that the windows of a foot fitted alone are centred anew on its instants.
#: Unit: 1. Origin: chosen.
RECENTRED = 3


def weak_priors(n: int, gravity: str, foot_of: tuple[int, ...] = ()) -> FlightPriors:
    """Return priors of n feet before anything is learned.

    `gravity` is described in `hopdata.landings.contacts.find.find_contacts`.
    """
    own_mean, own_sd = chosen("touchdowns.gravity", gravity, GRAVITIES)
    mean = np.zeros((n, 2 * n))
    mean[:, 0] = own_mean
    pushes = [WEAK_CHANGE_SD, WEAK_JERK_SD] * (n - 1)
    sd = np.tile([own_sd, *pushes, WEAK_CREEP_SD], (n, 1))
    weak = FlightPriors(mean, sd, foot_of)
    kinks = sd[:, 2:-1:2]  # a view: what is written here changes `sd`
    kinks[weak.hinged] = WEAK_KINK_SD
    return weak


def joint_fits(
    feet: FootHeights, near: FloatArray, *, noise_m: float, gravity: str
) -> tuple[KinkFits, FloatArray]:
    """Fit each foot alone, learn the law from some landings, then fit all by it.

    Parameters
    ----------
    feet : FootHeights
        The recording.
    near : (L, n) array
        Rough instants, s; NaN for none.
    noise_m : float
        Standard deviation of a height, m.
    gravity : {"learned", "free", "known"}
        See `hopdata.landings.contacts.find.find_contacts`.

    Returns
    -------
    fits : KinkFits
    common : (n,) array
        Error that all contacts of a foot may share, s.
    """
    n = feet.heights.shape[1]
    learns_own = gravity == "learned"
    weak = Law(weak_priors(n, gravity, feet.foot_of), noise_m)
    alone = feet.fits(near, replace(weak, pushes=False), widely=True)

    law, instant = _law_and_instants(feet, alone, weak, own=learns_own)
    if law.pushes:
        # Legs may also strike: velocities jump, as for markers of one rigid foot.
        one_foot = (0,) * n
        striking = replace(weak, priors=weak_priors(n, gravity, one_foot))
        strikes, struck = _law_and_instants(feet, alone, striking, own=learns_own)
        if _fits_better(feet, (strikes, struck), (law, instant)):
            law = strikes
            instant = struck
    fits, common = with_softness(feet, feet.fits(instant, law), law, alike=True)
    hidden_s = _hidden_by_the_law(feet, fits, law, weak, noise_m)
    return fits, np.hypot(common, hidden_s)


def _law_and_instants(
    feet: FootHeights, alone: KinkFits, start: Law, *, own: bool
) -> tuple[Law, FloatArray]:
    """Learn a law, and return the instants (L, n), s, of all landings by it.

    Only the instants are returned, so that memory holds one set of fits at a time.
    """
    law = learned_law(feet, feet.telling(alone), start, own=own)
    return law, feet.fits(alone.instant, law, widely=True).instant


def _fits_better(
    feet: FootHeights,
    other: tuple[Law, FloatArray],
    first: tuple[Law, FloatArray],
) -> bool:
    """Tell whether the data clearly speak for the other law with its instants."""
    law, instant = first
    other_law, other_instant = other
    same_noise = replace(other_law, noise_m=law.noise_m)
    some = some_landings(instant, STANCE_LANDINGS)
    other_some = some_landings(other_instant, STANCE_LANDINGS)
    gain = known_gains(
        log_likelihood(feet, other_some, same_noise), log_likelihood(feet, some, law)
    )
    return bool(gain.sum() > TELLING_LOSS)


def _hidden_by_the_law(
    feet: FootHeights, fits: KinkFits, law: Law, weak: Law, noise_m: float
) -> FloatArray:
    """Return the common error (n,), s, of what the law does not describe.

    Its misfit beyond the noise is common to all landings. A foot that turns about its
    toes creeps unevenly, so part of the creep may be softness.
    """
    falls_m_s = np.abs(fits.velocity[np.isfinite(fits.instant)])
    if not len(falls_m_s):
        return np.zeros(len(law.priors.mean))
    misfit_m = np.sqrt(max(law.noise_m**2 - noise_m**2, 0.0))
    turns = law.creeps & weak.priors.hinged.any(axis=1)
    creep_m_s = np.abs(law.priors.mean[:, -1]) * turns
    creep_m = TURN_HIDES * creep_m_s * feet.windows_s[1]
    hidden_m = np.hypot(MISFIT_HIDES * misfit_m, creep_m)
    return np.asarray(hidden_m / np.median(falls_m_s))


def single_fits(
    feet: FootHeights, near: FloatArray, *, noise_m: float, gravity: str
) -> tuple[KinkFits, FloatArray]:
    """Fit each foot alone, by the simplest law that determines its contacts.

    Curvature is free (unless gravity is `known`) and windows are recentred. The first
    law is a foot that stops at once and stands. If that leaves too many of its contacts
    undetermined, the foot creeps on. If that does not suffice either, the median over
    ever softer contacts is taken. The spread of these in each landing is part of the
    standard error.
    """
    n = near.shape[1]
    stands = Law(weak_priors(n, gravity), noise_m, pushes=False)
    best = _alone(feet, near, stands)
    noise = pooled_noise(best)
    softness_counts = np.ones(n, dtype=bool)
    rejected = _undetermined(best, near, noise) > UNDETERMINED_SHARE
    for foot in np.flatnonzero(rejected):
        its = np.full(near.shape, np.arange(n) == foot)
        own = np.where(its, near, np.nan)
        creeps = replace(stands, creeps=True, compliance_s=SOFTER_S[0])
        found = [_alone(feet, own, creeps)]
        if _undetermined(found[0], own, noise)[foot] > UNDETERMINED_SHARE:
            for time_s in SOFTER_S[1:]:
                found.append(_alone(feet, own, replace(creeps, compliance_s=time_s)))
            # The error of a median already contains the spread over compliances.
            softness_counts[foot] = False
        best = merged(best, _median_law(found, int(foot), noise), its)
    law = replace(stands, noise_m=noise, creeps=True)
    softly, common = with_softness(feet, best, law, alike=False)
    unit_se = np.where(softness_counts, softly.unit_se, best.unit_se)
    return replace(best, unit_se=unit_se), common


def _alone(feet: FootHeights, near: FloatArray, law: Law) -> KinkFits:
    """Fit about rough instants (L, n), s, then with windows about those found."""
    fits = feet.fits(near, law, widely=True)
    for _ in range(RECENTRED):
        fits = feet.fits(fits.instant, law)
    return fits


def _determined(fits: KinkFits, noise_m: float) -> BoolArray:
    """Mark the contacts (L, n) with a kink that determines their instant."""
    sure = noise_m * fits.unit_se < UNDETERMINED_S
    comes_down = fits.velocity < 0
    return np.asarray(sure & comes_down)


def _undetermined(fits: KinkFits, near: FloatArray, noise_m: float) -> FloatArray:
    """Return each foot's share of undetermined contacts (n,), but one in ten."""
    wanted = np.isfinite(near)
    count = wanted.sum(axis=0)
    without = (wanted & ~_determined(fits, noise_m)).sum(axis=0)
    forgiven = count >= ODD_ONE_OF
    return np.asarray((without - forgiven) / np.maximum(count, 1))


def _median_law(found: Sequence[KinkFits], foot: int, noise_m: float) -> KinkFits:
    """Return the fits whose instants of a foot are nearest to the median over the laws.

    They get the median instant. The standard error includes the spread of the instants
    over the laws.
    """
    known = np.stack([_determined(fits, noise_m)[:, foot] for fits in found])
    instant = np.ma.array([fits.instant[:, foot] for fits in found], mask=~known)
    error = np.ma.array([fits.unit_se[:, foot] for fits in found], mask=~known)
    middle = np.ma.median(instant, axis=0)
    spread = np.ma.mean((instant - middle) ** 2, axis=0) / noise_m**2
    variance = np.ma.median(error**2, axis=0) + spread
    nearest = np.ma.argmin(np.ma.abs(instant - middle), axis=0, fill_value=np.inf)
    rows = np.arange(len(nearest))
    kept = {}
    for name in vars(found[0]):
        of_each_law = np.stack([vars(fits)[name] for fits in found])
        kept[name] = of_each_law[nearest, rows]
    fits = KinkFits(**kept)
    some = known.any(axis=0)
    fits.instant[some, foot] = np.asarray(middle[some])
    fits.unit_se[some, foot] = np.sqrt(np.asarray(variance[some]))
    return fits


def learned_law(feet: FootHeights, instant: FloatArray, law: Law, *, own: bool) -> Law:
    """Learn the law from landings with these instants (L, n), s, from weak priors on.

    Parameters
    ----------
    feet : FootHeights
        The recording.
    instant : (L, n) array
        Instants of the landings to learn from, s; NaN where they tell nothing.
    law : Law
        The law with weak priors.
    own : bool
        Whether to learn the feet's own accelerations.
    """
    instant = some_landings(instant, LEARNING_LANDINGS)
    weak = law.priors
    for step in range(LEARNING_STEPS):
        some = some_landings(instant, STANCE_LANDINGS)
        if step == STEP_OF_STANCE:
            stance = _with_stance(feet, some, replace(law, priors=weak))
            if stance.compliance_s > 0:
                # Priors learned with a hard contact would keep it hard, so they start
                # anew.
                law = replace(stance, priors=weak)
            else:
                law = replace(stance, priors=law.priors)
        elif step > STEP_OF_STANCE:
            law = _refined(feet, some, law)
        fits = feet.fits(instant, law)
        instant = fits.instant
        is_last = step == LEARNING_STEPS - 1
        law = _one_step(fits, law, own=own, sharpen=is_last)
    some = some_landings(instant, STANCE_LANDINGS)
    law = _refined(feet, some, law)
    free = replace(law, pushes=False)
    gain = known_gains(
        log_likelihood(feet, some, law), log_likelihood(feet, some, free)
    )
    # Weak pushes hardly pay for their extra freedom, but leaving them out makes errors
    # larger than stated. Keeping them where there are none only widens the stated
    # errors. So they are dropped only if the data speak against them.
    if gain.sum() > -TELLING_LOSS:
        return law
    return free


def _one_step(fits: KinkFits, law: Law, *, own: bool, sharpen: bool = False) -> Law:
    """Learn noise and priors from fits by the law."""
    noise_m = pooled_noise(fits)
    priors = learn(fits, noise_m=noise_m, prior=law.priors, own=own, sharpen=sharpen)
    return replace(law, priors=priors, noise_m=noise_m)


def _with_stance(feet: FootHeights, instant: FloatArray, law: Law) -> Law:
    """Give the law a soft contact or creeping feet, if landings (L, n) ask for it."""
    best = law
    best_likelihood = log_likelihood(feet, instant, law)
    totals_of_best = [-np.inf]
    for creeps in (False, True):
        totals: list[float] = []
        for compliance_s in COMPLIANCES_S:
            trial = replace(law, compliance_s=compliance_s, creeps=creeps)
            if creeps:
                learned = _one_step(feet.fits(instant, trial), trial, own=False)
                trial = replace(trial, priors=learned.priors)
            likelihood = log_likelihood(feet, instant, trial)
            totals.append(float(np.nansum(likelihood)))
            gain = known_gains(likelihood, best_likelihood)
            if gain.sum() > STANCE_GAIN + STANCE_GAIN_PER_FIT * len(gain):
                best = trial
                best_likelihood = likelihood
                totals_of_best = totals  # the same list, which grows with the trials
            if totals[-1] < max(totals):  # worse than the one before
                break
    if best.compliance_s == 0.0:
        return best
    tried = COMPLIANCES_S[: len(totals_of_best)]
    return replace(best, compliance_s=_likeliest_trial(tried, totals_of_best))


def _refined(feet: FootHeights, instant: FloatArray, law: Law) -> Law:
    """Adjust the compliance of a soft contact to the law learned with it."""
    if law.compliance_s == 0.0:
        return law
    for factors in REFINEMENTS:
        trials_s = [law.compliance_s * factor for factor in factors]
        totals = []
        for time_s in trials_s:
            trial = replace(law, compliance_s=time_s)
            totals.append(float(np.nansum(log_likelihood(feet, instant, trial))))
        law = replace(law, compliance_s=_likeliest_trial(trials_s, totals))
    return law


def _likeliest_trial(trials: Sequence[float], totals: Sequence[float]) -> float:
    """Return the trial of maximum likelihood, by a parabola through the best three."""
    x = np.array(trials)
    y = np.array(totals)
    middle = int(np.clip(np.argmax(y), 1, len(x) - 2))
    near = slice(middle - 1, middle + 2)
    bend, slope, _ = np.polyfit(x[near] - x[middle], y[near], 2)
    if bend < 0:
        likeliest = x[middle] - slope / (2 * bend)
    else:
        likeliest = x[int(np.argmax(y))]
    return float(np.clip(likeliest, x[middle - 1], x[middle + 1]))
