"""Kink fits of a study's recordings, with laws of flight and stance learned from them.

`joint_fits` fits all feet by one law. `single_fits` fits each foot alone, by the
simplest law that determines its contacts. What a foot is, soft or hard, is the same in
all recordings unless one of them clearly says otherwise; each has its own noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, BoolArray, FloatArray
from hopdata.errors import chosen
from hopdata.landings.contacts.curved import curved_errors
from hopdata.landings.contacts.kink import FlightPriors, KinkFits
from hopdata.landings.contacts.law import (
    TELLING_LOSS,
    UNDETERMINED_S,
    Law,
    Laws,
    Trials,
    changed,
    known_gains,
    likeliest_trial,
    log_likelihood,
    merged,
    noises,
)
from hopdata.landings.contacts.learning import FEW, learn, pooled_noises
from hopdata.landings.contacts.likelier import likelier_fits
from hopdata.landings.contacts.partly import partly_errors
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

#: The choice that takes the place of ``learned`` where landings are few and the body
#: falls freely: feet fall as it does, but for what their legs do.
FALLS = "falls"

#: Standard deviation of a foot's own acceleration about that of gravity then.
#: Unit: m/s^2. Origin: chosen.
FALLS_SD = 3.0

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
#: (docs/contacts_method.md), so the last lies just beyond.
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

    `gravity` is described in `hopdata.landings.contacts.timing.find_contacts`, or is
    `FALLS`.
    """
    if gravity == FALLS:
        own_mean = -GRAVITY_M_S2
        own_sd = FALLS_SD
    else:
        own_mean, own_sd = chosen("touchdowns.gravity", gravity, GRAVITIES)
    mean = np.zeros((n, 2 * n))
    mean[:, 0] = own_mean
    pushes = [WEAK_CHANGE_SD, WEAK_JERK_SD] * (n - 1)
    sd = np.tile([own_sd, *pushes, WEAK_CREEP_SD], (n, 1))
    weak = FlightPriors(mean, sd, foot_of)
    kinks = sd[:, 2:-1:2]  # a view: what is written here changes `sd`
    kinks[weak.hinged] = WEAK_KINK_SD
    return weak


@dataclass(frozen=True)
class JointFits:
    """Fits of all feet by one law, and the law.

    Parameters
    ----------
    fits : KinkFits
        Of L landings and n feet; their errors contain how soft the contacts may be.
    of_softness : (R, n) array
        The error that all contacts of a foot share since they may be softer, s.
    by_law : KinkFits
        The same fits by the law alone, of which the softness is known.
    laws, weak : Laws
        The laws of the R recordings, and those before anything was learned.
    """

    fits: KinkFits
    of_softness: FloatArray
    by_law: KinkFits
    laws: Laws
    weak: Laws


def joint_fits(
    trials: Trials, near: FloatArray, *, noise_m: FloatArray, gravity: str
) -> JointFits:
    """Fit each foot alone, learn the law from some landings, then fit all by it.

    Parameters
    ----------
    trials : Trials
        The R recordings.
    near : (L, n) array
        Rough instants, s; NaN for none.
    noise_m : (R,) array
        Standard deviation of a height in each recording, m.
    gravity : {"learned", "free", "known"}
        See `hopdata.landings.contacts.timing.find_contacts`.
    """
    n = near.shape[1]
    learns_own = gravity in ("learned", FALLS)
    weak = _laws(weak_priors(n, gravity, trials.foot_of), noise_m)
    alone = trials.fits(near, changed(weak, pushes=False), widely=True)

    laws, instant = _laws_and_instants(trials, alone, weak, own=learns_own)
    if laws[0].pushes:
        # Legs may also strike: velocities jump, as for markers of one rigid foot.
        one_foot = (0,) * n
        striking = _laws(weak_priors(n, gravity, one_foot), noise_m)
        by_strikes = _laws_and_instants(trials, alone, striking, own=learns_own)
        if _fits_better(trials, by_strikes, (laws, instant)):
            laws, instant = by_strikes
    by_law = likelier_fits(trials, trials.fits(instant, laws), laws)
    fits, of_softness = with_softness(trials, by_law, laws, alike=True)
    return JointFits(fits, of_softness, by_law, laws, weak)


