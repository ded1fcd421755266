"""The methods paragraph of contacts alone: what was timed, how, and how surely."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from hopdata.arrays import pd
from hopdata.errors import counted
from hopdata.landings.contacts.joined import parts_of_feet
from hopdata.messages import Message, without_exponent
from hopdata.recording import Recording
from hopdata.report.methods import CITED, Methods, references

# What is said of each method of hopdata.
METHODS_SAID = {
    "kink": "report.contacts_by_kink",
    "velocity_minimum": "report.contacts_by_velocity",
    "velocity_minimum_parabola": "report.contacts_by_parabola",
}

# Packages whose versions are stated.
STATED = ("numpy", "numba")


def contact_methods(
    table: pd.DataFrame,
    orders: pd.DataFrame,
    *,
    recordings: Sequence[Recording],
    messages: Sequence[Message],
    method: str = "kink",
    sure: float = 0.9,
) -> Methods:
    """Return the methods paragraph of some contacts, with the references it cites.

    Parameters
    ----------
    table : DataFrame
        A row for each contact, as `hopdata.contact_times.ContactTimes.table`.
    orders : DataFrame
        A row for each landing, as `hopdata.contact_times.ContactTimes.orders`.
    recordings : sequence of Recording
        The recordings.
    messages : sequence of Message
        What was told of them.
    method : str
        The method that timed the contacts.
    sure : float
        Probability from which on an order is sure.
    """
    parts = [
        _of_recordings(recordings),
        _by_method(method),
        *_of_contacts(table, len(orders)),
        *_of_orders(orders, sure),
        *_of_messages(messages),
        _of_software(),
    ]
    text = " ".join(str(part) for part in parts).replace("\u00a0", " ")
    return Methods(text, references(text, CITED, version("hopdata")))


def _of_recordings(recordings: Sequence[Recording]) -> Message:
    """Say what was recorded, and of which feet."""
    rates = sorted({float(f"{one.rate_hz:.4g}") for one in recordings})
    values = {
        "recordings": counted(len(recordings), "recording"),
        "rate": " and ".join(f"{rate:g}" for rate in rates),
        "feet": ", ".join(_feet(recordings)),
    }
    return Message("report.contacts_recorded", values)


def _by_method(method: str) -> Message:
    """Say what a contact is by a method; one of another package is named only."""
    if method in METHODS_SAID:
        return Message(METHODS_SAID[method])
    return Message("report.contacts_by_other", {"method": method})


def _of_contacts(table: pd.DataFrame, n_landings: int) -> Iterator[Message]:
    """Say how many contacts were timed, and how surely."""
    timed = table[table["found"].astype(bool)]
    values = {
        "timed": len(timed),
        "all": counted(len(table), "contact"),
        "landings": counted(n_landings, "landing"),
    }
    yield Message("report.contacts_timed", values)
    if len(timed):
        values = {
            "median_ms": without_exponent(1e3 * timed["se_s"].median()),
            "most_ms": without_exponent(1e3 * timed["se_s"].max()),
        }
        yield Message("report.contacts_errors", values)
    common_s = timed.groupby("foot", sort=False)["common_s"].max()
    common_s = common_s[np.isfinite(common_s.astype(float))]
    if len(common_s):
        each = [
            f"{without_exponent(1e3 * error_s)} ms ({foot})"
            for foot, error_s in common_s.items()
        ]
        yield Message("report.contacts_common", {"each": ", ".join(each)})
    large = int((timed["remark"] != "").sum())
    if large:
        values = {"contacts": counted(large, "contact")}
        yield Message("report.contacts_remarked", values)


def _of_orders(orders: pd.DataFrame, least: float) -> Iterator[Message]:
    """Say what the probability of an order is, and how many orders are sure."""
    ordered = orders[orders["probability"].notna()]
    if ordered.empty:
        return
    sure = ordered[ordered["sure"].astype(bool)]
    values: dict[str, Any] = {
        "ordered": counted(len(ordered), "landing"),
        "sure": len(sure),
        "least": f"{least:g}",
    }
    yield Message("report.methods_order_probability")
    yield Message("report.contacts_orders", values)


def _of_messages(messages: Sequence[Message]) -> Iterator[Message]:
    """Say what was left out, and how contacts compare with force plates."""
    for one in messages:
        if one.code == "landings.spans_excluded":
            why: Any = ""
            if not one.values["all_have_reasons"]:
                why = Message("report.contacts_excluded_why")
            yield Message("report.contacts_excluded", {**one.values, "why": why})
        if one.code == "landings.contacts_beside_plates":
            yield Message("report.contacts_plates", one.values)


def _of_software() -> Message:
    """Say which versions were used."""
    packages = [f"{name} {version(name)}" for name in STATED]
    values = {"version": version("hopdata"), "packages": ", ".join(packages)}
    return Message("report.contacts_software", values)


def _feet(recordings: Sequence[Recording]) -> list[str]:
    """Return the feet, and of which markers each is."""
    named: dict[str, str] = {}
    for recording in recordings:
        parts = parts_of_feet(recording)
        for foot, markers in zip(recording.names("foot"), parts, strict=True):
            own = ", ".join(recording.markers[marker] for marker in markers)
            named[foot] = foot if own == foot else f"{foot} ({own})"
    return list(named.values())
