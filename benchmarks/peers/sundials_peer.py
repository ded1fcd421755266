"""SUNDIALS: CVODE, stopped at each root of the nearest guard and restarted.

There are two ways to call it: scikit-sundae, whose callbacks are Python calls (here of
compiled functions), and the C library that scikit-sundae includes, with compiled
callbacks and a compiled loop.
"""

from __future__ import annotations

from ctypes import CDLL, byref, c_double, c_int, c_int64, c_long, c_void_p
from functools import cache, partial
from typing import Any

import numba
import numpy as np
from numba import carray, njit, types
from numba.extending import intrinsic
from sksundae.cvode import CVODE

from peers import MOST_EVENTS, FloatArray, Found, LostEventError, Problem, Run, Solver
from peers.scipy_peer import Compiled, compiled

# CVODE in C: compiled callbacks, and a compiled loop over the events.


ADAMS, BDF, NORMAL, ROOT_RETURN = 1, 2, 1, 2  # as in cvode.h
SIGNATURES: dict[str, tuple[Any, ...]] = {  # result type, argument types
    "SUNContext_Create": (c_int, c_int, c_void_p),
    "N_VMake_Serial": (c_void_p, c_int64, c_void_p, c_void_p),
    "N_VGetArrayPointer_Serial": (c_void_p, c_void_p),
    "SUNNonlinSol_FixedPoint": (c_void_p, c_void_p, c_int, c_void_p),
    "SUNDenseMatrix": (c_void_p, c_int64, c_int64, c_void_p),
    "SUNLinSol_Dense": (c_void_p, c_void_p, c_void_p, c_void_p),
    "SUNBandMatrix": (c_void_p, c_int64, c_int64, c_int64, c_void_p),
    "SUNLinSol_Band": (c_void_p, c_void_p, c_void_p, c_void_p),
    "CVodeCreate": (c_void_p, c_int, c_void_p),
    "CVodeInit": (c_int, c_void_p, c_void_p, c_double, c_void_p),
    "CVodeReInit": (c_int, c_void_p, c_double, c_void_p),
    "CVodeSStolerances": (c_int, c_void_p, c_double, c_double),
    "CVodeSetUserData": (c_int, c_void_p, c_void_p),
    "CVodeSetMaxNumSteps": (c_int, c_void_p, c_long),
    "CVodeSetNonlinearSolver": (c_int, c_void_p, c_void_p),
    "CVodeSetLinearSolver": (c_int, c_void_p, c_void_p, c_void_p),
    "CVodeRootInit": (c_int, c_void_p, c_int, c_void_p),
    "CVodeSetRootDirection": (c_int, c_void_p, c_void_p),
    "CVodeSetStopTime": (c_int, c_void_p, c_double),
    "CVodeGetNumSteps": (c_int, c_void_p, c_void_p),
    "CVodeGetNumRhsEvals": (c_int, c_void_p, c_void_p),
    "CVodeGetNumLinRhsEvals": (c_int, c_void_p, c_void_p),
    "CVode": (c_int, c_void_p, c_double, c_void_p, c_void_p, c_int),
}


@cache
def library() -> dict[str, Any]:
    """Return the functions of the library that scikit-sundae is linked to."""
    from sksundae import _cy_cvode

    loaded, functions = CDLL(_cy_cvode.__file__), {}
    for name, (result, *arguments) in SIGNATURES.items():
        functions[name] = function = getattr(loaded, name)
        function.restype, function.argtypes = result, arguments
    return functions


