"""Feet at the pre section: the posture in which a body is about to land.

Two landings with the same state of the body differ if a leg is longer in one of them:
that foot comes down earlier. The feet are therefore part of the state before a landing.
Like the body's, their tracks are fitted to frames in flight only, before any foot has
touched, so no order of contacts can bias them.

A foot on a swinging leg is not in free fall. But its acceleration changes little
within a window, and is much the same in all landings: exactly what
`hopdata.landings.states.fits.together` learns, in the home frame.
Where few landings are there to learn from, the residuals choose between free fall and
a cubic.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.landings.states.crossing import SectionStates
from hopdata.landings.states.fits import states_in_flight
from hopdata.landings.states.home_frames import HomeFrames

#: Standard errors of a contact instant by which frames keep away from the contact.
#: Unit: standard errors. Origin: convention: two sigmas.
SURE_OF_FLIGHT = 2.0

#: Share of the landings that show a marker from which on it is fitted together with
#: the others.
#: Unit: 1. Origin: chosen.
MOST = 0.8


def feet_at_section(  # noqa: PLR0913 (the data, and the options of the fits)
    time: FloatArray,
    positions: FloatArray,
    markers_of_feet: Sequence[Sequence[int]],
    states: SectionStates,
    home: HomeFrames,
    *,
    contacts: FloatArray,
    contacts_se: FloatArray,
    window_s: float | None = None,
    time_scale: float = 1.0,
) -> tuple[FloatArray, FloatArray]:
    """Return the feet where the body crosses the pre section, with standard errors.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    positions : (N, M, 3) array
        Markers in the world, m; NaN where unseen.
    markers_of_feet : sequence of sequence of int
        For each of F feet its markers. A foot with several, such as heel and toe, is
        where the one is that is lowest in most landings.
    states : SectionStates
        States of the body in L landings.
    home : HomeFrames
        Their home frames.
    contacts, contacts_se : (L, F) array
        Contact instants of all feet and their standard errors, s. No frame after the
        first contact is used for any foot.
    window_s, time_scale
        See `hopdata.landings.states.fits.section_states`.

    Returns
    -------
    feet, feet_se : (L, F, 3) array
        Positions in the home frame, with heights above the floor, and standard errors,
        m. They include the error of the instant of the crossing. NaN where a foot is
        not seen.
    """
    margins = SURE_OF_FLIGHT * np.nan_to_num(contacts_se)
    until = (contacts - margins).min(axis=1)
    # Any instant serves where the body has none, since it has no state either.
    near = np.where(np.isfinite(states.time), states.time, until)
    columns = np.concatenate(markers_of_feet).astype(np.int64)
    place = np.empty((len(near), len(columns), 3))
    place_se = np.empty(place.shape)
    for markers in _fitted_together(time, positions, columns, near):
        found = states_in_flight(
            time,
            positions[:, columns[markers]],
            near,
            contact=until,
            direction=home.direction,
            window_s=window_s,
            time_scale=time_scale,
        )
        velocity = home.vectors(found.velocity)
        of_instant = velocity * states.time_se[:, None, None]
        place[:, markers] = home.points(found.position)
        own = home.standard_errors(found.covariance)
        place_se[:, markers] = np.hypot(own, of_instant)
    place_se[np.isnan(place)] = np.nan

    first = 0
    chosen = []
    for of_foot in markers_of_feet:
        last = first + len(of_foot)
        chosen.append(first + _lowest(place[:, first:last, 2]))
        first = last
    return place[:, chosen], place_se[:, chosen]


def _fitted_together(
    time: FloatArray, positions: FloatArray, columns: IntArray, near: FloatArray
) -> list[list[int]]:
    """Return groups of the markers in these columns that are fitted together.

    They are those that most landings show, as landings teach accelerations only if they
    show all markers. Any other marker is fitted by itself.
    """
    frames = np.clip(np.searchsorted(time, near), 0, len(time) - 1)
    is_seen = np.isfinite(positions[frames][:, columns]).all(axis=2)
    is_common = is_seen.mean(axis=0) > MOST
    alone = [[int(marker)] for marker in np.flatnonzero(~is_common)]
    common = np.flatnonzero(is_common).tolist()
    if not common:
        return alone
    return [common, *alone]


def _lowest(heights: FloatArray) -> int:
    """Return the number of the marker of a foot that is lowest in most landings.

    One marker for all landings: a foot that changed from one marker to another would
    not move smoothly with the posture. `heights` are (L, p), m.
    """
    known = heights[np.isfinite(heights).all(axis=1)]
    if not len(known):
        return int(np.isfinite(heights).sum(axis=0).argmax())
    return int(np.bincount(np.argmin(known, axis=1)).argmax())
