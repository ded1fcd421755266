"""Contact instants or forces under the feet, measured by another device."""

import codecs
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.errors import RecordingError, chosen, did_you_mean
from hopdata.foreign import door
from hopdata.recordings.budget import LONGEST_LINE
from hopdata.recordings.readers.qtm import KEYS
from hopdata.recordings.readers.text import ColumnTable, listed, open_table

SECONDS_PER_UNIT = {"s": 1.0, "ms": 1e-3}

# Formats whose events may be contacts; text files are recognised by their first line.
WITH_EVENTS = (".c3d", ".mat")

NEWTONS_PER_UNIT = {"N": 1.0, "kN": 1000.0, "body_weight": 1.0}

# Units as C3D files spell them, in small letters; "nt" is that of older laboratories.
FORCE_UNIT_SPELLINGS = {
    **dict.fromkeys(("n", "nt", "newton", "newtons"), "N"),
    **dict.fromkeys(("kn", "kilonewton", "kilonewtons"), "kN"),
    **dict.fromkeys(
        ("bw", "xbw", "body_weight", "body weight", "bodyweight"), "body_weight"
    ),
}

#: Least rate of a force signal.
#: Unit: Hz. Origin: chosen. Below it, onsets are no more precise than those of a
#: camera.
LEAST_RATE_HZ = 50.0

#: Largest difference of the rate of the times from the stated one.
#: Unit: 1. Origin: chosen.
RATE_TOLERANCE = 1e-3

#: Share of a force's samples that may lie outside, at either end, where its sign is
#: judged.
#: Unit: 1. Origin: chosen.
SIGN_BUT_FOR = 0.02


@dataclass(frozen=True)
class Column:
    """A column of an external file and the feet it belongs to.

    Parameters
    ----------
    name : str
        Column (or event label, or analog channel) of the file.
    feet : tuple of str
        Feet of the recording that the column cannot tell apart; it gives the first
        contact of any of them.
    """

    name: str
    feet: tuple[str, ...]


@dataclass(frozen=True)
class ExternalContacts:
    """Contact instants of one column of an external file.

    Parameters
    ----------
    column : Column
        Where they come from, and which feet they belong to.
    instant : (K,) array
        Contact instants on the recording's clock, s, increasing.
    source : str
        ``"contacts"`` or ``"forces"``, the block of the configuration; ``"plates"`` or
        ``"events"`` if they are in the recording's own file.
    span_s : tuple of float
        First and last instant at which a contact would have been listed, s.
    other_feet_above_m : float, optional
        Height, m. A contact during which all feet of the column are higher than this
        belongs to another foot. None if the column records no other foot.
    error_s : (K,) array, optional
        Standard error of each instant, s; None if it is not known.
    of_other_foot : (K,) bool array, optional
        Which contacts belong to another foot, where that is known.
    """

    column: Column
    instant: FloatArray
    source: str
    span_s: tuple[float, float]
    other_feet_above_m: float | None = None
    error_s: FloatArray | None = None
    of_other_foot: BoolArray | None = None


@dataclass(frozen=True)
class ForceSignal:
    """Vertical force of one column of an external file.

    Parameters
    ----------
    column : Column
        Where it comes from, and which feet it belongs to.
    time : (K,) array
        Times on the recording's clock, s, strictly increasing.
    force : (K,) array
        Upward force on the feet, N, or multiples of body weight; NaN where missing.
    unit : str
        ``"N"`` or ``"body_weight"``.
    options : mapping
        The block ``forces`` of the configuration, which holds the threshold.
    """

    column: Column
    time: FloatArray
    force: FloatArray
    unit: str
    options: Mapping[str, Any] = field(default_factory=dict)


def columns_of(
    entries: Sequence[Mapping[str, Any]], feet: Sequence[str]
) -> tuple[Column, ...]:
    """Return the configured columns, or one named after each foot if there are none.

    Parameters
    ----------
    entries : sequence of mappings
        ``columns`` of the configuration, each with ``name`` and ``feet``; a column
        without ``feet`` belongs to the foot of the same name.
    feet : sequence of str
        Feet of the recording.
    """
    if not entries:
        return tuple(Column(foot, (foot,)) for foot in feet)
    columns = []
    for entry in entries:
        name = entry["name"]
        columns.append(Column(name, tuple(entry["feet"] or [name])))
    return tuple(columns)


# Contact instants from another source: a table, or the events stored in a recording's
# file.


