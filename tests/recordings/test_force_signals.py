"""Forces from text tables: clock, unit, sign, and mistakes."""

import numpy as np
import pytest
from external_blocks import block, columns

from hopdata.errors import RecordingError
from hopdata.recordings.force_signals import read_force_signals

FEET = ("heel", "toe")
WAVE = np.maximum(0, 900 * np.sin(np.arange(400) / 20))


def written(tmp_path, force=WAVE, time=None, name="Fz"):
    time = np.arange(len(force)) if time is None else time
    rows = [f"{t:.9g}\t{f:.9g}" for t, f in zip(time, force, strict=True)]
    path = tmp_path / "forces.txt"
    path.write_text(f"Time\t{name}\n" + "\n".join(rows) + "\n")
    return str(path)


def read(file, **options):
    given = {"columns": columns(Fz=FEET), **options}
    (signal,) = read_force_signals(block("forces", file=file, **given), feet=FEET)
    return signal


def test_rows_at_a_rate(tmp_path):
    signal = read(written(tmp_path), rate_hz=200, offset_s=0.5)
    np.testing.assert_allclose(signal.time, 0.5 + np.arange(400) / 200)
    np.testing.assert_allclose(signal.force, WAVE, rtol=1e-8)
    assert signal.column.feet == FEET
    assert signal.unit == "N"


def test_a_column_of_times(tmp_path):
    time = 3 + np.arange(400) / 250
    signal = read(written(tmp_path, time=time), time_column="Time")
    np.testing.assert_allclose(signal.time, time)


@pytest.mark.parametrize(("unit", "factor"), [("N", 1), ("kN", 1000), ("body_weight", 1)])
def test_units(tmp_path, unit, factor):
    signal = read(written(tmp_path), rate_hz=200, unit=unit)
    np.testing.assert_allclose(signal.force, factor * WAVE, rtol=1e-8)
    assert signal.unit == ("body_weight" if unit == "body_weight" else "N")


def test_a_plate_that_counts_downwards(tmp_path):
    signal = read(written(tmp_path, -WAVE), rate_hz=200, inverted=True)
    np.testing.assert_allclose(signal.force, WAVE, rtol=1e-8)


COUNTED = np.arange(1, 401)
MISTAKES = {
    "no rate": ({}, {}, ["forces.rate_hz", "or forces.time_column, found neither"]),
    "a count for a time": (
        {"time": COUNTED},
        {"time_column": "Time"},
        ["at least 50 samples a second, found 1;", "counts samples is no time"],
    ),
    "rate against times": (
        {"time": COUNTED / 300},
        {"time_column": "Time", "rate_hz": 200},
        ["as forces.rate_hz: 200 says", "found 0.00333333 s (300 Hz)"],
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
    "no force": ({"force": np.full(400, np.nan)}, {"rate_hz": 200}, ["a force in each row"]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told(tmp_path, mistake):
    content, options, parts = MISTAKES[mistake]
    file = written(tmp_path, **content)
    with pytest.raises(RecordingError) as caught:
        read(file, **options)
    for part in (file, "expected", "found", *parts):
        assert part in str(caught.value)
