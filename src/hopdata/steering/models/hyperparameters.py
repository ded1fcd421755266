"""Hyper-parameters of largest marginal likelihood, by scikit-learn."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.steering.models.kernels import embedded, embedded_scales
from hopdata.steering.models.options import ProcessOptions
from hopdata.steering.models.process import FrameChangeProcess

FloatArray = NDArray[np.float64]

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


def regressor_of(process: FrameChangeProcess, component: int) -> Any:
    """Return scikit-learn's regressor of one component with the hyper-parameters of a process.

    It predicts the output as modelled, for embedded inputs: a peer to compare with.
    """
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    j = component
    lengths = embedded_scales(process.length_scales[j], process.periodic)
    matern = Matern(lengths, nu=process.smoothness)
    kernel = ConstantKernel(process.variance[j]) * matern + WhiteKernel(process.noise[j])
    target = (process.outputs[:, j] - process.offset[j]) / process.unit[j]
    regressor = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None)
    return regressor.fit(embedded(process.inputs, process.periodic), target)


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
