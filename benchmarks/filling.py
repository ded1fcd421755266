"""Gaps of the body markers: what filling wins, and how far what it fills is from the truth.

    python benchmarks/filling.py --out filling.csv

The hopper is simulated once for each number of body markers and observed with and without
drop-outs of all markers, feet included. One row for each kind of gaps and each way to fill them:
`none`, the methods of `hopdata.landings.filling`, and scipy's `CubicSpline` through all that was
seen of each marker, which knows neither contacts nor bodies. Gaps of up to `longest_s` are filled;
the default of the configuration is `rigid` up to 0.1 s.

`error_mm` is the rms distance of filled places from the true ones, per coordinate, `worst_mm` its
99 % quantile, and `seen_mm` the same rms of the places that were seen, which is their noise.
Touchdowns that are used are counted beside those of the same recording without any gap; `won` are
those more than with `none`. Errors of the states at the sections are against the integrated
landings: of the touchdowns that rest on filled places (from 0.22 s before the pre section to
0.22 s after the post section) and of those that do not.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hopdata.arrays import FloatArray
from hopdata.landings.filling import fill_gaps, mark_filled
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.sections.select import select_sections
from hopdata.landings.states.assemble import assemble_pairs, exclude_stateless
from hopdata.landings.states.pairs import Pairs
from hopdata.landings.touchdowns import touchdown_table
from hopdata.maps.truth.landings import state_errors, true_rows
from hopdata.recording import Recording, Truth
from hopdata.recordings.quality.stretches import marker_gaps
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.scaling import known_scene, true_states
from hopdata.synthesis.simulate import simulate_recording

MARKERS = (
    *((0.13, 0.03, 0.05), (-0.08, 0.11, 0.075), (-0.07, -0.14, 0.055)),
    *((0.02, -0.05, 0.1), (-0.12, 0.0, 0.03)),
)
GAPS = {"short": (60.0, 0.03), "long": (60.0, 0.15)}  # 1/min of each marker, s
METHODS = ("none", "rigid", "CubicSpline")
DEFAULT_S, LONGEST_S = 0.1, 0.5
WAYS = (("none", 0.0), ("rigid", DEFAULT_S), ("CubicSpline", LONGEST_S))
CAPTURE = {"noise_m": 0.0006}


@dataclass(frozen=True)
class Case:
    """A hopper seen with and without gaps, its truth, and what does not depend on the gaps."""

    whole: Recording
    perfect: Recording
    truth: Truth
    heights: tuple[float, float]
    true: Pairs


def observed(hops: int, n_body: int, seed: int, **capture: Any) -> tuple[Recording, Truth]:
    """Simulate the hopper with its first `n_body` markers."""
    capture = {**CAPTURE, "markers": {"body_m": MARKERS[:n_body]}, **capture}
    return simulate_recording({"hops": hops}, capture, seed=seed)


def make_case(hops: int, n_body: int, seed: int) -> Case:
    """Simulate, choose the sections, and integrate the true landings to them."""
    whole, truth = observed(hops, n_body, seed)
    perfect, _ = observed(hops, n_body, seed, noise_m=0.0, resolution_m=0.0)
    flat = level(whole, fit_floor(whole))
    found = select_sections([flat])
    scene = known_scene(truth)
    sections = SectionHeights(found.pre_height_m, found.post_height_m, scene.body_points_m)
    states = true_states(truth, scene, sections)
    names = np.full(len(states.index), whole.name)
    true = Pairs(
        states.x, states.y, states.schedule, states.spread_s, names, states.index,
        whole.names("body"),
    )  # fmt: skip
    return Case(whole, perfect, truth, (found.pre_height_m, found.post_height_m), true)


def splined(recording: Recording, *, longest_s: float) -> Recording:
    """Fill the gaps of each body marker by scipy's spline through all that was seen of it."""
    positions, filled = recording.positions.copy(), np.zeros(recording.positions.shape[:2], bool)
    short = short_gaps(recording, longest_s)
    for m in recording.indices("body"):
        is_seen = np.isfinite(positions[:, m, 0])
        spline = CubicSpline(recording.time[is_seen], positions[is_seen, m], extrapolate=False)
        positions[short[:, m], m] = spline(recording.time[short[:, m]])
        filled[:, m] = short[:, m] & np.isfinite(positions[:, m, 0])
    return replace(recording, positions=positions, filled=filled)


