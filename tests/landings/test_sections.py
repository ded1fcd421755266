import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from section_fakes import hopper, true_sections

from hopdata.errors import AnalysisError
from hopdata.landings.contact_frames import descents, landing_frames
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.sections import Sections, select_sections
from hopdata.recordings.hdf5 import read_recording, read_truth

SAMPLE = Path(__file__).parents[2] / "data" / "sample" / "hopper.h5"
BANDWIDTHS = (1e-4, 2e-4, 4e-4, 8e-4, 1.6e-3, 2.46e-3)
TAIL = 0.01


@pytest.fixture(scope="module")
def fake():
    return hopper(np.random.default_rng(1))


@pytest.fixture(scope="module")
def sample():
    recording = read_recording(SAMPLE)
    return level(recording, fit_floor(recording)), read_truth(SAMPLE)


def errors_m(seeds, **options):
    out = []
    for seed in seeds:
        fake = hopper(np.random.default_rng(seed), **options)
        found = select_sections([fake.recording], tail_fraction=TAIL)
        pre, post = true_sections(fake, TAIL)
        out.append((found.pre_height_m - pre, found.post_height_m - post))
    return np.array(out)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"extension_m": 0.0},
        {"rate_hz": 400.0, "hops": 100},
        {"feet": 2},
        {"feet": 6},
        {"noise_m": 0.0002},
    ],
)
def test_bias_against_truth_is_half_a_threshold_at_most(options):
    errors = errors_m(range(8), **options)
    assert np.abs(errors.mean(axis=0)).max() < 0.5 * 0.0018 + 0.0003
    assert np.abs(errors).max() < 4e-3


@pytest.mark.parametrize("tail", [0.001, 0.01])
def test_sample_within_2_mm_of_its_truth(sample, tail):
    recording, truth = sample
    found = select_sections([recording], tail_fraction=tail)
    down = truth.foot_down
    pre = np.quantile(truth.body_height[down.any(axis=1)], 1 - tail)
    post = np.quantile(truth.body_height[~down.all(axis=1)], tail)
    assert found.pre_height_m == pytest.approx(pre, abs=0.002)
    assert found.post_height_m == pytest.approx(post, abs=0.002)
    assert found.pre_height_m - found.post_height_m > 0.140


def test_a_bare_threshold_would_miss_by_centimetres(sample):
    recording, truth = sample
    found = select_sections([recording])
    highest = recording.feet[:, :, 2].max(axis=1)
    bare = np.quantile(recording.body_height[highest > found.max_foot_threshold_m], 0.001)
    post = np.quantile(truth.body_height[~truth.foot_down.all(axis=1)], 0.001)
    assert abs(bare - post) > 0.02


def test_sections_do_not_depend_on_the_bandwidth(sample, fake):
    for recording in (sample[0], fake.recording):
        found = [
            select_sections([recording], bandwidth_m=width, tail_fraction=TAIL)
            for width in BANDWIDTHS
        ]
        assert np.ptp([s.pre_height_m for s in found]) < 5e-4
        assert np.ptp([s.post_height_m for s in found]) < 5e-4


def test_halves_of_the_data_agree(sample):
    recording, _ = sample
    n = len(recording.time)
    halves = [
        select_sections(
            [replace(recording, time=recording.time[part], positions=recording.positions[part])],
            tail_fraction=TAIL,
        )
        for part in (slice(0, n // 2), slice(n // 2, n))
    ]
    assert halves[0].pre_height_m == pytest.approx(halves[1].pre_height_m, abs=0.005)
    assert halves[0].post_height_m == pytest.approx(halves[1].post_height_m, abs=0.005)
    assert halves[0].min_foot_threshold_m == pytest.approx(halves[1].min_foot_threshold_m, abs=1e-4)


def test_two_recordings_are_pooled(fake):
    n = len(fake.recording.time) // 2
    parts = [
        replace(fake.recording, time=fake.recording.time[p], positions=fake.recording.positions[p])
        for p in (slice(0, n), slice(n, None))
    ]
    whole, pooled = select_sections([fake.recording]), select_sections(parts)
    assert pooled.n_frames == whole.n_frames
    assert pooled.pre_height_m == pytest.approx(whole.pre_height_m, abs=1e-4)
    assert pooled.post_height_m == pytest.approx(whole.post_height_m, abs=1e-4)
    assert select_sections(parts[:1]).n_frames == n


def test_thresholds_are_the_knees_of_the_ground_modes(fake):
    found = select_sections([fake.recording], threshold_sigmas=4.0)
    assert found.min_foot_threshold_m == found.min_foot_mode.knee(4.0)
    assert found.max_foot_threshold_m == found.max_foot_mode.knee(4.0)
    assert found.min_foot_mode.height_m < found.ground_m < found.max_foot_mode.height_m
    assert found.ground_m == pytest.approx(0.0, abs=1e-4)
    assert set(found.decided.values()) == {"data"}


def test_gaps_are_left_out(fake):
    rng = np.random.default_rng(2)
    positions = fake.recording.positions.copy()
    hidden = rng.uniform(size=positions.shape[:2]) < 0.02
    positions[hidden] = np.nan
    found = select_sections([replace(fake.recording, positions=positions)], tail_fraction=TAIL)
    whole = select_sections([fake.recording], tail_fraction=TAIL)
    assert found.n_frames == int((~hidden.any(axis=1)).sum())
    assert found.pre_height_m == pytest.approx(whole.pre_height_m, abs=0.002)
    assert found.post_height_m == pytest.approx(whole.post_height_m, abs=0.002)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("pre_height_m", 0.52),
        ("post_height_m", 0.35),
        ("min_foot_threshold_m", 0.004),
        ("max_foot_threshold_m", 0.005),
    ],
)
def test_each_height_can_be_given(fake, name, value):
    free = select_sections([fake.recording])
    found = select_sections([fake.recording], **{name: value})
    assert getattr(found, name) == value
    assert [k for k, how in found.decided.items() if how == "config"] == [name]
    others = [k for k in found.decided if k != name and not k.endswith("height_m")]
    for other in others:
        assert getattr(found, other) == getattr(free, other)


