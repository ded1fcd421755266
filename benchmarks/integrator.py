"""Work and precision of the integrator against scipy's `solve_ivp`, on two scenes with exact ends.

    python benchmarks/integrator.py --out integrator.csv

One row for each scene, solver and tolerance. `error_max` is the largest deviation of the final
state from the exact one, in the scene's own units; times are of one call from Python (mean of
five in a row), median and quartiles over the repeats, all in one process on one thread, the
solvers taken in turn. `field_ns` is the time of one evaluation of the field alone, called by its
address in a loop, and `over_evaluations` the time of a call over that of its evaluations;
`empty_call_us` is a call of our solver for an empty time span.
Both solvers use the same methods, and call the same Numba-compiled field and guards. scipy stops at
each event (a terminal event per guard, in the direction that its lock leaves open) and is started
again in the new mode.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from exact import hopper_end, octant_end
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hopdata.hybrid import System, solve
from hopdata.hybrid.compiled.calls import call_field
from hopdata.hybrid.compiled.views import view
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant
from hopdata.scenes.vertical_hopper import VerticalHopper

FloatArray = NDArray[np.float64]

TOLERANCES = tuple(10.0**-k for k in range(4, 13))
EQUAL_ERROR = 1e-9
EVALUATIONS = 10_000  # of the field in a row, and a tenth as many empty calls
CALLS = 5  # in a row, for each timing
COLUMNS = (
    "scene",
    "solver",
    "rtol",
    "error_max",
    "time_median_us",
    "time_q25_us",
    "time_q75_us",
    "field_evaluations",
    "field_ns",
    "over_evaluations",
    "empty_call_us",
)


@dataclass(frozen=True)
class Case:
    """A scene, where it starts, and where it truly ends."""

    name: str
    system: System
    params: tuple[float, ...]
    t_span: tuple[float, float]
    y0: tuple[float, ...]
    exact: FloatArray


def cases() -> list[Case]:
    """Return both scenes as in the dissertation, sections 4.4.2 and 4.4.3."""
    hopper = VerticalHopper()
    return [
        Case("octant", octant(), (), T_SPAN, INITIAL_STATE, octant_end()),
        Case(
            "vertical_hopper", hopper.system(), hopper.params, (0.0, 2.0), (2.0, 0.0),
            hopper_end(hopper, 2.0, 2.0),
        ),
    ]  # fmt: skip


def with_hopdata(case: Case, method: str) -> Callable[[float], tuple[FloatArray, int]]:
    """Return a function of the tolerance that gives the final state and the field evaluations."""

    def run(tolerance: float) -> tuple[FloatArray, int]:
        solution = solve(
            case.system, case.t_span, case.y0, params=case.params, rtol=tolerance, atol=tolerance,
            method=method,
        )  # fmt: skip
        return solution.y_end, solution.nfev

    return run


def with_scipy(case: Case, method: str) -> Callable[[float], tuple[FloatArray, int]]:
    """Do the same by `solve_ivp`, started again at each event."""
    ivp: Any = solve_ivp
    assert case.system.guards is not None
    field, guards = njit(case.system.field.function), njit(case.system.guards.function)
    params, n_guards = np.array(case.params, dtype=np.float64), case.system.n_guards

    def slope(t: float, y: FloatArray, mode: NDArray[np.int64]) -> FloatArray:
        dy = np.empty_like(y)
        field(t, y, mode, params, dy)
        return dy

    def heights(t: float, y: FloatArray, mode: NDArray[np.int64]) -> FloatArray:
        h, rates = np.empty(n_guards), np.empty(n_guards)
        guards(t, y, slope(t, y, mode), mode, params, h, rates)
        return h

    def event(k: int, lock: int) -> Callable[..., float]:
        def value(t: float, y: FloatArray, mode: NDArray[np.int64]) -> float:
            return heights(t, y, mode)[k]

        value.terminal, value.direction = True, -lock  # type: ignore[attr-defined]
        return value

    def run(tolerance: float) -> tuple[FloatArray, int]:
        now, state, evaluations = case.t_span[0], np.array(case.y0, dtype=np.float64), 0
        mode = np.full(n_guards, -1)
        mode[:] = np.where(heights(now, state, mode) > 0, 1, -1)
        while now < case.t_span[1]:
            part = ivp(
                slope, (now, case.t_span[1]), state, method=method, args=(mode,),
                events=[event(k, lock) for k, lock in enumerate(mode)],
                rtol=tolerance, atol=tolerance,
            )  # fmt: skip
            now, state, evaluations = part.t[-1], part.y[:, -1], evaluations + part.nfev
            for k, times in enumerate(part.t_events):
                if len(times) > 0:
                    mode[k] = -mode[k]
        return state, evaluations

    return run


@njit
def evaluate(
    address: int, states: FloatArray, mode: NDArray[np.int64], params: FloatArray, count: int
) -> None:
    """Evaluate a field many times, as the driver does, from row 0 of the states into row 1."""
    s, m, p = view(states), view(mode), view(params)
    for _ in range(count):
        call_field(address, 0.0, s, 0, m, p, s, 1)


def best_time(run: Callable[[], object], repeats: int) -> float:
    """Return the least time of a run, s: what is done is the same each time, the rest is noise."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def field_time_ns(case: Case, repeats: int) -> float:
    """Return the time of one evaluation of the field."""
    system = case.system
    states = np.array([case.y0, case.y0])
    mode, params = np.full(system.n_modes, -1), np.array(case.params, dtype=np.float64)
    arguments = (system.field.address, states, mode, params, EVALUATIONS)
    evaluate(*arguments)
    return 1e9 * best_time(lambda: evaluate(*arguments), repeats) / EVALUATIONS


