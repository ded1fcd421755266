"""Kink fits of a whole recording, with laws of flight and stance learned from it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, BoolArray, FloatArray
from hopdata.errors import chosen
from hopdata.landings.contacts.descents import LEAST_NOISE_M
from hopdata.landings.contacts.kink import FlightPriors, KinkFits, kink_fits

# What the kink fits of a recording reveal about its feet: noise, and laws of flight and
# stance.
#
# This is empirical Bayes: the distribution of a coefficient of the law over all
# landings is the prior of its value in each landing.

Part = tuple[
    FloatArray, FloatArray, float, float
]  # posteriors of an entry, and its prior
Distribution = tuple[float, float] | None  # mean and sd; None if too little is known

# Ratio of posterior to prior variance above which a landing is uninformative: for
# pooled posteriors (mixtures), and for the data without the prior.
TELLING, TELLING_ALONE = 0.9, 0.5
FEW = 8  # fewest landings from which an entry is learned on its own
OUTLYING = 4.0  # standard deviations beyond which outliers are clipped
LEAST_SHARE = (
    1e-3  # smallest sd that one step of learning may give, in sds of the prior
)
CANDIDATES = 60  # number of sds tried


def pooled_noise(fits: KinkFits) -> float:
    """Estimate the standard deviation of a height about its fit, m, from the median of all fits.

    The result is never less than `LEAST_NOISE_M`.
    """
    use = fits.dof > 1
    if not use.any():
        return float("nan")
    dof = fits.dof[use]
    median = (
        dof * (1 - 2 / (9 * dof)) ** 3
    )  # Wilson and Hilferty's median of chi-squared
    return max(float(np.sqrt(np.median(fits.misfit[use] / median))), LEAST_NOISE_M)


def learn(
    fits: KinkFits,
    *,
    noise_m: float,
    prior: FlightPriors,
    own: bool = True,
    sharpen: bool = False,
) -> FlightPriors:
    """Take one step towards the distributions behind the laws of flight and stance.

    Pushes are confounded with one another, so they take a step of expectation
    maximisation, which narrows wide priors slowly and safely. All other entries go
    straight to the distribution of maximum restricted likelihood, and so do the pushes
    in a last step with `sharpen`. A foot's own acceleration is learned from the
    landings in which it touched first, since no leg has pushed there. Entries with few
    informative landings take the pooled distribution of all entries of their kind, or
    stay as they were.

    Parameters
    ----------
    fits : KinkFits
        Fits made under `prior`.
    noise_m : float
        Standard deviation of a foot's height, m.
    prior : FlightPriors
        The prior of those fits.
    own : bool
        Whether to learn the feet's own accelerations as well.
    sharpen : bool
        Whether to take the pushes to their maximum likelihood.

    Returns
    -------
    FlightPriors
    """
    value, variance = fits.flight, (fits.unit_flight_se * noise_m) ** 2
    first = np.where(np.isnan(fits.instant), np.inf, fits.instant).argmin(axis=1)
    not_first = first[:, None] != np.arange(len(prior.mean))
    variance[:, :, 0] = np.where(not_first | (not own), np.inf, variance[:, :, 0])
    mean, sd, n = prior.mean.copy(), prior.sd.copy(), len(prior.mean)
    kinds = np.tile([0, *[1, 2] * (n - 1), 5], (n, 1))  # own, changes, jerks, creep
    kinds[:, 1:-1] += 2 * np.repeat(
        prior.hinged, 2, axis=1
    )  # 3 and 4 for the same foot
    for kind in np.unique(kinds):
        pushes, entries = 0 < kind < 5, np.argwhere(kinds == kind).tolist()
        known: Any = (value, variance, prior.mean, prior.sd)
        parts = [tuple(one[..., i, j] for one in known) for i, j in entries]
        found = (
            _mixtures(parts)
            if pushes and not sharpen
            else _likeliest(parts, wider=pushes)
        )
        for (i, j), behind in zip(entries, found, strict=True):
            if behind:
                mean[i, j], sd[i, j] = (
                    behind[0],
                    max(behind[1], LEAST_SHARE * prior.sd[i, j]),
                )
    return FlightPriors(mean, sd, prior.foot_of)


def _mixtures(parts: list[Part]) -> list[Distribution]:
    """Take one step of expectation maximisation for each entry of a kind: mix its posteriors."""
    use = [
        (variance < TELLING * sd**2) & np.isfinite(value)
        for value, variance, _, sd in parts
    ]
    telling = [
        (part[0][known], part[1][known]) for part, known in zip(parts, use, strict=True)
    ]
    pooled = _mixture(*(np.concatenate(part) for part in zip(*telling, strict=True)))
    return [_mixture(*part) or pooled for part in telling]


def _likeliest(parts: list[Part], *, wider: bool) -> list[Distribution]:
    """Return the distributions behind the entries of a kind, from the data without the prior."""
    telling = []
    for value, variance, mean, sd in parts:
        use = (variance < TELLING_ALONE * sd**2) & np.isfinite(value)
        alone = 1 / (1 / variance[use] - 1 / sd**2)
        telling.append((alone * (value[use] / variance[use] - mean / sd**2), alone))
    pooled = _restricted(
        *(np.concatenate(p) for p in zip(*telling, strict=True)), wider=wider
    )
    return [_restricted(*part, wider=wider) or pooled for part in telling]


def _mixture(value: FloatArray, variance: FloatArray) -> Distribution:
    """Return mean and sd of a mixture of normals, with outliers clipped; None if there are few."""
    if len(value) < FEW:
        return None
    reach = OUTLYING * float(np.std(value))
    middle = float(np.median(value))
    clipped = np.clip(value, middle - reach, middle + reach)
    return float(np.mean(clipped)), float(np.sqrt(np.mean(variance) + np.var(clipped)))


def _restricted(
    value: FloatArray, variance: FloatArray, *, wider: bool
) -> Distribution:
    """Return mean and sd of the distribution behind values with known variances; None if few.

    The sd maximises the restricted likelihood over a grid; `wider` adds one standard
    error. Outliers are clipped first.
    """
    if len(value) < FEW:
        return None
    middle = float(np.median(value))
    reach = OUTLYING * np.sqrt(
        variance + (np.median(np.abs(value - middle)) / 0.6745) ** 2
    )
    value = np.clip(value, middle - reach, middle + reach)
    widest = float(np.std(value)) or float(np.sqrt(variance.max()))
    trial = np.concatenate([[0.0], widest * np.geomspace(1e-3, 2.0, CANDIDATES)])
    weight = 1 / (trial[:, None] ** 2 + variance)
    total = weight.sum(axis=1)
    mean = weight @ value / total
    misfit = (weight * (value - mean[:, None]) ** 2).sum(axis=1)
    best = int(np.argmin(misfit - np.log(weight).sum(axis=1) + np.log(total)))
    doubt = np.sqrt(2 / (weight[best] ** 2).sum()) if wider else 0.0
    return float(mean[best]), float(np.sqrt(trial[best] ** 2 + doubt))


FLAT_SD, SHARP_SD = 1e4, 1e-3  # m/s^2: equivalent to no prior, and to a known value
# Mean and standard deviation of a foot's acceleration before anything is learned,
# m/s^2.
GRAVITIES = {
    "learned": (0.0, FLAT_SD),
    "free": (0.0, FLAT_SD),
    "known": (-GRAVITY_M_S2, SHARP_SD),
}
# Prior sds of pushes (m/s^2, m/s^3) and creep (m/s), and of kinks within a foot (m/s),
# before anything is learned.
WEAK_CHANGE_SD, WEAK_JERK_SD, WEAK_CREEP_SD, WEAK_KINK_SD = 30.0, 500.0, 0.1, 3.0
LEARNING_STEPS = 6
Softly = tuple[KinkFits, FloatArray]  # fits, and the common errors of the feet, s
# Evenly spaced landings that teach flight and stance; more would sharpen no prior that
# matters.
LEARNING_LANDINGS, STANCE_LANDINGS = 400, 120
COMPLIANCES_S = (0.0, 0.002, 0.004, 0.006, 0.009, 0.013)  # tried for the law of stance
# Log likelihood that a law of stance must gain: in total, to exceed chance, and per
# fit, because a smaller gain moves an instant by only a small part of its standard
# error. Then the log likelihood by which the data must speak against pushes.
STANCE_GAIN, STANCE_GAIN_PER_FIT, TELLING_LOSS = 6.0, 0.15, 20.0
# Standard error, s, above which a contact is undetermined; it also is if the foot does
# not come down. Then the share of undetermined contacts above which a foot's law is
# rejected, and the number of contacts from which one undetermined contact is allowed
# for.
UNDETERMINED_S, UNDETERMINED_SHARE, ODD_ONE_OF = 0.015, 0.025, 10
FRAMES_BEFORE, FRAMES_AFTER = 3, 2  # fewest frames that determine a kink
AT_BOUND_S = 1e-3  # an instant this close to the earliest one, s, is only the bound
SOFTNESS_S = (
    0.001,
    0.002,
    0.003,
    0.0045,
    0.0065,
    0.009,
    0.013,
)  # tried beside the law's own
# Prior odds of a soft against a hard contact, and the sds from zero at which a contact
# is surely soft.
SOFTNESS_ODDS, SURE_OF_SOFT = 6.0, 2.0
SOFTNESS_NODES = 1001  # compliances at which the posterior is evaluated
LEAST_STEP_S = 3e-4  # smallest step between the compliances tried, s
# The likelihood treats the learned law as known, so it is too sure of the compliance by
# the first factor. No foot stops exactly exponentially; the second, a share of the
# compliance, allows for it.
OVERSURE, SHAPE_SHARE = 1.3, 0.03
# Common error in units of the time that the foot takes to fall by the misfit, and by
# its creep after the contact.
MISFIT_HIDES, TURN_HIDES = 2.0, 0.5
# An instant that moves by this much more than the compliance explains, s, is in a gap,
# so unsure.
JUMP_S = 1e-3
SOFTER_S = (
    0.0,
    0.003,
    0.006,
    0.009,
    0.013,
)  # compliances for a foot whose first law is rejected


@dataclass(frozen=True)
class Law:
    """How the feet of a recording fly and stand.

    Parameters
    ----------
    priors : FlightPriors
        Distributions of the laws over the landings.
    noise_m : float
        Standard deviation of a height, m.
    compliance_s : float
        Time constant with which a contact takes up the foot's velocity, s.
    creeps : bool
        Whether feet creep after their contacts.
    pushes : bool
        Whether standing feet push those still in flight.
    """

    priors: FlightPriors
    noise_m: float
    compliance_s: float = 0.0
    creeps: bool = False
    pushes: bool = True


@dataclass(frozen=True)
class FootHeights:
    """Data to fit: times (N,), s, heights (N, n), m, and the windows about a contact, s.

    Before `earliest` (L, n), s, a foot is too high to touch. A fit that ends there has
    found no kink, and gets the error of an undetermined contact. A foot that rises by
    more than `leaves_m` after a contact has left the floor again. Landings marked `odd`
    (L, 1) teach no law.
    """

    time: FloatArray
    heights: FloatArray
    windows_s: tuple[float, float]
    earliest: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    leaves_m: float = np.inf
    foot_of: tuple[int, ...] = ()
    odd: BoolArray | bool = False

    def telling(self, fits: KinkFits) -> FloatArray:
        """Return instants (L, n) to learn from; NaN if odd or after a gap, where any law fits."""
        return np.where(
            (fits.n_before < FRAMES_BEFORE) | self.odd, np.nan, fits.instant
        )

    def fits(self, near: FloatArray, law: Law, *, widely: bool = False) -> KinkFits:
        """Fit each foot about its instant (L, n), s; search `widely` about a rough one."""
        frame_s = float(np.median(np.diff(self.time)))
        search_s = max(0.015, 2.5 * frame_s) if widely else max(0.008, 1.5 * frame_s)
        earliest = np.full(near.shape, -np.inf)
        for foot, bounds in enumerate(np.sort(self.earliest, axis=0).T):
            bounds = np.insert(bounds, 0, -np.inf)
            earliest[:, foot] = bounds[
                np.searchsorted(bounds, near[:, foot] + search_s) - 1
            ]
        fits = kink_fits(
            self.time, self.heights, near, priors=law.priors, noise_m=law.noise_m,
            windows_s=self.windows_s, search_s=search_s, earliest=earliest,
            earlier=near if law.pushes else None, compliance_s=law.compliance_s,
            creeps=law.creeps, leaves_m=self.leaves_m,
        )  # fmt: skip
        at_bound = fits.instant < earliest + AT_BOUND_S
        unknown = UNDETERMINED_S / law.noise_m
        return replace(fits, unit_se=np.where(at_bound, unknown, fits.unit_se))


def joint_fits(
    feet: FootHeights, near: FloatArray, *, noise_m: float, gravity: str
) -> Softly:
    """Fit each foot alone, learn the laws from some of the landings, then fit all with them.

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
    """
    weak = Law(weak_priors(n := feet.heights.shape[1], gravity, feet.foot_of), noise_m)
    alone = feet.fits(near, replace(weak, pushes=False), widely=True)

    def learned(start: Law) -> tuple[Law, FloatArray]:
        law = learned_law(feet, feet.telling(alone), start, own=gravity == "learned")
        # Only the instants are returned, so that memory holds one set of fits at a
        # time.
        return law, feet.fits(alone.instant, law, widely=True).instant

    law, instant = learned(weak)
    if (
        law.pushes
    ):  # legs may also strike: velocities jump, as for markers of one rigid foot
        other, others = learned(replace(weak, priors=weak_priors(n, gravity, (0,) * n)))
        same = replace(other, noise_m=law.noise_m)
        some, also = (some_landings(at, STANCE_LANDINGS) for at in (instant, others))
        gain = _gain(
            _log_likelihood(feet, also, same), _log_likelihood(feet, some, law)
        )
        if gain.sum() > TELLING_LOSS:
            law, instant = other, others
    fits, common = _with_softness(feet, feet.fits(instant, law), law, alike=True)
    # The misfit of the law beyond the noise is common to all landings.
    left_m = np.sqrt(max(law.noise_m**2 - noise_m**2, 0.0))
    falls = np.abs(fits.velocity[np.isfinite(fits.instant)])
    # A foot that turns about its toes creeps unevenly, so part of the creep may be
    # softness.
    turns_m_s = np.abs(law.priors.mean[:, -1]) * (
        law.creeps & weak.priors.hinged.any(axis=1)
    )
    hidden_m = np.hypot(
        MISFIT_HIDES * left_m, TURN_HIDES * turns_m_s * feet.windows_s[1]
    )
    return fits, np.hypot(common, hidden_m / np.median(falls) if len(falls) else 0.0)


def _with_softness(
    feet: FootHeights, fits: KinkFits, law: Law, *, alike: bool
) -> Softly:
    """Add the uncertainty of the compliance to the errors, and return the common errors.

    Few landings cannot distinguish a hard contact from a soft one, which shifts all
    instants of a foot. The likelihoods of other compliances, for all feet `alike` or
    for each, limit what it can be. If feet are alike and surely soft, their instants
    are those of the mean compliance. The error that all landings of a foot share is its
    common error (n,), s; the rest is in `unit_se`.
    """
    some, own_s = some_landings(feet.telling(fits), STANCE_LANDINGS), law.compliance_s
    step_s = max(0.1 * own_s, LEAST_STEP_S)
    others = {
        time_s for time_s in (0.0, *SOFTNESS_S) if abs(time_s - own_s) > 1.5 * step_s
    }
    trials_s = np.array(
        sorted({max(own_s - step_s, 0.0), own_s, own_s + step_s, *others})
    )
    trials = [replace(law, compliance_s=time_s) for time_s in trials_s.tolist()]
    found = [feet.fits(some, one) for one in trials]
    each = np.array([one.evidence for one in found]) / (-2 * law.noise_m**2)
    # Jumps of instants count only between likely trials: at far too soft ones they jump
    # anyway.
    likely = (total := np.nansum(each, axis=(1, 2))) > total.max() - TELLING_LOSS
    moves = np.abs(np.diff(np.array([one.instant for one in found])[likely], axis=0))
    steady = (moves < 2 * np.diff(trials_s[likely])[:, None, None] + JUMP_S).all(axis=0)
    gains = np.where(steady & np.isfinite(each).all(axis=0), each, 0.0).sum(axis=1)
    if alike:
        gains[:] = gains.sum(axis=1, keepdims=True)
    mean, sd = _compliance(trials_s, gains)
    away = np.where(trials_s == own_s, np.inf, np.abs(trials_s - own_s))
    other = trials[int(np.argmin(np.abs(away - np.hypot(mean - own_s, sd).max())))]
    moved = feet.fits(fits.instant, other, widely=True).instant - fits.instant
    moved /= other.compliance_s - own_s
    known = [one[np.isfinite(one)] for one in moved.T]
    shift = np.array([np.median(one) if len(one) else 0.0 for one in known])
    moved = np.where(np.isfinite(moved), moved, shift)
    better = np.where(alike & (mean > SURE_OF_SOFT * sd), mean, own_s)
    instant, doubt = (
        fits.instant + moved * (better - own_s),
        np.hypot(mean - better, sd),
    )
    centre = (
        shift.mean() if alike else shift
    )  # feet that shift differently may swap places
    error = np.hypot(fits.unit_se, (moved - centre) * doubt / law.noise_m)
    # Include the law's own error, since it was learned from a finite number of landings
    if alike:
        error *= np.sqrt(1 + 1 / max(np.isfinite(instant).any(axis=1).sum(), 1))
    common = np.hypot(shift * doubt, SHAPE_SHARE * mean)
    return replace(fits, instant=instant, unit_se=error), common


def _compliance(
    trials_s: FloatArray, gains: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean and sd (n,) of compliances, s, from log likelihoods (K, n) of trials (K,).

    Log likelihoods are interpolated by a cubic spline, whose third derivative jumps at
    the inner trials except the outermost (not-a-knot). Loading SciPy's spline would
    take a short study longer than judging all its contacts.
    """

    def basis(at: FloatArray) -> FloatArray:
        share, jumps = at[:, None] / trials_s[-1], trials_s[2:-2] / trials_s[-1]
        return np.hstack([share ** np.arange(4), np.maximum(share - jumps, 0.0) ** 3])

    time_s = np.linspace(0, trials_s[-1], SOFTNESS_NODES)
    gain = basis(time_s) @ np.linalg.solve(basis(trials_s), gains) / OVERSURE**2
    prior = np.full(len(time_s), SOFTNESS_ODDS / len(time_s))
    prior[0] = 1.0
    weights = prior[:, None] * np.exp(gain - gain.max(axis=0))
    weights /= weights.sum(axis=0)
    mean = time_s @ weights
    return mean, np.sqrt(((time_s[:, None] - mean) ** 2 * weights).sum(axis=0))


