"""How surely `hopdata inspect` finds planted faults, and what it sees in clean recordings.

    python benchmarks/recording_faults.py --out recording_faults.csv

Recordings of the simulated hopper, each with one fault of known markers and frames. One row for
each camera (rate and noise) and kind of fault. `found` is the share of recordings in which the
fault is told with its markers and frames (a swap that ends in a gap may end anywhere in it);
`named` the share in which nothing else is told beside it. In the rows "clean" and "gaps" nothing is
wrong, `false_alarms` is the number of faults told in all their recordings, `hours` their length,
and `guessed` the share of them in which unit, vertical axis and the roles of all markers are
guessed right.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd

from hopdata.arrays import FloatArray
from hopdata.recording import Recording
from hopdata.recordings.plausibility import check_fall, check_rigid
from hopdata.recordings.quality.inspection import Faults, Inspection, inspect_recording
from hopdata.recordings.quality.roles import guess_roles
from hopdata.recordings.raw import RawRecording
from hopdata.synthesis.simulate import simulate_recording

CAMERAS = ((100.0, 0.0003), (100.0, 0.0006), (100.0, 0.0012), (250.0, 0.0006))
HOPS = 50
RECORDINGS = 20
GAPS = {"rate_per_min": 20.0, "mean_s": 0.1}
ROLES = {"body": 3, "foot": 3, "boom": 1}


@dataclass(frozen=True)
class Planted:
    """A recording with a fault, and how to recognise it among those told."""

    positions: FloatArray
    is_found: Callable[[Faults], bool]


def swap(length: int, gap: int) -> Callable[[Recording, np.random.Generator], Planted]:
    """Exchange two markers for `length` frames, unseen for `gap` frames before either end."""

    def plant(recording: Recording, rng: np.random.Generator) -> Planted:
        pair = rng.choice(len(recording.markers), 2, replace=False)
        start = int(rng.integers(100, len(recording.time) - length - 100))
        stop = start + length
        positions = recording.positions.copy()
        positions[start:stop, pair] = recording.positions[start:stop, pair[::-1]]
        for end in (start, stop):
            positions[end - gap : end, pair] = np.nan
        names = {recording.markers[m] for m in pair}

        def is_found(faults: Faults) -> bool:
            return any(
                set(s.markers) == names
                and s.start == start
                and s.stop is not None
                and stop - gap <= s.stop <= stop
                for s in faults.swaps
            )

        return Planted(positions, is_found)

    return plant


def spike(size_m: float, length: int) -> Callable[[Recording, np.random.Generator], Planted]:
    """Move a marker aside for a few frames."""

    def plant(recording: Recording, rng: np.random.Generator) -> Planted:
        m = int(rng.integers(len(recording.markers)))
        start = int(rng.integers(10, len(recording.time) - 10))
        way = rng.normal(size=3)
        positions = recording.positions.copy()
        positions[start : start + length, m] += size_m * way / np.linalg.norm(way)
        expected = (recording.markers[m], start, start + length)

        def is_found(faults: Faults) -> bool:
            return any((s.marker, s.start, s.stop) == expected for s in faults.spikes)

        return Planted(positions, is_found)

    return plant


def frozen(length: int) -> Callable[[Recording, np.random.Generator], Planted]:
    """Let a marker repeat one position."""

    def plant(recording: Recording, rng: np.random.Generator) -> Planted:
        m = int(rng.integers(len(recording.markers)))
        start = int(rng.integers(10, len(recording.time) - length - 10))
        positions = recording.positions.copy()
        positions[start : start + length, m] = positions[start, m]
        expected = (recording.markers[m], start, start + length)

        def is_found(faults: Faults) -> bool:
            return any((f.marker, f.start, f.stop) == expected for f in faults.frozen)

        return Planted(positions, is_found)

    return plant


FAULTS = {
    "swap for 1 frame": swap(1, 0),
    "swap for 50 frames": swap(50, 0),
    "swap for 200 frames in gaps of 10": swap(200, 10),
    "swap for 200 frames in gaps of 80": swap(200, 80),
    "spike of 10 mm": spike(0.01, 1),
    "spike of 20 mm": spike(0.02, 1),
    "spike of 30 mm": spike(0.03, 1),
    "spike of 50 mm": spike(0.05, 1),
    "spike of 50 mm for 3 frames": spike(0.05, 3),
    "frozen for 5 frames": frozen(5),
    "frozen for 50 frames": frozen(50),
}


def simulated(seed: int, rate_hz: float, noise_m: float, **camera: Any) -> Recording:
    """Simulate the hopper as this camera sees it."""
    seen = {"rate_hz": rate_hz, "noise_m": noise_m, **camera}
    return simulate_recording({"hops": HOPS}, seen, seed=seed)[0]


def inspected(recording: Recording, positions: FloatArray) -> Inspection:
    """Inspect positions in mm, as a file would hold them."""
    raw = RawRecording(
        recording.markers, recording.time, 1e3 * positions, recording.rate_hz, unit="mm"
    )
    return inspect_recording(raw)


def is_guessed(inspection: Inspection, recording: Recording) -> bool:
    """Whether unit, axis and all roles are right, and the checks pass."""
    roles = guess_roles(inspection)
    found = (roles.body, roles.feet, roles.boom)
    right = tuple(recording.names(role) for role in ROLES)
    check_fall(recording)
    check_rigid(recording)
    return found == right and (inspection.unit.value, inspection.up.value) == ("mm", "z")


def without_fault(rate_hz: float, noise_m: float, n: int) -> Iterator[dict[str, Any]]:
    """Yield the rows in which nothing is wrong."""
    for kind, camera in (("clean", {}), ("gaps", {"gaps": GAPS})):
        alarms, guessed, seconds = 0, 0, 0.0
        for seed in range(n):
            recording = simulated(seed, rate_hz, noise_m, **camera)
            inspection = inspected(recording, recording.positions)
            alarms += inspection.n_problems
            guessed += is_guessed(inspection, recording)
            seconds += inspection.duration_s
        yield {
            "fault": kind,
            "recordings": n,
            "false_alarms": alarms,
            "hours": seconds / 3600,
            "guessed": guessed / n,
        }


def with_fault(rate_hz: float, noise_m: float, n: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each kind of fault."""
    for number, (kind, plant) in enumerate(FAULTS.items()):
        found = named = 0
        for seed in range(n):
            recording = simulated(1000 + seed, rate_hz, noise_m)
            rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
            planted = plant(recording, rng)
            faults = inspected(recording, planted.positions).faults
            is_found = planted.is_found(faults)
            found += is_found
            named += is_found and faults.count == 1
        yield {"fault": kind, "recordings": n, "found": found / n, "named": named / n}


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--recordings", type=int, default=RECORDINGS)
    options = parser.parse_args()
    rows = [
        {"rate_hz": rate_hz, "noise_mm": 1e3 * noise_m, **row}
        for rate_hz, noise_m in CAMERAS
        for measure in (without_fault, with_fault)
        for row in measure(rate_hz, noise_m, options.recordings)
    ]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(rows).to_csv(options.out, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
