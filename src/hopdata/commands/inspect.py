"""``hopdata inspect``: what is in a recording, and what looks wrong."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from hopdata.commands.exit_codes import OK, PROBLEM
from hopdata.commands.progress import Progress
from hopdata.commands.writing import write_text

if TYPE_CHECKING:
    from hopdata.recordings.quality.inspection import Inspection


def inspect(options: argparse.Namespace) -> int:
    """Say what is in a file; exit code 1 if anything looks wrong."""
    from hopdata.commands.listing import listing

    inspection = inspected(options)
    encoding = sys.stdout.encoding or "ascii"
    print(listing(inspection, str(options.file), encoding=encoding))
    if options.html is not None:
        from hopdata.commands.inspection_html import inspection_html

        with Progress() as progress:
            progress("drawing the page")
            page = inspection_html(inspection, options.file.name)
        write_text(options.html, page)
        print(f"  page     {options.html}")
    return PROBLEM if inspection.n_problems else OK


def inspected(options: argparse.Namespace) -> Inspection:
    """Read and measure the file of ``file``, ``unit``, ``vertical_axis``, ``rate`` ...."""
    from hopdata.recordings.importing import read_raw
    from hopdata.recordings.quality.inspection import inspect_recording

    with Progress() as progress:
        progress(f"reading {options.file}")
        raw = read_raw(
            options.file, rate_hz=options.rate, most_unpacked_mb=options.most_unpacked_mb
        )
        return inspect_recording(
            raw, unit=options.unit, up=options.vertical_axis, progress=progress
        )
