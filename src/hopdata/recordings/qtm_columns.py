"""Which column of a QTM export holds what: marker names, and the columns before and after them."""

from __future__ import annotations

from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.qtm_header import COUNTERS, KEYS, QtmHeader, trimmed


def marker_names(header: QtmHeader) -> tuple[str, ...]:
    """Marker names from ``MARKER_NAMES``, or else from the column row.

    Raises
    ------
    RecordingError
        If there are none, two are alike, or the number differs from ``NO_OF_MARKERS``.
    """
    if "MARKER_NAMES" in header.values:
        place, names = header.place("MARKER_NAMES"), trimmed(header.values["MARKER_NAMES"])
    else:
        place = f"{header.path}, line {header.n_lines}"
        names = [c[:-2] for c in header.columns if c.endswith(" X")]
    if not names:
        hint = did_you_mean("MARKER_NAMES", set(header.values) - set(KEYS))
        raise RecordingError(
            f"{header.path}: expected MARKER_NAMES or a column row, found neither{hint}"
        )
    for i, name in enumerate(names):
        if not name:
            raise RecordingError(f"{place}: expected a name for marker {i + 1}, found none")
        if name in names[:i]:
            raise RecordingError(f"{place}: expected each marker name once, found '{name}' twice")
    stated = header.number("NO_OF_MARKERS")
    if stated is not None and stated != len(names):
        raise RecordingError(
            f"{place}: expected {stated:g} marker names (NO_OF_MARKERS), found {len(names)}"
        )
    return tuple(names)


def counter_columns(header: QtmHeader, markers: tuple[str, ...]) -> list[str]:
    """Names of the columns before the coordinates: of ``Frame`` and ``Time`` those present.

    Parameters
    ----------
    header : QtmHeader
        The parsed header.
    markers : tuple of str
        The M marker names.

    Raises
    ------
    RecordingError
        If the column row contradicts the marker names, or the columns do not come out even.
    """
    coordinates = [f"{name} {axis}" for name in markers for axis in "XYZ"]
    if header.columns:
        counters = [c for c in header.columns if c in COUNTERS]
        if header.columns != counters + coordinates:
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


def n_empty_columns(header: QtmHeader, markers: tuple[str, ...]) -> int:
    """Empty columns (0 or 1) after the coordinates, from a tab at each row's end."""
    n_columns = len(header.first_row)
    if header.first_row[-1]:
        return 0
    if header.columns:
        return int(n_columns == len(header.columns) + 1)
    return (n_columns - 3 * len(markers)) % 2


def _raise_for_columns(header: QtmHeader, expected: list[str]) -> None:
    place = f"{header.path}, line {header.n_lines}"
    for i, (want, have) in enumerate(zip(expected, header.columns, strict=False)):
        if want != have:
            raise RecordingError(f"{place}: column {i + 1}: expected '{want}', found '{have}'")
    raise RecordingError(
        f"{place}: expected {len(expected)} columns, found {len(header.columns)} in the column row"
    )
