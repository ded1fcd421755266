"""Models of the frame change: how well they predict, from how many hops, and what they cost.

    python benchmarks/steering/frame_change_models.py --out frame_change_models.csv

The steered hopper is excited at random as printed (Algorithm 1) and observed by motion
capture: markers with noise, poses and boom angles by `hopdata.steering.observation`.
Each model learns from 100 random hops of one recording, with one draw per recording. It
is tested on the other hops of that recording ("rest"), on a recording with swings of
any size ("any swing"), and on the true map of an undisturbed hopper ("true map").

Beside `frame_change_models.csv`, it writes:

- `frame_change_learning.csv`: the error by the number of hops, with all recordings
  pooled, tested on the other hops.
- `frame_change_kernels.csv`: four smoothnesses of the kernel in the readings of Section
  3.4.2, on the hopper and on analytic functions.
- `frame_change_cost.csv`: time of a prediction by the processes and by their table,
  and the table's largest error.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import beside  # noqa: F401  finds `machine`
import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from machine import quartiles
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.rigid import wrapped
from hopdata.steering.excitation import ControlGrid, random_excitation
from hopdata.steering.experiments.outcomes import SAME_STANCE_S
from hopdata.steering.frame_changes import (
    FrameChanges,
    StanceStates,
    frame_changes,
)
from hopdata.steering.models.learning import (
    IN_UNITS,
    UNITS,
    learning_scores,
    prediction_score,
    random_split,
    smooth_truth,
    smoothness_scores,
    with_intervals,
)
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.models.stride_table import StrideTable
from hopdata.steering.models.training import (
    PRINTED,
    RECOMMENDED,
    trained_process,
    training_set,
)
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.observe import observe_stances
from hopdata.steering.robot import SteeredHopper
from hopdata.steering.strides import joined
from hopdata.steering.trial import (
    POSE,
    SteeredTrial,
    TrueFrameChanges,
    record_trial,
    true_frame_changes,
)

ROBOT = SteeredHopper()
LIMIT = ROBOT.swing_limit_rad
TRAIN = 100
MODELS = {
    "printed": PRINTED,
    "copies": replace(RECOMMENDED, periodic=False),
    "recommended": RECOMMENDED,
}
CURVES = ("printed", "recommended")
SIZES = (20, 35, 60, 100, 170, 300)
SCORES = ("r2", "rmse", "coverage")
BOOM_WINDOW_S = 0.11  # window after the stance (printed: 11 frames at 100 Hz)


# Printed frame changes, errors against the true ones, closed-form derivatives of
# models, and scikit-learn's regressor.


def frame_changes_at_frames(
    pairs: ArrayLike,
    poses: ArrayLike,
    boom_angles_rad: ArrayLike,
    *,
    rate_hz: float,
    swing_limit_rad: float,
    recording: str = "",
) -> FrameChanges:
    """Collect printed frame changes: poses of single frames, boom angles of the next 11 frames.

    Parameters
    ----------
    pairs : (P, 2) array of int
        Frames of stances that are one hop apart.
    poses, boom_angles_rad : (N, 3) and (N,) arrays
        Pose and boom angle of every frame, as for `frame_changes`.
    rate_hz : float
        Frames per second.
    swing_limit_rad, recording
        See `frame_changes`.
    """
    every = np.asarray(poses, dtype=float)
    frames, stances = np.unique(np.reshape(pairs, (-1, 2)), return_inverse=True)
    window = max(1, round(BOOM_WINDOW_S * rate_hz))
    booms = stance_boom_angles(boom_angles_rad, frames, window)
    of = (frames / rate_hz, every[frames], booms, stances.reshape(-1, 2))
    states = StanceStates(*of, tilt_rad=np.full(len(frames), np.nan))
    return frame_changes(states, swing_limit_rad=swing_limit_rad, recording=recording)


def true_pairs(stances: pd.DataFrame) -> IntArray:
    """Return the frames (P, 2) of stances that are one hop apart, from `SteeredTrial.stances`."""
    frame, second = stances["frame"].to_numpy() - 1, np.flatnonzero(stances["follows"])
    return np.column_stack([frame[second - 1], frame[second]])


def stance_boom_angles(
    booms_rad: ArrayLike, frames: ArrayLike, window: int
) -> FloatArray:
    """Return the median boom angle of the frames that follow each stance, (S,), rad.

    Angles are taken relative to their mean direction, so that they may pass a full
    turn. The result is NaN if fewer than half of the frames have an angle.
    """
    booms, frames = np.asarray(booms_rad, dtype=float), np.asarray(frames)
    padded = np.append(booms, np.full(window, np.nan))
    near = padded[frames[:, None] + 1 + np.arange(window)]
    few = np.isfinite(near).sum(axis=1) < (window + 1) // 2
    near[few] = 0.0
    direction = np.nansum(np.exp(1j * near), axis=1)
    centre = np.angle(direction)
    angle = centre + np.nanmedian(wrapped(near - centre[:, None]), axis=1)
    return np.where(few, np.nan, angle)


@dataclass(frozen=True)
class FrameChangeErrors:
    """Errors of the hops that were found.

    Parameters
    ----------
    boom_angle_rad, swing_rad : (n,) arrays
        Measured minus true.
    change : (n, 3) array
        Measured minus true, m, m, rad.
    missed, invented : int
        True hops without a measured one, and measured ones without a true one.
    """

    boom_angle_rad: FloatArray
    swing_rad: FloatArray
    change: FloatArray
    missed: int
    invented: int

    def rms(self) -> dict[str, float]:
        """Return root mean square errors by name; the names contain the unit."""
        columns = {
            "boom_angle_rad": self.boom_angle_rad,
            "swing_rad": self.swing_rad,
            **dict(zip(("dx_m", "dy_m", "dtheta_rad"), self.change.T, strict=True)),
        }
        return {
            name: float(np.sqrt(np.mean(error**2))) for name, error in columns.items()
        }


def frame_change_errors(
    measured: FrameChanges, true: FrameChanges
) -> FrameChangeErrors:
    """Compare the used hops of a recording with the true ones.

    Parameters
    ----------
    measured, true : FrameChanges
        Hops of one recording in order of time. Two hops are the same if their first
        stances are within `SAME_STANCE_S` of each other.
    """
    seen, real = measured.used(), true.used()
    if not len(seen) or not len(real):
        empty = np.zeros(0)
        return FrameChangeErrors(empty, empty, np.zeros((0, 3)), len(real), len(seen))
    nearest = np.abs(seen.time_s[:, None] - real.time_s).argmin(axis=1)
    matched = np.abs(seen.time_s - real.time_s[nearest]) <= SAME_STANCE_S
    _, first = np.unique(nearest[matched], return_index=True)
    found = np.flatnonzero(matched)[first]
    a, b = seen.rows(found), real.rows(nearest[found])
    change = a.change - b.change
    change[:, 2] = wrapped(change[:, 2])
    return FrameChangeErrors(
        boom_angle_rad=wrapped(a.boom_angle_rad - b.boom_angle_rad),
        swing_rad=wrapped(a.swing_rad - b.swing_rad),
        change=change,
        missed=len(real) - len(found),
        invented=len(seen) - len(found),
    )


# Recordings, models and their scores.


def observed(trial: SteeredTrial, name: str) -> FrameChanges:
    """Return the frame changes that motion capture sees."""
    states = observe_stances(trial.recording, calibrate(trial.recording))
    return frame_changes(states, swing_limit_rad=LIMIT, recording=name)


def true_hops(trial: SteeredTrial, name: str) -> FrameChanges:
    """Return the frame changes that truly happened."""
    return frame_changes_at_frames(
        true_pairs(trial.stances),
        trial.motion[POSE].to_numpy(),
        trial.motion["boom_angle_rad"].to_numpy(),
        rate_hz=trial.recording.rate_hz,
        swing_limit_rad=LIMIT,
        recording=name,
    )


def excited(seed: int, recordings: int) -> Iterator[SteeredTrial]:
    """Record the hopper with the printed excitation."""
    for stream in np.random.SeedSequence(seed).spawn(recordings):
        swings = random_excitation(ControlGrid(), np.random.default_rng(stream))
        yield record_trial(ROBOT, swings, seed=stream.generate_state(2).tolist())


def any_swing(seed: int, hops: int) -> FrameChanges:
    """Record the hopper with swings of any size."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 1]))
    return observed(
        record_trial(ROBOT, rng.uniform(-LIMIT, LIMIT, hops), seed=[seed, 2]), "any"
    )


