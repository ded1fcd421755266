"""Which markers are the body of a study, and which of them defines its home frame."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.messages import Message
from hopdata.recordings.quality import softness
from hopdata.recordings.quality.inspection import Inspection
from hopdata.recordings.quality.part_names import part_by_name
from hopdata.recordings.quality.softness import LEAST_BODY
from hopdata.recordings.quality.vocabulary import named_parts
from hopdata.recordings.wording import also, listed

#: Largest share of the frames in which the home marker may be unseen.
#: Unit: 1. Origin: chosen.
HOME_UNSEEN = 0.01

#: The same for a marker of a body that keeps four such markers or more.
#: Unit: 1. Origin: derived: as for the home marker, which is one of them.
BODY_UNSEEN = HOME_UNSEEN

#: The same for a marker of a body that keeps three such markers.
#: Unit: 1. Origin: chosen.
BODY_UNSEEN_OF_THREE = 0.05


@dataclass(frozen=True)
class Body:
    """The body that was chosen.

    Parameters
    ----------
    markers : list of int
        Its markers, in increasing order; none if no body was found.
    reason : Message, optional
        Why these.
    alternative : Message, optional
        Others that it might be.
    """

    markers: list[int]
    reason: Message | None = None
    alternative: Message | None = None


def guess_body(inspection: Inspection, taken: set[int], feet: list[int]) -> Body:
    """Choose the body among markers that are not `taken`, and say why.

    Tried in turn: a rigid cluster with three markers named as a body; markers named so;
    the rigid clusters, the highest first. Each is limited to markers that are nearly
    always seen, if these are enough, and that `hopdata check` takes for one body.
    """
    names = named_parts(tuple(inspection.markers))
    named = []
    for m, name in enumerate(inspection.markers):
        is_body = part_by_name(name) == "body" and names.role(m) == "body"
        if (is_body or names.parts[m] == "pelvis") and m not in taken:
            named.append(m)
    pelvis = [m for m in named if names.parts[m] == "pelvis"]
    if names.is_human and len(pelvis) >= LEAST_BODY:  # thighs and backs bend
        named = pelvis
    clusters = _free_clusters(inspection, taken)
    body = _named_in_a_cluster(inspection, feet, clusters, named)
    if body is None:
        body = _named(inspection, feet, named)
    if body is None:
        body = _highest_cluster(inspection, feet, clusters, named)
    if body is None:
        body = Body([])
    return body


def _free_clusters(inspection: Inspection, taken: set[int]) -> list[list[int]]:
    """Return the rigid clusters of markers that are not taken, the highest first."""
    clusters = []
    for cluster in inspection.clusters:
        free = [m for m in cluster.markers if m not in taken]
        if len(free) >= LEAST_BODY:
            clusters.append(free)
    heights = inspection.positions[:, :, 2]
    clusters.sort(key=lambda free: -float(np.nanmedian(heights[:, free])))
    return clusters


def _named_in_a_cluster(
    inspection: Inspection,
    feet: list[int],
    clusters: list[list[int]],
    named: list[int],
) -> Body | None:
    """Return the body within the highest cluster with three markers named so."""
    for cluster in clusters:
        pool = [m for m in cluster if m in named]
        if len(pool) < LEAST_BODY:
            continue
        well_seen = _well_seen(pool, inspection)
        kept = softness.one_body(well_seen, inspection.positions, feet)
        if not kept:
            return None
        reason = _reason(
            Message("recordings.body_rigid", {"varies": _variation(kept, inspection)}),
            _left_out("recordings.left_out_names", cluster, pool, inspection),
            _left_out("recordings.left_out_seen_less", pool, well_seen, inspection),
            _left_out("recordings.left_out_bend", well_seen, kept, inspection),
        )
        return Body(sorted(kept), reason)
    return None


def _named(inspection: Inspection, feet: list[int], named: list[int]) -> Body | None:
    """Return the body within the markers named so."""
    for pool in (_well_seen(named, inspection), named):
        kept = softness.one_body(pool, inspection.positions, feet)
        if not kept:
            continue
        reason = _reason(
            Message("recordings.body_named", {"varies": _variation(kept, inspection)}),
            _left_out("recordings.left_out_seen_less", named, pool, inspection),
            _left_out("recordings.left_out_bend", pool, kept, inspection),
        )
        return Body(sorted(kept), reason)
    return None


def _highest_cluster(
    inspection: Inspection,
    feet: list[int],
    clusters: list[list[int]],
    named: list[int],
) -> Body | None:
    """Return the body within the highest cluster that holds one."""
    for k, cluster in enumerate(clusters):
        well_seen = _well_seen(cluster, inspection)
        kept = softness.one_body(well_seen, inspection.positions, feet)
        if not kept:
            continue
        reason = _reason(
            Message(
                "recordings.body_cluster", {"varies": _variation(kept, inspection)}
            ),
            _left_out("recordings.left_out_seen_less", cluster, well_seen, inspection),
            _left_out("recordings.left_out_bend", well_seen, kept, inspection),
        )
        rivals = clusters[k + 1] if k + 1 < len(clusters) else named
        others = [inspection.markers[m] for m in rivals if m not in kept]
        return Body(sorted(kept), reason, listed(others) if others else None)
    return None


def _reason(why: Message, *left_out: Message | None) -> Message:
    return also(why, *(one for one in left_out if one is not None))


def _left_out(
    code: str, pool: Sequence[int], kept: Sequence[int], inspection: Inspection
) -> Message | None:
    """Report which markers of a pool were not kept."""
    left = [inspection.markers[m] for m in pool if m not in kept]
    if not left:
        return None
    return Message(code, {"markers": ", ".join(left)})


def _well_seen(pool: list[int], inspection: Inspection) -> list[int]:
    """Keep the markers seen in nearly all frames if four are or, with more gaps, three.

    With four, the gaps of each can be filled from the other three.
    """
    seen = _share_seen(inspection.positions)
    nearly_always = [m for m in pool if seen[m] >= 1 - BODY_UNSEEN]
    if len(nearly_always) > LEAST_BODY:
        return nearly_always
    mostly = [m for m in pool if seen[m] >= 1 - BODY_UNSEEN_OF_THREE]
    if len(mostly) >= LEAST_BODY:
        return mostly
    return pool


def _share_seen(positions: FloatArray) -> FloatArray:
    """Return the share of frames in which each marker of (N, M, 3) was seen, (M,)."""
    return np.asarray(np.isfinite(positions[:, :, 0]).mean(axis=0))


def _variation(members: list[int], inspection: Inspection) -> Message:
    """Report how much a body's distances vary beyond noise, in mm and to its size."""
    found = softness.bending(inspection.positions[:, members])
    most_mm = float(f"{1e3 * found.usual_m.max():.2g}")
    percent = 100 * float(found.strain.max())
    return Message(
        "recordings.distances_vary", {"most_mm": most_mm, "percent": percent}
    )


