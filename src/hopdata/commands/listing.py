"""What `inspect` lists of a recording: facts, questions, a picture, suspects."""

from __future__ import annotations

import sys
import textwrap
from collections import Counter
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.commands import terminal
from hopdata.errors import counted
from hopdata.messages import Message

if TYPE_CHECKING:
    from hopdata.arrays import FloatArray
    from hopdata.recordings.quality.guess import Guess
    from hopdata.recordings.quality.inspection import Inspection
    from hopdata.recordings.quality.stretches import MarkerGaps

# Sizes of the listing: characters of a line, columns of the picture, suspects shown.
WIDTH = 100
COLUMNS = 50
MOST_SUSPECTS = 20

# Names of kinds of suspects that are not their own name.
KINDS = {
    "frozen": "frozen marker",
    "dropped": "dropout",
    "rate": "wrong frame rate",
    "filled": "filled gap",
    "irregular": "irregular time stamp",
    "backward": "backward time stamp",
    "jitter": "clock that jitters",
    "copy": "copied part",
}

#: Share of the frames in which a marker is unseen beyond which that is noted.
#: Unit: 1. Origin: chosen.
LONG_UNSEEN = 0.2

# Signs of the picture, and those of a terminal without them.
HEIGHTS = "▁▂▃▄▅▆▇█"
PARTLY = "▒"
UNSEEN = "·"
PLAIN = str.maketrans(HEIGHTS + PARTLY + UNSEEN, "#" * len(HEIGHTS) + "+.")


Devices = Sequence[tuple[str, str]]


def show(inspection: Inspection, file: str, devices: Devices = ()) -> None:
    """Print the listing of a file, with its tables drawn if stdout is a terminal."""
    encoding = sys.stdout.encoding or "ascii"
    if sys.stdout.isatty():
        _draw(inspection, file, encoding, devices)
    else:
        print(listing(inspection, file, encoding=encoding, devices=devices))


def _draw(inspection: Inspection, file: str, encoding: str, devices: Devices) -> None:
    """Print the listing on a terminal."""

    def encodable(text: str) -> str:
        return _encodable(text, encoding)

    head = [*_head(inspection, file, devices), "", _legend(inspection)]
    print(encodable("\n".join(head)))
    bars = _bars(inspection)
    terminal.draw_table(
        {"marker": "left", "height": "left", "gaps": "left"},
        [
            (encodable(gaps.marker), encodable(bar), _in_numbers(gaps, inspection))
            for gaps, bar in zip(inspection.gaps, bars, strict=True)
        ],
    )
    suspects = inspection.suspects()
    print(f"  {answer(inspection)}")
    if suspects:
        terminal.draw_table(
            {"kind": "left", "frame": "right", "s": "right", "what": "left"},
            [
                (one.kind, f"{one.start + 1}", f"{one.time_s:.3f}", encodable(one.text))
                for one in suspects[:MOST_SUSPECTS]
            ],
        )
    for line in _further(len(suspects)):
        print(line)


def listing(
    inspection: Inspection,
    file: str,
    *,
    encoding: str = "utf-8",
    devices: Devices = (),
) -> str:
    """Describe the contents of a recording.

    Parameters
    ----------
    inspection : Inspection
        Result of the inspection.
    file : str
        The file, for the first line.
    encoding : str
        Encoding of the terminal; the picture is in ASCII if necessary.
    devices : sequence of (str, str)
        A key and a text for what the file holds beside markers, from `devices`.
    """
    lines = [*_head(inspection, file, devices), "", *_picture(inspection), ""]
    lines += _suspects(inspection)
    return _encodable("\n".join(lines), encoding)


def _encodable(text: str, encoding: str) -> str:
    """Return a text, in ASCII if the encoding lacks one of its signs or is unknown."""
    try:
        text.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        plain = text.translate(PLAIN)
        return plain.encode("ascii", errors="replace").decode("ascii")
    return text


def answer(inspection: Inspection) -> str:
    """Answer in one sentence whether anything is wrong."""
    kinds = Counter(suspect.kind for suspect in inspection.suspects())
    if not kinds:
        return str(Message("commands.nothing_suspect"))
    parts = [counted(number, KINDS.get(kind, kind)) for kind, number in kinds.items()]
    values = {"number": counted(kinds.total(), "suspect"), "kinds": ", ".join(parts)}
    return str(Message("commands.suspects", values))


