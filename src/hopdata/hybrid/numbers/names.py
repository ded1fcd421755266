"""Under which names Python and NumPy have an operation, for all kinds of numbers.

Each kind of numbers (`dual_type`, `moving`, `traces`, `operators` for ranges, and
`gradients.tape`) gives these names a meaning of its own.
"""

import builtins
import math
import operator
from typing import Any

import numpy as np

Keys = tuple[Any, ...]

# With two arguments. A sum in place, ``x += y``, is one as well.
ADD: Keys = (operator.add, operator.iadd, np.add)
SUBTRACT: Keys = (operator.sub, operator.isub, np.subtract)
MULTIPLY: Keys = (operator.mul, operator.imul, np.multiply)
DIVIDE: Keys = (operator.truediv, operator.itruediv, np.divide)
REMAINDER: Keys = (operator.mod, operator.imod, np.mod)
WHOLE_QUOTIENT: Keys = (operator.floordiv, operator.ifloordiv, np.floor_divide)
POWER: Keys = (operator.pow, operator.ipow, pow, math.pow, np.power)
LEAST: Keys = (builtins.min, np.minimum, np.fmin)
LARGEST: Keys = (builtins.max, np.maximum, np.fmax)
HYPOTENUSE: Keys = (math.hypot, np.hypot)
ANGLE: Keys = (math.atan2, np.arctan2)
COPY_SIGN: Keys = (math.copysign, np.copysign)
COMPARE: Keys = (
    operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne
)  # fmt: skip

# With one.
NEGATE: Keys = (operator.neg, np.negative)
SAME: Keys = (operator.pos, np.positive, float)
ABSOLUTE: Keys = (abs, np.abs, math.fabs, np.fabs)
TELL_NUMBERS: Keys = (
    math.isnan, math.isinf, math.isfinite, np.isnan, np.isinf, np.isfinite
)  # fmt: skip
ROUND: Keys = (math.floor, math.ceil, math.trunc)  # to an integer
ROUND_TO_FLOAT: Keys = (np.floor, np.ceil, np.trunc, np.rint)

# NumPy's names of elementary functions, where they are not those of `math`.
IN_NUMPY = {
    "asin": ("arcsin",),
    "acos": ("arccos",),
    "atan": ("arctan",),
    "asinh": ("arcsinh",),
    "acosh": ("arccosh",),
    "atanh": ("arctanh",),
    "degrees": ("degrees", "rad2deg"),
    "radians": ("radians", "deg2rad"),
}


def functions_named(name: str) -> list[Any]:
    """Return the elementary functions of this name, of `math` and of NumPy."""
    found = [getattr(math, name, None)]
    for in_numpy in IN_NUMPY.get(name, (name,)):
        found.append(getattr(np, in_numpy, None))
    return [one for one in found if one is not None]
