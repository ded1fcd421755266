"""From a table of frame changes to a trained process."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import AnalysisError, chosen, require, require_choice
from hopdata.steering.frame_changes import FrameChanges
from hopdata.steering.models.process import (
    SMOOTHNESSES,
    TURN,
    FrameChangeProcess,
    embedded,
)

# How the processes are set up: the printed way, the recommended one, and others between them.

# What of the hop before are inputs: columns of `FrameChanges`.
HISTORIES: dict[str, tuple[str, ...]] = {
    "none": (),
    "swing": ("previous_swing_rad",),
    "change": ("previous_change",),
}


@dataclass(frozen=True, kw_only=True)
class ProcessOptions:
    """Options of the three Gaussian processes.

    Parameters
    ----------
    smoothness : float
        Of the Matern kernel, 0.5, 1.5 or 2.5, or infinity for the Gaussian one.
    periodic : bool
        Compare boom angles by points on the circle. Otherwise the training set is copied a turn
        before and a turn after, as printed.
    history : {"none", "swing", "change"}
        What of the hop before are inputs beside boom angle and swing.
    standardised : bool
        Centre each component of the frame change and divide it by its standard deviation, and
        divide the inputs but the boom angle by theirs. Otherwise frame changes are modelled as they
        are, about zero.
    length_unit_m : float
        Unit of length in which they are modelled if not standardised, m; turns are in rad.
    own_scales : bool
        A length scale for each input. Otherwise one for all.
    variance : float, optional
        Variance of the process, in squared units of the output; fitted if not given.
    noise : float, optional
        Variance of the white noise, likewise.
    length_scale : float, optional
        Length scale of all inputs, in rad or, if standardised, their units; fitted if not given.
    restarts : int
        Further random starts of the search for hyper-parameters.
    """

    smoothness: float = 1.5
    periodic: bool = True
    history: str = "none"
    standardised: bool = True
    length_unit_m: float = 1e-3
    own_scales: bool = True
    variance: float | None = None
    noise: float | None = None
    length_scale: float | None = None
    restarts: int = 1

    def __post_init__(self) -> None:
        known = ", ".join(map(str, SMOOTHNESSES))
        require(self.smoothness in SMOOTHNESSES, "smoothness", f"one of {known}", self.smoothness)
        require_choice("history", self.history, HISTORIES)
        for name in ("variance", "noise", "length_scale", "length_unit_m"):
            value = getattr(self, name)
            require(value is None or value > 0, name, "more than 0", value)


RECOMMENDED = ProcessOptions()
WITH_PREVIOUS_SWING = ProcessOptions(history="swing")
WITH_PREVIOUS_CHANGE = ProcessOptions(history="change")

# The formula of Section 3.4.2 has no variance and no length scale, so both are 1; motion capture
# gives mm.
PRINTED = ProcessOptions(
    periodic=False,
    standardised=False,
    own_scales=False,
    variance=1.0,
    noise=0.1,
    length_scale=1.0,
    restarts=0,
)


def process_inputs(changes: FrameChanges, history: str) -> FloatArray:
    """Return the inputs (n, d): boom angle, swing, and what `history` adds; NaN where unknown."""
    added = [getattr(changes, name) for name in chosen("history", history, HISTORIES)]
    return np.column_stack([changes.boom_angle_rad, changes.swing_rad, *added])


# Hyper-parameters of largest marginal likelihood, by scikit-learn.

# Bounds of the search, for standardised inputs and outputs. What is finer than a third of the
# spread of an input, about a step of the printed grid of boom angles, 100 hops cannot show.
VARIANCES = (1e-4, 1e4)
NOISES = (1e-6, 1e2)
LENGTHS = (0.3, 1e3)
UNSCALED = (1e-5, 1e5)  # of all where units are not standardised: scikit-learn's own
FIRST_NOISE = 0.1


def fitted_regressor(
    inputs: FloatArray, target: FloatArray, options: ProcessOptions, seed: int
) -> Any:
    """Return scikit-learn's regressor of one modelled output.

    Parameters
    ----------
    inputs : (m, d) array
        Boom angle, swing and history, in the units of the length scales.
    target : (m,) array
        The output as modelled.
    options : ProcessOptions
    seed : int
        Of the random restarts.
    """
    import warnings

    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor

    regressor = GaussianProcessRegressor(
        _kernel(options, inputs.shape[1]),
        alpha=0.0,
        n_restarts_optimizer=options.restarts,
        random_state=seed,
    )
    with one_blas_thread(), warnings.catch_warnings():
        # A length scale at its bound means that the input does not matter: no reason to warn.
        warnings.simplefilter("ignore", ConvergenceWarning)
        return regressor.fit(embedded(inputs, options.periodic), target)


def hyper_parameters(regressor: Any, n_inputs: int) -> tuple[float, FloatArray, float]:
    """Return variance, length scales (d,) and noise of a regressor."""
    product, white = regressor.kernel_.k1, regressor.kernel_.k2
    lengths = np.broadcast_to(np.atleast_1d(product.k2.length_scale), (n_inputs,))
    return float(product.k1.constant_value), lengths.astype(float), float(white.noise_level)


def _kernel(options: ProcessOptions, n_inputs: int) -> Any:
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    def bounds(value: float | None, free: tuple[float, float]) -> Any:
        if value is not None:
            return "fixed"
        return free if options.standardised else UNSCALED

    length = options.length_scale or 1.0
    lengths = np.full(n_inputs, length) if options.own_scales else length
    matern = _embedded_matern() if options.periodic else Matern
    variance = ConstantKernel(options.variance or 1.0, bounds(options.variance, VARIANCES))
    shape = matern(lengths, bounds(options.length_scale, LENGTHS), nu=options.smoothness)
    noise = WhiteKernel(options.noise or FIRST_NOISE, bounds(options.noise, NOISES))
    return variance * shape + noise


@cache
def _embedded_matern() -> Any:
    """Return scikit-learn's Matern kernel on embedded inputs: one length for cosine and sine."""
    from sklearn.gaussian_process.kernels import Matern

    class EmbeddedMatern(Matern):  # type: ignore[misc]
        """Its length scales are those of the inputs, the boom angle first."""

        def __call__(self, X: FloatArray, Y: Any = None, eval_gradient: bool = False) -> Any:
            if not np.ndim(self.length_scale):
                return super().__call__(X, Y, eval_gradient)
            lengths = np.concatenate([self.length_scale[:1], self.length_scale])
            plain = Matern(lengths, self.length_scale_bounds, nu=self.nu)
            if not eval_gradient or self.hyperparameter_length_scale.fixed:
                return plain(X, Y, eval_gradient)
            covariance, gradient = plain(X, Y, True)
            tied = np.concatenate(
                [gradient[..., :1] + gradient[..., 1:2], gradient[..., 2:]], axis=-1
            )
            return covariance, tied

    return EmbeddedMatern


