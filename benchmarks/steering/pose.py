"""Pose, boom angle and stances against truth, for whole recordings and frame by frame.

    python benchmarks/steering/pose.py --out pose.csv

`pose.csv` holds errors of heading, boom angle and place (mean body marker), rms over
frames, by estimator. In the scenes "tilted by", the body is tilted by a constant angle
in 24 directions; `bias` is the rms over these of the mean error, after subtracting the
best constant for all of them. The scenes "hopper" simulate the hopper with its boom
swinging through 67.5 degrees from eight angles. The recommended estimator is given
nothing but a recording. The phasors' heading and the printed boom angle have an
arbitrary zero, and the latter an arbitrary sense of rotation; both are removed.
`unknown` is the share of frames without a value.

`pose_stances.csv` holds consecutive stance pairs over all hops, compared with the true
landings. Pairs in which the hopper stumbles (not all feet stand at once, or it comes
from less than half the usual height) are counted separately. `instant_sd_ms` is the
error of the instants of the lowest points.

`pose_live.csv` holds stances detected frame by frame, with their delay after the true
lowest point.

`pose_time.csv` holds the processor time per frame.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import beside  # noqa: F401  finds `machine`
import numpy as np
import pandas as pd
from machine import quartiles

from hopdata.arrays import BoolArray, FloatArray
from hopdata.recording import Recording
from hopdata.rigid import headings, rigid_fit, twists, wrapped
from hopdata.scenes.body import rotation_matrices
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.steering.observation.calibration import algebraic_circle, calibrate
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.observe import (
    REST_FRAMES,
    phasor_poses,
    printed_boom_angles,
    printed_stance_pairs,
)
from hopdata.steering.observation.stances import StanceDetector, find_stances
from hopdata.steering.observation.tracking import (
    HopperTracker,
    hopper_motion,
    observe_frame,
)
from hopdata.synthesis.camera import (
    MarkerTracks,
    MotionCapture,
    draw_floor,
    track_markers,
)
from hopdata.synthesis.trial import (
    FloorOptions,
    GapOptions,
    MarkerOptions,
    Trial,
    run_trial,
)

# The steered hopper with its boom swinging to and fro, with true poses and landings.


SWING_RAD = np.deg2rad(67.5)
N_ANGLES = 8  # recordings start at this many boom angles, which cover the circle
FLAT = FloorOptions(bowl_depth_m=0.0, waves=0)
FINE_HZ = 1000.0  # rate at which the true lowest points are read


@dataclass(frozen=True)
class Swinging:
    """A trial with its markers before a camera sees it."""

    hopper: HopperParameters
    trial: Trial
    tracks: MarkerTracks

    @property
    def yaw(self) -> FloatArray:
        """Heading at each frame, rad."""
        return self.trial.states[:, 3]

    @property
    def boom_angle(self) -> FloatArray:
        """Boom angle at each frame, rad."""
        x, y = self.trial.boom[:, 0] - self.hopper.boom_offset_m, self.trial.boom[:, 1]
        return np.arctan2(y, x)


@dataclass(frozen=True)
class Landings:
    """True landings: lowest points, s, whether the next is one hop later, and which stumble."""

    lowest_s: FloatArray
    goes_on: BoolArray
    stumbles: BoolArray


def swinging(number: int, hops: int, rate_hz: float, seed: int) -> Swinging:
    """Simulate one of the recordings; the hops are the same at all frame rates."""
    hopper = HopperParameters(
        mass_kg=2.6, counterweight_mass_kg=0.1, inertia_z_kg_m2=0.04, damping_n_s_m=5.5,
        boom_angle_rad=2 * np.pi * number / N_ANGLES, boom_swing_rad=SWING_RAD,
        boom_duration_s=0.25,
    )  # fmt: skip
    rng = np.random.default_rng(np.random.SeedSequence([seed, number]))
    trial = run_trial(hopper, hops=hops, rate_hz=rate_hz, rng=rng)
    return Swinging(hopper, trial, track_markers(trial, hopper, MarkerOptions()))


def landings(number: int, hops: int, seed: int) -> Landings:
    """Return the true landings, read at a high frame rate.

    A landing stumbles if not all feet stood at once, or if it came from less than half
    the usual height.
    """
    fine = swinging(number, hops, FINE_HZ, seed)
    height = fine.tracks.positions[:, :3, 2].mean(axis=1)
    begins = fine.trial.hop_start_s
    ends = begins + [hop.end_time_s for hop in fine.trial.hops]
    first, last = np.ceil(begins * FINE_HZ).astype(int), (ends * FINE_HZ).astype(int)
    lowest = np.array(
        [i + np.argmin(height[i:j]) for i, j in zip(first, last, strict=True)]
    )
    rise = height[first] - np.median(height[lowest])
    stood = np.array([hop.all_stood() and not hop.fell for hop in fine.trial.hops])
    goes_on = np.append(np.abs(ends[:-1] - begins[1:]) < 1e-6, False)
    return Landings(lowest / FINE_HZ, goes_on, ~stood | (rise < 0.5 * np.median(rise)))


def filmed(
    scene: Swinging,
    seed: int,
    *,
    noise_m: float = 0.0006,
    gaps_per_min: float = 0.0,
    curved: bool = False,
    rest_first: bool = False,
) -> Recording:
    """Return what cameras see, optionally preceded by frames of the resting hopper."""
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]
    true, rate_hz = scene.tracks.positions, scene.trial.rate_hz
    if rest_first:
        true = np.concatenate([np.repeat(true[:1], REST_FRAMES, axis=0), true])
    gaps = GapOptions(rate_per_min=gaps_per_min)
    camera = MotionCapture(
        rate_hz=rate_hz, noise_m=noise_m, resolution_m=0.0, gaps=gaps
    )
    hidden = camera.draw_gaps(len(true), true.shape[1], streams[1])
    floor = draw_floor(FloorOptions() if curved else FLAT, streams[0])
    seen = camera.observe(true, floor, hidden, streams[2])
    time = np.arange(len(true)) / rate_hz
    return Recording(
        "swinging", time, seen, scene.tracks.names, scene.tracks.roles, rate_hz
    )


Row = dict[str, object]

# The conditions that are compared.

TILTS_RAD = (0.0, 0.05, 0.15, 0.3)
DIRECTIONS = 24
NEAR_S = 0.05  # an instant this close to a true one matches it


def rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def about_constant(error: FloatArray) -> FloatArray:
    """Return angular errors relative to their circular mean."""
    known = error[np.isfinite(error)]
    return wrapped(error - np.angle(np.mean(np.exp(1j * known))))


# Heading of a tilted body


def tilted(
    tilt_rad: float, frames: int, noise_m: float, seed: int
) -> tuple[FloatArray, ...]:
    """Return markers (N, B, 3), true yaw (N,) and the number of the tilt's direction (N,)."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, int(1000 * tilt_rad)]))
    direction = np.arange(frames) % DIRECTIONS
    angle = 2 * np.pi * direction / DIRECTIONS
    yaw = rng.uniform(-np.pi, np.pi, frames)
    pitch = np.arcsin(np.sin(tilt_rad) * np.cos(angle))  # the z-axis leans by the tilt
    roll = np.arcsin(np.sin(tilt_rad) * np.sin(angle) / np.cos(pitch))
    turn = rotation_matrices(np.column_stack([yaw, pitch, roll]))
    markers = np.einsum("nij,bj->nbi", turn, np.array(MarkerOptions().body_m))
    markers += rng.uniform(-1, 1, (frames, 1, 3))
    return markers + noise_m * rng.standard_normal(markers.shape), yaw, direction


