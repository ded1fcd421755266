"""Exact linear map from section to section for each mode schedule.

On the trajectory with simultaneous contact of all feet, the map through a landing has
one derivative for each order in which its neighbours touch: flow to the contacts, a
product of saltation matrices, flow to the post section, projected on the sections. The
derivatives are equal if the map is C1 there.

Feet on one rigid body cannot touch in every order. For six feet, about a dozen of the
720 orders border on the simultaneous contact. The others also have a product of
matrices, but no landing follows it.
"""

from dataclasses import dataclass
from functools import cache
from itertools import permutations
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.feet import order_name
from hopdata.hybrid import Solution, System, solve
from hopdata.hybrid.first_order import project_onto_section
from hopdata.hybrid.first_order.linearise import Instant, field_at, guards_at, linearise
from hopdata.hybrid.first_order.saltation import BouligandDerivative
from hopdata.hybrid.layout import TERMINATED
from hopdata.rigid import turned
from hopdata.scenes.body import N_STATES, flight_mode
from hopdata.scenes.scene import Control, Scene
from hopdata.synthesis import landings
from hopdata.synthesis.hops import padded

# Free components of an apex state, without place and heading.
FREE = np.array([2, 4, 5, 6, 7, 8, 9, 10, 11])
#: Relative tolerance of the integrations that give the exact maps.
#: Unit: 1. Origin: chosen.
RTOL = 1e-12
EXACTLY: dict[str, Any] = {
    "rtol": RTOL,
    "atol": 1e-14,
    # A single method, since code that carries the derivative takes seconds to compile
    # for each.
    "method": "dop853",
    "jacobian": True,
}
#: Contacts that are no further apart are simultaneous.
#: Unit: s. Origin: chosen.
SAME_INSTANT_S = 1e-13
#: Difference in length of legs that touch one after the other, in `leg_slopes`.
#: Unit: m. Origin: chosen.
LEGS_APART_M = 2e-6
#: Step of the differences by the lengths of legs; smaller, so that no order changes.
#: Unit: m. Origin: derived: a quarter of `LEGS_APART_M`.
LEG_STEP_M = LEGS_APART_M / 4
#: Time that all feet move on after they have touched at once, before their guards are
#: watched: till then `SAME_INSTANT_S` decides on which side of its surface a foot is.
#: Unit: s. Origin: chosen: a foot of 1 m/s moves by 1 um, where 1e-13 m are not sure.
PAST_CONTACT_S = 1e-6
#: Most corrections of a simultaneous contact before it is given up.
#: Unit: 1. Origin: chosen.
MOST_STEPS = 20


@dataclass(frozen=True)
class SimultaneousLanding:
    """A flight that ends with all feet touching at once.

    Parameters
    ----------
    apex_state : (12,) array
        State of the body at the apex, with place and heading zero.
    contact_time_s : float
        Time of the contacts from the apex, s.
    """

    apex_state: FloatArray
    contact_time_s: float


@cache
def flying_system(system: System) -> System:
    """Return a scene's field without guards: legs stay up (mode -1) or down (+1)."""
    return System(
        field=system.field, n_states=system.n_states, n_extra_modes=system.n_modes
    )


def homed(states: FloatArray) -> FloatArray:
    """Move states (L, 12) to the origin and turn them to heading zero."""
    moved = states.copy()
    moved[:, [0, 1, 3]] = 0.0
    moved[:, 6:9] = turned(states[:, 6:9], states[:, 3])
    return moved


def simultaneous_landing(
    scene: Scene, control: Control, apex_states: FloatArray
) -> SimultaneousLanding:
    """Find the apex state nearest to the mean from which all feet touch at once.

    Newton's method on the linearised contact instants. Each step takes the smallest
    correction, as measured by the covariance of the landings.

    Parameters
    ----------
    scene, control
        The system that lands.
    apex_states : (L, 12) array
        States of the landings at their apexes.

    Raises
    ------
    AnalysisError
        If it does not converge, since the landings are far from a simultaneous contact.
    """
    moved = homed(apex_states)[:, FREE]
    mean = moved.mean(axis=0)
    covariance = np.cov(moved.T)
    apex = np.zeros(N_STATES)
    apex[FREE] = mean
    fall = _free_fall(scene, apex)
    for _ in range(MOST_STEPS):
        jacobian, fall, delays, instants = _contact(scene, control, apex, fall)
        if np.ptp(instants) < SAME_INSTANT_S:
            return SimultaneousLanding(apex, fall)
        slopes = (delays @ jacobian)[:, FREE]
        slope = slopes - slopes.mean(axis=0)
        apart = instants - instants.mean()
        # The point of the linearised set nearest to the mean, not to the last guess.
        missing = apart - slope @ (apex[FREE] - mean)
        normal = slope @ covariance @ slope.T
        weights = np.linalg.lstsq(normal, missing, rcond=1e-10)[0]
        apex[FREE] = mean - covariance @ slope.T @ weights
    apart_ms = 1e3 * np.ptp(instants)
    found = f"instants {apart_ms:.3g} ms apart after {MOST_STEPS} corrections"
    raise AnalysisError.at("simultaneous contact", "one near the mean landing", found)


