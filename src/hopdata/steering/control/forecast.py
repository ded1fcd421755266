"""Whether a model will take a robot to a point, told before the first run.

A planner that looks one stride ahead steers a stand-in for the robot: each of its
strides ends where the model predicts, plus the model's error in a stride that it has
not learned from, of about the same states and inputs. So the errors count where the way
needs them, the size of a step and of a turn count too, and no robot is needed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray, one_blas_thread, pd
from hopdata.messages import Message
from hopdata.rigid import composed, wrapped
from hopdata.steering.control.cost_to_go import cost_to_go, input_nodes
from hopdata.steering.control.objectives import Horizon, goal_errors
from hopdata.steering.control.planner import Planner, planner
from hopdata.steering.control.prediction import next_state, predicted_change
from hopdata.steering.frame_changes import is_hopper
from hopdata.steering.goals import ARRIVED_M
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.models.training import LENGTHS, outputs_of
from hopdata.steering.strides import COMPONENTS, TURN, StrideAxes, Strides

#: Starts of the stand-in.
#: Unit: 1. Origin: chosen: an expected share of 0.95 then has a deviation of 0.015.
STARTS = 200
#: Inputs that are tried in each stride, by the number of inputs of the robot.
#: Unit: 1. Origin: chosen: as many as the planner tries in the first of two strides; of
#: two inputs more, since they are not refined.
INPUTS_TRIED = {1: 31, 2: 81}
#: Strides nearest in states and inputs of which one lends its error.
#: Unit: 1. Origin: chosen: the excitation makes each move this often.
NEIGHBOURS = 3
#: Correlation of the errors of strides in a row from which on a state is missing.
#: Unit: 1. Origin: measured: that of hoppers that are plain is at most 0.25, of a robot
#: whose sideways speed carries over 0.8.
PERSISTENT = 0.5
#: The same in deviations of the correlation of errors that are independent.
#: Unit: 1. Origin: chosen.
SURE = 3.0
#: Longest time between strides in a row, in the time of a short one.
#: Unit: 1. Origin: chosen: without a stride between, even if strides vary.
IN_A_ROW = 1.5
#: Least share of the starts from which a sound model arrives.
#: Unit: 1. Origin: measured: see docs/steering_measured.md, "The forecast".
LEAST_ARRIVED = 0.95

# Length scales within this factor of their upper bound are at it.
_AT_BOUND = 0.99
# Cells of the space of states and inputs whose share with a stride is counted, along a
# periodic state and along any other axis.
_PERIODIC_CELLS = 16
_LINEAR_CELLS = 7


@dataclass(frozen=True, kw_only=True)
class Way:
    """The task that is foretold: to come near a point.

    Parameters
    ----------
    distance_m : float
        Distance of the starts from the point, if they are not given.
    width_m : float
        Radius of the goal region.
    strides : int
        Strides within which the robot must arrive.
    """

    distance_m: float = 1.0
    width_m: float = ARRIVED_M
    strides: int = 50


@dataclass(frozen=True)
class Forecast:
    """What is expected of a model before its first run.

    Attributes
    ----------
    arrived
        Share of the starts from which the stand-in arrives.
    error_m
        Root mean square distance of a stride from its prediction, on strides that were
        not learned from, m.
    step_m
        Median distance between neighbouring stances, m.
    width_m
        Radius of the goal region, m.
    covered
        Share of the cells of the space of states and inputs in which a stride was
        learned. The model fills in the others; the share falls with every axis, so it
        only compares recordings of one robot.
    unresolved
        Components whose length scales in all inputs are at their upper bound: the model
        sees no effect of the inputs on them.
    persistent
        Components whose errors are alike in strides in a row. Then a state is missing,
        and `arrived` is too hopeful, as the stand-in's errors are lent one by one.
    """

    arrived: float
    error_m: float
    step_m: float
    width_m: float
    covered: float
    unresolved: tuple[str, ...]
    persistent: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Say what is expected, in words."""
        return (
            f"arrives from {self.arrived:.0%} of the starts; a stride errs by "
            f"{self.error_m / self.width_m:.0%} of the goal's radius and is "
            f"{self.step_m / self.width_m:.0%} of it long; strides were learned in "
            f"{self.covered:.0%} of the cells of states and inputs"
        )

    def columns(self) -> dict[str, float | str]:
        """Return the columns that it adds to ``model_scores.csv``."""
        return {
            "expected_arrivals": self.arrived,
            "error_over_width": self.error_m / self.width_m,
            "step_over_width": self.step_m / self.width_m,
            "covered": self.covered,
            "unresolved": " ".join(self.unresolved),
            "persistent": " ".join(self.persistent),
        }


