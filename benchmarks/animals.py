"""Landings found for animals of two to six feet, recorded at 50 to 2000 Hz, and the time taken.

    python benchmarks/animals.py --out animals.csv [--hops 200]

The animals have the body of the three-legged hopper on n legs that together have the
strength of its three. They are simulated and seen with 0.6 mm of noise. The biped is
dropped anew for every landing, because two point feet cannot balance. There is one row
for each number of feet and frame rate with three body markers, and three more rows for
the largest animal with four, five and eight. `landings` counts true landings on all
feet; `used` counts those that are not excluded. `order_right` is the share of used
landings with the right order; `order_right_sure` considers those whose order has a
probability of 0.9 or more. `contact_rms_ms` is the error of the instants about their
common bias `contact_bias_ms`, and `within_se` the share of them within the stated
standard error. `velocity_pre_m_s` and `velocity_post_m_s` are rms errors of the
vertical velocity at the two sections. Processor seconds are given for the stages floor,
sections, touchdowns and pairs, on one thread. `peak_mb` is the largest memory use above
that at the start, and `recording_mb` the size of the positions.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from pathlib import Path
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd

from hopdata.landings.floor import fit_floor, level
from hopdata.landings.sections.select import select_sections
from hopdata.landings.states.assemble import assemble_pairs
from hopdata.landings.states.pairs import Pairs
from hopdata.landings.touchdowns import touchdown_table
from hopdata.maps.truth.scoring import match_landings
from hopdata.recording import Recording
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.scaling import known_scene, true_states
from hopdata.synthesis.simulate import simulate_recording
from hopdata.truth import Truth

FEET, RATES_HZ, MARKERS = (
    (2, 3, 4, 5, 6),
    (50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0),
    (4, 5, 8),
)
SURE = 0.9


def simulate(
    feet: int, rate_hz: float, markers: int, hops: int
) -> tuple[Recording, Truth]:
    """Simulate an animal whose legs share the strength of three, with markers around the body."""
    three, share = HopperParameters(), 3 / feet
    names = ("stiffness_n_m", "damping_n_s_m", "preload_n")
    legs = {"n_legs": feet} | {name: share * getattr(three, name) for name in names}
    simulation: dict[str, Any] = {"hops": hops, "hopper": legs}
    if feet == 2:
        simulation["operator"] = {"arena_m": 1e-6, "carry_s": 0.5}
    camera: dict[str, Any] = {"rate_hz": rate_hz}
    if markers != 3:
        angle = 2 * np.pi * np.arange(markers) / markers
        height = 0.06 + 0.02 * np.cos(2 * angle)
        places = np.column_stack([0.14 * np.cos(angle), 0.14 * np.sin(angle), height])
        camera["markers"] = {"body_m": places.tolist()}
    return simulate_recording(simulation, camera, seed=[20261121, feet])


def stages(recording: Recording) -> tuple[pd.DataFrame, Pairs, Any, dict[str, float]]:
    """Run the landing stages; return touchdowns, pairs, sections and the seconds of each stage."""
    seconds, begin = {}, time.process_time()

    def lap(name: str) -> None:
        nonlocal begin
        seconds[f"{name}_s"] = time.process_time() - begin
        begin = time.process_time()

    flat = level(recording, fit_floor(recording))
    lap("floor")
    sections = select_sections([flat])
    lap("sections")
    heights = {
        "pre_height_m": sections.pre_height_m,
        "post_height_m": sections.post_height_m,
    }
    table = touchdown_table(flat, **heights)
    lap("touchdowns")
    pairs = assemble_pairs([flat], table, home_marker="body1", **heights)
    lap("pairs")
    return table, pairs, sections, seconds


def velocity_errors(
    truth: Truth, table: pd.DataFrame, pairs: Pairs, sections: Any
) -> list[float]:
    """Return the rms error of a marker's vertical velocity at each of the two sections, m/s."""
    scene = known_scene(truth)
    heights = SectionHeights(
        sections.pre_height_m, sections.post_height_m, scene.body_points_m
    )
    true = true_states(truth, scene, heights)
    mine = match_landings(contacts(table)[pairs.touchdown - 1], truth.contact_times)
    place = {int(number) - 1: row for row, number in enumerate(true.touchdown)}
    rows = [(k, place[j]) for k, j in enumerate(mine) if j in place]
    here, there = (np.array(part) for part in zip(*rows, strict=True))
    half = pairs.x.shape[1] // 2
    errors = []
    for found, exact in ((pairs.x, true.x), (pairs.y, true.y)):
        speed = [
            v[:, half:].reshape(len(v), -1, 3) for v in (found[here], exact[there])
        ]
        errors.append(
            float(np.sqrt(np.mean((speed[0][..., 2] - speed[1][..., 2]) ** 2)))
        )
    return errors


def contacts(table: pd.DataFrame, what: str = "contact") -> np.ndarray:
    """Return contact instants or their standard errors, (rows, feet), s."""
    return table.filter(regex=f"^{what}_.*_s$").to_numpy(float)


def measure(feet: int, rate_hz: float, markers: int, hops: int) -> dict[str, float]:
    """Simulate one animal at one rate, and compare the landings found with the true ones."""
    recording, truth = simulate(feet, rate_hz, markers, hops)
    table, pairs, sections, seconds = stages(recording)
    tracemalloc.start()
    stages(recording)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    used = table[~table["excluded"].astype(bool)].reset_index(drop=True)
    landing = match_landings(contacts(used), truth.contact_times)
    known = np.flatnonzero(landing >= 0)
    error = contacts(used)[known] - truth.contact_times[landing[known]]
    error_free = error - error.mean()
    order = np.argsort(contacts(used)[known], axis=1)
    right = (order == np.argsort(truth.contact_times[landing[known]], axis=1)).all(
        axis=1
    )
    sure = used["probability"].to_numpy()[known] >= SURE
    pre, post = velocity_errors(truth, table, pairs, sections)
    return {
        "feet": feet,
        "body_markers": markers,
        "rate_hz": rate_hz,
        "frames": len(recording.time),
        "landings": int(
            np.isfinite(truth.contact_times[truth.complete]).all(axis=1).sum()
        ),
        "used": len(used),
        "without_landing": int((landing < 0).sum()),
        "orders_seen": used["schedule"].nunique(),
        "order_right": float(right.mean()),
        "order_right_sure": float(right[sure].mean()),
        "share_sure": float(sure.mean()),
        "contact_bias_ms": 1e3 * float(error.mean()),
        "contact_rms_ms": 1e3 * float(error_free.std()),
        "within_se": float(np.mean(np.abs(error_free) < contacts(used, "se")[known])),
        "velocity_pre_m_s": pre,
        "velocity_post_m_s": post,
        **seconds,
        "peak_mb": peak / 2**20,
        "recording_mb": recording.positions.nbytes / 2**20,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument(
        "--hops", type=int, default=200, help="hops of each animal (default 200)"
    )
    parser.add_argument("--feet", type=int, nargs="+", default=FEET)
    parser.add_argument("--rates", type=float, nargs="+", default=RATES_HZ)
    arguments = parser.parse_args()
    cases = [(feet, rate, 3) for feet in arguments.feet for rate in arguments.rates]
    cases += [(arguments.feet[-1], 100.0, markers) for markers in MARKERS]
    measure(*cases[0], 20)  # compile before timing
    rows = []
    for case in cases:
        rows.append(measure(*case, arguments.hops))
        print({key: round(value, 4) for key, value in rows[-1].items()}, flush=True)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(rows).to_csv(arguments.out, index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
