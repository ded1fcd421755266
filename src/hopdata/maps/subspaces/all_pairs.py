"""Arc lengths of all pairs of two sets of subspaces, in threads.

Each length has a bound of its error. Pairs whose bound is not below 1e-12 (a pair of subspaces
near each other or with directions near to orthogonal, about one in a hundred) are computed again
by singular values, so that every length is good to 1e-12. A chunk of rows is worked on in one
thread and in one order: the bytes do not depend on how many threads there are.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import starmap

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.maps.subspaces.grassmann import exact_arc_length, uncertified

_CHUNK_ROWS = 16
#: Called with the number of pairs done since the last call.
Report = Callable[[int], None]


def all_arc_lengths(
    a: FloatArray, b: FloatArray | None = None, *, workers: int = 1, report: Report | None = None
) -> FloatArray:
    """Return the arc lengths between all subspaces of one set and all of another.

    Parameters
    ----------
    a, b
        (R, D, k) and (S, D, k) orthonormal bases; without `b` the pairs within `a`.
    workers
        Threads.
    report
        Told of pairs that are done, in the calling thread.

    Returns
    -------
    ndarray
        (R, S) lengths in rad, error below 1e-12. Without `b`, (R, R), of which the upper triangle
        is computed and the rest is zero.
    """
    a = np.ascontiguousarray(a, float)
    others = a if b is None else np.ascontiguousarray(b, float)
    lengths = np.zeros((len(a), len(others)))
    blocks = _in_lanes(others)
    starts = range(0, len(a), _CHUNK_ROWS)
    chunks = [(first, min(first + _CHUNK_ROWS, len(a))) for first in starts]

    def run(first: int, last: int) -> int:
        return _fill_rows(a, others, blocks, lengths, first, last, within=b is None)

    with ThreadPoolExecutor(workers) as pool:
        done = pool.map(lambda chunk: run(*chunk), chunks) if workers > 1 else starmap(run, chunks)
        for count in done:
            if report is not None:
                report(count)
    return lengths


def _in_lanes(bases: FloatArray) -> FloatArray:
    """Return all bases in lanes, a block in each row: see `angle_kernel.fill_lanes`."""
    from hopdata.maps.subspaces.angle_kernel import fill_lanes, lane_space
    from hopdata.maps.subspaces.lanes import LANES

    size = len(lane_space(*bases.shape[1:]))
    blocks = np.zeros((-(-len(bases) // LANES), size))
    for number, block in enumerate(blocks):
        fill_lanes(bases[number * LANES : (number + 1) * LANES], block)
    return blocks


def _fill_rows(
    a: FloatArray,
    b: FloatArray,
    blocks: FloatArray,
    lengths: FloatArray,
    first: int,
    last: int,
    *,
    within: bool,
) -> int:
    """Fill rows `first` to `last` of `lengths`; return the number of pairs."""
    from hopdata.maps.subspaces.angle_kernel import row_lengths, workspace
    from hopdata.maps.subspaces.lanes import LANES

    x, _, work = workspace(*a.shape[1:])
    bounds = np.zeros((last - first, len(b)))
    for row in range(first, last):
        start = (row + 1) // LANES if within else 0
        beyond = start * LANES
        row_lengths(
            a[row], blocks[start:], x, work, lengths[row, beyond:], bounds[row - first, beyond:]
        )
        if within:
            lengths[row, : row + 1] = bounds[row - first, : row + 1] = 0.0
    rows, columns = np.nonzero(uncertified(bounds))
    lengths[first + rows, columns] = exact_arc_length(a[first + rows], b[columns])
    return sum(len(b) - row - 1 if within else len(b) for row in range(first, last))
