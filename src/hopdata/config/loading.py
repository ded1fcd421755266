"""Load a configuration: read, fill in the defaults, check against the schema and with itself."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from math import isfinite
from pathlib import Path
from typing import Any

from hopdata.config.consistency import CHECKS
from hopdata.config.files import missing_files
from hopdata.config.lines import place_of
from hopdata.config.messages import describe, dotted
from hopdata.config.schema import load_schema
from hopdata.config.yaml_file import read_yaml
from hopdata.errors import ConfigError

MOST_MISTAKES = 10
_POWER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")


def load_config(
    source: str | Path | Mapping[str, Any],
    *,
    files: Iterable[str | Path] = (),
    check_files: bool = True,
) -> dict[str, Any]:
    """Load and check a configuration.

    Parameters
    ----------
    source : path or mapping
        A YAML file, or what others have read from `files` (and perhaps changed since).
    files : iterable of path
        Where the mapping comes from: named in messages, and looked into for keys that stand twice.
    check_files : bool
        Whether the recordings' files must exist; they are relative to the working directory.

    Returns
    -------
    dict
        The whole configuration in plain types, with every key of the schema.

    Raises
    ------
    ConfigError
        One line for each mistake: file, key, what was expected and what was found.
    """
    files = list(files or ())
    if isinstance(source, Mapping):
        content: Any = source
        for file in files:
            read_yaml(file)
    else:
        content, files = read_yaml(source), [source]
    place = ", ".join(map(str, files)) or "configuration"
    if not isinstance(content, Mapping):
        kind = "nothing" if content is None else type(content).__name__
        raise ConfigError(
            f"{place}: expected keys with values, such as 'study: name', found {kind}"
        )
    schema = load_schema()
    try:
        config: dict[str, Any] = _with_defaults(content, schema)
    except RecursionError:
        raise ConfigError(f"{place}: expected a tree of keys, found one within itself") from None
    _raise_all(place, files, _schema_mistakes(config, schema))
    checks = [*CHECKS, missing_files] if check_files else CHECKS
    _raise_all(place, files, [mistake for check in checks for mistake in check(config)])
    config["home"]["marker"] = config["home"]["marker"] or config["markers"]["body"][0]
    return config


def _with_defaults(value: Any, schema: dict[str, Any]) -> Any:
    """Copy `value` into plain types, with the defaults of all keys that it leaves out."""
    if value is None and schema.get("default") == {}:
        value = {}  # a section whose keys are all commented out
    if isinstance(value, Mapping):
        properties = schema.get("properties", {})
        filled = {key: _with_defaults(v, properties.get(key, {})) for key, v in value.items()}
        for key, inner in properties.items():
            if key not in filled and "default" in inner:
                filled[key] = _with_defaults(deepcopy(inner["default"]), inner)
        return filled
    if isinstance(value, list | tuple):
        return [_with_defaults(v, schema.get("items", {})) for v in value]
    if isinstance(value, str) and "number" in schema.get("type", ()) and _POWER.fullmatch(value):
        value = float(value)  # YAML 1.1 takes 1e-3 for text, 1.0e-3 for a number
    if isinstance(value, float) and value.is_integer() and _is_whole(schema):
        return int(value)  # the schema takes 1000.0 for a whole number, Python does not
    return value


def _is_whole(schema: dict[str, Any]) -> bool:
    """Whether numbers of this key are whole."""
    return "integer" in schema.get("type", ()) and "number" not in schema.get("type", ())


def _schema_mistakes(config: dict[str, Any], schema: dict[str, Any]) -> list[str]:
    """Return what the schema rejects, and numbers that are not finite."""
    from jsonschema import Draft202012Validator

    mistakes = describe(Draft202012Validator(schema).iter_errors(config), schema)
    for path, value in _leaves(config):
        if isinstance(value, float) and not isfinite(value):
            mistakes.append(f"{dotted(path)}: expected a finite number, found {value}")
    return mistakes


def _leaves(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[Any, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, (*path, key))
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from _leaves(inner, (*path, i))
    else:
        yield path, value


def _raise_all(place: str, files: list[str | Path], mistakes: list[str]) -> None:
    if not mistakes:
        return
    shown = mistakes[:MOST_MISTAKES]
    lines = [f"{place_of(mistake, files, place)}: {mistake}" for mistake in shown]
    if len(mistakes) > MOST_MISTAKES:
        more = len(mistakes) - MOST_MISTAKES
        lines.append(f"{place}: and {more} more mistake" + ("s" if more > 1 else ""))
    raise ConfigError(*lines)
