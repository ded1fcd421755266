"""The sections again, with other bandwidths and from parts of the data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hopdata.errors import AnalysisError
from hopdata.landings.sections import Sections, select_sections
from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd

BANDWIDTH_FACTORS = (0.35, 0.5, 0.71, 1.41, 2.0, 2.83)
COLUMNS = ("kind", "variant", "bandwidth_m", "pre_height_m", "post_height_m", "note")


def section_stability(
    recordings: Sequence[Recording], sections: Sections, options: Mapping[str, Any]
) -> pd.DataFrame:
    """Choose the sections again under six bandwidths, from each half and from each recording.

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
        ``kind`` (``chosen, bandwidth, half, recording``), ``variant``, ``bandwidth_m`` of the
        ground mode of the lowest foot, ``pre_height_m``, ``post_height_m``, and in ``note`` why a
        variant has none. Heights that the configuration sets stay as they are.
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
    for name, which in (("first half", 0), ("second half", 1)):
        yield "half", name, [_half(recording, which) for recording in recordings], {}
    if len(recordings) > 1:
        for recording in recordings:
            yield "recording", recording.name, [recording], {}


def _half(recording: Recording, which: int) -> Recording:
    middle = len(recording.time) // 2
    part = slice(middle, None) if which else slice(middle)
    return recording.part(part)


def _row(kind: str, variant: str, found: Sections) -> tuple[str, str, float, float, float, str]:
    bandwidth = found.min_foot_mode.bandwidth_m
    return kind, variant, bandwidth, found.pre_height_m, found.post_height_m, ""
