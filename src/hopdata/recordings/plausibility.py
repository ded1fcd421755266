"""Checks that catch common mistakes in a recording before they reach the results.

Each check examines the canonical recording (metres, z up) and raises one clear message.
"""

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.recording import Recording, body_over_feet, extent, fraction_seen, sampled
from hopdata.recordings.axes import FILE_AXES, along_file, opposite
from hopdata.recordings.quality import softness
from hopdata.recordings.quality.orientation import (
    PLAUSIBLE_EXTENT_M,
    FreeFall,
    free_fall,
)
from hopdata.recordings.quality.rigid import treated
from hopdata.recordings.quality.stretches import check_stamps, feet_as_one, high_feet
from hopdata.time_stamps import is_pause

MIN_BODY_MARKERS = 3
MIN_FEET = 2
# Ratio to the height: if exceeded along another axis, the vertical axis is wrong
TILT_LIMIT = 5.0
SMALLEST_M = 0.003  # m; metres mistaken for millimetres are then detected from 3 m on
STEP_TOLERANCE = 0.02  # relative to a frame

EXPORT = "export in mm or m"
# Mistakes with the unit: the factor that corrects the positions, and what to do.
WRONG_UNITS = {
    "centimetres taken for millimetres": (10.0, EXPORT),
    "centimetres taken for metres": (0.01, EXPORT),
    "inches taken for millimetres": (25.4, EXPORT),
    "inches taken for metres": (0.0254, EXPORT),
    "millimetres taken for metres": (1e-3, "set input.unit: mm"),
    "metres taken for millimetres": (1e3, "set input.unit: m"),
}
AS_READ = "as read"
# Free fall must be this many times as frequent in another unit as in the one taken
CLEARLY = 5.0


def check_plausible(
    recording: Recording, *, largest_body_strain: float = softness.LARGEST_STRAIN
) -> None:
    """Run all checks and raise at the first failure.

    Parameters
    ----------
    recording : Recording
        In metres, z up, with only the configured markers.
    largest_body_strain : float
        ``quality.largest_body_strain`` of the configuration.

    Raises
    ------
    RecordingError
        If a check fails; names the recording, what was expected and found.
    """
    check_markers(recording)
    check_time(recording)
    check_positions(recording)
    check_fall(recording)
    check_scale(recording)
    check_upright(recording)
    check_rigid(recording, largest_strain=largest_body_strain)


def check_markers(recording: Recording) -> None:
    """Require enough body markers and feet."""
    wanted = (("body", "body markers", MIN_BODY_MARKERS), ("foot", "feet", MIN_FEET))
    for role, what, least in wanted:
        names = recording.names(role)
        if len(names) < least:
            found = f"{len(names)} ({', '.join(names) or 'none'})"
            raise RecordingError.at(
                f"{recording.place}: {what}", f"at least {least}", found
            )


def check_time(recording: Recording) -> None:
    """Require a positive rate and strictly increasing time stamps that agree with it."""
    place, time, rate = recording.place, recording.time, recording.rate_hz
    if not (np.isfinite(rate) and rate > 0):
        raise RecordingError(
            f"{place}: frame rate: expected more than 0 Hz, found {rate:g} Hz"
        )
    if len(time) < 2:
        raise RecordingError(f"{place}: expected at least 2 frames, found {len(time)}")
    check_order(place, time)
    step = float(np.median(np.diff(time)))
    if abs(step * rate - 1) > STEP_TOLERANCE:
        wanted = f"{1 / rate:.6g} s from frame to frame ({rate:g} Hz)"
        found = f"{step:.6g} s ({1 / step:.6g} Hz)"
        raise RecordingError.at(f"{place}: time stamps", wanted, found)


def check_order(place: str, time: FloatArray) -> None:
    """Require each time stamp (N,), s, to be later than the one before."""
    bad = np.flatnonzero(~(np.diff(time) > 0))
    if len(bad):
        i = int(bad[0])
        found = f"{time[i + 1]:.6g} s; if frames occur twice, remove them from the file; if "
        found += (
            "times have too few digits, leave the column out and give input.rate_hz"
        )
        raise RecordingError.at(
            f"{place}: frame {i + 2}", f"a time after {time[i]:.6g} s", found
        )


