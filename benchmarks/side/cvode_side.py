"""CVODE in C, with compiled callbacks and a compiled loop over the events.

The library is the one inside scikit-sundae (`peers.sundials_peer.library`). All guards
are root functions of CVODE, in the direction of their events.
"""

from __future__ import annotations

import math
from ctypes import byref, c_int, c_void_p
from functools import cache, partial
from typing import Any

import numba
import numpy as np
from numba import carray, njit, types
from peers import FloatArray, Found, LostEventError, Run, Solver
from peers import sundials_peer as sundials

from side import MOST_EVENTS, Scene

METHODS = {"Adams": sundials.ADAMS, "BDF": sundials.BDF}
TOO_MANY = -99
sundials.SIGNATURES["CVodeGetRootInfo"] = (c_int, c_void_p, c_void_p)


def solvers(scene: Scene) -> list[Solver]:
    """Return CVODE's two methods."""
    sundials.library()
    return [
        Solver("SUNDIALS", "CVODE, C", method, partial(prepare, scene, method))
        for method in METHODS
    ]


@cache
def compiled(scene: Scene) -> tuple[Any, Any, Any]:
    """Return the right-hand side and the root functions for C, and the loop."""
    functions = sundials.library()
    rates = njit(scene.rates(math))
    heights = njit(scene.heights(math))
    after = njit(scene.after(math))
    entries = functions["N_VGetArrayPointer_Serial"]
    n, n_modes, n_guards = len(scene.y0), len(scene.mode), scene.n_guards
    pointer = types.voidptr

    @njit
    def array(vector: Any) -> FloatArray:
        return carray(sundials.pointer_to(entries(vector)), (n,))

    @numba.cfunc(
        types.int32(types.float64, pointer, pointer, pointer), error_model="numpy"
    )
    def field(t: float, y: Any, dy: Any, data: Any) -> int:
        out = array(dy)
        values = rates(t, array(y), carray(data, (n_modes,), np.float64))
        for i in range(n):
            out[i] = values[i]
        return 0

    out_type = types.CPointer(types.float64)

    @numba.cfunc(
        types.int32(types.float64, pointer, out_type, pointer), error_model="numpy"
    )
    def roots(t: float, y: Any, h: Any, data: Any) -> int:
        out = carray(h, (n_guards,))
        values = heights(t, array(y), carray(data, (n_modes,), np.float64))
        for k in range(n_guards):
            out[k] = values[k]
        return 0

    reinit, stop = functions["CVodeReInit"], functions["CVodeSetStopTime"]
    advance, which = functions["CVode"], functions["CVodeGetRootInfo"]
    found_root, normal = sundials.ROOT_RETURN, sundials.NORMAL

    @njit
    def loop(
        memory: int, vector: int, y: FloatArray, mode: FloatArray, time: FloatArray,
        found: Any, end: float,
    ) -> int:  # fmt: skip
        for count in range(MOST_EVENTS):
            reinit(memory, time[0], vector)
            stop(memory, end)
            flag = advance(memory, end, vector, time.ctypes, normal)
            if flag != found_root:
                return flag if flag < 0 else count
            which(memory, found.ctypes)
            k = 0
            while found[k] == 0:
                k += 1
            state, changed = after(time[0], y, mode, k)
            for i in range(n):
                y[i] = state[i]
            for i in range(n_modes):
                mode[i] = changed[i]
        return TOO_MANY

    return field, roots, loop


def prepare(scene: Scene, method: str, tolerance: float) -> Run:
    """Return the loop over the events. The memory that CVODE allocates is never freed."""
    c, n = sundials.library(), len(scene.y0)
    field, roots, loop = compiled(scene)
    y, mode, time = scene.start, np.array([*scene.mode, 0.0]), np.zeros(1)
    found = np.zeros(scene.n_guards, dtype=np.int32)
    context, falling = c_void_p(), np.full(scene.n_guards, -1, dtype=np.int32)
    c["SUNContext_Create"](0, byref(context))
    vector = c["N_VMake_Serial"](n, y.ctypes.data, context)
    memory = c["CVodeCreate"](METHODS[method], context)
    c["CVodeInit"](memory, field.address, scene.t_span[0], vector)
    c["CVodeSStolerances"](memory, tolerance, tolerance)
    c["CVodeSetUserData"](memory, mode.ctypes.data)
    c["CVodeSetMaxNumSteps"](memory, 100_000)
    if method == "Adams":
        fixed_point = c["SUNNonlinSol_FixedPoint"](vector, 0, context)
        c["CVodeSetNonlinearSolver"](memory, fixed_point)
    else:
        matrix = c["SUNDenseMatrix"](n, n, context)
        linear = c["SUNLinSol_Dense"](vector, matrix, context)
        c["CVodeSetLinearSolver"](memory, linear, matrix)
    c["CVodeRootInit"](memory, scene.n_guards, roots.address)
    c["CVodeSetRootDirection"](memory, falling.ctypes.data)

    def run() -> Found:
        y[:], time[0] = scene.y0, scene.t_span[0]
        mode[: len(scene.mode)] = scene.mode
        count = loop(memory, vector, y, mode, time, found, scene.t_span[1])
        if count < 0:
            raise LostEventError(f"CVode returned {count}")
        return y.copy(), count

    return run
