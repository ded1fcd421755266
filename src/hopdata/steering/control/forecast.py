"""Whether a model will take the robot to a point, told before the first run.

A controller that knows the model steers a stand-in for the robot: each of its hops ends
where the model predicts, plus the model's error in a hop that it has not learned from,
of about the same boom angle and swing. So the errors count where the way needs them,
the size of a step and of a turn count too, and no robot is needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.messages import Message
from hopdata.rigid import composed, relative, wrapped
from hopdata.steering.control.adaptive import COARSE
from hopdata.steering.control.cost_to_go import cost_to_go
from hopdata.steering.control.grids import PointGrid
from hopdata.steering.goals import ARRIVED_M, MOST_STRIDES
from hopdata.steering.models.process import LENGTHS, FrameChangeProcess
from hopdata.steering.models.tabulated import COMPONENTS, TabulatedMap, tabulated
from hopdata.steering.strides import TURN, Strides

#: Starts of the stand-in, a metre from the point, with any heading.
#: Unit: 1. Origin: chosen: an expected share of 0.95 then has a deviation of 0.015.
STARTS = 200
#: Distance of the starts from the point.
#: Unit: m. Origin: convention: that of the experiments.
DISTANCE_M = 1.0
#: Swings that are tried in each hop.
#: Unit: 1. Origin: chosen: the planner tries as many in the first of two hops.
SWINGS = 31
#: Hops nearest in boom angle and swing of which one lends its error.
#: Unit: 1. Origin: chosen: the excitation makes each move this often.
NEIGHBOURS = 3
#: Least share of the starts from which a sound model arrives.
#: Unit: 1. Origin: measured: see docs/steering.md, "Before the first run".
LEAST_ARRIVED = 0.95

# Length scales within this factor of their upper bound are at it.
_AT_BOUND = 0.99
# Cells of the plane of boom angle and swing whose share with a hop is counted.
_CELLS = (16, 7)


@dataclass(frozen=True)
class Forecast:
    """What is expected of a model before its first run.

    Attributes
    ----------
    arrived
        Share of the starts from which the stand-in arrives.
    error_m
        Root mean square distance of a hop from its prediction, on hops that were not
        learned from, m.
    step_m
        Median distance between neighbouring stances, m.
    width_m
        Radius of the goal region, m.
    covered
        Share of the cells of the plane of boom angle and swing in which a hop was
        learned.
    unresolved
        Components whose length scale in the swing is at its upper bound: the model
        sees no effect of the swing on them.
    """

    arrived: float
    error_m: float
    step_m: float
    width_m: float
    covered: float
    unresolved: tuple[str, ...]

    def columns(self) -> dict[str, float | str]:
        """Return the columns that it adds to ``model_scores.csv``."""
        return {
            "expected_arrivals": self.arrived,
            "error_over_width": self.error_m / self.width_m,
            "step_over_width": self.step_m / self.width_m,
            "covered": self.covered,
            "unresolved": " ".join(self.unresolved),
        }


@one_blas_thread()
def forecast(
    process: FrameChangeProcess,
    hops: Strides,
    *,
    swing_limit_rad: float,
    width_m: float = ARRIVED_M,
) -> Forecast:
    """Tell what to expect of a model.

    Parameters
    ----------
    process : FrameChangeProcess
    hops : Strides
        At least `NEIGHBOURS` hops of the same robot that were not learned from.
    swing_limit_rad : float
        Largest swing.
    width_m : float
        Radius of the goal region, m.
    """
    inputs = np.column_stack([hops.state, hops.inputs])
    error = hops.change - process.change(hops.state, hops.inputs)
    distance = np.hypot(error[:, 0], error[:, 1])
    step = np.hypot(hops.change[:, 0], hops.change[:, 1])
    return Forecast(
        arrived=_arrived(
            tabulated(process, swing_limit_rad),
            inputs,
            error,
            width_m,
        ),
        error_m=float(np.sqrt(np.mean(distance**2))),
        step_m=float(np.median(step)),
        width_m=width_m,
        covered=_covered(process, swing_limit_rad),
        unresolved=_unresolved(process),
    )


def _arrived(
    model: TabulatedMap, inputs: FloatArray, error: FloatArray, width_m: float
) -> float:
    """Return the share of the starts from which the stand-in arrives.

    `inputs` (n, 2) and `error` (n, 3) are those of the hops that lend their errors.
    """
    limit = model.swing_limit_rad
    swings = np.linspace(-limit, limit, SWINGS)
    ahead = cost_to_go(model, COARSE[PointGrid])
    rng = np.random.default_rng(0)
    bearing, heading = rng.uniform(-np.pi, np.pi, (2, STARTS))
    x = DISTANCE_M * np.cos(bearing)
    y = DISTANCE_M * np.sin(bearing)
    pose = np.column_stack([x, y, heading])
    boom = np.full(STARTS, np.pi)
    for _ in range(MOST_STRIDES):
        on_the_way = np.hypot(pose[:, 0], pose[:, 1]) > width_m
        pose = pose[on_the_way]
        boom = boom[on_the_way]
        if not len(pose):
            break
        # Axes: the starts still on the way, and the swings to choose from.
        booms = np.broadcast_to(boom[:, None], (len(pose), SWINGS))
        tried = np.broadcast_to(swings, booms.shape)
        change = model.change(booms.ravel(), tried.ravel()).reshape(*booms.shape, 3)
        point = np.zeros_like(pose)
        point[:, 2] = pose[:, 2]
        remaining = relative(change, relative(pose, point)[:, None, :])
        best = ahead.at(remaining, (booms + tried)[..., None]).argmin(axis=1)
        swing = swings[best]
        predicted = change[np.arange(len(pose)), best]
        lent = error[_near(inputs, boom, swing, rng)]
        pose = composed(pose, predicted + lent)
        boom = boom + swing
    left = int((np.hypot(pose[:, 0], pose[:, 1]) > width_m).sum())
    return 1.0 - left / STARTS


def _near(
    inputs: FloatArray, boom: FloatArray, swing: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return for each hop one of the `NEIGHBOURS` hops nearest to it, by number."""
    of_boom = wrapped(inputs[:, 0] - boom[:, None])
    of_swing = inputs[:, 1] - swing[:, None]
    nearest = np.argsort(np.hypot(of_boom, of_swing), axis=1, kind="stable")
    chosen = rng.integers(0, NEIGHBOURS, len(boom))
    return np.asarray(nearest[np.arange(len(boom)), chosen])


