import hashlib
import os
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from qtm_files import NAMES, UPRIGHT, data_rows, qtm_text, standing, write
from trc_files import trc_text

from hopdata.errors import RecordingError
from hopdata.recording import Event
from hopdata.recordings.axes import FILE_AXES, rotate_up
from hopdata.recordings.importing import PER_FOOT, import_recording, join
from hopdata.recordings.plausibility import check_plausible
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.readers.formats import READERS, read_raw
from hopdata.recordings.readers.hdf5 import read_recording, read_truth, write_recording
from hopdata.time_stamps import PAUSE_S

MARKERS = {"body": list(NAMES[:3]), "feet": list(NAMES[3:])}
SAMPLE_MARKERS = {
    "body": ["body1", "body2", "body3"],
    "feet": ["foot1", "foot2", "foot3"],
}


def imported(path, markers=MARKERS, **options):
    """Return the checked recording, as the workflow and `hopdata check` see it."""
    recording, _ = import_recording(path, name="trial", markers=markers, **options)
    check_plausible(recording)
    return recording


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("share", [0.0, 0.5])  # held, or interpolated linearly
def test_frames_between_those_recorded_are_left_out(tmp_path, share, first):
    at = np.arange(800) / 100.0
    rng = np.random.default_rng(share > 0)
    places = np.array(
        [[0.1, 0, 1], [-0.1, 0.1, 1], [0, -0.1, 1.1], [0.2, 0, 0], [-0.2, 0, 0]]
    )
    kept = (
        places + 0.05 * np.sin(9 * at)[:, None, None] + rng.normal(0, 3e-4, (800, 5, 3))
    )
    doubled = np.repeat(kept, 2, axis=0)[:-1]
    doubled[1::2] = (1 - share) * kept[:-1] + share * kept[1:]
    path, original = tmp_path / "a.trc", tmp_path / "b.trc"
    path.write_text(trc_text(1e3 * doubled[first:], NAMES, rate_hz=200.0))
    original.write_text(trc_text(1e3 * kept, NAMES))
    found, wanted = (imported(p, MARKERS) for p in (path, original))
    assert (found.rate_hz, wanted.remarks) == (100.0, ())
    assert "every second frame is made up" in found.remarks[0]
    rest = wanted.positions[first:]
    np.testing.assert_allclose(found.positions, rest, atol=2e-6)


def test_markers_come_in_the_order_of_their_roles(tmp_path):
    positions = np.concatenate([standing(), standing()[:, :1] + 200], axis=1)
    path = write(tmp_path, qtm_text(positions, names=(*NAMES, "boom")))
    wanted = {
        "boom": ["boom"],
        "feet": ["toe", "heel"],
        "body": ["back", "hip right", "hip left"],
    }
    recording = imported(path, wanted)
    assert recording.markers == ("back", "hip right", "hip left", "toe", "heel", "boom")
    assert recording.roles == ("body", "body", "body", "foot", "foot", "boom")
    order = [2, 1, 0, 4, 3, 5]
    np.testing.assert_allclose(
        recording.positions, positions[:, order] / 1000, atol=1e-6
    )


def test_names_without_a_subject_fit_any_file_of_one_subject(tmp_path):
    anna, ben = ([f"{who}:{name}" for name in NAMES] for who in ("Anna", "Ben"))
    for who in (anna, ben):
        path = write(tmp_path, qtm_text(standing(), names=tuple(who)))
        assert imported(path).markers == (*MARKERS["body"], *MARKERS["feet"])
    with pytest.raises(RecordingError, match="may be left out"):
        imported(path, {"body": anna[:3], "feet": anna[3:]})
    both = np.concatenate([standing(), standing() + 500], axis=1)
    with pytest.raises(RecordingError, match="did you mean"):
        imported(write(tmp_path, qtm_text(both, names=(*anna, *ben))))


