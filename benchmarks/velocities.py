"""Velocities and positions at the sections against truth: the split fit and the filter.

    python benchmarks/velocities.py --out velocities.csv

One scene is the hopper (true states by integration; contacts as `touchdown_table` finds
them) at three frame rates and three levels of noise, with a gap of three frames of one
marker at each crossing, and with sections near the contacts. The other is a body that
tumbles in free flight at 2, 4 and 8 rad/s about random axes, with its centre of mass 50
mm away from the middle of the markers.

Each row is one side of one scene by one method, in world coordinates: `split_fit` with
its defaults; with gravity `known` or `free`; `alone` (each landing fitted by itself, as
for few landings); `rigid`, the default's states made those of a rigid body; and
`savitzky_golay`. `contact_ms` is the median time between crossing and contact.
`chi_square` is the mean square of velocity errors over their standard errors,
`within_se` the share of errors below these (0.683 if normal), and `times_below_filter`
the filter's rms error over that of the row. `lost` is the share of crossings without a
state.

`map_error.csv`, beside it, holds the error of the estimated landing map against the
exact one, by number of landings and noise.

One recording of the C1 hopper on a flat floor, as long as the dissertation's four
together, is seen with four levels of noise (the same draws, scaled), at the sections of
the study `thesis`. States at the sections are fitted piecewise, split at the contacts
(`split_fit`, our default), or by a cubic over seven frames (`savitzky_golay`), which is
noisier. Each estimator of `hopdata.maps.corrected.estimates` is fitted to random
landings; the last size uses all of them.

A third table, `map_error_spread.csv`, uses true states whose deviations from the
simultaneous landing are scaled down. Without noise only curvature remains, which
vanishes with the spread.

Errors are relative differences of predictions for the true inputs
(`hopdata.maps.truth.maps`), with velocities weighted by the time unit that the study
`thesis` finds, 13.7 ms: medians over the draws, with their 5 and 95 % quantiles.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hopdata.arrays import FloatArray
from hopdata.landings.states.assemble import assemble_pairs
from hopdata.landings.states.crossing import SectionStates, cross
from hopdata.landings.states.fits import Tracks, alone, section_states
from hopdata.landings.touchdowns import touchdown_table
from hopdata.maps.coordinates import output_weights, rigid_states, split_states
from hopdata.maps.corrected.estimates import estimate_maps
from hopdata.maps.corrected.regression import curved_map, ols_map
from hopdata.maps.truth.maps import exact_map, input_root, relative_difference
from hopdata.maps.truth.scoring import match_landings
from hopdata.recording import Recording
from hopdata.rigid import body_shape
from hopdata.scenes.scene import Control
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.scaling import (
    exact_maps,
    known_scene,
    scaled_landings,
    true_states,
)
from hopdata.synthesis.simulate import simulate_recording
from hopdata.truth import Truth

PRE_M, POST_M = 0.502, 0.2815  # sections of the study `thesis`
NEAR_PRE_M, LATE_POST_M = 0.42, 0.265
FLAT = {"bowl_depth_m": 0.0, "wave_amplitude_m": 0.0}
GRAVITY_M_S2 = 9.80665
BODY_M = np.array([[0.1, 0.0, 0.0], [-0.05, 0.09, 0.0], [-0.05, -0.09, 0.0]])
OFF_CENTRE_M = np.array([0.03, 0.0, 0.04])


@dataclass(frozen=True)
class Crossings:
    """Observed crossings (L) of a section, and true positions and velocities (L, B, 3) there."""

    time: FloatArray
    body: FloatArray
    near: FloatArray
    contact: FloatArray
    height_m: float
    side: str
    position: FloatArray
    velocity: FloatArray


def by_section_states(seen: Crossings, **options: str) -> SectionStates:
    """Return the states by one of the library's methods."""
    return section_states(
        seen.time, seen.body, seen.near,
        height_m=seen.height_m, side=seen.side, contact=seen.contact, **options,
    )  # fmt: skip


def each_alone(seen: Crossings) -> SectionStates:
    """Return the states with each landing fitted for itself."""
    tracks = Tracks(
        seen.time, seen.body, seen.near, seen.contact, seen.side == "before"
    )
    return cross(alone(tracks, None)(), seen.near, seen.height_m)


