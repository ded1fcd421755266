"""The table of example runs: which of its runs is shown first."""

from __future__ import annotations

from hopdata.arrays import pd


def shown_run(examples: pd.DataFrame, experiment: str) -> pd.DataFrame:
    """Return the curves of the run that a study shows first of an experiment.

    The run beside it, of another controller from the same start, is left out.

    Parameters
    ----------
    examples : DataFrame
        The examples of `hopdata.steering.experiments.study.experiments_of`.
    experiment : str
        Name of the experiment.
    """
    curves = examples[examples["experiment"] == experiment]
    if curves.empty:
        return curves
    return curves[curves["controller"] == curves["controller"].iloc[0]]
