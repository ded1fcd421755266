# ruff: noqa: ARG001, ARG005 (the integrators prescribe the signatures)
"""Error and time of the integrator and its peers on eight scenes, at all tolerances.

    python benchmarks/work_precision.py --out work_precision.csv

It writes the table and, beside it, `ratios.csv` (times at an error of 1e-9 over ours),
`head_to_head.csv` and `batches.csv`, in one process on one thread. At each tolerance
all solvers take turns. Times are those of one trajectory, in CPU time of the process
(which other programs hardly affect), as median and quartiles over the turns. They
exclude compilation and setup, which are in `compile_s`: the wall-clock time of the
first call and all preparation for it, beyond that of the second call. `setting` is the
relative and absolute tolerance, or MuJoCo's time step, s. `error_max` is the largest
deviation of the final state from the exact one. `events_lost` is the number of events
that were not found (negative: too many), empty if a solver does not report it. A solver
that fails or is not installed has a row that says so.

`head_to_head.csv` has each package's fastest solver and tolerance, from tolerances a
decade apart, among those whose final state errs by at most 1e-9; ours enters once in
single calls and once in a batch. They are timed in turn, and each turn gives a ratio,
because a temporary slowdown of the machine then affects both.

`batches.csv` has ten thousand systems at a tolerance of 1e-9, with random starts (seed
0): pendulums, x'' = -sin x from rest at x0 in [-2, 2] for 10 s, with the guard x = 0,
which is crossed about three times; and, by our solver alone, one-dimensional hoppers
and plates on 35 springs. Times are CPU time of the process for one system (wall-clock
time with two threads, then with that of the process in `cpu_us_per_system`), as the
median of the repeats, which all solvers take in turn; they exclude earlier compilation.
Errors are those of the final state relative to our driver's at the tightest tolerance;
`events_lost` counts systems whose number of events differs from the driver's. heyoka's
batch steps eight systems together, with an event callback in Python, or without events;
diffrax runs under `vmap`, with fewer systems. `lanes` is the number of systems that run
in a lane each.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field as own
from functools import partial
from itertools import zip_longest
from math import sin
from pathlib import Path
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from peers import FloatArray, Found, Problem, Solver, problems, solvers_of

from hopdata.arrays import IntArray
from hopdata.hybrid import System, field, guards, solve_batch
from hopdata.hybrid.arguments import SMALLEST_RTOL
from hopdata.hybrid.lanes.vectors import WIDTH
from hopdata.scenes.plate import PLATE_SPAN, Plate
from hopdata.scenes.vertical_hopper import VerticalHopper

# Times at equal error, and their ratios.


EQUAL_ERROR = 1e-9
SMALLEST = 1e-17  # replaces an error of zero on a logarithmic axis
OURS, OUR_CALL, OUR_BATCH = "hopdata", "hopdata, call", "hopdata, batch"


def time_at(rows: pd.DataFrame, error: float) -> float:
    """Interpolate the time at an error, us, on logarithmic axes along the least times so far.

    The result is NaN if the error is not reached. If even the loosest tolerance is more
    accurate, its time is returned.
    """
    done = rows[rows["time_median_us"].notna() & rows["error_max"].notna()]
    if done.empty or done["error_max"].min() > error:
        return np.nan
    by_error = done.sort_values("error_max")
    envelope = np.minimum.accumulate(by_error["time_median_us"])
    errors = np.log(np.maximum(by_error["error_max"], SMALLEST))
    return float(np.exp(np.interp(np.log(error), errors, np.log(envelope))))


def ratios(table: pd.DataFrame, error: float = EQUAL_ERROR) -> pd.DataFrame:
    """Return one row per scene and solver: its time at an error over ours.

    Ours is our fastest method, in single calls (``ratio``) and in a batch
    (``ratio_to_batch``). A ratio above 1 means that ours is faster. ``best_of_package``
    marks the fastest solver of each package.
    """
    parts = []
    keys = ["scene", "package", "way", "method"]
    for key, rows in table.groupby(keys, sort=False, dropna=False):
        parts.append(dict(zip(keys, key, strict=True)) | {
            "error": error, "time_us": time_at(rows, error), "least_error": rows["error_max"].min(),
        })  # fmt: skip
    result = pd.DataFrame(parts)
    for way, column in ((OUR_CALL, "ratio"), (OUR_BATCH, "ratio_to_batch")):
        ours = result[result["way"] == way].groupby("scene")["time_us"].min()
        result[column] = result["time_us"] / result["scene"].map(ours)
    best = result.groupby(["scene", "package"])["time_us"].transform("min")
    result["best_of_package"] = result["time_us"] == best
    result["note"] = np.where(
        result["time_us"].notna(), "",
        np.where(result["least_error"].isna(), "no result", "does not reach the error"),
    )  # fmt: skip
    return result


def best_of_way(ratio_table: pd.DataFrame) -> pd.Series:
    """Mark in each scene each way's fastest method, or its most accurate if none gets there."""
    ranked = ratio_table.sort_values(["time_us", "least_error"], na_position="last")
    first = ranked.groupby(["scene", "way"]).head(1).index
    return pd.Series(ratio_table.index.isin(first), index=ratio_table.index)


