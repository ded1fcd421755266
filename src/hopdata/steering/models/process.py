"""Three Gaussian processes, one for each component of the frame change, in closed form.

Mean and variance follow Rasmussen and Williams 2006, Sec. 2.2. The mean is compiled: a controller
asks for few points at a time.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from math import cos, exp, sin, sqrt
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.blas import one_blas_thread
from hopdata.code_cache import kept_njit
from hopdata.errors import AnalysisError, ConfigError, RecordingError
from hopdata.jobs import whole_file

# Arguments of maps: as many inputs as the map has, a number or an array of one a hop each.


def input_rows(inputs: tuple[ArrayLike, ...], wanted: int) -> FloatArray:
    """Return the inputs as rows (d, n); a single number holds for all hops.

    Raises
    ------
    AnalysisError
        If there are more inputs or fewer, or of different lengths.
    """
    if len(inputs) != wanted:
        raise AnalysisError(f"frame change: expected {wanted} inputs, found {len(inputs)}")
    arrays = [np.asarray(values, dtype=float).ravel() for values in inputs]
    sizes = {array.size for array in arrays} - {1}
    if len(sizes) > 1:
        raise AnalysisError(f"frame change: expected inputs of one length, found {sorted(sizes)}")
    return np.array(np.broadcast_arrays(*arrays))


# Covariance functions of boom angle, swing and what came before.
#
# A kernel is a function of the scaled squared distance between two hops, ``s = sum of (difference /
# length scale)^2``. In the boom angle the difference is that of the angles themselves, or the chord
# between their points on the unit circle, which makes all predictions periodic without any copies
# of the data.
#
# The Matern family (Rasmussen and Williams 2006, Sec. 4.2) is here for smoothness 1/2, 3/2, 5/2
# and, as its limit, the Gaussian kernel ("rbf", infinity).

SMOOTHNESSES = (0.5, 1.5, 2.5, np.inf)

_ROOT3, _ROOT5 = sqrt(3.0), sqrt(5.0)


def kernel_code(smoothness: float) -> int:
    """Return the number by which compiled code knows a smoothness: its place in SMOOTHNESSES.

    Raises
    ------
    ConfigError
        If it is none of them.
    """
    if smoothness not in SMOOTHNESSES:
        raise ConfigError(
            f"smoothness: expected one of {', '.join(map(str, SMOOTHNESSES))}, found {smoothness}"
        )
    return SMOOTHNESSES.index(smoothness)


def embedded(inputs: ArrayLike, periodic: bool) -> FloatArray:
    """Return inputs (n, d) with the boom angle, the first, as a point on the circle: (n, d + 1).

    Left as they are unless `periodic`.
    """
    inputs = np.asarray(inputs, dtype=float)
    if not periodic:
        return inputs
    angle = inputs[:, :1]
    return np.concatenate([np.cos(angle), np.sin(angle), inputs[:, 1:]], axis=1)


def embedded_scales(length_scales: ArrayLike, periodic: bool) -> FloatArray:
    """Return the length scales (..., d) of the embedded inputs: cosine and sine share theirs."""
    scales = np.asarray(length_scales, dtype=float)
    return np.concatenate([scales[..., :1], scales], axis=-1) if periodic else scales


def squared_distances(a: FloatArray, b: FloatArray, scales: FloatArray) -> FloatArray:
    """Return scaled squared distances (n, m) of embedded inputs (n, e) and (m, e)."""
    squared = np.zeros((len(a), len(b)))
    for column_a, column_b in zip((a / scales).T, (b / scales).T, strict=True):
        squared += (column_a[:, None] - column_b) ** 2
    return squared


def correlation(squared: FloatArray, smoothness: float) -> FloatArray:
    """Return the kernel, 1 at distance zero, of scaled squared distances."""
    if smoothness == np.inf:
        return np.asarray(np.exp(-squared / 2))
    r = np.sqrt(2 * smoothness * squared)
    polynomial = {0.5: 1.0, 1.5: 1 + r, 2.5: 1 + r + r**2 / 3}[smoothness]
    return np.asarray(polynomial * np.exp(-r))


@kept_njit(error_model="numpy")
def compiled_correlation(squared, code):  # type: ignore[no-untyped-def]
    """Return the kernel at a squared distance; `code` is `kernel_code`."""
    if code == 3:
        return exp(-0.5 * squared)
    if code == 2:
        r = _ROOT5 * sqrt(squared)
        return (1.0 + r + r * r / 3.0) * exp(-r)
    if code == 1:
        r = _ROOT3 * sqrt(squared)
        return (1.0 + r) * exp(-r)
    return exp(-sqrt(squared))


@kept_njit(error_model="numpy")
def mean(points, train, weights, inverse_squares, offset, code, periodic):  # type: ignore[no-untyped-def]
    """Return means of the three processes (n, 3) at points (n, d): a few cost microseconds.

    `train` (m, 2 + d) holds cosine and sine of the boom angle, and the inputs; `weights` (3, m) and
    `offset` (3,) are in units of the output; `inverse_squares` (3, d) are of the length scales.
    """
    n, d = points.shape
    values, squares = np.empty((n, 3)), np.empty(d)
    for p in range(n):
        c, s = cos(points[p, 0]), sin(points[p, 0])
        values[p] = offset
        for i in range(len(train)):
            if periodic:
                x, y = c - train[i, 0], s - train[i, 1]
                squares[0] = x * x + y * y
            for a in range(1 if periodic else 0, d):
                difference = points[p, a] - train[i, 2 + a]
                squares[a] = difference * difference
            for j in range(3):
                squared = 0.0
                for a in range(d):
                    squared += squares[a] * inverse_squares[j, a]
                values[p, j] += weights[j, i] * compiled_correlation(squared, code)
    return values


TURN = 2 * np.pi


@dataclass(frozen=True)
class FrameChangeProcess:
    """Gaussian processes of the frame change; satisfies `FrameChangeMap`, or with a history input.

    Parameters
    ----------
    smoothness : float
        See `hopdata.steering.models.process`.
    periodic : bool
        Whether boom angles are compared by points on the circle.
    inputs : (m, d) array
        Training inputs, copies included: boom angle, swing and those of the hop before.
    outputs : (m, 3) array
        Training frame changes, m, m, rad.
    offset, unit : (3,) arrays
        Output j is modelled as ``(output - offset) / unit``.
    variance, noise : (3,) arrays
        Of the process and of the white noise, in squared units of the modelled output.
    length_scales : (3, d) array
        Of each input for each output: rad, and for a previous frame change m, m, rad.
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
        m, d = self.inputs.shape
        shapes: dict[str, tuple[int, ...]] = {"outputs": (m, 3), "length_scales": (3, d)}
        shapes |= dict.fromkeys(("offset", "unit", "variance", "noise"), (3,))
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name}: expected {shape}, found {getattr(self, name).shape}")

    @property
    def n_inputs(self) -> int:
        """Number of inputs, 2 without history."""
        return self.inputs.shape[1]

    @cached_property
    def inverse_factors(self) -> FloatArray:
        """Inverse Cholesky factors of the three covariances, (3, m, m)."""
        points = embedded(self.inputs, self.periodic)
        factors = []
        for j in range(3):
            covariance = self._covariance(points, points, j)
            covariance[np.diag_indices_from(covariance)] += self.noise[j]
            factors.append(_inverse_factor(covariance))
        return np.array(factors)

    @property
    def _whitened(self) -> FloatArray:
        """Modelled outputs by the inverse factors, (3, m)."""
        targets = ((self.outputs - self.offset) / self.unit).T
        return np.asarray(np.einsum("jab,jb->ja", self.inverse_factors, targets))

    @cached_property
    def weights(self) -> FloatArray:
        """Weight of each training point in the mean, (3, m), in units of the output."""
        solved = np.einsum("jab,ja->jb", self.inverse_factors, self._whitened)
        return np.ascontiguousarray(solved * (self.variance * self.unit)[:, None])

    @cached_property
    def log_marginal_likelihood(self) -> FloatArray:
        """Log marginal likelihood of the training outputs, (3,), as modelled."""
        half_logdet = -np.log(np.einsum("jaa->ja", self.inverse_factors)).sum(axis=1)
        constant = len(self.inputs) / 2 * np.log(2 * np.pi)
        return np.asarray(-(self._whitened**2).sum(axis=1) / 2 - half_logdet - constant)

    def change(self, *inputs: ArrayLike) -> FloatArray:
        """Return the expected frame changes (n, 3) of hops with these inputs, (n,) each."""
        return self.mean_at(self._points(inputs))

    def sd(self, *inputs: ArrayLike, observed: bool = False) -> FloatArray:
        """Return predictive standard deviations (n, 3) of the frame change, m, m, rad.

        Of its expectation, or, if `observed`, of a hop: with the white noise.
        """
        return self.sd_at(self._points(inputs), observed=observed)

    def mean_at(self, points: ArrayLike) -> FloatArray:
        """Return expected frame changes (n, 3) at inputs (n, d), whose boom angle is not wrapped.

        It matters only for processes that are not periodic.
        """
        return mean(np.ascontiguousarray(points, dtype=float), *self._compiled)

    @one_blas_thread()
    def sd_at(self, points: ArrayLike, *, observed: bool = False) -> FloatArray:
        """Return predictive standard deviations (n, 3) at inputs (n, d); see `mean_at`, `sd`."""
        at = embedded(np.asarray(points, dtype=float), self.periodic)
        train = embedded(self.inputs, self.periodic)
        variances = np.empty((len(at), 3))
        for j in range(3):
            explained = self._covariance(at, train, j) @ self.inverse_factors[j].T
            variances[:, j] = self.variance[j] - (explained**2).sum(axis=1)
        variances = np.maximum(variances, 0.0) + (self.noise if observed else 0.0)
        return np.asarray(np.sqrt(variances) * self.unit)

    def _covariance(self, a: FloatArray, b: FloatArray, j: int) -> FloatArray:
        scales = embedded_scales(self.length_scales[j], self.periodic)
        return self.variance[j] * correlation(squared_distances(a, b, scales), self.smoothness)

    def _points(self, inputs: tuple[ArrayLike, ...]) -> FloatArray:
        points = input_rows(inputs, self.n_inputs).T
        if not self.periodic:
            points[:, 0] %= TURN
        return np.ascontiguousarray(points)

    @cached_property
    def _compiled(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, int, bool]:
        """Arguments of the compiled mean after the points."""
        angle = self.inputs[:, 0]
        train = np.column_stack([np.cos(angle), np.sin(angle), self.inputs])
        inverse_squares = 1.0 / self.length_scales**2
        code = kernel_code(self.smoothness)
        return train, self.weights, inverse_squares, self.offset, code, self.periodic


