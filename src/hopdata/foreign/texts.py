"""Text files from elsewhere: which are read at all, and how much of them.

Configurations, tables of samples, provenance files and other small files of text come
from anybody. Only plain files are read: a pipe would keep the reader waiting, and a
device may have no end. A file is measured before it is read, and its brackets are
counted before a parser sees them, so what such a file costs follows from its bytes.
These limits are small beside the memory of any computer, so they do not depend on it.
"""

from __future__ import annotations

import errno
import json
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

from hopdata.errors import ConfigError, HopdataError
from hopdata.messages import Message

#: Length of a text that is read whole.
#: Unit: bytes. Origin: chosen. The provenance of a study of 10,000 recordings has 3 MB.
MOST_BYTES = 16_000_000

#: Levels of lists and mappings within one another.
#: Unit: 1. Origin: chosen. A configuration has six.
MOST_LEVELS = 50

#: Values of a text in JSON: lists and mappings, and all that is in them.
#: Unit: 1. Origin: chosen. A parser takes about 1 kB for each.
MOST_VALUES = 500_000

#: Longest number that is read: the digits of a float64, its point and its exponent,
#: with room for zeros. More digits mean nothing, and take time that grows as their
#: square.
#: Unit: characters. Origin: chosen.
LONGEST_NUMBER = 400

# Counting ends here, as a multiple of what is allowed; beyond, "more than" is told.
COUNTED_UP_TO = 2

_KINDS = {
    stat.S_ISDIR: "a folder",
    stat.S_ISFIFO: "a pipe",
    stat.S_ISSOCK: "a socket",
    stat.S_ISCHR: "a device",
    stat.S_ISBLK: "a device",
}


def kind_of(mode: int) -> str:
    """Return what a path leads to, by its mode; an empty string for a plain file."""
    for is_kind, name in _KINDS.items():
        if is_kind(mode):
            return name
    return "" if stat.S_ISREG(mode) else "no plain file"


def bytes_of(
    path: str | Path,
    *,
    wanted: str = "a file that can be read",
    most: int = MOST_BYTES,
    place: object = None,
    error: type[HopdataError] = ConfigError,
) -> bytes:
    """Return the bytes of a plain file of bounded length.

    Parameters
    ----------
    path : path
    wanted : str
        What is expected there, for the message.
    most : int
        Most bytes that it may have.
    place : object, optional
        How the message names the file; by default as `path`.
    error : type of HopdataError
        Class of the error.

    Raises
    ------
    HopdataError
        Of class `error`, if the file cannot be read, is no plain file or is longer.
    """
    told = {"place": f"{path if place is None else place}", "wanted": wanted}
    try:
        handle = _opened(path, told, error)
        with open(handle, "rb") as file:
            found = os.fstat(file.fileno()).st_size
            content = b""
            if found <= most:
                # A file of the system states no size, and a log may have grown.
                content = file.read(most + 1) or b""
            found = max(found, len(content))
    except (OSError, ValueError) as fault:
        raise _unreadable(fault, told, error) from fault
    if found > most:
        values = {
            "most_mb": most / 1e6,
            "found_mb": found / 1e6,
            "more": " or more" if found == len(content) else "",
        }
        raise error(Message("foreign.too_large", told | values))
    return content


def _opened(path: str | Path, told: dict[str, Any], error: type[HopdataError]) -> int:
    """Open a plain file; nothing else is opened, as that alone may have effects."""
    kind = kind_of(os.stat(path).st_mode)
    if not kind:
        # Should a pipe have taken its place meanwhile, this does not wait for a writer.
        flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        handle = os.open(path, flags | getattr(os, "O_CLOEXEC", 0))
        kind = kind_of(os.fstat(handle).st_mode)
        if not kind:
            return handle
        os.close(handle)
    raise error(Message("foreign.no_plain_file", told | {"found": kind}))


def _unreadable(
    fault: OSError | ValueError, told: dict[str, Any], error: type[HopdataError]
) -> HopdataError:
    found = f"{fault}"  # of a name with a zero byte, or with half a character
    if isinstance(fault, UnicodeError):
        found = "a name that is no text"
    if isinstance(fault, OSError):
        found = fault.strerror or f"{fault}"
    return error(Message("foreign.no_file", told | {"found": found}))


