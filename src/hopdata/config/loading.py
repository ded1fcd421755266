"""Load a configuration: read it, fill in defaults, check the schema and consistency."""

import re
from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from math import isfinite
from pathlib import Path
from typing import Any

import yaml

from hopdata import products
from hopdata.config.consistency import CHECKS, missing_files, nearest_file
from hopdata.config.schema import describe, dotted, load_schema
from hopdata.errors import ConfigError
from hopdata.scenes import SCENES, STANDARD

# Line numbers of the keys of a configuration file.

MOST_DEPTH = 50  # a file that contains itself has no end


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
    key, _, told = mistake.partition(": expected")
    if told.startswith(" this key,"):
        return otherwise
    for file in reversed(list(files)):
        if line := key_lines(file).get(key):
            return f"{file}, line {line}"
    return otherwise


def key_lines(file: str | Path) -> dict[str, int]:
    """Return the line, from 1, of each key and entry of a YAML file, by dotted path."""
    try:
        root = yaml.compose(Path(file).read_text(encoding="utf-8"), yaml.SafeLoader)
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return {}
    return {dotted(path): line for path, line in _lines(root, ())} if root else {}


def _lines(
    node: Any, path: tuple[str | int, ...]
) -> Iterator[tuple[tuple[str | int, ...], int]]:
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


# YAML as written by users: a duplicate key is a mistake, not a choice.

MOST_ENTRIES = 100_000


def read_yaml(path: str | Path) -> Any:
    """Read a YAML file.

    Raises
    ------
    ConfigError
        If the file cannot be read, is not YAML, has a duplicate key, or has aliases
        that would expand to more than `MOST_ENTRIES`.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        near = nearest_file(path) if isinstance(error, FileNotFoundError) else ""
        told = f"{error.strerror or error}{near}"
        raise ConfigError(
            f"{path}: expected a readable configuration, found: {told}"
        ) from None
    except UnicodeDecodeError:
        raise ConfigError.at(
            path, "YAML in UTF-8", "other bytes (a recording? use init)"
        ) from None
    try:
        loader = _StrictLoader(text)
        node = loader.get_single_node()
        if node is None:
            return None
        if (size := _expanded(node, {})) > MOST_ENTRIES:
            once = "once the aliases (*name) stand for what they repeat; write out what is needed"
            raise ConfigError.at(
                path, f"at most {MOST_ENTRIES} entries", f"{size} {once}"
            )
        return loader.construct_document(node)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        hint = _hint(error.problem, text[mark.index : mark.index + 1] if mark else "")
        raise ConfigError(
            f"{path}{where}: expected YAML, found: {error.problem}{hint}"
        ) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: expected YAML, found: {error}") from None


def _expanded(node: Any, known: dict[int, int]) -> int:
    """Count the entries of a node with aliases expanded, visiting each node once."""
    if id(node) not in known:
        known[id(node)] = 0  # recursive nodes are refused elsewhere
        inner = node.value if isinstance(node.value, list) else []
        parts = [
            part
            for entry in inner
            for part in (entry if isinstance(entry, tuple) else [entry])
        ]
        known[id(node)] = 1 + sum(_expanded(part, known) for part in parts)
    return known[id(node)]


def _hint(problem: str | None, character: str) -> str:
    """Return the usual cause of the YAML parser's message about this character."""
    problem = problem or ""
    if "':'" in problem or "mapping values" in problem:
        return "; is there a space behind each colon, also in the line above?"
    if "\\t" in problem or "\t" in problem or character == "\t":
        return "; indent with spaces, not with tabs"
    return ""


class _StrictLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Safe loader that refuses duplicate keys; by default the last one would win."""

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Make a value; PyYAML raises almost anything if a tag does not fit its text."""
        try:
            return super().construct_object(node, deep)
        except (yaml.YAMLError, RecursionError):
            raise
        except Exception:
            kind = node.tag.removeprefix("tag:yaml.org,2002:")
            problem = f"a value that is no {kind}"
            raise yaml.constructor.ConstructorError(
                None, None, problem, node.start_mark
            ) from None

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        seen = set()
        for key_node, _ in node.value:
            key = str(key_node.value)
            if key in seen and key != "<<":
                raise yaml.constructor.ConstructorError(
                    None,
                    None,
                    f"the key '{key}' twice in one place",
                    key_node.start_mark,
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


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
        raise ConfigError.at(
            place, "keys with values, as 'hopdata init' writes them", kind
        )
    schema = load_schema(_scene_of(content))
    try:
        config: dict[str, Any] = _with_defaults(content, schema)
    except RecursionError:
        raise ConfigError.at(place, "a tree of keys", "one within itself") from None
    _raise_all(place, files, _schema_mistakes(config, schema))
    checks = [*CHECKS, missing_files] if check_files else CHECKS
    mistakes = [mistake for check in checks for mistake in check(config)]
    for product in products.installed():
        # A product is imported only for a configuration that speaks of it.
        if product.name in content:
            mistakes += product.mistakes(config)
    _raise_all(place, files, mistakes)
    return config


def check_keys(place: str, keys: Mapping[str, Any]) -> None:
    """Check sections of a configuration; raise a `ConfigError` that begins with `place`."""
    schema = {**load_schema(_scene_of(keys)), "required": []}
    _raise_all(place, [], _schema_mistakes(dict(keys), schema))


def _scene_of(content: Mapping[str, Any]) -> str:
    """Return the scene to be simulated; the standard one if no known scene is named."""
    simulation = content.get("simulation")
    name = (
        simulation.get("scene", STANDARD)
        if isinstance(simulation, Mapping)
        else STANDARD
    )
    return name if isinstance(name, str) and name in SCENES else STANDARD


def _with_defaults(value: Any, schema: dict[str, Any]) -> Any:
    """Copy `value` into plain types, adding the defaults of missing keys."""
    if value is None and schema.get("default") == {}:
        value = {}  # a section with all keys commented out
    if isinstance(value, Mapping):
        properties = schema.get("properties", {})
        filled = {
            key: _with_defaults(v, properties.get(key, {})) for key, v in value.items()
        }
        for key, inner in properties.items():
            if key not in filled and "default" in inner:
                filled[key] = _with_defaults(deepcopy(inner["default"]), inner)
        return filled
    if isinstance(value, list | tuple):
        return [_with_defaults(v, schema.get("items", {})) for v in value]
    if (
        isinstance(value, str)
        and "number" in schema.get("type", ())
        and _POWER.fullmatch(value)
    ):
        value = float(value)  # YAML 1.1 reads 1e-3 as text, 1.0e-3 as a number
    is_whole = "integer" in schema.get("type", ()) and "number" not in schema.get(
        "type", ()
    )
    # The schema accepts 1000.0 as a whole number, Python does not.
    return (
        int(value)
        if isinstance(value, float) and value.is_integer() and is_whole
        else value
    )


def _schema_mistakes(config: dict[str, Any], schema: dict[str, Any]) -> list[str]:
    """Return violations of the schema, and numbers that are not finite."""
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
    if more := len(mistakes) - len(shown):
        lines.append(f"{place}: and {more} more mistake" + ("s" if more > 1 else ""))
    raise ConfigError(*lines)