def common_errors(trials: Trials, joint: JointFits) -> FloatArray:
    """Return the error (R, n), s, that all contacts of a foot may share.

    It contains how soft they are, and what the law does not describe: curves of flight,
    feet that lose part of their speed at once, and what is left beyond the noise.
    """
    parts = (
        joint.of_softness,
        _hidden_by_the_law(trials, joint.fits, joint.laws, joint.weak),
        curved_errors(trials, joint.by_law, joint.laws, joint.fits.instant),
        partly_errors(trials, joint.fits, joint.laws),
    )
    return np.asarray(np.linalg.norm(parts, axis=0))


def _laws(priors: FlightPriors, noise_m: FloatArray, *, pushes: bool = True) -> Laws:
    """Return laws that differ in their noise (R,), m, only."""
    return tuple(Law(priors, one_m, pushes=pushes) for one_m in noise_m.tolist())


def _laws_and_instants(
    trials: Trials, alone: KinkFits, start: Laws, *, own: bool
) -> tuple[Laws, FloatArray]:
    """Learn laws, and return the instants (L, n), s, of all landings by them.

    Only the instants are returned, so that memory holds one set of fits at a time.
    """
    laws = learned_laws(trials, trials.telling(alone), start, own=own)
    return laws, trials.fits(alone.instant, laws, widely=True).instant


def _fits_better(
    trials: Trials,
    other: tuple[Laws, FloatArray],
    first: tuple[Laws, FloatArray],
) -> bool:
    """Tell whether the data clearly speak for the other laws with their instants.

    A law is one of all landings, so no single contact decides, however much it gains.
    """
    laws, instant = first
    other_laws, other_instant = other
    same_noise = tuple(
        replace(one, noise_m=law.noise_m)
        for one, law in zip(other_laws, laws, strict=True)
    )
    some, instant = trials.some(instant, STANCE_LANDINGS)
    other_some, other_instant = trials.some(other_instant, STANCE_LANDINGS)
    gain = known_gains(
        log_likelihood(other_some, other_instant, same_noise),
        log_likelihood(some, instant, laws),
    )
    return bool(np.clip(gain, -STANCE_GAIN, STANCE_GAIN).sum() > TELLING_LOSS)


def _hidden_by_the_law(
    trials: Trials, fits: KinkFits, laws: Laws, weak: Laws
) -> FloatArray:
    """Return the common error (R, n), s, of what the law does not describe.

    Its misfit beyond the noise is common to all landings. A foot that turns about its
    toes creeps unevenly, so part of the creep may be softness.
    """
    falls_m_s = np.abs(fits.velocity)
    is_fitted = np.isfinite(fits.instant)
    hidden_s = np.zeros((len(laws), fits.instant.shape[1]))
    for number, (law, start) in enumerate(zip(laws, weak, strict=True)):
        own = is_fitted & (trials.of_landing == number)[:, None]
        if not own.any():
            continue
        misfit_m = np.sqrt(max(law.noise_m**2 - start.noise_m**2, 0.0))
        turns = law.creeps & start.priors.hinged.any(axis=1)
        creep_m_s = np.abs(law.priors.mean[:, -1]) * turns
        creep_m = TURN_HIDES * creep_m_s * trials.feet[number].windows_s[1]
        hidden_m = np.hypot(MISFIT_HIDES * misfit_m, creep_m)
        hidden_s[number] = hidden_m / np.median(falls_m_s[own])
    return hidden_s