def single_fits(
    feet: FootHeights, near: FloatArray, *, noise_m: float, gravity: str
) -> Softly:
    """Fit each foot alone, by the simplest law that determines its contacts.

    Curvature is free (unless gravity is `known`) and windows are recentred. The first
    law is a foot that stops at once and stands. If that leaves too many of its contacts
    undetermined, the foot creeps on. If that does not suffice either, the median over
    ever softer contacts is taken. The spread of these in each landing is part of the
    standard error.
    """
    law = Law(weak_priors(feet.heights.shape[1], gravity), noise_m, pushes=False)
    best = _alone(feet, near, law)
    noise, spread = pooled_noise(best), np.ones(near.shape[1], dtype=bool)
    for foot in np.flatnonzero(_undetermined(best, near, noise) > UNDETERMINED_SHARE):
        its = np.full(near.shape, np.arange(near.shape[1]) == foot)
        own = np.where(its, near, np.nan)
        laws = [replace(law, creeps=True, compliance_s=time_s) for time_s in SOFTER_S]
        found = [_alone(feet, own, laws[0])]
        if _undetermined(found[0], own, noise)[foot] > UNDETERMINED_SHARE:
            found += [_alone(feet, own, one) for one in laws[1:]]
        best = merged(best, _median_law(found, int(foot), noise), its)
        if len(found) > 1:
            spread[foot] = False
    law = replace(law, noise_m=noise, creeps=True)
    softly, common = _with_softness(feet, best, law, alike=False)
    # The error of a median already contains the spread over compliances.
    return replace(best, unit_se=np.where(spread, softly.unit_se, best.unit_se)), common


