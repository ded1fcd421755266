"""Three Gaussian processes, one for each component of the frame change, in closed form.

scikit-learn finds the hyper-parameters. Mean and variance are computed here and follow
Rasmussen and Williams 2006, Sec. 2.2.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import AnalysisError, RecordingError, chosen, require
from hopdata.foreign.npz import arrays_of
from hopdata.jobs import whole_file
from hopdata.steering.frame_changes import FrameChanges


def input_rows(boom_angle: ArrayLike, swing: ArrayLike) -> FloatArray:
    """Return the arguments of a map as rows (2, n); a single number is for all hops.

    Raises
    ------
    AnalysisError
        If their lengths differ.
    """
    booms = np.asarray(boom_angle, dtype=float).ravel()
    swings = np.asarray(swing, dtype=float).ravel()
    sizes = {booms.size, swings.size} - {1}
    if len(sizes) > 1:
        raise AnalysisError.at("frame change", "inputs of one length", sorted(sizes))
    return np.array(np.broadcast_arrays(booms, swings))


# Covariance functions of boom angle and swing.
#
# A kernel is a function of the scaled squared distance between two hops, ``s = sum of
# (difference / length scale)^2``. The difference in boom angle is either that of the
# angles themselves, or the chord between their points on the unit circle. The chord
# makes all predictions periodic without copies of the data.
#
# The Matern family (Rasmussen and Williams 2006, Sec. 4.2) is here for smoothness 1/2,
# 3/2, 5/2 and, as its limit, the Gaussian kernel ("rbf", infinity).

SMOOTHNESSES = (0.5, 1.5, 2.5, np.inf)


def embedded(inputs: ArrayLike, periodic: bool) -> FloatArray:
    """Return inputs (n, 2), or (n, 3) if `periodic`.

    Then the boom angle is a point on the circle.
    """
    inputs = np.asarray(inputs, dtype=float)
    if not periodic:
        return inputs
    angle = inputs[:, :1]
    return np.concatenate([np.cos(angle), np.sin(angle), inputs[:, 1:]], axis=1)


def embedded_scales(length_scales: ArrayLike, periodic: bool) -> FloatArray:
    """Return length scales (..., 2) for embedded inputs; cosine and sine share one."""
    scales = np.asarray(length_scales, dtype=float)
    if not periodic:
        return scales
    return np.concatenate([scales[..., :1], scales], axis=-1)


def correlation(squared: FloatArray, smoothness: float) -> FloatArray:
    """Return the kernel at scaled squared distances; it is 1 at distance zero."""
    if smoothness == np.inf:
        return np.asarray(np.exp(-squared / 2))
    r = np.sqrt(2 * smoothness * squared)
    polynomial = {0.5: 1.0, 1.5: 1 + r, 2.5: 1 + r + r**2 / 3}[smoothness]
    return np.asarray(polynomial * np.exp(-r))


TURN = 2 * np.pi


@dataclass(frozen=True)
class FrameChangeProcess:
    """Gaussian processes of the frame change; a `FrameChangeMap`.

    Parameters
    ----------
    smoothness : float
        Smoothness of the kernel: see `ProcessOptions`.
    periodic : bool
        Whether boom angles are compared as points on the circle.
    inputs : (m, 2) array
        Training inputs, including copies: boom angle and swing.
    outputs : (m, 3) array
        Training frame changes, m, m, rad.
    offset, unit : (3,) arrays
        Output j is modelled as ``(output - offset) / unit``.
    variance, noise : (3,) arrays
        Variances of the process and of the white noise, in squared units of the
        modelled output.
    length_scales : (3, 2) array
        Length scale of each input for each output, rad.
    """

    smoothness: float
    periodic: bool
    inputs: FloatArray
    outputs: FloatArray
    offset: FloatArray
    unit: FloatArray
    variance: FloatArray
    noise: FloatArray
    length_scales: FloatArray

    def __post_init__(self) -> None:
        m = len(self.inputs)
        shapes: dict[str, tuple[int, ...]] = {"inputs": (m, 2), "outputs": (m, 3)}
        shapes |= dict.fromkeys(("offset", "unit", "variance", "noise"), (3,))
        shapes["length_scales"] = (3, 2)
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(
                    f"{name}: expected {shape}, found {getattr(self, name).shape}"
                )

    @property
    def chance(self) -> FloatArray:
        """Standard deviation of a hop about its expected change, (3,), m, m, rad."""
        return np.asarray(np.sqrt(self.noise) * self.unit)

    @cached_property
    def inverse_factors(self) -> FloatArray:
        """Inverse Cholesky factors of the three covariances, (3, m, m)."""
        from scipy.linalg import solve_triangular

        covariances = self.variance[:, None, None] * self._correlations(self.inputs)
        unit = np.eye(len(self.inputs))
        covariances += self.noise[:, None, None] * unit
        with one_blas_thread():
            try:
                factors = np.linalg.cholesky(covariances)
            except np.linalg.LinAlgError as error:
                wanted = "a positive definite covariance"
                found = (
                    "one that is not; the noise is too small for hops that are this "
                    "similar"
                )
                raise AnalysisError.at("Gaussian process", wanted, found) from error
            return np.array(
                [solve_triangular(one, unit, lower=True) for one in factors]
            )

    @cached_property
    def weights(self) -> FloatArray:
        """Weight of each training point in the mean, (3, m), in the output's units.

        They include the variance, so the mean needs only correlations.
        """
        targets = ((self.outputs - self.offset) / self.unit).T
        whitened = np.einsum("jab,jb->ja", self.inverse_factors, targets)
        solved = np.einsum("jab,ja->jb", self.inverse_factors, whitened)
        return np.asarray(solved * (self.variance * self.unit)[:, None])

    def change(self, boom_angle: ArrayLike, swing: ArrayLike) -> FloatArray:
        """Return the expected frame changes (n, 3) of hops, by inputs each (n,)."""
        return self.mean_at(self._points(boom_angle, swing))

    def sd(
        self, boom_angle: ArrayLike, swing: ArrayLike, *, observed: bool = False
    ) -> FloatArray:
        """Return predictive standard deviations (n, 3) of the frame change, m, m, rad.

        Of the expected frame change or, if `observed`, of a single hop, including the
        white noise.
        """
        return self.sd_at(self._points(boom_angle, swing), observed=observed)

    def mean_at(self, points: ArrayLike) -> FloatArray:
        """Return expected frame changes (n, 3) at inputs (n, 2).

        The boom angle is not wrapped, which matters only for processes that are not
        periodic.
        """
        means = np.einsum("jna,ja->nj", self._correlations(points), self.weights)
        return np.asarray(self.offset + means)

    @one_blas_thread()
    def sd_at(self, points: ArrayLike, *, observed: bool = False) -> FloatArray:
        """Return predictive standard deviations (n, 3) at inputs (n, 2).

        See `mean_at` and `sd`.
        """
        crossed = self.variance[:, None, None] * self._correlations(points)
        whitened = crossed @ self.inverse_factors.swapaxes(1, 2)
        explained = (whitened**2).sum(axis=2).T  # by the training points
        of_change = np.maximum(self.variance - explained, 0.0)
        of_noise = self.noise if observed else 0.0
        return np.asarray(np.sqrt(of_change + of_noise) * self.unit)

    @cached_property
    def _scaled(self) -> list[tuple[FloatArray, FloatArray]]:
        """Length scales and scaled training inputs of each process, both embedded."""
        train = embedded(self.inputs, self.periodic)
        scales_of_each = embedded_scales(self.length_scales, self.periodic)
        return [(scales, train / scales) for scales in scales_of_each]

    def _correlations(self, points: ArrayLike) -> FloatArray:
        """Return the kernels of points (n, 2) with the training inputs, (3, n, m)."""
        from scipy.spatial.distance import cdist

        at = embedded(points, self.periodic)
        squared = [
            cdist(at / scales, train, "sqeuclidean") for scales, train in self._scaled
        ]
        return correlation(np.array(squared), self.smoothness)

    def _points(self, boom_angle: ArrayLike, swing: ArrayLike) -> FloatArray:
        points = input_rows(boom_angle, swing).T
        if not self.periodic:
            points[:, 0] %= TURN
        return points


# Trained processes on disk: one `.npz` file, written whole or not at all.

#: Training inputs of a process that is read. Covariances grow as their square.
#: Unit: 1. Origin: chosen: its covariances take 600 MB. The printed model has 1,500.
MOST_INPUTS = 5_000

# Bytes of its file, and of each array: 3 numbers for each input, and a head.
_MOST_BYTES = 64 * MOST_INPUTS


def save_process(path: str | Path, process: FrameChangeProcess) -> None:
    """Write a process; its fields are the file's arrays."""
    arrays = {field.name: getattr(process, field.name) for field in fields(process)}
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def load_process(path: str | Path) -> FrameChangeProcess:
    """Read a process that `save_process` wrote.

    Raises
    ------
    RecordingError
        If the file is missing or holds something else.
    """
    names = [field.name for field in fields(FrameChangeProcess)]
    wanted = f"a trained process with {', '.join(names)}"
    arrays: dict[str, Any] = arrays_of(path, names, wanted=wanted, most=_MOST_BYTES)
    try:
        # Of any precision and order of bytes; what is too large is refused below.
        with np.errstate(over="ignore"):
            arrays = {name: array.astype(float) for name, array in arrays.items()}
        arrays["smoothness"] = float(arrays["smoothness"])
        arrays["periodic"] = bool(arrays["periodic"])
        process = FrameChangeProcess(**arrays)
        _require_usable(process)
    except (ValueError, TypeError) as error:
        raise RecordingError.at(path, wanted, f"another file: {error}") from error
    return process


