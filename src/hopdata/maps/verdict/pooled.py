"""Whether landings that have no blocks are of more than one body.

Two subjects in one table may be called different though each has one smooth map: who
lands is linked with which foot is first. Nobody puts markers on two subjects alike, and
on a rigid body their distances stay as they are. So the distances of pooled subjects
fall into groups with nothing between them. So do those of one body whose markers were
moved, and that, too, is a reason for blocks.
"""

from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray

#: Least share of the landings on either side of what lies between two groups.
#: Unit: 1. Origin: chosen: fewer are mistakes, such as exchanged markers. 1.5 times
#: larger or smaller, this and the next two change the answer on none of 40 tables of
#: one body (noise 0.2 to 3 mm, mistakes, whole mm) and 36 of two or three (0.6 mm).
LEAST_SIDE = 0.1

#: Landings are of two groups if nothing lies in this share of the range that holds the
#: landings but `LEAST_SIDE` on either side.
#: Unit: 1. Origin: derived: 150 normal landings leave 0.07 of it empty, more landings
#: less, and two groups that lie ten standard deviations apart 0.4.
EMPTY = 0.25

#: Range of distances, as a share of the median distance, up to which no groups are
#: looked for.
#: Unit: 1. Origin: chosen: a centimetre of a metre. Rounding to whole millimetres makes
#: groups within 0.6 % of what was measured without noise.
RIGID = 0.01

#: Principal components of the distances in which groups are looked for.
#: Unit: 1. Origin: chosen: the first parts two bodies, and three parts four of them.
COMPONENTS = 3


def of_more_bodies(states: FloatArray) -> bool:
    """Return whether distances between markers fall into groups, as of more bodies.

    Parameters
    ----------
    states
        (n, 6B) marker states, of finite values: see `judge`.
    """
    n = len(states)
    markers = states[:, : states.shape[1] // 2].reshape(n, -1, 3)
    pairs = combinations(range(markers.shape[1]), 2)
    distances = np.column_stack(
        [np.linalg.norm(markers[:, i] - markers[:, j], axis=1) for i, j in pairs]
    )
    typical = np.median(distances, axis=0)
    apart = distances - typical
    left, sizes, _ = np.linalg.svd(apart, full_matrices=False)
    components = (left * sizes)[:, :COMPONENTS]
    return any(
        _in_groups(values, RIGID * float(np.median(typical))) for values in components.T
    )


def _in_groups(values: FloatArray, least_range: float) -> bool:
    """Return whether nothing lies in a large part of the range of these values."""
    side = max(1, round(LEAST_SIDE * len(values)))
    middle = np.sort(values)[side - 1 : len(values) - side + 1]
    whole = middle[-1] - middle[0]
    return bool(whole > least_range and np.max(np.diff(middle)) > EMPTY * whole)
