"""Time stamps of frames: the grid they were rounded from, frame rate, and pauses."""

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.errors import RecordingError

#: Largest deviation of time stamps from a grid of which they are rounded values.
#: Unit: frames. Origin: chosen.
SNAP = 0.05

#: Stamps are printed to whole frames if their last decimal place is at least this long.
#: Unit: frames. Origin: chosen.
WHOLE_FRAMES = 0.9

#: Largest difference of two frame rates that are one rate, written or measured.
#: Unit: 1. Origin: rounding: larger than the error of any rounded rate in a file.
RATE_TOLERANCE = 1e-3

#: Length of a pause in the recording; a longer step is no lost frames. It is also put
#: between joined files that do not state their start.
#: Unit: s. Origin: chosen. It is longer than any landing.
PAUSE_S = 1.0

#: A step between frames is odd if it exceeds the usual one by this share of it: rows
#: are missing there.
#: Unit: 1. Origin: chosen.
MISSING_ROW = 0.5

#: The same, in ranges of the steps between their outer tenths, where these scatter.
#: Unit: 1. Origin: chosen.
MISSING_ROW_RANGES = 1.5

#: Time stamps of no clock, and numbers of no frame, are at least this far from 0; of
#: such nothing is computed. Nanoseconds since 1970 are 1e18.
#: Unit: s, or frames. Origin: chosen.
FARTHEST = 1e30

#: Time from the first stamp to the last that is none of a clock, likewise.
#: Unit: s. Origin: chosen.
BRIEFEST_S = 1e-30

#: Longest median time between frames; a longer one suggests times in milliseconds.
#: Unit: s. Origin: chosen.
SLOWEST_S = 0.5

# Decimal places of the finest stamps and rates that are looked for: 1 us.
_MOST_DECIMALS = 6


def settle(
    place: str, stamps: FloatArray, number: FloatArray, rate_hz: float
) -> tuple[FloatArray, tuple[str, ...]]:
    """Put time stamps back onto the grid they were rounded from.

    Exports round the time to 10 us or 1 ms, and some spread N frames over N / rate.
    Stamps that are otherwise evenly spaced follow the cameras' clock. All others are
    left unchanged for the checks to judge.

    Parameters
    ----------
    place : str
        The file, for the remark.
    stamps, number : (N,) array
        Time of each frame as printed, s, and its frame number.
    rate_hz : float
        The nominal rate, Hz.

    Returns
    -------
    time : (N,) array
        Time of each frame, s.
    remarks : tuple of str
    """
    if not _are_of_a_clock(stamps, number):
        return stamps, ()
    number = _with_missing_rows(stamps, number)
    at_nominal_rate = _fitting_grid(stamps, number, rate_hz)
    if at_nominal_rate is not None:
        return at_nominal_rate, ()

    own_hz = rate_of(stamps, number, whole=False)
    if own_hz is None or abs(own_hz - rate_hz) > RATE_TOLERANCE * rate_hz:
        return stamps, ()
    if _fitting_grid(stamps, number, own_hz) is None:
        return stamps, ()

    grid: FloatArray = stamps[0] + (number - number[0]) / rate_hz
    remark = (
        f"{place}: time stamps run evenly at {own_hz:.7g} Hz up to {stamps[-1]:.6g} s, "
        f"but at the rate of {rate_hz:g} Hz they would end at {grid[-1]:.6g} s; "
        f"all {len(grid)} are taken from the rate"
    )
    return grid, (remark,)


def _are_of_a_clock(stamps: FloatArray, number: FloatArray) -> bool:
    """Tell whether stamps, s, and frame numbers (N,) may be those of any recording."""
    if not len(stamps):
        return False
    # A stamp that is no number makes no difference here: the checks name it.
    if (np.abs(stamps) > FARTHEST).any() or (np.abs(number) > FARTHEST).any():
        return False
    return not abs(stamps[-1] - stamps[0]) < BRIEFEST_S


def _fitting_grid(
    stamps: FloatArray, number: FloatArray, rate_hz: float
) -> FloatArray | None:
    """Return the grid that the stamps are rounded from; None if there is none.

    It begins at the first stamp or, since that is rounded too, midway between the
    bounds set by all stamps. The second choice is not tried for stamps printed to whole
    frames, because it would accept a repeated stamp.
    """
    ticks: FloatArray = (number - number[0]) / rate_hz
    late = stamps - ticks
    begins = [stamps[0]]
    if printed_digit(stamps) * rate_hz < WHOLE_FRAMES:
        begins.append(0.5 * (late.min() + late.max()))
    for begin in begins:
        grid = begin + ticks
        if on_the_grid(stamps, grid, rate_hz):
            return grid
    return None


def on_the_grid(stamps: FloatArray, grid: FloatArray, rate_hz: float) -> bool:
    """Tell whether stamps agree with the grid to within their rounding.

    Parameters
    ----------
    stamps, grid : (N,) array
        Time of each frame as printed, and at the nominal rate, s.
    rate_hz : float
        The nominal rate, Hz.
    """
    digit_s = printed_digit(stamps)
    rounding_s = 0.0
    if digit_s * rate_hz <= 1:  # coarser stamps could not tell frames apart
        rounding_s = 0.5 * digit_s * (1 + 1e-6)
    largest_s = np.max(np.abs(stamps - grid))
    return bool(largest_s < max(SNAP / rate_hz, rounding_s))


