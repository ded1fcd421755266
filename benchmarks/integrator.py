"""Work and precision of the integrator, and the time it adds to evaluations of the field.

    python benchmarks/integrator.py --out integrator.csv

There is one row for each scene, solver and tolerance. `error_max` is the largest
deviation of the final state from the exact one, in the scene's own units. Times are
those of one call from Python (the mean of consecutive calls, after an untimed one):
median and quartiles over the repeats. Everything runs in one process on one thread, and
the solvers and their parts take turns. `field_ns` is the time of one evaluation of the
field alone, called by its address in a loop along the trajectory, and
`over_evaluations` is the time of a call over that of its evaluations. `bare_step_ns`
and `bare_over_evaluations` are those of the method's steps alone, in one loop with the
field compiled into it (`step_timer`): no driver can be faster than its method.
`over_bare` is the time of a call over that of as many bare steps as its evaluations
make.

Three numbers are not timed in turn; each is the least of its repeats. `empty_call_us`
is a call of our solver for an empty time span. For the one-dimensional hopper,
`hand_written_step_ns` is a step written by hand for its two states (`hopper_times_ns`),
and `inlined_field_ns` an evaluation compiled into its loop, without a call.

Both solvers use the same methods and call the same Numba-compiled field and guards.
scipy stops at each event (one terminal event per guard, in the direction that its lock
allows) and is restarted in the new mode. In two scenes with a costlier field, only our
solver runs, and its own end at the tightest tolerance counts as exact: `plate_4`, with
four contacts, some tens of ns and 26 events in 2 s, and `hopper`, three hops on three
legs (where a handler decides which legs push on), 100 ns.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numba import njit
from numpy.typing import NDArray
from restarted import restarted

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import System, on_event, solve
from hopdata.hybrid.compiled.kernel import call_field
from hopdata.hybrid.compiled.memory import address_of, array_of, int_vector, view
from hopdata.hybrid.layout import END, K1, KEND, W1, Y
from hopdata.hybrid.methods.explicit import DOP853, DOPRI5, Tableau
from hopdata.hybrid.methods.method import Scene, explicit_method
from hopdata.scenes.body import flight_mode
from hopdata.scenes.hopper import hopper_event, hopper_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant, octant_end
from hopdata.scenes.plate import Plate
from hopdata.scenes.vertical_hopper import VerticalHopper, hopper_end
from hopdata.synthesis.hops import level_state

# Cost of a method by itself: its steps in one loop, without events, step control or a
# driver.
#
# Two things are timed along a path (states and modes of a solution), in machine code:
# the field alone, called by its address as the driver does, and whole steps of an
# explicit method with the field compiled into it, including only the sums of its stages
# and its error norm. Each step continues from the last, as in an integration; a
# processor would execute independent steps in parallel.

EVALUATIONS = 20_000  # least number in a row
IN_A_ROW = 8  # evaluations at one state, as a step makes them in one mode
TINY_STEP = 1e-7  # s; the states are given, so the step need not be useful


@dataclass(frozen=True)
class Route:
    """The path of a system.

    Parameters
    ----------
    system : System
    params : (p,) array
    states : (N, n) array
    modes : (N, m) array of int
    """

    system: System
    params: FloatArray
    states: FloatArray
    modes: IntArray

    @property
    def rounds(self) -> int:
        """Number of times to go along the path."""
        return EVALUATIONS // (IN_A_ROW * len(self.states)) + 1


def path_of(
    system: System, t_span: tuple[float, float], y0: Sequence[float], params: Sequence[float],
    mode: Sequence[int] | None,
) -> Route:  # fmt: skip
    """Return the path of a solution, with one state per step."""
    whole, start = (
        solve(system, span, y0, params=params, mode=mode, method="dopri5")
        for span in (t_span, (t_span[0], t_span[0]))
    )
    modes = np.vstack([start.mode, whole.events.mode])
    last_event = np.searchsorted(whole.events.time, whole.t, side="right")
    states = np.ascontiguousarray(whole.y.T)
    return Route(system, np.array(params, dtype=np.float64), states, modes[last_event])


@njit(error_model="numpy")
def _evaluate(
    address: int, states: FloatArray, modes: IntArray, params: FloatArray, rounds: int
) -> None:
    table, p, out = view(states), view(params), view(np.empty((1, states.shape[1])))
    for _ in range(rounds):
        for i in range(len(states)):
            mode = int_vector(
                address_of(view(modes)) + 8 * i * modes.shape[1], modes.shape[1]
            )
            for _ in range(IN_A_ROW):
                call_field(address, 0.0, table, i, mode, p, out, 0)


@njit(error_model="numpy")
def _take_steps(
    step: Any, states: FloatArray, modes: IntArray, params: FloatArray, room: FloatArray,
    atol: FloatArray, rounds: int,
) -> float:  # fmt: skip
    s, allowed, total, n_modes = view(room), view(atol), 0.0, modes.shape[1]
    for _ in range(rounds):
        for i in range(len(states)):
            mode = array_of(
                int_vector(address_of(view(modes)) + 8 * i * n_modes, n_modes)
            )
            for j in range(states.shape[1]):
                s[Y, j], s[K1, j] = states[i, j], 1.0
            for _ in range(IN_A_ROW):
                total += step(0.0, TINY_STEP, 1e-9, s, mode, params, allowed, 0)
                for j in range(states.shape[1]):
                    s[Y, j], s[K1, j] = s[END, j], s[KEND, j]
    return total


def best_time(run: Callable[[], object], repeats: int) -> float:
    """Return the least time of a run, s. The work is the same each time; the rest is noise."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def once(run: Callable[[], object], count: int) -> Callable[[], float]:
    """Return a function that measures the time per item of a run of `count` items, ns."""
    run()
    return lambda: 1e9 * best_time(run, 1) / count