def made_rigid(seen: Crossings) -> SectionStates:
    """Return the default's states projected onto a rigid body, without errors."""
    found = by_section_states(seen)
    known = np.isfinite(found.velocity).all(axis=(1, 2))
    flat = np.concatenate([found.position, found.velocity], axis=1)[known].reshape(
        known.sum(), -1
    )
    shape = body_shape(split_states(flat)[0])
    rigid = rigid_states(flat, shape)
    arms = np.einsum("nij,bj->nbi", rigid.rotation, shape)
    turning = np.einsum("nij,nj->ni", rigid.rotation, rigid.spin)
    position, velocity = (
        np.full_like(found.position, np.nan),
        np.full_like(found.velocity, np.nan),
    )
    position[known] = rigid.centre[:, None] + arms
    velocity[known] = rigid.velocity[:, None] + np.cross(turning[:, None], arms)
    unknown = np.full_like(found.position_covariance, np.nan)
    return SectionStates(found.time, position, velocity, unknown, unknown)


METHODS: dict[str, Callable[[Crossings], SectionStates]] = {
    "savitzky_golay": partial(by_section_states, method="savitzky_golay"),
    "split_fit": by_section_states,
    "split_fit, known": partial(by_section_states, gravity="known"),
    "split_fit, free": partial(by_section_states, gravity="free"),
    "alone": each_alone,
    "rigid": made_rigid,
}


def hopper(
    recording: Recording, truth: Truth, pre_m: float = PRE_M, post_m: float = POST_M
) -> Iterator[Crossings]:
    """Yield the crossings of both sections that are used and whose truth is known."""
    scene = known_scene(truth)
    true = true_states(truth, scene, SectionHeights(pre_m, post_m, scene.body_points_m))
    table = touchdown_table(recording, pre_height_m=pre_m, post_height_m=post_m)
    used = table[~table["excluded"].astype(bool)]
    contacts = used[[f"contact_{foot}_s" for foot in recording.names("foot")]].to_numpy(
        float
    )
    landing = match_landings(contacts, truth.contact_times)
    place = {int(number) - 1: row for row, number in enumerate(true.touchdown)}
    row = np.array([place.get(int(number), -1) for number in landing])
    known = row >= 0
    for side, column, height_m, contact, states in (
        ("before", "t_pre_s", pre_m, contacts.min(axis=1), true.x),
        ("after", "t_post_s", post_m, contacts.max(axis=1), true.y),
    ):
        position, velocity = split_states(states[row[known]])
        yield Crossings(
            recording.time, recording.body, used[column].to_numpy()[known], contact[known],
            height_m, side, position, velocity,
        )  # fmt: skip


def simulated(hops: int, rate_hz: float, seed: int) -> tuple[Recording, Truth]:
    """Simulate the hopper without noise on a flat floor."""
    camera = {"noise_m": 0.0, "resolution_m": 0.0, "floor": FLAT, "rate_hz": rate_hz}
    return simulate_recording({"hops": hops}, camera, seed=seed)


def noisy(recording: Recording, noise_mm: float, seed: int) -> Recording:
    """Return the recording with noise on every coordinate."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    noise = 1e-3 * noise_mm * rng.standard_normal(recording.positions.shape)
    return replace(recording, positions=recording.positions + noise)


def with_gaps(seen: Crossings) -> Crossings:
    """Return the crossings with the second marker unseen in the three frames about each."""
    body = seen.body.copy()
    middle = np.searchsorted(seen.time, seen.near)
    for shift in (-1, 0, 1):
        body[middle + shift, 1] = np.nan
    return replace(seen, body=body)


def tumbling(
    falls: int, rate_hz: float, noise_mm: float, spin_rad_s: float, seed: int
) -> Crossings:
    """Drop a round body that spins about random axes; each fall ends with a contact."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2,)))
    tau = np.arange(-0.2, 0.06, 1 / rate_hz) + rng.uniform(0, 1 / rate_hz, (falls, 1))
    axis = rng.standard_normal((falls, 3))
    spin = spin_rad_s * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    start = rng.normal(0, 0.3, (falls, 3)) * [1, 1, 0] + [0, 0, -1.5]
    arms = BODY_M - OFF_CENTRE_M
    turned = _turned(spin[:, None] * tau[..., None], arms)  # (L, W, B, 3)
    fall = (
        start[:, None] * tau[..., None]
        + [0, 0, -0.5 * GRAVITY_M_S2] * tau[..., None] ** 2
    )
    tracks = 1.0 + fall[:, :, None] + turned
    tracks += 1e-3 * noise_mm * rng.standard_normal(tracks.shape)
    now = np.broadcast_to(arms, (falls, *arms.shape))
    begin = np.arange(falls, dtype=float)
    return Crossings(
        time=(begin[:, None] + tau).ravel(),
        body=tracks.reshape(-1, *arms.shape),
        near=begin,
        contact=begin + rng.uniform(0.02, 0.06, falls),
        height_m=float(1.0 + arms[:, 2].mean()),
        side="before",
        position=1.0 + now,
        velocity=start[:, None] + np.cross(spin[:, None], now),
    )


