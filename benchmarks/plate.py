"""The plate on 2 to 35 springs: time and error by number of contacts (dissertation, 4.4.4).

    python benchmarks/plate.py --out results/benchmarks/plate.csv

All numbers of contacts use the same random starts, for 2 s each; all solvers take turns
on one thread in one process. A time is that of one whole run without output in between,
the faster of two in a row (a single run if it is long), given per simulated second.
Errors are the largest deviation of the final state (m, rad, and these per s) from our
solver at its tightest tolerance, which is checked against `plate_reference` for some.
The springs of MuJoCo's contacts cannot pull, and push along the normal, so their error
has two parts; `own_law_error_median` is the error against the limit of their own law.
Beside the table, it writes ``plate_scaling.csv``: our solver for up to 10,000 contacts, in the three forms of the
scene, and from a start that is flat except for 1e-6 rad. All sizes take turns;
`per_contact_over_300` is the median over the turns of the time per contact over that
with 300. The cost of a further contact, figure 4.4, is a part of the dissertation's page
(`hopdata.dissertation.parts.scaling`).

Without MuJoCo, a row says "absent".
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from machine import this_machine, timed
from peers.mujoco_peer import ABSENT
from scipy.integrate import DOP853
from scipy.optimize import brentq

from hopdata.arrays import FloatArray
from hopdata.hybrid import Solution, solve
from hopdata.scenes.plate import Plate

if not ABSENT:
    from hopdata.dissertation.mujoco_models import (
        INTEGRATORS,
        Setting,
        plate_simulation,
        steps,
    )

# True end of the plate: DOP853 at its tightest tolerance, restarted at each event.
#
# It uses no part of the integrator under test: numpy evaluates the field, scipy makes
# the steps and finds the roots. A step that meets an event is repeated up to the
# event's instant.

RTOL, ATOL = 3e-14, 1e-15
LOOKS = 16  # samples of each guard within a step
LONGEST_STEP_S = 0.01  # so that no pair of crossings hides between two samples
SAME_S = 1e-13  # instants closer than this are one


def reference_end(plate: Plate, start: FloatArray, until_s: float) -> FloatArray:
    """Return the state at the end, (6,), from a start at time 0 at which no guard is zero."""
    now, state = 0.0, np.array(start)
    touching = plate.compressions(state) > 0
    while now < until_s:
        solver = begin(plate, touching, now, state, until_s)
        instant, flips = until_s, np.zeros_like(touching)
        while solver.status == "running" and not flips.any():
            solver.step()
            instant, flips = first_flips(plate, touching, solver)
        if flips.any():
            state = taken_to(
                plate, touching, solver.t_old, solver_start(solver), instant
            )
        else:
            state = solver.y
        now, touching = instant, touching ^ flips
    return state


def begin(
    plate: Plate, touching: Any, now: float, state: FloatArray, until_s: float
) -> DOP853:
    """Return a solver in this mode."""
    arms = plate.spring_places_m[touching]
    sums = np.array([len(arms), arms.sum(), (arms**2).sum()])
    gravity, mass, inertia, rest, stiffness, damping, *_ = plate.params

    def slope_of(_t: float, y: FloatArray) -> FloatArray:
        x, z, angle, vx, vz, spin = y
        slope, grow = np.tan(angle), 1 + np.tan(angle) ** 2
        along = np.array(
            [
                sums[0],
                x * sums[0] - sums[1],
                x * x * sums[0] - 2 * x * sums[1] + sums[2],
            ]
        )
        at_centre = stiffness * (rest - z) + damping * (slope * vx - vz)
        per_arm = stiffness * slope + damping * grow * spin
        force = at_centre * along[0] + per_arm * along[1]
        moment = at_centre * along[1] + per_arm * along[2]
        return np.array(
            [
                vx,
                vz,
                spin,
                -slope * force / mass,
                force / mass - gravity,
                -grow * moment / inertia,
            ]
        )

    return DOP853(
        slope_of, now, state, until_s, rtol=RTOL, atol=ATOL, max_step=LONGEST_STEP_S
    )  # fmt: skip


def solver_start(solver: Any) -> FloatArray:
    """Return the state at the start of the last step."""
    return np.asarray(solver.dense_output()(solver.t_old))


def taken_to(
    plate: Plate, touching: Any, now: float, state: FloatArray, instant: float
) -> FloatArray:
    """Return the state at a nearby instant in the unchanged mode."""
    solver = begin(plate, touching, now, state, instant)
    while solver.status == "running":
        solver.step()
    return np.asarray(solver.y)


def first_flips(plate: Plate, touching: Any, solver: Any) -> tuple[float, Any]:
    """Return the first instant within the last step at which springs touch or let go, and which."""
    dense, times = solver.dense_output(), np.linspace(solver.t_old, solver.t, LOOKS + 1)
    side = np.where(touching, 1.0, -1.0)
    margins = side[:, None] * plate.compressions(dense(times))
    past = margins[:, 1:] < 0
    instants = np.full(len(side), np.inf)
    for k in np.flatnonzero(past.any(axis=1)):
        at = int(np.argmax(past[k]))
        instants[k] = brentq(
            lambda t, k=k: side[k] * plate.compressions(dense(t))[k],
            times[at], times[at + 1], xtol=1e-16, rtol=1e-15,
        )  # fmt: skip
    if not np.isfinite(instants).any():
        return solver.t, np.zeros_like(touching)
    return float(instants.min()), instants < instants.min() + SAME_S


Solver = Callable[[FloatArray], FloatArray]
Key = TypeVar("Key")

UNTIL_S, N_STARTS, SEED = 2.0, 150, 444
CONTACTS = tuple(range(2, 36))
CHECKED = (2, 10, 35)  # numbers of contacts, and number of starts, for slow checks
N_CHECKED = 3
LONG_S = 0.05  # a longer run is timed only once
TIGHTEST = 1e-13
OURS: dict[str, tuple[float, dict[str, bool]]] = {  # tolerance and form of the scene
    "hopdata": (1e-6, {}),
    "hopdata rtol 1e-9": (1e-9, {}),
    "hopdata sums": (1e-6, {"sums": True}),
    "hopdata sparse": (1e-6, {"sparse": True}),
}
MUJOCO: dict[str, Setting] = {}
MUJOCO_MORE: dict[str, Setting] = {}  # for a few numbers of contacts only
if not ABSENT:
    MUJOCO["MuJoCo contact 2 ms"] = Setting("contact", "Euler", 2e-3)
    MUJOCO["MuJoCo callback 2 ms"] = Setting("callback", "Euler", 2e-3)
    MORE = [
        Setting(spring, integrator, 2e-3)
        for spring in ("contact", "callback")
        for integrator in INTEGRATORS[1:]
    ]
    MORE.append(Setting("contact", "Euler", 1e-4))
    MORE.append(Setting("callback", "RK4", 1e-4))
    MORE.append(Setting("callback", "RK4", 1e-5))
    for one in MORE:
        MUJOCO_MORE[f"MuJoCo {one.name} {1e3 * one.timestep_s:g} ms"] = one
    LIMIT = Setting("contact law", "RK4", 5e-5)
SCALING_PLAIN = (35, 100, 300, 1000)
SCALING = (*SCALING_PLAIN, 3000, 10_000)
SCALING_S, N_SCALING = 1.0, 5  # the plate lands once and flies off again
LARGE_FORMS = ("hopdata", "hopdata sums", "hopdata sparse", "hopdata sparse flat")
UNIT = 300  # number of contacts to whose cost others are compared
N_TURNS, TURN_S = (
    25,
    0.05,
)  # at least, per size: the machine's speed may change within a second
Case = tuple[str, int]  # form of the scene and number of contacts
FLAT = (
    0.0,
    2.4,
    1e-6,
    0.0,
    0.0,
    0.0,
)  # a start that touches all springs within microseconds


def with_hopdata(
    plate: Plate, tolerance: float, form: dict[str, bool], until_s: float = UNTIL_S
) -> Callable[[FloatArray], Solution]:
    """Return our solver as a function of the start."""
    system, params = plate.system(**form), plate.params
    system.compile()

    def run(start: FloatArray) -> Solution:
        solution = solve(
            system, (0.0, until_s), start, params=params, rtol=tolerance, atol=0.1 * tolerance,
            t_eval=(until_s,),
        )  # fmt: skip
        if solution.status != 0:
            raise RuntimeError(solution.message)
        return solution

    return run


def end(run: Callable[[FloatArray], Solution]) -> Solver:
    """Return a function from start to end."""
    return lambda start: run(start).y_end


def with_mujoco(plate: Plate, setting: Setting) -> Solver:
    """Return MuJoCo as a function from start to end."""
    simulation, count = plate_simulation(plate, setting), steps(setting, UNTIL_S)

    def run(start: FloatArray) -> FloatArray:
        simulation.start(start)
        simulation.step_in_c(count)
        return simulation.state()

    return run


def solvers(plate: Plate) -> dict[str, Solver]:
    """Return the solvers that run at every number of contacts."""
    ours = {name: end(with_hopdata(plate, *options)) for name, options in OURS.items()}
    return ours | {
        name: with_mujoco(plate, setting) for name, setting in MUJOCO.items()
    }


def in_turn(
    runs: dict[Key, Solver], starts: FloatArray
) -> tuple[dict[Key, FloatArray], dict[Key, FloatArray]]:
    """Return the times, (S,), s, and the ends, (S, 6), of each solver; they take turns."""
    times: dict[Key, list[float]] = {name: [] for name in runs}
    ends: dict[Key, list[FloatArray]] = {name: [] for name in runs}
    for start in starts:
        for name, run in runs.items():
            best, last = timed(partial(run, start))
            if best < LONG_S:
                best = min(best, timed(partial(run, start))[0])
            times[name].append(best)
            ends[name].append(last)
    return {k: np.array(v) for k, v in times.items()}, {
        k: np.array(v) for k, v in ends.items()
    }


def rows_of(
    n: int,
    times_s: dict[str, FloatArray],
    ends: dict[str, FloatArray],
    exact: FloatArray,
) -> list[dict[str, Any]]:
    """Return the rows of all solvers at one number of contacts, n."""
    rows = []
    for name, times in times_s.items():
        low, median, high = 1e6 / UNTIL_S * np.percentile(times, [25, 50, 75])
        errors = np.abs(ends[name] - exact).max(axis=1)
        rows.append(
            {
                "solver": name,
                "n_contacts": n,
                "n_starts": len(times),
                "time_median_us_per_s": median,
                "time_q25_us_per_s": low,
                "time_q75_us_per_s": high,
                "error_median": np.median(errors),
                "error_max": errors.max(),
            }
        )
    return rows


def checked(
    plate: Plate, starts: FloatArray, exact: FloatArray
) -> list[dict[str, Any]]:
    """Return rows of the slow solvers, and of our tightest against the independent reference."""
    n, starts, exact = plate.n_contacts, starts[:N_CHECKED], exact[:N_CHECKED]
    fine = {name: with_mujoco(plate, setting) for name, setting in MUJOCO_MORE.items()}
    runs = {"hopdata tightest": end(with_hopdata(plate, TIGHTEST, {}))} | fine
    rows = rows_of(n, *in_turn(runs, starts), exact)
    reference = np.array([reference_end(plate, start, UNTIL_S) for start in starts])
    deviation = np.abs(exact - reference).max(axis=1)
    rows[0] |= {"error_median": np.median(deviation), "error_max": deviation.max()}
    return rows


def own_law_errors(plate: Plate, starts: FloatArray) -> dict[str, float]:
    """Return the median error of MuJoCo's contacts relative to the limit of their own law."""
    if ABSENT:
        return {}
    limit = with_mujoco(plate, LIMIT)
    few = starts[:N_CHECKED]
    ends = np.array([limit(start) for start in few])
    contacts = {
        k: v for k, v in (MUJOCO | MUJOCO_MORE).items() if v.spring == "contact"
    }
    return {
        name: float(
            np.median(
                [np.abs(run(s) - e).max() for s, e in zip(few, ends, strict=True)]
            )
        )
        for name, run in ((k, with_mujoco(plate, v)) for k, v in contacts.items())
    }


