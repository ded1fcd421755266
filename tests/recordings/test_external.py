"""Contact instants from tables and from the events of a recording's file."""

import numpy as np
import pytest
from external_blocks import block, columns
from written_files import write_c3d

from hopdata.errors import RecordingError
from hopdata.recording import Event
from hopdata.recordings.external import read_contact_times, read_force_signals
from hopdata.recordings.raw import RawRecording

FEET = ("left", "right")


def written(tmp_path, text, name="contacts.csv"):
    path = tmp_path / name
    path.write_text(text)
    return str(path)


def test_one_column_a_foot(tmp_path):
    file = written(tmp_path, "left,right\n1.5,0.9\n0.5,\n")
    left, right = read_contact_times(block("contacts", file=file), feet=FEET)
    assert left.column.feet == ("left",)
    assert left.source == "contacts"
    np.testing.assert_array_equal(left.instant, [0.5, 1.5])
    np.testing.assert_array_equal(right.instant, [0.9])
    assert left.span_s == (0.5, 1.5)


def test_unit_and_offset(tmp_path):
    file = written(tmp_path, "left,right\n500,900\n")
    options = block("contacts", file=file, unit="ms", offset_s=-0.2)
    left, right = read_contact_times(options, feet=FEET)
    np.testing.assert_allclose([left.instant[0], right.instant[0]], [0.3, 0.7])


def test_a_column_of_several_feet(tmp_path):
    file = written(tmp_path, "switch\n0.5\n")
    options = block("contacts", file=file, columns=columns(switch=FEET))
    (both,) = read_contact_times(options, feet=FEET)
    assert both.column.feet == FEET


def test_one_row_a_contact(tmp_path):
    file = written(tmp_path, "foot;t\nleft;0.5\nright;0.9\nleft;1.5\nhand;2\n")
    options = block("contacts", file=file, label_column="foot", time_column="t")
    left, right = read_contact_times(options, feet=FEET)
    np.testing.assert_array_equal(left.instant, [0.5, 1.5])
    np.testing.assert_array_equal(right.instant, [0.9])


def test_events_of_a_qtm_file(tmp_path):
    head = (
        "NO_OF_FRAMES\t2\nNO_OF_CAMERAS\t4\nNO_OF_MARKERS\t1\nFREQUENCY\t100\nNO_OF_ANALOG\t0\n"
        "ANALOG_FREQUENCY\t0\nDESCRIPTION\t--\nTIME_STAMP\t2021-01-01\nDATA_INCLUDED\t3D\n"
        "EVENT\tL down\t1\t0.25\nEVENT\tR down\t1\t0.5\nEVENT\tL down\t2\t1.25\nMARKER_NAMES\ta\n"
    )
    file = written(tmp_path, head + "1\t2\t3\n4\t5\t6\n", "trial.tsv")
    both = columns(**{"L down": ["left"], "R down": ["right"]})
    left, right = read_contact_times(
        block("contacts", file=file, columns=both), feet=FEET
    )
    np.testing.assert_array_equal(left.instant, [0.25, 1.25])
    np.testing.assert_array_equal(right.instant, [0.5])
    later = "FILE_VERSION\t2.0.0\n" + head + "1\t2\t3\n4\t5\t6\n"
    for text, name in (
        (later, "2.tsv"),
        ("\ufeff" + later, "bom.tsv"),
        (later, "trial.txt"),
    ):
        file = written(tmp_path, text, name)
        left, _ = read_contact_times(
            block("contacts", file=file, columns=both), feet=FEET
        )
        np.testing.assert_array_equal(left.instant, [0.25, 1.25])
    wrong = block("contacts", file=file, columns=columns(**{"L dwn": ["left"]}))
    with pytest.raises(
        RecordingError, match=r"events: label: expected 'L dwn'.*mean 'L down'"
    ):
        read_contact_times(wrong, feet=FEET)


def test_a_tab_separated_table_is_no_recording(tmp_path):
    file = written(tmp_path, "left\tright\n0.5\t0.9\n", "contacts.tsv")
    left, _ = read_contact_times(block("contacts", file=file), feet=FEET)
    np.testing.assert_array_equal(left.instant, [0.5])


