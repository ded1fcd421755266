"""What ``hopdata inspect`` prints, as an object for a notebook or a program."""

from __future__ import annotations

from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

from hopdata.arrays import Shown, pd
from hopdata.errors import ArgumentError, HopdataError, counted, told_call
from hopdata.inspecting import listing
from hopdata.inspecting.devices import Devices, devices_of, lines_of
from hopdata.inspecting.guesses import inspected_file, with_effects
from hopdata.landings.role_guesses import guessed_roles
from hopdata.messages import Lines
from hopdata.recording import Recording, place_of
from hopdata.recordings.quality import inspection as quality


@dataclass(frozen=True, repr=False)
class InspectedRecording(Shown):
    """What is in a recording, and what looks wrong; ``print`` shows the whole listing.

    Parameters
    ----------
    source : str
        The file, or the name of the recording.
    inspection : Inspection
        All that was measured: see `hopdata.recordings.quality.inspection.Inspection`.
    devices : Devices
        Force plates, events and analog channels of the file.
    """

    source: str
    inspection: quality.Inspection
    devices: Devices

    @property
    def table(self) -> pd.DataFrame:
        """A row for each marker.

        ``marker``, its guessed ``role`` (empty without one), ``gaps`` (how many),
        ``longest_s`` (of them), ``unseen`` (share of the frames) and ``noise_m`` (of a
        coordinate from frame to frame).
        """
        found = self.inspection
        role_of = self._role_of()
        rows = [
            (
                gaps.marker,
                role_of.get(gaps.marker, ""),
                gaps.count,
                gaps.longest / found.rate_hz,
                gaps.share,
                noise_m,
            )
            for gaps, noise_m in zip(found.gaps, found.noise_m, strict=True)
        ]
        columns = ["marker", "role", "gaps", "longest_s", "unseen", "noise_m"]
        return pd.DataFrame(rows, columns=columns)

    @property
    def suspects(self) -> pd.DataFrame:
        """What looks wrong, the earliest first.

        The columns are ``kind, markers, frame, time_s, remark``. Frames count from 1,
        times from the first frame.
        """
        rows = [
            (one.kind, ", ".join(one.markers), one.start + 1, one.time_s, one.text)
            for one in self.inspection.suspects()
        ]
        columns = ["kind", "markers", "frame", "time_s", "remark"]
        return pd.DataFrame(rows, columns=columns)

    @property
    def notes(self) -> Lines:
        """What is unsure, with its candidates, and what else to know."""
        refused = map(str, self.devices.refused)
        return Lines([*listing.notes(self.inspection), *refused])

    @told_call
    def plot(self, *, ax: Any = None, style: str | None = None) -> Any:
        """Draw when each marker was seen, and what looks wrong.

        Parameters
        ----------
        ax : Axes or Figure, optional
            Where to draw; by default a figure of its own.
        style : str, optional
            ``"nature"``, ``"ieee"`` or ``"poster"``.

        Returns
        -------
        Figure
            Or, with `ax`, what was drawn into.
        """
        from hopdata.inspecting.timeline import drawn_gaps

        return drawn_gaps(self.inspection, ax=ax, style=style)

    def _role_of(self) -> dict[str, str]:
        try:
            roles = guessed_roles(self.inspection)
        except HopdataError:  # frames without an order in time
            return {}
        named = {"body": roles.body, "foot": roles.feet, "boom": roles.boom}
        return {name: role for role, names in named.items() for name in names}

    def __str__(self) -> str:
        lines = lines_of(self.devices)
        return listing.listing(self.inspection, self.source, devices=lines)

    def _told(self) -> str:
        found = self.inspection
        n_frames = f"{len(found.time):,} frames at {found.rate_hz:g} Hz"
        markers = counted(len(found.markers), "marker")
        answer = listing.answer(found).rstrip(".")
        answer = answer[:1].lower() + answer[1:]
        return f"'{self.source}': {markers}, {n_frames}; {answer}"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


@told_call
def inspect(
    source: str | Path | Recording,
    *,
    unit: str | None = None,
    vertical_axis: str | None = None,
    rate_hz: float | None = None,
) -> InspectedRecording:
    """Show what is in a file or a recording, and what looks wrong.

    Parameters
    ----------
    source : path or Recording
        A file of any known format, or a recording.
    unit, vertical_axis, rate_hz
        Of the file, if you know them; otherwise they are guessed, and the listing says
        why. A recording has its own.

    Returns
    -------
    InspectedRecording
        ``print(found)`` is what ``hopdata inspect`` prints; ``found.table`` has a row
        for each marker, ``found.suspects`` one for all that looks wrong, and
        ``found.notes`` asks about what is unsure.

    Raises
    ------
    RecordingError
        If the file cannot be read.
    ArgumentError
        If what is to be known of a file is given for a recording.
    """
    if isinstance(source, Recording):
        of_file = {"unit": unit, "vertical_axis": vertical_axis, "rate_hz": rate_hz}
        given = [name for name, value in of_file.items() if value is not None]
        if given:
            wanted = "none for a recording, which is in m, z up, at its own rate"
            raise ArgumentError.at(", ".join(given), wanted, of_file[given[0]])
        found = replace(quality.inspect(source), place=place_of(source))
        found = replace(found, remarks=source.remarks, events=source.events)
        beside = Devices(events=source.events)
        return InspectedRecording(source.name, with_effects(found), beside)
    if not isinstance(source, str | Path):
        wanted = "the path of a file, or a recording"
        raise ArgumentError.at("source", wanted, f"{source!r}"[:60])
    path = Path(source)
    found = inspected_file(
        path, unit=unit, vertical_axis=vertical_axis, rate_hz=rate_hz
    )
    found = with_effects(found)
    beside = devices_of(
        path,
        up=found.up.value,
        unit=found.unit.value,
        rate_hz=rate_hz,
        events=found.events,
    )
    return InspectedRecording(f"{source}", found, beside)
