"""Kink fits of a whole recording, whose laws of flight and stance are learned from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import chosen
from hopdata.gravity import GRAVITY_M_S2
from hopdata.landings.kink import FlightPriors, KinkFits, kink_fits
from hopdata.landings.kink_learning import learn, pooled_noise

FloatArray = NDArray[np.float64]

FLAT_SD, SHARP_SD = 1e4, 1e-3  # m/s^2: as good as no prior, and as good as known
# Mean and standard deviation of a foot's acceleration before the recording has been asked, m/s^2.
GRAVITIES = {
    "learned": (0.0, FLAT_SD),
    "free": (0.0, FLAT_SD),
    "known": (-GRAVITY_M_S2, SHARP_SD),
}
WEAK_CHANGE_SD, WEAK_JERK_SD = 30.0, 500.0  # m/s^2, m/s^3: pushes not yet learned
WEAK_CREEP_SD = 0.1  # m/s
LEARNING_STEPS = 6
LEARNING_LANDINGS = 400  # evenly spaced; more would sharpen no prior that matters
STANCE_LANDINGS = 120
COMPLIANCES_S = (0.0, 0.002, 0.004, 0.006, 0.009, 0.013)
# The log likelihood that a further part of the law must gain: to be beyond chance, and for each
# fit, since what gains less there moves an instant by little of its standard error.
TELLING_GAIN, TELLING_GAIN_PER_FIT = 20.0, 0.15


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
        Time in which a contact takes up the foot's velocity, s.
    creeps : bool
        Whether feet creep after their contacts.
    pushes : bool
        Whether the feet that stand push those still in flight.
    """

    priors: FlightPriors
    noise_m: float
    compliance_s: float = 0.0
    creeps: bool = False
    pushes: bool = True


@dataclass(frozen=True)
class FootHeights:
    """What is fitted: times (N,), s, heights (N, n), m, and the windows about a contact, s."""

    time: FloatArray
    heights: FloatArray
    windows_s: tuple[float, float]

    def search_s(self) -> tuple[float, float]:
        """Half widths of the first and of the later searches for an instant, s."""
        frame_s = float(np.median(np.diff(self.time)))
        return max(0.015, 2.5 * frame_s), max(0.008, 1.5 * frame_s)

    def first_fits(self, near: FloatArray, law: Law) -> KinkFits:
        """Search about rough instants (L, n), s, as if no foot acted on another."""
        return self._fits(near, replace(law, pushes=False), self.search_s()[0])

    def fits(self, instant: FloatArray, law: Law, *, widely: bool = False) -> KinkFits:
        """Fit each foot about its last instant (L, n), s, as far as in the first fits or less."""
        return self._fits(instant, law, self.search_s()[0 if widely else 1])

    def _fits(self, near: FloatArray, law: Law, search_s: float) -> KinkFits:
        return kink_fits(
            self.time, self.heights, near, priors=law.priors, noise_m=law.noise_m,
            windows_s=self.windows_s, search_s=search_s, earlier=near if law.pushes else None,
            compliance_s=law.compliance_s, creeps=law.creeps,
        )  # fmt: skip


def joint_fits(feet: FootHeights, near: FloatArray, *, noise_m: float, gravity: str) -> KinkFits:
    """Fit each foot alone, learn the laws on some of the landings, then fit all by them.

    Parameters
    ----------
    feet : FootHeights
        The recording.
    near : (L, n) array
        Rough instants, s; NaN for none.
    noise_m : float
        Standard deviation of a height, m.
    gravity : {"learned", "free", "known"}
        See `hopdata.landings.contacts.find_contacts`.
    """
    law = Law(weak_priors(feet.heights.shape[1], gravity), noise_m)
    alone = feet.first_fits(near, law)
    law = learned_law(feet, alone.instant, law, own=gravity == "learned")
    fits = feet.fits(alone.instant, law, widely=True)
    return feet.fits(fits.instant, law)


def single_fits(feet: FootHeights, near: FloatArray, *, noise_m: float, gravity: str) -> KinkFits:
    """Fit each foot alone with a free curvature (unless gravity is `known`), windows recentred."""
    law = Law(weak_priors(feet.heights.shape[1], gravity), noise_m, pushes=False)
    fits = feet.first_fits(near, law)
    for _ in range(3):
        fits = feet.fits(fits.instant, law)
    return fits


