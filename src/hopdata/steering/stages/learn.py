"""From the table of frame changes to a model, and how well it predicts the other hops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.blas import one_blas_thread
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

LEFT_TO_TEST = 2  # hops: the fewest that have a variance


@one_blas_thread()
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

    hops, wanted = hops_to_learn_from(changes, options["training_hops"]), options["training_hops"]
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


def hops_to_learn_from(changes: FrameChanges, training_hops: int) -> FrameChanges:
    """Return the hops that are used, if they suffice to learn from so many and to test on two.

    Raises
    ------
    AnalysisError
        With the number of hops that there are, and how many were left out for what.
    """
    hops = changes.used()
    left_out = f"(left out of {len(changes)}: {changes.excluded() or 'none'})"
    if len(hops) < LEAST_HOPS + LEFT_TO_TEST:
        raise AnalysisError(
            f"steering: expected at least {LEAST_HOPS + LEFT_TO_TEST} hops that can be used, to "
            f"learn from and to test on, found {len(hops)} {left_out}"
        )
    if len(hops) < training_hops + LEFT_TO_TEST:
        raise AnalysisError(
            f"steering.model.training_hops: expected at most {len(hops) - LEFT_TO_TEST}, two fewer "
            f"than the {len(hops)} hops that can be used, found {training_hops} {left_out}"
        )
    return hops