def test_a_marker_is_unseen_where_the_configuration_says_so(tmp_path):
    path = write(tmp_path, qtm_text(standing()))
    entries = [
        {
            "from_s": 0.1,
            "to_s": 0.2,
            "markers": ["toe"],
            "landings": [],
            "reason": "loose",
        },
        {
            "from_s": None,
            "to_s": 0.05,
            "markers": ["back"],
            "landings": [],
            "reason": "hidden",
        },
        {
            "from_s": None,
            "to_s": None,
            "markers": [],
            "landings": [],
            "reason": "all of it",
        },
    ]
    found, plain = imported(path, exclude=entries), imported(path)
    unseen = np.isnan(found.positions).all(axis=2)
    assert np.flatnonzero(unseen[:, found.markers.index("toe")]).tolist() == list(
        range(10, 21)
    )
    assert np.flatnonzero(unseen[:, found.markers.index("back")]).tolist() == list(
        range(6)
    )
    np.testing.assert_array_equal(found.positions[~unseen], plain.positions[~unseen])
    assert (
        "marker 'toe' counts as unseen from 0.1 to 0.2 s, by hand: loose"
        in found.remarks[-2]
    )
    assert len(found.remarks) == len(plain.remarks) + 2


def test_source_and_digest_are_kept(tmp_path):
    path = write(tmp_path, qtm_text())
    recording = imported(path)
    assert recording.name == "trial"
    assert recording.source == path.as_posix()
    assert recording.source_sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("axis", FILE_AXES)
def test_the_vertical_axis_is_turned_up(tmp_path, axis):
    turned = standing() @ rotate_up(np.eye(3), axis).T
    sign = -1 if axis.startswith("-") else 1
    assert np.argmax(sign * turned[:, :3].mean(axis=(0, 1))) == "xyz".index(axis[-1])
    recording = imported(write(tmp_path, qtm_text(turned)), vertical_axis=axis)
    assert recording.vertical_axis == axis
    height = standing()[:, :3, 2].mean(axis=1) / 1000
    np.testing.assert_allclose(recording.body_height, height, atol=1e-6)


def test_an_axis_that_nothing_shows_is_asked_for(tmp_path):
    told = "vertical_axis: auto: expected a clear fall, or a body that is clearly above its feet, "
    told += "found .* not enough to rule out"
    upright = standing()
    assert (
        imported(write(tmp_path, qtm_text(upright)), vertical_axis="auto").vertical_axis
        == "z"
    )
    beside = upright.copy()
    beside[:, :3, 0] += 500.0
    with pytest.raises(RecordingError, match=told):
        imported(write(tmp_path, qtm_text(beside)), vertical_axis="auto")


@pytest.mark.parametrize(("scale", "unit"), [(1000.0, "mm"), (1.0, "m")])
def test_the_unit_is_found_or_given(tmp_path, scale, unit):
    path = write(tmp_path, qtm_text(standing(scale=scale, wobble=0.02)))
    found = imported(path, unit="auto")
    assert np.array_equal(found.positions, imported(path, unit=unit).positions)
    np.testing.assert_allclose(
        found.body[:, :, 2].mean(), UPRIGHT[:3, 2].mean(), atol=0.02
    )


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("hip left ", "'hip left '"),
        (" HIP LEFT", "' HIP LEFT'"),
        ("hip\xa0left", r"'hip\xa0left'"),
    ],
)
def test_a_space_in_a_name_is_seen_and_the_name_without_it_is_suggested(
    tmp_path, name, shown
):
    path = write(tmp_path, qtm_text())
    with pytest.raises(RecordingError) as caught:
        imported(path, {"body": [name, *NAMES[1:3]], "feet": NAMES[3:]})
    assert str(caught.value).endswith(f"found {shown}; did you mean 'hip left'?")


def test_the_sample_reads_as_it_was_written(tmp_path, sample_path):
    markers = {**SAMPLE_MARKERS, "boom": ["boom"]}
    recording = imported(sample_path, markers)
    write_recording(tmp_path / "copy.h5", recording)
    again = imported(tmp_path / "copy.h5", markers)
    assert np.array_equal(again.positions, recording.positions, equal_nan=True)
    assert np.array_equal(again.time, recording.time)
    assert again.rate_hz == recording.rate_hz == 100


def test_the_same_recording_by_two_formats(tmp_path):
    recording = imported(write(tmp_path, qtm_text()))
    write_recording(tmp_path / "trial.h5", recording)
    again = imported(tmp_path / "trial.h5")
    np.testing.assert_allclose(again.positions, recording.positions, atol=1e-7)
    assert np.array_equal(again.time, recording.time)


def sample_truth(path, **changes):
    options = {"vertical_axis": changes.pop("vertical_axis", "z"), "name": "hopper"}
    return import_recording(path, markers={**SAMPLE_MARKERS, **changes}, **options)[1]