def _covered(process: FrameChangeProcess, swing_limit_rad: float) -> float:
    """Return the share of the cells of boom angle and swing with a learned hop."""
    booms = process.points[:, 0] % TURN
    swings = np.clip(process.points[:, 1], -swing_limit_rad, swing_limit_rad)
    ranges = [[0.0, TURN], [-swing_limit_rad, swing_limit_rad]]
    counts, _, _ = np.histogram2d(booms, swings, bins=_CELLS, range=ranges)
    return float((counts > 0).mean())


def _unresolved(process: FrameChangeProcess) -> tuple[str, ...]:
    """Return the components on which the model sees no effect of the swing."""
    # The bound is in units of the swing's deviation.
    largest = _AT_BOUND * LENGTHS[1] * float(process.points[:, 1].std())
    scales = process.length_scales[:, 1]
    return tuple(
        name for name, scale in zip(COMPONENTS, scales, strict=True) if scale >= largest
    )


# What to say of it.

#: Error of a hop over the goal's radius that is named as the reason.
#: Unit: 1. Origin: measured: 0.8 on a floor of friction 0.2, at most 0.45 where the
#: planner arrives.
LARGEST_ERROR = 0.6
#: Step over the goal's radius that is named as the reason.
#: Unit: 1. Origin: derived: with longer steps, fewer than two stances of a way across
#: the goal are in it.
LARGEST_STEP = 1.0


def warning(scores: pd.DataFrame) -> Message | None:
    """Return what to say before the first run; None if the model is expected to do.

    Parameters
    ----------
    scores : DataFrame
        ``model_scores.csv`` of one model, with the columns of `Forecast.columns`; one
        without them says nothing.
    """
    if "expected_arrivals" not in scores or scores.empty:
        return None
    row = scores.iloc[0]
    arrived = float(row["expected_arrivals"])
    if not arrived < LEAST_ARRIVED:
        return None
    of_errors = {"errors": round(100 * float(row["error_over_width"]))}
    if row["error_over_width"] > LARGEST_ERROR:
        why = Message("steering.errors_too_large", of_errors)
    elif row["step_over_width"] > LARGEST_STEP:
        steps = {"steps": round(100 * float(row["step_over_width"]))}
        why = Message("steering.steps_too_large", steps)
    elif isinstance(row["unresolved"], str) and row["unresolved"]:
        components = {"components": row["unresolved"].replace(" ", " and ")}
        why = Message("steering.swing_without_effect", components)
    else:
        why = Message("steering.errors_where_needed", of_errors)
    share = {"arrived": round(100 * arrived), "why": why}
    return Message("steering.will_not_reach", share)
