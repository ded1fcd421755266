"""What `check` and `run` give of recordings with too few landings for maps: contacts.

A study stops with fewer usable landings than `LEAST_PAIRS`. Its contacts are known from
the first landing on, so that they are given, and it is said what maps need.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.commands import terminal
from hopdata.commands.contacts import Trial, show, timed, trial_of
from hopdata.errors import AnalysisError, HopdataError
from hopdata.landings.states.assemble import LEAST_PAIRS
from hopdata.messages import Message

if TYPE_CHECKING:
    from hopdata.contact_times import ContactTimes
    from hopdata.recording import Recording


def few_contacts(
    config: Mapping[str, Any], recordings: Sequence[Recording]
) -> ContactTimes | None:
    """Return the contacts of a study that stops because its landings are too few.

    None if they are enough, so that something else stops it, or if there are none.
    """
    with terminal.progress_line("timing contacts"):
        trials = _trials(config, recordings)
        try:
            found = timed(trials)
        except AnalysisError:
            return None
    if not len(found.found) or len(found.orders) >= LEAST_PAIRS:
        return None
    return found


def _trials(config: Mapping[str, Any], recordings: Sequence[Recording]) -> list[Trial]:
    entries = {entry["name"]: entry for entry in config["recordings"]}
    return [trial_of(config, entries[one.name], one) for one in recordings]


def show_few(found: ContactTimes, reason: str) -> None:
    """Print the contacts, and what maps need."""
    show(found, ())
    print(_told(found, reason))


def _told(found: ContactTimes, reason: str) -> str:
    values = {
        "landings": len(found.orders),
        "least": LEAST_PAIRS,
        "reason": reason,
    }
    return str(Message("commands.contacts_only", values))


def write_few(config: Mapping[str, Any], folder: Path) -> bool:
    """Write the contacts of a study that has stopped; say where they are.

    Parameters
    ----------
    config : mapping
        The configuration, complete and valid.
    folder : path
        The study's folder of results.

    Returns
    -------
    bool
        Whether the study has stopped because its landings are too few. Nothing is
        written if not.
    """
    from hopdata.commands.contacts_page import contacts_html
    from hopdata.commands.forecast import foretell
    from hopdata.config.consistency import files_of

    if not all(files_of(entry) for entry in config["recordings"]):
        return False
    try:
        recordings = [_read(config, entry) for entry in config["recordings"]]
        forecast = foretell(dict(config), recordings)
        reason = forecast.reason if forecast.stops else ""
    except AnalysisError as error:
        reason = str(error)
    except HopdataError:
        return False
    if not reason:
        return False
    found = few_contacts(config, recordings)
    if found is None:
        return False
    show_few(found, reason)
    told = _told(found, reason)
    tables = {"contacts": found.table, "contacts_orders": found.orders}
    lags = found.lags()
    if len(lags):
        tables["contacts_lags"] = lags
    for name, table in tables.items():
        path = folder / "tables" / f"{name}.csv"
        terminal.write_text(path, table.to_csv(index=False, float_format="%.7g"))
        print(path)
    page = folder / "contacts.html"
    terminal.write_text(
        page, contacts_html(found, title=str(config["study"]), notes=[told])
    )
    print(page)
    return True


def _read(config: Mapping[str, Any], entry: Mapping[str, Any]) -> Recording:
    """Import a recording as the study does."""
    from hopdata.config.consistency import files_of
    from hopdata.recordings.importing import import_recording
    from hopdata.recordings.plausibility import check_plausible

    recording, _ = import_recording(
        files_of(entry),
        name=entry["name"],
        markers=config["markers"],
        exclude=entry["exclude"],
        **config["input"],
    )
    check_plausible(recording, **config["quality"])
    return recording
