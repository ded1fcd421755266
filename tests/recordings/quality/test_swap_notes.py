import numpy as np
from made_up_hopper import MARKERS, hopping

from hopdata.recordings.quality.swap_notes import swap_notes
from hopdata.recordings.recording import Recording

ROLES = ("body",) * 3 + ("foot",) * 3 + ("other",)


def recording(positions, time):
    return Recording("hop", time, positions, MARKERS, ROLES, 100.0)


def test_a_sound_recording_has_no_notes():
    time, positions = hopping(1)
    assert swap_notes(recording(positions, time)) == []


def test_says_who_when_and_that_nothing_is_corrected():
    time, positions = hopping(1)
    exchanged = positions.copy()
    exchanged[700:900, [0, 2]] = positions[700:900, [2, 0]]
    kept = exchanged.copy()
    (note,) = swap_notes(recording(exchanged, time))
    assert note.startswith("hop: hip1 and hip3")
    assert "from 7.00 s (frame 701) to 8.99 s (frame 900)" in note
    assert "as they are" in note
    np.testing.assert_array_equal(exchanged, kept)


def test_a_swap_that_never_ends():
    time, positions = hopping(2)
    positions[1500:, [0, 1]] = positions[1500:, [1, 0]]
    (note,) = swap_notes(recording(positions, time))
    assert "to the end" in note
