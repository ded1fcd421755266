"""Landings as the verdict sees them: inputs, outcomes, and expected contacts.

The inputs are the state of the body at the pre section (`coordinates`) and, where legs
have a posture of their own, the feet about it. Contact instants are in units of their
spread.
"""

from dataclasses import dataclass
from enum import Enum
from itertools import combinations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.maps import coordinates
from hopdata.maps.coordinates import rigid_states
from hopdata.maps.verdict.coordinates import (
    Dimensionless,
    feet_about_body,
    outcomes,
    state_inputs,
    without_units,
)
from hopdata.maps.verdict.expected import (
    Expected,
    Unforetold,
    expected_contacts,
    unforetold,
)
from hopdata.maps.verdict.grazing import grazing
from hopdata.maps.verdict.linear import FLAT
from hopdata.maps.verdict.noise import believable, state_noise
from hopdata.maps.verdict.session import Session
from hopdata.messages import Message

#: Share of the landings, those with the least contact spread, to which the kinks are
#: fitted.
#: Unit: 1. Origin: chosen: the smooth terms that are not fitted grow with the spread
#: (docs/decisions.md, "The verdict looks for kinks").
WINDOW = 0.85

#: Schedules with fewer landings are ignored, and so are pairs of feet with fewer in
#: either order.
#: Unit: landings. Origin: chosen.
LEAST_CLASS = 20

#: Below this share foretold the verdict notes that it averages over the rest.
#: Unit: 1. Origin: measured: rigid legs have 0.999 (the sample, its control, a hopper
#: of another simulator). At 0.98 half of a jump is rounded away, which averaging brings
#: back at the price of a wider interval.
WELL_FORETOLD = 0.98

#: The feet are inputs if they foretell at least this share more of the contact
#: instants' mean square than the state alone.
#: Unit: 1. Origin: measured: of legs that scatter by 0.5 mm the state foretells 0.9996,
#: by 2 mm 0.98. With less to gain, their terms cost more than they bring.
WORTH = 0.01

#: The feet are inputs only if they are all seen in at least this share of the landings;
#: the other landings are then left out.
#: Unit: 1. Origin: chosen.
LEAST_SEEN = 0.8

# Number of inputs that are the body's state.
STATE = 8

# Number of outputs that are positions; the rest are velocities.
POSITIONS = 5

# Parts of the state before a landing -> columns of the inputs.
STATES = {"tilt": slice(0, 2), "velocity": slice(2, 5), "spin": slice(5, 8)}

#: Landings are of two kinds if a split into two parts explains more than this share of
#: a state's variance.
#: Unit: 1. Origin: derived: a split explains 0.64 of a normal and 0.75 of a uniform
#: distribution.
APART = 0.8

#: Least share of the landings in the smaller of two kinds.
#: Unit: 1. Origin: chosen.
LEAST_PART = 0.1

#: Two landings are suspected to be copies if they are nearer to each other than this.
#: Unit: standard deviations of whitened inputs. Origin: chosen: nearer than any two of
#: 100,000 landings.
NEAR_COPY = 0.1

#: Such landings are copies if they are more than this share of all.
#: Unit: 1. Origin: chosen.
NEAR_COPIES_SHARE = 0.01

#: Two landings that are nearer than this agree to rounding, and are copies in any
#: number.
#: Unit: standard deviations of whitened inputs. Origin: rounding.
EXACT_COPY = 1e-5

#: Coordinates whose sd is below this fraction of the median sd count as constant.
#: Unit: 1. Origin: chosen.
CONSTANT = 1e-3

#: Two feet whose instants vary relative to each other by less touch down as one.
#: Unit: contact spreads. Origin: measured: it is 0.003 for a copied marker, since the
#: fits of two feet differ.
AS_ONE = 0.01


class Posture(Enum):
    """What the verdict knows of the feet before the landing."""

    USED = "inputs of the map"
    NOT_NEEDED = "foretold by the state of the body"
    NOT_SEEN = "not seen before contact"


