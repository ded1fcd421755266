"""What speaks for each direction that may point up: a likelihood for each piece.

Each piece of evidence is a function that returns probabilities of the six directions of
a file's axes. Any of them may mislead altogether: then all six are alike. So no piece
can rule a direction out, and how far one can be trusted is a number with a name.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.messages import Message
from hopdata.recordings.axes import DIRECTIONS, along
from hopdata.recordings.quality.free_fall import FreeFall
from hopdata.recordings.quality.rests import CLEARER, FLAT, flattest_direction
from hopdata.recordings.quality.stretches import quantiles
from hopdata.recordings.quality.vocabulary import NamedParts

#: Share of the recordings in which most markers fall, and not downwards.
#: Unit: 1. Origin: chosen. Nothing but gravity accelerates all markers at once.
FALL_MISLEADS = 1e-6

#: The same where they fall seldom (`SELDOM`): whoever pushes off at every step is in
#: free fall upwards for a moment, and the names of a body that stands may outweigh it.
#: Unit: 1. Origin: chosen. Twice `NAMES_MISLEAD`.
SELDOM_FALL_MISLEADS = 0.01

#: Share of the frames in free fall below which a fall is seldom.
#: Unit: 1. Origin: chosen. No benchmark prints the shares of those who run or jump.
SELDOM = 0.06

#: The same where only few markers fall, as limbs that swing do.
#: Unit: 1. Origin: chosen.
FEW_FALLS_MISLEAD = 0.3

#: Share of the markers that must fall for all to fall.
#: Unit: 1. Origin: chosen.
MOST_FALL = 0.5

#: Share of the frames that must fall, since a jerk of the cameras passes for a fall of
#: all markers.
#: Unit: 1. Origin: chosen.
OFTEN = 0.04

#: Share of the recordings in which a body by its markers' names is not upright.
#: Unit: 1. Origin: chosen.
NAMES_MISLEAD = 0.005

#: The same if the names tell of a trunk or of legs only, which may lean.
#: Unit: 1. Origin: chosen.
TRUNK_MISLEADS = 0.15

#: The same by the roles that the user gave.
#: Unit: 1. Origin: chosen.
ROLES_MISLEAD = 0.002

#: Share of the recordings in which a body lies along an axis, where nothing moves as on
#: a floor: who lies straight has all parts in a row as who stands.
#: Unit: 1. Origin: chosen. Most who are upright along the usual axis of a format stay
#: sure; who is so along a less usual one is asked about.
LIES = 0.05

#: How much the length from feet to head must change, relative to it, to show that the
#: body squats or jumps.
#: Unit: 1. Origin: chosen. Made-up walkers change it by 0.08 at most.
FOLDS = 0.15

#: How much the feet must move past one another, relative to that length, to show that
#: the body walks or runs.
#: Unit: 1. Origin: chosen. A step is some 0.4 of it, so feet move by 0.8.
STRIDES = 0.4

#: Share of the recordings in which markers come to rest again and again
#: and not on a floor.
#: Unit: 1. Origin: chosen.
RESTS_MISLEAD = 0.03

#: The same if something stands still at the upper end.
#: Unit: 1. Origin: chosen.
SQUATS_MISLEAD = 0.5

#: What is at the upper end is at most this far from the highest, relative to the range.
#: Unit: 1. Origin: chosen.
UPPER_END = 0.15

#: What stands still there moves less than this, relative to what moves most.
#: Unit: 1. Origin: chosen.
HARDLY = 0.05

#: The same if they are named as feet.
#: Unit: 1. Origin: chosen.
FEET_MISLEAD = 0.01

#: Share of the files that state another direction than the true one.
#: Unit: 1. Origin: chosen. Programs write the axes of a screen, often unasked.
STATED_MISLEADS = 0.2

#: Share of the files whose force plates are not level in the markers' axes.
#: Unit: 1. Origin: chosen. Programs turn markers and forget the plates.
PLATES_MISLEAD = 0.1

#: Least component of a level plate's normal along an axis.
#: Unit: 1. Origin: chosen. Ramps are less steep.
LEVEL = 0.95

#: Share of the recordings in which left and right are not beside one another.
#: Unit: 1. Origin: chosen.
SIDES_MISLEAD = 0.05

#: Share of the recordings in which what stands still is not below what moves.
#: Unit: 1. Origin: chosen.
STANCE_MISLEADS = 0.1

#: How many times farther the body is from its feet along the vertical than along any
#: other axis.
#: Unit: 1. Origin: measured. In 19 public recordings of standing, walking, running and
#: a serve it is 3.9 times or more. At 1.5 times as much all of them are still sure.
UPRIGHT = 2.0

#: Concentration of the direction from feet to head about the vertical.
#: Unit: 1. Origin: chosen. At 12 the mean tilt of a body is 17 degrees.
ON_TWO_LEGS = 12.0

#: The same of a body that is not `UPRIGHT`.
#: Unit: 1. Origin: chosen.
LEANING = 3.0

#: The same of an animal on four legs, whose legs are short.
#: Unit: 1. Origin: chosen.
ON_FOUR_LEGS = 8.0

#: Share of the places of all parts that their usual heights explain, from which on a
#: body is straight.
#: Unit: 1. Origin: chosen. Made-up people who stand or lie have 0.92 to 0.95, most of
#: those who sit or stoop at most 0.90.
STRAIGHT = 0.9

#: The same of legs with a pelvis, which are wide for their length.
#: Unit: 1. Origin: chosen. Made-up people who stand or lie have 0.81 to 0.88, those who
#: sit at most 0.74; who stoops has straight legs.
STRAIGHT_LEGS = 0.78

#: Range of the usual heights of parts from which on they are not of legs alone.
#: Unit: 1. Origin: chosen. Legs with a pelvis have 0.6, with a trunk it is 0.8.
MORE_THAN_LEGS = 0.7

#: Concentration of the direction from feet to head about the vertical, of a straight
#: body that does not move.
#: Unit: 1. Origin: chosen. The mean tilt of such a body is then 5 degrees; made-up
#: people who stand have less than 4, and who lies has any along the floor.
ERECT = 200.0

#: Least of that likelihood, relative to the one without a tilt.
#: Unit: 1. Origin: chosen. Who tilts more is asked about, and not called lying.
LEAST_ERECT = 0.1

#: Concentration of the direction from what stands to what moves.
#: Unit: 1. Origin: chosen.
STANDS_BELOW = 6.0

#: Concentration of the direction from left to right about the horizontal.
#: Unit: 1. Origin: chosen.
BESIDE = 12.0

#: Share of the variation of the heights of parts that a direction must explain before
#: it says anything.
#: Unit: 1. Origin: chosen.
LEAST_EXPLAINED = 0.5

#: Markers with a known part, at least.
#: Unit: 1. Origin: derived: with three any direction explains much by chance.
LEAST_NAMED = 4

#: Range of the usual heights of those parts, at least, relative to the stature.
#: Unit: 1. Origin: chosen. As from the pelvis to the shoulders.
LEAST_RANGE = 0.2

#: The same, from which on a trunk that leans does not matter.
#: Unit: 1. Origin: chosen. As from the feet to the pelvis.
WHOLE_RANGE = 0.5

#: Evenly spaced frames in which postures are looked at.
#: Unit: frames. Origin: chosen.
MOST_POSTURES = 200

#: Usual height of a body that the user names, relative to its stature, if the names of
#: its markers do not tell.
#: Unit: 1. Origin: table: as of the pelvis (`vocabulary.HEIGHTS`).
OF_A_BODY = 0.57

#: Speed of a marker that stands still, relative to the fast ones.
#: Unit: 1. Origin: chosen.
STILL = 0.08

#: Time over which that speed is measured.
#: Unit: s. Origin: chosen.
STEP_S = 0.04

#: Evenly spaced steps of that kind that are looked at, at most.
#: Unit: 1. Origin: chosen.
MOST_STEPS = 2000

#: Such steps in which most markers move, at least.
#: Unit: 1. Origin: chosen.
LEAST_STEPS = 20

#: Share of these steps in which a foot stands, at least.
#: Unit: 1. Origin: chosen.
LEAST_STANCE = 0.15

#: Least range of a marker's places, relative to the largest, where all travel.
#: Unit: 1. Origin: chosen.
TRAVELS = 0.6

# How often each direction points up in files, by their suffix and for the others.
_USUAL = {"z": 0.5, "y": 0.33, "-y": 0.06, "x": 0.05, "-z": 0.03, "-x": 0.03}
_HABITS: Mapping[str, Mapping[str, float]] = {
    ".trc": {"y": 0.6, "z": 0.28, "-y": 0.04, "x": 0.04, "-z": 0.02, "-x": 0.02},
    ".c3d": {"z": 0.68, "y": 0.2, "-y": 0.02, "x": 0.06, "-z": 0.02, "-x": 0.02},
    ".tsv": {"z": 0.85, "y": 0.07, "-y": 0.02, "x": 0.02, "-z": 0.02, "-x": 0.02},
    ".mat": {"z": 0.75, "y": 0.15, "-y": 0.03, "x": 0.03, "-z": 0.02, "-x": 0.02},
}

# Kinds of evidence, each of which may disagree with the others.
HABIT = "habit"
FALL = "fall"
RESTS = "rests"
STANCE = "stance"
PLATES = "plates"
POSTURE = "posture"

# Those that tell who stands from who lies.
OF_A_FLOOR = (FALL, RESTS, STANCE, PLATES)


@dataclass(frozen=True)
class Evidence:
    """One piece of evidence on the direction that points up.

    Parameters
    ----------
    kind : str
        What it is, such as ``"fall"`` or ``"names"``.
    log_likelihood : mapping
        Natural logarithm of its probability for each of `axes.DIRECTIONS`.
    why : Message
        What speaks for its own likeliest direction.
    """

    kind: str
    log_likelihood: Mapping[str, float]
    why: Message

    @property
    def best(self) -> str:
        """The direction that it speaks for."""
        return max(DIRECTIONS, key=lambda up: self.log_likelihood[up])

    def margin(self, one: str, other: str) -> float:
        """Return how much likelier it finds one direction than another, nepers."""
        return self.log_likelihood[one] - self.log_likelihood[other]


def _evidence(
    kind: str, weights: Mapping[str, float], misleads: float, why: Message
) -> Evidence:
    """Return evidence that misleads altogether in a share of the recordings.

    `weights` need not sum to 1.
    """
    total = sum(weights.values())
    of_chance = misleads / len(DIRECTIONS)
    logs = {}
    for up in DIRECTIONS:
        probability = (1 - misleads) * weights.get(up, 0.0) / total + of_chance
        logs[up] = float(np.log(probability))
    return Evidence(kind, logs, why)


def by_habit(suffix: str) -> Evidence:
    """Return how often each direction points up in files of a format."""
    return _evidence(
        HABIT, _HABITS.get(suffix, _USUAL), 0.0, Message("recordings.up_by_habit")
    )


def by_fall(fall: FreeFall) -> Evidence | None:
    """Return what free fall says, if it is clear."""
    if not fall.is_clear:
        return None
    is_flight = fall.spread >= MOST_FALL and fall.share >= OFTEN
    if not is_flight:
        misleads = FEW_FALLS_MISLEAD
    elif fall.share < SELDOM:
        misleads = SELDOM_FALL_MISLEADS
    else:
        misleads = FALL_MISLEADS
    values = {"percent": 100 * fall.share, "next_percent": 100 * fall.next_share}
    why = Message("recordings.up_by_fall", values)
    return _evidence(FALL, {fall.up: 1.0}, misleads, why)


def by_statement(stated_up: str) -> Evidence | None:
    """Return what the file states."""
    if not stated_up:
        return None
    why = Message("recordings.up_as_stated")
    return _evidence("statement", {stated_up: 1.0}, STATED_MISLEADS, why)


def by_plates(corners: FloatArray | None, positions: FloatArray) -> Evidence | None:
    """Return the direction in which force plates lie level, below the markers.

    Parameters
    ----------
    corners : (P, 4, 3) array or None
        Corners of the plates that the file states, along its axes.
    positions : (N, M, 3) array
        In the same unit.
    """
    if corners is None or not len(corners):
        return None
    axis = _axis_of_level(corners)
    if not axis:
        return None
    stride = max(1, len(positions) // MOST_POSTURES)
    centre = corners.reshape(-1, 3).mean(axis=0)
    heights = along(positions[::stride] - centre, axis)
    heights = heights[np.isfinite(heights)]
    if not len(heights):
        return None
    above = float(np.mean(heights > 0))
    weights = {axis: above, f"-{axis}": 1 - above}
    why = Message("recordings.up_by_plates")
    return _evidence(PLATES, weights, PLATES_MISLEAD, why)


def _axis_of_level(corners: FloatArray) -> str:
    """Return the axis across which all plates (P, 4, 3) lie level; empty if none."""
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    areas = np.linalg.norm(normals, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        components = np.nan_to_num(np.abs(normals / areas))
    axes = np.argmax(components, axis=1)
    are_level = bool((components.max(axis=1) > LEVEL).all())
    if len(set(axes.tolist())) > 1 or not are_level:
        return ""
    return "xyz"[axes[0]]


def by_rests(
    positions: FloatArray, feet: Sequence[int], over: FloatArray
) -> Evidence | None:
    """Return along which direction markers come to rest again and again.

    Parameters
    ----------
    positions : (N, M, 3) array
        In any unit, along the file's axes.
    feet : sequence of int
        The markers on feet, if they are known.
    over : (3,) array
        From the feet to the body, NaN if not known: someone who squats comes back to
        one height at the upper end.
    """
    up, flatness, following = flattest_direction(positions, feet)
    is_flat = flatness < FLAT and CLEARER * flatness < following
    if not is_flat or along(over, up) <= 0:
        return None
    if len(feet):
        misleads = FEET_MISLEAD
    elif _stands_at_upper_end(positions, up):
        misleads = SQUATS_MISLEAD
    else:
        misleads = RESTS_MISLEAD
    return _evidence(RESTS, {up: 1.0}, misleads, Message("recordings.up_by_rest"))


def _stands_at_upper_end(positions: FloatArray, up: str) -> bool:
    """Tell whether what is highest along `up` stands still, as feet do."""
    stride = max(1, len(positions) // MOST_STEPS)
    heights = along(positions[::stride], up)
    low, middle, high = quantiles(heights, [0.01, 0.5, 0.99])
    ranges = high - low
    if not np.isfinite(ranges).any():
        return False
    bottom = np.nanmin(low)
    top = np.nanmax(high)
    at_upper_end = middle > top - UPPER_END * (top - bottom)
    stays = ranges < HARDLY * np.nanmax(ranges)
    return bool(np.count_nonzero(at_upper_end & stays) > 1)


@dataclass(frozen=True)
class Posture:
    """How the parts of a body lie, in the frames in which they are seen.

    Parameters
    ----------
    stature : (3,) array
        From the ground to the top of a body whose parts are spaced as usual, in the
        file's unit along its axes; a median over frames.
    explained : (3,) array
        Share of the variation of the usual heights that each axis explains.
    height_range : float
        Range of the usual heights of the parts, relative to the stature.
    folding : float
        How much the stature changes, but for a tenth of the frames, relative to it.
    striding : float
        How much left and right feet move past one another, likewise.
    straightness : float
        Share of the variation of all parts' places that the usual heights explain.
    """

    stature: FloatArray
    explained: FloatArray
    height_range: float
    folding: float
    striding: float = 0.0
    straightness: float = 0.0

    @property
    def is_whole(self) -> bool:
        """Tell whether the parts are far enough apart for a lean not to matter."""
        return self.height_range >= WHOLE_RANGE

    @property
    def is_straight(self) -> bool:
        """Tell whether the parts are in a row, as of one who stands or lies."""
        if self.height_range > MORE_THAN_LEGS:
            return self.straightness > STRAIGHT
        return self.straightness > STRAIGHT_LEGS


def posture_of(
    positions: FloatArray,
    named: NamedParts,
    *,
    feet: Sequence[int] = (),
    body: Sequence[int] = (),
) -> Posture | None:
    """Fit the usual heights of the parts to their places, frame by frame.

    Parameters
    ----------
    positions : (N, M, 3) array
        In any unit, along the file's axes.
    named : NamedParts
        The parts that the M names mean.
    feet, body : sequence of int
        Markers that the user gave these roles.

    Returns
    -------
    Posture or None
        None if too few parts are known, or all are of one height.
    """
    heights = np.array([named.heights.get(part, np.nan) for part in named.parts])
    if len(body):
        above = np.nan_to_num(heights[list(body)])
        heights[list(body)] = np.where(above > OF_A_BODY / 2, above, OF_A_BODY)
    if len(feet):
        heights[list(feet)] = named.heights["foot"]
    known = np.flatnonzero(np.isfinite(heights))
    least = 2 if len(body) and len(feet) else LEAST_NAMED
    if len(known) < least or np.ptp(heights[known]) < LEAST_RANGE:
        return None
    stride = max(1, len(positions) // MOST_POSTURES)
    places = positions[::stride, known]
    seen = np.asarray(np.isfinite(places).all(axis=2))
    posture = _posture(places, seen, heights[known], least)
    if posture is None:
        return None
    stature = posture.stature
    striding = _striding(positions[::stride], named, stature)
    return replace(posture, striding=striding)


def _striding(positions: FloatArray, named: NamedParts, stature: FloatArray) -> float:
    """Return how far left and right feet move past one another across the body.

    Relative to the stature (3,); 0 if there are no feet of both sides.
    """
    length = float(np.linalg.norm(stature))
    left = [m for m in named.feet if named.sides[m] == "l"]
    right = [m for m in named.feet if named.sides[m] == "r"]
    if not left or not right or not length > 0:
        return 0.0
    apart = positions[:, left].mean(axis=1) - positions[:, right].mean(axis=1)
    apart = apart[np.isfinite(apart).all(axis=1)]
    if not len(apart):
        return 0.0
    to_head = stature / length
    across = apart - (apart @ to_head)[:, None] * to_head
    near, far = np.quantile(across, [0.05, 0.95], axis=0)
    return float((far - near).max()) / length


def _posture(
    places: FloatArray, seen: BoolArray, heights: FloatArray, least: int
) -> Posture | None:
    """Fit heights (K,) to places (N, K, 3) where `least` are seen (N, K)."""
    enough = seen.sum(axis=1) >= least
    places = np.where(seen[..., None], places, 0.0)[enough]
    weights = seen[enough].astype(np.float64)
    if not len(weights):
        return None
    count = weights.sum(axis=1)
    centre = places.sum(axis=1) / count[:, None]
    apart = (places - centre[:, None]) * weights[..., None]
    mean_height = (weights * heights).sum(axis=1) / count
    above = (heights - mean_height[:, None]) * weights
    of_heights = (above**2).sum(axis=1)
    in_common = np.einsum("nk,nki->ni", above, apart)
    of_places = (apart**2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        statures = in_common / of_heights[:, None]
        explained = in_common**2 / (of_heights[:, None] * of_places)
        of_all = (in_common**2).sum(axis=1) / (of_heights * of_places.sum(axis=1))
    spread_enough = of_heights > 0
    if not spread_enough.any():
        return None
    n_markers = int(np.median(count))
    stature = np.median(statures[spread_enough], axis=0)
    shares = np.nan_to_num(np.median(explained[spread_enough], axis=0))
    # Few markers fit any direction by chance.
    adjusted = 1 - (1 - shares) * (n_markers - 1) / max(n_markers - 2, 1)
    lengths = np.linalg.norm(statures[spread_enough], axis=1)
    shortest, usual, longest = np.quantile(lengths, [0.05, 0.5, 0.95]).tolist()
    folding = (longest - shortest) / usual if usual > 0 else 0.0
    return Posture(
        stature,
        np.maximum(adjusted, 0.0),
        float(np.ptp(heights)),
        folding,
        straightness=float(np.nan_to_num(np.median(of_all[spread_enough]))),
    )


def by_posture(
    posture: Posture | None,
    named: NamedParts,
    *,
    given: bool,
    others: Sequence[Evidence],
) -> Evidence | None:
    """Return along which direction the parts of a body lie above one another.

    Parameters
    ----------
    posture : Posture or None
        Output of `posture_of`.
    named : NamedParts
        The parts that the names mean.
    given : bool
        Whether the user named the body and the feet.
    others : sequence of Evidence
        All other evidence. The body may lie unless some of this tells that it stands,
        or it squats, jumps, walks or runs.
    """
    if posture is None:
        return None
    length = float(np.linalg.norm(posture.stature))
    beyond = posture.explained.max() - LEAST_EXPLAINED
    if not length > 0 or not beyond > 0:
        return None
    beside, above = np.sort(np.abs(posture.stature))[1:].tolist()
    concentration = ON_FOUR_LEGS if named.is_animal else ON_TWO_LEGS
    concentration *= beyond / (1 - LEAST_EXPLAINED)
    if not posture.is_whole:
        concentration *= posture.height_range / WHOLE_RANGE
    if not above > UPRIGHT * beside:
        concentration = min(concentration, LEANING)
    along_stature = posture.stature / length
    weights = {
        up: float(np.exp(concentration * along(along_stature, up))) for up in DIRECTIONS
    }
    why = _why_upright(beside, above, given=given)
    if given:
        misleads = ROLES_MISLEAD
    elif posture.is_whole:
        misleads = NAMES_MISLEAD
    else:
        misleads = TRUNK_MISLEADS
    moves = posture.folding > FOLDS or posture.striding > STRIDES
    if not given and not moves and not _is_seen_to_stand(weights, others):
        weights = _may_lie(weights, posture)
    return _evidence(POSTURE, weights, misleads, why)


def _is_seen_to_stand(weights: Mapping[str, float], others: Sequence[Evidence]) -> bool:
    """Tell whether a floor or gravity speaks for the direction from feet to head."""
    to_head = max(DIRECTIONS, key=lambda up: weights[up])
    return any(one.kind in OF_A_FLOOR and one.best == to_head for one in others)


def _may_lie(weights: Mapping[str, float], posture: Posture) -> dict[str, float]:
    """Return weights of directions for a body that stands, or lies along an axis.

    Who stands is along the vertical, who lies along any direction on the floor.
    """
    to_head = max(DIRECTIONS, key=lambda up: weights[up])
    across = [up for up in DIRECTIONS if up[-1] != to_head[-1]]
    total = sum(weights.values())
    stands = 1 - LIES
    if posture.is_straight:
        length = float(np.linalg.norm(posture.stature))
        of_tilt = ERECT * (1 - along(posture.stature / length, to_head))
        stands *= max(LEAST_ERECT, float(np.exp(-of_tilt)))
    either = {up: stands * weight / total for up, weight in weights.items()}
    for up in across:
        either[up] += LIES / len(across)
    return either


def _why_upright(beside: float, above: float, *, given: bool) -> Message:
    """Report that parts lie above one another, and how much more than beside them."""
    if not beside > 0:
        if given:
            return Message("recordings.up_by_body")
        return Message("recordings.up_by_names")
    values = {"times": above / beside}
    if given:
        return Message("recordings.up_by_body_far", values)
    return Message("recordings.up_by_names_far", values)


def by_sides(positions: FloatArray, named: NamedParts) -> Evidence | None:
    """Return along which directions left and right are not apart.

    A person's left and right markers are beside one another.
    """
    pairs = _central_pairs(named)
    if not pairs:
        return None
    stride = max(1, len(positions) // MOST_POSTURES)
    left = positions[::stride, [one for one, _ in pairs]]
    right = positions[::stride, [other for _, other in pairs]]
    apart = left - right
    length = np.linalg.norm(apart, axis=2, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        squares = (apart / length) ** 2
    squares = squares[np.isfinite(squares).all(axis=2)]
    if not len(squares):
        return None
    tilt = squares.mean(axis=0)
    weights = {up: float(np.exp(-BESIDE * along(tilt, up[-1]))) for up in DIRECTIONS}
    return _evidence("sides", weights, SIDES_MISLEAD, Message("recordings.up_by_sides"))


def _central_pairs(named: NamedParts) -> list[tuple[int, int]]:
    """Return the left and the right marker of each pair near the trunk.

    Hands and feet swing; what is near the trunk is beside its fellow.
    """
    of_left = {}
    for m, (stem, side) in enumerate(zip(named.stems, named.sides, strict=True)):
        if side == "l":
            of_left[stem] = m
    pairs = []
    for m, (stem, side) in enumerate(zip(named.stems, named.sides, strict=True)):
        is_central = named.parts[m] in ("pelvis", "hip", "thigh", "shoulder", "head")
        if side == "r" and stem in of_left and is_central:
            pairs.append((of_left[stem], m))
    return pairs


def by_stance(positions: FloatArray, rate_hz: float) -> Evidence | None:
    """Return where the markers lie that stand still while others move: below these.

    Only where all markers travel, since on a treadmill it is the trunk that stays.
    """
    stride = max(1, len(positions) // MOST_STEPS)
    ahead = max(1, round(STEP_S * rate_hz))
    begin = positions[:-ahead:stride]
    end = positions[ahead::stride][: len(begin)]
    if len(begin) < LEAST_STEPS or not _all_travel(begin):
        return None
    moved = np.linalg.norm(end - begin, axis=2)
    seen = np.isfinite(moved)
    if not seen.any():
        return None
    fast = float(np.quantile(moved[seen], 0.95))
    # Frames in which a marker is not seen count as those in which it stands.
    moving = np.median(np.where(seen, moved, 0.0), axis=1) > 2 * STILL * fast
    if np.count_nonzero(moving) < LEAST_STEPS:
        return None
    n_seen = np.maximum(seen[moving].sum(axis=0), 1)
    stands = (moved[moving] < STILL * fast).sum(axis=0) / n_seen
    on_feet = stands >= LEAST_STANCE
    if not 2 <= np.count_nonzero(on_feet) <= 0.5 * len(stands):
        return None
    over = _median_offset(begin[moving], on_feet)
    length = float(np.linalg.norm(over))
    if not length > 0:
        return None
    weights = {
        up: float(np.exp(STANDS_BELOW * along(over / length, up))) for up in DIRECTIONS
    }
    why = Message("recordings.up_by_stance")
    return _evidence(STANCE, weights, STANCE_MISLEADS, why)


def _all_travel(positions: FloatArray) -> bool:
    """Tell whether all markers (N, M, 3) travel, most of them about as far."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # markers that are never seen
        ranges = np.nanmax(positions, axis=0) - np.nanmin(positions, axis=0)
    travelled = ranges.max(axis=1)
    travelled = travelled[np.isfinite(travelled)]
    if not len(travelled):
        return False
    return bool(np.quantile(travelled, 0.05) > TRAVELS * travelled.max())


def _median_offset(frames: FloatArray, on_feet: BoolArray) -> FloatArray:
    """Return the mean of other markers minus that of those on feet, median, (3,)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without any marker
        offsets = np.nanmean(frames[:, ~on_feet], axis=1)
        offsets -= np.nanmean(frames[:, on_feet], axis=1)
        return np.nan_to_num(np.nanmedian(offsets, axis=0))


def log_odds(pieces: Sequence[Evidence]) -> dict[str, float]:
    """Return the logarithm of each direction's probability, all evidence together."""
    of_direction = {}
    for up in DIRECTIONS:
        of_direction[up] = sum(one.log_likelihood[up] for one in pieces)
    # Exponentials of the sums themselves would be too small for a double.
    largest = max(of_direction.values())
    shares = [np.exp(one - largest) for one in of_direction.values()]
    of_all = largest + float(np.log(sum(shares)))
    return {up: one - of_all for up, one in of_direction.items()}
