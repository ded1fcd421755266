from dataclasses import replace

import numpy as np
import pytest
from qtm_files import NAMES, standing

from hopdata.errors import RecordingError
from hopdata.recording import Recording, body_over_feet, fraction_seen
from hopdata.recordings.plausibility import check_plausible, notes, rounded_to
from hopdata.scale import extent
from hopdata.time_stamps import PAUSE_S

ROLES = ("body", "body", "body", "foot", "foot")


def recording(n_frames=100, rate_hz=100.0, **changes):
    sound = Recording(
        name="trial",
        time=np.arange(n_frames) / rate_hz,
        positions=standing(n_frames, scale=1.0),
        markers=NAMES,
        roles=ROLES,
        rate_hz=rate_hz,
        source="trial.tsv",
    )
    return replace(sound, **changes)


def refused(faulty):
    with pytest.raises(RecordingError) as caught:
        check_plausible(faulty)
    message = str(caught.value)
    assert message.startswith("trial.tsv: ")
    assert "expected" in message
    assert "found" in message
    assert "\n" not in message
    return message


def told(sound):
    return [str(note) for note in notes(sound)]


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 2000.0])
@pytest.mark.parametrize("size", [0.006, 0.05, 1.0, 5.0])
def test_a_sound_recording_passes_without_notes(rate_hz, size):
    sound = recording(rate_hz=rate_hz)
    sound = replace(sound, positions=size * sound.positions)
    check_plausible(sound)
    assert told(sound) == []


def test_the_sample_is_sound(sample_path):
    from hopdata.recordings.readers.hdf5 import read_recording

    check_plausible(read_recording(sample_path))


@pytest.mark.parametrize("rate_hz", [0.0, -100.0, np.nan, np.inf])
def test_rate(rate_hz):
    message = refused(replace(recording(), rate_hz=rate_hz))
    assert "more than 0 Hz" in message


def test_time_that_repeats_or_runs_back_is_refused_with_its_frame():
    for value in (0.10, 0.05, np.nan):
        time = np.arange(100) / 100.0
        time[11] = value
        assert "frame 12: expected a time after 0.1 s" in refused(recording(time=time))


def test_time_steps_must_agree_with_the_rate():
    message = refused(recording(time=np.arange(100) / 120.0))
    assert "expected 0.01 s from frame to frame (100 Hz)" in message
    assert "(120 Hz)" in message
    check_plausible(recording(time=np.arange(100) / 101.0))  # a nominal rate


def test_one_frame_is_not_enough():
    assert "at least 2 frames, found 1" in refused(recording(n_frames=1))


def test_scale():
    sound = recording()
    too_large = refused(replace(sound, positions=1e3 * sound.positions))
    assert "millimetres taken for metres: set input.unit: mm" in too_large
    too_small = refused(replace(sound, positions=1e-3 * sound.positions))
    assert "metres taken for millimetres: set input.unit: m" in too_small
    neither = refused(replace(sound, positions=1e8 * sound.positions))
    assert "input.unit" not in neither


@pytest.mark.parametrize(
    ("vertical_axis", "order"), [("z", [0, 1, 2]), ("y", [2, 0, 1])]
)
def test_body_beside_the_feet_names_the_axis_of_the_file(vertical_axis, order):
    """Canonical y is up by mistake: the file's y, or its x if y was configured as vertical."""
    positions = recording().positions[..., [1, 2, 0]]
    message = refused(recording(positions=positions, vertical_axis=vertical_axis))
    assert f"set input.vertical_axis: {'xyz'[order[1]]}?" in message


def test_body_below_the_feet():
    positions = recording().positions * [1, -1, -1]
    hint = (
        "set input.vertical_axis: -z, or are markers.body and markers.feet exchanged?"
    )
    assert hint in refused(recording(positions=positions))
    assert hint in refused(recording(roles=("foot", "foot", "body", "body", "body")))
    assert "set input.vertical_axis: y, or" in refused(
        recording(positions=positions, vertical_axis="-y")
    )


def test_a_marker_never_seen_is_refused_and_one_often_unseen_is_noted():
    positions = recording().positions.copy()
    positions[:, 4] = np.nan
    assert "marker 'toe'" in refused(recording(positions=positions))
    positions[:80, 4] = recording().positions[:80, 4]
    often = recording(positions=positions)
    check_plausible(often)
    np.testing.assert_allclose(fraction_seen(often), [1, 1, 1, 1, 0.8])
    assert told(often) == ["trial.tsv: marker 'toe' is missing in 20.0 % of frames"]


def test_a_foot_that_stays_high_is_noted():
    positions = recording().positions.copy()
    positions[:, 4, 2] += 0.5 * body_over_feet(recording())[2]
    (note,) = told(recording(positions=positions))
    assert f"foot '{NAMES[4]}' comes no nearer to the floor than" in note
    assert (
        f"above '{NAMES[3]}'; does it touch the ground, or does the floor slope?"
        in note
    )