FAR_OFF = 0.1  # an error that no tolerance here explains
BLOCK_S = 500e-6  # least duration of consecutive calls in one timing
MOST_TRIES = 20
BUDGET_S = 0.06  # for all timings of a solver at a setting, ...
FEWEST = 3  # ... but at least this many
LONGEST_S = 0.5  # a longer run is timed once, and tighter tolerances are not tried
COLUMNS = (
    "scene", "package", "way", "method", "setting", "error_max", "events_lost", "time_median_us",
    "time_q25_us", "time_q75_us", "timings", "compile_s", "status",
)  # fmt: skip


@dataclass
class Entry:
    """A solver at one setting: its known results, and its timings, s."""

    solver: Solver
    setting: float
    run: Callable[[], Found] | None = None
    error: float = np.nan
    events_lost: float = np.nan
    compile_s: float = np.nan
    calls: int = 1
    wanted: int = 0
    status: str = "ok"
    times: list[float] = own(default_factory=list)

    def time_block(self) -> None:
        """Add one timing, the mean of consecutive calls; if short, after a call that warms up."""
        assert self.run is not None
        if self.calls > 1:
            self.run()
        start = time.process_time()
        for _ in range(self.calls):
            self.run()
        spent = time.process_time() - start
        self.times.append(spent / (self.calls * self.solver.trajectories))


def entered(solver: Solver, problem: Problem, setting: float, turns: int) -> Entry:
    """Prepare and run a solver, to find its error and its duration."""
    entry, start = Entry(solver, setting), time.perf_counter()
    try:
        entry.run = solver.prepare(setting)
        end, count = entry.run()
        entry.error = float(np.abs(end - problem.end).max())
        entry.events_lost = np.nan if count is None else problem.events - count
        first = time.perf_counter() - start
        warm = least_time(entry.run)
    except Exception as error:  # any exception of a peer is its result
        entry.run, entry.status = (
            None,
            f"failed: {type(error).__name__}: {error}".splitlines()[0],
        )
        return entry
    entry.compile_s = max(first - warm, 0.0)
    entry.calls = max(1, round(BLOCK_S / warm))
    if warm > LONGEST_S:
        entry.times = [warm / solver.trajectories]
    else:
        entry.wanted = int(np.clip(BUDGET_S / (entry.calls * warm), FEWEST, turns))
    if not entry.error < FAR_OFF:
        entry.status = "far off: perhaps an event was lost"
    return entry


def least_time(run: Callable[[], Found]) -> float:
    """Return the shortest of some calls, s: first calls are slower than consecutive ones."""
    times = []
    while sum(times) < BLOCK_S and len(times) < MOST_TRIES:
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def measured(problem: Problem, solvers: list[Solver], turns: int) -> list[Entry]:
    """Return each solver of a scene at each of its settings, timed in turn with the others."""
    slow: set[Solver] = set()
    found: list[Entry] = []
    for settings in zip_longest(*(solver.settings for solver in solvers)):
        entries = [
            entered(solver, problem, setting, turns)
            for solver, setting in zip(solvers, settings, strict=True)
            if setting is not None and solver not in slow
        ]
        slow |= {one.solver for one in entries if one.times and one.wanted == 0}
        for turn in range(turns):
            for entry in entries:
                if turn < entry.wanted:
                    entry.time_block()
        found += entries
    return found


def absent_row(problem: Problem, package: str, reason: str) -> tuple[object, ...]:
    """Return the row of a package that is not installed."""
    return (
        problem.name,
        package,
        package,
        "",
        *[np.nan] * 6,
        0,
        np.nan,
        f"absent: {reason}",
    )


