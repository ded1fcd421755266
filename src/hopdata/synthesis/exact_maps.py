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

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
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
RTOL = 1e-12
# A single method, since code that carries the derivative takes seconds to compile for
# each.
EXACTLY: dict[str, Any] = {
    "rtol": RTOL,
    "atol": 1e-14,
    "method": "dop853",
    "jacobian": True,
}
SAME_INSTANT_S = 1e-13
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
    """Return a scene's field without guards: all legs stay up (mode -1) or down (+1)."""
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
    mean, wide = moved.mean(axis=0), np.cov(moved.T)
    apex, fall = np.zeros(N_STATES), 0.0
    apex[FREE] = mean
    for _ in range(MOST_STEPS):
        jacobian, fall, delays, instants = _contact(scene, control, apex, fall)
        if np.ptp(instants) < SAME_INSTANT_S:
            return SimultaneousLanding(apex, fall)
        slope = (delays @ jacobian)[:, FREE]
        slope, apart = slope - slope.mean(axis=0), instants - instants.mean()
        # The point of the linearised set nearest to the mean, not to the last guess.
        missing = apart - slope @ (apex[FREE] - mean)
        weights = np.linalg.lstsq(slope @ wide @ slope.T, missing, rcond=1e-10)[0]
        apex[FREE] = mean - wide @ slope.T @ weights
    found = (
        f"instants {1e3 * np.ptp(instants):.3g} ms apart after {MOST_STEPS} corrections"
    )
    raise AnalysisError.at("simultaneous contact", "one near the mean landing", found)


def _contact(
    scene: Scene, control: Control, apex: FloatArray, fall: float
) -> tuple[FloatArray, float, FloatArray, FloatArray]:
    """Fly to the mean contact instant.

    Returns the derivative of the state there with respect to the apex state, the
    instant, the derivatives of the contact instants with respect to that state, and
    these instants relative to it.
    """
    n, system, vector = scene.n_legs, scene.system(control), scene.vector(None, control)
    fall = fall or float(
        np.sqrt(2 * (apex[2] - scene.leg_length_m) / scene.gravity_m_s2)
    )
    for _ in range(MOST_STEPS):
        flight = _flown(system, vector, (0.0, fall), apex)
        start = Instant(fall, flight.y_end, flight_mode(system, -1.0), vector)
        here = linearise(system, start, np.ones(system.n_states))
        instants = -(guards_at(system, start, here.rate)[0] / here.guard_rates)[:n]
        if abs(instants.mean()) < SAME_INSTANT_S:
            break
        fall += float(instants.mean())
    return (
        _slopes(flight),
        fall,
        -here.gradients[:n] / here.guard_rates[:n, None],
        instants,
    )


def _flown(
    system: System, vector: FloatArray, t_span: tuple[float, float], state: FloatArray
) -> Solution:
    """Fly with all legs up, carrying the derivative with respect to the state."""
    start, mode = padded(state, system), flight_mode(system, -1.0).tolist()
    return solve(
        flying_system(system), t_span, start, params=vector, mode=mode, **EXACTLY
    )


def _slopes(solution: Solution) -> FloatArray:
    """Return the derivatives of all states with respect to those of the body, (s, 12)."""
    return np.asarray(solution.jacobian)[:, :N_STATES]


ALL_ORDERS_UP_TO = 3  # largest number of feet that can touch in any order


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
    """Return each schedule's linear map at the simultaneous contact nearest to the mean.

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
    if (
        control.impulse and control.delay_s
    ):  # an impulse moves guards that depend on velocities
        raise AnalysisError(
            "simultaneous contact: expected impulses or a delay, found both"
        )
    landing = simultaneous_landing(scene, control, apex_states)
    preloads = np.full((1, scene.n_legs), scene.preload_n)
    of = (scene, control, landing.apex_state[None], preloads, sections)
    fall = landings.true_landings(*of, rtol=RTOL, workers=1)
    if not fall.pre_time_s[0] < landing.contact_time_s:
        wanted = (
            f"a simultaneous contact below the pre section ({sections.pre_m:.4g} m)"
        )
        raise AnalysisError.at("sections", wanted, "it above")
    pre, centre = fall.pre_state[0], sections.centre_m
    system, vector = scene.system(control), scene.vector(None, control)
    flight = _flown(
        system, vector, (float(fall.pre_time_s[0]), landing.contact_time_s), pre
    )
    start = Instant(
        landing.contact_time_s, flight.y_end, flight_mode(system, -1.0), vector
    )
    tree = BouligandDerivative(
        system, start, range(scene.n_legs), np.ones(system.n_states)
    )
    before = _slopes(flight) @ landings.section_tangents(pre, centre)
    orders = _orders(tree, landing, apex_states, vector)
    maps, outcomes = [], []
    for order in orders:
        node = tree.node(order)
        flow, post = _to_post_section(scene, control, sections, node.here.instant)
        maps.append(
            landings.output_slopes(pre, post, centre) @ (flow @ node.product @ before)
        )
        outcomes.append(landings.output_coordinates(pre, post, centre))
    schedules = tuple(">".join(str(foot + 1) for foot in order) for order in orders)
    x = landings.input_coordinates(pre, centre)
    return SectionJacobians(
        landing, pre, schedules, np.array(maps), x, np.array(outcomes)
    )


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
    flight = _flown(
        tree.system, vector, (0.0, landing.contact_time_s), landing.apex_state
    )
    apart = (homed(apex_states) - landing.apex_state) @ _slopes(flight).T
    return tuple(sorted({tree.order(deviation) for deviation in apart}))


def _to_post_section(
    scene: Scene, control: Control, sections: landings.SectionHeights, start: Instant
) -> tuple[FloatArray, FloatArray]:
    """Return the derivative, (12, s), of the state at the post section, and that state."""
    n, own = scene.n_legs, scene.system(control)
    system, mode = landings.landing_system(own), start.mode.copy()
    mode[n : n + 2] = [-1, 1]  # falling, above the section
    vector = landings.landing_vectors(
        scene, control, np.full((1, n), scene.preload_n),
        point_m=sections.centre_m, height_m=sections.post_m,
    )[0]  # fmt: skip
    t_span, begin = (
        (start.t, start.t + landings.LONGEST_S),
        np.append(start.y, [start.t] * n),
    )
    stance = solve(system, t_span, begin, params=vector, mode=mode.tolist(), **EXACTLY)
    if stance.status != TERMINATED or stance.mode[n + 1] > 0:
        wanted = f"the body to sink to the post section ({sections.post_m:.4g} m)"
        raise AnalysisError.at("sections", wanted, stance.message)
    end = Instant(stance.t_end, stance.y_end, stance.mode, vector)
    post, flow = (
        stance.y_end[:N_STATES],
        np.asarray(stance.jacobian)[:N_STATES, : own.n_states],
    )
    rate = field_at(system, end)[:N_STATES]
    return project_onto_section(
        flow, rate, landings.height_slope(post, sections.centre_m)
    ), post
