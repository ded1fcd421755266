"""Checks that catch common mistakes in a recording before they reach the results.

Each check examines the canonical recording (metres, z up) and raises one clear message.
"""

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.messages import Message
from hopdata.recording import Recording, body_over_feet, fraction_seen, place_of
from hopdata.recordings.axes import FILE_AXES, along_file, opposite
from hopdata.recordings.quality import softness
from hopdata.recordings.quality.free_fall import FreeFall, free_fall
from hopdata.recordings.quality.orientation import LARGEST_M, is_of_a_persons_size
from hopdata.recordings.quality.processing import treated
from hopdata.recordings.quality.rests import feet_as_one, high_feet
from hopdata.recordings.quality.timing import check_stamps
from hopdata.scale import extent, sampled
from hopdata.time_stamps import is_pause

#: Body markers that a study needs.
#: Unit: 1. Origin: derived: three fix the attitude of a rigid body.
MIN_BODY_MARKERS = 3

#: Feet that a study needs.
#: Unit: 1. Origin: derived: with fewer there is no order of contacts.
MIN_FEET = 2

#: Ratio of the body's distance from the feet along another axis to its height over
#: them, above which the vertical axis is wrong.
#: Unit: 1. Origin: chosen.
TILT_LIMIT = 5.0

#: Smallest size of a recording.
#: Unit: m. Origin: chosen. Metres mistaken for millimetres are detected from 3 m on.
SMALLEST_M = 0.003

#: Largest difference of the median step of the time stamps from the stated one.
#: Unit: frames. Origin: chosen.
STEP_TOLERANCE = 0.02

#: Free fall must be this many times as frequent in another unit as in the one taken.
#: Unit: 1. Origin: chosen.
CLEARLY = 5.0

#: Share of frames without a marker from which on this is remarked.
#: Unit: 1. Origin: chosen.
MISSING_NOTE_FRACTION = 0.1

#: Height of a foot over the lowest one, relative to the body's height over the feet,
#: from which on this is remarked.
#: Unit: 1. Origin: chosen. No mount and no floor is this uneven.
HIGH_FOOT = 0.2

#: Coarsest step of rounded coordinates that is looked for.
#: Unit: m. Origin: chosen.
COARSE_STEP_M = 0.01

#: Finest step of rounded coordinates that is looked for.
#: Unit: m. Origin: chosen. A finer one is lost in the noise of any camera.
FINE_STEP_M = 0.001

AS_READ = "as read"
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
            raise RecordingError.at(
                f"{place_of(recording)}: {what}",
                f"at least {least}",
                f"{len(names)} ({', '.join(names) or 'none'})",
            )


def check_time(recording: Recording) -> None:
    """Require a positive rate, and time stamps that increase and agree with it."""
    place = place_of(recording)
    time = recording.time
    rate_hz = recording.rate_hz
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise RecordingError(
            f"{place}: frame rate: expected more than 0 Hz, found {rate_hz:g} Hz"
        )
    if len(time) < 2:
        raise RecordingError(f"{place}: expected at least 2 frames, found {len(time)}")
    check_order(place, time)
    step_s = float(np.median(np.diff(time)))
    if abs(step_s * rate_hz - 1) > STEP_TOLERANCE:
        raise RecordingError.at(
            f"{place}: time stamps",
            f"{1 / rate_hz:.6g} s from frame to frame ({rate_hz:g} Hz)",
            f"{step_s:.6g} s ({1 / step_s:.6g} Hz)",
        )


def check_order(place: str, time: FloatArray) -> None:
    """Require each time stamp (N,), s, to be later than the one before."""
    wrong = np.flatnonzero(~(np.diff(time) > 0))
    if not len(wrong):
        return
    first = int(wrong[0])
    raise RecordingError.at(
        f"{place}: frame {first + 2}",
        f"a time after {time[first]:.6g} s",
        f"{time[first + 1]:.6g} s; if frames occur twice, remove them from the file; "
        "if times have too few digits, leave the column out and give input.rate_hz",
    )


