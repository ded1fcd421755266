import jumps as jumps_of
import numpy as np
import pytest
from checkouts import ROOT, part_of_sample
from made_up_hopper import MARKERS, hopping, with_gap, with_spike, with_swap
from made_up_jumps import STYLES, jumping

from hopdata.recordings.quality.feet import of_one_side
from hopdata.recordings.quality.inspection import inspect_recording
from hopdata.recordings.quality.landing_markers import feet_between
from hopdata.recordings.quality.part_names import (
    part_by_name,
    place_by_name,
    subject_prefixes,
)
from hopdata.recordings.quality.roles import guess_roles
from hopdata.recordings.raw import RawRecording


def roles(positions, markers=MARKERS, rate_hz=100.0):
    raw = RawRecording(
        markers, np.arange(len(positions)) / rate_hz, positions, rate_hz, "m"
    )
    return guess_roles(inspect_recording(raw))


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("R_mt1", "foot"),
        ("L.Heel.Top", "foot"),
        ("FOOT3", "foot"),
        ("RToe", "foot"),
        ("hip left", "body"),
        ("R.ASIS", "body"),
        ("body1", "body"),
        ("LPSI", "body"),
        ("boom", "boom"),
        ("RHEE", "foot"),
        ("L_FCC", "foot"),
        ("R_FM5", "foot"),
        ("LANK", "ankle"),
        ("R.Ankle.Lat", "ankle"),
        ("L_FAL", "ankle"),
        ("L_IPS", "body"),
        ("LSACR", "body"),
        ("LKNE", ""),
        ("R.Shank.Top.Medial", ""),
        ("Marker 7", ""),
        ("", ""),
    ],
)
def test_part_by_name(name, part):
    assert part_by_name(name) == part


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("LHEE", "RHEE"),
        ("L_mt1", "rMT1"),
        ("LeftFootIn", "RightFootIn"),
        ("toe_l", "R.Toe"),
    ],
)
def test_both_sides_have_places_of_the_same_name(left, right):
    assert place_by_name(left) == place_by_name(right)
    assert place_by_name("LMT1") != place_by_name("LMT5")


@pytest.mark.parametrize("size", [1 / 256, 1 / 16, 4.0])
def test_roles_do_not_depend_on_the_size_of_the_animal(size):
    positions = hopping(5, n_frames=3000)[1]
    found, other = (
        roles(positions),
        roles(size * positions, rate_hz=100 / np.sqrt(size)),
    )
    assert found.feet
    assert (other.feet, other.body, other.boom) == (found.feet, found.body, found.boom)


@pytest.mark.parametrize("jumps", [1, 2, 4])
@pytest.mark.parametrize("style", STYLES)
def test_jumps_on_two_feet_with_heels_and_toes(style, jumps):
    names = STYLES[style]
    found = roles(jumping([jumps, *style.encode()], jumps=jumps), names)
    feet = {names.index(name) for name in found.feet}
    heels_and_toes = {4, 5, 10, 11}
    if style == "numbers":  # by motion alone: the lowest markers, on both sides
        assert feet <= {*range(4, 9), *range(10, 15)}
        assert len(feet & {4, 5, 6, 7, 8}) == len(feet) / 2 >= 2
    else:
        assert feet > heels_and_toes
        assert feet <= {*range(4, 8), *range(10, 14)}, "no ankle"
        assert set(found.body) == set(names[:4])
        assert "one rigid part" not in str(found.reasons["feet"])
        assert {n: {*of} for n, of in found.joined.items()} == {
            "left": {name for name in found.feet if names.index(name) < 10},
            "right": {name for name in found.feet if names.index(name) >= 10},
        }
    assert found.problems == ()
    assert found.other_feet == ()


@pytest.mark.parametrize("seed", range(3))
def test_feet_whose_soles_give_at_each_landing_are_found(seed):
    soft = jumps_of.KINDS["series, soft 8 ms"]
    seen, _ = jumps_of.make(soft, 11, np.random.default_rng(seed), 100.0, 5e-4)
    found = roles(seen, jumps_of.NAMES)
    assert {*found.feet} == {"LTOE", "LHEE", "RTOE", "RHEE"}
    assert {*found.body} == {*jumps_of.PELVIS}