def _require_usable(process: FrameChangeProcess) -> None:
    """Require numbers with which a process can predict.

    Raises
    ------
    ValueError
        If one is not finite, a scale is not above zero, or there are too many inputs.
    """
    if process.smoothness not in SMOOTHNESSES:
        raise ValueError(f"smoothness {process.smoothness}")
    if not 0 < len(process.inputs) <= MOST_INPUTS:
        raise ValueError(f"{len(process.inputs)} inputs, where 1 to {MOST_INPUTS} fit")
    for field in fields(process):
        # The smoothness of the Gaussian kernel is infinite.
        is_finite = bool(np.isfinite(getattr(process, field.name)).all())
        if not is_finite and field.name != "smoothness":
            raise ValueError(f"{field.name} is not finite")
    for name in ("unit", "variance", "noise", "length_scales"):
        if not (getattr(process, name) > 0).all():
            raise ValueError(f"{name} is not above zero")


# From a table of frame changes to a trained process: its set-up (the printed one, the
# recommended one, or another in between), its hyper-parameters, and the training.


@dataclass(frozen=True, kw_only=True)
class ProcessOptions:
    """Options of the three Gaussian processes.

    Parameters
    ----------
    smoothness : float
        Smoothness of the Matern kernel: 0.5, 1.5, 2.5, or infinity for the Gaussian
        kernel.
    periodic : bool
        Compare boom angles as points on the circle. Otherwise copies of the training
        set are added one turn before and one turn after, as printed.
    standardised : bool
        Centre each component of the frame change and divide it by its standard
        deviation; divide the swing by its standard deviation. Otherwise frame changes
        are modelled as they are, about zero.
    length_unit_m : float
        Unit of length of the modelled frame changes if not standardised, m; headings
        are in rad.
    own_scales : bool
        Use a length scale for each input. Otherwise all share one.
    variance : float, optional
        Variance of the process, in squared units of the output; fitted by default.
    noise : float, optional
        Variance of the white noise, likewise.
    length_scale : float, optional
        Length scale of all inputs, in rad or, if standardised, in their units; fitted
        by default.
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
    inputs: FloatArray, target: FloatArray, options: ProcessOptions, seed: int
) -> Any:
    """Fit scikit-learn's regressor to one modelled output.

    Parameters
    ----------
    inputs : (m, 2) array
        Boom angle and swing, in units of the length scales.
    target : (m,) array
        The modelled output.
    options : ProcessOptions
    seed : int
        Seed of the random restarts.
    """
    import warnings

    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor

    regressor = GaussianProcessRegressor(
        _kernel(options),
        alpha=0.0,
        n_restarts_optimizer=options.restarts,
        random_state=seed,
    )
    with one_blas_thread(), warnings.catch_warnings():
        # A length scale at its bound means that the input does not matter: that is no
        # reason to warn.
        warnings.simplefilter("ignore", ConvergenceWarning)
        return regressor.fit(embedded(inputs, options.periodic), target)


def hyper_parameters(regressor: Any) -> tuple[float, FloatArray, float]:
    """Return variance, length scales (2,) and noise of a regressor."""
    # As `_kernel` puts them together: (constant * Matern) + white.
    product = regressor.kernel_.k1
    white = regressor.kernel_.k2
    variance = float(product.k1.constant_value)
    lengths = np.full(2, product.k2.length_scale, dtype=float)
    return variance, lengths, float(white.noise_level)


def _kernel(options: ProcessOptions) -> Any:
    """Return scikit-learn's kernel with its first values and bounds."""
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    def bounds(value: float | None, free: tuple[float, float]) -> Any:
        if value is not None:
            return "fixed"
        return free if options.standardised else UNSCALED

    length = options.length_scale or 1.0
    lengths = np.full(2, length) if options.own_scales else length
    matern = _embedded_matern() if options.periodic else Matern
    variance_bounds = bounds(options.variance, VARIANCES)
    length_bounds = bounds(options.length_scale, LENGTHS)
    noise_bounds = bounds(options.noise, NOISES)
    variance = ConstantKernel(options.variance or 1.0, variance_bounds)
    shape = matern(lengths, length_bounds, nu=options.smoothness)
    noise = WhiteKernel(options.noise or FIRST_NOISE, noise_bounds)
    return variance * shape + noise


