"""Hopper and plate in MuJoCo against the scenes that they model."""

import numpy as np
import pytest

from hopdata.hybrid import solve
from hopdata.scenes.plate import Plate
from hopdata.scenes.vertical_hopper import VerticalHopper, hopper_states

pytest.importorskip("mujoco")

from hopdata.dissertation.mujoco_models import (
    Setting,
    depths,
    hopper_simulation,
    plate_simulation,
    plate_xml,
    steps,
)

FALL = np.array([0.0, 2.2, 0.05, 0.0, 0.0, 0.0])


def hopper_error(setting, until=1.5):
    simulation = hopper_simulation(VerticalHopper(), setting)
    count = steps(setting, until)
    states = simulation.roll_out((2.0, 0.0), count)
    time = setting.timestep_s * np.arange(1, count + 1)
    exact = hopper_states(VerticalHopper(), 2.0, time)
    return np.abs(states - exact)[0].max()


@pytest.mark.parametrize("spring", ["contact", "tendon", "callback"])
def test_a_hopper_converges_to_the_closed_form(spring):
    coarse = hopper_error(Setting(spring, "RK4", 2e-3))
    fine = hopper_error(Setting(spring, "RK4", 2.5e-4))
    assert fine < 0.3 * coarse
    assert fine < 1e-3


def test_the_default_contact_has_another_force():
    fine = hopper_error(Setting("default contact", "RK4", 2.5e-4))
    assert fine > 5 * hopper_error(Setting("contact", "RK4", 2.5e-4))


@pytest.mark.parametrize(
    ("spring", "tolerance"), [("callback", 1e-3), ("contact", 0.1), ("body", 0.1)]
)
def test_a_plate_lands_as_the_scene_does(spring, tolerance):
    plate = Plate(6)
    setting = Setting(spring, "Euler", 1e-4)
    simulation = plate_simulation(plate, setting)
    simulation.start(FALL)
    simulation.step_in_python(steps(setting, 0.6))
    exact = solve(plate.system(), (0.0, 0.6), FALL, params=plate.params, rtol=1e-10)
    assert np.abs(simulation.state()[:3] - exact.y_end[:3]).max() < tolerance
    # It has landed: without springs it would be far lower.
    assert exact.y_end[1] > 2.2 - 0.5 * 9.81 * 0.6**2 + 0.2


@pytest.mark.parametrize("spring", ["contact", "body"])
@pytest.mark.parametrize("n", [1, 2, 40])
def test_a_bed_is_generated_for_any_number_of_springs(spring, n):
    xml = plate_xml(Plate(n), Setting(spring))
    assert xml.count('type="sphere"') == n
    assert xml.count("stiffness=") == n * (spring == "body")


def test_springs_of_the_scene_need_no_contact():
    assert "sphere" not in plate_xml(Plate(5), Setting("callback"))


def test_depths_are_the_event_functions():
    plate = Plate(7)
    state = [0.1, 0.8, -0.2, 0.0, 0.0, 0.0]
    found = depths(plate_simulation(plate, Setting()), state) / np.cos(-0.2)
    touched = plate.compressions(state)
    assert np.sort(found) == pytest.approx(np.sort(touched[touched > 0]), abs=1e-12)
    assert len(found) > 0


def test_a_simulation_starts_anew():
    simulation = plate_simulation(Plate(3), Setting("body"))
    ends = []
    for _ in range(2):
        simulation.start(FALL)
        simulation.step_in_c(400)
        ends.append(simulation.state())
    assert np.array_equal(*ends)
    assert len(ends[0]) == 6


def test_a_time_step_divides_the_time():
    assert steps(Setting(timestep_s=2e-3), 2.0) == 1000
    with pytest.raises(ValueError, match="does not divide"):
        steps(Setting(timestep_s=3e-3), 2.0)
