"""Compilation of the driver's and the methods' functions.

Division by zero gives infinity or NaN, which the driver checks for anyway. Raising an
exception would require a branch at each division.

`kernel` is for functions called by other kernels. `kernel_in_loop` is for work done
once a step. It is inlined into its callers, because a call costs as much as several
field evaluations: the views of all arrays are passed as individual numbers.
`kernel_apart` is never inlined. It is for long work done once an event, which would
otherwise be optimised in many copies, and for loops over guards, which vectorise only
in a function of their own. `ENTRY` holds the options of functions called from outside,
by Python or by address.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from numba import njit, types

from hopdata.hybrid.compiled.memory import (
    ADDRESS,
    ROW,
    SPAN,
    VALUE,
    VECTOR,
    View,
    caller,
)

# Signatures of the user's functions, in Python and in machine code.
#
# A new kind of function is a new entry in this table and a decorator in `callbacks`.

STATE = types.float64[::1]
MODE = types.int64[::1]
MATRIX = types.float64[:, ::1]


@dataclass(frozen=True)
class Signature:
    """The signature of one kind of user's function.

    Parameters
    ----------
    name : str
        Name of the decorator.
    arguments : tuple of str
        Names of the arguments, as in the documentation.
    native : Numba signature
        Types of the arguments and of the result.
    fills : tuple of str
        Arrays that the function fills in place.
    """

    name: str
    arguments: tuple[str, ...]
    native: Any
    fills: tuple[str, ...] = ()

    def call(self, function_name: str) -> str:
        """Return the call as a user would write it."""
        return f"{function_name}({', '.join(self.arguments)})"


TYPES = {
    "t": types.float64,
    **dict.fromkeys(("y", "dy", "params", "h", "hdot", "b"), STATE),
    "mode": MODE,
    **dict.fromkeys(("k", "guard", "direction"), types.int64),
    **dict.fromkeys(("jac", "a"), MATRIX),
}


def _kind(
    name: str, arguments: str, *, fills: str = "", returns: Any = types.void
) -> Signature:
    names = tuple(arguments.split())
    return Signature(
        name, names, returns(*(TYPES[n] for n in names)), tuple(fills.split())
    )


FIELD = _kind("field", "t y mode params dy", fills="dy")
GUARDS = _kind("guards", "t y dy mode params h hdot", fills="h hdot")
GUARD = _kind("guard", "t y dy mode params k h hdot", fills="h hdot")
RATE_BOUND = _kind("rate_bound", "t y dy mode params", returns=types.float64)
ON_EVENT = _kind("on_event", "t y mode params guard direction", returns=types.int64)
JACOBIAN = _kind("jacobian", "t y mode params jac", fills="jac")
AFFINE = _kind("affine", "mode params a b", fills="a b")

SIGNATURES = {
    kind.name: kind
    for kind in (FIELD, GUARDS, GUARD, RATE_BOUND, ON_EVENT, JACOBIAN, AFFINE)
}


# Calls of machine code by address, from the driver.
#
# If Numba functions were passed as arguments, the driver would be recompiled for each
# scene in each process. With calls by address, one driver serves all.
#
# The driver passes views. The functions called take arrays (the user's functions) or
# the addresses and widths of views (steps, interpolants and tangents of a method).

FLOATS, INTEGERS = View(types.float64, 1), View(types.int64, 1)
TABLE = View(types.float64, 2)

_T = (types.float64, VALUE)
_STATE, _GUARDS, _MODE, _PARAMS = (
    (TABLE, ROW),
    (TABLE, ROW),
    (INTEGERS, VECTOR),
    (FLOATS, VECTOR),
)
_NUMBER = (types.int64, VALUE)

# call_field(address, t, s, y, mode, params, s, dy): y and dy are rows of the table s.
call_field = caller(FIELD.native, _T, _STATE, _MODE, _PARAMS, _STATE)
# The same with mode and params as arrays.
call_field_on_arrays = caller(
    FIELD.native, _T, _STATE, (MODE, VALUE), (STATE, VALUE), _STATE
)
# call_jacobian(address, t, s, y, mode, params, jac)
call_jacobian = caller(
    JACOBIAN.native, _T, _STATE, (MODE, VALUE), (STATE, VALUE), (MATRIX, VALUE)
)
# call_guards(address, t, s, y, s, dy, mode, params, g, h, g, hdot)
call_guards = caller(
    GUARDS.native, _T, _STATE, _STATE, _MODE, _PARAMS, _GUARDS, _GUARDS
)
# call_guard(address, t, s, y, s, dy, mode, params, k, g, h, g, hdot)
call_guard = caller(
    GUARD.native, _T, _STATE, _STATE, _MODE, _PARAMS, _NUMBER, _GUARDS, _GUARDS
)
# call_rate_bound(address, t, s, y, s, dy, mode, params)
call_rate_bound = caller(RATE_BOUND.native, _T, _STATE, _STATE, _MODE, _PARAMS)
# call_on_event(address, t, s, y, mode, params, guard, direction)
call_on_event = caller(ON_EVENT.native, _T, _STATE, _MODE, _PARAMS, _NUMBER, _NUMBER)

# Parts of a method (see `methods.method`), in the order in which they are made ready: a
# method is ready when its step is. Field and jacobian are passed by their own
# addresses.

_HANDED = {
    **dict.fromkeys(("t", "dt", "rtol"), _T), **dict.fromkeys(("field", "jacobian"), _NUMBER),
    "s": (TABLE, SPAN), "mode": (INTEGERS, SPAN), "params": (FLOATS, SPAN),
    "atol": (FLOATS, ADDRESS), "phi": (TABLE, ADDRESS),
}  # fmt: skip


class Part(NamedTuple):
    """Arguments of a part, the signature of its machine code, and ``call(address, *arguments)``."""

    arguments: str
    native: Any
    call: Any


def _part(arguments: str, returns: Any = types.float64) -> Part:
    plan, taken = [_HANDED[name] for name in arguments.split(", ")], list[Any]()
    for kind, way in plan:
        taken += [kind] if way == VALUE else [types.int64] * (2 if way == SPAN else 1)
    native = returns(*taken)
    return Part(arguments, native, caller(native, *plan))


_TANGENT = _part("t, dt, rtol, s, mode, params, atol, phi, field, jacobian")
PARTS = {
    "refresh": _part("s, mode, params"),
    "tangent": _TANGENT,
    "short_tangent": _TANGENT,
    "interpolant": _part("t, dt, s, mode, params, field", types.int64),
    "step": _part("t, dt, rtol, s, mode, params, atol, field"),
}
call_step, call_interpolant = PARTS["step"].call, PARTS["interpolant"].call
call_tangent, call_refresh = _TANGENT.call, PARTS["refresh"].call


ENTRY: dict[str, Any] = {"error_model": "numpy"}

try:
    from hopdata.hybrid.compiled.linking import Apart, Entry, Kernel, linked
except (
    ImportError
):  # another Numba version: the result is the same, in five times as long
    kernel: Any = njit(error_model="numpy")
    kernel_apart: Any = kernel
    kernel_in_loop: Any = njit(error_model="numpy", forceinline=True)
else:
    ENTRY["pipeline_class"] = Entry
    kernel = partial(linked, Kernel)
    kernel_apart = partial(linked, Apart)
    kernel_in_loop = partial(linked, Kernel, forceinline=True)


@kernel
def copy(source: Any, into: Any) -> None:
    """Copy a vector element by element.

    An assignment ``into[:] = source`` would do the same, but Numba takes 1.5 s to
    compile its error message about shapes.
    """
    for i in range(len(into)):
        into[i] = source[i]
