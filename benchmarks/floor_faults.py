"""The fitted floor where a foot hangs low, drags, or stands on something, against the true floor.

    python benchmarks/floor_faults.py --out floor_faults.csv

The hopper is simulated with the default curved floor, and its feet are then moved as each fault
says. One row for each fault, height and estimator: `ours` is `hopdata.landings.floor.fit_floor`;
`tukey`, `huber` and `least squares` are one regression of the same rest points by statsmodels (RLM,
RLM, OLS), with the same polynomial and mount heights. Errors at the true contacts, root mean square
over the seeds: `floor_mm` of the floor, less its mean; `mounts_mm` of the worst foot's mount height
against the other feet; `level_mm` the mean of floor and mount together, over the feet, and `rms_mm`
their root mean square: how far from zero a foot on the floor is afterwards. `efficiency`, of the
clean recordings only: the square of `floor_mm` of least squares over that of the row.

Faults: `hangs`, one foot's rests are too high by that height in the given share of the run;
`drags`, the foot slides in flight at that height with slow waves of half of it, in the given share;
`obstacle`, all feet rest that much higher within a disc that holds the given share of the steps,
about.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hopdata.arrays import FloatArray
from hopdata.landings.floor import fit_floor
from hopdata.landings.floor_surface import (
    FloorModel,
    design,
    polynomial_terms,
    rest_points,
    thinned,
)
from hopdata.recording import Recording, Truth
from hopdata.synthesis.simulate import simulate_recording

DEGREE = 5
FAULTS = (
    ("clean", 0.0, 0.0),
    *(("hangs", share, mm) for share in (0.3, 0.5, 0.7) for mm in (4.0, 8.0, 15.0)),
    *(("drags", share, mm) for share in (0.3, 0.6) for mm in (4.0, 15.0)),
    *(("obstacle", share, mm) for share in (0.1, 0.3) for mm in (4.0, 8.0, 15.0)),
)


def spoilt(
    recording: Recording, truth: Truth, fault: str, share: float, height_m: float
) -> Recording:
    """Move the feet as a fault says."""
    positions = recording.positions.copy()
    feet = recording.indices("foot")
    late = recording.time > (1 - share) * recording.time[-1]
    down = truth.foot_down
    if fault == "hangs":
        positions[late & down[:, 0], feet[0], 2] += height_m
    elif fault == "drags":
        wave = height_m * (1 + 0.5 * np.sin(2 * np.pi * recording.time / 2.0))
        floor = _true_floor(recording, truth, feet[0])
        moved = late & ~down[:, 0]
        noise = np.random.default_rng(0).normal(0, truth.noise_m, len(wave))
        positions[moved, feet[0], 2] = (floor + wave + noise)[moved]
    elif fault == "obstacle":
        stands = np.concatenate([positions[down[:, k], f, :2] for k, f in enumerate(feet)])
        centre = np.median(stands, axis=0) + np.array([0.2, 0.1])
        radius = np.quantile(np.hypot(*(stands - centre).T), share)
        for k, foot in enumerate(feet):
            inside = np.hypot(*(positions[:, foot, :2] - centre).T) < radius
            positions[inside & down[:, k], foot, 2] += height_m
    return replace(recording, positions=positions)


def _true_floor(recording: Recording, truth: Truth, foot: int) -> FloatArray:
    """Height of the true floor under a foot at each frame: that of the nearest true contact."""
    from scipy.spatial import cKDTree

    seen = np.isfinite(truth.contact_times)
    _, nearest = cKDTree(truth.contact_points[seen]).query(recording.positions[:, foot, :2])
    return truth.floor_at_contacts[seen][nearest]


def peer(recording: Recording, name: str) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Regress the same rest points by statsmodels; floor and mounts as a function of places."""
    import statsmodels.api as sm

    rest = rest_points(recording)
    rest = thinned(rest.take(np.abs(rest.above_mode) <= 0.06), 10000)
    rest = rest.take(np.abs(rest.above_mode) <= 0.02)
    scale = float(np.abs(rest.points[:, :2]).max())
    terms = polynomial_terms(DEGREE)
    n = len(rest.start_m)
    contrasts = np.vstack([np.eye(n - 1), -np.ones((1, n - 1))])
    columns = np.hstack([design(rest.points[:, :2] / scale, terms), contrasts[rest.foot]])
    norms = {"tukey": sm.robust.norms.TukeyBiweight(), "huber": sm.robust.norms.HuberT()}
    heights = rest.points[:, 2]
    if name == "least squares":
        found = sm.OLS(heights, columns).fit().params
    else:
        found = sm.RLM(heights, columns, M=norms[name]).fit().params
    offsets = contrasts @ found[len(terms) :]

    def height(places: FloatArray, foot: FloatArray) -> FloatArray:
        flat = places.reshape(-1, 2) / scale
        floor = (design(flat, terms) @ found[: len(terms)]).reshape(places.shape[:-1])
        return np.asarray(floor + foot * offsets)

    return height


