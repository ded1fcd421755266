"""Text output on a terminal: an inspection, progress, and written files."""

from __future__ import annotations

import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from hopdata.errors import HopdataError, counted

if TYPE_CHECKING:
    from hopdata.arrays import FloatArray
    from hopdata.recordings.quality.guess import Guess
    from hopdata.recordings.quality.inspection import Inspection

# Exit codes of a command; argparse itself exits with 2 on a wrong command line.

OK, PROBLEM, INTERRUPTED = 0, 1, 130


WIDTH, COLUMNS, MOST_SUSPECTS = 100, 50, 20
KINDS = {
    "frozen": "frozen marker", "dropped": "dropout", "rate": "wrong frame rate",
    "filled": "filled gap",
    "irregular": "irregular time stamp", "backward": "backward time stamp",
    "jitter": "clock that jitters", "copy": "copied part",
}  # fmt: skip
LONG_UNSEEN = 0.2  # of the frames
HEIGHTS, PARTLY, UNSEEN = "▁▂▃▄▅▆▇█", "▒", "·"
PLAIN = str.maketrans(HEIGHTS + PARTLY + UNSEEN, "#" * len(HEIGHTS) + "+.")


def listing(inspection: Inspection, file: str, *, encoding: str = "utf-8") -> str:
    """Describe the contents of a recording.

    Parameters
    ----------
    inspection : Inspection
        Result of the inspection.
    file : str
        The file, for the first line.
    encoding : str
        Encoding of the terminal; the picture is in ASCII if necessary.
    """
    said = [line for note in notes(inspection) for line in _wrapped("note", note)]
    lines = [file, *_facts(inspection), *said, "", *_rigid(inspection), ""]
    lines += [*_gaps(inspection), ""]
    text = "\n".join([*lines, *_suspects(inspection)])
    try:
        text.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        text = text.translate(PLAIN).encode("ascii", errors="replace").decode("ascii")
    return text


def answer(inspection: Inspection) -> str:
    """Answer in one sentence whether anything is wrong."""
    kinds = Counter(suspect.kind for suspect in inspection.suspects())
    if not kinds:
        return "No swapped or frozen markers, spikes, jumps, dropped frames or irregular stamps."
    parts = ", ".join(
        counted(count, KINDS.get(kind, kind)) for kind, count in kinds.items()
    )
    return f"{counted(kinds.total(), 'suspect')}: {parts}."


def _facts(inspection: Inspection) -> list[str]:
    timing = inspection.timing
    stamps = f"time stamps regular to {1e3 * timing.jitter_s:.3f} ms"
    if timing.n_dropped:
        stamps = f"{counted(timing.n_dropped, 'frame')} dropped"
    rate = f"{len(inspection.time)} at {inspection.rate_hz:g} Hz, {inspection.duration_s:.1f} s"
    unit, up = inspection.unit, inspection.up
    return [
        f"  {'frames':8} {rate}; {stamps}",
        *_wrapped(
            "markers", f"{len(inspection.markers)}: {', '.join(inspection.markers)}"
        ),
        *_wrapped("unit", f"{unit.value}: {unit.reason}"),
        *_wrapped("up", f"{up.value}: {up.reason}"),
    ]


def notes(inspection: Inspection) -> list[str]:
    """Ask about what is unsure, with two candidates, and list what needs no answer.

    The latter are remarks of the reader, processing of the positions, and unseen
    markers.
    """
    questions = question("input.unit", inspection.unit)
    questions += question("input.vertical_axis", inspection.up)
    questions += question("input.rate_hz", inspection.rate)
    gaps = [one for one in inspection.gaps if LONG_UNSEEN < one.share < 1]
    told = "unseen in many of the frames: "
    told += ", ".join(f"{one.marker} ({100 * one.share:.0f} %)" for one in gaps)
    told += "; that may lose landings, and on a foot those of other legs would count in their place"
    lost = [f"{told}: choose markers that are seen"] * bool(gaps)
    return [
        *questions,
        *inspection.remarks,
        *map(str, inspection.treated),
        *map(str, inspection.lost),
        *lost,
    ]


def question(key: str, guess: Guess) -> list[str]:
    """Ask about a key with its two candidates, unless the guess is sure."""
    asked = f"{key}: {guess.value} or {guess.other}? {guess.value} is not sure ({guess.reason})"
    return [] if guess.is_sure else [asked]