@cache
def _embedded_matern() -> Any:
    """Return scikit-learn's Matern kernel for embedded inputs.

    Cosine and sine of the boom angle share a length scale.
    """
    from sklearn.gaussian_process.kernels import Matern

    class EmbeddedMatern(Matern):  # type: ignore[misc]
        """Matern kernel with one length scale per input, the boom angle first."""

        def __call__(
            self, X: FloatArray, Y: Any = None, eval_gradient: bool = False
        ) -> Any:
            if not np.ndim(self.length_scale):
                return super().__call__(X, Y, eval_gradient)
            lengths = np.concatenate([self.length_scale[:1], self.length_scale])
            plain = Matern(lengths, self.length_scale_bounds, nu=self.nu)
            if not eval_gradient or self.hyperparameter_length_scale.fixed:
                return plain(X, Y, eval_gradient)
            covariance, gradient = plain(X, Y, True)
            # Cosine and sine share the first length: the derivative by it is the sum of
            # those by the length of each.
            gradient[..., 1] += gradient[..., 0]
            return covariance, gradient[..., 1:]

    return EmbeddedMatern


#: Least number of hops to learn from.
#: Unit: 1. Origin: chosen.
LEAST_HOPS = 10


def trained_process(
    changes: FrameChanges, options: ProcessOptions = RECOMMENDED, *, seed: int = 0
) -> FrameChangeProcess:
    """Train the three processes on the used hops of a table.

    Parameters
    ----------
    changes : FrameChanges
    options : ProcessOptions
    seed : int
        Seed of the random restarts of the search for hyper-parameters.

    Raises
    ------
    AnalysisError
        If there are fewer than `LEAST_HOPS` used hops.
    """
    inputs, outputs = training_set(changes)
    return process_on(inputs, outputs, options, seed=seed)