# Facts, and what is unsure.


def _head(inspection: Inspection, file: str, devices: Devices) -> list[str]:
    lines = [file, *_facts(inspection)]
    for key, text in devices:
        lines += _wrapped(key, text)
    for note in notes(inspection):
        lines += _wrapped("note", note)
    return [*lines, "", *_rigid(inspection)]


def _facts(inspection: Inspection) -> list[str]:
    timing = inspection.timing
    if timing.n_dropped:
        stamps = f"{counted(timing.n_dropped, 'frame')} dropped"
    else:
        stamps = f"time stamps regular to {1e3 * timing.jitter_s:.3f} ms"
    n_frames = len(inspection.time)
    rate = f"{n_frames} at {inspection.rate_hz:g} Hz, {inspection.duration_s:.1f} s"
    names = ", ".join(inspection.markers)
    unit = inspection.unit
    up = inspection.up
    return [
        f"  {'frames':8} {rate}; {stamps}",
        *_wrapped("markers", f"{len(inspection.markers)}: {names}"),
        *_wrapped("rate", f"{inspection.rate.value} Hz: {_why(inspection.rate)}"),
        *_wrapped("unit", f"{unit.value}: {unit.reason}"),
        *_wrapped("up", f"{up.value}: {up.reason}"),
    ]


def _why(guess: Guess) -> str:
    """Return all that was found for and against a guess, or else its reason."""
    return "; ".join(str(one) for one in guess.evidence) or guess.reason


def notes(inspection: Inspection) -> list[str]:
    """Ask about what is unsure, with two candidates, and list what needs no answer.

    The latter are remarks of the reader, processing of the positions, and unseen
    markers.
    """
    found = question("input.unit", inspection.unit)
    found += question("input.vertical_axis", inspection.up)
    found += question("input.rate_hz", inspection.rate)
    found += inspection.remarks
    found += [str(one) for one in (*inspection.treated, *inspection.lost)]
    return found + unseen_for_long(inspection)


def unseen_for_long(inspection: Inspection) -> list[str]:
    """Return one note on all markers that many frames do not show, or none."""
    unseen = [gaps for gaps in inspection.gaps if LONG_UNSEEN < gaps.share < 1]
    if not unseen:
        return []
    markers = [f"{gaps.marker} ({100 * gaps.share:.0f} %)" for gaps in unseen]
    return [str(Message("commands.unseen_for_long", {"markers": ", ".join(markers)}))]


def question(key: str, guess: Guess) -> list[str]:
    """Ask about a key with its two candidates, unless the guess is sure."""
    if guess.is_sure:
        return []
    values = {
        "key": key,
        "value": guess.value,
        "other": guess.other,
        "reason": guess.why,
    }
    return [str(Message("commands.which_value", values))]


def _rigid(inspection: Inspection) -> list[str]:
    noise_mm = 1e3 * inspection.typical_noise_m
    noise = "no five frames in a row"
    if isfinite(noise_mm):
        noise = f"{noise_mm:.2f} mm per coordinate from frame to frame"
        noise += " (median of the markers)"
    lines = _wrapped("noise", noise)
    for cluster in inspection.clusters:
        names = ", ".join(inspection.markers[marker] for marker in cluster.markers)
        noise = f"{1e3 * cluster.noise:.2f} mm per coordinate by its distances"
        lines += _wrapped("rigid", f"{names}; {noise}")
    if not inspection.clusters:
        lines += _wrapped("rigid", "no three markers that keep their distances")
    return lines


def _wrapped(key: str, text: str) -> list[str]:
    return textwrap.wrap(
        text,
        terminal.width(WIDTH),
        initial_indent=f"  {key:8} ",
        subsequent_indent=" " * 11,
    )


# The picture: a line of heights for each marker, and its gaps in numbers.


def _picture(inspection: Inspection) -> list[str]:
    width = max(map(len, inspection.markers), default=0)
    lines = [_legend(inspection)]
    for gaps, bar in zip(inspection.gaps, _bars(inspection), strict=True):
        numbers = _in_numbers(gaps, inspection)
        lines.append(f"  {gaps.marker:{width}} {bar} {numbers}")
    return lines


