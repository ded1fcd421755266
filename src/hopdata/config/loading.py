"""Load a configuration: read it, fill in defaults, check the schema and consistency."""

import re
from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from math import isfinite
from pathlib import Path
from typing import Any

import yaml

from hopdata import products
from hopdata.config.consistency import (
    CHECKS,
    missing_files,
    nearest_file,
    unnameable_files,
)
from hopdata.config.schema import default_of, describe, dotted, load_schema
from hopdata.errors import ConfigError
from hopdata.foreign.texts import is_absent, text_of
from hopdata.foreign.working_folder import is_own, say
from hopdata.foreign.yaml_texts import loaded, root_node
from hopdata.scenes import SCENES, STANDARD
from hopdata.scenes.own import handed_over

# Keys and indices that lead to a value.
KeyPath = tuple[str | int, ...]

# Line numbers of the keys of a configuration file.

#: Depth at which the search for keys ends, since a file within itself has no end.
#: Unit: 1. Origin: chosen.
MOST_DEPTH = 50


def place_of(mistake: str, files: Iterable[str | Path], otherwise: str) -> str:
    """Return the file and line of the key with which a mistake begins.

    Parameters
    ----------
    mistake : str
        For example ``"verdict.margn: expected ..."``.
    files : iterable of path
        Where to look; the last file with the key counts, as it does for its value.
    otherwise : str
        What to return if no file has the key, for example because it is missing.
    """
    key, _, rest = mistake.partition(": expected")
    if rest.startswith(" this key,"):
        return otherwise
    for file in reversed(list(files)):
        line = key_lines(file).get(key)
        if line is not None:
            return f"{file}, line {line}"
    return otherwise


def key_lines(file: str | Path) -> dict[str, int]:
    """Return the line, from 1, of each key and entry of a YAML file, by dotted path."""
    try:
        root = root_node(text_of(file), file)
    except (ConfigError, ValueError, RecursionError, yaml.YAMLError):
        return {}
    if root is None:
        return {}
    return {dotted(path): line for path, line in _lines(root, ())}


def _lines(node: Any, path: KeyPath) -> Iterator[tuple[KeyPath, int]]:
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


# YAML as written by users.


def read_yaml(path: str | Path) -> Any:
    """Read a YAML file.

    Raises
    ------
    ConfigError
        If the file cannot be read, is not YAML, has a duplicate key, or is larger than
        any configuration (`hopdata.foreign.yaml_texts`).
    """
    path = Path(path)
    text = _text_of(path)
    try:
        return loaded(text, path)
    except yaml.MarkedYAMLError as error:
        raise _not_yaml(path, text, error) from None
    except (yaml.YAMLError, ValueError) as error:
        raise ConfigError(f"{path}: expected YAML, found: {error}") from None


def _text_of(path: Path) -> str:
    try:
        return text_of(
            path,
            wanted="a readable configuration, YAML in UTF-8",
            hint=" (a recording? use init)",
        )
    except ConfigError as error:
        if is_absent(error):
            raise ConfigError(f"{error}{nearest_file(path)}") from None
        raise


def _not_yaml(path: Path, text: str, error: yaml.MarkedYAMLError) -> ConfigError:
    mark = error.problem_mark
    place = f"{path}"
    character = ""
    if mark is not None:
        place += f", line {mark.line + 1}, column {mark.column + 1}"
        character = text[mark.index : mark.index + 1]
    found = f"{error.problem}{_hint(error.problem, character)}"
    return ConfigError(f"{place}: expected YAML, found: {found}")


def _hint(problem: str | None, character: str) -> str:
    """Return the usual cause of the YAML parser's message about this character."""
    problem = problem or ""
    if "':'" in problem or "mapping values" in problem:
        return "; is there a space behind each colon, also in the line above?"
    if "\\t" in problem or "\t" in problem or character == "\t":
        return "; indent with spaces, not with tabs"
    return ""


