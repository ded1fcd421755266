"""Landings in the dimensionless coordinates of the verdict, with expected contact instants.

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
from hopdata.rigid import body_shape, turned, twists, wrapped

#: Share of the landings, those with the least contact spread, to which the kinks are
#: fitted.
WINDOW = 0.85
#: Schedules with fewer landings are ignored, and so are pairs of feet with fewer in
#: either order.
LEAST_CLASS = 20
#: Number of outputs that are positions; the rest are velocities.
POSITIONS = 5
#: Least share of the contact instants' mean square that the preceding states must
#: predict.
LEAST_FORETOLD = 0.1
#: Below this share the verdict notes that its sizes are too small. Rigid legs have
#: 0.999 (the sample, its control, a hopper of another simulator). With legs that
#: scatter, a jump lost 15 % of its size at 0.994 and half at 0.945, since the instants
#: expected from the state then miss the order in which the feet really touch. With
#: 0.985 the note comes when a jump has lost a fifth.
WELL_FORETOLD = 0.99
#: Parts of the state before a landing -> columns of the inputs.
STATES = {"tilt": slice(0, 2), "velocity": slice(2, 5), "spin": slice(5, 8)}
#: Landings are of two kinds if a split into two parts explains more than this share of
#: a state's variance (it explains 0.64 of a normal and 0.75 of a uniform distribution),
#: and the smaller part has at least this share of the landings.
_APART, _LEAST_PART = 0.8, 0.1
_OUTLYING = 5.0  # robust standard deviations beyond which contact instants are left out
#: Distance from the median, in medians of that distance, beyond what a heavy tail
#: explains.
_FAR_OFF = 30.0
#: Larger non-rigid speeds of markers, as a share of the body's speed, mean mixed-up
#: columns.
_MOST_APART = 0.5
_FLAT = 1e-9  # relative rounding limit
#: Distances in standard deviations of whitened inputs, and shares of the landings:
#: copies are many that are nearer to others than any two of 100,000 landings, or a few
#: that agree to rounding.
_COPIES = ((0.1, 0.01), (1e-5, 0.0))
#: Coordinates whose sd is below this fraction of the median sd count as constant.
_CONSTANT = 1e-3
#: Two feet whose instants vary relative to each other by less, in spreads, touch down
#: as one. For a copied marker it is 0.003, since the fits of two feet differ.
_AS_ONE = 0.01


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
    landings, feet = instants.shape
    known = "touchdowns with known states and contacts", least_landings(feet), landings
    for what, least, found in (("feet", 2, feet), known):
        if found < least:
            raise AnalysisError(f"expected at least {least} {what}, found {found}")
    spread = np.sqrt(np.mean(np.var(instants, axis=1)))
    if not np.ptp(instants, axis=1).any():
        raise AnalysisError("all feet touch at the same instant in every touchdown")
    before, after, shape = _without_units(x, y)
    pre, post = rigid_states(before, shape), rigid_states(after, shape)
    inputs, outputs = _inputs(pre), _outputs(pre, post, shape)
    spreads = inputs.std(axis=0)
    scaled = (inputs - inputs.mean(axis=0)) / spreads.clip(1e-300)
    whitened, widths, _ = np.linalg.svd(scaled, full_matrices=False)
    if (
        spreads.min() < _CONSTANT * np.median(spreads)
        or not widths[-1] > _FLAT * widths[0]
    ):
        raise AnalysisError(
            "the states before the landing do not vary in all their coordinates"
        )
    if copies := _copies(np.sqrt(landings) * whitened):
        told = f"{copies} of {landings} touchdowns are copies of others"
        raise AnalysisError(f"{told}, as of one session that two programs exported")
    errors = None
    if instants_se is not None:
        errors = instants_se / spread
    expected, foretold = expected_contacts(inputs, instants / spread, errors)
    centred_inputs = inputs - inputs.mean(axis=0)
    centred_outputs = outputs - outputs.mean(axis=0)
    return SectionLandings(centred_inputs, centred_outputs, expected, foretold)


def _copies(whitened: FloatArray) -> int:
    """Return the number of landings that repeat others, but for rounding; 0 if it is chance."""
    from scipy.spatial import cKDTree

    nearest = cKDTree(whitened).query(whitened, 2)[0][:, 1]
    for close, share in _COPIES:
        if (count := int((nearest < close).sum())) > share * len(whitened):
            return count // 2
    return 0


def two_kinds(inputs: FloatArray) -> str:
    """Return the part of the state in which landings are of two kinds, or an empty string.

    Examples are hops at two speeds, or drops from two heights. `inputs` (N, 8) have
    mean zero.
    """
    n = len(inputs)
    first = np.arange(round(_LEAST_PART * n), n - round(_LEAST_PART * n) + 1)
    for name, columns in STATES.items():
        ways = np.linalg.svd(inputs[:, columns], full_matrices=False)[
            0
        ]  # sum 0, squared sum 1
        sums = np.cumsum(np.sort(ways, axis=0), axis=0)[first - 1]
        if np.max(np.max(sums**2, axis=1) * n / (first * (n - first))) > _APART:
            return name
    return ""


def far_off(landings: SectionLandings) -> int:
    """Return the number of landings farther from the median than `_FAR_OFF` median distances."""
    all_of_it = np.hstack([landings.inputs, landings.outputs])
    away = np.abs(all_of_it - np.median(all_of_it, axis=0))
    return int(np.sum((away > _FAR_OFF * np.median(away, axis=0)).any(axis=1)))


def feet_as_one(landings: SectionLandings) -> bool:
    """Return whether two feet are always the same time apart, as those of copied markers are."""
    return any(np.std(a - b) < _AS_ONE for a, b in combinations(landings.expected.T, 2))


def least_landings(feet: int) -> int:
    """Return the number of landings needed to fit second-order terms to those in the window."""
    terms = coordinates.number_of_free_terms(8, feet, 2)
    return int(np.ceil(coordinates.LANDINGS_PER_TERM * terms / WINDOW))


def expected_contacts(
    x: FloatArray, instants: FloatArray, errors: FloatArray | None = None
) -> tuple[FloatArray, float]:
    """Return the contact instants (N, feet) expected from the inputs, and how well they are.

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
    fitted, best, least = np.median(t, axis=0), t, np.inf
    scaled = (x - x.mean(axis=0)) / x.std(axis=0)
    for degree in range(
        1, highest + 1
    ):  # few terms first, since wrong instants stand out more
        miss = np.abs(t - fitted).max(axis=1)
        good = miss <= _OUTLYING * 1.4826 * np.median(miss)
        design = np.column_stack(
            [np.ones(len(x)), monomials(scaled, tuple(range(1, degree + 1)))]
        )
        if good.sum() <= design.shape[1]:  # too few landings to identify outliers
            good = np.ones(len(x), dtype=bool)
        basis, root = np.linalg.qr(design[good])
        fitted = design @ np.linalg.solve(root, basis.T @ t[good])
        slack = np.maximum(1.0 - np.sum(basis**2, axis=1), 1e-3)
        error = np.mean(((t - fitted)[good] / slack[:, None]) ** 2)
        if error < least:
            best, least = fitted, error
    varied = np.mean(t[good] ** 2)
    foretold = 1.0 - least / varied if varied > _FLAT else 0.0
    if not foretold >= LEAST_FORETOLD:
        place = (
            "the states before the landing do not predict in which order the feet touch"
        )
        wanted = f"{100 * LEAST_FORETOLD:g} % of the variance of the contact instants"
        raise AnalysisError.at(place, wanted, f"{100 * max(0.0, foretold):.0f} %")
    if errors is not None:
        foretold = _foretold_beside_errors(least, varied, errors)
    return np.asarray(best - best.mean(axis=1, keepdims=True)), float(foretold)


