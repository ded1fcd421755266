"""How a difference between orders grows with the time between contacts.

A kink grows in proportion to that time, whatever the time is: the derivative of the map
jumps by as much at the simultaneous contact as far from it. Something else grows with
its square, such as (last - first contact)^2. Where two of three feet change places far
from the simultaneous contact, this also makes the derivative jump; the nearer that
contact is, the less. At it the map has one derivative.

So the kinks are fitted once more, with their derivative proportional to a power of the
contact spread: r^slope, where r is the spread of the landing. The slope is 0 if the
derivative jumps at the simultaneous contact, and 1 if only its curvature does. The
likelihood of the residuals tells which slopes the landings allow.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.maps.coordinates import ALL_SETS_UP_TO
from hopdata.maps.verdict.saturation import NEARLY, misfit, moved_instants
from hopdata.maps.verdict.smooth import Shapes, Smooth, fit_beside

#: Slopes that are tried.
#: Unit: 1. Origin: chosen: from what is nearly a jump of the outcome to cubes.
SLOPES = tuple(np.arange(-0.75, 2.01, 0.125).tolist())

#: Growing kinks that remain beside smooth terms with less than this share of the most
#: visible one are left out.
#: Unit: 1. Origin: chosen.
LEAST_GROWN = 0.01


@dataclass(frozen=True)
class Growth:
    """Slopes that the landings allow.

    Attributes
    ----------
    slope
        Of the best fit.
    low, high
        Least and largest slope that fits nearly as well.
    """

    slope: float
    low: float
    high: float


def corners(instants: FloatArray) -> FloatArray:
    """Return the kinks (n, K) without what is linear in the instants (n, feet).

    They are |t_i - t_j| of each pair and, of three feet, the latest contact less the
    mean.
    """
    columns = [np.abs(a - b) for a, b in combinations(instants.T, 2)]
    if instants.shape[1] == ALL_SETS_UP_TO:
        columns.append(instants.max(axis=1) - instants.mean(axis=1))
    return np.column_stack(columns)


def growth(smooth: Smooth, instants: FloatArray, rest: FloatArray) -> Growth | None:
    """Return the slopes that n landings allow; None for two feet.

    Of two feet, (t_1 - t_2)^2 is smooth: nothing is left that grows with the square.

    Parameters
    ----------
    smooth
        Smooth terms of the landings.
    instants, rest
        As for `saturation.mean_saturated`.
    """
    n_feet = instants.shape[1]
    if n_feet == 2:
        return None
    smooth = smooth.and_also(smooth.along)
    moved = moved_instants(instants, rest)
    flat = moved.reshape(-1, n_feet)
    spread = flat.std(axis=1)
    kinks = corners(flat)
    misfits = []
    for slope in SLOPES:
        grown = kinks * spread[:, None] ** slope
        columns = grown.reshape(*moved.shape[:2], -1).mean(axis=1)
        distinct = Shapes(columns, columns).visible(smooth, LEAST_GROWN)
        shapes = columns @ distinct
        found = fit_beside(smooth, shapes)
        explained = smooth.without(shapes) @ found.coefficients
        misfits.append(misfit(smooth.without(smooth.outputs) - explained))
    return allowed_slopes(np.array(SLOPES), np.array(misfits))


def allowed_slopes(slopes: FloatArray, misfits: FloatArray) -> Growth:
    """Return the best slope, and the ends of those of nearly the least misfit."""
    best = int(np.argmin(misfits))
    fine = np.linspace(slopes[0], slopes[-1], 1 + 10 * (len(slopes) - 1))
    nearly = fine[np.interp(fine, slopes, misfits) <= misfits[best] + NEARLY]
    return Growth(float(slopes[best]), float(nearly[0]), float(nearly[-1]))
