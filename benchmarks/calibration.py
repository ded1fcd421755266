"""The hopper in MuJoCo and in our integrator: error and time (dissertation, section 4.4.3).

    python benchmarks/calibration.py --out results/benchmarks/calibration.csv

The hopper starts at rest at 2 m with k / m = 1000 / s^2 and runs for 2 s, on one
thread. MuJoCo runs in all ways that `hopdata.dissertation.mujoco_models` offers for the hopper, with all its
integrators, down to time steps of 10 us. Errors are those of the height against the
closed form: at MuJoCo's steps or at 2001 times, and at the end. `time_*` is the time of
a whole simulation, by the faster of MuJoCo's two loops in C, `mj_step(nstep)` and
`rollout`; `python_loop_ms` is that of a loop of `mj_step` in Python. Beside the table
of all runs, it writes ``calibration_table.csv``: the fastest run of each solver at or
below each error, and the time step of the dissertation, 2 ms, with MuJoCo's default
contact. The dissertation's own comparison (table 4.4, figure 4.3) is a part of its page
(`hopdata.dissertation.parts.calibration`).

Without MuJoCo, its row says "absent" and the tables show our solver alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from machine import quartiles, this_machine
from peers.mujoco_peer import ABSENT

from hopdata.arrays import FloatArray
from hopdata.hybrid import solve
from hopdata.scenes.vertical_hopper import VerticalHopper, hopper_states

if not ABSENT:
    from hopdata.dissertation.mujoco_models import (
        INTEGRATORS,
        Setting,
        hopper_simulation,
        steps,
    )

HOPPER = VerticalHopper()
START, UNTIL_S = (2.0, 0.0), 2.0
TIMES_S = np.linspace(0.0, UNTIL_S, 2001)
TIMESTEPS_S = (2e-3, 5e-4, 1e-4, 1e-5)
IMPEDANCES = (1e-2, 1e-4)
TOLERANCES = tuple(10.0**-k for k in range(3, 15))
CALLS = 20  # consecutive calls of our solver in each timing
LEVELS_M = tuple(10.0**-k for k in range(1, 12))
LONG = 50_000  # steps; from this number on, only the faster loop in C is timed
DISSERTATION, DISSERTATION_S = "default contact Euler", 2e-3  # setting, time step


def settings() -> Iterator[Setting]:
    """Return all ways, integrators and time steps of MuJoCo."""
    for timestep in TIMESTEPS_S:
        for integrator in INTEGRATORS:
            for spring in ("default contact", "tendon", "callback"):
                yield Setting(spring, integrator, timestep)
            for impedance in IMPEDANCES:
                yield Setting("contact", integrator, timestep, impedance)


def errors(times_s: FloatArray, states: FloatArray) -> dict[str, float]:
    """Return the errors of a trajectory (2, N) and its change in energy."""
    residual = states - hopper_states(HOPPER, START[0], times_s)
    drift = HOPPER.energy(states[:, -1]) / HOPPER.energy(START) - 1
    return {
        "height_error_max_m": float(np.abs(residual[0]).max()),
        "height_error_end_m": float(np.abs(residual[0, -1])),
        "velocity_error_end_m_s": float(np.abs(residual[1, -1])),
        "energy_change_relative": float(drift),
    }


def times(low: float, median: float, high: float) -> dict[str, float]:
    """Return the columns for a time given in s."""
    return {
        "time_median_ms": 1e3 * median,
        "time_q25_ms": 1e3 * low,
        "time_q75_ms": 1e3 * high,
    }


def with_mujoco(setting: Setting) -> dict[str, Any]:
    """Simulate and time one setting of MuJoCo."""
    simulation, count = hopper_simulation(HOPPER, setting), steps(setting, UNTIL_S)
    states = simulation.roll_out(START, count)

    def in_c() -> None:
        simulation.start(START)
        simulation.step_in_c(count)

    def in_python() -> None:
        simulation.start(START)
        simulation.step_in_python(count)

    runs: dict[str, Any] = {"mj_step(nstep)": in_c}
    if count < LONG:
        runs["rollout"] = lambda: simulation.roll_out(START, count)
    spread = quartiles(runs)
    loop = min(spread, key=lambda name: spread[name][1])
    python = 1e3 * quartiles({"loop": in_python})["loop"][1] if count < LONG else np.nan
    return {
        "solver": "MuJoCo",
        "setting": setting.name,
        "timestep_s": setting.timestep_s,
        "rtol": np.nan,
        **errors(setting.timestep_s * np.arange(1, count + 1), states),
        **times(*spread[loop]),
        "loop": loop,
        "python_loop_ms": python,
    }


def with_hopdata(tolerance: float) -> dict[str, Any]:
    """Simulate and time our solver at one tolerance."""

    def run(**options: Any) -> Any:
        return solve(
            HOPPER.system(), (0.0, UNTIL_S), START, params=HOPPER.params,
            rtol=tolerance, atol=0.1 * tolerance, **options,
        )  # fmt: skip

    states = run(t_eval=TIMES_S).y

    def in_a_row() -> None:
        for _ in range(CALLS):
            run()

    (spread,) = quartiles({"solve": in_a_row}, most=101).values()
    return {
        "solver": "hopdata",
        "setting": "auto",
        "timestep_s": np.nan,
        "rtol": tolerance,
        **errors(TIMES_S, states),
        **times(*(time / CALLS for time in spread)),
        "loop": "solve",
        "python_loop_ms": np.nan,
    }


def mujoco_rows() -> list[dict[str, Any]]:
    """Return the rows of MuJoCo, or one that says it is absent."""
    if ABSENT:
        print(f"MuJoCo {ABSENT}")
        return [{"solver": "MuJoCo", "setting": ABSENT}]
    return [with_mujoco(setting) for setting in settings()]


def fastest(rows: pd.DataFrame, level_m: float) -> Any:
    """Return the fastest row at or below an error, or None."""
    good = rows[rows["height_error_max_m"] <= level_m]
    return None if good.empty else good.loc[good["time_median_ms"].idxmin()]


def comparison(label: str, mujoco: Any, ours: Any) -> dict[str, Any]:
    """Return a row in the form of the dissertation's table 4.4."""
    row: dict[str, Any] = {"case": label}
    for name, one in (("mujoco", mujoco), ("hopdata", ours)):
        row[f"{name}_s"] = np.nan if one is None else 1e-3 * one["time_median_ms"]
        row[f"{name}_height_error_max_m"] = (
            np.nan if one is None else one["height_error_max_m"]
        )
    row["mujoco_setting"] = ABSENT if mujoco is None else mujoco["setting"]
    row["mujoco_timestep_s"] = np.nan if mujoco is None else mujoco["timestep_s"]
    row["hopdata_rtol"] = np.nan if ours is None else ours["rtol"]
    row["times_faster"] = row["mujoco_s"] / row["hopdata_s"]
    return row


def table_by_level(table: pd.DataFrame) -> pd.DataFrame:
    """Return the fastest run of each solver at each error, and at the dissertation's time step."""
    theirs, ours = (table[table["solver"] == name] for name in ("MuJoCo", "hopdata"))
    printed = theirs[
        (theirs["setting"] == DISSERTATION) & (theirs["timestep_s"] == DISSERTATION_S)
    ]
    rows = []
    for _, one in printed.iterrows():
        rows.append(
            comparison(
                "2 ms, default contact", one, fastest(ours, one["height_error_max_m"])
            )
        )
    for level in LEVELS_M:
        rows.append(
            comparison(
                f"error <= {level:g} m", fastest(theirs, level), fastest(ours, level)
            )
        )
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    out = parser.parse_args().out
    out.parent.mkdir(parents=True, exist_ok=True)
    rows = [with_hopdata(tolerance) for tolerance in TOLERANCES]
    rows += mujoco_rows()
    table = pd.DataFrame(rows).assign(**this_machine("mujoco"))
    table.to_csv(out, index=False)
    levels = table_by_level(table)
    levels.to_csv(out.with_name(f"{out.stem}_table.csv"), index=False)
    print(levels.to_string(index=False))


if __name__ == "__main__":
    main()