def ours(recording: Recording) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Fit by `fit_floor`."""
    floor: FloorModel = fit_floor(recording, degree=DEGREE)

    def height(places: FloatArray, foot: FloatArray) -> FloatArray:
        return np.asarray(
            floor.height(places[..., 0], places[..., 1]) + foot * floor.foot_offsets_m
        )

    return height


def measure(
    height: Callable[[FloatArray, FloatArray], FloatArray], truth: Truth
) -> dict[str, float]:
    """Errors at the true contacts; the true mount heights are all zero."""
    seen = np.isfinite(truth.contact_times)
    floor = (height(truth.contact_points, np.zeros(1)) - truth.floor_at_contacts)[seen]
    both = np.where(seen, height(truth.contact_points, np.ones(1)) - truth.floor_at_contacts, 0)
    zero = np.zeros((1, truth.contact_points.shape[1], 2))
    mounts = (height(zero, np.ones(1)) - height(zero, np.zeros(1)))[0]
    return {
        "floor_mm": 1e3 * float(floor.std()),
        "mounts_mm": 1e3 * float(np.abs(mounts).max()),
        "level_mm": 1e3 * float(both[seen].mean()),
        "rms_mm": 1e3 * float(np.sqrt(np.mean(both[seen] ** 2))),
    }


ESTIMATORS: dict[str, Callable[[Recording], Callable[[FloatArray, FloatArray], FloatArray]]] = {
    "ours": ours,
    "tukey": lambda r: peer(r, "tukey"),
    "huber": lambda r: peer(r, "huber"),
    "least squares": lambda r: peer(r, "least squares"),
}


def main() -> None:
    """Simulate, spoil, fit, tabulate and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--hops", type=int, default=300)
    parser.add_argument("--seeds", type=int, default=5)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for seed in range(options.seeds):
        recording, truth = simulate_recording({"hops": options.hops}, seed=seed)
        for fault, share, mm in FAULTS:
            bad = spoilt(recording, truth, fault, share, 1e-3 * mm)
            for name, estimator in ESTIMATORS.items():
                found = measure(estimator(bad), truth)
                where = {"fault": fault, "share": share, "height_mm": mm, "estimator": name}
                rows.append({**where, **found})
    keys = ["fault", "share", "height_mm", "estimator"]
    table = pd.DataFrame(rows).groupby(keys, sort=False).agg(_rms).reset_index()
    clean = table["fault"] == "clean"
    best = table.loc[clean & (table["estimator"] == "least squares"), "floor_mm"].iloc[0]
    table["efficiency"] = np.where(clean, (best / table["floor_mm"]) ** 2, np.nan)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(options.out, index=False, float_format="%.6g")
    print(table.round(3).to_string(index=False))


def _rms(values: pd.Series) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()
