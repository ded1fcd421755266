"""Which contact orders have a map of their own, each against all others pooled.

The sizes of pairs (`orders`) are of kinks, which are continuous from order to order,
and of jumps, which are the same wherever two feet exchange their order. Of three feet
no continuous map differs in one order alone: a bend at one of its two borders is a bend
of its neighbour, too. An order may still have a map of its own, which jumps at its
borders by what the state says, and whose mean jump may be zero.

Each order therefore gets an affine map of its own beside the smooth terms of the study.
The size is what this changes of the outcomes of its landings, rms, as a share of what
the mean map makes of the inputs. All orders are tested together (single-step max T, as
pairs are). If some are found, the largest joins the smooth terms, and the others are
tested again beside it, until none is found. So an order is not named for what another
one does. If a single order is found, the kinks and jumps of the study are tested once
more beside its map: if they are no longer found, this order alone differs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.landings.schedules import order_names
from hopdata.maps.coordinates import ALL_SETS_UP_TO
from hopdata.maps.draws import named_generator
from hopdata.maps.verdict import comparison as comparing
from hopdata.maps.verdict.comparison import Comparison
from hopdata.maps.verdict.data import Options
from hopdata.maps.verdict.inputs import STATE, SectionLandings, contact_orders
from hopdata.maps.verdict.linear import symmetric_root, whitened
from hopdata.maps.verdict.model import KinkFit
from hopdata.maps.verdict.orders import (
    OF_JUMPS,
    OF_ORDER,
    OTHERS,
    OneTest,
    PairEffect,
    Part,
    joint_level,
    pair_effects,
)
from hopdata.maps.verdict.signs import Draws, level_of, signed_errors
from hopdata.maps.verdict.smooth import Smooth, fit_beside

#: Landings of an order for each coefficient of a map of its own.
#: Unit: landings. Origin: chosen: with fewer the landings would be fitted rather than
#: their map.
LANDINGS_PER_COEFFICIENT = 3


@dataclass(frozen=True)
class _Order:
    """An order, which landings are of it, and the terms (n, 9) of its own map."""

    name: str
    rows: BoolArray
    terms: FloatArray


@dataclass(frozen=True)
class OwnMaps:
    """How far the map of each order is from that of all others.

    Attributes
    ----------
    effects
        One for each order with enough landings, with intervals that hold together. None
        of two feet, whose two orders are a pair, nor of so many feet that pairs of feet
        are compared.
    alone
        The order that alone differs, if it is the only one that is found and nothing
        else is found beside it; otherwise empty.
    """

    effects: list[PairEffect]
    alone: str = ""


def own_maps(
    fit: KinkFit,
    landings: SectionLandings,
    comparison: Comparison,
    options: Options,
    *,
    alike: bool,
) -> OwnMaps:
    """Return how far the map of each order is from that of all others.

    Parameters
    ----------
    fit
        Kinks of the study, and the smooth terms beside them.
    landings, comparison
        What they are of.
    options
        Seed, confidence and number of random signs.
    alike
        Whether successive landings err alike: see `signed_errors`.
    """
    n_feet = landings.expected.shape[1]
    if fit.smooth is None or not 2 < n_feet <= ALL_SETS_UP_TO:
        return OwnMaps([])
    every = _orders(landings, fit)
    if len(every) < 2:
        return OwnMaps([])
    level = level_of(options.confidence)
    named: list[str] = []
    effects = _effects(every, named, fit, landings, comparison, options, alike=alike)
    while len(named) < len(every) - 1:
        found = [
            one for one in effects if one.p_value < level and one.first not in named
        ]
        if not found:
            break
        named.append(max(found, key=lambda one: one.low).first)
        effects = _effects(
            every, named, fit, landings, comparison, options, alike=alike
        )
    alone = ""
    if len(named) == 1:
        terms = [one.terms for one in every if one.name in named]
        beside = fit.smooth.and_also(terms[0])
        rest = _p_value_of_rest(beside, fit, landings, comparison, options, alike=alike)
        if rest >= level:
            alone = named[0]
    return OwnMaps(effects, alone)


def _orders(landings: SectionLandings, fit: KinkFit) -> list[_Order]:
    """Return the orders that have enough landings in the window."""
    instants = landings.expected[fit.rows]
    states = whitened(landings.inputs[fit.rows, :STATE])
    own = np.column_stack([np.ones(len(states)), states])
    least = LANDINGS_PER_COEFFICIENT * own.shape[1]
    orders, _ = contact_orders(instants, least)
    each = np.argsort(instants, axis=1, kind="stable")
    found = []
    for order, name in zip(orders, order_names(orders), strict=True):
        rows = np.asarray((each == order).all(axis=1))
        found.append(_Order(name, rows, own * rows[:, None]))
    return found


def _effects(
    every: Sequence[_Order],
    named: Sequence[str],
    fit: KinkFit,
    landings: SectionLandings,
    comparison: Comparison,
    options: Options,
    *,
    alike: bool,
) -> list[PairEffect]:
    """Return the size of each order beside those that are named already."""
    smooth = fit.smooth
    if smooth is None:
        raise ValueError("expected the smooth terms of the kinks")
    weights = comparing.weights_of_map(fit, landings, comparison)
    parts = []
    n_all = len(fit.rows)
    for one in every:
        beside = smooth
        for other in every:
            if other.name in named and other.name != one.name:
                beside = beside.and_also(other.terms)
        own = _with_own_map(fit, beside, one)
        # A generator of the same name gives every order the same signs.
        generator = named_generator(options.seed, "verdict", "own maps")
        (errors,) = signed_errors([own], options.flips, generator, alike=alike)
        own = replace(own, null_scores=own.null_scores[:0])  # no longer needed
        n_own = int(one.rows.sum())
        mean_square = one.terms.T @ one.terms / n_own
        root = np.asarray(np.kron(symmetric_root(mean_square), weights), float)
        counts = (n_own, n_all - n_own)
        names = (one.name, OTHERS)
        parts.append(Part(OF_ORDER, names, own, errors, root, fit.allowed, counts))
    return pair_effects(
        parts, alike=alike, joint_p_value=0.0, confidence=options.confidence
    )


def _with_own_map(fit: KinkFit, beside: Smooth, order: _Order) -> KinkFit:
    """Return the fit of an order's own map in place of that of the kinks."""
    return _refitted(fit, beside, order.terms)


