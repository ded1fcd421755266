"""A soft pelvis is a body, told with its size; a foot, a knee or a loose marker is not of it."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping, with_swap
from made_up_runner import NAMES, RATE_HZ, SHORTEST_M, SINE, SIZE_M, STANDS_M, runner

from hopdata.errors import RecordingError
from hopdata.recording import Recording
from hopdata.recordings.plausibility import check_rigid, notes
from hopdata.recordings.quality.softness import (
    AT_ITS_LOWEST,
    ON_FLOOR,
    USUALLY,
    bending,
    on_the_floor,
    one_body,
    softness_remark,
    what_bends,
)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("share", [0.05, 0.1])
@pytest.mark.parametrize("wobble_m", [0.0, 0.01])
def test_a_soft_pelvis_is_a_body(seed, share, wobble_m):
    pelvis, feet = runner(seed, skin_m=share * SHORTEST_M, wobble_m=wobble_m)
    assert what_bends(pelvis, feet) is None
    assert one_body([0, 1, 2, 3], np.concatenate([pelvis, feet], axis=1), [4, 5]) == [
        0,
        1,
        2,
        3,
    ]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("skin_m", "wobble_m"), [(0.0, 0.0), (0.006, 0.01)])
@pytest.mark.parametrize("leg", ["gives way in stance", "swings"])
def test_a_foot_among_a_pelvis_is_found_whether_that_is_soft_or_not(
    seed, skin_m, wobble_m, leg
):
    pelvis, feet = runner(seed, skin_m=skin_m, wobble_m=wobble_m)
    foot = feet[:, 0].copy()
    if (
        leg == "swings"
    ):  # every second stride the other foot lands, and this one stays high
        foot[:, 2] += 0.2 * (np.sin(np.pi * np.arange(len(foot)) / RATE_HZ / 0.36) > 0)
    markers = np.insert(pelvis, 2, foot, axis=1)
    bend = what_bends(markers, feet[:, 1:])
    assert bend is not None
    assert (bend.odd, bend.when) == (2, ON_FLOOR)
    assert one_body(range(5), np.concatenate([markers, feet], axis=1), [5, 6]) == [
        0,
        1,
        3,
        4,
    ]


@pytest.mark.parametrize("stance", [0.0, 0.3])
def test_a_marker_that_comes_down_to_the_feet_may_be_of_the_body_if_rigid(stance):
    """The skid of a robot: it nearly touches, and is refused only if it then gives way."""
    pelvis, feet = runner(3)
    skid = pelvis[:, 0].copy()
    skid[:, 2] -= np.quantile(skid[:, 2], stance) - (5e-3 if stance == 0 else 0.0)
    skid[:, 2] = np.maximum(skid[:, 2], 0.0)
    markers = np.insert(pelvis, 4, skid, axis=1)
    assert on_the_floor(markers, feet).tolist() == [False] * 4 + [True]
    bend = what_bends(markers, feet)
    assert (bend is None) == (stance == 0.0)


def test_without_feet_nothing_is_on_the_floor():
    pelvis, feet = runner(1)
    markers = np.concatenate([pelvis, feet], axis=1)
    assert not on_the_floor(markers, feet[:, :0]).any()
    assert on_the_floor(markers, feet).tolist() == [False] * 4 + [True] * 2


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("sway", [0.04, 0.08])
def test_a_loose_marker_is_refused_from_a_twentieth_of_the_bodys_size_on(seed, sway):
    pelvis, feet = runner(seed)
    time = np.arange(len(pelvis)) / RATE_HZ
    pelvis[:, 1, 1] += sway * SIZE_M / SINE * np.sin(7.0 * time)
    bend = what_bends(pelvis, feet)
    if sway < 0.05:
        assert bend is None
    else:
        assert (bend.odd, bend.when, bend.limit) == (1, USUALLY, 0.05)
        assert bend.strain == pytest.approx(sway, rel=0.1)
        assert what_bends(pelvis, feet, largest_strain=0.09) is None


@pytest.mark.parametrize(("gives_m", "refused"), [(0.02, False), (0.06, True)])
def test_what_gives_way_only_where_it_is_lowest_is_refused_at_twice_the_limit(
    gives_m, refused
):
    pelvis, feet = runner(2)
    depth = STANDS_M - 0.045 - pelvis[:, 0, 2].clip(max=STANDS_M - 0.045)
    pelvis[:, 0, 0] += gives_m * depth / 0.015  # in a seventh of the frames
    bend = what_bends(pelvis, feet)
    if refused:
        assert (bend.odd, bend.when, bend.limit) == (0, AT_ITS_LOWEST, 0.1)
    else:
        assert bend is None


def test_softness_is_relative_to_the_body_not_to_a_short_distance():
    """Eight percent of the 91 mm between two markers are less than three of the body's size."""
    pelvis, feet = runner(5)
    time = np.arange(len(pelvis)) / RATE_HZ
    pelvis[:, 2, 1] += 0.08 * SHORTEST_M / SINE * np.sin(7.0 * time)
    found = bending(pelvis)
    assert found.size_m == pytest.approx(SIZE_M, rel=0.01)
    assert found.usual_m[2, 3] / found.median_m[2, 3] == pytest.approx(0.08, rel=0.1)
    assert found.strain[2, 3] == pytest.approx(0.08 * SHORTEST_M / SIZE_M, rel=0.1)
    assert what_bends(pelvis, feet) is None


