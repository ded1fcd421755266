"""Onsets of force plates, their standard errors, and the feet that make them."""

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from hopdata.landings.plate_contacts import contacts_on_plates, find_onsets, within
from hopdata.recording import Recording
from hopdata.recordings.force_plates import ForcePlate

FINE_HZ = 20_000
N_STANCES = 30
LEVEL_N = 12.0
NOISE_N = 2.0


def stances(seed, rate_hz, power, *, cut_off_hz=None):
    """Return time, force and onsets of stances whose force begins with a power of time."""
    rng = np.random.default_rng(seed)
    fine = np.arange(0, N_STANCES + 1, 1 / FINE_HZ)
    force = np.zeros_like(fine)
    onsets = 0.6 + np.arange(N_STANCES) + rng.uniform(0, 0.1, N_STANCES)
    for onset in onsets:
        since = fine - onset
        on = (since > 0) & (since < 0.25)
        rise_s = 0.02 * rng.uniform(0.6, 1.6)
        risen = np.minimum((since[on] / rise_s) ** power, 1)
        gone = np.minimum(1, (0.25 - since[on]) / 0.05)
        force[on] += 1200 * rng.uniform(0.6, 1.2) * risen * gone
    step = FINE_HZ // rate_hz
    seen = force[::step]
    seen = seen + LEVEL_N + NOISE_N * rng.standard_normal(len(seen))
    if cut_off_hz is not None:
        b, a = butter(2, cut_off_hz / (rate_hz / 2))
        seen = filtfilt(b, a, seen)
    return fine[::step], seen, onsets


@pytest.mark.parametrize("rate_hz", [300, 1000])
def test_onsets_are_found_to_within_their_errors(rate_hz):
    """The stated error is that of a rise with an unknown power of time.

    It is right for powers that are drawn so that the way to the onset is uniform. These
    four, of which two are at the ends, have a root mean square of 1.3 in its units.
    """
    ratios = []
    for power in (0.5, 1.0, 1.5, 2.0):
        for seed in (11, 12, 13):
            time, force, truth = stances(seed, rate_hz, power)
            found = find_onsets(time, force)
            assert len(found.instant) == N_STANCES
            assert found.level_n == pytest.approx(LEVEL_N, abs=0.3)
            assert found.noise_n == pytest.approx(NOISE_N, rel=0.2)
            assert found.blur_s == 0.0
            ratios.append((found.instant - truth) / found.error_s)
    rms = np.sqrt(np.mean(np.square(ratios), axis=1)).reshape(4, 3).mean(axis=1)
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.3, abs=0.25)
    ends, middle = rms[[0, 3]], rms[[1, 2]]
    assert middle.max() < 1 < ends.min()
    early_and_late = [np.mean(ratios[:3]), np.mean(ratios[9:])]
    assert early_and_late[0] < 0 < early_and_late[1]


def test_the_error_shrinks_with_the_rate_and_the_rise():
    slow = find_onsets(*stances(21, 200, 1.5)[:2])
    fast = find_onsets(*stances(21, 2000, 1.5)[:2])
    steep = find_onsets(*stances(21, 2000, 1.0)[:2])
    assert np.median(fast.error_s) < 0.7 * np.median(slow.error_s)
    assert np.median(steep.error_s) < np.median(fast.error_s)
    assert np.median(steep.error_s) >= 1 / 2000 / np.sqrt(12)


@pytest.mark.parametrize("cut_off_hz", [20, 50])
def test_a_filter_is_known_by_its_noise_and_counted(cut_off_hz):
    time, force, truth = stances(31, 1000, 1.0, cut_off_hz=cut_off_hz)
    found = find_onsets(time, force)
    assert 0.1 / cut_off_hz < found.blur_s < 0.3 / cut_off_hz
    assert len(found.instant) == N_STANCES
    ratios = (found.instant - truth) / found.error_s
    assert np.sqrt(np.mean(ratios**2)) < 1.5
    unaware = find_onsets(*stances(31, 1000, 1.0)[:2])
    assert np.median(found.error_s) > 3 * np.median(unaware.error_s)


def test_a_processed_signal_without_noise():
    time, force, truth = stances(41, 1000, 1.0)
    force = np.where(force < LEVEL_N + 20, 0.0, force - LEVEL_N)
    found = find_onsets(time, force)
    assert found.noise_n == 0.0
    assert len(found.instant) == N_STANCES
    assert np.abs(found.instant - truth).max() < 0.003


STANDING = 700 + 60 * np.sin(np.arange(5000) / 300)
NO_ONSETS = {
    "somebody stands on it all the time": STANDING,
    "nobody steps on it": np.random.default_rng(1).normal(3, 1.5, 5000),
    "it shows nothing at all": np.zeros(5000),
    "it shows no numbers": np.full(5000, np.nan),
    "it has one sample": np.array([3.0]),
    "it has no sample": np.empty(0),
}


@pytest.mark.parametrize("why", NO_ONSETS)
def test_no_onset_is_made_up(why):
    force = NO_ONSETS[why]
    found = find_onsets(np.arange(len(force)) / 1000, force)
    assert not len(found.instant)
    assert not len(found.error_s)
    assert not found.is_loaded


def test_points_within_a_plate_and_its_margin():
    corners = np.array([[0.0, 0, 0], [0.4, 0, 0], [0.4, 0.6, 0], [0, 0.6, 0]])
    points = np.array(
        [
            [0.2, 0.3, 5.0],
            [0.45, 0.3, 0.0],
            [0.2, -0.08, 0.0],
            [0.55, 0.3, 0.0],
            [np.nan, 0.3, 0.0],
        ]
    )
    for order in (corners, corners[::-1]):
        inside = within(order, points, margin_m=0.1)
        np.testing.assert_array_equal(inside, [True, True, True, False, False])
        none = within(order, points, margin_m=0.0)
        np.testing.assert_array_equal(none, [True, False, False, False, False])


