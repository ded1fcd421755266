"""Errors that a user can act on: the place, what was expected and what was found."""

import difflib
import inspect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from pickle import PicklingError
from typing import TYPE_CHECKING, Any, ParamSpec, Self, TypeVar

Entry = TypeVar("Entry")
Arguments = ParamSpec("Arguments")


class HopdataError(Exception):
    """Base class of the errors that hopdata raises for a mistake in its input.

    The arguments are the lines of the message. Unprintable characters in them are
    replaced, and of a line that is very long the middle is left out.

    Attributes
    ----------
    key
        Key of the configuration to change, if the error names one beside its place.
    """

    key: str = ""

    @classmethod
    def at(cls, place: object, expected: str, found: object, *, key: str = "") -> Self:
        """Return an error about a place, what was expected there and what was found."""
        error = cls(mismatch(place, expected, found))
        error.key = key
        return error

    @property
    def code(self) -> str:
        """The code of the message if it is a `hopdata.messages.Message`; else empty."""
        if not self.args:
            return ""
        return str(getattr(self.args[0], "code", ""))

    def __str__(self) -> str:
        return "\n".join(printable(shortened(str(line))) for line in self.args)

    def _render_traceback_(self) -> list[str]:
        """Show only the message, and no traceback, in a notebook, which calls this."""
        return [f"{type(self).__name__}: {self}"]


class ArgumentError(HopdataError, TypeError, ValueError):
    """A function was called with an argument that it does not accept."""


class NotPicklableError(HopdataError, PicklingError):
    """An object cannot be sent to another process."""


class AbsentError(HopdataError, AttributeError):
    """A module or an object has no attribute of this name."""


class Told:
    """Base of objects for notebooks.

    The error for a misspelt attribute suggests the nearest.
    """

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> object:
            if name.startswith("_") or hasattr(type(self), name):
                # This raises the property's own error.
                return object.__getattribute__(self, name)
            raise absent(type(self).__name__, name, dir(self))


class ConfigError(HopdataError):
    """A key of the configuration is missing, misspelt or out of range."""


class RecordingError(HopdataError):
    """A recording cannot be read, or does not hold what the configuration says."""


class AnalysisError(HopdataError):
    """The data are valid but do not suffice for the requested analysis."""


class DamagedError(HopdataError):
    """A file of an earlier job is not as that job has written it."""


class StorageError(HopdataError, OSError):
    """A file cannot be written, for example because the disk is full."""


def mismatch(place: object, expected: str, found: object) -> str:
    """Return a message in the common form: place, what was expected, what was found."""
    return f"{place}: expected {expected}, found {found}"


#: Spaces of hopdata's own sentences, which `printable` may keep.
NO_BREAK_SPACES = "\u00a0\u202f\u2009"
# Characters that are seen as nothing, but part or join the letters of some scripts: the
# zero-width non-joiner and joiner, between letters from Arabic to Sinhala.
_JOINERS = "\u200c\u200d"
_JOINED = range(0x0600, 0x0E00)


def printable(text: str, keep: str = "") -> str:
    """Return a text from elsewhere as one line without what a reader cannot see.

    This is the one rule for what is shown on a terminal and in a log, a table or a
    page. Control characters, by which a terminal is told to do things, become ``?``, as
    do marks that turn the direction of writing or take no room, and halves of
    characters. Any space or line end becomes a space. Letters of all scripts stay.

    Parameters
    ----------
    text : str
    keep : str
        Characters that stay as they are, such as line ends.
    """
    if text.isprintable():
        return text
    shown = []
    for i, character in enumerate(text):
        is_joiner = character in _JOINERS and _is_within_word(text, i)
        if character.isprintable() or character in keep or is_joiner:
            shown.append(character)
        else:
            shown.append(" " if character.isspace() else "?")
    return "".join(shown)


def _is_within_word(text: str, i: int) -> bool:
    """Tell whether letters of a script that uses joiners stand on both sides."""
    around = (text[i - 1 : i], text[i + 1 : i + 2])
    return all(one and ord(one) in _JOINED for one in around)


# Characters of a line of an error, and those of its end, where advice stands.
LONGEST_LINE = 2000
_END = 500


def shortened(line: str) -> str:
    """Return a line of a message, of a very long one its begin and its end.

    A name of a damaged file, or the list of its names, can have a million characters.
    """
    if len(line) <= LONGEST_LINE:
        return line
    gap = f" ... ({len(line) - LONGEST_LINE:,} characters left out) ... "
    return line[: LONGEST_LINE - _END] + gap + line[-_END:]


LEAST_LIKENESS = 0.5  # of a name that is suggested, as in `difflib`


