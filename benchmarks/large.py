# ruff: noqa: ARG001 (the integrators prescribe the signatures of a field)
"""Large stiff systems with sparse Jacobians, beside CVODE and SciPy.

    python benchmarks/large.py --out large.csv

Three problems, on grids of growing size: `rod` is heat in a rod, `plate` is heat in a
square, and `brusselator` is a chemical reaction with diffusion along a line (Hairer and
Wanner, *Solving Ordinary Differential Equations II*, section IV.10). The first two have
exact solutions on the grid; the third is compared with our own result at a tolerance a
thousand times tighter. All solvers get the same compiled field and the same pattern or
bandwidths, and take the differences themselves.

The table has one row per problem, size, solver and tolerance. `error` is the largest
deviation of the final state, relative to its largest component. `seconds` is processor
time, the least of several runs (of one, if it takes long) after a first one that
compiles; `setup_seconds` is what ours spends once per system on colours and order.
`steps` and `evaluations` are as each solver counts them.

CVODE solves bands in C, with compiled callbacks. For other patterns it is called through
scikit-sundae, which fills the Jacobian, and whose callbacks are Python's: on the large
grids they do not count. It does not tell its steps.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from ctypes import byref, c_double, c_long, c_void_p
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pandas as pd
from scipy import sparse
from scipy.integrate import solve_ivp

from hopdata.arrays import FloatArray
from hopdata.hybrid import System, field, solve

try:
    from peers import sundials_peer
    from sksundae.cvode import CVODE
except ImportError:
    CVODE = None


@field
def rod(t, y, mode, params, dy):
    n = len(y)
    rate = (n + 1.0) ** 2
    for i in range(n):
        left = y[i - 1] if i > 0 else 0.0
        right = y[i + 1] if i < n - 1 else 0.0
        dy[i] = rate * (left - 2.0 * y[i] + right)


@field
def plate(t, y, mode, params, dy):
    m = int(params[0])
    rate = (m + 1.0) ** 2
    for i in range(m):
        for j in range(m):
            k = i * m + j
            total = -4.0 * y[k]
            if i > 0:
                total += y[k - m]
            if i < m - 1:
                total += y[k + m]
            if j > 0:
                total += y[k - 1]
            if j < m - 1:
                total += y[k + 1]
            dy[k] = rate * total


@field
def brusselator(t, y, mode, params, dy):
    m = len(y) // 2
    rate = (m + 1.0) ** 2 / 50.0
    for i in range(m):
        u = y[2 * i]
        v = y[2 * i + 1]
        u_left = y[2 * i - 2] if i > 0 else 1.0
        u_right = y[2 * i + 2] if i < m - 1 else 1.0
        v_left = y[2 * i - 1] if i > 0 else 3.0
        v_right = y[2 * i + 3] if i < m - 1 else 3.0
        reaction = u * u * v
        dy[2 * i] = 1.0 + reaction - 4.0 * u + rate * (u_left - 2.0 * u + u_right)
        dy[2 * i + 1] = 3.0 * u - reaction + rate * (v_left - 2.0 * v + v_right)


@dataclass(frozen=True)
class Problem:
    """A problem of one size.

    Parameters
    ----------
    name : str
        Name of the problem.
    field : Callback
        Its field.
    params : list of float
        Parameters of the field.
    y0 : (n,) array
        Start.
    end : float
        End of the time span, which starts at 0.
    sparsity : matrix or tuple of int
        Pattern, or bandwidths.
    exact : (n,) array, optional
        Final state, if it is known.
    """

    name: str
    field: Any
    params: list[float]
    y0: FloatArray
    end: float
    sparsity: Any
    exact: FloatArray | None = None

    @property
    def n_states(self) -> int:
        """Number of states."""
        return len(self.y0)

    @property
    def banded(self) -> bool:
        """Whether the Jacobian is a narrow band."""
        return isinstance(self.sparsity, tuple)

    def pattern(self) -> Any:
        """Return the pattern as a sparse matrix."""
        if not self.banded:
            return sparse.csc_matrix(self.sparsity)
        lower, upper = self.sparsity
        offsets = range(-lower, upper + 1)
        ones = np.ones((len(offsets), self.n_states))
        shape = (self.n_states, self.n_states)
        return sparse.csc_matrix(sparse.diags_array(ones, offsets=offsets, shape=shape))

    def rates(self) -> Callable[[float, FloatArray, FloatArray], None]:
        """Return the field as a compiled function that fills its last argument."""
        fill = numba.njit(error_model="numpy")(self.field.function)
        mode = np.zeros(0, dtype=np.int64)
        params = np.array(self.params, dtype=float)

        def rates(t: float, y: FloatArray, dy: FloatArray) -> None:
            fill(t, y, mode, params, dy)

        return rates


def decay(n: int, mode: int) -> float:
    """Return the rate of a sine of heat on a grid of n points."""
    return -4.0 * (n + 1) ** 2 * np.sin(0.5 * np.pi * mode / (n + 1)) ** 2


def rod_of(n: int) -> Problem:
    """Return heat in a rod of n points."""
    x = np.arange(1, n + 1) / (n + 1)
    first = np.sin(np.pi * x)
    third = np.sin(3 * np.pi * x)
    end = 0.1
    exact = np.exp(decay(n, 1) * end) * first + np.exp(decay(n, 3) * end) * third
    return Problem("rod", rod, [], first + third, end, (1, 1), exact)


def plate_of(m: int) -> Problem:
    """Return heat in a square of m times m points."""
    x = np.arange(1, m + 1) / (m + 1)
    y0 = np.outer(np.sin(np.pi * x), np.sin(2 * np.pi * x)).ravel()
    end = 0.05
    exact = np.exp((decay(m, 1) + decay(m, 2)) * end) * y0
    along = sparse.diags_array(np.ones((3, m)), offsets=[-1, 0, 1], shape=(m, m))
    one = sparse.eye_array(m)
    pattern = sparse.kron(along, one) + sparse.kron(one, along)
    return Problem("plate", plate, [m], y0, end, pattern, exact)


def brusselator_of(m: int) -> Problem:
    """Return the Brusselator with m points, so 2 m states."""
    x = np.arange(1, m + 1) / (m + 1)
    y0 = np.empty(2 * m)
    y0[::2] = 1.0 + np.sin(2 * np.pi * x)
    y0[1::2] = 3.0
    problem = Problem("brusselator", brusselator, [], y0, 10.0, (2, 2))
    _, found = ours(problem, 1e-10)
    return Problem("brusselator", brusselator, [], y0, 10.0, (2, 2), found())


Run = Callable[[], FloatArray]
Counts = dict[str, Any]


def ours(problem: Problem, tolerance: float) -> tuple[Counts, Run]:
    """Return counts, filled by each run, and a run of ours."""
    system = System(problem.field, n_states=problem.n_states, sparsity=problem.sparsity)
    started = time.process_time()
    factors = system.sparsity.structure.factors
    counts: Counts = {"setup_seconds": time.process_time() - started}
    counts["matrix"] = "band" if factors.is_band else "sparse"
    counts["matrix_entries"] = factors.size

    def run() -> FloatArray:
        found = solve(
            system, (0.0, problem.end), problem.y0, params=problem.params,
            method="rosenbrock", rtol=tolerance, atol=1e-3 * tolerance, t_eval=(),
        )  # fmt: skip
        assert found.success, found.message
        counts.update(steps=found.n_steps, evaluations=found.nfev)
        return found.y_end

    return counts, run


def cvode(problem: Problem, tolerance: float) -> tuple[Counts, Run]:
    """Return counts and a run of CVODE's BDF."""
    if problem.banded:
        return cvode_in_c(problem, tolerance)
    fill = problem.rates()
    evaluations = [0]

    def rates(t: float, y: FloatArray, dy: FloatArray) -> None:
        evaluations[0] += 1
        fill(t, y, dy)

    solver = CVODE(
        rates, method="BDF", rtol=tolerance, atol=1e-3 * tolerance,
        max_num_steps=100_000, linsolver="sparse", sparsity=problem.pattern(),
    )  # fmt: skip
    counts: Counts = {"matrix": "sparse"}

    def run() -> FloatArray:
        evaluations[0] = 0
        found = solver.solve(np.array([0.0, problem.end]), problem.y0)
        assert found.success, found.message
        counts["evaluations"] = evaluations[0]
        return np.asarray(found.y[-1])

    return counts, run