# What a configuration needs not say that has the block of a product, such as steering,
# and neither recordings nor markers: they are those of the simulated hopper.
SIMULATED = {
    "recordings": [{"name": "hopper"}],
    "markers": {
        "body": ["body1", "body2", "body3"],
        "feet": ["foot1", "foot2", "foot3"],
        "boom": ["boom"],
    },
}


def _with_simulated(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the content, with `SIMULATED` where a product's block stands alone."""
    names = {product.name for product in products.installed()}
    if names.isdisjoint(content) or not content.keys().isdisjoint(SIMULATED):
        return content
    return {**content, **deepcopy(SIMULATED)}


# Lines of a message: more would hide the first, which often causes the others.
MOST_MISTAKES = 10


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
        A YAML file, or a mapping read from `files` (and possibly changed since).
    files : iterable of path
        Origin of the mapping: named in messages, and searched for duplicate keys.
    check_files : bool
        Whether the recordings' files must exist, relative to the working directory.

    Returns
    -------
    dict
        The whole configuration in plain types, with every key of the schema.

    Raises
    ------
    ConfigError
        With a line for each mistake: file, key, what was expected and what was found.
    """
    content: Any
    if isinstance(source, Mapping):
        content = source
        origins = list(files)
        for file in origins:
            read_yaml(file)
    else:
        content = read_yaml(source)
        origins = [source]
    place = ", ".join(map(str, origins)) or "configuration"
    if not isinstance(content, Mapping):
        found = "nothing" if content is None else type(content).__name__
        wanted = "keys with values, as 'hopdata init' writes them"
        raise ConfigError.at(place, wanted, found)
    content = _with_simulated(content)
    scene = _scene_of(content)
    try:
        schema = load_schema(scene)
    except ConfigError as error:
        if is_own(scene):
            _raise_all(place, origins, [str(line) for line in error.args])
        raise
    try:
        printed = is_printed(content)
        config: dict[str, Any] = _with_defaults(content, schema, printed=printed)
    except RecursionError:
        raise ConfigError.at(place, "a tree of keys", "one within itself") from None
    _raise_all(place, origins, _schema_mistakes(config, schema))
    _raise_all(place, origins, [*unnameable_files(config)])
    checks = [*CHECKS]
    if check_files:
        checks.append(missing_files)
    mistakes = [mistake for check in checks for mistake in check(config)]
    for product in products.installed():
        # A product is imported only for a configuration that speaks of it.
        if product.name in content:
            mistakes += product.mistakes(config)
    _raise_all(place, origins, mistakes)
    return config


def check_keys(place: str, keys: Mapping[str, Any]) -> None:
    """Check sections of a configuration.

    Raises
    ------
    ConfigError
        Its lines begin with `place`.
    """
    schema = {**load_schema(_scene_of(keys)), "required": []}
    _raise_all(place, [], _schema_mistakes(dict(keys), schema))


def section_names(section: str = "") -> list[str]:
    """Return the names of the sections of a configuration, or of the keys of one."""
    schema = load_schema()
    if section:
        schema = schema["properties"][section]
    return [*schema["properties"]]


def _scene_of(content: Mapping[str, Any]) -> str:
    """Return the scene to be simulated; the standard one if none known is named."""
    simulation = content.get("simulation")
    if not isinstance(simulation, Mapping):
        return STANDARD
    name = simulation.get("scene", STANDARD)
    if isinstance(name, str) and (name in SCENES or is_own(name)):
        return name
    return STANDARD


def scene_said(scene: object) -> tuple[str, dict[str, Any]]:
    """Return the name of a scene that a program has given, and the keys of its block.

    A name MODULE:CLASS counts as said: its code may run.

    Parameters
    ----------
    scene : str or Scene

    Raises
    ------
    ArgumentError
        If it is neither.
    """
    if not isinstance(scene, str):
        return handed_over(scene, SCENES)
    if is_own(scene):
        say(scene)
    return scene, {}


def is_printed(content: Mapping[str, Any]) -> bool:
    """Tell whether a configuration asks for the dissertation's methods as printed."""
    return content.get("printed") is True


def _with_defaults(value: Any, schema: dict[str, Any], *, printed: bool) -> Any:
    """Copy `value` into plain types, adding the defaults of missing keys."""
    if value is None and schema.get("default") == {}:
        # All of its keys are commented out.
        return _section_with_defaults({}, schema, printed=printed)
    if isinstance(value, Mapping):
        return _section_with_defaults(value, schema, printed=printed)
    if isinstance(value, list | tuple):
        items = schema.get("items", {})
        return [_with_defaults(entry, items, printed=printed) for entry in value]
    return _as_number(value, schema.get("type", ()))


def _section_with_defaults(
    section: Mapping[Any, Any], schema: dict[str, Any], *, printed: bool
) -> dict[Any, Any]:
    properties = schema.get("properties", {})
    filled = {}
    for key, value in section.items():
        filled[key] = _with_defaults(value, properties.get(key, {}), printed=printed)
    for key, inner in properties.items():
        if key not in filled and "default" in inner:
            default = deepcopy(default_of(inner, printed=printed))
            filled[key] = _with_defaults(default, inner, printed=printed)
    return filled


def what_is_set(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of a whole configuration that differ from their defaults.

    `load_config` makes the whole configuration of them again.

    Parameters
    ----------
    config : mapping
        A configuration from `load_config`.
    """
    scene = _scene_of(config)
    try:
        schema = load_schema(scene)
    except ConfigError:
        if not is_own(scene):
            raise
        # Its code may not run, or is elsewhere: all its parameters count as set.
        schema = load_schema()
    return _section_without_defaults(config, schema, printed=is_printed(config))


def _section_without_defaults(
    section: Mapping[str, Any], schema: dict[str, Any], *, printed: bool
) -> dict[str, Any]:
    properties = schema.get("properties", {})
    kept = {}
    for key, value in section.items():
        inner = properties.get(key, {})
        if "default" in inner:
            default = deepcopy(default_of(inner, printed=printed))
            if value == _with_defaults(default, inner, printed=printed):
                continue
        kept[key] = _without_defaults(value, inner, printed=printed)
    return kept


def _without_defaults(value: Any, schema: dict[str, Any], *, printed: bool) -> Any:
    if isinstance(value, Mapping):
        return _section_without_defaults(value, schema, printed=printed)
    if isinstance(value, list):
        items = schema.get("items", {})
        return [_without_defaults(entry, items, printed=printed) for entry in value]
    return value


_POWER_OF_TEN = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")


def _as_number(value: Any, types: str | list[str]) -> Any:
    """Return a number where YAML, or the schema, means one by another type."""
    # YAML 1.1 reads 1e-3 as text, 1.0e-3 as a number.
    is_power = isinstance(value, str) and _POWER_OF_TEN.fullmatch(value)
    if is_power and "number" in types:
        return float(value)
    # The schema accepts 1000.0 as a whole number, Python does not.
    is_whole = isinstance(value, float) and value.is_integer()
    if is_whole and "integer" in types and "number" not in types:
        return int(value)
    return value


def _schema_mistakes(config: dict[str, Any], schema: dict[str, Any]) -> list[str]:
    """Return violations of the schema, and numbers that are not finite."""
    from jsonschema import Draft202012Validator

    mistakes = describe(Draft202012Validator(schema).iter_errors(config), schema)
    for path, value in _leaves(config):
        if isinstance(value, float) and not isfinite(value):
            mistakes.append(f"{dotted(path)}: expected a finite number, found {value}")
    return mistakes


def _leaves(value: Any, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
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
    n_hidden = len(mistakes) - len(shown)
    if n_hidden:
        plural = "s" if n_hidden > 1 else ""
        lines.append(f"{place}: and {n_hidden} more mistake{plural}")
    raise ConfigError(*lines)
