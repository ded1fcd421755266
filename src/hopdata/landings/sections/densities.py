"""Gaussian kernel density on a uniform grid, exact to about 1e-8, by one FFT.

Each sample is spread over four nodes of a fine grid by the cubic B-spline. In Fourier
space, the counts are multiplied by the transfer function of the Gaussian and divided by
that of the spline (a type-1 non-uniform FFT with a spline window). The remaining error
is aliasing of the spline, of order (spacing / bandwidth)^4; the grid is chosen fine
enough for it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError

BLOCK = 100_000  # samples processed at a time, to bound memory

#: Nodes of the fine grid in a bandwidth.
#: Unit: nodes. Origin: rounding: aliasing is then below 1e-8 of the peak.
FINE_NODES_PER_BANDWIDTH = 32

#: Reach of the kernel, beyond which it is negligible.
#: Unit: bandwidths. Origin: rounding: exp(-32) is 1e-14.
REACH = 8.0

MOST_FINE_NODES = 2**23  # to bound memory

#: Smallest usual bandwidth, as a share of the range of heights.
#: Unit: 1. Origin: chosen.
FINEST_SHARE = 1e-4

#: Nodes of a grid from which heights are read, in a bandwidth: a height is then right
#: to 3 % of a bandwidth.
#: Unit: nodes. Origin: chosen.
GRID_NODES_PER_BANDWIDTH = 16

#: Fewest nodes of such a grid.
#: Unit: nodes. Origin: chosen.
LEAST_GRID_NODES = 1024

MOST_GRID_NODES = 2**18  # to bound memory and time

#: Reach of such a grid beyond the samples, where a density has ended.
#: Unit: bandwidths. Origin: chosen.
GRID_MARGIN = 5.0

#: Factor of the normal rule for bandwidths.
#: Unit: 1. Origin: table: Silverman (1986), eq. 3.31.
SILVERMAN = 0.9

#: Interquartile range of a normal distribution.
#: Unit: standard deviations. Origin: derived: twice its quartile.
NORMAL_IQR = 1.349


def normal_bandwidth(samples: ArrayLike) -> float:
    """Return the bandwidth of the normal rule, with the smaller of two spreads.

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
    sd = float(values.std(ddof=1))
    lower, upper = np.quantile(values, [0.25, 0.75])
    spread = min(sd, float(upper - lower) / NORMAL_IQR)
    if spread == 0:  # more than half of the values are equal
        spread = sd
    return SILVERMAN * spread * values.size**-0.2


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
    return max(min(found, default=0.0), FINEST_SHARE * range_m)


def kde(samples: ArrayLike, *, bandwidth: float, grid: ArrayLike) -> FloatArray:
    """Estimate the density of `samples` with a Gaussian kernel, on a uniform grid.

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
    values = np.asarray(samples).ravel()
    nodes = np.asarray(grid, dtype=np.float64)
    spacing = float(nodes[-1] - nodes[0]) / (len(nodes) - 1)
    refine = max(1, int(np.ceil(spacing * FINE_NODES_PER_BANDWIDTH / bandwidth)))
    step = spacing / refine
    margin = int(np.ceil(REACH * bandwidth / step)) + 2
    n_inside = (len(nodes) - 1) * refine + 1
    if n_inside + 2 * margin > MOST_FINE_NODES:
        extent = f"a grid from {nodes[0]:g} to {nodes[-1]:g}"
        raise ValueError(f"bandwidth: {bandwidth:g} is too small for {extent}")
    n_fine = fast_length(n_inside + 2 * margin)
    counts = np.zeros((4, n_fine))
    n_finite = 0
    for first in range(0, len(values), BLOCK):
        part = finite(values[first : first + BLOCK])
        _spread((part - nodes[0]) / step + margin, counts)
        n_finite += part.size
    spread = sum(counts) / 6.0
    cycles = np.arange(n_fine // 2 + 1) / n_fine  # the FFT's frequencies
    gaussian = np.exp(-2.0 * (np.pi * cycles * (bandwidth / step)) ** 2)
    spline = np.sinc(cycles) ** 4
    smooth = np.fft.irfft(np.fft.rfft(spread) * (gaussian / spline), n_fine)
    inside = smooth[margin : margin + n_inside : refine]
    return np.maximum(inside, 0.0) / (n_finite * step)


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
    margin = GRID_MARGIN * bandwidth_m
    low = float(samples.min()) - margin
    high = float(samples.max()) + margin
    nodes = int((high - low) / bandwidth_m * GRID_NODES_PER_BANDWIDTH)
    if nodes > MOST_GRID_NODES:
        least_m = (high - low) * GRID_NODES_PER_BANDWIDTH / MOST_GRID_NODES
        expected = (
            f"at least {least_m:.2g} m, for heights that range over {high - low:.3g} m"
        )
        raise AnalysisError.at("sections.bandwidth_m", expected, f"{bandwidth_m:g} m")
    return np.linspace(low, high, max(nodes, LEAST_GRID_NODES))


def fast_length(least: int) -> int:
    """Return the smallest 2^k 3^m 5^n that is at least `least`, for a fast FFT."""
    lengths = []
    for k in range(15):
        for m in range(10):
            odd = 3**k * 5**m
            times = -(-least // odd)
            next_power_of_two = 1 << (times - 1).bit_length()
            lengths.append(odd * next_power_of_two)
    return min(lengths)


def finite(samples: ArrayLike) -> FloatArray:
    """Return the finite values of `samples`, flat."""
    values = np.asarray(samples, dtype=np.float64)
    return values[np.isfinite(values)]


def _spread(place: FloatArray, counts: FloatArray) -> None:
    """Spread unit counts at fractional places over four nodes by the cubic B-spline.

    Row k of `counts` collects the contributions to node k of the four, one sample after
    another, so the sums do not depend on the number of samples passed at a time.
    """
    place = place[(place >= 1) & (place < counts.shape[1] - 3)]
    below = place.astype(np.int64)
    u = place - below
    v = 1.0 - u
    weights = (
        v**3,
        4 - 3 * u * u * (1 + v),
        4 - 3 * v * v * (1 + u),
        u**3,
    )
    for k, weight in enumerate(weights):
        np.add.at(counts[k], below + (k - 1), weight)
