"""Compilation of the driver's and the methods' functions.

Division by zero gives infinity or NaN, which the driver checks for anyway. Raising an
exception would require a branch at each division.

`kernel` is for functions called by other kernels. `kernel_in_loop` is for work done
once a step. It is inlined into its callers, because a call costs as much as several
field evaluations: the views of all arrays are passed as individual numbers.
`kernel_apart` is never inlined. It is for long work done once an event, which would
otherwise be optimised in many copies, and for loops over guards, which vectorise only
in a function of their own. `kernel_into_other` is one that writes to no place that it
reads through another argument, though both may be in one table: so its loops become
vector instructions without a check. `ENTRY` holds the options of functions called from
outside, by Python or by address, and `LARGE_ENTRY` those of long ones of ours, whose
optimisation takes seconds.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from numba import njit, types

from hopdata.hybrid.compiled.calls import Passed, caller
from hopdata.hybrid.compiled.memory import View

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
    "y": STATE,
    "dy": STATE,
    "params": STATE,
    "h": STATE,
    "hdot": STATE,
    "b": STATE,
    "mode": MODE,
    "due": MODE,
    "k": types.int64,
    "guard": types.int64,
    "direction": types.int64,
    "jac": MATRIX,
    "a": MATRIX,
}


def _kind(
    name: str, arguments: str, *, fills: str = "", returns: Any = types.void
) -> Signature:
    names = tuple(arguments.split())
    native = returns(*(TYPES[one] for one in names))
    return Signature(name, names, native, tuple(fills.split()))


FIELD = _kind("field", "t y mode params dy", fills="dy")
GUARDS = _kind("guards", "t y dy mode params h hdot", fills="h hdot")
GUARD = _kind("guard", "t y dy mode params k h hdot", fills="h hdot")
RATE_BOUND = _kind("rate_bound", "t y dy mode params", returns=types.float64)
ON_EVENT = _kind("on_event", "t y mode params guard direction", returns=types.int64)
TOGETHER = _kind("together", "t y mode params due", returns=types.int64)
JACOBIAN = _kind("jacobian", "t y mode params jac", fills="jac")
AFFINE = _kind("affine", "mode params a b", fills="a b")

SIGNATURES = {
    kind.name: kind
    for kind in (
        FIELD,
        GUARDS,
        GUARD,
        RATE_BOUND,
        ON_EVENT,
        TOGETHER,
        JACOBIAN,
        AFFINE,
    )
}


# Calls of machine code by address, from the driver.
#
# If Numba functions were passed as arguments, the driver would be recompiled for each
# scene in each process. With calls by address, one driver serves all.
#
# The driver passes views. The functions called take arrays (the user's functions) or
# the addresses and widths of views (steps, interpolants and tangents of a method).

FLOATS = View(types.float64, 1)
INTEGERS = View(types.int64, 1)
TABLE = View(types.float64, 2)

_T = (types.float64, Passed.AS_IT_IS)
_NUMBER = (types.int64, Passed.AS_IT_IS)
_STATE = (TABLE, Passed.ROW)
_GUARDS = (TABLE, Passed.ROW)
_MODE = (INTEGERS, Passed.VECTOR)
_PARAMS = (FLOATS, Passed.VECTOR)
_MODE_ARRAY = (MODE, Passed.AS_IT_IS)
_PARAMS_ARRAY = (STATE, Passed.AS_IT_IS)
_MATRIX = (MATRIX, Passed.AS_IT_IS)

# call_field(address, t, s, y, mode, params, s, dy): y and dy are rows of the table s.
call_field = caller(FIELD.native, _T, _STATE, _MODE, _PARAMS, _STATE)
# The same with mode and params as arrays.
call_field_on_arrays = caller(
    FIELD.native, _T, _STATE, _MODE_ARRAY, _PARAMS_ARRAY, _STATE
)
# call_jacobian(address, t, s, y, mode, params, jac)
call_jacobian = caller(JACOBIAN.native, _T, _STATE, _MODE_ARRAY, _PARAMS_ARRAY, _MATRIX)
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
    "t": _T,
    "dt": _T,
    "rtol": _T,
    "field": _NUMBER,
    "jacobian": _NUMBER,
    "s": (TABLE, Passed.SPAN),
    "mode": (INTEGERS, Passed.SPAN),
    "params": (FLOATS, Passed.SPAN),
    "atol": (FLOATS, Passed.ADDRESS),
    "phi": (TABLE, Passed.ADDRESS),
    "along": (INTEGERS, Passed.ADDRESS),
}
_N_INTEGERS = {Passed.SPAN: 2, Passed.ADDRESS: 1}  # that the machine code takes


class Part(NamedTuple):
    """Arguments of a part, the signature of its machine code, and how to call it.

    It is called by ``call(address, *arguments)``.
    """

    arguments: str
    native: Any
    call: Any


def _part(arguments: str, returns: Any = types.float64) -> Part:
    plan = [_HANDED[name] for name in arguments.split(", ")]
    taken: list[Any] = []
    for kind, passed in plan:
        if passed is Passed.AS_IT_IS:
            taken.append(kind)
        else:
            taken += [types.int64] * _N_INTEGERS[passed]
    native = returns(*taken)
    return Part(arguments, native, caller(native, *plan))


_TANGENT = _part("t, dt, rtol, s, mode, params, atol, phi, field, jacobian, along")
PARTS = {
    "refresh": _part("s, mode, params"),
    "tangent": _TANGENT,
    "short_tangent": _TANGENT,
    "interpolant": _part("t, dt, s, mode, params, field", types.int64),
    "step": _part("t, dt, rtol, s, mode, params, atol, field"),
}
call_step = PARTS["step"].call
call_interpolant = PARTS["interpolant"].call
call_tangent = _TANGENT.call
call_refresh = PARTS["refresh"].call


ENTRY: dict[str, Any] = {"error_model": "numpy"}
LARGE_ENTRY = dict(ENTRY)

try:
    from hopdata.hybrid.compiled.linking import (
        Apart,
        Entry,
        IntoOther,
        Kernel,
        LargeEntry,
        linked,
    )
# Another Numba version: the result is the same, in five times as long.
except ImportError:
    kernel: Any = njit(error_model="numpy")
    kernel_apart: Any = kernel
    kernel_into_other: Any = kernel
    kernel_in_loop: Any = njit(error_model="numpy", forceinline=True)
else:
    ENTRY["pipeline_class"] = Entry
    LARGE_ENTRY["pipeline_class"] = LargeEntry
    kernel = partial(linked, Kernel)
    kernel_apart = partial(linked, Apart)
    kernel_into_other = partial(linked, IntoOther)
    kernel_in_loop = partial(linked, Kernel, forceinline=True)


@kernel
def copy(source: Any, into: Any) -> None:
    """Copy a vector element by element.

    An assignment ``into[:] = source`` would do the same, but Numba takes 1.5 s to
    compile its error message about shapes.
    """
    for i in range(len(into)):
        into[i] = source[i]
