"""Time stamps and frame rate of a file: what agrees, what is only rounded, what is irregular."""

from __future__ import annotations

import numpy as np

from hopdata.recordings.raw import RATE_TOLERANCE, Event, FloatArray

SNAP = 0.05  # of a frame: time stamps this near to the nominal grid are its rounded values
FINER = 0.9  # of a frame: the last decimal of stamps that are not printed to whole frames
_MOST_DECIMALS = 6


def settle(
    place: str, stamps: FloatArray, number: FloatArray, rate_hz: float
) -> tuple[FloatArray, tuple[str, ...]]:
    """Put time stamps back onto the grid from which they were printed.

    Exports round the time to 10 us or 1 ms, and some spread N frames over N / rate. Stamps that
    are evenly spaced but for that are those of the cameras' clock; all others stay as they are,
    for the checks to judge.

    Parameters
    ----------
    place : str
        The file, for the remark.
    stamps, number : (N,) array
        Time of each frame as printed, s, and the frame's number.
    rate_hz : float
        The nominal rate, Hz.

    Returns
    -------
    time : (N,) array
        s.
    remarks : tuple of str
    """
    fitting = _fitting_grid(stamps, number, rate_hz)
    if fitting is not None:
        return fitting, ()
    own = rate_of(stamps, number, whole=False)
    if own is None or abs(own - rate_hz) > RATE_TOLERANCE * rate_hz:
        return stamps, ()
    if _fitting_grid(stamps, number, own) is None:
        return stamps, ()
    grid: FloatArray = stamps[0] + (number - number[0]) / rate_hz
    return grid, (
        f"{place}: time stamps run evenly at {own:.7g} Hz up to {stamps[-1]:.6g} s, but at the "
        f"rate of {rate_hz:g} Hz they would end at {grid[-1]:.6g} s; all {len(grid)} are taken "
        "from the rate",
    )


def _fitting_grid(stamps: FloatArray, number: FloatArray, rate_hz: float) -> FloatArray | None:
    """Return the grid of which the stamps are the rounded times; None if there is none.

    It begins at the first stamp or, since that is rounded too, midway between the bounds that all
    stamps set. (Not where they are printed to whole frames: a stamp that is repeated would pass.)
    """
    ticks: FloatArray = (number - number[0]) / rate_hz
    late = stamps - ticks
    begins = [stamps[0]]
    if printed_digit(stamps) * rate_hz < FINER:
        begins.append(0.5 * (late.min() + late.max()))
    fitting = (begin + ticks for begin in begins)
    return next((grid for grid in fitting if on_the_grid(stamps, grid, rate_hz)), None)


def on_the_grid(stamps: FloatArray, grid: FloatArray, rate_hz: float) -> bool:
    """Tell whether stamps are those of the grid but for the rounding with which they were printed.

    Parameters
    ----------
    stamps, grid : (N,) array
        Time of each frame as printed, and as it would be at the nominal rate, s.
    rate_hz : float
        The nominal rate, Hz.
    """
    digit = printed_digit(stamps)
    rounding = 0.5 * digit * (1 + 1e-6) if digit * rate_hz <= 1 else 0.0
    return bool(np.max(np.abs(stamps - grid)) < max(SNAP / rate_hz, rounding))


def printed_digit(stamps: FloatArray) -> float:
    """Place of the last decimal with which time stamps (N,) were printed, s; at least 1 us."""
    for decimals in range(_MOST_DECIMALS):
        if np.allclose(stamps, np.round(stamps, decimals), rtol=1e-12, atol=1e-9):
            return float(10.0**-decimals)
    return float(10.0**-_MOST_DECIMALS)


def rate_of(stamps: FloatArray, number: FloatArray, *, whole: bool = True) -> float | None:
    """Frame rate by time stamps and frame numbers (N,), Hz; None if they do not tell.

    With `whole`, a rate within the usual rounding of a whole number is that number.
    """
    if len(stamps) < 2 or not (stamps[-1] > stamps[0] and number[-1] > number[0]):
        return None
    rate = (number[-1] - number[0]) / (stamps[-1] - stamps[0])
    nearest = np.round(rate)
    return float(nearest if whole and abs(rate - nearest) < RATE_TOLERANCE * rate else rate)


def irregular(place: str, time: FloatArray, rate_hz: float) -> tuple[str, ...]:
    """Remark on steps of time that are no whole number of frames.

    Steps of two or more whole frames are dropped frames; `remarks.notes` counts those.
    """
    steps = np.diff(time) * rate_hz
    off = np.abs(steps - np.round(steps))
    bad = np.flatnonzero(off > SNAP)
    if not len(bad):
        return ()
    worst = int(bad[np.argmax(off[bad])])
    return (
        f"{place}: {len(bad)} of {len(steps)} steps of time are no whole number of frames at "
        f"{rate_hz:g} Hz; the worst, after frame {worst + 1}, is {steps[worst] / rate_hz:.6g} s",
    )


def events_outside(
    place: str, events: tuple[Event, ...], time: FloatArray, rate_hz: float
) -> tuple[str, ...]:
    """Remark on events before the first frame or after the last."""
    if not len(time):
        return ()
    begin, end = time[0] - 1 / rate_hz, time[-1] + 1 / rate_hz
    outside = sum(not begin <= event.time_s <= end for event in events)
    if not outside:
        return ()
    return (
        f"{place}: {outside} of {len(events)} events lie outside the recording "
        f"({time[0]:.6g} to {time[-1]:.6g} s)",
    )
