"""How many hops it takes to learn the frame change, and whether the kernel matters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.steering.frame_changes import FrameChanges
from hopdata.steering.models.learning import learning_scores, with_intervals
from hopdata.steering.models.options import (
    PRINTED,
    RECOMMENDED,
    WITH_PREVIOUS_CHANGE,
    WITH_PREVIOUS_SWING,
)
from hopdata.steering.models.smoothness import smoothness_scores
from hopdata.steering.stages.learn import hops_to_learn_from

if TYPE_CHECKING:
    import pandas as pd

MODELS = {
    "printed": PRINTED,
    "recommended": RECOMMENDED,
    "previous swing": WITH_PREVIOUS_SWING,
    "previous change": WITH_PREVIOUS_CHANGE,
}
SIZES = (20, 35, 60, 100, 170)
LEAST_TESTED = 30  # hops left to test on
SCORES = ("r2", "rmse", "coverage")


@dataclass(frozen=True)
class LearningTables:
    """Two tables, means over random sets of hops with their spread.

    Parameters
    ----------
    curve : DataFrame
        ``model, hops, component, unit`` and of ``r2, rmse, coverage`` the mean, its standard error
        (``_se``) and the 5 and 95 % quantiles over the sets (``_q05``, ``_q95``).
    kernels : DataFrame
        The same by ``data, reading, smoothness, component, unit``, with ``log_likelihood``.
    """

    curve: pd.DataFrame
    kernels: pd.DataFrame


@one_blas_thread()
def learning_tables(
    changes: FrameChanges, *, training_hops: int, draws: int, seed: int
) -> LearningTables:
    """Learn from random sets of hops of several sizes, and with kernels of several smoothnesses.

    Parameters
    ----------
    changes : FrameChanges
    training_hops : int
        Number of hops with which kernels are compared.
    draws : int
        Random sets of each size.
    seed : int

    Raises
    ------
    AnalysisError
        If there are too few hops for the smallest size or for `training_hops`; nothing has been
        learned then.
    """
    used = hops_to_learn_from(changes, training_hops)
    usable = int(np.isfinite(used.previous_swing_rad).sum())
    sizes = [size for size in SIZES if size <= usable - LEAST_TESTED]
    if not sizes:
        raise AnalysisError(
            f"learning curve: expected at least {SIZES[0] + LEAST_TESTED} hops that follow a hop, "
            f"found {usable}"
        )
    curve = learning_scores(changes, MODELS, sizes, draws=draws, seed=seed)
    kernels = smoothness_scores(changes, train=training_hops, draws=draws, seed=seed)
    by = ["data", "reading", "smoothness", "component", "unit"]
    return LearningTables(
        with_intervals(curve, ["model", "hops", "component", "unit"], SCORES),
        with_intervals(kernels.assign(data="hopper"), by, [*SCORES, "log_likelihood"]),
    )
