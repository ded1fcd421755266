"""A law of flight and stance, and the recordings to which it is fitted.

`Law` is how the feet of one recording fly and stand. The recordings of a study are
fitted together (`Trials`), each by its own law; what these share is decided by
`hopdata.landings.contacts.learning` and `hopdata.landings.contacts.kink_law`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray, IntArray
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
#: 1.35 to 1.7 times as large as stated (docs/contacts_method.md, "Few landings").
#: Unit: 1 (log likelihood). Origin: chosen.
TELLING_LOSS = 20.0

#: Rise at which a foot has left the floor again, in standard deviations of a height.
#: Frames from then on are left out: when such feet were taken to stand, contacts came
#: out 0.5 to 2 ms early.
#: Unit: standard deviations. Origin: chosen.
LEAVES = 8.0


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
    kept : float
        Share of the velocity that is taken up so; the rest is lost at once, as where a
        light foot lands on a damper.
    creeps : bool
        Whether feet creep after their contacts.
    pushes : bool
        Whether standing feet push those still in flight.
    """

    priors: FlightPriors
    noise_m: float
    compliance_s: float = 0.0
    kept: float = 1.0
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
    """

    time: FloatArray
    heights: FloatArray
    windows_s: tuple[float, float]
    earliest: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    leaves_m: float = np.inf
    foot_of: tuple[int, ...] = ()

    def fits(self, near: FloatArray, law: Law, *, widely: bool = False) -> KinkFits:
        """Fit each foot about its instant (L, n), s; `widely` about a rough one."""
        if widely:
            search_s = max(WIDE_SEARCH_S, WIDE_SEARCH_FRAMES * self._frame_s)
        else:
            search_s = max(SEARCH_S, SEARCH_FRAMES * self._frame_s)
        earliest = self.earliest_until(near + search_s)
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
            kept=law.kept,
            creeps=law.creeps,
            leaves_m=self.leaves_m,
            frame_s=self._frame_s,
        )
        at_bound = fits.instant < earliest + AT_BOUND_S
        undetermined = UNDETERMINED_S / law.noise_m
        return replace(fits, unit_se=np.where(at_bound, undetermined, fits.unit_se))

    @cached_property
    def _frame_s(self) -> float:
        """Return the usual time between two frames, s."""
        return float(np.median(np.diff(self.time)))

    @cached_property
    def _earliest_in_order(self) -> list[FloatArray]:
        """Return the earliest instants of each foot in order, after one of long ago."""
        in_order = np.sort(self.earliest, axis=0)
        return [np.insert(of_foot, 0, -np.inf) for of_foot in in_order.T]

    def earliest_until(self, latest: FloatArray) -> FloatArray:
        """Return each foot's last earliest instant that is not after `latest` (L, n).

        It is -inf where there is none.

        Rows of `latest` may be some of the landings only, so they are found by time.
        """
        earliest = np.full(latest.shape, -np.inf)
        for foot, bounds in enumerate(self._earliest_in_order):
            place = np.searchsorted(bounds, latest[:, foot])
            earliest[:, foot] = bounds[place - 1]
        return earliest


Laws = tuple[Law, ...]


@dataclass(frozen=True)
class Trials:
    """The R recordings of a study, whose landings are stacked in their order.

    Parameters
    ----------
    feet : tuple of FootHeights
        The recordings. All have the same n feet.
    of_landing : (L,) int array
        Number of the recording of each landing, in ascending order.
    odd : (L, 1) bool array or False
        Landings that teach no law.
    """

    feet: tuple[FootHeights, ...]
    of_landing: IntArray
    odd: BoolArray | bool = False

    @classmethod
    def of(
        cls, feet: Sequence[FootHeights], landings: Sequence[int] | IntArray
    ) -> Trials:
        """Put recordings side by side; `landings` is the number of each."""
        return cls(tuple(feet), np.repeat(np.arange(len(feet)), landings))

    @property
    def landings(self) -> IntArray:
        """Number of landings of each recording, (R,)."""
        return np.bincount(self.of_landing, minlength=len(self.feet))

    @property
    def foot_of(self) -> tuple[int, ...]:
        """Number of the rigid foot that each belongs to: see `FootHeights`."""
        return self.feet[0].foot_of

    @property
    def earliest(self) -> FloatArray:
        """Instants before which a foot is too high to touch, (L, n), s."""
        return np.concatenate([one.earliest for one in self.feet])

    def earliest_until(self, latest: FloatArray) -> FloatArray:
        """Return earliest instants (L, n), s: see `FootHeights.earliest_until`."""
        parts = zip(self.feet, self.each(latest), strict=True)
        return np.concatenate([one.earliest_until(own) for one, own in parts])

    def each(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Return the part of each recording of values (L, ...)."""
        return np.split(values, np.cumsum(self.landings)[:-1])

    def at(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return values of recordings (R, ...) for each landing, (L, ...)."""
        return np.asarray(values)[self.of_landing]

    def only(self, recordings: BoolArray) -> Trials:
        """Return some of the recordings (R,)."""
        numbers = np.flatnonzero(recordings)
        landings = self.landings[numbers]
        feet = [self.feet[number] for number in numbers]
        some = Trials.of(feet, landings)
        if isinstance(self.odd, bool):
            return some
        return replace(some, odd=self.odd[self.at(recordings)])

    def some(self, instant: FloatArray, most: int) -> tuple[Trials, FloatArray]:
        """Return at most `most` of the landings (L, n) with an instant, evenly spaced.

        The landings alone become fewer: the heights stay those of all frames.
        """
        rows = np.flatnonzero(np.isfinite(instant).any(axis=1))
        if len(rows) > most:
            evenly = np.linspace(0, len(rows) - 1, most)
            rows = rows[evenly.round().astype(np.int64)]
        some = Trials(self.feet, self.of_landing[rows])
        return some, instant[rows]

    def telling(self, fits: KinkFits) -> FloatArray:
        """Return instants (L, n) to learn from; NaN where the landing tells nothing.

        It does not if it is odd, or if the contact follows a gap, where any law fits.
        """
        tells_nothing = (fits.n_before < FRAMES_BEFORE) | self.odd
        return np.where(tells_nothing, np.nan, fits.instant)

    def fits(self, near: FloatArray, laws: Laws, *, widely: bool = False) -> KinkFits:
        """Fit each foot about its instant (L, n), s; `widely` about a rough one."""
        parts = zip(self.feet, self.each(near), laws, strict=True)
        return stacked([one.fits(own, law, widely=widely) for one, own, law in parts])


def stacked(parts: Sequence[KinkFits]) -> KinkFits:
    """Return the fits of recordings as those of all their landings."""
    if len(parts) == 1:
        return parts[0]
    names = [one.name for one in fields(KinkFits)]
    return KinkFits(
        **{name: np.concatenate([vars(part)[name] for part in parts]) for name in names}
    )


def taken(fits: KinkFits, rows: BoolArray) -> KinkFits:
    """Return the fits of some landings (L,)."""
    return KinkFits(**{name: value[rows] for name, value in vars(fits).items()})


def changed(laws: Laws, **values: Any) -> Laws:
    """Return the laws with the same new values in all."""
    return tuple(replace(law, **values) for law in laws)


def noises(laws: Laws) -> FloatArray:
    """Return the noise of a height in each recording, (R,), m."""
    return np.array([law.noise_m for law in laws])


def log_likelihood(
    trials: Trials, instant: FloatArray, laws: Laws, *, widely: bool = False
) -> FloatArray:
    """Return the log likelihood of each foot in each landing (L, n), but a constant."""
    noise_m = trials.at(noises(laws))[:, None]
    fits = trials.fits(instant, laws, widely=widely)
    return fits.evidence / (-2 * noise_m**2)


def known_gains(more: FloatArray, fewer: FloatArray) -> FloatArray:
    """Return the gains of log likelihood (L, n) where both are known, flat."""
    gain = more - fewer
    return np.asarray(gain[np.isfinite(gain)])


def likeliest_trial(trials: Sequence[float], totals: Sequence[float]) -> float:
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


def merged(fits: KinkFits, others: KinkFits, where: BoolArray) -> KinkFits:
    """Return the fits (L, n), replaced by the others where `where` (L, n) is true."""
    chosen = {}
    for name, value in vars(fits).items():
        other = getattr(others, name)
        # Landings and feet are the first axes of each field, so they are put last.
        chosen[name] = np.where(where.T, other.T, value.T).T
    return KinkFits(**chosen)
