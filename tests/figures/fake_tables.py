"""Tables as the workflow writes them, made without the workflow, for any number of feet."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

MODELS = ("specialised", "near", "all", "far", "specialised_mean", "mean")
KINDS = ("in_class", "cross_class", "noised_identity", "random")


def frames(travel_m: float = 0.211, n: int = 4000, seed: int = 1) -> pd.DataFrame:
    """Return frames of three feet under a bouncing, tilting body."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2 * np.pi, n)
    clearance = travel_m * (0.35 + 0.75 * np.cos(phase) + 0.06 * rng.standard_normal(n))
    tilt = 0.1 * travel_m * rng.standard_normal((n, 3))
    noise = 0.0006 * rng.standard_normal((n, 3))
    foot = np.maximum(clearance[:, None] + tilt, 0.0) + noise
    return pd.DataFrame(
        {
            "min_foot_m": foot.min(axis=1),
            "max_foot_m": foot.max(axis=1),
            "body_m": 0.3 + clearance,
            "landing": np.arange(len(foot)) % 2 == 0,
        }
    )


def sections(travel_m: float = 0.211) -> dict[str, Any]:
    return {
        "rule": "landings",
        "chosen_by": {"pre_height_m": "data", "post_height_m": "data"},
        "landing_shares": {"pre": 1.0, "post": 0.989},
        "other_rule": {
            "rule": "printed",
            "pre_height_m": 0.3 + 0.3 * travel_m,
            "post_height_m": 0.3 - 0.2 * travel_m,
        },
        "min_foot_threshold_m": 0.0014,
        "max_foot_threshold_m": 0.0027,
        "pre_height_m": 0.3 + 0.27 * travel_m,
        "post_height_m": 0.3 - 0.28 * travel_m,
    }


def densities(table: pd.DataFrame, limits: dict[str, Any]) -> pd.DataFrame:
    up = table["min_foot_m"] > limits["min_foot_threshold_m"]
    down = table["max_foot_m"] < limits["max_foot_threshold_m"]
    body = table["body_m"].to_numpy()
    pre, post = limits["pre_height_m"], limits["post_height_m"]
    scatter = 0.05 * (pre - post) * np.random.default_rng(3).standard_normal(200)
    curves = {
        "min_foot": _kde(table["min_foot_m"].to_numpy(), 0.0007),
        "max_foot": _kde(table["max_foot_m"].to_numpy(), 0.0007),
        "body_given_all_up": _kde(body[up], 0.02 * np.ptp(body)),
        "body_given_some_down": _kde(body[~up], 0.02 * np.ptp(body)),
        "body_given_all_down": _kde(body[down], 0.02 * np.ptp(body)),
        "body_given_some_up": _kde(body[~down], 0.02 * np.ptp(body)),
        "top": _kde(pre + 0.3 * (pre - post) + scatter, 0.01 * np.ptp(body)),
        "first_contact": _kde(pre - 0.3 * (pre - post) + scatter, 0.01 * np.ptp(body)),
        "last_contact": _kde(post + 0.2 * (pre - post) + scatter, 0.01 * np.ptp(body)),
        "lowest": _kde(post - 0.2 * (pre - post) + scatter, 0.01 * np.ptp(body)),
    }
    parts = [
        pd.DataFrame({"curve": name, "height_m": x, "density_per_m": y})
        for name, (x, y) in curves.items()
    ]
    return pd.concat(parts, ignore_index=True)


def _kde(sample: np.ndarray, bandwidth: float) -> tuple[np.ndarray, np.ndarray]:
    if not len(sample):
        return np.empty(0), np.empty(0)
    grid = np.linspace(sample.min() - 4 * bandwidth, sample.max() + 4 * bandwidth, 512)
    kernels = np.exp(-0.5 * ((grid[:, None] - sample[:800]) / bandwidth) ** 2)
    return grid, kernels.mean(axis=1) / bandwidth / np.sqrt(2 * np.pi)


def feet_names(n: int) -> tuple[str, ...]:
    return tuple(f"foot{i}" for i in range(1, n + 1))


