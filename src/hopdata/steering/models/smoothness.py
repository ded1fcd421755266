"""Whether a kernel of C2 functions fails to model frame changes, as the dissertation reports.

Section 3.4.2 says so of the Matern kernel of smoothness 5/2, and concludes that the dynamics are
measurably only C1. What is fitted and what is held fixed is not said, so the smoothnesses are
compared in several readings of the set-up: see `READINGS`.

The mean of a process of which no hyper-parameter is fitted depends on the ratio of noise to
variance alone, not on the units. Once the length scale is fitted and the variance is not, the units
decide.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hopdata.steering.frame_changes import USED, FrameChanges
from hopdata.steering.models.kernels import SMOOTHNESSES
from hopdata.steering.models.learning import prediction_score, random_split, score_rows
from hopdata.steering.models.options import (
    PRINTED,
    RECOMMENDED,
    ProcessOptions,
    process_inputs,
)
from hopdata.steering.models.training import trained_process

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

_FITTED = replace(PRINTED, length_scale=None, noise=None)
READINGS: Mapping[str, ProcessOptions] = {
    # The formula: variance and length scale 1, noise 0.1; mm and rad.
    "printed, all fixed": PRINTED,
    # The length scale fitted, the rest as before.
    "printed, length fitted": replace(PRINTED, length_scale=None),
    # scikit-learn's `Matern(nu) + WhiteKernel(0.1)`: the noise is only where the search begins.
    "printed, length and noise fitted, mm": _FITTED,
    "printed, length and noise fitted, m": replace(_FITTED, length_unit_m=1.0),
    "standardised, all fitted": RECOMMENDED,
}

SMOOTH_NOISE = np.array([0.5e-3, 0.5e-3, 2e-3])


def smooth_truth(hops: int, swing_limit_rad: float, seed: int) -> FrameChanges:
    """Return frame changes by analytic functions of boom angle and swing, with a little noise.

    Their sizes are those of the hopper: a few cm and about five degrees. The noise is that of
    poses from motion capture (`SMOOTH_NOISE`).
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    angle = rng.uniform(0, 2 * np.pi, hops)
    swing = rng.uniform(-swing_limit_rad, swing_limit_rad, hops)
    middle = angle + swing / 2
    change = np.column_stack(
        [
            0.05 - 0.025 * np.cos(middle) + 0.01 * np.sin(swing),
            -0.02 * np.sin(middle) + 0.01 * np.cos(2 * angle) * np.cos(swing),
            0.12 * np.sin(swing) + 0.03 * np.sin(angle) - 0.02 * np.cos(middle),
        ]
    )
    unknown = np.full(hops, np.nan)
    return FrameChanges(
        recording=np.full(hops, "smooth truth"),
        time_s=np.arange(hops, dtype=float),
        boom_angle_rad=angle,
        swing_rad=swing,
        change=change + SMOOTH_NOISE * rng.standard_normal(change.shape),
        previous_swing_rad=unknown,
        previous_change=np.full((hops, 3), np.nan),
        reason=np.full(hops, USED),
    )


def smoothness_scores(
    changes: FrameChanges,
    *,
    train: int = 100,
    draws: int,
    seed: int,
    readings: Mapping[str, ProcessOptions] = READINGS,
) -> pd.DataFrame:
    """Score the four smoothnesses in each reading of the set-up, on the same random hops.

    Returns
    -------
    DataFrame
        Columns of `learning_scores` without ``hops, model``, with ``reading``, ``smoothness`` and
        ``log_likelihood``, the log marginal likelihood of the training hops in the units in which
        they are modelled: compare it within a reading and a component.
    """
    import pandas as pd

    hops = changes.used()
    rows: list[dict[str, object]] = []
    for draw, stream in enumerate(np.random.SeedSequence([seed, train]).spawn(draws)):
        chosen, rest = random_split(len(hops), train, np.random.default_rng(stream))
        test = hops.rows(rest)
        for reading, options in readings.items():
            for smoothness in SMOOTHNESSES:
                setup = replace(options, smoothness=smoothness)
                process = trained_process(hops.rows(chosen), setup, seed=seed + draw)
                score = prediction_score(process, process_inputs(test, setup.history), test.change)
                labels = {"reading": reading, "smoothness": smoothness, "draw": draw}
                rows.extend(
                    {**row, "log_likelihood": value}
                    for row, value in zip(
                        score_rows(score, labels), process.log_marginal_likelihood, strict=True
                    )
                )
    return pd.DataFrame(rows)
