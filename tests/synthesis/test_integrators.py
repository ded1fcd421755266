"""Hops by the dissertation's method, beside the same by the driver."""

from dataclasses import replace

import numpy as np
import pytest

import hopdata as hd
from hopdata.errors import AnalysisError, ConfigError
from hopdata.scenes.hopper_control import HopperDrag
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.quadruped import Quadruped
from hopdata.scenes.scene import Control
from hopdata.synthesis import integrators, simulate_recording
from hopdata.synthesis.hops import fly_hop, level_state
from hopdata.synthesis.simulate import Simulation

HOPPER = HopperParameters()
FRAMES = np.arange(300) / 100 + 0.003


def start(seed=3):
    rng = np.random.default_rng(seed)
    state = level_state(HOPPER, 0.24)
    state[6:9] += 0.05 * rng.standard_normal(3)
    state[9:12] += 0.25 * rng.standard_normal(3)
    return state


def both(scene=HOPPER, state=None, **options):
    """Return a hop by the driver and the same hop by the printed method."""
    if state is None:
        state = start()
    options = {"frame_times_s": FRAMES, **options}
    return [
        fly_hop(scene, state, integrator=name, **options)
        for name in integrators.INTEGRATORS
    ]


def apart(ours, printed):
    """Return how far two hops are apart: in contacts, s, and in poses and rates."""
    assert printed.ending == ours.ending
    assert printed.event_leg.tolist() == ours.event_leg.tolist()
    assert printed.event_down.tolist() == ours.event_down.tolist()
    assert printed.states.shape == ours.states.shape
    assert printed.boom == pytest.approx(ours.boom)
    instants = np.abs(printed.event_time - ours.event_time).max()
    states = np.abs(printed.states - ours.states).max(axis=0)
    return instants, states[:6].max(), states[6:].max()


# A cubic Hermite spline is within dt^4 / 384 of a function with a fourth derivative of 1.
# Fastest is the slip of standing feet, a velocity of at most 0.5 m/s that decays with the
# rate below. Every error of a pose moves a contact by as much over the speed of the fall.
SLIP_PER_S = (
    HOPPER.friction
    * HOPPER.n_legs
    * HOPPER.preload_n
    / HOPPER.total_mass_kg
    / HOPPER.slip_velocity_m_s
)
RATE = integrators.LONGEST_STEP_S**4 / 384 * 0.5 * SLIP_PER_S**4
POSE = RATE / SLIP_PER_S
INSTANT_S = POSE / np.sqrt(2 * 9.81 * 0.24)

