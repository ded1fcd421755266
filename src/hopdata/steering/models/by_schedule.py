"""One model of the frame change for all mode schedules, against one for each.

The dissertation learns from 100 hops and states that a model which considers the 36
schedules would need 3,600 (Sec. 3.4.2). Here both are learned from the same hops and
predict the same fresh ones.

The models of the schedules share the hyper-parameters and the mean of the one for all,
so a schedule of few hops is predicted no worse than by the mean, and the comparison is
about hops alone. The schedule of a hop is known only once it has landed. So the models
by schedule predict twice: given the schedule, and without it, as a controller would use
them, by the average over the schedules, weighted by how often each occurs near the
inputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.steering.models import training
from hopdata.steering.models.kernels import embedded
from hopdata.steering.models.learning import IN_UNITS, UNITS
from hopdata.steering.models.process import N_CHANGE, FrameChangeProcess
from hopdata.steering.strides import COMPONENTS
from hopdata.steering.true_hops import TrueHops

#: Numbers of hops to learn from: from the dissertation's 100 to 100 for each of the 36
#: schedules.
#: Unit: 1. Origin: convention: Sec. 3.4.2, with steps of about a factor of 2.5 between.
SIZES = (100, 250, 600, 1500, 3600)
#: Weight of all schedules together where no hop is near.
#: Unit: 1. Origin: rounding: it only prevents a division by zero.
LEAST_WEIGHT = 1e-300

AGNOSTIC = "one model for all"
KNOWN = "one model a schedule, which is known"
UNKNOWN = "one model a schedule, which is unknown"
MODELS = (AGNOSTIC, KNOWN, UNKNOWN)


@one_blas_thread()
def conditioned_mean(
    process: FrameChangeProcess, known: TrueHops, points: FloatArray
) -> FloatArray:
    """Return the mean (n, 3) of a process that has seen these hops instead, at points.

    Hyper-parameters, offset and unit stay. Only one covariance is held at a time, so
    thousands of hops are no matter.
    """
    changes = known.changes
    other = replace(process, points=changes.points, outputs=changes.change)
    means = np.empty((len(points), N_CHANGE))
    at = embedded(points, process.n_embedded)
    for j in range(N_CHANGE):
        standardised = other.regressor(j).predict(at)
        means[:, j] = process.offset[j] + process.unit[j] * standardised
    return means


@dataclass(frozen=True)
class Predictions:
    """Frame changes of n hops as predicted by each of `MODELS`, (n, 3) each."""

    agnostic: FloatArray
    known: FloatArray
    unknown: FloatArray

    def by_model(self) -> dict[str, FloatArray]:
        """Return the predictions by the names of `MODELS`."""
        return {AGNOSTIC: self.agnostic, KNOWN: self.known, UNKNOWN: self.unknown}


def predictions(
    process: FrameChangeProcess, known: TrueHops, fresh: TrueHops
) -> Predictions:
    """Predict fresh hops from known ones, with one model for all and one a schedule.

    Parameters
    ----------
    process : FrameChangeProcess
        Gives the hyper-parameters, and the mean that is assumed of a schedule without
        hops.
    known, fresh : TrueHops
        Hops to learn from, and to predict.
    """
    points = fresh.changes.points
    agnostic = conditioned_mean(process, known, points)
    conditional = np.tile(process.offset, (len(fresh), 1))
    summed = np.zeros((len(fresh), 3))
    weights = np.full((len(fresh), 3), LEAST_WEIGHT)
    schedules = known.schedule
    for schedule in np.unique(schedules):
        own = known.rows(schedules == schedule)
        predicted = conditioned_mean(process, own, points)
        is_own = fresh.schedule == schedule
        # If the schedule is known, its model alone predicts; if not, all models do,
        # each by how much its hops have to say there.
        conditional[is_own] = predicted[is_own]
        near = _nearness(process, own, points)
        summed += near * predicted
        weights += near
    return Predictions(agnostic=agnostic, known=conditional, unknown=summed / weights)


def _nearness(
    process: FrameChangeProcess, own: TrueHops, points: FloatArray
) -> FloatArray:
    """Return how much some hops correlate with points in all, (n, 3)."""
    at = embedded(points, process.n_embedded)
    seen = embedded(own.changes.points, process.n_embedded)
    sums = [process.kernel(j)(at, seen).sum(axis=1) for j in range(N_CHANGE)]
    return np.column_stack(sums)


def schedule_curve(
    hops: TrueHops,
    sizes: Sequence[int] = SIZES,
    *,
    fresh: int,
    seed: int = 0,
    options: training.ProcessOptions | None = None,
) -> pd.DataFrame:
    """Return the errors of the three models on fresh hops, by hops to learn from.

    Parameters
    ----------
    hops : TrueHops
        At least as many as the largest size and `fresh` together.
    sizes : sequence of int
        Numbers of hops to learn from; each set contains the one before. The
        hyper-parameters are fitted to the smallest; more hops only add to the data.
    fresh : int
        Number of hops to predict.
    seed : int
        Seed of the draw.
    options : ProcessOptions, optional
        Set-up of the processes; by default the recommended one, without restarts.

    Returns
    -------
    DataFrame
        One row for each size (``hops``), ``model`` (`MODELS`) and ``component`` with
        its ``unit``: ``rmse`` on the fresh hops.

    Raises
    ------
    AnalysisError
        If there are too few hops.
    """
    needed = max(sizes) + fresh
    if len(hops) < needed:
        raise AnalysisError.at("schedules", f"at least {needed} hops", len(hops))
    if options is None:
        options = replace(training.RECOMMENDED, restarts=0)
    order = np.random.default_rng(seed).permutation(len(hops))
    unseen = hops.rows(order[:fresh])
    pool = order[fresh:]
    first = hops.rows(pool[: min(sizes)])
    process = training.trained_process(first.changes, options, seed=seed)
    tables = []
    for size in sizes:
        found = predictions(process, hops.rows(pool[:size]), unseen)
        for model, predicted in found.by_model().items():
            errors = predicted - unseen.changes.change
            rmse = np.sqrt((errors**2).mean(axis=0)) * IN_UNITS
            columns = {"component": COMPONENTS, "unit": UNITS, "rmse": rmse}
            tables.append(pd.DataFrame(columns).assign(hops=size, model=model))
    return pd.concat(tables, ignore_index=True)


def crossing(curve: pd.DataFrame, component: str, model: str = KNOWN) -> float:
    """Return the number of hops from which a model errs less than the one for all.

    It is interpolated between the sizes on a logarithmic scale. It is infinite if the
    model errs more at the largest size, and the smallest size if it never does.

    Parameters
    ----------
    curve : DataFrame
        From `schedule_curve`.
    component : str
    model : str
        A name from `MODELS`.
    """
    rows = curve[curve["component"] == component]
    wide = rows.pivot_table(index="hops", columns="model", values="rmse")
    size = wide.index.to_numpy(dtype=float)
    excess = np.log(wide[model].to_numpy() / wide[AGNOSTIC].to_numpy())
    if excess[-1] >= 0:
        return float(np.inf)
    worse = np.flatnonzero(excess >= 0)
    if not len(worse):
        return float(size[0])
    # The sizes on both sides of the crossing, and where between their logarithms it is.
    last = worse[-1]
    share = excess[last] / (excess[last] - excess[last + 1])
    growth = size[last + 1] / size[last]
    return float(size[last] * growth**share)