def check_positions(recording: Recording) -> None:
    """Require each marker to be seen, to move, to be finite and to be no copy."""
    place = place_of(recording)
    is_infinite = np.isinf(recording.positions)
    if is_infinite.any():
        name = recording.markers[int(np.argwhere(is_infinite)[0, 1])]
        raise RecordingError(
            f"{place}: marker '{name}': expected finite positions, found infinity"
        )
    seen = fraction_seen(recording)
    tracks = np.moveaxis(recording.positions, 1, 0)
    for name, fraction, track in zip(recording.markers, seen, tracks, strict=True):
        _check_moves(f"{place}: marker '{name}'", fraction, track)
    _check_no_copies(recording)


def _check_moves(place: str, fraction_seen: float, track: FloatArray) -> None:
    """Require a marker (N, 3) to be seen and to move."""
    if fraction_seen == 0:
        raise RecordingError.at(place, "to be seen", f"in none of {len(track)} frames")
    known = track[~np.isnan(track).any(axis=1)]
    if len(known) > 1 and not np.ptp(known, axis=0).any():
        where = ", ".join(f"{x:.4g}" for x in known[0])
        found = f"it at ({where}) m in all of {len(known)} frames"
        raise RecordingError.at(place, "to move", found)


def _check_no_copies(recording: Recording) -> None:
    """Require that no two markers have the same positions."""
    frames = sampled(recording.positions)
    for i, name in enumerate(recording.markers):
        for j, earlier in enumerate(recording.markers[:i]):
            both = ~np.isnan(frames[:, i] + frames[:, j])
            if both.any() and np.array_equal(frames[:, i][both], frames[:, j][both]):
                raise RecordingError.at(
                    f"{place_of(recording)}: markers '{earlier}' and '{name}'",
                    "different positions",
                    "the same in every frame",
                )


def check_scale(recording: Recording) -> None:
    """Require a size plausible for an animal or a robot.

    This catches millimetres taken for metres.
    """
    size_m = extent(recording.positions)
    is_plausible = SMALLEST_M <= size_m <= LARGEST_M
    if np.isnan(size_m) or is_plausible or _falls(recording).is_clear:
        return
    found = f"{size_m:.3g} m"
    for slip in ("metres taken for millimetres", "millimetres taken for metres"):
        factor, _ = WRONG_UNITS[slip]
        if SMALLEST_M <= size_m * factor <= LARGEST_M:
            remedy = _remedy(recording, slip)
            found = f"{size_m:.3g} m; the numbers look like {slip}: {remedy}"
    raise RecordingError.at(
        f"{place_of(recording)}: scale",
        f"the markers to span {SMALLEST_M:g} to {LARGEST_M:g} m",
        found,
    )


def _remedy(recording: Recording, slip: str) -> str:
    """Return advice on a mistaken unit."""
    factor, remedy = WRONG_UNITS[slip]
    if not recording.source:  # made from arrays, so there is no file and no key
        return f"multiply the positions by {factor:g}"
    return remedy


def check_upright(recording: Recording) -> None:
    """Require the body to be above the feet, and not much further beside than above."""
    offset = body_over_feet(recording)
    above_m = offset[2]
    farthest = int(np.argmax(np.abs(offset)))
    if np.isnan(above_m) or abs(offset[farthest]) <= TILT_LIMIT * above_m:
        return
    in_file = along_file(offset, recording.vertical_axis)
    offsets = ", ".join(
        f"{value:+.3g} m along {axis}" for axis, value in in_file.items()
    )
    raise RecordingError.at(
        f"{place_of(recording)}: vertical axis {recording.vertical_axis}",
        "the body above the feet",
        f"the body's mean at {offsets} from the feet; "
        f"{_advice_on_up(recording, offset, farthest)}",
    )