def _alone(feet: FootHeights, near: FloatArray, law: Law) -> KinkFits:
    fits = feet.fits(near, law, widely=True)
    for _ in range(3):
        fits = feet.fits(fits.instant, law)
    return fits


def _determined(fits: KinkFits, noise_m: float) -> BoolArray:
    """Mark the contacts (L, n) with a kink that determines their instant."""
    return np.asarray((noise_m * fits.unit_se < UNDETERMINED_S) & (fits.velocity < 0))


def _undetermined(fits: KinkFits, near: FloatArray, noise_m: float) -> FloatArray:
    """Return each foot's share of undetermined contacts (n,), forgiving one in ten or more."""
    wanted = np.isfinite(near)
    count = wanted.sum(axis=0)
    without = (wanted & ~_determined(fits, noise_m)).sum(axis=0) - (count >= ODD_ONE_OF)
    return np.asarray(without / np.maximum(count, 1))


def _median_law(found: Sequence[KinkFits], foot: int, noise_m: float) -> KinkFits:
    """Return the fits whose instants of a foot are nearest to the median, with the median instant.

    The standard error includes the spread of the instants over the laws.
    """
    known = np.stack([_determined(fits, noise_m)[:, foot] for fits in found])
    instant = np.ma.array([fits.instant[:, foot] for fits in found], mask=~known)
    error = np.ma.array([fits.unit_se[:, foot] for fits in found], mask=~known)
    middle = np.ma.median(instant, axis=0)
    spread = np.ma.mean((instant - middle) ** 2, axis=0) / noise_m**2
    variance = np.ma.median(error**2, axis=0) + spread
    nearest = np.ma.argmin(np.ma.abs(instant - middle), axis=0, fill_value=np.inf)
    rows = np.arange(len(nearest))
    kept = {
        k: np.stack([vars(one)[k] for one in found])[nearest, rows]
        for k in vars(found[0])
    }
    fits = KinkFits(**kept)
    some = known.any(axis=0)
    fits.instant[some, foot] = np.asarray(middle[some])
    fits.unit_se[some, foot] = np.sqrt(np.asarray(variance[some]))
    return fits


