"""Contact instants and orders of any recording, from its first landing on.

No study, no sections and no maps: the floor is levelled, the landings are found in the
descents of the body and in those of each foot, and each contact is timed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, Shown, figure_function, pd
from hopdata.config.loading import check_keys
from hopdata.errors import (
    AnalysisError,
    ArgumentError,
    RecordingError,
    counted,
    told_call,
    told_options,
)
from hopdata.landings import schedules
from hopdata.landings.contacts import descents
from hopdata.landings.contacts.find import find_study_landings
from hopdata.landings.contacts.joined import join_feet
from hopdata.landings.contacts.law import UNDETERMINED_S
from hopdata.landings.contacts.one_foot import one_foot_remarks
from hopdata.landings.contacts.remarks import contact_remarks, resampled_remarks
from hopdata.landings.excluded_spans import without_spans
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.held_frames import without_held_frames
from hopdata.messages import Lines, Message, Messages
from hopdata.recording import Recording, require_distinct
from hopdata.recordings.quality.part_names import SIDE_NAMES, side_of_foot
from hopdata.recordings.wording import chained
from hopdata.recordings.writers.contact_events import ContactEvent

#: Probability below which an order is unsure, as `touchdowns.ambiguous_below`.
#: Unit: 1. Origin: chosen.
SURE = 0.9

#: Share of the heights of a foot below which it is taken to stand if it never rests.
#: Unit: 1. Origin: chosen.
LOWEST_SHARE = 0.02

#: Landings whose heights are drawn if no number is asked for.
#: Unit: landings. Origin: chosen.
MOST_DRAWN = 24

# Time about the contacts of a landing of which the page shows curves, of an animal of
# 1 m, s.
SHOWN_BEFORE_S = 0.08
SHOWN_AFTER_S = 0.06

# What became of a foot that may have landed: the words of the column `remark`.
REMARKS = {
    descents.MISSING: "landings.contact_hidden",
    descents.POOR_FIT: "landings.contact_poor_fit",
    descents.RISES: "landings.contact_rises",
    descents.THIN: "landings.contact_thin",
    descents.GLIDES: "landings.contact_glides",
}
# A foot that is hidden may not have landed at all.
SEEN_TO_COME_DOWN = frozenset(REMARKS) - {descents.MISSING}

COLUMNS = (
    "recording",
    "landing",
    "foot",
    "side",
    "contact_s",
    "se_s",
    "common_s",
    "found",
    "remark",
    "plate",
    "plate_s",
    "plate_se_s",
)
# What may name feet.
Feet = Sequence[str] | Mapping[str, Iterable[str]] | Sequence[str | Mapping[str, Any]]
FEET_FORMS = (
    'a list of markers, the markers of each foot by its name, as {"left": ["LHEE", '
    '"LTOE"]}, or a list of {"name": ..., "markers": [...]}'
)

# Columns of a force plate, and what they hold without one.
PLATE_COLUMNS = ["plate", "plate_s", "plate_se_s"]
NO_PLATE = ("", float("nan"), float("nan"))
# Fewest contacts on plates whose scatter is told.
LEAST_FOR_SCATTER = 10
# Onsets of plates without a contact whose times a remark tells.
MOST_NAMED = 6

ORDER_COLUMNS = (
    "recording",
    "landing",
    "begin_s",
    "end_s",
    "feet",
    "order",
    "probability",
    "runner_up",
    "runner_up_probability",
    "sure",
)


@dataclass(frozen=True, repr=False)
class ContactTimes(Shown):
    """Contacts of the feet of some recordings.

    Parameters
    ----------
    table : DataFrame
        A row for each contact, in order of time: recording, landing (from 1), foot, its
        side (``left``, ``right`` or empty), contact_s (on the clock of the file), its
        standard error se_s, the error common_s that all contacts of this foot may
        share, found (whether the instant can be trusted), and a remark if not,
        or if the foot slowed without a kink, so that the error is large. A foot
        that may have landed unseen has a row without an instant. Last, the force plate
        of the file that the contact loads, its onset plate_s, and the onset's standard
        error plate_se_s; empty without one.
    orders : DataFrame
        A row for each landing: recording, landing, begin_s and end_s (the top and the
        end of the descent in which it was sought, or its last contact if that is
        later), feet (how many were timed), order (their names, as ``left >
        right``), its probability, the runner_up with its own, and whether the order is
        sure (`SURE`). Both probabilities are NaN, and ``sure`` is missing, where only
        one foot was timed.
    messages : tuple of Message
        What to know about the recordings and how their contacts were found, as codes
        with values; `remarks` are their texts.
    recordings : tuple of Recording
        The recordings, levelled: each foot rests at height 0.
    """

    table: pd.DataFrame
    orders: pd.DataFrame
    messages: Messages
    recordings: tuple[Recording, ...]

    @property
    def found(self) -> pd.DataFrame:
        """Return the contacts that can be trusted."""
        # Without a row the column has no type, and would choose columns, not rows.
        is_found = self.table["found"].astype(bool)
        return self.table[is_found].reset_index(drop=True)

    @property
    def remarks(self) -> Lines:
        """Return what to know, a text each; printed, each is a line."""
        return Lines(str(message) for message in self.messages)

    @property
    def feet(self) -> list[str]:
        """Return the names of all feet, in the order of the recordings."""
        names = [name for one in self.recordings for name in one.names("foot")]
        return list(dict.fromkeys(names))

    @property
    def median_se_s(self) -> float:
        """Return the median standard error of these, s; NaN without any."""
        return float(self.found["se_s"].median())

    def events(self, recording: str | None = None) -> list[ContactEvent]:
        """Return the contacts of a recording as events, in order of time.

        Parameters
        ----------
        recording : str, optional
            Its name; not needed if there is only one.

        Raises
        ------
        ArgumentError
            If there are several and none is named, or none has this name.
        """
        names = [one.name for one in self.recordings]
        if recording is None and len(names) == 1:
            recording = names[0]
        if recording not in names:
            wanted = f"one of {', '.join(names)}"
            raise ArgumentError.at("recording", wanted, repr(recording))
        own = self.found[self.found["recording"] == recording]
        return [
            ContactEvent(
                one["contact_s"],
                one["foot"],
                one["side"],
                one["se_s"],
                one["landing"],
            )
            for one in own.sort_values("contact_s", kind="stable").to_dict("records")
        ]

    def curves(self, orders: pd.DataFrame | None = None) -> pd.DataFrame:
        """Return the heights of the feet about the contacts of some landings.

        Parameters
        ----------
        orders : DataFrame, optional
            Rows of `orders`; by default all.

        Returns
        -------
        DataFrame
            ``recording, landing, foot, time_s, height_m``, a row for each foot and
            frame from `SHOWN_BEFORE_S` before the first contact to `SHOWN_AFTER_S`
            after the last one; NaN where the foot was not seen.
        """
        if orders is None:
            orders = self.orders
        by_name = {one.name: one for one in self.recordings}
        parts = []
        for landing in orders.to_dict("records"):
            recording = by_name[landing["recording"]]
            own = self.table[
                (self.table["recording"] == landing["recording"])
                & (self.table["landing"] == landing["landing"])
            ]
            instants = own.loc[own["contact_s"].notna(), "contact_s"]
            begin_s = instants.min() - SHOWN_BEFORE_S * recording.time_scale
            end_s = instants.max() + SHOWN_AFTER_S * recording.time_scale
            start, stop = np.searchsorted(recording.time, [begin_s, end_s])
            for foot in own["foot"]:
                marker = recording.markers.index(foot)
                track = {
                    "recording": landing["recording"],
                    "landing": landing["landing"],
                    "foot": foot,
                    "time_s": recording.time[start:stop],
                    "height_m": recording.positions[start:stop, marker, 2],
                }
                parts.append(pd.DataFrame(track))
        return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()

    @told_call
    def plot(self, *, ax: Any = None, style: str | None = None) -> Any:
        """Draw how long after the first foot each foot touched, in all landings.

        Without two feet that land together, the heights of the feet are drawn, as by
        `plot_landings`.

        Parameters
        ----------
        ax : Axes or Figure, optional
            Where to draw; by default a figure of its own.
        style : str, optional
            ``"nature"``, ``"ieee"`` or ``"poster"``.

        Returns
        -------
        Figure
            Or, with `ax`, what was drawn into.
        """
        if not self.orders["probability"].notna().any():
            return self.plot_landings(ax=ax, style=style)
        draw = figure_function("contacts:spread_figure")
        return draw(self.table, self.orders, self.feet, ax=ax, style=style)

    @told_call
    def plot_landings(
        self, most: int = MOST_DRAWN, *, ax: Any = None, style: str | None = None
    ) -> Any:
        """Draw the heights of the feet about the contacts of the first landings.

        Below them the figure says of how many landings these are the first.

        Parameters
        ----------
        most : int
            Landings to draw.
        ax, style
            As for `plot`.
        """
        shown = self.orders.head(most)
        keys = ["recording", "landing"]
        own = self.table.merge(shown[keys], on=keys)
        draw = figure_function("contacts:landings_figure")
        curves = self.curves(shown)
        n_all = len(self.orders)
        return draw(
            curves, own, shown, self.feet, of_landings=n_all, ax=ax, style=style
        )

    def _told(self) -> str:
        """Return how many contacts there are, and how sure their orders are."""
        n_contacts = counted(len(self.found), "contact")
        told = f"{n_contacts} in {counted(len(self.orders), 'landing')}"
        if len(self.found):
            told += f", standard error {1e3 * self.median_se_s:.2g} ms (median)"
        ordered = self.orders["probability"].notna()
        if ordered.any():
            n_sure = int(self.orders.loc[ordered, "sure"].sum())
            told += f"; {n_sure} of {counted(int(ordered.sum()), 'order')} sure"
        return told

    def _rows(self) -> dict[str, Any]:
        """Return the table for a notebook."""
        return {str(name): self.table[name] for name in self.table}


def _options_of_landings() -> list[str]:
    """Return the names of the options of `find_study_landings` that a user may give."""
    ours = ("recordings", "of_feet")
    known = signature(find_study_landings).parameters
    return [name for name in known if name not in ours]


@told_options(_options_of_landings)
def contacts(
    recordings: Recording | str | Path | Sequence[Recording | str | Path],
    *,
    feet: Feet | None = (),
    floor: Mapping[str, Any] | None = None,
    sure: float = SURE,
    files: Sequence[str | Path | Sequence[str | Path]] = (),
    exclude: Sequence[tuple[float, float]] = (),
    **options: Any,
) -> ContactTimes:
    """Time the contacts of all feet, from the first landing on.

    Parameters
    ----------
    recordings : Recording or path, or sequence of them
        Recordings of `hopdata.read`, or made from arrays; of the path of a file all
        markers are read. One foot is enough, and no body is needed. If no marker has
        the role of a foot, all feet are guessed, as ``hopdata contacts`` does, and a
        remark says which.
    feet : sequence of str, mapping, or sequence of mapping
        The feet, and no others: a marker for each, or the markers of each foot by its
        name, as for `hopdata.Recording.with_roles`; or ``name`` and ``markers`` of
        each, as in the configuration. The first marker of a foot to land counts. By
        default, and if None, the feet that the recordings have.
    floor : mapping, optional
        Options of `hopdata.landings.floor.fit_floor`.
    sure : float
        Probability from which on an order is sure, 0 to 1.
    files : sequence of path, or of several
        The file of each recording, or its files in order of time; by default those
        that they were read from. The contacts are compared with the onsets of the
        force plates in them.
    exclude : sequence of (begin, end)
        Spans, s, whose frames count as unseen in all recordings, such as those with
        exchanged markers. Contacts in them are not timed.
    **options
        Options of `hopdata.landings.contacts.find.find_study_landings`, such as
        ``gravity``.

    Returns
    -------
    ContactTimes
        With ``table``, ``orders`` and ``remarks``.

    Raises
    ------
    AnalysisError
        If a recording has no foot, and none can be guessed.
    RecordingError
        If a file cannot be read, or two recordings hold the same bytes.
    ConfigError
        If a foot's marker is none of a recording's, or an option is wrong.

    Examples
    --------
    >>> import hopdata as hd
    >>> recording, _ = hd.synthesize("quadruped", simulation={"hops": 5}, seed=1)
    >>> found = hd.contacts(recording)
    >>> len(found.orders)
    5
    """
    _check_options(sure, floor or {}, options)
    several, of_files = _as_several(recordings)
    require_distinct(several)
    remarks: list[Message] = []
    levelled = []
    for recording in several:
        known, guessed = _with_feet(recording, _named_feet(feet))
        known, left_out = without_spans(known, exclude)
        remarks += left_out
        remarks += one_foot_remarks(known)
        ready, on_floor = _levelled(known, floor or {})
        groups = [{"name": name, "markers": [*own]} for name, own in known.joined]
        ready = join_feet(replace(ready, joined=()), groups)
        remarks += guessed + on_floor
        levelled.append(ready)
    tables: dict[int, pd.DataFrame] = {}
    for alike in _with_the_same_feet(levelled):
        # The recordings of one call learn from one another.
        group = [levelled[number] for number in alike]
        of_group = find_study_landings(group, of_feet=True, **options)
        remarks += contact_remarks(group, of_group)
        tables |= zip(alike, of_group, strict=True)
    remarks += resampled_remarks(levelled)
    rows: list[tuple[Any, ...]] = []
    orders: list[tuple[Any, ...]] = []
    for number, ready in enumerate(levelled):
        landings = tables[number]
        of_recording = _landed(landings, ready.names("foot"))
        remarks += _untimed(ready, landings)
        rows += _contact_rows(ready, of_recording)
        orders += _order_rows(ready, of_recording, sure)
        if not len(of_recording):
            remarks.append(Message("landings.no_landing", {"recording": ready.name}))
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    files = files or of_files
    if len(files):
        table, of_plates = _with_plates(table, levelled, files)
        remarks += of_plates
    return ContactTimes(
        table=table,
        orders=_order_table(orders),
        messages=Messages(remarks),
        recordings=tuple(levelled),
    )


def _with_plates(
    table: pd.DataFrame,
    recordings: Sequence[Recording],
    files: Sequence[str | Path | Sequence[str | Path]],
) -> tuple[pd.DataFrame, list[Message]]:
    """Return the contacts with the onsets of the plates in the recordings' files."""
    from hopdata.landings.plate_contacts import (
        SAME_CONTACT_S,
        beside_plates,
        contacts_on_plates,
        onsets_without_contact,
        plates_of_files,
    )

    if len(files) != len(recordings):
        wanted = f"the file of each of {len(recordings)} recordings"
        raise ArgumentError.at("files", wanted, f"{len(files)}")
    remarks: list[Message] = []
    for recording, given in zip(recordings, files, strict=True):
        several = [given] if isinstance(given, str | Path) else given
        if not several:
            continue
        try:
            found = plates_of_files(recording, [Path(one) for one in several])
        except RecordingError as error:
            remarks.append(Message("landings.plates_not_read", {"why": str(error)}))
            continue
        remarks += found.refused
        on_plates = contacts_on_plates(recording, found.plates)
        is_own = table["recording"] == recording.name
        own = beside_plates(table[is_own], on_plates.contacts)
        table.loc[is_own, PLATE_COLUMNS] = own[PLATE_COLUMNS]
        begin_s, end_s = recording.time[[0, -1]]
        alone_s = [
            one
            for one in onsets_without_contact(own, on_plates.contacts)
            if begin_s <= one <= end_s  # of a part of the file
        ]
        if alone_s:
            values = {
                "recording": recording.name,
                "often": counted(len(alone_s), "time"),
                "window_ms": 1e3 * SAME_CONTACT_S,
                "places": ", ".join(f"{one:.3f}" for one in alone_s[:MOST_NAMED]),
            }
            remarks.append(Message("landings.onsets_without_contact", values))
    remarks += beside_plates_told(table)
    return table, remarks