def single_fits(
    trials: Trials, near: FloatArray, *, noise_m: FloatArray, gravity: str
) -> tuple[KinkFits, FloatArray]:
    """Fit each foot alone, by the simplest law that determines its contacts.

    Curvature is free (unless gravity is `known`) and windows are recentred. The first
    law is a foot that stops at once and stands. If that leaves too many of its contacts
    undetermined, the foot creeps on. If that does not suffice either, the median over
    ever softer contacts is taken. The spread of these in each landing is part of the
    standard error. A recording of few landings takes the law that all of them need.
    """
    n = near.shape[1]
    stands = _laws(weak_priors(n, gravity), noise_m, pushes=False)
    best = _alone(trials, near, stands)
    noise = pooled_noises(best, trials, noise_m)
    softness_counts = np.ones(near.shape, dtype=bool)
    rejected = _undetermined(best, near, trials, noise) > UNDETERMINED_SHARE
    for foot in np.flatnonzero(rejected.any(axis=0)).tolist():
        its = np.arange(n) == foot
        fails = trials.at(rejected[:, foot])[:, None] & its
        own = np.where(fails, near, np.nan)
        creeps = changed(stands, creeps=True, compliance_s=SOFTER_S[0])
        found = [_alone(trials, own, creeps)]
        still = _undetermined(found[0], own, trials, noise)[:, foot]
        best = merged(best, found[0], fails)
        fails = trials.at(still > UNDETERMINED_SHARE)[:, None] & fails
        if not fails.any():
            continue
        own = np.where(fails, near, np.nan)
        found += _by_softer_laws(trials, own, creeps)
        # The error of a median already contains the spread over compliances.
        softness_counts &= ~fails
        of_landing_m = trials.at(noise)
        best = merged(best, _median_law(found, foot, of_landing_m), fails)
    laws = tuple(
        replace(law, noise_m=one_m, creeps=True)
        for law, one_m in zip(stands, noise.tolist(), strict=True)
    )
    softly, common = with_softness(trials, best, laws, alike=False, of_frames_m=noise_m)
    unit_se = np.where(softness_counts, softly.unit_se, best.unit_se)
    return replace(best, unit_se=unit_se), common


def soft_fits(
    trials: Trials, near: FloatArray, *, noise_m: FloatArray, gravity: str
) -> KinkFits:
    """Fit each foot alone, by the median over ever softer contacts that creep on.

    It is the last of the laws of `single_fits`, for contacts (L, n) of which none says
    how soft they are. `noise_m` (R,) is the noise of a height, m.
    """
    n = near.shape[1]
    stands = _laws(weak_priors(n, gravity), noise_m, pushes=False)
    creeps = changed(stands, creeps=True, compliance_s=SOFTER_S[0])
    found = [_alone(trials, near, creeps), *_by_softer_laws(trials, near, creeps)]
    fits = found[0]
    for foot in range(n):
        of_foot = np.broadcast_to(np.arange(n) == foot, near.shape)
        fits = merged(fits, _median_law(found, foot, trials.at(noise_m)), of_foot)
    return fits


def _by_softer_laws(trials: Trials, near: FloatArray, creeps: Laws) -> list[KinkFits]:
    """Fit each foot alone by ever softer contacts, after a hard one that creeps."""
    return [
        _alone(trials, near, changed(creeps, compliance_s=time_s))
        for time_s in SOFTER_S[1:]
    ]


def _alone(trials: Trials, near: FloatArray, laws: Laws) -> KinkFits:
    """Fit about rough instants (L, n), s, then with windows about those found."""
    fits = trials.fits(near, laws, widely=True)
    for _ in range(RECENTRED):
        fits = trials.fits(fits.instant, laws)
    return fits


def _determined(fits: KinkFits, noise_m: FloatArray) -> BoolArray:
    """Mark the contacts (L, n) with a kink that determines their instant.

    `noise_m` (L,) is the noise of a height, m.
    """
    sure = noise_m[:, None] * fits.unit_se < UNDETERMINED_S
    comes_down = fits.velocity < 0
    return np.asarray(sure & comes_down)


def _undetermined(
    fits: KinkFits, near: FloatArray, trials: Trials, noise_m: FloatArray
) -> FloatArray:
    """Return each foot's share of undetermined contacts (R, n), but one in ten.

    That of a recording with few landings is the share in all. `noise_m` is (R,).
    """
    wanted = np.isfinite(near)
    without = wanted & ~_determined(fits, trials.at(noise_m))
    count = np.stack([own.sum(axis=0) for own in trials.each(wanted)])
    failed = np.stack([own.sum(axis=0) for own in trials.each(without)])
    count = np.where(count < FEW, count.sum(axis=0), count)
    failed = np.where(count < FEW, failed.sum(axis=0), failed)
    forgiven = count >= ODD_ONE_OF
    return np.asarray((failed - forgiven) / np.maximum(count, 1))