def _inverse_factor(covariance: FloatArray) -> FloatArray:
    from scipy.linalg import cholesky, solve_triangular

    with one_blas_thread():
        try:
            factor = cholesky(covariance, lower=True)
        except np.linalg.LinAlgError as error:
            raise AnalysisError(
                "Gaussian process: expected a positive definite covariance, found one that is not; "
                "the noise is too small for hops that are so much alike"
            ) from error
        return np.asarray(solve_triangular(factor, np.eye(len(factor)), lower=True))


# Trained processes on disk: one `.npz` file, written whole or not at all.

# What reading a folder, a text, a picture, a single array or an archive of others ends in.
FOREIGN = (OSError, KeyError, ValueError, TypeError, AttributeError, EOFError, BadZipFile)


def save_process(path: str | Path, process: FrameChangeProcess) -> None:
    """Write a process; its fields are the arrays of the file."""
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
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in names}
        arrays["smoothness"] = float(arrays["smoothness"])
        arrays["periodic"] = bool(arrays["periodic"])
        return FrameChangeProcess(**arrays)
    except FileNotFoundError:
        raise RecordingError(f"{path}: expected a trained process, found no such file") from None
    except FOREIGN as error:
        raise RecordingError(
            f"{path}: expected a trained process with {', '.join(names)}, found another file"
        ) from error
