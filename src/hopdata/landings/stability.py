"""Stability of a study: drift between its parts, and sections from parts of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import SD_PER_MAD, FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.landings.contacts.find import find_study_landings
from hopdata.landings.sections.frames import heights_of
from hopdata.landings.sections.poincare import Sections
from hopdata.landings.sections.select import select_sections
from hopdata.recording import Recording

# Quantities that should not change between recordings, or within a single one, each
# with one value per touchdown. Quantity -> unit.
QUANTITIES = {
    "time between the sections": "s",
    "contact spread": "s",
    "height of the feet at the post section": "m",
    "distance between body markers": "m",
}

#: Parts of a single recording that are compared.
#: Unit: parts. Origin: chosen.
PARTS_OF_ONE = 4

#: Fewest touchdowns of a part.
#: Unit: touchdowns. Origin: chosen.
LEAST = 5

#: Standard error of the median of normal values, times the root of their number.
#: Unit: standard deviations. Origin: derived: the root of pi / 2.
SE_OF_MEDIAN = 1.2533

#: Bandwidths with which the sections are selected again, over the one chosen: half an
#: octave apart.
#: Unit: 1. Origin: chosen.
BANDWIDTH_FACTORS = (0.35, 0.5, 0.71, 1.41, 2.0, 2.83)

#: Half of the time that is left out about the frame farthest on the wrong side.
#: Unit: s. Origin: chosen.
HALF_A_SECOND = 0.5

COLUMNS = ("kind", "variant", "bandwidth_m", "pre_height_m", "post_height_m", "note")


@one_blas_thread()
def drift_table(
    recordings: Sequence[Recording], touchdowns: pd.DataFrame
) -> pd.DataFrame:
    """Compare used touchdowns between recordings, or between quarters of a single one.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled.
    touchdowns : DataFrame
        The study's table of touchdowns.

    Returns
    -------
    pandas.DataFrame
        One row for each quantity and part: ``quantity, unit, part, touchdowns,
        median_of_part, se`` (of the median), ``typical`` (median of all), ``spread``
        (robust standard deviation within parts) and ``deviation`` of the part's median,
        in spreads. Parts with fewer than five touchdowns are left out. A quantity with
        fewer than two parts left has no rows.
    """
    values = pd.concat(
        [_values(one, touchdowns) for one in recordings], ignore_index=True
    )
    if len(recordings) == 1:
        values["part"] = _quarters(values["t_pre_s"].to_numpy(float))
    rows = [row for name in QUANTITIES for row in quantity_rows(values, name)]
    columns = [
        "quantity",
        "unit",
        "part",
        "touchdowns",
        "median_of_part",
        "se",
        "typical",
        "spread",
        "deviation",
    ]
    return pd.DataFrame(rows, columns=columns)


def _values(recording: Recording, touchdowns: pd.DataFrame) -> pd.DataFrame:
    """Return each quantity at each used touchdown of one recording."""
    own = touchdowns["recording"].astype(str) == recording.name
    used = touchdowns[own & ~touchdowns["excluded"].astype(bool)]
    pre = used["t_pre_s"].to_numpy(float)
    post = used["t_post_s"].to_numpy(float)
    feet_after = recording.feet[_frames(recording, post), :, 2]
    columns = (
        post - pre,
        used["spread_s"].to_numpy(float),
        feet_after.mean(axis=1),
        _mean_distance(recording.body[_frames(recording, pre)]),
    )
    table = pd.DataFrame(dict(zip(QUANTITIES, columns, strict=True)))
    return table.assign(part=recording.name, t_pre_s=pre)


def _frames(recording: Recording, times: FloatArray) -> NDArray[np.int64]:
    """Return the frame after each time, (n,)."""
    last = max(len(recording.time) - 1, 0)
    return np.searchsorted(recording.time, times).clip(max=last)


def _mean_distance(body: FloatArray) -> FloatArray:
    """Return the mean distance between the markers of (n, B, 3) bodies, (n,)."""
    a, b = np.triu_indices(body.shape[1], 1)
    distances = np.linalg.norm(body[:, a] - body[:, b], axis=2)
    return np.asarray(distances.mean(axis=1))


def _quarters(times: FloatArray) -> list[str]:
    """Name the quarter that each time (n,) belongs to, by its rank."""
    rank = np.argsort(np.argsort(times, kind="stable"), kind="stable")
    numbers = 1 + rank * PARTS_OF_ONE // max(len(times), 1)
    return [f"part {k} of {PARTS_OF_ONE}" for k in numbers]


def quantity_rows(values: pd.DataFrame, name: str) -> list[tuple[object, ...]]:
    """Return the rows of one quantity; none with fewer than two parts."""
    known = values[np.isfinite(values[name].to_numpy(float))]
    parts = {}
    for part, group in known.groupby("part", sort=False):
        if len(group) >= LEAST:
            parts[str(part)] = group[name].to_numpy(float)
    if len(parts) < 2:
        return []
    within = np.concatenate([np.abs(v - np.median(v)) for v in parts.values()])
    # Each part's median is taken from its own values, so that one of its deviations is
    # lost: of five values, the middle one always deviates by zero.
    free_share = 1 - len(parts) / len(within)
    spread = SD_PER_MAD * float(np.median(within)) / free_share
    typical = float(np.median(np.concatenate(list(parts.values()))))
    rows: list[tuple[object, ...]] = []
    for part, v in parts.items():
        median = float(np.median(v))
        se = SE_OF_MEDIAN * spread / np.sqrt(len(v))
        deviation = 0.0
        if spread > 0:
            deviation = (median - typical) / spread
        unit = QUANTITIES[name]
        rows.append((name, unit, part, len(v), median, se, typical, spread, deviation))
    return rows


@one_blas_thread()
def section_stability(
    recordings: Sequence[Recording],
    sections: Sections,
    options: Mapping[str, Any],
    landings: Mapping[str, pd.DataFrame] | None = None,
) -> pd.DataFrame:
    """Select the sections again with six other bandwidths, and from parts of the data.

    The parts are each half, each recording, and all data but the second around the
    frame farthest on the wrong side of a section: one bad second must not move it.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled, as for `hopdata.landings.sections.select.select_sections`.
    sections : Sections
        Sections selected from all data; they are the first row.
    options : mapping
        Options with which they were selected.
    landings : mapping, optional
        Landings with which they were selected.

    Returns
    -------
    pandas.DataFrame
        ``kind`` (``chosen, bandwidth, second, half, recording``), ``variant``,
        ``bandwidth_m`` by which the sections were chosen, ``pre_height_m``,
        ``post_height_m``, and ``note``, which says why a variant has no sections.
        Heights set by the configuration stay as they are; if both are, there is no
        bandwidth to vary.
    """
    if not landings:
        tables = find_study_landings(recordings)
        names = [one.name for one in recordings]
        landings = dict(zip(names, tables, strict=True))
    rows = [_row("chosen", "all data", sections)]
    for kind, variant, part, changed in _variants(recordings, sections):
        # The depth is that of the study: to choose it anew would cost a fit of all
        # states for each variant.
        depth_share = sections.depth.get("share")
        how = {"depth_share": depth_share, **options, **changed}
        try:
            found = select_sections(part, landings=landings, **how)
        except AnalysisError as error:
            rows.append((kind, variant, np.nan, np.nan, np.nan, str(error)))
        else:
            rows.append(_row(kind, variant, found))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _variants(
    recordings: Sequence[Recording], sections: Sections
) -> Iterator[tuple[str, str, Sequence[Recording], dict[str, float]]]:
    """Yield kind and name of each variant, its recordings and its options."""
    if sections.bandwidth_m is not None:
        for factor in BANDWIDTH_FACTORS:
            changed = {"bandwidth_m": factor * sections.bandwidth_m}
            yield "bandwidth", f"bandwidth × {factor:g}", recordings, changed
    for number, frame in dict.fromkeys(_farthest_frames(recordings, sections)):
        with _without_second(recordings, number, frame) as (name, parts):
            yield "second", name, parts, {}

    first = [one.part(slice(0, len(one.time) // 2)) for one in recordings]
    yield "half", "first half", first, {}
    second = [one.part(slice(len(one.time) // 2, None)) for one in recordings]
    yield "half", "second half", second, {}
    if len(recordings) > 1:
        for recording in recordings:
            yield "recording", recording.name, [recording], {}


def _farthest_frames(
    recordings: Sequence[Recording], sections: Sections
) -> Iterator[tuple[int, int]]:
    """Find recording and frame of the bodies farthest on the wrong side of a section.

    They are the highest body with a foot down and the lowest with one up.
    """
    heights = [heights_of(recording) for recording in recordings]
    frames_of = [sections.pooled([one]) for one in heights]
    with_a_foot_down = [frames.body[~frames.all_up] for frames in frames_of]
    with_a_foot_up = [frames.body[~frames.all_down] for frames in frames_of]
    # With its sign, the height that is sought is the largest in both.
    for sign, bodies in ((1.0, with_a_foot_down), (-1.0, with_a_foot_up)):
        farthest = [np.max(sign * body, initial=-np.inf) for body in bodies]
        number = int(np.argmax(farthest))
        if np.isfinite(farthest[number]):
            # Some frames were left out, so the frame is found again by its height.
            is_there = sign * heights[number].body == farthest[number]
            yield number, int(np.flatnonzero(is_there)[0])


@contextmanager
def _without_second(
    recordings: Sequence[Recording], number: int, frame: int
) -> Iterator[tuple[str, list[Recording]]]:
    """Yield the name of a variant, and recordings with a second about a frame unseen.

    The second is restored afterwards, since memory may not hold a copy of a long
    recording.
    """
    bad = recordings[number]
    time = bad.time[frame]
    unseen = np.abs(bad.time - time) <= HALF_A_SECOND
    kept = bad.positions[unseen]
    parts = list(recordings)
    parts[number] = replace(bad)  # the same positions, but no cached heights
    name = f"without {time:.1f} ± {HALF_A_SECOND:g} s"
    if len(recordings) > 1:
        name += f" of {bad.name}"
    bad.positions[unseen] = np.nan
    try:
        yield name, parts
    finally:
        bad.positions[unseen] = kept


def _row(
    kind: str, variant: str, found: Sections
) -> tuple[str, str, float, float, float, str]:
    bandwidth_m = float("nan")
    if found.bandwidth_m is not None:
        bandwidth_m = found.bandwidth_m
    return kind, variant, bandwidth_m, found.pre_height_m, found.post_height_m, ""