def beside_plates_told(table: pd.DataFrame) -> list[Message]:
    """Say how long after the onsets of force plates contacts are, and their scatter."""
    late_ms = 1e3 * (table["contact_s"] - table["plate_s"].astype(float)).dropna()
    if not len(late_ms):
        return []
    scatter = Message("landings.plate_scatter_unknown")
    if len(late_ms) >= LEAST_FOR_SCATTER:
        own = table.loc[late_ms.index, ["foot", "se_s", "plate_se_s"]]
        # Each foot has its own delay.
        about_ms = late_ms - late_ms.groupby(own["foot"]).transform("mean")
        degrees = len(late_ms) - own["foot"].nunique()
        errors_ms = 1e3 * own[["se_s", "plate_se_s"]].astype(float)
        scatters = {
            "scatter_ms": float(np.sqrt((about_ms**2).sum() / degrees)),
            "stated_ms": float(np.sqrt((errors_ms**2).sum(axis=1).mean())),
        }
        scatter = Message("landings.plate_scatter", scatters)
    values = {
        "number": len(late_ms),
        "loading": _loading(len(late_ms)),
        "middle_ms": float(late_ms.median()),
        "most_ms": float(late_ms.abs().max()),
        "scatter": scatter,
    }
    return [Message("landings.contacts_beside_plates", values)]


