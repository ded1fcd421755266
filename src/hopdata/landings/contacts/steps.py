"""Landings that no descent of the body shows, found in each foot's own descents.

A body hardly falls in a walk, and a file may hold no body at all. Every foot that lands
comes down from its own apex, however, so its descents show where to look.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.contacts import descents
from hopdata.landings.contacts.law import UNDETERMINED_S
from hopdata.landings.contacts.noise import height_noise

#: Share of a foot's descent, from its end, at which the foot is still surely in the
#: air: a descent of the body shows the landing if it has begun by then.
#: Unit: 1. Origin: chosen.
HALF_WAY = 0.5

#: Share of a foot's descent, from its end, below which the foot is nearly down.
#: Unit: 1. Origin: chosen.
NEARLY_DOWN = 0.15

#: Share of a foot's usual descent that a foot must exceed by twice to have been up.
#: Unit: 1. Origin: chosen.
LOW_SHARE = 0.05

#: Least fall of a foot or a body, in standard deviations of its height: the noise of a
#: thousand frames spans 6 to 7 of them.
#: Unit: standard deviations. Origin: chosen.
LEAST_FALL_SIGMAS = 15.0

#: Time after a foot is nearly down until which its contact is sought, of an animal of
#: 1 m: a heel then stands, and a toe has followed.
#: Unit: s. Origin: chosen.
AFTER_S = 0.12

#: Landings of two feet that are closer than this belong together, of an animal of 1 m:
#: a foot's own next landing comes later.
#: Unit: s. Origin: chosen.
TOGETHER_S = 0.1

#: Contacts in one descent of a foot that are closer than this are the same, of an
#: animal of 1 m: the foot has not been up in between.
#: Unit: s. Origin: chosen.
SAME_S = 0.15

# The row of the other contact of a foot that has no other.
NO_OTHER = -1


@dataclass(frozen=True)
class Steps:
    """Descents of single feet, S in all, in the order in which they came down.

    Parameters
    ----------
    foot : (S,) int array
        Number of the foot.
    apex, half_way, down : (S,) array
        When the foot was highest, half way down, and nearly down, s.
    """

    foot: IntArray
    apex: FloatArray
    half_way: FloatArray
    down: FloatArray

    def take(self, chosen: BoolArray) -> Steps:
        """Return the steps that are marked, (S,)."""
        return Steps(
            self.foot[chosen],
            self.apex[chosen],
            self.half_way[chosen],
            self.down[chosen],
        )


def find_steps(
    time: FloatArray, heights: FloatArray, *, noise_m: float
) -> tuple[Steps, float]:
    """Find the descents of each foot, and how far a foot usually falls in them.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet, m; NaN where unseen.
    noise_m : float
        Standard deviation of a height, m.

    Returns
    -------
    steps : Steps
    fall_m : float
        Median fall of a foot in its descents, m; 0 without any.
    """
    rows = []
    falls_m = []
    for foot, height in enumerate(heights.T):
        for apex, nadir in descents.descents(height, time, longest=descents.HIDDEN_S):
            fall_m = height[apex] - height[nadir]
            if not fall_m > LEAST_FALL_SIGMAS * noise_m:
                continue
            above_m = height[apex : nadir + 1] - height[nadir]
            # Frames that do not show the foot are no higher than any.
            is_high = above_m > HALF_WAY * fall_m
            last_high = int(np.flatnonzero(is_high)[-1])
            is_down = above_m[last_high:] <= NEARLY_DOWN * fall_m
            down = last_high + int(np.argmax(is_down))
            rows.append((foot, time[apex], time[apex + last_high], time[apex + down]))
            falls_m.append(fall_m)
    if not rows:
        none = np.empty(0)
        return Steps(none.astype(np.int64), none, none, none), 0.0
    foot_of, at_apex, at_half, at_down = np.array(rows).T
    order = np.argsort(at_down, kind="stable")
    steps = Steps(
        foot_of[order].astype(np.int64), at_apex[order], at_half[order], at_down[order]
    )
    return steps, float(np.median(falls_m))


def clear_falls(
    body: FloatArray, falls: list[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Return the descents of a body that its noise does not make.

    `body` (N,) is its height, m, and `falls` are frames of apex and nadir.
    """
    least_m = LEAST_FALL_SIGMAS * height_noise(body[:, None])
    return [
        (apex, nadir) for apex, nadir in falls if body[apex] - body[nadir] > least_m
    ]


