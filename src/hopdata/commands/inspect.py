"""``hopdata inspect``: show what is in a recording, and what looks wrong."""

from __future__ import annotations

import argparse
import io
import sys
from typing import TYPE_CHECKING

import numpy as np

from hopdata import __version__
from hopdata.arrays import pd
from hopdata.commands import terminal
from hopdata.errors import RecordingError, counted
from hopdata.report.formatting import NOTES, Table
from hopdata.report.inputs import ReportFigure, picture_of, rendered

if TYPE_CHECKING:
    from hopdata.recordings.quality.inspection import Inspection, Suspect


def inspect(options: argparse.Namespace) -> int:
    """Show what is in a file; exit code 1 if anything looks wrong."""
    inspection = inspected(options)
    encoding = sys.stdout.encoding or "ascii"
    print(terminal.listing(inspection, str(options.file), encoding=encoding))
    if options.html is not None:
        with terminal.progress_line("drawing the page"):
            page = inspection_html(inspection, options.file.name)
        terminal.write_text(options.html, page)
        print(f"  page     {options.html}")
    return terminal.PROBLEM if inspection.n_problems else terminal.OK


def view(options: argparse.Namespace) -> int:
    """Write the 3-D page of a file, roles guessed as in `init`, and open it in a browser."""
    import tempfile
    import webbrowser
    from pathlib import Path

    from hopdata.commands.init import guessed_roles
    from hopdata.report.scene import recording_scene

    inspection = inspected(options)
    roles = guessed_roles(inspection)
    shown = inspection.recording(roles.feet, roles.body, name=options.file.name)
    page = rendered(
        "view.html.j2",
        title=options.file.name,
        told=shown.told(),
        scene=recording_scene(shown),
    )
    out = options.out or Path(tempfile.gettempdir(), f"{options.file.name}.html")
    terminal.write_text(out, page)
    print(out)
    if not options.no_browser:
        webbrowser.open(out.resolve().as_uri())
    return terminal.OK


def inspected(options: argparse.Namespace) -> Inspection:
    """Read and measure the file given by ``file``, ``unit``, ``vertical_axis``, ``rate`` ...."""
    from hopdata.recording import extent
    from hopdata.recordings.quality.frame_rate import guess_rate
    from hopdata.recordings.quality.inspection import inspect_recording
    from hopdata.recordings.quality.orientation import choose_unit
    from hopdata.recordings.raw import METRES_PER_UNIT, RateUnknownError
    from hopdata.recordings.readers.formats import read_raw

    with terminal.progress_line(f"reading {options.file}") as progress:
        limit = {"most_unpacked_mb": options.most_unpacked_mb}
        try:
            raw = read_raw(options.file, rate_hz=options.rate, **limit)
        except RateUnknownError as error:
            raw = read_raw(options.file, rate_hz=100.0, **limit)
            unit = choose_unit(raw.positions, unit="auto", nominal=raw.unit)
            rate = guess_rate(raw, unit, is_stated=False)
            try_it = f": --rate {rate.value} or {rate.other}?" if rate.value else ""
            raise RecordingError(f"{error}; {rate.reason}{try_it}") from None
        likely = choose_unit(
            raw.positions, unit="auto", nominal=options.unit or raw.unit
        )
        if likely != (options.unit or likely):
            size = METRES_PER_UNIT[likely] * extent(raw.positions)
            wanted = f"{likely}, in which the markers span {size:.3g} m"
            raise RecordingError.at(f"{options.file}: --unit", wanted, options.unit)
        guessed = {
            "unit": options.unit,
            "up": options.vertical_axis,
            "rate_hz": options.rate,
        }
        return inspect_recording(raw, **guessed, progress=progress)


# An inspection as a self-contained page.


