"""What limits a study that cannot tell, and by how much it would have to change.

A study finds a difference beyond what is allowed for, A, and beyond its noise, N: its
detectable size is A + N. Each cause adds to one of the two. How much the detectable
size would fall if this cause were as in a usual good study says how much it limits, and
the causes are listed by it, largest first. What each would have to be is solved for
alone, with all others as they are, so that the detectable size is the margin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from hopdata.errors import AnalysisError
from hopdata.maps.verdict import inputs
from hopdata.maps.verdict.effect import MOST_LANDINGS, EffectSize
from hopdata.maps.verdict.inputs import LEAST_CLASS, SectionLandings
from hopdata.maps.verdict.model import BY_CHANCE, LEFT, KinkFit
from hopdata.maps.verdict.signs import IN_A_ROW
from hopdata.maps.verdict.words import asked_for, at_most, percent
from hopdata.messages import Message

#: Landings of a usual good study, which a study is compared with.
#: Unit: landings. Origin: chosen: ten minutes of hops at less than two a second.
USUAL_LANDINGS = 1000

#: A cause that adds less than this share of the detectable size is not listed.
#: Unit: 1. Origin: chosen.
LEAST_SHARE = 0.03

# Velocities among the inputs and the outcomes: the outcome's direct noise is that of
# the same velocities before the landing.
OF_INPUTS = slice(2, 5)
OF_OUTPUTS = slice(5, 8)

# Reasons for which there is no size -> what then limits the study, and its sentence.
REASONS = {
    "maps.too_few_landings": ("landings", "maps.none_for_landings"),
    "maps.too_few_orders": ("orders", "maps.none_for_orders"),
    "maps.no_two_feet": ("orders", "maps.none_for_orders"),
    "maps.same_instants": ("spread", "maps.none_for_spread"),
    "maps.states_do_not_vary": ("spread", "maps.none_for_spread"),
    "maps.orders_not_foretold": ("posture", "maps.none_for_posture"),
    "maps.markers_move_apart": ("noise", "maps.none_for_noise"),
}


@dataclass(frozen=True)
class Limit:
    """A cause that limits a study.

    Attributes
    ----------
    cause
        ``"estimate"``, ``"landings"``, ``"noise"``, ``"posture"``, ``"spread"``,
        ``"drift"``, ``"sections"``, ``"saturation"`` or ``"orders"``.
    costs
        By how much the detectable size would fall without it, as a share of the map;
        None if this cannot be told.
    said
        What is now, and what it would have to be.
    """

    cause: str
    costs: float | None
    said: Message

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, for ``verdict.json``."""
        return {
            "cause": self.cause,
            "costs": self.costs,
            "said": str(self.said),
            **self.said.to_dict(),
        }


# The sentence where landings of the table of touchdowns were lost.
SOME_LOST = "maps.none_for_landings_lost"


def limits_of_reason(
    error: AnalysisError,
    orders: Sequence[Any],
    lost: Mapping[str, Sequence[int]] = MappingProxyType({}),
) -> list[Limit]:
    """Return what limits a study without a size; nothing if it is another mistake.

    Parameters
    ----------
    error
        Why there is no size.
    orders
        Those that occur, with their ``landings``: see `preliminary`.
    lost
        Numbers of the landings that could not be judged, by the reason.
    """
    found = REASONS.get(str(error.code))
    if found is None:
        return []
    cause, sentence = found
    values = dict(getattr(error.args[0], "values", {}))
    values |= {"least_of_order": LEAST_CLASS}
    if "least" in values and "found" in values:
        values["missing"] = values["least"] - values["found"]
    if cause == "landings" and lost:
        sentence = SOME_LOST
        values |= _lost_of(lost)
    told = [f"{one['order']} ({one['landings']})" for one in orders]
    values["orders"] = ", ".join(told) or "none"
    limits = [Limit(cause, None, Message(sentence, values))]
    if len(orders) == 1 and cause != "orders":
        # More of the same would not help: without a second order nothing is compared.
        of_one = {**orders[0], "least_of_order": LEAST_CLASS}
        only = Limit("orders", None, Message("maps.none_for_one_order", of_one))
        limits.insert(0, only)
    return limits


def _lost_of(lost: Mapping[str, Sequence[int]]) -> dict[str, Any]:
    """Return how many landings could not be judged, and why, in numbers and words."""
    why = []
    for reason, rows in lost.items():
        why.append(str(Message(f"maps.{reason}", {"count": len(rows)})))
    numbers = set().union(*lost.values())
    return {"lost": len(numbers), "why": ", ".join(why), "rows": dict(lost)}


@dataclass(frozen=True)
class _Detectable:
    """What is allowed for, the noise of the detectable size, and the margin."""

    allowed: float
    noise: float
    margin: float


