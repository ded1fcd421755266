"""Which contact orders differ, beside whether any do; and the level of both.

**Kinks and jumps together.** A study is different if its kinks or its jumps are. These
are two tests, and one of them alone would err in 5 % of the studies without a
difference. The rarest of both p-values is therefore compared with its own distribution
over the random signs, which both tests share (Westfall and Young 1993). The jumps have
a fifth of the level, `OF_JUMPS`: kinks are tested at some 4 %, jumps at some 1 %, and
one of the two errs in 5 % (`joint_level`).

**Which.** e^2 is the mean over pairs of orders, or of feet. Each pair has a size of its
own, and all pairs, those of maps and those of jumps, are tested together: the largest
of their statistics, each as a share of its own 95 % quantile, is compared with its own
distribution over the same signs (single-step max T of Westfall and Young). The
intervals of all pairs hold together. No pair is different unless the study is, as
closed testing asks for.

What smooth terms may leave of a pair is the same share of its kinks as of all: pairs
of opposite orders allow for more than pairs of similar ones, and `KinkFit.allowed` is
the root of the mean square over the pairs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray, pd
from hopdata.feet import AND, foot_called, with_foot_names
from hopdata.maps.verdict import comparison as comparing
from hopdata.maps.verdict.comparison import Comparison
from hopdata.maps.verdict.effect import interval
from hopdata.maps.verdict.exchanges import TOGETHER
from hopdata.maps.verdict.inputs import SectionLandings
from hopdata.maps.verdict.model import KinkFit
from hopdata.maps.verdict.signs import Draws, SignedErrors, level_of
from hopdata.messages import Message, in_per_cent

#: Share of the level that the test of jumps has, if there can be any.
#: Unit: 1. Origin: measured: beside a test of kinks alone the size of kinks that is
#: found in 80 % of studies rises by 1 to 2 %, and with equal shares by 4 to 8 %. That
#: of jumps rises by 4 to 7 % in place of 3 to 4 %, but is smaller anyway (14 simulated
#: studies of some 600 landings).
OF_JUMPS = 0.2

#: A pair is left out if less than this share of the square of its difference, beside
#: that of the others, is distinct from smooth terms, as of two feet that always touch
#: together.
#: Unit: 1. Origin: chosen.
LEAST_SEEN = 0.1

# What a pair differs in, and an order differs in from all others.
OF_MAP = "map"
OF_JUMP = "jump"
OF_ORDER = "order"

# With what an order is compared that is compared with all others.
OTHERS = "others"


@dataclass(frozen=True)
class PairEffect:
    """The difference between two orders, or between either order of two feet.

    Attributes
    ----------
    of
        ``"map"``: relative difference of the Jacobians; ``"jump"``: jump of the outcome
        as a share of what the mean map makes of the inputs; ``"order"``: what a map of
        its own changes of an order's outcomes, likewise (see `own_maps`).
    first, second
        The orders, as ``"1>2>3"``; for pairs of feet ``"1>2"`` and ``"2>1"``, or
        ``"1>2, 4>3"`` and ``"2>1, 3>4"`` if they exchange their order together; if an
        order is compared with all others, the second is ``"others"``.
    estimate, low, high
        Size and interval as those of the study, `EffectSize`. The intervals of all
        pairs, of maps and of jumps, hold together; so do, apart from these, those of
        all orders that are compared with all others. `low` is above zero if the two
        differ.
    p_value
        Of a size of at most `allowed`, adjusted for all that hold together.
    n_first, n_second
        Number of landings of either; of pairs that exchange their order together, those
        that agree.
    allowed
        Size that is no evidence, since smooth terms may leave it.
    """

    of: str
    first: str
    second: str
    estimate: float
    low: float
    high: float
    p_value: float
    n_first: int
    n_second: int
    allowed: float


def orders_table(effects: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Return the sizes of pairs as a table, a row for each `PairEffect`."""
    columns = [item.name for item in fields(PairEffect)]
    return pd.DataFrame(list(effects), columns=columns)


@dataclass(frozen=True)
class OneTest:
    """One of the tests of a study.

    Attributes
    ----------
    draws
        Draws of its statistic, from the same random signs as those of the others.
    allowed
        Size that is no evidence.
    share
        Its share of the level.
    """

    draws: Draws
    allowed: float
    share: float


@dataclass(frozen=True)
class JointLevel:
    """The level of the tests of a study, of which one errs at the level of the study.

    Attributes
    ----------
    of_each
        A test finds a difference if its own p-value is below its level.
    p_value
        Share of the sign patterns, with the data, in which the rarest statistic is as
        rare.
    """

    of_each: list[float]
    p_value: float


