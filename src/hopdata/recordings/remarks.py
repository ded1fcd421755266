"""What is worth saying of a recording although it can be analysed."""

from __future__ import annotations

import numpy as np

from hopdata.recordings.joining import is_pause
from hopdata.recordings.quality.resting import feet_as_one, high_feet
from hopdata.recordings.raw import FloatArray
from hopdata.recordings.recording import Recording
from hopdata.recordings.span import body_over_feet, fraction_seen, sampled

MISSING_NOTE_FRACTION = 0.1
HIGH_FOOT = 0.2  # of the body's height over the feet: no mount and no floor is so uneven
ROUNDED_TO_M = (0.01, 0.001)  # the coarser first; finer is lost in the noise of any camera


def notes(recording: Recording) -> list[str]:
    """Remarks that do not stop the analysis: the reader's, markers unseen, rounding, lost frames.

    Returns
    -------
    list of str
        One line each.
    """
    remarks = list(recording.remarks)
    remarks += [
        f"{recording.place}: marker '{name}' is missing in {100 * (1 - fraction):.1f} % of frames"
        for name, fraction in zip(recording.markers, fraction_seen(recording), strict=True)
        if 1 - fraction > MISSING_NOTE_FRACTION
    ]
    heights, feet = recording.feet[:, :, 2], recording.names("foot")
    high = HIGH_FOOT * body_over_feet(recording)[2]
    remarks += [
        f"{recording.place}: {remark}; does it touch the ground?"
        for remark in high_feet(heights, feet, above_m=high)
    ]
    remarks += [
        f"{recording.place}: {remark}; is one a copy of the other?"
        for remark in feet_as_one(heights, feet)
    ]
    more = [*_rounding(recording), *_missing_times(recording)]
    return remarks + [f"{recording.place}: {remark}" for remark in more]


def rounded_to(positions: FloatArray) -> float | None:
    """Step of which all coordinates (N, M, 3), m, are multiples; None if there is none so coarse.

    What float32 makes of a multiple is one.
    """
    for step in ROUNDED_TO_M:
        if all(_all_multiples(part, step) for part in (sampled(positions), positions)):
            return step
    return None


def _all_multiples(positions: FloatArray, step: float) -> bool:
    """Tell whether all that is seen is a multiple of a step, and something is seen."""
    seen = positions[np.isfinite(positions)]
    off = np.abs(seen - step * np.round(seen / step))
    return bool(seen.size and np.all(off <= np.finfo(np.float32).eps * np.abs(seen)))


def _rounding(recording: Recording) -> list[str]:
    """Say how coarsely the file's coordinates are rounded, and what noise that is."""
    step = rounded_to(recording.positions)
    if step is None:
        return []
    noise_mm = 1e3 * step / np.sqrt(12)
    return [
        f"coordinates are rounded to {1e3 * step:g} mm, which adds noise of {noise_mm:.2g} mm "
        "(standard deviation) to each; export more digits"
    ]


def _missing_times(recording: Recording) -> list[str]:
    """Say how many frames are missing, and how often and how long nothing was recorded."""
    steps = np.diff(recording.time)
    pause = is_pause(recording.time, recording.rate_hz)
    pauses = steps[pause]
    short = steps[(steps * recording.rate_hz > 1.5) & ~pause]
    dropped = int(np.sum(np.round(short * recording.rate_hz) - 1))
    remarks = []
    if dropped:
        frames = "1 frame is" if dropped == 1 else f"{dropped} frames are"
        remarks.append(f"{frames} missing between the time stamps")
    if len(pauses):
        longer = f"1 pause of {pauses[0]:.6g} s" if len(pauses) == 1 else f"{len(pauses)} pauses"
        total = "" if len(pauses) == 1 else f" of {pauses.sum():.6g} s in all"
        remarks.append(f"{longer}{total} in which nothing was recorded")
    return remarks
