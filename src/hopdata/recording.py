"""The `Recording`: marker positions over time, in SI units, with z up."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from hopdata import interchange
from hopdata.arrays import BoolArray, FloatArray, Shown, figure_function
from hopdata.errors import (
    ArgumentError,
    RecordingError,
    chosen,
    require_choice,
    told_call,
)
from hopdata.given import feet_and_joined, marker_names, numbers
from hopdata.scale import median_offset, sampled, scale_of
from hopdata.time_stamps import require_stamps, times_and_rate


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


#: Suffixes of the files of `Recording.save`.
HDF5 = (".h5", ".hdf5")
# "part" is another marker of the preceding foot.
ROLES = ("body", "foot", "part", "boom", "other")


@dataclass(frozen=True, repr=False, eq=False)
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
        `hopdata.recordings.axes.FILE_AXES`.
    events : tuple of Event
        Events marked in the file, on the same clock as `time`.
    remarks : tuple of str
        Statements in the file that were wrong and have been corrected, one line each.
    filled : (N, M) bool array, optional
        True for positions that were not seen but filled in; None if no gaps were
        filled.
    joined : tuple of (str, tuple of str)
        Feet with several of the foot markers: name, and those markers.
    other_feet : tuple of str
        Markers of the file that were left out, and that land at other times than the
        feet; a study then takes frames about the landings only.
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
    joined: tuple[tuple[str, tuple[str, ...]], ...] = ()
    other_feet: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n_frames = len(self.time)
        n_markers = len(self.markers)
        if len(self.roles) != n_markers:
            raise ArgumentError.at("roles", f"{n_markers} entries", len(self.roles))
        shapes = {
            "time": (n_frames,),
            "positions": (n_frames, n_markers, 3),
            "filled": (n_frames, n_markers),
        }
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array is None:
                continue
            found = getattr(array, "shape", type(array))
            if found != shape:
                raise ArgumentError.at(name, f"an array of shape {shape}", found)

    def _told(self) -> str:
        """Return the name, the size and the share of positions seen."""
        seen = 0.0
        if self.positions.size:
            seen = 100 * fraction_seen(self).mean()
        return (
            f"'{self.name}': {len(self.markers)} markers, {len(self.time):,} frames "
            f"at {self.rate_hz:g} Hz, {seen:.3g} % seen"
        )

    def _rows(self) -> dict[str, Any]:
        """Return each marker, its role and in how many of the frames it was seen, %."""
        return {
            "marker": self.markers,
            "role": self.roles,
            "seen (%)": 100 * fraction_seen(self),
        }

    # Markers and roles.

    @told_call
    def with_roles(
        self,
        *,
        feet: Iterable[str] | Mapping[str, Iterable[str]] | None = None,
        body: Iterable[str] | None = None,
        boom: Iterable[str] | None = None,
    ) -> Self:
        """Return a recording in which these markers are feet, body or boom.

        Parameters
        ----------
        feet : iterable of str, or mapping, optional
            A marker for each foot; or the markers of each foot by its name, as in
            ``{"left": ["LHEE", "LTOE"]}``.
        body : iterable of str, optional
            Three markers or more on one rigid part.
        boom : iterable of str, optional
            Markers of a boom that holds the animal.

        Returns
        -------
        Recording
            Markers of a role that is not given keep it. Those with a role come first,
            body before feet before boom, each in the order given; the others follow.

        Raises
        ------
        HopdataError
            If a name is no marker of the recording, or is given twice.

        Examples
        --------
        >>> time, markers = np.arange(5) / 100, ["hip1", "hip2", "hip3", "toe", "wand"]
        >>> recording = Recording.from_arrays(time, np.zeros((5, 5, 3)), markers)
        >>> recording.with_roles(feet=["toe"], body=["hip1", "hip2", "hip3"]).roles
        ('body', 'body', 'body', 'foot', 'other')
        """
        joined = self.joined
        if feet is not None:
            feet, joined = feet_and_joined(feet)
        given = {"body": body, "foot": feet, "boom": boom}
        key_of = {"body": "body", "foot": "feet", "boom": "boom"}
        markers_of: dict[str, tuple[str, ...]] = {}
        for role, names in given.items():
            if names is not None:
                markers_of[role] = marker_names(key_of[role], names)
                for one in markers_of[role]:
                    require_choice(key_of[role], one, self.markers)
        named = [name for names in markers_of.values() for name in names]
        marker_names(" and ".join(key_of[role] for role in markers_of), named)
        for role in given:
            if role not in markers_of:
                kept = [name for name in self.names(role) if name not in named]
                markers_of[role] = tuple(kept)
        role_of = {name: role for role in given for name in markers_of[role]}
        for name, role in zip(self.markers, self.roles, strict=True):
            is_free = role in given and name not in role_of
            role_of.setdefault(name, "other" if is_free else role)
        return replace(
            self._of_markers(list(role_of)), roles=(*role_of.values(),), joined=joined
        )

    def __eq__(self, other: object) -> bool:
        """Tell whether all is the same; positions that were not seen are alike."""
        if not isinstance(other, Recording):
            return NotImplemented
        for one in fields(self):
            mine = getattr(self, one.name)
            yours = getattr(other, one.name)
            if isinstance(mine, np.ndarray) and isinstance(yours, np.ndarray):
                if not np.array_equal(mine, yours, equal_nan=mine.dtype != bool):
                    return False
            elif mine is not yours and mine != yours:
                return False
        return True

    __hash__ = None  # type: ignore[assignment]  # arrays may be changed in place

    def __contains__(self, marker: object) -> bool:
        return marker in self.markers

    def __iter__(self) -> Iterator[str]:
        """Go through the names of the markers, as a table through its columns."""
        return iter(self.markers)

    def __getitem__(self, key: str | Sequence[str] | slice) -> Any:
        """Return what the markers of these names did, or some of the frames.

        Parameters
        ----------
        key : str, sequence of str, or slice
            ``recording["toe"]`` is an array (N, 3), m, of the recording's own memory.
            ``recording[["toe", "heel"]]`` is a recording of these markers, and
            ``recording[100:200]`` one of these frames (`part`). For a span of time
            take `between`.
        """
        if isinstance(key, str):
            require_choice("marker", key, self.markers)
            return self.positions[:, self.markers.index(key)]
        if isinstance(key, slice):
            return self.part(key)
        if isinstance(key, list | tuple):
            names = marker_names("markers", key)
            for one in names:
                require_choice("marker", one, self.markers)
            return self._of_markers(names)
        wanted = "the name of a marker, a list of names, or a slice of frames"
        raise ArgumentError.at("recording[...]", wanted, f"{key!r}")

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.markers)

    def _of_markers(self, names: Sequence[str]) -> Self:
        """Return a recording of these markers, in this order."""
        order = [self.markers.index(name) for name in names]
        if order == list(range(len(self.markers))):
            return self
        kept = [(foot, own) for foot, own in self.joined if {*own} <= {*names}]
        return replace(
            self,
            positions=self.positions[:, _together(order)],
            markers=tuple(names),
            roles=tuple(self.roles[one] for one in order),
            filled=None if self.filled is None else self.filled[:, _together(order)],
            joined=tuple(kept),
        )

    # To and from other libraries.

    def _parts(self) -> dict[str, Any]:
        """Return the parts that `hopdata.interchange` takes."""
        parts = {one.name: getattr(self, one.name) for one in fields(self)}
        parts["events"] = [[one.label, one.time_s] for one in self.events]
        parts["remarks"] = list(self.remarks)
        return parts

    @classmethod
    def _from_parts(
        cls,
        parts: Mapping[str, Any],
        feet: Iterable[str] | Mapping[str, Iterable[str]] | None,
        body: Iterable[str] | None,
        name: str | None,
    ) -> Self:
        """Return a recording of the parts that `hopdata.interchange` returns."""
        time = parts["time"]
        require_stamps(time)
        markers = marker_names("markers", parts["markers"])
        roles = interchange.roles_of(parts, markers)
        for role in roles:
            require_choice("role", role, ROLES)
        rate_hz = interchange.rate_that_fits(time, parts.get("rate_hz"))
        if rate_hz is None:
            time, rate_hz = times_and_rate(time)
        found = cls(
            name=name or parts.get("name", "recording"),
            time=time,
            positions=parts["positions"],
            markers=markers,
            roles=tuple(roles),
            rate_hz=rate_hz,
            source=parts.get("source", ""),
            source_sha256=parts.get("source_sha256", ""),
            vertical_axis=parts.get("vertical_axis", "z"),
            events=tuple(Event(*one) for one in parts.get("events", ())),
            remarks=tuple(parts.get("remarks", ())),
            filled=parts["filled"],
            joined=tuple((foot, tuple(own)) for foot, own in parts.get("joined", ())),
            other_feet=tuple(parts.get("other_feet", ())),
        )
        if feet is None and body is None:
            return found
        return found.with_roles(feet=feet, body=body)

    @told_call
    def to_xarray(self, *, individual: str = interchange.INDIVIDUAL) -> Any:
        """Return the recording as a dataset of poses, as the package movement has them.

        Parameters
        ----------
        individual : str
            Label of the animal.

        Returns
        -------
        xarray.Dataset
            ``position`` in m along ``time`` (s), ``space`` (x, y, and z up),
            ``keypoints`` (with their ``role``) and ``individuals``; ``confidence``,
            which motion capture does not tell (NaN); ``filled``, if gaps were filled.
            The attributes ``fps``, ``time_unit``, ``source_file`` and ``ds_type`` are
            those of movement; ``hopdata`` holds the rest, so that `from_xarray`
            returns this recording again, bit by bit.

        Raises
        ------
        RecordingError
            If xarray is not installed.
        """
        return interchange.dataset_of(self._parts(), individual)

    @classmethod
    @told_call
    def from_xarray(
        cls,
        data: Any,
        *,
        individual: str | None = None,
        feet: Iterable[str] | Mapping[str, Iterable[str]] | None = None,
        body: Iterable[str] | None = None,
        name: str | None = None,
    ) -> Self:
        """Return the recording in a dataset of poses, of hopdata or of movement.

        Parameters
        ----------
        data : xarray.Dataset or xarray.DataArray
            Positions, m, z up, along ``time``, ``space`` (x, y, z), ``keypoints`` and,
            if there are any, ``individuals``, in any order.
        individual : str, optional
            Which animal, if there are several.
        feet, body, name
            As for `with_roles`; by default what the dataset says.

        Raises
        ------
        HopdataError
            If it is no such dataset; the message says what is missing.
        """
        parts = interchange.parts_of_dataset(data, individual)
        return cls._from_parts(parts, feet, body, name)

    @told_call
    def to_pandas(self, layout: str = "wide") -> Any:
        """Return the positions as a table, m and s.

        Parameters
        ----------
        layout : {"wide", "long"}
            ``"wide"``: a row for each frame, by its time ``time_s``; the columns have
            two levels, ``marker`` and ``axis``, so that ``table["toe"]["z"]`` is a
            height. ``"long"``: a row for each frame and marker, with the columns
            ``time_s, marker, role, x_m, y_m, z_m``, and ``filled`` if gaps were filled.

        Returns
        -------
        DataFrame
            The rest of the recording is in its ``attrs``, so that `from_pandas` returns
            this recording again, bit by bit (of a wide table without ``filled``).

        Examples
        --------
        >>> time, markers = np.arange(500) / 100, ["toe", "heel"]
        >>> recording = Recording.from_arrays(time, np.ones((500, 2, 3)), markers)
        >>> table = recording.to_pandas()
        >>> float(table["toe"]["z"].max())
        1.0
        >>> Recording.from_pandas(table.loc[1.0:1.5]).n_frames
        51
        """
        tables = {"wide": interchange.wide_table, "long": interchange.long_table}
        return chosen("layout", layout, tables)(self._parts())

    @classmethod
    @told_call
    def from_pandas(
        cls,
        table: Any,
        *,
        feet: Iterable[str] | Mapping[str, Iterable[str]] | None = None,
        body: Iterable[str] | None = None,
        name: str | None = None,
    ) -> Self:
        """Return the recording in a table, wide or long; see `to_pandas`.

        Parameters
        ----------
        table : DataFrame
            Positions, m, z up, and times, s; NaN, or no row, where a marker was not
            seen.
        feet, body, name
            As for `with_roles`; by default what the table says.

        Raises
        ------
        HopdataError
            If it is no such table; the message says what is missing.
        """
        parts = interchange.parts_of_table(table)
        return cls._from_parts(parts, feet, body, name)

    @told_call
    def plot(
        self,
        markers: str | Sequence[str] | None = None,
        *,
        ax: Any = None,
        style: str | None = None,
    ) -> Any:
        """Draw the heights of markers over time.

        Parameters
        ----------
        markers : str or sequence of str, optional
            By default the feet, and the body's mean; without roles all markers.
        ax : Axes or Figure, optional
            Where to draw; by default a figure of its own.
        style : str, optional
            ``"nature"``, ``"ieee"`` or ``"poster"``.

        Returns
        -------
        Figure
            Or, with `ax`, what was drawn into.
        """
        if isinstance(markers, str):
            markers = [markers]
        shown = self if markers is None else self[list(markers)]
        heights = {
            name: shown.positions[:, number, 2]
            for number, name in enumerate(shown.markers)
        }
        roles = dict(zip(shown.markers, shown.roles, strict=True))
        if markers is not None:
            roles = dict.fromkeys(heights, "other")
        draw = figure_function("recording:heights_figure")
        return draw(shown.time, heights, roles, ax=ax, style=style)

    @classmethod
    @told_call
    def from_arrays(
        cls,
        time: ArrayLike,
        positions: ArrayLike,
        markers: Iterable[str],
        *,
        feet: Iterable[str] = (),
        body: Iterable[str] = (),
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
            role. `with_roles` gives them later, and `hopdata.guess` guesses them.
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
        stamps = numbers("time", time)
        places = numbers("positions", positions)
        known = marker_names("markers", markers)
        of_foot = marker_names("feet", feet)
        of_body = marker_names("body", body)

        require_stamps(stamps)
        shape = (len(stamps), len(known), 3)
        if places.shape != shape:
            raise RecordingError.at(
                "positions", f"shape {shape} (frames, markers, 3)", places.shape
            )
        marker_names("feet and body", (*of_foot, *of_body))
        for key, names in (("feet", of_foot), ("body", of_body)):
            for one in names:
                require_choice(key, one, known)

        role = dict.fromkeys(of_foot, "foot") | dict.fromkeys(of_body, "body")
        roles = tuple(role.get(name, "other") for name in known)
        frame_times, rate_hz = times_and_rate(stamps)
        return cls(name, frame_times, places, known, roles, rate_hz)

    def indices(self, role: str) -> list[int]:
        """Return the indices of the markers with this role, in order."""
        require_choice("role", role, ROLES)
        return [i for i, r in enumerate(self.roles) if r == role]

    def names(self, role: str) -> tuple[str, ...]:
        """Return the names of the markers with this role, in order."""
        return tuple(self.markers[i] for i in self.indices(role))

    def part(self, frames: slice) -> Self:
        """Return a recording of these frames only.

        The rate is that of the frames kept: half of it for every second frame.
        """
        wanted = "a slice such as slice(0, 1000)"
        if not isinstance(frames, slice):
            raise ArgumentError.at("frames", wanted, f"{frames!r}")
        ends = (frames.start, frames.stop, frames.step)
        if not all(one is None or isinstance(one, int | np.integer) for one in ends):
            found = f"{frames!r}; for a span of time take between(begin_s, end_s)"
            raise ArgumentError.at("frames", f"{wanted}, in frames", found)
        if (frames.step or 1) < 0:
            raise ArgumentError.at("frames", wanted, f"{frames!r}")
        return replace(
            self,
            time=self.time[frames],
            positions=self.positions[frames],
            filled=None if self.filled is None else self.filled[frames],
            rate_hz=self.rate_hz / (frames.step or 1),
        )

    @told_call
    def between(self, begin_s: float | None = None, end_s: float | None = None) -> Self:
        """Return a recording of the frames between two instants, both included.

        Parameters
        ----------
        begin_s, end_s : float, optional
            On the clock of `time`, s; by default from the first frame, to the last.

        Raises
        ------
        ArgumentError
            If fewer than two frames are between them.

        Examples
        --------
        >>> time, markers = np.arange(500) / 100, ["toe", "heel"]
        >>> recording = Recording.from_arrays(time, np.ones((500, 2, 3)), markers)
        >>> recording.between(1.0, 1.5)
        <Recording 'recording': 2 markers, 51 frames at 100 Hz, 100 % seen>
        """
        ends = []
        for key, value in (("begin_s", begin_s), ("end_s", end_s)):
            is_number = isinstance(value, int | float | np.number) and value == value
            if value is not None and not is_number:
                raise ArgumentError.at(key, "a time in s", f"{value!r}")
            ends.append(value)
        start = 0
        stop = len(self.time)
        if ends[0] is not None:
            start = int(np.searchsorted(self.time, ends[0], "left"))
        if ends[1] is not None:
            stop = int(np.searchsorted(self.time, ends[1], "right"))
        if stop - start < 2:
            first, last = self.time[[0, -1]] if len(self.time) else (np.nan, np.nan)
            wanted = f"two frames or more; those of {place_of(self)} are at "
            wanted += f"{first:g} to {last:g} s"
            raise ArgumentError.at("begin_s, end_s", wanted, f"{begin_s} and {end_s}")
        return self.part(slice(start, stop))

    @told_call
    def save(self, file: str | Path) -> Path:
        """Write the recording to an HDF5 file, which `hopdata.read` reads again.

        Parameters
        ----------
        file : path
            Ends in ``.h5``. It replaces a file of this name.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        ArgumentError
            If the name ends otherwise.
        """
        if not isinstance(file, str | Path) or Path(file).suffix not in HDF5:
            raise ArgumentError.at("file", "a name that ends in .h5", f"{str(file)!r}")
        write = resolve_name("hopdata.recordings.readers.hdf5:write_recording")
        Path(file).parent.mkdir(parents=True, exist_ok=True)
        write(file, self)
        return Path(file)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.time)

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the last, s."""
        if not len(self.time):
            return 0.0
        return float(self.time[-1] - self.time[0])

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
        """Mean height of the body markers, (N,), m; NaN where one is not seen."""
        return np.asarray(self.body[:, :, 2].mean(axis=1))

    @cached_property
    def scale(self) -> float:
        """Scale of the body and foot markers: see `scale_of`."""
        markers = self.indices("body") + self.indices("foot")
        return scale_of(sampled(self.positions)[:, markers])

    @property
    def time_scale(self) -> float:
        """Factor for times: the root of the scale.

        Gravity is the same at all sizes.
        """
        return float(np.sqrt(self.scale))