def measurement_rows(
    trials: list[SteeredTrial], seen: list[FrameChanges]
) -> list[dict[str, Any]]:
    """Return errors of the measured frame changes themselves."""
    found = [
        frame_change_errors(hops, true_hops(trial, ""))
        for trial, hops in zip(trials, seen, strict=True)
    ]
    rms = np.array(
        [[e.rms()[name] for name in ("dx_m", "dy_m", "dtheta_rad")] for e in found]
    )
    print("missed, invented:", [(e.missed, e.invented) for e in found])
    return [
        {
            "model": "measurement",
            "test": "truth",
            "component": component,
            "unit": unit,
            "draw": draw,
            "rmse": value,
        }
        for draw, row in enumerate(rms * IN_UNITS)
        for component, unit, value in zip(
            ("dx", "dy", "dtheta"), UNITS, row, strict=True
        )
    ]


def on_true_map(process: FrameChangeProcess, true: TrueFrameChanges) -> FloatArray:
    """Return predicted minus true frame changes, averaged over what came before, (A * S, 3)."""
    mesh = np.meshgrid(true.boom_angle_rad, true.swing_rad, indexing="ij")
    predicted = process.change(*(axis.ravel() for axis in mesh))
    return predicted - true.average().reshape(-1, 3)


def true_map_rows(
    process: FrameChangeProcess, true: TrueFrameChanges, labels: dict[str, Any]
) -> list[dict[str, Any]]:
    square = np.mean(on_true_map(process, true) ** 2, axis=0)
    r2 = 1 - square / true.average().reshape(-1, 3).var(axis=0)
    rmse = np.sqrt(square) * IN_UNITS
    rows = zip(("dx", "dy", "dtheta"), UNITS, r2, rmse, strict=True)
    names = ("component", "unit", "r2", "rmse")
    return [{**labels, **dict(zip(names, row, strict=True))} for row in rows]


