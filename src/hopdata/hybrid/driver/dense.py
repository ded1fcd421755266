"""The fourth-order interpolant of a Dormand-Prince step, and its derivative."""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.compiled.views import FloatTable
from hopdata.hybrid.driver.layout import (
    END,
    K1,
    K3,
    K4,
    K5,
    K6,
    K7,
    P1,
    P2,
    P3,
    P4,
    SLOPE,
    SPAN,
    Memory,
    Y,
)
from hopdata.hybrid.methods.dopri5 import D1, D3, D4, D5, D6, D7


@kernel
def prepare_interpolant(m: Memory, dt: float) -> None:
    """Compute the interpolant of the step of length `dt`, unless it is there already."""
    if m.clock[SPAN] > 0.0:
        return
    m.clock[SPAN] = dt
    s = m.states
    for i in range(s.width):
        rise = s[END, i] - s[Y, i]
        bend = dt * s[K1, i] - rise
        early = D1 * s[K1, i] + D3 * s[K3, i] + D4 * s[K4, i]
        s[P1, i] = rise
        s[P2, i] = bend
        s[P3, i] = rise - dt * s[K7, i] - bend
        s[P4, i] = dt * (early + D5 * s[K5, i] + D6 * s[K6, i] + D7 * s[K7, i])


@kernel
def interpolate(s: FloatTable, theta: float, table: FloatTable, row: int) -> None:
    """Write the state at the fraction `theta` of the step into a row of a table."""
    rest = 1.0 - theta
    for i in range(s.width):
        inner = s[P2, i] + theta * (s[P3, i] + rest * s[P4, i])
        table[row, i] = s[Y, i] + theta * (s[P1, i] + rest * inner)


@kernel
def interpolate_slope(s: FloatTable, theta: float, dt: float) -> None:
    """Write the time derivative of the interpolant at `theta` into SLOPE."""
    rest = 1.0 - theta
    turn = rest - theta
    for i in range(s.width):
        outer = s[P3, i] + rest * s[P4, i]
        inner = s[P2, i] + theta * outer
        inner_slope = outer - theta * s[P4, i]
        s[SLOPE, i] = (s[P1, i] + turn * inner + theta * rest * inner_slope) / dt
