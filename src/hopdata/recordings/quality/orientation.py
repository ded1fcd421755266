"""Guess the unit of a file and the axis that points up, each with its reason."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, FloatArray
from hopdata.errors import RecordingError, chosen, require_choice
from hopdata.recording import extent, sampled
from hopdata.recordings.axes import DIRECTIONS, FILE_AXES, along
from hopdata.recordings.quality.stretches import (
    CLEARER,
    FLAT,
    flattest_direction,
    scale_of_all,
)
from hopdata.recordings.raw import METRES_PER_UNIT, RawRecording

# The range spans a factor of less than 1000, so at most one of mm and m can be
# plausible.
PLAUSIBLE_EXTENT_M = (0.015, 12.0)


# Up direction and unit, from markers in free fall, which accelerate downwards by g.

HALF_WINDOW_S = 0.04
WITHIN = 0.25  # of g: largest deviation of an acceleration from free fall
LEAST_SHARE = 0.01  # of a marker's frames, mean over the markers
UNIT_CLEARER = 2.0  # ratio of free-fall frames to those in the next best unit
FREE_FALL_CLEARER = 4.0  # ratio of free-fall frames to those of the next best guess
MOST_FRAMES = 20_000  # evenly spaced frames that are evaluated

Markers = Mapping[str, Sequence[str]]  # names by role
UNITS_IN_M = MappingProxyType({"mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "m": 1.0})


@dataclass(frozen=True)
class FreeFall:
    """How much of a recording looks like free fall.

    Parameters
    ----------
    unit : str
        The unit in which most frames are in free fall.
    up : str
        The direction opposite to the fall: ``"z"``, ``"-y"`` and so on.
    share : float
        Share of the frames in free fall, mean over the markers.
    next_share : float
        The same for the best other direction in this unit.
    other_unit_share : float
        The same for the best other unit, in any direction.
    """

    unit: str
    up: str
    share: float
    next_share: float
    other_unit_share: float = 0.0

    @property
    def is_clear(self) -> bool:
        """Tell whether free fall is frequent, and much more so than along other directions."""
        return (
            self.share >= LEAST_SHARE
            and self.share > FREE_FALL_CLEARER * self.next_share
        )


def accelerations(
    positions: FloatArray, rate_hz: float, *, metres: float
) -> FloatArray:
    """Return accelerations of (N, M, 3) positions from parabolas over 80 ms, (K, M, 3), per s².

    The window is shorter for a small animal, with `metres` the length of one unit. At
    most about `MOST_FRAMES` evenly spaced frames are evaluated.
    """
    pace = np.sqrt(scale_of_all(sampled(positions) * metres))
    half = max(2, round(HALF_WINDOW_S * pace * rate_hz))
    time = np.arange(-half, half + 1) / rate_hz
    weights = (
        2 * np.linalg.pinv(np.stack([np.ones_like(time), time, time**2], axis=1))[2]
    )
    n = len(positions) - 2 * half
    if n < 1:
        return np.zeros((0, *positions.shape[1:]))
    stride = max(1, n // MOST_FRAMES)
    return sum(
        weight * positions[k : k + n : stride] for k, weight in enumerate(weights)
    )


def free_fall(
    positions: FloatArray, rate_hz: float, *, units: Mapping[str, float] = UNITS_IN_M
) -> FreeFall:
    """Look for free fall in every direction and unit.

    Parameters
    ----------
    positions : (N, M, 3) array
        In the unknown unit, along the file's axes.
    rate_hz : float
        Frame rate, Hz.
    units : mapping
        Units to try, and their lengths in m.

    Returns
    -------
    FreeFall
        The best guess; see `FreeFall.is_clear`.
    """
    of = (positions, rate_hz)
    shares = {u: _shares(accelerations(*of, metres=m), m) for u, m in units.items()}
    unit = max(shares, key=lambda u: max(shares[u].values()))
    ranked = sorted(shares[unit].items(), key=lambda item: -item[1])
    others = (max(shares[u].values()) for u in shares if u != unit)
    return FreeFall(
        unit, ranked[0][0], ranked[0][1], ranked[1][1], max(others, default=0.0)
    )


def _shares(measured: FloatArray, metres: float) -> dict[str, float]:
    """Return the share of accelerations (K, M, 3), per s², in free fall, mean over seen markers.

    One share per direction, for a unit that is `metres` long. With g in that unit, ``|a
    - g|² < (c g)²`` is tested as ``|a|² - 2 a·g < (c² - 1) g²``, so that squares are
    formed only once.
    """
    squares: FloatArray = np.einsum("kmi,kmi->km", measured, measured)
    known = np.asarray(np.isfinite(squares))
    seen = known.any(axis=0)
    counts = known.sum(axis=0)[seen]
    shares, gravity = {}, GRAVITY_M_S2 / metres
    for up in DIRECTIONS:
        pulled = 2 * gravity * along(measured, up)
        near = np.asarray(squares + pulled < (WITHIN**2 - 1) * gravity**2)
        found = np.count_nonzero(near[:, seen], axis=0)
        shares[up] = float(np.mean(found / counts)) if seen.any() else 0.0
    return shares


# The unit of a file's positions: given, stated or guessed from their size, with
# remarks.

UNITS = ("auto", *METRES_PER_UNIT)
UPWARD = ("auto", *FILE_AXES)


def choose_unit(positions: FloatArray, *, unit: str, nominal: str) -> str:
    """Choose the unit as given; ``"auto"`` takes the format's unless only another one fits.

    Parameters
    ----------
    positions : (N, M, 3) array
        In the unknown unit.
    unit : {"auto", "m", "mm"}
        ``input.unit`` of the configuration.
    nominal : {"m", "mm"}
        The format's own unit.
    """
    require_choice("input.unit", unit, UNITS)
    if unit != "auto":
        return unit
    size = extent(positions)
    return next(
        (u for u, metres in METRES_PER_UNIT.items() if _fits(size * metres)), nominal
    )


def speak_for_silent(
    files: Sequence[str], pieces: Sequence[RawRecording], unit: str
) -> list[RawRecording]:
    """Give files without a stated unit the unit of the others, if those agree on one.

    Parameters
    ----------
    files, pieces
        Names of a recording's files and what was read from each.
    unit : {"auto", "m", "mm"}
        ``input.unit`` of the configuration.

    Raises
    ------
    RecordingError
        If no unit is given and the size of a file without one contradicts the unit of
        the others.
    """
    stating = [i for i, piece in enumerate(pieces) if piece.unit_is_stated]
    if len({pieces[i].unit for i in stating}) != 1:
        return list(pieces)
    first = stating[0]
    nominal = pieces[first].unit
    theirs = choose_unit(pieces[first].positions, unit=unit, nominal=nominal)
    for file, piece in zip(files, pieces, strict=True):
        own = choose_unit(piece.positions, unit=unit, nominal=nominal)
        if not piece.unit_is_stated and own != theirs:
            found = f"no unit, and markers whose distances fit {own} only"
            found += "; files joined in one recording must agree"
            raise RecordingError.at(
                f"{file}: unit", f"{theirs} as in {files[first]}", found
            )
    return [replace(piece, unit=nominal) for piece in pieces]


def unit_remarks(
    files: Sequence[str], pieces: Sequence[RawRecording], raw: RawRecording, taken: str
) -> tuple[str, ...]:
    """Remark that the unit is a guess because the files state none, or an impossible one.

    Parameters
    ----------
    files, pieces
        Names of a recording's files and what was read from each.
    raw : RawRecording
        The whole recording.
    taken : {"m", "mm"}
        The unit that `choose_unit` chose for ``"auto"``.

    Returns
    -------
    tuple of str
        One line for files that state no unit and one for files that are overruled, each
        with the reason and the key that settles it; none if all files state `taken`.
    """
    silent, stating = (
        [
            f
            for f, piece in zip(files, pieces, strict=True)
            if piece.unit_is_stated == stated
        ]
        for stated in (False, True)
    )
    faults = []
    if silent:
        faults.append((silent, "expected the file to state it, found none"))
    if stating and taken != raw.unit:
        size = extent(raw.positions) * METRES_PER_UNIT[raw.unit]
        found = f"expected {raw.unit} as stated, found markers that would span {size:.3g} m in it"
        faults.append((stating, found))
    return tuple(
        f"{named[0]}{f' and {len(named) - 1} more' * (len(named) > 1)}: unit: {found}; "
        f"{_guess(raw, taken)}"
        for named, found in faults
    )


def _guess(raw: RawRecording, taken: str) -> str:
    """Report which unit was taken, the evidence for it and how to settle it."""
    size = extent(raw.positions) * METRES_PER_UNIT[taken]
    fall = free_fall(raw.positions, raw.rate_hz, units=METRES_PER_UNIT)
    reason = (
        f"in which the markers span {size:.3g} m" if _fits(size) else "which is usual"
    )
    if _fits(size) and fall.is_clear and fall.unit == taken:
        reason += f" and fall at 9.81 m/s² in {100 * fall.share:.0f} % of the frames"
    return f"taken for {taken}, {reason}; input.unit: {taken} makes it certain"


def _fits(size_m: float) -> bool:
    """Tell whether an animal or a robot can have this size."""
    return PLAUSIBLE_EXTENT_M[0] <= size_m <= PLAUSIBLE_EXTENT_M[1]


@dataclass(frozen=True)
class Guess:
    """A value and the reason for it.

    Parameters
    ----------
    value : str
        The value.
    reason : str
        A phrase shown to the user.
    is_sure : bool
        Whether the data support it; otherwise it is only the usual value.
    other : str
        The alternative value, if this one is not sure.
    """

    value: str
    reason: str
    is_sure: bool = True
    other: str = ""


def guess_unit_and_up(
    raw: RawRecording,
    *,
    unit: str | None = None,
    up: str | None = None,
    markers: Markers | None = None,
) -> tuple[Guess, Guess]:
    """Guess the unit and the direction that points up.

    Parameters
    ----------
    raw : RawRecording
        As read.
    unit, up : str, optional
        Values given by the user, used as they are, except an `up` of ``"auto"``.
    markers : mapping, optional
        Names of the markers of the ``"body"`` and the ``"feet"``: a body is above its
        feet.

    Returns
    -------
    unit, up : Guess
        The unit ``"m"``, ``"mm"``, ``"cm"`` or ``"inch"``; the direction such as
        ``"z"``, ``"-y"``.
    """
    units = UNITS_IN_M if unit is None else {unit: chosen("unit", unit, UNITS_IN_M)}
    raw = replace(raw, rate_hz=_rate_by_stamps(raw))
    fall = free_fall(raw.positions, raw.rate_hz, units=units)
    found = Guess(unit, "as given") if unit else _unit(raw, fall)
    if up is not None and up != "auto":
        return found, Guess(up, "as given")
    over = body_over_feet_in_file(raw, markers or {})
    return found, _up(raw, fall, over)


def choose_up(
    asked: str, source: str, raw: RawRecording, unit: str, markers: Markers
) -> tuple[str, tuple[str, ...]]:
    """Choose the file's up direction: as asked, or for ``"auto"`` by the fall and the markers.

    Also return remarks on that choice. `markers` names those of the ``"body"`` and the
    ``"feet"``.

    Raises
    ------
    RecordingError
        If the direction has to be found and the data do not show it clearly.
    """
    if asked != "auto":
        return asked, ()
    up = guess_unit_and_up(raw, unit=unit, markers=markers)[1]
    if up.is_sure:
        return up.value, (f"{source}: {up.value} is up: {up.reason}",)
    wanted = "a clear fall, or a body that is clearly above its feet"
    raise RecordingError.at(f"{source}: input.vertical_axis: auto", wanted, up.reason)


def _unit(raw: RawRecording, fall: FreeFall) -> Guess:
    if fall.is_clear and fall.share > UNIT_CLEARER * fall.other_unit_share:
        told = f"in {100 * fall.share:.0f} % of the frames the markers fall at 9.81 m/s², if the "
        told += f"numbers are {fall.unit}"
        against = raw.unit_is_stated and fall.unit != raw.unit
        return Guess(
            fall.unit, told + ", and not in the unit that the file states" * against
        )
    unit = choose_unit(raw.positions, unit="auto", nominal=raw.unit)
    size, metres, of = (
        extent(raw.positions),
        UNITS_IN_M[unit],
        (raw.positions, raw.rate_hz),
    )
    moves = {u: m * liveliness(*of, metres=m) for u, m in UNITS_IN_M.items()}
    low, high = LIVELY_M_S2
    lively = {
        u for u, m in UNITS_IN_M.items() if _fits(size * m) and low <= moves[u] <= high
    }
    own = (
        "the format's own unit" if raw.unit_is_stated else "usual, the file states none"
    )
    why = own if unit == raw.unit else f"in {raw.unit} the size would be absurd"
    told = f"{why}; the markers span {size * metres:.2f} m"
    if unit in lively:
        return Guess(unit, f"{told} and move as animals do, at {moves[unit]:.0f} m/s²")
    other = next((u for u in UNITS_IN_M if u in lively), "cm" if unit == "mm" else "mm")
    nothing = f"nothing falls, and the markers move at {moves[unit]:.2g} m/s²"
    return Guess(unit, f"{told}; {nothing}", is_sure=False, other=other)


# Range of accelerations of a running, walking or hopping animal: the median marker, in
# the fastest tenth of the time. In a unit that is ten times too small it hardly moves.
LIVELY_M_S2 = (5.0, 100.0)
RATES_HZ = (25, 30, 50, 60, 100, 120, 150, 200, 240, 250, 300, 400, 500, 1000)
OTHER_RATE = 0.02  # relative difference
OTHER_RATES = (
    0.5,
    1 / 1.2,
    1.2,
    2.0,
)  # of the stated rate: usual ones that it is mistaken for
FALLING = (
    0.7,
    1.3,
)  # g, at the right rate: downward acceleration of a body that leaves the ground
SOME_CLEARER = 1.5  # ratio of free fall to that along the next best direction


def liveliness(positions: FloatArray, rate_hz: float, *, metres: float) -> float:
    """Return the acceleration that the median marker exceeds in a tenth of the time, per s²."""
    size: FloatArray = np.linalg.norm(
        accelerations(positions, rate_hz, metres=metres), axis=2
    )
    of_seen = size[:, np.isfinite(size).any(axis=0)]
    return (
        float(np.median(np.nanquantile(of_seen, 0.9, axis=0)))
        if of_seen.size
        else np.nan
    )


def guess_rate(
    raw: RawRecording, unit: str, *, up: str = "z", is_stated: bool = True
) -> Guess:
    """Guess the frame rate, Hz, from free fall, whose acceleration grows with the rate squared.

    Parameters
    ----------
    raw : RawRecording
        As read, at the stated rate, or at any rate if none is stated.
    unit : str
        Unit of the positions, one of `UNITS_IN_M`.
    up : str
        Direction that points up, one of `DIRECTIONS`.
    is_stated : bool
        Whether the file states its rate.
    """
    units, own, by_stamps = {unit: UNITS_IN_M[unit]}, raw.rate_hz, _rate_by_stamps(raw)
    if is_stated and by_stamps != own:
        told = f"as stated, but the time stamps run at {by_stamps:g} Hz"
        return Guess(f"{own:g}", told, is_sure=False, other=f"{by_stamps:g}")
    if not is_stated:
        (best, share), (following, _) = _falls_by_rate(raw, units)
        if share < LEAST_SHARE:
            return Guess(
                "", "nothing falls freely that would show it", False, following
            )
        told = (
            f"{100 * share:.0f} % of the frames are free fall if the rate is {best} Hz"
        )
        return Guess(best, told, is_sure=False, other=following)
    pull = _pull_down(raw, up, units[unit])
    low, high = FALLING
    fall = free_fall(raw.positions, own, units=units)
    falls_clearly = (
        fall.share >= LEAST_SHARE and fall.share > SOME_CLEARER * fall.next_share
    )
    falls_as_stated = falls_clearly and fall.up == up and low <= pull <= high
    clearer = FREE_FALL_CLEARER if falls_as_stated else UNIT_CLEARER
    another_falls = _another_rate_falls(raw, units, up, clearer * fall.share)
    if falls_as_stated and not another_falls:
        return Guess(f"{own:g}", "as stated, and with it the markers fall at 9.81 m/s²")
    if not another_falls and not pull > high:
        stated = (
            "as stated, and as the time stamps run" if raw.has_stamps else "as stated"
        )
        return Guess(
            f"{own:g}",
            f"{stated}; nothing falls freely that would speak for or against it",
        )
    if pull > high:
        told = (
            f"as stated, but with it the markers would be pulled down by {pull:.2g} g"
        )
    else:
        told = f"as stated, but with it they fall freely in {100 * fall.share:.2g} % of the frames"
        told += ", and more often with another"
    (best, share), (_, next_share) = _falls_by_rate(raw, units)
    if best == f"{own:g}" or share < max(LEAST_SHARE, FREE_FALL_CLEARER * next_share):
        best = f"{own / 2 if pull > high else 2 * own:g}"
    return Guess(f"{own:g}", told, False, best)


def _another_rate_falls(
    raw: RawRecording, units: Mapping[str, float], up: str, share: float
) -> bool:
    """Tell whether, at another rate, markers fall freely in more than this share of the frames.

    They must fall along the vertical axis. At a wrong rate, `up` may have been taken
    for down.
    """
    for factor in OTHER_RATES:
        fall = free_fall(raw.positions, factor * raw.rate_hz, units=units)
        clearly = (
            fall.share >= LEAST_SHARE and fall.share > SOME_CLEARER * fall.next_share
        )
        if clearly and fall.up[-1] == up[-1] and fall.share > share:
            return True
    return False


def _falls_by_rate(
    raw: RawRecording, units: Mapping[str, float]
) -> list[tuple[str, float]]:
    """Return the two usual rates, Hz, with the most frames in free fall, and their shares."""
    shares = (
        (f"{r:g}", free_fall(raw.positions, r, units=units).share) for r in RATES_HZ
    )
    return sorted(shares, key=lambda found: -found[1])[:2]


def _pull_down(raw: RawRecording, up: str, metres: float) -> float:
    """Return the acceleration against `up` of the median marker, exceeded 2 % of the time, in g.

    A body that is not pulled down does not exceed 1, and one that leaves the ground
    comes near it. The result is a quarter of that if the stated rate is half the true
    one, and four times as much if it is twice the true one. Legs are swung down faster,
    so if the result is too large, the quarter of the markers with the least
    acceleration decides.
    """
    upward = along(accelerations(raw.positions, raw.rate_hz, metres=metres), up)
    seen = upward[np.isfinite(upward).any(axis=1)]
    if not len(seen):
        return np.nan
    last = np.isfinite(seen).sum(axis=1, keepdims=True) - 1
    quarter = np.take_along_axis(np.sort(seen, axis=1), -(-3 * last // 4), axis=1)
    pulled = np.nanmedian(seen, axis=1), quarter
    middle, least = (
        float(-np.quantile(p, 0.02) * metres / GRAVITY_M_S2) for p in pulled
    )
    return least if middle > FALLING[1] else middle


def _rate_by_stamps(raw: RawRecording) -> float:
    """Return the rate of the time stamps, Hz, if it clearly differs from the stated; else that."""
    steps = np.diff(raw.time)
    step = float(np.median(steps)) if len(steps) else 0.0
    onward = np.count_nonzero(steps > 0) > 0.9 * len(steps)  # else too few digits
    apart = onward and abs(step * raw.rate_hz - 1) > OTHER_RATE
    return float(f"{1 / step:.4g}") if apart else raw.rate_hz


# How many times farther the body is from its feet along the vertical than along any
# other axis. In 19 public recordings of standing, walking, running and a serve it is
# 3.9 times or more. At 1.5 times as much all of them are still sure.
UPRIGHT = 2.0


def body_over_feet_in_file(raw: RawRecording, markers: Markers) -> FloatArray:
    """Return the median of mean body position minus mean foot position, (3,), along file axes.

    NaN if no marker of the body, or none of the feet, is in the recording.
    """
    frames = sampled(raw.positions)
    places = []
    for key in ("body", "feet"):
        columns = [
            k for k, name in enumerate(raw.markers) if name in (markers.get(key) or ())
        ]
        if not columns:
            return np.full(3, np.nan)
        places.append(frames[:, columns].mean(axis=1))
    difference = places[0] - places[1]
    difference = difference[np.isfinite(difference).all(axis=1)]
    return (
        np.asarray(np.median(difference, axis=0))
        if len(difference)
        else np.full(3, np.nan)
    )


def _upright(over: FloatArray) -> str:
    """Return the direction in which a body is clearly above its feet, from (3,); else ""."""
    sizes = np.abs(over)
    order = np.argsort(sizes)
    largest = int(order[-1])
    if not sizes[largest] > UPRIGHT * sizes[order[-2]]:
        return ""
    axis = "xyz"[largest]
    return axis if over[largest] > 0 else f"-{axis}"


def _up(raw: RawRecording, fall: FreeFall, over: FloatArray) -> Guess:
    """Guess the direction that points up; `over` (3,) is the body's place over the feet, if known.

    Gravity is never wrong, so a clear fall decides. Then it is the body that is above
    its feet, unless the markers come to rest along another axis, or the file states
    another.
    """
    if fall.is_clear:
        shares = f"{100 * fall.share:.0f} % of the frames; along the next best axis in "
        shares += f"{100 * fall.next_share:.1f} %"
        return Guess(fall.up, f"the markers fall along it, in {shares}")
    upright = _upright(over)
    flattest, flatness, following = flattest_direction(raw.positions)
    is_flat = flatness < FLAT and CLEARER * flatness < following
    if (
        is_flat and along(over, flattest) <= 0
    ):  # someone who squats comes back to one height
        is_flat = False
    if is_flat and upright in ("", flattest):
        rest = "markers come down to rest at their lowest along it, again and again, as on a floor"
        return Guess(flattest, rest)
    if upright and not is_flat and raw.stated_up in ("", upright):
        beside, higher = np.sort(np.abs(over))[1:]
        told = "along it the body is above the feet"
        if beside > 0:
            told += f", {higher / beside:.2g} times as far as beside them"
        return Guess(upright, told)
    if raw.stated_up and not upright:
        return Guess(
            raw.stated_up, "the file says so; nothing falls freely that would show it"
        )
    if upright:
        against = flattest if is_flat else raw.stated_up
        why = "markers come to rest again and again" if is_flat else "the file says so"
        told = f"the body is above the feet along it, but along {against} {why}"
        told += "; input.vertical_axis settles it"
        return Guess(upright, told, is_sure=False, other=against)
    likely, other = "yz" if flattest == "y" else "zy"  # both are common
    usual = f"nothing clearly falls or steps on a floor again and again: only usual, as is {other}"
    return Guess(
        likely, f"{usual}; input.vertical_axis settles it", is_sure=False, other=other
    )
