"""Gaussian processes of a stride: one for each component of what it changes.

They predict the change of the pose, and those next states of the robot that do not
follow from state and inputs, by scikit-learn (Rasmussen and Williams 2006, Sec. 2.2).
`hopdata.steering.models.training` trains them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.steering.models.kernels import embedded, matern
from hopdata.steering.models.stride_table import StrideTable, tabulated
from hopdata.steering.strides import COMPONENTS, TURN, StrideAxes

# Components of the change of the pose, the first outputs of all processes.
N_CHANGE = len(COMPONENTS)


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

    def __repr__(self) -> str:
        """Return what it predicts from what, and from how many points."""
        of = ", ".join(axis.name for axis in self.axes.axes)
        learned = [one.name for one in self.axes.states if not one.is_known]
        what = ", ".join([*COMPONENTS, *learned])
        return f"<FrameChangeProcess: {what} from {of}; {len(self.points)} points>"

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
    def table(self) -> StrideTable | None:
        """The model as a table, of a robot with one angle and one input; else None.

        The limits of the input are those of its axis. A process that was read has it
        from its file.
        """
        if not has_table(self.axes):
            return None
        return tabulated(self)

    def within(self, lower: FloatArray, upper: FloatArray) -> StrideTable:
        """Return the model as a table between these limits of the inputs, (U,) each.

        Of a robot without linear states.
        """
        if self.table is not None and self.axes.has_limits(lower, upper):
            return self.table
        return tabulated(self, lower=lower, upper=upper)


def has_table(axes: StrideAxes) -> bool:
    """Tell whether a process keeps its table: over an angle that its one input moves.

    Tables over more are large, and are made when they are asked for.
    """
    is_small = len(axes.periodic) == len(axes.inputs) == 1 and not axes.linear
    return is_small and bool(axes.periodic[0].moved_by)
