"""Errors that a user can act on: each names the place, what was expected and what was found."""

import difflib
import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from pickle import PicklingError
from typing import TYPE_CHECKING, ParamSpec, Self, TypeVar

Entry = TypeVar("Entry")
Arguments = ParamSpec("Arguments")


class HopdataError(Exception):
    """Base class of the errors that hopdata raises for a mistake in its input.

    The arguments are the lines of the message. Unprintable characters in them are
    replaced.
    """

    @classmethod
    def at(cls, place: object, expected: str, found: object) -> Self:
        """Return an error that names a place, what was expected there and what was found."""
        return cls(mismatch(place, expected, found))

    @property
    def code(self) -> str:
        """The code of the message, if it is a `hopdata.messages.Message`; otherwise empty."""
        return str(getattr(self.args[0], "code", "")) if self.args else ""

    def __str__(self) -> str:
        return "\n".join(printable(str(line)) for line in self.args)

    def _render_traceback_(self) -> list[str]:
        """Show only the message in a notebook, which calls this method, and no traceback."""
        return [f"{type(self).__name__}: {self}"]


class ArgumentError(HopdataError, TypeError, ValueError):
    """A function was called with an argument that it does not accept."""


class NotPicklableError(HopdataError, PicklingError):
    """An object cannot be sent to another process."""


class AbsentError(HopdataError, AttributeError):
    """A module or an object has no attribute of this name."""


class Told:
    """Base of objects for notebooks: the error for a misspelt attribute suggests the nearest."""

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> object:
            if name.startswith("_") or hasattr(type(self), name):
                return object.__getattribute__(
                    self, name
                )  # raises the property's own error
            raise absent(type(self).__name__, name, dir(self))


class ConfigError(HopdataError):
    """A key of the configuration is missing, misspelt or out of range."""


class RecordingError(HopdataError):
    """A recording cannot be read, or does not hold what the configuration says."""


class AnalysisError(HopdataError):
    """The data are valid but do not suffice for the requested analysis."""


class StorageError(HopdataError, OSError):
    """A file cannot be written, for example because the disk is full."""


def mismatch(place: object, expected: str, found: object) -> str:
    """Return a message in the common form: the place, what was expected and what was found."""
    return f"{place}: expected {expected}, found {found}"


def printable(text: str) -> str:
    """Return a user's text in a form safe for messages: one line without control characters."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)


def did_you_mean(name: str, choices: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the nearest of `choices`, or an empty string."""
    choices = list(choices)
    near = [choice for choice in choices if _plain(choice) == _plain(name)]
    near = near or difflib.get_close_matches(name, choices, n=1, cutoff=0.5)
    return f"; did you mean '{near[0]}'?" if near else ""


def _plain(name: str) -> str:
    """Return a name without its subject prefix, in one case and with single spaces."""
    return " ".join(name.rpartition(":")[2].split()).casefold()


def absent(owner: str, name: str, choices: Iterable[str]) -> AbsentError:
    """Return the error for a missing attribute; it suggests public names of the owner."""
    there = [one for one in choices if not one.startswith("_")]
    near = did_you_mean(name, there) or f"; it has {', '.join(there)}"
    return AbsentError(f"{owner} has no attribute {name!r}{near}")


def told_call(function: Callable[Arguments, Entry]) -> Callable[Arguments, Entry]:
    """Decorate a function so that an error about its arguments lists those that it accepts."""
    known = inspect.signature(function)
    names = [name for name in known.parameters if name not in ("self", "cls")]
    title = function.__qualname__.removesuffix(".__init__")

    @wraps(function)
    def called(*given: Arguments.args, **named: Arguments.kwargs) -> Entry:
        try:
            return function(*given, **named)
        except TypeError:
            try:
                known.bind(*given, **named)
            except TypeError as error:
                unknown = [
                    f"{n!r}{did_you_mean(n, names)}" for n in named if n not in names
                ]
                wanted = (
                    f"the arguments {', '.join(names)}" if names else "no arguments"
                )
                found = " and ".join(unknown) or str(error)
                raise ArgumentError.at(title, wanted, found) from None
            raise

    return called


def require(holds: bool, key: str, wanted: str, found: object) -> None:
    """Raise a `ConfigError` that names `key` unless the condition holds."""
    if not holds:
        raise ConfigError.at(key, wanted, found)


def require_choice(key: str, value: str, choices: Iterable[str]) -> None:
    """Raise a `ConfigError` that names `key` unless `value` is one of `choices`."""
    choices = tuple(choices)
    if value not in choices:
        near = did_you_mean(str(value), choices)
        raise ConfigError.at(key, f"one of {', '.join(choices)}", f"{value!r}{near}")


def chosen(key: str, name: str, table: Mapping[str, Entry]) -> Entry:
    """Return the entry of a table by name; raise a `ConfigError` that lists the names otherwise."""
    require_choice(key, name, table)
    return table[name]


def counted(number: int, word: str) -> str:
    """Write ``1 frame``, ``2 frames``."""
    return f"{number} {word}" + ("" if number == 1 else "s")


def with_names(reason: str, columns: Iterable[object]) -> str:
    """Replace ``foot 2`` by the name of that foot, taken from the columns ``contact_<foot>_s``."""
    names = dict(
        enumerate([str(c)[8:-2] for c in columns if str(c).startswith("contact_")], 1)
    )
    return re.sub(r"foot (\d+)", lambda foot: names.get(int(foot[1]), foot[0]), reason)