def empty_call_us(case: Case, repeats: int) -> float:
    """Return the time of a call that has nothing to integrate."""
    span, calls = (case.t_span[0], case.t_span[0]), EVALUATIONS // 10

    def run() -> None:
        for _ in range(calls):
            solve(case.system, span, case.y0, params=case.params)

    run()
    return 1e6 * best_time(run, repeats) / calls


def measure(case: Case, repeats: int) -> list[dict[str, object]]:
    """Time all solvers in turn at each tolerance."""
    solvers = {
        "hopdata DOPRI5": with_hopdata(case, "dopri5"),
        "hopdata DOP853": with_hopdata(case, "dop853"),
        "scipy RK45": with_scipy(case, "RK45"),
        "scipy DOP853": with_scipy(case, "DOP853"),
    }
    rows: list[dict[str, object]] = []
    field_ns, empty_us = field_time_ns(case, repeats), empty_call_us(case, repeats)
    for tolerance in TOLERANCES:
        times: dict[str, list[float]] = {name: [] for name in solvers}
        ends = {name: run(tolerance) for name, run in solvers.items()}  # warms up, too
        for _ in range(repeats):
            for name, run in solvers.items():
                start = time.perf_counter()
                for _ in range(CALLS):
                    run(tolerance)
                times[name].append(1e6 * (time.perf_counter() - start) / CALLS)
        for name, (end, evaluations) in ends.items():
            low, median, high = np.percentile(times[name], [25, 50, 75])
            row = (case.name, name, tolerance, float(np.abs(end - case.exact).max()))
            ratio = 1e3 * median / (field_ns * evaluations)
            timed = (median, low, high, evaluations, field_ns, ratio, empty_us)
            rows.append(dict(zip(COLUMNS, (*row, *timed), strict=True)))
    return rows


def time_at(rows: pd.DataFrame, error: float) -> float:
    """Interpolate the time at an error, on logarithmic axes, along the lowest times so far, us."""
    by_error = rows.sort_values("error_max")
    envelope = np.minimum.accumulate(by_error["time_median_us"])
    return float(np.exp(np.interp(np.log(error), np.log(by_error["error_max"]), np.log(envelope))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--repeats", type=int, default=15, help="timed runs of each case")
    arguments = parser.parse_args()
    table = pd.DataFrame([row for case in cases() for row in measure(case, arguments.repeats)])
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(arguments.out, index=False)
    for (scene, solver), rows in table.groupby(["scene", "solver"]):
        ratio = rows.loc[rows["rtol"].idxmin(), "over_evaluations"]
        print(
            f"{scene:16} {solver:16} {time_at(rows, EQUAL_ERROR):10.1f} us at {EQUAL_ERROR:g}, "
            f"{ratio:8.1f} times its field evaluations at the tightest tolerance"
        )
    for scene, rows in table.groupby("scene"):
        field_ns, empty_us = rows["field_ns"].iloc[0], rows["empty_call_us"].iloc[0]
        print(f"{scene:16} field {field_ns:.1f} ns, empty call of solve {empty_us:.1f} us")


if __name__ == "__main__":
    main()
