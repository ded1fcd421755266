"""Errors a user can act on: each says where, what was expected and what was found."""

import difflib
import inspect
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import TYPE_CHECKING, ParamSpec, Self, TypeVar

Entry = TypeVar("Entry")
Arguments = ParamSpec("Arguments")


class HopdataError(Exception):
    """Base of every error that hopdata raises for a mistake in its input.

    Its arguments are the lines of the message, whatever characters the names in them have.
    """

    @classmethod
    def at(cls, place: object, expected: str, found: object) -> Self:
        """Return the error that names a place, what was expected there and what was found."""
        return cls(mismatch(place, expected, found))

    def __str__(self) -> str:
        return "\n".join(printable(str(line)) for line in self.args)

    def _render_traceback_(self) -> list[str]:
        """Show the message alone in a notebook, which asks for this, without our inner frames."""
        return [f"{type(self).__name__}: {self}"]


class ArgumentError(HopdataError, TypeError, ValueError):
    """A function was called with what it does not take."""


class AbsentError(HopdataError, AttributeError):
    """A module or an object has nothing of this name."""


class Told:
    """What a notebook holds: a misspelt attribute is told with the nearest that there is."""

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> object:
            if name.startswith("_") or hasattr(type(self), name):
                return object.__getattribute__(self, name)  # which raises a property's own error
            raise absent(type(self).__name__, name, dir(self))


class ConfigError(HopdataError):
    """A key of the configuration is missing, misspelt or out of range."""


class RecordingError(HopdataError):
    """A recording cannot be read, or does not hold what the configuration says."""


class AnalysisError(HopdataError):
    """The data are sound but do not suffice for the analysis asked for."""


class StorageError(HopdataError, OSError):
    """There is no room for a file."""


def mismatch(place: object, expected: str, found: object) -> str:
    """Say what was expected at a place, and what was found: the form of every message."""
    return f"{place}: expected {expected}, found {found}"


def printable(text: str) -> str:
    """Return a text of a user as it can stand in a message: one line, nothing that steers."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)


def did_you_mean(name: str, choices: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the nearest of `choices`, or an empty string."""
    choices = list(choices)
    near = [choice for choice in choices if _plain(choice) == _plain(name)]
    near = near or difflib.get_close_matches(name, choices, n=1, cutoff=0.5)
    return f"; did you mean '{near[0]}'?" if near else ""


def _plain(name: str) -> str:
    """Return a name without what is easily overlooked: its subject, case, kinds of space."""
    return " ".join(name.rpartition(":")[2].split()).casefold()


def absent(owner: str, name: str, choices: Iterable[str]) -> AbsentError:
    """Return the error that says what there is in place of a name; of no use are private names."""
    there = [one for one in choices if not one.startswith("_")]
    near = did_you_mean(name, there) or f"; it has {', '.join(there)}"
    return AbsentError(f"{owner} has no attribute {name!r}{near}")


def told_call(function: Callable[Arguments, Entry]) -> Callable[Arguments, Entry]:
    """Decorate a function so that a misspelt or missing argument is told with those there are."""
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
                unknown = [f"{n!r}{did_you_mean(n, names)}" for n in named if n not in names]
                wanted = f"the arguments {', '.join(names)}" if names else "no arguments"
                found = " and ".join(unknown) or str(error)
                raise ArgumentError.at(title, wanted, found) from None
            raise

    return called


def require(holds: bool, key: str, wanted: str, found: object) -> None:
    """Raise a `ConfigError` that names `key` unless what was found is as wanted."""
    if not holds:
        raise ConfigError.at(key, wanted, found)


def require_choice(key: str, value: str, choices: Iterable[str]) -> None:
    """Raise a `ConfigError` that names `key` unless `value` is one of `choices`."""
    choices = tuple(choices)
    if value not in choices:
        near = did_you_mean(str(value), choices)
        raise ConfigError.at(key, f"one of {', '.join(choices)}", f"{value!r}{near}")


def chosen(key: str, name: str, table: Mapping[str, Entry]) -> Entry:
    """Return what a table has under a name; raise a `ConfigError` that lists it if it has none."""
    require_choice(key, name, table)
    return table[name]


def counted(number: int, word: str) -> str:
    """Write ``1 frame``, ``2 frames``."""
    return f"{number} {word}" + ("" if number == 1 else "s")
