"""Positions and velocities of the body markers where the body crosses a section."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import chosen
from hopdata.landings.crossings import SectionStates, cross
from hopdata.landings.section_fits import (
    GRAVITY_M_S2,
    LEAST_LANDINGS,
    Fit,
    Tracks,
    accelerated,
    alone,
    ballistic,
    filtered,
    together,
)

__all__ = ["GRAVITY_M_S2", "SectionStates", "section_states"]

FloatArray = NDArray[np.float64]

Fitting = Callable[[Tracks, float | None], Fit]

GRAVITIES: dict[str, Fitting | None] = {"auto": None, "known": ballistic, "free": accelerated}
SIDES = {"before": True, "after": False}  # whether the section lies in flight


def section_states(
    time: FloatArray,
    body: FloatArray,
    near: FloatArray,
    *,
    height_m: float,
    side: str,
    contact: FloatArray,
    method: str = "split_fit",
    window_s: float | None = None,
    gravity: str = "auto",
) -> SectionStates:
    """Fit the motion of each marker about each crossing and evaluate it on the section.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    body : (N, B, 3) array
        Body markers in the world, z up, m; NaN where unseen.
    near : (L,) array
        Approximate instants of the crossings, s.
    height_m : float
        Height of the section, m.
    side : {"before", "after"}
        On which side of the contacts the section lies.
    contact : (L,) array
        The first contact for the pre section, the last one for the post section, s. Frames beyond
        it are not used by the split fit.
    method : {"split_fit", "savitzky_golay"}
        Polynomials over the window on the right side of the contacts; or a cubic over the seven
        nearest frames, whatever happens in them.
    window_s : float, optional
        Frames used on either side of the crossing by the split fit, s; on the free side it is
        widened until the frames suffice. By default as wide as polynomials fit (see
        `hopdata.landings.section_fits.widest`).
    gravity : {"auto", "known", "free"}
        Flight before the contacts as straight lines under gravity (`known`), or with an
        acceleration of its own for each marker and landing (`free`). `auto` learns from all
        landings how much accelerations differ from gravity; from few landings it takes
        gravity where the residuals are then no larger.

    Returns
    -------
    SectionStates

    Raises
    ------
    ConfigError
        If `method`, `gravity` or `side` is unknown.
    """
    fitted = chosen("states.method", method, METHODS)
    flying = chosen("states.gravity", gravity, GRAVITIES)
    tracks = Tracks(time, body, near, contact, chosen("side", side, SIDES))
    sums, fit = fitted(tracks, window_s, flying)
    return cross(sums, fit, near, height_m)


def _split_fit(tracks: Tracks, window_s: float | None, flying: Fitting | None) -> Fit:
    if tracks.flight and flying is not None:
        return flying(tracks, window_s)
    enough = len(tracks.near) >= LEAST_LANDINGS
    return (together if enough else alone)(tracks, window_s)


def _savitzky_golay(tracks: Tracks, _window_s: float | None, _flying: Fitting | None) -> Fit:
    return filtered(tracks)


METHODS = {"split_fit": _split_fit, "savitzky_golay": _savitzky_golay}
