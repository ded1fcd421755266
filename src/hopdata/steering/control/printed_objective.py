"""The printed controller's objective, compiled for a table over an angle and an input.

It does the arithmetic of `prediction.poses_ahead` and `objectives.goal_errors` number
by number in the same order. A search asks for some sixty values of a few hops each, and
so little work by arrays takes far longer than the arithmetic.
"""

from __future__ import annotations

import math

import numpy as np

from hopdata.code_cache import kept_njit

TURN = 2 * math.pi
#: Degree of the splines.
#: Unit: 1. Origin: derived: of the cubic splines of `models.stride_table.spline_of`.
DEGREE = 3


@kept_njit(error_model="numpy")
def interval_of(knots, place):  # type: ignore[no-untyped-def]
    """Return the k of the knots k and k + 1 about a place; the ends extrapolate."""
    low = DEGREE
    high = len(knots) - DEGREE - 1
    while high - low > 1:
        middle = (low + high) // 2
        if place < knots[middle]:
            high = middle
        else:
            low = middle
    return low


@kept_njit(error_model="numpy")
def fill_basis(knots, place, interval, basis, lower):  # type: ignore[no-untyped-def]
    """Fill in the B-splines (4,) that are not 0 at a place, by de Boor's recursion.

    `lower` (4,) is working memory for those of the degree below.
    """
    basis[0] = 1.0
    for degree in range(1, DEGREE + 1):
        for k in range(degree):
            lower[k] = basis[k]
        basis[0] = 0.0
        for k in range(1, degree + 1):
            right = knots[interval + k]
            left = knots[interval + k - degree]
            if right == left:
                basis[k] = 0.0
                continue
            share = lower[k - 1] / (right - left)
            basis[k - 1] += share * (right - place)
            basis[k] = share * (place - left)


@kept_njit(error_model="numpy")
def fill_values(  # type: ignore[no-untyped-def]
    table, start, swings, steps, goal, is_heading, values
):
    """Fill in the objective at swings (H,), and with each of them changed in turn.

    Parameters
    ----------
    table : tuple
        Knots of the swing and of the boom angle, and coefficients (S, A, 3).
    start : tuple
        Pose, m, m, rad, and boom angle, rad.
    swings, steps : (H,) array
        Swings, and by how much each is changed, rad.
    goal : tuple
        Point (x, y), m, or heading, rad, and anything.
    is_heading : bool
        Whether the goal is a heading.
    values : (H + 1,) array
        Is filled: first the value without a change.
    """
    swing_knots, angle_knots, coefficients = table
    of_swing = np.empty(DEGREE + 1)
    of_angle = np.empty(DEGREE + 1)
    lower = np.empty(DEGREE + 1)
    change = np.empty(3)
    for tried in range(len(swings) + 1):
        x, y, heading, boom = start
        swung = 0.0
        cost = 0.0
        for hop in range(len(swings)):
            swing = swings[hop]
            if hop == tried - 1:
                swing = swing + steps[hop]
            swung += swing
            angle = (boom + swung - swing) % TURN
            first_swing = interval_of(swing_knots, swing)
            first_angle = interval_of(angle_knots, angle)
            fill_basis(swing_knots, swing, first_swing, of_swing, lower)
            fill_basis(angle_knots, angle, first_angle, of_angle, lower)
            change[:] = 0.0
            for i in range(DEGREE + 1):
                for j in range(DEGREE + 1):
                    weight = of_swing[i] * of_angle[j]
                    near = coefficients[first_swing - DEGREE + i]
                    for part in range(3):
                        value = near[first_angle - DEGREE + j, part]
                        change[part] += value * weight
            cos = math.cos(-heading)
            sin = math.sin(-heading)
            x += cos * change[0] + sin * change[1]
            y += cos * change[1] - sin * change[0]
            heading += change[2]
            if is_heading:
                cost += abs((goal[0] - heading + math.pi) % TURN - math.pi)
            else:
                cost += math.hypot(x - goal[0], y - goal[1])
        values[tried] = cost