def hopping(offset_m, noise_m, *, n_frames=400):
    """Return two feet; the second copies the first with an offset and noise of its own."""
    sound = recording(n_frames)
    draws = np.random.default_rng(3).normal(size=(2, n_frames, 3))
    air = np.maximum(0.0, np.sin(np.arange(n_frames) / 8.0))
    positions = sound.positions.copy()
    positions[:, 3, 2] = 0.1 * air
    positions[:, 3] += 1e-4 * draws[0]
    positions[:, 4] = positions[:, 3] + offset_m + noise_m * draws[1]
    return replace(sound, positions=positions)


@pytest.mark.parametrize(
    ("offset_m", "said"),
    [((0.1, 0.2, 0.0), "always the same"), ((0, 0, 0.012), "12.0 mm apart")],
)
def test_feet_that_move_as_one_are_noted(offset_m, said):
    copied = hopping(offset_m, 0.0)
    (note,) = told(copied)
    assert f"feet '{NAMES[3]}' and '{NAMES[4]}' are always" in note
    assert said in note
    assert note.endswith("is one a copy of the other?")


def test_feet_that_land_together_are_two_by_their_noise_or_the_flight():
    assert told(hopping((0.1, 0.2, 0.0), 1e-4)) == []
    coarse = hopping((0.1, 0.2, 0.0), 1e-3)
    coarse = replace(coarse, positions=np.round(coarse.positions, 3))
    assert not [note for note in told(coarse) if "copy" in note]


def test_dropped_frames_are_noted():
    time = np.arange(103) / 100.0
    time = np.delete(time, [10, 50, 51])
    assert told(recording(time=time)) == [
        "trial.tsv: 3 frames are missing between the time stamps"
    ]
    time = np.delete(np.arange(101) / 100.0, 10)
    assert told(recording(time=time)) == [
        "trial.tsv: 1 frame is missing between the time stamps"
    ]


def test_pauses_are_no_missing_frames():
    time = np.arange(100) / 100.0
    time[40:] += 7200.0
    assert told(recording(time=time)) == [
        "trial.tsv: 1 pause of 7200.01 s in which nothing was recorded"
    ]
    time[70:] += PAUSE_S - 0.01  # as between files that do not state when they began
    assert told(recording(time=time)) == [
        "trial.tsv: 2 pauses of 7201.01 s in all in which nothing was recorded"
    ]


def test_a_marker_under_two_names_is_refused():
    positions = recording().positions.copy()
    positions[:, 1] = positions[:, 0]
    assert "'hip left' and 'hip right'" in refused(recording(positions=positions))


def test_infinite_positions_are_refused():
    positions = recording().positions.copy()
    positions[5, 3, 1] = np.inf
    assert "marker 'heel': expected finite positions" in refused(
        recording(positions=positions)
    )


def test_too_few_markers():
    few = recording(roles=("body", "body", "boom", "foot", "foot"))
    assert "body markers: expected at least 3, found 2" in refused(few)
    few = recording(roles=("body", "body", "body", "foot", "boom"))
    assert "feet: expected at least 2, found 1 (heel)" in refused(few)


def test_extent_and_offset_by_hand():
    frame = np.array([[[0.0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 12], [np.nan] * 3]])
    assert extent(frame) == 13
    alone = np.full((2, *frame.shape[1:]), np.nan)  # two frames of a single marker
    alone[:, 0] = 1.0
    assert extent(np.concatenate([frame, alone])) == 13
    assert np.isnan(extent(np.full((3, 4, 3), np.nan)))
    up = recording(
        positions=np.tile([[0, 0, 1.0]], (100, 5, 1))
        * np.array([1, 1, 1, 0, 0])[:, None]
    )
    np.testing.assert_array_equal(body_over_feet(up), [0, 0, 1])


def test_a_frozen_marker_is_refused_and_one_that_rests_is_not():
    frozen = recording()
    frozen.positions[:, 3] = frozen.positions[0, 3]
    frozen.positions[4:7, 3] = np.nan
    assert "marker 'heel': expected to move, found it at" in refused(frozen)
    rests = recording()
    rests.positions[:60, 3] = rests.positions[0, 3]
    check_plausible(rests)


@pytest.mark.parametrize("kind", [np.float64, np.float32])
@pytest.mark.parametrize(
    ("step", "text"),
    [
        (0.01, "10 mm, which adds noise of 2.9 mm"),
        (0.001, "1 mm, which adds noise of 0.29 mm"),
    ],
)
def test_whole_millimetres_are_noted(step, text, kind):
    """This also holds for float32, in which files keep them, and far from the origin."""
    positions = np.round((recording().positions + 5) / step) * step
    positions[3, 2] = np.nan
    rounded = recording(positions=positions.astype(kind).astype(float))
    check_plausible(rounded)
    assert told(rounded) == [
        f"trial.tsv: coordinates are rounded to {text} (standard deviation) to each; "
        "export more digits"
    ]
    positions[50, 1, 2] += 3e-4
    assert told(recording(positions=positions)) == []


def test_nothing_seen_is_not_rounded():
    assert rounded_to(np.full((20, 5, 3), np.nan)) is None
