"""From a table of strides to a trained process: set-up, hyper-parameters, training.

The set-up is the printed one, the recommended one, or another in between. scikit-learn
finds the hyper-parameters of largest marginal likelihood.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import AnalysisError, chosen, require
from hopdata.rigid import wrapped
from hopdata.steering.models.kernels import SMOOTHNESSES, embedded, fitted_matern
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.strides import TURN, StrideAxes, Strides


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
