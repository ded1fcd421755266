from dataclasses import replace

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping
from made_up_jumps import STYLES, jumping
from made_up_people import person
from made_up_robot import robot
from qtm_files import NAMES, UPRIGHT, qtm_text, standing, write
from trc_files import trc_text
from written_files import write_c3d

from hopdata.errors import RecordingError
from hopdata.recordings.axes import rotate_up
from hopdata.recordings.importing import import_recording
from hopdata.recordings.plausibility import notes
from hopdata.recordings.quality.frame_rate import guess_rate
from hopdata.recordings.quality.free_fall import free_fall
from hopdata.recordings.quality.inspection import inspect_recording
from hopdata.recordings.quality.orientation import (
    choose_unit,
    guess_unit_and_up,
)
from hopdata.recordings.raw import RawRecording
from hopdata.scale import extent

UNITS = {"m": 1.0, "mm": 1000.0, "cm": 100.0, "inch": 1 / 0.0254}


def raw(positions, unit="m", rate_hz=100.0):
    return RawRecording(
        MARKERS, np.arange(len(positions)) / rate_hz, positions, rate_hz, unit
    )


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 1000.0])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_is_found_by_free_fall(unit, seed, rate_hz):
    positions = UNITS[unit] * hopping(seed, rate_hz=rate_hz, noise_m=3e-4)[1]
    found, up = guess_unit_and_up(raw(positions, rate_hz=rate_hz))
    assert (found.value, up.value) == (unit, "z")
    assert found.is_sure
    assert up.is_sure
    assert "9.81" in found.reason


@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
def test_the_axis_is_found_and_turned_up(up):
    """The file's axes are those that `rotate_up` rotates back, and handedness is preserved."""
    positions = hopping(1)[1]
    turn = rotate_up(np.eye(3), up)  # rows: directions of the file's axes
    assert np.linalg.det(turn) == pytest.approx(1.0)
    in_file = positions @ np.linalg.inv(turn)
    assert guess_unit_and_up(raw(in_file))[1].value == up
    np.testing.assert_allclose(rotate_up(in_file, up), positions, atol=1e-12)


