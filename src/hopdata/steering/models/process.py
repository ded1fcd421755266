"""Three Gaussian processes, one for each component of the frame change, in closed form.

Mean and variance follow Rasmussen and Williams 2006, Sec. 2.2.
"""

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import AnalysisError, RecordingError
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


def correlation(squared: FloatArray, smoothness: float) -> FloatArray:
    """Return the kernel, 1 at distance zero, of scaled squared distances."""
    if smoothness == np.inf:
        return np.asarray(np.exp(-squared / 2))
    r = np.sqrt(2 * smoothness * squared)
    polynomial = {0.5: 1.0, 1.5: 1 + r, 2.5: 1 + r + r**2 / 3}[smoothness]
    return np.asarray(polynomial * np.exp(-r))


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
        from scipy.linalg import solve_triangular

        covariances = self.variance[:, None, None] * self._correlations(self.inputs)
        unit = np.eye(len(self.inputs))
        covariances += self.noise[:, None, None] * unit
        with one_blas_thread():
            try:
                factors = np.linalg.cholesky(covariances)
            except np.linalg.LinAlgError as error:
                raise AnalysisError(
                    "Gaussian process: expected a positive definite covariance, found one that is "
                    "not; the noise is too small for hops that are so much alike"
                ) from error
            return np.array([solve_triangular(one, unit, lower=True) for one in factors])

    @cached_property
    def weights(self) -> FloatArray:
        """Weight of each training point in the mean, (3, m), in units of the output."""
        targets = ((self.outputs - self.offset) / self.unit).T
        whitened = np.einsum("jab,jb->ja", self.inverse_factors, targets)
        solved = np.einsum("jab,ja->jb", self.inverse_factors, whitened)
        return np.asarray(solved * (self.variance * self.unit)[:, None])

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
        means = np.einsum("jna,ja->nj", self._correlations(points), self.weights)
        return np.asarray(self.offset + means)

    @one_blas_thread()
    def sd_at(self, points: ArrayLike, *, observed: bool = False) -> FloatArray:
        """Return predictive standard deviations (n, 3) at inputs (n, d); see `mean_at`, `sd`."""
        crossed = self.variance[:, None, None] * self._correlations(points)
        explained = crossed @ self.inverse_factors.swapaxes(1, 2)
        variances = self.variance - (explained**2).sum(axis=2).T
        variances = np.maximum(variances, 0.0) + (self.noise if observed else 0.0)
        return np.asarray(np.sqrt(variances) * self.unit)

    @cached_property
    def _scaled(self) -> list[tuple[FloatArray, FloatArray]]:
        """Length scales and scaled training inputs of each process, both embedded."""
        train = embedded(self.inputs, self.periodic)
        scales = embedded_scales(self.length_scales, self.periodic)
        return [(one, train / one) for one in scales]

    def _correlations(self, points: ArrayLike) -> FloatArray:
        """Kernels between points (n, d) and the training inputs, (3, n, m)."""
        from scipy.spatial.distance import cdist

        at = embedded(points, self.periodic)
        squared = [cdist(at / scales, train, "sqeuclidean") for scales, train in self._scaled]
        return correlation(np.array(squared), self.smoothness)

    def _points(self, inputs: tuple[ArrayLike, ...]) -> FloatArray:
        points = input_rows(inputs, self.n_inputs).T
        if not self.periodic:
            points[:, 0] %= TURN
        return points


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