# A jumper who lands with one foot on each plate, and a third plate beside.

LEFT_ON = 1.0
RIGHT_ON = 1.02
RATE_HZ = 200.0


def jumper():
    """Return a levelled recording in which both feet come down, and leave again."""
    time = np.arange(0, 3, 1 / RATE_HZ)
    up = np.zeros((len(time), 2))
    for k, onset in enumerate((LEFT_ON, RIGHT_ON)):
        in_air = (time < onset) | (time > 1.8)
        up[:, k] = np.where(in_air, 0.3, 0.0)
    feet = np.stack(
        [
            np.stack([np.full_like(time, 0.2), np.full_like(time, 0.3), up[:, 0]], -1),
            np.stack([np.full_like(time, 0.7), np.full_like(time, 0.3), up[:, 1]], -1),
        ],
        axis=1,
    )
    hips = np.array([[[0.1, 0, 1.0], [-0.1, 0.05, 1.05], [0, -0.1, 1.1]]])
    body = feet.mean(axis=1, keepdims=True) + hips
    positions = np.concatenate([feet, body], axis=1)
    names = ("L_toe", "R_toe", "hip1", "hip2", "hip3")
    return Recording.from_arrays(
        time, positions, names, feet=names[:2], body=names[2:], name="jump"
    )


def plate(number, x_m, *onsets_s, length_s=0.5):
    time = np.arange(0, 3, 1e-3)
    force = np.zeros((len(time), 3))
    force[:, 2] = np.random.default_rng(number).normal(4, 1.0, len(time))
    for onset in onsets_s:
        on = (time >= onset) & (time < onset + length_s)
        force[on, 2] += np.minimum(40_000 * (time[on] - onset), 800)
    corners = np.array([[0.4, 0, 0], [0, 0, 0], [0, 0.6, 0], [0.4, 0.6, 0]])
    corners = corners + np.array([x_m, 0, 0])
    pressure = np.full((len(time), 3), np.nan)
    names = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
    return ForcePlate(number, 2, corners, names, ("N",) * 6, time, force, pressure)


def test_each_plate_gets_the_foot_that_steps_on_it():
    plates = [plate(1, 0.0, LEFT_ON), plate(2, 0.5, RIGHT_ON)]
    found = contacts_on_plates(jumper(), plates)
    assert [one.column.name for one in found.contacts] == ["plate 1", "plate 2"]
    assert [one.column.feet for one in found.contacts] == [("L_toe",), ("R_toe",)]
    for one, onset in zip(found.contacts, (LEFT_ON, RIGHT_ON), strict=True):
        assert one.source == "plates"
        assert one.instant == pytest.approx([onset], abs=4e-4)
        assert 2e-4 < one.error_s[0] < 2e-3
        np.testing.assert_array_equal(one.of_other_foot, [False])
    assert [signal.column.name for signal in found.signals] == ["plate 1", "plate 2"]
    assert np.median(found.signals[0].force[:900]) == pytest.approx(0, abs=0.2)
    assert not found.notes


def test_two_feet_on_one_plate_are_told():
    wide = plate(1, 0.0, LEFT_ON)
    wide.corners[[0, 3], 0] = 1.0
    found = contacts_on_plates(jumper(), [wide])
    (one,) = found.contacts
    assert one.column.feet == ("L_toe", "R_toe")
    (note,) = found.notes
    assert note.code == "landings.plate_shared"
    assert note.values["number"] == 1


def test_an_onset_while_all_feet_are_up_is_of_another_foot():
    found = contacts_on_plates(jumper(), [plate(1, 0.0, 0.3, LEFT_ON, length_s=0.4)])
    (one,) = found.contacts
    np.testing.assert_array_equal(one.of_other_foot, [True, False])


def test_of_two_feet_on_a_plate_the_one_at_the_pressure_landed():
    wide = plate(1, 0.0, RIGHT_ON)
    wide.corners[[0, 3], 0] = 1.0
    wide.pressure[:] = [0.75, 0.3, 0.0]
    (right,) = contacts_on_plates(jumper(), [wide]).contacts
    assert right.column.feet == ("R_toe",)
    wide.pressure[:] = [0.45, 0.3, 0.0]  # amid both
    (both,) = contacts_on_plates(jumper(), [wide]).contacts
    assert both.column.feet == ("L_toe", "R_toe")


def test_a_low_foot_away_from_the_pressure_did_not_land():
    """A foot that swings low over a plate while another one lands on it."""
    one_plate = plate(1, 0.0, LEFT_ON)
    one_plate.corners[[0, 3], 0] = 1.0
    one_plate.corners[[2, 3], 1] = 1.5
    for y_m, is_other in ((0.4, False), (1.3, True), (9.0, False)):
        # Far off the plate, the centre of pressure is wrong and tells nothing.
        one_plate.pressure[:] = [0.4, y_m, 0.0]
        feet = contacts_on_plates(jumper(), [one_plate])
        assert bool(feet.contacts) == (not is_other)
        if is_other:
            assert [note.code for note in feet.notes] == [
                "landings.plate_of_other_feet"
            ]


def test_a_plate_beside_the_feet_is_not_compared():
    found = contacts_on_plates(jumper(), [plate(3, 2.0, LEFT_ON), plate(4, 0.0)])
    assert not found.contacts
    codes = [note.code for note in found.notes]
    assert codes == ["landings.plate_of_other_feet", "landings.plate_without_onset"]
