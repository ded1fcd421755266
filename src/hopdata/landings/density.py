"""Gaussian kernel density on a uniform grid, exact to about 1e-8, at the cost of one FFT.

Each sample is spread over four nodes of a fine grid by the cubic B-spline; in Fourier space the
counts are multiplied by the transfer function of the Gaussian and divided by that of the spline
(the type-1 non-uniform FFT with a spline for its window). What is left is aliasing of the
spline, of order (spacing / bandwidth)^4, and the grid is made as fine as that asks for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

_NODES_PER_BANDWIDTH = 32  # spacing of the fine grid; aliasing below 1e-8 of the peak
_REACH = 8.0  # bandwidths after which the kernel is nothing (exp(-32) = 1e-14)
_MAX_FINE_NODES = 2**23


def normal_bandwidth(samples: ArrayLike) -> float:
    """Bandwidth by the normal reference rule with the robust of two spreads.

    Parameters
    ----------
    samples : array of any shape
        Values; those not finite are ignored.

    Returns
    -------
    float
        0.9 min(sd, IQR / 1.349) n^(-1/5), in the unit of `samples` (Silverman 1986, eq. 3.31).
    """
    values = finite(samples)
    if values.size < 2:
        raise ValueError(f"samples: expected at least 2 finite values, found {values.size}")
    lower, upper = np.quantile(values, [0.25, 0.75])
    spread = min(float(values.std(ddof=1)), float(upper - lower) / 1.349)
    return 0.9 * (spread or float(values.std(ddof=1))) * values.size**-0.2


def kde(
    samples: ArrayLike, *, bandwidth: float, grid: ArrayLike, compiled: bool = False
) -> FloatArray:
    """Density of `samples` under a Gaussian kernel, at the nodes of a uniform grid.

    Parameters
    ----------
    samples : array of any shape
        Values; those not finite are ignored. Values off the grid count in the total, so that
        the result integrates to the share of the probability that lies on the grid.
    bandwidth : float
        Standard deviation of the kernel, in the unit of `samples`, > 0.
    grid : (G,) array
        Nodes, equally spaced and increasing, G >= 2.
    compiled : bool
        Whether to spread the samples by compiled code: eight times as fast, but half a second to
        load, so that it pays from a hundred densities of long recordings on.

    Returns
    -------
    (G,) array
        Probability density per unit of `samples`. It agrees with the exact sum to about 1e-8 of
        the highest value; in the far tails it may be negative by rounding, and is cut at zero.

    Raises
    ------
    ValueError
        No finite sample, a bandwidth that is not positive, a grid that is not uniform, or a
        bandwidth so small against the grid that the work would be unreasonable.
    """
    values = np.asarray(samples, dtype=np.float64).ravel()
    nodes, spacing = _uniform(grid)
    if not (np.isfinite(bandwidth) and bandwidth > 0):
        raise ValueError(f"bandwidth: expected a positive number, found {bandwidth}")
    refine = max(1, int(np.ceil(spacing * _NODES_PER_BANDWIDTH / bandwidth)))
    step = spacing / refine
    margin = int(np.ceil(_REACH * bandwidth / step)) + 2
    n_inside = (len(nodes) - 1) * refine + 1
    if n_inside + 2 * margin > _MAX_FINE_NODES:
        raise ValueError(
            f"bandwidth: {bandwidth:g} is too small for a grid from {nodes[0]:g} to {nodes[-1]:g}"
        )
    n_fine = _fast_length(n_inside + 2 * margin)
    if compiled:
        counts, found = _spread_compiled(values, float(nodes[0]) - margin * step, step, n_fine)
    else:
        known = finite(values)
        counts, found = _spread((known - nodes[0]) / step + margin, n_fine), known.size
    if found == 0:
        raise ValueError("samples: expected at least one finite value, found none")
    smooth = np.fft.irfft(np.fft.rfft(counts) * _transfer(n_fine, bandwidth / step), n_fine)
    inside = smooth[margin : margin + n_inside : refine]
    return np.maximum(inside, 0.0) / (found * step)


def finite(samples: ArrayLike) -> FloatArray:
    """Return the finite values of `samples`, flat."""
    values = np.asarray(samples, dtype=np.float64).ravel()
    return values[np.isfinite(values)]


def _uniform(grid: ArrayLike) -> tuple[FloatArray, float]:
    """Check that `grid` is uniform; return it with its spacing."""
    nodes = np.asarray(grid, dtype=np.float64)
    if nodes.ndim != 1 or len(nodes) < 2:
        raise ValueError(f"grid: expected at least 2 nodes in a row, found shape {nodes.shape}")
    spacing = float(nodes[-1] - nodes[0]) / (len(nodes) - 1)
    even = nodes[0] + spacing * np.arange(len(nodes))
    if not (spacing > 0 and np.allclose(nodes, even, rtol=0.0, atol=1e-6 * spacing)):
        raise ValueError("grid: expected equally spaced, increasing nodes")
    return nodes, spacing


def _spread_compiled(
    values: FloatArray, origin: float, step: float, n_fine: int
) -> tuple[FloatArray, int]:
    """Spread unit counts of the finite values as `_spread` does; also return how many they are."""
    from hopdata.landings.density_kernel import spread_samples

    counts = np.zeros((2, n_fine))
    found = spread_samples(values, origin, 1.0 / step, counts)
    return (counts[0] + counts[1]) / 6.0, found


def _spread(place: FloatArray, n_fine: int) -> FloatArray:
    """Spread unit counts at fractional places over four nodes each by the cubic B-spline."""
    place = place[(place >= 1) & (place < n_fine - 3)]
    below = place.astype(np.int64)
    u = place - below
    v = 1.0 - u
    weights = (v**3, 4 - 3 * u * u * (1 + v), 4 - 3 * v * v * (1 + u), u**3)
    counts = np.zeros(n_fine)
    for offset, weight in enumerate(weights, start=-1):
        counts += np.bincount(below + offset, weights=weight, minlength=n_fine)
    return counts / 6.0


def _transfer(n_fine: int, bandwidth_steps: float) -> FloatArray:
    """Transfer function of the Gaussian over that of the spline, at the FFT's frequencies."""
    cycles = np.arange(n_fine // 2 + 1) / n_fine
    return np.exp(-2.0 * (np.pi * cycles * bandwidth_steps) ** 2) / np.sinc(cycles) ** 4


def _fast_length(n: int) -> int:
    """Smallest number 2^i, 3*2^i or 5*2^i that is at least `n`: quick to transform."""
    return min(k << max(0, -(-n // k) - 1).bit_length() for k in (1, 3, 5))
