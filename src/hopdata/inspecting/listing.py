"""What `inspect` lists of a recording: facts, questions, a picture, suspects."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
# Least columns of a narrow picture, and the spaces beside the columns of its table.
LEAST_COLUMNS = 20
MARGINS = 13
# Columns of the picture's table.
PICTURE = ("marker", "height", "between", "gaps")
# Time that the picture shows of a long recording, s, and how many spans begin in one.
SHOWN_S = 5.0
SPANS_IN_ONE = 10
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
    lines = [*head(inspection, file, devices), "", *_listed_picture(inspection), ""]
    lines += _suspects(inspection)
    return encodable("\n".join(lines), encoding)


def encodable(text: str, encoding: str) -> str:
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
        return str(Message("inspecting.nothing_suspect"))
    parts = [counted(number, KINDS.get(kind, kind)) for kind, number in kinds.items()]
    values = {"number": counted(kinds.total(), "suspect"), "kinds": ", ".join(parts)}
    return str(Message("inspecting.suspects", values))


# Facts, and what is unsure.


def head(
    inspection: Inspection, file: str, devices: Devices, *, width: int = WIDTH
) -> list[str]:
    """Return the lines above the picture: facts, questions, and rigid parts."""
    facts = [
        *_facts(inspection),
        *devices,
        *(("note", note) for note in notes(inspection)),
    ]
    lines = [file]
    for key, text in facts:
        lines += _wrapped(key, text, width)
    lines.append("")
    for key, text in _rigid(inspection):
        lines += _wrapped(key, text, width)
    return lines


def _facts(inspection: Inspection) -> list[tuple[str, str]]:
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
        ("frames", f"{rate}; {stamps}"),
        ("markers", f"{len(inspection.markers)}: {names}"),
        ("rate", f"{inspection.rate.value} Hz: {_why(inspection.rate)}"),
        ("unit", f"{unit.value}: {unit.reason}"),
        ("up", f"{up.value}: {up.reason}"),
    ]


def _why(guess: Guess) -> str:
    """Return all that was found for and against a guess, or else its reason."""
    return "; ".join(str(one) for one in guess.evidence) or guess.reason


def notes(inspection: Inspection) -> list[str]:
    """Ask about what is unsure, with two candidates, and list what needs no answer.

    The latter are remarks of the reader, processing of the positions, and unseen
    markers.
    """
    found = [str(one) for one in questions(inspection)]
    found += inspection.remarks
    found += [str(one) for one in (*inspection.treated, *inspection.lost)]
    return found + unseen_for_long(inspection)


def unseen_for_long(inspection: Inspection) -> list[str]:
    """Return one note on all markers that many frames do not show, or none."""
    unseen = [gaps for gaps in inspection.gaps if LONG_UNSEEN < gaps.share < 1]
    if not unseen:
        return []
    markers = [f"{gaps.marker} ({100 * gaps.share:.0f} %)" for gaps in unseen]
    return [str(Message("inspecting.unseen_for_long", {"markers": ", ".join(markers)}))]


def questions(inspection: Inspection) -> list[Message]:
    """Ask about unit, direction and rate, as far as they are unsure."""
    return [
        *question("input.unit", inspection.unit),
        *question("input.vertical_axis", inspection.up),
        *question("input.rate_hz", inspection.rate),
    ]


def question(key: str, guess: Guess) -> list[Message]:
    """Ask about a key with its two candidates, unless the guess is sure."""
    if guess.is_sure:
        return []
    values = {
        "key": key,
        "value": guess.value,
        "other": guess.other,
        "reason": guess.why,
    }
    return [Message("inspecting.which_value", values)]


def _rigid(inspection: Inspection) -> list[tuple[str, str]]:
    noise_mm = 1e3 * inspection.typical_noise_m
    noise = "no five frames in a row"
    if isfinite(noise_mm):
        noise = f"{noise_mm:.2f} mm per coordinate from frame to frame"
        noise += " (median of the markers)"
    lines = [("noise", noise)]
    for cluster in inspection.clusters:
        names = ", ".join(inspection.markers[marker] for marker in cluster.markers)
        noise = f"{1e3 * cluster.noise:.2f} mm per coordinate by its distances"
        lines.append(("rigid", f"{names}; {noise}"))
    if not inspection.clusters:
        lines.append(("rigid", "no three markers that keep their distances"))
    return lines


def _wrapped(key: str, text: str, width: int) -> list[str]:
    return textwrap.wrap(
        text,
        width,
        initial_indent=f"  {key:8} ",
        subsequent_indent=" " * 11,
    )


# The picture: a line of heights for each marker, and what is known of it in numbers.


def _listed_picture(inspection: Inspection) -> list[str]:
    """Return the lines of the picture, its columns padded with spaces."""
    rows = picture(inspection)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = legend(inspection, WIDTH)
    for row in rows:
        padded = [text.ljust(width) for text, width in zip(row, widths, strict=True)]
        lines.append("  " + " ".join(padded).rstrip())
    return lines


def picture(
    inspection: Inspection, most_columns: int = COLUMNS
) -> list[tuple[str, str, str, str]]:
    """Return for each marker what the columns `PICTURE` say."""
    rows = []
    bars = _bars(inspection, most_columns)
    for marker, gaps in enumerate(inspection.gaps):
        span = _span_of(inspection.positions[:, marker, 2])
        rows.append((gaps.marker, bars[marker], span, _in_numbers(gaps, inspection)))
    return rows


def legend(
    inspection: Inspection, width: int, most_columns: int = COLUMNS
) -> list[str]:
    """Say what the picture shows: of which time, and what its signs mean."""
    shown = _shown(inspection)
    n_frames = shown.stop - shown.start
    shown_s = n_frames / inspection.rate_hz
    column_s = shown_s / max(1, min(most_columns, n_frames))
    span = ""
    if n_frames < len(inspection.time):
        begin_s = inspection.time[shown.start] - inspection.time[0]
        span = f"from {begin_s:.3g} to {begin_s + shown_s:.3g} s; "
    signs = (
        f"{HEIGHTS[0]} low to {HEIGHTS[-1]} high, "
        f"{PARTLY} partly unseen, {UNSEEN} unseen"
    )
    text = f"heights ({span}a column is {column_s:.3g} s; {signs})"
    return textwrap.wrap(text, width, initial_indent="  ", subsequent_indent="  ")


def columns_that_fit(inspection: Inspection, width: int) -> int:
    """Return how many columns the heights may have in a table of a terminal."""
    others = [(marker, span, gaps) for marker, _, span, gaps in picture(inspection)]
    taken = sum(max(map(len, column)) for column in zip(*others, strict=True))
    return min(COLUMNS, max(LEAST_COLUMNS, width - taken - MARGINS))


def _shown(inspection: Inspection) -> slice:
    """Return the frames that the picture shows: all, or those in which most is seen.

    In a long recording a column would hold whole steps, and show their mean. Of spans
    in which as much is seen, the one nearest the middle is shown.
    """
    import numpy as np

    n_frames = len(inspection.time)
    n_shown = max(COLUMNS, round(SHOWN_S * inspection.rate_hz))
    if n_frames <= n_shown:
        return slice(0, n_frames)
    n_seen = np.isfinite(inspection.positions[:, :, 2]).sum(axis=1)
    sums = np.concatenate([[0], np.cumsum(n_seen)])
    starts = np.arange(0, n_frames - n_shown + 1, max(1, n_shown // SPANS_IN_ONE))
    seen = sums[starts + n_shown] - sums[starts]
    best = starts[seen == seen.max()]
    middle = (n_frames - n_shown) / 2
    start = int(best[np.argmin(np.abs(best - middle))])
    return slice(start, start + n_shown)


def _bars(inspection: Inspection, most_columns: int) -> list[str]:
    """Return the heights of each marker as signs, lowest to highest of all markers."""
    import numpy as np

    heights = inspection.positions[_shown(inspection), :, 2]
    low, high = 0.0, 1.0
    if np.isfinite(heights).any():
        # Quantiles, so that a marker that is far off for a moment flattens no line.
        low, high = np.nanquantile(heights, [0.01, 0.99])
    span = max(high - low, 1e-9)
    levels = len(HEIGHTS) * (heights - low) / span
    levels = levels.clip(0, len(HEIGHTS) - 1)
    n_columns = max(1, min(most_columns, len(levels)))
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


def _span_of(heights_m: FloatArray) -> str:
    """Return between which heights a marker is in all but 2 % of its frames."""
    import numpy as np

    seen = heights_m[np.isfinite(heights_m)]
    if not len(seen):
        return ""
    # Not "-0.00".
    low, high = np.quantile(seen, [0.01, 0.99]).round(2) + 0.0
    return f"{low:.2f} to {high:.2f} m"


def _in_numbers(gaps: MarkerGaps, inspection: Inspection) -> str:
    if gaps.share == 1:
        return "never seen"
    if not gaps.count:
        return "no gap"
    start, stop = max(gaps.stretches.tolist(), key=lambda gap: gap[1] - gap[0])
    longest_s = f"{(stop - start) / inspection.rate_hz:.3g} s"
    begin_s = inspection.time[start] - inspection.time[0]
    longest = f"{counted(stop - start, 'frame')} ({longest_s}) at {begin_s:.3g} s"
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
    return lines + further(len(suspects))


def further(n_suspects: int) -> list[str]:
    """Say how many suspects are not listed."""
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
