"""Landings in the dimensionless coordinates of the verdict, and expected contacts.

Lengths are in units of the markers' rms distance from their mean, speeds in units of
the body's speed at the pre section, and contact instants in units of their spread. The
axes are those of the body with its mean attitude upright. The heading of a body is its
twist about the vertical; its tilt is the direction of the vertical in the body. Another
frame for the states therefore turns all coordinates together and linearly, and no
result depends on it.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.maps import coordinates
from hopdata.maps.coordinates import RigidStates, monomials, rigid_states, split_states
from hopdata.maps.corrected.marker_noise import marker_noise
from hopdata.messages import Message
from hopdata.rigid import body_shape, turned, twists, wrapped

#: Share of the landings, those with the least contact spread, to which the kinks are
#: fitted.
#: Unit: 1. Origin: chosen: the smooth terms that are not fitted grow with the spread
#: (decisions.md, "A tenth of the map is allowed for").
WINDOW = 0.85

#: Schedules with fewer landings are ignored, and so are pairs of feet with fewer in
#: either order.
#: Unit: landings. Origin: chosen.
LEAST_CLASS = 20

# Number of outputs that are positions; the rest are velocities.
POSITIONS = 5

#: Least share of the contact instants' mean square that the preceding states must
#: predict.
#: Unit: 1. Origin: chosen.
LEAST_FORETOLD = 0.1

#: Below this share the verdict notes that its sizes are too small.
#: Unit: 1. Origin: measured: rigid legs have 0.999 (the sample, its control, a hopper
#: of another simulator). With legs that scatter, a jump lost 15 % of its size at 0.994
#: and half at 0.945, since the instants expected from the state then miss the order in
#: which the feet really touch. With 0.985 the note comes when a jump has lost a fifth.
WELL_FORETOLD = 0.99

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

#: Contact instants farther from the fit than this are left out.
#: Unit: robust standard deviations. Origin: chosen.
OUTLYING = 5.0

#: Standard deviations of a normal distribution in one median absolute deviation.
#: Unit: 1. Origin: derived: the inverse of its quartile, 0.6745.
ROBUST_SD = 1.4826

#: A landing is far from all others beyond this distance from the median, which no heavy
#: tail explains.
#: Unit: median distances. Origin: chosen.
FAR_OFF = 30.0

#: Larger non-rigid speeds of markers mean mixed-up columns.
#: Unit: share of the body's speed. Origin: chosen.
MOST_APART = 0.5

#: Singular values and mean squares at or below this share are rounding.
#: Unit: 1. Origin: rounding.
FLAT = 1e-9

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

#: Least slack of a landing (one minus its leverage) by which a leave-one-out error is
#: divided.
#: Unit: 1. Origin: chosen.
LEAST_SLACK = 1e-3


@dataclass(frozen=True)
class SectionLandings:
    """The n landings of a study.

    Attributes
    ----------
    inputs
        (n, 8) tilt, velocity and spin at the pre section.
    outputs
        (n, 11) outcome: step, tilt and turn as rms displacements of the markers, then
        velocity and spin at the post section as rms velocities of the markers.
    expected
        (n, feet) contact instants expected from the inputs, relative to the mean over
        the feet.
    foretold
        Share of the contact instants' mean square that the inputs foretell, beside what
        the standard errors of the instants explain.
    """

    inputs: FloatArray
    outputs: FloatArray
    expected: FloatArray
    foretold: float


def section_landings(
    x: FloatArray,
    y: FloatArray,
    instants: FloatArray,
    instants_se: FloatArray | None = None,
) -> SectionLandings:
    """Convert pairs to dimensionless coordinates.

    The contact instants are those expected from the inputs. Measured instants share
    errors with the states and would make equal maps seem different.

    Parameters
    ----------
    x, y
        (n, 6B) states at the two sections: positions and velocities of markers, in any
        frame that moves with the body in the plane and is the same for both.
    instants
        (n, feet) contact instants.
    instants_se
        (n, feet) their standard errors; none if they are not known.

    Raises
    ------
    AnalysisError
        If there are too few landings or markers, if landings are repeated, or if the
        states or instants do not vary.
    """
    n_landings, n_feet = instants.shape
    _require("too_few_feet", least=2, found=n_feet)
    _require("too_few_landings", least=least_landings(n_feet), found=n_landings)
    if not np.ptp(instants, axis=1).any():
        raise AnalysisError(Message("maps.same_instants"))

    before, after, shape = _without_units(x, y)
    pre = rigid_states(before, shape)
    post = rigid_states(after, shape)
    inputs = _inputs(pre)
    outputs = _outputs(pre, post, shape)
    whitened = _whitened_states(inputs)
    copies = _copies(whitened)
    if copies:
        values = {"copies": copies, "landings": n_landings}
        raise AnalysisError(Message("maps.copies", values))

    contact_spread = np.sqrt(np.mean(np.var(instants, axis=1)))
    errors = None
    if instants_se is not None:
        errors = instants_se / contact_spread
    expected, foretold = expected_contacts(inputs, instants / contact_spread, errors)
    return SectionLandings(
        inputs=inputs - inputs.mean(axis=0),
        outputs=outputs - outputs.mean(axis=0),
        expected=expected,
        foretold=foretold,
    )


def _require(name: str, *, least: int, found: int) -> None:
    if found < least:
        raise AnalysisError(Message(f"maps.{name}", {"least": least, "found": found}))


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


def far_off(landings: SectionLandings) -> int:
    """Return how many landings are beyond `FAR_OFF` median distances."""
    values = np.hstack([landings.inputs, landings.outputs])
    distances = np.abs(values - np.median(values, axis=0))
    is_far = distances > FAR_OFF * np.median(distances, axis=0)
    return int(np.sum(is_far.any(axis=1)))


def feet_as_one(landings: SectionLandings) -> bool:
    """Return whether two feet are always the same time apart, as copied markers are."""
    pairs = combinations(landings.expected.T, 2)
    return any(np.std(a - b) < AS_ONE for a, b in pairs)


def least_landings(feet: int) -> int:
    """Return the number of landings of which the window affords second-order terms."""
    terms = coordinates.number_of_free_terms(8, feet, 2)
    return int(np.ceil(coordinates.LANDINGS_PER_TERM * terms / WINDOW))


def expected_contacts(
    x: FloatArray, instants: FloatArray, errors: FloatArray | None = None
) -> tuple[FloatArray, float]:
    """Return contact instants (N, feet) expected from the inputs, and how well.

    The instants are relative to their mean over the feet. The second value is the share
    of their mean square that the inputs foretell by leave-one-out. What the standard
    errors of the measured instants explain, `errors` (N, feet), belongs to neither.

    They are a polynomial of the inputs fitted to the measured instants. Errors of the
    measured instants, which the outputs may share, then move no landing across a kink.
    The degree is the one with the least leave-one-out error. Landings with outlying
    instants are left out of the fit.

    Raises
    ------
    AnalysisError
        If the inputs predict less than `LEAST_FORETOLD` of the instants' mean square.
    """
    t = instants - instants.mean(axis=1, keepdims=True)
    highest = max(1, coordinates.affordable_degree(len(x), x.shape[1], t.shape[1]))
    scaled = (x - x.mean(axis=0)) / x.std(axis=0)

    fitted = np.median(t, axis=0)
    best = t
    least = np.inf
    # Few terms first, since wrong instants then stand out more.
    for degree in range(1, highest + 1):
        degrees = tuple(range(1, degree + 1))
        design = np.column_stack([np.ones(len(x)), monomials(scaled, degrees)])
        miss = np.abs(t - fitted).max(axis=1)
        good = miss <= OUTLYING * ROBUST_SD * np.median(miss)
        if good.sum() <= design.shape[1]:
            # Too few landings to identify outliers.
            good = np.ones(len(x), dtype=bool)
        basis, root = np.linalg.qr(design[good])
        fitted = design @ np.linalg.solve(root, basis.T @ t[good])
        slack = np.maximum(1.0 - np.sum(basis**2, axis=1), LEAST_SLACK)
        error = np.mean(((t - fitted)[good] / slack[:, None]) ** 2)
        if error < least:
            best = fitted
            least = error

    varied = np.mean(t[good] ** 2)
    foretold = 0.0
    if varied > FLAT:
        foretold = 1.0 - least / varied
    if not foretold >= LEAST_FORETOLD:
        values = {
            "wanted": f"{100 * LEAST_FORETOLD:g} %",
            "found": f"{100 * max(0.0, foretold):.0f} %",
        }
        raise AnalysisError(Message("maps.orders_not_foretold", values))
    if errors is not None:
        foretold = _foretold_beside_errors(least, varied, errors)
    return np.asarray(best - best.mean(axis=1, keepdims=True)), float(foretold)


def _foretold_beside_errors(missed: float, varied: float, errors: FloatArray) -> float:
    """Return the share foretold of what the instants' own errors leave, from 0 to 1.

    Independent errors of F feet have 1 - 1 / F of their mean square about the mean over
    the feet.
    """
    by_errors = float(np.mean(errors**2)) * (1.0 - 1.0 / errors.shape[1])
    if not varied > by_errors:
        return 0.0
    share_missed = (missed - by_errors) / (varied - by_errors)
    return float(np.clip(1.0 - share_missed, 0.0, 1.0))


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


def marker_root(shape: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) from turns about the axes to rms motions of markers."""
    squared_size = np.mean(np.sum(shape**2, axis=1)) * np.eye(3)
    mean_square = squared_size - shape.T @ shape / len(shape)
    return np.asarray(np.linalg.cholesky(mean_square))