def read_contact_times(
    options: Mapping[str, Any], *, feet: Sequence[str], rate_hz: float | None = None
) -> list[ExternalContacts]:
    """Read the contact instants named by a recording's block ``contacts``.

    Parameters
    ----------
    options : mapping
        ``recordings[].contacts`` of the configuration: file, columns, label_column,
        time_column, unit, offset_s.
    feet : sequence of str
        Feet of the recording.
    rate_hz : float, optional
        ``input.rate_hz``, for recordings whose file states no rate.

    Returns
    -------
    list of ExternalContacts
        One per column, on the recording's clock, s.

    Raises
    ------
    RecordingError
        If the file cannot be used; names the file, the column, what was expected and
        found.
    """
    found: list[ExternalContacts] = door.read(
        f"{__name__}:contact_times_here",
        dict(options),
        list(feet),
        rate_hz,
        place=options["file"],
        n_bytes=door.size_of(options["file"]),
        reader="the reader of tables",
        kinds=(ExternalContacts, Column),
        libraries=("pandas",),
    )
    return found


def contact_times_here(
    options: Mapping[str, Any], feet: Sequence[str], rate_hz: float | None
) -> list[ExternalContacts]:
    """Read them in this process; `read_contact_times` has another do so."""
    path = Path(options["file"])
    seconds = chosen("contacts.unit", options["unit"], SECONDS_PER_UNIT)
    columns = columns_of(options["columns"], feet)
    label_column = options["label_column"]
    if _is_recording(path):
        instants = _events(path, columns, rate_hz)
    elif label_column is not None:  # one row per contact
        table = open_table(path)
        labels = np.array(table.texts(label_column))
        times = table.numbers(options["time_column"])
        place = f"{path}, column '{label_column}'"
        instants = _by_label(place, columns, labels, times)
    else:
        table = open_table(path)
        instants = {column.name: table.numbers(column.name) for column in columns}
    found = []
    for column in columns:
        on_clock = instants[column.name] * seconds + options["offset_s"]
        found.append(_contact_times(path, column, on_clock))
    return found


def _contact_times(
    path: Path, column: Column, instants: FloatArray
) -> ExternalContacts:
    instants = np.sort(instants[~np.isnan(instants)])
    if not len(instants):
        place = f"{path}: column '{column.name}'"
        raise RecordingError.at(place, "at least one contact instant", "none")
    span_s = (float(instants[0]), float(instants[-1]))
    return ExternalContacts(column, instants, "contacts", span_s)


def _events(
    path: Path, columns: Sequence[Column], rate_hz: float | None
) -> dict[str, FloatArray]:
    """Return instants by label, from the events of a motion-capture file."""
    from hopdata.recordings.readers.formats import read_raw

    events = read_raw(path, rate_hz=rate_hz).events
    labels = np.array([event.label for event in events])
    times = np.array([event.time_s for event in events], dtype=np.float64)
    return _by_label(f"{path}: events", columns, labels, times)


def _by_label(
    place: str,
    columns: Sequence[Column],
    labels: np.ndarray[Any, Any],
    times: FloatArray,
) -> dict[str, FloatArray]:
    """Return the instants (K,) of each column by its label in (K,) labels."""
    present = tuple(dict.fromkeys(labels.tolist()))
    for column in columns:
        if column.name not in present:
            wanted = f"'{column.name}' among {listed(present) or 'no events'}"
            near = did_you_mean(column.name, present)
            raise RecordingError.at(f"{place}: label", wanted, f"none{near}")
    return {column.name: times[labels == column.name] for column in columns}


def _is_recording(path: Path) -> bool:
    """Tell whether a file is motion capture with events, not a table of instants."""
    suffix = path.suffix.lower()
    if suffix not in (".tsv", ".txt") or not path.is_file():
        return suffix in WITH_EVENTS
    with path.open("rb") as file:
        first_line = file.readline(LONGEST_LINE).removeprefix(codecs.BOM_UTF8)
    first_cell = first_line.split(b"\t")[0].strip()
    return first_cell in [key.encode() for key in KEYS]


# Vertical forces under the feet, from a text table or the analog channels of a C3D
# file.


def read_force_signals(
    options: Mapping[str, Any], *, feet: Sequence[str]
) -> list[ForceSignal]:
    """Read the forces named by a recording's block ``forces``.

    Parameters
    ----------
    options : mapping
        ``recordings[].forces`` of the configuration: file, columns, time_column,
        rate_hz, unit, inverted, offset_s, and the threshold, which is passed on.
    feet : sequence of str
        Feet of the recording.

    Returns
    -------
    list of ForceSignal
        One per column, upward force positive, on the recording's clock.

    Raises
    ------
    RecordingError
        If the file cannot be used; names the file, the column, what was expected and
        found.
    """
    found: list[ForceSignal] = door.read(
        f"{__name__}:force_signals_here",
        dict(options),
        list(feet),
        place=options["file"],
        n_bytes=door.size_of(options["file"]),
        reader="the reader of tables",
        kinds=(ForceSignal, Column),
        libraries=("pandas",),
    )
    return found


def force_signals_here(
    options: Mapping[str, Any], feet: Sequence[str]
) -> list[ForceSignal]:
    """Read them in this process; `read_force_signals` has another do so."""
    path = Path(options["file"])
    columns = columns_of(options["columns"], feet)
    if path.suffix.lower() == ".c3d":
        return _analog_signals(path, columns, options)
    table = open_table(path)
    forces = [table.numbers(column.name) for column in columns]
    time = _times(table, options, len(forces[0])) + options["offset_s"]
    signals = []
    for column, force in zip(columns, forces, strict=True):
        signals.append(_signal(path, column, time, force, options))
    return signals