def check_positions(recording: Recording) -> None:
    """Require each marker to be seen, to move, to be finite and not to duplicate another."""
    place = recording.place
    if np.isinf(recording.positions).any():
        name = recording.markers[int(np.argwhere(np.isinf(recording.positions))[0, 1])]
        raise RecordingError(
            f"{place}: marker '{name}': expected finite positions, found infinity"
        )
    seen = fraction_seen(recording)
    tracks = np.moveaxis(recording.positions, 1, 0)
    for name, fraction, positions in zip(recording.markers, seen, tracks, strict=True):
        own, n = f"{place}: marker '{name}'", len(recording.time)
        if fraction == 0:
            raise RecordingError.at(own, "to be seen", f"in none of {n} frames")
        known = positions[~np.isnan(positions).any(axis=1)]
        if len(known) > 1 and not np.ptp(known, axis=0).any():
            where = ", ".join(f"{x:.4g}" for x in known[0])
            found = f"it at ({where}) m in all of {len(known)} frames"
            raise RecordingError.at(own, "to move", found)
    frames = sampled(recording.positions)
    for i, name in enumerate(recording.markers):
        for j in range(i):
            both = ~np.isnan(frames[:, i] + frames[:, j])
            if both.any() and np.array_equal(frames[:, i][both], frames[:, j][both]):
                pair = f"{place}: markers '{recording.markers[j]}' and '{name}'"
                raise RecordingError.at(
                    pair, "different positions", "the same in every frame"
                )


def check_scale(recording: Recording) -> None:
    """Require a size plausible for an animal or a robot; catches millimetres taken for metres."""
    size = extent(recording.positions)
    low, high = SMALLEST_M, PLAUSIBLE_EXTENT_M[1]
    if np.isnan(size) or low <= size <= high or _falls(recording).is_clear:
        return
    looks = ""
    for slip in ("metres taken for millimetres", "millimetres taken for metres"):
        if low <= size * WRONG_UNITS[slip][0] <= high:
            looks = f"; the numbers look like {slip}: {_remedy(recording, slip)}"
    wanted = f"the markers to span {low:g} to {high:g} m"
    raise RecordingError.at(f"{recording.place}: scale", wanted, f"{size:.3g} m{looks}")


def _remedy(recording: Recording, slip: str) -> str:
    """Return advice on a mistaken unit; recordings made from arrays have no file or config."""
    factor, remedy = WRONG_UNITS[slip]
    return remedy if recording.source else f"multiply the positions by {factor:g}"


def check_upright(recording: Recording) -> None:
    """Require the body to be above the feet, and not much further beside than above them."""
    offset = body_over_feet(recording)
    up, best = offset[2], int(np.argmax(np.abs(offset)))
    if np.isnan(up) or abs(offset[best]) <= TILT_LIMIT * up:
        return
    in_file = along_file(offset, recording.vertical_axis)
    found = ", ".join(f"{value:+.3g} m along {axis}" for axis, value in in_file.items())
    if offset[best] > 0:
        hint = f"; set input.vertical_axis: {FILE_AXES[recording.vertical_axis][best]}?"
    elif axis := _up_by_fall(recording):
        hint = f"; the markers fall against {axis}: set input.vertical_axis: {axis}"
    else:
        up = opposite(FILE_AXES[recording.vertical_axis][best])
        hint = f"; set input.vertical_axis: {up}, or are markers.body and markers.feet exchanged?"
    if not recording.source:
        hint = (
            "; the last axis of positions is x, y, z with z up: reorder yours to match"
        )
    place = f"{recording.place}: vertical axis {recording.vertical_axis}"
    found = f"the body's mean at {found} from the feet{hint}"
    raise RecordingError.at(place, "the body above the feet", found)


def _falls(recording: Recording) -> FreeFall:
    return free_fall(recording.positions, recording.rate_hz, units={AS_READ: 1.0})


def _up_by_fall(recording: Recording) -> str:
    """Return the file's up direction if it is clearly against an axis of the recording; else ""."""
    fall = _falls(recording)
    against = fall.is_clear and fall.up.startswith("-")
    axis = FILE_AXES[recording.vertical_axis]["xyz".index(fall.up[-1])]
    return opposite(axis) if against else ""


def check_fall(recording: Recording) -> None:
    """Require freely falling markers, if any, to fall at 9.81 m/s²; catches centimetres."""
    units = {
        AS_READ: 1.0,
        **{slip: factor for slip, (factor, _) in WRONG_UNITS.items()},
    }
    fall = free_fall(recording.positions, recording.rate_hz, units=units)
    if fall.unit == AS_READ or fall.up != "z" or not fall.is_clear:
        return
    if fall.share > CLEARLY * _falls(recording).share:
        wanted = "markers to fall freely at 9.81 m/s²"
        found = f"{9.81 / units[fall.unit]:.3g} m/s² in {100 * fall.share:.0f} % of the frames"
        looks = f"the numbers look like {fall.unit}: {_remedy(recording, fall.unit)}"
        raise RecordingError.at(
            f"{recording.place}: scale", wanted, f"{found}; {looks}"
        )