def test_feet_that_land_together_are_not_one_for_keeping_their_distance():
    assert roles(jumping(1, jumps=2), STYLES["numbers"]).joined == {}
    legs = [f"{'RL'[4 <= n < 10]}{n}" for n in range(len(STYLES["numbers"]))]
    assert roles(jumping(1, jumps=2), legs).joined == {}
    assert roles(hopping(1)[1]).joined == {}


def test_heels_and_toes_of_two_sides_may_be_on_one_foot_each():
    names = ["LHEE", "LTOE", "RHEE", "RTOE", "LASI"]
    assert of_one_side(names[:4], names) == {
        "left": ["LHEE", "LTOE"],
        "right": ["RHEE", "RTOE"],
    }
    assert of_one_side(names[:2], names) == {}  # those of a study of one foot
    for legs in (["FL", "FR", "HL", "HR"], ["foot1", "foot2", "foot3", "foot4"]):
        assert of_one_side(legs, legs) == {}


@pytest.mark.parametrize(("above_m", "is_used"), [(0.0, True), (0.06, False)])
def test_left_and_right_foot_have_the_same_markers(above_m, is_used):
    # One heel never stays where it is lowest.
    names = STYLES["plug-in gait"]
    positions = jumping(3, jumps=2)
    heel = names.index("RHEE")
    positions[:, heel, 2] += above_m + 0.05 * (np.arange(len(positions)) % 3)
    found = roles(positions, names)
    assert {"LHEE", "LTOE", "RTOE"} <= {*found.feet}
    assert ("RHEE" in found.feet) == is_used
    assert ("RHEE as on the other foot" in str(found.reasons["feet"])) == is_used
    told = "RHEE does not come down to rest as LHEE does"
    assert (told in str(found.reasons["unused"])) != is_used


def test_feet_that_are_all_of_one_side_need_no_counterparts():
    names = STYLES["plug-in gait"]
    positions = jumping(3, jumps=3)
    # The left leg is held up, but for the standing before.
    held = np.arange(len(positions)) > 40
    positions[held, 4:10, 2] += 0.3
    found = roles(positions, names)
    assert {name[0] for name in found.feet} == {"R"}


def bent(positions, by_m):
    """Move both heels along x against their feet, as far as `by_m`, all the time."""
    moved = positions.copy()
    swing = by_m * np.sin(0.3 * np.arange(len(positions)))
    for heel in (4, 10):
        moved[:, heel, 0] += swing
    return moved


def test_heel_and_toe_by_name_are_one_foot_however_far_it_bends():
    """One marker set has the same feet in each trial; a leg apart is no bent foot."""
    positions = jumping(1, jumps=2)
    for by_m, is_one in ((0.0, True), (0.025, True), (0.15, False)):
        found = roles(bent(positions, by_m), STYLES["plug-in gait"])
        assert ([*found.joined] == ["left", "right"]) == is_one
        if is_one:
            assert {*found.joined["left"]} >= {"LHEE", "LTOE"}
    # L0, L1, ... may be legs, for which distances decide.
    legs = [f"{'RL'[4 <= n < 10]}{n}" for n in range(len(STYLES["numbers"]))]
    assert roles(bent(positions, 0.025), legs).joined == {}


def test_ankles_are_taken_where_there_is_no_foot():
    positions, names = jumping(3), STYLES["plug-in gait"]
    kept = [
        m
        for m, name in enumerate(names)
        if name[1:] not in ("HEE", "TOE", "MT1", "MT5")
    ]
    found = roles(positions[:, kept], tuple(names[m] for m in kept))
    assert found.feet == ("LANK", "RANK")


def test_where_all_stand_still_no_marker_is_a_boom():
    found = roles(jumping(4)[:60] * 0.1, STYLES["opensim"])
    assert found.boom == ()


def test_a_foot_that_stands_throughout_is_a_foot_and_no_boom():
    swaying = jumping(4)[:60].copy()
    names = STYLES["opensim"]
    foot = [*names].index("R.Toe.Tip")
    swaying += 0.3 * np.linspace(0.0, 1.0, 60)[:, None, None] * [1.0, 0.0, 0.0]
    swaying[:, foot] = swaying[0, foot]
    found = roles(swaying, names)
    assert "R.Toe.Tip" in found.feet
    assert "R.Toe.Tip" not in found.boom