def _free_fall(scene: Scene, apex: FloatArray) -> float:
    """Return the time, s, in which a level body at rest would fall to its contact."""
    height = apex[2] - scene.leg_length_m
    return float(np.sqrt(2 * height / scene.gravity_m_s2))


def _contact(
    scene: Scene, control: Control, apex: FloatArray, fall: float
) -> tuple[FloatArray, float, FloatArray, FloatArray]:
    """Fly to the mean contact instant.

    Returns the derivative of the state there with respect to the apex state, the
    instant, the derivatives of the contact instants with respect to that state, and
    these instants relative to it.
    """
    n = scene.n_legs
    system = scene.system(control)
    vector = scene.vector(None, control)
    for _ in range(MOST_STEPS):
        flight = _flown(system, vector, (0.0, fall), apex)
        start = Instant(fall, flight.y_end, flight_mode(system, -1.0), vector)
        here = linearise(system, start, np.ones(system.n_states))
        h, _ = guards_at(system, start, here.rate)
        instants = -(h / here.guard_rates)[:n]
        if abs(instants.mean()) < SAME_INSTANT_S:
            break
        fall += float(instants.mean())
    delays = -here.gradients[:n] / here.guard_rates[:n, None]
    return _slopes(flight), fall, delays, instants


def _flown(
    system: System, vector: FloatArray, t_span: tuple[float, float], state: FloatArray
) -> Solution:
    """Fly with all legs up, carrying the derivative with respect to the state."""
    mode = flight_mode(system, -1.0)
    return _moved(system, vector, t_span, padded(state, system), mode)


def _moved(
    system: System,
    vector: FloatArray,
    t_span: tuple[float, float],
    start: FloatArray,
    mode: IntArray,
) -> Solution:
    """Move in one mode, whatever the guards, and carry the derivative."""
    flying = flying_system(system)
    return solve(flying, t_span, start, params=vector, mode=mode.tolist(), **EXACTLY)


def _slopes(solution: Solution) -> FloatArray:
    """Return the derivatives of all states with respect to the body's, (s, 12)."""
    return np.asarray(solution.jacobian)[:, :N_STATES]


#: Largest number of feet that can touch in any order.
#: Unit: 1. Origin: derived: three points of a plane can have any heights.
ALL_ORDERS_UP_TO = 3


@dataclass(frozen=True)
class SectionJacobians:
    """Derivatives of a landing at its simultaneous contact for each of S schedules.

    Parameters
    ----------
    landing : SimultaneousLanding
        The trajectory.
    pre_state : (12,) array
        State of the trajectory at the pre section.
    schedules : tuple of str
        Names such as ``"2>3>1"``.
    maps : (S, 11, 8) array
        Derivatives of outcome with respect to input; see `hopdata.synthesis.landings`.
    x : (8,) array
        Input of the trajectory.
    y : (S, 11) array
        Its outcome in each order; outcomes differ only if contacts make the state jump.
    """

    landing: SimultaneousLanding
    pre_state: FloatArray
    schedules: tuple[str, ...]
    maps: FloatArray
    x: FloatArray
    y: FloatArray


def section_jacobians(
    scene: Scene,
    control: Control,
    apex_states: FloatArray,
    sections: landings.SectionHeights,
) -> SectionJacobians:
    """Return each schedule's map at the simultaneous contact nearest to the mean.

    Parameters
    ----------
    scene, control
        The system that lands, with equal preloads. A swinging boom must rest before the
        pre section. Otherwise the map depends on the time of the apex, which is not a
        coordinate.
    apex_states : (L, 12) array
        States of the landings at their apexes, at least ten. With more than three feet,
        the only orders with a map are those in which these landings touch when drawn
        together.
    sections : SectionHeights
        The sections.

    Raises
    ------
    AnalysisError
        If there is no simultaneous contact between the sections, or the control has
        both impulses and a delay; after the first contact the others are then later, or
        over.
    """
    # An impulse moves guards that depend on velocities.
    if control.impulse and control.delay_s:
        raise AnalysisError(
            "simultaneous contact: expected impulses or a delay, found both"
        )
    landing = simultaneous_landing(scene, control, apex_states)
    preloads = np.full((1, scene.n_legs), scene.preload_n)
    fall = landings.true_landings(
        scene,
        control,
        landing.apex_state[None],
        preloads,
        sections,
        rtol=RTOL,
        workers=1,
    )
    contact_s = landing.contact_time_s
    pre_s = float(fall.pre_time_s[0])
    if not pre_s < contact_s:
        height = f"{sections.pre_m:.4g} m"
        wanted = f"a simultaneous contact below the pre section ({height})"
        raise AnalysisError.at("sections", wanted, "it above")
    pre = fall.pre_state[0]
    centre = sections.centre_m
    system = scene.system(control)
    vector = scene.vector(None, control)
    flight = _flown(system, vector, (pre_s, contact_s), pre)
    start = Instant(contact_s, flight.y_end, flight_mode(system, -1.0), vector)
    scale = np.ones(system.n_states)
    tree = BouligandDerivative(system, start, range(scene.n_legs), scale)
    before = _slopes(flight) @ landings.section_tangents(pre, centre)
    orders = _orders(tree, landing, apex_states, vector)
    maps = []
    outcomes = []
    for order in orders:
        node = tree.node(order)
        flow, post = _to_post_section(scene, control, sections, node.here.instant)
        slopes = landings.output_slopes(pre, post, centre)
        maps.append(slopes @ (flow @ node.product @ before))
        outcomes.append(landings.output_coordinates(pre, post, centre))
    schedules = tuple(order_name(order) for order in orders)
    x = landings.input_coordinates(pre, centre)
    y = np.array(outcomes)
    return SectionJacobians(landing, pre, schedules, np.array(maps), x, y)


