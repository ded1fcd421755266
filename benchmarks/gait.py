"""The synthetic hopper's gait, over many hops, beside that of the robot.

    python benchmarks/gait.py --out gait.csv

One row for each quantity, with its unit and, where the robot of the dissertation or the project's
specification gives one, the range wanted. Simulation time includes sampling the frames.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.hops import fly_hop, level_state
from hopdata.synthesis.simulate import first_contacts
from hopdata.synthesis.trial import Trial, run_trial

DROP_HEIGHT_M = 0.24
Row = tuple[str, float, str, str]


def rebound(hopper: HopperParameters) -> float:
    """Apex height of the feet after a level drop over that before it."""
    hop = fly_hop(hopper, level_state(hopper, DROP_HEIGHT_M))
    return float((hop.end_state[2] - hopper.leg_length_m) / DROP_HEIGHT_M)


def gait_rows(trial: Trial, hopper: HopperParameters) -> list[Row]:
    """Falls, durations, contact orders and spreads of a trial."""
    stood = np.array([hop.all_stood() for hop in trial.hops])
    durations = np.array([hop.end_time_s for hop in trial.hops])
    contacts = first_contacts(trial, hopper)[0]
    spread = np.nanstd(contacts, axis=1)
    orders = Counter(map(tuple, np.argsort(contacts[stood], axis=1)))
    return [
        ("hops", len(trial.hops), "1", ">= 10000"),
        ("falls", sum(hop.fell for hop in trial.hops), "1", "0"),
        ("landings on all feet", float(stood.mean()), "1", ""),
        ("mean hop duration", float(durations.mean()), "s", "0.60 to 0.66"),
        ("sd of hop duration", float(durations.std()), "s", ""),
        ("contact orders seen", len(orders), "1", "6"),
        ("rarest contact order", min(orders.values()) / int(stood.sum()), "1", ">= 0.05"),
        ("median sd of contact instants", 1e3 * float(np.median(spread)), "ms", "about 10"),
        ("95 % sd of contact instants", 1e3 * float(np.quantile(spread, 0.95)), "ms", ""),
    ]


def main() -> None:
    """Simulate, tabulate and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--hops", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=20261121)
    options = parser.parse_args()
    hopper = HopperParameters()
    run_trial(hopper, hops=2, rate_hz=100.0, rng=np.random.default_rng(0))  # compile first
    start = time.perf_counter()
    rng = np.random.default_rng(options.seed)
    trial = run_trial(hopper, hops=options.hops, rate_hz=100.0, rng=rng)
    seconds = time.perf_counter() - start
    passive = replace(hopper, release_extension_m=0.0)
    rows = [
        *gait_rows(trial, hopper),
        ("rebound, legs not released", rebound(passive), "1", ">= 0.40"),
        ("rebound, legs released", rebound(hopper), "1", ""),
        ("simulation time per hop", 1e3 * seconds / options.hops, "ms", ""),
    ]  # fmt: skip
    table = pd.DataFrame(rows, columns=["quantity", "value", "unit", "wanted"])
    table.to_csv(options.out, index=False, float_format="%.6g")
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