def _loading(number: int) -> str:
    """Return ``1 contact loads``, ``2 contacts load``."""
    return f"{counted(number, 'contact')} load{'s' if number == 1 else ''}"


def joined_times(parts: Sequence[ContactTimes], names: Sequence[str]) -> ContactTimes:
    """Join the contacts of groups of recordings, in the order of these names."""
    tables = [part.table for part in parts]
    orders = [part.orders for part in parts]
    recordings = {one.name: one for part in parts for one in part.recordings}
    return ContactTimes(
        table=_in_order(tables, names),
        orders=_in_order(orders, names),
        messages=Messages(remark for part in parts for remark in part.messages),
        recordings=tuple(recordings[name] for name in names),
    )


def _in_order(tables: Sequence[pd.DataFrame], names: Sequence[str]) -> pd.DataFrame:
    """Join tables; their rows follow the order of the recordings' names."""
    filled = [table for table in tables if len(table)]
    if not filled:
        return tables[0]
    whole = pd.concat(filled, ignore_index=True)
    place = whole["recording"].map({name: i for i, name in enumerate(names)})
    order = place.sort_values(kind="stable").index
    return whole.loc[order].reset_index(drop=True)


def _as_several(given: Any) -> tuple[list[Recording], list[list[Path]]]:
    """Return recordings, and the files of each that was given by its path.

    Files of the same name in different folders get names that differ. A recording has
    the file that it was read from. No files are returned if none has one.
    """
    from hopdata.analysis import read

    several = given
    if isinstance(given, Recording | str | Path) or not isinstance(given, Iterable):
        several = [given]
    found: list[Recording] = []
    files: list[list[Path]] = []
    for one in several:
        if isinstance(one, str | Path):
            taken = [other.name for other in found]
            name = Path(one).stem
            number = 2
            while name in taken:
                name = f"{Path(one).stem}_{number}"
                number += 1
            found.append(read(one, name=name))
            files.append([Path(one)])
        elif isinstance(one, Recording):
            found.append(one)
            files.append(_file_of(one))
        else:
            wanted = "a recording, the path of a file, or several"
            raise ArgumentError.at("recordings", wanted, f"{one!r}"[:60])
    if not found:
        raise ArgumentError.at("recordings", "a recording or several", "none")
    return found, files if any(files) else []


