"""Answers of commands as JSON, for scripts: ``--json``.

With it, stdout holds one JSON object, also after an error; docs/json.md lists its
fields. A command gives its fields as it finds them, and what it prints for a reader is
dropped. Without it, fields that are given go nowhere.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any

from hopdata.errors import HopdataError
from hopdata.messages import Message

#: Version of the fields: a field may come without a new one; none goes or changes.
FORMAT = 1

#: The fields of the command that runs; None if nobody asked for them.
_fields: dict[str, Any] | None = None


def is_asked() -> bool:
    """Tell whether the command that runs answers in JSON, so that stdout is taken."""
    return _fields is not None


def give(**fields: object) -> None:
    """Give fields of the answer: numbers, texts, lists, mappings, messages or paths."""
    if _fields is not None:
        _fields.update(fields)


def give_also(name: str, /, **entry: object) -> None:
    """Give a further entry of a list of the answer."""
    if _fields is not None:
        _fields.setdefault(name, []).append(entry)


def in_json(
    options: argparse.Namespace, name: str, run: Callable[[argparse.Namespace], int]
) -> int:
    """Run a command, and print its answer or its error as JSON.

    Parameters
    ----------
    options : Namespace
        The command's.
    name : str
        Name of the command.
    run : callable
        The command: takes its options and returns its exit code.
    """
    from hopdata import __version__
    from hopdata.commands.terminal import OK, PROBLEM

    answer: dict[str, Any] = {"format": FORMAT, "hopdata": __version__}
    answer["command"] = name
    with _collected() as fields:
        try:
            code = run(options)
        except HopdataError as error:
            code = PROBLEM
            fields["error"] = error_fields(error)
    answer["ok"] = code == OK
    print(json.dumps(as_plain(answer | fields), indent=2, allow_nan=False))
    sys.stdout.flush()
    return code


def error_fields(error: HopdataError) -> dict[str, Any]:
    """Return an error as a field: the code of its message, if it has one, and lines."""
    return {"code": error.code or None, "lines": str(error).splitlines()}


@contextmanager
def _collected() -> Iterator[dict[str, Any]]:
    """Collect the fields that are given, and drop what is printed on stdout."""
    global _fields
    _fields = {}
    try:
        with redirect_stdout(io.StringIO()):
            yield _fields
    finally:
        _fields = None


def as_plain(value: Any) -> Any:
    """Return a value as JSON knows it; what is no number becomes null."""
    if isinstance(value, Message):
        return value.to_dict() | {"values": as_plain(value.to_dict()["values"])}
    if isinstance(value, Mapping):
        return {str(key): as_plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [as_plain(one) for one in value]
    if isinstance(value, Path):
        return value.as_posix()
    if hasattr(value, "tolist"):  # a number or an array of NumPy
        return as_plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