def _analog_signals(
    path: Path, columns: Sequence[Column], options: Mapping[str, Any]
) -> list[ForceSignal]:
    """Read forces from the analog channels of a C3D file.

    It has its own clock and units.
    """
    from hopdata.recordings.readers.c3d import read_analogs

    analogs = read_analogs(path)
    if options["rate_hz"] is not None:
        _check_times(f"{path}: analog rate", analogs.time, options["rate_hz"])
    time = analogs.time + options["offset_s"]
    signals = []
    for column in columns:
        force, stated = analogs.channel(column.name)
        _check_force_unit(f"{path}: channel '{column.name}'", stated, options["unit"])
        signals.append(_signal(path, column, time, force, options))
    return signals


def _check_force_unit(place: str, stated: str, wanted: str) -> None:
    """Require the unit that a channel states, if any, to be that of `forces.unit`.

    A channel of volts, of moments or of muscle activity is not a force, whatever the
    configuration says.

    Raises
    ------
    RecordingError
        If the unit is another one, or none that is known.
    """
    if not stated:
        return
    unit = FORCE_UNIT_SPELLINGS.get(stated.lower())
    if unit is None:
        known = ", ".join(NEWTONS_PER_UNIT)
        raise RecordingError.at(
            place,
            f"a unit of force ({known})",
            f"'{stated}'; name a channel of forces, "
            "or export the plate's forces calibrated",
        )
    if unit != wanted:
        raise RecordingError.at(
            place, f"forces.unit: {unit} as the file states", wanted
        )


def _times(
    table: ColumnTable, options: Mapping[str, Any], n_samples: int
) -> FloatArray:
    """Return the time of each sample from the start of the file's clock, (K,), s."""
    path = table.rows.path
    rate_hz = options["rate_hz"]
    name = options["time_column"] or table.clock
    if name is not None:
        time = table.numbers(name)
        place = f"{path}, column '{name}'"
        _check_times(place, time, rate_hz, n_lines=table.rows.n_lines)
        return time
    if rate_hz is None:
        raise RecordingError.at(
            f"{path}: forces.rate_hz",
            "the samples' rate or forces.time_column",
            "neither",
        )
    return np.arange(n_samples) / float(rate_hz)


def _check_times(
    place: str, time: FloatArray, rate_hz: float | None, *, n_lines: int = 1
) -> None:
    """Require times (K,), s, that increase, at the stated rate and often enough."""
    steps = np.diff(time)
    if len(time) < 2 or not (steps > 0).all():
        wrong = 0
        if len(time) > 1:
            wrong = int(np.flatnonzero(~(steps > 0))[0])
        raise RecordingError.at(
            place,
            "times in s that increase from row to row",
            f"otherwise at line {n_lines + wrong + 2}",
        )
    found_hz = 1 / float(np.median(steps))
    hint = ""
    if found_hz == 1:
        hint = (
            "; a column that counts samples is not a time: "
            "leave it out and give forces.rate_hz"
        )
    if rate_hz is not None and abs(found_hz / rate_hz - 1) > RATE_TOLERANCE:
        raise RecordingError.at(
            place,
            f"steps of {1 / rate_hz:.6g} s as stated by forces.rate_hz: {rate_hz:g}",
            f"{1 / found_hz:.6g} s ({found_hz:.6g} Hz){hint}",
        )
    if found_hz < LEAST_RATE_HZ:
        raise RecordingError.at(
            place,
            f"at least {LEAST_RATE_HZ:g} samples a second",
            f"{found_hz:.6g}{hint}",
        )


def _signal(
    path: Path,
    column: Column,
    time: FloatArray,
    force: FloatArray,
    options: Mapping[str, Any],
) -> ForceSignal:
    """Return a signal (K,) in N or body weights, and require it to point upwards."""
    newtons = chosen("forces.unit", options["unit"], NEWTONS_PER_UNIT)
    is_inverted = options["inverted"]
    sign = -1.0 if is_inverted else 1.0
    upward = force * newtons * sign
    place = f"{path}: column '{column.name}'"
    if len(upward) < 2 or np.isnan(upward).all():
        raise RecordingError(f"{place}: expected a force in each row, found none")
    low, high = np.nanquantile(upward, [SIGN_BUT_FOR, 1 - SIGN_BUT_FOR])
    if -low > high:
        correct = str(not is_inverted).lower()
        raise RecordingError.at(
            place,
            "the upward force on the feet to be positive",
            f"{low:.4g} to {high:.4g}; set forces.inverted: {correct}",
        )
    unit = "body_weight" if options["unit"] == "body_weight" else "N"
    return ForceSignal(column, time, upward, unit, options)