def _file_of(recording: Recording) -> list[Path]:
    """Return the file that a recording was read from, if it is still the same."""
    from hopdata.recordings.importing import sha256

    file = Path(recording.source)
    if not recording.source_sha256 or not file.is_file():
        return []
    return [file] if sha256(file) == recording.source_sha256 else []


def _check_options(sure: Any, floor: Any, options: Mapping[str, Any]) -> None:
    """Refuse options that are not of their kind.

    Raises
    ------
    ConfigError
        Its message names the option.
    """
    if not isinstance(sure, int | float) or not 0 <= sure <= 1:
        raise ArgumentError.at("sure", "a probability, 0 to 1", f"{sure!r}")
    if not isinstance(floor, Mapping):
        raise ArgumentError.at("floor", "options of fit_floor by name", f"{floor!r}")
    # None stands for the default here, and is no value of a configuration.
    given = {name: value for name, value in options.items() if value is not None}
    check_keys("contacts", {"touchdowns": given, "floor": dict(floor)})


def _named_feet(
    feet: Any,
) -> Mapping[str, Iterable[str]] | tuple[str, ...] | None:
    """Return feet of any form as `Recording.with_roles` takes them; None without any.

    Raises
    ------
    ArgumentError
        If they have another form.
    """
    if feet is None:
        return None
    if isinstance(feet, Mapping):
        return feet or None
    several = [*feet] if isinstance(feet, Iterable) and feet != "" else [feet]
    if isinstance(feet, str) or not all(
        isinstance(one, str | Mapping) for one in several
    ):
        raise ArgumentError.at("feet", FEET_FORMS, f"{feet!r}"[:60])
    if not several:
        return None
    if all(isinstance(one, str) for one in several):
        return tuple(several)
    found: dict[str, Iterable[str]] = {}
    for one in several:
        if isinstance(one, str):
            one = {"name": one, "markers": [one]}
        if set(one) != {"name", "markers"} or not isinstance(one["name"], str):
            raise ArgumentError.at("feet", FEET_FORMS, f"{one!r}"[:60])
        if one["name"] in found:
            raise ArgumentError.at("feet", "each name once", f"{one['name']!r}")
        found[one["name"]] = one["markers"]
    return found


