"""How deep the post section lies: where the state before foretells the one after best.

Several heights hold nearly as many landings. A shallow section follows close on the
last contact: few frames show the body free of contacts, so velocities are less sure. At
a deep one the body nearly stands: it passes at an instant that a small change of the
state shifts by much (it *grazes* the section), and this multiplies the errors of the
states before the landing and bends the map. Which of the two is worse depends on
cameras, legs and gait, so the study's own errors decide.

The measure of both is the *misfit*: what no smooth map of the state before the landing
foretells of the state after it, leave-one-out, as a share of the variation, with
positions and velocities weighing a half each. Contact orders and instants play no part
in it. The section is the shallowest that is as good as the best, up to one standard
error (the rule of Breiman et al. 1984 for nested choices).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray, pd
from hopdata.landings.contacts.descents import LANDED, find_transitions
from hopdata.landings.contacts.tables import contacts_of, floor_instants
from hopdata.landings.states.crossing import SectionStates
from hopdata.landings.states.fits import section_states
from hopdata.landings.states.tracks import LOOK_AT, evenly, joined
from hopdata.recording import Recording
from hopdata.rigid import body_shape, kabsch, turned, twists, wrapped

#: Heights at which states are fitted, from the shallowest to the deepest. Between them
#: the misfit is a parabola, so that the section moves steadily with the data.
#: Unit: heights. Origin: derived: a parabola has three coefficients.
TRIED = 3

#: Fewest landings for each term of the map that foretells.
#: Unit: landings. Origin: chosen.
LANDINGS_PER_TERM = 2

#: Misfit, in usual ones, beyond which a landing teaches the map nothing: five standard
#: deviations.
#: Unit: 1. Origin: chosen.
OUTLYING = 25.0

#: Squares of standard deviations in one squared median absolute deviation.
#: Unit: 1. Origin: derived: the inverse of the squared quartile of a normal, 0.6745.
SQUARED_MAD = 2.198

POSITIONS = 5  # outputs that are positions; the rest are velocities

STATE_ARRAYS = tuple(field.name for field in fields(SectionStates))


@dataclass(frozen=True)
class Depth:
    """The depth chosen.

    Parameters
    ----------
    share : float
        Place of the section, from 0 at the shallowest height that holds nearly as many
        landings as any to 1 at the deepest.
    misfit : tuple of float
        Usual misfit at the shallowest height, half-way and at the deepest, as shares of
        the variation; empty if there were too few landings to tell.
    n_landings : int
        Landings from which it was found.
    """

    share: float
    misfit: tuple[float, ...]
    n_landings: int


def choose_depth(
    recordings: Sequence[Recording],
    landings: Sequence[pd.DataFrame],
    *,
    pre_m: float,
    shallow_m: float,
    deep_m: float,
    states: Mapping[str, Any] | None = None,
) -> Depth:
    """Choose the depth of the post section between two heights.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled, with feet and body.
    landings : sequence of DataFrame
        Landings of each, from `hopdata.landings.contacts.find.find_landings`.
    pre_m : float
        Height of the pre section, m.
    shallow_m, deep_m : float
        The shallowest and the deepest height of the post section, m.
    states : mapping, optional
        Options of `hopdata.landings.states.fits.section_states` with which the study
        fits its states: the errors that decide are those of these fits.
    """
    if not pre_m > shallow_m > deep_m:
        return Depth(0.0, (), 0)
    tried_m = np.linspace(shallow_m, deep_m, TRIED)
    passed = []
    for recording, table in zip(recordings, landings, strict=True):
        passed.append(_passages(recording, table, pre_m, tried_m))
    n_passed = sum(len(one.before_s) for one in passed)
    parts = []
    for recording, of_recording in zip(recordings, passed, strict=True):
        n_landings = len(of_recording.before_s)
        n_own = -(-LOOK_AT * n_landings // max(n_passed, 1))
        few = of_recording.some(evenly(n_landings, n_own))
        if len(few.before_s) > 0:
            parts.append(_states(recording, few, pre_m, tried_m, states or {}))
    if not parts:
        return Depth(0.0, (), 0)
    before = joined([part[0] for part in parts], STATE_ARRAYS)
    after = []
    for k in range(TRIED):
        after.append(joined([part[1 + k] for part in parts], STATE_ARRAYS))
    known = _known(before)
    for one in after:
        known &= _known(one)
    misfits = landing_misfits(_rows(before, known), [_rows(a, known) for a in after])
    if misfits is None:
        return Depth(0.0, (), int(known.sum()))
    logarithm = np.log(misfits)
    usual = tuple(np.exp(logarithm.mean(axis=0)).tolist())
    return Depth(shallowest_as_good(logarithm), usual, int(known.sum()))


def shallowest_as_good(logarithm: FloatArray) -> float:
    """Return the place, 0 to 1, of the shallowest depth that is as good as the best.

    Parameters
    ----------
    logarithm : (L, TRIED) array
        Logarithms of the landings' misfits at evenly spaced depths, the shallowest
        first.
    """
    mean = logarithm.mean(axis=0)
    best = int(np.argmin(mean))
    if best == 0:
        return 0.0
    gain = logarithm[:, 0] - logarithm[:, best]
    standard_error = float(gain.std(ddof=1) / np.sqrt(len(gain)))
    places = np.linspace(0.0, 1.0, 201)
    nodes = np.linspace(0.0, 1.0, TRIED)
    curve = np.polyval(np.polyfit(nodes, mean, TRIED - 1), places)
    as_good = curve <= curve.min() + standard_error
    return float(places[np.argmax(as_good)])


def landing_misfits(
    before: SectionStates, after: Sequence[SectionStates]
) -> FloatArray | None:
    """Return the misfit of each landing at each depth, (L, depths).

    None if there are too few landings to tell.

    Parameters
    ----------
    before : SectionStates
        States of L landings at the pre section; all of them known.
    after : sequence of SectionStates
        States of the same landings at each depth.
    """
    n = len(before.time)
    inputs = _inputs(before)
    designs = []
    for degree in (1, 2):
        design = _design(inputs, degree)
        if n >= LANDINGS_PER_TERM * design.shape[1]:
            designs.append(design)
    if not designs:
        return None
    found = []
    for one in after:
        outputs = _outputs(before, one)
        each = [_misfit(design, outputs) for design in designs]
        found.append(each)
    # One degree for all depths: that which foretells the first best.
    usual = [float(np.log(misfit).mean()) for misfit in found[0]]
    degree = int(np.argmin(usual))
    return np.column_stack([each[degree] for each in found])


@dataclass(frozen=True)
class _Passages:
    """Landings of one recording that pass the pre section and every depth.

    Parameters
    ----------
    before_s : (L,) array
        Instants at the pre section, s.
    after_s : (L, TRIED) array
        Instants at each depth, s.
    first_s, last_s : (L,) array
        First and last contact, s.
    """

    before_s: FloatArray
    after_s: FloatArray
    first_s: FloatArray
    last_s: FloatArray

    def some(self, rows: IntArray) -> _Passages:
        """Return some of the landings."""
        return _Passages(
            self.before_s[rows],
            self.after_s[rows],
            self.first_s[rows],
            self.last_s[rows],
        )


def _passages(
    recording: Recording, table: pd.DataFrame, pre_m: float, tried_m: FloatArray
) -> _Passages:
    """Find the landings whose contacts lie between the pre section and each depth."""
    touched = floor_instants(table)
    whole = (contacts_of(table).status == LANDED).all(axis=1)
    whole &= np.isfinite(touched).all(axis=1)
    instant = touched[whole]
    spans = table[["begin_s", "end_s"]].to_numpy(float)[whole]
    if len(instant) == 0:
        none = np.empty(0)
        return _Passages(none, np.empty((0, len(tried_m))), none, none)
    crossings = []
    for height_m in tried_m:
        crossings.append(
            find_transitions(
                recording.time,
                recording.body_height,
                pre_height_m=pre_m,
                post_height_m=float(height_m),
                spans=spans,
            )
        )
    before_s = crossings[0].t_pre
    after_s = np.column_stack([one.t_post for one in crossings])
    first_s = instant.min(axis=1)
    last_s = instant.max(axis=1)
    # The shallowest depth comes first; a landing that passes it in time passes all.
    fits = (before_s <= first_s) & (last_s <= after_s[:, 0])
    fits &= np.isfinite(after_s).all(axis=1)
    return _Passages(before_s, after_s, first_s, last_s).some(np.flatnonzero(fits))


def _states(
    recording: Recording,
    passed: _Passages,
    pre_m: float,
    tried_m: FloatArray,
    options: Mapping[str, Any],
) -> list[SectionStates]:
    """Fit the states of landings at the pre section, then at each depth."""
    states = [
        section_states(
            recording.time,
            recording.body,
            passed.before_s,
            height_m=pre_m,
            side="before",
            contact=passed.first_s,
            time_scale=recording.time_scale,
            **options,
        )
    ]
    for k, height_m in enumerate(tried_m):
        states.append(
            section_states(
                recording.time,
                recording.body,
                passed.after_s[:, k],
                height_m=float(height_m),
                side="after",
                contact=passed.last_s,
                time_scale=recording.time_scale,
                **options,
            )
        )
    return states


def _known(states: SectionStates) -> BoolArray:
    """Mark the states (L,) that are determined."""
    values = np.concatenate([states.position, states.velocity], axis=1)
    return np.asarray(np.isfinite(values).all(axis=(1, 2)))


def _rows(states: SectionStates, rows: BoolArray) -> SectionStates:
    """Return some of the states."""
    return SectionStates(**{name: getattr(states, name)[rows] for name in STATE_ARRAYS})


@dataclass(frozen=True)
class _Motion:
    """Rigid motions of L states, in the world.

    Parameters
    ----------
    centre : (L, 3) array
        Mean of the markers, m.
    heading : (L,) array
        Turn about the vertical, rad.
    tilt : (L, 2) array
        Rotation about horizontal axes that tilts the body, along its heading: the sine
        of the angle.
    velocity : (L, 3) array
        Mean velocity of the markers, m/s.
    spin : (L, 3) array
        Angular velocity, rad/s.
    """

    centre: FloatArray
    heading: FloatArray
    tilt: FloatArray
    velocity: FloatArray
    spin: FloatArray


def _rigid_motion(states: SectionStates, shape: FloatArray) -> _Motion:
    """Return the rigid motions of markers whose places in the body are `shape`, (B, 3).

    Every marker has the same mass; the spin is that of their angular momentum.
    """
    centre = states.position.mean(axis=1)
    velocity = states.velocity.mean(axis=1)
    arms = states.position - centre[:, None]
    rotation = kabsch(arms, shape)
    momentum = np.cross(arms, states.velocity - velocity[:, None]).sum(axis=1)
    square = np.einsum("lbi,lbi->l", arms, arms)
    moments = np.einsum("lbi,lbj->lij", arms, arms)
    inertia = square[:, None, None] * np.eye(3) - moments
    spin = np.linalg.solve(inertia, momentum[..., None])[..., 0]
    heading = twists(rotation)
    up = turned(rotation[:, :, 2], heading)
    tilt = np.column_stack([-up[:, 1], up[:, 0]])
    return _Motion(centre, heading, tilt, velocity, spin)


def _shape(states: SectionStates) -> FloatArray:
    """Return the markers (B, 3) in the body, the farthest of them along its x axis.

    Headings are then those of the body, and robust variations along its axes are the
    same however the laboratory's axes are turned.
    """
    shape = body_shape(states.position)
    farthest = shape[np.argmax(np.hypot(shape[:, 0], shape[:, 1]))]
    heading = np.full(len(shape), np.arctan2(farthest[1], farthest[0]))
    return turned(shape, heading)


def _inputs(before: SectionStates) -> FloatArray:
    """Return tilt, velocity and spin before the landing, (L, 8), of sd one."""
    first = _rigid_motion(before, _shape(before))
    velocity = turned(first.velocity, first.heading)
    spin = turned(first.spin, first.heading)
    values = np.column_stack([first.tilt, velocity, spin])
    centred = values - values.mean(axis=0)
    return np.asarray(centred / np.maximum(centred.std(axis=0), 1e-300))


def _outputs(before: SectionStates, after: SectionStates) -> FloatArray:
    """Return step, tilt and turn, then velocity and spin after the landing, (L, 11).

    All are motions of the markers: m, and m/s.
    """
    shape = _shape(before)
    radius_m = float(np.sqrt(np.mean(np.sum(shape**2, axis=1))))
    first = _rigid_motion(before, shape)
    then = _rigid_motion(after, shape)
    step = turned(then.centre - first.centre, first.heading)[:, :2]
    turn = wrapped(then.heading - first.heading)
    velocity = turned(then.velocity, first.heading)
    spin = turned(then.spin, first.heading)
    turns = radius_m * np.column_stack([then.tilt, turn])
    return np.column_stack([step, turns, velocity, radius_m * spin])


def _design(inputs: FloatArray, degree: int) -> FloatArray:
    """Return the terms of a map of a degree, 1 or 2, of inputs (L, q)."""
    columns = [np.ones((len(inputs), 1)), inputs]
    if degree == 2:
        first, second = np.triu_indices(inputs.shape[1])
        columns.append(inputs[:, first] * inputs[:, second])
    return np.hstack(columns)


def _misfit(design: FloatArray, outputs: FloatArray) -> FloatArray:
    """Return what a map does not foretell of each landing, (L,), leave-one-out.

    Squares of positions and of velocities count as shares of their robust variation, a
    half each. Landings far off the map do not teach it, and have the misfit from it.
    """
    away = np.abs(outputs - np.median(outputs, axis=0))
    variance = SQUARED_MAD * np.median(away, axis=0) ** 2
    weight = np.empty(outputs.shape[1])
    weight[:POSITIONS] = 0.5 / variance[:POSITIONS].sum()
    weight[POSITIONS:] = 0.5 / variance[POSITIONS:].sum()
    teaches = np.ones(len(outputs), dtype=bool)
    for _ in range(2):
        basis, root = np.linalg.qr(design[teaches])
        coefficients = np.linalg.solve(root, basis.T @ outputs[teaches])
        missed = outputs - design @ coefficients
        leverage = np.sum(basis**2, axis=1)
        # By these, residuals of the fit become those of landings left out of it.
        left_out = np.ones(len(outputs))
        left_out[teaches] = np.maximum(1.0 - leverage, 1e-3)
        misfit = ((missed / left_out[:, None]) ** 2) @ weight
        near = misfit <= OUTLYING * np.median(misfit)
        if near.sum() < LANDINGS_PER_TERM * design.shape[1]:
            break
        teaches = near
    return np.maximum(misfit, np.finfo(float).tiny)