def is_absent(error: HopdataError) -> bool:
    """Tell whether a file was not read because there is none."""
    cause = error.__cause__
    return isinstance(cause, OSError) and cause.errno in (errno.ENOENT, errno.ENOTDIR)


def text_of(
    path: str | Path,
    *,
    wanted: str = "text in UTF-8",
    hint: str = "",
    most: int = MOST_BYTES,
    place: object = None,
    error: type[HopdataError] = ConfigError,
) -> str:
    """Return the text of a plain file of bounded length, without a byte order mark.

    The parameters are those of `bytes_of`; `hint` is added to the message about bytes
    that are no UTF-8.

    Raises
    ------
    HopdataError
        Of class `error`, also if the file is not in UTF-8.
    """
    content = bytes_of(path, wanted=wanted, most=most, place=place, error=error)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        shown = f"{path if place is None else place}"
        values = {"place": shown, "wanted": wanted, "hint": hint}
        raise error(Message("foreign.not_utf8", values)) from None


# JSON.


def json_of(
    path: str | Path,
    *,
    wanted: str = "JSON",
    most: int = MOST_BYTES,
    error: type[HopdataError] = ConfigError,
) -> Any:
    """Return the content of a JSON file from elsewhere.

    The parameters are those of `bytes_of`.

    Raises
    ------
    HopdataError
        Of class `error`, also if it is no JSON, has more than `MOST_LEVELS` or
        `MOST_VALUES`, a number that is not finite, or one with more than
        `LONGEST_NUMBER` characters.
    """
    text = text_of(path, wanted=wanted, most=most, error=error)
    return parsed_json(text, wanted=wanted, place=path, error=error)


def parsed_json(
    text: str,
    *,
    wanted: str = "JSON",
    place: object,
    error: type[HopdataError] = ConfigError,
) -> Any:
    """Return the content of a text of JSON from elsewhere; see `json_of`."""
    told = {"place": f"{place}", "wanted": wanted}
    n_values = 0
    for n_levels, n_values in _counted(text):
        if n_levels > MOST_LEVELS:
            raise error(Message("foreign.too_deep", told | {"most": MOST_LEVELS}))
        if n_values > COUNTED_UP_TO * MOST_VALUES:
            break
    if n_values > MOST_VALUES:
        raise error(too_many(place, "values", n_values, MOST_VALUES))
    try:
        return json.loads(
            text,
            parse_int=_whole,
            parse_float=_broken,
            parse_constant=_no_number,
        )
    except (ValueError, RecursionError) as fault:
        found = {"found": f"{fault}"}
        raise error(Message("foreign.not_json", told | found)) from None


def too_many(place: object, what: str, found: int, most: int) -> Message:
    """Return the message about a text with more than is read.

    Parameters
    ----------
    place : object
    what : str
        What was counted.
    found : int
        How many there are; not all if more than `COUNTED_UP_TO` times `most`.
    most : int
        How many there may be.
    """
    counted = f"{found:,}"
    if found > COUNTED_UP_TO * most:
        counted = f"more than {COUNTED_UP_TO * most:,}"
    values = {"place": f"{place}", "what": what, "most": most, "found": counted}
    return Message("foreign.too_many", values)


# A text that is never closed reaches to the end, so that none is looked at twice.
_MARKS = re.compile(r'"(?:[^"\\]|\\.)*+"?|[\[{]|[\]}]|,', re.DOTALL)


def _counted(text: str) -> Iterator[tuple[int, int]]:
    """Yield levels and values at each bracket and comma outside of texts.

    A list or mapping has one value more than commas; an empty one counts as two.
    """
    n_levels = 0
    n_values = 1
    for found in _MARKS.finditer(text):
        mark = found[0]
        if mark in "[{":
            n_levels += 1
            n_values += 1
        elif mark in "]}":
            n_levels -= 1
        elif mark == ",":
            n_values += 1
        else:
            continue
        yield n_levels, n_values


def _whole(text: str) -> int:
    _require_short(text)
    return int(text)


def _broken(text: str) -> float:
    _require_short(text)
    number = float(text)
    if number in (float("inf"), float("-inf")):
        _no_number(text)
    return number


def _require_short(text: str) -> None:
    if len(text) > LONGEST_NUMBER:
        raise ValueError(f"a number of {len(text)} characters")


def _no_number(text: str) -> NoReturn:
    raise ValueError(f"{text}, which is no finite number")
