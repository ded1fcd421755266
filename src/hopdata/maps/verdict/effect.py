"""Size of the difference between the maps of the contact orders, and its interval.

What is compared, and what its size is: see `comparison`. All results follow from the
statistic T = b'Fb and its distribution for b = e u, where u is the direction found:
see `signs`. Residual smooth terms shift b equally in every study of a system, so a size
up to `allowed` is not evidence.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, Shown
from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import ALL_SETS_UP_TO
from hopdata.maps.verdict import inputs, model
from hopdata.maps.verdict.comparison import contrasts, relative_size
from hopdata.maps.verdict.inputs import SectionLandings
from hopdata.maps.verdict.model import KinkFit
from hopdata.maps.verdict.saturation import LEVEL, saturation
from hopdata.maps.verdict.signs import (
    IN_A_ROW,
    Draws,
    crossing,
    level_of,
    signed_errors,
)
from hopdata.messages import Message

# Programs outside take the size of known maps from here.
__all__ = [
    "MORE_SPREAD",
    "MOST_LANDINGS",
    "SHOWN_SCATTER",
    "AtContact",
    "EffectSize",
    "Ends",
    "at_the_contact",
    "contrasts",
    "detectable_in",
    "effect_size",
    "interval",
    "landings_needed",
    "relative_size",
    "size_drawn",
]

#: Directions of kinks over which the power for the detectable size is averaged.
#: Unit: 1. Origin: chosen.
DIRECTIONS = 64

#: Scatter of the logarithm of how large a difference shows, relative to its exact size.
#: Unit: 1. Origin: chosen: smooth terms add to kinks or hide them. On hoppers that were
#: seen before, eps shows as 1.4 to 1.6 times its exact size, kappa as 0.85 and tau as
#: 0.6 to 0.75.
SHOWN_SCATTER = 0.3

#: More landings than this are not asked for without a word on the contacts' spread.
#: Unit: landings. Origin: chosen: the most that anybody records.
MOST_LANDINGS = 20_000

#: What is said then.
MORE_SPREAD = str(Message("maps.more_spread"))


# Values that may be infinite.
UPPER_ENDS = ("high", "upper_bound")


@dataclass(frozen=True, repr=False)
class EffectSize(Shown):
    """Relative difference between the Jacobians of the contact orders.

    Attributes
    ----------
    estimate
        Size, after the mean contribution of noise to its square has been subtracted.
    low, high
        Ends of the interval; `low` is above zero exactly if the test finds more than
        `allowed`. `high` is infinite if no upper end can be given: see
        `at_the_contact`.
    upper_bound
        One-sided bound: at the given confidence the difference is not larger than this.
        Like `high`, it is never below the value that the median study without a
        difference gives; infinite if `high` is.
    detectable
        Exact size of a difference that the test finds with the given power, over
        directions and what smooth terms add or hide.
    p_value
        Share of the sign patterns, including the data's own, that give at least this
        statistic if smooth terms left `allowed`.
    squared, squared_error
        Unbiased estimate of the squared size, which noise can make negative, and its
        standard error if there is no difference.
    along_error
        Standard error of the kinks along the direction found. For a difference of size
        e the variance of `squared` is `squared_error`^2 + 4 e^2 `along_error`^2.
    allowed, left
        Sizes up to which one study, and the mean of such studies, is not evidence: see
        `KinkFit`.
    detectable_nearest, allowed_nearest
        `detectable` and `allowed` if only the nearest landings were used. They are the
        same if these are all that was used. A small study uses others too, which are
        less noisy together and for which more must be allowed; a larger study of the
        same body does not need them, and shows smaller differences: see `window`.
    """

    estimate: float
    low: float
    high: float
    upper_bound: float
    detectable: float
    p_value: float
    squared: float
    squared_error: float
    along_error: float
    allowed: float
    left: float
    detectable_nearest: float
    allowed_nearest: float

    def _told(self) -> str:
        """Return the estimate, its interval, the bound and the detectable size."""
        shown = f"detectable from {self.detectable:.2g}"
        if not self.is_bounded:
            ends = f"at least {self.low:.2g}, without an upper end"
            return f"{self.estimate:.2g} (extrapolated), {ends}; {shown}"
        size = f"{self.estimate:.2g}, {self.low:.2g} to {self.high:.2g}"
        return f"{size}; at most {self.upper_bound:.2g}; {shown}"

    @property
    def is_bounded(self) -> bool:
        """Whether an upper end can be given."""
        return math.isfinite(self.upper_bound)

    def to_dict(self) -> dict[str, Any]:
        """Return all values; infinite ends are None, as JSON has no infinity."""
        values = asdict(self)
        for name in UPPER_ENDS:
            if not math.isfinite(values[name]):
                values[name] = None
        return values

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> "EffectSize":
        """Return the size of which `to_dict` made `content`."""
        values = dict(content)
        for name in UPPER_ENDS:
            if values[name] is None:
                values[name] = math.inf
        return cls(**values)

    @property
    def least_allowed(self) -> float:
        """Return the size beyond which enough landings show any difference."""
        return min(self.allowed, self.allowed_nearest)

    def landings_needed(self, landings: int, difference: float, feet: int) -> int:
        """Return the number of landings that shows a difference: see `landings_needed`.

        Parameters
        ----------
        landings, feet
            Number of landings that this size is of, and number of feet.
        difference
            Difference to show.
        """
        return landings_needed(
            landings,
            self.detectable,
            self.allowed,
            difference,
            feet,
            detectable_nearest=self.detectable_nearest,
            allowed_nearest=self.allowed_nearest,
        )

    def in_landings(self, landings: int, others: int, feet: int) -> "EffectSize":
        """Return this size with what other landings of the same kind would detect.

        The window is the one that shows the smaller difference there.

        Parameters
        ----------
        landings, feet
            Number of landings that this size is of, and number of feet.
        others
            Number of the other landings.
        """
        detectable = detectable_in(
            others, landings, self.detectable, self.allowed, feet
        )
        nearest = detectable_in(
            others, landings, self.detectable_nearest, self.allowed_nearest, feet
        )
        scaled = replace(self, detectable=detectable, detectable_nearest=nearest)
        if others > landings and nearest < detectable:
            scaled = replace(scaled, detectable=nearest, allowed=self.allowed_nearest)
        return scaled

    def landings_for_bound(
        self, landings: int, difference: float, feet: int
    ) -> int | None:
        """Return the number of landings whose bound is `difference`, by this estimate.

        The estimate is taken to stay as it is, as one does that smooth terms leave.
        What noise adds to it in the bound falls with the root of the number of
        landings, as in `landings_needed`. None if no number suffices.

        Parameters
        ----------
        landings, feet
            Number of landings that this size is of, and number of feet.
        difference
            The bound to reach.
        """
        if not self.is_bounded:
            return None
        wanted = _size_of_end(difference, self.allowed)
        beyond = _size_of_end(self.upper_bound, self.allowed) - self.estimate
        if wanted <= self.estimate:
            return None
        for_terms = inputs.landings_for_terms(feet)
        free = _free_landings(landings, feet)
        share = max(0.0, beyond) / (wanted - self.estimate)
        return int(np.ceil(for_terms + free * share**2))

    def sizes(self) -> tuple[float, float, float, float]:
        """Return estimate, low, high and upper bound."""
        return self.estimate, self.low, self.high, self.upper_bound


def effect_size(
    fit: KinkFit,
    root: FloatArray,
    *,
    generator: np.random.Generator,
    confidence: float,
    power: float,
    flips: int,
) -> EffectSize:
    """Return the size of the kinks, if no other test shares the level of theirs.

    Parameters
    ----------
    fit, root
        Kinks, and the root of their squared size: see `squared_size`.
    generator
        Source of the random signs.
    confidence, power
        See `size_drawn`.
    flips
        Number of random sign patterns.
    """
    alike = model.err_alike(fit.scores @ root.T)
    (errors,) = signed_errors([fit], flips, generator, alike=alike)
    draws = Draws(fit, root, errors, alike=alike)
    level = level_of(confidence)
    return size_drawn(draws, fit, level_found=level, confidence=confidence, power=power)


def size_drawn(
    draws: Draws,
    fit: KinkFit,
    *,
    level_found: float,
    confidence: float,
    power: float,
) -> EffectSize:
    """Return the size of the kinks, with interval, bounds and p-value.

    The interval contains the sizes for which the T found is not a rare draw: see
    `interval`.

    Parameters
    ----------
    draws
        Draws of T.
    fit
        The kinks.
    level_found
        Level of the test that finds a difference: see `hopdata.maps.verdict.orders`.
    confidence, power
        Confidence of the interval and the bound, and power for the detectable
        difference.
    """
    level = level_of(confidence)
    p_value = draws.p_value(fit.allowed)
    ends = interval(
        draws,
        fit.allowed,
        is_found=p_value < level_found,
        level_found=level_found,
        level=level,
    )
    squared = draws.statistic - draws.of_noise
    errors = draws.null_errors
    detectable = _detectable(errors, fit.allowed, level_found, power)
    detectable_nearest = detectable
    allowed_nearest = fit.allowed
    if fit.nearest is not None:
        allowed_nearest = fit.nearest.allowed
        detectable_nearest = _detectable(
            fit.nearest.noise * errors, allowed_nearest, level_found, power
        )
    return EffectSize(
        estimate=float(np.sqrt(max(0.0, squared))),
        low=ends.low,
        high=ends.high,
        upper_bound=ends.upper_bound,
        detectable=detectable,
        p_value=p_value,
        squared=squared,
        squared_error=float(np.std(draws.statistics(0.0))),
        along_error=draws.along_error,
        allowed=fit.allowed,
        left=fit.left,
        detectable_nearest=detectable_nearest,
        allowed_nearest=allowed_nearest,
    )


@dataclass(frozen=True)
class Ends:
    """Ends of an interval, and the bound from one side: see `EffectSize`."""

    low: float
    high: float
    upper_bound: float


def interval(
    draws: Draws,
    allowed: float,
    *,
    is_found: bool,
    level_found: float,
    level: float,
) -> Ends:
    """Return the sizes for which the T found is not a rare draw.

    The low end is then reduced by `allowed` and the high end raised by `upper_ends`,
    for two reasons: residual smooth terms may add to a difference or hide part of it,
    and the simultaneous contact is a single landing, which may differ from the observed
    mean (`one_landing`).

    Below the size at which a statistic as small as the median under `allowed` becomes
    rare, only large draws count as rare. The interval therefore starts above zero
    exactly if the test, of level `level_found`, finds more than `allowed`, as
    `is_found` says. For the high end and the bound, a statistic below the median
    without kinks is replaced by that median: an estimate smaller than noise alone gives
    is luck, not knowledge.
    """
    low = 0.0
    if is_found:
        of_allowed = float(np.median(draws.statistics(allowed)))
        floor = draws.size_below(of_allowed, level_found / 2.0)
        one_sided = draws.size_below(draws.statistic, 1.0 - level_found)
        two_sided = draws.size_below(draws.statistic, 1.0 - level_found / 2.0)
        found_low = min(one_sided, max(floor, two_sided))
        deviation = model.one_landing(allowed)
        low = max(0.0, found_low - allowed) / (1.0 + deviation)

    typical = max(draws.statistic, float(np.median(draws.statistics(0.0))))
    ends = [draws.size_below(typical, level / 2.0), draws.size_below(typical, level)]
    high, bound = model.upper_ends(ends, allowed)
    return Ends(low, high, bound)


def _detectable(
    errors: FloatArray, allowed: float, level: float, power: float
) -> float:
    """Return the size of kinks that the test finds with this power.

    The power is the mean over `DIRECTIONS` in which kinks may lie and over the sizes as
    which they may show: see `SHOWN_SCATTER`. Directions are those of random errors,
    since kinks and errors both are largest in the outcomes that vary most.

    Parameters
    ----------
    errors
        (draws, m) random errors of kinks that are not there, in shares of the map.
    allowed
        Size that is no evidence.
    level, power
        Level of the test, and share of the studies that it is to find.
    """
    from scipy.special import ndtri

    squares = np.sum(errors**2, axis=1)
    directions = errors[:DIRECTIONS] / np.sqrt(squares[:DIRECTIONS, None])
    along = directions @ errors.T
    under_allowed = allowed**2 + 2.0 * allowed * along + squares
    thresholds = np.quantile(under_allowed, 1.0 - level, axis=1)[:, None]

    shares = (np.arange(len(directions)) + 0.5) / len(directions)
    shown = np.exp(SHOWN_SCATTER * ndtri(shares))[:, None]

    def missed(true: float) -> float:
        """Return the share of draws that the test misses, beyond what power allows."""
        seen = true * shown
        statistics = seen**2 + 2.0 * seen * along + squares
        return float(np.mean(statistics <= thresholds)) - (1.0 - power)

    return crossing(missed)


def _size_of_end(end: float, allowed: float) -> float:
    """Return the size of which `upper_ends` makes this upper end; zero if none does."""

    def below(size: float) -> float:
        (reached,) = model.upper_ends([size], allowed)
        return end - reached

    return crossing(below)


@dataclass(frozen=True)
class AtContact:
    """What saturation changes of a size over the landings.

    Attributes
    ----------
    size
        Size at the simultaneous contact; without an upper end if the kinks saturate.
    saturates
        Whether the kinks are found to saturate.
    p_value
        Share of the sign patterns, including the data's own, that show as much
        saturation as found.
    """

    size: EffectSize
    saturates: bool
    p_value: float


def at_the_contact(
    fit: KinkFit,
    landings: SectionLandings,
    over_landings: EffectSize,
    size: Callable[[KinkFit], EffectSize],
    *,
    generator: np.random.Generator,
    flips: int,
) -> AtContact:
    """Return the size at the simultaneous contact.

    It is that over the landings unless the kinks are found to saturate: the random
    signs show it, and the estimate at the contact exceeds that over the landings or,
    of more than three feet, the high end of its interval. Then the
    estimate is that for the slowest time constant in doubt, extrapolated from landings
    in which part of the difference is spent. How much more there is at the contact
    depends on the shape in which it is spent, which landings away from the contact do
    not tell. So there is no upper end. `low` remains: kinks that saturate are smaller
    over the landings than at the contact.

    Parameters
    ----------
    fit, landings
        Kinks over the landings.
    over_landings
        Their size.
    size
        Function that returns the size of kinks.
    generator, flips
        Source and number of random sign patterns.
    """
    in_a_row = 1
    if model.err_alike(fit.scores):
        in_a_row = IN_A_ROW
    fits = fit.at_contact(landings)
    p_value, likely = saturation(fits, flips=flips, in_a_row=in_a_row, rng=generator)
    if not p_value < LEVEL:
        return AtContact(over_landings, saturates=False, p_value=p_value)
    estimate = size(fit.with_slopes(likely)).estimate
    least = over_landings.estimate
    if landings.expected.shape[1] > ALL_SETS_UP_TO:
        # Kinks that three feet make together are not fitted, and look like saturation.
        least = over_landings.high
    if estimate <= max(fit.allowed, least):
        # Smooth terms may leave as much, or the kinks grow with the delay instead.
        return AtContact(over_landings, saturates=False, p_value=p_value)
    found = replace(
        over_landings, estimate=estimate, high=math.inf, upper_bound=math.inf
    )
    return AtContact(found, saturates=True, p_value=p_value)


def landings_needed(
    landings: int,
    detectable: float,
    allowed: float,
    difference: float,
    feet: int,
    *,
    detectable_nearest: float | None = None,
    allowed_nearest: float | None = None,
) -> int:
    """Return the number of landings that shows a difference as well as the detectable.

    The detectable size beyond `allowed` falls with the root of the number of landings
    beyond those that pay for the smooth terms (`inputs.landings_for_terms`). It does so
    in the window of the study as in that of the nearest landings; a study uses the
    better one. The result is at least the number that second-order terms need.

    Parameters
    ----------
    landings, feet
        Number of landings that the sizes are of, and number of feet.
    detectable, allowed, detectable_nearest, allowed_nearest
        As in `EffectSize`; without the latter two, the study is taken to have used the
        nearest landings.
    difference
        Difference to show.

    Raises
    ------
    AnalysisError
        If the difference is larger than neither allowed size, so that no number of
        landings shows it.
    """
    windows = [(detectable, allowed)]
    if detectable_nearest is not None and allowed_nearest is not None:
        windows.append((detectable_nearest, allowed_nearest))
    for_terms = inputs.landings_for_terms(feet)
    free = _free_landings(landings, feet)
    needs = []
    for shown, left in windows:
        if difference > left:
            beyond = max(0.0, shown - left) / (difference - left)
            needs.append(int(np.ceil(for_terms + free * beyond**2)))
    if not needs:
        least_allowed = min(left for _, left in windows)
        least = f"numbers above {least_allowed:.2g}, as much as smooth terms may leave"
        raise AnalysisError(f"differences: expected {least}, found {difference}")
    return max(inputs.least_landings(feet), min(needs))


def detectable_in(
    others: int, landings: int, detectable: float, allowed: float, feet: int
) -> float:
    """Return what another number of landings detects: `landings_needed` turned round.

    Parameters
    ----------
    others
        Number of landings that is asked about.
    landings, feet
        Number of landings that the sizes are of, and number of feet.
    detectable, allowed
        As in `EffectSize`.

    Returns
    -------
    float
        Share of the map; infinite if the others are too few to pay for smooth terms.
    """
    free = _free_landings(others, feet)
    if not free:
        return math.inf
    beyond = max(0.0, detectable - allowed)
    return allowed + beyond * math.sqrt(_free_landings(landings, feet) / free)


def _free_landings(landings: int, feet: int) -> float:
    """Return the number of landings beyond those that pay for the smooth terms."""
    return max(0.0, landings - inputs.landings_for_terms(feet))