def heading_estimates(
    body: FloatArray, geometry: HopperGeometry
) -> dict[str, FloatArray]:
    rotation = rigid_fit(body, geometry.body_m).rotation
    return {
        "phasors (printed)": phasor_poses(body)[:, 2],
        "rigid body, yaw of x (recommended)": headings(rotation),
        "rigid body, twist": twists(rotation),
    }


def heading_rows(geometry: HopperGeometry, frames: int, seed: int) -> Iterator[Row]:
    for tilt in TILTS_RAD:
        body, yaw, direction = tilted(tilt, frames, 0.0006, seed)
        for method, heading in heading_estimates(body, geometry).items():
            error = about_constant(wrapped(heading - yaw))
            means = np.array([error[direction == k].mean() for k in range(DIRECTIONS)])
            yield {
                "what": "heading_mrad", "method": method, "scene": f"tilted by {tilt:g} rad",
                "noise_mm": 0.6, "rms": 1e3 * rms(error), "bias": 1e3 * rms(means),
                "worst": 1e3 * float(np.abs(error).max()), "unknown": 0.0,
            }  # fmt: skip


# The hopper


def scored(
    what: str, method: str, scene: str, noise_mm: float, error: FloatArray
) -> Row:
    return {
        "what": what, "method": method, "scene": scene, "noise_mm": noise_mm,
        "rms": 1e3 * rms(error), "worst": 1e3 * float(np.nanmax(np.abs(error))),
        "unknown": float(np.mean(~np.isfinite(error))),
    }  # fmt: skip