def leg_slopes(
    scene: Scene,
    control: Control,
    sections: landings.SectionHeights,
    found: SectionJacobians,
) -> FloatArray:
    """Return derivatives (S, 11, n) of each schedule's outcome by the legs' lengths.

    They are central differences of landings near the simultaneous one, whose legs are a
    little longer the earlier they touch, so that the order stays.

    Parameters
    ----------
    scene, control, sections
        As for `section_jacobians`.
    found : SectionJacobians
        Its result.
    """
    n = scene.n_legs
    steps = LEG_STEP_M * np.vstack([np.eye(n), -np.eye(n)])
    lengths = []
    for schedule in found.schedules:
        order = [int(foot) - 1 for foot in schedule.split(">")]
        ordered = np.empty(n)
        ordered[order] = LEGS_APART_M * np.arange(n)[::-1]
        lengths.append(ordered + steps)
    longer_m = np.concatenate(lengths)
    flown = landings.true_landings(
        scene,
        control,
        np.tile(found.landing.apex_state, (len(longer_m), 1)),
        np.full(longer_m.shape, scene.preload_n),
        sections,
        longer_m=longer_m,
        rtol=RTOL,
        workers=1,
    )
    outcomes = landings.output_coordinates(
        flown.pre_state, flown.post_state, sections.centre_m
    ).reshape(len(found.schedules), 2, n, -1)
    slopes = (outcomes[:, 0] - outcomes[:, 1]) / (2.0 * LEG_STEP_M)
    return np.asarray(np.swapaxes(slopes, 1, 2))


def _orders(
    tree: BouligandDerivative,
    landing: SimultaneousLanding,
    apex_states: FloatArray,
    vector: FloatArray,
) -> tuple[tuple[int, ...], ...]:
    """Return the sorted orders: all for up to three feet, otherwise those that occur.

    An order occurs if some landing touches in it when the landings are drawn together
    about the simultaneous one.
    """
    if len(tree.guards) <= ALL_ORDERS_UP_TO:
        return tuple(permutations(tree.guards))
    t_span = (0.0, landing.contact_time_s)
    flight = _flown(tree.system, vector, t_span, landing.apex_state)
    apart = (homed(apex_states) - landing.apex_state) @ _slopes(flight).T
    return tuple(sorted({tree.order(deviation) for deviation in apart}))


def _to_post_section(
    scene: Scene, control: Control, sections: landings.SectionHeights, start: Instant
) -> tuple[FloatArray, FloatArray]:
    """Return the derivative, (12, s), of the state at the post section, and it."""
    n = scene.n_legs
    own = scene.system(control)
    system = landings.landing_system(own)
    mode = start.mode.copy()
    mode[n : n + 2] = [-1, 1]  # falling, above the section
    vectors = landings.landing_vectors(
        scene,
        control,
        np.full((1, n), scene.preload_n),
        point_m=sections.centre_m,
        height_m=sections.post_m,
    )
    vector = vectors[0]
    past_s = start.t + PAST_CONTACT_S
    past = _moved(own, start.params, (start.t, past_s), start.y, start.mode)
    t_span = (past_s, start.t + landings.LONGEST_S)
    begin = np.append(past.y_end, [start.t] * n)
    stance = solve(system, t_span, begin, params=vector, mode=mode.tolist(), **EXACTLY)
    if stance.status != TERMINATED or stance.mode[n + 1] > 0:
        wanted = f"the body to sink to the post section ({sections.post_m:.4g} m)"
        raise AnalysisError.at("sections", wanted, stance.message)
    end = Instant(stance.t_end, stance.y_end, stance.mode, vector)
    post = stance.y_end[:N_STATES]
    flow = np.asarray(stance.jacobian)[:N_STATES, : own.n_states]
    flow = flow @ np.asarray(past.jacobian)
    rate = field_at(system, end)[:N_STATES]
    gradient = landings.height_slope(post, sections.centre_m)
    return project_onto_section(flow, rate, gradient), post