def did_you_mean(name: str, choices: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the nearest choice, or an empty string."""
    choices = list(choices)
    near = [choice for choice in choices if _plain(choice) == _plain(name)]
    if not near:
        near = difflib.get_close_matches(name, choices, n=1, cutoff=LEAST_LIKENESS)
    if not near:
        return ""
    return f"; did you mean '{near[0]}'?"


def _plain(name: str) -> str:
    """Return a name without its subject prefix, in one case and with single spaces."""
    return " ".join(name.rpartition(":")[2].split()).casefold()


def absent(owner: str, name: str, choices: Iterable[str]) -> AbsentError:
    """Return the error for a missing attribute, with public names of the owner."""
    there = [one for one in choices if not one.startswith("_")]
    near = did_you_mean(name, there) or f"; it has {', '.join(there)}"
    return AbsentError(f"{owner} has no attribute {name!r}{near}")


def told_call(function: Callable[Arguments, Entry]) -> Callable[Arguments, Entry]:
    """Decorate a function: an error about its arguments lists those that it accepts.

    Of a function with ``**options``, all names are passed on: see `told_options`.
    """
    names = _own_arguments(function)
    title = _title(function)
    known = inspect.signature(function)

    @wraps(function)
    def called(*given: Arguments.args, **named: Arguments.kwargs) -> Entry:
        try:
            return function(*given, **named)
        except TypeError:
            try:
                known.bind(*given, **named)
            except TypeError as error:
                require_arguments(title, named, names)
                wanted = _in_words(names)
                raise ArgumentError.at(title, wanted, error) from None
            raise

    return called


def told_options(
    options: Callable[[], Iterable[str]],
) -> Callable[[Callable[Arguments, Entry]], Callable[Arguments, Entry]]:
    """Decorate a function with ``**options``: only options of these names are accepted.

    Parameters
    ----------
    options : callable
        Returns the names of the options; it is called when the function is. A misspelt
        name is compared with them and with the function's other arguments.
    """

    def decorated(
        function: Callable[Arguments, Entry],
    ) -> Callable[Arguments, Entry]:
        own = _own_arguments(function)
        title = _title(function)

        @wraps(function)
        def called(*given: Arguments.args, **named: Arguments.kwargs) -> Entry:
            if not {*named} <= {*own}:
                names = dict.fromkeys([*own, *options()])
                require_arguments(title, named, [*names])
            return function(*given, **named)

        return told_call(called)

    return decorated


#: Arguments that a message lists beside the one that was meant.
MOST_LISTED = 20


def require_arguments(title: str, given: Iterable[str], names: Sequence[str]) -> None:
    """Require that a function was called with arguments of these names only.

    Raises
    ------
    ArgumentError
        If not; it lists the names, and suggests the nearest of them.
    """
    unknown = [name for name in given if name not in names]
    if not unknown:
        return
    near = [did_you_mean(name, names) for name in unknown]
    wanted = _in_words(names)
    if all(near) and len(names) > MOST_LISTED:
        wanted = f"one of its {len(names)} arguments"
    parts = zip(unknown, near, strict=True)
    found = " and ".join(f"{name!r}{advice}" for name, advice in parts)
    raise ArgumentError.at(title, wanted, found)


def _own_arguments(function: Callable[..., Any]) -> list[str]:
    """Return the names of a function's arguments, without its ``**options``."""
    known = inspect.signature(function).parameters.values()
    return [
        one.name
        for one in known
        if one.name not in ("self", "cls") and one.kind is not one.VAR_KEYWORD
    ]


def _title(function: Callable[..., Any]) -> str:
    return function.__qualname__.removesuffix(".__init__")


def _in_words(names: Sequence[str]) -> str:
    return f"the arguments {', '.join(names)}" if names else "no arguments"


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
    """Return the entry of a table by name, or raise a `ConfigError` with the names."""
    require_choice(key, name, table)
    return table[name]


def counted(number: int, word: str) -> str:
    """Write ``1 frame``, ``2 frames``."""
    if number == 1:
        return f"{number} {word}"
    return f"{number} {word}s"


def with_names(reason: str, columns: Iterable[object]) -> str:
    """Replace ``foot 2`` by that foot's name in the columns ``contact_<foot>_s``."""
    contacts = [str(one) for one in columns if str(one).startswith("contact_")]
    names = [one.removeprefix("contact_").removesuffix("_s") for one in contacts]

    def named(foot: re.Match[str]) -> str:
        number = int(foot[1])
        if 1 <= number <= len(names):
            return names[number - 1]
        return foot[0]

    return re.sub(r"foot (\d+)", named, reason)
