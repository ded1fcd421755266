"""Time stamps are restored to the grid from which they were rounded."""

import numpy as np
import pytest

from hopdata.errors import RecordingError
from hopdata.time_stamps import (
    printed_digit,
    rate_of,
    require_stamps,
    settle,
    times_and_rate,
)


@pytest.mark.parametrize("rate_hz", [50, 100, 120, 150, 180, 240, 300, 360])
@pytest.mark.parametrize("decimals", [3, 4, 5])
@pytest.mark.parametrize("first", [0, 1, 2, 5, 7])
def test_rounded_stamps_of_a_part_of_a_recording(rate_hz, decimals, first):
    number = np.arange(first, first + 2000, dtype=float)
    stamps = np.round(number / rate_hz, decimals)
    time, remarks = settle("a.trc", stamps, number, rate_hz)
    assert remarks == ()
    np.testing.assert_allclose(np.diff(time), 1 / rate_hz, rtol=1e-9)
    np.testing.assert_allclose(time, number / rate_hz, atol=0.5001 * 10.0**-decimals)


@pytest.mark.parametrize(
    ("rate_hz", "decimals"), [(100, 2), (100, 3), (150, 3), (250, 4)]
)
def test_rows_that_were_cut_out_stay_out_and_leave_the_rate(rate_hz, decimals):
    true = np.delete(np.arange(900) / rate_hz, [100, *range(300, 420), 600, 601])
    stamps, counted = np.round(true, decimals), np.arange(len(true), dtype=float)
    assert rate_of(stamps, counted) == rate_hz
    time, remarks = settle("a.tsv", stamps, counted, float(rate_hz))
    np.testing.assert_allclose(time, true, atol=0.5001 * 10.0**-decimals)
    np.testing.assert_allclose(
        np.diff(time) * rate_hz, np.round(np.diff(true) * rate_hz)
    )
    assert remarks == ()


@pytest.mark.parametrize("rate_hz", [119.88, 179.82, 239.76, 249.7, 99.5])
@pytest.mark.parametrize("first", [1, 4000, 70_001])
def test_stamps_in_ms_tell_a_rate_that_is_no_whole_number(rate_hz, first):
    number = np.arange(first, first + 3000.0)
    stamps = np.round((number - 1) / rate_hz, 3)
    assert rate_of(stamps, number) == rate_hz
    time, remarks = settle("a.csv", stamps, number, rate_hz)
    np.testing.assert_allclose(np.diff(time), 1 / rate_hz, rtol=1e-6)
    assert remarks == ()


@pytest.mark.parametrize(
    ("rate_hz", "decimals"), [(100, 2), (100, 3), (150, 3), (360, 3)]
)
def test_a_repeated_stamp_stays_as_it_is(rate_hz, decimals):
    stamps = np.round(np.arange(40) / rate_hz, decimals)
    stamps[9] = stamps[8]
    time, _ = settle("a.trc", stamps, np.arange(40.0), float(rate_hz))
    np.testing.assert_array_equal(time, stamps)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("back_s", [0.0, 1 / 64, -1.0])
def test_stamps_that_run_back_before_a_long_step_show_no_missing_rows(back_s):
    # All steps but the last last no time together, or less.
    stamps = np.array([*np.arange(20) / 64, back_s, 5.0])
    number = np.arange(22.0)
    assert rate_of(stamps, number) == pytest.approx(21 / 5)
    time, remarks = settle("a.tsv", stamps, number, 64.0)
    np.testing.assert_array_equal(time, stamps)
    assert remarks == ()
    # The control: without the step back, rows are missing before the last.
    forward = np.delete(stamps, 20)
    assert rate_of(forward, np.arange(21.0)) == 64.0


def test_the_last_digit_of_stamps_that_no_clock_shows():
    assert printed_digit(np.array([0.01, 0.02])) == 0.01
    assert printed_digit(np.array([0.0123, 1.7e308])) == 1e-6


NO_CLOCK = {
    "all at once": np.arange(20) * 5e-324,
    "no time at all": np.array([*np.arange(19) / 100, 1e-310]),
    "beyond all clocks": np.array([*np.arange(19) / 100, 1.7e308]),
    "one far away": np.array([0.0, -1.7e308, 1.7e308, *np.arange(3, 20) / 100]),
    "none and far away": np.array([0.0, np.nan, 1.7e308, *np.arange(3, 20) / 100]),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", NO_CLOCK)
def test_stamps_of_no_clock_have_no_rate_and_stay_as_they_are(name):
    stamps = NO_CLOCK[name]
    number = np.arange(20.0)
    assert rate_of(stamps, number) is None
    time, remarks = settle("a.csv", stamps, number, 100.0)
    np.testing.assert_array_equal(time, stamps)
    assert remarks == ()


@pytest.mark.filterwarnings("error")
def test_numbers_of_no_frame_have_no_rate():
    stamps = np.arange(20) / 100
    assert rate_of(stamps, np.array([*np.arange(19.0), 1e308])) is None
    assert rate_of(stamps, np.arange(20.0)) == 100


@pytest.mark.parametrize("begin_s", [0.0, 1.7e9, 1e12])
def test_stamps_of_clocks_that_began_long_ago_have_a_rate(begin_s):
    number = np.arange(200.0)
    assert rate_of(begin_s + number / 50, number) == pytest.approx(50, rel=1e-2)


def test_stamps_of_frames_increase_by_less_than_half_a_second():
    require_stamps(np.arange(5) / 100)
    for wrong in (np.zeros(1), np.array([0.0, 0.1, 0.1]), np.arange(5.0)):
        with pytest.raises(RecordingError, match="two frames or more"):
            require_stamps(wrong)


def test_rounded_stamps_are_put_back_on_their_grid_and_uneven_ones_kept():
    exact = np.arange(300) / 120
    time, rate_hz = times_and_rate(np.round(exact, 3))
    np.testing.assert_allclose(time, exact, atol=1e-9)
    assert rate_hz == pytest.approx(120.0)
    uneven = exact + 0.003 * np.sin(np.arange(300))
    assert times_and_rate(uneven)[0] is uneven