def joint_level(tests: Sequence[OneTest], level: float) -> JointLevel:
    """Return the level of each test.

    Parameters
    ----------
    tests
        Of kinks, and of jumps if there can be any.
    level
        Probability that one or more find a difference where there is none.
    """
    of_draws = []
    of_data = []
    for test in tests:
        drawn = test.draws.statistics(test.allowed)
        places, place = _as_large(drawn, test.draws.statistic)
        of_draws.append(places / test.share)
        of_data.append(place / test.share)
    found = min(of_data)
    rarest = np.sort(np.append(np.min(of_draws, axis=0), found))
    n = len(rarest)

    # The first that is not rare is above the level with its whole group of equals.
    within = np.searchsorted(rarest, rarest, side="right") / n < level
    n_within = int(within.sum())
    last = 0.0
    if n_within:
        last = float(rarest[n_within - 1])
    critical = 0.5 * (last + float(rarest[n_within]))
    return JointLevel(
        of_each=[critical * test.share / n for test in tests],
        p_value=float(np.searchsorted(rarest, found, side="right") / n),
    )


def _as_large(drawn: FloatArray, found: float) -> tuple[IntArray, int]:
    """Return how many of all statistics, with itself, are as large as each."""
    every = np.append(drawn, found)
    below = np.searchsorted(np.sort(every), every, side="left")
    places = len(every) - below
    return places[:-1], int(places[-1])


@dataclass(frozen=True)
class Part:
    """A pair that is compared.

    Attributes
    ----------
    of, names
        What it differs in, and the two names: see `PairEffect`.
    fit, errors
        Kinks, jumps or a map of its own, and random errors of their coefficients.
    root
        Root of its squared size.
    allowed
        Size that is no evidence.
    counts
        Number of landings of either.
    """

    of: str
    names: tuple[str, str]
    fit: KinkFit
    errors: SignedErrors
    root: FloatArray
    allowed: float
    counts: tuple[int, int]


def pair_effects(
    pairs: Sequence[Part],
    *,
    alike: bool,
    joint_p_value: float,
    confidence: float,
) -> list[PairEffect]:
    """Return the size of each pair, with intervals that hold together.

    Parameters
    ----------
    pairs
        Pairs of orders or of feet: see `pairs_of_maps` and `pairs_of_jumps`.
    alike
        Whether successive landings err alike: see `signed_errors`.
    joint_p_value
        Of the study. No pair has a smaller one.
    confidence
        Confidence of all intervals together.
    """
    level = level_of(confidence)
    draws = [Draws(p.fit, p.root, p.errors, alike=alike) for p in pairs]
    usual = []
    shares = []
    for pair, of_pair in zip(pairs, draws, strict=True):
        statistics = of_pair.statistics(pair.allowed)
        usual.append(float(np.quantile(statistics, confidence)))
        shares.append(statistics / usual[-1])
    largest = np.max(shares, axis=0)
    critical = float(np.quantile(largest, confidence, method="higher"))
    n = 1 + len(largest)

    effects = []
    for pair, of_pair, at, drawn in zip(pairs, draws, usual, shares, strict=True):
        as_large = int(np.sum(largest >= of_pair.statistic / at))
        p_value = max((1 + as_large) / n, joint_p_value)
        # The level at which all pairs together err at the level of the study.
        own_level = (1 + int(np.sum(drawn >= critical))) / n
        ends = interval(
            of_pair,
            pair.allowed,
            is_found=p_value < level,
            level_found=own_level,
            level=own_level,
        )
        squared = of_pair.statistic - of_pair.of_noise
        effects.append(
            PairEffect(
                of=pair.of,
                first=pair.names[0],
                second=pair.names[1],
                estimate=float(np.sqrt(max(0.0, squared))),
                low=ends.low,
                high=ends.high,
                p_value=p_value,
                n_first=pair.counts[0],
                n_second=pair.counts[1],
                allowed=pair.allowed,
            )
        )
    return effects


def largest_high(effects: Sequence[PairEffect], of: str) -> float | None:
    """Return the bound that holds for each of the maps, or jumps; None of none.

    Intervals of pairs hold together, so the largest of their high ends does.
    """
    return max((effect.high for effect in effects if effect.of == of), default=None)


def pairs_of_maps(
    fit: KinkFit,
    errors: SignedErrors,
    landings: SectionLandings,
    comparison: Comparison,
) -> list[Part]:
    """Return the pairs whose maps are compared; the mean of their squares is e^2."""
    changes = comparing.changes_of_map(fit, landings, comparison)
    weights = comparing.weights_of_map(fit, landings, comparison)
    squares = np.sum(changes**2, axis=(1, 2))
    mean_square = squares.mean()
    pairs = []
    for names, change, square in zip(comparison.names, changes, squares, strict=True):
        if square < LEAST_SEEN * mean_square:
            continue
        root = np.kron(change.T, weights)
        allowed = float(np.sqrt(square / mean_square) * fit.allowed)
        counts = _landings_of(names, landings.expected[fit.rows])
        pairs.append(Part(OF_MAP, names, fit, errors, root, allowed, counts))
    return pairs