def row(problem: Problem, entry: Entry) -> tuple[object, ...]:
    """Return the row of an entry."""
    s, us = entry.solver, 1e6 * np.array(entry.times or [np.nan])
    low, median, high = np.percentile(us, [25, 50, 75])
    return (
        problem.name, s.package, s.way, s.method, entry.setting, entry.error, entry.events_lost,
        median, low, high, len(entry.times), entry.compile_s, entry.status,
    )  # fmt: skip


# Our integrator and the best of each peer, turn by turn, for fewer but steadier ratios.
LEVELS = {"q25": 25, "median": 50, "q75": 75}


def contender(entry: Entry) -> str:
    """Return the contender of an entry: each of our two ways, or a peer's package as a whole."""
    return entry.solver.way if entry.solver.package == OURS else entry.solver.package


def fastest(entries: list[Entry]) -> dict[str, Entry]:
    """Return the fastest entry of each contender that errs by at most `EQUAL_ERROR`."""
    best: dict[str, Entry] = {}
    good = [one for one in entries if one.times and one.error <= EQUAL_ERROR]
    for entry in sorted(good, key=lambda one: np.median(one.times)):
        best.setdefault(contender(entry), entry)
    return best


def race_row(problem: Problem, name: str, best: dict[str, Entry]) -> dict[str, object]:
    """Return the row of a contender: its time, and its ratios to our two ways."""
    entry = best[name]
    s, times = entry.solver, np.array(entry.times)
    ratios = {
        "call": times / best[OUR_CALL].times,
        "batch": times / best[OUR_BATCH].times,
    }
    return {
        "scene": problem.name, "package": s.package, "way": s.way, "method": s.method,
        "setting": entry.setting, "error_max": entry.error, "turns": len(times),
        "time_median_us": 1e6 * np.median(times),
    } | {
        f"over_{way}_{level}": np.percentile(sample, at)
        for way, sample in ratios.items() for level, at in LEVELS.items()
    } | {"note": ""}  # fmt: skip


def race(
    problem: Problem, entries: list[Entry], absent: dict[str, str], turns: int
) -> list[dict[str, object]]:
    """Return the rows of a scene; earlier timings of the best are discarded."""
    best = fastest(entries)
    for entry in best.values():
        entry.times.clear()
    for _ in range(turns):
        for entry in best.values():
            entry.time_block()
    late = {one.solver.package for one in entries} - {
        one.solver.package for one in best.values()
    }
    notes = dict.fromkeys(sorted(late), f"does not reach {EQUAL_ERROR:g}")
    notes |= {package: f"absent: {reason}" for package, reason in absent.items()}
    return [race_row(problem, name, best) for name in best] + [
        {"scene": problem.name, "package": package, "note": note}
        for package, note in notes.items()
    ]


def print_ratios(at_equal_error: pd.DataFrame) -> None:
    """Print the best of each package and scene."""
    chosen: Any = at_equal_error[
        at_equal_error["best_of_package"] | (at_equal_error["note"] != "")
    ]
    for one in chosen.itertuples():
        print(
            f"{one.scene:16}{one.way:22}{one.method:8}{one.time_us:10.1f} us at {EQUAL_ERROR:g}, "
            f"{one.ratio:8.2f} times ours, {one.ratio_to_batch:8.2f} times our batch {one.note}"
        )


# Batches of ten thousand systems and their events, in lanes, by the driver, and by
# peers.

SPAN, TOLERANCE, EIGHT = (0.0, 10.0), 1e-9, 8
BATCH_REPEATS = 7
MOSTLY = 0.9  # least share of systems done in lanes for a row of lanes
FEW = 200  # systems for diffrax, which all take as many steps as the slowest
Several = tuple[FloatArray, IntArray | None]  # final states and numbers of events
Run = Callable[[], Several]


@field
def pendulum(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], -sin(y[0])


@guards
def bottom(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0], dy[0]


SWING = System(pendulum, bottom, n_states=2, guard_names=("bottom",))


@dataclass(frozen=True)
class Many:
    """A system, its span and parameters, and many starts."""

    system: System
    span: tuple[float, float]
    y0: FloatArray
    params: tuple[float, ...] = ()