def test_truth_comes_along_with_its_feet_in_the_order_asked_for(sample_path):
    stored = read_truth(sample_path)
    truth = sample_truth(sample_path, feet=["foot3", "foot1", "foot2"])
    for key in PER_FOOT:
        expected = getattr(stored, key)[:, [2, 0, 1]]
        assert np.array_equal(
            getattr(truth, key), expected, equal_nan=expected.dtype != bool
        )
    assert np.array_equal(truth.apex_times, stored.apex_times)
    n_feet = stored.contact_times.shape[1]
    arrays = {
        k: v
        for k, v in vars(stored).items()
        if isinstance(v, np.ndarray) and v.ndim > 1
    }
    assert {
        k for k, v in arrays.items() if v.shape[1] == n_feet and k != "apex_states"
    } == (set(PER_FOOT))


def test_truth_is_left_behind_where_it_does_not_apply(tmp_path, sample_path):
    assert sample_truth(sample_path, feet=["foot1", "foot2"]) is None
    assert sample_truth(sample_path, body=["body1", "body2", "boom"]) is None
    assert sample_truth(sample_path, vertical_axis="x") is None
    assert (
        import_recording(write(tmp_path, qtm_text()), name="a", markers=MARKERS)[1]
        is None
    )


def good(folder):
    return write(folder, qtm_text())


def without_back(folder):
    positions = standing()
    positions[:, 2] = 0
    return write(folder, qtm_text(positions))


def with_markers(**changes):
    return {"markers": {**MARKERS, **changes}}


