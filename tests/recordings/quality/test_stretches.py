import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping, with_gap

from hopdata.recordings.quality.repeats import copied_frames
from hopdata.recordings.quality.rests import at_rest
from hopdata.recordings.quality.stretches import marker_gaps, runs
from hopdata.recordings.quality.timing import check_stamps, lasting


@pytest.mark.parametrize(
    ("mask", "expected"),
    [
        ("", []),
        ("0", []),
        ("1", [(0, 1)]),
        ("0110", [(1, 3)]),
        ("1011", [(0, 1), (2, 4)]),
    ],
)
def test_runs(mask, expected):
    found = runs(np.array([c == "1" for c in mask], dtype=bool))
    assert [tuple(run) for run in found] == expected


def test_gaps_are_counted_as_planted():
    _, positions = hopping(1, n_frames=400)
    assert all(
        gaps.count == 0 == gaps.longest for gaps in marker_gaps(positions, MARKERS)
    )
    gappy = with_gap(with_gap(positions, "toe2", 0, 7), "toe2", 390, 400)
    gappy[50, MARKERS.index("toe2"), 1] = np.nan  # one coordinate is enough
    found = dict(zip(MARKERS, marker_gaps(gappy, MARKERS), strict=True))
    toe = found.pop("toe2")
    assert toe.stretches.tolist() == [[0, 7], [50, 51], [390, 400]]
    assert (toe.count, toe.longest, toe.missing, toe.share) == (3, 10, 18, 18 / 400)
    assert not any(gaps.count for gaps in found.values())


def test_a_marker_never_seen():
    (gaps,) = marker_gaps(np.full((5, 1, 3), np.nan), ("m",))
    assert (gaps.count, gaps.longest, gaps.share) == (1, 5, 1.0)


def test_on_a_floor_that_gives_a_foot_rests_where_it_settles():
    t = (
        np.arange(300) / 200.0
    )  # it falls, sinks by 44 mm, and comes back to 0 within 0.2 s
    sunk = -0.16 * np.exp(-t / 0.08) * np.sin(np.pi * np.clip(t / 0.3, 0, 1))
    drop = np.concatenate([np.linspace(0.3, 0.0, 100, endpoint=False), sunk])
    heights = np.tile(drop, 20)[:, None]
    assert heights.min() < -0.03
    settled = np.tile(np.arange(len(drop)) > 200, 20)
    resting = at_rest(heights, 200.0)[:, 0]
    assert resting[settled].mean() > 0.9
    assert not resting[np.tile(np.arange(len(drop)) < 90, 20)].any()


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 2000.0])
def test_regular_stamps_are_without_fault(rate_hz):
    jitter = np.random.default_rng(1).uniform(-0.05, 0.05, 1000) / rate_hz
    timing = check_stamps(np.arange(1000) / rate_hz + jitter)
    assert len(timing.drops) == len(timing.irregular) == len(timing.backward) == 0
    assert timing.rate_hz == pytest.approx(rate_hz, rel=0.05)
    assert timing.jitter_s <= 0.11 / rate_hz


def test_dropped_frames_are_counted_where_they_are():
    time = np.delete(np.arange(1000) / 100.0, [300, 500, 501, 502])
    timing = check_stamps(time)
    assert timing.drops.tolist() == [[299, 1], [498, 3]]
    assert timing.n_dropped == 4
    assert len(timing.irregular) == len(timing.backward) == 0


def test_irregular_stamps_and_those_that_run_back():
    time = np.arange(1000) / 100.0
    time[400:] += 0.004
    time[700] = time[699]
    timing = check_stamps(time)
    assert timing.irregular.tolist() == [399]
    assert timing.backward.tolist() == [699]
    assert timing.drops.tolist() == [[700, 1]]  # the repeated time stamp leaves a gap


def test_a_single_frame_has_no_rate():
    assert np.isnan(check_stamps(np.zeros(1)).rate_hz)


def test_a_clock_that_jitters_loses_no_frames():
    rng = np.random.default_rng(3)
    time = np.arange(32_500) / 250 + 4e-4 * rng.normal(size=32_500).clip(-3, 3)
    steps = 250 * np.diff(time)
    assert (steps > 1.5).sum() > 3
    assert not lasting(steps)[steps > 1.5].any()
    assert len(check_stamps(time).irregular) > 1000
    steps = 250 * np.diff(np.delete(time, [9000, 9001]))
    assert np.flatnonzero(lasting(steps) & (steps > 1.5)).tolist() == [8999]


def test_a_block_that_is_there_twice_is_found_with_its_frames():
    positions = hopping(4, n_frames=900)[1]
    positions[:, 2] = np.nan  # never seen
    positions[100:140] = np.nan  # nothing is seen
    positions[300:340, 0] = positions[300, 0]
    assert len(copied_frames(positions)) == 0
    doubled = np.concatenate([positions[:600], positions[520:]])
    assert copied_frames(doubled).tolist() == [[600, 680, 520]]
