"""The quadruped: its mechanics, its gait, its recording, and its exact truth."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from hopdata.analysis import synthesize
from hopdata.errors import ConfigError
from hopdata.landings.sections.select import select_sections
from hopdata.landings.touchdowns import touchdown_table
from hopdata.maps.truth.scoring import match_landings, score_sections
from hopdata.scenes import SCENES, scene_class
from hopdata.scenes.body import flight_mode, rotation_matrices
from hopdata.scenes.quadruped import (
    FALLEN,
    N_LEGS,
    N_STATES,
    SYSTEM,
    Quadruped,
    quadruped_field,
    quadruped_guards,
)
from hopdata.scenes.scene import Control, Scene
from hopdata.synthesis import simulate_recording
from hopdata.synthesis.exact_maps import homed, section_jacobians
from hopdata.synthesis.hops import fly_hop, level_state
from hopdata.synthesis.landings import (
    SectionHeights,
    input_coordinates,
    output_coordinates,
    true_landings,
)
from hopdata.synthesis.scaling import known_scene
from hopdata.synthesis.simulate import first_contacts
from hopdata.synthesis.trial import run_trial

QUADRUPED, COUPLED = Quadruped(), Control(coupling=0.2)
BODY = [
    [0.2, 0.03, 0.05],
    [-0.05, 0.12, 0.075],
    [-0.2, -0.07, 0.055],
    [0.06, -0.1, 0.09],
]
SECTIONS = SectionHeights(0.51, 0.29, np.array(BODY))


def standing(seed, legs):
    """Return a random state and mode with these legs down."""
    rng = np.random.default_rng(seed)
    y = 0.2 * rng.normal(size=SYSTEM.n_states)
    y[2] = 0.25
    mode = flight_mode(SYSTEM, -1.0)
    mode[list(legs)] = 1
    return y, mode


def rate(y, mode, quadruped=QUADRUPED, control=None):
    dy = np.zeros(SYSTEM.n_states)
    quadruped_field.function(0.0, y, mode, quadruped.vector(variant=control), dy)
    return dy


def energy(y, mode, quadruped):
    feet = y[:3] + quadruped.rest_feet() @ rotation_matrices(y[3:6]).T
    inertia = [
        quadruped.inertia_x_kg_m2,
        quadruped.inertia_y_kg_m2,
        quadruped.inertia_z_kg_m2,
    ]
    total = quadruped.mass_kg * (0.5 * y[6:9] @ y[6:9] + quadruped.gravity_m_s2 * y[2])
    total += 0.5 * np.array(inertia) @ y[9:12] ** 2
    for leg in np.flatnonzero(mode[:N_LEGS] > 0):
        aside = y[N_STATES + 2 * leg :][:2]
        total += 0.5 * quadruped.side_stiffness_n_m * aside @ aside
        total += 0.5 * quadruped.stiffness_n_m * feet[leg, 2] ** 2
        total -= quadruped.preload_n * feet[leg, 2]
    return total


@pytest.mark.parametrize("legs", [(), (0,), (1, 2), (0, 1, 2, 3)])
def test_without_damping_energy_is_kept(legs):
    elastic = replace(QUADRUPED, damping_n_s_m=0.0, side_damping_n_s_m=0.0)
    y, mode = standing(2, legs)
    dy, step = rate(y, mode, elastic), 1e-6
    gain = energy(y + step * dy, mode, elastic) - energy(y - step * dy, mode, elastic)
    assert abs(gain / (2 * step)) < 1e-6
    assert np.abs(rate(y, mode) - dy).max() > 0.1 or not legs


@pytest.mark.parametrize(
    ("legs", "share"), [((1,), 0.4), ((0, 2), 0.6), ((0, 1, 2, 3), 1.0)]
)
def test_a_coupling_scales_the_forces_of_all_legs(legs, share):
    y, mode = standing(3, legs)
    free = rate(y, flight_mode(SYSTEM, -1.0))
    coupled, plain = rate(y, mode, control=COUPLED) - free, rate(y, mode) - free
    np.testing.assert_allclose(coupled[:N_STATES], share * plain[:N_STATES], atol=1e-11)


def test_rates_of_the_guards_are_derivatives():
    y, mode = standing(4, (1,))
    dy, step = rate(y, mode), 1e-6

    def at(state):
        h, hdot = np.zeros(6), np.zeros(6)
        quadruped_guards.function(0.0, state, dy, mode, QUADRUPED.vector(), h, hdot)
        return h, hdot

    ahead, behind = at(y + step * dy)[0], at(y - step * dy)[0]
    np.testing.assert_allclose((ahead - behind) / (2 * step), at(y)[1], atol=1e-8)
    assert at(y)[0][FALLEN] < 0


def test_the_middle_of_a_level_drop_does_not_move():
    hop = fly_hop(
        QUADRUPED, level_state(QUADRUPED, 0.24), frame_times_s=np.arange(100) / 100
    )
    assert hop.ending == "apex"
    assert hop.all_stood()
    assert np.abs(hop.states[:, [0, 1, 3, 4, 5]]).max() < 1e-12
    assert abs(hop.end_state[2] - hop.start_state[2]) < 0.02


@pytest.fixture(scope="module")
def trial():
    return run_trial(QUADRUPED, hops=2000, rate_hz=100.0, rng=np.random.default_rng(7))


def test_it_hops_thousands_of_times_and_touches_in_eight_orders(trial):
    assert not any(hop.fell for hop in trial.hops)
    assert all(hop.all_stood() for hop in trial.hops)
    orders = Counter(
        map(tuple, np.argsort(first_contacts(trial, QUADRUPED)[0], axis=1))
    )
    often = [count for count in orders.values() if count > 0.05 * len(trial.hops)]
    assert len(often) == 8
    assert sum(often) > 0.95 * len(trial.hops)


@pytest.fixture(scope="module")
def apexes(trial):
    return np.array([hop.start_state for hop in trial.hops[:200]])


@pytest.mark.parametrize("control", [None, COUPLED], ids=["c1", "coupled"])
def test_landings_to_the_sections_are_those_of_single_hops(apexes, control):
    preloads = QUADRUPED.preload_n * np.array([[0.97, 1.02, 1.0, 1.04]])
    found = true_landings(QUADRUPED, control, apexes[:8], np.repeat(preloads, 8, 0), SECTIONS,
                          rtol=1e-11)  # fmt: skip
    assert found.whole.sum() >= 6
    for k in np.flatnonzero(found.whole):
        at = np.array([found.pre_time_s[k], found.post_time_s[k]])
        hop = fly_hop(
            QUADRUPED,
            apexes[k],
            variant=control,
            preloads_n=preloads[0],
            frame_times_s=at,
        )
        both = [found.pre_state[k], found.post_state[k]]
        np.testing.assert_allclose(hop.states, both, rtol=0, atol=2e-8)
        touch = hop.event_time[hop.first_contacts()]
        np.testing.assert_allclose(found.contact_s[k], touch, rtol=0, atol=1e-9)


@pytest.fixture(scope="module")
def jacobians(apexes):
    return {
        control: section_jacobians(QUADRUPED, control, apexes, SECTIONS)
        for control in (Control(), COUPLED)
    }


def spread(maps):
    return max(np.linalg.norm(a - b) for a in maps for b in maps) / np.linalg.norm(
        maps[0]
    )


def test_its_eight_maps_are_one_and_those_of_the_control_are_not(jacobians):
    for found in jacobians.values():
        assert len(found.schedules) >= 8
        assert found.maps.shape[1:] == (11, 8)
    assert spread(jacobians[Control()].maps) < 1e-12
    assert spread(jacobians[COUPLED].maps) > 0.5


@pytest.mark.parametrize("control", [Control(), COUPLED], ids=["c1", "coupled"])
def test_a_small_deviation_does_what_the_map_of_its_schedule_says(
    apexes, jacobians, control
):
    exact = jacobians[control]
    middle = exact.landing.apex_state
    states = middle + 1e-4 * (homed(apexes) - middle)
    preloads = np.full((len(states), N_LEGS), QUADRUPED.preload_n)
    found = true_landings(QUADRUPED, control, states, preloads, SECTIONS, rtol=1e-12)
    x = input_coordinates(found.pre_state, SECTIONS.centre_m) - exact.x
    y = output_coordinates(found.pre_state, found.post_state, SECTIONS.centre_m)
    for k, name in enumerate(found.schedule):
        said = exact.maps[exact.schedules.index(name)] @ x[k]
        assert np.abs(y[k] - exact.y[0] - said).max() < 5e-3 * np.abs(said).max()


FLAT = {"floor": {"bowl_depth_m": 0.0, "waves": 0}, "markers": {"body_m": BODY}}


@pytest.fixture(scope="module")
def recorded():
    return simulate_recording({"scene": "quadruped", "hops": 150}, FLAT, seed=5)


def test_feet_of_the_recording_stay_where_they_touch():
    clean = {**FLAT, "noise_m": 0.0, "resolution_m": 0.0, "rate_hz": 500.0}
    recording, truth = simulate_recording(
        {"scene": "quadruped", "hops": 30}, clean, seed=5
    )
    assert recording.markers[4:] == ("foot1", "foot2", "foot3", "foot4")
    down = truth.foot_down[1:] & truth.foot_down[:-1]
    steps = np.abs(np.diff(recording.feet, axis=0))
    assert steps[down].max() < 1e-12
    assert steps.max() < 0.01, "5 m/s"
    assert truth.complete.all()


def test_its_orders_are_found_between_sections_from_the_data(recorded):
    recording, truth = recorded
    sections = select_sections([recording])
    found = sections.pre_height_m, sections.post_height_m
    entries = score_sections({"one": truth}, sections.to_dict(), {"one": recording})
    true = entries["section_pre_true"]["value"], entries["section_post_true"]["value"]
    np.testing.assert_allclose(found, true, rtol=0, atol=0.005)
    table = touchdown_table(recording, pre_height_m=found[0], post_height_m=found[1])
    used = table[~table["excluded"].astype(bool)]
    assert len(used) > 0.8 * len(truth.complete)
    instants = used[[f"contact_foot{k}_s" for k in range(1, 5)]].to_numpy(float)
    landing = match_landings(instants, truth.contact_times)
    true = np.argsort(truth.contact_times[landing], axis=1)
    assert np.mean((np.argsort(instants, axis=1) == true).all(axis=1)) > 0.85


def test_the_scene_is_read_from_the_truth(recorded):
    known = known_scene(recorded[1])
    assert (known.name, known.scene, known.control) == (
        "quadruped",
        QUADRUPED,
        Control(),
    )


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_of_the_table_is_one(name):
    scene = scene_class(name)()
    assert isinstance(scene, Scene)
    n, system = scene.n_legs, scene.system()
    assert scene.rest_feet().shape == (n, 3)
    assert system.guard_names == (*(f"foot{k + 1}" for k in range(n)), "apex", "fallen")
    assert system is scene.system()
    scene.require_take_off("simulation")


def test_an_unknown_scene_is_answered_with_those_there_are():
    with pytest.raises(
        ConfigError, match=rf"one of {', '.join(SCENES)}, found 'pronk'"
    ):
        simulate_recording({"scene": "pronk"}, seed=1)


@pytest.mark.parametrize(
    ("scene", "key", "value", "wanted"),
    [
        ("quadruped", "mass_kg", 0.0, "a number above 0, found 0.0"),
        ("hopper", "n_legs", 1, "a whole number at least 2 and at most 6, found 1"),
        ("hopper", "mass_kg", 0.0, "a number above 0, found 0.0"),
        ("hopper", "friction", -0.1, "a number at least 0, found -0.1"),
    ],
)
def test_a_parameter_out_of_range_is_refused_by_name(scene, key, value, wanted):
    with pytest.raises(
        ConfigError, match=rf"simulation\.{scene}\.{key}: expected {wanted}"
    ):
        synthesize(scene, simulation={scene: {key: value}})


@pytest.mark.parametrize("fraction", [-0.1, 1.1])
def test_an_impulse_is_a_fraction(fraction):
    with pytest.raises(
        ConfigError, match=r"simulation\.control\.impulse: expected a number"
    ):
        synthesize(simulation={"control": {"impulse": fraction}})