def _n_columns(inspection: Inspection) -> int:
    return max(1, min(COLUMNS, len(inspection.time)))


def _legend(inspection: Inspection) -> str:
    column_s = inspection.duration_s / _n_columns(inspection)
    signs = (
        f"{HEIGHTS[0]} low to {HEIGHTS[-1]} high, "
        f"{PARTLY} partly unseen, {UNSEEN} unseen"
    )
    return f"  heights (a column is {column_s:.3g} s; {signs})"


def _bars(inspection: Inspection) -> list[str]:
    """Return the heights of each marker as signs, lowest to highest of all markers."""
    import numpy as np

    heights = inspection.positions[:, :, 2]
    low, high = 0.0, 1.0
    if np.isfinite(heights).any():
        # Quantiles, so that a marker that is far off for a moment flattens no line.
        low, high = np.nanquantile(heights, [0.01, 0.99])
    span = max(high - low, 1e-9)
    levels = len(HEIGHTS) * (heights - low) / span
    levels = levels.clip(0, len(HEIGHTS) - 1)
    n_columns = _n_columns(inspection)
    return [_bar(level, n_columns) for level in levels.T]


def _bar(level: FloatArray, n_columns: int) -> str:
    """Draw one line; a column with a single missing frame is partly unseen."""
    import numpy as np

    signs = []
    for column in np.array_split(level, n_columns):
        is_unseen = np.isnan(column)
        if is_unseen.all():
            signs.append(UNSEEN)
        elif is_unseen.any():
            signs.append(PARTLY)
        else:
            signs.append(HEIGHTS[round(float(column.mean()))])
    return "".join(signs)


def _in_numbers(gaps: MarkerGaps, inspection: Inspection) -> str:
    if gaps.share == 1:
        return "never seen"
    if not gaps.count:
        return "no gap"
    longest_s = f"{gaps.longest / inspection.rate_hz:.3g} s"
    longest = f"{counted(gaps.longest, 'frame')} ({longest_s})"
    # Two digits, without an exponent.
    percent = float(f"{100 * gaps.share:.2g}")
    return f"{counted(gaps.count, 'gap')}, longest {longest}, {percent:g} % unseen"


# What looks wrong.


def _suspects(inspection: Inspection) -> list[str]:
    suspects = inspection.suspects()
    lines = [f"  {answer(inspection)}"]
    for suspect in suspects[:MOST_SUSPECTS]:
        frame = f"frame {suspect.start + 1} ({suspect.time_s:.3f} s)"
        lines.append(f"    {suspect.kind:8} {frame:24} {suspect.text}")
    return lines + _further(len(suspects))


def _further(n_suspects: int) -> list[str]:
    if n_suspects <= MOST_SUSPECTS:
        return []
    return [f"    and {n_suspects - MOST_SUSPECTS} more; --html lists all"]


# The same for scripts.


def fields_of(inspection: Inspection, file: Path) -> dict[str, Any]:
    """Return what `inspect` found in a file, as fields of ``--json``."""
    guesses = {
        "unit": inspection.unit,
        "up": inspection.up,
        "rate": inspection.rate,
    }
    markers = []
    for gaps, noise_m in zip(inspection.gaps, inspection.noise_m, strict=True):
        marker: dict[str, Any] = {"name": gaps.marker, "noise_m": noise_m}
        marker["gaps"] = gaps.count
        marker["longest_gap_frames"] = gaps.longest
        marker["unseen_share"] = gaps.share
        markers.append(marker)
    suspects = [
        {
            "kind": one.kind,
            "markers": one.markers,
            "first_frame": one.start + 1,
            "last_frame": one.stop,
            "time_s": one.time_s,
            "message": one.message,
        }
        for one in inspection.suspects()
    ]
    return {
        "file": file,
        "frames": len(inspection.time),
        "rate_hz": inspection.rate_hz,
        "duration_s": inspection.duration_s,
        **{
            name: {"value": one.value, "sure": one.is_sure, "reason": one.reason}
            for name, one in guesses.items()
        },
        "dropped_frames": inspection.timing.n_dropped,
        "markers": markers,
        "clusters": [
            {
                "markers": [inspection.markers[marker] for marker in one.markers],
                "noise_m": one.noise,
            }
            for one in inspection.clusters
        ],
        "suspects": suspects,
    }