def merged(fits: KinkFits, others: KinkFits, where: BoolArray) -> KinkFits:
    """Return the fits (L, n), replaced by the others where `where` (L, n) is true."""
    both = ((name, value, getattr(others, name)) for name, value in vars(fits).items())
    return KinkFits(**{k: np.where(where.T, b.T, a.T).T for k, a, b in both})


def learned_law(feet: FootHeights, instant: FloatArray, law: Law, *, own: bool) -> Law:
    """Learn the law from the landings with these instants (L, n), s, starting from weak priors."""
    instant, weak = some_landings(instant, LEARNING_LANDINGS), law.priors
    for step in range(LEARNING_STEPS):
        some = some_landings(instant, STANCE_LANDINGS)
        if step == 2:  # restart: priors learned with a hard contact would keep it hard
            stance = _with_stance(feet, some, replace(law, priors=weak))
            law = replace(
                stance, priors=weak if stance.compliance_s > 0 else law.priors
            )
        elif step > 2:
            law = _refined(feet, some, law)
        fits, last = feet.fits(instant, law), step == LEARNING_STEPS - 1
        instant, law = fits.instant, _one_step(fits, law, own=own, sharpen=last)
    some = some_landings(instant, STANCE_LANDINGS)
    law = _refined(feet, some, law)
    free = replace(law, pushes=False)
    gain = _gain(_log_likelihood(feet, some, law), _log_likelihood(feet, some, free))
    # Weak pushes hardly pay for their extra freedom, but leaving them out makes errors
    # larger than stated. Keeping them where there are none only widens the stated
    # errors. So they are dropped only if the data speak against them.
    return law if gain.sum() > -TELLING_LOSS else free


