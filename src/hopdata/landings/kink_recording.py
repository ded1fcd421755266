"""Kink fits of a whole recording, whose laws of flight and stance are learned from it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.kink import FlightPriors, KinkFits, kink_fits
from hopdata.landings.kink_learning import learn, pooled_noise

FloatArray = NDArray[np.float64]

GRAVITY_M_S2 = 9.80665
FLAT_SD, SHARP_SD = 1e4, 1e-3  # m/s^2: as good as no prior, and as good as known
WEAK_CHANGE_SD, WEAK_JERK_SD = 30.0, 500.0  # m/s^2, m/s^3: pushes not yet learned
WEAK_CREEP_SD = 0.1  # m/s
LEARNING_STEPS = 6
LEARNING_LANDINGS = 400  # evenly spaced; more would sharpen no prior that matters
STANCE_LANDINGS = 120
COMPLIANCES_S = (0.0, 0.002, 0.004, 0.006, 0.009, 0.013)
FINEST_COMPLIANCE_S = 2.5e-4
TELLING_GAIN = 20.0  # of the log likelihood, for which a soft or a creeping contact is believed


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
class Frames:
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

    def fits(self, instant: FloatArray, law: Law) -> KinkFits:
        """Fit each foot about its last instant (L, n), s."""
        return self._fits(instant, law, self.search_s()[1])

    def _fits(self, near: FloatArray, law: Law, search_s: float) -> KinkFits:
        return kink_fits(
            self.time, self.heights, near, priors=law.priors, noise_m=law.noise_m,
            windows_s=self.windows_s, search_s=search_s, earlier=near if law.pushes else None,
            compliance_s=law.compliance_s, creeps=law.creeps,
        )  # fmt: skip


def joint_fits(frames: Frames, near: FloatArray, *, noise_m: float, gravity: str) -> KinkFits:
    """Fit each foot alone, learn the laws on some of the landings, then fit all by them.

    Parameters
    ----------
    frames : Frames
        The recording.
    near : (L, n) array
        Rough instants, s; NaN for none.
    noise_m : float
        Standard deviation of a height, m.
    gravity : {"learned", "free", "known"}
        See `hopdata.landings.contacts.find_contacts`.
    """
    law = Law(weak_priors(frames.heights.shape[1], gravity), noise_m)
    alone = frames.first_fits(near, law)
    law = learned_law(frames, alone.instant, law, own=gravity == "learned")
    fits = frames.fits(alone.instant, law)
    return frames.fits(fits.instant, law) if law.pushes else fits


def single_fits(frames: Frames, near: FloatArray, *, noise_m: float, gravity: str) -> KinkFits:
    """Fit each foot alone with a free curvature (unless gravity is `known`), windows recentred."""
    law = Law(weak_priors(frames.heights.shape[1], gravity), noise_m, pushes=False)
    fits = frames.first_fits(near, law)
    for _ in range(3):
        fits = frames.fits(fits.instant, law)
    return fits


def learned_law(frames: Frames, instant: FloatArray, law: Law, *, own: bool) -> Law:
    """Learn from the landings with these instants (L, n), s, from weak priors on."""
    instant = some_landings(instant, LEARNING_LANDINGS)
    for step in range(LEARNING_STEPS):
        if step == 2:
            law = _with_stance(frames, some_landings(instant, STANCE_LANDINGS), law)
        fits = frames.fits(instant, law)
        last = step == LEARNING_STEPS - 1
        instant, law = fits.instant, _one_step(fits, law, own=own, sharpen=last)
    free = replace(law, pushes=False)
    some = some_landings(instant, STANCE_LANDINGS)
    return law if _gain(frames, some, law, over=free) > TELLING_GAIN else free


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


def _with_stance(frames: Frames, instant: FloatArray, law: Law) -> Law:
    """Give the law a soft contact or creeping feet if the landings (L, n) clearly ask for them."""
    best = law
    for creeps, compliance_s in product((False, True), COMPLIANCES_S):
        trial = replace(law, compliance_s=compliance_s, creeps=creeps)
        if creeps:
            priors = _one_step(frames.fits(instant, trial), trial, own=False).priors
            trial = replace(trial, priors=priors)
        if _gain(frames, instant, trial, over=best) > TELLING_GAIN:
            best = trial
    return best


def _gain(frames: Frames, instant: FloatArray, law: Law, *, over: Law) -> float:
    """By how much the log likelihood of a law on these landings exceeds that of another."""
    difference = frames.fits(instant, over).evidence - frames.fits(instant, law).evidence
    return float(np.nansum(difference)) / (2 * law.noise_m**2)


def weak_priors(n: int, gravity: str) -> FlightPriors:
    """Priors of n feet before the recording has been asked: see `find_contacts` for `gravity`."""
    mean = np.zeros((n, 2 * n))
    pushes = [WEAK_CHANGE_SD, WEAK_JERK_SD] * (n - 1)
    sd = np.tile([FLAT_SD, *pushes, WEAK_CREEP_SD], (n, 1))
    if gravity == "known":
        mean[:, 0], sd[:, 0] = -GRAVITY_M_S2, SHARP_SD
    return FlightPriors(mean, sd)