def _advice_on_up(recording: Recording, offset: FloatArray, farthest: int) -> str:
    """Return advice on the vertical axis.

    Parameters
    ----------
    recording : Recording
        The recording.
    offset : (3,) array
        The body's place over the feet, m.
    farthest : int
        The axis along which it is farthest.
    """
    if not recording.source:
        return "the last axis of positions is x, y, z with z up: reorder yours to match"
    direction = FILE_AXES[recording.vertical_axis][farthest]
    if offset[farthest] > 0:
        return f"set input.vertical_axis: {direction}?"
    by_fall = _up_by_fall(recording)
    if by_fall:
        return f"the markers fall against {by_fall}: set input.vertical_axis: {by_fall}"
    return (
        f"set input.vertical_axis: {opposite(direction)}, "
        "or are markers.body and markers.feet exchanged?"
    )


def _falls(recording: Recording) -> FreeFall:
    return free_fall(
        recording.positions, _rate_of_stamps(recording), units={AS_READ: 1.0}
    )


def _rate_of_stamps(recording: Recording) -> float:
    """Return the rate of the time stamps, Hz, at which things fall as they do.

    A wrong rate is none of the unit; `check_time` tells of it.
    """
    steps_s = np.diff(recording.time)
    if not len(steps_s) or not np.median(steps_s) > 0:
        return recording.rate_hz
    step_s = float(np.median(steps_s))
    if abs(step_s * recording.rate_hz - 1) <= STEP_TOLERANCE:
        return recording.rate_hz
    return 1 / step_s


def _up_by_fall(recording: Recording) -> str:
    """Return the file's up direction if the markers clearly fall upwards; else ""."""
    fall = _falls(recording)
    if not fall.is_clear or not fall.up.startswith("-"):
        return ""
    axis = "xyz".index(fall.up[-1])
    return opposite(FILE_AXES[recording.vertical_axis][axis])


def check_fall(recording: Recording) -> None:
    """Require freely falling markers, if any, to fall at 9.81 m/s².

    This catches centimetres. A person who is as tall as people are, by the markers'
    names, is in the right unit however the markers move.
    """
    units = {AS_READ: 1.0}
    for slip, (factor, _) in WRONG_UNITS.items():
        units[slip] = factor
    fall = free_fall(recording.positions, _rate_of_stamps(recording), units=units)
    if fall.unit == AS_READ or fall.up != "z" or not fall.is_clear:
        return
    if is_of_a_persons_size(recording.positions, recording.markers):
        return
    if fall.share <= CLEARLY * _falls(recording).share:
        return
    found_m_s2 = 9.81 / units[fall.unit]
    raise RecordingError.at(
        f"{place_of(recording)}: scale",
        "markers to fall freely at 9.81 m/s²",
        f"{found_m_s2:.3g} m/s² in {100 * fall.share:.0f} % of the frames; "
        f"the numbers look like {fall.unit}: {_remedy(recording, fall.unit)}",
    )