LEAST_HOPS = 10

logger = logging.getLogger(__name__)


def trained_process(
    changes: FrameChanges, options: ProcessOptions = RECOMMENDED, *, seed: int = 0
) -> FrameChangeProcess:
    """Train the three processes on the used hops of a table.

    Hops whose inputs are not all known, as with history after a break, are left out; their number
    is logged.

    Parameters
    ----------
    changes : FrameChanges
    options : ProcessOptions
    seed : int
        Of the random restarts of the search for hyper-parameters.

    Raises
    ------
    AnalysisError
        If fewer than `LEAST_HOPS` hops remain.
    """
    inputs, outputs = training_set(changes, options.history)
    offset, unit = _modelled(outputs, options)
    scale = input_units(inputs, options)
    if not options.periodic:
        inputs, outputs = _copies(inputs), np.tile(outputs, (3, 1))
    targets = (outputs - offset) / unit
    regressors = [fitted_regressor(inputs / scale, y, options, seed) for y in targets.T]
    found = [hyper_parameters(regressor, inputs.shape[1]) for regressor in regressors]
    variance, lengths, noise = zip(*found, strict=True)
    return FrameChangeProcess(
        smoothness=options.smoothness,
        periodic=options.periodic,
        inputs=inputs,
        outputs=outputs,
        offset=offset,
        unit=unit,
        variance=np.array(variance),
        noise=np.array(noise),
        length_scales=np.array(lengths) * scale,
    )


def training_set(changes: FrameChanges, history: str = "none") -> tuple[FloatArray, FloatArray]:
    """Return inputs (n, d) and frame changes (n, 3) of the used hops whose inputs are known."""
    used = changes.used()
    inputs = process_inputs(used, history)
    known = np.asarray(np.isfinite(inputs).all(axis=1))
    if not known.all():
        logger.info("%d of %d hops have no hop before them", np.sum(~known), len(known))
    if known.sum() < LEAST_HOPS:
        raise AnalysisError(
            f"frame changes: expected at least {LEAST_HOPS} hops to learn from, "
            f"found {known.sum()} of {len(changes)} (excluded: {changes.excluded() or 'none'}; "
            f"without a hop before: {np.sum(~known)})"
        )
    return inputs[known], used.change[known]


def _modelled(outputs: FloatArray, options: ProcessOptions) -> tuple[FloatArray, FloatArray]:
    """Offset and unit of the modelled outputs."""
    if not options.standardised:
        return np.zeros(3), np.array([options.length_unit_m, options.length_unit_m, 1.0])
    unit = outputs.std(axis=0)
    return outputs.mean(axis=0), np.where(unit > 0, unit, 1.0)


def input_units(inputs: FloatArray, options: ProcessOptions) -> FloatArray:
    """Units of the inputs, (d,): 1 rad for the boom angle, the standard deviation of the others."""
    units = np.ones(inputs.shape[1])
    if options.standardised:
        units[1:] = inputs[:, 1:].std(axis=0)
    return np.where(units > 0, units, 1.0)


def _copies(inputs: FloatArray) -> FloatArray:
    """Return the inputs a turn before, where they are, and a turn after (Sec. 3.4.2)."""
    shift = np.zeros(inputs.shape[1])
    shift[0] = TURN
    return np.concatenate([inputs - shift, inputs, inputs + shift])


KERNELS = {"recommended": RECOMMENDED, "printed": PRINTED}


def process_of(options: Mapping[str, Any]) -> ProcessOptions:
    """Return the set-up of the processes that the block ``steering.model`` names."""
    return chosen("steering.model.kernel", options["kernel"], KERNELS)
