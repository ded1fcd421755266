"""How well frame changes are predicted, and how many hops it takes to learn them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.rigid import wrapped
from hopdata.steering import TRAINING, child
from hopdata.steering.frame_changes import HOPPER, FrameChanges
from hopdata.steering.models import training
from hopdata.steering.models.kernels import SMOOTHNESSES
from hopdata.steering.models.process import N_CHANGE, FrameChangeProcess
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.strides import COMPONENTS, TURN, USED, Strides

#: Half of the central 95 % of a hop's prediction, in deviations.
#: Unit: 1. Origin: table: the standard normal distribution.
WIDTH_95 = 1.959963984540054
UNITS = ("mm", "mm", "deg")
IN_UNITS = np.array([1e3, 1e3, 180 / np.pi])


def prediction_score(process: FrameChangeProcess, hops: Strides) -> pd.DataFrame:
    """Score the one-step predictions of strides.

    Returns
    -------
    DataFrame
        One row per ``component`` of the change of the pose and per state whose next
        value is learned, with its ``unit``: ``r2``, 1 minus the mean square error
        divided by the variance of the observed values (of an angle: of its increments);
        ``rmse``, the root mean square error in that unit; ``coverage``, the fraction of
        the strides within the central 95 % of their prediction.
    """
    observed = training.outputs_of(hops)
    every = range(observed.shape[1])
    predicted, sd = process.predicted(hops.points, every, observed=True)
    error = predicted - observed
    learned = [state for state in hops.axes.states if not state.is_known]
    for k, state in enumerate(learned):
        if state in hops.axes.periodic:
            column = N_CHANGE + k
            error[:, column] = wrapped(error[:, column])
    mean_square = np.mean(error**2, axis=0)
    is_within = np.abs(error) <= WIDTH_95 * sd
    in_units = np.concatenate([IN_UNITS, np.ones(len(learned))])
    return pd.DataFrame(
        {
            "component": (*COMPONENTS, *(state.name for state in learned)),
            "unit": (*UNITS, *(state.unit for state in learned)),
            "r2": 1 - mean_square / observed.var(axis=0),
            "rmse": np.sqrt(mean_square) * in_units,
            "coverage": np.mean(is_within, axis=0),
        }
    )


#: Scatter of the changes of a coordinate up to which it does not move, in multiples of
#: the noise of a marker: for the heading, of a marker at the usual distance from the
#: middle of the body.
#: Unit: 1. Origin: chosen: twice that of the difference of two markers.
STILL = 3.0


def moves_of(hops: Strides, geometry: HopperGeometry) -> BoolArray:
    """Return whether x, y and the heading change by more than noise, (3,).

    A planar robot, for example, never leaves its line.

    Parameters
    ----------
    hops : Strides
    geometry : HopperGeometry
        Markers of the body, with their noise.
    """
    changes = training.outputs_of(hops)[:, :N_CHANGE]
    arms = geometry.body_m - geometry.body_m.mean(axis=0)
    arm_m = np.sqrt(np.mean(np.sum(arms[:, :2] ** 2, axis=1)))
    noise_m = geometry.noise_m
    noise = np.array([noise_m, noise_m, noise_m / arm_m])
    return np.asarray(changes.std(axis=0) > STILL * noise)


def trained_and_scored(
    hops: Strides,
    train: FloatArray,
    test: FloatArray,
    options: training.ProcessOptions,
    seed: int,
) -> tuple[FrameChangeProcess, pd.DataFrame]:
    """Train on some rows of a table of strides, and score on other rows."""
    process = training.trained_process(hops.rows(train), options, seed=seed)
    return process, prediction_score(process, hops.rows(test))


def random_split(
    hops: int, train: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draw hops to train on; return their row numbers, and those of the rest."""
    order = rng.permutation(hops)
    return np.sort(order[:train]), np.sort(order[train:])