def process_on(
    inputs: FloatArray, outputs: FloatArray, options: ProcessOptions, *, seed: int = 0
) -> FrameChangeProcess:
    """Train the three processes on these hops, as `trained_process` does.

    Parameters
    ----------
    inputs : (m, 2) array
        Boom angle, in [0, 2 pi), and swing of each hop, rad.
    outputs : (m, 3) array
        Frame changes, m, m, rad.
    options : ProcessOptions
    seed : int
        Seed of the random restarts of the search for hyper-parameters.
    """
    offset, unit = _offset_and_unit(outputs, options)
    scale = input_units(inputs, options)
    if not options.periodic:
        # Copies a turn before and a turn after (Sec. 3.4.2).
        turn = np.array([TURN, 0.0])
        inputs = np.concatenate([inputs - turn, inputs, inputs + turn])
        outputs = np.tile(outputs, (3, 1))
    targets = (outputs - offset) / unit
    regressors = [fitted_regressor(inputs / scale, y, options, seed) for y in targets.T]
    found = [hyper_parameters(regressor) for regressor in regressors]
    return FrameChangeProcess(
        smoothness=options.smoothness,
        periodic=options.periodic,
        inputs=inputs,
        outputs=outputs,
        offset=offset,
        unit=unit,
        variance=np.array([variance for variance, _, _ in found]),
        noise=np.array([noise for _, _, noise in found]),
        length_scales=np.array([lengths for _, lengths, _ in found]) * scale,
    )