def field_timer(path: Route) -> Callable[[], float]:
    """Return a function that measures the mean time of a field evaluation along the path, ns."""
    address = path.system.field.address
    arguments = (address, path.states, path.modes, path.params, path.rounds)
    return once(
        lambda: _evaluate(*arguments), path.rounds * len(path.states) * IN_A_ROW
    )


def step_timer(path: Route, tableau: Tableau) -> Callable[[], float]:
    """Return a function that measures the time of a bare step of an explicit method, ns."""
    n = path.system.n_states
    step = njit(error_model="numpy")(
        explicit_method(tableau, Scene(path.system.field, n)).step
    )
    room, atol = np.zeros((W1 + tableau.work_rows, n)), np.full(n, 1e-9)
    arguments = (step, path.states, path.modes, path.params, room, atol, path.rounds)
    return once(
        lambda: _take_steps(*arguments), path.rounds * len(path.states) * IN_A_ROW
    )


# The least possible cost of a step: DOPRI5 for one scene, written by hand for its two
# states.


STEPS = 20_000  # consecutive steps in a timing
(A21,), (A31, A32), (A41, A42, A43), (A51, A52, A53, A54), A6 = DOPRI5.stages
A61, A62, A63, A64, A65 = A6
B1, _, B3, B4, B5, B6 = DOPRI5.weights
E1, _, E3, E4, E5, E6, E7 = DOPRI5.errors[0]


@njit(error_model="numpy")
def _rate(z: float, v: float, lock: int, p: NDArray[np.float64]) -> tuple[float, float]:
    """Return the field of `exact`, for scalars."""
    gravity, stiffness, rest_length, damping = p[0], p[1], p[2], p[3]
    push = stiffness * (rest_length - z) - damping * v if lock < 0 else 0.0
    return v, push - gravity


@njit(error_model="numpy")
def _steps(
    count: int, z: float, v: float, lock: int, p: NDArray[np.float64], dt: float
) -> float:
    """Take `count` steps; return the sum of their errors, so that nothing is optimised away."""
    tolerance, total = 1e-9, 0.0
    k1, m1 = _rate(z, v, lock, p)
    for _ in range(count):
        k2, m2 = _rate(z + dt * (A21 * k1), v + dt * (A21 * m1), lock, p)
        k3, m3 = _rate(
            z + dt * (A31 * k1 + A32 * k2), v + dt * (A31 * m1 + A32 * m2), lock, p
        )  # fmt: skip
        k4, m4 = _rate(
            z + dt * (A43 * k3 + (A41 * k1 + A42 * k2)),
            v + dt * (A43 * m3 + (A41 * m1 + A42 * m2)), lock, p,
        )  # fmt: skip
        k5, m5 = _rate(
            z + dt * ((A51 * k1 + A52 * k2) + (A53 * k3 + A54 * k4)),
            v + dt * ((A51 * m1 + A52 * m2) + (A53 * m3 + A54 * m4)), lock, p,
        )  # fmt: skip
        k6, m6 = _rate(
            z + dt * (A65 * k5 + ((A61 * k1 + A62 * k2) + (A63 * k3 + A64 * k4))),
            v + dt * (A65 * m5 + ((A61 * m1 + A62 * m2) + (A63 * m3 + A64 * m4))), lock, p,
        )  # fmt: skip
        z_end = z + dt * (B6 * k6 + ((B1 * k1 + B3 * k3) + (B4 * k4 + B5 * k5)))
        v_end = v + dt * (B6 * m6 + ((B1 * m1 + B3 * m3) + (B4 * m4 + B5 * m5)))
        k7, m7 = _rate(z_end, v_end, lock, p)
        z_error = (E1 * k1 + E3 * k3) + (E4 * k4 + E5 * k5) + (E6 * k6 + E7 * k7)
        v_error = (E1 * m1 + E3 * m3) + (E4 * m4 + E5 * m5) + (E6 * m6 + E7 * m7)
        e0 = dt * z_error / (tolerance + tolerance * max(abs(z), abs(z_end)))
        e1 = dt * v_error / (tolerance + tolerance * max(abs(v), abs(v_end)))
        total += sqrt(0.5 * (e0 * e0 + e1 * e1))
        z, v, k1, m1 = z_end, v_end, k7, m7
    return total