def walking(seed=1, n_frames=2000):
    """Return feet that rest and swing under a rocking body; nothing falls freely."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * np.arange(n_frames) / 120
    positions = np.zeros((n_frames, len(MARKERS), 3))
    positions[:, :3] = [0.0, 0.0, 0.9]
    positions[:, :3, 2] += 0.02 * np.sin(2 * phase)[:, None]
    for m, shift in ((3, 0.0), (4, np.pi), (5, 0.3)):
        swing = np.sin(phase + shift)
        positions[:, m, 0] = 0.3 * np.cos(phase + shift)
        positions[:, m, 2] = 0.1 * np.maximum(swing, 0.0) ** 2
    return positions + rng.normal(0, 5e-4, positions.shape)


def test_without_free_fall_the_floor_tells_and_the_size():
    found, up = guess_unit_and_up(raw(walking()))
    assert (up.value, up.is_sure) == ("z", True)
    assert "rest" in up.reason
    assert found.value == "m"
    assert "the format's own unit" in found.reason
    found, up = guess_unit_and_up(raw(walking()[..., [1, 2, 0]] * 1000, "mm"))
    assert (found.value, up.value) == ("mm", "y")


def test_a_unit_that_the_file_does_not_state_is_not_called_its_own():
    found, _ = guess_unit_and_up(
        replace(raw(walking() * 1000, "mm"), unit_is_stated=False)
    )
    assert found.value == "mm"
    assert "usual, the file states none; the markers span" in found.reason


@pytest.mark.parametrize("unit", ["cm", "inch"])
@pytest.mark.parametrize("seed", range(3))
def test_a_unit_that_hardly_lets_move_is_not_sure(unit, seed):
    """The file states mm, or nothing, but the numbers differ: a walker would creep."""
    sound = replace(raw(walking(seed) * 1000, "mm", rate_hz=200), unit_is_stated=False)
    assert guess_unit_and_up(sound)[0].is_sure
    for stated in (True, False):
        wrong = replace(
            sound, positions=walking(seed) * UNITS[unit], unit_is_stated=stated
        )
        found = guess_unit_and_up(wrong)[0]
        assert (found.value, found.is_sure, found.other) == ("mm", False, unit)
        assert "nothing falls, and the markers move at" in found.reason


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("rate_hz", [100.0, 200.0])
def test_the_rate_is_asked_for_with_what_free_fall_says(seed, rate_hz):
    positions = hopping(seed, rate_hz=rate_hz)[1]
    assert guess_rate(raw(positions, rate_hz=rate_hz), "m").is_sure
    twice = guess_rate(raw(positions, rate_hz=2 * rate_hz), "m")
    assert (twice.value, twice.is_sure) == (f"{2 * rate_hz:g}", False)
    assert twice.other == f"{rate_hz:g}"
    half = guess_rate(raw(positions, rate_hz=rate_hz / 2), "m")
    assert (half.is_sure, half.other) == (False, f"{rate_hz:g}")
    near = guess_rate(
        raw(positions, rate_hz=rate_hz / 1.2), "m"
    )  # 83 or 167: not a half
    assert (near.is_sure, near.other) == (False, f"{rate_hz:g}")
    asked = guess_rate(raw(positions, rate_hz=100.0), "m", is_stated=False)
    assert not asked.is_sure
    assert asked.value == f"{rate_hz:g}"


@pytest.mark.parametrize(("least_g", "is_sure"), [(0.9, True), (1.6, False)])
def test_of_six_markers_the_two_that_are_pulled_least_speak_for_the_rate(
    least_g, is_sure
):
    time = np.arange(2000) / 100
    # In g; a hip marker shakes.
    pulls = np.array([least_g, least_g, 1.6, 2.0, 2.0, 2.0])[:, None]
    swing = (
        np.sin(2 * np.pi * time / 0.6)[:, None, None]
        * pulls
        * 9.81
        * (0.6 / 2 / np.pi) ** 2
    )
    positions = (np.arange(6)[:, None] + swing) * [0.0, 0.0, 1.0]
    found = guess_rate(RawRecording(MARKERS[:6], time, positions, 100.0, "m"), "m")
    assert found.is_sure == is_sure


def of_people(positions, names, rate_hz):
    time = np.arange(len(positions)) / rate_hz
    return RawRecording(names, time, positions, rate_hz, "m", has_stamps=False)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("posture", "rate_hz"), [("walk", 120.0), ("walk", 250.0), ("treadmill", 120.0)]
)
def test_swinging_legs_do_not_speak_for_twice_the_rate(posture, rate_hz, seed):
    """At twice the rate they would fall freely, one leg at a time."""
    walker = person(seed, posture, "Plug-in Gait", seconds=4.0, rate_hz=rate_hz)
    walk = of_people(walker.positions, walker.names, rate_hz)
    assert guess_rate(walk, "m").is_sure


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("rate_hz", [120.0, 500.0])
def test_flights_speak_for_their_rate_alone(seed, rate_hz):
    positions = jumping(seed, jumps=2, rate_hz=rate_hz)
    for factor, is_sure in ((1.0, True), (0.5, False), (2.0, False)):
        stated = of_people(positions, STYLES["qtm"], factor * rate_hz)
        found = guess_rate(stated, "m")
        assert found.is_sure == is_sure
        if not is_sure:
            assert found.other == f"{rate_hz:g}"


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("strength_g", [3, 4, 5, 6])
def test_legs_drawn_in_do_not_speak_for_half_the_rate(strength_g, seed):
    """Its torso is pulled down by 1.5 to 1.8 g, and at half the rate by under 0.5 g."""
    positions = robot(seed, strength_g=strength_g)
    names = [f"m{k}" for k in range(positions.shape[1])]
    found = guess_rate(of_people(positions, names, 250.0), "m")
    assert found.is_sure
    assert found.why.code == "recordings.rate_confirmed"
    for factor in (1.2, 2.0):
        too_fast = of_people(positions, names, factor * 250.0)
        assert not guess_rate(too_fast, "m").is_sure


def test_one_marker_that_falls_does_not_confirm_a_rate_at_which_others_are_hurled():
    time = np.arange(2000) / 100
    phase = 2 * np.pi * time / 0.6
    radius_m = 9.81 * (0.6 / 2 / np.pi) ** 2
    # Six markers are pulled by 1.6 g down and by 1 g aside at once, and never fall.
    circle = np.stack([np.cos(phase), np.sin(phase), 1.6 * np.sin(phase)], axis=1)
    shaken = np.arange(6)[:, None] + radius_m * circle[:, None]
    bouncing = np.zeros((2000, 1, 3))
    since = time % 0.6
    bouncing[:, 0, 2] = np.maximum(0.0, 0.5 * 9.81 * since * (0.4 - since))
    positions = np.concatenate([shaken, bouncing], axis=1)
    fall = free_fall(positions, 100.0, units={"m": 1.0})
    assert fall.is_rather_clear
    assert fall.up == "z"
    assert not guess_rate(of_people(positions, MARKERS, 100.0), "m").is_sure


def test_time_stamps_speak_against_the_rate_that_is_stated():
    sound = raw(walking(), rate_hz=100.0)
    assert guess_rate(sound, "m").is_sure
    found = guess_rate(replace(sound, rate_hz=250.0), "m")
    assert (found.value, found.is_sure, found.other) == ("250", False, "100")


@pytest.mark.parametrize("has_stamps", [True, False])
def test_a_stated_rate_that_nothing_speaks_against_is_taken(has_stamps):
    """It was asked about in 143 of 161 drafts: nothing falls in a walk."""
    found = guess_rate(replace(raw(walking()), has_stamps=has_stamps), "m")
    assert (found.value, found.is_sure) == ("100", True)
    assert ("as the time stamps run" in found.reason) == has_stamps
    falling = replace(raw(hopping(1)[1]), has_stamps=has_stamps)
    codes = {one.code for one in guess_rate(falling, "m").evidence}
    assert "recordings.rate_confirmed" in codes
    assert ("recordings.rate_of_own_stamps" in codes) == has_stamps
    assert "nothing falls freely" in found.reason


@pytest.mark.parametrize(("stated_hz", "is_sure"), [(100.0, True), (400.0, False)])
def test_a_walk_is_asked_about_only_if_its_markers_would_be_hurled_down(
    stated_hz, is_sure
):
    time = np.arange(2000) / 100
    rise = 0.03 * np.sin(2 * np.pi * 2.0 * time)[:, None, None] * [0.0, 0.0, 1.0]
    walk = RawRecording(
        MARKERS, time, np.arange(7)[:, None] * 0.2 + rise, stated_hz, "m"
    )
    walk = replace(walk, time=np.arange(2000) / stated_hz)
    found = guess_rate(walk, "m")
    assert found.is_sure == is_sure
    assert ("pulled down by" in found.reason) == (not is_sure)


def test_without_free_fall_no_rate_is_offered():
    still = (
        np.random.default_rng(4).normal(0, 1e-4, (2000, 7, 3))
        + np.arange(7)[:, None] * 0.1
    )
    asked = guess_rate(raw(still), "m", is_stated=False)
    assert (asked.value, asked.is_sure) == ("", False)
    assert "nothing falls" in asked.reason


def test_what_cannot_be_guessed_is_said_to_be_unsure():
    drift = np.cumsum(np.random.default_rng(2).normal(0, 1e-3, (3000, 7, 3)), axis=0)
    found, up = guess_unit_and_up(raw(drift + np.arange(7)[:, None] * 0.1))
    assert not up.is_sure
    assert "only usual" in up.reason
    assert found.value == "m"


@pytest.mark.parametrize("turn", [[0, 1, 2], [1, 2, 0], [2, 0, 1]])
@pytest.mark.parametrize("seed", range(5))
def test_who_stands_or_takes_one_step_shows_no_floor(seed, turn):
    """Each marker rests at its own places along every axis."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-0.4, 0.4, (7, 3)) + np.array([0, 0, 1])
    step = np.clip((np.arange(800) - 300) / 60, 0, 1)[:, None, None]
    reached = places + step * rng.uniform(-0.5, 0.5, (7, 3))
    positions = reached + rng.normal(0, 3e-4, (800, 7, 3))
    assert not guess_unit_and_up(raw(positions[..., turn]))[1].is_sure


