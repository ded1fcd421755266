"""Which landings are gross errors: swapped markers, slips, contacts of a second bounce.

A landing is left out if it is far from what all others tell:

- its body markers are not as far apart as those of the body (`markers_apart`);
- its state before is far from all others;
- its contact instants are far from those that are expected;
- its outcome is far from what a map of low order foretells, the same for all landings.

Of a contact order most of whose outcomes are far off none is left out: that is a map of
its own. Apart from this, nothing here looks at whether contact orders differ: the map
has kinks and steps of any size, and only the length of a miss counts, not its
direction. In a landing that has one derivative, what the map misses of the landings
that stay is therefore as likely to have either sign as before, which is all that random
signs ask for.

How far is too far is read from the study (`too_far`): a study with heavy tails has wide
limits, and loses next to nothing.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations
from statistics import NormalDist

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import LANDINGS_PER_TERM, kinks, monomials, split_states
from hopdata.maps.verdict import averaged
from hopdata.maps.verdict.inputs import LEAST_CLASS, STATE, SectionLandings
from hopdata.maps.verdict.linear import FLAT, whitened
from hopdata.maps.verdict.smooth import WAYS

#: Number of landings of a sound study that are expected beyond `too_far`, before
#: `GROSS`.
#: Unit: landings. Origin: convention: a half (Chauvenet's criterion).
EXPECTED_BEYOND = 0.5

#: A landing is a gross error this many times farther away than the farthest of a sound
#: study.
#: Unit: 1. Origin: measured: at 1, sound simulated studies lost up to 1.4 % of their
#: landings, those far out on the curvature of the map; at 1.5 sound bodies lost at most
#: 3 of 686, and up to 0.84 % with errors of Student's t with three degrees of freedom.
GROSS = 1.5

#: Contacts that miss the expected ones by less are no mistakes, however well all others
#: are foretold.
#: Unit: contact spreads. Origin: chosen: so small a miss moves no landing far from its
#: place among the orders.
LEAST_LATE = 0.1

#: Quantile of the distances that, with the median, tells how they spread.
#: Unit: 1. Origin: chosen: it holds up while fewer than a fifth of the landings are
#: wrong.
UPPER = 0.8

#: A state is far from all others beyond this distance from the median, which no heavy
#: tail explains.
#: Unit: the quantile `UPPER` of the distances. Origin: chosen: 20 standard deviations
#: of normally distributed states.
FAR_OFF = 16.0

#: Least slack of a landing (one minus its leverage) by which a residual is divided.
#: Unit: 1. Origin: chosen.
LEAST_SLACK = 0.05

#: Outcomes that are far off in more than this share of the landings of a contact order
#: are no mistakes: the order has a map of its own.
#: Unit: 1. Origin: chosen: sound studies lose less than 1 % of their landings, and of
#: an order with a map of its own nearly all are far off.
OF_ORDER = 0.25

# Passes of the reweighted fit, which settles in fewer.
PASSES = 10

# Searches, each among what the one before has left. Few studies need a third.
SEARCHES = 5

# Reasons for which landings are left out; each is also the name of a message.
MARKERS = "markers_apart"
FAR_STATE = "state_far_off"
CONTACTS = "contacts_far_off"
OUTCOME = "outcome_far_off"


def too_far(distances: FloatArray) -> float:
    """Return the distance beyond which no landing of a sound study is expected.

    The logarithms of the distances are taken as normally distributed above their
    median, as wide as the quantile `UPPER` tells. Student's t with three degrees of
    freedom has less beyond.
    """
    median, upper = np.quantile(distances, [0.5, UPPER])
    if not median > 0.0:
        return np.inf
    normal = NormalDist()
    width = np.log(upper / median) / normal.inv_cdf(UPPER)
    reach = normal.inv_cdf(1.0 - EXPECTED_BEYOND / len(distances))
    return float(GROSS * median * np.exp(reach * width))


def _beyond(distances: FloatArray) -> BoolArray:
    return np.asarray(distances > too_far(distances))


def markers_apart(states: FloatArray) -> BoolArray:
    """Return in which states the markers are not those of the one rigid body.

    Their distances, or the speeds at which these change, are then too far from the
    usual ones, as if two markers were swapped. What a rigid body without noise misses
    by rounding is no mistake.

    Parameters
    ----------
    states
        (n, 6B) positions and velocities of markers.
    """
    positions, velocities = split_states(states)
    lengths = []
    speeds = []
    lengthened = []
    lengthening = []
    for i, j in combinations(range(positions.shape[1]), 2):
        apart = positions[:, i] - positions[:, j]
        drawing_apart = velocities[:, i] - velocities[:, j]
        distance = np.linalg.norm(apart, axis=1)
        moving = np.sum(apart * drawing_apart, axis=1)
        lengths.append(np.median(distance))
        speeds.append(np.linalg.norm(drawing_apart, axis=1))
        lengthened.append(distance - np.median(distance))
        lengthening.append(moving / np.median(distance))
    size = np.linalg.norm(lengths)
    speed = np.median(np.linalg.norm(speeds, axis=0))
    changed = np.linalg.norm(lengthened, axis=0)
    changing = np.linalg.norm(lengthening, axis=0)
    of_positions = _beyond(changed) & (changed > FLAT * size)
    of_velocities = _beyond(changing) & (changing > FLAT * speed)
    return np.asarray(of_positions | of_velocities)


def gross(landings: SectionLandings) -> Mapping[str, BoolArray]:
    """Return which of the n landings are gross errors, by reason."""
    far_states = _far_states(landings.inputs[:, :STATE])
    late = np.linalg.norm(landings.missed, axis=1)
    is_late = _beyond(late) & (late > LEAST_LATE)

    # A far state would bend the map towards its own outcome.
    near = np.flatnonzero(~far_states)
    rough, n_steps = _rough_map(landings)
    missed = misses(rough[near], landings.outputs[near], n_steps)
    far_outcomes = np.zeros(len(late), dtype=bool)
    far_outcomes[near] = _beyond(missed)
    far_outcomes &= ~_of_orders_that_are_far(landings, far_outcomes)
    return {FAR_STATE: far_states, CONTACTS: is_late, OUTCOME: far_outcomes}


def _far_states(states: FloatArray) -> BoolArray:
    """Return which states (n, 8) are far from all others, in any coordinate, (n,).

    How the states spread is told by the quantile `UPPER`, not by the median: where most
    landings are drops from one height and the rest are rebounds, the drops alone have
    the median. The rebounds are a kind of landings, no errors.
    """
    from_median = np.abs(states - np.median(states, axis=0))
    is_far = from_median > FAR_OFF * np.quantile(from_median, UPPER, axis=0)
    return np.asarray(is_far.any(axis=1))


def _of_orders_that_are_far(
    landings: SectionLandings, far_outcomes: BoolArray
) -> BoolArray:
    """Return which landings are of contact orders whose outcomes are far off, (n,)."""
    order = np.argsort(landings.expected, axis=1, kind="stable")
    _, of_landing, counts = np.unique(
        order, axis=0, return_inverse=True, return_counts=True
    )
    of_landing = of_landing.ravel()
    n_far = np.bincount(of_landing[far_outcomes], minlength=len(counts))
    are_far = (n_far > OF_ORDER * counts) & (counts >= LEAST_CLASS)
    return np.asarray(are_far[of_landing])


def _rough_map(landings: SectionLandings) -> tuple[FloatArray, int]:
    """Return the terms of a map of low order, (n, terms), and how many are steps.

    The steps are the last terms.
    """
    instants = landings.expected
    n_landings, n_feet = instants.shape
    scaled = _scaled(landings.inputs)
    pairs = list(combinations(range(n_feet), 2))
    steps = averaged.steps(instants, landings.unforetold.total, pairs)
    session = landings.session
    rough = np.column_stack(
        [
            np.ones(n_landings),
            scaled,
            session.drift(),
            session.levels(),
            kinks(instants),
            monomials(whitened(instants)[:, :WAYS], (3,)),
        ]
    )
    squares = monomials(scaled[:, : landings.n_bent], (2,))
    n_terms = rough.shape[1] + squares.shape[1] + steps.shape[1]
    if n_landings < LANDINGS_PER_TERM * n_terms:
        squares = monomials(scaled[:, :STATE], (2,))
    return np.column_stack([rough, squares, steps]), steps.shape[1]


def _scaled(columns: FloatArray) -> FloatArray:
    """Return columns of standard deviation one; constant ones stay."""
    sds = columns.std(axis=0)
    sds[sds == 0.0] = 1.0
    return np.asarray(columns / sds)


def misses(design: FloatArray, outcomes: FloatArray, n_steps: int = 0) -> FloatArray:
    """Return how far each outcome is from a fit that the far ones hardly move, (n,).

    If the outcome jumps, a landing near the exchange of two feet may have jumped the
    other way than its state foretells. The distance is therefore that from the nearest
    of the outcomes on either side of each step.

    The fit is an M-estimate of map and scatter together: a landing counts as the
    median distance over its own, at most fully (Huber's weights). Distances are
    Mahalanobis distances of residuals over the root of their slack.

    Parameters
    ----------
    design
        (n, terms) terms of the map.
    outcomes
        (n, q) outcomes.
    n_steps
        How many of the last terms are steps from -1 to 1.
    """
    first_step = design.shape[1] - n_steps
    steps = design[:, first_step:]
    lengths = np.linalg.norm(design, axis=0)
    lengths[lengths == 0.0] = 1.0
    design = design / lengths
    outcomes = _scaled(outcomes)
    weights = np.ones(len(design))
    distances = np.zeros(len(design))
    for _ in range(PASSES):
        roots = np.sqrt(weights)[:, None]
        left, singular, right = np.linalg.svd(roots * design, full_matrices=False)
        kept = singular > FLAT * singular[0]
        basis = left[:, kept]
        along = basis.T @ (roots * outcomes)
        rest = roots * outcomes - basis @ along
        coefficients = (right[kept].T / singular[kept]) @ along
        jumps = (coefficients / lengths[:, None])[first_step:]
        slack = np.maximum(1.0 - np.sum(basis**2, axis=1), LEAST_SLACK)
        residuals = rest / (roots * np.sqrt(slack)[:, None])
        scatter = residuals.T @ (weights[:, None] ** 2 * residuals)
        values, vectors = np.linalg.eigh(scatter)
        if not values[-1] > 0.0:
            return distances
        widths = np.sqrt(np.maximum(values, FLAT * values[-1]))
        whitening = vectors / widths
        distances = np.linalg.norm(residuals @ whitening, axis=1)
        for step, jump in zip(steps.T, jumps, strict=True):
            for side in (-1.0, 1.0):
                there = residuals - (side - step)[:, None] * jump
                distance = np.linalg.norm(there @ whitening, axis=1)
                distances = np.minimum(distances, distance)
        median = np.median(distances)
        weights = median / np.maximum(distances, median)
    return distances


@dataclass(frozen=True)
class Sound:
    """What a search for gross errors leaves.

    Attributes
    ----------
    landings
        The sound landings.
    left_out
        Numbers of the landings left out, by reason.
    """

    landings: SectionLandings
    left_out: dict[str, list[int]]


class UnsoundError(AnalysisError):
    """The landings that a search for gross errors leaves do not suffice.

    Attributes
    ----------
    left_out
        Numbers of the landings left out, by reason.
    """

    left_out: Mapping[str, list[int]] = {}


def sound_landings(
    before: FloatArray,
    after: FloatArray,
    convert: Callable[[IntArray], SectionLandings],
) -> Sound:
    """Leave out gross errors until no more are found.

    Parameters
    ----------
    before, after
        (n, 6B) states of the landings at both sections.
    convert
        Returns the landings of these numbers, as if there were no others.

    Raises
    ------
    UnsoundError
        If `convert` raises an `AnalysisError` for the landings that are left.
    """
    if not len(before):
        return Sound(convert(np.arange(0)), {})
    apart = markers_apart(before) | markers_apart(after)
    left_out = {MARKERS: np.flatnonzero(apart).tolist()}
    sound = np.flatnonzero(~apart)
    landings = _converted(sound, convert, left_out)
    for _ in range(SEARCHES):
        rows = sound[landings.kept]
        wrong: set[int] = set()
        for reason, is_wrong in gross(landings).items():
            new = set(rows[is_wrong].tolist()) - wrong
            left_out[reason] = sorted([*left_out.get(reason, []), *new])
            wrong.update(new)
        if not wrong:
            break
        sound = np.setdiff1d(sound, sorted(wrong))
        landings = _converted(sound, convert, left_out)
    return Sound(landings, _that_occur(left_out))


def _converted(
    sound: IntArray,
    convert: Callable[[IntArray], SectionLandings],
    left_out: Mapping[str, list[int]],
) -> SectionLandings:
    """Return the landings that are left; if they are refused, tell which are not."""
    try:
        return convert(sound)
    except AnalysisError as error:
        refused = UnsoundError(*error.args)
        refused.left_out = _that_occur(left_out)
        raise refused from error


def _that_occur(left_out: Mapping[str, list[int]]) -> dict[str, list[int]]:
    return {why: rows for why, rows in left_out.items() if rows}
