"""How much the distances within a body change, and whether it is one body at all.

One measure serves `hopdata init`, which proposes a body, and the checks, which refuse
what is none. Markers on skin move: at an impact those of a pelvis by up to 17 mm
against one another. What such a motion does to the pose of the body depends on the size
of the body, not on the distance between the two markers, so changes are relative to the
body's size, its largest distance.

A foot among the body's markers moves with the body in flight, but not in stance. It is
known by its place: it comes down to where the feet are, far below the rest of the body,
and there its distances change by more than skin gives.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.messages import Message
from hopdata.recordings.quality.rests import lowest
from hopdata.recordings.quality.rigid import (
    STRAIN,
    PairDistances,
    frame_noise,
    norms,
    pair_distances,
)
from hopdata.recordings.quality.stretches import quantiles

#: Largest change of a distance within a body, relative to the body's size.
#: Unit: 1. Origin: measured. The pelves of 20 public recordings of walks, runs and a
#: serve reach 0.044. With one more marker on a thigh or knee they reach 0.046 to 0.084,
#: on a foot 0.02 to 0.19. With a limit 1.5 times larger nearly all thighs pass.
LARGEST_STRAIN = 0.05

#: The same where a marker is lowest, as a multiple of the limit above.
#: Unit: 1. Origin: measured. Those pelves reach 1.2 (a runner's impacts), knees of the
#: serve 3 to 4. With 1.5 times as much the thighs pass.
LOWEST_STRAINS = 2.0

#: The same for a marker on the floor: to be of the body, what is there has to be rigid.
#: Unit: 1. Origin: measured. Feet reach 1.4 and more. With 1.5 times as much a foot
#: passes that leaves the body for a tenth of the time.
FLOOR_STRAINS = 0.5

#: Change of a distance, relative to the body's size, beyond which it is remarked that
#: the body is soft.
#: Unit: 1. Origin: derived: the spread up to which `rigid_clusters` takes markers for
#: rigid. At 1.5 times as much, four of the seven soft ones are told nothing.
SOFT_STRAIN = STRAIN

#: Share of the frames in which a marker counts as low; a stance may be as short a part
#: of a recording.
#: Unit: 1. Origin: chosen. At 1.5 times as much a foot that stands in a tenth of the
#: frames is still found.
LOWEST_FRAMES = 0.05

#: A marker is on the floor if it comes as near to the lowest place of the feet as this
#: share of the height of the body's highest marker.
#: Unit: 1. Origin: measured. Ankles reach 0.1, the pelvis of a deep squat stays above
#: 0.5.
ON_THE_FLOOR = 0.2

#: Factor on the variance of a distance by noise, to allow for chance in short
#: recordings.
#: Unit: 1. Origin: chosen.
NOISE_MARGIN = 2.0

#: Noise by which alone a marker is at its lowest.
#: Unit: standard deviations. Origin: chosen.
LOWEST_NOISE = 3.0

#: Markers of a body, at least.
#: Unit: 1. Origin: derived: three fix the attitude of a rigid body.
LEAST_BODY = 3

# When a distance changes.
USUALLY = "usually"
AT_ITS_LOWEST = "at its lowest"
ON_FLOOR = "on the floor"


@dataclass(frozen=True)
class Bending:
    """How much the distances between M markers change, beyond their noise.

    Parameters
    ----------
    median_m : (M, M) array
        Median distances, m.
    usual_m : (M, M) array
        Robust standard deviation of each distance, m.
    lowest_m : (M, M) array
        By how much a distance differs from its median where the first marker is lowest,
        m.
    noise_m : float
        Median noise of a coordinate from frame to frame, m.
    """

    median_m: FloatArray
    usual_m: FloatArray
    lowest_m: FloatArray
    noise_m: float

    @property
    def size_m(self) -> float:
        """Return the size of the body, m: the largest distance, or NaN."""
        known = self.median_m[np.isfinite(self.median_m)]
        if not known.size:
            return float("nan")
        return float(known.max())

    @property
    def strain(self) -> FloatArray:
        """Return the usual change of each distance, relative to the size, (M, M)."""
        return relative(self.usual_m, self.size_m)


@dataclass(frozen=True)
class Bend:
    """One distance that changes, and the marker that is to blame.

    Parameters
    ----------
    pair : tuple of int
        The two markers.
    odd : int
        The one of the two whose other distances change more.
    change_m : float
        Change of the distance, m.
    length_m : float
        Length to which the change is compared, m.
    limit : float
        Largest change that is accepted, relative to that length.
    when : str
        When it was measured: `USUALLY`, `AT_ITS_LOWEST` or `ON_FLOOR`.
    """

    pair: tuple[int, int]
    odd: int
    change_m: float
    length_m: float
    limit: float
    when: str

    @property
    def strain(self) -> float:
        """Return the change relative to the length."""
        return self.change_m / self.length_m


@np.errstate(over="ignore", invalid="ignore")  # absurd numbers are left to other checks
def bending(body: FloatArray) -> Bending:
    """Measure how much the distances between the markers of a body change.

    Parameters
    ----------
    body : (N, M, 3) array
        Positions, m, z up; NaN where not seen.
    """
    pairs = pair_distances(body)
    noise = frame_noise(body)
    usual_m = usual_bending(pairs, noise)

    variance = _variance_by_noise(noise)
    heights = body[:, :, 2]
    low = heights <= quantiles(heights, [LOWEST_FRAMES])[0]
    lowest_m = np.zeros_like(usual_m)
    for m, is_low in enumerate(low.T):
        moved = _lowest_distances(body, m, is_low) - pairs.median[m]
        beyond_noise = moved**2 - LOWEST_NOISE**2 * variance[m]
        lowest_m[m] = np.sqrt(np.clip(np.nan_to_num(beyond_noise), 0.0, None))

    known = noise[np.isfinite(noise)]
    noise_m = float(np.median(known)) if len(known) else float("nan")
    return Bending(pairs.median, usual_m, lowest_m, noise_m)


def _variance_by_noise(noise: FloatArray) -> FloatArray:
    """Return the variance of each distance, (M, M), by the markers' noise, (M,)."""
    return np.nan_to_num(noise[:, None] ** 2 + noise[None] ** 2)