def callback_in_c(problem: Problem) -> Any:
    """Return the field as a C function of CVODE."""
    fill = numba.njit(error_model="numpy")(problem.field.function)
    entries = sundials_peer.library()["N_VGetArrayPointer_Serial"]
    pointer_to = sundials_peer.pointer_to
    n = problem.n_states
    mode = np.zeros(0, dtype=np.int64)
    params = np.array(problem.params, dtype=float)
    pointer = numba.types.voidptr
    native = numba.types.int32(numba.types.float64, pointer, pointer, pointer)

    @numba.cfunc(native, error_model="numpy")
    def rates(t: float, y: Any, dy: Any, data: Any) -> int:
        states = numba.carray(pointer_to(entries(y)), (n,))
        slopes = numba.carray(pointer_to(entries(dy)), (n,))
        fill(t, states, mode, params, slopes)
        return 0

    return rates


def cvode_in_c(problem: Problem, tolerance: float) -> tuple[Counts, Run]:
    """Return counts and a run of CVODE with its band solver, all in C."""
    c = sundials_peer.library()
    n = problem.n_states
    lower, upper = problem.sparsity
    y = problem.y0.copy()
    rates = callback_in_c(problem)
    context = c_void_p()
    c["SUNContext_Create"](0, byref(context))
    vector = c["N_VMake_Serial"](n, y.ctypes.data, context)
    memory = c["CVodeCreate"](sundials_peer.BDF, context)
    c["CVodeInit"](memory, rates.address, 0.0, vector)
    c["CVodeSStolerances"](memory, tolerance, 1e-3 * tolerance)
    c["CVodeSetMaxNumSteps"](memory, 100_000)
    matrix = c["SUNBandMatrix"](n, upper, lower, context)
    solver = c["SUNLinSol_Band"](vector, matrix, context)
    c["CVodeSetLinearSolver"](memory, solver, matrix)
    counts: Counts = {"matrix": "band"}

    def counted(name: str) -> int:
        number = c_long()
        c[name](memory, byref(number))
        return number.value

    def run(_: object = rates) -> FloatArray:  # keeps its machine code alive
        y[:] = problem.y0
        now = c_double()
        c["CVodeReInit"](memory, 0.0, vector)
        c["CVodeSetStopTime"](memory, problem.end)
        flag = c["CVode"](memory, problem.end, vector, byref(now), sundials_peer.NORMAL)
        assert flag >= 0, flag
        counts["steps"] = counted("CVodeGetNumSteps")
        counts["evaluations"] = counted("CVodeGetNumRhsEvals")
        counts["evaluations"] += counted("CVodeGetNumLinRhsEvals")
        return y.copy()

    return counts, run


