"""Exchanges of order: pairs of feet that no landing tells apart count as one.

Where two feet exchange their order the outcome may jump. Parallel sides of a rigid
rectangle or hexagon exchange together: a landing in which feet 1 and 2 come in the
other order is one in which feet 4 and 3 do. A jump of either is seen as that of both,
and their steps beside each other would share it out. What the body does when it crosses
is the sum, which one step for both has as its coefficient, whichever of them jumps.

So pairs become one exchange, those that agree best first, until all exchanges are
distinct.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray

#: Two pairs of feet exchange their order together if they agree, or disagree, in this
#: share more of the landings than they do not.
#: Unit: 1. Origin: chosen.
TOGETHER = 0.8

Pair = tuple[int, int]
# Pairs (i, j) of feet: i comes before j in all of them, or after j in all of them.
Exchange = tuple[Pair, ...]


def exchanges_of(
    pairs: Sequence[Pair],
    instants: FloatArray,
    are_distinct: Callable[[Sequence[Exchange]], bool],
) -> list[Exchange]:
    """Return the exchanges that landings tell apart, as far as pairs agree.

    Parameters
    ----------
    pairs
        Pairs (i, j) of feet that exchange their order.
    instants
        (n, feet) expected contact instants.
    are_distinct
        Whether all steps of some exchanges are visible beside each other.
    """
    exchanges: list[Exchange] = [(pair,) for pair in pairs]
    while not are_distinct(exchanges):
        by_two = {
            (one, other): _agreement(one, other, instants)
            for one, other in combinations(exchanges, 2)
        }
        one, other = max(by_two, key=lambda two: abs(by_two[two]), default=((), ()))
        alike = by_two.get((one, other), 0.0)
        if abs(alike) <= TOGETHER:
            break
        exchanges[exchanges.index(one)] = (*one, *_turned(other, alike))
        exchanges.remove(other)
    return exchanges


def steps_of(exchanges: Sequence[Exchange], of_pairs: FloatArray) -> FloatArray:
    """Return the steps (n, exchanges): the mean over the pairs of each.

    Parameters
    ----------
    exchanges
        Exchanges.
    of_pairs
        (n, pairs) steps of the pairs i < j in all of them, in lexicographic order.
    """
    pairs = sorted(_upright(pair) for exchange in exchanges for pair in exchange)
    means = np.zeros((len(pairs), len(exchanges)))
    for k, exchange in enumerate(exchanges):
        for i, j in exchange:
            sign = 1.0
            if i > j:
                sign = -1.0
            means[pairs.index(_upright((i, j))), k] = sign / len(exchange)
    return np.asarray(of_pairs @ means)


def _upright(pair: Pair) -> Pair:
    """Return the pair, the lower foot first."""
    i, j = pair
    return min(i, j), max(i, j)


def _agreement(one: Exchange, other: Exchange, instants: FloatArray) -> float:
    """Return the agreement of the two of their pairs that agree least."""
    least = np.inf
    found = 0.0
    for i, j in one:
        first = np.sign(instants[:, i] - instants[:, j])
        for k, m in other:
            second = np.sign(instants[:, k] - instants[:, m])
            alike = float(np.mean(first * second))
            if abs(alike) < least:
                least = abs(alike)
                found = alike
    return found


def _turned(exchange: Exchange, alike: float) -> Exchange:
    """Return the exchange, with feet the other way round if it disagrees."""
    if alike > 0.0:
        return exchange
    return tuple((j, i) for i, j in exchange)