@intrinsic
def pointer_to(typing: Any, address: Any) -> Any:  # noqa: ARG001
    """Return an address as a pointer to double."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.inttoptr(
            values[0], context.get_value_type(signature.return_type)
        )

    return types.CPointer(types.float64)(types.uintp), generate


@cache
def callbacks(functions: Compiled, n_states: int) -> tuple[Any, Any]:
    """Return right-hand side and root function as C functions."""
    fill, nearest, n_data = functions.fill, functions.nearest, len(functions.data)
    entries = library()["N_VGetArrayPointer_Serial"]
    pointer = types.voidptr

    @njit
    def array(vector: Any) -> FloatArray:
        return carray(pointer_to(entries(vector)), (n_states,))

    @numba.cfunc(
        types.int32(types.float64, pointer, pointer, pointer), error_model="numpy"
    )
    def rates(t: float, y: Any, dy: Any, data: Any) -> int:  # noqa: ARG001
        fill(array(y), carray(data, (n_data,), np.float64), array(dy))
        return 0

    heights = types.CPointer(types.float64)

    @numba.cfunc(
        types.int32(types.float64, pointer, heights, pointer), error_model="numpy"
    )
    def roots(t: float, y: Any, h: Any, data: Any) -> int:  # noqa: ARG001
        carray(h, (1,))[0] = nearest(array(y), carray(data, (n_data,), np.float64))
        return 0

    return rates, roots


@cache
def compiled_loop(flip: Any) -> Any:
    """Return the compiled loop over the events."""
    functions = library()
    advance, reinit, stop = (
        functions[name] for name in ("CVode", "CVodeReInit", "CVodeSetStopTime")
    )

    @njit
    def loop(
        memory: int,
        vector: int,
        y: FloatArray,
        data: FloatArray,
        time: FloatArray,
        end: float,
    ) -> int:
        count = 0
        while count < MOST_EVENTS:
            reinit(memory, time[0], vector)
            stop(memory, end)
            flag = advance(memory, end, vector, time.ctypes, NORMAL)
            if flag != ROOT_RETURN:
                return flag if flag < 0 else count
            count += flip(y, data)
        return -99

    return loop


def prepare_library(
    problem: Problem, functions: Compiled, method: str, tolerance: float
) -> Run:
    """Return the loop over the events, all in C. The memory that CVODE allocates is never freed."""
    c, n = library(), len(problem.y0)
    y, data, time = problem.start, functions.data.copy(), np.zeros(1)
    rates, roots = callbacks(functions, n)
    context, falling = c_void_p(), np.array([-1], dtype=np.int32)
    c["SUNContext_Create"](0, byref(context))
    vector = c["N_VMake_Serial"](n, y.ctypes.data, context)
    memory = c["CVodeCreate"](ADAMS if method == "Adams" else BDF, context)
    c["CVodeInit"](memory, rates.address, problem.t_span[0], vector)
    c["CVodeSStolerances"](memory, tolerance, tolerance)
    c["CVodeSetUserData"](memory, data.ctypes.data)
    c["CVodeSetMaxNumSteps"](memory, 100_000)
    if method == "Adams":
        c["CVodeSetNonlinearSolver"](
            memory, c["SUNNonlinSol_FixedPoint"](vector, 0, context)
        )
    else:
        matrix = c["SUNDenseMatrix"](n, n, context)
        c["CVodeSetLinearSolver"](
            memory, c["SUNLinSol_Dense"](vector, matrix, context), matrix
        )
    c["CVodeRootInit"](memory, 1, roots.address)
    c["CVodeSetRootDirection"](memory, falling.ctypes.data)
    loop = compiled_loop(functions.flip)
    kept = (rates, roots)  # keeps their machine code alive

    def run(_: object = kept) -> Found:
        y[:], data[:], time[0] = problem.y0, functions.data, problem.t_span[0]
        count = loop(memory, vector, y, data, time, problem.t_span[1])
        if count < 0:
            raise LostEventError(f"CVode returned {count}")
        return y.copy(), count

    return run


METHODS = ("Adams", "BDF")


def solvers(problem: Problem) -> list[Solver]:
    """Return CVODE's two methods, each through scikit-sundae and through C."""
    functions = compiled(problem)
    ways = {"CVODE, scikit-sundae": prepare_wrapped, "CVODE, C": prepare_library}
    return [
        Solver("SUNDIALS", way, method, partial(prepare, problem, functions, method))
        for way, prepare in ways.items()
        for method in METHODS
    ]


def prepare_wrapped(
    problem: Problem, functions: Compiled, method: str, tolerance: float
) -> Run:
    """Return the loop over the events with scikit-sundae."""
    fill, nearest = functions.fill, functions.nearest
    data = functions.data.copy()
    start, end = problem.t_span

    def rates(_: float, y: FloatArray, dy: FloatArray) -> None:
        fill(y, data, dy)

    def events(_: float, y: FloatArray, h: FloatArray) -> None:
        h[0] = nearest(y, data)

    events.terminal, events.direction = [True], [-1]  # type: ignore[attr-defined]
    solver = CVODE(
        rates, method=method, rtol=tolerance, atol=tolerance, eventsfn=events, num_events=1,
        max_num_steps=100_000,
    )  # fmt: skip

    def run() -> Found:
        data[:] = functions.data
        now, y, count = start, problem.start, 0
        for _ in range(MOST_EVENTS):
            solver.init_step(now, y)
            part = solver.step(end, tstop=end)
            now, y = part.t, part.y
            if part.status < 0:
                raise LostEventError(part.message)
            if now >= end:
                return y, count
            count += functions.flip(y, data)
        raise LostEventError(f"more than {MOST_EVENTS} events")

    return run
