"""The file of a command, read and measured while the terminal shows what is done."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from hopdata.commands import terminal
from hopdata.commands.bringing import bring_recording
from hopdata.inspecting.guesses import inspected_file

if TYPE_CHECKING:
    from hopdata.recordings.quality.inspection import Inspection


def inspected(options: argparse.Namespace) -> Inspection:
    """Read and measure the file of a command; its other options override the guesses.

    Parameters
    ----------
    options : Namespace
        With ``file``, ``unit``, ``vertical_axis`` and ``rate``.
    """
    bring_recording(Path(options.file))
    with terminal.progress_line(f"reading {options.file}") as progress:
        return inspected_file(
            options.file,
            unit=options.unit,
            vertical_axis=options.vertical_axis,
            rate_hz=options.rate,
            progress=progress,
        )
