"""Contacts on soles that yield and spring back: errors beside the stated ones.

    python benchmarks/springy_soles.py --out springy_soles.csv [--seeds 5] [--jumps 25]

Jumps in place on two feet, which leave the floor and land at 1.9 m/s. The heel lands
first; of feet with two markers, the toe does 25 to 45 ms later at about 1 m/s. In the
form `stops`, a marker stops at once, and then dips by A (s / D) exp(1 - s / D), s
seconds after its contact: by A at most, after D. In the form `falls through`, it falls
on by A at its own speed and then springs back as exp(-s / D). The controls stop at once
(`stops`, A = 0), or as exp(-s / 3 ms), and stand.

There is one row for each form, depth, time, camera (rate and noise) and number of
markers. Over the seeds, `bias_ms` is the median of the mean errors of a recording,
`bias_worst_ms` the largest, and `stated_ms` the median of the stated errors (standard
and common error, in quadrature). `over_stated` is the rms of error over stated error
in a recording, median and worst; `told` is the share of recordings with a remark on it.
"""

from __future__ import annotations

import argparse
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hopdata.arrays import GRAVITY_M_S2, FloatArray
from hopdata.contact_times import contacts
from hopdata.recording import Recording

SPEED_M_S = 1.9
PERIOD_S = 1.6
FIRST_S = 0.8  # of the first jump
NEAR_S = 0.03  # instants farther apart do not belong to the same contact
SOFT_S = 0.003  # of the soft control, which is lifted back before the next jump
LIFTS_S = 0.5
LIFTING_S = 0.2
FORMS = ("stops", "falls through")
DEPTHS_M = (5e-4, 1.4e-3, 4e-3)
TURNS_S = (0.005, 0.02, 0.04)
CAMERAS = ((100.0, 1e-3), (200.0, 3e-4), (500.0, 1e-4))
FEET = {
    "one": {"left": ["LHEE"], "right": ["RHEE"]},
    "two": {"left": ["LHEE", "LTOE"], "right": ["RHEE", "RTOE"]},
}
REMARKS = ("landings.foot_springs_back", "landings.feet_spring_back")
BODY = ("LPSI", "RPSI", "SACR")
PLACES_M = {
    "LPSI": (0.0, 0.1, 1.0),
    "RPSI": (0.0, -0.1, 1.0),
    "SACR": (-0.05, 0.0, 1.0),
    "LHEE": (-0.1, 0.1, 0.04),
    "LTOE": (0.12, 0.1, 0.03),
    "RHEE": (-0.1, -0.1, 0.04),
    "RTOE": (0.12, -0.1, 0.03),
}


def after_contact(
    s: FloatArray, fall_m_s: float, form: str, depth_m: float, turns_s: float
) -> FloatArray:
    """Return the height of a marker `s` seconds after its contact, m."""
    if form == "soft":
        sinks_m = fall_m_s * SOFT_S * (1 - np.exp(-s / SOFT_S))
        return np.asarray(-sinks_m * np.clip((LIFTS_S - s) / LIFTING_S, 0, 1))
    if not depth_m:
        return np.zeros_like(s)
    if form == "stops":
        return np.asarray(-depth_m * s / turns_s * np.exp(1 - s / turns_s))
    falls_s = depth_m / fall_m_s
    back = depth_m * np.exp(-np.maximum(s - falls_s, 0.0) / turns_s)
    return -np.where(s < falls_s, fall_m_s * s, back)


def jumping(
    seed: int,
    *,
    form: str,
    depth_m: float,
    turns_s: float,
    rate_hz: float,
    noise_m: float,
    jumps: int,
) -> tuple[Recording, FloatArray]:
    """Return a recording of jumps, and when each foot (left, right) landed, (J, 2), s."""
    rng = np.random.default_rng(seed)
    time = np.arange(int((jumps * PERIOD_S + FIRST_S) * rate_hz)) / rate_hz
    time += rng.random() / rate_hz
    names = list(PLACES_M)
    positions = np.tile(np.array(list(PLACES_M.values())), (len(time), 1, 1))
    truth = np.zeros((jumps, 2))
    sole = (form, depth_m, turns_s)
    for jump in range(jumps):
        leaves_s = FIRST_S + PERIOD_S * jump + rng.uniform(-0.05, 0.05)
        speed = SPEED_M_S + rng.normal(0, 0.05)
        positions[:, : len(BODY), 2] += _body(time - leaves_s, speed)[:, None]
        for side in range(2):
            since = time - leaves_s - rng.normal(0, 0.006)
            own = speed + rng.normal(0, 0.03)
            heel = len(BODY) + 2 * side
            lands_s = 2 * own / GRAVITY_M_S2
            truth[jump, side] = time[0] - since[0] + lands_s
            toe = rng.uniform(0.025, 0.045), rng.uniform(0.8, 1.3)
            heel_m, toe_m = _foot(since, own, toe, sole)
            positions[:, heel, 2] += heel_m
            positions[:, heel + 1, 2] += toe_m
    positions += rng.normal(0, noise_m, positions.shape)
    recording = Recording.from_arrays(
        time, positions, names, feet=names[len(BODY) :], body=BODY
    )
    return recording, truth


