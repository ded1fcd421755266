"""A steering study's results as plain data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

import hopdata.steering
from hopdata.report.inputs import ReportFigure
from hopdata.steering.report.page import SteeringInputs

CAPTIONS = Path(hopdata.steering.__file__).parent / "workflow" / "captions"
FIGURES = (
    "fig3_5_origin",
    "fig3_6_turn",
    "fig3_8_origin_board",
    "fig3_9_turn_board",
    "steering_outcomes",
    "steering_waypoints",
    "steering_film",
    "steering_map",
    "fig3_3_printed",
    "steering_learning",
    "steering_kernels",
)
SVG = b'<svg xmlns="http://www.w3.org/2000/svg" width="240.9pt" height="99pt"></svg>'


def figures() -> list[ReportFigure]:
    return [
        ReportFigure(
            name,
            b"GIF89a" if name == "steering_film" else SVG,
            "image/gif" if name == "steering_film" else "image/svg+xml",
            (CAPTIONS / f"{name}.md").read_text(),
        )
        for name in FIGURES
    ]


def outcomes() -> pd.DataFrame:
    common = {
        "experiment": "origin", "seeds": 10, "runs": 300, "worst_seed": 4, "fell": 0, "touched": 0,
        "blind": 3,
    }  # fmt: skip
    return pd.DataFrame(
        [
            {
                **common, "controller": "planner", "worst_rate": 28 / 30, "median_rate": 29.5 / 30,
                "hops": 34.0, "ratio": 1.05, "worst_ratio": 1.12, "last_error": 0.09, "late": 7,
                "met": "yes",
            },
            {
                **common, "controller": "printed", "worst_rate": 0.0, "median_rate": 2 / 30, "hops": np.nan,
                "ratio": np.nan, "worst_ratio": np.nan, "last_error": np.nan, "late": 290,
                "met": "",
            },
        ]
    )  # fmt: skip


def horizons() -> pd.DataFrame:
    return pd.DataFrame(
        {"horizon": [3, 10], "runs": 10, "succeeded": [1, 9], "hops": [12, 27.5]}
    )


def examples(controller: str = "planner", *, success: bool = True) -> pd.DataFrame:
    """Return what captions need of the runs shown: a stance of each."""
    predicted = controller not in ("random", "none")
    rows = [
        {"experiment": experiment, "controller": controller, "success": success, "curve": curve,
         "x_m": 0.1 if predicted or curve == "measured" else np.nan}
        for experiment in ("origin", "turn", "origin_board", "turn_board", "waypoints")
        for curve in ("measured", "response")
    ]  # fmt: skip
    return pd.DataFrame(rows)


def counts() -> list[dict[str, object]]:
    return [
        {
            "recording": "excitation",
            "frames": {"seen": 21000, "leaned on an earlier frame": 12, "misfit": 0, "unseen": 3},
            "stances": 336, "pairs": 320, "used": 317,
            "rejected": {"no bounce": 2, "held or carried in between": 13},
            "excluded": {"boom angle missing": 3},
        }
    ]  # fmt: skip


def scores() -> pd.DataFrame:
    return pd.DataFrame(
        {
            "seed": 1, "component": ["dx", "dy", "dtheta"], "unit": ["mm", "mm", "deg"],
            "r2": [0.35, 0.46, 0.91], "rmse": [21.0, 17.5, 1.8], "coverage": [0.95, 0.94, 0.96],
            "training_hops": 100, "test_hops": 217, "observation": "corrected",
        }
    )  # fmt: skip


def full_steering(study: str = "steered") -> SteeringInputs:
    return SteeringInputs(
        study=study,
        figures=figures(),
        outcomes=outcomes(),
        horizons=horizons(),
        examples=examples(),
        counts=counts(),
        scores=scores(),
        truth={"heading_rms": {"value": 2.4, "unit": "mrad", "what": "heading, rms error"}},
        provenance={
            "study": study, "seed": 5, "config": {"study": study}, "inputs": {"a.h5": "0" * 64},
            "versions": {"numpy": "2"}, "stage_seconds": {"steering_model": 1.5},
        },
    )  # fmt: skip
