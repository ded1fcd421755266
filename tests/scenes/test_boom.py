import numpy as np
import pytest

from hopdata.scenes.boom import boom_motion, counterweight_places
from hopdata.scenes.hopper_parameters import HopperParameters

SWINGING = HopperParameters(boom_swing_rad=1.1, boom_duration_s=0.3)


def test_boom_moves_by_its_swing_and_its_rates_are_its_derivatives():
    p, step = SWINGING.vector(), 1e-5
    for t in (-0.1, 0.05, 0.17, 0.29, 0.5):
        place, speed, acceleration = (np.array(v) for v in boom_motion.py_func(t, p))
        before, after = (np.array(boom_motion.py_func(t + s * step, p)[0]) for s in (-1, 1))
        np.testing.assert_allclose((after - before) / (2 * step), speed, atol=1e-8)
        np.testing.assert_allclose((after - 2 * place + before) / step**2, acceleration, atol=1e-4)
    angles = [
        np.arctan2(place[1], place[0] - SWINGING.boom_offset_m)
        for place in (boom_motion.py_func(t, p)[0] for t in (0.0, 0.3))
    ]
    assert (angles[1] - angles[0]) % (2 * np.pi) == pytest.approx(1.1)


def test_neutral_boom_holds_the_counterweight_on_the_body_axis():
    place, speed, acceleration = boom_motion.py_func(0.1, HopperParameters().vector())
    assert place == pytest.approx((0.0, 0.0, -0.03), abs=1e-15)
    assert speed == acceleration == (0.0, 0.0, 0.0)


def test_places_at_many_times_are_those_at_each():
    p, times = SWINGING.vector(), np.linspace(-0.1, 0.5, 7)
    single = [boom_motion.py_func(t, p)[0] for t in times]
    np.testing.assert_allclose(counterweight_places(times, p), single, rtol=1e-15)
