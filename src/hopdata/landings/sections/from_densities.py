"""The rule `printed`: sections at knees of densities, as Sec. 2.2.2 prints it.

The lowest mode of the density of a foot's height is the ground. Its upper knee, where
the density bends most while it falls, is the threshold above which the foot is up. The
pre section is the upper knee of the density of body height while some foot is down; the
post section is the lower knee of that while some foot is up. The two conditions are
exchanged in print: see `docs/decisions.md`.

All four knees move with the bandwidth of the densities, and with a few odd frames. The
rule is there so that the printed method can be run and compared; `landings` is the
default.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.landings.sections.densities import finite, grid_of, kde
from hopdata.landings.sections.frames import Frames
from hopdata.landings.sections.modes import large_modes

#: Density at an outer knee, as a share of the largest: there it has left zero. The
#: largest bend is no stable place, because a sparse tail bends between its bumps: on
#: the sample it jumped from 0.25 to 0.54 m. At 3 % the sample's sections lie 2 mm
#: closer together.
#: Unit: 1. Origin: chosen.
LEFT_ZERO = 0.02


def upper_knee(heights: FloatArray, bandwidth_m: float) -> float:
    """Return where the density of foot heights bends most above its lowest mode, m.

    Parameters
    ----------
    heights : (N,) array
        Heights of a foot, m; non-finite ones are ignored.
    bandwidth_m : float
        Bandwidth of the density, m.

    Raises
    ------
    AnalysisError
        If the bandwidth is too small for the range of the heights.
    """
    values = finite(heights)
    grid = grid_of(values, bandwidth_m)
    density = kde(values, bandwidth=bandwidth_m, grid=grid)
    mode = 1 + int(np.argmax(large_modes(density)))
    rises = np.flatnonzero(np.diff(density[mode:]) > 0)
    end = len(grid) - 1
    if len(rises) > 0:
        end = mode + int(rises[0])
    bend = np.diff(density, 2)  # bend[k] belongs to node k + 1
    knee = mode + int(np.argmax(bend[mode - 1 : end - 1]))
    return float(grid[knee])


def heights_from_densities(frames: Frames, bandwidth_m: float) -> tuple[float, float]:
    """Return pre and post section, m: the outer knees of the conditional densities.

    Parameters
    ----------
    frames : Frames
        Frames that count, with the states of the feet; in some of them a foot is down,
        in others one is up.
    bandwidth_m : float
        Bandwidth of the densities, m.

    Raises
    ------
    AnalysisError
        If the bandwidth is too small for the range of the heights.
    """
    some_down = frames.body[~frames.all_up]
    some_up = frames.body[~frames.all_down]
    pre_m = _beyond_zero(some_down, bandwidth_m)[-1]
    post_m = _beyond_zero(some_up, bandwidth_m)[0]
    return float(pre_m), float(post_m)


def _beyond_zero(heights: FloatArray, bandwidth_m: float) -> FloatArray:
    """Return where the density of `heights` has left zero, in order, m."""
    grid = grid_of(heights, bandwidth_m)
    density = kde(heights, bandwidth=bandwidth_m, grid=grid)
    return grid[density >= LEFT_ZERO * density.max()]
