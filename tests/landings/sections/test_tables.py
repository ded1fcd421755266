from functools import cache, partial

import numpy as np
import pytest
from section_fakes import hopper

from hopdata.landings.contacts.find import find_landings
from hopdata.landings.sections.select import select_sections
from hopdata.landings.sections.tables import section_densities, section_frames


@pytest.fixture(scope="module")
def fake():
    return hopper(np.random.default_rng(1))


@pytest.fixture(scope="module")
def landings(fake):
    return {fake.recording.name: find_landings(fake.recording)}


@pytest.fixture(scope="module")
def select(fake, landings):
    return cache(partial(select_sections, [fake.recording], landings=landings))


@pytest.fixture(scope="module")
def sections(select):
    return select()


@pytest.fixture(scope="module")
def table(fake, sections, landings):
    return section_densities([fake.recording], sections, landings, nodes=800)


def curve(table, name):
    rows = table[table.curve == name]
    return rows.height_m.to_numpy(), rows.density_per_m.to_numpy()


def test_every_curve_is_a_density(table):
    assert list(table.columns) == ["curve", "height_m", "density_per_m"]
    assert set(table.curve) == {
        "min_foot",
        "max_foot",
        "body_all",
        "body_given_all_up",
        "body_given_all_down",
        "body_given_some_down",
        "body_given_some_up",
        "top",
        "first_contact",
        "last_contact",
        "lowest",
    }
    for name in table.curve.unique():
        height, density = curve(table, name)
        assert len(height) == 800
        assert density.min() >= 0
        assert np.trapezoid(density, height) == pytest.approx(1.0, abs=2e-3)


def test_a_condition_and_its_complement_make_up_all_frames(fake, table):
    height, whole = curve(table, "body_all")
    centre = np.average(height, weights=whole)
    n_up = (~fake.foot_down).all(axis=1).mean()
    parts = [
        np.average(height, weights=curve(table, name)[1])
        for name in ("body_given_all_up", "body_given_some_down")
    ]
    assert n_up * parts[0] + (1 - n_up) * parts[1] == pytest.approx(centre, abs=2e-3)


def test_the_sections_lie_between_the_densities_of_contacts_and_turns(table, sections):
    for name, height_m, is_above in (
        ("top", sections.pre_height_m, True),
        ("first_contact", sections.pre_height_m, False),
        ("last_contact", sections.post_height_m, True),
        ("lowest", sections.post_height_m, False),
    ):
        height, density = curve(table, name)
        side = height > height_m if is_above else height < height_m
        assert density[side].sum() * (height[1] - height[0]) > 0.95


def test_the_printed_sections_cut_off_the_conditional_densities(fake, select, landings):
    printed = select(rule="printed")
    table = section_densities([fake.recording], printed, landings)
    height, down = curve(table, "body_given_some_down")
    assert down[height > printed.pre_height_m].max() <= 0.02 * down.max()
    assert down[height > printed.pre_height_m - 0.005].max() > 0.02 * down.max()
    height, up = curve(table, "body_given_some_up")
    assert up[height < printed.post_height_m].max() <= 0.02 * up.max()
    assert up[height < printed.post_height_m + 0.005].max() > 0.02 * up.max()


def test_the_ground_modes_stand_out_at_their_place(table, sections):
    for name, mode in (
        ("min_foot", sections.min_foot_mode),
        ("max_foot", sections.max_foot_mode),
    ):
        height, density = curve(table, name)
        assert height[np.argmax(density)] == pytest.approx(mode.height_m, abs=1e-3)


def test_landings_make_the_body_curves(fake, select, landings):
    sections = select(frames="landings")
    table = section_densities([fake.recording], sections, landings, nodes=400)
    whole = section_densities([fake.recording], select(), landings, nodes=400)
    for name in ("min_foot", "max_foot"):
        np.testing.assert_array_equal(curve(table, name)[0], curve(whole, name)[0])
    assert not np.array_equal(curve(table, "body_all")[1], curve(whole, "body_all")[1])


def test_frames_are_thinned_evenly_and_hold_no_gaps():
    fake = hopper(np.random.default_rng(1))
    fake.recording.positions[100:200, 3] = np.nan
    sections = select_sections([fake.recording])
    full = section_frames([fake.recording], sections)
    assert list(full.columns) == ["min_foot_m", "max_foot_m", "body_m", "landing"]
    falls = full[full["landing"]]["body_m"].diff()
    assert 0.2 < full["landing"].mean() < 0.8
    assert (falls < 0).mean() > 0.8  # except for jumps between landings
    assert len(full) == -(-(len(fake.recording.time) - 100) // 2)
    few = section_frames([fake.recording, fake.recording], sections, max_rows=500)
    assert 400 < len(few) <= 500
    assert not few.isna().any().any()
    assert (few.min_foot_m <= few.max_foot_m).all()