def _median_law(found: Sequence[KinkFits], foot: int, noise_m: FloatArray) -> KinkFits:
    """Return the fits whose instants of a foot are nearest to the median over the laws.

    They get the median instant. The standard error includes the spread of the instants
    over the laws. `noise_m` (L,) is the noise of a height, m.
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


def learned_laws(trials: Trials, instant: FloatArray, laws: Laws, *, own: bool) -> Laws:
    """Learn laws from landings with these instants (L, n), s, from weak priors on.

    Parameters
    ----------
    trials : Trials
        The recordings.
    instant : (L, n) array
        Instants of the landings to learn from, s; NaN where they tell nothing.
    laws : Laws
        The laws with weak priors.
    own : bool
        Whether to learn the feet's own accelerations.
    """
    trials, instant = trials.some(instant, LEARNING_LANDINGS)
    weak = laws
    for step in range(LEARNING_STEPS):
        some, of_some = trials.some(instant, STANCE_LANDINGS)
        if step == STEP_OF_STANCE:
            start = _with_priors_of(laws, weak)
            stances = _with_stance(some, of_some, start)
            # Priors learned with a hard contact would keep it hard, so they start anew.
            laws = tuple(
                stance
                if stance.compliance_s > 0
                else replace(stance, priors=law.priors)
                for stance, law in zip(stances, laws, strict=True)
            )
        elif step > STEP_OF_STANCE:
            laws = _refined(some, of_some, laws)
        fits = trials.fits(instant, laws)
        instant = fits.instant
        is_last = step == LEARNING_STEPS - 1
        laws = _one_step(trials, fits, laws, weak, own=own, sharpen=is_last)
    some, of_some = trials.some(instant, STANCE_LANDINGS)
    laws = _refined(some, of_some, laws)
    free = changed(laws, pushes=False)
    gain = known_gains(
        log_likelihood(some, of_some, laws), log_likelihood(some, of_some, free)
    )
    # Weak pushes hardly pay for their extra freedom, but leaving them out makes errors
    # larger than stated. Keeping them where there are none only widens the stated
    # errors. So they are dropped only if the data speak against them.
    if gain.sum() > -TELLING_LOSS:
        return laws
    return free


def _with_priors_of(laws: Laws, others: Laws) -> Laws:
    """Return the laws with the priors of others."""
    pairs = zip(laws, others, strict=True)
    return tuple(replace(law, priors=other.priors) for law, other in pairs)


def _one_step(
    trials: Trials,
    fits: KinkFits,
    laws: Laws,
    weak: Laws,
    *,
    own: bool,
    sharpen: bool = False,
) -> Laws:
    """Learn noise and priors from fits by the laws; `weak` has the noise of heights."""
    noise_m = pooled_noises(fits, trials, noises(weak))
    priors = learn(
        fits,
        noise_m=noise_m,
        priors=[law.priors for law in laws],
        of_landing=trials.of_landing,
        own=own,
        sharpen=sharpen,
    )
    return tuple(
        replace(law, priors=prior, noise_m=one_m)
        for law, prior, one_m in zip(laws, priors, noise_m.tolist(), strict=True)
    )


def _with_stance(trials: Trials, instant: FloatArray, laws: Laws) -> Laws:
    """Give laws a soft contact or creeping feet, if landings (L, n) ask for it.

    All recordings have the same, except those in which another stance is clearly
    likelier, as on another floor.
    """
    stances: list[Laws] = []  # all that were tried, and their likelihoods
    likelihoods: list[FloatArray] = []
    best = laws
    best_likelihood = log_likelihood(trials, instant, laws)
    tried: Sequence[Laws] = ()
    totals_of_best: list[float] = []
    for creeps in (False, True):
        totals: list[float] = []
        of_recordings: list[FloatArray] = []
        of_these: list[Laws] = []
        for compliance_s in COMPLIANCES_S:
            trial = changed(laws, compliance_s=compliance_s, creeps=creeps)
            if creeps:
                fits = trials.fits(instant, trial)
                learned = _one_step(trials, fits, trial, laws, own=False)
                trial = _with_priors_of(trial, learned)
            likelihood = log_likelihood(trials, instant, trial)
            of_these.append(trial)
            stances.append(trial)
            likelihoods.append(likelihood)
            totals.append(float(np.nansum(likelihood)))
            gain = known_gains(likelihood, best_likelihood)
            if gain.sum() > STANCE_GAIN + STANCE_GAIN_PER_FIT * len(gain):
                best = trial
                best_likelihood = likelihood
                totals_of_best = totals  # the same list, which grows with the trials
                tried = of_these
            of_recordings.append(_of_each(trials, likelihood))
            is_worse = of_recordings[-1] < np.max(of_recordings, axis=0)
            if is_worse.all():  # than one before, in every recording
                break
    if best[0].compliance_s > 0.0:
        tried_s = [one[0].compliance_s for one in tried]
        best = changed(best, compliance_s=likeliest_trial(tried_s, totals_of_best))
    return _own_stances(trials, best, best_likelihood, stances, likelihoods)


def _own_stances(
    trials: Trials,
    best: Laws,
    best_likelihood: FloatArray,
    stances: Sequence[Laws],
    likelihoods: Sequence[FloatArray],
) -> Laws:
    """Give a recording a stance of its own where that is clearly likelier there.

    Once one differs for sure, as on another floor or in other shoes, the others may
    have its stance, too, if it gains them more than chance.

    `stances` were tried, with their `likelihoods`, each (L, n).
    """
    gains = np.array(
        [_of_each(trials, likelihood - best_likelihood) for likelihood in likelihoods]
    )
    n_fits = _of_each(trials, np.isfinite(best_likelihood))
    chance = STANCE_GAIN + STANCE_GAIN_PER_FIT * n_fits
    is_sure = gains.max(axis=0) > np.maximum(chance, TELLING_LOSS)
    if not is_sure.any() or len(best) == 1:
        return best  # no recording says that it differs from the others
    likeliest = np.argmax(gains, axis=0)
    known = np.unique(likeliest[is_sure])
    likeliest_known = known[np.argmax(gains[known], axis=0)]
    likeliest = np.where(is_sure, likeliest, likeliest_known)
    numbers = np.arange(len(best))
    is_own = is_sure | (gains[likeliest, numbers] > chance)
    return tuple(
        stances[which][number] if differs else best[number]
        for number, (which, differs) in enumerate(zip(likeliest, is_own, strict=True))
    )


def _of_each(trials: Trials, values: FloatArray | BoolArray) -> FloatArray:
    """Return the sum of the known values (L, n) of each recording, (R,)."""
    return np.array([np.nansum(own) for own in trials.each(values)], dtype=float)


def _refined(trials: Trials, instant: FloatArray, laws: Laws) -> Laws:
    """Adjust the compliances of soft contacts to the laws learned with them.

    Recordings of one stance are adjusted together, but one to which another compliance
    is clearly likelier: with weak priors it may not have been sure.
    """
    for factors in REFINEMENTS:
        refined_s = {}
        of_factors = [_softer(laws, factor) for factor in factors]
        stances_s = sorted({law.compliance_s for law in laws} - {0.0})
        if not stances_s:
            return laws
        likelihoods = [log_likelihood(trials, instant, trial) for trial in of_factors]
        best_likelihood = likelihoods[factors.index(1.0)].copy()
        for own_s in stances_s:
            rows = trials.at(np.array([law.compliance_s == own_s for law in laws]))
            totals = [float(np.nansum(likelihood[rows])) for likelihood in likelihoods]
            trials_s = [own_s * factor for factor in factors]
            refined_s[own_s] = likeliest_trial(trials_s, totals)
            best_likelihood[rows] = likelihoods[int(np.argmax(totals))][rows]
        laws = tuple(
            replace(law, compliance_s=refined_s.get(law.compliance_s, 0.0))
            for law in laws
        )
        laws = _own_stances(trials, laws, best_likelihood, of_factors, likelihoods)
    return laws


def _softer(laws: Laws, factor: float) -> Laws:
    """Return the laws with their compliances times a factor."""
    return tuple(replace(law, compliance_s=law.compliance_s * factor) for law in laws)
