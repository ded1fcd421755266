"""Compiled core of the arc lengths: `LANES` pairs of subspaces at a time, one in each lane.

The squared cosines of the principal angles are the eigenvalues of ``C.T @ C`` with ``C = a.T @ b``:
products, Householder's tridiagonal form, and the root-free QL iteration of Pal, Walker and Kahan.
What squaring loses is bounded beside each length (see `_length`), so that the caller can
compute again what it does not find good enough.
"""

from __future__ import annotations

from math import acos, sqrt

import numpy as np
from numpy.typing import NDArray

from hopdata.code_cache import kept_njit
from hopdata.maps.subspaces.lanes import LANES, any_above, load, root, spread, store, where_above

#: Rows and columns of a tile of a product; bases are padded to a multiple of it.
TILE = 3
#: Error of a squared cosine that the bounds suppose. None of 10^5 pairs was off by a quarter of it.
SQUARED_COSINE_ERROR = 16 * 2.0**-52
_NEGLIGIBLE = 1e-34  # squared off-diagonal element
_MOST_SWEEPS = 60

Floats = NDArray[np.float64]


@kept_njit(nogil=True, error_model="numpy")
def _tile(x, y, count, width, p, q, out, at, step):  # type: ignore[no-untyped-def]
    """Fill 3 by 3 elements of ``x.T @ y``, both (count, width, LANES), in `out` from `at` on."""
    s00 = s01 = s02 = s10 = s11 = s12 = s20 = s21 = s22 = spread(0.0)
    for k in range(count):
        left, right = (k * width + p) * LANES, (k * width + q) * LANES
        a0, a1, a2 = load(x, left), load(x, left + LANES), load(x, left + 2 * LANES)
        b0, b1, b2 = load(y, right), load(y, right + LANES), load(y, right + 2 * LANES)
        s00, s01, s02 = s00 + a0 * b0, s01 + a0 * b1, s02 + a0 * b2
        s10, s11, s12 = s10 + a1 * b0, s11 + a1 * b1, s12 + a1 * b2
        s20, s21, s22 = s20 + a2 * b0, s21 + a2 * b1, s22 + a2 * b2
    store(out, at, s00)
    store(out, at + LANES, s01)
    store(out, at + 2 * LANES, s02)
    store(out, at + step, s10)
    store(out, at + step + LANES, s11)
    store(out, at + step + 2 * LANES, s12)
    store(out, at + 2 * step, s20)
    store(out, at + 2 * step + LANES, s21)
    store(out, at + 2 * step + 2 * LANES, s22)


@kept_njit(nogil=True, error_model="numpy")
def _product(x, y, count, width, out):  # type: ignore[no-untyped-def]
    """Fill ``x.T @ y``, (width, width, LANES)."""
    for p in range(0, width, TILE):
        for q in range(0, width, TILE):
            at = (p * width + q) * LANES
            _tile(x, y, count, width, p, q, out, at, width * LANES)


