"""The recording: its size, its noise and its floor (items 18 to 20)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hopdata.dissertation.labelling.agreement import agrees, built, close
from hopdata.dissertation.rows import Row
from hopdata.dissertation.sample import study_of

if TYPE_CHECKING:
    from hopdata.dissertation.labelling.sample_by_both import Both
    from hopdata.recording import Recording
    from hopdata.truth import Truth
    from hopdata.walk import Study

# The study of the printed size, in a checkout.
THESIS_FILE = "config/thesis.yaml"

# What the dissertation prints, with its section.
FRAMES = 182_611  # 2.2.1
HOPS = 2860  # 2.2.1
RATE_HZ = 100.0  # 2.2.1
NOISE_M = 0.6e-3  # 2.2.1

#: Hops of the recordings in which the two readings of the noise are measured.
#: Unit: hops. Origin: chosen.
NOISE_HOPS = 30


def thesis_trial(seed: int) -> tuple[Recording, Truth]:
    """Simulate a quarter of a recording of the printed size, over a level floor."""
    from hopdata.config.loading import load_config
    from hopdata.synthesis import simulate_recording

    config = load_config(THESIS_FILE, check_files=False)
    first = config["recordings"][0]["simulation"]["duration_s"]
    level = {"bowl_depth_m": 0.0, "waves": 0}
    return simulate_recording(
        {**config["simulation"], "duration_s": first},
        {**config["motion_capture"], "floor": level},
        seed=(seed, 0),
    )


def frames_and_hops(
    again: Sequence[tuple[Recording, Truth]], seeds: Sequence[int]
) -> Row:
    """Item 18: the study of the printed size."""
    from hopdata.config.loading import load_config

    config = load_config(THESIS_FILE, check_files=False)
    rate_hz = config["motion_capture"]["rate_hz"]
    frames = 0
    for entry in config["recordings"]:
        # A frame at the beginning, and one each period.
        frames += int(np.ceil(entry["simulation"]["duration_s"] * rate_hz - 1e-6))
    each_s = []
    hops = []
    for recording, truth in again:
        hops_a_frame = len(truth.apex_times) / len(recording.time)
        each_s.append(1 / hops_a_frame / rate_hz)
        hops.append(hops_a_frame * FRAMES)
    values = {
        "frames": frames,
        "rate": rate_hz,
        "seeds": len(seeds),
        "printed_hop": FRAMES / RATE_HZ / HOPS,
        "hop": each_s,
        "hops": hops,
        "simulated": [len(recording.time) for recording, _ in again],
    }
    is_printed_size = frames == FRAMES and rate_hz == RATE_HZ
    as_many_hops = close(np.median(hops), HOPS)
    return Row(18, agrees(is_printed_size and as_many_hops), values)


def noise(both: Both, seeds: Sequence[int]) -> Row:
    """Item 19: both readings of the noise, and what the distances of pairs give."""
    from hopdata.synthesis import simulate_recording

    of_pairs: dict[str, list[float]] = {"coordinate": [], "distance": []}
    for noise_of, found in of_pairs.items():
        for seed in seeds:
            camera = {"noise_m": NOISE_M, "noise_of": noise_of}
            recording, _ = simulate_recording(
                {"hops": NOISE_HOPS}, camera, seed=(seed, 1)
            )
            found.append(1e3 * _pair_noise(recording))
    sample_mm = 1e3 * _pair_noise(both.recording)
    true_mm = 1e3 * both.truth.noise_m
    values = {
        "pairs": sample_mm,
        "coordinate": float(sample_mm / np.sqrt(2)),
        "true": true_mm,
        "harder": of_pairs["coordinate"],
        "easier": of_pairs["distance"],
    }
    printed_mm = 1e3 * NOISE_M
    by_coordinate = close(np.median(of_pairs["coordinate"]) / np.sqrt(2), printed_mm)
    by_distance = close(np.median(of_pairs["distance"]), printed_mm)
    return Row(19, built(by_coordinate and by_distance), values, "two_readings")


def _pair_noise(recording: Recording) -> float:
    """Return the mean error of the distances between body markers, m."""
    from hopdata.recordings.quality.rigid import pair_distances

    spread = pair_distances(recording.body).spread
    return float(spread[np.triu_indices(len(spread), 1)].mean())


def floor(both: Both) -> Row:
    """Item 20: the floor that was found, and what becomes of a study without it."""
    from hopdata.maps.truth.scoring import score_floor

    known = {both.recording.name: both.truth}
    residual = score_floor(known, both.ours.floors)["floor_residual_rms"]["value"]
    true_floor = both.truth.floor_at_contacts
    curved = float(np.nanstd(true_floor))
    used = {}
    for name in ("printed", "ours"):
        by_print = name == "printed"
        flat = study_of(both.file, printed=by_print, floor={"enabled": False})
        used[name] = _n_used(flat)
    values = {
        "curvature": 1e3 * curved,
        "residual": float(residual),
        "printed_with": _n_used(both.printed),
        "printed_without": used["printed"],
        "ours_with": _n_used(both.ours),
        "ours_without": used["ours"],
    }
    compensated = residual < 0.5 * values["curvature"]
    return Row(20, built(compensated), values, "slight")


def _n_used(found: Study) -> int:
    return int((~found.touchdowns["excluded"].astype(bool)).sum())