def scenes_of_batches(count: int) -> dict[str, Many]:
    """Return `count` pendulums, hoppers and plates each."""
    rng = np.random.default_rng(0)
    swings, drops = np.zeros((count, 2)), np.zeros((count, 2))
    swings[:, 0], drops[:, 0] = (
        rng.uniform(-2.0, 2.0, count),
        rng.uniform(1.5, 2.5, count),
    )
    hopper, plate = VerticalHopper(), Plate()
    falls = plate.initial_states(count, 0)
    return {
        "pendulum": Many(SWING, SPAN, swings),
        "vertical_hopper": Many(hopper.system(), (0.0, 2.0), drops, hopper.params),
        "plate": Many(plate.system(sums=True), PLATE_SPAN, falls, plate.params),
    }


def batch_by_us(
    many: Many, lanes: bool, workers: int, tolerance: float = TOLERANCE
) -> Several:
    batch = solve_batch(
        many.system, many.span, many.y0, params=many.params, rtol=tolerance, atol=tolerance,
        lanes=lanes, workers=workers,
        method="dop853" if lanes or tolerance < TOLERANCE else "auto",
    )  # fmt: skip
    assert batch.success
    assert not lanes or batch.lanes.mean() > MOSTLY, batch.lanes_reason
    return batch.y_end, batch.n_events


def batch_by_heyoka(y0: FloatArray, together: int, events: bool) -> Run:
    """Return a function that runs heyoka on all systems, singly or eight together."""
    import heyoka as hy

    x, v = hy.make_vars("x", "v")
    equations, counts = [(x, v), (v, -hy.sin(x))], np.zeros(len(y0), dtype=np.int64)
    first = [0]

    def count(
        *given: object,
    ) -> None:  # integrator, time, sign and, in a batch, the index
        counts[first[0] + (given[3] if together > 1 else 0)] += 1

    if together == 1:
        seen = [hy.nt_event(x, callback=count)] if events else []
        one = hy.taylor_adaptive(equations, y0[0], tol=TOLERANCE, nt_events=seen)
    else:
        seen = [hy.nt_event_batch(x, callback=count)] if events else []
        some = np.ascontiguousarray(y0[:together].T)
        one = hy.taylor_adaptive_batch(equations, some, tol=TOLERANCE, nt_events=seen)

    def run() -> Several:
        ends = np.empty_like(y0)
        counts[:] = 0
        for first[0] in range(0, len(y0), together):
            rows = slice(first[0], first[0] + together)
            one.state[:] = y0[first[0]] if together == 1 else y0[rows].T
            if together == 1:
                one.time = SPAN[0]
                one.propagate_until(SPAN[1])
            else:
                one.set_time(SPAN[0])
                one.propagate_until([SPAN[1]] * together)
            ends[rows] = one.state.T
        return ends, counts.copy() if events else None

    return run


def batch_by_diffrax(y0: FloatArray) -> Run:
    """Return a run of diffrax under vmap, restarted at each event as in `peers.diffrax_peer`."""
    import jax
    from peers.diffrax_peer import FINDERS, METHODS, trajectory

    problem = Problem(
        "pendulum", SPAN, tuple(y0[0]), 1, lambda m: lambda y, c: (y[1], -m.sin(y[0])),
        lambda m: lambda y, k: y[k], lambda locks: (), SWING, (), y0[0],
    )  # fmt: skip

    def one(start):
        signed = jax.numpy.where(
            start[0] > 0, 1.0, -1.0
        )  # x to -x, so that all begin on one side
        _, y, count = trajectory(
            problem,
            METHODS["Dopri8"](),
            FINDERS["bisection"],
            signed * start,
            TOLERANCE,
        )
        return signed * y, count

    assert y0[0, 0] > 0
    call = jax.jit(jax.vmap(one))

    def run() -> Several:
        ends, counts = jax.block_until_ready(call(y0))
        return np.asarray(ends), np.asarray(counts)

    return run


def batch_solvers(many: Many) -> dict[tuple[str, int, int, int], Callable[[], Run]]:
    """Return a factory of each run, by its name, lanes, threads and systems."""
    y0, n = many.y0, len(many.y0)
    ours: dict[tuple[str, int, int, int], Callable[[], Run]] = {
        ("hopdata, driver", 1, 1, n): lambda: partial(batch_by_us, many, False, 1),
        ("hopdata, driver", 1, 2, n): lambda: partial(batch_by_us, many, False, 2),
        ("hopdata, lanes", WIDTH, 1, n): lambda: partial(batch_by_us, many, True, 1),
        ("hopdata, lanes", WIDTH, 2, n): lambda: partial(batch_by_us, many, True, 2),
    }
    if many.system is not SWING:
        return ours
    some = y0[y0[:, 0] > 0][:FEW]
    return ours | {
        ("heyoka", 1, 1, n): lambda: batch_by_heyoka(y0, 1, True),
        ("heyoka, batch", EIGHT, 1, n): lambda: batch_by_heyoka(y0, EIGHT, True),
        ("heyoka, batch, no events", EIGHT, 1, n): lambda: batch_by_heyoka(
            y0, EIGHT, False
        ),
        ("diffrax, vmap", FEW, 1, FEW): lambda: batch_by_diffrax(some),
    }


