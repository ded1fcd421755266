"""A steering study's results as plain data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from hopdata.report.inputs import ReportFigure, SteeringInputs

CAPTIONS = Path(__file__).parents[2] / "workflow" / "captions"
FIGURES = (
    "fig3_5_origin",
    "fig3_6_turn",
    "fig3_8_origin_board",
    "fig3_9_turn_board",
    "steering_outcomes",
    "steering_film",
    "steering_map",
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
        "runs": 30, "late": 1, "left": 1, "fell": 0, "stances": 1200, "blind": 3, "start": "any",
    }  # fmt: skip
    nothing = dict.fromkeys(("hops", "hops_low", "hops_high", "hops_ratio", "ratio_low",
                             "ratio_high", "asked_rate", "asked_ratio"), np.nan)  # fmt: skip
    return pd.DataFrame(
        [
            {
                **common, "experiment": "origin", "controller": "planner", "succeeded": 28,
                "rate": 28 / 30, "rate_low": 0.779, "rate_high": 0.992, "hops": 34.0,
                "hops_low": 30.0, "hops_high": 37.0, "paired_starts": 27, "hops_ratio": 1.05,
                "ratio_low": 0.98, "ratio_high": 1.11, "asked_rate": 0.9, "asked_ratio": 1.3,
                "met": "yes",
            },
            {
                **common, **nothing, "experiment": "origin", "controller": "printed",
                "succeeded": 0, "rate": 0.0, "rate_low": 0.0, "rate_high": 0.116,
                "paired_starts": 0, "met": "",
            },
        ]
    )  # fmt: skip


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
            "set": 1, "component": ["dx", "dy", "dtheta"], "unit": ["mm", "mm", "deg"],
            "r2": [0.35, 0.46, 0.91], "rmse": [21.0, 17.5, 1.8], "coverage": [0.95, 0.94, 0.96],
            "training_hops": 100, "test_hops": 217,
        }
    )  # fmt: skip


def full_steering(study: str = "steered") -> SteeringInputs:
    return SteeringInputs(
        study=study,
        figures=figures(),
        outcomes=outcomes(),
        counts=counts(),
        scores=scores(),
        truth={"heading_rms": {"value": 2.4, "unit": "mrad", "what": "heading, rms error"}},
        provenance={
            "study": study, "seed": 5, "config": {"study": study}, "inputs": {"a.h5": "0" * 64},
            "versions": {"numpy": "2"}, "stage_seconds": {"steering_model": 1.5},
        },
    )  # fmt: skip