def _lowest_distances(body: FloatArray, m: int, is_low: BoolArray) -> FloatArray:
    """Return the distances (M,), m, of marker `m` to the others where it `is_low` (N,).

    It is the median over visits, the runs of low frames. A marker that takes another
    one's place for a while, as names are exchanged, makes only one visit.
    """
    frames = np.flatnonzero(is_low)
    if not len(frames):
        return np.full(body.shape[1], np.nan)
    apart = norms(body[frames] - body[frames, m][:, None])
    is_first = np.diff(frames, prepend=-2) > 1
    begins = np.flatnonzero(is_first)
    known = np.isfinite(apart)
    sums = np.add.reduceat(np.where(known, apart, 0.0), begins, axis=0)
    counts = np.add.reduceat(known.astype(np.int64), begins, axis=0)
    visits = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    return np.asarray(quantiles(visits, [0.5])[0])


def usual_bending(pairs: PairDistances, noise: FloatArray) -> FloatArray:
    """Return the robust sd of each distance without the part due to noise, (M, M), m.

    Parameters
    ----------
    pairs : PairDistances
        Distances between M markers, m.
    noise : (M,) array
        Noise of each marker from frame to frame, m; NaN where unknown.
    """
    beyond_noise = pairs.spread**2 - NOISE_MARGIN * _variance_by_noise(noise)
    return np.sqrt(np.clip(np.nan_to_num(beyond_noise), 0.0, None))


def relative(change_m: FloatArray, length_m: float) -> FloatArray:
    """Return changes (...), m, relative to a length, m; 0 if that is not known."""
    if not length_m > 0:
        return np.zeros_like(change_m)
    return change_m / length_m


def what_bends(
    body: FloatArray, feet: FloatArray, *, largest_strain: float = LARGEST_STRAIN
) -> Bend | None:
    """Return what makes markers no body; None if they are one, rigid or soft.

    Parameters
    ----------
    body : (N, M, 3) array
        Positions of the body's markers, m, z up; NaN where not seen.
    feet : (N, F, 3) array
        Positions of the feet, m; there may be none.
    largest_strain : float
        Largest robust standard deviation of a distance, relative to the body's size.
        Where a marker is lowest, twice as much is accepted. Of a marker on the floor
        half as much is, relative to the size of the body without that marker.
    """
    found = bending(body)
    if not found.size_m > 0:
        return None
    lowest_limit = LOWEST_STRAINS * largest_strain
    bends = [
        _worst(found, found.usual_m, largest_strain, USUALLY),
        _worst(found, found.lowest_m, lowest_limit, AT_ITS_LOWEST),
    ]
    for m in np.flatnonzero(on_the_floor(body, feet)).tolist():
        bend = _bend_on_the_floor(found, m, FLOOR_STRAINS * largest_strain)
        if bend.length_m > 0:
            bends.append(bend)
    too_large = [bend for bend in bends if bend.strain > bend.limit]
    return max(too_large, key=lambda bend: bend.strain / bend.limit, default=None)


