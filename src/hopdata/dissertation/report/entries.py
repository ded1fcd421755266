"""The rows of the page: each item of the dissertation with what was found of it."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hopdata.dissertation.items import Item
from hopdata.dissertation.making import Failure, Record
from hopdata.dissertation.report.sentences import filled
from hopdata.dissertation.rows import Agreement, Row
from hopdata.errors import counted, printable
from hopdata.report.formatting import words

WORDS: dict[str, Any] = tomllib.loads(
    Path(__file__).with_name("words.toml").read_text("utf-8")
)

# Standing of an item that could not be measured, beside those of `Agreement`.
MISSING = "missing"
STANDINGS = tuple(WORDS["standing"])
# Standings of items that claim something.
CLAIMS = (Agreement.AGREES, Agreement.PARTLY, Agreement.DIFFERS)


@dataclass(frozen=True)
class Entry:
    """A row of the page.

    Attributes
    ----------
    item
        What the dissertation states.
    standing
        An `Agreement`, or `MISSING`.
    printed_method, ours, why
        Sentences with the numbers in them; empty where there is nothing to say.
    failure
        Why it could not be measured; None if it was.
    figure_failure
        Why its figure could not be drawn; None if it was, or there is none.
    """

    item: Item
    standing: str
    printed_method: str = ""
    ours: str = ""
    why: str = ""
    failure: Failure | None = None
    figure_failure: Failure | None = None

    @property
    def anchor(self) -> str:
        """The name of its place on the page."""
        return f"item-{self.item.number}"

    @property
    def sign(self) -> str:
        """The sign of its standing."""
        return str(WORDS["standing"][self.standing]["sign"])

    @property
    def word(self) -> str:
        """Its standing in a word."""
        return str(WORDS["standing"][self.standing]["word"])


@dataclass(frozen=True)
class Fault:
    """Something that could not be made: which part to make again, and a line on it."""

    part: str
    line: str


def entries_of(items: Sequence[Item], records: Iterable[Record]) -> list[Entry]:
    """Return a row for each item, whether it was measured or not."""
    by_part = {record.part: record for record in records}
    return [_entry(item, by_part.get(item.part)) for item in items]


def _entry(item: Item, record: Record | None) -> Entry:
    if record is None:
        failure = Failure(f"there is no part {item.part}")
        return Entry(item, MISSING, failure=failure)
    if record.failure is not None:
        return Entry(item, MISSING, failure=record.failure)
    if item.number in record.failed_rows:
        return Entry(item, MISSING, failure=record.failed_rows[item.number])
    row = next((row for row in record.rows if row.item == item.number), None)
    if row is None:
        failure = Failure(f"the part {item.part} returned no row for it")
        return Entry(item, MISSING, failure=failure)
    return _filled(item, row, record)


def _filled(item: Item, row: Row, record: Record) -> Entry:
    """Put the numbers of a row into the sentences of its item."""
    try:
        why = item.reasons[row.reason] if row.reason else ""
        return Entry(
            item=item,
            standing=str(row.agreement),
            printed_method=filled(item.printed_method, row.values),
            ours=filled(item.ours, row.values),
            why=filled(why, row.values),
            figure_failure=_figure_failure(item, record),
        )
    except KeyError as error:
        wanted = f"the part {item.part} gives no {error} for its sentences"
        return Entry(item, MISSING, failure=Failure(wanted))
    except (AttributeError, IndexError, TypeError, ValueError) as error:
        wanted = f"its sentences do not suit its numbers: {printable(str(error))}"
        return Entry(item, MISSING, failure=Failure(wanted))


def _figure_failure(item: Item, record: Record) -> Failure | None:
    if not item.figure or item.figure in record.figures:
        return None
    if item.figure in record.failed_figures:
        return record.failed_figures[item.figure]
    if "" in record.failed_figures:
        return record.failed_figures[""]
    return Failure(f"the part {item.part} drew no figure of this name")


def faults_of(entries: Sequence[Entry], records: Sequence[Record]) -> list[Fault]:
    """Return what could not be made: a line for a part, or for a row or a figure."""
    faults = []
    for record in records:
        own = [entry for entry in entries if entry.item.part == record.part]
        if record.failure is not None:
            numbers = _numbers([entry.item.number for entry in own])
            line = f"{record.part} ({numbers}): cannot be made: {record.failure}"
            faults.append(Fault(record.part, line))
            continue
        faults += _faults_of_rows(own, record)
    made = {record.part for record in records}
    for entry in entries:
        if entry.item.part not in made:
            faults.append(Fault(entry.item.part, _line(entry, entry.failure)))
    return faults


def _faults_of_rows(own: Sequence[Entry], record: Record) -> list[Fault]:
    faults = []
    for entry in own:
        if entry.failure is not None:
            faults.append(Fault(record.part, _line(entry, entry.failure)))
        if entry.figure_failure is not None:
            told = f"{entry.item.figure}: cannot be drawn: {entry.figure_failure}"
            faults.append(Fault(record.part, f"item {entry.item.number}: {told}"))
    known = {entry.item.number for entry in own}
    for row in record.rows:
        if row.item not in known:
            told = f"item {row.item}: items/{record.part}.toml has no entry for it"
            faults.append(Fault(record.part, told))
    return faults


def _line(entry: Entry, failure: Failure | None) -> str:
    item = entry.item
    return f"item {item.number} ({item.title}): cannot be made: {failure}"


def _numbers(numbers: Sequence[int]) -> str:
    """Write ``items 3 to 5 and 9``-like lists of numbers shortly."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and runs[-1][-1] == number - 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    texts = []
    for run in runs:
        if len(run) > 1:
            texts.append(f"{run[0]} to {run[-1]}")
        else:
            texts.append(str(run[0]))
    word = "item" if len(numbers) == 1 else "items"
    return f"{word} {', '.join(texts)}" if texts else "no item"


def counts_of(entries: Sequence[Entry]) -> Mapping[str, int]:
    """Return how many items have each standing."""
    standings = [entry.standing for entry in entries]
    return {standing: standings.count(standing) for standing in STANDINGS}


def found_of(items: Sequence[Item], records: Sequence[Record]) -> dict[str, Any]:
    """Return for JSON what was found in all.

    Returns
    -------
    dict
        ``answer``: the page's answer in words; ``counts`` of items by standing;
        ``standings`` of the items by number; ``faults``: part and line of what could
        not be made.
    """
    entries = entries_of(items, records)
    counts = counts_of(entries)
    return {
        "answer": answer(counts),
        "counts": dict(counts),
        "standings": {str(one.item.number): one.standing for one in entries},
        "faults": [asdict(fault) for fault in faults_of(entries, records)],
    }


def answer(counts: Mapping[str, int]) -> str:
    """Return in a sentence or three what was found.

    Parameters
    ----------
    counts
        The number of items of each standing.
    """
    told = []
    claims = sum(counts[name] for name in CLAIMS)
    if claims:
        parts = [_counted(counts, name) for name in CLAIMS if counts[name]]
        told.append(f"Of {counted(claims, 'result')}, {words(parts)}.")
    if counts["built"]:
        told.append(f"{_counted(counts, 'built')}.")
    if counts[MISSING]:
        told.append(f"{_counted(counts, MISSING)}.")
    return " ".join(told)


def _counted(counts: Mapping[str, int], standing: str) -> str:
    number = counts[standing]
    one, several = WORDS["standing"][standing]["counted"]
    if number == 1:
        return f"{number} {one}"
    return f"{number} {several}"


def repetitions(records: Sequence[Record]) -> int:
    """Return with how many seeds the parts measured."""
    return max((len(record.seeds) for record in records), default=0)
