"""Compiled core of the density: samples spread over the nodes of a grid in one pass."""

from __future__ import annotations

from hopdata.code_cache import kept_njit


@kept_njit(nogil=True)
def spread_samples(values, origin, nodes_per_unit, counts):  # type: ignore[no-untyped-def]
    """Add six times the cubic B-spline of each sample to `counts`; return how many are finite.

    Parameters
    ----------
    values : (n,) array
        Samples; those not finite, and those off the grid, are left out.
    origin, nodes_per_unit : float
        A sample lies at node ``(value - origin) * nodes_per_unit``.
    counts : (2, G) array
        Filled by turns, since neighbours in time meet in one node and would wait for each other.
    """
    found, side, last = 0, 0, counts.shape[1] - 3
    for i in range(len(values)):
        value = values[i]
        found += value - value == 0.0
        place = (value - origin) * nodes_per_unit
        if 1.0 <= place < last:
            node = int(place)
            u = place - node
            v = 1.0 - u
            counts[side, node - 1] += v * v * v
            counts[side, node] += 4.0 - 3.0 * u * u * (1.0 + v)
            counts[side, node + 1] += 4.0 - 3.0 * v * v * (1.0 + u)
            counts[side, node + 2] += u * u * u
            side = 1 - side
    return found