def test_feet_that_never_land_are_taken_by_name_or_asked_for():
    standing = jumping(4)[:60]
    found = roles(standing, STYLES["opensim"])
    assert {"L.Heel", "R.Heel", "L.Toe.Tip", "R.Toe.Tip"} <= set(found.feet)
    assert all(part_by_name(name) == "foot" for name in found.feet)
    assert str(found.reasons["feet"]).startswith("by name alone")
    assert found.problems == ()
    (problem,) = roles(standing, STYLES["numbers"]).problems
    assert "nearest to the floor: " in str(problem)
    # A toe or a hip alone may be anybody's: without landings it is asked for.
    (problem,) = roles(hopping(1)[1][40:60]).problems
    assert problem.code == "recordings.no_feet"
    assert "leave it and land, found none" in str(problem)
    assert "named as feet: " in str(problem)


@pytest.mark.parametrize(
    "spoilt",
    [
        lambda p: with_spike(p, "hip1", 700, 0.05),
        lambda p: with_gap(p, "hip1", 100, 300),
        lambda p: with_swap(p, "hip1", "toe2", 900, 960),
    ],
    ids=["spike", "gap", "swap"],
)
def test_the_home_marker_is_one_that_inspect_calls_good(spoilt):
    positions = hopping(5)[1]
    assert roles(positions).home == ("hip1",)
    found = roles(spoilt(positions))
    assert found.body[0] == "hip1"
    assert found.home == ("hip2",)
    assert "without fault; hip1: " in str(found.reasons["home"])


def test_forward_is_between_the_markers_on_the_front_of_the_pelvis():
    named = {"hip1": "SACR", "hip2": "RASI", "hip3": "LASI"}
    markers = tuple(named.get(name, name) for name in MARKERS)
    found = roles(hopping(5)[1], markers)
    assert set(found.home) == {"LASI", "RASI"}
    assert "on the front of the pelvis" in str(found.reasons["home"])


def test_of_body_markers_that_are_all_suspected_home_is_the_least_bad():
    positions = hopping(5)[1]
    for name, frames in {
        "hip1": (300, 700),
        "hip2": (300, 900),
        "hip3": (400,),
    }.items():
        for frame in frames:
            positions = with_spike(positions, name, frame, 0.05)
    found = roles(positions)
    assert found.home == ("hip3",)
    assert "the best of the body's, none of them without fault: 1 susp" in str(
        found.reasons["home"]
    )


@pytest.mark.parametrize("seed", range(5))
def test_roles_by_motion_alone(seed):
    order = np.random.default_rng(seed).permutation(7)
    names = tuple(f"Marker {i}" for i in range(7))
    found = roles(hopping(seed)[1][:, order], names)
    part = {MARKERS[m]: names[i] for i, m in enumerate(order)}
    assert set(found.body) == {part[f"hip{i}"] for i in (1, 2, 3)}
    assert set(found.feet) == {part[f"toe{i}"] for i in (1, 2, 3)}
    assert found.boom == (part["post"],)
    assert "fixed in the world" in str(found.reasons["boom"])
    assert "rest near the floor" in str(found.reasons["feet"])
    assert found.problems == ()


def test_feet_on_one_shoe_at_different_heights_are_told_apart():
    positions = hopping(1)[1]
    assert "one rigid part" not in str(roles(positions).reasons["feet"])
    positions[:, 3, 2] += 0.02
    assert "one rigid part; 20 mm apart in height" in str(
        roles(positions).reasons["feet"]
    )
    positions[:, 3, 2] += 0.02
    found = roles(positions)
    assert found.feet == ("toe2", "toe3")
    assert "left out, higher on it: toe1" in str(found.reasons["feet"])


def test_feet_that_land_in_between_are_named():
    positions = hopping(1)[1]
    names = (*MARKERS, "paw1", "paw2")
    paws = positions[:, 3:5].copy()
    paws[:, :, 2] += np.where(positions[:, 3, 2] > 0.02, 0.0, 0.1)[
        :, None
    ]  # down in flight
    paws[:, :, 2] -= np.where(positions[:, 3, 2] > 0.02, positions[:, 3, 2], 0.0)[
        :, None
    ]
    both = np.concatenate([positions, paws], axis=1)
    toes = ("toe1", "toe2", "toe3")
    assert feet_between(names, both, 100.0, toes) == ["paw1", "paw2"]
    assert feet_between(MARKERS, positions, 100.0, toes) == []