def measure(n_starts: int) -> pd.DataFrame:
    """Return the table."""
    starts = Plate().initial_states(n_starts, SEED)
    runs = {(n, name): run for n in CONTACTS for name, run in solvers(Plate(n)).items()}
    for run in runs.values():
        run(starts[0])  # so that no timing includes compilation
    times, ends = in_turn(runs, starts)  # numbers of contacts take turns too
    rows: list[dict[str, Any]] = []
    for n in CONTACTS:
        plate = Plate(n)
        tightest = end(with_hopdata(plate, TIGHTEST, {}))
        exact = np.array([tightest(start) for start in starts])
        own_times, own_ends = (
            {k: x[n, k] for k in (*OURS, *MUJOCO)} for x in (times, ends)
        )
        rows += rows_of(n, own_times, own_ends, exact)
        if n in CHECKED:
            rows += checked(plate, starts, exact)
            law = own_law_errors(plate, starts)
            for one in rows:
                if one["n_contacts"] == n:
                    one["own_law_error_median"] = law.get(one["solver"], np.nan)
    if ABSENT:
        rows.append({"solver": f"MuJoCo {ABSENT}"})
    return pd.DataFrame(rows)


def large_cases() -> dict[Case, list[Callable[[], Solution]]]:
    """Return runs of our solver from some starts, for many contacts in all forms of the scene."""
    runs: dict[Case, list[Callable[[], Solution]]] = {}
    for name in LARGE_FORMS:
        tolerance, form = OURS[name.removesuffix(" flat")]
        for n in SCALING if form.get("sparse") else SCALING_PLAIN:
            plate = Plate(n)
            run = with_hopdata(plate, tolerance, form, SCALING_S)
            starts = plate.initial_states(N_SCALING, SEED)
            own = np.array([FLAT] * N_SCALING) if name.endswith("flat") else starts
            runs[name, n] = [partial(run, start) for start in own]
    return runs


