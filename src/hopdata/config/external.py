"""Mistakes in what a configuration says of external contacts and forces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from hopdata.errors import did_you_mean

BLOCKS = ("contacts", "forces")


def external_files(config: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield key and file of each block that names one."""
    for i, recording in enumerate(config["recordings"]):
        for block in BLOCKS:
            if recording[block]["file"] is not None:
                yield f"recordings[{i}].{block}.file", recording[block]["file"]


def external_mistakes(config: dict[str, Any]) -> Iterator[str]:
    """Yield what is wrong with columns, feet and thresholds."""
    for i, recording in enumerate(config["recordings"]):
        for block in BLOCKS:
            place = f"recordings[{i}].{block}"
            yield from _wrong_columns(place, recording[block], config["markers"]["feet"])
        yield from _wrong_options(f"recordings[{i}]", recording)


def _wrong_columns(place: str, block: dict[str, Any], feet: list[str]) -> Iterator[str]:
    if block["columns"] and block["file"] is None:
        yield f"{place}.file: expected a file beside the columns, found null (nothing)"
    names = [column["name"] for column in block["columns"]]
    for k, column in enumerate(block["columns"]):
        if column["name"] in names[:k]:
            yield (
                f"{place}.columns[{k}].name: expected each column once, "
                f"found '{column['name']}' twice"
            )
        for foot in column["feet"] or [column["name"]]:
            if foot not in feet:
                yield (
                    f"{place}.columns[{k}].feet: expected feet of markers.feet "
                    f"({', '.join(feet)}), found '{foot}'{did_you_mean(foot, feet)}"
                )


def _wrong_options(place: str, recording: dict[str, Any]) -> Iterator[str]:
    contacts, forces = recording["contacts"], recording["forces"]
    if contacts["label_column"] is not None and contacts["time_column"] is None:
        yield (
            f"{place}.contacts.time_column: expected the column of the instants beside "
            "label_column, found null (nothing)"
        )
    if forces["threshold_n"] is not None and forces["unit"] == "body_weight":
        yield (
            f"{place}.forces.threshold_n: expected threshold_share where forces are in "
            f"body weights, found {forces['threshold_n']:g} N"
        )