def _with_feet(
    recording: Recording, given: Mapping[str, Iterable[str]] | tuple[str, ...] | None
) -> tuple[Recording, list[Message]]:
    """Return a recording with these feet, or all its own; without any, guess them.

    Markers without a role are left out if roles are guessed. Of a recording without
    roles whose feet are named, the body is guessed, as by ``hopdata contacts --feet``.

    Raises
    ------
    AnalysisError
        If no foot is found.
    """
    if given is not None:
        named = recording.with_roles(feet=given)
        if recording.indices("foot") or recording.indices("body"):
            return named, []
        return _with_body(named), []
    if recording.indices("foot"):
        return recording, []
    from hopdata.landings.role_guesses import guessed_roles
    from hopdata.recordings.quality.every_foot import every_foot
    from hopdata.recordings.quality.inspection import inspect

    if len(recording.time) < 2 or not recording.markers:
        found = f"{len(recording.time)} frames of {len(recording.markers)} markers"
        raise AnalysisError.at(recording.place, "two frames or more", found)
    inspection = replace(inspect(recording), place=recording.place)
    roles = guessed_roles(inspection)
    every, joined = every_foot(inspection, roles)
    if not every:
        why = "; ".join(str(problem) for problem in roles.problems)
        values = {"place": recording.place, "why": why or "by names and motion"}
        raise AnalysisError(Message("landings.no_feet_for_contacts", values))
    foot_of = {marker: foot for foot, own in joined.items() for marker in own}
    body = recording.names("body") or roles.body
    with_roles = recording.with_roles(
        feet=every, body=[name for name in body if name not in every]
    )
    # The markers stay in the order of the file, as for the command.
    groups = tuple((foot, tuple(own)) for foot, own in joined.items())
    with_roles = replace(with_roles, joined=groups)
    kept = [*with_roles.names("body"), *with_roles.names("foot")]
    names = ", ".join(dict.fromkeys(foot_of.get(name, name) for name in every))
    values = {"place": recording.place, "role": "feet", "names": names}
    reason = _of_all_feet(roles.reasons.get("feet")) or ""
    remark = Message("landings.role_guessed", {**values, "reason": reason})
    return with_roles[kept], [remark]