def shown_by_body(steps: Steps, spans: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return until when feet are sought in the body's descents, and which steps are.

    A step is sought in the descent of the body that holds its second half. A foot that
    lands when the body rises again, as the hind feet do after a jump, is sought until
    it is surely down.

    Parameters
    ----------
    steps : Steps
        S descents of the feet.
    spans : (L, 2) array
        Apex and nadir of each descent of the body, s.

    Returns
    -------
    spans : (L, 2) array
        With later ends where feet need it.
    is_shown : (S,) bool array
        Whether a descent of the body holds each step.
    """
    if not len(spans):
        return spans, np.zeros(len(steps.foot), dtype=bool)
    row = np.searchsorted(spans[:, 0], steps.half_way, side="right") - 1
    is_shown = (row >= 0) & (spans[np.maximum(row, 0), 1] >= steps.down)
    # The second half of what is left takes as long as the first, or less.
    touches_s = steps.down + (steps.down - steps.half_way)
    sought_until = spans[:, 1].copy()
    is_late = is_shown & (touches_s > spans[np.maximum(row, 0), 1])
    np.maximum.at(sought_until, row[is_late], steps.down[is_late] + AFTER_S)
    return np.stack([spans[:, 0], sought_until], axis=1), is_shown


def landings_of(steps: Steps, n_feet: int) -> tuple[FloatArray, BoolArray]:
    """Return the landings (H, 2), s, in which these steps end, and whose they are.

    Feet that come down within `TOGETHER_S` land together, each of them once. A landing
    begins with the last apex of the foot that was highest first.

    Parameters
    ----------
    steps : Steps
        In the order in which they came down.
    n_feet : int
        Number of feet, n.

    Returns
    -------
    spans : (H, 2) array
        When the first of the feet was highest, and when the search ends, s.
    own : (H, n) bool array
        Which feet land in each.
    """
    groups: list[list[int]] = []
    for step, down_s in enumerate(steps.down):
        joins = False
        if groups:
            last = groups[-1]
            is_near = down_s - steps.down[last[0]] <= TOGETHER_S
            joins = is_near and steps.foot[step] not in steps.foot[last]
        if joins:
            groups[-1].append(step)
        else:
            groups.append([step])
    spans = np.empty((len(groups), 2))
    own = np.zeros((len(groups), n_feet), dtype=bool)
    for row, group in enumerate(groups):
        spans[row, 0] = steps.apex[group].min()
        spans[row, 1] = steps.down[group].max() + AFTER_S
        own[row, steps.foot[group]] = True
    return spans, own


def found_twice(
    steps: Steps, instant: FloatArray, se: FloatArray, status: IntArray
) -> tuple[BoolArray, FloatArray, IntArray]:
    """Mark the contacts (L, n) that belong to a descent of a foot with a better one.

    The body and the foot may both show a landing, and each has its row then. Better is
    the one that can be trusted; of two such, the surer one. If both have a kink, but
    are farther apart than the other's error explains, either may be the contact: it
    depends on where it is sought, and so on the choice of the body.

    Parameters
    ----------
    steps : Steps
        All descents of the feet.
    instant, se : (L, n) array
        Contacts and their standard errors, s; NaN for none.
    status : (L, n) int array
        Codes of `hopdata.landings.contacts.descents`.

    Returns
    -------
    twice : (L, n) bool array
    choice_s : (L, n) array
        Error of the better contact from the choice between the two, s; else 0.
    other : (L, n) int array
        Row of the other contact where there is such a choice; else `NO_OTHER`.
    """
    choice_s = np.zeros(instant.shape)
    other = np.full(instant.shape, NO_OTHER)
    twice = np.zeros(instant.shape, dtype=bool)
    lands = np.isfinite(instant) & (status == descents.LANDED)
    for foot in range(instant.shape[1]):
        apexes = np.sort(steps.apex[steps.foot == foot])
        rows = np.flatnonzero(np.isfinite(instant[:, foot]))
        rows = rows[np.argsort(instant[rows, foot], kind="stable")]
        kept = -1
        for row in rows.tolist():
            is_same = False
            if kept >= 0:
                pair = instant[np.array([kept, row]), foot]
                descent = np.searchsorted(apexes, pair, side="right")
                is_same = descent[0] == descent[1] and pair[1] - pair[0] < SAME_S
            if not is_same:
                kept = row
                continue
            doubts = [
                (status[one, foot] != descents.LANDED, se[one, foot])
                for one in (kept, row)
            ]
            worse = row if doubts[0] <= doubts[1] else kept
            twice[worse, foot] = True
            kept = kept + row - worse
            have_kinks = lands[[kept, worse], foot] & (
                se[[kept, worse], foot] < UNDETERMINED_S
            )
            if have_kinks.all():
                apart_s = instant[worse, foot] - instant[kept, foot]
                unexplained = max(apart_s**2 - se[worse, foot] ** 2, 0.0)
                # The error is 0 or all of it, at even odds.
                choice_s[kept, foot] = np.sqrt(unexplained / 2)
                if unexplained:
                    other[kept, foot] = worse
    return twice, choice_s, other


def only_settles(steps: Steps, instant: FloatArray) -> BoolArray:
    """Mark instants (L, n) at which a foot had come down long before: it only settles.

    It is so if the last descent of the foot before the instant ended more than
    `AFTER_S` earlier. A foot without any descent before it tells nothing.
    """
    settles = np.zeros(instant.shape, dtype=bool)
    for foot in range(instant.shape[1]):
        own = steps.foot == foot
        order = np.argsort(steps.apex[own], kind="stable")
        apex = steps.apex[own][order]
        down = steps.down[own][order]
        rows = np.flatnonzero(np.isfinite(instant[:, foot]))
        last = np.searchsorted(apex, instant[rows, foot], side="right") - 1
        known = last >= 0
        after_s = instant[rows[known], foot] - down[last[known]]
        settles[rows[known], foot] = after_s > AFTER_S
    return settles
