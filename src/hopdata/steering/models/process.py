"""Three Gaussian processes, one for each component of the frame change, in closed form.

Mean, variance and gradient follow Rasmussen and Williams 2006, Sec. 2.2. The mean and its gradient
are compiled: a controller asks for few points at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.steering.models.arguments import input_rows
from hopdata.steering.models.compiled_mean import mean, mean_and_gradient
from hopdata.steering.models.kernels import (
    correlation,
    embedded,
    embedded_scales,
    kernel_code,
    squared_distances,
)

FloatArray = NDArray[np.float64]

TURN = 2 * np.pi


@dataclass(frozen=True)
class FrameChangeProcess:
    """Gaussian processes of the frame change; satisfies `FrameChangeMap`, or with a history input.

    Parameters
    ----------
    smoothness : float
        See `hopdata.steering.models.kernels`.
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
        for name in ("offset", "unit", "variance", "noise"):
            shapes[name] = (3,)
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

    @cached_property
    def weights(self) -> FloatArray:
        """Weight of each training point in the mean, (3, m), in units of the output."""
        targets = ((self.outputs - self.offset) / self.unit).T
        inverse = self.inverse_factors
        whitened = np.einsum("jab,jb->ja", inverse, targets)
        solved = np.einsum("jab,ja->jb", inverse, whitened)
        return np.ascontiguousarray(solved * (self.variance * self.unit)[:, None])

    @cached_property
    def log_marginal_likelihood(self) -> FloatArray:
        """Log marginal likelihood of the training outputs, (3,), as modelled."""
        targets = ((self.outputs - self.offset) / self.unit).T
        inverse = self.inverse_factors
        whitened = np.einsum("jab,jb->ja", inverse, targets)
        half_logdet = -np.log(np.einsum("jaa->ja", inverse)).sum(axis=1)
        constant = len(self.inputs) / 2 * np.log(2 * np.pi)
        return np.asarray(-(whitened**2).sum(axis=1) / 2 - half_logdet - constant)

    def change(self, *inputs: ArrayLike) -> FloatArray:
        """Return the expected frame changes (n, 3) of hops with these inputs, (n,) each."""
        return self.mean_at(self._points(inputs))

    def change_and_gradient(self, *inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the expected frame changes (n, 3), and derivatives (n, 3, d) by the inputs."""
        points = self._points(inputs)
        return mean_and_gradient(points, *self._compiled)

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
