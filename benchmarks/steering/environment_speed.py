"""What a stride of the environment `hopdata/SteeredHopper-v0` costs, and how exact it is.

    python benchmarks/steering/environment_speed.py --out environment_speed.csv

Random swings; episodes that end begin anew. A row is a tolerance of the integrator, or
the environment as `gymnasium.make` wraps it. Times are processor times of one thread:
`us_per_stride` of all strides with their resets, `us_q05`, `us_median` of single calls
of `step`. On a busy machine calls wait for its caches, and `us_q05` is near what an idle
one takes. Errors are the largest over single hops from the same states with the same
kicks, against a tolerance of 1e-12: of the pose at the stance, of the state at the apex
and of the instants of contacts; `other_orders` counts hops with another sequence of
contacts.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import beside  # noqa: F401  finds `machine`
import gymnasium
import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd

from hopdata.jobs import write_table
from hopdata.steering.environment import ID, RTOL, SteeredHopperEnv
from hopdata.steering.robot import SteeredHop, SteeredHopper, released, steer_hop

TOLERANCES = (1e-10, 1e-8, RTOL, 1e-5, 1e-4)
REFERENCE_RTOL = 1e-12


def strides_timed(environment: Any, strides: int, seed: int) -> dict[str, float]:
    """Return what strides with random swings cost, us, in an environment."""
    limit = float(environment.action_space.high[0])
    swings = np.random.default_rng(seed).uniform(-limit, limit, (strides, 1))
    environment.reset(seed=seed)
    took_us = np.empty(strides)
    begun = time.process_time()
    for k, swing in enumerate(swings):
        before = time.perf_counter()
        _, _, terminated, truncated, _ = environment.step(swing)
        took_us[k] = 1e6 * (time.perf_counter() - before)
        if terminated or truncated:
            environment.reset()
    whole_us = 1e6 * (time.process_time() - begun) / strides
    return {
        "strides": strides,
        "us_per_stride": whole_us,
        "us_q05": float(np.percentile(took_us, 5)),
        "us_median": float(np.median(took_us)),
        "strides_per_second": 1e6 / whole_us,
        "strides_per_second_q05": 1e6 / float(np.percentile(took_us, 5)),
    }


def hops_from_same_states(rtol: float, hops: int, seed: int) -> list[SteeredHop]:
    """Return hops of this tolerance from the apexes of a walk of the reference."""
    robot = SteeredHopper()
    rng = np.random.default_rng(seed)
    limit = robot.swing_limit_rad
    apex = released(robot, (0.0, 0.0, 0.0))
    found = []
    for k in range(hops):
        swing = float(rng.uniform(-limit, limit))
        kicks = np.random.SeedSequence(seed, spawn_key=(k,))
        exact = steer_hop(
            robot, apex, swing, rng=np.random.default_rng(kicks), rtol=REFERENCE_RTOL
        )
        hop = exact
        if rtol != REFERENCE_RTOL:
            again = np.random.default_rng(kicks)
            hop = steer_hop(robot, apex, swing, rng=again, rtol=rtol)
        found.append(hop)
        apex = exact.end
        if exact.stance.fell:
            apex = released(robot, (0.0, 0.0, 0.0))
    return found


def errors_of(hops: list[SteeredHop], exact: list[SteeredHop]) -> dict[str, float]:
    """Return the largest errors of hops from the same states."""
    pose, apex, instant, other = 0.0, 0.0, 0.0, 0
    for hop, true in zip(hops, exact, strict=True):
        same = np.array_equal(hop.hop.event_leg, true.hop.event_leg)
        if hop.stance.fell or not same:
            other += hop.stance.fell != true.stance.fell or not same
            continue
        pose = max(pose, float(np.abs(hop.stance.pose - true.stance.pose).max()))
        apex = max(apex, float(np.abs(hop.end.state - true.end.state).max()))
        apart = np.abs(hop.hop.event_time - true.hop.event_time)
        instant = max(instant, float(apart.max()))
    return {
        "pose_error": pose,
        "apex_error": apex,
        "contact_error_s": instant,
        "other_orders": other,
    }


def main() -> None:
    """Measure, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--strides", type=int, default=5000)
    parser.add_argument("--hops", type=int, default=1000, help="for the errors")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    exact = hops_from_same_states(REFERENCE_RTOL, given.hops, given.seed)
    rows = []
    for rtol in TOLERANCES:
        environment = SteeredHopperEnv(rtol=rtol)
        strides_timed(environment, 10, given.seed)  # compiles
        cost = strides_timed(environment, given.strides, given.seed)
        errors = errors_of(hops_from_same_states(rtol, given.hops, given.seed), exact)
        rows.append({"way": "environment", "rtol": rtol, **cost, **errors})
    made = gymnasium.make(ID)
    cost = strides_timed(made, given.strides, given.seed)
    rows.append({"way": "gymnasium.make", "rtol": RTOL, **cost})
    table = pd.DataFrame(rows)
    write_table(given.out, table)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
