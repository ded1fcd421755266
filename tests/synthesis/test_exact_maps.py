"""The linear maps of the schedules: equal for the hopper, different for controls, and true."""

import os
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.hybrid.first_order.linearise import Instant
from hopdata.rigid import INPUT_NAMES, OUTPUT_NAMES
from hopdata.scenes.body import flight_mode
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.scene import Control
from hopdata.synthesis.exact_maps import (
    _flown,
    _to_post_section,
    homed,
    leg_slopes,
    section_jacobians,
    simultaneous_landing,
)
from hopdata.synthesis.hops import level_state
from hopdata.synthesis.landings import (
    SectionHeights,
    height_slope,
    input_coordinates,
    output_coordinates,
    section_tangents,
    true_landings,
)
from hopdata.synthesis.trial import MarkerOptions

HOPPER = HopperParameters()
FOUR = HopperParameters(n_legs=4, stiffness_n_m=67.5, preload_n=16.5, damping_n_s_m=3.6)
SIX = HopperParameters(n_legs=6, stiffness_n_m=45.0, preload_n=11.0, damping_n_s_m=2.4)
SECTIONS = SectionHeights(0.5, 0.275, np.array(MarkerOptions().body_m))
CONTROLS = {
    "hopper": Control(),
    "coupling": Control(coupling=0.1),
    "impulse": Control(impulse=0.3),
    "delay": Control(delay_s=0.005),
}


def apexes(count=60, size=1.0):
    rng = np.random.default_rng(4)
    states = np.tile(level_state(HOPPER, 0.24), (count, 1))
    states[:, :2] += rng.uniform(-0.5, 0.5, (count, 2))
    states[:, 3] = rng.uniform(-3, 3, count)
    states[:, 4:6] += size * 0.02 * rng.standard_normal((count, 2))
    states[:, 6:9] += size * 0.05 * rng.standard_normal((count, 3))
    states[:, 9:] += size * 0.25 * rng.standard_normal((count, 3))
    return states


def largest_difference(maps):
    size = np.linalg.norm(maps[0])
    return max(np.linalg.norm(a - b) for a in maps for b in maps) / size


@pytest.fixture(scope="module")
def jacobians():
    return {
        kind: section_jacobians(HOPPER, control, apexes(), SECTIONS)
        for kind, control in CONTROLS.items()
    }


def test_all_feet_touch_at_once_near_the_mean_landing():
    for control in CONTROLS.values():
        found = simultaneous_landing(HOPPER, control, apexes())
        preloads = np.full((1, 3), HOPPER.preload_n)
        flown = true_landings(
            HOPPER, control, found.apex_state[None], preloads, SECTIONS, rtol=1e-12
        )
        assert np.ptp(flown.contact_s) < 1e-11
        np.testing.assert_allclose(
            flown.contact_s, found.contact_time_s, rtol=0, atol=1e-11
        )
        mine = homed(apexes())[:, 4:]
        assert np.all(
            np.abs(found.apex_state[4:] - mine.mean(axis=0)) < 0.5 * mine.std(axis=0)
        )


def test_the_six_maps_of_the_hopper_are_one(jacobians):
    maps = jacobians["hopper"].maps
    assert maps.shape == (6, 11, 8)
    assert sorted(jacobians["hopper"].schedules) == [
        ">".join(map(str, order)) for order in sorted(permutations((1, 2, 3)))
    ]
    assert largest_difference(maps) < 1e-12


#: Six legs compile for seconds, and are in a small study in any run: with `ALL=1`.
MANY_LEGS = {"four": FOUR, "six": SIX} if "ALL" in os.environ else {"four": FOUR}


@pytest.mark.parametrize("hopper", MANY_LEGS.values(), ids=MANY_LEGS)
def test_many_legs_have_one_map_in_the_orders_that_occur(hopper):
    found = section_jacobians(hopper, CONTROLS["hopper"], apexes(), SECTIONS)
    n = hopper.n_legs
    assert found.maps.shape == (len(found.schedules), 11, 8)
    assert largest_difference(found.maps) < 1e-12
    assert 2 * n <= len(found.schedules) < 4 * n, (
        "of a rigid body: 2 n, and a few narrow ones"
    )
    middle = found.landing.apex_state
    states = middle + 1e-5 * (homed(apexes()) - middle)
    preloads = np.full((len(states), n), hopper.preload_n)
    flown = true_landings(
        hopper, CONTROLS["hopper"], states, preloads, SECTIONS, rtol=1e-12, workers=1
    )
    assert set(flown.schedule) == set(found.schedules)


def test_the_maps_of_a_control_differ(jacobians):
    assert largest_difference(jacobians["coupling"].maps) > 0.1
    assert largest_difference(jacobians["impulse"].maps) > 0.1
    assert largest_difference(jacobians["delay"].maps) > 0.05


