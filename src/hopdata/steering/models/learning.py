"""How well frame changes are predicted, and how many hops that takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.steering.frame_changes import FrameChanges
from hopdata.steering.models.interface import COMPONENTS
from hopdata.steering.models.options import ProcessOptions, process_inputs
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.models.training import trained_process

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

WIDTH_95 = 1.959963984540054  # half of the central 95 % of a standard normal
UNITS = ("mm", "mm", "deg")
IN_UNITS = np.array([1e3, 1e3, 180 / np.pi])


@dataclass(frozen=True)
class PredictionScore:
    """Scores of predictions, each (3,).

    Parameters
    ----------
    r2 : array
        1 less the mean square error over the variance of what was to be predicted.
    rmse : array
        Root mean square error, mm, mm, degrees.
    coverage : array
        Share of the hops within the central 95 % of their prediction.
    """

    r2: FloatArray
    rmse: FloatArray
    coverage: FloatArray


def prediction_score(process: FrameChangeProcess, inputs: FloatArray, outputs: FloatArray) -> (
    PredictionScore
):  # fmt: skip
    """Score predictions of frame changes `outputs` (n, 3) at `inputs` (n, d)."""
    error = process.change(*inputs.T) - outputs
    sd = process.sd(*inputs.T, observed=True)
    square = np.mean(error**2, axis=0)
    return PredictionScore(
        r2=1 - square / outputs.var(axis=0),
        rmse=np.sqrt(square) * IN_UNITS,
        coverage=np.mean(np.abs(error) <= WIDTH_95 * sd, axis=0),
    )


def random_split(hops: int, train: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draw which hops to train on; return them and the rest, as row numbers.

    Raises
    ------
    AnalysisError
        If fewer than two hops would remain to test on.
    """
    if hops - train < 2:
        raise AnalysisError(
            f"learning: expected more than {train + 1} hops, to test on some, found {hops}"
        )
    order = rng.permutation(hops)
    return np.sort(order[:train]), np.sort(order[train:])


def learning_scores(
    changes: FrameChanges,
    options: Mapping[str, ProcessOptions],
    sizes: Sequence[int],
    *,
    draws: int,
    seed: int,
) -> pd.DataFrame:
    """Train on random hops and test on the rest, for several set-ups and numbers of hops.

    All set-ups have the same draws, from the hops that have one before them, so that they can be
    compared whether or not they use history.

    Parameters
    ----------
    changes : FrameChanges
    options : mapping
        Set-ups by name.
    sizes : sequence of int
        Numbers of hops to train on.
    draws : int
        Random sets of each size.
    seed : int
        Of the draws.

    Returns
    -------
    DataFrame
        Columns ``model, hops, draw, component, unit, r2, rmse, coverage``; a row for each component
        of each draw.
    """
    import pandas as pd

    hops = changes.used()
    hops = hops.rows(np.isfinite(hops.previous_change).all(axis=1))
    rows = []
    for size in sizes:
        streams = np.random.SeedSequence([seed, size]).spawn(draws)
        for draw, stream in enumerate(streams):
            train, test = random_split(len(hops), size, np.random.default_rng(stream))
            for name, chosen in options.items():
                process = trained_process(hops.rows(train), chosen, seed=seed + draw)
                rest = hops.rows(test)
                score = prediction_score(process, process_inputs(rest, chosen.history), rest.change)
                rows.extend(score_rows(score, {"model": name, "hops": size, "draw": draw}))
    return pd.DataFrame(rows)


def score_rows(score: PredictionScore, labels: Mapping[str, object]) -> list[dict[str, object]]:
    """Return a row for each component."""
    columns = zip(COMPONENTS, UNITS, score.r2, score.rmse, score.coverage, strict=True)
    names = ("component", "unit", "r2", "rmse", "coverage")
    return [{**labels, **dict(zip(names, values, strict=True))} for values in columns]


def with_intervals(scores: pd.DataFrame, by: Sequence[str], values: Sequence[str]) -> pd.DataFrame:
    """Return means over the draws, their standard errors, and 5 and 95 % quantiles of the draws.

    Parameters
    ----------
    scores : DataFrame
        One row a draw.
    by : sequence of str
        Columns that tell settings apart.
    values : sequence of str
        Columns to average; each gives four, ``<value>, <value>_se, <value>_q05, <value>_q95``.
    """
    groups = scores.groupby(list(by), sort=False)
    table = groups.size().rename("draws").reset_index()
    for value in values:
        part = groups[value]
        table[value] = part.mean().to_numpy()
        table[f"{value}_se"] = part.sem(ddof=1).to_numpy()
        table[f"{value}_q05"] = part.quantile(0.05).to_numpy()
        table[f"{value}_q95"] = part.quantile(0.95).to_numpy()
    return table