@one_blas_thread()
def forecast(
    process: FrameChangeProcess,
    strides: Strides,
    *,
    way: Way | None = None,
    starts: ArrayLike | None = None,
    state: ArrayLike | None = None,
    state_limits: tuple[float, float] | None = None,
) -> Forecast:
    """Tell what to expect of a model.

    Parameters
    ----------
    process : FrameChangeProcess
        Of a robot that the planner supports.
    strides : Strides
        At least `NEIGHBOURS` used strides of the same robot that were not learned from.
    way : Way, optional
        By default that of the experiments.
    starts : (N, 3) array, optional
        Poses from which it must arrive, relative to the point; by default `STARTS`
        around it.
    state : (S,) array, optional
        State at the starts; by default those of the strides, in turn.
    state_limits : (float, float), optional
        See `planner`.
    """
    way = way or Way()
    error = outputs_of(strides) - _predicted(process, strides)
    distance = np.hypot(error[:, 0], error[:, 1])
    step = np.hypot(strides.change[:, 0], strides.change[:, 1])
    rng = np.random.default_rng(0)
    if starts is None:
        poses = _around(way, rng)
    else:
        poses = np.array(starts, dtype=float)
    first = strides.state if state is None else np.atleast_2d(state)
    states = np.resize(first, (len(poses), first.shape[1]))
    stand_in = _StandIn(
        _one_step_planner(process, way, state_limits), strides.points, error
    )
    return Forecast(
        arrived=stand_in.arrived(way, poses, states, rng),
        error_m=float(np.sqrt(np.mean(distance**2))),
        step_m=float(np.median(step)),
        width_m=way.width_m,
        covered=_covered(process),
        unresolved=_unresolved(process),
        persistent=persistent(error[:, : len(COMPONENTS)], strides),
    )


def persistent(error: FloatArray, strides: Strides) -> tuple[str, ...]:
    """Return the components whose errors are alike in strides in a row.

    Parameters
    ----------
    error : (n, 3) array
        Errors of the predicted changes of pose.
    strides : Strides
        The n strides. They may be some of a recording; those that follow each other
        are found by their times.
    """
    order = np.lexsort((strides.time_s, strides.recording))
    gaps_s = np.diff(strides.time_s[order])
    names = strides.recording[order]
    is_next = (names[1:] == names[:-1]) & (gaps_s > 0)
    if not is_next.any():
        return ()
    short_s = np.quantile(gaps_s[is_next], 0.1)
    first = np.flatnonzero(is_next & (gaps_s <= IN_A_ROW * short_s))
    apart = error[order] - error.mean(axis=0)
    before = apart[first]
    after = apart[first + 1]
    size = np.sqrt(np.sum(before**2, axis=0) * np.sum(after**2, axis=0))
    least = max(PERSISTENT, SURE / np.sqrt(len(first)))
    is_alike = np.sum(before * after, axis=0) > least * size
    return tuple(
        name for name, alike in zip(COMPONENTS, is_alike.tolist(), strict=True) if alike
    )


def _predicted(process: FrameChangeProcess, strides: Strides) -> FloatArray:
    """Return the expected outputs (n, J) of strides; see `FrameChangeProcess`."""
    return process.predicted(strides.points, range(len(process.offset)))[0]


def _one_step_planner(
    process: FrameChangeProcess, way: Way, state_limits: tuple[float, float] | None
) -> Planner:
    """Return a planner that looks one stride ahead, on a coarse grid."""
    horizon = Horizon(hops=1)
    if is_hopper(process.axes):
        limit = float(process.axes.upper[0])
        horizon = Horizon(hops=1, swing_limit_rad=limit)
    found = planner(process, horizon=horizon, few_nodes=True, state_limits=state_limits)
    grid = found.cost_to_go.grid
    if grid.width == way.width_m:
        return found
    own = cost_to_go(found.model, replace(grid, width=way.width_m))
    return replace(found, cost_to_go=own)