HOPPER_SCENES: dict[str, dict[str, object]] = {
    "hopper": {},
    "hopper, curved floor": {"curved": True},
    "hopper, 6 gaps a minute": {"gaps_per_min": 6.0},
    "hopper, 30 gaps a minute": {"gaps_per_min": 30.0},
    "hopper, 1.2 mm": {"noise_m": 0.0012},
}


def hopper_errors(
    scene: Swinging, seed: int, options: dict[str, object]
) -> dict[str, FloatArray]:
    """Return errors of all estimators in all frames, rad and m, by "what; method"."""
    seen = filmed(scene, seed, **options)
    geometry = calibrate(seen)
    motion = hopper_motion(seen, geometry)
    phasors = phasor_poses(seen.body)
    resting = filmed(scene, seed, rest_first=True, **options)
    boom = resting.positions[:, resting.indices("boom")[0]]
    printed = printed_boom_angles(resting.body, boom)[-len(seen.time) :]
    senses = [about_constant(wrapped(s * printed - scene.boom_angle)) for s in (1, -1)]
    middle = scene.tracks.positions[:, :3].mean(axis=1)
    leaned = motion.status == "leaned on an earlier frame"
    heading = wrapped(motion.pose[:, 2] - scene.yaw)
    recommended = "rigid body, yaw of x (recommended)"
    return {
        "heading_mrad; phasors (printed)": about_constant(
            wrapped(phasors[:, 2] - scene.yaw)
        ),
        f"heading_mrad; {recommended}": heading,
        "heading_mrad; two markers and a frame near in time": heading[leaned],
        "place_mm; mean marker (printed)": np.linalg.norm(
            phasors[:, :2] - middle[:, :2], axis=1
        ),
        "place_mm; rigid body (recommended)": np.linalg.norm(
            motion.pose[:, :2] - middle[:, :2], axis=1
        ),
        "boom_mrad; printed": min(senses, key=rms),
        "boom_mrad; rigid body, geometric circle (recommended)": wrapped(
            motion.boom_angle_rad - scene.boom_angle
        ),
        "boom_mrad; rigid body, algebraic circle": wrapped(
            algebraic_boom(seen, geometry) - scene.boom_angle
        ),
    }


def algebraic_boom(seen: Recording, geometry: HopperGeometry) -> FloatArray:
    """Return the boom angle about the centre of an algebraic circle in the same plane."""
    fit = rigid_fit(seen.body, geometry.body_m)
    boom = seen.positions[:, seen.indices("boom")[0]]
    places = np.einsum("nji,nj->ni", fit.rotation, boom - fit.centre)
    flat = places @ geometry.circle.axes.T
    known = np.isfinite(flat).all(axis=1)
    arms = flat - algebraic_circle(flat[known])[0]
    return np.arctan2(arms[:, 1], arms[:, 0])


def hopper_rows(scenes: list[Swinging], seed: int) -> Iterator[Row]:
    for name, options in HOPPER_SCENES.items():
        parts = [
            hopper_errors(scene, seed + k, options) for k, scene in enumerate(scenes)
        ]
        noise_mm = 1e3 * float(options.get("noise_m", 0.0006))
        for key in parts[0]:
            what, method = key.split("; ")
            error = np.concatenate([part[key] for part in parts])
            if error.size:
                yield scored(what, method, name, noise_mm, error)
            if what == "boom_mrad":
                worst = max((part[key] for part in parts), key=rms)
                yield scored(
                    what, method, f"{name}: worst of {N_ANGLES} arcs", noise_mm, worst
                )


# Stances


STANCE_SCENES: dict[str, dict[str, object]] = {
    "100 Hz": {},
    "50 Hz": {"rate_hz": 50.0},
    "200 Hz": {"rate_hz": 200.0},
    "100 Hz, 1.2 mm": {"noise_m": 0.0012},
    "100 Hz, curved floor": {"curved": True},
    "100 Hz, 6 gaps a minute": {"gaps_per_min": 6.0},
    "100 Hz, 30 gaps a minute": {"gaps_per_min": 30.0},
}


def film(number: int, hops: int, seed: int, options: dict[str, object]) -> Recording:
    rate_hz = float(options.get("rate_hz", 100.0))
    rest = {name: value for name, value in options.items() if name != "rate_hz"}
    return filmed(swinging(number, hops, rate_hz, seed), seed + number, **rest)