def test_what_the_user_gives_is_taken():
    found, up = guess_unit_and_up(raw(hopping(1)[1]), unit="mm", up="x")
    assert (found.value, up.value) == ("mm", "x")
    assert found.reason == up.reason == "as given"


def test_no_frames_no_fall():
    fall = free_fall(np.zeros((3, 2, 3)), 100.0)
    assert fall.share == 0.0
    assert not fall.is_clear


# The unit of a recording, and the text where it is a guess.

LENGTH_UNIT_MARKERS = {"body": list(NAMES[:3]), "feet": list(NAMES[3:])}
SILENT = {"Units": None}


def imported(path, **options):
    return import_recording(path, name="trial", markers=LENGTH_UNIT_MARKERS, **options)[
        0
    ]


def trc(folder, *, scale=1000.0, name="a.trc", positions=None, **options):
    positions = standing(scale=scale) if positions is None else positions
    return write(folder, trc_text(positions, NAMES, **options), name)


def c3d(folder, *, scale=1000.0, unit="mm", states=True):
    path = folder / "a.c3d"
    write_c3d(
        path,
        RawRecording(NAMES, np.arange(40) / 100, standing(scale=scale), 100.0, unit),
    )
    if not states:
        path.write_bytes(path.read_bytes().replace(b"UNITS", b"OTHER"))
    return path


