from dataclasses import replace

import numpy as np
import pytest
from made_up_people import ANIMAL_SETS, MARKER_SETS, animal, in_file, person
from scipy.spatial.transform import Rotation

from hopdata.recordings.axes import DIRECTIONS
from hopdata.recordings.quality import evidence, orientation
from hopdata.recordings.quality.free_fall import FreeFall
from hopdata.recordings.quality.inspection import inspect_recording
from hopdata.recordings.quality.orientation import guess_unit_and_up
from hopdata.recordings.quality.roles import guess_roles
from hopdata.recordings.quality.vocabulary import named_parts
from hopdata.recordings.raw import RawRecording


def file_of(made, up="z", *, unit="m", **fields):
    """Return a made-up person as read from a file in which `up` points up."""
    metres = {"m": 1.0, "mm": 1e-3}[unit]
    time = np.arange(len(made.positions)) / made.rate_hz
    positions = in_file(made.positions, up) / metres
    return RawRecording(made.names, time, positions, made.rate_hz, unit, **fields)


@pytest.mark.parametrize("marker_set", MARKER_SETS)
@pytest.mark.parametrize("posture", ["walk", "treadmill", "run", "stand"])
def test_the_names_of_a_person_show_up_and_unit(posture, marker_set):
    made = person(7, posture, marker_set, seconds=2.0)
    for up, suffix, unit in (("z", ".c3d", "mm"), ("y", ".trc", "m")):
        raw = file_of(made, up, unit=unit, suffix=suffix)
        found_unit, found = guess_unit_and_up(raw)
        assert (found.value, found.is_sure) == (up, True)
        assert (found_unit.value, found_unit.is_sure) == (unit, True)
        assert "the parts that the names mean" in found.reason


@pytest.mark.parametrize("marker_set", ["Plug-in Gait", "Rizzoli", "German"])
@pytest.mark.parametrize("posture", ["walk", "stand", "sit", "lie"])
def test_the_feet_are_known_by_name_whether_they_land_or_not(posture, marker_set):
    made = person(8, posture, marker_set, seconds=2.0)
    roles = guess_roles(inspect_recording(file_of(made), unit="m", up="z"))
    assert roles.feet
    assert set(roles.feet) <= made.feet
    assert "feet" not in roles.unsure


@pytest.mark.parametrize("marker_set", ANIMAL_SETS)
def test_an_animal_stands_on_its_paws(marker_set):
    made = animal(3, marker_set)
    for up in ("z", "-y"):
        found = guess_unit_and_up(file_of(made, up))[1]
        assert (found.value, found.is_sure) == (up, True)
    roles = guess_roles(inspect_recording(file_of(made), unit="m", up="z"))
    assert roles.feet
    assert set(roles.feet) <= made.feet


def one_side_of(raw, beginning):
    """Return a recording without the markers whose names begin so."""
    kept = [m for m, name in enumerate(raw.markers) if not name.startswith(beginning)]
    names = tuple(raw.markers[m] for m in kept)
    return replace(raw, markers=names, positions=raw.positions[:, kept])


@pytest.mark.parametrize(("up", "suffix"), [("z", ".c3d"), ("y", ".trc")])
def test_who_pushes_off_at_every_step_is_not_surely_upside_down(up, suffix):
    made = person([402, 9, 1], "treadmill", "OpenPose")
    found = guess_unit_and_up(file_of(made, up, suffix=suffix))[1]
    assert any("fall along it" in str(one) for one in found.evidence)
    assert (found.value, found.other, found.is_sure) == (up, f"-{up}", False)


@pytest.mark.parametrize(("share", "overrules"), [(0.045, False), (0.2, True)])
def test_a_frequent_fall_overrules_all_else(share, overrules):
    fall = FreeFall("m", "-z", share, next_share=0.0, spread=1.0)
    found = evidence.by_fall(fall)
    assert found.best == "-z"
    assert found.margin("-z", "z") > orientation.SURE  # enough where it is alone
    assert (found.margin("-z", "z") > -np.log(orientation.FALL_DECIDES)) == overrules


def test_what_is_asked_has_two_candidates_with_reasons():
    made = person(5, "stand", "MediaPipe", seconds=1.0)
    one_side = one_side_of(file_of(made, "-x", suffix=".c3d"), "right")
    found = guess_unit_and_up(one_side)[1]
    assert (found.value, found.other, found.is_sure) == ("-x", "z", False)
    assert "usual in such files" in found.reason


def test_without_names_who_stands_is_asked_about():
    made = person(9, "stand", "Plug-in Gait", seconds=2.0)
    plain = tuple(f"m{k}" for k in range(len(made.names)))
    found = guess_unit_and_up(replace(file_of(made), markers=plain))[1]
    assert not found.is_sure
    roles = guess_roles(
        inspect_recording(replace(file_of(made), markers=plain), unit="m", up="z")
    )
    assert roles.problems


