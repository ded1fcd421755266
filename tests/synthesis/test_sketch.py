"""The points and forces of a drawing are those of the scene."""

import numpy as np
import pytest

from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis import sketch
from hopdata.synthesis.trial import MarkerOptions

HOPPER = HopperParameters(boom_angle_rad=2.0, boom_radius_m=0.2, boom_offset_m=0.22)


def points(table, kind):
    return table.loc[table["kind"] == kind, sketch.POINT].to_numpy()


def test_feet_markers_and_counterweight_are_those_of_the_scene():
    markers = MarkerOptions(boom_m=(0.0, 0.0, 0.05))
    table = sketch.hopper_sketch(HOPPER, markers)
    np.testing.assert_array_equal(points(table, sketch.FOOT), HOPPER.rest_feet())
    np.testing.assert_array_equal(points(table, sketch.BODY_MARKER), markers.body_m)
    weight = points(table, sketch.COUNTERWEIGHT)
    np.testing.assert_array_equal(weight, HOPPER.boom_places(np.zeros(1)))
    boom = points(table, sketch.BOOM_MARKER)
    np.testing.assert_allclose(boom - weight, [[0.0, 0.0, 0.05]], atol=1e-15)


def test_the_circle_is_the_counterweights_and_a_swing_reaches_its_share_of_it():
    table = sketch.hopper_sketch(HOPPER, swing_limit_rad=0.7)
    centre = points(table, sketch.BOOM_CENTRE)
    circle = points(table, sketch.CIRCLE)
    reached = points(table, sketch.REACHED)
    for line in (circle, reached, points(table, sketch.COUNTERWEIGHT)):
        np.testing.assert_allclose(np.linalg.norm(line - centre, axis=1), 0.2)
    angle = np.arctan2(*(reached - centre)[:, 1::-1].T)
    np.testing.assert_allclose(angle[[0, -1]], [1.3, 2.7])
    without = sketch.hopper_sketch(HOPPER)
    assert not len(points(without, sketch.REACHED))


def test_the_force_jumps_to_the_preload_and_is_affine():
    forces = sketch.leg_forces(HOPPER)
    flight, landing, push_off = (
        forces[forces["phase"] == phase] for phase in ("flight", "landing", "push-off")
    )
    assert (flight["force_n"] == 0).all()
    assert landing["force_n"].iloc[0] == pytest.approx(HOPPER.preload_n)
    for phase in (landing, push_off):
        expected = HOPPER.preload_n - HOPPER.stiffness_n_m * phase["gap_m"]
        np.testing.assert_allclose(phase["force_n"], expected)
    assert push_off["gap_m"].iloc[-1] == HOPPER.release_extension_m


def test_the_force_is_the_one_that_the_integrated_hopper_feels():
    """At its first touchdown the level hopper is pushed up by three preloads."""
    from hopdata.synthesis.hops import fly_hop, level_state

    hopper = HopperParameters()
    times = np.linspace(0.15, 0.3, 1501)
    hop = fly_hop(hopper, level_state(hopper, 0.2), frame_times_s=times)
    climb = hop.states[:, 8]
    rate = np.gradient(climb, times)
    touchdown = hop.event_time[0]
    before = rate[times < touchdown - 3e-4][-1]
    after = rate[times > touchdown + 3e-4][0]
    jump_n = hopper.total_mass_kg * (after - before)
    # Damping adds to the preload, in proportion to the speed of the landing.
    speed = -climb[times > touchdown][0]
    expected = hopper.n_legs * (hopper.preload_n + hopper.damping_n_s_m * speed)
    assert jump_n == pytest.approx(expected, rel=0.02)
