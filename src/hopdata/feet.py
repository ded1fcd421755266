"""The feet in tables: their names, and orders of contact with names for numbers."""

import re
from collections.abc import Iterable, Sequence

# Columns of the touchdown table with the contact instants.
_CONTACT = re.compile("contact_(.+)_s")


def foot_names(columns: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the feet in the order in which schedules number them.

    Parameters
    ----------
    columns : iterable of str
        Columns of a touchdown table, of which ``contact_<foot>_s`` are used.
    """
    found = [_CONTACT.fullmatch(str(column)) for column in columns]
    return tuple(match[1] for match in found if match)


def with_foot_names(order: str, names: Sequence[str]) -> str:
    """Return an order such as ``2>1>3`` with names of feet, ``toe → heel → thumb``.

    Unless each of its feet has a name, the numbers stay.
    """
    feet = order.split(">")
    known = [foot for foot in feet if foot.isdigit() and int(foot) <= len(names)]
    if len(known) == len(feet):
        feet = [names[int(foot) - 1] for foot in feet]
    return " → ".join(feet)