def _rigid(inspection: Inspection) -> list[str]:
    white = 1e3 * inspection.typical_noise_m
    noise = f"{white:.2f} mm per coordinate from frame to frame (median of the markers)"
    lines = _wrapped("noise", noise if isfinite(white) else "no five frames in a row")
    for cluster in inspection.clusters:
        names = ", ".join(inspection.markers[m] for m in cluster.markers)
        noise = f"{1e3 * cluster.noise:.2f} mm per coordinate by its distances"
        lines += _wrapped("rigid", f"{names}; {noise}")
    if not inspection.clusters:
        lines += _wrapped("rigid", "no three markers that keep their distances")
    return lines


def _gaps(inspection: Inspection) -> list[str]:
    """Return a line of heights per marker, and its gaps in numbers."""
    import numpy as np

    width = max(map(len, inspection.markers), default=0)
    n_columns = max(1, min(COLUMNS, len(inspection.time)))
    column = inspection.duration_s / n_columns
    signs = f"{HEIGHTS[0]} low to {HEIGHTS[-1]} high, {PARTLY} partly unseen, {UNSEEN} unseen"
    lines = [f"  height and gaps (a column is {column:.3g} s; {signs})"]
    heights = inspection.positions[:, :, 2]
    low, high = (
        np.nanquantile(heights, [0.01, 0.99]) if np.isfinite(heights).any() else (0, 1)
    )
    levels = (len(HEIGHTS) * (heights - low) / max(high - low, 1e-9)).clip(
        0, len(HEIGHTS) - 1
    )
    for gaps, level in zip(inspection.gaps, levels.T, strict=True):
        longest = f"{counted(gaps.longest, 'frame')} ({gaps.longest / inspection.rate_hz:.3g} s)"
        share = f"{float(f'{100 * gaps.share:.2g}'):g} % unseen"
        numbers = f"{counted(gaps.count, 'gap')}, longest {longest}, {share}"
        numbers = (
            "never seen" if gaps.share == 1 else numbers if gaps.count else "no gap"
        )
        lines.append(f"  {gaps.marker:{width}} {_bar(level, n_columns)} {numbers}")
    return lines


def _bar(level: FloatArray, n_columns: int) -> str:
    """Draw one line; a column counts as partly unseen if a single frame in it is missing."""
    import numpy as np

    columns = ((np.isnan(part), part) for part in np.array_split(level, n_columns))
    return "".join(
        UNSEEN if c.all() else PARTLY if c.any() else HEIGHTS[round(float(z.mean()))]
        for c, z in columns
    )


def _suspects(inspection: Inspection) -> list[str]:
    found, lines = inspection.suspects(), [f"  {answer(inspection)}"]
    for suspect in found[:MOST_SUSPECTS]:
        where = f"frame {suspect.start + 1} ({suspect.time_s:.3f} s)"
        lines.append(f"    {suspect.kind:8} {where:24} {suspect.text}")
    if len(found) > MOST_SUSPECTS:
        lines.append(f"    and {len(found) - MOST_SUSPECTS} more; --html lists all")
    return lines


def _wrapped(key: str, text: str) -> list[str]:
    return textwrap.wrap(
        text, WIDTH, initial_indent=f"  {key:8} ", subsequent_indent=" " * 11
    )


# Progress on stderr: one line, replaced, on a terminal; elsewhere lines, or nothing.

CLEAR_LINE = "\r\033[K"


@contextmanager
def progress_line(first: str = "") -> Iterator[Callable[[str], None]]:
    """Show the first step on a terminal, yield a function for the others; clear the line after."""
    shown = sys.stderr.isatty()

    def show(text: str) -> None:
        if shown:
            print(f"{CLEAR_LINE}{text}", end="", file=sys.stderr, flush=True)

    try:
        show(first + " ..." * bool(first))
        yield lambda step: show(step + " ..." * shown)
    finally:
        show("")


# Files written by a command: complete or not at all, with one clear message.


def write_text(path: Path, text: str) -> None:
    """Write a text file, creating the folders on its path.

    Raises
    ------
    HopdataError
        If the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        told = f"expected a file that can be written, found: {error.strerror}"
        raise HopdataError(f"{path}: {told}") from None