def learned_law(feet: FootHeights, instant: FloatArray, law: Law, *, own: bool) -> Law:
    """Learn from the landings with these instants (L, n), s, from weak priors on."""
    instant = some_landings(instant, LEARNING_LANDINGS)
    for step in range(LEARNING_STEPS):
        if step == 2:
            law = _with_stance(feet, some_landings(instant, STANCE_LANDINGS), law)
        fits = feet.fits(instant, law)
        last = step == LEARNING_STEPS - 1
        instant, law = fits.instant, _one_step(fits, law, own=own, sharpen=last)
    some = some_landings(instant, STANCE_LANDINGS)
    law = _refined(feet, some, law)
    free = replace(law, pushes=False)
    better = _better(_log_likelihood(feet, some, law), _log_likelihood(feet, some, free))
    return law if better else free


def some_landings(instant: FloatArray, most: int) -> FloatArray:
    """At most so many of the landings (L, n) with an instant, evenly spaced."""
    rows = np.flatnonzero(np.isfinite(instant).any(axis=1))
    if len(rows) > most:
        rows = rows[np.linspace(0, len(rows) - 1, most).round().astype(np.int64)]
    return instant[rows]


def _one_step(fits: KinkFits, law: Law, *, own: bool, sharpen: bool = False) -> Law:
    noise_m = pooled_noise(fits)
    priors = learn(fits, noise_m=noise_m, prior=law.priors, own=own, sharpen=sharpen)
    return replace(law, priors=priors, noise_m=noise_m)


def _with_stance(feet: FootHeights, instant: FloatArray, law: Law) -> Law:
    """Give the law a soft contact or creeping feet if the landings (L, n) clearly ask for them."""
    best, likelihood, totals = law, _log_likelihood(feet, instant, law), [-np.inf]
    for creeps in (False, True):
        known = []
        for compliance_s in COMPLIANCES_S:  # up to the first that is worse than the last
            trial = _trial(feet, instant, replace(law, compliance_s=compliance_s, creeps=creeps))
            found = _log_likelihood(feet, instant, trial)
            known.append(float(np.nansum(found)))
            if _better(found, likelihood):
                best, likelihood, totals = trial, found, known  # which still grows
            if known[-1] < max(known):
                break
    if best.compliance_s == 0.0:
        return best
    return replace(best, compliance_s=_vertex(COMPLIANCES_S[: len(totals)], totals))


def _refined(feet: FootHeights, instant: FloatArray, law: Law) -> Law:
    """Adjust the compliance of a soft contact to the law that was learned with it."""
    if law.compliance_s == 0.0:
        return law
    trials = [law.compliance_s * share for share in (0.7, 1.0, 1.4)]
    totals = [
        float(np.nansum(_log_likelihood(feet, instant, replace(law, compliance_s=trial))))
        for trial in trials
    ]
    return replace(law, compliance_s=_vertex(trials, totals))


def _trial(feet: FootHeights, instant: FloatArray, law: Law) -> Law:
    """Learn the creep of a law that is to be tried on landings (L, n)."""
    if not law.creeps:
        return law
    return replace(law, priors=_one_step(feet.fits(instant, law), law, own=False).priors)


def _log_likelihood(feet: FootHeights, instant: FloatArray, law: Law) -> FloatArray:
    """Log likelihood of each foot of each landing (L, n), but for a constant."""
    return feet.fits(instant, law).evidence / (-2 * law.noise_m**2)


def _better(more: FloatArray, fewer: FloatArray) -> bool:
    """Whether a law with more parts is clearly likelier than one with fewer."""
    gain = (more - fewer)[np.isfinite(more - fewer)]
    return float(gain.sum()) > TELLING_GAIN + TELLING_GAIN_PER_FIT * len(gain)


def _vertex(trials: Sequence[float], totals: Sequence[float]) -> float:
    """Return the trial of largest likelihood, by a parabola through the best and its two next."""
    x, y = np.array(trials), np.array(totals)
    middle = int(np.clip(np.argmax(y), 1, len(x) - 2))
    near = slice(middle - 1, middle + 2)
    bend, slope, _ = np.polyfit(x[near] - x[middle], y[near], 2)
    vertex = x[middle] - slope / (2 * bend) if bend < 0 else x[int(np.argmax(y))]
    return float(np.clip(vertex, x[middle - 1], x[middle + 1]))


def weak_priors(n: int, gravity: str) -> FlightPriors:
    """Priors of n feet before the recording has been asked: see `find_contacts` for `gravity`."""
    mean = np.zeros((n, 2 * n))
    pushes = [WEAK_CHANGE_SD, WEAK_JERK_SD] * (n - 1)
    mean[:, 0], acceleration_sd = chosen("touchdowns.gravity", gravity, GRAVITIES)
    sd = np.tile([acceleration_sd, *pushes, WEAK_CREEP_SD], (n, 1))
    return FlightPriors(mean, sd)