def pairs_of_jumps(
    fit: KinkFit,
    errors: SignedErrors,
    landings: SectionLandings,
    comparison: Comparison,
) -> list[Part]:
    """Return the pairs of feet at whose exchange the outcome may jump.

    `fit` is that of the kinks, and `errors` are those of its jumps.
    """
    steps = fit.jumps
    if steps is None:
        return []
    instants = landings.expected[steps.rows]
    weights = comparing.weights_of_map(fit, landings, comparison)
    pairs = []
    for exchange, seen in zip(steps.exchanges, steps.seen, strict=True):
        if np.sum(seen**2) < LEAST_SEEN:
            continue
        root = np.kron(2.0 * seen[None, :], weights)
        names = comparing.names_of_exchange(exchange)
        counts = _landings_of(names, instants)
        part = Part(OF_JUMP, names, steps, errors, root, steps.allowed, counts)
        pairs.append(part)
    return pairs


def _landings_of(names: tuple[str, str], instants: FloatArray) -> tuple[int, int]:
    """Return how many landings come in either order, of all feet or of some pairs."""
    counts = []
    for name in names:
        is_all = np.full(len(instants), True)
        for order in name.split(AND):
            feet = [int(foot) - 1 for foot in _feet(order)]
            in_order = np.diff(instants[:, feet], axis=1) > 0.0
            is_all &= in_order.all(axis=1)
        counts.append(int(is_all.sum()))
    return counts[0], counts[1]


# What the differences have in common, in words.

# Place of a foot in an order -> what is said of orders that differ there.
PLACES = {
    0: ("maps.begin_differently", "maps.begin_with", "maps.begin_with_either"),
    -1: ("maps.end_differently", "maps.end_with", "maps.end_with_either"),
}
Parted = Callable[[tuple[str, ...], tuple[str, ...]], bool]


def mainly(
    effects: Sequence[PairEffect],
    instants: FloatArray,
    alone: str = "",
    names: Sequence[str] = (),
) -> Message | None:
    """Return which orders differ most or surest, or which feet; None if none was found.

    What a group of pairs has in common is said if all of the group were found and even
    the low ends of their intervals are above the estimates of all other pairs.
    Otherwise the pair with the largest low end is named. It is said to differ most if
    this end is above the high ends of all others, whose intervals hold together. If
    not, it is said to be surest to differ: another seed may name another, and pairs
    whose low ends read the same are named together. Of feet, pairs that exchange their
    order together are named together, since few landings or none tell them apart.

    Parameters
    ----------
    effects
        See `pair_effects`.
    instants
        (n, feet) expected contact instants.
    alone
        The order that alone differs, if there is one: see `own_maps`.
    names
        Names of the feet; without them their numbers are said.
    """
    if alone:
        return Message("maps.mainly_alone", {"order": with_foot_names(alone, names)})
    of_maps = [effect for effect in effects if effect.of == OF_MAP]
    of_jumps = [effect for effect in effects if effect.of == OF_JUMP]
    maps = _mainly_maps(of_maps, instants, names)
    jumps = _mainly_jump(of_jumps, names)
    if maps is not None and jumps is not None:
        return Message("maps.mainly_both", {"maps": maps, "jumps": jumps})
    return maps or jumps


def _mainly_maps(
    effects: Sequence[PairEffect], instants: FloatArray, names: Sequence[str]
) -> Message | None:
    surest = _surest(effects)
    if not surest or len(effects) == 1:
        return None
    is_largest = _is_largest(surest[0], effects)
    if len(_feet(surest[0].first)) == 2:
        together = _together(surest, instants, names)
        code = "maps.surest_feet"
        if is_largest:
            code = "maps.mainly_feet"
        return Message(code, {"feet": together})
    common = _in_common(effects, names)
    if common is not None:
        return common
    values = [
        {
            "first": with_foot_names(effect.first, names),
            "second": with_foot_names(effect.second, names),
        }
        for effect in surest
    ]
    if is_largest:
        return Message("maps.mainly_pair", values[0])
    pairs = [Message("maps.two_orders", pair) for pair in values]
    return Message("maps.surest_pair", {"pairs": _and_likewise(pairs)})


def _mainly_jump(effects: Sequence[PairEffect], names: Sequence[str]) -> Message | None:
    surest = _surest(effects)
    if not surest or len(effects) == 1:
        return None
    exchanges = []
    for effect in surest:
        said = []
        for order in effect.first.split(AND):
            first, second = sorted(int(foot) - 1 for foot in _feet(order))
            said.append(_both(first, second, names))
        exchanges.append(_any_of(said))
    code = "maps.surest_jump"
    if _is_largest(surest[0], effects):
        code = "maps.mainly_jump"
    return Message(code, {"feet": _and_likewise(exchanges)})