def test_a_fixed_marker_below_the_floor_is_not_the_floor():
    positions = hopping(1)[1]
    positions[:, 6, 2] -= 2.0
    found = roles(positions)
    assert found.feet == ("toe1", "toe2", "toe3")
    assert found.boom == ("post",)


def test_of_eight_feet_it_is_said_which_are_left_out():
    positions = hopping(1)[1]
    rng = np.random.default_rng(2)
    more = positions[:, [3, 4, 5, 3, 4]] + rng.normal(0, 6e-4, (len(positions), 5, 3))
    more[:, :, 0] += 0.05
    names = (*MARKERS, *(f"toe{k}" for k in range(4, 9)))
    found = roles(np.concatenate([positions, more], axis=1), names)
    assert len(found.feet) == 6
    left = sorted({f"toe{k}" for k in range(1, 9)} - set(found.feet))
    assert f"6 at most, left out: {', '.join(left)}" in str(found.reasons["feet"])
    assert found.problems == ()


def test_the_file_s_order_is_kept():
    found = roles(hopping(1)[1])
    assert found.body == ("hip1", "hip2", "hip3")
    assert found.feet == ("toe1", "toe2", "toe3")
    assert found.other_feet == ()


def test_the_sample_s_roles_are_those_of_its_configuration(tmp_path):
    from hopdata.config.loading import load_config
    from hopdata.recordings.readers.formats import read_raw

    config = load_config(ROOT / "config/config.yaml", check_files=False)
    found = guess_roles(
        inspect_recording(read_raw(part_of_sample(tmp_path / "part.h5", 200)))
    )
    assert {k: list(getattr(found, k)) for k in ("body", "feet", "boom")} == config[
        "markers"
    ]


def test_a_runner_s_right_foot_and_pelvis(external_recording):
    from hopdata.recordings.readers.formats import read_raw

    found = guess_roles(inspect_recording(read_raw(external_recording)))
    assert found.body == ("body1", "body2", "body3")
    assert found.feet == ("R_heel", "R_mt1", "R_mt5")
    assert found.other_feet == (("L_heel", "L_mt1", "L_mt5"),)


def test_of_the_heel_of_a_shoe_one_marker_is_taken(quick_runner):
    from hopdata.recordings.readers.formats import read_raw

    found = guess_roles(inspect_recording(read_raw(quick_runner)))
    assert found.feet == ("R.Heel.Bottom", "R.MT1", "R.MT5")
    left = "R.Heel.Top, R.Heel.Lateral, R.ASY (of a shoe's heel one marker is enough)"
    assert f"left out: {left}" in str(found.reasons["feet"])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("on_heel", [True, False])
def test_a_second_marker_of_a_heel_is_left_out_and_a_toe_s_is_not(seed, on_heel):
    positions, names = jumping(seed, jumps=2), STYLES["opensim"]
    place = "Heel" if on_heel else "Midfoot.Lat"
    extra = positions[:, [4, 10]] + [0.0, 0.03, 0.01]
    extra += np.random.default_rng(seed).normal(0, 5e-4, extra.shape)
    added = [f"L.{place}.Second", f"R.{place}.Second"]
    assert {part_by_name(name) for name in added} == ({"foot"} if on_heel else {""})
    found = roles(np.concatenate([positions, extra], axis=1), (*names, *added))
    assert not set(found.feet) & set(added)
    assert {names[4], names[10]} <= set(found.feet)


def test_without_feet_it_says_what_is_missing():
    found = roles(hopping(2)[1][:, [0, 1, 2, 6]], ("hip1", "hip2", "hip3", "post"))
    assert found.feet == ()
    assert found.body == ("hip1", "hip2", "hip3")
    (problem,) = found.problems
    assert str(problem).startswith("markers.feet: expected two markers or more")


def test_without_a_body_it_says_what_is_missing():
    found = roles(hopping(3)[1][:, 3:6], MARKERS[3:6])
    assert found.body == ()
    assert "recordings.no_body" in [problem.code for problem in found.problems]


def test_a_body_marker_that_is_often_unseen_gives_way_to_others():
    positions = hopping(1)[1]
    more = np.einsum("m,nmi->ni", [0.7, 0.6, -0.3], positions[:, :3])
    positions = np.concatenate([positions, more[:, None]], axis=1)
    positions[100:300, 0] = np.nan
    found = roles(positions, (*MARKERS, "hip4"))
    assert found.body == ("hip2", "hip3", "hip4")
    assert "since they are seen less: hip1" in str(found.reasons["body"])
    assert roles(positions[:, :7]).body == (
        "hip1",
        "hip2",
        "hip3",
    )  # there are no others
    positions[140:, 0] = hopping(1)[1][
        140:, 0
    ]  # in few frames: four fill each other's gaps
    assert roles(positions, (*MARKERS, "hip4")).body == ("hip1", "hip2", "hip3", "hip4")