def table(folder, *, scale=1000.0):
    """Write a table that only resembles an export: no key names the program."""
    keys = (
        "NO_OF_FRAMES",
        "NO_OF_CAMERAS",
        "NO_OF_MARKERS",
        "FREQUENCY",
        "NO_OF_ANALOG",
    )
    keys += (
        "ANALOG_FREQUENCY",
        "DESCRIPTION",
        "TIME_STAMP",
        "DATA_INCLUDED",
        "MARKER_NAMES",
    )
    bare = dict.fromkeys((*keys, "TRAJECTORY_TYPES"))
    return write(
        folder, qtm_text(standing(scale=scale, wobble=0.002), header=bare), "a.txt"
    )


def test_of_two_units_never_both_fit():
    for size in np.geomspace(1e-4, 1e5, 200):
        positions = size * UPRIGHT[np.newaxis]
        by_mm = choose_unit(positions, unit="auto", nominal="mm")
        by_m = choose_unit(positions, unit="auto", nominal="m")
        assert (
            by_mm == by_m or size < 0.1 or size > 10
        )  # else the format's own unit stays


@pytest.mark.parametrize(("scale", "unit"), [(1000.0, "mm"), (1.0, "m")])
@pytest.mark.parametrize(
    "silent",
    [
        lambda folder, scale: trc(folder, scale=scale, values=SILENT),
        lambda folder, scale: c3d(folder, scale=scale, states=False),
        lambda folder, scale: table(folder, scale=scale),
    ],
    ids=["trc", "c3d", "table"],
)
def test_a_guess_is_said_until_the_unit_is_given(tmp_path, silent, scale, unit):
    path = silent(tmp_path, scale)
    guessed, given = imported(path), imported(path, unit=unit)
    assert np.array_equal(guessed.positions, given.positions)
    assert given.remarks == ()
    (remark,) = guessed.remarks
    assert remark == (
        f"{path}: unit: expected the file to state it, found none; taken for {unit}, in which the "
        f"markers span {extent(guessed.positions):.3g} m; input.unit: {unit} makes it certain"
    )
    assert remark in map(str, notes(guessed))


def test_what_the_file_states_or_its_format_prescribes_is_no_guess(tmp_path):
    files = [
        trc(tmp_path),
        c3d(tmp_path),
        c3d(tmp_path, scale=1.0, unit="m"),
        write(tmp_path, qtm_text()),
    ]
    for path in files:
        assert imported(path).remarks == ()


def test_a_stated_unit_that_cannot_be_is_said(tmp_path):
    path = trc(tmp_path, scale=1.0)
    assert imported(path).remarks == (
        f"{path}: unit: expected mm as stated, found markers that would span 0.000603 m in it; "
        "taken for m, in which the markers span 0.603 m; input.unit: m makes it certain",
    )
    assert imported(path, unit="m").remarks == ()


def test_the_fall_is_a_reason(tmp_path):
    """Every second all markers fly for 0.4 s."""
    time = np.arange(200) / 100
    phase = np.clip(time % 1.0, 0, 0.4)
    height = 0.5 * 9.81 * phase * (0.4 - phase)
    positions = np.tile(1000 * UPRIGHT, (200, 1, 1))
    positions[:, :, 2] += 1000 * height[:, None]
    (remark,) = imported(trc(tmp_path, positions=positions, values=SILENT)).remarks
    assert "in which the markers span 0.601 m and fall at 9.81 m/s² in 34 %" in remark
    assert "of the frames; input.unit: mm makes" in remark