def what_limits_most(
    effect: EffectSize,
    fit: KinkFit,
    landings: SectionLandings,
    *,
    margin: float,
    alike: bool,
    saturates: bool = False,
) -> list[Limit]:
    """Return the causes that limit a study, the one that costs most first.

    Parameters
    ----------
    effect, fit, landings
        The size, the kinks it is of, and the landings they were fitted to.
    margin
        Difference that the study is to exclude.
    alike
        Whether successive landings err alike.
    saturates
        Whether the difference is found to saturate.
    """
    shown = min(effect.detectable, 1e3)
    size = _Detectable(fit.allowed, max(shown - fit.allowed, 0.0), margin)
    n_landings, n_feet = landings.expected.shape
    needed = _needed(effect, n_landings, margin, n_feet)
    of_landings = _of_landings(n_landings, needed, size, n_feet, saturates=saturates)
    found = [
        of_landings,
        _of_noise(fit, landings, size),
        _of_posture(fit, landings, size),
        _of_spread(fit, landings),
        _of_sections(fit, landings),
        _of_drift(fit, size, alike=alike),
    ]
    least = LEAST_SHARE * shown
    listed = [one for one in found if (one.costs or 0.0) > least]
    listed.sort(key=lambda one: -(one.costs or 0.0))
    first = _of_saturation(effect, saturates=saturates)
    if not saturates and needed is not None and needed <= n_landings:
        # More landings are not what such a study lacks.
        listed = [one for one in listed if one.cause != "landings"]
        first = [_of_estimate(effect, landings, margin)]
    elif not listed:
        # Nothing is worse than in a usual study; this one asks for more.
        listed = [of_landings]
    return first + listed + _missing_orders(landings)


def _of_saturation(effect: EffectSize, *, saturates: bool) -> list[Limit]:
    """Return that saturation leaves no bound at the contact, if it is found.

    It stands first: what the others cost is told of the mean over the landings.
    """
    if not saturates:
        return []
    values = {"over": at_most(effect.upper_bound)}
    return [Limit("saturation", None, Message("maps.limit_saturation", values))]


def _needed(effect: EffectSize, landings: int, margin: float, feet: int) -> int | None:
    """Return how many landings would show the margin; None if too many."""
    try:
        needed = effect.landings_needed(landings, margin, feet)
    except AnalysisError:
        return None
    if needed > MOST_LANDINGS:
        return None
    return needed


def _of_estimate(effect: EffectSize, landings: SectionLandings, margin: float) -> Limit:
    """Return that a study has the landings for its power, but a large estimate.

    It stands first, and what it costs is not told: another study of the same kind would
    most likely have no such estimate.
    """
    n_landings, n_feet = landings.expected.shape
    values: dict[str, Any] = {
        "landings": n_landings,
        "margin": percent(margin),
        "estimate": percent(effect.estimate),
    }
    needed = effect.landings_for_bound(n_landings, margin, n_feet)
    code = "maps.limit_estimate_no"
    if needed is not None and needed <= MOST_LANDINGS:
        values["needed"] = f"{asked_for(needed, n_landings):,}"
        code = "maps.limit_estimate"
    return Limit("estimate", None, Message(code, values))


def _of_landings(
    n_landings: int,
    needed: int | None,
    size: _Detectable,
    feet: int,
    *,
    saturates: bool,
) -> Limit:
    for_terms = inputs.landings_for_terms(feet)
    free = max(1.0, n_landings - for_terms)
    usual = max(free, USUAL_LANDINGS - for_terms)
    costs = float(size.noise * (1.0 - np.sqrt(free / usual)))
    values = {"landings": n_landings, "margin": percent(size.margin)}
    if needed is None:
        return Limit("landings", costs, Message("maps.limit_landings_no", values))
    if saturates and needed <= n_landings:
        said = Message("maps.limit_landings_saturates_enough", values)
        return Limit("landings", costs, said)
    values["needed"] = f"{asked_for(needed, n_landings):,}"
    name = "maps.limit_landings"
    if saturates:
        name = "maps.limit_landings_saturates"
    return Limit("landings", costs, Message(name, values))


def share_of_noise(fit: KinkFit, landings: SectionLandings) -> float:
    """Return which share of the outcomes' scatter is noise of the measurement.

    It is told by the velocities after the landing: their own noise is that of those
    before it, and the map hands on the noise of the state.
    """
    smooth = fit.smooth
    if smooth is None:
        return 0.0
    rest = smooth.without(smooth.outputs)[:, OF_OUTPUTS]
    freedom = max(1, len(rest) - smooth.basis.shape[1])
    scatter = float(np.sum(rest**2)) / freedom
    own = float(np.trace(landings.noise[OF_INPUTS, OF_INPUTS]))
    slopes = fit.linear[:, OF_OUTPUTS]
    handed_on = float(np.trace(slopes.T @ landings.noise @ slopes))
    if not scatter > 0.0:
        return 0.0
    return min(1.0, (own + handed_on) / scatter)