def _of_all_feet(reason: Message | None) -> Message | None:
    """Return why feet were taken, without advice to study some on their own.

    A study compares feet that land together; here all of them are timed.
    """
    if reason is None or reason.code == "recordings.feet_in_between":
        return None
    if reason.code != "recordings.also":
        return reason
    parts = [_of_all_feet(reason.values[name]) for name in ("first", "then")]
    return chained([part for part in parts if part is not None])


def _with_body(recording: Recording) -> Recording:
    """Return a recording of named feet with the body that is guessed, if any."""
    from hopdata.landings.role_guesses import guessed_roles
    from hopdata.recordings.quality.inspection import inspect

    if len(recording.time) < 2:
        return recording
    roles = guessed_roles(replace(inspect(recording), place=recording.place))
    feet = recording.names("foot")
    body = [name for name in roles.body if name not in feet]
    if not body:
        return recording
    with_body = recording.with_roles(body=body)
    return with_body[[*with_body.names("body"), *feet]]


def _with_the_same_feet(recordings: Sequence[Recording]) -> list[list[int]]:
    """Return the numbers of the recordings that have the same feet."""
    alike: dict[tuple[str, ...], list[int]] = {}
    for number, recording in enumerate(recordings):
        alike.setdefault(recording.names("foot"), []).append(number)
    return list(alike.values())


