"""Planted faults are found with their frames, and clean recordings show none."""

import tracemalloc
from dataclasses import replace
from time import process_time

import numpy as np
import pytest
from made_up_hopper import (
    MARKERS,
    hopping,
    with_frozen,
    with_gap,
    with_spike,
    with_swap,
)

from hopdata.errors import RecordingError
from hopdata.inspecting.listing import listing
from hopdata.recording import Recording
from hopdata.recordings.quality.inspection import (
    inspect_recording,
    recording_tables,
)
from hopdata.recordings.quality.repeats import straight_stretches
from hopdata.recordings.quality.roles import guess_roles
from hopdata.recordings.quality.timing import lost_frames
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.readers.hdf5 import read_recording, write_recording


def faults(positions, rate_hz=100.0):
    time = np.arange(len(positions)) / rate_hz
    return inspect_recording(
        RawRecording(MARKERS, time, positions, rate_hz, "m")
    ).faults


def gappy(positions, seed, *, each=5, longest=40):
    rng = np.random.default_rng(seed)
    for marker in MARKERS:
        for start in rng.integers(0, len(positions) - longest, each):
            positions = with_gap(
                positions, marker, start, start + rng.integers(1, longest)
            )
    return positions


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("rate_hz", "noise_m"), [(50, 1e-3), (100, 6e-4), (300, 3e-4)])
def test_a_clean_recording_shows_none_with_gaps_or_without(seed, rate_hz, noise_m):
    _, positions = hopping(seed, rate_hz=rate_hz, noise_m=noise_m)
    assert faults(positions, rate_hz).count == 0
    assert faults(gappy(positions, seed), rate_hz).count == 0


def test_the_sample_shows_none(sample_path):
    from hopdata.recordings.readers.formats import read_raw

    assert inspect_recording(read_raw(sample_path)).n_problems == 0


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("length", [1, 2, 3, 10, 200])
def test_a_swap_is_found_with_markers_and_frames(seed, length):
    rng = np.random.default_rng(seed)
    one, other = rng.choice(MARKERS[:6], 2, replace=False)
    start = int(rng.integers(100, 1500))
    found = faults(with_swap(hopping(10 + seed)[1], one, other, start, start + length))
    assert found.count == 1
    (swap,) = found.swaps
    assert set(swap.markers) == {one, other}
    assert (swap.start, swap.stop) == (start, start + length)
    assert "continuity" in swap.found_by


@pytest.mark.parametrize(
    ("pair", "gap"),
    [
        (("hip1", "hip2"), 5),
        (("hip1", "hip2"), 70),
        (("hip1", "toe1"), 5),
        (("hip1", "toe1"), 70),
        (("toe2", "toe3"), 5),
    ],
)
def test_a_swap_that_begins_and_ends_in_gaps(pair, gap):
    """After a long gap, only the distances of a rigid cluster can reveal it."""
    start, stop = 700, 1000
    positions = with_swap(hopping(3)[1], *pair, start, stop)
    for end in (start, stop):
        for marker in pair:
            positions = with_gap(positions, marker, end - gap, end)
    found = faults(positions)
    assert found.count == 1
    (swap,) = found.swaps
    assert set(swap.markers) == set(pair)
    assert swap.start == start
    assert stop - gap <= swap.stop <= stop
    assert ("continuity" in swap.found_by) == (gap == 5)


def test_a_swap_inside_a_rigid_cluster_is_seen_by_both_tests():
    (swap,) = faults(with_swap(hopping(3)[1], "hip1", "hip2", 500, 600)).swaps
    assert swap.found_by == ("continuity", "pair distances")


def test_names_that_never_come_back():
    found = faults(with_swap(hopping(4)[1], "toe1", "toe2", 1500, 2000))
    (swap,) = found.swaps
    assert (swap.start, swap.stop) == (1500, None)
    assert found.count == 1


def test_three_names_that_go_round():
    positions = hopping(5)[1]
    feet = [MARKERS.index(f"toe{i}") for i in (1, 2, 3)]
    turned = positions.copy()
    turned[800:900, feet] = positions[800:900][:, [feet[1], feet[2], feet[0]]]
    found = faults(turned)
    (swap,) = found.swaps
    assert set(swap.markers) == {"toe1", "toe2", "toe3"}
    assert (swap.start, swap.stop) == (800, 900)
    assert found.count == 1