VARIANTS = {
    "plain": None,
    "coupled": Control(coupling=0.3),
    "early": Control(delay_s=0.005),
    "board": HopperDrag(drag_n=5.0, direction=(1.0, 0.0), front_m=0.01),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_a_hop_is_the_same_by_both(name):
    ours, printed = both(variant=VARIANTS[name])
    instants, poses, rates = apart(ours, printed)
    assert ours.ending == "apex"
    assert len(ours.event_time) == 6
    # The same numbers would be the same method.
    assert 0 < instants < INSTANT_S
    assert 0 < poses < POSE
    assert 0 < rates < RATE
    assert printed.end_time_s == pytest.approx(ours.end_time_s, abs=INSTANT_S)
    assert printed.end_state == pytest.approx(ours.end_state, abs=RATE)
    assert printed.touched_s == pytest.approx(ours.touched_s, nan_ok=True)


def test_a_swinging_boom_is_the_same_by_both():
    swinging = replace(HOPPER, boom_swing_rad=0.5)
    instants, poses, _ = apart(*both(swinging))
    assert 0 < instants < INSTANT_S
    assert 0 < poses < POSE
    still, swung = both()[1], both(swinging)[1]
    assert np.abs(still.end_state - swung.end_state).max() > 1e-3


def test_feet_that_touch_at_once():
    ours, printed = both(state=level_state(HOPPER, 0.24))
    fall_s = np.sqrt(2 * 0.24 / 9.81)
    down = printed.event_time[printed.event_down]
    assert down == pytest.approx(np.full(3, fall_s), abs=INSTANT_S)
    assert printed.all_stood()
    assert printed.ending == "apex"
    assert printed.end_time_s == pytest.approx(ours.end_time_s, abs=INSTANT_S)


def test_the_errors_shrink_with_the_tolerance(monkeypatch):
    errors = []
    for rtol in (1e-4, 1e-6, 1e-8):
        monkeypatch.setattr(integrators, "PRINTED_RTOL", rtol)
        errors.append(apart(*both())[0])
    assert errors[0] > 10 * errors[1] > 100 * errors[2]


@pytest.mark.parametrize("step", [0.002, 0.02])
def test_the_longest_step_decides_nothing_here(monkeypatch, step):
    monkeypatch.setattr(integrators, "LONGEST_STEP_S", step)
    instants, poses, _ = apart(*both())
    assert 0 < instants < INSTANT_S
    assert 0 < poses < POSE


def test_other_endings_are_the_same_by_both():
    tumbling = level_state(HOPPER, 0.24)
    tumbling[9] = 6.0
    fallen = both(state=tumbling)
    assert [hop.ending for hop in fallen] == ["tipped over"] * 2
    assert fallen[1].end_time_s == pytest.approx(fallen[0].end_time_s, abs=INSTANT_S)
    late = both(limit_s=0.4)
    assert [hop.ending for hop in late] == ["no apex in time"] * 2
    assert [hop.end_time_s for hop in late] == [0.4, 0.4]
    assert [len(hop.states) for hop in late] == [40, 40]


def test_a_hopper_that_rests_on_its_preload_is_stuck_by_both(monkeypatch):
    monkeypatch.setattr(integrators, "MOST_CROSSINGS", 50)
    unreleased = replace(HOPPER, release_extension_m=0.0)
    stuck = both(unreleased, level_state(unreleased, 0.0))
    assert [hop.ending for hop in stuck] == ["stuck"] * 2


def test_a_state_that_is_reset_is_an_error():
    message = r"the handler changes the state at foot\d, t = 0\.\d+; the printed method"
    with pytest.raises(AnalysisError, match=message):
        fly_hop(HOPPER, start(), variant=Control(impulse=0.2), integrator="printed")
    with pytest.raises(
        ConfigError, match="expected one of driver, printed, found 'rk'"
    ):
        fly_hop(HOPPER, start(), integrator="rk")


def test_scenes_say_whether_they_reset_states():
    wanted = "simulation.integrator: expected driver where events reset the state"
    for keys in ({"scene": "quadruped"}, {"control": {"impulse": 0.1}}):
        assert Simulation.of(keys).integrator == "driver"
        with pytest.raises(ConfigError, match=wanted):
            Simulation.of({**keys, "integrator": "printed"})
    assert Quadruped.resets_state
    assert not HopperParameters.resets_state


# Recordings.

HOPS = 4


def recorded(**simulation):
    return hd.synthesize(simulation={"hops": HOPS, **simulation}, seed=2)


@pytest.fixture(scope="module")
def printed():
    return recorded(integrator="printed")


def test_a_recording_runs_from_the_key(printed):
    recording, truth = printed
    usual, usual_truth = recorded()
    assert recording.positions.shape == usual.positions.shape
    # Coordinates are rounded to 2**-15 m. Errors of a hop grow in the next.
    assert np.abs(recording.positions - usual.positions).max() <= 2**-15
    gap = np.abs(truth.contact_times - usual_truth.contact_times).max()
    assert 0 < gap < 10 * INSTANT_S
    assert '"integrator": "printed"' in truth.parameters_json
    assert "integrator" not in usual_truth.parameters_json


def test_a_recording_has_the_same_bytes_again(printed):
    again = recorded(integrator="printed")
    assert again[0].positions.tobytes() == printed[0].positions.tobytes()
    assert again[1].contact_times.tobytes() == printed[1].contact_times.tobytes()
    assert again[1].apex_states.tobytes() == printed[1].apex_states.tobytes()


def test_a_control_lands_by_it_too():
    keys = {"hops": 2, "control": {"coupling": 0.3}}
    truths = [
        simulate_recording({**keys, "integrator": name}, seed=2)[1]
        for name in integrators.INTEGRATORS
    ]
    gap = np.abs(truths[0].contact_times - truths[1].contact_times).max()
    assert 0 < gap < 10 * INSTANT_S