@dataclass(frozen=True)
class SectionLandings:
    """The n landings of a study.

    Attributes
    ----------
    inputs
        (n, p) tilt, velocity and spin at the pre section; if the feet are inputs, also
        their heights above the body's centre, then their other two coordinates.
    outputs
        (n, 11) outcome: step, tilt and turn as rms displacements of the markers, then
        velocity and spin at the post section as rms velocities of the markers.
    expected
        (n, feet) contact instants expected from the inputs, relative to the mean over
        the feet.
    missed
        (n, feet) measured less expected contact instants, likewise.
    foretold
        Share of the contact instants' mean square that the inputs foretell, beside what
        the standard errors of the instants explain.
    unforetold
        Covariances of the true instants about those expected.
    noise
        (p, p) covariance of the errors of the inputs.
    session
        When and where the landings were recorded.
    n_bent
        Number of leading inputs whose squares and products count among the smooth
        terms; the others enter linearly.
    posture
        What is known of the feet before the landing.
    kept
        (N,) which of the N landings given these n are.
    bent
        Share of the map that the square root leaves with which a body that hardly falls
        passes the post section: see `grazing`.
    """

    inputs: FloatArray
    outputs: FloatArray
    expected: FloatArray
    missed: FloatArray
    foretold: float
    unforetold: Unforetold
    noise: FloatArray
    session: Session
    n_bent: int
    posture: Posture
    kept: BoolArray
    bent: float = 0.0


@dataclass(frozen=True)
class Contacts:
    """Contact instants and feet of n landings, as they were measured.

    Attributes
    ----------
    instants, instants_se
        (n, feet) contact instants and their standard errors; the latter None if they
        are not known.
    feet, feet_se
        (n, feet, 3) positions of the feet at the pre section, in the frame of the
        states, and their standard errors; NaN where a foot is not seen. None if they
        are not known.
    """

    instants: FloatArray
    instants_se: FloatArray | None = None
    feet: FloatArray | None = None
    feet_se: FloatArray | None = None


def section_landings(
    x: FloatArray, y: FloatArray, contacts: Contacts, session: Session, aside: int = 0
) -> SectionLandings:
    """Convert pairs to dimensionless coordinates.

    Parameters
    ----------
    x, y
        (n, 6B) states at the two sections: positions and velocities of markers, in any
        frame that moves with the body in the plane and is the same for both.
    contacts
        Contact instants, and the feet before them.
    session
        When and where the landings were recorded.
    aside
        Number of landings that are left out as far off, which the error on too few
        tells.

    Raises
    ------
    AnalysisError
        If there are too few landings or markers, if landings are repeated, or if the
        states or instants do not vary.
    """
    n_landings, n_feet = contacts.instants.shape
    if n_feet < 2:
        values = {"least": 2, "found": n_feet}
        raise AnalysisError(Message("maps.too_few_feet", values))
    if n_landings < least_landings(n_feet):
        raise AnalysisError(_too_few(n_landings, n_feet, aside))
    if not np.ptp(contacts.instants, axis=1).any():
        raise AnalysisError(Message("maps.same_instants"))

    dimensionless = without_units(x, y)
    pre = rigid_states(dimensionless.before, dimensionless.shape)
    post = rigid_states(dimensionless.after, dimensionless.shape)
    states = state_inputs(pre)
    copies = _copies(_whitened_states(states))
    if copies:
        values = {"copies": copies, "landings": n_landings}
        raise AnalysisError(Message("maps.copies", values))

    noise = state_noise(dimensionless.before, dimensionless.shape, dimensionless.noise)
    spread = contact_spread(contacts.instants)
    instants = contacts.instants / spread
    errors = None
    if contacts.instants_se is not None:
        errors = contacts.instants_se / spread
    feet = _seen_feet(dimensionless, contacts)
    known = _known_inputs(states, noise, instants, feet)

    kept = known.kept
    inputs = known.inputs - known.inputs.mean(axis=0)
    noise = believable(known.noise, np.cov(inputs.T))
    if errors is not None:
        errors = errors[kept]
    outputs = outcomes(pre, post, dimensionless.shape)[kept]
    relative = instants - instants.mean(axis=1, keepdims=True)
    return SectionLandings(
        inputs=inputs,
        outputs=outputs - outputs.mean(axis=0),
        expected=known.expected.instants,
        missed=relative[kept] - known.expected.instants,
        foretold=known.expected.foretold(errors),
        unforetold=unforetold(inputs, noise, known.expected, errors),
        noise=noise,
        session=session.rows(np.flatnonzero(kept)),
        n_bent=known.n_bent,
        posture=known.posture,
        kept=kept,
        bent=grazing(dimensionless.after[kept]).bent,
    )