def _surest(effects: Sequence[PairEffect]) -> list[PairEffect]:
    """Return the pair with the largest low end, and those whose low end reads the same.

    Of pairs of which none was found, there is none.
    """
    found = [effect for effect in effects if effect.low > 0.0]
    found.sort(key=lambda effect: -effect.low)
    if not found:
        return []
    surest = in_per_cent(found[0].low)
    return [one for one in found if in_per_cent(one.low) == surest]


def _is_largest(one: PairEffect, effects: Sequence[PairEffect]) -> bool:
    """Tell whether the intervals, which hold together, leave no pair as large."""
    return all(one.low > effect.high for effect in effects if effect is not one)


def _and_likewise(said: Sequence[Message | str]) -> Message | str:
    """Return the pairs as one list."""
    pairs = said[0]
    for another in said[1:]:
        values = {"pairs": pairs, "another": another}
        pairs = Message("maps.and_likewise", values)
    return pairs


def _in_common(effects: Sequence[PairEffect], names: Sequence[str]) -> Message | None:
    """Return what the largest group of clearly larger pairs has in common, if any."""
    best: Message | None = None
    most = 0
    for said, parted in _statements(effects, names):
        group = []
        others = []
        for effect in effects:
            if parted(_feet(effect.first), _feet(effect.second)):
                group.append(effect)
            else:
                others.append(effect)
        if len(group) <= most or not others:
            continue
        least = min(effect.low for effect in group)
        if least > max(0.0, *(effect.estimate for effect in others)):
            best = said
            most = len(group)
    return best


def _together(
    effects: Sequence[PairEffect], instants: FloatArray, names: Sequence[str]
) -> Message | str:
    """Return pairs of feet, each with all that exchange their order with it."""
    named: set[tuple[int, int]] = set()
    said = []
    for effect in effects:
        first, second = sorted(int(foot) - 1 for foot in _feet(effect.first))
        if (first, second) in named:
            continue
        alike = [(first, second), *_exchanged_with(first, second, instants)]
        named.update(alike)
        said.append(_any_of([_both(i, j, names) for i, j in alike]))
    return _and_likewise(said)


def _exchanged_with(
    first: int, second: int, instants: FloatArray
) -> list[tuple[int, int]]:
    """Return the pairs of feet that exchange their order together with these two."""
    exchanged = np.sign(instants[:, first] - instants[:, second])
    found = []
    for i, j in combinations(range(instants.shape[1]), 2):
        other = np.sign(instants[:, i] - instants[:, j])
        alike = abs(float(np.mean(exchanged * other)))
        if (i, j) != (first, second) and alike > TOGETHER:
            found.append((i, j))
    return found


def _any_of(said: list[str]) -> str:
    """Return pairs of feet in words, of which any may be meant."""
    if len(said) == 1:
        return said[0]
    return str(Message("maps.feet_together", {"pairs": " or ".join(said)}))


def _both(first: int, second: int, names: Sequence[str]) -> str:
    called = {
        "a": foot_called(first + 1, names),
        "b": foot_called(second + 1, names),
    }
    return str(Message("maps.two_feet", called))


def _statements(
    effects: Sequence[PairEffect], names: Sequence[str]
) -> list[tuple[Message, Parted]]:
    """Return what may part the orders of pairs: a foot that is first, last or before.

    Each comes with a function of two orders that tells whether it parts them.
    """
    feet = sorted(_feet(effects[0].first), key=int)
    called = {foot: foot_called(foot, names) for foot in feet}
    statements: list[tuple[Message, Parted]] = []
    for place, (differently, with_one, with_either) in PLACES.items():
        statements.append((Message(differently), partial(_differ_at, place)))
        for foot in feet:
            said = Message(with_one, {"a": called[foot]})
            statements.append((said, partial(_one_has, place, foot)))
        for a, b in combinations(feet, 2):
            said = Message(with_either, {"a": called[a], "b": called[b]})
            statements.append((said, partial(_have, place, {a, b})))
    for a, b in combinations(feet, 2):
        said = Message("maps.before", {"a": called[a], "b": called[b]})
        statements.append((said, partial(_exchanged, a, b)))
    return statements


def _differ_at(place: int, one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    return one[place] != other[place]


def _one_has(
    place: int, foot: str, one: tuple[str, ...], other: tuple[str, ...]
) -> bool:
    return (one[place] == foot) != (other[place] == foot)


def _have(
    place: int, feet: set[str], one: tuple[str, ...], other: tuple[str, ...]
) -> bool:
    return {one[place], other[place]} == feet


def _exchanged(a: str, b: str, one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    before = one.index(a) < one.index(b)
    return before != (other.index(a) < other.index(b))


def _feet(order: str) -> tuple[str, ...]:
    return tuple(order.split(">"))