def printed(seen: Recording, *, derivative: int) -> FloatArray:
    return seen.time[printed_stance_pairs(seen.body_height, derivative=derivative)]


def recommended(seen: Recording) -> FloatArray:
    geometry = calibrate(seen)
    motion = hopper_motion(seen, geometry)
    stances = find_stances(motion.time, motion.height, geometry)
    return stances.time_s[stances.pairs]


STANCE_METHODS: dict[str, Callable[[Recording], FloatArray]] = {
    "printed, literally": lambda seen: printed(seen, derivative=2),
    "printed": lambda seen: printed(seen, derivative=1),
    "recommended": recommended,
}


def pair_counts(
    instants: FloatArray, true: Landings
) -> tuple[dict[str, int], FloatArray]:
    """Compare pairs (P, 2) of instants with the landings; return counts and errors, s."""
    near = np.abs(instants[..., None] - true.lowest_s).argmin(axis=-1).reshape(-1, 2)
    error = instants - true.lowest_s[near]
    hit = (np.abs(error) < NEAR_S).all(axis=1)
    found = {(int(a), int(b)) for (a, b), good in zip(near, hit, strict=True) if good}
    stumble = true.stumbles
    whole = {(int(k), int(k) + 1) for k in np.flatnonzero(true.goes_on)}
    stumbling = {pair for pair in whole if stumble[list(pair)].any()}
    odd = {pair for pair in found - whole if stumble[pair[0] : pair[1] + 1].any()}
    counts = {
        "pairs": len(whole - stumbling),
        "found": len(found & whole - stumbling),
        "missed": len(whole - stumbling - found),
        "invented": len(instants) - len(found & whole) - len(odd),
        "stumbling": len(stumbling),
        "stumbling_found": len(found & stumbling),
        "stumbling_invented": len(odd),
    }
    return counts, error[hit].ravel()


def stance_rows(truths: list[Landings], hops: int, seed: int) -> Iterator[Row]:
    for name, options in STANCE_SCENES.items():
        films = [film(k, hops, seed, options) for k in range(len(truths))]
        for method, find in STANCE_METHODS.items():
            both = [
                pair_counts(find(one), true)
                for one, true in zip(films, truths, strict=True)
            ]
            total = pd.DataFrame([counts for counts, _ in both]).sum().to_dict()
            error = 1e3 * np.concatenate([errors for _, errors in both])
            yield {
                "scene": name, "method": method, **total,
                "instant_bias_ms": error.mean() if error.size else np.nan,
                "instant_sd_ms": error.std() if error.size else np.nan,
                "instant_worst_ms": np.abs(error).max() if error.size else np.nan,
            }  # fmt: skip


# Live


LIVE_SCENES: dict[str, dict[str, object]] = {
    "100 Hz": {},
    "100 Hz, 1 % dropped, 6 gaps a minute": {"dropped": 0.01, "gaps_per_min": 6.0},
    "100 Hz, 5 % dropped, 30 gaps a minute": {"dropped": 0.05, "gaps_per_min": 30.0},
    "100 Hz, 1 % of frames off by 0.2 m": {"jumping": 0.01},
    "100 Hz, 1.2 mm": {"noise_m": 0.0012},
    "50 Hz": {"rate_hz": 50.0},
    "200 Hz": {"rate_hz": 200.0},
}