@pytest.mark.parametrize("n_frames", [1, 2, 3])
@pytest.mark.parametrize("marker", ["hip2", "toe1", "post"])
def test_a_spike_is_found_and_nothing_else(marker, n_frames):
    found = faults(with_spike(hopping(6)[1], marker, 777, 0.05, n_frames=n_frames))
    (spike,) = found.spikes
    assert (MARKERS[spike.marker], spike.start, spike.stop) == (
        marker,
        777,
        777 + n_frames,
    )
    assert spike.size == pytest.approx(0.05, rel=0.4 if n_frames == 1 else 1.4)
    assert found.count == 1


def test_a_short_stance_between_two_bounces_is_no_spike():
    positions = hopping(6)[1]
    fall = 0.1 * np.abs(np.arange(-20, 21) / 10)
    bounce = np.maximum(fall - 0.02, 0.0)  # stands for three to five frames
    toe = MARKERS.index("toe1")
    bounce += np.median(positions[:, toe, 2])
    stands = int(np.argmin(positions[500:600, toe, 2])) + 500
    bounced = positions.copy()
    bounced[stands - 20 : stands + 21, toe, 2] = bounce
    raw = RawRecording(MARKERS, np.arange(2000) / 100.0, bounced, 100.0, "m")
    assert not [s for s in inspect_recording(raw).faults.spikes if s.marker == toe]
    bounced[stands - 1 : stands + 2, toe, 0] += 0.06
    bounced[stands - 1 : stands + 2, toe, 2] += 0.06
    raw = RawRecording(MARKERS, np.arange(2000) / 100.0, bounced, 100.0, "m")
    assert [s for s in inspect_recording(raw).faults.spikes if s.marker == toe]


def test_a_doubled_block_is_one_fault_and_no_jumps():
    positions = hopping(7)[1]
    doubled = np.concatenate([positions[:600], positions[480:]])
    found = faults(doubled)
    assert (found.copies, found.jumps, found.count) == (((600, 720, 480),), (), 1)


def test_a_clock_that_jitters_is_one_line_with_what_to_do():
    time, positions = hopping(8)
    time = time + 1.5e-3 * np.random.default_rng(0).normal(size=len(time))
    inspection = inspect_recording(
        RawRecording(MARKERS, np.sort(time), positions, 100.0, "m")
    )
    (one,) = inspection.suspects()
    assert (one.kind, inspection.n_problems) == ("jitter", 1)
    assert "give input.rate_hz" in one.text


def test_a_jump_is_no_spike():
    positions = hopping(7)[1]
    positions[900:, MARKERS.index("hip3")] += [0.04, 0.0, 0.03]
    found = faults(positions)
    (jump,) = found.jumps
    assert (MARKERS[jump.marker], jump.start) == ("hip3", 900)
    assert jump.size == pytest.approx(0.05, rel=0.3)
    assert found.count == 1


@pytest.mark.parametrize("marker", ["hip1", "toe3", "post"])
def test_a_frozen_marker_is_found_with_its_frames(marker):
    found = faults(with_frozen(hopping(8)[1], marker, 1200, 1215))
    (frozen,) = found.frozen
    assert (frozen.marker, frozen.start, frozen.stop) == (marker, 1200, 1215)
    assert found.count == 1


def test_gaps_that_were_filled_with_the_last_position_are_all_frozen():
    positions = hopping(8)[1]
    for start in range(100, 1900, 60):
        positions = with_frozen(positions, "hip1", start, start + 10)
    found = faults(positions)
    assert len(found.frozen) == found.count == 29  # one lies where it hardly moves


