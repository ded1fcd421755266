"""Error of the estimated landing map against the exact one, by number of landings and noise.

    python benchmarks/map_error.py --out map_error.csv

One recording of the C1 hopper on a flat floor, as long as the dissertation's four, is seen with
four levels of noise (the same draws, scaled), its sections where the study `thesis` has them.
States at the sections are fitted piecewise, split at the contacts (`split_fit`, our default), or by
a cubic over seven frames (`savitzky_golay`), which is noisier. Each estimator of
`hopdata.maps.corrected.estimates` is fitted to random landings; the last size is all of them.

A second table, `map_error_spread.csv`, has true states whose deviations from the simultaneous
landing are scaled down: without noise what is left is curvature, which vanishes with the spread.

Errors are relative differences of predictions for the true inputs (`hopdata.maps.truth.maps`),
with velocities weighed by the time unit that the study `thesis` finds, 13.7 ms: medians over the
draws, with their 5 and 95 % quantiles.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hopdata.arrays import FloatArray
from hopdata.landings.states.assemble import assemble_pairs
from hopdata.landings.touchdowns import touchdown_table
from hopdata.maps.coordinates import output_weights
from hopdata.maps.corrected.estimates import estimate_maps
from hopdata.maps.corrected.regression import curved_map, ols_map
from hopdata.maps.truth.maps import exact_map, input_root, relative_difference
from hopdata.recording import Recording, Truth
from hopdata.scenes.scene import Control
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.scaling import exact_maps, known_scene, scaled_landings, true_states
from hopdata.synthesis.simulate import simulate_recording

PRE_M, POST_M, TIME_UNIT_S = 0.502, 0.2815, 0.0137
NOISES_MM = (0.0, 0.3, 0.6, 1.2)
SIZES = (60, 120, 250, 500, 1000)
SPREADS = (1.0, 0.5, 0.25, 0.1)
FLAT = {"bowl_depth_m": 0.0, "wave_amplitude_m": 0.0}


def recorded(hops: int, seed: int) -> tuple[Recording, Truth]:
    """Simulate the hopper without noise on a flat floor."""
    camera = {"noise_m": 0.0, "resolution_m": 0.0, "floor": FLAT}
    return simulate_recording({"hops": hops}, camera, seed=seed)


def errors_of_draws(pairs: Any, instants: FloatArray, exact: Any, draws: int, seed: int) -> Any:
    """Yield size, estimator and error of every draw."""
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


def noise_rows(recording: Recording, truth: Truth, draws: int, seed: int) -> Iterator[pd.DataFrame]:
    """Yield the errors for each level of noise and way of fitting states."""
    scene = known_scene(truth)
    sections = SectionHeights(PRE_M, POST_M, scene.body_points_m)
    maps = exact_maps([truth], sections)
    states = true_states(truth, scene, sections).x
    heights = {"pre_height_m": PRE_M, "post_height_m": POST_M}
    noise = np.random.default_rng(seed).standard_normal(recording.positions.shape)
    for noise_mm in NOISES_MM:
        seen = replace(recording, positions=recording.positions + 1e-3 * noise_mm * noise)
        table = touchdown_table(seen, **heights)
        for method in ("split_fit", "savitzky_golay"):
            pairs = assemble_pairs([seen], table, method=method, **heights)
            rows = errors_of_draws(
                pairs,
                pairs.instants,
                lambda shape: exact_map(maps, states, shape=shape, time_unit_s=TIME_UNIT_S),
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV to write, another beside it")
    parser.add_argument("--hops", type=int, default=2860)
    parser.add_argument("--draws", type=int, default=20, help="random subsets of each size")
    parser.add_argument("--seed", type=int, default=20261121)
    arguments = parser.parse_args()
    recording, truth = recorded(arguments.hops, arguments.seed)
    errors = pd.concat(noise_rows(recording, truth, arguments.draws, arguments.seed))
    table, spreads = summary(errors), pd.DataFrame(spread_rows(truth))
    beside = arguments.out.with_name("map_error_spread.csv")
    for path, part in ((arguments.out, table), (beside, spreads)):
        print(part.to_string(index=False))
        part.to_csv(path, index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