def relearned(
    process: FrameChangeProcess, options: ProcessOptions
) -> FrameChangeProcess:
    """Train processes with another set-up on the hops of this one."""
    angle = process.inputs[:, 0]
    once = (angle >= 0) & (angle < TURN)  # without copies a turn before and after
    return process_on(process.inputs[once], process.outputs[once], options)


def training_set(changes: FrameChanges) -> tuple[FloatArray, FloatArray]:
    """Return boom angles and swings (n, 2) and frame changes (n, 3) of used hops."""
    used = changes.used()
    if len(used) < LEAST_HOPS:
        wanted = f"at least {LEAST_HOPS} hops to learn from"
        excluded = changes.excluded() or "none"
        found = f"{len(used)} of {len(changes)} (excluded: {excluded})"
        raise AnalysisError.at("frame changes", wanted, found)
    return np.column_stack([used.boom_angle_rad, used.swing_rad]), used.change


def _offset_and_unit(
    outputs: FloatArray, options: ProcessOptions
) -> tuple[FloatArray, FloatArray]:
    """Return offset and unit of each output, (3,): see `FrameChangeProcess`."""
    if not options.standardised:
        length = options.length_unit_m
        return np.zeros(3), np.array([length, length, 1.0])
    spread = outputs.std(axis=0)
    return outputs.mean(axis=0), np.where(spread > 0, spread, 1.0)


def input_units(inputs: FloatArray, options: ProcessOptions) -> FloatArray:
    """Return the units of the inputs, (2,): 1 rad, and the swing's deviation."""
    swing = 1.0
    if options.standardised:
        swing = float(inputs[:, 1].std())
    if swing == 0.0:  # all alike
        swing = 1.0
    return np.array([1.0, swing])


KERNELS = {"recommended": RECOMMENDED, "printed": PRINTED}


def process_of(options: Mapping[str, Any]) -> ProcessOptions:
    """Return the set-up of the processes named by the block ``steering.model``."""
    return chosen("steering.model.kernel", options["kernel"], KERNELS)