def test_frames_that_are_held_are_told_one_by_one():
    positions = hopping(9)[1]
    often = np.ones(len(positions), dtype=np.int64)
    often[100::100] = 2
    often[300] = 3
    held = np.repeat(positions, often, axis=0)
    inspection = inspect_recording(
        RawRecording(MARKERS, np.arange(len(held)) / 100, held, 100.0, "m")
    )
    told = [one.text for one in inspection.suspects() if one.kind == "copy"]
    assert (len(told), told[0]) == (
        19,
        "frame 101 stands here 2 times, and counts once: the others are unseen",
    )
    assert told[2].startswith("frame 303 stands here 3 times")
    assert (
        faults(np.repeat(positions, 2, axis=0)).copies == ()
    )  # the file was made in this way


def test_repeats_by_rounding_are_no_frozen_marker():
    """In a file of whole millimetres, a resting foot repeats its position again and again."""
    positions = np.round(hopping(9, noise_m=2e-4)[1], 3)
    repeats = np.all(np.diff(positions[:, MARKERS.index("toe1")], axis=0) == 0, axis=1)
    assert repeats.sum() > 200
    assert faults(positions).frozen == ()
    coarse = with_frozen(positions, "hip1", 500, 530)
    assert [f.marker for f in faults(coarse).frozen] == ["hip1"]


def test_dropped_frames_are_no_jumps():
    time, positions = hopping(11)
    kept = np.delete(np.arange(len(time)), slice(1000, 1010))
    raw = RawRecording(MARKERS, time[kept], positions[kept], 100.0, "m")
    inspection = inspect_recording(raw)
    assert inspection.faults.count == 0
    assert inspection.timing.n_dropped == 10
    assert inspection.n_problems == 1


@pytest.mark.parametrize("seed", range(5))
def test_frames_that_no_time_stamp_misses_are_told_with_their_number(seed):
    positions = hopping(20 + seed)[1]
    after, lost = np.arange(104, 1900, 90), 1 + np.arange(20) % 4
    gone = np.concatenate(
        [np.arange(k + 1, k + 1 + n) for k, n in zip(after, lost, strict=True)]
    )
    after = after - np.cumsum(lost) + lost
    less = np.delete(positions, gone, axis=0)
    inspection = inspect_recording(
        RawRecording(MARKERS, np.arange(len(less)) / 100, less, 100.0, "m")
    )
    found = dict(inspection.timing.drops.tolist())
    assert set(found) <= set(after.tolist())
    assert len(found) >= 10  # of 20; at the top of a hop nothing moves
    off = np.array(
        [found.get(k, n) - n for k, n in zip(after.tolist(), lost, strict=True)]
    )
    assert np.abs(off).max() <= 3
    assert np.count_nonzero(off) <= 6
    assert {one.kind for one in inspection.suspects()} == {"dropped"}
    (told,) = inspection.lost
    assert told.code == "recordings.lost"
    assert str(told).startswith(
        f"about {sum(found.values())} frames may be missing in {len(found)} places"
    )
    assert str(told) in listing(inspection, "file").replace("\n" + " " * 10, "")


@pytest.mark.parametrize("rate_hz", [30, 60])
def test_contacts_seen_by_few_frames_are_no_lost_ones(rate_hz):
    for seed in range(100, 110):
        positions = hopping(seed, rate_hz=rate_hz, noise_m=1e-4)[1]
        assert not len(lost_frames(positions)), seed


@pytest.mark.parametrize("digits", [4, 6, None])
def test_gaps_that_were_filled_with_straight_lines_are_told(digits):
    for seed in range(5):
        positions, markers, starts = (
            hopping(seed)[1],
            [0, 1, 3, 5],
            range(100, 1900, 37),
        )
        for k, start in enumerate(starts):
            a, b = start - 1, start + 6 + k % 9
            ends = positions[[a, b], markers[k % 4]]
            positions[a : b + 1, markers[k % 4]] = np.linspace(*ends, b - a + 1)
        written = (
            positions.astype(np.float32)
            if digits is None
            else np.round(positions, digits)
        )
        found = straight_stretches(written, MARKERS)
        told = {(one.marker, one.start, one.stop) for one in found}
        true = {
            (MARKERS[markers[k % 4]], s, s + 6 + k % 9) for k, s in enumerate(starts)
        }
        assert told <= true
        assert len(told) >= (30 if digits == 4 else 40), (
            seed,
            len(told),
        )  # some hardly move
        clean = hopping(seed)[1]
        assert straight_stretches(np.round(clean, digits or 9), MARKERS) == ()