def _of_noise(fit: KinkFit, landings: SectionLandings, size: _Detectable) -> Limit:
    share = share_of_noise(fit, landings)
    costs = size.noise * (1.0 - np.sqrt(1.0 - share))
    costs += _blurred(fit, size) * (1.0 - _share_of_posture(landings))
    values = {"share": percent(share), "margin": percent(size.margin)}
    room = max(0.0, size.margin - size.allowed)
    left = (room / max(size.noise, 1e-12)) ** 2 - (1.0 - share)
    if share <= 0.0 or left <= 0.0:
        return Limit("noise", float(costs), Message("maps.limit_noise_no", values))
    if left >= share:
        return Limit("noise", float(costs), Message("maps.limit_noise_some", values))
    factor = np.sqrt(left / share)
    values["factor"] = percent(float(factor))
    return Limit("noise", float(costs), Message("maps.limit_noise", values))


def _blurred(fit: KinkFit, size: _Detectable) -> float:
    """Return what it costs that kinks are averaged over what is not foretold."""
    fainter = 1.0 - 1.0 / max(fit.faded, 1.0)
    return (size.allowed + size.noise) * fainter


def _share_of_posture(landings: SectionLandings) -> float:
    """Return which share of what is not foretold is posture; the rest is noise."""
    total = float(np.trace(landings.unforetold.total))
    if not total > 0.0:
        return 0.0
    return min(1.0, float(np.trace(landings.unforetold.by_posture)) / total)


def _of_posture(fit: KinkFit, landings: SectionLandings, size: _Detectable) -> Limit:
    costs = _blurred(fit, size) * _share_of_posture(landings)
    values = {
        "share": f"{100 * landings.foretold:.1f} %",
        "well": percent(inputs.WELL_FORETOLD),
    }
    name = "maps.limit_posture"
    if landings.posture is inputs.Posture.NOT_SEEN:
        name = "maps.limit_posture_not_seen"
    return Limit("posture", costs, Message(name, values))


def _of_spread(fit: KinkFit, landings: SectionLandings) -> Limit:
    sharp = fit.sharp(landings.bent)
    costs = max(0.0, sharp - LEFT) * fit.faded
    values = {"allowed": percent(fit.allowed), "usual": percent(LEFT)}
    if fit.wants_landings(landings.bent):
        return Limit("spread", costs, Message("maps.limit_spread_few", values))
    # What smooth terms leave grows as the cube of the contacts' spread.
    factor = (LEFT / sharp) ** (1.0 / 3.0) if sharp > 0.0 else 1.0
    values["factor"] = percent(min(1.0, factor))
    return Limit("spread", costs, Message("maps.limit_spread", values))


def _of_sections(fit: KinkFit, landings: SectionLandings) -> Limit:
    values = {"bent": percent(landings.bent)}
    costs = landings.bent * fit.faded
    return Limit("sections", costs, Message("maps.limit_sections", values))


def slow_share(fit: KinkFit) -> float:
    """Return which share of the outcomes' scatter is the same from one to the next.

    It is the correlation of what the fit leaves of successive landings; 0 if chance
    gives as much.
    """
    smooth = fit.smooth
    if smooth is None:
        return 0.0
    rest = smooth.without(smooth.outputs)
    squares = np.sum(rest**2, axis=0)
    if not squares.all():
        return 0.0
    rest = rest / np.sqrt(squares)
    likeness = np.sum(rest[1:] * rest[:-1], axis=0)
    # A drift seldom shows in one outcome only.
    of_two_likest = float(np.sort(likeness)[-2:].mean())
    if of_two_likest < BY_CHANCE / np.sqrt(len(rest)):
        return 0.0
    return min(1.0, of_two_likest)


def _of_drift(fit: KinkFit, size: _Detectable, *, alike: bool) -> Limit:
    share = slow_share(fit)
    wider = 1.0
    if alike:
        scores = fit.null_scores
        together = np.add.reduceat(scores, np.arange(0, len(scores), IN_A_ROW))
        wider = float(np.linalg.norm(together) / np.linalg.norm(scores))
    without = np.sqrt(1.0 - share) / max(wider, 1.0)
    values = {"share": percent(share), "wider": f"{1.0 / max(without, 1e-3):.1f}"}
    costs = float(size.noise * (1.0 - without))
    return Limit("drift", costs, Message("maps.limit_drift", values))


def _missing_orders(landings: SectionLandings) -> list[Limit]:
    """Return the contact orders that occur too rarely to be compared, if any."""
    n_feet = landings.expected.shape[1]
    if n_feet > inputs.coordinates.ALL_SETS_UP_TO:
        return []
    orders, _ = inputs.contact_orders(landings.expected, LEAST_CLASS)
    possible = int(np.prod(np.arange(1, n_feet + 1)))
    if len(orders) == possible:
        return []
    values = {
        "found": len(orders),
        "possible": possible,
        "least_of_order": LEAST_CLASS,
    }
    return [Limit("orders", None, Message("maps.limit_orders", values))]