def contact_spread(instants: FloatArray) -> float:
    """Return the spread of contacts (n, feet): the sd of those of a landing, rms."""
    return float(np.sqrt(np.mean(np.var(instants, axis=1))))


@dataclass(frozen=True)
class _SeenFeet:
    """Feet (n, feet, 3) about the body, and their errors, in its size; who is seen."""

    about: FloatArray
    errors: FloatArray
    seen: BoolArray


def _seen_feet(states: Dimensionless, contacts: Contacts) -> _SeenFeet | None:
    """Return the feet about the body; None if they are hidden in too many landings."""
    if contacts.feet is None:
        return None
    feet = contacts.feet / states.length
    seen = np.asarray(np.isfinite(feet).all(axis=(1, 2)))
    if not seen.mean() >= LEAST_SEEN:
        return None
    errors = np.zeros_like(feet)
    if contacts.feet_se is not None:
        errors = np.nan_to_num(contacts.feet_se / states.length)
    about = feet_about_body(rigid_states(states.before, states.shape), feet)
    return _SeenFeet(about, errors, seen)


@dataclass(frozen=True)
class _KnownInputs:
    """Inputs (n, p), the instants that they foretell, and what they are made of."""

    inputs: FloatArray
    noise: FloatArray
    expected: Expected
    n_bent: int
    posture: Posture
    kept: BoolArray


def _known_inputs(
    states: FloatArray,
    noise: FloatArray,
    instants: FloatArray,
    feet: _SeenFeet | None,
) -> _KnownInputs:
    """Return the state, and the feet if they foretell what the state does not."""
    every = np.ones(len(states), dtype=bool)
    if feet is None:
        expected = expected_contacts(states, instants)
        return _KnownInputs(states, noise, expected, STATE, Posture.NOT_SEEN, every)

    seen = feet.seen
    with_heights = np.column_stack([states, feet.about[:, :, 2]])[seen]
    alone = _missed_by_state(states[seen], instants[seen])
    expected = expected_contacts(with_heights, instants[seen])
    gained = (alone - expected.left) / expected.square
    if not gained > WORTH:
        expected = expected_contacts(states, instants)
        return _KnownInputs(states, noise, expected, STATE, Posture.NOT_NEEDED, every)

    n_feet = instants.shape[1]
    sideways = feet.about[:, :, :2].reshape(len(states), -1)[seen]
    of_heights = np.mean(feet.errors[seen][:, :, 2] ** 2, axis=0)
    of_sideways = np.mean(feet.errors[seen][:, :, :2] ** 2, axis=0).ravel()
    n_bent = STATE + n_feet
    errors = np.zeros((n_bent + 2 * n_feet, n_bent + 2 * n_feet))
    errors[:STATE, :STATE] = noise
    errors[STATE:, STATE:] = np.diag(np.concatenate([of_heights, of_sideways]))
    inputs = np.column_stack([with_heights, sideways])
    return _KnownInputs(inputs, errors, expected, n_bent, Posture.USED, seen)


def _missed_by_state(states: FloatArray, instants: FloatArray) -> float:
    """Return the mean square of the instants that the state does not foretell."""
    try:
        return expected_contacts(states, instants).left
    except AnalysisError:
        # The state foretells nothing: all is left to the feet.
        relative = instants - instants.mean(axis=1, keepdims=True)
        return float(np.mean(relative**2))