def test_a_filled_gap_is_one_fault_of_its_own_kind():
    positions = hopping(8)[1]
    positions[704:716, 0] = np.linspace(positions[704, 0], positions[715, 0], 12)
    raw = RawRecording(MARKERS, np.arange(2000) / 100, positions, 100.0, "m")
    inspection = inspect_recording(raw)
    assert [(s.kind, s.start, s.stop) for s in inspection.suspects()] == [
        ("filled", 705, 715)
    ]
    assert "1 suspect: 1 filled gap." in listing(inspection, "file")


def test_a_marker_never_seen_is_no_fault_but_a_gap():
    positions = with_gap(hopping(12)[1], "toe2", 0, 2000)
    assert faults(positions).count == 0


@pytest.mark.parametrize("n_frames", [1, 2, 3, 4, 7])
def test_a_few_frames_are_measured_without_error(n_frames):
    assert faults(hopping(13, n_frames=200)[1][:n_frames]).swaps == ()


@pytest.mark.parametrize("shape", [(0, 7), (5, 0)])
def test_nothing_to_measure_is_refused(shape):
    raw = RawRecording(
        MARKERS[: shape[1]],
        np.arange(shape[0]) / 100,
        np.zeros((*shape, 3)),
        100.0,
        "m",
    )
    with pytest.raises(RecordingError, match="expected frames and markers"):
        inspect_recording(raw)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "kind", ["unseen", "constant", "infinite", "huge", "sparse", "equal"]
)
def test_absurd_positions_are_measured_without_error_or_warning(kind):
    rng = np.random.default_rng(1)
    positions = rng.normal(size=(300, 7, 3))
    absurd = {
        "unseen": np.full_like(positions, np.nan),
        "constant": np.ones_like(positions),
        "infinite": np.where(rng.random(positions.shape) < 0.1, np.inf, positions),
        "huge": 1e300 * positions,
        "sparse": np.where(rng.random((300, 7, 1)) < 0.7, np.nan, positions),
        "equal": np.repeat(positions[:, :1], 7, axis=1),
    }[kind]
    raw = RawRecording(MARKERS, np.arange(300) / 100.0, absurd, 100.0, "m")
    inspection = inspect_recording(raw)
    guess_roles(inspection)
    assert "7: hip1" in listing(inspection, "absurd")


def test_one_frame_of_many_markers_costs_next_to_nothing():
    positions = np.random.default_rng(0).uniform(-1, 1, (1, 138, 3))
    raw = RawRecording(
        tuple(f"m{i}" for i in range(138)), np.zeros(1), positions, 100.0, "m"
    )
    begin = process_time()
    found = inspect_recording(raw)
    assert process_time() - begin < 2.0
    assert found.faults.count == 0
    assert found.clusters == ()  # one frame does not show which distances are constant


def test_a_long_recording_is_inspected_in_little_more_memory_than_its_own():
    tile = hopping(3, n_frames=2000)[1]
    positions = np.tile(np.concatenate([tile, tile[::-1]]), (12, 3, 1))
    time = np.arange(len(positions)) / 100.0
    raw = RawRecording(tuple(f"m{i}" for i in range(21)), time, positions, 100.0, "m")
    tracemalloc.start()
    found = inspect_recording(raw)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4.0 * positions.nbytes  # one is the result; some have a bounded size
    assert len(found.markers) == 21


def test_a_swap_among_many_markers_of_one_rigid_body_is_found():
    rng = np.random.default_rng(5)
    hops = hopping(5)[1]
    positions = (
        hops[:, :1]
        + rng.uniform(-0.3, 0.3, (40, 3))
        + rng.normal(0, 3e-4, (2000, 40, 3))
    )
    positions[700:750, [11, 30]] = np.nan
    positions[750:900, [11, 30]] = positions[750:900, [30, 11]]
    positions[900:980, [11, 30]] = np.nan  # too long for the tracks to bridge
    time, names = np.arange(2000) / 100.0, tuple(f"m{i}" for i in range(40))
    (swap,) = inspect_recording(
        RawRecording(names, time, positions, 100.0, "m")
    ).faults.swaps
    assert (swap.markers, swap.start, swap.stop) == (("m11", "m30"), 750, 900)
    assert "pair distances" in swap.found_by


