"""Code that other packages bring: its errors are told in one line, with its name.

A package that is installed beside hopdata may bring readers, scenes, labelling methods,
figures and products by entry points (docs/plugins.md). It is code and is trusted as
such, but its errors may be of any kind, and a traceback through hopdata would say
nothing to a user about whom to ask.
"""

from __future__ import annotations

import os
import traceback
import warnings
from collections.abc import Container, Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points

from hopdata.errors import ConfigError, HopdataError
from hopdata.foreign.budget import MOST_WORDS
from hopdata.messages import Message


def name_of(kind: str, entry: EntryPoint) -> str:
    """Return how a message names a plugin, by its name, its package and its object.

    Parameters
    ----------
    kind : str
        What it brings: a reader, a scene, a product.
    entry : EntryPoint
        Where it is declared.
    """
    package = f"{entry.dist.name} " if entry.dist is not None else ""
    return f"the {kind} '{entry.name}' of the package {package}({entry.value})"


def plugins(group: str, kind: str, own: Container[str]) -> dict[str, EntryPoint]:
    """Return what other packages bring to a group of entry points, by name.

    A name that hopdata has itself, or that an earlier package brings, is not taken; a
    warning says whose is used.

    Parameters
    ----------
    group : str
        Such as ``"hopdata.readers"``.
    kind : str
        What it brings, as for `name_of`.
    own : container of str
        hopdata's own names.
    """
    found: dict[str, EntryPoint] = {}
    for entry in sorted(entry_points(group=group), key=_place_of):
        used = "hopdata's own"
        if entry.name in found:
            used = name_of(kind, found[entry.name])
        elif entry.name not in own:
            found[entry.name] = entry
            continue
        values = {"plugin": name_of(kind, entry), "used": used}
        warnings.warn(str(Message("foreign.clash", values)), stacklevel=2)
    return found


def _place_of(entry: EntryPoint) -> tuple[str, str, str]:
    """Return what orders entry points, however their packages lie on the path."""
    package = entry.dist.name if entry.dist is not None else ""
    return entry.name, package, entry.value


@contextmanager
def blamed(
    plugin: str, place: object, *, error: type[HopdataError] = ConfigError
) -> Iterator[None]:
    """Turn what a plugin raises meanwhile into one line with its name.

    Parameters
    ----------
    plugin : str
        Its name, as `name_of` returns it.
    place : object
        What the message begins with.
    error : type of HopdataError
        Class of the error.

    Raises
    ------
    HopdataError
        What it raises of this kind, unchanged; of class `error` for all else.
    """
    try:
        yield
    except (HopdataError, MemoryError):
        raise
    except (Exception, SystemExit) as fault:  # a plugin may also end the program
        told = " ".join(f"{type(fault).__name__}: {fault}".split())[:MOST_WORDS]
        values = {"place": f"{place}", "plugin": plugin, "found": told}
        raise error(Message("foreign.plugin", values)) from fault


@contextmanager
def own_code(named: str, place: object) -> Iterator[None]:
    """Turn what code of the working folder raises into one line with its file.

    Parameters
    ----------
    named : str
        What the user has named, such as ``"the scene my_lab:Tripod"``.
    place : object
        What the message begins with.

    Raises
    ------
    HopdataError
        What it raises of this kind, unchanged; a `ConfigError` for all else.
    """
    try:
        yield
    except (HopdataError, MemoryError):
        raise
    except (Exception, SystemExit) as fault:
        told = " ".join(f"{type(fault).__name__}: {fault}".split())[:MOST_WORDS]
        told += _line_in_folder(fault)
        values = {"place": f"{place}", "plugin": named, "found": told}
        raise ConfigError(Message("foreign.own_code", values)) from fault


def _line_in_folder(fault: BaseException) -> str:
    """Return the last line of a file in the working folder that led to an error."""
    place = ""
    folder = os.getcwd()
    for frame in traceback.extract_tb(fault.__traceback__):
        if os.path.dirname(os.path.abspath(frame.filename)) == folder:
            place = f", in {os.path.basename(frame.filename)}, line {frame.lineno}"
    return place
