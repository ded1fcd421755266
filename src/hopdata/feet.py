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


def order_name(feet: Iterable[int]) -> str:
    """Return an order of feet, counted from 0, as schedules name it: ``2>1>3``."""
    return ">".join(str(foot + 1) for foot in feet)


# A left and a right foot look alike in all files, whichever comes first.
SIDES = ("left", "right")
# Between two feet of an order, wherever a person reads it.
ARROW = " → "
# Between orders of feet that belong together, ``1>2, 4>3``.
AND = ", "


def with_foot_names(order: str, names: Sequence[str] = ()) -> str:
    """Return an order such as ``2>1>3`` as it is read, ``toe → heel → thumb``.

    Unless each of its feet has a name, the numbers stay. Every page, figure and
    sentence spells orders by this function.
    """
    return AND.join(_with_names(one, names) for one in order.split(AND))


def _with_names(order: str, names: Sequence[str]) -> str:
    """Return one order with the names of its feet."""
    feet = order.split(">")
    known = [foot for foot in feet if foot.isdigit() and int(foot) <= len(names)]
    if len(known) == len(feet):
        feet = [names[int(foot) - 1] for foot in feet]
    return ARROW.join(feet)


def foot_called(foot: str | int, names: Sequence[str] = ()) -> str:
    """Return the name of a foot, numbered from 1; ``foot 2`` if it has none."""
    number = int(foot)
    if number <= len(names):
        return names[number - 1]
    return f"foot {number}"


def foot_places(names: Sequence[str]) -> dict[str, int]:
    """Return the number that gives each foot its colour, dashes and mark, by name."""
    sides = [name.lower() for name in names]
    if sorted(sides) == sorted(SIDES):
        return {name: SIDES.index(name.lower()) for name in names}
    return {name: place for place, name in enumerate(names)}