def test_a_given_threshold_is_taken_at_its_word(fake):
    found = select_sections([fake.recording], min_foot_threshold_m=0.02, tail_fraction=TAIL)
    lowest = fake.recording.feet[:, :, 2].min(axis=1)
    expected = np.quantile(fake.recording.body_height[lowest <= 0.02], 1 - TAIL)
    assert found.pre_height_m == pytest.approx(expected, abs=1e-3)


def test_landings_use_only_the_descents_to_the_ground(fake):
    found = select_sections([fake.recording], frames="landings", tail_fraction=TAIL)
    every = select_sections([fake.recording], tail_fraction=TAIL)
    up, down = (~fake.foot_down).all(axis=1), fake.foot_down.all(axis=1)
    inside, landed = landing_frames(fake.body_height, up, down)
    pre = np.quantile(fake.body_height[inside & ~up], 1 - TAIL)
    post = np.quantile(fake.body_height[inside & ~landed], TAIL)
    assert found.pre_height_m == pytest.approx(pre, abs=0.002)
    assert found.post_height_m == pytest.approx(post, abs=0.002)
    assert found.n_used == pytest.approx(inside.sum(), rel=0.05)
    assert found.pre_height_m < every.pre_height_m - 0.05  # no lift-off with its long legs


def test_landings_see_past_feet_that_are_not_followed():
    fake = hopper(np.random.default_rng(3), extension_m=0.0)
    apexes = [apex for apex, _ in descents(fake.body_height)]
    positions = fake.recording.positions.copy()
    for begin, end in zip(apexes[1::2], apexes[2::2], strict=False):
        positions[begin:end, 3:, 2] = 0.15 + 0.02 * np.sin(np.arange(end - begin))[:, None]
    walker = replace(fake.recording, positions=positions)
    alone = select_sections([fake.recording], frames="landings", tail_fraction=TAIL)
    found = select_sections([walker], frames="landings", tail_fraction=TAIL)
    assert found.n_used < 0.6 * alone.n_used
    assert found.post_height_m == pytest.approx(alone.post_height_m, abs=0.004)
    assert found.pre_height_m == pytest.approx(alone.pre_height_m, abs=0.004)
    every = select_sections([walker], tail_fraction=TAIL)
    assert every.post_height_m < found.post_height_m - 0.1  # the body sinks onto other feet


def test_feet_that_never_leave_the_ground(fake):
    positions = fake.recording.positions.copy()
    positions[:, 3:, 2] = 0.0006 * np.random.default_rng(4).normal(size=(len(positions), 3))
    standing = replace(fake.recording, positions=positions)
    with pytest.raises(AnalysisError, match=r"never leave the ground together.*min_foot_thr"):
        select_sections([standing])
    with pytest.raises(AnalysisError, match="go from all up to all down, found none"):
        select_sections([standing], frames="landings")
    given = select_sections([standing], pre_height_m=0.5, post_height_m=0.4)
    assert (given.pre_height_m, given.post_height_m) == (0.5, 0.4)


def test_the_pre_section_must_be_above_the_post_section(fake):
    with pytest.raises(AnalysisError, match=r"set sections\.pre_height_m and sections\.post_h"):
        select_sections([fake.recording], pre_height_m=0.3, post_height_m=0.4)


@pytest.mark.parametrize(
    "options",
    [{"tail_fraction": -0.1}, {"tail_fraction": 0.5}, {"threshold_sigmas": 0}],
)
def test_options_out_of_range(fake, options):
    with pytest.raises(ValueError, match=f"{next(iter(options))}: expected"):
        select_sections([fake.recording], **options)
    with pytest.raises(ValueError, match="recordings: expected"):
        select_sections([])


def test_goes_through_json(fake):
    found = select_sections([fake.recording], pre_height_m=0.55)
    assert Sections.from_dict(json.loads(json.dumps(found.to_dict()))) == found


@pytest.mark.parametrize(
    ("name", "value"), [("min_foot_threshold_m", -1.0), ("max_foot_threshold_m", 5.0)]
)
def test_a_threshold_beyond_all_frames_is_told(fake, name, value):
    with pytest.raises(AnalysisError, match=f"{name}: expected a height that divides the frames"):
        select_sections([fake.recording], **{name: value})


def test_a_bandwidth_finer_than_any_camera_still_works(fake):
    usual = select_sections([fake.recording])
    finest = select_sections([fake.recording], bandwidth_m=1e-12)
    assert finest.pre_height_m == pytest.approx(usual.pre_height_m, abs=5e-4)
