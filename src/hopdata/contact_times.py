"""Contact instants and orders of any recording, from its first landing on.

No study, no sections and no maps: the floor is levelled, the landings are found in the
descents of the body and in those of each foot, and each contact is timed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import Shown, figure_function, pd
from hopdata.config.loading import check_keys
from hopdata.errors import (
    AnalysisError,
    ArgumentError,
    RecordingError,
    counted,
    told_call,
    told_options,
)
from hopdata.landings.contact_feet import Feet, named_feet, with_feet
from hopdata.landings.contact_lags import lag_table
from hopdata.landings.contact_rows import (
    COLUMNS,
    MOST_NAMED,
    contact_rows,
    cut_off,
    hidden_contacts,
    landed,
    order_rows,
    order_table,
    untimed,
)
from hopdata.landings.contacts.find import find_study_landings
from hopdata.landings.contacts.joined import join_feet
from hopdata.landings.contacts.one_foot import one_foot_remarks
from hopdata.landings.contacts.remarks import contact_remarks, resampled_remarks
from hopdata.landings.excluded_spans import (
    excluded_spans,
    with_reasons,
    without_spans,
)
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.held_frames import without_held_frames
from hopdata.landings.treads import without_treads
from hopdata.messages import Lines, Message, Messages, without_exponent
from hopdata.recording import Recording, require_distinct
from hopdata.recordings.plausibility import check_fall
from hopdata.recordings.writers.contact_events import ContactEvent

if TYPE_CHECKING:
    from hopdata.report.methods import Methods

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

# Columns of a force plate.
PLATE_COLUMNS = ["plate", "plate_s", "plate_se_s"]
# Fewest contacts on plates whose scatter is told.
LEAST_FOR_SCATTER = 10


@dataclass(frozen=True, repr=False)
class ContactTimes(Shown):
    """Contacts of the feet of some recordings.

    Parameters
    ----------
    table : DataFrame
        A row for each contact, in order of time: recording, landing (from 1), foot, its
        side (``left``, ``right`` or empty), the marker of this foot that touches first
        (empty if the contact is not found, or if a printed method timed a foot of
        several) and its marker_probability (that it is the first, by the contacts'
        own and common errors; NaN for a foot of a single marker), contact_s (on the
        clock of the file), its standard error se_s, the error common_s that all
        contacts of this foot may share, found (whether the instant can be trusted), and
        a remark if not, or if the foot slowed without a kink, so that the error is
        large. A foot that may have landed unseen has a row without an instant. Last,
        the force plate of the file that the contact loads, its onset plate_s, and the
        onset's standard error plate_se_s; empty without one.
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
    method : str
        The method that timed them (`hopdata.landings.contacts.timing.METHODS`).
    sure_from : float
        Probability from which on an order is sure.
    """

    table: pd.DataFrame
    orders: pd.DataFrame
    messages: Messages
    recordings: tuple[Recording, ...]
    method: str = "kink"
    sure_from: float = SURE

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

    def lags(
        self,
        recordings: str | Sequence[str] | None = None,
        *,
        landings: Sequence[int] | None = None,
    ) -> pd.DataFrame:
        """Return how long each foot touches before each other foot, over all landings.

        Parameters
        ----------
        recordings : str or sequence of str, optional
            Names of the recordings whose landings count, such as those of a condition;
            by default all.
        landings : sequence of int, optional
            Numbers of the landings that count in each recording, from 1: 1 is the drop
            of a drop jump, 2 its rebound. By default all.

        Returns
        -------
        DataFrame
            A row for each two feet that were timed in one landing or more. A lag is the
            contact of ``foot`` less that of ``other``, s: negative where ``foot``
            touches first. Columns: ``foot, other, landings`` (those of both feet),
            ``mean_s`` with ``se_s`` (standard error by the scatter over landings),
            ``common_s`` (error by what all contacts of each foot share: the root of the
            sum of squares of both feet, an upper limit where they err alike),
            ``low_s`` and ``high_s`` (95 % interval of the mean, with both errors),
            ``median_abs_s`` (median without sign) and ``sd_s`` (standard deviation).
            Of one landing ``se_s``, the interval and ``sd_s`` are NaN. Details:
            `hopdata.landings.contact_lags.lag_table`.

        Raises
        ------
        ArgumentError
            If none of the recordings has one of these names, or none of them a landing
            of these numbers.

        Examples
        --------
        >>> import hopdata as hd
        >>> recording, _ = hd.synthesize("quadruped", simulation={"hops": 5}, seed=1)
        >>> len(hd.contacts(recording).lags())  # two of four feet
        6
        """
        chosen = self.table
        if recordings is not None:
            names = [recordings] if isinstance(recordings, str) else [*recordings]
            known = [one.name for one in self.recordings]
            for name in names:
                if name not in known:
                    wanted = f"names among {', '.join(known)}"
                    raise ArgumentError.at("recordings", wanted, repr(name))
            chosen = chosen[chosen["recording"].isin(names)]
        if landings is not None:
            is_one = chosen["landing"].isin([*landings])
            if not is_one.any():
                most = int(chosen["landing"].max()) if len(chosen) else 0
                wanted = f"numbers from 1 to {most}"
                raise ArgumentError.at("landings", wanted, repr([*landings]))
            chosen = chosen[is_one]
        return lag_table(chosen, self.feet)

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

    def methods(self) -> Methods:
        """Return a methods paragraph for a paper: what was timed, how, how surely.

        It has ``text`` and, as ``bibtex``, the references.
        """
        from hopdata.contact_methods import contact_methods

        return contact_methods(
            self.table,
            self.orders,
            recordings=self.recordings,
            messages=self.messages,
            method=self.method,
            sure=self.sure_from,
        )

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

        Returns
        -------
        Figure
            Or, with `ax`, what was drawn into.
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
            error_ms = without_exponent(1e3 * self.median_se_s)
            told += f", standard error {error_ms} ms (median)"
            told += self._common_told()
        ordered = self.orders["probability"].notna()
        if ordered.any():
            n_sure = int(self.orders.loc[ordered, "sure"].sum())
            told += f"; {n_sure} of {counted(int(ordered.sum()), 'order')} sure"
        return told

    def _common_told(self) -> str:
        """Return the common error of each foot, in words; nothing if it is unknown.

        Of several recordings it is the largest.
        """
        of_feet = self.found.groupby("foot", sort=False)["common_s"].max()
        each = {
            str(foot): f"{without_exponent(1e3 * common_s)} ms"
            for foot, common_s in of_feet.items()
            if np.isfinite(common_s)
        }
        if not each:
            return ""
        if len(set(each.values())) == 1:
            whose = "of the foot" if len(each) == 1 else "of each foot"
            return f", common error {next(iter(each.values()))} ({whose})"
        listed = ", ".join(f"{foot} {error}" for foot, error in each.items())
        return f", common error {listed}"

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
    exclude: Sequence[Any] = (),
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
    exclude : sequence of (begin, end) or (begin, end, reason)
        Spans, s, whose frames count as unseen in all recordings, such as those with
        exchanged markers, each with a reason that is told; or ``from_s``, ``to_s`` and
        ``reason`` of each, as in the configuration. A foot that comes down in them is
        not timed, or less surely from the frames beside them. Of a landing half inside,
        the feet outside are timed; a landing wholly inside has no row, and no number:
        compare tables with and without it by time.
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
    spans = excluded_spans(exclude)
    several, of_files, remarks = _as_several(recordings)
    require_distinct(several)
    levelled = []
    for known, guessed in with_feet(several, named_feet(feet)):
        known, left_out = without_spans(known, spans)
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
    remarks += cut_off(levelled, [tables[number] for number in range(len(levelled))])
    rows: list[tuple[Any, ...]] = []
    orders: list[tuple[Any, ...]] = []
    for number, ready in enumerate(levelled):
        landings = tables[number]
        of_recording = landed(landings, ready.names("foot"))
        remarks += untimed(ready, landings)
        rows += contact_rows(ready, of_recording)
        remarks += hidden_contacts(ready, of_recording)
        orders += order_rows(ready, of_recording, sure)
        if not len(of_recording):
            remarks.append(Message("landings.no_landing", {"recording": ready.name}))
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    of_landings = order_table(orders)
    table = with_reasons(table, of_landings, spans)
    files = files or of_files
    if len(files):
        table, of_plates = _with_plates(table, levelled, files)
        remarks += of_plates
    return ContactTimes(
        table=table,
        orders=of_landings,
        messages=Messages(remarks),
        recordings=tuple(levelled),
        method=options.get("method", "kink"),
        sure_from=sure,
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
        "offsets": _offsets(table.loc[late_ms.index], late_ms),
    }
    return [Message("landings.contacts_beside_plates", values)]


def _offsets(table: pd.DataFrame, late_ms: pd.Series) -> Message:
    """Say how long after the plates the contacts of each foot are, beside its error."""
    each = []
    for foot, own in table.groupby("foot", sort=False):
        late = f"{foot} {late_ms[own.index].mean():+.1f} ms"
        common_s = float(own["common_s"].max())
        if np.isfinite(common_s):
            late += f" (common error {without_exponent(1e3 * common_s)} ms)"
        each.append(late)
    return Message("landings.plate_offsets", {"each": ", ".join(each)})


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
        method=parts[0].method,
        sure_from=parts[0].sure_from,
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


def _as_several(
    given: Any,
) -> tuple[list[Recording], list[list[Path]], list[Message]]:
    """Return recordings, the files of each, and what was noted when they were read.

    Files of the same name in different folders get names that differ. A recording has
    the file that it was read from. No files are returned if none has one.
    """
    from hopdata.reading import read

    several = given
    if isinstance(given, Recording | str | Path) or not isinstance(given, Iterable):
        several = [given]
    found: list[Recording] = []
    files: list[list[Path]] = []
    remarks: list[Message] = []
    for one in several:
        if isinstance(one, str | Path):
            taken = [other.name for other in found]
            name = Path(one).stem
            number = 2
            while name in taken:
                name = f"{Path(one).stem}_{number}"
                number += 1
            recording = read(one, name=name)
            remarks += [
                Message("recordings.as_read", {"text": text})
                for text in recording.remarks
            ]
            found.append(recording)
            files.append([Path(one)])
        elif isinstance(one, Recording):
            # The unit of a file is looked at when it is read; arrays have none.
            if not one.source:
                check_fall(one)
            found.append(one)
            files.append(_file_of(one))
        else:
            wanted = "a recording, the path of a file, or several"
            raise ArgumentError.at("recordings", wanted, f"{one!r}"[:60])
    if not found:
        raise ArgumentError.at("recordings", "a recording or several", "none")
    return found, files if any(files) else [], remarks


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


def _with_the_same_feet(recordings: Sequence[Recording]) -> list[list[int]]:
    """Return the numbers of the recordings that have the same feet."""
    alike: dict[tuple[str, ...], list[int]] = {}
    for number, recording in enumerate(recordings):
        alike.setdefault(recording.names("foot"), []).append(number)
    return list(alike.values())


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
        on_floor, on_treads = without_treads(level(recording, model))
        return on_floor[given], on_treads
    except AnalysisError:
        # The reason names keys of a configuration, which need not be there.
        values = {"recording": recording.name}
        positions = recording.positions.copy()
        for marker in recording.indices("foot"):
            heights = positions[:, marker, 2]
            heights -= np.nanquantile(heights, LOWEST_SHARE)
        remark = Message("landings.floor_by_lowest", values)
        return replace(recording, positions=positions)[given], [remark]
