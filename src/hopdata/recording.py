"""The `Recording`: marker positions over time, in SI units, with z up."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, Shown
from hopdata.errors import (
    ArgumentError,
    RecordingError,
    mismatch,
    require_choice,
    told_call,
)


@dataclass(frozen=True)
class Event:
    """An event that an operator or a device marked in the file.

    Parameters
    ----------
    label : str
        Name of the event.
    time_s : float
        Time as in the file, s.
    """

    label: str
    time_s: float


SLOWEST_S = (
    0.5  # longest median time between frames; longer ones suggest times in milliseconds
)
ROLES = (
    "body",
    "foot",
    "part",
    "boom",
    "other",
)  # "part": another marker of the preceding foot


@dataclass(frozen=True, repr=False)
class Recording(Shown):
    """Motion capture of one trial.

    Parameters
    ----------
    name : str
        Short name, unique in a study.
    time : (N,) array
        Time of each frame, s, strictly increasing.
    positions : (N, M, 3) array
        Marker positions in the world frame with z up, m; NaN where a marker was not
        seen.
    markers : tuple of str
        The M marker names.
    roles : tuple of str
        One of `ROLES` for each marker.
    rate_hz : float
        Nominal frame rate, Hz.
    source : str
        Name of the file that the recording was read from.
    source_sha256 : str
        Digest of that file.
    vertical_axis : str
        Axis of the source file that pointed up, such as ``"y"`` or ``"-z"``; see
        `hopdata.recordings.raw.FILE_AXES`.
    events : tuple of Event
        Events marked in the file, on the same clock as `time`.
    remarks : tuple of str
        Statements in the file that were wrong and have been corrected, one line each.
    filled : (N, M) bool array, optional
        True for positions that were not seen but filled in; None if no gaps were
        filled.
    """

    name: str
    time: FloatArray
    positions: FloatArray
    markers: tuple[str, ...]
    roles: tuple[str, ...]
    rate_hz: float
    source: str = ""
    source_sha256: str = ""
    vertical_axis: str = "z"
    events: tuple[Event, ...] = ()
    remarks: tuple[str, ...] = ()
    filled: BoolArray | None = None

    def __post_init__(self) -> None:
        seen = (len(self.time), len(self.markers))
        if len(self.roles) != seen[1]:
            raise ArgumentError.at("roles", f"{seen[1]} entries", len(self.roles))
        for name, shape in (
            ("time", seen[:1]),
            ("positions", (*seen, 3)),
            ("filled", seen),
        ):
            array = getattr(self, name)
            if (
                array is not None
                and (found := getattr(array, "shape", type(array))) != shape
            ):
                raise ArgumentError.at(name, f"an array of shape {shape}", found)

    def told(self) -> str:
        """Return the name, the size and the share of positions seen."""
        seen = 100 * fraction_seen(self).mean() if self.positions.size else 0.0
        size = f"{len(self.markers)} markers, {len(self.time):,} frames at {self.rate_hz:g} Hz"
        return f"'{self.name}': {size}, {seen:.3g} % seen"

    def rows(self) -> dict[str, Any]:
        """Return each marker, its role and the percentage of frames in which it was seen."""
        return {
            "marker": self.markers,
            "role": self.roles,
            "seen (%)": 100 * fraction_seen(self),
        }

    def to_xarray(self) -> Any:
        """Return the positions as an ``xarray.DataArray`` with named axes.

        Returns
        -------
        DataArray, (N, M, 3)
            Positions in m along ``time`` (s), ``marker`` (with its ``role``) and
            ``axis`` (x, y, and z up).

        Raises
        ------
        RecordingError
            If xarray is not installed.
        """
        try:
            from xarray import DataArray
        except ImportError:
            found = "none: pip install xarray"
            raise RecordingError.at("to_xarray", "the package xarray", found) from None
        roles = ("marker", list(self.roles))
        axes: Any = {
            "time": self.time,
            "marker": list(self.markers),
            "axis": list("xyz"),
        }
        attributes = {"units": "m", "rate_hz": self.rate_hz, "source": self.source}
        return DataArray(
            self.positions, {**axes, "role": roles}, list(axes), self.name, attributes
        )

    @classmethod
    @told_call
    def from_arrays(
        cls,
        time: ArrayLike,
        positions: ArrayLike,
        markers: Iterable[str],
        *,
        feet: Iterable[str],
        body: Iterable[str],
        name: str = "recording",
    ) -> Self:
        """Make a recording from arrays.

        Parameters
        ----------
        time : (N,) array-like
            Time of each frame, s, strictly increasing. Times rounded from an even grid,
            for example to float32 or to whole ms, are put back on the grid.
        positions : (N, M, 3) array-like
            Marker positions, m, z up; NaN where a marker was not seen.
        markers : iterable of str
            The M marker names.
        feet, body : iterable of str
            Names of the foot and body markers; the other markers are kept without a
            role.
        name : str
            Name of the recording.

        Raises
        ------
        HopdataError
            If shapes, times or names do not match.

        Examples
        --------
        >>> time, markers = np.arange(5) / 100, ["toe", "hip1", "hip2", "hip3"]
        >>> still = np.tile([[0, 0, 0], [0, 0, 1], [0.1, 0, 1], [0, 0.1, 1]], (5, 1, 1))
        >>> Recording.from_arrays(time, still, markers, feet=["toe"], body=markers[1:])
        <Recording 'recording': 4 markers, 5 frames at 100 Hz, 100 % seen>
        """
        from hopdata.recordings.raw import rate_of, settle

        stamps, places = numbers("time", time), numbers("positions", positions)
        known = marker_names("markers", markers)
        of_foot, of_body = marker_names("feet", feet), marker_names("body", body)
        size = (*stamps.shape, len(known), 3)
        steps = np.diff(stamps) if stamps.ndim == 1 and len(stamps) > 1 else np.empty(0)
        if not len(steps) or not (steps > 0).all() or np.median(steps) > SLOWEST_S:
            wrong = 1 + int(np.argmin(steps > 0)) if len(steps) else 0
            here = f"{stamps.flat[max(wrong - 1, 0) : wrong + 1]} at frame {wrong}"
            later = f"each later than the one before by at most {SLOWEST_S} s"
            found = f"shape {stamps.shape}, {here}"
            raise RecordingError.at(
                "time", f"two frames or more, (N,), s, {later}", found
            )
        if places.shape != size:
            raise RecordingError.at(
                "positions", f"shape {size} (frames, markers, 3)", places.shape
            )
        marker_names("feet and body", (*of_foot, *of_body))
        for key, chosen in (("feet", of_foot), ("body", of_body)):
            for one in chosen:
                require_choice(key, one, known)
        roles = (
            "body" if m in of_body else "foot" if m in of_foot else "other"
            for m in known
        )
        number = np.arange(1.0, len(stamps) + 1)
        whole, own = (rate_of(stamps, number, whole=w) or np.nan for w in (True, False))
        grid, remarks = settle("time", stamps, number, whole)
        fits = not remarks and grid is not stamps  # even except for rounding
        kept = (grid, whole) if fits else (stamps, own)
        return cls(name, kept[0], places, known, tuple(roles), kept[1])

    def indices(self, role: str) -> list[int]:
        """Return the indices of the markers with this role, in order."""
        require_choice("role", role, ROLES)
        return [i for i, r in enumerate(self.roles) if r == role]

    def names(self, role: str) -> tuple[str, ...]:
        """Return the names of the markers with this role, in order."""
        return tuple(self.markers[i] for i in self.indices(role))

    @property
    def place(self) -> str:
        """Origin of the recording, for messages."""
        if more := self.source_sha256.count(","):
            return f"{self.source.partition(', ')[0]} and {more} more"
        return self.source or f"recording '{self.name}'"

    def part(self, frames: slice) -> Self:
        """Return a recording of these frames only; taking every second frame halves the rate."""
        if not isinstance(frames, slice) or (frames.step or 1) < 0:
            raise ArgumentError.at(
                "frames", "a slice such as slice(0, 1000)", f"{frames!r}"
            )
        filled = None if self.filled is None else self.filled[frames]
        kept: Any = {"time": self.time[frames], "positions": self.positions[frames]}
        return replace(
            self, **kept, filled=filled, rate_hz=self.rate_hz / (frames.step or 1)
        )

    @cached_property
    def body(self) -> FloatArray:
        """Body markers, (N, B, 3), m."""
        return self.positions[:, _together(self.indices("body"))]

    @cached_property
    def feet(self) -> FloatArray:
        """Foot markers, (N, n, 3), m."""
        return self.positions[:, _together(self.indices("foot"))]

    @cached_property
    def body_height(self) -> FloatArray:
        """Mean height of the body markers, (N,), m; NaN where one of them is not seen."""
        return np.asarray(self.body[:, :, 2].mean(axis=1))

    @cached_property
    def scale(self) -> float:
        """Scale of the body and foot markers: see `scale_of`."""
        return scale_of(
            sampled(self.positions)[:, self.indices("body") + self.indices("foot")]
        )

    @property
    def pace(self) -> float:
        """Factor for times: the root of the scale, since gravity is the same at all sizes."""
        return float(np.sqrt(self.scale))


def _together(markers: list[int]) -> list[int] | slice:
    """Return the indices of adjacent markers as a slice, which avoids a copy of the frames."""
    side_by_side = markers and markers == list(range(markers[0], markers[-1] + 1))
    return slice(markers[0], markers[-1] + 1) if side_by_side else markers


def numbers(key: str, values: ArrayLike) -> FloatArray:
    """Return an argument as an array of floats; raise an error with its name if it is none."""
    try:
        return np.ma.asarray(values, float).filled(np.nan)
    except (TypeError, ValueError) as error:
        raise ArgumentError.at(
            key, "an array of numbers", str(error).partition(". ")[0]
        ) from None


def marker_names(key: str, names: Iterable[str]) -> tuple[str, ...]:
    """Return a list of distinct names as a tuple; raise an error with the key for anything else."""
    listed = isinstance(names, Iterable) and not isinstance(names, str)
    found = tuple(names) if listed else ()
    if not listed or not all(isinstance(name, str) for name in found):
        raise RecordingError.at(key, "a list of marker names", f"{names!r}")
    if len(set(found)) < len(found):
        raise RecordingError.at(key, "each name once", ", ".join(found))
    return found


# No landing may count twice, so the same content under two names is an error.

SEPARATOR = ", "  # between the files of one recording, and between their digests


def require_distinct(recordings: Iterable[Recording]) -> None:
    """Raise an error if two files are byte for byte the same, within or between recordings.

    Raises
    ------
    RecordingError
        If so; the message names both files.
    """
    known: dict[str, str] = {}
    for recording in recordings:
        for number, digest in enumerate(
            filter(None, recording.source_sha256.split(SEPARATOR))
        ):
            here = f"file {number + 1} of recording '{recording.name}'"
            if digest in known:
                same = f"the same bytes in {here} and in {known[digest]}"
                found = f"{same}: their landings would count twice"
                raise RecordingError.at(recording.place, "each file once", found)
            known[digest] = here


# How much of a recording was seen, and how far its markers extend.

SAMPLE_FRAMES = 2000


def fraction_seen(recording: Recording) -> FloatArray:
    """Return the fraction of the frames in which each marker was seen, (M,)."""
    return np.asarray((~np.isnan(recording.positions).any(axis=2)).mean(axis=0))


def extent(positions: FloatArray) -> float:
    """Return the diagonal of the box around all markers seen, as a median over frames.

    Parameters
    ----------
    positions : (N, M, 3) array
        Marker positions in any unit, along any axes.

    Returns
    -------
    float
        In the unit of `positions`; NaN if no frame shows two markers.
    """
    frames = np.ascontiguousarray(
        sampled(positions).T
    )  # (3, M, N): NumPy is slow along short axes
    seen = (~np.isnan(frames).any(axis=0)).sum(axis=0) >= 2
    if not seen.any():
        return float("nan")
    span = (np.fmax.reduce(frames, axis=1) - np.fmin.reduce(frames, axis=1))[:, seen]
    with np.errstate(over="ignore"):  # an absurd size may be infinite
        return float(np.median(np.sqrt((span**2).sum(axis=0))))


# The lengths of the code were tuned on the simulated hopper and on runners, whose body
# and foot markers have rms distances from their mean of 0.33 and 0.50 m. The value lies
# between: at 0.33 contacts of runners are found some mm too high, at 0.42 those of the
# hopper scatter by 6 % more. With 1.5 times the value all lengths and speeds are two
# thirds of what they are.
SIZE_OF_TUNING_M = 0.36
NO_ANIMAL_M = (1e-4, 1e4)  # smaller and larger positions are absurd, in whatever unit


def scale_of(positions: FloatArray) -> float:
    """Return the factor for lengths that were tuned on an animal of about 1 m.

    It is proportional to the size of the animal: the same animal at a hundredth of the
    size has a hundredth of the factor, however its recording is turned or shifted.
    Times scale with its root.

    Parameters
    ----------
    positions : (N, M, 3) array
        Marker positions, m; NaN where unseen.

    Returns
    -------
    float
        Rms distance of the markers from their mean, as a median over a sample of
        frames, divided by `SIZE_OF_TUNING_M`. It is 1 if no frame shows two markers
        apart.
    """
    frames = np.ascontiguousarray(
        sampled(positions).T
    )  # (3, M, N): NumPy is slow along short axes
    seen = np.asarray(~np.isnan(frames).any(axis=0))
    count = seen.sum(axis=0)
    enough = count >= 2
    if not enough.any():
        return 1.0
    frames, seen, count = frames[:, :, enough], seen[:, enough], count[enough]
    with np.errstate(over="ignore"):  # the size of absurd positions may be infinite
        middle = np.where(seen, frames, 0.0).sum(axis=1) / count
        squares = np.where(seen, (frames - middle[:, None]) ** 2, 0.0).sum(axis=(0, 1))
        size_m = float(np.median(np.sqrt(squares / count)))
    if not size_m > 0:
        return 1.0
    return float(np.clip(size_m, *NO_ANIMAL_M)) / SIZE_OF_TUNING_M


def body_over_feet(recording: Recording) -> FloatArray:
    """Return the median over frames of mean body position minus mean foot position, (3,), m."""
    difference = sampled(recording.body).mean(axis=1) - sampled(recording.feet).mean(
        axis=1
    )
    difference = difference[~np.isnan(difference).any(axis=1)]
    return (
        np.asarray(np.median(difference, axis=0))
        if len(difference)
        else np.full(3, np.nan)
    )


def sampled(positions: FloatArray) -> FloatArray:
    """Return an evenly spaced sample of frames (N, ...), fewer than twice `SAMPLE_FRAMES`."""
    return positions[:: max(1, len(positions) // SAMPLE_FRAMES)]


# Facts about a recording that only a simulation knows; only scoring reads them.


@dataclass(frozen=True, repr=False)
class Truth(Shown):
    """Truth of a synthetic recording of N frames, L landings and n feet.

    A landing runs from the apex of one hop to the apex of the next.

    Parameters
    ----------
    contact_times : (L, n) array
        Instant at which each foot first touched in each landing, s; NaN if it did not
        touch.
    apex_times : (L,) array
        Time of the apex before each landing, s.
    complete : (L,) bool array
        Whether all feet were on the floor at once.
    foot_down : (N, n) bool array
        Whether each foot was in contact in each frame.
    body_height : (N,) array
        Mean height of the body markers above the flat simulated floor, without noise,
        m.
    contact_points : (L, n, 2) array
        Point at which each foot first touched, in the world frame, m.
    floor_at_contacts : (L, n) array
        Height of the measured (curved) floor at these points, m.
    apex_states : (L, 12) array
        State of the body at the apex, after the kick (see `hopdata.scenes.body`).
    preloads_n : (L, n) array
        Preload of each leg in each landing, N.
    noise_m : float
        Standard deviation of the noise per marker coordinate, m.
    parameters_json : str
        All parameters of the simulation, as JSON.
    true_effect : float
        Relative difference between the exact maps of the contact orders, as the verdict
        measures it, between the sections of a study; NaN if it was not computed.
    """

    contact_times: FloatArray
    apex_times: FloatArray
    complete: BoolArray
    foot_down: BoolArray
    body_height: FloatArray
    contact_points: FloatArray
    floor_at_contacts: FloatArray
    apex_states: FloatArray
    preloads_n: FloatArray
    noise_m: float
    parameters_json: str
    true_effect: float = float("nan")

    def told(self) -> str:
        """Return the numbers of landings and feet."""
        return "of {} landings on {} feet".format(*self.contact_times.shape)


# Shapes by array: letters are N frames, L landings and n feet; numbers are fixed sizes.
_SIZES: dict[str, str] = {
    "contact_times": "L n", "apex_times": "L", "complete": "L", "foot_down": "N n",
    "body_height": "N", "contact_points": "L n 2", "floor_at_contacts": "L n",
    "apex_states": "L 12", "preloads_n": "L n",
}  # fmt: skip


def check_sizes(truth: Truth) -> None:
    """Check that the arrays of a truth agree in their numbers of frames, landings and feet.

    Raises
    ------
    ValueError
        If not; the message names the first array that does not match those before it.
    """
    known: dict[str, int] = {}
    for name, letters in _SIZES.items():
        shape, sizes = getattr(truth, name).shape, letters.split()
        expected = [
            int(letter) if letter.isdigit() else known.setdefault(letter, size)
            for letter, size in zip(sizes, shape, strict=False)
        ]
        if len(shape) != len(sizes) or list(shape) != expected:
            raise ValueError(
                mismatch(name, f"shape ({', '.join(sizes)}) of {known}", shape)
            )
