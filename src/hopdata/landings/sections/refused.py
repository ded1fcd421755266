"""Why a study has no sections: feet that land in turn, or never all stand or fly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hopdata.arrays import BoolArray, pd
from hopdata.errors import AnalysisError, counted
from hopdata.landings.contacts.descents import LANDED
from hopdata.landings.contacts.tables import contacts_of
from hopdata.landings.sections.frames import Frames, heights_of, pooled
from hopdata.landings.sections.poincare import FRAMES, Sections
from hopdata.messages import Message
from hopdata.recording import Recording, place_of

#: Fewest frames with all feet up, and with all down, in a hopping gait.
#: Unit: frames. Origin: chosen.
LEAST_FRAMES = 5

#: Share of the descents in which each foot lands if feet land in turn; fewer are of a
#: foot that hardly lands.
#: Unit: 1. Origin: chosen.
LEAST_TOUCHES = 0.1

#: Range of the body's height, as a share of the recording's scale, below which feet
#: that never land together are those of a walk.
#: Unit: 1. Origin: chosen: a walker's body moves by some 0.03 to 0.06.
LEAST_BOUNCE = 0.08

#: Share of the landings of two feet beyond which they land together.
#: Unit: 1. Origin: chosen.
MOSTLY = 0.5


def no_landing(
    recordings: Sequence[Recording],
    landings: Sequence[pd.DataFrame],
    sections: Sections,
) -> AnalysisError:
    """Return the error that says which feet land, if never all of them do.

    Parameters
    ----------
    recordings, landings
        Those of a study, above the floor, with their landings.
    sections
        Sections whose thresholds are known.

    Raises
    ------
    AnalysisError
        If no foot lands, and its heights say why: see `require_hopping`.
    """
    feet = recordings[0].names("foot")
    in_each = [contacts_of(table).status == LANDED for table in landings]
    landed = np.concatenate(in_each)
    touches = landed.sum(axis=0)
    descents = len(landed)
    groups = feet_in_turn(landed)
    if groups:
        told = []
        for own in groups:
            count = np.count_nonzero(landed[:, own].all(axis=1))
            told.append(f"{' and '.join(feet[foot] for foot in own)} in {count}")
        values = {
            "descents": descents,
            "groups": "; ".join(told),
            "first": ", ".join(feet[foot] for foot in groups[0]),
        }
        return AnalysisError(Message("landings.feet_land_in_turn", values))
    heights = [heights_of(recording) for recording in recordings]
    low_m, high_m = np.nanquantile(pooled([one.body for one in heights]), [0.01, 0.99])
    bounce_m = high_m - low_m
    scale = float(np.median([recording.scale for recording in recordings]))
    some_land = touches.max() > 0
    if some_land and bounce_m < LEAST_BOUNCE * scale:
        values = {
            "descents": descents,
            "mm": 1e3 * bounce_m,
            "place": place_of(recordings[0]),
        }
        return AnalysisError(Message("landings.looks_like_a_walk", values))
    if some_land:
        change = "record more, or take feet that hardly land off markers.feet"
    else:
        require_hopping(sections.pooled(heights), sections)
        change = "if they stand above z = 0, raise touchdowns.down_height_m above that"
    counts = zip(feet, touches, strict=True)
    each = ", ".join(f"{foot} in {count}" for foot, count in counts)
    return AnalysisError(
        "sections: expected landings in which the contact of every foot is found, "
        f"found none in {counted(descents, 'descent')} of the body ({each}); "
        f"{change}, or set sections.pre_height_m and sections.post_height_m"
    )


def feet_in_turn(landed: BoolArray) -> list[list[int]]:
    """Return the groups of feet that land together, if one group lands after another.

    Parameters
    ----------
    landed : (L, F) bool array
        Which of the feet land in which descent of the body.

    Returns
    -------
    list of lists of int
        Numbers of the feet of each group; empty unless there are two groups or more of
        two feet or more, and one lands in most of the descents of each foot.
    """
    from scipy.sparse.csgraph import connected_components

    together = landed.T.astype(np.int64) @ landed
    touches = together.diagonal()
    if not len(landed) or touches.min() < LEAST_TOUCHES * len(landed):
        return []
    fewer = np.minimum(touches[:, None], touches)
    n_groups, group_of = connected_components(together > MOSTLY * fewer)
    groups = [np.flatnonzero(group_of == group).tolist() for group in range(n_groups)]
    if n_groups < 2 or min(map(len, groups)) < 2:
        return []
    return groups


def require_hopping(frames: Frames, sections: Sections) -> None:
    """Raise an error unless the feet are all up in some frames, all down in others."""
    n_up = int(frames.all_up.sum())
    n_down = int(frames.all_down.sum())
    lowest_m = sections.min_foot_threshold_m
    highest_m = sections.max_foot_threshold_m
    if min(n_up, n_down) >= LEAST_FRAMES:
        require_both("min_foot_threshold_m", lowest_m, "up", frames.all_up)
        require_both("max_foot_threshold_m", highest_m, "down", frames.all_down)
        return
    narrower = ""
    if sections.rule == "printed":
        narrower = ", or a smaller sections.bandwidth_m"
    if FRAMES[sections.frames]:
        raise AnalysisError(
            "sections: expected descents of the body in which the feet go from all up "
            f"to all down, found none (all up: lowest foot above {lowest_m:.4f} m; all "
            f"down: highest foot below {highest_m:.4f} m); in a walk the body need not "
            "sink when a foot lands; otherwise set sections.min_foot_threshold_m and "
            f"sections.max_foot_threshold_m{narrower}"
        )
    if n_up < n_down:
        where = "leave"
        key = "min_foot_threshold_m"
        threshold_m = lowest_m
        n = n_up
        walks = (
            "; a walk, in which some foot is always down, has no landing on several "
            "feet: `hopdata contacts` times it"
        )
    else:
        where = "stand on"
        key = "max_foot_threshold_m"
        threshold_m = highest_m
        n = n_down
        walks = ""
    raise AnalysisError(
        f"sections: the feet never {where} the ground together: expected at least "
        f"{LEAST_FRAMES} frames, found {n} of {len(frames.body)} (threshold "
        f"{threshold_m:.4f} m); check the foot markers, or set sections.{key}"
        f"{narrower}{walks}"
    )


def require_both(name: str, threshold_m: float, state: str, frames: BoolArray) -> None:
    """Raise an error if the threshold puts all feet into one state in every frame."""
    if frames.all():
        found = f"{threshold_m:.4f} m with all feet {state} in all {len(frames)} frames"
        raise AnalysisError.at(
            f"sections.{name}", "a height that divides the frames", found
        )