def learning_scores(
    changes: Strides,
    options: Mapping[Any, training.ProcessOptions],
    sizes: Sequence[int],
    *,
    draws: int,
    seed: int,
    names: Sequence[str] = ("model",),
) -> pd.DataFrame:
    """Train on random hops and test on the rest, by set-up and number of hops.

    All set-ups use the same draws, so they can be compared.

    Parameters
    ----------
    changes : Strides
    options : mapping
        Set-ups by name, or by a tuple of names.
    sizes : sequence of int
        Numbers of hops to train on.
    draws : int
        Number of random sets of each size.
    seed : int
        Seed of the draws.
    names : sequence of str
        Columns for the names of the set-ups.

    Returns
    -------
    DataFrame
        Columns ``model, hops, draw, component, unit, r2, rmse, coverage``; one row for
        each component of each draw.
    """
    hops = changes.used()
    tables = []
    for size in sizes:
        streams = np.random.SeedSequence([seed, size]).spawn(draws)
        for draw, stream in enumerate(streams):
            train, test = random_split(len(hops), size, np.random.default_rng(stream))
            for name, chosen in options.items():
                _, score = trained_and_scored(hops, train, test, chosen, seed + draw)
                name_parts = name if isinstance(name, tuple) else (name,)
                columns = dict(zip(names, name_parts, strict=True))
                columns |= {"hops": size, "draw": draw + 1}
                tables.append(pd.DataFrame({**columns, **score}))
    return pd.concat(tables, ignore_index=True)


