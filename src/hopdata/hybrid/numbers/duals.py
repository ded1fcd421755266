"""Dual numbers, for which a user's functions compile as they are.

A `Dual` is a value and its slopes along some directions at once, which are one vector
of the processor. Each operation computes the value as the code for numbers does, to the
bit, and the slopes by the chain rule. So the derivatives are exact but for rounding.

Comparisons decide by the value, as for numbers. What is constant between jumps
(`floor`, `//`, `sign`, `int`) is a plain number. `%` has the slope between its jumps.

At a kink the slope is one-sided, along each direction: that of `abs(x)` at 0 is the
size of the slope of x, that of `max` of two equal numbers the larger of their slopes,
and that of `hypot(x, y)` at 0 the hypotenuse of their slopes. In a table each direction
sees the piece into which it leads. Where a derivative is infinite (`sqrt` at 0), a
number whose slope is zero keeps a slope of zero.

Where a line belongs:

``dual_type``
    The type, and how an operation is defined by a formula.
``dual_arithmetic``
    Sums, products, quotients, remainders, powers.
``dual_functions``
    The table of derivatives of elementary functions; tables of numbers.
``dual_kinks``
    `abs`, `min`, `hypot` and the like; `floor`, comparisons, `np.where`.
``dual_rows``
    Duals in arrays, and from rows of plain numbers.

This module has what others use of them; with it, all operations are defined.
"""

from hopdata.hybrid.numbers import dual_arithmetic, dual_functions, dual_kinks
from hopdata.hybrid.numbers.dual_rows import (
    dual_at,
    each_alone,
    harvest_all,
    moving,
    number_along,
    pack,
    seed_all,
    stack,
    unpack,
)
from hopdata.hybrid.numbers.dual_type import (
    OPERATIONS,
    WIDTHS,
    Dual,
    width_for,
)

__all__ = [
    "OPERATIONS",
    "WIDTHS",
    "Dual",
    "dual_arithmetic",
    "dual_at",
    "dual_functions",
    "dual_kinks",
    "each_alone",
    "harvest_all",
    "moving",
    "number_along",
    "pack",
    "seed_all",
    "stack",
    "unpack",
    "width_for",
]
