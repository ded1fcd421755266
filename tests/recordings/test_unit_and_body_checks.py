"""`check_plausible` refuses impossible units and bodies that bend; sound recordings pass."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping
from made_up_people import person

from hopdata.errors import RecordingError
from hopdata.recording import Recording
from hopdata.recordings.axes import FILE_AXES
from hopdata.recordings.plausibility import check_fall, check_plausible, check_rigid

ROLES = ("body",) * 3 + ("foot",) * 3 + ("boom",)


def recording(seed=1, *, rate_hz=100.0, noise_m=6e-4, **changes):
    time, positions = hopping(seed, rate_hz=rate_hz, noise_m=noise_m)
    return replace(
        Recording("trial", time, positions, MARKERS, ROLES, rate_hz), **changes
    )


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("rate_hz", "noise_m"), [(50.0, 1e-3), (100.0, 2e-3), (1000.0, 3e-4)]
)
def test_sound_recordings_pass(seed, rate_hz, noise_m):
    check_plausible(recording(seed, rate_hz=rate_hz, noise_m=noise_m))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (0.1, "centimetres taken for millimetres: export in mm or m"),
        (100.0, "centimetres taken for metres: export in mm or m"),
        (1 / 25.4, "inches taken for millimetres: export in mm or m"),
        (1e3, "millimetres taken for metres: set input.unit: mm"),
    ],
)
def test_a_wrong_unit_is_told_by_how_things_fall(seed, factor, told):
    sound = recording(seed, source="trial.tsv")
    with pytest.raises(RecordingError) as caught:
        check_fall(replace(sound, positions=factor * sound.positions))
    message = str(caught.value)
    assert "scale: expected markers to fall freely at 9.81 m/s²" in message
    assert f"found {9.81 * factor:.3g} m/s²" in message
    assert message.endswith(told)


@pytest.mark.parametrize("vertical_axis", FILE_AXES)
def test_an_axis_that_points_down_is_told_by_how_things_fall(vertical_axis):
    turned = recording(vertical_axis=vertical_axis, source="trial.tsv")
    turned = replace(turned, positions=turned.positions * [1, -1, -1])
    up = {"x": "-x", "y": "-y", "z": "-z", "-x": "x", "-y": "y", "-z": "z"}[
        vertical_axis
    ]
    told = f"the markers fall against {up}: set input.vertical_axis: {up}$"
    with pytest.raises(RecordingError, match=told):
        check_plausible(turned)


def test_what_does_not_fall_cannot_be_told():
    still = (
        np.random.default_rng(1).normal(0, 1e-3, (500, 7, 3)) + np.arange(7)[:, None]
    )
    check_fall(recording(time=np.arange(500) / 100.0, positions=0.1 * still))


def test_a_foot_among_the_body_is_named():
    exchanged = recording(
        roles=("body", "body", "foot", "body", "foot", "foot", "boom")
    )
    with pytest.raises(RecordingError) as caught:
        check_rigid(exchanged)
    message = str(caught.value)
    assert message.startswith(
        "recording 'trial': markers.body: expected distances that vary by"
    )
    assert (
        "at most 2.5 % (half quality.largest_body_strain) of the body's size" in message
    )
    assert "'toe1' coming down to the feet" in message
    assert message.endswith("is 'toe1' on the body?")
    assert caught.value.key == "markers.body"


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("stance", "refused"), [(0.1, True), (0.0, False)])
def test_a_foot_that_leaves_the_body_only_in_stance_is_named(seed, stance, refused):
    sound = recording(seed)
    positions, hip = sound.positions.copy(), sound.positions[:, 0]
    lowest = np.quantile(hip[:, 2], stance) - 5e-3 * (stance == 0.0)
    foot = hip + np.array([0.05, 0.02, -lowest])
    foot[:, 2] = np.maximum(foot[:, 2], 0.0)  # the leg is compressed by up to some cm
    positions[:, 1] = foot + np.random.default_rng(seed).normal(0, 6e-4, foot.shape)
    with_foot = replace(sound, positions=positions)
    if refused:
        with pytest.raises(RecordingError, match=f"is '{MARKERS[1]}' on the body"):
            check_rigid(with_foot)
    else:
        check_rigid(with_foot)


def test_a_body_that_should_bend_can_be_allowed():
    sound = recording()
    positions = sound.positions.copy()
    sway = 0.03 * np.sin(np.arange(len(positions)) / 9.0)
    positions[:, 0, 0] += sway
    bending = replace(sound, positions=positions)
    with pytest.raises(RecordingError, match=r"markers\.body"):
        check_plausible(bending)
    check_plausible(bending, largest_body_strain=0.3)


def test_noise_is_no_bending():
    check_rigid(recording(noise_m=0.01))


@pytest.mark.parametrize("seed", range(3))
def test_a_wrong_rate_is_not_taken_for_a_wrong_unit(seed):
    sound = recording(seed, source="trial.trc")
    at_ten_times = replace(sound, rate_hz=10 * sound.rate_hz)
    check_fall(at_ten_times)
    with pytest.raises(RecordingError, match=r"time stamps: expected 0\.001 s"):
        check_plausible(at_ten_times)
    in_inches = replace(at_ten_times, positions=at_ten_times.positions / 25.4)
    with pytest.raises(RecordingError, match="inches taken for millimetres"):
        check_fall(in_inches)


@pytest.mark.parametrize("marker_set", ["Plug-in Gait, legs", "Rizzoli", "clusters"])
def test_a_person_as_tall_as_people_is_in_no_other_unit(marker_set):
    made = person(3, "jump", marker_set)
    time = np.arange(len(made.positions)) / made.rate_hz
    roles = tuple("foot" if name in made.feet else "body" for name in made.names)
    sound = Recording("trial", time, made.positions, made.names, roles, made.rate_hz)
    check_fall(sound)
    # Things fall as if the numbers were inches, but not the person.
    faster = 0.0254**0.5
    quick = replace(sound, time=time * faster, rate_hz=made.rate_hz / faster)
    check_fall(quick)
    unnamed = tuple(f"m{k}" for k in range(len(made.names)))
    with pytest.raises(RecordingError, match="inches taken for metres"):
        check_fall(replace(quick, markers=unnamed))
    with pytest.raises(RecordingError, match="inches taken for millimetres"):
        check_fall(replace(sound, positions=made.positions / 25.4))