def _worst(found: Bending, changes_m: FloatArray, limit: float, when: str) -> Bend:
    """Return the largest of the changes (M, M), m.

    Of its two markers the odd one bends more.
    """
    changes_m = np.fmax(changes_m, changes_m.T)
    largest = np.unravel_index(np.argmax(changes_m), changes_m.shape)
    i = int(largest[0])
    j = int(largest[1])
    of_each = np.median(changes_m, axis=1)
    odd = i if of_each[i] > of_each[j] else j
    return Bend((i, j), odd, float(changes_m[i, j]), found.size_m, limit, when)


def _bend_on_the_floor(found: Bending, m: int, limit: float) -> Bend:
    """Return the largest change of the distances of a marker that is on the floor.

    It is relative to the size of the body without that marker.
    """
    others = np.delete(np.arange(len(found.median_m)), m)
    distances_m = found.median_m[np.ix_(others, others)]
    size_of_others_m = np.nanmax(np.nan_to_num(distances_m))
    lowest_m = np.fmax(found.lowest_m[m], found.lowest_m[:, m])
    changes_m = np.fmax(lowest_m, found.usual_m[m])[others]
    most = int(np.argmax(changes_m))
    return Bend(
        pair=(m, int(others[most])),
        odd=m,
        change_m=float(changes_m[most]),
        length_m=float(size_of_others_m),
        limit=limit,
        when=ON_FLOOR,
    )


def on_the_floor(body: FloatArray, feet: FloatArray) -> BoolArray:
    """Mark the markers of a body that come down to where the feet are, (M,).

    Parameters
    ----------
    body : (N, M, 3) array
        Positions of the body's markers, m, z up.
    feet : (N, F, 3) array
        Positions of the feet, m; there may be none.
    """
    if not feet.shape[1]:
        return np.zeros(body.shape[1], dtype=bool)
    floor_m = np.nanmin(lowest(feet[:, :, 2]), initial=np.inf)
    highest_m = np.nanmax(quantiles(body[:, :, 2], [0.5]), initial=-np.inf)
    lowest_m = quantiles(body[:, :, 2], [LOWEST_FRAMES])[0]
    with np.errstate(invalid="ignore"):
        near = lowest_m - floor_m < ON_THE_FLOOR * (highest_m - floor_m)
    return np.asarray(near & np.isfinite(floor_m) & np.isfinite(highest_m))


def one_body(
    members: Sequence[int], positions: FloatArray, feet: Sequence[int]
) -> list[int]:
    """Remove the markers that make the others no body; return what remains, or none.

    Parameters
    ----------
    members, feet : sequence of int
        Markers of the body to try, and of the feet.
    positions : (N, M, 3) array
        Positions of all markers, m, z up.
    """
    kept = list(members)
    while len(kept) >= LEAST_BODY:
        bend = what_bends(positions[:, kept], positions[:, feet])
        if bend is None:
            return kept
        kept.pop(bend.odd)
    return []


def softness_remark(body: FloatArray, names: tuple[str, ...]) -> list[Message]:
    """Remark that a body (N, M, 3), m, is soft: where, by how much, and the cost."""
    found = bending(body)
    if not found.size_m > 0:
        return []
    usual = _worst(found, found.usual_m, SOFT_STRAIN, USUALLY)
    low = _worst(found, found.lowest_m, SOFT_STRAIN, AT_ITS_LOWEST)
    worst = low if low.strain > usual.strain else usual
    if not worst.strain > worst.limit:
        return []

    i, j = worst.pair
    values = {
        "one": names[i],
        "other": names[j],
        "change_mm": 1e3 * worst.change_m,
        "percent": 100 * worst.strain,
        "size_mm": 1e3 * found.size_m,
        "usual_mm": 1e3 * usual.change_m,
        "cost": _cost(usual.change_m, found.noise_m),
    }
    if worst.when == USUALLY:
        return [Message("recordings.soft", values)]
    return [Message("recordings.soft_where_lowest", values)]


def _cost(change_m: float, noise_m: float) -> Message:
    """Return what a usual change of the distances, m, costs, beside the noise, m."""
    # A distance has the noise of two coordinates.
    coordinate_m = float(change_m / np.sqrt(2.0))
    values = {"noise_mm": 1e3 * coordinate_m}
    if not noise_m > 0:
        return Message("recordings.soft_cost", values)
    values["times"] = coordinate_m / noise_m
    return Message("recordings.soft_cost_in_noise", values)