def _foretold_beside_errors(missed: float, varied: float, errors: FloatArray) -> float:
    """Return the share foretold of what the instants' own errors leave, from 0 to 1.

    Independent errors of F feet have 1 - 1 / F of their mean square about the mean over
    the feet.
    """
    known = float(np.mean(errors**2)) * (1.0 - 1.0 / errors.shape[1])
    if not varied > known:
        return 0.0
    return float(np.clip(1.0 - (missed - known) / (varied - known), 0.0, 1.0))


def contact_orders(instants: FloatArray, least: int) -> tuple[IntArray, IntArray]:
    """Return the contact orders (S, feet) of at least `least` landings, and their counts (S,)."""
    order = np.argsort(instants, axis=1, kind="stable")
    orders, counts = np.unique(order, axis=0, return_counts=True)
    return orders[counts >= least], counts[counts >= least]


def halves(power: FloatArray) -> FloatArray:
    """Return weights (q,) by which positions and velocities of this power count one half each."""
    parts = power[:POSITIONS].sum(), power[POSITIONS:].sum()
    return np.repeat(0.5 / np.array(parts), [POSITIONS, len(power) - POSITIONS])


def marker_root(shape: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) from turns about the axes to rms displacements of the markers."""
    mean_square = np.mean(np.sum(shape**2, axis=1)) * np.eye(3) - shape.T @ shape / len(
        shape
    )
    return np.asarray(np.linalg.cholesky(mean_square))


def _without_units(
    x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return both states (n, 6B) in units of body size and speed, and the upright shape (B, 3)."""
    shape = body_shape(split_states(x)[0])
    pre = rigid_states(x, shape)
    up = pre.rotation[:, 2].mean(axis=0)
    across = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    axes = np.stack([across, np.cross(up, across), up])
    shape = shape @ (axes / np.linalg.norm(axes, axis=1, keepdims=True)).T
    length, speed = np.sqrt(np.mean(shape**2)), np.sqrt(np.mean(pre.velocity**2))
    if not speed > 0:
        raise AnalysisError("the body does not move at the pre section")
    if (apart := np.sqrt(marker_noise(x, shape).velocity) / speed) > _MOST_APART:
        told = "positions, then velocities, of the markers of a rigid body"
        raise AnalysisError.at(
            "states", told, f"markers moving apart at {apart:.2g} of its speed"
        )
    units = np.repeat([length, speed], x.shape[1] // 2)
    return x / units, y / units, shape / length


def _inputs(pre: RigidStates) -> FloatArray:
    heading = twists(pre.rotation)
    return np.column_stack(
        [_tilt(pre.rotation, heading), turned(pre.velocity, heading), pre.spin]
    )


def _outputs(pre: RigidStates, post: RigidStates, shape: FloatArray) -> FloatArray:
    heading, later = twists(pre.rotation), twists(post.rotation)
    root = marker_root(shape)
    turns = np.column_stack([_tilt(post.rotation, later), wrapped(later - heading)])
    step = turned(post.centre - pre.centre, heading)[:, :2]
    return np.column_stack(
        [step, turns @ root, turned(post.velocity, heading), post.spin @ root]
    )


def _tilt(rotation: FloatArray, heading: FloatArray) -> FloatArray:
    """Return the tilt (n, 2) about the two level axes of the heading frame, rad."""
    up = turned(rotation[:, :, 2], heading)
    return np.column_stack([-up[:, 1], up[:, 0]])