def test_of_joined_files_those_that_are_silent_are_named(tmp_path):
    rows = [
        trc(tmp_path, name="a.trc"),
        *(trc(tmp_path, name=f"{name}.trc", values=SILENT) for name in "bc"),
    ]
    (remark,) = [remark for remark in imported(rows).remarks if "unit" in remark]
    assert remark.startswith(
        f"{tmp_path}/b.trc and 1 more: unit: expected the file to state it"
    )


def mixed(folder, *, stated, silent):
    """Write two files of one animal in these units; the second does not state its own."""
    scale = {"m": 1.0, "mm": 1000.0}
    return [
        trc(folder, name="a.trc", scale=scale[stated], values={"Units": stated}),
        trc(folder, name="b.trc", scale=scale[silent], values=SILENT),
    ]


@pytest.mark.parametrize("unit", ["m", "mm"])
def test_a_silent_file_is_joined_in_the_unit_of_the_one_that_states_it(tmp_path, unit):
    rows = mixed(tmp_path, stated=unit, silent=unit)
    guessed, given = imported(rows), imported(rows, unit=unit)
    assert np.array_equal(guessed.positions, given.positions)
    assert extent(given.positions) == pytest.approx(0.6, abs=0.01)
    assert not any("unit" in remark for remark in given.remarks)
    (remark,) = [remark for remark in guessed.remarks if "unit" in remark]
    assert remark.startswith(
        f"{tmp_path}/b.trc: unit: expected the file to state it, found none"
    )


@pytest.mark.parametrize(("stated", "silent"), [("m", "mm"), ("mm", "m")])
def test_a_silent_file_of_another_size_is_not_joined(tmp_path, stated, silent):
    rows = mixed(tmp_path, stated=stated, silent=silent)
    with pytest.raises(RecordingError) as caught:
        imported(rows)
    for part in (
        f"{rows[1]}: unit: expected {stated} as in {rows[0]}",
        f"fit {silent} only",
    ):
        assert part in str(caught.value)


def test_of_joined_files_the_silent_and_the_overruled_are_named(tmp_path):
    rows = [
        trc(tmp_path, name="a.trc", scale=1.0, values={"Units": "mm"}),
        trc(tmp_path, name="b.trc", scale=1.0, values=SILENT),
    ]
    guessed = imported(rows)
    assert extent(guessed.positions) == pytest.approx(0.6, abs=0.01)
    silent, overruled = [remark for remark in guessed.remarks if "unit" in remark]
    assert silent.startswith(
        f"{rows[1]}: unit: expected the file to state it, found none"
    )
    assert overruled.startswith(
        f"{rows[0]}: unit: expected mm as stated, found markers that would"
    )
    assert not any("unit" in remark for remark in imported(rows, unit="m").remarks)


def test_a_file_in_which_no_size_is_seen_keeps_the_usual_unit(tmp_path):
    positions = standing()
    positions[:, 1:] = np.nan
    (remark,) = imported(trc(tmp_path, positions=positions, values=SILENT)).remarks
    assert "taken for mm, which is usual; input.unit: mm makes it certain" in remark


def turned(positions, up):
    """Return positions, z up, along the axes of a file in which `up` points up."""
    return positions @ np.linalg.inv(rotate_up(np.eye(3), up))


SQUATTING = {"body": ["hip1", "hip2", "hip3"], "feet": ["toe1", "toe2"]}
OF_SQUAT = ("hip1", "hip2", "hip3", "toe1", "toe2", "C7", "sho1", "sho2")


