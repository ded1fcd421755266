"""Fit of kinks beside a smooth map, and what smooth terms leave.

The model is y = smooth(x) + b h(t(x)). The kinks h are the latest contacts of sets of
feet (`maps.coordinates.kinks`), at the contact instants t(x) expected from the state
before the landing, and averaged over what is not foretold of them (`averaged`); b is
zero exactly if the map is C1.

Other terms of a C1 map look like kinks; they shrink as the contacts come closer
together. The landings with the largest contact spread are therefore left out unless the
study needs them (`window`), and kinks up to `allowed` are not evidence. What smooth
terms leave is not rounded as kinks are, so `allowed` grows as averaging makes the kinks
fainter.

If impacts do not commute, the outcome itself jumps where two feet exchange their order.
Steps, sign(t_i - t_j), are then fitted like the kinks, and the kinks count as smooth
terms.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.maps import coordinates
from hopdata.maps.coordinates import ALL_SETS_UP_TO
from hopdata.maps.verdict import averaged
from hopdata.maps.verdict.exchanges import Exchange, exchanges_of, steps_of
from hopdata.maps.verdict.growth import Growth, growth
from hopdata.maps.verdict.inputs import LEAST_CLASS, WINDOW, SectionLandings
from hopdata.maps.verdict.saturation import (
    AtContact,
    Lasting,
    at_contact,
    beside_bends,
    lasts,
)
from hopdata.maps.verdict.smooth import (
    Curvature,
    Fit,
    Shapes,
    Smooth,
    affords_third,
    fit_beside,
    smooth_terms,
)
from hopdata.messages import Message

#: Apparent difference that residual smooth terms may cause in any C1 landing.
#: Unit: share of the map. Origin: measured: a C1 hopper without noise has kinks of up
#: to 0.08 (docs/decisions.md, "The verdict looks for kinks").
LEFT = 0.1

#: The same where contacts lie far apart: this times c^1.5. Here c is the relative
#: change of the derivative by third-order terms along the contacts. It grows as the
#: square of the contacts' spread, while the change by the fourth order grows as the
#: cube, hence as c^1.5.
#: Unit: 1. Origin: measured: of 1.5 c, 2 c and 4 c^1.5 the last covers C1 hoppers of
#: other shapes (docs/decisions.md, "The verdict looks for kinks").
OF_FOURTH = 4.0

#: Sizes of which one is larger by less than this share count as equal: relative error
#: of a product of two numbers, with room.
#: Unit: 1. Origin: rounding.
ROUNDING = 1e-9

# From here on more is left than `LEFT`, rounding aside.
_MORE_THAN_LEFT = LEFT * (1.0 + ROUNDING)

#: Power of the contacts' spread with which the part that smooth terms leave grows from
#: one window to a wider one.
#: Unit: 1. Origin: measured: a C1 hopper without noise has kinks of 0.051, 0.060 and
#: 0.080 in the nearest 85 %, 92 % and all landings, whose spreads are as 1, 1.08 and
#: 1.23 (docs/decisions.md, "The verdict looks for kinks").
OF_SPREAD = 2.2

#: Apparent jump that residual smooth terms may cause.
#: Unit: share of the map. Origin: chosen: it suffices, since no jump is
#: named in 60 studies with a C1 map or kinks that last (docs/verdict_campaign.md).
LEFT_OF_JUMPS = 0.05

#: The same where contacts lie far apart, as a share of `KinkFit.allowed`.
#: Unit: 1. Origin: chosen: as `LEFT_OF_JUMPS`.
OF_ALLOWED = 0.1

#: Part of a true difference that smooth terms may hide, as a share of `allowed`.
#: Unit: 1. Origin: chosen.
HIDDEN = 0.5

#: Largest deviation of one landing's derivative from the mean, in rms deviations of all
#: landings.
#: Unit: 1. Origin: chosen.
ONE_LANDING = 2.0

#: How much more the mean of many studies may have left if landings are too few to fit
#: third-order terms without shrinking them, as a multiple of `allowed`.
#: Unit: 1. Origin: chosen.
WITHOUT_THIRD = 1.5

#: Number of following landings with which each is compared, to find whether they err
#: alike.
#: Unit: landings. Origin: chosen.
NEXT = 5

#: Standard errors by which successive landings resemble each other by chance.
#: Unit: 1. Origin: convention: three standard errors.
BY_CHANCE = 3.0

#: The same relative to the most visible kink, for kinks of pairs of feet only and for
#: steps.
#: Unit: 1. Origin: chosen.
LEAST_OF_PAIRS = 0.25


@dataclass(frozen=True)
class Nearest:
    """What the nearest landings, `WINDOW` of them, leave beside a wider window.

    Attributes
    ----------
    allowed
        Size up to which kinks of these landings are not evidence.
    noise
        Noise of that size, as a multiple of the noise in the wider window.
    faded, third_is_sure
        As in `KinkFit`.
    """

    allowed: float
    noise: float
    faded: float = 1.0
    third_is_sure: bool = True

    def suffice(self, bent: float) -> bool:
        """Return whether these leave no more than `LEFT`, or more only by chance."""
        of_nearest = self.allowed / self.faded - bent
        return of_nearest <= _MORE_THAN_LEFT or not self.third_is_sure


@dataclass(frozen=True)
class KinkFit:
    """Kinks, or steps, of a study with K kinks, q outputs and N landings.

    Attributes
    ----------
    coefficients
        (K, q) coefficients of the combinations `seen` of the kinks.
    linear
        (p, q) derivative of the outputs with respect to the inputs, without the kinks
        and steps.
    scores, null_scores
        (N, K q) contributions of the landings to the error of the coefficients, row by
        row: after the kinks found have been subtracted from the outputs, and under the
        assumption of no kinks.
    seen
        (all kinks, K) orthonormal combinations of the kinks that are distinct from
        smooth terms.
    rows
        (n,) numbers of the landings in the window.
    allowed
        Size up to which kinks are not evidence in one study: see `LEFT`.
    left
        The same for the mean of such studies; 1.5 times `allowed` without third-order
        terms.
    faded
        By how much averaging over what is not foretold makes the kinks fainter.
    third_is_sure
        Whether third-order terms along the contacts are more than chance.
    session
        What the terms of the session depend on, if there are any.
    jumps
        Steps of the outcome beside the kinks; None if no steps can be fitted.
    smooth, shown
        Smooth terms of the landings in the window, None for steps; and the (n, K) kinks
        or steps that were fitted.
    faint
        (n, m) combinations of the kinks that are too faint to be fitted.
    exchanges
        Of which feet the steps are, if they are steps: see `exchanges`.
    nearest
        What the nearest landings alone would leave; None if the window is theirs.
    """

    coefficients: FloatArray
    linear: FloatArray
    scores: FloatArray
    null_scores: FloatArray
    seen: FloatArray
    rows: IntArray
    allowed: float
    left: float
    faded: float = 1.0
    third_is_sure: bool = True
    session: tuple[str, ...] = ()
    jumps: "KinkFit | None" = None
    smooth: Smooth | None = None
    shown: FloatArray | None = None
    faint: FloatArray | None = None
    exchanges: tuple[Exchange, ...] = ()
    nearest: Nearest | None = None

    def sharp(self, bent: float) -> float:
        """Return what third orders leave of kinks that nothing blurs.

        `bent` is what the post section adds to `allowed`.
        """
        return self.allowed / self.faded - bent

    def leaves_more(self, bent: float) -> bool:
        """Return whether third orders leave more than `LEFT` of such kinks."""
        return self.sharp(bent) > _MORE_THAN_LEFT

    def wants_landings(self, bent: float) -> bool:
        """Return whether they do so for want of landings, not by contacts far apart.

        That is so if the landings do not tell these terms from chance, or if the
        nearest would leave no more, but are too few to be judged by.
        """
        if not self.leaves_more(bent):
            return False
        if self.nearest is not None:
            return self.nearest.suffice(bent)
        return not self.third_is_sure

    def with_slopes(self, at: AtContact) -> "KinkFit":
        """Return the fit with the slopes at the simultaneous contact as its kinks."""
        scores = _of_all(at.slopes.scores, self.rows, len(self.scores))
        null_scores = _of_all(at.slopes.null_scores, self.rows, len(self.scores))
        return replace(
            self,
            coefficients=at.slopes.coefficients,
            scores=scores,
            null_scores=null_scores,
        )

    def at_contact(self, landings: SectionLandings) -> tuple[AtContact, ...]:
        """Return the kinks at the simultaneous contact, if they saturate.

        See `saturation.at_contact`; there are none of steps. Jumps and faint kinks are
        free, since either looks like saturation of the kinks that are fitted.
        """
        if self.smooth is None or self.shown is None or self.faint is None:
            return ()
        smooth = self.smooth.and_also(self.faint)
        if self.jumps is not None and self.jumps.shown is not None:
            smooth = smooth.and_also(self.jumps.shown)
        instants = landings.expected[self.rows]
        rest = landings.unforetold.total
        return at_contact(smooth, self.shown, self.seen, instants, rest)

    def kinks_beside_jumps(self) -> "KinkFit":
        """Return the kinks as they stand beside the steps.

        Without the steps, a jump is left in the residuals of the kinks. It is a
        function of the inputs, so that random signs do not show by how much it moves
        the kinks.
        """
        jumps = self.jumps
        if self.smooth is None or self.shown is None:
            return self
        if jumps is None or jumps.shown is None:
            return self
        fit = fit_beside(self.smooth.and_also(jumps.shown), self.shown)
        both = self.shown @ fit.coefficients + jumps.shown @ jumps.coefficients
        number = len(self.scores)
        return replace(
            self,
            coefficients=fit.coefficients,
            linear=self.smooth.linear(both),
            scores=_of_all(fit.scores, self.rows, number),
            null_scores=_of_all(fit.null_scores, self.rows, number),
        )

    def jumps_beside_bends(self, landings: SectionLandings) -> tuple["KinkFit", ...]:
        """Return the jumps as they stand beside bends: see `saturation.beside_bends`.

        Those beside the likeliest bends come first. There are none if no steps can be
        fitted.
        """
        jumps = self.jumps
        if self.smooth is None or self.shown is None or self.faint is None:
            return ()
        if jumps is None or jumps.shown is None:
            return ()
        smooth = self.smooth.and_also(np.column_stack([self.shown, self.faint]))
        instants = landings.expected[self.rows]
        rest = landings.unforetold.total
        number = len(self.scores)
        found = []
        for fit in beside_bends(smooth, jumps.shown, instants, rest):
            beside = replace(
                jumps,
                coefficients=fit.coefficients,
                scores=_of_all(fit.scores, self.rows, number),
                null_scores=_of_all(fit.null_scores, self.rows, number),
            )
            found.append(beside)
        return tuple(found)

    def curvature(self) -> Curvature | None:
        """Return how strongly the map bends over the landings; None of steps."""
        if self.smooth is None or self.shown is None:
            return None
        explained = self.shown @ self.coefficients
        if self.jumps is not None and self.jumps.shown is not None:
            explained = explained + self.jumps.shown @ self.jumps.coefficients
        return self.smooth.curvature(explained, self.linear)

    def growth(self, landings: SectionLandings) -> Growth | None:
        """Return how the difference grows with the time between contacts.

        See `growth.growth`; there is none of steps, and of two feet.
        """
        if self.smooth is None:
            return None
        instants = landings.expected[self.rows]
        return growth(self.smooth, instants, landings.unforetold.total)

    def lasting(self, landings: SectionLandings) -> Lasting | None:
        """Return what shows over the landings of kinks that saturate; None of steps."""
        if self.smooth is None:
            return None
        return lasts(self.smooth, self.seen, landings.expected[self.rows])


def fit_kinks(landings: SectionLandings, share: float = WINDOW) -> KinkFit:
    """Fit the kinks to this share of the landings, those of least contact spread.

    Raises
    ------
    AnalysisError
        If there are no landings in which two feet exchange their order.
    """
    n_feet = landings.expected.shape[1]
    rows = nearest(landings.expected, share)
    kinks = _kinks(landings, rows)
    steps = _steps(landings, rows)
    shapes = np.column_stack([kinks.shown, steps.shown])
    smooth = smooth_terms(landings, rows, shapes)
    least = LEAST_OF_PAIRS if n_feet > ALL_SETS_UP_TO else 0.0
    seen = kinks.visible(smooth, least)
    if not seen.size:
        missing = Message("maps.feet_exchange")
        raise AnalysisError(Message("maps.no_two_feet", {"what_is_missing": missing}))

    # Combinations in the order of how much is left of them: the faint ones come last.
    faint = kinks.visible(smooth, 0.0)[:, seen.shape[1] :]
    shown = kinks.shown @ seen
    change = smooth.change_by_third(np.column_stack([shown, steps.shown]))
    of_window = left_by_window(landings.expected, share)
    allowed = max(LEFT * of_window, OF_FOURTH * change.size**1.5) + landings.bent
    fit = fit_beside(smooth, shown)
    linear = smooth.linear(shown @ fit.coefficients)
    faded = kinks.faded(smooth, seen)
    of_kinks = faded * allowed
    left = of_kinks
    if not affords_third(landings, len(rows)):
        left = WITHOUT_THIRD * of_kinks
    found = _kink_fit(landings, fit, linear, seen, rows, of_kinks, left)
    found = replace(
        found,
        session=smooth.session,
        faded=faded,
        third_is_sure=change.squared > BY_CHANCE * change.error,
        smooth=smooth,
        shown=shown,
        faint=kinks.shown @ faint,
    )

    if not steps.shown.size:
        return found
    beside_kinks = smooth.and_also(shown)
    exchanges = _exchanges(landings, rows, steps, beside_kinks)
    steps = _as_exchanges(steps, exchanges)
    seen = steps.visible(beside_kinks, LEAST_OF_PAIRS)
    if not seen.size:
        return found
    fit = fit_beside(beside_kinks, steps.shown @ seen)
    # Where an input places a landing on one side, its slope has a part of the step.
    both = shown @ found.coefficients + steps.shown @ seen @ fit.coefficients
    linear = smooth.linear(both)
    of_jumps = max(LEFT_OF_JUMPS * of_window, OF_ALLOWED * allowed)
    of_jumps *= steps.faded(beside_kinks, seen)
    jumps = _kink_fit(landings, fit, linear, seen, rows, of_jumps, of_jumps)
    jumps = replace(jumps, shown=steps.shown @ seen, exchanges=tuple(exchanges))
    return replace(found, linear=linear, jumps=jumps)


def _kinks(landings: SectionLandings, rows: IntArray) -> Shapes:
    """Return the kinks of these landings."""
    instants = landings.expected[rows]
    return Shapes(
        shown=averaged.mean_kinks(instants, landings.unforetold.total),
        sharp=coordinates.kinks(instants),
    )


def _steps(landings: SectionLandings, rows: IntArray) -> Shapes:
    """Return the steps of these landings, of the feet that exchange their order."""
    instants = landings.expected[rows]
    pairs = averaged.pairs_that_exchange(instants, LEAST_CLASS)
    nothing = np.zeros_like(landings.unforetold.total)
    return Shapes(
        shown=averaged.steps(instants, landings.unforetold.total, pairs),
        sharp=averaged.steps(instants, nothing, pairs),
    )


def _exchanges(
    landings: SectionLandings, rows: IntArray, steps: Shapes, smooth: Smooth
) -> list[Exchange]:
    """Return the exchanges of order that these landings tell apart.

    `steps` are those of pairs, and `smooth` has the kinks among its terms.
    """

    def are_distinct(exchanges: Sequence[Exchange]) -> bool:
        of_exchanges = _as_exchanges(steps, exchanges)
        seen = of_exchanges.visible(smooth, LEAST_OF_PAIRS)
        return seen.shape[1] == len(exchanges)

    instants = landings.expected[rows]
    pairs = averaged.pairs_that_exchange(instants, LEAST_CLASS)
    return exchanges_of(pairs, instants, are_distinct)


def _as_exchanges(steps: Shapes, exchanges: Sequence[Exchange]) -> Shapes:
    """Return the steps of exchanges from those of pairs."""
    return Shapes(
        shown=steps_of(exchanges, steps.shown),
        sharp=steps_of(exchanges, steps.sharp),
    )


def _kink_fit(
    landings: SectionLandings,
    fit: Fit,
    linear: FloatArray,
    seen: FloatArray,
    rows: IntArray,
    allowed: float,
    left: float,
) -> KinkFit:
    """Return the fit with its scores at the rows of all landings."""
    number = len(landings.inputs)
    return KinkFit(
        coefficients=fit.coefficients,
        linear=linear,
        scores=_of_all(fit.scores, rows, number),
        null_scores=_of_all(fit.null_scores, rows, number),
        seen=seen,
        rows=rows,
        allowed=allowed,
        left=left,
    )


def _of_all(scores: FloatArray, rows: IntArray, number: int) -> FloatArray:
    """Return the scores (number, m) of all landings; zero beside the rows."""
    of_all = np.zeros((number, scores.shape[1]))
    of_all[rows] = scores
    return of_all


def nearest(instants: FloatArray, share: float) -> IntArray:
    """Return the numbers of the landings with the least contact spread, increasing."""
    by_spread = np.argsort(instants.std(axis=1), kind="stable")
    chosen = by_spread[: round(share * len(instants))]
    return np.sort(chosen)


def left_by_window(instants: FloatArray, share: float) -> float:
    """Return how much more smooth terms leave in this share than in `WINDOW`."""
    spreads = instants.std(axis=1)
    of_share = np.mean(spreads[nearest(instants, share)] ** 2)
    of_window = np.mean(spreads[nearest(instants, WINDOW)] ** 2)
    return float((of_share / of_window) ** (OF_SPREAD / 2.0))


def err_alike(scores: FloatArray) -> bool:
    """Return whether scores (N, m) resemble the next few more than by chance.

    Random signs give a resemblance of up to three standard errors by chance.
    """
    products = [np.sum(scores[k:] * scores[:-k], axis=1) for k in range(1, NEXT + 1)]
    resemblance = np.concatenate(products)
    by_chance = BY_CHANCE * np.linalg.norm(resemblance)
    return bool(resemblance.sum() > by_chance)


def one_landing(allowed: float) -> float:
    """Return the relative deviation of a difference at one landing from the mean.

    Like the derivative itself, the difference changes over the landings by the share c
    (see `LEFT`).
    """
    change = (allowed / OF_FOURTH) ** (2 / 3)
    return float(ONE_LANDING * change)


def upper_ends(sizes: list[float], allowed: float) -> list[float]:
    """Return upper ends for differences that appear as these `sizes`.

    At the simultaneous contact they are larger, because smooth terms may hide part of a
    difference, and because that contact is a single landing, which may deviate from the
    mean.
    """
    hidden = HIDDEN * allowed
    deviation = one_landing(allowed)
    return [size + float(np.hypot(hidden, deviation * size)) for size in sizes]
