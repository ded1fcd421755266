"""The value of a number that may be a dual, in compiled code."""

from typing import Any

from numba.extending import overload

from hopdata.hybrid.numbers.duals import Dual
from hopdata.hybrid.numbers.vectors import bare


def value_of(x: Any) -> Any:
    """Return the value of a number or a dual."""
    return x


def _value_of(x: Any) -> Any:
    if isinstance(x, Dual):
        return lambda x: x.value
    return lambda x: x


overload(value_of)(bare(_value_of))
