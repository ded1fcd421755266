"""Which column of a QTM export holds what: marker names, and the columns before and after them."""

from __future__ import annotations

from collections.abc import Sequence

from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.qtm_header import COUNTERS, KEYS, QtmHeader, coordinate_stems
from hopdata.recordings.text_table import trimmed


def marker_names(header: QtmHeader) -> tuple[str, list[str]]:
    """Place and marker names of ``MARKER_NAMES``, or else of the column row.

    A file of nothing but numbers has ``marker1``, ``marker2`` and so on.

    Raises
    ------
    RecordingError
        If there are none, or the number differs from ``NO_OF_MARKERS``.
    """
    if "MARKER_NAMES" in header.values:
        place, names = header.place("MARKER_NAMES"), trimmed(header.values["MARKER_NAMES"])
    elif header.columns:
        place = f"{header.path}, line {header.n_lines}"
        names = _names_of_columns(header, place)
    elif not header.values:
        place, names = f"{header.path}, line 1", _numbered_names(header)
    else:
        names = []
    if not names:
        hint = did_you_mean("MARKER_NAMES", set(header.values) - set(KEYS))
        raise RecordingError(
            f"{header.path}: expected MARKER_NAMES or a column row, found neither{hint}"
        )
    stated = header.number("NO_OF_MARKERS")
    if stated is not None and stated != len(names):
        raise RecordingError(
            f"{place}: expected {stated:g} marker names (NO_OF_MARKERS), found {len(names)}"
        )
    return place, names


def trajectory_types(header: QtmHeader, n_markers: int) -> tuple[str, ...]:
    """Entries of ``TRAJECTORY_TYPES``, one a marker; none if the file has no such row.

    Raises
    ------
    RecordingError
        If their number is not that of the markers.
    """
    types = trimmed(header.values.get("TRAJECTORY_TYPES", []))
    if types and len(types) != n_markers:
        raise RecordingError(
            f"{header.place('TRAJECTORY_TYPES')}: TRAJECTORY_TYPES: expected {n_markers} entries, "
            f"one a marker, found {len(types)}"
        )
    return tuple(types)


def counter_columns(header: QtmHeader, markers: Sequence[str]) -> list[str]:
    """Names of the columns before the coordinates: of ``Frame`` and ``Time`` those present.

    Parameters
    ----------
    header : QtmHeader
        The parsed header.
    markers : sequence of str
        The M marker names, as in the file.

    Raises
    ------
    RecordingError
        If the column row contradicts the marker names, or the columns do not come out even.
    """
    coordinates = [f"{name} {axis}" for name in markers for axis in "XYZ"]
    if header.columns:
        counters = _counters(header)
        if coordinate_stems(header.columns[len(counters) :]) != list(markers):
            _raise_for_columns(header, counters + coordinates)
        return counters
    n_columns = len(header.first_row)
    n_counters = n_columns - len(coordinates) - n_empty_columns(header, markers)
    if n_counters not in (0, len(COUNTERS)):
        raise RecordingError(
            f"{header.path}, line {header.n_lines + 1}: expected {len(coordinates)} columns "
            f"(X, Y, Z of {len(markers)} markers), or two more for Frame and Time, "
            f"found {n_columns}"
        )
    return list(COUNTERS[:n_counters])


def n_empty_columns(header: QtmHeader, markers: Sequence[str]) -> int:
    """Empty columns (0 or 1) after the coordinates, from a tab at each row's end."""
    n_columns = len(header.first_row)
    if header.first_row[-1]:
        return 0
    if header.columns:
        return int(n_columns == len(header.columns) + 1)
    return (n_columns - 3 * len(markers)) % 2


def _counters(header: QtmHeader) -> list[str]:
    """Columns of the column row before the coordinates, in the file's order."""
    return [c for c in header.columns[: len(COUNTERS)] if c in COUNTERS]


def _names_of_columns(header: QtmHeader, place: str) -> list[str]:
    """Marker names from the column row.

    Raises
    ------
    RecordingError
        If its columns do not come in threes.
    """
    columns = header.columns[len(_counters(header)) :]
    stems = coordinate_stems(columns)
    if stems is None:
        start = 1 + len(_counters(header))
        odd = next(
            (i for i in range(0, len(columns), 3) if not coordinate_stems(columns[i : i + 3])), 0
        )
        raise RecordingError(
            f"{place}, column {start + odd}: expected the columns X, Y, Z of a marker, "
            f"found {', '.join(repr(c) for c in columns[odd : odd + 3]) or 'none'}"
        )
    return stems


def _numbered_names(header: QtmHeader) -> list[str]:
    """Names of the markers of a file that has neither header nor column row."""
    n_columns = len(header.first_row)
    if n_columns % 3 == 0 and not header.first_row[-1] and all(header.first_row[:2]):
        raise RecordingError(
            f"{header.path}, line 1: expected a column row, since {n_columns} columns of which the "
            "last is empty can be read in two ways, found none; export with the column row"
        )
    return [f"marker{i + 1}" for i in range(n_columns // 3)]


def _raise_for_columns(header: QtmHeader, expected: list[str]) -> None:
    place = f"{header.path}, line {header.n_lines}"
    for i, (want, have) in enumerate(zip(expected, header.columns, strict=False)):
        if want != have:
            raise RecordingError(f"{place}: column {i + 1}: expected '{want}', found '{have}'")
    raise RecordingError(
        f"{place}: expected {len(expected)} columns, found {len(header.columns)} in the column row"
    )