def some_landings(instant: FloatArray, most: int) -> FloatArray:
    """Return at most `most` of the landings (L, n) with an instant, evenly spaced."""
    rows = np.flatnonzero(np.isfinite(instant).any(axis=1))
    if len(rows) > most:
        rows = rows[np.linspace(0, len(rows) - 1, most).round().astype(np.int64)]
    return instant[rows]


def _one_step(fits: KinkFits, law: Law, *, own: bool, sharpen: bool = False) -> Law:
    noise_m = pooled_noise(fits)
    priors = learn(fits, noise_m=noise_m, prior=law.priors, own=own, sharpen=sharpen)
    return replace(law, priors=priors, noise_m=noise_m)


def _with_stance(feet: FootHeights, instant: FloatArray, law: Law) -> Law:
    """Give the law a soft contact or creeping feet if the landings (L, n) clearly call for them."""
    best, likelihood, totals = law, _log_likelihood(feet, instant, law), [-np.inf]
    for creeps in (False, True):
        known = []
        for compliance_s in COMPLIANCES_S:  # until one is worse than the one before
            trial = replace(law, compliance_s=compliance_s, creeps=creeps)
            if creeps:
                learned = _one_step(feet.fits(instant, trial), trial, own=False)
                trial = replace(trial, priors=learned.priors)
            found = _log_likelihood(feet, instant, trial)
            known.append(float(np.nansum(found)))
            gain = _gain(found, likelihood)
            if gain.sum() > STANCE_GAIN + STANCE_GAIN_PER_FIT * len(gain):
                best, likelihood, totals = (
                    trial,
                    found,
                    known,
                )  # the list `known` still grows
            if known[-1] < max(known):
                break
    if best.compliance_s == 0.0:
        return best
    return replace(best, compliance_s=_vertex(COMPLIANCES_S[: len(totals)], totals))