def test_names_that_lie_anywhere_are_asked_about():
    made = person(10, "stand", "Plug-in Gait", seconds=1.0)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        order = rng.permutation(len(made.names))
        mixed = replace(file_of(made), positions=made.positions[:, order])
        assert not guess_unit_and_up(mixed)[1].is_sure


def test_a_statement_alone_is_not_sure_and_beside_names_it_is():
    made = person(11, "stand", "Plug-in Gait", seconds=1.0)
    plain = tuple(f"m{k}" for k in range(len(made.names)))
    stated = file_of(made, stated_up="y", suffix=".c3d")
    alone = guess_unit_and_up(replace(stated, markers=plain))[1]
    assert not alone.is_sure
    assert {alone.value, alone.other} == {"y", "z"}
    # Of one side alone: that left is beside right would be a second piece.
    stated = one_side_of(replace(stated, positions=made.positions), "R")
    against = guess_unit_and_up(stated)[1]
    assert (against.value, against.other, against.is_sure) == ("z", "y", False)
    assert "for y speaks: the file says so" in against.reason
    agreed = guess_unit_and_up(replace(stated, stated_up="z"))[1]
    assert (agreed.value, agreed.is_sure) == ("z", True)


def test_two_strong_pieces_overrule_a_wrong_statement():
    made = person(12, "walk", "Plug-in Gait", seconds=8.0)
    wrong = file_of(made, "y", stated_up="z", suffix=".c3d")
    found = guess_unit_and_up(wrong)[1]
    assert (found.value, found.is_sure) == ("y", True)


def test_the_statures_of_another_unit_are_asked_about():
    made = person(13, "stand", "Plug-in Gait", seconds=1.0)
    in_cm = replace(file_of(made, unit="mm"), positions=100 * made.positions)
    found = guess_unit_and_up(in_cm)[0]
    assert (found.value, found.other, found.is_sure) == ("mm", "cm", False)
    assert "tall by the names" in found.reason


def test_each_piece_leaves_every_direction_possible():
    made = person(14, "walk", "Plug-in Gait", seconds=4.0)
    named = named_parts(made.names)
    posture = evidence.posture_of(made.positions, named)
    assert np.linalg.norm(posture.stature) == pytest.approx(1.6, abs=0.7)
    pieces = [
        evidence.by_habit(".trc"),
        evidence.by_fall(FreeFall("m", "z", 0.2, 0.01, spread=1.0)),
        evidence.by_statement("z"),
        evidence.by_posture(posture, named, given=False, others=()),
        evidence.by_sides(made.positions, named),
        evidence.by_stance(made.positions, made.rate_hz),
    ]
    for piece in pieces:
        chances = np.exp([piece.log_likelihood[up] for up in DIRECTIONS])
        assert chances.sum() == pytest.approx(1.0)
        assert (chances > 0).all()
    assert pieces[0].best == "y"
    for piece in (*pieces[1:4], pieces[5]):
        assert piece.best == "z"
    left_to_right = pieces[4]
    assert left_to_right.log_likelihood["z"] == left_to_right.log_likelihood["-z"]
    assert sum(np.exp([*evidence.log_odds(pieces).values()])) == pytest.approx(1.0)


@pytest.mark.parametrize("marker_set", ["OpenSim", "French", "German", "Rizzoli"])
def test_who_lies_is_asked_about_and_who_stands_is_not(marker_set):
    for up, suffix in (("z", ".c3d"), ("y", ".trc")):
        for seed in range(3):
            lying = person([30, seed], "lie", marker_set, seconds=1.0)
            guess = guess_unit_and_up(file_of(lying, up, suffix=suffix))[1]
            assert guess.value == up or not guess.is_sure
            standing = person([30, seed], "stand", marker_set, seconds=1.0)
            guess = guess_unit_and_up(file_of(standing, up, suffix=suffix))[1]
            assert (guess.value, guess.is_sure) == (up, True)


@pytest.mark.parametrize("marker_set", ["OpenSim", "French", "Rizzoli", "clusters"])
@pytest.mark.parametrize("aside_degrees", [10.0, 20.0])
def test_who_lies_along_the_usual_axis_of_a_format_is_asked_about(
    marker_set, aside_degrees
):
    lying = person([33, 2], "lie", marker_set, seconds=1.0)
    named = named_parts(lying.names)
    to_x, to_y, _ = evidence.posture_of(lying.positions, named).stature
    heading = np.degrees(np.arctan2(to_y, to_x))
    for quarter in range(4):
        turn = 90.0 * quarter + aside_degrees - heading
        about = Rotation.from_euler("z", turn, degrees=True).as_matrix()
        places = np.einsum("ij,nmj->nmi", about, lying.positions)
        raw = file_of(replace(lying, positions=places), "y", suffix=".c3d")
        guess = guess_unit_and_up(raw)[1]
        assert guess.value == "y" or not guess.is_sure