def _turned(vectors: FloatArray, arms: FloatArray) -> FloatArray:
    """Turn arms (B, 3) by rotation vectors (..., 3), by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    axis = vectors[..., None, :] / np.where(angle > 0, angle, 1.0)
    across = np.cross(axis, arms)
    return arms + np.sin(angle) * across + (1 - np.cos(angle)) * np.cross(axis, across)


def measure(seen: Crossings) -> pd.DataFrame:
    """Return one row per method."""
    rows = []
    for name, method in METHODS.items():
        if seen.side == "after" and "," in name:
            continue
        found = method(seen)
        error = found.velocity - seen.velocity
        score = error / np.sqrt(np.einsum("lbkk->lbk", found.velocity_covariance))
        known = bool(np.isfinite(score).any())
        rows.append({
            "method": name,
            "landings": len(error),
            "contact_ms": 1e3 * float(np.median(np.abs(seen.contact - seen.near))),
            "velocity_rms_mm_s": 1e3 * rms(error),
            "position_rms_mm": 1e3 * rms(found.position - seen.position),
            "chi_square": rms(score) ** 2 if known else np.nan,
            "within_se": within(score) if known else np.nan,
            "lost": float(np.mean(~np.isfinite(error).all(axis=(1, 2)))),
        })  # fmt: skip
    table = pd.DataFrame(rows)
    filtered = table.loc[table["method"] == "savitzky_golay", "velocity_rms_mm_s"].iloc[
        0
    ]
    return table.assign(times_below_filter=filtered / table["velocity_rms_mm_s"])


def rms(values: FloatArray) -> float:
    """Return the root mean square of the finite values."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def within(score: FloatArray) -> float:
    """Return the share of finite scores between -1 and 1."""
    return float(np.mean(np.abs(score[np.isfinite(score)]) < 1))


def scenes(hops: int, seed: int) -> Iterator[tuple[dict[str, object], Crossings]]:
    """Yield every scene with its name, frame rate and noise."""
    for rate_hz, noises_mm in (
        (100.0, (0.2, 0.6, 1.2)),
        (250.0, (0.6,)),
        (500.0, (0.6,)),
    ):
        clean, truth = simulated(hops, rate_hz, seed)
        for noise_mm in noises_mm:
            seen = noisy(clean, noise_mm, seed)
            setting = {"rate_hz": rate_hz, "noise_mm": noise_mm}
            for one in hopper(seen, truth):
                yield {"scene": "hopper", **setting}, one
                if (rate_hz, noise_mm) == (100.0, 0.6):
                    yield {"scene": "hopper, gaps", **setting}, with_gaps(one)
            if noise_mm == 0.6:
                for one in hopper(seen, truth, NEAR_PRE_M, LATE_POST_M):
                    yield {"scene": "hopper, other sections", **setting}, one
    for rate_hz in (100.0, 250.0):
        for spin in (2.0, 4.0, 8.0):
            name = f"tumbling, {spin:g} rad/s"
            yield (
                {"scene": name, "rate_hz": rate_hz, "noise_mm": 0.6},
                tumbling(hops, rate_hz, 0.6, spin, seed),
            )


# The landing map estimated from such states.

TIME_UNIT_S = 0.0137
NOISES_MM = (0.0, 0.3, 0.6, 1.2)
SIZES = (60, 120, 250, 500, 1000)
SPREADS = (1.0, 0.5, 0.25, 0.1)


def errors_of_draws(
    pairs: Any, instants: FloatArray, exact: Any, draws: int, seed: int
) -> Any:
    """Yield size, estimator and error for every draw."""
    for size in (*(s for s in SIZES if s < len(pairs)), len(pairs)):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(size,)))
        for _ in range(1 if size == len(pairs) else draws):
            rows = np.sort(rng.choice(len(pairs), size, replace=False))
            found = estimate_maps(
                pairs.x[rows], pairs.y[rows], instants[rows], time_unit_s=TIME_UNIT_S
            )
            truth = exact(found.shape)
            for name, one in found.maps.items():
                yield size, name, truth.error(one.coefficients)


