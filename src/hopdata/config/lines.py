"""The line of each key of a configuration file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from hopdata.config.messages import dotted

MOST_DEPTH = 50  # a file within itself has no end


def place_of(mistake: str, files: Iterable[str | Path], otherwise: str) -> str:
    """Name file and line of the key with which a mistake begins.

    Parameters
    ----------
    mistake : str
        Such as ``"verdict.margn: expected ..."``.
    files : iterable of path
        Where to look; the last one that has the key counts, as it does for its value.
    otherwise : str
        What to return where no file has it, for instance because it is missing.
    """
    key, _, told = mistake.partition(": expected")
    if told.startswith(" this key,"):
        return otherwise
    for file in reversed(list(files)):
        line = key_lines(file).get(key)
        if line is not None:
            return f"{file}, line {line}"
    return otherwise


def key_lines(file: str | Path) -> dict[str, int]:
    """Return the line, from 1, of each key and entry of a YAML file, by its dotted path."""
    import yaml

    try:
        root = yaml.compose(Path(file).read_text(encoding="utf-8"), yaml.SafeLoader)
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return {}
    return {dotted(path): line for path, line in _lines(root, ())} if root else {}


def _lines(node: Any, path: tuple[str | int, ...]) -> Iterator[tuple[tuple[str | int, ...], int]]:
    import yaml

    if len(path) > MOST_DEPTH:
        return
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            inner = (*path, str(key.value))
            yield inner, key.start_mark.line + 1
            yield from _lines(value, inner)
    elif isinstance(node, yaml.SequenceNode):
        for i, value in enumerate(node.value):
            yield (*path, i), value.start_mark.line + 1
            yield from _lines(value, (*path, i))
