"""A law of flight and stance, and the data to which it is fitted."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.landings.contacts.kink import FlightPriors, KinkFits, kink_fits

#: Fewest frames of flight that determine a kink. With fewer, any law fits, and
#: contacts came out soft and 0.3 to 0.6 ms early.
#: Unit: frames. Origin: measured: feet that came out of a gap.
FRAMES_BEFORE = 3

#: Fewest frames of stance that determine a kink.
#: Unit: frames. Origin: chosen.
FRAMES_AFTER = 2

#: Standard error from which on a contact is undetermined (as it is where the foot does
#: not come down), and which a fit gets that ends at the earliest instant.
#: Unit: s. Origin: chosen.
UNDETERMINED_S = 0.015

#: An instant this close to the earliest one was stopped by it and is no kink.
#: Unit: s. Origin: chosen.
AT_BOUND_S = 1e-3

#: Half width of the search about a rough instant.
#: Unit: s. Origin: chosen.
WIDE_SEARCH_S = 0.015

#: Least half width of the search about a rough instant, in frames.
#: Unit: frames. Origin: chosen.
WIDE_SEARCH_FRAMES = 2.5

#: Half width of the search about an instant that was fitted before.
#: Unit: s. Origin: chosen.
SEARCH_S = 0.008

#: Least half width of the search about an instant that was fitted before, in frames.
#: Unit: frames. Origin: chosen.
SEARCH_FRAMES = 1.5

#: Log likelihood by which the data must speak against something, such as pushes. That
#: it must be a loss is measured: when pushes had to show a gain to stay, errors were
#: 1.35 to 1.7 times as large as stated (docs/contacts.md, "Few landings").
#: Unit: 1 (log likelihood). Origin: chosen.
TELLING_LOSS = 20.0


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
    """Heights of feet to which a law is fitted.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet, m; NaN where unseen.
    windows_s : tuple of float
        Windows before and after a contact, s.
    earliest : (L, n) array
        Instant before which a foot is too high to touch, s. A fit that ends there has
        found no kink, and gets the error of an undetermined contact.
    leaves_m : float
        Rise after a contact by which a foot has left the floor again, m.
    foot_of : tuple of int
        Number of the rigid foot that each belongs to, where several are markers of one.
    odd : (L, 1) bool array or False
        Landings that teach no law.
    """

    time: FloatArray
    heights: FloatArray
    windows_s: tuple[float, float]
    earliest: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    leaves_m: float = np.inf
    foot_of: tuple[int, ...] = ()
    odd: BoolArray | bool = False

    def telling(self, fits: KinkFits) -> FloatArray:
        """Return instants (L, n) to learn from; NaN where the landing tells nothing.

        It does not if it is odd, or if the contact follows a gap, where any law fits.
        """
        tells_nothing = (fits.n_before < FRAMES_BEFORE) | self.odd
        return np.where(tells_nothing, np.nan, fits.instant)

    def fits(self, near: FloatArray, law: Law, *, widely: bool = False) -> KinkFits:
        """Fit each foot about its instant (L, n), s; `widely` about a rough one."""
        frame_s = float(np.median(np.diff(self.time)))
        if widely:
            search_s = max(WIDE_SEARCH_S, WIDE_SEARCH_FRAMES * frame_s)
        else:
            search_s = max(SEARCH_S, SEARCH_FRAMES * frame_s)
        earliest = self._earliest_within(near + search_s)
        fits = kink_fits(
            self.time,
            self.heights,
            near,
            priors=law.priors,
            noise_m=law.noise_m,
            windows_s=self.windows_s,
            search_s=search_s,
            earliest=earliest,
            all_contacts=near if law.pushes else None,
            compliance_s=law.compliance_s,
            creeps=law.creeps,
            leaves_m=self.leaves_m,
        )
        at_bound = fits.instant < earliest + AT_BOUND_S
        undetermined = UNDETERMINED_S / law.noise_m
        return replace(fits, unit_se=np.where(at_bound, undetermined, fits.unit_se))

    def _earliest_within(self, latest: FloatArray) -> FloatArray:
        """Return each foot's last earliest instant that is not after `latest` (L, n).

        Rows of `latest` may be some of the landings only, so they are found by time.
        """
        earliest = np.full(latest.shape, -np.inf)
        for foot, in_order in enumerate(np.sort(self.earliest, axis=0).T):
            bounds = np.insert(in_order, 0, -np.inf)
            place = np.searchsorted(bounds, latest[:, foot])
            earliest[:, foot] = bounds[place - 1]
        return earliest


def log_likelihood(feet: FootHeights, instant: FloatArray, law: Law) -> FloatArray:
    """Return the log likelihood of each foot in each landing (L, n), but a constant."""
    return feet.fits(instant, law).evidence / (-2 * law.noise_m**2)


def known_gains(more: FloatArray, fewer: FloatArray) -> FloatArray:
    """Return the gains of log likelihood (L, n) where both are known, flat."""
    gain = more - fewer
    return np.asarray(gain[np.isfinite(gain)])


def some_landings(instant: FloatArray, most: int) -> FloatArray:
    """Return at most `most` of the landings (L, n) with an instant, evenly spaced."""
    rows = np.flatnonzero(np.isfinite(instant).any(axis=1))
    if len(rows) > most:
        evenly = np.linspace(0, len(rows) - 1, most)
        rows = rows[evenly.round().astype(np.int64)]
    return instant[rows]


def merged(fits: KinkFits, others: KinkFits, where: BoolArray) -> KinkFits:
    """Return the fits (L, n), replaced by the others where `where` (L, n) is true."""
    chosen = {}
    for name, value in vars(fits).items():
        other = getattr(others, name)
        # Landings and feet are the first axes of each field, so they are put last.
        chosen[name] = np.where(where.T, other.T, value.T).T
    return KinkFits(**chosen)