def _too_few(n_landings: int, n_feet: int, aside: int) -> Message:
    """Return what is said of too few landings, of which some may be left out."""
    of_aside: Message | str = ""
    if aside:
        of_aside = Message("maps.far_off_aside", {"aside": aside})
    values = {
        "least": least_landings(n_feet),
        "found": n_landings,
        "aside": of_aside,
    }
    return Message("maps.too_few_landings", values)


def _whitened_states(inputs: FloatArray) -> FloatArray:
    """Return combinations of the inputs (n, 8) that are uncorrelated, of sd one.

    Raises
    ------
    AnalysisError
        If the inputs do not vary in some direction.
    """
    sds = inputs.std(axis=0)
    scaled = (inputs - inputs.mean(axis=0)) / sds.clip(1e-300)
    left, singular, _ = np.linalg.svd(scaled, full_matrices=False)
    one_is_constant = sds.min() < CONSTANT * np.median(sds)
    all_vary = singular[-1] > FLAT * singular[0]
    if one_is_constant or not all_vary:
        raise AnalysisError(Message("maps.states_do_not_vary"))
    return np.asarray(np.sqrt(len(inputs)) * left)


def _copies(whitened: FloatArray) -> int:
    """Return how many landings repeat others; 0 if a few are alike by chance."""
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(whitened).query(whitened, 2)
    nearest = distances[:, 1]  # the first is the landing itself
    near = int((nearest < NEAR_COPY).sum())
    if near > NEAR_COPIES_SHARE * len(whitened):
        return near // 2
    exact = int((nearest < EXACT_COPY).sum())
    return exact // 2


def two_kinds(inputs: FloatArray) -> str:
    """Return the part of the state in which landings are of two kinds; empty if none.

    Examples are hops at two speeds, or drops from two heights. `inputs` (N, 8) have
    mean zero.
    """
    n = len(inputs)
    least = round(LEAST_PART * n)
    first_part = np.arange(least, n - least + 1)  # sizes of the part of lower values
    for name, columns in STATES.items():
        # Components of sum zero and squared sum one.
        components, _, _ = np.linalg.svd(inputs[:, columns], full_matrices=False)
        sums = np.cumsum(np.sort(components, axis=0), axis=0)[first_part - 1]
        between = np.max(sums**2, axis=1) * n / (first_part * (n - first_part))
        if np.max(between) > APART:
            return name
    return ""


def feet_as_one(landings: SectionLandings) -> bool:
    """Return whether two feet are always the same time apart, as copied markers are."""
    pairs = combinations(landings.expected.T, 2)
    return any(np.std(a - b) < AS_ONE for a, b in pairs)


def least_landings(feet: int) -> int:
    """Return the number of landings of which the window affords second-order terms."""
    return int(np.ceil(coordinates.LANDINGS_PER_TERM * landings_for_terms(feet)))


def landings_for_terms(feet: int) -> float:
    """Return the number of landings whose window has one for each fitted term.

    These are the terms up to the second order, kinks and steps. As many landings of a
    study say nothing of errors.
    """
    return coordinates.number_of_free_terms(STATE, feet, 2) / WINDOW


def contact_orders(instants: FloatArray, least: int) -> tuple[IntArray, IntArray]:
    """Return contact orders (S, feet) of `least` landings or more, and counts (S,)."""
    order = np.argsort(instants, axis=1, kind="stable")
    orders, counts = np.unique(order, axis=0, return_counts=True)
    is_common = counts >= least
    return orders[is_common], counts[is_common]


def halves(power: FloatArray) -> FloatArray:
    """Return weights (q,) by which positions and velocities count one half each.

    `power` (q,) has the mean squares of the outputs.
    """
    of_positions = power[:POSITIONS].sum()
    of_velocities = power[POSITIONS:].sum()
    weights = 0.5 / np.array([of_positions, of_velocities])
    return np.repeat(weights, [POSITIONS, len(power) - POSITIONS])
