from dataclasses import replace

import numpy as np
import pytest
from section_fakes import hopper

from hopdata.landings.section_tables import section_densities, section_frames
from hopdata.landings.sections import select_sections


@pytest.fixture(scope="module")
def fake():
    return hopper(np.random.default_rng(1))


@pytest.fixture(scope="module")
def sections(fake):
    return select_sections([fake.recording])


@pytest.fixture(scope="module")
def table(fake, sections):
    return section_densities([fake.recording], sections, nodes=800)


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
    }
    for name in table.curve.unique():
        height, density = curve(table, name)
        assert len(height) == 800
        assert density.min() >= 0
        assert np.trapezoid(density, height) == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("noise_m", [0.0, 1e-4])
def test_heights_in_whole_millimetres_have_sections_and_curves(noise_m):
    fine = hopper(np.random.default_rng(2), noise_m=noise_m).recording
    coarse = replace(fine, positions=np.round(fine.positions + 0.0004, 3))  # 0 or 1 mm, in stance
    expected, found = select_sections([fine]), select_sections([coarse])
    assert found.post_height_m == pytest.approx(expected.post_height_m, abs=0.01)
    assert found.pre_height_m == pytest.approx(expected.pre_height_m, abs=0.01)
    assert np.isfinite(section_densities([coarse], found)["density_per_m"]).all()


def test_a_condition_and_its_complement_make_up_all_frames(fake, table):
    height, whole = curve(table, "body_all")
    centre = np.average(height, weights=whole)
    n_up = (~fake.foot_down).all(axis=1).mean()
    parts = [
        np.average(height, weights=curve(table, name)[1])
        for name in ("body_given_all_up", "body_given_some_down")
    ]
    assert n_up * parts[0] + (1 - n_up) * parts[1] == pytest.approx(centre, abs=2e-3)


def test_the_sections_cut_off_the_conditional_densities(table, sections):
    height, down = curve(table, "body_given_some_down")
    step = height[1] - height[0]
    assert down[height > sections.pre_height_m + 0.02].sum() * step < 0.005
    height, up = curve(table, "body_given_some_up")
    assert up[height < sections.post_height_m - 0.02].sum() * step < 0.005


def test_the_ground_modes_stand_out_at_their_place(table, sections):
    for name, mode in (
        ("min_foot", sections.min_foot_mode),
        ("max_foot", sections.max_foot_mode),
    ):
        height, density = curve(table, name)
        assert height[np.argmax(density)] == pytest.approx(mode.height_m, abs=1e-3)


def test_landings_make_the_body_curves(fake):
    sections = select_sections([fake.recording], frames="landings")
    table = section_densities([fake.recording], sections, nodes=400)
    whole = section_densities([fake.recording], select_sections([fake.recording]), nodes=400)
    for name in ("min_foot", "max_foot"):
        np.testing.assert_array_equal(curve(table, name)[0], curve(whole, name)[0])
    assert not np.array_equal(curve(table, "body_all")[1], curve(whole, "body_all")[1])


def test_frames_are_thinned_evenly_and_hold_no_gaps():
    fake = hopper(np.random.default_rng(1))
    fake.recording.positions[100:200, 3] = np.nan
    full = section_frames([fake.recording])
    assert list(full.columns) == ["min_foot_m", "max_foot_m", "body_m"]
    assert len(full) == -(-(len(fake.recording.time) - 100) // 2)
    few = section_frames([fake.recording, fake.recording], max_rows=500)
    assert 400 < len(few) <= 500
    assert not few.isna().any().any()
    assert (few.min_foot_m <= few.max_foot_m).all()