def inspection_html(inspection: Inspection, file: str) -> str:
    """Write the page on one recording."""
    found = inspection.suspects()
    image, ends = _timeline(inspection, found)
    return rendered(
        "inspection.html.j2",
        version=__version__,
        title=file,
        answer=terminal.answer(inspection),
        highlights=_highlights(inspection),
        notes=terminal.notes(inspection),
        pictures=[picture_of(ReportFigure("seen", image, "image/svg+xml", NOTES["seen"]), {})],
        tables=[t for t in (_suspect_table(found), _gap_table(inspection), _rigid_table(inspection))
                if t.rows],
        markers=inspection.markers,
        span=(*ends, *(float(t) for t in inspection.time[[0, -1]])) if ends else (),
    )  # fmt: skip


def _highlights(inspection: Inspection) -> list[tuple[str, str, str]]:
    timing, unit, up = inspection.timing, inspection.unit, inspection.up
    noise = f"{1e3 * inspection.typical_noise_m:.2f} mm"
    return [
        ("Frames", f"{len(inspection.time)}", f"{inspection.duration_s:.1f} s"),
        (
            "Rate",
            f"{inspection.rate_hz:g} Hz",
            f"{counted(timing.n_dropped, 'frame')} dropped",
        ),
        ("Markers", f"{len(inspection.markers)}", "their names beside the picture"),
        ("Unit", unit.value, unit.reason),
        ("Up", up.value, up.reason),
        ("Noise", noise, "a coordinate, from frame to frame; median of the markers"),
    ]


def _timeline(
    inspection: Inspection, found: list[Suspect]
) -> tuple[bytes, tuple[float, ...]]:
    """Draw the timeline as SVG; return it with the span of its time axis as shares of its width."""
    from hopdata.figures.catalogue import FORMATS
    from hopdata.figures.quality import recording_gaps_figure
    from hopdata.figures.style import style_context

    time = inspection.time - inspection.time[0]
    columns = ["recording", "marker", "start_s", "stop_s"]
    stretches = [
        (g.marker, *stretch) for g in inspection.gaps for stretch in g.stretches
    ]
    gaps = [
        ("", name, time[a], time[min(b, len(time) - 1)]) for name, a, b in stretches
    ]
    faults = [
        ("", name, s.time_s, s.kind) for s in found for name in (s.markers or ("",))
    ]
    markers = {
        "recording": "",
        "marker": inspection.markers,
        "duration_s": inspection.duration_s,
    }
    figure = recording_gaps_figure(
        pd.DataFrame(markers),
        pd.DataFrame(gaps, columns=columns),
        pd.DataFrame(faults, columns=[*columns[:3], "kind"]),
    )
    buffer = io.BytesIO()
    with style_context():
        figure.savefig(buffer, format="svg", metadata=dict(FORMATS["svg"]))
    ends = tuple(x for axes in figure.axes for x in axes.get_position().intervalx)
    return buffer.getvalue(), ends


def _suspect_table(found: list[Suspect]) -> Table:
    rows = tuple((s.kind, s.text, f"{s.start + 1}", f"{s.time_s:.3f}") for s in found)
    head = ("kind", "what", "frame", "time (s)")
    return Table(
        "What looks wrong", head, rows, text_columns=2, note="Frames count from 1."
    )


def _gap_table(inspection: Inspection) -> Table:
    rows = []
    for g, noise in zip(inspection.gaps, inspection.noise_m, strict=True):
        seconds, noise_mm = (
            f"{g.longest / inspection.rate_hz:.3f}",
            f"{1e3 * noise:.2f}",
        )
        numbers = (f"{g.count}", f"{g.longest}", seconds, f"{100 * g.share:.2f}")
        rows.append((g.marker, *numbers, noise_mm if np.isfinite(noise) else "—"))
    head = (
        "marker",
        "gaps",
        "longest (frames)",
        "longest (s)",
        "unseen (%)",
        "noise (mm)",
    )
    return Table(
        "Markers", head, tuple(rows), note="Noise of a coordinate, from frame to frame."
    )


def _rigid_table(inspection: Inspection) -> Table:
    rows = tuple(
        (", ".join(inspection.markers[m] for m in c.markers), f"{1e3 * c.noise:.2f}")
        for c in inspection.clusters
    )
    note = "Noise of a coordinate by the distances within; what bends counts as noise."
    return Table("Rigid clusters", ("markers", "noise (mm)"), rows, note=note)
