"""Numbers that move: a value and its rate, of any kind of number.

The kind may be a float, a dual, a range, or a number that moves itself. So the rate of
a guard along a motion is a number of that kind: a dual, with its derivatives, or a
range of values and of rates. Derivatives and rates of a rate are second derivatives of
the guard.

Each operation is written once, in terms of the operations of the kind: the value as it
is, the rate by the chain rule. Comparisons decide by the value. What is constant
between jumps (`floor`, `sign`) has no rate. At a kink the rate is that of one side; of
a range that contains the kink, those of both.

Where a line belongs:

``moving_type``
    The type, rooms for such numbers, and how an operation is defined by a formula.
``moving_arithmetic``
    Sums, products, quotients, remainders, powers.
``moving_functions``
    The table of derivatives of elementary functions; tables of numbers.
``moving_kinks``
    `abs`, `min`, `hypot` and the like; `floor`, comparisons, `np.where`.

This module has what others use of them; with it, all operations are defined.
"""

from hopdata.hybrid.numbers import moving_arithmetic, moving_functions, moving_kinks
from hopdata.hybrid.numbers.moving_type import (
    Moving,
    as_item,
    moving,
    plain,
    room_like,
    room_moving,
)

__all__ = [
    "Moving",
    "as_item",
    "moving",
    "moving_arithmetic",
    "moving_functions",
    "moving_kinks",
    "plain",
    "room_like",
    "room_moving",
]