def short_gaps(recording: Recording, longest_s: float) -> NDArray[np.bool_]:
    """Mark the gaps that are no longer than `longest_s`, (N, M)."""
    mask = np.zeros(recording.positions.shape[:2], bool)
    for m, gaps in enumerate(marker_gaps(recording.positions, recording.markers)):
        for start, stop in gaps.stretches:
            mask[start:stop, m] = stop - start <= longest_s * recording.rate_hz + 1e-6
    return mask


def filled_by(method: str, flat: Recording, longest_s: float) -> Recording:
    """Fill by one of `METHODS`."""
    if method == "none":
        return replace(flat, filled=np.zeros(flat.positions.shape[:2], bool))
    if method == "CubicSpline":
        return splined(flat, longest_s=longest_s)
    return fill_gaps(flat, longest_s=longest_s)


def touchdowns(recording: Recording, case: Case) -> tuple[Pairs, pd.DataFrame]:
    """Pairs and touchdowns of a levelled recording."""
    pre, post = case.heights
    table = touchdown_table(recording, pre_height_m=pre, post_height_m=post)
    table = mark_filled(recording, table)
    pairs = assemble_pairs([recording], table, pre_height_m=pre, post_height_m=post)
    return pairs, exclude_stateless(table, pairs)


def state_row(case: Case, recording: Recording) -> dict[str, float]:
    """Touchdowns used, and errors of their states with and without filled places."""
    pairs, table = touchdowns(recording, case)
    contacts = {recording.name: case.truth.contact_times}
    rows = true_rows(pairs, table, case.true, contacts, recording.names("foot"))
    share = table.set_index("index")["filled_share"].loc[pairs.index].to_numpy()
    out: dict[str, float] = {
        "descents": len(table),
        "used": int((~table["excluded"]).sum()),
        "rest_on_filled": int((share > 0).sum()),
    }
    for kind, chosen in (("filled", share > 0), ("seen", share == 0)):
        errors = state_errors(pairs, case.true, np.where(chosen, rows, -1))
        for row in errors.to_dict("records"):
            section = row["section"]
            out[f"{kind}_{section}_position_mm"] = row["position_rms_mm"]
            out[f"{kind}_{section}_velocity_mm_s"] = row["velocity_rms_mm_s"]
    return out


def rows_of(case: Case, n_body: int, kind: str, gappy: Recording) -> list[dict[str, Any]]:
    """One row a method for one recording with gaps."""
    floor = fit_floor(gappy)
    flat, perfect = level(gappy, floor), level(case.perfect, floor)
    bodies = flat.indices("body")
    missing = ~np.isfinite(flat.positions[:, bodies]).all(axis=2)
    noise = (flat.positions - perfect.positions)[:, bodies][~missing]
    whole = replace(level(case.whole, floor), filled=np.zeros(flat.positions.shape[:2], bool))
    used_whole = int((~touchdowns(whole, case)[1]["excluded"]).sum())
    rows = []
    for method, longest_s in WAYS:
        recording = filled_by(method, flat, longest_s)
        assert recording.filled is not None
        error = (recording.positions - perfect.positions)[recording.filled]
        rows.append(
            {
                "body_markers": n_body,
                "gaps": kind,
                "rate_per_min": GAPS[kind][0],
                "mean_s": GAPS[kind][1],
                "method": method,
                "longest_s": longest_s,
                "missing": int(missing.sum()),
                "filled": len(error),
                "error_mm": 1e3 * _rms(error),
                "worst_mm": 1e3 * _far(error),
                "seen_mm": 1e3 * _rms(noise),
                "used_without_gaps": used_whole,
                **state_row(case, recording),
            }
        )
    for row in rows:
        row["won"] = row["used"] - rows[0]["used"]
    return rows


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _far(values: FloatArray) -> float:
    return float(np.quantile(np.abs(values), 0.99)) if values.size else float("nan")


def main() -> None:
    """Simulate, fill, tabulate and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--hops", type=int, default=500)
    parser.add_argument("--seed", type=int, default=20261121)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for n_body in (3, 4, 5):
        case = make_case(options.hops, n_body, options.seed)
        for kind, (rate, mean) in GAPS.items():
            gaps = {"rate_per_min": rate, "mean_s": mean}
            gappy, _ = observed(options.hops, n_body, options.seed, gaps=gaps)
            rows += rows_of(case, n_body, kind, gappy)
    table = pd.DataFrame(rows)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(options.out, index=False, float_format="%.6g")
    with pd.option_context("display.width", 250, "display.max_columns", 50):
        print(table.round(3).to_string(index=False))


if __name__ == "__main__":
    main()