# Tables of gaps and faults: they contain what was planted in a recording, and no more.


@pytest.fixture(scope="module")
def clean(sample_path):
    whole = read_recording(sample_path)
    n = 4000
    return Recording(
        "run",
        5.0 + whole.time[:n],
        whole.positions[:n],
        whole.markers,
        whole.roles,
        whole.rate_hz,
    )


@pytest.fixture(scope="module")
def faulty(clean):
    positions = clean.positions.copy()
    positions[100:130, 1] = np.nan
    positions[-10:, 4] = np.nan
    positions[2000, 0] += 0.05
    return Recording(
        "faulty", clean.time, positions, clean.markers, clean.roles, clean.rate_hz
    )


def test_a_clean_recording_has_no_gaps_and_no_faults(clean):
    tables = recording_tables([clean])
    assert tables["gaps"].empty
    assert tables["faults"].empty
    table = tables["markers"]
    assert list(table["marker"]) == list(clean.markers)
    assert (table["missing"] == 0).all()
    assert np.allclose(table["noise_m"], 6e-4, rtol=0.15)
    assert np.allclose(table["duration_s"], 39.99)


def test_gaps_from_the_first_frame(faulty):
    gaps = recording_tables([faulty])["gaps"]
    assert list(gaps["marker"]) == [faulty.markers[1], faulty.markers[4]]
    assert np.allclose(gaps["start_s"], [1.0, 39.9])
    assert np.allclose(gaps["stop_s"], [1.3, 40.0])
    assert list(gaps["frames"]) == [30, 10]
    markers = recording_tables([faulty])["markers"].set_index("marker")
    assert markers.loc[faulty.markers[1], "longest_s"] == pytest.approx(0.3)
    assert markers["missing"].sum() == 40


def test_a_spike_is_a_row_with_its_size(clean, faulty):
    faults = recording_tables([clean, faulty])["faults"]
    assert list(faults["kind"]) == ["spike"]
    row = faults.iloc[0]
    assert (row["recording"], row["marker"]) == ("faulty", faulty.markers[0])
    assert row["start_s"] == pytest.approx(20.0)
    assert float(row["remark"].split(" is ")[1].split()[0]) == pytest.approx(
        50 * np.sqrt(3), abs=3
    )


def test_dropped_frames_stand_without_a_marker(clean):
    time = clean.time.copy()
    time[1000:] += 0.03
    late = Recording(
        "late", time, clean.positions, clean.markers, clean.roles, clean.rate_hz
    )
    faults = recording_tables([late])["faults"]
    dropped = faults[faults["kind"] == "dropped"]
    assert list(dropped["marker"]) == [""]
    assert dropped["start_s"].iloc[0] == pytest.approx(9.99)
    assert dropped["remark"].iloc[0] == "3 frames dropped after this one"


def test_a_pause_is_no_fault(clean):
    time = clean.time.copy()
    time[1000:] += 1.0  # as between joined files
    paused = Recording(
        "paused", time, clean.positions, clean.markers, clean.roles, clean.rate_hz
    )
    assert recording_tables([paused])["faults"].empty


def test_remarks_stand_with_their_recording(clean, tmp_path):
    guessed = replace(clean, name="guessed", remarks=("a.trc: unit: taken for mm",))
    table = recording_tables([clean, guessed])["remarks"]
    assert list(table.itertuples(index=False, name=None)) == [
        ("guessed", guessed.remarks[0])
    ]
    path = tmp_path / "guessed.h5"
    write_recording(path, guessed)
    assert recording_tables([read_recording(path)])["remarks"].equals(table)
    assert list(recording_tables([clean])["remarks"].columns) == ["recording", "remark"]


def test_all_tables_of_some_recordings(clean, faulty):
    tables = recording_tables(iter([clean, faulty]))
    assert {name: set(table["recording"]) for name, table in tables.items()} == {
        "markers": {"run", "faulty"},
        "gaps": {"faulty"},
        "faults": {"faulty"},
        "remarks": set(),
    }