@pytest.mark.parametrize("kind", CONTROLS)
def test_a_small_deviation_does_what_the_map_of_its_schedule_says(jacobians, kind):
    exact, size = jacobians[kind], 1e-4
    middle = exact.landing.apex_state
    states = middle + size * (homed(apexes(size=1.0)) - homed(apexes()).mean(axis=0))
    preloads = np.full((len(states), 3), HOPPER.preload_n)
    found = true_landings(
        HOPPER, CONTROLS[kind], states, preloads, SECTIONS, rtol=1e-12
    )
    x = input_coordinates(found.pre_state, SECTIONS.centre_m) - exact.x
    y = output_coordinates(found.pre_state, found.post_state, SECTIONS.centre_m)
    assert set(found.schedule) == set(exact.schedules)
    for k, name in enumerate(found.schedule):
        number = exact.schedules.index(name)
        said = exact.maps[number] @ x[k]
        assert np.abs(y[k] - exact.y[number] - said).max() < 3e-3 * np.abs(said).max()


def test_coordinates_of_a_turned_and_moved_landing_are_the_same():
    pre, post = apexes(5), apexes(5)[::-1].copy()
    moved = []
    for states in (pre, post):
        other, angle = states.copy(), 0.7
        c, s = np.cos(angle), np.sin(angle)
        for x in (0, 6):
            other[:, x] = c * states[:, x] - s * states[:, x + 1]
            other[:, x + 1] = s * states[:, x] + c * states[:, x + 1]
        other[:, :2] += [3.0, -2.0]
        other[:, 3] += angle
        moved.append(other)
    centre = SECTIONS.centre_m
    x, y = input_coordinates(pre, centre), output_coordinates(pre, post, centre)
    assert (x.shape, y.shape) == ((5, len(INPUT_NAMES)), (5, len(OUTPUT_NAMES)))
    np.testing.assert_allclose(input_coordinates(moved[0], centre), x, atol=1e-12)
    np.testing.assert_allclose(output_coordinates(*moved, centre), y, atol=1e-12)


def test_tangents_stay_on_the_section_and_change_one_coordinate_each():
    state, centre = apexes(1)[0], SECTIONS.centre_m
    tangents, step = section_tangents(state, centre), 1e-6
    np.testing.assert_allclose(height_slope(state, centre) @ tangents, 0, atol=1e-13)
    for k, tangent in enumerate(tangents.T):
        ahead, back = (
            input_coordinates(state + s * tangent, centre) for s in (step, -step)
        )
        np.testing.assert_allclose((ahead - back) / (2 * step), np.eye(8)[k], atol=1e-8)


@pytest.mark.parametrize("rounding_m", [-1e-13, 0.0, 1e-13])
def test_rounding_does_not_decide_on_which_side_the_feet_begin(rounding_m):
    """A foot that stands, but is above the floor by rounding, would flip back and forth."""
    control = CONTROLS["coupling"]
    landing = simultaneous_landing(HOPPER, control, apexes())
    system = HOPPER.system(control)
    vector = HOPPER.vector(None, control)
    t_span = (0.0, landing.contact_time_s)
    touching = _flown(system, vector, t_span, landing.apex_state).y_end
    touching[2] += rounding_m
    mode = flight_mode(system, -1.0)
    mode[: HOPPER.n_legs] = 1
    start = Instant(landing.contact_time_s, touching, mode, vector)
    flow, post = _to_post_section(HOPPER, control, SECTIONS, start)
    assert flow.shape == (12, system.n_states)
    assert post[8] < 0.0


def test_what_cannot_be_is_refused():
    tall = replace(SECTIONS, pre_m=0.32)
    with pytest.raises(AnalysisError, match="contact below the pre section"):
        section_jacobians(HOPPER, CONTROLS["hopper"], apexes(), tall)
    deep = replace(SECTIONS, post_m=0.05)
    with pytest.raises(AnalysisError, match="sink to the post section"):
        section_jacobians(HOPPER, CONTROLS["hopper"], apexes(), deep)


def test_impulses_and_a_delay_together_have_no_simultaneous_contact():
    with pytest.raises(AnalysisError, match="impulses or a delay, found both"):
        section_jacobians(
            HOPPER, Control(impulse=0.1, delay_s=0.005), apexes(), SECTIONS
        )


@pytest.mark.parametrize("kind", ["hopper", "coupling"])
def test_slopes_by_the_lengths_of_legs_foretell_landings(jacobians, kind):
    control, found = CONTROLS[kind], jacobians[kind]
    slopes = leg_slopes(HOPPER, control, SECTIONS, found)
    assert slopes.shape == (6, 11, 3)
    apart = largest_difference(slopes)
    if kind == "hopper":
        assert apart < 1e-3  # C1 in the lengths of its legs, too
    else:
        assert apart > 0.02
    longer = 5e-5 * np.random.default_rng(3).standard_normal((20, 3))
    flown = true_landings(
        HOPPER,
        control,
        np.tile(found.landing.apex_state, (20, 1)),
        np.full((20, 3), HOPPER.preload_n),
        SECTIONS,
        longer_m=longer,
        rtol=1e-11,
    )
    outcome = output_coordinates(flown.pre_state, flown.post_state, SECTIONS.centre_m)
    order = [found.schedules.index(schedule) for schedule in flown.schedule]
    assert len(set(order)) > 3
    foretold = found.y[order] + np.einsum("nqp,np->nq", slopes[order], longer)
    moved = np.linalg.norm(outcome - found.y[order], axis=1)
    assert (np.linalg.norm(outcome - foretold, axis=1) < 0.01 * moved).all()
