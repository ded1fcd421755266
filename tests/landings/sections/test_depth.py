"""The depth of the post section: state errors of a shallow one against a deep one that grazes."""

import numpy as np
import pytest
from section_fakes import hopper

from hopdata.landings.contacts.find import find_landings
from hopdata.landings.sections.depth import (
    choose_depth,
    landing_misfits,
    shallowest_as_good,
)
from hopdata.landings.sections.from_landings import (
    heights_from_landings,
    landing_heights,
)
from hopdata.landings.sections.select import select_sections
from hopdata.landings.states.crossing import SectionStates

SHAPE = 0.1 * np.array([[1.0, 0, 0], [-0.5, 0.9, 0], [-0.5, -0.9, 0.1]])


def states(tilt, velocity, spin, rng, noise=0.0):
    """Return states of three markers on a body that hardly turns, with noise of m/s."""
    turn = np.column_stack([tilt, np.zeros(len(tilt))])
    position = SHAPE + np.cross(turn[:, None], SHAPE)
    speed = velocity[:, None] + np.cross(spin[:, None], SHAPE)
    speed = speed + noise * rng.standard_normal(speed.shape)
    none = np.zeros((*position.shape, 3))
    zero = np.zeros(len(tilt))
    return SectionStates(
        time=zero,
        position=position,
        velocity=speed,
        position_covariance=none,
        velocity_covariance=none,
        time_se=zero,
    )


def made_landings(n, rng):
    """Return states before, and how velocity and spin follow from them."""
    tilt, velocity, spin = (rng.standard_normal((n, k)) for k in (2, 3, 3))
    before = states(0.03 * tilt, 0.1 * velocity - [0, 0, 1.5], 0.3 * spin, rng)
    after = 0.1 * velocity + 0.05 * tilt[:, :1] * [1, 0, 1] - [0, 0, 1.2]
    return before, (0.03 * tilt[:, ::-1], after, 0.2 * spin)


def test_the_misfit_is_what_the_state_before_does_not_foretell():
    rng = np.random.default_rng(1)
    before, (tilt, velocity, spin) = made_landings(300, rng)
    after = [states(tilt, velocity, spin, rng, noise) for noise in (0.02, 0.01, 0.0)]
    misfits = landing_misfits(before, after)
    assert misfits.shape == (300, 3)
    usual = np.exp(np.log(misfits).mean(axis=0))
    assert usual[0] == pytest.approx(4 * usual[1], rel=0.15), "squares of the noise"
    assert usual[2] < 0.05 * usual[1], "a smooth map is foretold but for its curvature"


def test_one_landing_that_follows_no_map_changes_no_other():
    rng = np.random.default_rng(2)
    before, motion = made_landings(300, rng)
    noise = np.random.default_rng(3)
    usual = landing_misfits(before, [states(*motion, noise, 0.01)])[:, 0]
    motion[1][7] += 5.0
    noise = np.random.default_rng(3)
    found = landing_misfits(before, [states(*motion, noise, 0.01)])[:, 0]
    assert found[7] > 1000 * usual[7]
    others = np.delete(found, 7)
    np.testing.assert_allclose(others, np.delete(usual, 7), rtol=0.5)
    assert np.median(others / np.delete(usual, 7)) == pytest.approx(1.0, abs=0.02)


def test_few_landings_tell_no_depth():
    rng = np.random.default_rng(4)
    before, motion = made_landings(17, rng)
    assert landing_misfits(before, [states(*motion, rng, 0.01)]) is None
    before, motion = made_landings(18, rng)
    assert landing_misfits(before, [states(*motion, rng, 0.01)]).shape == (18, 1)


def test_the_shallowest_that_is_as_good_as_the_best_is_taken():
    noise = np.random.default_rng(5).standard_normal((400, 1))
    falling, level = np.array([0.5, 0.2, 0.0]), np.zeros(3)
    scatter = 0.1 * np.random.default_rng(6).standard_normal((400, 3))
    assert shallowest_as_good(noise + falling[::-1]) == 0.0
    assert shallowest_as_good(noise + scatter + level) < 0.3
    deep = shallowest_as_good(noise + scatter + falling)
    assert 0.9 < deep <= 1.0
    middle = shallowest_as_good(noise + scatter + np.array([0.3, 0.0, 0.3]))
    assert 0.4 < middle < 0.5
    unsure = 3.0 * np.random.default_rng(7).standard_normal((400, 3))
    assert shallowest_as_good(unsure + falling) < deep - 0.1


@pytest.fixture(scope="module")
def made():
    recording = hopper(np.random.default_rng(1), hops=120, tilt_rad=0.02).recording
    return recording, find_landings(recording)


def test_no_landing_and_no_room_leave_the_section_shallow(made):
    recording, table = made
    held = heights_from_landings(landing_heights(recording, table))
    places = {"pre_m": held.pre_m, "shallow_m": held.shallow_m}
    none = choose_depth([recording], [table[:0]], **places, deep_m=held.deep_m)
    assert (none.share, none.misfit, none.n_landings) == (0.0, (), 0)
    flat = choose_depth([recording], [table], **places, deep_m=held.shallow_m)
    assert (flat.share, flat.misfit) == (0.0, ())


def test_where_no_frame_is_short_of_contacts_the_deeper_state_is_surer(made):
    """The body of this hopper does what its feet do not tell, so only noise decides."""
    recording, table = made
    held = heights_from_landings(landing_heights(recording, table))
    places = {
        "pre_m": held.pre_m,
        "shallow_m": held.shallow_m,
        "deep_m": held.deep_m,
    }
    found = choose_depth([recording], [table], **places)
    assert 90 < found.n_landings <= 120
    assert len(found.misfit) == 3
    assert 0.0 <= found.share <= 1.0
    assert found == choose_depth([recording], [table], **places)


def test_the_states_of_the_study_decide(made):
    """Fits as the study does not make them would have errors that it does not have."""
    recording, table = made
    held = heights_from_landings(landing_heights(recording, table))
    places = {
        "pre_m": held.pre_m,
        "shallow_m": held.shallow_m,
        "deep_m": held.deep_m,
    }
    usual = choose_depth([recording], [table], **places)
    options = {"method": "split_fit", "window_s": None, "gravity": "auto"}
    named = choose_depth([recording], [table], **places, states=options)
    other = {"method": "savitzky_golay"}
    rough = choose_depth([recording], [table], **places, states=other)
    assert named == usual
    # A cubic over seven frames leaves velocities less sure at every depth.
    assert all(a > b for a, b in zip(rough.misfit, usual.misfit, strict=True))
    selected = select_sections(
        [recording], landings={recording.name: table}, states=other
    )
    assert selected.depth["misfit"] == list(rough.misfit)