@dataclass(frozen=True, order=True)
class _Flaws:
    """What speaks against a home marker; the least comes first."""

    suspected_faults: int
    share_unseen: float

    def message(self) -> Message:
        """Return the flaws in words, of which there is at least one."""
        code = "recordings.one_suspected_fault"
        if self.suspected_faults > 1:
            code = "recordings.suspected_faults"
        suspected = Message(code, {"number": self.suspected_faults})
        unseen = Message(
            "recordings.unseen_share", {"percent": 100 * self.share_unseen}
        )
        if not self.share_unseen:
            return suspected
        if not self.suspected_faults:
            return unseen
        return Message("recordings.comma", {"first": suspected, "then": unseen})


NO_FLAWS = _Flaws(0, 0.0)


#: Stems of the names of markers on the left and the right front of the pelvis.
#: Origin: convention: the anterior superior iliac spines in the names of marker sets.
FRONT_OF_PELVIS = frozenset({"asi", "asis", "ias"})


def home_markers(
    body: list[int], inspection: Inspection
) -> tuple[tuple[str, ...], Message | None]:
    """Return the body markers in whose direction forward is, and the reason.

    They are the two on the front of the pelvis, if their names tell. Otherwise it is
    the first without flaws, or with the fewest, and without a reason if it is the first
    of all.

    Parameters
    ----------
    body : list of int
        At least one marker.
    inspection : Inspection
        The recording.
    """
    names = [inspection.markers[m] for m in body]
    times_suspected = Counter(
        name for fault in inspection.suspects() for name in fault.markers
    )
    unseen = 1.0 - _share_seen(inspection.positions[:, body])
    flaws = []
    for name, share in zip(names, unseen.tolist(), strict=True):
        flaws.append(
            _Flaws(times_suspected[name], share if share > HOME_UNSEEN else 0.0)
        )
    front = _front_of_pelvis(names)
    if front and all(flaws[k] == NO_FLAWS for k in front):
        return tuple(names[k] for k in front), Message("recordings.home_in_front")
    best = flaws.index(min(flaws))

    if flaws[best] != NO_FLAWS:
        return (names[best],), Message(
            "recordings.home_best_of_bad", {"flaws": flaws[best].message()}
        )
    if best == 0:
        return (names[best],), None
    passed = [
        Message(
            "recordings.home_passed", {"marker": names[k], "flaws": flaws[k].message()}
        )
        for k in range(best)
    ]
    return (names[best],), also(Message("recordings.home_first_sound"), *passed)


def _front_of_pelvis(names: Sequence[str]) -> tuple[int, ...]:
    """Return the two markers on the front of the pelvis; none if not both are there."""
    named = named_parts(tuple(names))
    of_sides = {}
    for k, (stem, side) in enumerate(zip(named.stems, named.sides, strict=True)):
        if side and stem in FRONT_OF_PELVIS:
            of_sides[side] = k
    if {*of_sides} != {"l", "r"} or len(names) < 3:
        return ()
    return of_sides["l"], of_sides["r"]