def _body(since: FloatArray, speed: float) -> FloatArray:
    """Return the height of the body above its stance: crouch, flight and landing."""
    flight_s = 2 * speed / GRAVITY_M_S2
    share = np.clip((since + 0.4) / 0.4, 0, 1)
    before = -0.18 * np.sin(np.pi * share) ** 2 + 0.4 * speed * (share**3 - share**2)
    flies = speed * since - GRAVITY_M_S2 / 2 * since**2
    down = np.maximum(since - flight_s, 0)
    after = -speed * down * np.exp(-down / 0.08)
    return np.where(since < 0, before, np.where(since < flight_s, flies, after))


def _foot(
    since: FloatArray,
    speed: float,
    toe: tuple[float, float],
    sole: tuple[str, float, float],
) -> tuple[FloatArray, FloatArray]:
    """Return the heights of heel and toe above their rest.

    `toe` holds how long after the heel it lands, s, and how fast, m/s.
    """
    lands_s = 2 * speed / GRAVITY_M_S2
    flies = speed * since - GRAVITY_M_S2 / 2 * since**2
    down = np.maximum(since - lands_s, 0)
    heel = np.where(since < lands_s, flies, after_contact(down, speed, *sole))
    late_s, toe_m_s = toe
    share = np.clip(since / lands_s, 0, 1)
    raised = late_s * toe_m_s * share**2 * (3 - 2 * share)
    toe_down = np.maximum(since - lands_s - late_s, 0)
    comes = late_s * toe_m_s - toe_m_s * down
    lies = after_contact(toe_down, toe_m_s, *sole)
    tips = np.where(toe_down > 0, lies, comes)
    ends = np.where(since < lands_s, flies + raised, tips)
    is_up = since > 0
    return np.where(is_up, heel, 0.0), np.where(is_up, ends, 0.0)


def run(recording: Recording, truth: FloatArray, markers: str) -> dict[str, float]:
    """Return the errors of one recording, ms, and whether a remark tells of them."""
    found = contacts(recording, feet=FEET[markers])
    errors = []
    stated = []
    for side, foot in enumerate(FEET[markers]):
        own = found.found[found.found["foot"] == foot]
        instant = own["contact_s"].to_numpy()
        error = np.hypot(own["se_s"], own["common_s"]).to_numpy()
        for at in truth[:, side]:
            nearest = int(np.abs(instant - at).argmin()) if len(instant) else 0
            if len(instant) and abs(instant[nearest] - at) < NEAR_S:
                errors.append(instant[nearest] - at)
                stated.append(error[nearest])
    off = 1e3 * np.array(errors)
    stated_ms = 1e3 * np.array(stated)
    return {
        "found": len(off) / truth.size,
        "bias_ms": float(off.mean()),
        "sd_ms": float(off.std()),
        "stated_ms": float(np.median(stated_ms)),
        "over_stated": float(np.sqrt(np.mean((off / stated_ms) ** 2))),
        "told": float(any(one.code in REMARKS for one in found.messages)),
    }


def rows(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Return one row for each condition."""
    soles = [("stops", 0.0, 0.0), ("soft", 0.0, 0.0)]
    soles += product(FORMS, DEPTHS_M, TURNS_S)
    table = []
    for sole, camera, markers in product(soles, CAMERAS, FEET):
        form, depth_m, turns_s = sole
        rate_hz, noise_m = camera
        results = []
        for seed in range(arguments.seed, arguments.seed + arguments.seeds):
            recording, truth = jumping(
                seed,
                form=form,
                depth_m=depth_m,
                turns_s=turns_s,
                rate_hz=rate_hz,
                noise_m=noise_m,
                jumps=arguments.jumps,
            )
            results.append(run(recording, truth, markers))
        runs = pd.DataFrame(results)
        table.append(
            {
                "form": form,
                "depth_mm": 1e3 * depth_m,
                "turns_ms": 1e3 * turns_s,
                "rate_hz": rate_hz,
                "noise_mm": 1e3 * noise_m,
                "markers": markers,
                "seeds": arguments.seeds,
                "found_worst": runs["found"].min(),
                "bias_ms": runs["bias_ms"].median(),
                "bias_worst_ms": runs["bias_ms"][runs["bias_ms"].abs().idxmax()],
                "sd_ms": runs["sd_ms"].median(),
                "stated_ms": runs["stated_ms"].median(),
                "over_stated": runs["over_stated"].median(),
                "over_stated_worst": runs["over_stated"].max(),
                "told": runs["told"].mean(),
            }
        )
    return table


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--jumps", type=int, default=25)
    arguments = parser.parse_args()
    pd.DataFrame(rows(arguments)).to_csv(arguments.out, index=False)


if __name__ == "__main__":
    main()
