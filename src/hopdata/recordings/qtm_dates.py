"""The date and time that QTM writes into its exports."""

from __future__ import annotations

from datetime import datetime
from typing import Any

_FORMS = ("%Y-%m-%d, %H:%M:%S.%f", "%Y-%m-%d, %H:%M:%S")


def moment(text: Any) -> datetime | None:
    """Return when the measurement began; None if the text is no date, or in a form of its own."""
    if not isinstance(text, str):
        return None
    for form in _FORMS:
        try:
            return datetime.strptime(text.split("\t")[0].strip(), form)
        except ValueError:
            continue
    return None
