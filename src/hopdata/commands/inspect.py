"""``hopdata inspect``: show what is in a recording, and what looks wrong."""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hopdata.commands import answers, terminal
from hopdata.commands.guesses import inspected
from hopdata.errors import HopdataError, counted
from hopdata.inspecting import devices, listing
from hopdata.inspecting.guesses import with_effects
from hopdata.inspecting.timeline import drawn_gaps
from hopdata.landings.role_guesses import guessed_roles
from hopdata.report.formatting import NOTES, Table
from hopdata.report.inputs import ReportFigure, picture_of, rendered

if TYPE_CHECKING:
    from hopdata.recordings.quality.inspection import Inspection, Suspect


def inspect(options: argparse.Namespace) -> int:
    """Show what is in a file, or in brief in each; exit code 1 if anything looks wrong.

    Raises
    ------
    HopdataError
        If a page of several files is asked for.
    """
    if options.brief or options.more:
        from hopdata.commands.brief import inspect_briefly

        if options.html is not None:
            found = f"{1 + len(options.more)} files"
            if not options.more:
                found = "--brief"
            raise HopdataError.at("--html", "one file and no --brief", found)
        return inspect_briefly([options.file, *options.more], options)
    inspection = inspected(options)
    with terminal.progress_line("finding by how much processing moves contacts"):
        inspection = with_effects(inspection)
    beside = _beside_markers(options, inspection)
    _show(inspection, str(options.file), beside)
    answers.give(files=[listing.fields_of(inspection, options.file)], page=options.html)
    if options.html is not None:
        with terminal.progress_line("drawing the page"):
            page = inspection_html(inspection, options.file.name, beside)
        terminal.write_text(options.html, page)
        print(f"  page     {options.html}")
    return terminal.PROBLEM if inspection.n_problems else terminal.OK


def _beside_markers(
    options: argparse.Namespace, inspection: Inspection
) -> devices.Devices:
    with terminal.progress_line(f"reading force plates and events of {options.file}"):
        return devices.devices_of(
            options.file,
            up=inspection.up.value,
            unit=inspection.unit.value,
            rate_hz=options.rate,
            events=inspection.events,
        )


def view(options: argparse.Namespace) -> int:
    """Write the 3-D page of a file, roles guessed as in `init`, and open it."""
    import webbrowser

    from hopdata.report.scene import recording_scene

    inspection = inspected(options)
    roles = guessed_roles(inspection)
    shown = inspection.recording(roles.feet, roles.body, name=options.file.name)
    page = rendered(
        "view.html.j2",
        title=options.file.name,
        told=str(shown),
        scene=recording_scene(shown),
    )
    out = options.out or Path(tempfile.gettempdir(), f"{options.file.name}.html")
    terminal.write_text(out, page)
    print(out)
    if not options.no_browser:
        webbrowser.open(out.resolve().as_uri())
    return terminal.OK


# The listing on a terminal, with its tables drawn.


def _show(inspection: Inspection, file: str, beside: devices.Devices) -> None:
    """Print the listing of a file, with its tables drawn if stdout is a terminal."""
    encoding = sys.stdout.encoding or "ascii"
    lines = devices.lines_of(beside)
    if sys.stdout.isatty():
        _draw(inspection, file, encoding, lines)
    else:
        text = listing.listing(inspection, file, encoding=encoding, devices=lines)
        print(text)


def _draw(
    inspection: Inspection, file: str, encoding: str, lines: listing.Devices
) -> None:
    """Print the listing on a terminal."""

    def encodable(text: str) -> str:
        return listing.encodable(text, encoding)

    width = terminal.width(listing.WIDTH)
    head = listing.head(inspection, file, lines, width=width)
    columns = listing.columns_that_fit(inspection, width)
    legend = listing.legend(inspection, width, columns)
    print(encodable("\n".join([*head, "", *legend])))
    terminal.draw_table(
        dict.fromkeys(listing.PICTURE, "left"),
        [tuple(map(encodable, row)) for row in listing.picture(inspection, columns)],
    )
    suspects = inspection.suspects()
    print(f"  {listing.answer(inspection)}")
    if suspects:
        shown = suspects[: listing.MOST_SUSPECTS]
        terminal.draw_table(
            {"kind": "left", "frame": "right", "s": "right", "what": "left"},
            [
                (one.kind, f"{one.start + 1}", f"{one.time_s:.3f}", encodable(one.text))
                for one in shown
            ],
        )
    for line in listing.further(len(suspects)):
        print(line)


# An inspection as a self-contained page.