def place_of(recording: Recording) -> str:
    """Return the origin of a recording, for messages."""
    n_more_files = recording.source_sha256.count(",")
    if n_more_files:
        first_file = recording.source.partition(", ")[0]
        return f"{first_file} and {n_more_files} more"
    return recording.source or f"recording '{recording.name}'"


def _together(markers: list[int]) -> list[int] | slice:
    """Return the indices of adjacent markers as a slice, which copies no frames."""
    if not markers:
        return markers
    side_by_side = range(markers[0], markers[-1] + 1)
    if markers != list(side_by_side):
        return markers
    return slice(side_by_side.start, side_by_side.stop)


# Between the files of one recording, and between their digests.
SEPARATOR = ", "


def require_distinct(recordings: Iterable[Recording]) -> None:
    """Require that no two files, of one recording or of several, hold the same bytes.

    No landing may count twice.

    Raises
    ------
    RecordingError
        If two do; the message names both files.
    """
    known: dict[str, str] = {}
    for recording in recordings:
        digests = [d for d in recording.source_sha256.split(SEPARATOR) if d]
        for number, digest in enumerate(digests, start=1):
            here = f"file {number} of recording '{recording.name}'"
            if digest in known:
                raise RecordingError.at(
                    place_of(recording),
                    "each file once",
                    f"the same bytes in {here} and in {known[digest]}: "
                    "their landings would count twice",
                )
            known[digest] = here


def fraction_seen(recording: Recording) -> FloatArray:
    """Return the fraction of the frames in which each marker was seen, (M,)."""
    return np.asarray((~np.isnan(recording.positions).any(axis=2)).mean(axis=0))


def body_over_feet(recording: Recording) -> FloatArray:
    """Return the mean body position minus the mean foot position, (3,), m.

    It is the median over frames.
    """
    body = sampled(recording.body).mean(axis=1)
    feet = sampled(recording.feet).mean(axis=1)
    return median_offset(body - feet)
