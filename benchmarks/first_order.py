"""The flow's Jacobian: its cost and error, and whether the orders of a landing agree.

    python benchmarks/first_order.py --out first_order.csv

There is one row per number, with its unit. Cost is the time of `solve` with the
Jacobian over the time without, on the plate (35 contacts, 2 s, tolerances 1e-6). All
starts with it and all starts without it take turns on one thread. Medians are over the
turns, also for the ratio, because a machine's speed varies from turn to turn. Error is
the largest difference from fourth-order central differences of `solve` itself, relative
to the largest entry. The spread of orders is the spread of the saltation products over
all orders in which three feet may land together (see `check_c1`).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from machine import in_turn
from numpy.typing import NDArray

from hopdata.hybrid import Solution, System, solve
from hopdata.hybrid.first_order import check_c1
from hopdata.scenes.body import flight_mode
from hopdata.scenes.hopper import hopper_system
from hopdata.scenes.hopper_control import control_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant
from hopdata.scenes.plate import Plate
from hopdata.scenes.scene import Control
from hopdata.scenes.vertical_hopper import VerticalHopper

Run = Callable[..., Solution]
TIGHT = {"rtol": 1e-13, "atol": 1e-14}
TURNS = 25
FEET = ("foot1", "foot2", "foot3")
LANDING = (0, 0, 0.27, 0, 0, 0, 0.05, -0.03, -2.1, 0.1, -0.2, 0.05)
TILTED = (0, 0, 0.29, 0.4, 0.03, -0.02, 0.1, -0.05, -1.5, 0.1, -0.2, 0.1)


def differences(run: Run, y0: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return the derivative of the final state by fourth-order central differences."""
    columns = []
    for j in range(len(y0)):
        shift = np.zeros(len(y0))
        shift[j] = step
        ends = [run(y0 + k * shift, **TIGHT).y_end for k in (-2, -1, 1, 2)]
        columns.append((ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step))
    return np.array(columns).T


def error_of(run: Run, y0: tuple[float, ...], step: float) -> float:
    start = np.array(y0, dtype=np.float64)
    reference = differences(run, start, step)
    found = run(start, jacobian=True, **TIGHT).jacobian
    assert found is not None
    return float(np.abs(found - reference).max() / np.abs(reference).max())


def errors() -> list[tuple[str, str, float, str]]:
    """Return the Jacobian's error on each scene."""
    hopper, plate, legs = (
        VerticalHopper(damping_n_s_m=3.0),
        Plate(12),
        HopperParameters(),
    )
    runs: list[tuple[str, Run, tuple[float, ...], float]] = [
        ("octant", lambda y, **k: solve(octant(), T_SPAN, y, method="dop853", **k),
         INITIAL_STATE, 1e-4),
        ("vertical_hopper",
         lambda y, **k: solve(hopper.system(), (0, 2), y, params=hopper.params, **k),
         (2.0, 0.0), 1e-5),
        ("plate_12", lambda y, **k: solve(plate.system(), (0, 1), y, params=plate.params, **k),
         (0.0, 2.2, 0.07, 0.0, 0.0, 0.0), 1e-6),
        ("hopper_landing",
         lambda y, **k: solve(hopper_system(), (0, 0.1), y, params=legs.vector(),
                              mode=flight_mode(hopper_system(), -1.0), **k),
         TILTED, 1e-6),
    ]  # fmt: skip
    return [
        (name, "jacobian_error_relative", error_of(run, y0, step), "1")
        for name, run, y0, step in runs
    ]


def costs(contacts: int, starts: int) -> list[tuple[str, str, float, str]]:
    """Return the cost of the Jacobian on the plate, for plain user code and for sums."""
    plate, rows = Plate(contacts), []
    states = plate.initial_states(starts, 3)
    for form, system in (("plain", plate.system()), ("sums", plate.system(sums=True))):

        def run(
            wanted: bool, form: str = form, system: System = system
        ) -> Callable[[], object]:
            system.compile(jacobian=wanted)

            def all_starts() -> None:
                for y in states:
                    memory = plate.memory(y) if form == "sums" else None
                    solve(
                        system, (0, 2), y, params=plate.params, memory=memory, rtol=1e-6,
                        atol=1e-6, jacobian=wanted,
                    )  # fmt: skip

            return all_starts

        times = in_turn(
            {"state": run(False), "both": run(True)}, fewest=TURNS, most=TURNS
        )
        case = f"plate_{contacts}_{form}"
        state, both = (
            1e6 * np.array(times[name]) / starts for name in ("state", "both")
        )
        rows += [
            (case, "state_time", float(np.median(state)), "us"),
            (case, "with_jacobian_time", float(np.median(both)), "us"),
            (case, "jacobian_cost_ratio", float(np.median(both / state)), "1"),
        ]
    return rows


def spreads() -> list[tuple[str, str, float, str]]:
    """Return how far apart the products over all orders of a landing are, for C1 and controls."""
    legs = HopperParameters()
    mode = flight_mode(hopper_system(), -1.0)
    reports = {
        "hopper": check_c1(
            hopper_system(), LANDING, params=legs.vector(), mode=mode, guards=FEET
        )
    }
    for name, control in (
        ("control_kappa_0.1", Control(coupling=0.1)),
        ("control_kappa_0.4", Control(coupling=0.4)),
        ("control_tau_5ms", Control(delay_s=0.005)),
        ("control_eps_0.1", Control(impulse=0.1)),
    ):
        reports[name] = check_c1(
            control_system(),
            LANDING,
            params=legs.vector(variant=control),
            mode=mode,
            guards=FEET,
        )
    return [
        (
            f"{name} ({report.verdict})",
            "spread_of_six_orders",
            report.products.value,
            "1",
        )
        for name, report in reports.items()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    arguments = parser.parse_args()
    rows = [*errors(), *costs(35, 20), *spreads()]
    table = pd.DataFrame(rows, columns=["case", "quantity", "value", "unit"])
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(arguments.out, index=False)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