def scipys(method: str) -> Callable[[Problem, float], tuple[Counts, Run]]:
    """Return a function that prepares one of SciPy's implicit methods."""

    def prepare(problem: Problem, tolerance: float) -> tuple[Counts, Run]:
        fill = problem.rates()
        pattern = problem.pattern()
        counts: Counts = {"matrix": "sparse"}

        def rates(t: float, y: FloatArray) -> FloatArray:
            dy = np.empty_like(y)
            fill(t, np.ascontiguousarray(y), dy)
            return dy

        def run() -> FloatArray:
            found = solve_ivp(
                rates, (0.0, problem.end), problem.y0, method=method,
                jac_sparsity=pattern, rtol=tolerance, atol=1e-3 * tolerance,
            )  # fmt: skip
            assert found.success, found.message
            counts.update(steps=len(found.t) - 1, evaluations=found.nfev)
            return np.asarray(found.y[:, -1])

        return counts, run

    return prepare


SOLVERS = {
    "ours, Rodas5P": ours,
    "SUNDIALS, CVODE BDF": cvode,
    "SciPy, BDF": scipys("BDF"),
    "SciPy, Radau": scipys("Radau"),
}
SIZES = {
    rod_of: (400, 10_000, 100_000),
    brusselator_of: (200, 5_000, 50_000),
    plate_of: (40, 100, 300),
}
TOLERANCES = (1e-4, 1e-6, 1e-8)
REPEATS = 5
LONG_S = 2.0  # a run that takes longer is not repeated


def shortest_time(run: Run) -> float:
    """Return the shortest time of several runs."""
    times: list[float] = []
    while len(times) < REPEATS and sum(times) < LONG_S:
        started = time.process_time()
        run()
        times.append(time.process_time() - started)
    return min(times)


def measured(problem: Problem, solver: str, tolerance: float) -> Counts:
    """Return a row of the table."""
    row: Counts = {
        "problem": problem.name,
        "states": problem.n_states,
        "solver": solver,
        "rtol": tolerance,
    }
    if solver.startswith("SUNDIALS") and CVODE is None:
        return row | {"matrix": "absent"}
    counts, run = SOLVERS[solver](problem, tolerance)
    end = run()
    assert problem.exact is not None
    error = np.abs(end - problem.exact).max() / np.abs(problem.exact).max()
    seconds = shortest_time(run)
    return row | {"error": error, "seconds": seconds} | counts


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--largest", type=int, default=100_000, help="number of states")
    parser.add_argument("--tolerances", type=float, nargs="+", default=TOLERANCES)
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS))
    arguments = parser.parse_args()
    rows = []
    for make, sizes in SIZES.items():
        for size in sizes:
            problem = make(size)
            if problem.n_states > arguments.largest:
                continue
            for solver in arguments.solvers:
                for tolerance in arguments.tolerances:
                    rows.append(measured(problem, solver, tolerance))
                    print(rows[-1], flush=True)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(rows).to_csv(arguments.out, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
