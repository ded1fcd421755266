"""Compiled core of the products with twice the digits."""

from __future__ import annotations

from hopdata.code_cache import kept_njit


@kept_njit(nogil=True)
def add_products(values, lost, matrix, top, rest, high, low):  # type: ignore[no-untyped-def]
    """Add ``(values + lost) @ matrix`` to `high`, and what its roundings lose to `low`.

    The steps are those of `hopdata.maps.linear.compensated`, in the same order.
    """
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            value = values[i, k]
            scaled = value * 134217729.0
            first = scaled - (scaled - value)
            second = value - first
            for j in range(matrix.shape[1]):
                product = value * matrix[k, j]
                error = first * top[k, j] - product
                error = ((error + first * rest[k, j]) + second * top[k, j]) + second * rest[k, j]
                total = high[i, j] + product
                part = total - high[i, j]
                error = error + ((high[i, j] - (total - part)) + (product - part))
                low[i, j] = low[i, j] + (error + lost[i, k] * matrix[k, j])
                high[i, j] = total
