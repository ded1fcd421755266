"""The user's functions: what they are called with, in Python and in machine code.

One table. A new kind of function is a new entry here and a decorator in `callbacks`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numba import types

STATE = types.float64[::1]
MODE = types.int64[::1]
MATRIX = types.float64[:, ::1]


@dataclass(frozen=True)
class Signature:
    """What a kind of function is called with.

    Parameters
    ----------
    name : str
        The decorator's.
    arguments : tuple of str
        Names by which the documentation calls the arguments.
    native : Numba signature
        Their types, and that of the result.
    fills : tuple of str
        The arrays that the function fills in place.
    """

    name: str
    arguments: tuple[str, ...]
    native: Any
    fills: tuple[str, ...] = ()

    def call(self, function_name: str) -> str:
        """Write the call as a user would."""
        return f"{function_name}({', '.join(self.arguments)})"


TYPES = {
    "t": types.float64,
    **dict.fromkeys(("y", "dy", "params", "h", "hdot", "b"), STATE),
    "mode": MODE,
    **dict.fromkeys(("k", "guard", "direction"), types.int64),
    **dict.fromkeys(("jac", "a"), MATRIX),
}


def _kind(name: str, arguments: str, *, fills: str = "", returns: Any = types.void) -> Signature:
    names = tuple(arguments.split())
    native = returns(*(TYPES[name] for name in names))
    return Signature(name, names, native, tuple(fills.split()))


FIELD = _kind("field", "t y mode params dy", fills="dy")
GUARDS = _kind("guards", "t y dy mode params h hdot", fills="h hdot")
GUARD = _kind("guard", "t y dy mode params k h hdot", fills="h hdot")
RATE_BOUND = _kind("rate_bound", "t y dy mode params", returns=types.float64)
ON_EVENT = _kind("on_event", "t y mode params guard direction", returns=types.int64)
JACOBIAN = _kind("jacobian", "t y mode params jac", fills="jac")
AFFINE = _kind("affine", "mode params a b", fills="a b")

SIGNATURES = {
    kind.name: kind for kind in (FIELD, GUARDS, GUARD, RATE_BOUND, ON_EVENT, JACOBIAN, AFFINE)
}