def _refitted(fit: KinkFit, beside: Smooth, shapes: FloatArray) -> KinkFit:
    """Return a fit with the coefficients of other shapes (n, K), or beside others."""
    own = fit_beside(beside, shapes)
    everywhere = (len(fit.scores), own.scores.shape[1])
    scores = np.zeros(everywhere)
    scores[fit.rows] = own.scores
    null_scores = np.zeros(everywhere)
    null_scores[fit.rows] = own.null_scores
    return replace(
        fit, coefficients=own.coefficients, scores=scores, null_scores=null_scores
    )


def _p_value_of_rest(
    beside: Smooth,
    fit: KinkFit,
    landings: SectionLandings,
    comparison: Comparison,
    options: Options,
    *,
    alike: bool,
) -> float:
    """Return the p-value of the kinks and jumps of a study beside further terms."""
    if fit.shown is None:
        raise ValueError("expected the kinks that were fitted")
    parts = [_refitted(fit, beside, fit.shown)]
    roots: list[FloatArray] = [comparing.squared_size(fit, landings, comparison)]
    shares = [1.0]
    jumps = fit.jumps
    if jumps is not None and jumps.shown is not None:
        parts.append(_refitted(jumps, beside.and_also(fit.shown), jumps.shown))
        roots.append(comparing.squared_jump(fit, landings, comparison))
        shares = [1.0 - OF_JUMPS, OF_JUMPS]
    generator = named_generator(options.seed, "verdict", "rest")
    errors = signed_errors(parts, options.flips, generator, alike=alike)
    tests = []
    for part, root, signed, share in zip(parts, roots, errors, shares, strict=True):
        draws = Draws(part, root, signed, alike=alike)
        tests.append(OneTest(draws, part.allowed, share))
    return joint_level(tests, level_of(options.confidence)).p_value