def check_rigid(
    recording: Recording, *, largest_strain: float = softness.LARGEST_STRAIN
) -> None:
    """Require the body's markers to be one body: soft perhaps, but without a limb or a foot.

    Parameters
    ----------
    recording : Recording
        In metres, z up.
    largest_strain : float
        See `softness.what_bends`.
    """
    bend = softness.what_bends(
        recording.body, recording.feet, largest_strain=largest_strain
    )
    if bend is None:
        return
    names = recording.names("body")
    i, j = bend.pair
    share, length = f"{100 * bend.strain:.1f} %", f"{1e3 * bend.length_m:.0f} mm"
    varies = f"'{names[i]}' to '{names[j]}' varying by {1e3 * bend.change_m:.1f} mm, {share} of"
    if bend.when == softness.USUALLY:
        found = f"{varies} {length}"
        where = "of the body's size"
    elif bend.when == softness.AT_ITS_LOWEST:
        found = f"{varies} {length}, where it is lowest"
        where = "of the body's size where it is lowest"
    else:
        found = f"{varies} the others' {length}, and '{names[bend.odd]}' coming down to the feet"
        where = "of the body's size"
    most = f"{100 * bend.limit:g} % ({_key_of(bend)}) {where}"
    place = f"{recording.place}: markers.body"
    found += f"; is '{names[bend.odd]}' on the body?"
    raise RecordingError.at(place, f"distances that vary by at most {most}", found)


def _key_of(bend: softness.Bend) -> str:
    """Return the key that sets the limit of a bend."""
    often = {softness.AT_ITS_LOWEST: "twice ", softness.ON_FLOOR: "half "}
    return f"{often.get(bend.when, '')}quality.largest_body_strain"


# Remarks on a recording that can be analysed nevertheless.

MISSING_NOTE_FRACTION = 0.1
HIGH_FOOT = (
    0.2  # of the body's height over the feet; no mount and no floor is this uneven
)
ROUNDED_TO_M = (
    0.01,
    0.001,
)  # coarser first; finer rounding is lost in the noise of any camera


def notes(recording: Recording) -> list[str]:
    """Return remarks that do not stop the analysis: reader, unseen markers, a soft body, ....

    Returns
    -------
    list of str
        One line each.
    """
    more = [
        f"marker '{name}' is missing in {100 * (1 - fraction):.1f} % of frames"
        for name, fraction in zip(
            recording.markers, fraction_seen(recording), strict=True
        )
        if 1 - fraction > MISSING_NOTE_FRACTION
    ]
    feet = recording.feet[:, :, 2], recording.names("foot")
    high = high_feet(*feet, above_m=HIGH_FOOT * body_over_feet(recording)[2])
    more += [
        f"{one}; does it touch the ground, or does the floor slope?" for one in high
    ]
    more += [f"{one}; is one a copy of the other?" for one in feet_as_one(*feet)]
    more += [*_rounding(recording), *_missing_times(recording)]
    more += softness.softness_remark(recording.body, recording.names("body"))
    more += treated(recording.body, recording.rate_hz, scale=recording.scale)
    return [*recording.remarks, *(f"{recording.place}: {remark}" for remark in more)]


def rounded_to(positions: FloatArray) -> float | None:
    """Return the step, m, that all coordinates (N, M, 3), m, are multiples of; None if too fine.

    A multiple rounded to float32 counts as one, but not so far from the origin that
    float32 itself has steps of more than a hundredth of these.
    """

    def all_multiples(part: FloatArray, step: float) -> bool:
        seen = part[np.isfinite(part)]
        off = np.abs(seen - step * np.round(seen / step))
        rounding = np.finfo(np.float32).eps * np.abs(seen)
        return bool(seen.size and np.all(off <= np.minimum(rounding, 0.01 * step)))

    parts = (sampled(positions), positions)  # a sample rules out most files quickly
    return next(
        (s for s in ROUNDED_TO_M if all(all_multiples(p, s) for p in parts)), None
    )


def _rounding(recording: Recording) -> list[str]:
    """Report how coarsely the file's coordinates are rounded, and the noise this adds."""
    if not (step_mm := 1e3 * (rounded_to(recording.positions) or 0.0)):
        return []
    noise = f"noise of {step_mm / np.sqrt(12):.2g} mm (standard deviation)"
    told = f"coordinates are rounded to {step_mm:g} mm, which adds {noise} to each"
    return [f"{told}; export more digits"]


def _missing_times(recording: Recording) -> list[str]:
    """Report how many frames are missing, and the number and length of pauses."""
    pause = is_pause(recording.time, recording.rate_hz)
    pauses, drops = np.diff(recording.time)[pause], check_stamps(recording.time).drops
    dropped = int(drops[~pause[drops[:, 0]], 1].sum())
    frames = "1 frame is" if dropped == 1 else f"{dropped} frames are"
    remarks = [f"{frames} missing between the time stamps"] * bool(dropped)
    if len(pauses):
        several = len(pauses) > 1
        told = f"{len(pauses)} pause{'s' * several} of {pauses.sum():.6g} s{' in all' * several}"
        remarks.append(f"{told} in which nothing was recorded")
    return remarks