def printed_digit(stamps: FloatArray) -> float:
    """Return the last decimal place printed in time stamps (N,), s; at least 1 us."""
    for decimals in range(_MOST_DECIMALS):
        with np.errstate(over="ignore"):  # of stamps that no clock shows
            rounded = np.round(stamps, decimals)
        if np.allclose(stamps, rounded, rtol=1e-12, atol=1e-9):
            return float(10.0**-decimals)
    return float(10.0**-_MOST_DECIMALS)


def rate_of(
    stamps: FloatArray, number: FloatArray, *, whole: bool = True
) -> float | None:
    """Return the frame rate from time stamps and frame numbers (N,), Hz, or None.

    None if it is not determined. With `whole`, a rate within the usual rounding of a
    whole number becomes that number. If the first and last stamps are too coarse, the
    rate is the one of fewest decimals that reproduces all stamps.
    """
    if len(stamps) < 2 or not (stamps[-1] > stamps[0] and number[-1] > number[0]):
        return None
    if not _are_of_a_clock(stamps, number):
        return None
    number = _with_missing_rows(stamps, number)
    rate = (number[-1] - number[0]) / (stamps[-1] - stamps[0])
    if not whole:
        return float(rate)

    ends_are_too_coarse = rate > 0 and _fitting_grid(stamps, number, rate) is None
    if ends_are_too_coarse:
        plain = _plainest_rate(stamps, number)
        rate = rate if plain is None else plain
    nearest = np.round(rate)
    if abs(rate - nearest) < RATE_TOLERANCE * rate:
        return float(nearest)
    return float(rate)


def _plainest_rate(stamps: FloatArray, number: FloatArray) -> float | None:
    """Return the rate, Hz, of fewest decimals that reproduces all stamps, if any."""
    frame_s = float(np.polyfit(number - number[0], stamps, 1)[0])
    if frame_s <= 0:
        return None
    for decimals in range(_MOST_DECIMALS):
        rate = round(1 / frame_s, decimals)
        if rate > 0 and _fitting_grid(stamps, number, rate) is not None:
            return rate
    return None


def _with_missing_rows(stamps: FloatArray, number: FloatArray) -> FloatArray:
    """Advance frame numbers (N,) by the frames that time stamps, s, show to be missing.

    Rows may have been cut out of a table whose frames are numbered by its rows.
    """
    steps_s = np.diff(stamps)
    frames = np.diff(number)
    if not (frames > 0).all() or not stamps[-1] > stamps[0]:
        return number
    rate = (number[-1] - number[0]) / (stamps[-1] - stamps[0])
    if on_the_grid(stamps, stamps[0] + (number - number[0]) / rate, rate):
        return number

    frame_s = steps_s / frames
    low_s, usual_s, high_s = np.quantile(frame_s, [0.1, 0.5, 0.9])
    odd_s = max(MISSING_ROW * usual_s, MISSING_ROW_RANGES * (high_s - low_s))
    missing = frame_s - usual_s > odd_s
    if usual_s <= 0 or not missing.any():
        return number
    if (steps_s < 0).any():
        # The other steps may last no time together. The checks refuse such stamps.
        return number
    rate = frames[~missing].sum() / steps_s[~missing].sum()
    frames[missing] = np.round(steps_s[missing] * rate)
    return np.concatenate([number[:1], number[0] + np.cumsum(frames)])


def is_pause(time: FloatArray, rate_hz: float) -> BoolArray:
    """Tell which steps of time stamps (N,), s, are pauses of the recording (N - 1,)."""
    return np.asarray(np.diff(time) > PAUSE_S - 0.5 / rate_hz)


def require_stamps(stamps: FloatArray) -> None:
    """Require two time stamps, s, or more that increase as those of frames do."""
    steps = np.empty(0)
    if stamps.ndim == 1 and len(stamps) > 1:
        steps = np.diff(stamps)
    if len(steps) and (steps > 0).all() and not np.median(steps) > SLOWEST_S:
        return
    frame = 0
    if len(steps):
        frame = 1 + int(np.argmin(steps > 0))
    around = stamps.flat[max(frame - 1, 0) : frame + 1]
    raise RecordingError.at(
        "time",
        "two frames or more, (N,), s, each later than the one before by at most "
        f"{SLOWEST_S} s",
        f"shape {stamps.shape}, {around} at frame {frame}",
    )


def times_and_rate(stamps: FloatArray) -> tuple[FloatArray, float]:
    """Return the times of frames, s, and their rate, Hz.

    Stamps that are even except for rounding are put back on their grid.
    """
    number = np.arange(1.0, len(stamps) + 1)
    rate_hz = rate_of(stamps, number)
    grid, remarks = settle("time", stamps, number, rate_hz or np.nan)
    is_even = not remarks and grid is not stamps
    if is_even:
        return grid, rate_hz or np.nan
    return stamps, rate_of(stamps, number, whole=False) or np.nan