def model_rows(
    seen: list[FrameChanges], other: FrameChanges, true: TrueFrameChanges, seed: int
) -> Iterator[dict[str, Any]]:
    """Score all models, each trained on a part of each recording."""
    for draw, hops in enumerate(seen):
        usable = hops.used()
        rng = np.random.default_rng(np.random.SeedSequence([seed, draw, 3]))
        train, rest = random_split(len(usable), TRAIN, rng)
        for name, options in MODELS.items():
            process = trained_process(usable.rows(train), options, seed=draw)
            for test, data in (
                ("rest", usable.rows(rest)),
                ("any swing", other.used()),
            ):
                score = prediction_score(process, data)
                labels = {"model": name, "test": test, "draw": draw}
                yield from pd.DataFrame({**labels, **score}).to_dict("records")
            labels = {"model": name, "test": "true map", "draw": draw}
            yield from true_map_rows(process, true, labels)


def kernel_table(hops: FrameChanges, draws: int, seed: int) -> pd.DataFrame:
    """Compare the smoothnesses on the hopper and on analytic functions."""
    parts = []
    for name, data in (
        ("hopper", hops),
        ("smooth truth", smooth_truth(400, LIMIT, seed)),
    ):
        scores = smoothness_scores(data, draws=draws, seed=seed, train=TRAIN)
        parts.append(scores.assign(data=name))
    by = ["data", "reading", "smoothness", "component", "unit"]
    return with_intervals(pd.concat(parts), by, SCORES)