@pytest.mark.parametrize("noise_m", [3e-4, 3e-3, 6e-3])
def test_noise_is_no_softness(noise_m):
    pelvis, feet = runner(4, noise_m=noise_m)
    assert what_bends(pelvis, feet) is None
    assert softness_remark(pelvis, NAMES) == []


def test_the_remark_tells_where_how_much_and_what_it_costs():
    pelvis, feet = runner(5)
    time = np.arange(len(pelvis)) / RATE_HZ
    pelvis[:, 2, 1] += 8e-3 * np.sin(7.0 * time)
    (message,) = softness_remark(pelvis, NAMES)
    remark = str(message)
    assert remark.startswith("the body is soft: 'R.PSIS' to 'L.PSIS' changes by ")
    assert "% of the body's 275 mm" in remark
    assert "noise of " in remark
    assert "times that from frame to frame" in remark
    positions = np.concatenate([pelvis, feet], axis=1)
    roles = ("body",) * 4 + ("foot",) * 2
    recording = Recording(
        "run", time, positions, (*NAMES, "toe1", "toe2"), roles, RATE_HZ
    )
    assert f"recording 'run': {remark}" in map(str, notes(recording))
    check_rigid(recording)
    hard = replace(recording, positions=np.concatenate(runner(5), axis=1))
    assert not any("soft" in str(note) for note in notes(hard))


def test_the_message_blames_a_marker_of_the_pair():
    pelvis, feet = runner(6)
    time = np.arange(len(pelvis)) / RATE_HZ
    pelvis[:, 3, 0] += 0.05 * np.sin(7.0 * time)
    roles = ("body",) * 4 + ("foot",) * 2
    markers = (*NAMES, "toe1", "toe2")
    positions = np.concatenate([pelvis, feet], axis=1)
    with pytest.raises(
        RecordingError, match=r"'L\.PSIS' varying by .* is 'L\.PSIS' on the body"
    ):
        check_rigid(Recording("run", time, positions, markers, roles, RATE_HZ))


def test_names_exchanged_for_a_while_make_no_foot_of_a_hip():
    """They are another fault, which `hopdata inspect` tells."""
    positions = with_swap(hopping(5)[1], "hip1", "toe2", 900, 960)
    assert what_bends(positions[:, :3], positions[:, 3:6]) is None
    longer = with_swap(hopping(5)[1], "hip1", "toe2", 900, 1900)
    bend = what_bends(longer[:, :3], longer[:, 3:6])
    assert MARKERS[bend.odd] == "hip1"


def test_unseen_markers_have_no_size():
    nothing = np.full((50, 3, 3), np.nan)
    assert what_bends(nothing, nothing) is None
    assert softness_remark(nothing, NAMES[:3]) == []