def side_of(foot: str) -> str:
    """Return ``"left"`` or ``"right"`` if the name of a foot tells it; else empty."""
    if foot.lower() in SIDE_NAMES.values():
        return foot.lower()
    return SIDE_NAMES.get(side_of_foot(foot), "")


def _levelled(
    recording: Recording, options: Mapping[str, Any]
) -> tuple[Recording, list[Message]]:
    """Return a recording whose feet rest at height 0, and remarks.

    A foot that never rests, as in a file that ends with the landing, stands where it is
    lowest.
    """
    given = list(recording.markers)
    # By height: sums in another order round otherwise, and on few landings the last
    # digits can decide which law fits.
    summed_m = np.nan_to_num(recording.positions[:, :, 2]).sum(axis=0)
    by_height = [given[marker] for marker in np.argsort(summed_m, kind="stable")]
    recording = without_held_frames(recording[by_height])
    try:
        model = fit_floor(recording, **options)
        return level(recording, model)[given], []
    except AnalysisError:
        # The reason names keys of a configuration, which need not be there.
        values = {"recording": recording.name}
        positions = recording.positions.copy()
        for marker in recording.indices("foot"):
            heights = positions[:, marker, 2]
            heights -= np.nanquantile(heights, LOWEST_SHARE)
        remark = Message("landings.floor_by_lowest", values)
        return replace(recording, positions=positions)[given], [remark]


def _landed(landings: pd.DataFrame, feet: Sequence[str]) -> pd.DataFrame:
    """Return the descents in which a foot landed, or may have; others are dropped."""
    status = landings[[f"status_{foot}" for foot in feet]].to_numpy()
    idle = np.isin(status, (descents.ALREADY_DOWN, descents.NOT_LANDED))
    timed = landings[[f"contact_{foot}_s" for foot in feet]].notna().to_numpy()
    # A foot that is hidden for long may have landed at any time: that is no landing.
    is_landing = (timed & ~idle).any(axis=1)
    kept = landings.iloc[np.flatnonzero(is_landing)]
    instants = kept[[f"contact_{foot}_s" for foot in feet]].to_numpy(float)
    first = np.fmin.reduce(instants, axis=1)
    return kept.iloc[np.argsort(first, kind="stable")].reset_index(drop=True)


def _untimed(recording: Recording, landings: pd.DataFrame) -> list[Message]:
    """Say in which descents feet came down, though none of them could be timed.

    Such a landing has no row. A single marker that fits badly has an instant all the
    same; a foot of several has none, since any of them may have been the first. A
    descent of the body may be long, and a foot that is timed in it has a row of its
    own: that landing is not left out.
    """
    feet = recording.names("foot")
    instants = {foot: landings[f"contact_{foot}_s"].to_numpy(float) for foot in feet}
    named = []
    for landing in landings.to_dict("records"):
        if any(np.isfinite(landing[f"contact_{foot}_s"]) for foot in feet):
            continue
        status = {foot: int(landing[f"status_{foot}"]) for foot in feet}
        begin_s, end_s = landing["begin_s"], landing["end_s"]
        came_down = [
            foot
            for foot in feet
            if status[foot] in SEEN_TO_COME_DOWN
            and not ((begin_s <= instants[foot]) & (instants[foot] <= end_s)).any()
        ]
        if not came_down:
            continue
        reasons = [f"{foot}: {Message(REMARKS[status[foot]])}" for foot in came_down]
        named.append(f"{begin_s:.2f} to {end_s:.2f} s ({', '.join(reasons)})")
    if not named:
        return []
    places = "; ".join(named[:MOST_NAMED])
    if len(named) > MOST_NAMED:
        places += f"; and {len(named) - MOST_NAMED} more"
    often = counted(len(named), "landing")
    values = {"recording": recording.name, "often": often, "places": places}
    return [Message("landings.untimed_landings", values)]


