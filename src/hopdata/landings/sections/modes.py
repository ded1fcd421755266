"""Gaussian kernel density on a uniform grid, exact to about 1e-8, at the cost of one FFT.

Each sample is spread over four nodes of a fine grid by the cubic B-spline. In Fourier
space, the counts are multiplied by the transfer function of the Gaussian and divided by
that of the spline (a type-1 non-uniform FFT with a spline window). The remaining error
is aliasing of the spline, of order (spacing / bandwidth)^4; the grid is chosen fine
enough for it.

The ground mode is found from such densities: where the heights of feet on the ground
pile up.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError

_NODES_PER_BANDWIDTH = 32  # spacing of the fine grid; aliasing below 1e-8 of the peak
_REACH = 8.0  # bandwidths beyond which the kernel is negligible (exp(-32) = 1e-14)
_MAX_FINE_NODES = 2**23
BLOCK = 100_000  # samples processed at a time, to bound memory


def normal_bandwidth(samples: ArrayLike) -> float:
    """Return the bandwidth of the normal reference rule, with the smaller of two spreads.

    Parameters
    ----------
    samples : array of any shape
        Values; non-finite ones are ignored.

    Returns
    -------
    float
        0.9 min(sd, IQR / 1.349) n^(-1/5), in the unit of `samples` (Silverman 1986, eq.
        3.31).
    """
    values = finite(samples)
    lower, upper = np.quantile(values, [0.25, 0.75])
    spread = min(float(values.std(ddof=1)), float(upper - lower) / 1.349)
    return 0.9 * (spread or float(values.std(ddof=1))) * values.size**-0.2


_FINEST_SHARE = 1e-4  # smallest usual bandwidth, as a share of the range of heights


def usual_bandwidth(groups: Sequence[FloatArray], range_m: float) -> float:
    """Return the smallest bandwidth of the normal rule for groups of heights, m.

    Heights without scatter have no bandwidth of their own: 1e-4 of `range_m` is the
    least.

    Parameters
    ----------
    groups : sequence of array
        Heights, m; non-finite ones are ignored.
    range_m : float
        Range of all heights in question, m.
    """
    found = [normal_bandwidth(one) for one in groups if np.isfinite(one).sum() > 1]
    return max(min(found, default=0.0), _FINEST_SHARE * range_m)


def kde(samples: ArrayLike, *, bandwidth: float, grid: ArrayLike) -> FloatArray:
    """Estimate the density of `samples` with a Gaussian kernel, at the nodes of a uniform grid.

    Parameters
    ----------
    samples : array of any shape
        Values; non-finite ones are ignored. Values off the grid count in the total, so
        the result integrates to the share of the probability that lies on the grid.
    bandwidth : float
        Standard deviation of the kernel, in the unit of `samples`, > 0.
    grid : (G,) array
        Nodes, equally spaced and increasing, G >= 2.

    Returns
    -------
    (G,) array
        Probability density per unit of `samples`. It agrees with the exact sum to about
        1e-8 of the highest value. Values that rounding makes negative in the far tails
        are set to zero.

    Raises
    ------
    ValueError
        If the bandwidth is too small for the extent of the grid.
    """
    values, nodes = np.asarray(samples).ravel(), np.asarray(grid, dtype=np.float64)
    spacing = float(nodes[-1] - nodes[0]) / (len(nodes) - 1)
    refine = max(1, int(np.ceil(spacing * _NODES_PER_BANDWIDTH / bandwidth)))
    step = spacing / refine
    margin = int(np.ceil(_REACH * bandwidth / step)) + 2
    n_inside = (len(nodes) - 1) * refine + 1
    if n_inside + 2 * margin > _MAX_FINE_NODES:
        extent = f"a grid from {nodes[0]:g} to {nodes[-1]:g}"
        raise ValueError(f"bandwidth: {bandwidth:g} is too small for {extent}")
    n_fine = _fast_length(n_inside + 2 * margin)
    counts, n_finite = np.zeros((4, n_fine)), 0
    for first in range(0, len(values), BLOCK):
        part = finite(values[first : first + BLOCK])
        _spread((part - nodes[0]) / step + margin, counts)
        n_finite += part.size
    spread = sum(counts) / 6.0
    cycles = np.arange(n_fine // 2 + 1) / n_fine
    # Transfer function of the Gaussian over that of the spline, at the FFT's
    # frequencies.
    transfer = (
        np.exp(-2.0 * (np.pi * cycles * (bandwidth / step)) ** 2) / np.sinc(cycles) ** 4
    )
    smooth = np.fft.irfft(np.fft.rfft(spread) * transfer, n_fine)
    return np.maximum(smooth[margin : margin + n_inside : refine], 0.0) / (
        n_finite * step
    )


_GRID_NODES_PER_BANDWIDTH = (
    16  # a height read off the grid is right to 3 % of a bandwidth
)
_LEAST_GRID_NODES = 1024
_MOST_GRID_NODES = 2**18
_GRID_MARGIN = 5.0  # bandwidths beyond the samples, where a density has ended


def grid_of(samples: FloatArray, bandwidth_m: float) -> FloatArray:
    """Return a uniform grid for reading heights off a density of `samples`, m.

    Parameters
    ----------
    samples : array of any shape
        Finite heights, m.
    bandwidth_m : float
        Bandwidth of the density, m, > 0.

    Raises
    ------
    AnalysisError
        If the bandwidth is too small for the range of the heights.
    """
    margin = _GRID_MARGIN * bandwidth_m
    low = float(samples.min()) - margin
    high = float(samples.max()) + margin
    nodes = int((high - low) / bandwidth_m * _GRID_NODES_PER_BANDWIDTH)
    if nodes > _MOST_GRID_NODES:
        least_m = (high - low) * _GRID_NODES_PER_BANDWIDTH / _MOST_GRID_NODES
        expected = (
            f"at least {least_m:.2g} m, for heights that range over {high - low:.3g} m"
        )
        raise AnalysisError.at("sections.bandwidth_m", expected, f"{bandwidth_m:g} m")
    return np.linspace(low, high, max(nodes, _LEAST_GRID_NODES))


def _fast_length(least: int) -> int:
    """Return the smallest 2^k 3^m 5^n that is at least `least`, for a fast FFT."""
    odd = (3**k * 5**m for k in range(15) for m in range(10))
    return min(one << (-(-least // one) - 1).bit_length() for one in odd)


def finite(samples: ArrayLike) -> FloatArray:
    """Return the finite values of `samples`, flat."""
    values = np.asarray(samples, dtype=np.float64)
    return values[np.isfinite(values)]


def _spread(place: FloatArray, counts: FloatArray) -> None:
    """Spread unit counts at fractional places over four nodes each by the cubic B-spline.

    Row k of `counts` collects the contributions to node k of the four, one sample after
    another, so the sums do not depend on the number of samples passed at a time.
    """
    place = place[(place >= 1) & (place < counts.shape[1] - 3)]
    below = place.astype(np.int64)
    u = place - below
    v = 1.0 - u
    weights = (v**3, 4 - 3 * u * u * (1 + v), 4 - 3 * v * v * (1 + u), u**3)
    for row, (count, weight) in enumerate(zip(counts, weights, strict=True)):
        np.add.at(count, below + (row - 1), weight)


# The ground mode: where the heights of feet on the ground pile up, and how much they
# scatter.

_FINEST_M = (
    1e-5  # below the resolution of optical systems; keeps sigma > 0 for noise-free data
)
_LEAST_SAMPLES = 20
_COARSE = (
    0.04  # coarse bandwidth, as a share of the range from the 2 % to the 98 % quantile
)
_STEP_REACH_M = 5e-3  # distance from the mode within which printed steps are sought
_COARSE_STEP_M = 1e-4  # finer steps are below the noise of cameras
_TIES, _LEAST_TIES = (
    20,
    2,
)  # mean and median heights per level above which heights come in steps
LARGE = 0.2  # smallest density of a mode that counts, as a share of the highest density


@dataclass(frozen=True)
class GroundMode:
    """Mode of the heights of feet on the ground.

    Parameters
    ----------
    height_m : float
        Place of the mode, m.
    sigma_m : float
        Standard deviation of its left flank, m. Nothing is below the ground, so this
        flank contains only scatter: measurement noise and the remaining error of the
        floor.
    bandwidth_m : float
        Bandwidth of the density whose highest point is the mode, m.
    """

    height_m: float
    sigma_m: float
    bandwidth_m: float

    def knee(self, sigmas: float) -> float:
        """Return the upper knee of the mode, m: `sigmas` deviations of the left flank above it."""
        return self.height_m + sigmas * self.sigma_m


def ground_mode(heights: ArrayLike, *, scale: float = 1.0) -> GroundMode:
    """Find the lowest large mode of `heights` and the scatter on its left flank.

    The mode is narrower than any bandwidth suited to the whole density, so it has a
    bandwidth of its own: sigma n^(-1/7), the rate suited to a mode, with sigma from the
    left flank.

    Parameters
    ----------
    heights : array of any shape
        Foot heights, m; non-finite ones are ignored.
    scale : float
        Scale of the recording (`hopdata.recording.scale_of`).

    Raises
    ------
    AnalysisError
        If there are fewer than 20 finite heights.
    """
    values = finite(heights) / scale
    values.sort()
    if values.size < _LEAST_SAMPLES:
        wanted = f"at least {_LEAST_SAMPLES} frames with foot heights"
        raise AnalysisError.at("ground mode", wanted, values.size)
    n_low = np.searchsorted(values, _upper_end_of_lowest_mode(values), side="right")
    place = _densest(values[:n_low])
    sigma = _left_flank(values, place)
    for _ in range(3):
        n_ground = 2 * max(int(np.searchsorted(values, place)), 1)
        width = sigma * n_ground ** (-1 / 7)
        place = _highest_near(
            values, place, reach=6 * sigma + 2 * width, bandwidth=width
        )
        sigma = _left_flank(values, place)
    return GroundMode(
        height_m=scale * place, sigma_m=scale * sigma, bandwidth_m=scale * width
    )


def _upper_end_of_lowest_mode(values: FloatArray) -> float:
    """Return the upper end of the lowest large mode of a coarse density, m."""
    low, high = np.quantile(values, [0.02, 0.98])
    width = max(_COARSE * float(high - low), _FINEST_M)
    grid = np.linspace(low - 3 * width, high + 3 * width, 512)
    density = kde(values, bandwidth=width, grid=grid)
    inner = density[1:-1]
    is_peak = (
        (inner > density[:-2])
        & (inner >= density[2:])
        & (inner >= LARGE * density.max())
    )
    return float(grid[1:-1][np.argmax(is_peak)]) + 2 * width


def _densest(values: FloatArray) -> float:
    """Return the half-sample mode of sorted values (Bickel and Fruehwirth 2006), bandwidth-free."""
    while values.size > 8:
        half = (values.size + 1) // 2
        start = int(np.argmin(values[half - 1 :] - values[: values.size - half + 1]))
        values = values[start : start + half]
    return float(values.mean())


def _left_flank(values: FloatArray, place: float) -> float:
    """Return the robust deviation of the values below `place`, as half of a normal, m."""
    least = max(_FINEST_M, 0.5 * _printed_step(values, place))
    below = values[: np.searchsorted(values, place)]
    return (
        max(float(place - np.median(below)) / NORMAL_MEDIAN, least)
        if below.size
        else least
    )


def _printed_step(values: FloatArray, place: float) -> float:
    """Return the step, m, in which heights near `place` were printed; 0 if none is visible."""
    first, last = np.searchsorted(
        values, (place - _STEP_REACH_M, place + _STEP_REACH_M)
    )
    near = np.round(values[first:last], 6)
    starts = np.flatnonzero(np.diff(near, prepend=-np.inf))  # the values are sorted
    levels, ties = near[starts], np.diff(starts, append=len(near))
    if len(levels) < 2 or ties.mean() <= _TIES or np.median(ties) <= _LEAST_TIES:
        return 0.0
    step = float(np.median(np.diff(levels)))
    return step if step >= _COARSE_STEP_M else 0.0


def _highest_near(
    values: FloatArray, place: float, *, reach: float, bandwidth: float
) -> float:
    """Return the peak of the density within `reach` of `place`, by a parabola through its top."""
    grid = np.linspace(place - reach, place + reach, 401)
    density = kde(values, bandwidth=bandwidth, grid=grid)
    top = int(np.clip(np.argmax(density), 1, len(grid) - 2))
    left, middle, right = density[top - 1 : top + 2]
    curvature = left - 2 * middle + right
    shift = 0.5 * (left - right) / curvature if curvature < 0 else 0.0
    return float(grid[top] + np.clip(shift, -1.0, 1.0) * (grid[1] - grid[0]))


NORMAL_MEDIAN = 0.6744897501960817  # median of |z| for a standard normal z


def robust_rms(residuals: FloatArray) -> float:
    """Return the sd about zero of a normal with the same median absolute residual."""
    return float(np.median(np.abs(residuals))) / NORMAL_MEDIAN