def touchdown(n_feet: int = 3, seed: int = 2) -> dict[str, object]:
    rng = np.random.default_rng(seed)
    row: dict[str, object] = {
        "recording": "hopper",
        "touchdown": 7,
        "method": "kink",
        "t_pre_s": 12.34,
        "t_post_s": 12.47,
    }
    instants = 12.34 + 0.06 + 0.012 * rng.standard_normal(n_feet)
    for name, instant in zip(feet_names(n_feet), instants, strict=True):
        row[f"contact_{name}_s"] = instant
        row[f"se_{name}_s"] = 0.0009
    row["schedule"] = ">".join(str(i + 1) for i in np.argsort(instants))
    row["probability"] = 0.987
    row["spread_s"] = float(np.std(instants))
    return row


def example(row: dict[str, object], n_feet: int = 3, seed: int = 3) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    time = np.arange(-0.1, 0.2, 0.01)
    parts = []
    for name in feet_names(n_feet):
        contact = float(row[f"contact_{name}_s"]) - float(row["t_pre_s"])  # type: ignore[arg-type]
        before = np.minimum(time - contact, 0.0)
        height = (
            -1.4 * before + 4.9 * -(before**2) + 0.0006 * rng.standard_normal(len(time))
        )
        velocity = np.gradient(height, time)
        parts.append(
            pd.DataFrame(
                {
                    "recording": "hopper",
                    "touchdown": 7,
                    "time_s": time,
                    "foot": name,
                    "height_m": height,
                    "velocity_m_s": velocity,
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def prediction_summary(models: tuple[str, ...] = MODELS) -> pd.DataFrame:
    middle = dict(
        zip(MODELS, (1.95e-3, 2.03e-3, 3.13e-3, 3.79e-3, 15.4e-3, 29.5e-3), strict=True)
    )
    rows = []
    for name in models:
        m = middle[name]
        rows.append(
            {
                "model": name,
                "n_classes": 6 if name.startswith("specialised") else 1,
                "n_train": 120,
                "n_test": 41,
                "median_mse": m,
                "q25": 0.9 * m,
                "q75": 1.13 * m,
                "p2_5": 0.75 * m,
                "p97_5": 1.5 * m,
                "worst_position_mm": 40 * np.sqrt(m),
                "worst_velocity_m_s": 2 * np.sqrt(m),
            }
        )
    return pd.DataFrame(rows)


def units() -> dict[str, float]:
    return {"length_unit_m": 0.02913, "time_unit_s": 0.027, "velocity_unit_m_s": 1.079}


def distances(
    kinds: tuple[str, ...] = KINDS, n: int = 500, seed: int = 4
) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    places = {
        "in_class": (2.99, 0.12),
        "cross_class": (3.10, 0.12),
        "noised_identity": (2.268, 0.098),
        "random": (3.7605, 0.102),
    }
    parts = [
        pd.DataFrame({"kind": kind, "distance_rad": rng.normal(*places[kind], n)})
        for kind in kinds
    ]
    empty = pd.DataFrame(
        {"kind": pd.Series(dtype=str), "distance_rad": pd.Series(dtype=float)}
    )
    return pd.concat([empty, *parts], ignore_index=True) if parts else empty


def distance_summary(table: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for kind, group in table.groupby("kind", sort=False):
        d = group["distance_rad"]
        q = d.quantile([0.05, 0.25, 0.5, 0.75, 0.95]).to_numpy()
        rows.append(
            {"kind": kind, "n": len(d), "mean_distance": d.mean(), "sd": d.std()}
            | dict(zip(("q05", "q25", "median_distance", "q75", "q95"), q, strict=True))
            | {"auc_against_in_class": 0.73}
        )
    columns = [
        "kind",
        "n",
        "mean_distance",
        "sd",
        "q05",
        "q25",
        "median_distance",
        "q75",
        "q95",
    ]
    return pd.DataFrame(rows, columns=[*columns, "auc_against_in_class"])
