"""Feet at the pre section: the posture in which a body is about to land.

Two landings with the same state of the body differ if a leg is longer in one of them:
that foot comes down earlier. The feet are therefore part of the state before a landing.
Like the body's, their tracks are fitted to frames in flight only, before any foot has
touched, so no order of contacts can bias them.

A foot on a swinging leg is not in free fall. But its acceleration changes little
within a window, and is much the same in all landings: exactly what
`hopdata.landings.states.fits.together` learns, in the home frame, for each foot alone.
Where few landings are there to learn from, the residuals choose between free fall and
an acceleration of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.landings.states.crossing import InstantStates, SectionStates
from hopdata.landings.states.fits import states_in_flight
from hopdata.landings.states.home_frames import HomeFrames

#: Standard errors of a contact instant by which frames keep away from the contact.
#: Unit: standard errors. Origin: convention: two sigmas.
SURE_OF_FLIGHT = 2.0


def feet_at_section(
    time: FloatArray,
    parts_of_feet: Sequence[FloatArray],
    states: SectionStates,
    home: HomeFrames,
    *,
    contacts: FloatArray,
    contacts_se: FloatArray,
    window_s: float | None = None,
    pace: float = 1.0,
) -> tuple[FloatArray, FloatArray]:
    """Return the feet where the body crosses the pre section, with standard errors.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    parts_of_feet : sequence of (N, p, 3) array
        For each of F feet its p markers in the world, m; NaN where unseen. A foot with
        several markers, such as heel and toe, is where the one is that is lowest in
        most landings.
    states : SectionStates
        States of the body in L landings.
    home : HomeFrames
        Their home frames.
    contacts, contacts_se : (L, F) array
        Contact instants of all feet and their standard errors, s. No frame after the
        first contact is used for any foot.
    window_s, pace
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
    crossed = np.isfinite(states.time)
    # Any instant serves where the body has none, since it has no state either.
    near = np.where(crossed, states.time, until)
    feet = []
    errors = []
    for parts in parts_of_feet:
        found = []
        for part in range(parts.shape[1]):
            track = parts[:, [part]]
            found.append(
                states_in_flight(
                    time,
                    track,
                    near,
                    contact=until,
                    direction=home.direction,
                    window_s=window_s,
                    pace=pace,
                )
            )
        foot = found[_lowest(found)]
        velocity = home.vectors(foot.velocity)
        of_instant = velocity * states.time_se[:, None, None]
        feet.append(home.points(foot.position))
        errors.append(np.hypot(home.standard_errors(foot.covariance), of_instant))
    place = np.concatenate(feet, axis=1)
    place_se = np.concatenate(errors, axis=1)
    place_se[np.isnan(place)] = np.nan
    return place, place_se


def _lowest(parts: Sequence[InstantStates]) -> int:
    """Return the number of the marker of a foot that is lowest in most landings.

    One marker for all landings: a foot that changed from one marker to another would
    not move smoothly with the posture.
    """
    heights = np.column_stack([part.position[:, 0, 2] for part in parts])
    known = heights[np.isfinite(heights).all(axis=1)]
    if not len(known):
        return 0
    return int(np.bincount(np.argmin(known, axis=1)).argmax())