@njit(error_model="numpy")
def _rates(
    states: NDArray[np.float64], lock: int, p: NDArray[np.float64], rounds: int
) -> float:
    """Evaluate the field along states in a bare loop."""
    total = 0.0
    for _ in range(rounds):
        for i in range(len(states)):
            dz, dv = _rate(states[i, 0], states[i, 1], lock, p)
            total += dz + dv
    return total


def hopper_times_ns(params: tuple[float, ...], repeats: int) -> tuple[float, float]:
    """Return the times of a step and of an evaluation compiled into its loop, in stance."""
    p = np.array(params)
    states = np.ascontiguousarray(np.linspace([0.9, -1.0], [1.0, 1.0], 64))
    rounds = STEPS // len(states)

    def steps() -> float:
        return float(_steps(STEPS, 0.95, 0.0, -1, p, TINY_STEP))

    def rates() -> float:
        return float(_rates(states, -1, p, rounds))

    steps(), rates()
    step_s, rates_s = best_time(steps, repeats), best_time(rates, repeats)
    return 1e9 * step_s / STEPS, 1e9 * rates_s / (rounds * len(states))


TOLERANCES = tuple(10.0**-k for k in range(4, 13))
EQUAL_ERROR = 1e-9
EMPTY_CALLS = 1000  # consecutive calls in a timing
TURN_S = (
    5e-3  # duration of consecutive calls for each timing, or five calls if longer, s
)
LEAST_CALLS = 5
EXACT = {"rtol": 1e-14, "atol": 1e-16, "method": "dop853"}
HOPPER, BY_HAND, FIELD = "vertical_hopper", "hopdata DOPRI5", "field"
TABLEAUS = {BY_HAND: DOPRI5, "hopdata DOP853": DOP853}
METHODS = {BY_HAND: "dopri5", "hopdata DOP853": "dop853"}
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
    """A scene, its start, and its exact end."""

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
    t: float,
    y: FloatArray,
    mode: NDArray[np.int64],
    p: FloatArray,
    guard: int,
    direction: int,
) -> int:
    _hop(t, y, mode, p, guard, direction)
    return 0  # the event does not end the integration, not even at an apex


def three_hops() -> Case:
    """Return three hops of the three-legged hopper, released with a slight roll."""
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
        Case(
            "plate_4", system, params, (0.0, 2.0), start, np.empty(0), with_peers=False
        )
    )


def ending_by_itself(case: Case) -> Case:
    """Return a case whose exact end is our own at the tightest tolerance."""
    end = solve(
        case.system, case.t_span, case.y0, params=case.params, mode=case.mode, **EXACT
    ).y_end
    return replace(case, exact=end)


def cases() -> list[Case]:
    """Return both scenes of the dissertation, sections 4.4.2 and 4.4.3, and costlier fields."""
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
    """Return the same for `solve_ivp`, restarted at each event."""
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
    """Return the solvers of a scene, as functions of the tolerance."""
    ours = {name: with_hopdata(case, method) for name, method in METHODS.items()}
    if not case.with_peers:
        return ours
    peers = {
        f"scipy {method}": with_scipy(case, method) for method in ("RK45", "DOP853")
    }
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
        ends = {name: run(tolerance) for name, run in runs.items()}  # also warms up
        calls = {name: calls_in_a_turn(run, tolerance) for name, run in runs.items()}
        for _ in range(repeats):
            for name, run in runs.items():
                run(
                    tolerance
                )  # restores the caches, which the previous solver has used
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
            step, count = (
                part.get(name, np.nan),
                len(TABLEAUS[name].weights) if name in part else 1,
            )
            timed = (median, low, high, evaluations, part[FIELD], ratio, empty_us)
            timed += (step, step / (part[FIELD] * count))
            timed += (1e3 * median / (step * evaluations / count),)
            timed += by_hand if name == BY_HAND else nowhere
            rows.append(dict(zip(COLUMNS, (*row, *timed), strict=True)))
    return rows


def calls_in_a_turn(
    run: Callable[[float], tuple[FloatArray, int]], tolerance: float
) -> int:
    """Return how many calls fill one turn."""
    start = time.perf_counter()
    run(tolerance)
    return max(LEAST_CALLS, int(TURN_S / (time.perf_counter() - start)))


def time_at(rows: pd.DataFrame, error: float) -> float:
    """Interpolate the time at an error, us, on logarithmic axes along the lowest times so far."""
    by_error = rows.sort_values("error_max")
    envelope = np.minimum.accumulate(by_error["time_median_us"])
    return float(
        np.exp(
            np.interp(np.log(error), np.log(by_error["error_max"]), np.log(envelope))
        )
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument(
        "--repeats", type=int, default=15, help="timed runs of each case"
    )
    arguments = parser.parse_args()
    table = pd.DataFrame(
        [row for case in cases() for row in measure(case, arguments.repeats)]
    )
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
        print(
            f"{scene:16} field {field_ns:.1f} ns, empty call of solve {empty_us:.1f} us"
        )


if __name__ == "__main__":
    main()
