"""The linear map from section to section of each mode schedule, exactly.

At the trajectory on which all feet touch at once the map through a landing has one derivative for
each order in which its neighbours touch: flow to the contacts, a product of saltation matrices,
flow to the post section, projected on the sections. They are equal if the map is C1 there.

Feet on one rigid body do not touch in any order: of six, a dozen or so of the 720 orders border on
the simultaneous contact. The others have a product of matrices too, but no landing obeys it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.hybrid import solve
from hopdata.hybrid.first_order import project_onto_section
from hopdata.hybrid.first_order.local import Instant, field_at
from hopdata.hybrid.first_order.orders import CrossingTree
from hopdata.hybrid.status import TERMINATED
from hopdata.scenes.hopper import N_STATES, flight_mode
from hopdata.scenes.hopper_control import HopperControl, control_system
from hopdata.scenes.hopper_landing import landing_system, landing_vectors
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.landings import LONGEST_S, SectionHeights, true_landings
from hopdata.synthesis.section_coordinates import (
    height_slope,
    input_coordinates,
    output_coordinates,
    output_slopes,
    section_tangents,
)
from hopdata.synthesis.simultaneous import (
    ATOL,
    RTOL,
    SimultaneousLanding,
    flying_system,
    homed,
    simultaneous_landing,
)

FloatArray = NDArray[np.float64]

ALL_ORDERS_UP_TO = 3  # feet that can touch in any order


@dataclass(frozen=True)
class SectionJacobians:
    """Derivatives of a landing at its simultaneous contact, for each of S schedules.

    Parameters
    ----------
    landing : SimultaneousLanding
        The trajectory.
    pre_state : (12,) array
        Its state at the pre section.
    schedules : tuple of str
        Names such as ``"2>3>1"``.
    maps : (S, 11, 8) array
        Derivatives of the outcome by the input: see `hopdata.synthesis.section_coordinates`.
    x : (8,) array
        Input of the trajectory.
    y : (S, 11) array
        Its outcome in each order; they differ only if contacts make the state jump.
    """

    landing: SimultaneousLanding
    pre_state: FloatArray
    schedules: tuple[str, ...]
    maps: FloatArray
    x: FloatArray
    y: FloatArray


def section_jacobians(
    hopper: HopperParameters,
    control: HopperControl,
    apex_states: FloatArray,
    sections: SectionHeights,
) -> SectionJacobians:
    """Return the linear map of each schedule at the simultaneous contact nearest to the mean.

    Parameters
    ----------
    hopper, control
        What lands, its preloads all alike. If its boom swings, it has to rest before the pre
        section: else the map depends on the time of the apex, which is no coordinate.
    apex_states : (L, 12) array
        States of the landings at their apexes, at least ten. Of more than three feet only the
        orders have a map in which these landings touch when they are drawn together.
    sections : SectionHeights
        The sections.

    Raises
    ------
    AnalysisError
        If there is no simultaneous contact between the sections.
    """
    landing = simultaneous_landing(hopper, control, apex_states)
    preloads = np.full((1, hopper.n_legs), hopper.preload_n)
    fall = true_landings(
        hopper, control, landing.apex_state[None], preloads, sections, rtol=RTOL, workers=1
    )
    if not fall.pre_time_s[0] < landing.contact_time_s:
        raise AnalysisError(
            f"sections: expected a simultaneous contact below the pre section ({sections.pre_m:.4g}"
            " m), found it above"
        )
    pre, centre, vector = fall.pre_state[0], sections.centre_m, control.vector(hopper)
    flight = solve(
        flying_system(hopper.n_legs), (float(fall.pre_time_s[0]), landing.contact_time_s), pre,
        params=vector, mode=[-1] * hopper.n_legs, rtol=RTOL, atol=ATOL, jacobian=True,
    )  # fmt: skip
    start = Instant(landing.contact_time_s, flight.y_end, flight_mode(hopper.n_legs, -1.0), vector)
    system, feet = control_system(hopper.n_legs), range(hopper.n_legs)
    tree = CrossingTree(system, start, feet, np.ones(N_STATES))
    before = np.asarray(flight.jacobian) @ section_tangents(pre, centre)
    orders = _orders(tree, landing, apex_states, vector)
    maps, outcomes = [], []
    for order in orders:
        node = tree.node(order)
        flow, post = _to_post_section(hopper, control, sections, node.here.instant)
        through = flow @ node.product @ before
        maps.append(output_slopes(pre, post, centre) @ through)
        outcomes.append(output_coordinates(pre, post, centre))
    return SectionJacobians(
        landing,
        pre,
        tuple(">".join(str(foot + 1) for foot in order) for order in orders),
        np.array(maps),
        input_coordinates(pre, centre),
        np.array(outcomes),
    )


def _orders(
    tree: CrossingTree, landing: SimultaneousLanding, apex_states: FloatArray, vector: FloatArray
) -> tuple[tuple[int, ...], ...]:
    """Return the orders, sorted: all of up to three feet, and of more those that occur.

    These are the orders in which the landings touch if they are drawn together about the
    simultaneous one.
    """
    n = len(tree.guards)
    if n <= ALL_ORDERS_UP_TO:
        return tuple(permutations(tree.guards))
    flight = solve(
        flying_system(n), (0.0, landing.contact_time_s), landing.apex_state,
        params=vector, mode=[-1] * n, rtol=RTOL, atol=ATOL, jacobian=True,
    )  # fmt: skip
    apart = (homed(apex_states) - landing.apex_state) @ np.asarray(flight.jacobian).T
    return tuple(sorted({tree.order(deviation) for deviation in apart}))


def _to_post_section(
    hopper: HopperParameters, control: HopperControl, sections: SectionHeights, start: Instant
) -> tuple[FloatArray, FloatArray]:
    """Return the derivative, (12, 12), of the state at the post section, and that state."""
    n = hopper.n_legs
    system, mode = landing_system(n), start.mode.copy()
    mode[n : n + 2] = [-1, 1]  # falling, above the section
    vector = landing_vectors(
        hopper, control, np.full((1, n), hopper.preload_n),
        point_m=sections.centre_m, height_m=sections.post_m,
    )[0]  # fmt: skip
    stance = solve(
        system, (start.t, start.t + LONGEST_S), np.append(start.y, np.full(n, start.t)),
        params=vector, mode=mode.tolist(), rtol=RTOL, atol=ATOL, jacobian=True,
    )  # fmt: skip
    if stance.status != TERMINATED or stance.mode[n + 1] > 0:
        raise AnalysisError(
            f"sections: expected the body to sink to the post section ({sections.post_m:.4g} m), "
            f"found: {stance.message}"
        )
    end = Instant(stance.t_end, stance.y_end, stance.mode, vector)
    post, flow = stance.y_end[:N_STATES], np.asarray(stance.jacobian)[:N_STATES, :N_STATES]
    rate = field_at(system, end)[:N_STATES]
    return project_onto_section(flow, rate, height_slope(post, sections.centre_m)), post