@dataclass(frozen=True)
class _StandIn:
    """A robot whose strides end where a model predicts, plus errors that are lent.

    Parameters
    ----------
    planner : Planner
        Looks one stride ahead.
    points : (n, S + U) array
        States and inputs of the strides that lend their errors.
    error : (n, J) array
        Errors of their predicted outputs.
    """

    planner: Planner
    points: FloatArray
    error: FloatArray

    def arrived(
        self,
        way: Way,
        pose: FloatArray,
        state: FloatArray,
        rng: np.random.Generator,
    ) -> float:
        """Return the share of starts that arrive, by poses (N, 3) and states (N, S)."""
        model = self.planner.model
        axes = model.axes
        tried = _tried(axes)
        is_learned = ~axes.is_known
        n_starts = len(pose)
        for _ in range(way.strides):
            on_the_way = goal_errors(self.planner.objective, pose) > way.width_m
            pose = pose[on_the_way]
            state = state[on_the_way]
            if not len(pose):
                break
            remaining = self.planner.remaining(pose)
            best = self.planner.costs(remaining, state, [tried]).argmin(axis=-1)
            inputs = tried[best]
            lent = self.error[self._near(state, inputs, rng)]
            change = predicted_change(model, state, inputs) + lent[:, : len(COMPONENTS)]
            pose = composed(pose, change)
            state = next_state(model, state, inputs)
            state[:, is_learned] += lent[:, len(COMPONENTS) :]
        left = goal_errors(self.planner.objective, pose) > way.width_m
        return 1.0 - int(left.sum()) / n_starts

    def _near(
        self, state: FloatArray, inputs: FloatArray, rng: np.random.Generator
    ) -> IntArray:
        """Return for each stride one of the `NEIGHBOURS` nearest to it, by number."""
        axes = self.planner.model.axes
        here = np.concatenate([state, inputs], axis=1)
        apart = self.points - here[:, None]
        n_periodic = len(axes.periodic)
        apart[..., :n_periodic] = wrapped(apart[..., :n_periodic])
        distance = np.sqrt(np.sum((apart / _units(axes, self.points)) ** 2, axis=-1))
        nearest = np.argsort(distance, axis=1, kind="stable")
        chosen = rng.integers(0, NEIGHBOURS, len(here))
        return np.asarray(nearest[np.arange(len(here)), chosen])


def _tried(axes: StrideAxes) -> FloatArray:
    """Return the inputs (n, U) that are tried in each stride."""
    n_inputs = len(axes.inputs)
    number = round(INPUTS_TRIED[n_inputs] ** (1 / n_inputs))
    return input_nodes(axes.lower, axes.upper, number)


def _around(way: Way, rng: np.random.Generator) -> FloatArray:
    """Return poses (`STARTS`, 3) around the point, with any heading."""
    bearing, heading = rng.uniform(-np.pi, np.pi, (2, STARTS))
    x = way.distance_m * np.cos(bearing)
    y = way.distance_m * np.sin(bearing)
    return np.column_stack([x, y, heading])


def _units(axes: StrideAxes, points: FloatArray) -> FloatArray:
    """Return the units (S + U,) in which points are apart: rad, else deviations."""
    spread = points.std(axis=0)
    is_angle = np.array([axis.unit == "rad" for axis in axes.axes])
    return np.where(is_angle | (spread == 0), 1.0, spread)


def _covered(process: FrameChangeProcess) -> float:
    """Return the share of the cells of states and inputs with a learned stride."""
    axes = process.axes
    n_states = len(axes.states)
    n_periodic = len(axes.periodic)
    points = process.points.copy()
    points[:, :n_periodic] %= TURN
    points[:, n_states:] = np.clip(points[:, n_states:], axes.lower, axes.upper)
    ranges = [(0.0, TURN)] * n_periodic
    linear = points[:, n_periodic:n_states].T
    ranges += [(float(values.min()), float(values.max())) for values in linear]
    ranges += zip(axes.lower.tolist(), axes.upper.tolist(), strict=True)
    bins = [_PERIODIC_CELLS] * n_periodic
    bins += [_LINEAR_CELLS] * (len(ranges) - n_periodic)
    counts, _ = np.histogramdd(points, bins=bins, range=ranges)
    return float((counts > 0).mean())


def _unresolved(process: FrameChangeProcess) -> tuple[str, ...]:
    """Return the components on which the model sees no effect of the inputs."""
    n_states = len(process.axes.states)
    # The bound is in units of the input's deviation.
    largest = _AT_BOUND * LENGTHS[1] * process.points[:, n_states:].std(axis=0)
    scales = process.length_scales[: len(COMPONENTS), n_states:]
    is_flat = (scales >= largest).all(axis=1)
    return tuple(
        name for name, flat in zip(COMPONENTS, is_flat.tolist(), strict=True) if flat
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
        return _too_hopeful(row, arrived)
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


def _too_hopeful(row: pd.Series, arrived: float) -> Message | None:
    """Return what to say of a model that is expected to do, but lacks a state."""
    components = row.get("persistent", "")  # tables of older versions lack it
    if not isinstance(components, str) or not components:
        return None
    values = {
        "arrived": round(100 * arrived),
        "components": components.replace(" ", " and "),
    }
    return Message("steering.errors_persist", values)