# Mistake: the file, the options, and what the message must name.
MISTAKES = {
    "misspelt marker": lambda f: (
        good(f),
        with_markers(body=["hip left", "hip rihgt", "back"]),
        ["trial.tsv: markers.body", "found 'hip rihgt'", "did you mean 'hip right'"],
    ),
    "marker twice": lambda f: (
        good(f),
        with_markers(feet=["toe", "back"]),
        ["markers.feet", "each marker once", "'back' twice"],
    ),
    "two body markers": lambda f: (
        good(f),
        with_markers(body=list(NAMES[:2])),
        ["body markers", "at least 3", "found 2 (hip left, hip right)"],
    ),
    "one foot": lambda f: (
        good(f),
        with_markers(feet=["toe"]),
        ["feet", "at least 2", "found 1 (toe)"],
    ),
    "misspelt file": lambda f: (
        good(f).with_name("trail.tsv"),
        {},
        ["trail.tsv", "expected a file", "did you mean 'trial.tsv'"],
    ),
    "no such folder": lambda f: (
        f / "sub/trial.tsv",
        {},
        ["a file", "there is no folder"],
    ),
    "other format": lambda f: (
        f / "trial.ods",
        {},
        [*READERS, "found '.ods'"],
    ),
    "mm taken for m": lambda f: (
        good(f),
        {"unit": "m"},
        ["scale", "0.003 to 12 m", "found 603 m", "input.unit: mm"],
    ),
    "m taken for mm": lambda f: (
        write(f, qtm_text(standing(scale=1.0))),
        {"unit": "mm"},
        ["scale", "0.003 to 12 m", "input.unit: m"],
    ),
    "y up, not told": lambda f: (
        write(f, qtm_text(standing()[..., [1, 2, 0]])),
        {},
        ["vertical axis z", "the body above the feet", "input.vertical_axis: y"],
    ),
    "z up, x told": lambda f: (
        good(f),
        {"vertical_axis": "x"},
        ["vertical axis x", "m along z", "input.vertical_axis: z"],
    ),
    "upside down": lambda f: (
        write(f, qtm_text(standing() * [1, 1, -1])),
        {},
        ["vertical axis z", "input.vertical_axis: -z, or are markers.body"],
    ),
    "marker never seen": lambda f: (
        without_back(f),
        {},
        ["'back'", "in none of 40 frames"],
    ),
    "stamps against rate": lambda f: (
        write(f, qtm_text(rows=data_rows(standing(), rate=50.0))),
        {},
        ["time stamps", "expected 0.01 s", "100 Hz", "found 0.02 s", "50 Hz"],
    ),
    "rate 0": lambda f: (
        good(f),
        {"rate_hz": 0.0},
        ["input.rate_hz", "more than 0 Hz", "found 0 Hz"],
    ),
    "other rate": lambda f: (good(f), {"rate_hz": 120.0}, ["expected 100 Hz", "120"]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told_in_one_line(tmp_path, mistake):
    path, options, parts = MISTAKES[mistake](tmp_path)
    with pytest.raises(RecordingError) as caught:
        imported(path, **options)
    message = str(caught.value)
    assert "\n" not in message
    for part in ("expected", "found", *parts):
        assert part in message


@pytest.mark.parametrize(
    ("mistake", "key"),
    [
        ("misspelt marker", "markers.body"),
        ("marker twice", "markers.feet"),
        ("marker never seen", ""),
    ],
)
def test_a_mistake_in_the_markers_has_their_key(tmp_path, mistake, key):
    path, options, _ = MISTAKES[mistake](tmp_path)
    with pytest.raises(RecordingError) as caught:
        imported(path, **options)
    assert caught.value.key == key


def test_a_name_that_markers_share_is_told_with_their_new_names(tmp_path):
    path = write(tmp_path, qtm_text(names=("hip left", "toe", "back", "toe", "heel")))
    shared = (
        "expected each marker name once, found 'toe' twice or more; they are called"
    )
    with pytest.raises(RecordingError, match=r"markers\.feet") as caught:
        imported(path, {"body": [], "feet": ["toe"]})
    assert f"line 10: {shared} 'toe 1', 'toe 2'" in str(caught.value)
    with pytest.raises(RecordingError, match=r"markers\.feet") as caught:
        imported(path, {"body": [], "feet": ["heal"]})
    assert "did you mean 'heel'?" in str(caught.value)
    assert "'toe' twice" not in str(caught.value)


def test_names_that_are_shared_are_told_in_one_remark_and_asked_for_alone(tmp_path):
    names = ("hip", "toe", "hip", "toe", "heel")
    path = write(tmp_path, qtm_text(names=names))
    (told,) = read_raw(path).remarks
    assert str(told).endswith(
        "found 'hip', 'toe' twice or more; they are called 'hip 1', 'hip 2', 'toe 1', "
        "'toe 2'"
    )
    with pytest.raises(RecordingError) as caught:
        imported(path, {"body": [], "feet": ["toe"]})
    assert "found 'toe' twice or more; they are called 'toe 1', 'toe 2'" in str(
        caught.value
    )
    assert "hip" not in str(caught.value).partition("line 10")[2]
    path = write(tmp_path, qtm_text(names=("hip left", "toe", "back", "t", "heel")))
    assert read_raw(path).remarks == ()


def test_a_damaged_hdf5_file_is_told(tmp_path):
    path = write(tmp_path, qtm_text(), "trial.h5")
    with pytest.raises(RecordingError, match=r"trial.h5: .*HDF5"):
        imported(path)


def test_the_real_recording(external_recording):
    markers = {
        "body": ["body1", "body2", "body3"],
        "feet": ["R_heel", "R_mt1", "R_mt5"],
    }
    recording = imported(external_recording, markers)
    assert recording.positions.shape == (4500, 6, 3)
    np.testing.assert_allclose(
        recording.positions[0, 0], [1.17022, 2.33784, 1.04126], atol=1e-9
    )
    assert 0.8 < np.nanmedian(recording.body_height) < 1.2
    with pytest.raises(RecordingError, match=r"input.vertical_axis: z"):
        imported(external_recording, markers, vertical_axis="y")


def test_a_truth_of_another_size_is_told(tmp_path, sample_path):
    recording, truth = read_recording(sample_path), read_truth(sample_path)
    fewer = replace(
        truth, foot_down=truth.foot_down[:-1], body_height=truth.body_height[:-1]
    )
    write_recording(tmp_path / "a.h5", recording, fewer)
    with pytest.raises(RecordingError, match=r"truth: expected \d+ frames and 3 feet"):
        imported(tmp_path / "a.h5", SAMPLE_MARKERS)


def test_a_file_name_need_not_be_utf_8(tmp_path):
    path = tmp_path / os.fsdecode(b"l\xf6pp.tsv")
    path.write_bytes(qtm_text().encode())
    recording = imported(path)
    write_recording(tmp_path / "a.h5", recording)
    assert read_recording(tmp_path / "a.h5").source.endswith("l\ufffdpp.tsv")


# Several files of one day joined into one recording.

JOINING_MARKERS = {"body": list(NAMES[:3]), "feet": list(NAMES[3:])}
NOON = datetime(2021, 1, 1, 12)
PATHS = [Path("a.tsv"), Path("b.tsv")]


def raw(start=0.0, **changes):
    made = RawRecording(
        NAMES,
        start + np.arange(50) / 100,
        standing(50),
        100.0,
        "mm",
        events=(Event("e", start),),
    )
    return replace(made, **changes)


def test_files_that_state_their_date_are_placed_by_it():
    later = NOON + timedelta(seconds=90)
    joined = join(PATHS, [raw(started=NOON), raw(started=later)])
    assert joined.time[50] == pytest.approx(90.0)
    assert [e.time_s for e in joined.events] == pytest.approx([0.0, 90.0])
    assert joined.positions.shape == (100, 5, 3)
    assert not joined.remarks


def test_time_stamps_that_go_on_are_kept():
    joined = join(PATHS, [raw(), raw(start=0.9)])
    assert joined.time[50] == 0.9
    assert not joined.remarks


@pytest.mark.parametrize("started", [None, NOON])
def test_others_are_put_after_a_pause_and_said(started):
    joined = join(PATHS, [raw(started=started), raw(started=started)])
    assert joined.time[50] == pytest.approx(0.49 + PAUSE_S)
    assert np.all(np.diff(joined.time) > 0)
    assert "no start is known for b.tsv" in joined.remarks[0]


@pytest.mark.parametrize(
    ("second", "parts"),
    [
        (raw(started=NOON - timedelta(1)), ["recorded after a.tsv", "order of time"]),
        (raw(rate_hz=120.0), ["frame rate", "expected 100.0", "found 120.0"]),
        (raw(unit="m"), ["unit", "expected mm", "found m"]),
        (raw(stated_up="y"), ["vertical axis", "found y"]),
        (raw(markers=tuple("abcde")), ["markers", "hip left", "('a', 'b'"]),
    ],
)
def test_files_that_do_not_belong_together_are_refused(second, parts):
    with pytest.raises(RecordingError) as caught:
        join(PATHS, [raw(started=NOON), second])
    for part in ("b.tsv", "expected", "found", *parts):
        assert part in str(caught.value)


def test_a_recording_of_two_files(tmp_path):
    halves = np.split(standing(80), [50])
    bare = {"TIME_STAMP": None}
    paths = [
        write(tmp_path, qtm_text(half, header=bare), f"part{i}.tsv")
        for i, half in enumerate(halves)
    ]
    recording, truth = import_recording(paths, name="day", markers=JOINING_MARKERS)
    check_plausible(recording)
    np.testing.assert_allclose(recording.positions * 1000, standing(80), atol=6e-4)
    assert recording.source == ", ".join(path.as_posix() for path in paths)
    assert len(recording.source_sha256.split(", ")) == 2
    assert truth is None
    assert len(recording.remarks) == 1


def test_a_marker_that_one_file_lacks_is_told_with_that_file(tmp_path):
    first = write(tmp_path, qtm_text(), "a.tsv")
    second = write(
        tmp_path,
        qtm_text(names=("hip left", "hip right", "bak", "heel", "toe")),
        "b.tsv",
    )
    with pytest.raises(
        RecordingError, match=r"b.tsv: .*found 'back'; did you mean 'bak'"
    ):
        import_recording([first, second], name="day", markers=JOINING_MARKERS)


def test_no_file_at_all_is_refused():
    with pytest.raises(RecordingError, match="at least one file, found none"):
        import_recording([], name="day", markers=JOINING_MARKERS)


def test_a_session_with_other_names_is_told_what_to_do(tmp_path):
    path = write(tmp_path, qtm_text(names=tuple(f"{name} new" for name in NAMES)))
    with pytest.raises(
        RecordingError, match=r"none of the configured markers, .* rename them"
    ):
        imported(path, {"body": NAMES[:3], "feet": NAMES[3:]})


def test_markers_in_another_order_and_some_of_them_are_the_same_numbers(tmp_path):
    whole = read_raw(write(tmp_path, qtm_text()))
    chosen = {"body": [NAMES[4], NAMES[0], NAMES[2]], "feet": [NAMES[3], NAMES[1]]}
    found = imported(tmp_path / "trial.tsv", chosen)
    order = [4, 0, 2, 3, 1]
    np.testing.assert_array_equal(found.positions, whole.positions[:, order] * 1e-3)
