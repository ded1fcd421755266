"""Contacts of feet whose swing ends curved: errors beside the stated ones.

    python benchmarks/curved_swings.py --out curved_swings.csv [--seeds 5] [--landings 40]

Two feet land again and again and stand at once. Swings are polynomials that leave the
floor at 0.8 m/s and end at a given speed: cubic ones, whose acceleration follows from
that, or quintic ones with a given acceleration at the contact. Either ends with a jerk.
The control, of the form `free fall`, has none.

There is one row for each camera (rate and noise), form, speed and acceleration. Over
seeds and feet, `bias_ms` is the median of a foot's mean error, `bias_worst_ms` the one
farthest from zero, `common_ms` the median of the stated common errors, and
`over_stated` the rms of error over both stated errors, median and worst.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hopdata.arrays import GRAVITY_M_S2, FloatArray
from hopdata.landings.contacts.descents import LANDED, Transitions
from hopdata.landings.contacts.timing import find_contacts

SWING_S = 0.3
STANCE_S = 0.25
LEAVES_M_S = 0.8
N_FEET = 2
DOWN_M = 0.015
CAMERAS = ((120.0, 1e-3), (250.0, 3e-4))
# Speed at the contact, m/s, and acceleration there, m/s²; None if it follows.
SWINGS: tuple[tuple[float, float | None], ...] = (
    (0.4, None),
    (1.3, None),
    (2.0, None),
    (0.6, -20.0),
    (1.3, -20.0),
    (1.3, 20.0),
    (2.0, 20.0),
    (2.0, 0.0),
    (0.8, 0.0),
)
FREE_FALL_M_S = 1.0


def swing(since_s: FloatArray, speed: float, acceleration: float | None) -> FloatArray:
    """Return the height of a foot `since_s` after it left the floor, m."""
    share = since_s / SWING_S
    if acceleration is None:
        leaves = share**3 - 2 * share**2 + share
        lands = share**3 - share**2
        return np.asarray(SWING_S * (LEAVES_M_S * leaves - speed * lands))
    # Height, speed and acceleration at either end settle a quintic.
    left = SWING_S * LEAVES_M_S
    landed = -SWING_S * speed
    curved = SWING_S**2 * acceleration
    cubic = -6 * left - 4 * landed + curved / 2
    quartic = 8 * left + 7 * landed - curved
    quintic = -3 * left - 3 * landed + curved / 2
    powers = left * share + cubic * share**3 + quartic * share**4 + quintic * share**5
    return np.asarray(powers)


def landing(
    seed: int,
    *,
    speed: float,
    acceleration: float | None,
    falls: bool,
    rate_hz: float,
    noise_m: float,
    landings: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times (N,), heights (N, 2) and true contacts (L, 2) of two feet, s and m."""
    rng = np.random.default_rng(seed)
    period_s = SWING_S + STANCE_S
    time = np.arange(int((landings + 2) * period_s * rate_hz)) / rate_hz
    heights = np.zeros((len(time), N_FEET))
    regular_s = period_s * (np.arange(landings) + 1)[:, None]
    truth = regular_s + rng.normal(0, 0.006, (landings, N_FEET))
    for foot in range(N_FEET):
        for contact_s in truth[:, foot]:
            own_speed = speed * (1 + 0.08 * rng.normal())
            before_s = contact_s - time
            is_up = (before_s > 0) & (before_s <= SWING_S)
            if falls:
                own = own_speed * before_s - GRAVITY_M_S2 / 2 * before_s**2
                heights[is_up, foot] = np.maximum(own[is_up], 0)
                continue
            own_acceleration = acceleration
            if acceleration is not None:
                own_acceleration = acceleration * (1 + 0.05 * rng.normal())
            since_s = SWING_S - before_s[is_up]
            heights[is_up, foot] = swing(since_s, own_speed, own_acceleration)
    heights += rng.normal(0, noise_m, heights.shape)
    return time, heights, truth


def of_feet(seed: int, **case: Any) -> pd.DataFrame:
    """Return a row for each foot of a recording: errors beside the stated ones, ms."""
    time, heights, truth = landing(seed, **case)
    no_gap = np.full(len(truth), 1 / case["rate_hz"])
    spans = Transitions(
        truth.min(axis=1) - 0.05, truth.max(axis=1) + 0.02, *[no_gap] * 2
    )
    found = find_contacts(time, heights, spans, down_height_m=DOWN_M)
    rows = []
    for foot in range(N_FEET):
        timed = found.status[:, foot] == LANDED
        errors_s = (found.instant - truth)[timed, foot]
        common_s = found.common[foot]
        stated_s = np.hypot(found.se[timed, foot], common_s)
        rows.append(
            {
                "timed": timed.mean(),
                "bias_ms": 1e3 * errors_s.mean(),
                "common_ms": 1e3 * common_s,
                "over_stated": np.sqrt(np.mean((errors_s / stated_s) ** 2)),
            }
        )
    return pd.DataFrame(rows)


def cases() -> list[dict[str, Any]]:
    """Return the cases that are tried."""
    swings = [(*one, False) for one in SWINGS]
    return [
        {
            "rate_hz": rate_hz,
            "noise_m": noise_m,
            "speed": speed,
            "acceleration": acceleration,
            "falls": falls,
        }
        for rate_hz, noise_m in CAMERAS
        for speed, acceleration, falls in [*swings, (FREE_FALL_M_S, None, True)]
    ]


def row_of(case: dict[str, Any], seeds: range, landings: int) -> dict[str, Any]:
    """Return the row of a case, over the seeds and the feet."""
    feet = pd.concat([of_feet(seed, landings=landings, **case) for seed in seeds])
    bias_ms = feet["bias_ms"]
    return {
        "rate_hz": case["rate_hz"],
        "noise_mm": 1e3 * case["noise_m"],
        "form": "free fall" if case["falls"] else "curved swing",
        "speed_m_s": case["speed"],
        "acceleration_m_s2": case["acceleration"],
        "least_timed": feet["timed"].min(),
        "bias_ms": bias_ms.median(),
        "bias_worst_ms": bias_ms.iloc[int(np.argmax(np.abs(bias_ms)))],
        "common_ms": feet["common_ms"].median(),
        "over_stated": feet["over_stated"].median(),
        "over_stated_worst": feet["over_stated"].max(),
    }


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--landings", type=int, default=40)
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + options.seeds)
    rows = [row_of(case, seeds, options.landings) for case in cases()]
    pd.DataFrame(rows).to_csv(options.out, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