@kept_njit(nogil=True, error_model="numpy")
def _row(i):  # type: ignore[no-untyped-def]
    """Return where row i of a lower triangle begins, whose rows end with their tile."""
    tile = i // TILE
    return (TILE * tile * (tile + 1) // 2 + (i - TILE * tile) * (tile + 1)) * TILE * LANES


@kept_njit(nogil=True, error_model="numpy")
def _gram(x, width, out):  # type: ignore[no-untyped-def]
    """Fill the lower triangle of ``x.T @ x``."""
    for p in range(0, width, TILE):
        for q in range(0, p + TILE, TILE):
            _tile(x, x, width, width, p, q, out, _row(p) + q * LANES, (p + TILE) * LANES)


@kept_njit(nogil=True, error_model="numpy")
def _tridiagonal(size, gram, u, v, diagonal, squares):  # type: ignore[no-untyped-def]
    """Reduce the lower triangle of `gram` by reflections to a diagonal and squares beside it."""
    zero, one = spread(0.0), spread(1.0)
    for k in range(size - 1):
        total = zero
        for i in range(k + 1, size):
            value = load(gram, _row(i) + k * LANES)
            store(u, i * LANES, value)
            store(v, i * LANES, zero)
            total = total + value * value
        store(diagonal, k * LANES, load(gram, _row(k) + k * LANES))
        store(squares, k * LANES, total)
        first = load(u, (k + 1) * LANES)
        norm = root(total)
        norm = where_above(zero, first, zero - norm, norm)
        store(u, (k + 1) * LANES, first + norm)
        half = total + first * norm  # half the squared length of u
        share = where_above(half, zero, one / half, zero)
        overlap = zero
        for i in range(k + 1, size):  # v = gram @ u from the lower triangle
            row, ui, value = _row(i), load(u, i * LANES), zero
            for j in range(k + 1, i):
                element = load(gram, row + j * LANES)
                value = value + element * load(u, j * LANES)
                store(v, j * LANES, load(v, j * LANES) + element * ui)
            value = value + load(gram, row + i * LANES) * ui
            store(v, i * LANES, load(v, i * LANES) + value)
        for i in range(k + 1, size):
            overlap = overlap + load(v, i * LANES) * load(u, i * LANES)
        overlap = overlap * share * spread(0.5)
        for i in range(k + 1, size):
            row, ui = _row(i), load(u, i * LANES)
            vi = (load(v, i * LANES) - overlap * ui) * share
            store(v, i * LANES, vi)
            for j in range(k + 1, i + 1):
                at = row + j * LANES
                change = ui * load(v, j * LANES) + vi * load(u, j * LANES)
                store(gram, at, load(gram, at) - change)
    last = size - 1
    store(diagonal, last * LANES, load(gram, _row(last) + last * LANES))


@kept_njit(nogil=True, error_model="numpy")
def _sweep(first, last, diagonal, squares, open_lanes):  # type: ignore[no-untyped-def]
    """Do one QL sweep with Wilkinson's shift from `last` to `first`, where lanes are open."""
    zero, one, limit = spread(0.0), spread(1.0), spread(_NEGLIGIBLE)
    corner = load(diagonal, first * LANES)
    beside = root(open_lanes)
    shift = (load(diagonal, (first + 1) * LANES) - corner) / (beside + beside)
    length = root(shift * shift + one)
    shift = corner - beside / (shift + where_above(zero, shift, zero - length, length))
    cosine, sine = one, zero
    gamma = load(diagonal, last * LANES) - shift
    p = gamma * gamma
    for i in range(last - 1, first - 1, -1):
        square, alpha = load(squares, i * LANES), load(diagonal, i * LANES)
        r = p + square
        if i < last - 1:
            old = load(squares, (i + 1) * LANES)
            store(squares, (i + 1) * LANES, where_above(open_lanes, limit, sine * r, old))
        before = cosine
        divisor = where_above(p, zero, p, one)
        inverse = one / (r * divisor)  # of both, since a division costs as much as all the rest
        cosine, sine = p * (divisor * inverse), square * (divisor * inverse)
        held = gamma
        gamma = cosine * (alpha - shift) - sine * held
        old = load(diagonal, (i + 1) * LANES)
        value = held + (alpha - gamma)
        store(diagonal, (i + 1) * LANES, where_above(open_lanes, limit, value, old))
        p = where_above(p, zero, gamma * gamma * r * (r * inverse), before * square)
    store(squares, first * LANES, where_above(open_lanes, limit, sine * p, open_lanes))
    store(diagonal, first * LANES, where_above(open_lanes, limit, shift + gamma, corner))


@kept_njit(nogil=True, error_model="numpy")
def _eigenvalues(size, diagonal, squares):  # type: ignore[no-untyped-def]
    """Turn the diagonal of each lane's tridiagonal matrix into its eigenvalues."""
    limit = spread(_NEGLIGIBLE)
    for first in range(size - 1):
        for _ in range(_MOST_SWEEPS):
            open_lanes = load(squares, first * LANES)
            if not any_above(open_lanes, limit):
                break
            _sweep(first, size - 1, diagonal, squares, open_lanes)


@kept_njit(nogil=True, error_model="numpy")
def _length(size, lane, diagonal):  # type: ignore[no-untyped-def]
    """Return arc length and error bound of a lane.

    An error e of a squared cosine moves its angle t by e / (2 sin t cos t), and the length d by
    that times t / d.
    """
    total, growth = 0.0, 0.0
    for i in range(size):
        square = min(max(diagonal[i * LANES + lane], 0.0), 1.0)
        angle = acos(sqrt(square))
        total += angle * angle
        product = sqrt(square * (1.0 - square))
        growth += angle / product if square < 1.0 - 1e-10 else 1.0
    length = sqrt(total)
    return length, SQUARED_COSINE_ERROR * growth / (2.0 * length)


@kept_njit(nogil=True, error_model="numpy")
def _lengths(x, y, count, size, work, lengths, bounds):  # type: ignore[no-untyped-def]
    """Fill lengths and bounds of the pairs in the lanes of two bases, (count, width, LANES)."""
    product, gram, u, v, diagonal, squares = work
    width = (size + TILE - 1) // TILE * TILE
    _product(x, y, count, width, product)
    _gram(product, width, gram)
    _tridiagonal(size, gram, u, v, diagonal, squares)
    _eigenvalues(size, diagonal, squares)
    for lane in range(len(lengths)):
        lengths[lane], bounds[lane] = _length(size, lane, diagonal)


@kept_njit(nogil=True, error_model="numpy")
def fill_lanes(bases, lanes):  # type: ignore[no-untyped-def]
    """Put (R, D, k) bases, R at most LANES, into the lanes of a flat (D, width, LANES) array."""
    count, size = bases.shape[1:]
    width = (size + TILE - 1) // TILE * TILE
    for row in range(count):
        for column in range(size):
            at = (row * width + column) * LANES
            for lane in range(len(bases)):
                lanes[at + lane] = bases[lane, row, column]


@kept_njit(nogil=True, error_model="numpy")
def paired_lengths(a, b, x, y, work, lengths, bounds):  # type: ignore[no-untyped-def]
    """Fill (R,) arc lengths and their error bounds of R pairs of (D, k) bases.

    `x`, `y` and `work` are those of `workspace`.
    """
    for first in range(0, len(a), LANES):
        last = min(first + LANES, len(a))
        fill_lanes(a[first:last], x)
        fill_lanes(b[first:last], y)
        _lengths(x, y, *a.shape[1:], work, lengths[first:last], bounds[first:last])


@kept_njit(nogil=True, error_model="numpy")
def row_lengths(a, blocks, x, work, lengths, bounds):  # type: ignore[no-untyped-def]
    """Fill the arc lengths between one (D, k) basis and all in `blocks`, and their error bounds.

    Parameters
    ----------
    a : (D, k) array
    blocks : (M, D * width * LANES) array
        Bases in lanes: see `fill_lanes`.
    x, work
        Those of `workspace`.
    lengths, bounds : (R,) array
        Filled; R at most M * LANES.
    """
    count, size = a.shape
    width = (size + TILE - 1) // TILE * TILE
    for row in range(count):
        for column in range(size):
            store(x, (row * width + column) * LANES, spread(a[row, column]))
    for block in range(len(blocks)):
        first = block * LANES
        last = min(first + LANES, len(lengths))
        _lengths(x, blocks[block], count, size, work, lengths[first:last], bounds[first:last])


def lane_space(count: int, size: int) -> Floats:
    """Return a flat array for `LANES` bases of a (count, size) shape."""
    return np.zeros(count * -(-size // TILE) * TILE * LANES)


def workspace(count: int, size: int) -> tuple[Floats, Floats, tuple[Floats, ...]]:
    """Return what the functions above work in: x, y and work. One for each thread."""
    square = lane_space(-(-size // TILE) * TILE, size)
    columns = (lane_space(1, size) for _ in range(4))
    space = (square, np.zeros_like(square), *columns)
    return lane_space(count, size), lane_space(count, size), space
