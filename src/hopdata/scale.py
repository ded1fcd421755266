"""How far markers extend, and the factor for lengths that were tuned on one animal."""

import numpy as np

from hopdata.arrays import FloatArray

#: Least number of frames, if there are as many, from which sizes are taken.
#: Unit: frames. Origin: chosen.
SAMPLE_FRAMES = 2000


def extent(positions: FloatArray) -> float:
    """Return the diagonal of the box around all markers seen, as a median over frames.

    Parameters
    ----------
    positions : (N, M, 3) array
        Marker positions in any unit, along any axes.

    Returns
    -------
    float
        In the unit of `positions`; NaN if no frame shows two markers.
    """
    frames = _axes_first(positions)
    seen = (~np.isnan(frames).any(axis=0)).sum(axis=0) >= 2
    if not seen.any():
        return float("nan")
    highest = np.fmax.reduce(frames, axis=1)
    lowest = np.fmin.reduce(frames, axis=1)
    span = (highest - lowest)[:, seen]
    with np.errstate(over="ignore"):  # an absurd size may be infinite
        return float(np.median(np.sqrt((span**2).sum(axis=0))))


def _axes_first(positions: FloatArray) -> FloatArray:
    """Return a sample of (N, M, 3) positions as (3, M, N).

    NumPy is slow along short axes.
    """
    return np.ascontiguousarray(sampled(positions).T)


#: Size of the animal for which the lengths of the code were tuned, as the rms distance
#: of its body and foot markers from their mean. All lengths are in proportion to it.
#: Unit: m. Origin: measured. The simulated hopper has 0.33 m and runners have 0.50 m;
#: the value lies between: at 0.33 contacts of runners are found some mm too high, at
#: 0.42 those of the hopper scatter by 6 % more. With 1.5 times the value all lengths
#: and speeds are two thirds of what they are.
SIZE_OF_TUNING_M = 0.36

#: Smallest size that is scaled to; a smaller one is absurd, in whatever unit.
#: Unit: m. Origin: chosen.
SMALLEST_SIZE_M = 1e-4

#: Largest size that is scaled to; a larger one is absurd, in whatever unit.
#: Unit: m. Origin: chosen.
LARGEST_SIZE_M = 1e4


def scale_of(positions: FloatArray) -> float:
    """Return the factor for lengths that were tuned on an animal of about 1 m.

    It is proportional to the size of the animal: the same animal at a hundredth of the
    size has a hundredth of the factor, however its recording is turned or shifted.
    Times scale with its root.

    Parameters
    ----------
    positions : (N, M, 3) array
        Marker positions, m; NaN where unseen.

    Returns
    -------
    float
        Rms distance of the markers from their mean, as a median over a sample of
        frames, divided by `SIZE_OF_TUNING_M`. It is 1 if no frame shows two markers
        apart.
    """
    frames = _axes_first(positions)
    seen = np.asarray(~np.isnan(frames).any(axis=0))
    n_seen = seen.sum(axis=0)
    enough = n_seen >= 2
    if not enough.any():
        return 1.0
    frames = frames[:, :, enough]
    seen = seen[:, enough]
    n_seen = n_seen[enough]
    with np.errstate(over="ignore"):  # the size of absurd positions may be infinite
        middle = np.where(seen, frames, 0.0).sum(axis=1) / n_seen
        squares = np.where(seen, (frames - middle[:, None]) ** 2, 0.0).sum(axis=(0, 1))
        size_m = float(np.median(np.sqrt(squares / n_seen)))
    if not size_m > 0:
        return 1.0
    size_m = float(np.clip(size_m, SMALLEST_SIZE_M, LARGEST_SIZE_M))
    return size_m / SIZE_OF_TUNING_M


def median_offset(offsets: FloatArray) -> FloatArray:
    """Return the median (3,) of offsets (N, 3) that are known; NaN if none is."""
    known = offsets[~np.isnan(offsets).any(axis=1)]
    if not len(known):
        return np.full(3, np.nan)
    return np.asarray(np.median(known, axis=0))


def sampled(positions: FloatArray) -> FloatArray:
    """Return evenly spaced frames of (N, ...), fewer than twice `SAMPLE_FRAMES`."""
    return positions[:: max(1, len(positions) // SAMPLE_FRAMES)]