def test_what_rests_near_the_floor_and_is_no_foot_is_told():
    positions = hopping(1)[1]
    assert roles(positions).reasons["unused"] is None
    ankle, dragged = (
        positions[:, [3]] + [0.0, 0.0, 0.06],
        positions[:, [4]] * [1.0, 1.0, 0.0],
    )
    more = np.concatenate([positions, ankle, dragged], axis=1)
    told = str(roles(more, (*MARKERS, "RANK", "tip")).reasons["unused"])
    assert "RANK rests" in told
    assert "times, 6" in told
    assert "tip hardly ever leaves the floor" in told


def test_a_second_rigid_part_makes_the_body_unsure_where_names_say_nothing():
    positions = hopping(1)[1]
    assert roles(positions).unsure == {}
    sway = 0.1 * np.sin(np.arange(len(positions)) / 30)[:, None, None]
    arm = positions[:, :3] - [0.6, 0.0, 0.05] + sway * [0.0, 1.0, 0.0]
    plain = tuple(f"m{k}" for k in range(10))
    found = roles(np.concatenate([positions, arm], axis=1), plain)
    assert found.body == plain[:3]
    assert {role: str(doubt) for role, doubt in found.unsure.items()} == {
        "body": "m7, m8, m9"
    }


def test_a_marker_named_as_the_feet_that_stays_higher_makes_them_unsure():
    positions = hopping(1)[1]
    positions[:, MARKERS.index("toe1"), 2] += 0.09  # it sits on the shank
    assert "toe1, which stays 9" in str(roles(positions).unsure["feet"])
    positions[:, MARKERS.index("toe1")] = np.nan  # a name without a marker
    assert "feet" not in roles(positions).unsure


def test_feet_that_land_once_are_not_sure():
    found = roles(hopping(1)[1][:100])
    assert set(found.unsure) == {"body", "feet"}
    assert found.unsure["feet"].code == "recordings.doubt_few_rests"


@pytest.mark.parametrize("mark", [":", "_"])
def test_of_two_subjects_the_first_is_taken_and_the_other_named(mark):
    positions = np.concatenate(
        [hopping(3)[1], hopping(3)[1] + np.array([2.0, 1.0, 0.0])], axis=1
    )
    names = tuple(f"{who}{mark}{name}" for who in ("cat", "dog") for name in MARKERS)
    time = np.arange(len(positions)) / 100.0
    found = guess_roles(
        inspect_recording(RawRecording(names, time, positions, 100.0, "m"))
    )
    assert found.feet == tuple(f"cat{mark}toe{k}" for k in (1, 2, 3))
    assert {name[:4] for name in (*found.body, *found.boom)} == {f"cat{mark}"}
    assert "of cat alone, a study of its own for dog" in str(found.reasons["body"])


@pytest.mark.parametrize("begin", [("LF", "RH"), ("front", "hind"), ("R", "L")])
def test_what_the_names_of_limbs_begin_with_is_no_subject(begin):
    marked = ["toe", "ankle", "knee", "hip", "shoulder"]
    assert (
        subject_prefixes(tuple(f"{limb}_{part}" for limb in begin for part in marked))
        == []
    )
    assert subject_prefixes(
        tuple(f"{rat}_{part}" for rat in "AB" for part in marked)
    ) == [
        "A_",
        "B_",
    ]


def test_hands_that_land_as_feet_do_are_told():
    names = ("C7", "SIPS_li", "SIPS_re", "fuss_li", "fuss_re", "hand_li", "post")
    positions = hopping(1)[1]
    found = roles(positions, names)
    assert found.feet == ("fuss_li", "fuss_re")
    assert found.left_by_name == ("hand_li",)
    assert "hand_li rests" in str(found.reasons["unused"])
    assert "no foot by its name" in str(found.reasons["unused"])

    lifted = positions + 0.3 * (np.arange(7) == 5)[:, None] * [0.0, 0.0, 1.0]
    assert roles(lifted, names).left_by_name == ()
