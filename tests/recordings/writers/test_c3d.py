"""Contact events in a copy of a C3D file: read again, and nothing else is changed."""

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping
from written_files import write_c3d

from hopdata.errors import HopdataError, RecordingError
from hopdata.recording import Event
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.readers.c3d import read_c3d
from hopdata.recordings.readers.c3d_parameters import BLOCK
from hopdata.recordings.writers.c3d import write_c3d_events
from hopdata.recordings.writers.contact_events import ContactEvent, labels, require_new

FIRST_FRAME = 51
THEIRS = (Event("Right Foot Off", 0.75), Event("General Event", 1.5))


def contact_events(count):
    """Return contacts of a left and a right foot in turn, from 0.6 s on."""
    events = []
    for number in range(count):
        side = ("left", "right")[number % 2]
        time_s = 0.6 + 0.0123 * number
        events.append(ContactEvent(time_s, side, side, 0.0011, number + 1))
    return events


@pytest.fixture
def source(tmp_path):
    """Return a function that writes a C3D file of the made-up hopper."""

    def written(events=(), processor="Intel"):
        time, positions = hopping(1, n_frames=150)
        raw = RawRecording(
            MARKERS,
            time + (FIRST_FRAME - 1) / 100.0,
            1000 * positions,
            100.0,
            "mm",
            events=tuple(events),
        )
        path = tmp_path / "jump.c3d"
        write_c3d(path, raw, processor=processor)
        return path

    return written


def data_of(path):
    """Return the bytes from the start of the data on."""
    content = path.read_bytes()
    order = "big" if content[BLOCK + 3] == 86 else "little"
    return content[(int.from_bytes(content[16:18], order) - 1) * BLOCK :]


@pytest.mark.parametrize("processor", ["Intel", "DEC", "MIPS"])
@pytest.mark.parametrize("count", [0, 1, 7, 300])
def test_events_are_read_again_and_points_are_unchanged(source, processor, count):
    path = source(processor=processor)
    copy = path.with_name("copy.c3d")
    events = contact_events(count)
    before = path.read_bytes()
    write_c3d_events(path, copy, events)
    assert path.read_bytes() == before
    assert data_of(copy) == data_of(path)
    found = read_c3d(copy)
    original = read_c3d(path)
    np.testing.assert_array_equal(found.positions, original.positions)
    np.testing.assert_array_equal(found.time, original.time)
    assert found.markers == original.markers
    assert found.remarks == original.remarks == ()
    assert [event.label for event in found.events] == [
        f"{event.context} Foot Strike" for event in events
    ]
    times = [event.time_s for event in events]
    assert [event.time_s for event in found.events] == pytest.approx(times, abs=1e-6)


def test_another_program_reads_the_same_events_points_and_parameters(source):
    ezc3d = pytest.importorskip("ezc3d")
    path = source(THEIRS)
    copy = path.with_name("copy.c3d")
    write_c3d_events(path, copy, contact_events(5))
    before, after = (ezc3d.c3d(str(one)) for one in (path, copy))
    np.testing.assert_array_equal(before["data"]["points"], after["data"]["points"])
    event = after["parameters"]["EVENT"]
    assert event["USED"]["value"][0] == 7
    times = event["TIMES"]["value"][1]
    assert list(times) == sorted(times)
    assert list(event["CONTEXTS"]["value"]).count("Left") == 3
    assert list(event["LABELS"]["value"]).count("Foot Strike") == 5
    for name, group in before["parameters"].items():
        if name == "EVENT":
            continue
        for key, parameter in group.items():
            if key in ("__METADATA__", "DATA_START"):
                continue
            found = after["parameters"][name][key]["value"]
            assert np.array_equal(found, parameter["value"]), (name, key)


def test_events_of_others_stay_and_ours_are_replaced(source):
    path = source(THEIRS)
    copy = path.with_name("copy.c3d")
    again = path.with_name("again.c3d")
    write_c3d_events(path, copy, contact_events(4))
    write_c3d_events(copy, again, contact_events(2))
    assert [event.label for event in read_c3d(again).events] == [
        "Left Foot Strike",
        "Right Foot Strike",
        *(event.label for event in THEIRS),
    ]


def test_more_events_than_the_section_holds_are_refused(source):
    path = source()
    copy = path.with_name("copy.c3d")
    with pytest.raises(HopdataError, match="write them as csv"):
        write_c3d_events(path, copy, contact_events(2000))
    assert not copy.exists()


def test_what_is_no_c3d_is_refused(tmp_path):
    path = tmp_path / "jump.c3d"
    path.write_bytes(b"no c3d".ljust(BLOCK))
    with pytest.raises(RecordingError, match="a C3D file"):
        write_c3d_events(path, tmp_path / "copy.c3d", [])


def test_a_label_names_the_foot_where_its_side_does_not():
    of_side = [ContactEvent(1.0, "LTOE", "left", 0.001, 1)]
    assert labels(of_side) == ["Foot Strike"]
    two = [*of_side, ContactEvent(1.1, "LHEE", "left", 0.001, 1)]
    assert labels(two) == ["Foot Strike LTOE", "Foot Strike LHEE"]
    no_side = ContactEvent(1.0, "foot1", "", 0.001, 1)
    assert labels([no_side]) == ["Foot Strike foot1"]
    assert no_side.context == "General"


def test_a_recording_is_never_written_over(tmp_path):
    path = tmp_path / "jump.c3d"
    path.write_text("a recording")
    other = tmp_path / "other.csv"
    require_new(other, [path])
    other.write_text("there")
    with pytest.raises(HopdataError, match="--force replaces it"):
        require_new(other, [path])
    require_new(other, [path], replace=True)
    with pytest.raises(HopdataError, match="a recording that was read"):
        require_new(tmp_path / "." / "jump.c3d", [path], replace=True)