def with_intervals(
    scores: pd.DataFrame, by: Sequence[str], values: Sequence[str]
) -> pd.DataFrame:
    """Return the mean over the draws, its standard error, and the 5 and 95 % quantiles.

    Parameters
    ----------
    scores : DataFrame
        One row per draw.
    by : sequence of str
        Columns that identify a setting.
    values : sequence of str
        Columns to average. Each yields ``<value>, <value>_se, <value>_q05,
        <value>_q95``.
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


# The process as a table over its inputs, as Figure 3.3 shows it.

COLUMNS = ("dx_mm", "dy_mm", "dtheta_deg")
CELLS_PER_TURN = 48  # of the drawn map
#: Largest swing of Fig. 3.3 as printed.
#: Unit: rad. Origin: table: the dissertation's caption, -pi/4 to pi/4.
PRINTED_MAP_RAD = np.pi / 4


@one_blas_thread()
def map_table(
    process: FrameChangeProcess, swing_limit_rad: float, *, swings: int = 33
) -> pd.DataFrame:
    """Tabulate mean and standard deviation over three turns of the boom and all swings.

    The boom angle is not wrapped, so that a process that is not periodic can be seen as
    such.

    Parameters
    ----------
    process : FrameChangeProcess
    swing_limit_rad : float
        Swings range from minus to plus this.
    swings : int
        Number of swings.

    Returns
    -------
    DataFrame
        Columns ``boom_angle_rad`` (from -2 pi to 4 pi), ``swing_rad``, the mean
        ``dx_mm, dy_mm, dtheta_deg`` and the same with ``_sd``: the standard deviation
        of the mean, without noise.
    """
    angle = np.linspace(-TURN, 2 * TURN, 3 * CELLS_PER_TURN + 1)
    swing = np.linspace(-swing_limit_rad, swing_limit_rad, swings)
    grid = np.meshgrid(angle, swing, indexing="ij")
    points = np.stack(grid, axis=-1).reshape(-1, 2)
    table = pd.DataFrame(points, columns=list(HOPPER.columns))
    table[list(COLUMNS)] = process.mean_at(points) * IN_UNITS
    table[[f"{name}_sd" for name in COLUMNS]] = process.sd_at(points) * IN_UNITS
    return table


@one_blas_thread()
def printed_map_table(process: FrameChangeProcess) -> pd.DataFrame:
    """Tabulate Fig. 3.3 as printed, on the hops that a process was trained on.

    The printed model learns from them, and the swings are within 45 degrees. See
    `map_table`.
    """
    return map_table(training.relearned(process, training.PRINTED), PRINTED_MAP_RAD)


def training_table(process: FrameChangeProcess) -> pd.DataFrame:
    """Return the training hops of a process, with the columns of `map_table`.

    Copies of hops a turn before and after are left out.
    """
    points, outputs = training.without_copies(process)
    table = pd.DataFrame(points, columns=list(HOPPER.columns))
    table[list(COLUMNS)] = outputs * IN_UNITS
    return table


# Whether a kernel of C2 functions fails to model frame changes, as the dissertation
# reports.
#
# Section 3.4.2 reports this of the Matern kernel of smoothness 5/2, and concludes that
# the dynamics are measurably only C1. It does not say which parameters are fitted and
# which are fixed, so the smoothnesses are compared in several readings of the set-up:
# see `READINGS`.
#
# If no hyper-parameter is fitted, the mean of a process depends only on the ratio of
# noise to variance, not on the units. Once the length scale is fitted and the variance
# is not, the units matter.

_FITTED = replace(training.PRINTED, length_scale=None, noise=None)
READINGS: Mapping[str, training.ProcessOptions] = {
    # As in the formula: variance and length scale 1, noise 0.1; in mm and rad.
    "printed, all fixed": training.PRINTED,
    # The length scale is fitted, the rest as before.
    "printed, length fitted": replace(training.PRINTED, length_scale=None),
    # scikit-learn's `Matern(nu) + WhiteKernel(0.1)`: 0.1 is only the initial value of
    # the noise.
    "printed, length and noise fitted, mm": _FITTED,
    "printed, length and noise fitted, m": replace(_FITTED, length_unit_m=1.0),
    "standardised, all fitted": training.RECOMMENDED,
}


def smoothness_scores(
    changes: Strides,
    *,
    train: int = 100,
    draws: int,
    seed: int,
    readings: Mapping[str, training.ProcessOptions] = READINGS,
    smoothnesses: Sequence[float] = SMOOTHNESSES,
) -> pd.DataFrame:
    """Score smoothnesses, by default four, in each reading of the set-up.

    All learn from the same hops.

    Returns
    -------
    DataFrame
        Columns of `learning_scores` with ``reading`` and ``smoothness`` in place of
        ``model``.
    """
    options = {}
    for reading, one in readings.items():
        for smoothness in smoothnesses:
            options[reading, smoothness] = replace(one, smoothness=smoothness)
    names = ("reading", "smoothness")
    return learning_scores(
        changes, options, [train], draws=draws, seed=seed, names=names
    )


#: Deviations of the noise of `smooth_truth`: that of poses from motion capture.
#: Unit: m, m, rad. Origin: chosen.
SMOOTH_NOISE = np.array([0.5e-3, 0.5e-3, 2e-3])


def smooth_truth(hops: int, swing_limit_rad: float, seed: int) -> FrameChanges:
    """Return frame changes by analytic functions of boom angle and swing.

    A kernel that fails on them does not fail for want of smoothness. They are as large
    as the hopper's, a few cm and about five degrees, with a little noise
    (`SMOOTH_NOISE`).

    Parameters
    ----------
    hops : int
        Number of hops, at random boom angles and swings.
    swing_limit_rad : float
        Swings range from minus to plus this.
    seed : int
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
    return FrameChanges.hops(
        recording=np.full(hops, "smooth truth"),
        time_s=np.arange(hops, dtype=float),
        boom_angle_rad=angle,
        swing_rad=swing,
        change=change + SMOOTH_NOISE * rng.standard_normal(change.shape),
        reason=np.full(hops, USED),
    )


# From the table of frame changes to a model, and its score on the other hops.

#: Hops that must be left to test on.
#: Unit: 1. Origin: derived: the fewest that have a variance.
LEFT_TO_TEST = 2


@one_blas_thread()
def learn(
    changes: Strides, options: Mapping[str, Any], *, seed: np.random.SeedSequence
) -> tuple[FrameChangeProcess, pd.DataFrame]:
    """Learn from a random selection of ``steering.model.training_hops`` hops.

    Parameters
    ----------
    changes : Strides
    options : mapping
        Block ``steering.model`` of the configuration.

    Returns
    -------
    process : FrameChangeProcess
    scores : DataFrame
        On the other hops: ``component, unit, r2, rmse, coverage, training_hops,
        test_hops``.

    Raises
    ------
    AnalysisError
        If there are too few hops.
    """
    n_train = options["training_hops"]
    train, rest = learned_and_rest(changes, options, seed=seed)
    process = training.trained_process(train, training.process_of(options))
    score = prediction_score(process, rest)
    return process, score.assign(training_hops=n_train, test_hops=len(rest))


