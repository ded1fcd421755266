"""The one door: a function that reads something foreign is called apart, within limits.

Everything that hopdata did not write itself in this run comes in through `read`: files
of recordings, tables, configurations, packets, and whatever a plugin reads. The
function that does the reading, with the libraries that it needs, is called in another
process with hard limits on memory, time, files and the network (`hopdata.foreign.
limits`). What it may spend follows from the size of what it reads and the free memory
(`hopdata.foreign.budget`). Plain values come back (`hopdata.foreign.plain`), never a
pickle, or one error.

How to use it. Write a function at the top level of a module that takes plain values and
returns plain values: None, bool, int, float, str, bytes, dates, paths, arrays of
numbers, and lists, tuples and mappings of them; also dataclasses of these, if ``kinds``
names them. No other objects, no tables of pandas (a mapping of columns does), no
functions. It may raise `HopdataError`, whose class, lines, code and key arrive
unchanged. Then call it by its name::

    from hopdata.foreign import door

    content = door.read(
        "hopdata.config.loading:parsed",  # module:function
        str(path),  # its arguments, one after the other
        place=path,  # what a message begins with
        n_bytes=door.size_of(path),  # from which memory and time follow
        raises=ConfigError,
        reader="the YAML library",  # who is to blame, in a message
        libraries=("yaml",),  # what it imports
    )

The message of a failure has the code ``foreign.memory``, ``foreign.free_memory``,
``foreign.time``, ``foreign.waits``, ``foreign.ended``, ``foreign.failed`` (a traceback,
in one line), ``foreign.reply``, ``foreign.folder`` or ``foreign.start``.

A call costs some hundredths of a second where the process can fork (`apart.may_fork`),
since libraries that this process has imported are there at once: name what the
function needs as ``libraries``. One call for many small things is better than many.
Inside, the working folder is the same, so that relative paths mean the same, but it is
not on Python's search path. Nothing can be written, and a call within a call is made at
once, in the same process.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from hopdata.errors import HopdataError, RecordingError
from hopdata.foreign import apart
from hopdata.foreign.budget import LONGEST_SLEEP_S, Budget, budget_for
from hopdata.foreign.watch import MEMORY, TIME, WAITS
from hopdata.messages import Message

_is_open = False


def read(
    function: str,
    *arguments: Any,
    place: object,
    n_bytes: int,
    raises: type[HopdataError] = RecordingError,
    reader: str = "the reader",
    kinds: tuple[type, ...] = (),
    libraries: Sequence[str] = (),
) -> Any:
    """Call a function that reads something foreign, apart and within limits.

    Parameters
    ----------
    function : str
        Where it stands, ``"module:name"``.
    *arguments
        Its arguments, plain values.
    place : path or str
        What a message begins with.
    n_bytes : int
        Size of what is read, bytes; `size_of` gives that of a file.
    raises : type of HopdataError
        The error to raise if reading fails.
    reader : str
        Who reads, in a message: a library, or a plugin with its name.
    kinds : tuple of type
        Dataclasses that may be in what it returns.
    libraries : sequence of str
        Modules that it will import, so that this is no part of what it may spend.

    Returns
    -------
    Any
        What the function returns.

    Raises
    ------
    HopdataError
        What the function raises.
    raises
        If it needs too much memory or time, ends its process, raises anything else, or
        does not return plain values.
    """
    if is_inside():
        return resolve_name(function)(*arguments)
    budget = budget_for(n_bytes)
    request = apart.Request(function, arguments, budget, kinds, tuple(libraries))
    answer = apart.call(request)
    if answer.error is not None:
        raise answer.error
    if answer.failure is not None:
        raise raises(_message(answer.failure, place, reader, budget))
    return answer.value


def is_inside() -> bool:
    """Tell whether a call would be made at once: inside of another, or `open_here`."""
    return _is_open or apart.is_inside()


def size_of(*paths: str | Path) -> int:
    """Return the size of files together, bytes; of one that is missing it is 0."""
    total = 0
    for path in paths:
        try:
            total += Path(path).stat().st_size
        except (OSError, ValueError):
            continue
    return total


@contextmanager
def open_here() -> Iterator[None]:
    """Let what is read inside the block be read in this process, without any limit.

    Only for who measures or fuzzes the functions that read.
    """
    global _is_open
    before = _is_open
    _is_open = True
    try:
        yield
    finally:
        _is_open = before


def _message(
    failure: apart.Failure, place: object, reader: str, budget: Budget
) -> Message:
    """Return what to say of a failure."""
    name = failure.name
    if name == MEMORY and budget.is_short:
        name = "free_memory"
    values: dict[str, Any] = {
        "place": str(place),
        "reader": reader,
        "size": _size(budget.n_bytes),
    }
    if failure.name == MEMORY:
        values["most_mb"] = round(budget.memory / 1e6)
    elif name == TIME:
        values["most_s"] = round(budget.cpu_s)
    elif name == WAITS:
        values["waited_s"] = round(LONGEST_SLEEP_S)
    elif name == "ended":
        values["how"] = failure.words
    elif name == "reply":
        values["found"] = failure.words
    elif name == "folder":
        del values["reader"], values["size"]
    else:
        values["error"] = failure.words
    return Message(f"foreign.{name}", values)


def _size(n_bytes: int) -> str:
    """Write a number of bytes as a person would."""
    if n_bytes < 1_000:
        return f"{n_bytes} bytes"
    if n_bytes < 1_000_000:
        return f"{n_bytes / 1e3:.0f} kB"
    return f"{n_bytes / 1e6:.0f} MB"