MISTAKES = {
    "no such column": ("left,rigth\n1,2\n", {}, ["'right'", "did you mean 'rigth'"]),
    "empty column": (
        "left,right\n1,\n",
        {},
        ["'right'", "at least one contact", "found none"],
    ),
    "label unknown": (
        "foot,t\nlft,1\nright,2\n",
        {"label_column": "foot", "time_column": "t"},
        ["expected 'left' among lft, right", "did you mean 'lft'"],
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told(tmp_path, mistake):
    text, options, parts = MISTAKES[mistake]
    file = written(tmp_path, text)
    with pytest.raises(RecordingError) as caught:
        read_contact_times(block("contacts", file=file, **options), feet=FEET)
    for part in (file, "expected", "found", *parts):
        assert part in str(caught.value)


def test_events_of_a_c3d_file_are_on_the_clock_of_its_frames(tmp_path):
    events = tuple(
        Event(label, t) for label, t in [("R", 2.5), ("L", 2.25), ("L", 3.25)]
    )
    positions = np.random.default_rng(0).uniform(1, 900, (40, 2, 3))
    time = 2.0 + np.arange(40) / 10
    raw = RawRecording(("a", "b"), time, positions, 10.0, "mm", events=events)
    write_c3d(tmp_path / "trial.c3d", raw)
    both = columns(L=["left"], R=["right"])
    options = block("contacts", file=str(tmp_path / "trial.c3d"), columns=both)
    left, right = read_contact_times(options, feet=FEET)
    np.testing.assert_allclose(left.instant, [2.25, 3.25], rtol=1e-6)
    np.testing.assert_allclose(right.instant, [2.5], rtol=1e-6)


# Forces from text tables: clock, unit, sign, and mistakes.

FORCE_SIGNALS_FEET = ("heel", "toe")
WAVE = np.maximum(0, 900 * np.sin(np.arange(400) / 20))


def written_force_signals(tmp_path, force=WAVE, time=None, name="Fz"):
    time = np.arange(len(force)) if time is None else time
    rows = [f"{t:.9g}\t{f:.9g}" for t, f in zip(time, force, strict=True)]
    path = tmp_path / "forces.txt"
    path.write_text(f"Time\t{name}\n" + "\n".join(rows) + "\n")
    return str(path)


def read(file, **options):
    given = {"columns": columns(Fz=FORCE_SIGNALS_FEET), **options}
    (signal,) = read_force_signals(
        block("forces", file=file, **given), feet=FORCE_SIGNALS_FEET
    )
    return signal


def test_rows_at_a_rate(tmp_path):
    signal = read(written_force_signals(tmp_path), rate_hz=200, offset_s=0.5)
    np.testing.assert_allclose(signal.time, 0.5 + np.arange(400) / 200)
    np.testing.assert_allclose(signal.force, WAVE, rtol=1e-8)
    assert signal.column.feet == FORCE_SIGNALS_FEET
    assert signal.unit == "N"


def test_a_column_of_times(tmp_path):
    time = 3 + np.arange(400) / 250
    signal = read(written_force_signals(tmp_path, time=time), time_column="Time")
    np.testing.assert_allclose(signal.time, time)


@pytest.mark.parametrize("mark", ["\t", "  "])
@pytest.mark.parametrize("suffix", [".mot", ".STO"])
def test_forces_of_opensim_have_a_clock_of_their_own(tmp_path, mark, suffix):
    names = ["time", *(f"1_ground_force_v{axis}" for axis in "xyz")]
    head = [
        "forces",
        "version=1",
        "nRows=400",
        "nColumns=4",
        "inDegrees=yes",
        "",
        "endheader",
    ]
    rows = [
        mark.join((f"{k / 250:.6f}", "1.5", f"{f:.6f}", "0"))
        for k, f in enumerate(WAVE)
    ]
    path = tmp_path / f"forces{suffix}"
    path.write_text(
        "\n".join([*head, mark.join(names), *(" " * (mark != "\t") + r for r in rows)])
    )
    signal = read(str(path), columns=columns(**{names[2]: FORCE_SIGNALS_FEET}))
    np.testing.assert_allclose(signal.time, np.arange(400) / 250, atol=1e-9)
    np.testing.assert_allclose(signal.force, WAVE, atol=1e-6)
    path.write_text(path.read_text().replace("0.024000", "0.016000"))
    with pytest.raises(RecordingError, match="row to row, found otherwise at line 15"):
        read(str(path), columns=columns(**{names[2]: FORCE_SIGNALS_FEET}))
    path.write_text(path.read_text().replace("endheader", "end"))
    with pytest.raises(RecordingError, match="expected a line endheader, found none"):
        read(str(path))


@pytest.mark.parametrize(
    ("unit", "factor"), [("N", 1), ("kN", 1000), ("body_weight", 1)]
)
def test_units(tmp_path, unit, factor):
    signal = read(written_force_signals(tmp_path), rate_hz=200, unit=unit)
    np.testing.assert_allclose(signal.force, factor * WAVE, rtol=1e-8)
    assert signal.unit == ("body_weight" if unit == "body_weight" else "N")


def test_a_plate_that_counts_downwards(tmp_path):
    signal = read(written_force_signals(tmp_path, -WAVE), rate_hz=200, inverted=True)
    np.testing.assert_allclose(signal.force, WAVE, rtol=1e-8)


COUNTED = np.arange(1, 401)
FORCE_SIGNALS_MISTAKES = {
    "no rate": ({}, {}, ["forces.rate_hz", "or forces.time_column, found neither"]),
    "a count for a time": (
        {"time": COUNTED},
        {"time_column": "Time"},
        ["at least 50 samples a second, found 1;", "counts samples is not a time"],
    ),
    "rate against times": (
        {"time": COUNTED / 300},
        {"time_column": "Time", "rate_hz": 200},
        ["as stated by forces.rate_hz: 200", "found 0.00333333 s (300 Hz)"],
    ),
    "time goes back": (
        {"time": [0, 0.01, *np.arange(398) / 300]},
        {"time_column": "Time"},
        ["times in s that increase", "line 4"],
    ),
    "wrong sign": (
        {"force": -WAVE},
        {"rate_hz": 200},
        ["the upward force on the feet to be positive", "set forces.inverted: true"],
    ),
    "unknown column": (
        {"name": "Fzz"},
        {"rate_hz": 200},
        ["'Fz' once among Time, Fzz", "did you mean 'Fzz'"],
    ),
    "no force": (
        {"force": np.full(400, np.nan)},
        {"rate_hz": 200},
        ["a force in each row"],
    ),
}


@pytest.mark.parametrize("mistake", FORCE_SIGNALS_MISTAKES)
def test_mistakes_are_told_force_signals(tmp_path, mistake):
    content, options, parts = FORCE_SIGNALS_MISTAKES[mistake]
    file = written_force_signals(tmp_path, **content)
    with pytest.raises(RecordingError) as caught:
        read(file, **options)
    for part in (file, "expected", "found", *parts):
        assert part in str(caught.value)