def margin_of_posture(made, tilt_degrees):
    """Return how much likelier up is for one who stands, or leans so much."""
    named = named_parts(made.names)
    stature = evidence.posture_of(made.positions, named).stature
    upright, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [stature])
    tilted = Rotation.from_euler("x", tilt_degrees, degrees=True) * upright
    places = np.einsum("ij,nmj->nmi", tilted.as_matrix(), made.positions)
    posture = evidence.posture_of(places, named)
    found = evidence.by_posture(posture, named, given=False, others=())
    return found.margin("z", "x")


@pytest.mark.parametrize("marker_set", ["Plug-in Gait", "Qualisys", "OpenSim"])
def test_who_stands_still_is_nearly_upright_and_who_sits_is_not(marker_set):
    """Who lies leans by any angle, as seen from a file's axis."""
    standing = person([31, 5], "stand", marker_set, seconds=1.0)
    upright, leaning = (margin_of_posture(standing, tilt) for tilt in (1.0, 12.0))
    assert leaning < upright - 1.0
    # Who sits is bent, as nobody is who lies straight.
    sitting = person([31, 5], "sit", marker_set, seconds=1.0)
    upright, leaning = (margin_of_posture(sitting, tilt) for tilt in (1.0, 12.0))
    assert leaning > upright - 0.1


def test_a_floor_tells_that_a_body_does_not_lie():
    made = person(14, "stand", "Plug-in Gait", seconds=1.0)
    named = named_parts(made.names)
    posture = evidence.posture_of(made.positions, named)
    level = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=float)
    plates = evidence.by_plates(level, made.positions)
    on_a_wall = evidence.by_plates(in_file(level, "y"), made.positions)
    alone, stands, leans = (
        evidence.by_posture(posture, named, given=False, others=others)
        for others in ((), (plates,), (on_a_wall,))
    )
    assert stands.margin("z", "y") > alone.margin("z", "y") + 1.0
    assert leans.margin("z", "y") == alone.margin("z", "y")
    # Nobody who lies has the head below the feet.
    assert alone.margin("z", "-z") > alone.margin("z", "y") + 1.0


def test_who_moves_on_the_feet_does_not_lie():
    for doing, folds, strides in (
        ("stand", False, False),
        ("lie", False, False),
        ("squat", True, False),
        ("treadmill", False, True),
    ):
        made = person(17, doing, "Plug-in Gait", seconds=2.0)
        posture = evidence.posture_of(made.positions, named_parts(made.names))
        assert (posture.folding > evidence.FOLDS) == folds
        assert (posture.striding > evidence.STRIDES) == strides


def test_few_markers_that_fall_are_weak_evidence():
    few = evidence.by_fall(FreeFall("m", "y", 0.02, 0.001, spread=0.2))
    all_of_them = evidence.by_fall(FreeFall("m", "y", 0.2, 0.001, spread=1.0))
    assert few.margin("y", "z") < 3.0 < 10.0 < all_of_them.margin("y", "z")
    assert evidence.by_fall(FreeFall("m", "y", 0.02, 0.01)) is None


def test_level_plates_below_the_markers_show_up():
    made = person(16, "stand", "Plug-in Gait", seconds=1.0)
    level = np.array(
        [[[0, 0, 0], [0.4, 0, 0], [0.4, 0.6, 0], [0, 0.6, 0]]], dtype=float
    )
    for up in ("z", "y", "-x"):
        found = evidence.by_plates(in_file(level, up), in_file(made.positions, up))
        assert found.best == up
        plain = tuple(f"m{k}" for k in range(len(made.names)))
        raw = file_of(made, up, plate_corners=in_file(level, up), stated_up=up)
        guess = guess_unit_and_up(replace(raw, markers=plain))[1]
        assert (guess.value, guess.is_sure) == (up, up != "-x")
    on_a_wall = np.concatenate([level, in_file(level, "y")])
    assert evidence.by_plates(on_a_wall, made.positions) is None
    assert evidence.by_plates(0 * level, made.positions) is None
    assert evidence.by_plates(None, made.positions) is None


@pytest.mark.parametrize("posture", ["treadmill", "stand"])
def test_who_stays_in_place_shows_no_stance(posture):
    made = person(15, posture, "Plug-in Gait", seconds=4.0)
    assert evidence.by_stance(made.positions, made.rate_hz) is None


@pytest.mark.parametrize("marker_set", ["Plug-in Gait, legs", "Rizzoli", "clusters"])
def test_a_stated_unit_in_which_a_person_is_as_tall_as_people_is_kept(marker_set):
    made = person(5, "jump", marker_set)
    raw = file_of(made, unit="m", suffix=".trc")
    faster = 0.0254**0.5
    quick = replace(raw, time=raw.time * faster, rate_hz=raw.rate_hz / faster)
    assert guess_unit_and_up(quick)[0].value == "m"
    unnamed = replace(quick, markers=tuple(f"m{k}" for k in range(len(made.names))))
    assert guess_unit_and_up(unnamed)[0].value == "inch"
    wrong = replace(raw, positions=raw.positions / 0.0254)
    found = guess_unit_and_up(wrong)[0]
    assert (found.value, found.is_sure) == ("inch", True)
