"""Work and precision of the integrator, and what of its time is not evaluation of the field.

    python benchmarks/integrator.py --out integrator.csv

One row for each scene, solver and tolerance. `error_max` is the largest deviation of the final
state from the exact one, in the scene's own units; times are of one call from Python (mean of
calls in a row, after one that is not timed), median and quartiles over the repeats, all in one
process on one thread, the solvers and their parts taken in turn. `field_ns` is the time of one
evaluation of the field alone, called by its address in a loop along the trajectory, and
`over_evaluations` the time of a call over that of its evaluations. `bare_step_ns` and
`bare_over_evaluations` are of the method's steps alone, in one loop with the field compiled into it
(`bare.py`): no driver can be faster than its method. `over_bare` is the time of a call over that of
as many bare steps as its evaluations make.

Not in turn, but each the least of its repeats: `empty_call_us` is a call of our solver for an empty
time span; on the hopper in one dimension, `hand_written_step_ns` is a step written by hand for its
two states (`hand_written.py`), and `inlined_field_ns` an evaluation compiled into its loop, without
a call.

Both solvers use the same methods, and call the same Numba-compiled field and guards. scipy stops at
each event (a terminal event per guard, in the direction that its lock leaves open) and is started
again in the new mode. Ours runs alone where a field costs more, and the exact end is its own at the
tightest tolerance: on `plate_4`, four contacts, some tens of ns and 26 events in 2 s, and on
`hopper`, three hops on three legs (a handler decides there which legs push on), 100 ns.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from bare import best_time, field_timer, path_of, step_timer
from exact import hopper_end, octant_end
from hand_written import hopper_times_ns
from numpy.typing import NDArray
from plate_scene import Plate
from restarted import restarted

from hopdata.hybrid import System, on_event, solve
from hopdata.hybrid.methods.dop853 import DOP853
from hopdata.hybrid.methods.explicit import DOPRI5
from hopdata.scenes.body import flight_mode
from hopdata.scenes.hopper import hopper_event, hopper_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.small import INITIAL_STATE, T_SPAN, VerticalHopper, octant
from hopdata.synthesis.hops import level_state

FloatArray = NDArray[np.float64]

TOLERANCES = tuple(10.0**-k for k in range(4, 13))
EQUAL_ERROR = 1e-9
EMPTY_CALLS = 1000  # in a row
TURN_S = 5e-3  # for each timing calls follow one another so long, or five of them
LEAST_CALLS = 5
EXACT = {"rtol": 1e-14, "atol": 1e-16, "method": "dop853"}
HOPPER, BY_HAND, FIELD = "vertical_hopper", "hopdata DOPRI5", "field"
TABLEAUS = {BY_HAND: DOPRI5, "hopdata DOP853": DOP853}
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
    "bare_step_ns",
    "bare_over_evaluations",
    "over_bare",
    "hand_written_step_ns",
    "inlined_field_ns",
)
_hop = hopper_event.dispatcher


@dataclass(frozen=True)
class Case:
    """A scene, where it starts, and where it truly ends."""

    name: str
    system: System
    params: tuple[float, ...]
    t_span: tuple[float, float]
    y0: tuple[float, ...]
    exact: FloatArray
    mode: tuple[int, ...] | None = None
    with_peers: bool = True


@on_event
def keep_hopping(
    t: float, y: FloatArray, mode: NDArray[np.int64], p: FloatArray, guard: int, direction: int
) -> int:
    _hop(t, y, mode, p, guard, direction)
    return 0  # not even at an apex


def three_hops() -> Case:
    """Return three hops of the three-legged hopper, let go while it rolls a little."""
    hopper = HopperParameters()
    y0 = level_state(hopper, 0.25)
    y0[9:11] = 0.25, -0.1
    system = replace(hopper_system(), on_event=keep_hopping)
    case = Case(
        "hopper", system, tuple(hopper.vector()), (0.0, 2.0), tuple(y0), np.empty(0),
        tuple(int(x) for x in flight_mode(hopper_system(), -1.0)), with_peers=False,
    )  # fmt: skip
    return ending_by_itself(case)


def plate_on_four() -> Case:
    """Return a tilted plate that falls on four contacts and bounces."""
    plate = Plate(4)
    start = (0.0, 2.2, 0.07, 0.0, 0.0, 0.0)
    system, params = plate.system(), tuple(plate.params)
    return ending_by_itself(
        Case("plate_4", system, params, (0.0, 2.0), start, np.empty(0), with_peers=False)
    )


def ending_by_itself(case: Case) -> Case:
    """Return a case with our own end at the tightest tolerance as the exact one."""
    end = solve(
        case.system, case.t_span, case.y0, params=case.params, mode=case.mode, **EXACT
    ).y_end
    return replace(case, exact=end)


def cases() -> list[Case]:
    """Return both scenes as in the dissertation, sections 4.4.2 and 4.4.3, and costlier fields."""
    hopper = VerticalHopper()
    return [
        Case("octant", octant(), (), T_SPAN, INITIAL_STATE, octant_end()),
        Case(
            HOPPER, hopper.system(), hopper.params, (0.0, 2.0), (2.0, 0.0),
            hopper_end(hopper, 2.0, 2.0),
        ),
        plate_on_four(),
        three_hops(),
    ]  # fmt: skip


def with_hopdata(case: Case, method: str) -> Callable[[float], tuple[FloatArray, int]]:
    """Return a function of the tolerance that gives the final state and the field evaluations."""
    case.system.compile(method)

    def run(tolerance: float) -> tuple[FloatArray, int]:
        solution = solve(
            case.system, case.t_span, case.y0, params=case.params, rtol=tolerance, atol=tolerance,
            method=method, mode=case.mode,
        )  # fmt: skip
        return solution.y_end, solution.nfev

    return run


def with_scipy(case: Case, method: str) -> Callable[[float], tuple[FloatArray, int]]:
    """Do the same by `solve_ivp`, started again at each event."""
    integrate = restarted(case.system, case.params, case.t_span, case.y0)

    def run(tolerance: float) -> tuple[FloatArray, int]:
        return integrate(method=method, rtol=tolerance, atol=tolerance)

    return run


def empty_call_us(case: Case, repeats: int) -> float:
    """Return the time of a call that has nothing to integrate."""
    span = (case.t_span[0], case.t_span[0])

    def run() -> None:
        for _ in range(EMPTY_CALLS):
            solve(case.system, span, case.y0, params=case.params, mode=case.mode)

    run()
    return 1e6 * best_time(run, repeats) / EMPTY_CALLS


def solvers(case: Case) -> dict[str, Callable[[float], tuple[FloatArray, int]]]:
    """Return what integrates a scene, as functions of the tolerance."""
    ours = {name: with_hopdata(case, tableau.name) for name, tableau in TABLEAUS.items()}
    if not case.with_peers:
        return ours
    peers = {f"scipy {method}": with_scipy(case, method) for method in ("RK45", "DOP853")}
    return {**ours, **peers}


def measure(case: Case, repeats: int) -> list[dict[str, object]]:
    """Time all solvers, the field and the bare steps in turn, at each tolerance."""
    rows: list[dict[str, object]] = []
    path = path_of(case.system, case.t_span, case.y0, case.params, case.mode)
    parts = {FIELD: field_timer(path)}
    parts |= {name: step_timer(path, tableau) for name, tableau in TABLEAUS.items()}
    empty_us = empty_call_us(case, repeats)
    nowhere = (np.nan, np.nan)
    by_hand = hopper_times_ns(case.params, repeats) if case.name == HOPPER else nowhere
    for tolerance in TOLERANCES:
        runs = solvers(case)
        times: dict[str, list[float]] = {name: [] for name in runs}
        part_times: dict[str, list[float]] = {name: [] for name in parts}
        ends = {name: run(tolerance) for name, run in runs.items()}  # warms up, too
        calls = {name: calls_in_a_turn(run, tolerance) for name, run in runs.items()}
        for _ in range(repeats):
            for name, run in runs.items():
                run(tolerance)  # the peer before has taken the caches
                start = time.perf_counter()
                for _ in range(calls[name]):
                    run(tolerance)
                times[name].append(1e6 * (time.perf_counter() - start) / calls[name])
            for name, timer in parts.items():
                part_times[name].append(timer())
        part = {name: float(np.median(of)) for name, of in part_times.items()}
        for name, (end, evaluations) in ends.items():
            low, median, high = np.percentile(times[name], [25, 50, 75])
            row = (case.name, name, tolerance, float(np.abs(end - case.exact).max()))
            ratio = 1e3 * median / (part[FIELD] * evaluations)
            step, count = part.get(name, np.nan), TABLEAUS[name].evaluations if name in part else 1
            timed = (median, low, high, evaluations, part[FIELD], ratio, empty_us)
            timed += (step, step / (part[FIELD] * count))
            timed += (1e3 * median / (step * evaluations / count),)
            timed += by_hand if name == BY_HAND else nowhere
            rows.append(dict(zip(COLUMNS, (*row, *timed), strict=True)))
    return rows


def calls_in_a_turn(run: Callable[[float], tuple[FloatArray, int]], tolerance: float) -> int:
    """Return how many calls take as long as a turn is to last."""
    start = time.perf_counter()
    run(tolerance)
    return max(LEAST_CALLS, int(TURN_S / (time.perf_counter() - start)))


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
            f"{ratio:8.1f} times its field evaluations at the tightest tolerance, "
            f"the bare method {rows['bare_over_evaluations'].median():.1f} times; "
            f"{rows.loc[rows['rtol'].idxmin(), 'over_bare']:.1f} times its bare steps"
        )
    for scene, rows in table.groupby("scene"):
        field_ns, empty_us = rows["field_ns"].median(), rows["empty_call_us"].iloc[0]
        print(f"{scene:16} field {field_ns:.1f} ns, empty call of solve {empty_us:.1f} us")


if __name__ == "__main__":
    main()