def _contact_rows(
    recording: Recording, landings: pd.DataFrame
) -> list[tuple[Any, ...]]:
    """Return the rows of `ContactTimes.table` of one recording."""
    rows = []
    for number, landing in enumerate(landings.to_dict("records"), start=1):
        of_landing = []
        for foot in recording.names("foot"):
            status = int(landing[f"status_{foot}"])
            if status in (descents.ALREADY_DOWN, descents.NOT_LANDED):
                continue
            instant = landing[f"contact_{foot}_s"]
            is_found = status == descents.LANDED and np.isfinite(instant)
            se_s = landing[f"se_{foot}_s"]
            remark = ""
            if not is_found:
                code = REMARKS.get(status, "landings.contact_not_determined")
                remark = str(Message(code))
            elif se_s >= UNDETERMINED_S * recording.time_scale:
                remark = str(Message("landings.contact_without_kink"))
            of_landing.append(
                (
                    recording.name,
                    number,
                    foot,
                    side_of(foot),
                    instant,
                    se_s,
                    landing[f"common_{foot}_s"],
                    is_found,
                    remark,
                    *NO_PLATE,
                )
            )
        of_landing.sort(key=_in_time)
        rows += of_landing
    return rows


def _in_time(row: tuple[Any, ...]) -> float:
    """Return the contact of a row, s; those without one are last."""
    contact_s = row[COLUMNS.index("contact_s")]
    return float(np.nan_to_num(contact_s, nan=np.inf))


def _order_table(rows: list[tuple[Any, ...]]) -> pd.DataFrame:
    """Return the rows as a table in which ``sure`` may be missing."""
    table = pd.DataFrame(rows, columns=list(ORDER_COLUMNS))
    return table.astype({"sure": "boolean"})


def _order_rows(
    recording: Recording, landings: pd.DataFrame, sure: float
) -> list[tuple[Any, ...]]:
    """Return the rows of `ContactTimes.orders` of one recording."""
    feet = recording.names("foot")
    rows = []
    for number, landing in enumerate(landings.to_dict("records"), start=1):
        timed = [
            foot
            for foot in feet
            if landing[f"status_{foot}"] == descents.LANDED
            and np.isfinite(landing[f"contact_{foot}_s"])
        ]
        may_have_landed = [
            foot
            for foot in feet
            if landing[f"status_{foot}"] in REMARKS and foot not in timed
        ]
        instants = np.array([[landing[f"contact_{foot}_s"] for foot in timed]])
        errors = np.array([[landing[f"se_{foot}_s"] for foot in timed]])
        order = _Order.of(instants, errors, timed)
        is_sure = None
        if np.isfinite(order.probability):
            is_sure = bool(order.probability >= sure and not may_have_landed)
        every = [landing[f"contact_{foot}_s"] for foot in feet]
        rows.append(
            (
                recording.name,
                number,
                float(np.fmin.reduce([landing["begin_s"], *every])),
                float(np.fmax.reduce([landing["end_s"], *every])),
                len(timed),
                order.name,
                order.probability,
                order.other_name,
                order.other_probability,
                is_sure,
            )
        )
    return rows


@dataclass(frozen=True)
class _Order:
    """The most probable order of some contacts, and the next."""

    name: str
    probability: float
    other_name: str
    other_probability: float

    @classmethod
    def of(cls, instants: FloatArray, errors: FloatArray, feet: list[str]) -> _Order:
        """Return the order of the contacts (1, n) of these n feet, s."""
        named = schedules.contact_order(instants)[0]
        name = _chain(named, feet)
        if len(feet) < 2:
            return cls(name, float("nan"), "", float("nan"))
        probability = schedules.order_probability(instants, errors)
        other, of_other = schedules.runner_up(instants, errors)
        return cls(
            name, float(probability[0]), _chain(other[0], feet), float(of_other[0])
        )


def _chain(order: Any, feet: list[str]) -> str:
    """Return the names of feet in an order, as ``left > right``."""
    return " > ".join(feet[foot] for foot in order)
