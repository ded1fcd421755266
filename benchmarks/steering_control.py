"""Control of the steered hopper: time and quality of plans, and what they achieve in closed loop.

    python benchmarks/steering_control.py --out steering_control.csv

In `steering_control.csv` each row is 30 random starts with one controller and one map: "true" is
the plant's own, averaged over the swing before, which the ceiling knows; "learned" are Gaussian
processes from 100 hops, drawn at random from those of a printed excitation, seen by motion capture,
and the starts take turns with three of them. Poses are measured with noise. Success, by task:

- "facing", "90 degrees left", "90 degrees right", "away": from 1 m, the origin being ahead, to the
  left, to the right or behind: within 0.2 m of it in at most 16 hops (facing) or 40;
- "any heading": within 0.15 m in at most 60 hops, and within 0.25 m for the next ten; "board": with
  a board of 4 N across the way;
- "turn": heading error, of 180 degrees at first, at most 15 degrees in at most 25 hops; hops to 10
  degrees stand beside. The boom starts in neutral, or "any boom angle".

Intervals are Clopper and Pearson's of 95 %. `hops_ratio` is the mean number of hops to the goal
over that with the true map, both of the starts from which both arrived.

`steering_replanning.csv`: plans from random states within 1 m, any boom angle and any last swing,
half of them towards the origin and half to a heading. `excess` is over the lowest objective on a
dense grid and after scipy's polish, m or rad; more than 1e-3 is bad. Times are CPU times of one
thread.

`steering_turns.csv`: the largest turn that any swings make of the true map, without noise, by the
number of hops, with the boom in neutral at first or at the best angle.

`steering_legs.csv`: each row is random starts with one hopper, one controller and one way to begin
its search. Neither the unevenness of the robot nor the start of the search is printed; the legs of
the first rows are the default. Models are learned as above. `drift_...` is the frame change of the
settled hopper with its boom in neutral.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from machine import timed
from steering_setting import (
    EXCITATIONS,
    LIMIT,
    ROBOT,
    STARTS,
    ClosedLoopTrial,
    GradientController,
    Maps,
    PoseNoise,
    board_before,
    closed_loop,
    excited,
    maps,
    reference_objective,
    start_facing,
    start_turning,
)

from hopdata.arrays import FloatArray
from hopdata.rigid import relative
from hopdata.steering.control.objectives import Controller, Horizon, ToHeading, ToPoint, errors_left
from hopdata.steering.control.planner import Planner, planner
from hopdata.steering.control.printed import PrintedController
from hopdata.steering.experiments.outcomes import rate_interval
from hopdata.steering.experiments.tasks import ORIGIN, TURN, Task, goal_of, judged
from hopdata.steering.models.tabulated import TabulatedMap, tabulated, turn_nodes
from hopdata.steering.models.training import trained_process
from hopdata.steering.robot import SteeredHopper, released, steer_hop

OFF = {
    "facing": 0.0,
    "90 degrees left": -np.pi / 2,
    "90 degrees right": np.pi / 2,
    "away": np.pi,
    "any heading": None,
    "any heading, board": None,
}
BUDGET_S = 0.1


@dataclass(frozen=True)
class Run:
    """Hops to the goal (NaN: never), those to a stricter one, and whether the trial succeeded."""

    success: bool
    hops: float
    strict_hops: float
    fell: bool


def first_below(errors: FloatArray, bound: float) -> float:
    """Hops until the error is within the bound; NaN if it never is."""
    within = np.flatnonzero(errors <= bound)
    return float(within[0]) if len(within) else np.nan


def to_origin(
    controller: Controller, task: str, number: int, seed: int, robot: SteeredHopper = ROBOT
) -> Run:
    """One trial from 1 m."""
    start = start_facing(number, OFF[task], seed)
    wanted = trial_task(task)
    trial = closed_loop(
        robot, controller, start, hops=wanted.most_hops, seed=[seed, number, 1],
        observe=PoseNoise(), board=board_before(start) if "board" in task else None,
    )  # fmt: skip
    return _run(wanted, start, trial, 0.1)


def turning(
    controller: Any, task: str, number: int, seed: int, robot: SteeredHopper = ROBOT
) -> Run:
    """One turn by 180 degrees."""
    start = start_turning(number, seed)
    goal = ToHeading(heading_rad=float(start[2] + np.pi))
    rng = np.random.default_rng(np.random.SeedSequence([seed, number, 2]))
    boom = rng.uniform(0, 2 * np.pi) if "any boom" in task else np.pi
    trial = closed_loop(
        robot, controller.towards(goal), start, hops=32, seed=[seed, number, 1],
        observe=PoseNoise(), boom_angle_rad=boom,
    )  # fmt: skip
    return _run(trial_task(task), start, trial, np.radians(10))


def trial_task(name: str) -> Task:
    """Return what must be done for success."""
    if name.startswith("turn"):
        return Task(manoeuvre=TURN, near=np.radians(15), hops=25)
    if name.startswith("any"):
        return Task(manoeuvre=ORIGIN, near=0.15, hops=60, stay=0.25, stay_hops=10)
    return Task(manoeuvre=ORIGIN, near=0.2, hops=16 if name == "facing" else 40)


def _run(task: Task, start: FloatArray, trial: ClosedLoopTrial, strict: float) -> Run:
    """Judge a trial as the study judges its runs."""
    left = errors_left(goal_of(task.manoeuvre, start), trial.poses)
    outcome = judged(task, left, fell=trial.fell)
    hops = float(outcome.hops) if outcome.hops >= 0 else np.nan
    return Run(outcome.success, hops, first_below(left, strict), trial.fell)


def control_row(
    task: str, name: str, kind: str, controllers: Any, starts: int, seed: int
) -> tuple[dict[str, Any], list[Run]]:
    """One row of the table, and its trials."""
    trial = turning if task.startswith("turn") else to_origin
    runs = [
        trial(controllers[number % len(controllers)], task, number, seed)
        for number in range(starts)
    ]
    successes = sum(run.success for run in runs)
    low, high = rate_interval(successes, starts)
    hops = np.array([run.hops for run in runs])
    strict = np.array([run.strict_hops for run in runs])
    row = {
        "task": task, "controller": name, "map": kind, "starts": starts, "successes": successes,
        "share": successes / starts, "low": low, "high": high,
        "arrived": int(np.sum(~np.isnan(hops))), "hops_median": _median(hops),
        "hops_max": _largest(hops), "strict_hops_median": _median(strict),
        "strict_hops_max": _largest(strict), "falls": sum(run.fell for run in runs),
    }  # fmt: skip
    print(row, flush=True)
    return row, runs


def control_table(found: Maps, starts: int, seed: int) -> pd.DataFrame:
    """All rows of the closed loop."""
    by_map = {"true": [found.true], "learned": found.learned}
    planners = {kind: [planner(one) for one in models] for kind, models in by_map.items()}
    turners = {
        kind: [planner(one, ToHeading()) for one in models] for kind, models in by_map.items()
    }
    rows, trials = [], {}
    for task in ("any heading", "any heading, board", "facing"):
        for kind, controller in planners.items():
            row, trials[task, kind] = control_row(task, "planner", kind, controller, starts, seed)
            rows.append(row)
        rows[-1]["hops_ratio"] = ratio(trials[task, "learned"], trials[task, "true"])
    for task in ("turn", "turn, any boom angle"):
        for kind, controller in turners.items():
            row, trials[task, kind] = control_row(task, "planner", kind, controller, starts, seed)
            rows.append(row)
        rows[-1]["hops_ratio"] = ratio(trials[task, "learned"], trials[task, "true"])
    for task in ("facing", "90 degrees left", "90 degrees right", "away"):
        rows += short_rows(task, ToPoint(), found, starts, seed)
    for task in ("turn", "turn, any boom angle"):
        rows += short_rows(task, ToHeading(), found, starts, seed)
    return pd.DataFrame(rows)


def short_rows(task: str, goal: Any, found: Maps, starts: int, seed: int) -> list[dict[str, Any]]:
    """Rows of the controllers without a cost-to-go."""
    printed = GradientController(model=found.true, objective=goal)
    rows = [control_row(task, "printed", "true", [printed], starts, seed)[0]]
    if task in ("facing", "turn"):
        faithful = [PrintedController(model=one, objective=goal) for one in found.sklearn]
        rows.append(control_row(task, "printed, sklearn", "learned", faithful, starts, seed)[0])
    else:
        learned = [replace(printed, model=one) for one in found.learned]
        rows.append(control_row(task, "printed", "learned", learned, starts, seed)[0])
    return rows


def ratio(runs: list[Run], ceiling: list[Run]) -> float:
    """Mean hops to the goal over those of the ceiling."""
    pairs = np.array([(a.hops, b.hops) for a, b in zip(runs, ceiling, strict=True)])
    pairs = pairs[~np.isnan(pairs).any(axis=1)]
    return float(pairs[:, 0].mean() / pairs[:, 1].mean())


def replanning_table(found: Maps, plans: int, slow_plans: int, seed: int) -> pd.DataFrame:
    """Time and excess of the plans of each method."""
    table = tabulated(found.copies[0], LIMIT)
    methods = {
        "printed, closed-form gradient": (
            lambda goal: GradientController(model=found.copies[0], objective=goal),
            plans,
        ),
        "printed": (
            lambda goal: PrintedController(model=found.sklearn[0], objective=goal),
            slow_plans,
        ),
    }
    goals = (ToPoint(), ToHeading())
    poses, booms, swings = random_states(plans, seed)
    best = [
        reference_objective(table, goals[k % 2], Horizon(), poses[k], booms[k])
        for k in range(plans)
    ]
    rows = []
    for name, (make, count) in methods.items():
        controllers = [make(goal) for goal in goals]
        states = list(zip(poses, booms, swings, strict=True))[:count]
        rows += replanning_rows(name, controllers, states, np.array(best[:count]))
    rows.append(planner_row(planner(table), poses, booms))
    return pd.DataFrame(rows)


def random_states(n: int, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Poses (n, 3), boom angles (n,) and last swings (n,)."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 3]))
    poses = rng.uniform(-1, 1, (n, 3)) * np.array([1.0, 1.0, np.pi])
    return poses, rng.uniform(0, 2 * np.pi, n), rng.uniform(-LIMIT, LIMIT, n)


def replanning_rows(
    name: str,
    controllers: list[Any],
    states: list[tuple[FloatArray, float, float]],
    best: FloatArray,
) -> list[dict[str, Any]]:
    """Rows for both goals."""
    for controller in controllers:
        controller.plan(*states[0])
    times, excess = np.empty(len(states)), np.empty(len(states))
    for k, state in enumerate(states):
        controller = controllers[k % 2]
        times[k], plan = timed(lambda c=controller, state=state: c.plan(*state))
        excess[k] = plan.objective - best[k]
    rows = []
    for goal, chosen in {"to point": slice(0, None, 2), "to heading": slice(1, None, 2)}.items():
        n, bad = len(times[chosen]), int(np.sum(excess[chosen] > 1e-3))
        low, high = rate_interval(bad, n)
        rows.append(
            {
                "method": name, "goal": goal, "plans": n, **_time_columns(times[chosen]),
                "bad": bad, "bad_share": bad / n, "bad_low": low, "bad_high": high,
                "excess_max": float(excess[chosen].max()),
                "excess_min": float(excess[chosen].min()),
            }
        )  # fmt: skip
        print(rows[-1], flush=True)
    return rows


def planner_row(steering: Planner, poses: FloatArray, booms: FloatArray) -> dict[str, Any]:
    """Return times of the planner, whose objective is another."""
    steering.plan(poses[0], booms[0])
    times = np.array(
        [timed(lambda p=p, b=b: steering.plan(p, b))[0] for p, b in zip(poses, booms, strict=True)]
    )
    return {"method": "planner", "goal": "to point", "plans": len(times), **_time_columns(times)}


def turns_table(true: TabulatedMap, most_hops: int = 30) -> pd.DataFrame:
    """Largest turns to both sides, by dynamic programming over the boom angle."""
    boom = turn_nodes(144)
    grid = np.meshgrid(boom, np.linspace(-LIMIT, LIMIT, 37), indexing="ij")
    turn = true.change(*(axis.ravel() for axis in grid))[:, 2].reshape(grid[0].shape)
    rows = []
    for side, sign in {"left": 1, "right": -1}.items():
        best = np.zeros(len(boom))
        for hops in range(1, most_hops + 1):
            best = (sign * turn + np.interp(sum(grid), boom, best, period=2 * np.pi)).max(axis=1)
            degrees = np.degrees([best[len(boom) // 2], best.max()])
            rows.append((side, hops, *degrees))
    columns = ["side", "hops", "from_neutral_deg", "from_best_boom_angle_deg"]
    return pd.DataFrame(rows, columns=columns)


def _time_columns(times: FloatArray) -> dict[str, float]:
    return {
        "median_ms": 1e3 * float(np.median(times)),
        "p99_ms": 1e3 * float(np.percentile(times, 99)),
        "over_budget_share": float(np.mean(times > BUDGET_S)),
    }


def _median(values: FloatArray) -> float:
    return float(np.median(values[~np.isnan(values)])) if np.any(~np.isnan(values)) else np.nan


def _largest(values: FloatArray) -> float:
    return float(np.nanmax(values)) if np.any(~np.isnan(values)) else np.nan


# How even the legs are, and where the printed search begins: what they decide.

# Preload of each leg as a share; the default first.
LEGS = (ROBOT.preload_shares, (0.985, 1.02, 0.995), (1.0, 1.04, 0.96), (1.0, 1.06, 0.94))


def learned_of(robot: SteeredHopper, seed: int) -> list[TabulatedMap]:
    """Return what is learned of a hopper."""
    hops = [excited(seed, number, robot) for number in range(EXCITATIONS)]
    return [tabulated(trained_process(some), LIMIT) for some in hops]


def drift(robot: SteeredHopper, hops: int = 12) -> dict[str, float]:
    """Return the frame change with the boom in neutral."""
    still, rng = robot.still(), np.random.default_rng(0)
    apex, poses = released(still, np.zeros(3)), []
    for _ in range(hops):
        hop = steer_hop(still, apex, 0.0, rng=rng)
        apex = hop.end
        poses.append(hop.stance.pose)
    x, y, turn = relative(poses[-2], poses[-1])
    return {"drift_x_mm": 1e3 * x, "drift_y_mm": 1e3 * y, "drift_deg": float(np.degrees(turn))}


def leg_rows(shares: tuple[float, ...], starts: int, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of a hopper with such legs."""
    robot = replace(ROBOT, preload_shares=shares)
    learned = learned_of(robot, seed)
    printed = GradientController(model=learned[0])
    cases = [
        (name, f"printed, {begun}", [replace(printed, model=m, start=begun) for m in learned])
        for begun in STARTS
        for name in ("facing", "turn")
    ]
    cases.append(("any heading", "planner", [planner(model) for model in learned]))
    for name, controller, makers in cases:
        trial = turning if name == "turn" else to_origin
        good = sum(
            trial(makers[number % EXCITATIONS], name, number, seed, robot).success
            for number in range(starts)
        )
        low, high = rate_interval(good, starts)
        row = {
            "preload_shares": " ".join(map(str, robot.preload_shares)), **drift(robot),
            "task": name, "controller": controller, "starts": starts, "successes": good,
            "share": good / starts, "low": low, "high": high,
        }  # fmt: skip
        print(row, flush=True)
        yield row


def main() -> None:
    """Measure and tabulate."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--starts", type=int, default=30)
    parser.add_argument("--plans", type=int, default=2000)
    parser.add_argument("--slow-plans", type=int, default=400, help="of the printed controller")
    parser.add_argument("--seed", type=int, default=20261121)
    options = parser.parse_args()
    out: Path = options.out
    known = maps(options.seed)
    turns = turns_table(known.true)
    turns.to_csv(out.with_name("steering_turns.csv"), index=False, float_format="%.6g")
    control = control_table(known, options.starts, options.seed)
    control.to_csv(out, index=False, float_format="%.6g")
    replanning = replanning_table(known, options.plans, options.slow_plans, options.seed)
    beside = out.with_name("steering_replanning.csv")
    replanning.to_csv(beside, index=False, float_format="%.6g")
    found = [row for shares in LEGS for row in leg_rows(shares, options.starts, options.seed + 1)]
    legs = pd.DataFrame(found)
    legs.to_csv(out.with_name("steering_legs.csv"), index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