def _refined(feet: FootHeights, instant: FloatArray, law: Law) -> Law:
    """Adjust the compliance of a soft contact to the law learned with it."""
    if law.compliance_s == 0.0:
        return law
    for shares in ((0.7, 1.0, 1.4), (0.9, 1.0, 1.1)):
        trials = [law.compliance_s * share for share in shares]
        found = [
            _log_likelihood(feet, instant, replace(law, compliance_s=x)) for x in trials
        ]
        law = replace(
            law, compliance_s=_vertex(trials, [float(np.nansum(x)) for x in found])
        )
    return law


def _log_likelihood(feet: FootHeights, instant: FloatArray, law: Law) -> FloatArray:
    """Return the log likelihood of each foot in each landing (L, n), up to a constant."""
    return feet.fits(instant, law).evidence / (-2 * law.noise_m**2)


def _gain(more: FloatArray, fewer: FloatArray) -> FloatArray:
    return np.asarray((more - fewer)[np.isfinite(more - fewer)])


def _vertex(trials: Sequence[float], totals: Sequence[float]) -> float:
    """Return the trial of maximum likelihood, by a parabola through the best and its neighbours."""
    x, y = np.array(trials), np.array(totals)
    middle = int(np.clip(np.argmax(y), 1, len(x) - 2))
    near = slice(middle - 1, middle + 2)
    bend, slope, _ = np.polyfit(x[near] - x[middle], y[near], 2)
    vertex = x[middle] - slope / (2 * bend) if bend < 0 else x[int(np.argmax(y))]
    return float(np.clip(vertex, x[middle - 1], x[middle + 1]))


def weak_priors(n: int, gravity: str, foot_of: tuple[int, ...] = ()) -> FlightPriors:
    """Return priors of n feet before anything is learned; see `find_contacts` for `gravity`."""
    mean = np.zeros((n, 2 * n))
    pushes = [WEAK_CHANGE_SD, WEAK_JERK_SD] * (n - 1)
    mean[:, 0], acceleration_sd = chosen("touchdowns.gravity", gravity, GRAVITIES)
    sd = np.tile([acceleration_sd, *pushes, WEAK_CREEP_SD], (n, 1))
    weak = FlightPriors(mean, sd, foot_of)
    sd[:, 2:-1:2][weak.hinged] = WEAK_KINK_SD
    return weak
