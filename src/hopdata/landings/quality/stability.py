"""The sections again, with other bandwidths and from parts of the data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.landings.contact_frames import heights_of, pool_frames
from hopdata.landings.sections import Sections, select_sections
from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd

BANDWIDTH_FACTORS = (0.35, 0.5, 0.71, 1.41, 2.0, 2.83)
HALF_A_SECOND = 0.5
COLUMNS = ("kind", "variant", "bandwidth_m", "pre_height_m", "post_height_m", "note")


@one_blas_thread()
def section_stability(
    recordings: Sequence[Recording], sections: Sections, options: Mapping[str, Any]
) -> pd.DataFrame:
    """Choose the sections again under six bandwidths, and from parts of the data.

    These are each half, each recording, and all but the second that holds the frame farthest on the
    wrong side of a section: a section rests on few frames, and one bad second can move it.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled, as `hopdata.landings.sections.select_sections` takes them.
    sections : Sections
        Those chosen from all, the first row.
    options : mapping
        Options with which they were chosen.

    Returns
    -------
    pandas.DataFrame
        ``kind`` (``chosen, bandwidth, second, half, recording``), ``variant``, ``bandwidth_m`` of
        the ground mode of the lowest foot, ``pre_height_m``, ``post_height_m``, and in ``note`` why
        a variant has none. Heights that the configuration sets stay as they are.
    """
    import pandas as pd

    rows = [_row("chosen", "all data", sections)]
    for kind, variant, part, changed in _variants(recordings, sections):
        try:
            found = select_sections(part, **{**options, **changed})
        except AnalysisError as error:
            rows.append((kind, variant, float("nan"), float("nan"), float("nan"), str(error)))
        else:
            rows.append(_row(kind, variant, found))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _variants(
    recordings: Sequence[Recording], sections: Sections
) -> Iterator[tuple[str, str, Sequence[Recording], dict[str, float]]]:
    bandwidth = sections.min_foot_mode.bandwidth_m
    for factor in BANDWIDTH_FACTORS:
        yield (
            "bandwidth",
            f"bandwidth × {factor:g}",
            recordings,
            {"bandwidth_m": factor * bandwidth},
        )
    for number, frame in dict.fromkeys(_farthest_frames(recordings, sections)):
        yield ("second", *_without_second(recordings, number, frame), {})
    for name, which in (("first half", 0), ("second half", 1)):
        yield "half", name, [_half(recording, which) for recording in recordings], {}
    if len(recordings) > 1:
        for recording in recordings:
            yield "recording", recording.name, [recording], {}


def _farthest_frames(
    recordings: Sequence[Recording], sections: Sections
) -> Iterator[tuple[int, int]]:
    """Find recording and frame of the highest body with some foot down, the lowest with one up."""
    heights = [heights_of(recording) for recording in recordings]
    states = [
        pool_frames(
            [h],
            min_foot_m=sections.min_foot_threshold_m,
            max_foot_m=sections.max_foot_threshold_m,
            ground_m=sections.ground_m,
            landings_only=sections.landings_only,
        )
        for h in heights
    ]
    for sign, right_side in ((1.0, "all_up"), (-1.0, "all_down")):
        farthest = [
            np.max(sign * frames.body[~getattr(frames, right_side)], initial=-np.inf)
            for frames in states
        ]
        number = int(np.argmax(farthest))
        if np.isfinite(farthest[number]):
            there = sign * heights[number].body == farthest[number]
            yield number, int(np.flatnonzero(there)[0])


def _without_second(
    recordings: Sequence[Recording], number: int, frame: int
) -> tuple[str, list[Recording]]:
    """Return the recordings with the second around a frame unseen, and what to call that."""
    bad = recordings[number]
    time = bad.time[frame]
    unseen = np.abs(bad.time - time) <= HALF_A_SECOND
    positions = np.where(unseen[:, None, None], np.nan, bad.positions)
    parts = list(recordings)
    parts[number] = replace(bad, positions=positions)
    of_which = f" of {bad.name}" if len(recordings) > 1 else ""
    return f"without {time:.1f} ± {HALF_A_SECOND:g} s{of_which}", parts


def _half(recording: Recording, which: int) -> Recording:
    middle = len(recording.time) // 2
    part = slice(middle, None) if which else slice(middle)
    return recording.part(part)


def _row(kind: str, variant: str, found: Sections) -> tuple[str, str, float, float, float, str]:
    bandwidth = found.min_foot_mode.bandwidth_m
    return kind, variant, bandwidth, found.pre_height_m, found.post_height_m, ""
