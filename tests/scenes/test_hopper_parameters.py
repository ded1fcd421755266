import numpy as np
import pytest

from hopdata.errors import ConfigError
from hopdata.scenes import hopper_vector as at
from hopdata.scenes.hopper_parameters import HopperParameters


def test_every_place_of_the_vector_holds_the_parameter_of_its_name():
    parameters = HopperParameters(
        counterweight_mass_kg=0.37, boom_swing_rad=0.9, friction=0.41
    )
    vector = parameters.vector()
    assert vector[at.COUNTERWEIGHT] == 0.37
    assert vector[at.BOOM_SWING] == 0.9
    assert vector[at.FRICTION] == 0.41
    assert vector[at.TILT_LIMIT] == parameters.tilt_limit_rad
    assert vector[at.GRAVITY] == 9.81
    assert len(vector) == at.LEGS + 3 * at.LEG_STRIDE


@pytest.mark.parametrize("n_legs", [2, 3, 6])
def test_rest_feet_are_evenly_spaced_below_the_body(n_legs):
    feet = HopperParameters(n_legs=n_legs).rest_feet()
    np.testing.assert_allclose(feet[:, :2].sum(axis=0), 0, atol=1e-15)
    np.testing.assert_allclose(np.hypot(feet[:, 0], feet[:, 1]), 0.38)
    np.testing.assert_allclose(feet[:, 2], -0.27)
    neighbours = np.linalg.norm(feet - np.roll(feet, 1, axis=0), axis=1)
    np.testing.assert_allclose(neighbours, neighbours[0])


def test_preloads_go_to_their_legs():
    vector = HopperParameters().vector(np.array([20.0, 21.0, 22.0]))
    np.testing.assert_array_equal(vector[at.LEGS :: at.LEG_STRIDE], [20, 21, 22])


def test_the_default_hopper_can_lift_off_and_a_weak_one_cannot():
    strong, weak = HopperParameters(), HopperParameters(preload_n=19.0)
    strong.require_take_off("key")
    with pytest.raises(
        ConfigError, match=r"key: .* > 8.83 N, the weight per leg, found 7.75 N"
    ):
        weak.require_take_off("key")
