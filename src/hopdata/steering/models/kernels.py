"""Kernels of Gaussian processes of states and inputs, by scikit-learn.

A kernel is a function of the scaled distance between two strides, the root of the sum
of ``(difference / length scale)^2``. The difference in a periodic state is either that
of the angles themselves, or the chord between their points on the unit circle. The
chord makes all predictions periodic without copies of the data.

The Matern family (Rasmussen and Williams 2006, Sec. 4.2) is here for smoothness 1/2,
3/2, 5/2 and, as its limit, the Gaussian kernel ("rbf", infinity).
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray

SMOOTHNESSES = (0.5, 1.5, 2.5, np.inf)

Bounds = tuple[float, float] | str


def embedded(points: ArrayLike, n_periodic: int) -> FloatArray:
    """Return points (n, d) with their first columns, angles, as points on the circle.

    They are (n, n_periodic + d): all cosines, all sines, and the other columns.
    """
    columns = np.asarray(points, dtype=float)
    angles = columns[:, :n_periodic]
    return np.concatenate(
        [np.cos(angles), np.sin(angles), columns[:, n_periodic:]], axis=1
    )


def embedded_scales(length_scales: ArrayLike, n_periodic: int) -> FloatArray:
    """Return length scales (..., d) for embedded points; cosine and sine share one."""
    scales = np.asarray(length_scales, dtype=float)
    return np.concatenate([scales[..., :n_periodic], scales], axis=-1)


def matern(length_scales: ArrayLike, smoothness: float, n_periodic: int) -> Any:
    """Return scikit-learn's Matern kernel of embedded points, not to be fitted.

    Parameters
    ----------
    length_scales : (d,) array
    smoothness : float
    n_periodic : int
        Number of the first columns that are embedded.
    """
    from sklearn.gaussian_process.kernels import Matern

    scales = embedded_scales(length_scales, n_periodic)
    return Matern(scales, "fixed", nu=smoothness)


def fitted_matern(
    length_scales: float | FloatArray,
    bounds: Bounds,
    smoothness: float,
    n_periodic: int,
) -> Any:
    """Return scikit-learn's Matern kernel of embedded points, with first values.

    Cosine and sine of an angle share a length scale.

    Parameters
    ----------
    length_scales : float or (d,) array
        First values: one length for all, or one for each column before embedding.
    bounds : (float, float) or "fixed"
    smoothness : float
    n_periodic : int
    """
    from sklearn.gaussian_process.kernels import Matern

    kind = Matern
    if n_periodic and np.ndim(length_scales):
        kind = _embedded_matern(n_periodic)
    return kind(length_scales, bounds, nu=smoothness)


@cache
def _embedded_matern(n_periodic: int) -> Any:
    """Return the class of a Matern kernel whose first lengths are each used twice."""
    from sklearn.gaussian_process.kernels import Matern

    class EmbeddedMatern(Matern):  # type: ignore[misc]
        """Matern kernel of embedded points with one length scale per column before."""

        def __call__(
            self, X: FloatArray, Y: Any = None, eval_gradient: bool = False
        ) -> Any:
            lengths = embedded_scales(self.length_scale, n_periodic)
            plain = Matern(lengths, self.length_scale_bounds, nu=self.nu)
            if not eval_gradient or self.hyperparameter_length_scale.fixed:
                return plain(X, Y, eval_gradient)
            covariance, gradient = plain(X, Y, True)
            # Cosine and sine share a length: the derivative by it is the sum of those
            # by the length of each.
            of_cosines = gradient[..., :n_periodic]
            shared = gradient[..., n_periodic:]
            shared[..., :n_periodic] += of_cosines
            return covariance, shared

    return EmbeddedMatern