def _without_units(
    x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return both states in units of size and speed, and the upright shape (B, 3)."""
    shape = body_shape(split_states(x)[0])
    pre = rigid_states(x, shape)
    upright = shape @ _upright_axes(pre).T
    speed = np.sqrt(np.mean(pre.velocity**2))
    if not speed > 0:
        raise AnalysisError(Message("maps.body_at_rest"))
    apart = np.sqrt(marker_noise(x, upright).velocity) / speed
    if apart > MOST_APART:
        raise AnalysisError(
            Message("maps.markers_move_apart", {"share": f"{apart:.2g}"})
        )
    length = np.sqrt(np.mean(upright**2))
    units = np.repeat([length, speed], x.shape[1] // 2)
    return x / units, y / units, upright / length


def _upright_axes(pre: RigidStates) -> FloatArray:
    """Return axes (3, 3) of the body, of which the third is up in its mean attitude."""
    up = pre.rotation[:, 2].mean(axis=0)
    least_upright = np.eye(3)[np.argmin(np.abs(up))]
    across = np.cross(least_upright, up)
    axes = np.stack([across, np.cross(up, across), up])
    return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True))


def _inputs(pre: RigidStates) -> FloatArray:
    heading = twists(pre.rotation)
    tilt = _tilt(pre.rotation, heading)
    velocity = turned(pre.velocity, heading)
    return np.column_stack([tilt, velocity, pre.spin])


def _outputs(pre: RigidStates, post: RigidStates, shape: FloatArray) -> FloatArray:
    heading = twists(pre.rotation)
    heading_after = twists(post.rotation)
    step = turned(post.centre - pre.centre, heading)[:, :2]
    tilt = _tilt(post.rotation, heading_after)
    turns = np.column_stack([tilt, wrapped(heading_after - heading)])
    velocity = turned(post.velocity, heading)
    root = marker_root(shape)  # makes motions of the markers of turns and spins
    return np.column_stack([step, turns @ root, velocity, post.spin @ root])


def _tilt(rotation: FloatArray, heading: FloatArray) -> FloatArray:
    """Return the tilt (n, 2) about the two level axes of the heading frame, rad."""
    up = turned(rotation[:, :, 2], heading)
    return np.column_stack([-up[:, 1], up[:, 0]])