def inspection_html(
    inspection: Inspection, file: str, beside: devices.Devices | None = None
) -> str:
    """Write the page on one recording, and on what its file holds beside markers."""
    beside = beside or devices.Devices()
    found = inspection.suspects()
    image, ends = _timeline(inspection, found)
    picture = ReportFigure("seen", image, "image/svg+xml", NOTES["seen"])
    tables = (
        _suspect_table(found),
        _gap_table(inspection),
        _rigid_table(inspection),
        _plate_table(beside),
        _event_table(beside),
    )
    span: tuple[float, ...] = ()
    if ends:
        first_s = float(inspection.time[0])
        last_s = float(inspection.time[-1])
        span = (*ends, first_s, last_s)
    return rendered(
        "inspection.html.j2",
        title=file,
        answer=listing.answer(inspection),
        highlights=_highlights(inspection),
        notes=[*listing.notes(inspection), *map(str, beside.refused)],
        pictures=[picture_of(picture, {})],
        tables=[table for table in tables if table.rows],
        markers=inspection.markers,
        span=span,
    )


def _highlights(inspection: Inspection) -> list[tuple[str, str, str]]:
    """Return title, value and remark of each fact at the top of the page."""
    unit = inspection.unit
    up = inspection.up
    n_frames = f"{len(inspection.time)}"
    n_markers = f"{len(inspection.markers)}"
    rate = f"{inspection.rate_hz:g} Hz"
    dropped = f"{counted(inspection.timing.n_dropped, 'frame')} dropped"
    noise = f"{1e3 * inspection.typical_noise_m:.2f} mm"
    return [
        ("Frames", n_frames, f"{inspection.duration_s:.1f} s"),
        ("Rate", rate, dropped),
        ("Markers", n_markers, "their names beside the picture"),
        ("Unit", unit.value, unit.reason),
        ("Up", up.value, up.reason),
        ("Noise", noise, "a coordinate, from frame to frame; median of the markers"),
    ]


def _timeline(
    inspection: Inspection, found: list[Suspect]
) -> tuple[bytes, tuple[float, ...]]:
    """Draw the timeline as SVG; with it, the ends of its time axis.

    The ends are shares of the picture's width.
    """
    from hopdata.figures.catalogue import FORMATS
    from hopdata.figures.style import style_context

    figure = drawn_gaps(inspection, found)
    buffer = io.BytesIO()
    with style_context():
        figure.savefig(buffer, format="svg", metadata=dict(FORMATS["svg"]))
    ends = tuple(x for axes in figure.axes for x in axes.get_position().intervalx)
    return buffer.getvalue(), ends


def _suspect_table(found: list[Suspect]) -> Table:
    rows = [
        (suspect.kind, suspect.text, f"{suspect.start + 1}", f"{suspect.time_s:.3f}")
        for suspect in found
    ]
    return Table(
        "What looks wrong",
        ("kind", "what", "frame", "time (s)"),
        tuple(rows),
        text_columns=2,
        note="Frames count from 1.",
    )


def _gap_table(inspection: Inspection) -> Table:
    rows = []
    for gaps, noise_m in zip(inspection.gaps, inspection.noise_m, strict=True):
        longest_s = f"{gaps.longest / inspection.rate_hz:.3f}"
        unseen = f"{100 * gaps.share:.2f}"
        noise = f"{1e3 * noise_m:.2f}" if np.isfinite(noise_m) else "—"
        numbers = (f"{gaps.count}", f"{gaps.longest}", longest_s, unseen, noise)
        rows.append((gaps.marker, *numbers))
    heads = ("gaps", "longest (frames)", "longest (s)", "unseen (%)", "noise (mm)")
    return Table(
        "Markers",
        ("marker", *heads),
        tuple(rows),
        note="Noise of a coordinate, from frame to frame.",
    )


def _rigid_table(inspection: Inspection) -> Table:
    rows = []
    for cluster in inspection.clusters:
        names = ", ".join(inspection.markers[marker] for marker in cluster.markers)
        rows.append((names, f"{1e3 * cluster.noise:.2f}"))
    by_distances = "Noise of a coordinate by the distances within"
    return Table(
        "Rigid clusters",
        ("markers", "noise (mm)"),
        tuple(rows),
        note=f"{by_distances}; what bends counts as noise.",
    )


def _plate_table(beside: devices.Devices) -> Table:
    rows = []
    for plate, onsets in beside.plates:
        along_x, along_y = plate.sides_m
        channels = f"{plate.channels[0]} to {plate.channels[-1]}"
        numbers = (
            f"{plate.type}",
            f"{along_x:.3f} x {along_y:.3f}",
            f"{plate.rate_hz:g}",
            f"{np.nanmax(plate.force[:, 2], initial=0.0):.0f}",
            f"{len(onsets.instant)}",
        )
        when = devices.onsets_text(onsets)
        rows.append((plate.name, channels, when, *numbers))
    heads = ("type", "size (m)", "rate (Hz)", "largest force (N)", "onsets")
    return Table(
        "Force plates",
        ("plate", "channels", "when it begins to bear load", *heads),
        tuple(rows),
        text_columns=3,
        note="Vertical force of the plate on the subject.",
    )


def _event_table(beside: devices.Devices) -> Table:
    rows = [(event.label, f"{event.time_s:.3f}") for event in beside.events]
    return Table("Events", ("label", "time (s)"), tuple(rows))