def told(seen: Recording, *, dropped: float, jumping: float, seed: int) -> FloatArray:
    """Feed tracker and detector frame by frame; return reported instants and delays, (S, 2)."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 3]))
    geometry = calibrate(seen)
    tracker = HopperTracker(geometry, seen.markers)
    detector = StanceDetector(geometry, rate_hz=seen.rate_hz)
    off = np.where(
        rng.random(len(seen.time)) < jumping, rng.choice([-0.2, 0.2], len(seen.time)), 0
    )
    stances = []
    for k in np.flatnonzero(rng.random(len(seen.time)) >= dropped):
        height = tracker.feed(seen.time[k], seen.positions[k]).height_m + off[k]
        stance = detector.feed(seen.time[k], height)
        if stance is not None:
            stances.append((stance.time_s, stance.recognised_s))
    return np.array(stances)


def live_rows(truths: list[Landings], hops: int, seed: int) -> Iterator[Row]:
    for name, options in LIVE_SCENES.items():
        faults = {key: float(options.get(key, 0.0)) for key in ("dropped", "jumping")}
        camera = {key: value for key, value in options.items() if key not in faults}
        counts = dict.fromkeys(
            ("landings", "missed", "double", "invented", "stumbles", "told"), 0
        )
        delays, errors = [], []
        for k, true in enumerate(truths):
            stances = told(film(k, hops, seed, camera), seed=seed + k, **faults)
            near = np.abs(stances[:, :1] - true.lowest_s).argmin(axis=1)
            error = stances[:, 0] - true.lowest_s[near]
            hit = np.abs(error) < NEAR_S
            times = np.bincount(near[hit], minlength=len(true.lowest_s))
            counts["landings"] += int(np.sum(~true.stumbles))
            counts["missed"] += int(np.sum(times[~true.stumbles] == 0))
            counts["double"] += int(np.sum(times > 1))
            counts["invented"] += int(np.sum(~hit))
            counts["stumbles"] += int(true.stumbles.sum())
            counts["told"] += len(stances)
            delays.append(stances[hit, 1] - true.lowest_s[near[hit]])
            errors.append(error[hit])
        delay, error = 1e3 * np.concatenate(delays), 1e3 * np.concatenate(errors)
        yield {
            "scene": name, **counts, "delay_median_ms": np.median(delay),
            "delay_p99_ms": np.percentile(delay, 99), "delay_max_ms": delay.max(),
            "within_40_ms": np.mean(delay <= 40.0), "instant_sd_ms": error.std(),
        }  # fmt: skip


# Time


def time_rows(seen: Recording, frames: int = 300) -> Iterator[Row]:
    from scipy.spatial.transform import Rotation

    geometry = calibrate(seen)
    positions, body = seen.positions[:frames], seen.body[:frames]
    boom = positions[:, seen.indices("boom")[0]]
    n_all = len(seen.time)
    tracker = HopperTracker(geometry, seen.markers)

    def align() -> None:
        for frame in body:
            Rotation.align_vectors(frame - frame.mean(axis=0), geometry.body_m)

    def track() -> None:
        for time, frame in zip(seen.time[:frames], positions, strict=True):
            tracker.feed(time, frame)

    def observe() -> None:
        for frame, marker in zip(body, boom, strict=True):
            observe_frame(geometry, frame, marker)

    def detect() -> None:
        detector = StanceDetector(geometry)
        for time, height in zip(
            seen.time[:frames], body[:, :, 2].mean(axis=1), strict=True
        ):
            detector.feed(time, height)

    runs = {
        "observe_frame: pose, boom angle, checks": (observe, frames),
        "HopperTracker.feed: the same, following": (track, frames),
        "StanceDetector.feed": (detect, frames),
        "scipy Rotation.align_vectors: the rotation alone": (align, frames),
        "hopper_motion: a whole recording at once": (lambda: hopper_motion(seen, geometry), n_all),
    }  # fmt: skip
    times = quartiles({name: run for name, (run, _) in runs.items()})
    for name, (_, count) in runs.items():
        low, middle, high = (1e6 * value / count for value in times[name])
        yield {"what": name, "us_per_frame": middle, "us_low": low, "us_high": high}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV to write")
    parser.add_argument(
        "--hops", type=int, default=375, help=f"hops of each of {N_ANGLES} trials"
    )
    parser.add_argument("--frames", type=int, default=48000, help="frames of each tilt")
    parser.add_argument("--seed", type=int, default=20261121)
    arguments = parser.parse_args()
    hops, seed = arguments.hops, arguments.seed
    scenes = [swinging(k, hops, 100.0, seed) for k in range(N_ANGLES)]
    truths = [landings(k, hops, seed) for k in range(N_ANGLES)]
    first = filmed(scenes[0], seed)
    geometry = calibrate(first)
    out: Path = arguments.out
    tables = {
        out: chain(
            heading_rows(geometry, arguments.frames, seed), hopper_rows(scenes, seed)
        ),
        out.with_name(f"{out.stem}_stances.csv"): stance_rows(truths, hops, seed),
        out.with_name(f"{out.stem}_live.csv"): live_rows(truths, hops, seed),
        out.with_name(f"{out.stem}_time.csv"): time_rows(first.part(slice(20000))),
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    for path, rows in tables.items():
        found = []
        for row in rows:
            print(*row.values(), sep=", ", flush=True)
            found.append(row)
        table = pd.DataFrame(found)
        print(table.round(3).to_string(index=False), flush=True)
        table.to_csv(path, index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