def batches(scene: str, many: Many) -> list[dict[str, object]]:
    """Return one row per way to integrate the systems."""
    right, events = batch_by_us(many, False, 1, SMALLEST_RTOL)
    assert events is not None
    runs, rows = {}, {}
    for key, make in batch_solvers(many).items():
        names = ("scene", "solver", "lanes", "threads", "systems")
        row: dict[str, object] = dict(zip(names, (scene, *key), strict=True))
        start = time.perf_counter()
        try:
            runs[key] = make()
            ends, counts = runs[key]()
        except Exception as error:  # any exception of a peer is its result
            runs.pop(key, None)
            rows[key] = row | {
                "status": f"{type(error).__name__}: {error}".splitlines()[0]
            }
            continue
        few = np.flatnonzero(many.y0[:, 0] > 0)[
            : len(ends)
        ]  # the systems that diffrax has
        chosen = slice(None) if len(ends) == len(right) else few
        off = np.abs(ends - right[chosen]).max(axis=1)
        lost = np.nan if counts is None else int((counts != events[chosen]).sum())
        rows[key] = row | {
            "compile_s": time.perf_counter() - start, "error_max": off.max(),
            "error_median": np.median(off), "events_lost": lost, "status": "ok",
        }  # fmt: skip
    times: dict[tuple[str, int, int, int], list[float]] = {key: [] for key in runs}
    used: dict[tuple[str, int, int, int], list[float]] = {key: [] for key in runs}
    for _ in range(BATCH_REPEATS):
        for key, run in runs.items():
            clock = time.perf_counter if key[2] > 1 else time.process_time
            start, before = clock(), time.process_time()
            run()
            times[key].append(1e6 * (clock() - start) / key[3])
            used[key].append(1e6 * (time.process_time() - before) / key[3])
    for key, found in times.items():
        rows[key]["us_per_system"], rows[key]["us_least"] = np.median(found), min(found)
        rows[key]["cpu_us_per_system"] = np.median(used[key])
    return list(rows.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument(
        "--turns", type=int, default=15, help="maximum timings of each solver"
    )
    parser.add_argument(
        "--race-turns", type=int, default=60, help="timings of the best of each"
    )
    parser.add_argument("--scenes", nargs="*", help="names of scenes; all by default")
    parser.add_argument(
        "--systems", type=int, default=10_000, help="batch size, a multiple of 8"
    )
    given = parser.parse_args()
    out: Path = given.out
    out.parent.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")
    chosen = [one for one in problems() if not given.scenes or one.name in given.scenes]
    rows: list[tuple[object, ...]] = []
    racing: list[dict[str, object]] = []
    for problem in chosen:
        solvers, absent = solvers_of(problem)
        entries = measured(problem, solvers, given.turns)
        rows += [absent_row(problem, *one) for one in absent.items()]
        rows += [row(problem, entry) for entry in entries]
        racing += race(problem, entries, absent, given.race_turns)
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    at_equal_error = ratios(table)
    at_equal_error["best_of_way"] = best_of_way(at_equal_error)
    table.to_csv(out, index=False)
    at_equal_error.to_csv(out.with_name("ratios.csv"), index=False)
    print_ratios(at_equal_error)
    races = pd.DataFrame(racing)
    races.to_csv(out.with_name("head_to_head.csv"), index=False)
    many = scenes_of_batches(given.systems)
    together = pd.DataFrame(
        [row for name, one in many.items() for row in batches(name, one)]
    )
    together.to_csv(out.with_name("batches.csv"), index=False)
    print(together.to_string(index=False))
    shown = [
        "scene",
        "package",
        "way",
        "method",
        "error_max",
        "time_median_us",
        "over_call_median",
    ]
    print(races[[*shown, "over_batch_median", "note"]].to_string(index=False))


if __name__ == "__main__":
    main()