def squatting(seed, *, ahead_m=0.1, up="z"):
    """Return the recording of someone who squats six times, the body `ahead_m` of the feet.

    The shoulders come back to one height again and again, as a foot does to a floor.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0, 15.0, 0.04)
    depth = np.zeros(len(time))
    for k in range(6):
        depth += 0.38 * np.sin(np.pi * np.clip((time - 0.6 - 2.4 * k) / 1.7, 0, 1)) ** 2
    body = [[0.1, -0.13, 0.9], [0.1, 0.13, 0.9], [-0.1, 0.0, 0.95]]
    shoulders = [[0.0, 0.0, 1.46], [0.0, -0.16, 1.43], [0.0, 0.16, 1.43]]
    toes = [[-ahead_m, -0.2, 0.07], [-ahead_m, 0.2, 0.07]]
    places = np.array(body + toes + shoulders)
    sinks = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 1.05, 1.05, 1.05])
    positions = places - depth[:, None, None] * sinks[:, None] * [0, 0, 1]
    positions += rng.normal(0, 4e-4, positions.shape)
    return replace(raw(turned(positions, up), rate_hz=25.0), markers=OF_SQUAT)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_a_body_is_above_its_feet(seed, up):
    recording = squatting(seed, up=up)
    with_roles = guess_unit_and_up(recording, markers=SQUATTING)[1]
    assert (with_roles.value, with_roles.is_sure) == (up, True)
    assert "the body is above the feet" in with_roles.reason
    nameless = replace(recording, markers=tuple("abcdefgh"))
    assert not guess_unit_and_up(nameless)[1].is_sure


@pytest.mark.parametrize(
    ("ahead_m", "is_sure"), [(0.1, True), (0.3, True), (0.7, False)]
)
def test_a_body_beside_its_feet_shows_no_vertical(ahead_m, is_sure):
    found = guess_unit_and_up(squatting(1, ahead_m=ahead_m), markers=SQUATTING)[1]
    assert found.is_sure == is_sure


def test_the_file_against_the_markers_is_asked_about():
    asked = replace(squatting(2), stated_up="y")
    found = guess_unit_and_up(asked, markers=SQUATTING)[1]
    assert (found.value, found.other, found.is_sure) == ("z", "y", False)
    agreed = replace(asked, stated_up="z")
    assert guess_unit_and_up(agreed, markers=SQUATTING)[1].is_sure


def test_what_speaks_weakly_against_a_sure_direction_is_told():
    walk = raw(walking())
    roles = {"body": MARKERS[:3], "feet": MARKERS[3:6]}
    stated = {}
    for axis in ("", "z", "y"):
        found = guess_unit_and_up(replace(walk, stated_up=axis), markers=roles)[1]
        assert found.value == "z"
        stated[axis] = found
    assert all(one.is_sure for one in stated.values())
    assert "for y speaks: the file says so" in stated["y"].reason
    for axis in ("", "z"):
        assert "speaks" not in stated[axis].reason


def test_a_floor_against_the_markers_is_asked_about():
    """Feet that rest again and again along z, of a body that is said to be ahead of them."""
    walk = raw(walking())
    walk.positions[:, :3, 0] += 3.0
    roles = {"body": MARKERS[:3], "feet": MARKERS[3:6]}
    found = guess_unit_and_up(walk, markers=roles)[1]
    assert (found.value, found.other, found.is_sure) == ("z", "x", False)
    assert "the body is above the feet" in found.reason
    assert guess_unit_and_up(raw(walking()), markers=roles)[1].is_sure


def test_gravity_decides_against_exchanged_roles():
    exchanged = {"body": SQUATTING["feet"], "feet": SQUATTING["body"]}
    found = guess_unit_and_up(raw(hopping(1)[1]), markers=exchanged)[1]
    assert (found.value, found.is_sure) == ("z", True)
    assert "fall along it" in found.reason


@pytest.mark.parametrize("known", [{}, {"body": ["a"]}, {"body": ["k"], "feet": ["l"]}])
def test_roles_of_which_the_file_has_only_one_say_nothing(known):
    recording = replace(squatting(1), markers=tuple("abcdefgh"))
    found = guess_unit_and_up(recording, markers=known)[1]
    assert found == guess_unit_and_up(recording)[1]
    assert not found.is_sure


def test_names_serve_where_no_roles_are_given():
    recording = squatting(1, up="y")
    named = inspect_recording(recording).up
    assert (named.value, named.is_sure) == ("y", True)
    nameless = replace(recording, markers=tuple("abcdefgh"))
    assert inspect_recording(nameless).up.value != "y"


@pytest.mark.parametrize(("up", "is_sure"), [("x", False), ("y", True)])
def test_only_what_falls_along_the_vertical_speaks_against_a_stated_rate(up, is_sure):
    falls_along_x = turned(hopping(1)[1], "x")
    found = guess_rate(
        raw(falls_along_x, rate_hz=50.0), "m", up=up
    )  # half of the true rate
    assert found.is_sure == is_sure
