"""When a mode is too stiff for an explicit method, and when it is no longer.

Explicit methods: Hairer and Wanner's test (*Solving Ordinary Differential Equations II*, section
IV.2). The last stage of DOPRI5 and of DOP853 stands at the end of the step, near the new state;
two slopes there give, for no further evaluation, the rate of the fastest motion. Where stability
limits the step, dt times that rate stays near the edge of the region of stability.

Rosenbrock: the Jacobian is at hand, and a few products with it give its spectral radius.

States are measured by their tolerances, so that no unit of length or time enters.
"""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.compiled.views import FloatTable, FloatVector
from hopdata.hybrid.methods.rows import END, KEND, SCRATCH, Y

# Edges of the regions of stability on the negative axis, 3.31 and 6.4, a little reduced: where
# stability limits the step, the controller makes it swing about them.
DOPRI5_LIMIT = 3.0
DOP853_LIMIT = 6.1

STIFF = 15.0  # steps beyond the limit, more or less in a row
RELIEF = 2.5  # of these are forgotten at each step within it
TINY = 1e-300


@kernel
def tolerance(s: FloatTable, i: int, rtol: float, atol: FloatVector) -> float:
    """Return the error allowed in component `i` of this step."""
    return max(atol[i] + rtol * max(abs(s[Y, i]), abs(s[END, i])), TINY)


@kernel
def explicit_stiffness(
    s: FloatTable, dt: float, rtol: float, atol: FloatVector, last_slope: int, n: int
) -> float:
    """Return dt times the fastest rate, after an accepted explicit step.

    Row `last_slope` holds the slope of the last stage, SCRATCH the state where it was taken. The
    result is NaN, which exceeds no limit, if that state is the new one.
    """
    slopes, states = 0.0, 0.0
    for i in range(n):
        allowed = tolerance(s, i, rtol, atol)
        slopes += ((s[KEND, i] - s[last_slope, i]) / allowed) ** 2
        states += ((s[END, i] - s[SCRATCH, i]) / allowed) ** 2
    return dt * (slopes / states) ** 0.5


@kernel
def stiffness_score(score: float, stiffness: float, limit: float) -> float:
    """Count a step; the integration is stiff when the score reaches `STIFF`.

    The score starts at 0 and outlives events, which may come faster than it grows. While it is 0,
    testing one step in 16 is enough.
    """
    return score + 1.0 if stiffness > limit else max(score - RELIEF, 0.0)


@kernel
def multiply(s: FloatTable, first: int, x: int, product: int, n: int) -> None:
    """Write the product of the matrix in the rows from `first` on and row `x` to a row."""
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += s[first + i, j] * s[x, j]
        s[product, i] = total


@kernel
def implicit_stiffness(
    s: FloatTable, dt: float, rtol: float, atol: FloatVector, jac: int, spare: int, n: int
) -> float:
    """Return an estimate of dt times the spectral radius of the Jacobian in the rows from `jac`.

    Four products (of pairs, because a vibration turns states and rates into each other), started
    from the tolerances. Overwrites SCRATCH and row `spare`. An explicit method will do for the next
    step of length dt if this is well below its limit. It costs as much as half a step.
    """
    before, after = 0.0, 0.0
    for i in range(n):
        s[SCRATCH, i] = tolerance(s, i, rtol, atol)
    for _ in range(2):
        before = 0.0
        for i in range(n):
            before += (s[SCRATCH, i] / tolerance(s, i, rtol, atol)) ** 2
        if before == 0.0:
            return 0.0
        for i in range(n):
            s[SCRATCH, i] /= before**0.5
        multiply(s, jac, SCRATCH, spare, n)
        multiply(s, jac, spare, SCRATCH, n)
        after = 0.0
        for i in range(n):
            after += (s[SCRATCH, i] / tolerance(s, i, rtol, atol)) ** 2
    return dt * after**0.25
