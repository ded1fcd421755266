"""How the parts of the driver, and of methods, are compiled.

Division by zero gives infinity or NaN, which the driver looks for anyway, instead of an exception,
for which each division would be guarded by a branch.

`kernel` is called by other kernels. `kernel_in_loop` is for what is done once a step: a call costs
as much as several field evaluations, because the views of all arrays are handed over as single
numbers, so it is put into its callers. `kernel_apart` never is, wherever it is called from: for
what is long and done once an event, which else would be optimised in many copies, and for loops
over guards, which become vector instructions only in a function of their own. `ENTRY` are the
options of what is called from outside, by Python or by its address.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from numba import njit, types

from hopdata.hybrid.compiled.memory import ADDRESS, ROW, SPAN, VALUE, VECTOR, View, caller

# The user's functions: what they are called with, in Python and in machine code.
#
# One table. A new kind of function is a new entry here and a decorator in `callbacks`.

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
    return Signature(name, names, returns(*(TYPES[n] for n in names)), tuple(fills.split()))


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


# Calls of machine code by its address, from the driver.
#
# A Numba function passed as an argument would compile the driver anew for each scene, in each
# process. Called by its address instead, it leaves the driver as it is: one driver serves all.
#
# The driver hands over views; what is called takes arrays (the user's functions) or the addresses
# and widths of views (steps, interpolants and tangents of a method).

FLOATS, INTEGERS = View(types.float64, 1), View(types.int64, 1)
TABLE = View(types.float64, 2)

_T = (types.float64, VALUE)
_STATE, _GUARDS, _MODE, _PARAMS = (TABLE, ROW), (TABLE, ROW), (INTEGERS, VECTOR), (FLOATS, VECTOR)
_NUMBER = (types.int64, VALUE)

# call_field(address, t, s, y, mode, params, s, dy): y and dy are rows of the table s.
call_field = caller(FIELD.native, _T, _STATE, _MODE, _PARAMS, _STATE)
# The same with mode and params as arrays.
call_field_on_arrays = caller(FIELD.native, _T, _STATE, (MODE, VALUE), (STATE, VALUE), _STATE)
# call_jacobian(address, t, s, y, mode, params, jac)
call_jacobian = caller(JACOBIAN.native, _T, _STATE, (MODE, VALUE), (STATE, VALUE), (MATRIX, VALUE))
# call_guards(address, t, s, y, s, dy, mode, params, g, h, g, hdot)
call_guards = caller(GUARDS.native, _T, _STATE, _STATE, _MODE, _PARAMS, _GUARDS, _GUARDS)
# call_guard(address, t, s, y, s, dy, mode, params, k, g, h, g, hdot)
call_guard = caller(GUARD.native, _T, _STATE, _STATE, _MODE, _PARAMS, _NUMBER, _GUARDS, _GUARDS)
# call_rate_bound(address, t, s, y, s, dy, mode, params)
call_rate_bound = caller(RATE_BOUND.native, _T, _STATE, _STATE, _MODE, _PARAMS)
# call_on_event(address, t, s, y, mode, params, guard, direction)
call_on_event = caller(ON_EVENT.native, _T, _STATE, _MODE, _PARAMS, _NUMBER, _NUMBER)

# The parts of a method (see `methods.method`), in the order in which they are made ready: a method
# that has a step is. Of field and jacobian their own addresses are handed over.

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
except ImportError:  # of another Numba: it compiles the same, in five times as long
    kernel: Any = njit(error_model="numpy")
    kernel_apart: Any = kernel
    kernel_in_loop: Any = njit(error_model="numpy", forceinline=True)
else:
    ENTRY["pipeline_class"] = Entry
    kernel = partial(linked, Kernel)
    kernel_apart = partial(linked, Apart)
    kernel_in_loop = partial(linked, Kernel, forceinline=True)
