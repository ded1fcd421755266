# ruff: noqa: ARG001 (methods are all called alike)
"""Taylor series of the flow of an affine mode, y' = A y + b, exact but for rounding.

The derivatives follow from one another by a product with A, so a step of degree 32 costs 32 small
products and no evaluation of the field, and the series is its own dense output. `refresh` fetches
A and b; it is called at the start and whenever the mode or the parameters may have changed.

`refresh`, `disagreement` and `interpolant` are templates: AFFINE and N are put in for each scene.
The step is made by `series`.

The order for step control is that of the first term left out, 33. The error obeys this power
over many decades, so a step may be chosen very long and is cut to size by one or two rejections, if
the controller may shrink it as far as it proposes. Half the error costs a fiftieth of the step, so
steps are as short as rounding wants them, whatever the tolerance: half a swing is one step all the
same. The degree that was needed is left in INFO.
"""

from __future__ import annotations

from math import inf, nan, sqrt
from typing import Any

from hopdata.hybrid.compiled.views import FloatTable
from hopdata.hybrid.methods.rows import K1, Y, matrix, row
from hopdata.hybrid.methods.series import DEGREE, EPS, INFO, LONGEST, WEIGHT, A, B

NAME = "taylor"
EVALUATIONS = 0
BASIS = "power"

FARTHEST_TURN = 4.5  # radians: nine tenths of z with z^33 / 33! = 64 EPS, the tolerance of a step

AFFINE: Any = None
FASTEST_MOTION: Any = None
N: int = 0


def work_rows(n: int) -> int:
    """Return the number of work rows for `n` states."""
    return 4 + n


def refresh(s: FloatTable, mode: Any, params: Any) -> None:
    """Fetch A and b of the mode; entries that the user's function leaves alone are zero.

    The fastest motion tells how long a first step may be.
    """
    for i in range(N):
        s[B, i] = 0.0
        for j in range(N):
            s[A + i, j] = 0.0
    AFFINE(mode, params, matrix(s, A, N), row(s, B))
    fastest = FASTEST_MOTION(s, A)
    s[LONGEST, 0] = FARTHEST_TURN / sqrt(fastest) if 0.0 < fastest < inf else inf


def disagreement(s: FloatTable) -> float:
    """Return by how much K1, the field at Y, differs from A Y + b, relative to the terms of these.

    More than rounding means that the user's two functions are not the same field.
    """
    worst = 0.0
    for i in range(N):
        difference, size = s[B, i] - s[K1, i], abs(s[B, i]) + abs(s[K1, i])
        for j in range(N):
            difference += s[A + i, j] * s[Y, j]
            size += abs(s[A + i, j] * s[Y, j])
        if difference != 0.0:
            worst = max(worst, abs(difference) / size)
    return worst


def interpolant(t: float, dt: float, s: FloatTable, mode: Any, params: Any) -> int:
    """Return the degree that the series needed: its coefficients are in place."""
    return int(s[INFO, 0])


REFRESH: Any = None
DISAGREEMENT: Any = None


def refreshed_disagreement(s: FloatTable, mode: Any, params: Any) -> float:
    """Fetch A and b; return by how much they differ from the field (see `disagreement`)."""
    REFRESH(s, mode, params)
    result: float = DISAGREEMENT(s)
    return result


def tangent(
    t: float, dt: float, rtol: float, s: FloatTable, mode: Any, params: Any, atol: Any, phi: Any
) -> float:
    """Write exp(A dt) Phi into the block after Phi; return the error, which is 0 but for rounding.

    NaN if the series does not end: the step is too long for it.
    """
    for i in range(N):
        for j in range(N):
            phi[N + i, j] = phi[i, j]
            phi[2 * N + i, j] = phi[i, j]
    for k in range(1, 2 * DEGREE):
        largest, size = 0.0, 0.0
        for j in range(N):
            for i in range(N):
                total = 0.0
                for m in range(N):
                    total += s[A + i, m] * phi[2 * N + m, j]
                s[WEIGHT, i] = total * dt / k
            for i in range(N):
                phi[2 * N + i, j] = s[WEIGHT, i]
                phi[N + i, j] += s[WEIGHT, i]
                largest = max(largest, abs(s[WEIGHT, i]))
                size = max(size, abs(phi[N + i, j]))
        if largest <= EPS / 8.0 * size:
            return 0.0
    return nan