def median_ms(run: Callable[[], Solution]) -> float:
    """Return the median time of consecutive runs, ms."""
    times: list[float] = []
    while sum(times) < TURN_S:
        times.append(timed(run)[0])
    return 1e3 * float(np.median(times))


def scaling() -> pd.DataFrame:
    """Time our solver for many contacts; all sizes take turns, one start after another."""
    runs = large_cases()
    events = {
        case: np.median([len(run().events) for run in own])
        for case, own in runs.items()
    }
    times: dict[Case, list[float]] = {case: [] for case in runs}
    for turn in range(N_TURNS):
        for case, own in runs.items():
            times[case].append(median_ms(own[turn % N_SCALING]))
    rows = []
    for (name, n), sample in times.items():
        low, median, high = np.percentile(sample, [25, 50, 75])
        unit = np.array(times[name, UNIT]) / UNIT
        rows.append(
            {
                "solver": name,
                "n_contacts": n,
                "simulated_s": SCALING_S,
                "n_starts": N_SCALING,
                "n_events_median": events[name, n],
                "time_median_ms": median,
                "time_q25_ms": low,
                "time_q75_ms": high,
                "time_us_per_event": 1e3 * median / events[name, n],
                "time_us_per_contact_s": 1e3 * median / n / SCALING_S,
                f"per_contact_over_{UNIT}": float(
                    np.median(np.array(sample) / n / unit)
                ),
            }
        )
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument(
        "--starts", type=int, default=N_STARTS, help="for each number of contacts"
    )
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.parent.mkdir(parents=True, exist_ok=True)
    table = measure(arguments.starts)
    table.assign(**this_machine("mujoco", "scipy")).to_csv(out, index=False)
    large = scaling()
    large.to_csv(out.with_name(f"{out.stem}_scaling.csv"), index=False)
    print(table[table["n_contacts"].isin(CHECKED)].to_string(index=False))
    print(large.to_string(index=False))


if __name__ == "__main__":
    main()
