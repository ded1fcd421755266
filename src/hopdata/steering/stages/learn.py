"""From the table of frame changes to a model, and how well it predicts the other hops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.errors import AnalysisError
from hopdata.steering.frame_changes import FrameChanges
from hopdata.steering.models.learning import prediction_score, random_split, score_rows
from hopdata.steering.models.options import process_inputs
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.models.training import LEAST_HOPS, trained_process
from hopdata.steering.stages.options import process_of
from hopdata.steering.streams import TRAINING

if TYPE_CHECKING:
    import pandas as pd


def learn(
    changes: FrameChanges, options: Mapping[str, Any], *, seed: int
) -> tuple[list[FrameChangeProcess], pd.DataFrame]:
    """Learn from as many random sets of as many hops as the block ``steering.model`` says.

    Parameters
    ----------
    changes : FrameChanges
    options : mapping
    seed : int
        The study's.

    Returns
    -------
    processes : list of FrameChangeProcess
        One a set.
    scores : DataFrame
        On the hops that were not learned from: ``set`` (from 1), ``component, unit, r2, rmse,
        coverage, training_hops, test_hops``.

    Raises
    ------
    AnalysisError
        If there are too few hops.
    """
    import pandas as pd

    hops, wanted = changes.used(), options["training_hops"]
    if len(hops) < LEAST_HOPS + 2:
        raise AnalysisError(
            f"steering: expected at least {LEAST_HOPS + 2} hops with known pose and boom angle, to "
            f"learn from and to test on, found {len(hops)} "
            f"(left out of {len(changes)}: {changes.excluded() or 'none'})"
        )
    if len(hops) < wanted + 2:
        raise AnalysisError(
            f"steering.model.training_hops: expected at most {max(0, len(hops) - 2)}, two fewer "
            f"than the hops with known pose and boom angle, found {wanted} "
            f"(left out of {len(changes)}: {changes.excluded() or 'none'})"
        )
    processes, rows = [], []
    for k in range(options["sets"]):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(TRAINING, k)))
        train, rest = random_split(len(hops), wanted, rng)
        setup = process_of(options)
        process = trained_process(hops.rows(train), setup, seed=seed)
        test = hops.rows(rest)
        score = prediction_score(process, process_inputs(test, setup.history), test.change)
        processes.append(process)
        rows += score_rows(score, {"set": k + 1})
    sizes = {"training_hops": wanted, "test_hops": len(hops) - wanted}
    return processes, pd.DataFrame(rows).assign(**sizes)