def learned_and_rest(
    changes: Strides, options: Mapping[str, Any], *, seed: np.random.SeedSequence
) -> tuple[Strides, Strides]:
    """Return the hops that `learn` learns from, and those that it tests on.

    See `learn`.
    """
    n_train = options["training_hops"]
    hops = hops_to_learn_from(changes, n_train)
    rng = np.random.default_rng(child(seed, TRAINING))
    train, rest = random_split(len(hops), n_train, rng)
    return hops.rows(train), hops.rows(rest)


def hops_to_learn_from(changes: Strides, training_hops: int) -> Strides:
    """Return the used strides, if they suffice to learn from and to test on two more.

    Raises
    ------
    AnalysisError
        If there are too few; the message counts the hops, and those left out by reason.
    """
    hops = changes.used()
    left_out = f"(left out of {len(changes)}: {changes.excluded() or 'none'})"
    least = training.LEAST_HOPS + LEFT_TO_TEST
    if len(hops) < least:
        wanted = f"at least {least} hops that can be used, to learn from and to test on"
        raise AnalysisError.at("steering", wanted, f"{len(hops)} {left_out}")
    if len(hops) < training_hops + LEFT_TO_TEST:
        most = len(hops) - LEFT_TO_TEST
        wanted = f"at most {most}, two fewer than the {len(hops)} hops that can be used"
        found = f"{training_hops} {left_out}"
        raise AnalysisError.at("steering.model.training_hops", wanted, found)
    return hops


# How many hops it takes to learn the frame change, and whether the kernel matters.

MODELS = {"printed": training.PRINTED, "recommended": training.RECOMMENDED}
#: Numbers of hops of the learning curve.
#: Unit: 1. Origin: chosen.
SIZES = (20, 35, 60, 100, 170)
#: Fewest hops left to test on, for a size to be on the curve.
#: Unit: 1. Origin: chosen.
LEAST_TESTED = 30
SCORES = ("r2", "rmse", "coverage")


@one_blas_thread()
def learning_tables(
    changes: Strides, *, training_hops: int, draws: int, seed: int
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Learn from random sets of hops, of several sizes and with several kernels.

    Both tables hold means over the random sets, with their spread.

    Parameters
    ----------
    changes : Strides
    training_hops : int
        Number of hops for comparing kernels.
    draws : int
        Number of random sets of each size.
    seed : int

    Returns
    -------
    curve : DataFrame
        ``model, hops, component, unit``, and for each of ``r2, rmse, coverage`` the
        mean, its standard error (``_se``) and the 5 and 95 % quantiles over the sets
        (``_q05``, ``_q95``).
    kernels : DataFrame
        The same by ``data, reading, smoothness, component, unit``.

    Raises
    ------
    AnalysisError
        If there are too few hops for the smallest size or for `training_hops`; nothing
        has been learned by then.
    """
    used = hops_to_learn_from(changes, training_hops)
    sizes = [size for size in SIZES if size <= len(used) - LEAST_TESTED]
    if not sizes:
        least = SIZES[0] + LEAST_TESTED
        raise AnalysisError.at("learning curve", f"at least {least} hops", len(used))
    curve = learning_scores(changes, MODELS, sizes, draws=draws, seed=seed)
    kernels = smoothness_scores(changes, train=training_hops, draws=draws, seed=seed)
    kernels = kernels.assign(data="hopper")
    settings = ["model", "hops", "component", "unit"]
    kernel_settings = ["data", "reading", "smoothness", "component", "unit"]
    return (
        with_intervals(curve, settings, SCORES),
        with_intervals(kernels, kernel_settings, SCORES),
    )