def tabulation_error(
    table: StrideTable, model: FrameChangeProcess, *, points: int = 2000, seed: int = 0
) -> FloatArray:
    """Return the largest error (3,) of a table at random points, m, m, rad."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    angle = rng.uniform(0, 2 * np.pi, points)
    swing = rng.uniform(table.axes.lower, table.axes.upper, points)
    error = table.change(angle, swing) - model.change(angle, swing)
    return np.asarray(np.abs(error).max(axis=0))


def cost_rows(
    hops: FrameChanges, other: FrameChanges, seed: int
) -> Iterator[dict[str, Any]]:
    """Yield the time of each way to ask a model, and the largest error of its table."""
    swing_limits = np.array([LIMIT])
    for name in ("printed", "recommended"):
        process = trained_process(hops, MODELS[name], seed=seed)
        table = process.within(-swing_limits, swing_limits)
        largest = tabulation_error(table, process)
        for n in (1, 1000):
            angles, swings = np.resize(training_set(other)[0], (n, 2)).T.copy()
            runs: dict[str, Callable[[], object]] = {
                "table": partial(table.change, angles, swings),
                "process": partial(process.change, angles, swings),
                "process, sd": partial(process.sd, angles, swings),
            }
            times = quartiles(runs, fewest=5, most=31)
            slowest = times["process"][1]
            for way, (low, median, high) in times.items():
                row = {
                    "model": name,
                    "training_points": len(process.points),
                    "points": n,
                    "way": way,
                    "us_per_point": 1e6 * median / n,
                    "us_q25": 1e6 * low / n,
                    "us_q75": 1e6 * high / n,
                    "times_faster": slowest / median,
                }
                if way == "table":
                    row["table_error_mm"] = 1e3 * largest[:2].max()
                    row["table_error_mrad"] = 1e3 * largest[2]
                yield row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--out", type=Path, required=True, help="CSV to write, others beside it"
    )
    parser.add_argument("--recordings", type=int, default=12)
    parser.add_argument("--draws", type=int, default=8, help="random sets of each size")
    parser.add_argument("--seed", type=int, default=20261121)
    arguments = parser.parse_args()
    seed, draws = arguments.seed, arguments.draws

    def write(name: str, table: pd.DataFrame) -> None:
        print(f"{name}\n{table.head(80).to_string(index=False)}", flush=True)
        table.to_csv(arguments.out.with_name(name), index=False, float_format="%.6g")

    trials = list(excited(seed, arguments.recordings))
    seen = [observed(trial, f"trial {k}") for k, trial in enumerate(trials)]
    other, true = (
        any_swing(seed, 600),
        true_frame_changes(ROBOT, boom_angles=24, swings=9),
    )
    rows = [*measurement_rows(trials, seen), *model_rows(seen, other, true, seed)]
    by = ["model", "test", "component", "unit"]
    write(arguments.out.name, with_intervals(pd.DataFrame(rows), by, SCORES))
    pool = joined(seen)
    first = seen[0].used()
    chosen, _ = random_split(len(first), TRAIN, np.random.default_rng(seed))
    write(
        "frame_change_cost.csv",
        pd.DataFrame(cost_rows(first.rows(chosen), other, seed)),
    )
    models = {name: MODELS[name] for name in CURVES}
    scores = learning_scores(pool, models, SIZES, draws=draws, seed=seed)
    curve = with_intervals(scores, ["model", "hops", "component", "unit"], SCORES)
    write("frame_change_learning.csv", curve)
    write("frame_change_kernels.csv", kernel_table(pool, draws, seed))


if __name__ == "__main__":
    main()
