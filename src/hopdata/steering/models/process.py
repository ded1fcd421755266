"""Gaussian processes of a stride: one for each component of what it changes.

They predict the change of the pose, and those next states of the robot that do not
follow from state and inputs. scikit-learn finds their hyper-parameters and predicts
(Rasmussen and Williams 2006, Sec. 2.2).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import (
    AnalysisError,
    ConfigError,
    RecordingError,
    chosen,
    require,
)
from hopdata.foreign.npz import arrays_of
from hopdata.jobs import whole_file
from hopdata.rigid import wrapped
from hopdata.steering.models.kernels import (
    SMOOTHNESSES,
    embedded,
    fitted_matern,
    matern,
)
from hopdata.steering.models.tabulated import TabulatedMap, tabulated
from hopdata.steering.strides import TURN, StrideAxes, Strides

# Components of the change of the pose, the first outputs of all processes.
N_CHANGE = 3


@dataclass(frozen=True, kw_only=True)
class FrameChangeProcess:
    """Gaussian processes of a stride with D states and inputs and J outputs.

    The outputs are the change of the pose and, for each state that is not known, the
    increment of a periodic one or the next value of a linear one.

    Parameters
    ----------
    axes : StrideAxes
        States and inputs.
    smoothness : float
        Smoothness of the kernel: see `ProcessOptions`.
    periodic : bool
        Whether periodic states are compared as points on the circle.
    points : (m, D) array
        Training states and inputs, including copies.
    outputs : (m, J) array
        Training outputs: m, m, rad, and the units of the states.
    offset, unit : (J,) arrays
        Output j is modelled as ``(output - offset) / unit``.
    variance, noise : (J,) arrays
        Variances of the process and of the white noise, in squared units of the
        modelled output.
    length_scales : (J, D) array
        Length scale of each state and input for each output.
    """

    axes: StrideAxes
    smoothness: float
    periodic: bool
    points: FloatArray
    outputs: FloatArray
    offset: FloatArray
    unit: FloatArray
    variance: FloatArray
    noise: FloatArray
    length_scales: FloatArray

    def __post_init__(self) -> None:
        m = len(self.points)
        n_axes = len(self.axes.axes)
        n_outputs = N_CHANGE + int((~self.axes.is_known).sum())
        shapes: dict[str, tuple[int, ...]] = {
            "points": (m, n_axes),
            "outputs": (m, n_outputs),
            "length_scales": (n_outputs, n_axes),
        }
        names = ("offset", "unit", "variance", "noise")
        shapes |= dict.fromkeys(names, (n_outputs,))
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(
                    f"{name}: expected {shape}, found {getattr(self, name).shape}"
                )

    @property
    def n_embedded(self) -> int:
        """Number of states that are compared as points on the circle."""
        return len(self.axes.periodic) if self.periodic else 0

    @property
    def noise_sd(self) -> FloatArray:
        """Standard deviation of the noise of a change of pose, (3,), m, m, rad."""
        return np.asarray(np.sqrt(self.noise) * self.unit)[:N_CHANGE]

    def kernel(self, j: int) -> Any:
        """Return the correlation function of output j, of embedded points."""
        return matern(self.length_scales[j], self.smoothness, self.n_embedded)

    @one_blas_thread()
    def regressor(self, j: int) -> Any:
        """Return scikit-learn's regressor of output j, of embedded points.

        Raises
        ------
        AnalysisError
            If the covariance is not positive definite.
        """
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import ConstantKernel

        kernel = ConstantKernel(self.variance[j], "fixed") * self.kernel(j)
        regressor = GaussianProcessRegressor(
            kernel, alpha=self.noise[j], optimizer=None
        )
        target = (self.outputs[:, j] - self.offset[j]) / self.unit[j]
        try:
            return regressor.fit(embedded(self.points, self.n_embedded), target)
        except np.linalg.LinAlgError as error:
            wanted = "a positive definite covariance"
            found = (
                "one that is not; the noise is too small for strides that are this "
                "similar"
            )
            raise AnalysisError.at("Gaussian process", wanted, found) from error

    @cached_property
    def regressors(self) -> list[Any]:
        """scikit-learn's regressor of each output."""
        return [self.regressor(j) for j in range(len(self.offset))]

    def change(self, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Return the expected changes of the pose (n, 3), m, m, rad.

        Parameters
        ----------
        state, inputs : (n, S) and (n, U) arrays
            See `StrideAxes.points`.
        """
        return self.mean_at(self._points(state, inputs))

    def sd(
        self, state: ArrayLike, inputs: ArrayLike, *, observed: bool = False
    ) -> FloatArray:
        """Return predictive standard deviations (n, 3) of the change, m, m, rad.

        Of the expected change or, if `observed`, of a single stride, including the
        white noise.
        """
        return self.sd_at(self._points(state, inputs), observed=observed)

    def next_state(self, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Return the expected states (n, S) after strides; periodic in [0, 2 pi)."""
        points = self._points(state, inputs)
        n_states = len(self.axes.states)
        states = points[:, :n_states]
        after = self.axes.next_state(states, points[:, n_states:])
        is_learned = ~self.axes.is_known
        if is_learned.any():
            learned = range(N_CHANGE, len(self.offset))
            after[:, is_learned] = self._means(points, learned)
            is_angle = is_learned & self.axes.is_periodic
            after[:, is_angle] += states[:, is_angle]
        return self.axes.wrapped(after)

    def mean_at(self, points: ArrayLike) -> FloatArray:
        """Return expected changes of the pose (n, 3) at states and inputs (n, D).

        Periodic states are not wrapped, which matters only for processes that are not
        periodic.
        """
        return self._means(points, range(N_CHANGE))

    @one_blas_thread()
    def sd_at(self, points: ArrayLike, *, observed: bool = False) -> FloatArray:
        """Return predictive standard deviations (n, 3) at states and inputs (n, D).

        See `mean_at` and `sd`.
        """
        return self.predicted(points, range(N_CHANGE), observed=observed)[1]

    @one_blas_thread()
    def _means(self, points: ArrayLike, outputs: Iterable[int]) -> FloatArray:
        """Return expected outputs (n, J) at states and inputs (n, D), by number."""
        at = embedded(points, self.n_embedded)
        numbers = list(outputs)
        means = np.empty((len(at), len(numbers)))
        if not len(at):
            return means
        for k, j in enumerate(numbers):
            mean = self.regressors[j].predict(at)
            means[:, k] = self.offset[j] + self.unit[j] * mean
        return means

    @one_blas_thread()
    def predicted(
        self, points: ArrayLike, outputs: Iterable[int], *, observed: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Return means and standard deviations (n, J) of outputs, by their numbers.

        See `mean_at` and `sd`.
        """
        at = embedded(points, self.n_embedded)
        numbers = list(outputs)
        means = np.empty((len(at), len(numbers)))
        sds = np.empty_like(means)
        if not len(at):
            return means, sds
        for k, j in enumerate(numbers):
            mean, sd = self.regressors[j].predict(at, return_std=True)
            of_noise = self.noise[j] if observed else 0.0
            means[:, k] = self.offset[j] + self.unit[j] * mean
            sds[:, k] = np.sqrt(sd**2 + of_noise) * self.unit[j]
        return means, sds

    def _points(self, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        points = self.axes.points(state, inputs)
        if not self.periodic:
            n_periodic = len(self.axes.periodic)
            points[:, :n_periodic] %= TURN
        return points

    @cached_property
    def table(self) -> TabulatedMap | None:
        """The changes as a table over one angle and one input, else nothing.

        The limits of the input are those of its axis. A process that was read has it
        from its file.
        """
        limit = symmetric_limit(self.axes)
        if limit is None:
            return None
        return tabulated(self, limit)

    def table_within(self, limit: float) -> TabulatedMap:
        """Return the table of one angle and one input up to a limit."""
        if self.table is not None and self.table.swing_limit_rad == limit:
            return self.table
        return tabulated(self, limit)


def symmetric_limit(axes: StrideAxes) -> float | None:
    """Return the limit of the input of a robot that a table is made for.

    It has one state, an angle that its one input moves, by as much to either side.
    """
    is_small = len(axes.periodic) == len(axes.inputs) == 1 and not axes.linear
    if not is_small or not axes.periodic[0].moved_by:
        return None
    (command,) = axes.inputs
    return command.upper if command.upper == -command.lower else None


# Trained processes on disk: one `.npz` file, written whole or not at all. It holds the
# training data, the hyper-parameters and the table, and nothing that runs.

#: Training strides of a process that is read. Covariances grow as their square.
#: Unit: 1. Origin: chosen: its covariances take 600 MB. The printed model has 1,500.
MOST_POINTS = 5_000

#: Fewest nodes of an axis of a table.
#: Unit: 1. Origin: derived: of a cubic spline.
LEAST_NODES = 4

# Bytes of its file, and of each array: up to 20 numbers for each stride, and the table.
_MOST_BYTES = 256 * MOST_POINTS

_AXES = "axes"
_TABLE = "table"


def save_process(path: str | Path, process: FrameChangeProcess) -> None:
    """Write a process: its fields, its axes as JSON, and its table."""
    arrays = {name: getattr(process, name) for name in _numbers()}
    text = json.dumps(process.axes.as_dict())
    arrays[_AXES] = np.frombuffer(text.encode(), dtype=np.uint8)
    values = np.zeros((0, 0, N_CHANGE))
    if process.table is not None:
        values = process.table.values
    arrays[_TABLE] = values
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def _numbers() -> list[str]:
    """Return the names of the fields of a process that are numbers."""
    return [one.name for one in fields(FrameChangeProcess) if one.name != _AXES]


def load_process(path: str | Path) -> FrameChangeProcess:
    """Read a process that `save_process` wrote.

    Raises
    ------
    RecordingError
        If the file is missing or holds something else.
    """
    names = [_AXES, *_numbers(), _TABLE]
    wanted = f"a trained process with {', '.join(names)}"
    arrays: dict[str, Any] = arrays_of(path, names, wanted=wanted, most=_MOST_BYTES)
    try:
        text = arrays.pop(_AXES).astype(np.uint8).tobytes().decode()
        axes = StrideAxes.of_dict(json.loads(text))
        # Of any precision and order of bytes; what is too large is refused below.
        with np.errstate(over="ignore"):
            arrays = {name: array.astype(float) for name, array in arrays.items()}
        values = arrays.pop(_TABLE)
        arrays["smoothness"] = float(arrays["smoothness"])
        arrays["periodic"] = bool(arrays["periodic"])
        process = FrameChangeProcess(axes=axes, **arrays)
        _require_usable(process)
        table = _checked_table(values, axes)
    except (ValueError, TypeError, KeyError, ConfigError) as error:
        raise RecordingError.at(path, wanted, f"another file: {error}") from error
    # As the cached property would keep it: what is stored need not be computed.
    vars(process)[_TABLE] = table
    return process


def _checked_table(values: FloatArray, axes: StrideAxes) -> TabulatedMap | None:
    """Return the table of a file, which has one where the axes allow it.

    Raises
    ------
    ValueError
        If it has the wrong shape, or a number is not finite.
    """
    limit = symmetric_limit(axes)
    if limit is None:
        return None
    is_sound = values.ndim == 3 and values.shape[2] == N_CHANGE
    if not is_sound or min(values.shape[:2]) < LEAST_NODES:
        raise ValueError(f"table: expected (A, S, 3), found {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError("table is not finite")
    return TabulatedMap(values, limit)


def _require_usable(process: FrameChangeProcess) -> None:
    """Require numbers with which a process can predict.

    Raises
    ------
    ValueError
        If one is not finite, a scale is not above zero, or there are too many strides.
    """
    if process.smoothness not in SMOOTHNESSES:
        raise ValueError(f"smoothness {process.smoothness}")
    if not 0 < len(process.points) <= MOST_POINTS:
        raise ValueError(f"{len(process.points)} points, where 1 to {MOST_POINTS} fit")
    for name in _numbers():
        # The smoothness of the Gaussian kernel is infinite.
        is_finite = bool(np.isfinite(getattr(process, name)).all())
        if not is_finite and name != "smoothness":
            raise ValueError(f"{name} is not finite")
    for name in ("unit", "variance", "noise", "length_scales"):
        if not (getattr(process, name) > 0).all():
            raise ValueError(f"{name} is not above zero")


# From a table of strides to a trained process: its set-up (the printed one, the
# recommended one, or another in between), its hyper-parameters, and the training.


@dataclass(frozen=True, kw_only=True)
class ProcessOptions:
    """Options of the Gaussian processes.

    Parameters
    ----------
    smoothness : float
        Smoothness of the Matern kernel: 0.5, 1.5, 2.5, or infinity for the Gaussian
        kernel.
    periodic : bool
        Compare periodic states as points on the circle. Otherwise copies of the
        training set are added one turn before and one turn after, as printed.
    standardised : bool
        Centre each output and divide it by its standard deviation; divide linear states
        and inputs by theirs. Otherwise outputs are modelled as they are, about zero.
    length_unit_m : float
        Unit of length of the modelled frame changes if not standardised, m; headings
        are in rad.
    own_scales : bool
        Use a length scale for each state and input. Otherwise all share one.
    variance : float, optional
        Variance of the process, in squared units of the output; fitted by default.
    noise : float, optional
        Variance of the white noise, likewise.
    length_scale : float, optional
        Length scale of all states and inputs, in rad or, if standardised, in their
        units; fitted by default.
    restarts : int
        Number of further random starts of the search for hyper-parameters.
    """

    smoothness: float = 1.5
    periodic: bool = True
    standardised: bool = True
    length_unit_m: float = 1e-3
    own_scales: bool = True
    variance: float | None = None
    noise: float | None = None
    length_scale: float | None = None
    restarts: int = 1

    def __post_init__(self) -> None:
        is_known = self.smoothness in SMOOTHNESSES
        known = f"one of {', '.join(map(str, SMOOTHNESSES))}"
        require(is_known, "smoothness", known, self.smoothness)
        for name in ("variance", "noise", "length_scale", "length_unit_m"):
            value = getattr(self, name)
            require(value is None or value > 0, name, "more than 0", value)


RECOMMENDED = ProcessOptions()

# The formula in Section 3.4.2 has neither a variance nor a length scale, so both are 1.
# Motion capture yields mm.
PRINTED = ProcessOptions(
    periodic=False,
    standardised=False,
    own_scales=False,
    variance=1.0,
    noise=0.1,
    length_scale=1.0,
    restarts=0,
)


# Hyper-parameters of largest marginal likelihood, by scikit-learn.

#: Bounds of the variance of a process, of standardised inputs and outputs.
#: Unit: 1. Origin: chosen.
VARIANCES = (1e-4, 1e4)
#: Bounds of the variance of the noise, likewise.
#: Unit: 1. Origin: chosen.
NOISES = (1e-6, 1e2)
#: Bounds of a length scale, likewise.
#: Unit: 1. Origin: derived: 100 hops cannot resolve anything finer than a third of the
#: spread of an input, which is about a step of the printed grid of boom angles.
LENGTHS = (0.3, 1e3)
#: Bounds of all parameters if inputs and outputs are not standardised.
#: Unit: of the parameter. Origin: convention: scikit-learn's own.
UNSCALED = (1e-5, 1e5)
#: Variance of the noise with which the search begins.
#: Unit: 1. Origin: chosen.
FIRST_NOISE = 0.1


def fitted_regressor(
    points: FloatArray,
    target: FloatArray,
    options: ProcessOptions,
    seed: int,
    *,
    n_periodic: int = 1,
) -> Any:
    """Fit scikit-learn's regressor to one modelled output.

    Parameters
    ----------
    points : (m, D) array
        States and inputs, in units of the length scales.
    target : (m,) array
        The modelled output.
    options : ProcessOptions
    seed : int
        Seed of the random restarts.
    n_periodic : int
        How many of the states are angles; they stand first.
    """
    import warnings

    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor

    n_embedded = n_periodic if options.periodic else 0
    regressor = GaussianProcessRegressor(
        _kernel(options, points.shape[1], n_embedded),
        alpha=0.0,
        n_restarts_optimizer=options.restarts,
        random_state=seed,
    )
    with one_blas_thread(), warnings.catch_warnings():
        # A length scale at its bound means that the input does not matter: that is no
        # reason to warn.
        warnings.simplefilter("ignore", ConvergenceWarning)
        return regressor.fit(embedded(points, n_embedded), target)


def hyper_parameters(regressor: Any, n_axes: int) -> tuple[float, FloatArray, float]:
    """Return variance, length scales (n_axes,) and noise of a fitted regressor."""
    # As `_kernel` puts them together: (constant * Matern) + white.
    correlation = regressor.kernel_.k1
    white = regressor.kernel_.k2
    variance = float(correlation.k1.constant_value)
    lengths = np.full(n_axes, correlation.k2.length_scale, dtype=float)
    return variance, lengths, float(white.noise_level)


def _kernel(options: ProcessOptions, n_axes: int, n_embedded: int) -> Any:
    """Return scikit-learn's kernel with its first values and bounds."""
    from sklearn.gaussian_process.kernels import ConstantKernel, WhiteKernel

    def bounds(value: float | None, free: tuple[float, float]) -> Any:
        if value is not None:
            return "fixed"
        return free if options.standardised else UNSCALED

    length = options.length_scale or 1.0
    lengths = np.full(n_axes, length) if options.own_scales else length
    length_bounds = bounds(options.length_scale, LENGTHS)
    shape = fitted_matern(lengths, length_bounds, options.smoothness, n_embedded)
    variance_bounds = bounds(options.variance, VARIANCES)
    noise_bounds = bounds(options.noise, NOISES)
    variance = ConstantKernel(options.variance or 1.0, variance_bounds)
    noise = WhiteKernel(options.noise or FIRST_NOISE, noise_bounds)
    return variance * shape + noise


#: Least number of hops to learn from.
#: Unit: 1. Origin: chosen.
LEAST_HOPS = 10


def trained_process(
    strides: Strides, options: ProcessOptions = RECOMMENDED, *, seed: int = 0
) -> FrameChangeProcess:
    """Train the processes on the used strides of a table.

    Parameters
    ----------
    strides : Strides
    options : ProcessOptions
    seed : int
        Seed of the random restarts of the search for hyper-parameters.

    Raises
    ------
    AnalysisError
        If there are fewer than `LEAST_HOPS` used strides.
    """
    points, outputs = training_set(strides)
    return process_on(strides.axes, points, outputs, options, seed=seed)


def process_on(
    axes: StrideAxes,
    points: FloatArray,
    outputs: FloatArray,
    options: ProcessOptions,
    *,
    seed: int = 0,
) -> FrameChangeProcess:
    """Train the processes on these strides, as `trained_process` does.

    Parameters
    ----------
    axes : StrideAxes
    points : (m, D) array
        State and inputs of each stride; periodic states in [0, 2 pi).
    outputs : (m, J) array
        See `FrameChangeProcess`.
    options : ProcessOptions
    seed : int
        Seed of the random restarts of the search for hyper-parameters.
    """
    n_periodic = len(axes.periodic)
    offset, unit = _offset_and_unit(outputs, options)
    scale = axis_units(points, options, n_periodic=n_periodic)
    if not options.periodic:
        points, outputs = _with_copies(points, outputs, n_periodic)
    targets = (outputs - offset) / unit
    found = []
    for target in targets.T:
        regressor = fitted_regressor(
            points / scale, target, options, seed, n_periodic=n_periodic
        )
        found.append(hyper_parameters(regressor, len(scale)))
    return FrameChangeProcess(
        axes=axes,
        smoothness=options.smoothness,
        periodic=options.periodic,
        points=points,
        outputs=outputs,
        offset=offset,
        unit=unit,
        variance=np.array([variance for variance, _, _ in found]),
        noise=np.array([noise for _, _, noise in found]),
        length_scales=np.array([lengths for _, lengths, _ in found]) * scale,
    )


def _with_copies(
    points: FloatArray, outputs: FloatArray, n_periodic: int
) -> tuple[FloatArray, FloatArray]:
    """Add copies a turn before and a turn after in each angle (Sec. 3.4.2)."""
    copies = []
    for turns in product((-1, 0, 1), repeat=n_periodic):
        shift = np.zeros(points.shape[1])
        shift[:n_periodic] = turns
        copies.append(points + TURN * shift)
    return np.concatenate(copies), np.tile(outputs, (len(copies), 1))


def relearned(
    process: FrameChangeProcess, options: ProcessOptions
) -> FrameChangeProcess:
    """Train processes with another set-up on the strides of this one."""
    points, outputs = without_copies(process)
    return process_on(process.axes, points, outputs, options)


def without_copies(process: FrameChangeProcess) -> tuple[FloatArray, FloatArray]:
    """Return the strides that a process was trained on, without copies a turn away."""
    angles = process.points[:, : len(process.axes.periodic)]
    is_once = ((angles >= 0) & (angles < TURN)).all(axis=1)
    return process.points[is_once], process.outputs[is_once]


def training_set(strides: Strides) -> tuple[FloatArray, FloatArray]:
    """Return states and inputs (n, D) and outputs (n, J) of used strides.

    See `FrameChangeProcess`.
    """
    used = strides.used()
    if len(used) < LEAST_HOPS:
        wanted = f"at least {LEAST_HOPS} hops to learn from"
        excluded = strides.excluded() or "none"
        found = f"{len(used)} of {len(strides)} (excluded: {excluded})"
        raise AnalysisError.at("frame changes", wanted, found)
    return used.points, outputs_of(used)


def outputs_of(strides: Strides) -> FloatArray:
    """Return the outputs (n, J) of strides; see `FrameChangeProcess`."""
    is_angle = strides.axes.is_periodic
    after = strides.next_state.copy()
    after[:, is_angle] = _increments(strides.state[:, is_angle], after[:, is_angle])
    learned = after[:, ~strides.axes.is_known]
    return np.column_stack([strides.change, learned])


def _increments(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return increments of angles (n, P) within half a turn of their mean direction."""
    increments = after - before
    mean = np.angle(np.exp(1j * increments).mean(axis=0))
    return np.asarray(mean + wrapped(increments - mean))


def _offset_and_unit(
    outputs: FloatArray, options: ProcessOptions
) -> tuple[FloatArray, FloatArray]:
    """Return offset and unit of each output, (J,): see `FrameChangeProcess`."""
    n_outputs = outputs.shape[1]
    if not options.standardised:
        units = np.ones(n_outputs)
        units[:2] = options.length_unit_m
        return np.zeros(n_outputs), units
    spread = outputs.std(axis=0)
    return outputs.mean(axis=0), np.where(spread > 0, spread, 1.0)


def axis_units(
    points: FloatArray, options: ProcessOptions, *, n_periodic: int = 1
) -> FloatArray:
    """Return the units of states and inputs, (D,): 1 rad, and standard deviations."""
    units = np.ones(points.shape[1])
    if options.standardised:
        spread = points[:, n_periodic:].std(axis=0)
        units[n_periodic:] = np.where(spread > 0, spread, 1.0)  # all may be alike
    return units


KERNELS = {"recommended": RECOMMENDED, "printed": PRINTED}


def process_of(options: Mapping[str, Any]) -> ProcessOptions:
    """Return the set-up of the processes named by the block ``steering.model``."""
    return chosen("steering.model.kernel", options["kernel"], KERNELS)