def noise_rows(
    recording: Recording, truth: Truth, draws: int, seed: int
) -> Iterator[pd.DataFrame]:
    """Yield the errors for each level of noise and method of fitting states."""
    scene = known_scene(truth)
    sections = SectionHeights(PRE_M, POST_M, scene.body_points_m)
    maps = exact_maps([truth], sections)
    states = true_states(truth, scene, sections).x
    heights = {"pre_height_m": PRE_M, "post_height_m": POST_M}
    noise = np.random.default_rng(seed).standard_normal(recording.positions.shape)
    for noise_mm in NOISES_MM:
        seen = replace(
            recording, positions=recording.positions + 1e-3 * noise_mm * noise
        )
        table = touchdown_table(seen, **heights)
        for method in ("split_fit", "savitzky_golay"):
            pairs = assemble_pairs([seen], table, method=method, **heights)
            rows = errors_of_draws(
                pairs,
                pairs.instants,
                lambda shape: exact_map(
                    maps, states, shape=shape, time_unit_s=TIME_UNIT_S
                ),
                draws,
                seed,
            )
            found = pd.DataFrame(rows, columns=["landings", "estimator", "error"])
            yield found.assign(states=method, noise_mm=noise_mm)


def spread_rows(truth: Truth) -> Iterator[dict[str, float | str]]:
    """Yield the errors of maps fitted to true states at smaller spreads."""
    scene = known_scene(truth)
    sections = SectionHeights(PRE_M, POST_M, scene.body_points_m)
    shape = scene.body_points_m - sections.centre_m
    units = 1 / output_weights(shape, TIME_UNIT_S)
    for sample in scaled_landings(
        scene.scene, {"hopper": Control()}, truth.apex_states, truth.preloads_n, sections,
        scales=SPREADS,
    ):  # fmt: skip
        ways = {"ols": ols_map(sample.x, sample.y)}
        ways["curved"] = curved_map(sample.x, sample.y, sample.contact_s, units=units)
        for name, one in ways.items():
            error = relative_difference(
                one.coefficients.T,
                sample.exact_maps.mean(axis=0),
                root=input_root(sample.x),
                units=units,
            )
            yield {
                "spread": sample.scale,
                "landings": len(sample.x),
                "estimator": name,
                "error": error,
            }


def summary(errors: pd.DataFrame) -> pd.DataFrame:
    """Return medians and quantiles over the draws."""
    keys = ["states", "noise_mm", "landings", "estimator"]
    parts = errors.groupby(keys, sort=False)["error"]
    table = parts.agg(
        draws="size",
        median="median",
        q05=lambda values: values.quantile(0.05),
        q95=lambda values: values.quantile(0.95),
    )
    return table.reset_index()


def map_error(out: Path, hops: int, draws: int, seed: int) -> None:
    """Write the tables of the map's errors."""
    recording, truth = simulated(hops, 100.0, seed)
    table = summary(pd.concat(noise_rows(recording, truth, draws, seed)))
    table.to_csv(out.with_name("map_error.csv"), index=False, float_format="%.6g")
    spreads = pd.DataFrame(spread_rows(truth))
    spreads.to_csv(
        out.with_name("map_error_spread.csv"), index=False, float_format="%.6g"
    )
    print(table.to_string(index=False), spreads.to_string(index=False), sep="\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV to write")
    parser.add_argument("--hops", type=int, default=400, help="landings of each scene")
    parser.add_argument(
        "--map-hops", type=int, default=2860, help="landings of the map's errors"
    )
    parser.add_argument(
        "--draws", type=int, default=20, help="random subsets of each size"
    )
    parser.add_argument("--seed", type=int, default=20261121)
    arguments = parser.parse_args()
    parts = []
    for setting, seen in scenes(arguments.hops, arguments.seed):
        table = measure(seen)
        for place, (name, value) in enumerate([*setting.items(), ("side", seen.side)]):
            table.insert(place, name, value)
        print(table.round(3).to_string(index=False), flush=True)
        parts.append(table)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    pd.concat(parts).to_csv(arguments.out, index=False, float_format="%.6g")
    map_error(arguments.out, arguments.map_hops, arguments.draws, arguments.seed)


if __name__ == "__main__":
    main()
