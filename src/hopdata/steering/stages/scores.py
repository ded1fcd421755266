"""What was observed and learned against what the simulator knows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.steering.frame_change_errors import SAME_STANCE_S
from hopdata.steering.models.interface import FrameChangeMap
from hopdata.steering.plant.true_map import TrueFrameChanges
from hopdata.steering.se2 import wrapped

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

COMPONENTS = (("x", "mm", 1e3), ("y", "mm", 1e3), ("heading", "deg", 180 / np.pi))


@one_blas_thread()
def truth_entries(
    motion: pd.DataFrame,
    true_motion: pd.DataFrame,
    stances: pd.DataFrame,
    true_stances: pd.DataFrame,
    model: FrameChangeMap,
    true_map: TrueFrameChanges,
) -> dict[str, dict[str, Any]]:
    """Return name to ``value, unit, what`` of each score.

    Parameters
    ----------
    motion, true_motion : DataFrame
        One row a frame: pose and ``boom_angle_rad``; the true one with ``tilt_rad``.
    stances, true_stances : DataFrame
        One row a stance, ``time_s`` and ``follows``: whether the stance before is a hop before.
    model : FrameChangeMap
    true_map : TrueFrameChanges
    """
    return {
        **_pose_scores(motion, true_motion),
        **_stance_scores(stances, true_stances),
        **_model_scores(model, true_map),
    }


def _entry(value: float, unit: str, what: str) -> dict[str, Any]:
    return {"value": float(value), "unit": unit, "what": what}


def _rms(errors: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(errors**2)))


def _pose_scores(motion: pd.DataFrame, true: pd.DataFrame) -> Mapping[str, Any]:
    away = motion[["x_m", "y_m"]].to_numpy() - true[["x_m", "y_m"]].to_numpy()
    turned = wrapped((motion["heading_rad"] - true["heading_rad"]).to_numpy())
    boom = wrapped((motion["boom_angle_rad"] - true["boom_angle_rad"]).to_numpy())
    offset = float(np.nanmean(turned))
    return {
        "position_rms": _entry(1e3 * _rms(away), "mm", "position per axis, rms error"),
        "heading_rms": _entry(
            1e3 * _rms(turned - offset), "mrad", "heading, rms error about its mean"
        ),
        "heading_offset": _entry(1e3 * offset, "mrad", "heading, mean error"),
        "boom_angle_rms": _entry(1e3 * _rms(boom), "mrad", "boom angle, rms error"),
        "tilt_rms": _entry(1e3 * _rms(true["tilt_rad"].to_numpy()), "mrad", "tilt, rms"),
        "frames_without_pose": _entry(
            float(motion["x_m"].isna().sum()), "1", "frames without a pose"
        ),
    }


def _stance_scores(stances: pd.DataFrame, true: pd.DataFrame) -> Mapping[str, Any]:
    """Pairs of stances that were missed, and that were invented."""
    found = _pair_times(stances)
    real = _pair_times(true)
    apart = np.abs(found[:, None] - real).max(axis=2, initial=0.0)
    same = apart <= SAME_STANCE_S
    return {
        "true_pairs": _entry(float(len(real)), "1", "consecutive stances, true pairs"),
        "missed_pairs": _entry(
            float(len(real) - same.any(axis=0).sum()), "1", "pairs of stances missed"
        ),
        "invented_pairs": _entry(
            float(len(found) - same.any(axis=1).sum()), "1", "pairs of stances invented"
        ),
    }


def _pair_times(stances: pd.DataFrame) -> FloatArray:
    time, second = stances["time_s"].to_numpy(), np.flatnonzero(stances["follows"].astype(bool))
    return np.column_stack([time[second - 1], time[second]])


def _model_scores(model: FrameChangeMap, true_map: TrueFrameChanges) -> Mapping[str, Any]:
    """Errors of the learned map on the grid of the true one, averaged over the swing before."""
    angle, swing = np.meshgrid(true_map.boom_angle_rad, true_map.swing_rad, indexing="ij")
    true = true_map.average().reshape(-1, 3)
    errors = model.change(angle.ravel(), swing.ravel()) - true
    scores = {}
    for j, (name, unit, factor) in enumerate(COMPONENTS):
        explained = float(1 - np.mean(errors[:, j] ** 2) / np.var(true[:, j]))
        scores[f"model_{name}_rms"] = _entry(
            factor * _rms(errors[:, j]), unit, f"frame change in {name}, rms error of the model"
        )
        scores[f"model_{name}_r2"] = _entry(
            explained, "1", f"frame change in {name}, share of the true map explained (R2)"
        )
    return scores