def check_rigid(
    recording: Recording, *, largest_strain: float = softness.LARGEST_STRAIN
) -> None:
    """Require the body's markers to be one body, without a limb or a foot.

    It may be soft.

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
    one, other = bend.pair
    varies = (
        f"'{names[one]}' to '{names[other]}' varying by {1e3 * bend.change_m:.1f} mm, "
        f"{100 * bend.strain:.1f} % of"
    )
    length = f"{1e3 * bend.length_m:.0f} mm"
    where = "of the body's size"
    if bend.when == softness.USUALLY:
        found = f"{varies} {length}"
    elif bend.when == softness.AT_ITS_LOWEST:
        found = f"{varies} {length}, where it is lowest"
        where = "of the body's size where it is lowest"
    else:
        odd = names[bend.odd]
        found = f"{varies} the others' {length}, and '{odd}' coming down to the feet"
    most = f"{100 * bend.limit:g} % ({_key_of(bend)}) {where}"
    raise RecordingError.at(
        f"{place_of(recording)}: markers.body",
        f"distances that vary by at most {most}",
        f"{found}; is '{names[bend.odd]}' on the body?",
        key="markers.body",
    )


def _key_of(bend: softness.Bend) -> str:
    """Return the key that sets the limit of a bend."""
    key = "quality.largest_body_strain"
    if bend.when == softness.AT_ITS_LOWEST:
        return f"twice {key}"
    if bend.when == softness.ON_FLOOR:
        return f"half {key}"
    return key


def notes(recording: Recording) -> list[Message]:
    """Return remarks that do not stop the analysis.

    They are those of the reader, and on unseen markers, high feet, a soft body and so
    on.
    """
    body_names = recording.names("body")
    foot_names = recording.names("foot")
    heights = recording.feet[:, :, 2]
    above_m = HIGH_FOOT * body_over_feet(recording)[2]
    found = [
        *_unseen(recording),
        *high_feet(heights, foot_names, above_m=above_m),
        *feet_as_one(heights, foot_names),
        *_rounding(recording),
        *_missing_times(recording),
        *softness.softness_remark(recording.body, body_names),
        *treated(recording.body, recording.rate_hz, scale=recording.scale),
    ]
    of_reader = [
        Message("recordings.as_read", {"text": remark}) for remark in recording.remarks
    ]
    place = place_of(recording)
    of_data = [
        Message("recordings.at", {"place": place, "remark": remark}) for remark in found
    ]
    return [*of_reader, *of_data]


def _unseen(recording: Recording) -> list[Message]:
    """Report markers that are missing in many frames."""
    remarks = []
    missing = 1 - fraction_seen(recording)
    for name, fraction in zip(recording.markers, missing.tolist(), strict=True):
        if fraction > MISSING_NOTE_FRACTION:
            values = {"marker": name, "percent": 100 * fraction}
            remarks.append(Message("recordings.unseen", values))
    return remarks


def rounded_to(positions: FloatArray) -> float | None:
    """Return the step, m, that all coordinates (N, M, 3), m, are multiples of, or None.

    None if it is too fine. A multiple rounded to float32 counts as one, but not so far
    from the origin that float32 itself has steps of more than a hundredth of these.
    """
    for step_m in (COARSE_STEP_M, FINE_STEP_M):
        # A sample rules out most files quickly.
        if _all_multiples(sampled(positions), step_m) and _all_multiples(
            positions, step_m
        ):
            return step_m
    return None


def _all_multiples(positions: FloatArray, step_m: float) -> bool:
    """Tell whether all coordinates seen are multiples of a step, m."""
    seen = positions[np.isfinite(positions)]
    off = np.abs(seen - step_m * np.round(seen / step_m))
    rounding = np.finfo(np.float32).eps * np.abs(seen)
    return bool(seen.size and np.all(off <= np.minimum(rounding, 0.01 * step_m)))


def _rounding(recording: Recording) -> list[Message]:
    """Report how coarsely coordinates are rounded, and the noise this adds."""
    step_m = rounded_to(recording.positions)
    if step_m is None:
        return []
    step_mm = 1e3 * step_m
    # The standard deviation of a uniform distribution.
    noise_mm = float(step_mm / np.sqrt(12))
    values = {"step_mm": step_mm, "noise_mm": noise_mm}
    return [Message("recordings.rounded", values)]


def _missing_times(recording: Recording) -> list[Message]:
    """Report how many frames are missing, and the number and length of pauses."""
    is_step_a_pause = is_pause(recording.time, recording.rate_hz)
    pauses_s = np.diff(recording.time)[is_step_a_pause]
    drops = check_stamps(recording.time).drops
    dropped = int(drops[~is_step_a_pause[drops[:, 0]], 1].sum())
    remarks = []
    if dropped == 1:
        remarks.append(Message("recordings.one_frame_missing"))
    elif dropped:
        remarks.append(Message("recordings.frames_missing", {"number": dropped}))
    if len(pauses_s):
        code = "recordings.one_pause"
        if len(pauses_s) > 1:
            code = "recordings.pauses"
        values = {"number": len(pauses_s), "duration_s": float(pauses_s.sum())}
        remarks.append(Message(code, values))
    return remarks
