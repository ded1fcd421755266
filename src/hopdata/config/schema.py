"""Schema of the configuration as a plain dict, and its descriptions in words."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from copy import deepcopy
from dataclasses import fields
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, cast

import yaml

from hopdata import products
from hopdata.errors import did_you_mean, require
from hopdata.foreign.working_folder import is_own
from hopdata.scenes import SCENES, STANDARD, blamed_scene, scene_class

if TYPE_CHECKING:
    from jsonschema import ValidationError

SCHEMA_FILE = Path(__file__).with_name("schema.yaml")

#: Annotation of a key: its value in a study with ``printed: true``.
PRINTED = "x-printed"

_TYPES = {
    "number": "a number",
    "integer": "a whole number",
    "string": "text",
    "null": "null",
    "boolean": "true or false",
    "array": "a list",
    "object": "keys with values",
}
_BOUNDS = {
    "exclusiveMinimum": "above {}",
    "minimum": "at least {}",
    "exclusiveMaximum": "below {}",
    "maximum": "at most {}",
}


def load_schema(scene: str = STANDARD) -> dict[str, Any]:
    """Return the JSON schema with the keys of a scene; do not modify it."""
    if is_own(scene):
        # Its class may be another one the next time, in a notebook.
        return _schema_with(scene)
    return _known_schema(scene)


@cache
def _known_schema(scene: str) -> dict[str, Any]:
    return _schema_with(scene)


def _schema_with(scene: str) -> dict[str, Any]:
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    text = SCHEMA_FILE.read_text(encoding="utf-8")
    schema: dict[str, Any] = yaml.load(text, Loader=loader)
    _take_choices(schema)
    for product in products.installed():
        with product.blamed():
            schema["properties"] |= product.block()
    simulation = schema["properties"]["simulation"]["properties"]
    if scene != STANDARD:
        del simulation[STANDARD]
        with blamed_scene(scene):
            simulation[scene] = _scene_block(scene)
    if is_own(scene):
        simulation["scene"]["enum"].append(scene)
    return schema


def _take_choices(schema: dict[str, Any]) -> None:
    """Replace ``enum: module:TABLE`` in the schema by the names of that table."""
    for key, inner in schema.items():
        if key == "enum" and isinstance(inner, str):
            schema[key] = list(resolve_name(inner))
        elif isinstance(inner, dict):
            _take_choices(inner)


_KINDS = {int: "integer", float: "number"}


def _scene_block(name: str) -> dict[str, Any]:
    """Return the schema of a scene's parameters, as declared by its dataclass."""
    parameters = scene_class(name)
    bare = [one.name for one in fields(parameters) if type(one.default) not in _KINDS]
    wanted = "a number as default of each parameter"
    require(not bare, f"scene {name}", wanted, ", ".join(bare))
    keys = {}
    for one in fields(parameters):
        kind = _KINDS[type(one.default)]
        keys[one.name] = {"type": kind, "default": one.default, **one.metadata}
    summary = str(parameters.__doc__).split("\n\n")[0]
    return {
        "description": " ".join(summary.split()),
        "type": "object",
        "additionalProperties": False,
        "default": {},
        "properties": keys,
    }


def default_of(schema: dict[str, Any], *, printed: bool) -> Any:
    """Return the value of a key that a configuration leaves out.

    Parameters
    ----------
    schema : dict
        Schema of the key, with a default.
    printed : bool
        Whether the configuration says ``printed: true``. A key with ``x-printed`` then
        takes that value; others have no printed variant, and keep their default.
    """
    if printed and PRINTED in schema:
        return schema[PRINTED]
    return schema["default"]


def printed_keys(
    schema: dict[str, Any] | None = None, place: str = ""
) -> dict[str, Any]:
    """Return the keys that ``printed: true`` sets, by dotted path, with their values.

    Parameters
    ----------
    schema : dict, optional
        The JSON schema; by default that of the configuration, with its products.
    place : str
        Path of the section that the schema describes.
    """
    if schema is None:
        schema = load_schema()
    found = {}
    for key, inner in schema.get("properties", {}).items():
        path = _join(place, key)
        if PRINTED in inner:
            found[path] = inner[PRINTED]
        found |= printed_keys(inner, path)
    return found


def in_words(schema: dict[str, Any]) -> str:
    """Describe a valid value, such as ``"a number above 0 and at most 1, or null"``.

    Parameters
    ----------
    schema : dict
        Schema of one key.
    """
    if "enum" in schema:
        words = "one of " + ", ".join(f"'{choice}'" for choice in schema["enum"])
        return words + schema.get("x-also", "")
    types = _types_of(schema, otherwise="object")
    words = " or ".join(_TYPES[kind] for kind in types if kind != "null")
    words += _items_in_words(schema)
    bounds = [
        text.format(f"{schema[key]:.12g}")
        for key, text in _BOUNDS.items()
        if key in schema
    ]
    if bounds:
        words += " " + " and ".join(bounds)
    if "x-pattern" in schema:
        words += f" ({schema['x-pattern']})"
    if "null" in types:
        words += ", or null"
    return words


def _types_of(schema: dict[str, Any], *, otherwise: str | None = None) -> list[str]:
    """Return the types of a value, of which a schema gives one or a list."""
    types = schema.get("type", otherwise)
    if types is None:
        return []
    if isinstance(types, str):
        return [types]
    return list(types)


def _items_in_words(schema: dict[str, Any]) -> str:
    """Describe how many entries a list has, and of what kind."""
    if schema.get("type") != "array":
        return ""
    least = schema.get("minItems", 0)
    most = schema.get("maxItems")
    items = schema.get("items", {})
    if items.get("type") == "string":
        kind = "names"
    elif items.get("type") == "number":
        kind = "numbers"
    else:
        kind = "entries"
    if least == most:
        words = f" of {least} {kind}"
    elif most:
        words = f" of {least} to {most} {kind}"
    elif least == 1 and kind == "entries":
        words = " of at least 1 entry"
    elif least:
        words = f" of at least {least} {kind}"
    else:
        words = f" of {kind}"
    if "enum" in items:
        words += f", each {in_words(items)}"
    return words


# Documentation page generated from the schema.

HEAD = "| key | meaning | unit | default | value |\n|---|---|---|---|---|\n"


def configuration_page(schema: dict[str, Any] | None = None) -> str:
    """Write the Markdown page that lists all keys.

    Parameters
    ----------
    schema : dict, optional
        The JSON schema; by default that of the configuration.

    Returns
    -------
    str
        Markdown with a table for each section.
    """
    if schema is None:
        schema = _schema_of_all_scenes()
    rows = [
        _row(key, inner, key in schema["required"])
        for key, inner in schema["properties"].items()
        if not _has_table(inner)
    ]
    parts = [schema["description"], HEAD + "".join(rows)]
    for key, section in schema["properties"].items():
        if _has_table(section):
            parts += _sections(key, section)
    return "\n".join(parts)


def _schema_of_all_scenes() -> dict[str, Any]:
    schema = deepcopy(load_schema())
    simulation = schema["properties"]["simulation"]["properties"]
    for name in SCENES:
        if name != STANDARD:
            simulation[name] = _scene_block(name)
    return schema


def _has_table(schema: dict[str, Any]) -> bool:
    return _is_section(schema) or "items" in schema


def _sections(path: str, section: dict[str, Any]) -> Iterator[str]:
    """Yield a table for this section, then one for each section within it."""
    inner = section.get("items", section)
    heading = f"{path}[]" if "items" in section else path
    yield f"## `{heading}`\n\n{section['description']}\n"
    required = inner.get("required", ())
    rows = [
        _row(key, value, key in required)
        for key, value in inner["properties"].items()
        if not _is_section(value)
    ]
    if rows:
        yield HEAD + "".join(rows)
    for key, deeper in inner["properties"].items():
        if _is_section(deeper):
            yield from _sections(f"{heading}.{key}", deeper)


def _row(key: str, schema: dict[str, Any], required: bool) -> str:
    default = f"`{json.dumps(schema.get('default'))}`"
    if required:
        default = "required"
    if PRINTED in schema:
        default += f"; if `printed`: `{json.dumps(schema[PRINTED])}`"
    cells = [
        f"`{key}`",
        schema["description"],
        schema.get("x-unit", ""),
        default,
        in_words(schema),
    ]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def _is_section(schema: dict[str, Any]) -> bool:
    return "object" in (schema.get("type"), schema.get("items", {}).get("type"))


# What a user probably meant by a value that the schema rejects.

_WITH_UNIT = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s.].*)")
_OTHER_LENGTHS = {"cm", "dm", "km", "um", "in", "inch", "ft"}
QUOTE_TRUTHS = "; yes, no, on and off are true and false unless they are in quotes"
_COMMA = re.compile(r"[-+]?\d+,\d+")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def hint(value: Any, schema: dict[str, Any]) -> str:
    """Return advice on how to write the value, to end a message; empty without any.

    Parameters
    ----------
    value : any
        Value in the file.
    schema : dict
        Schema of the value's key.
    """
    types = _types_of(schema)
    if isinstance(value, bool) and ("enum" in schema or "string" in types):
        return QUOTE_TRUTHS
    if "enum" in schema:
        return _of_choice(value, [str(choice) for choice in schema["enum"]])
    if "array" in types:
        return _of_list(value, schema)
    if "number" in types or "integer" in types:
        return _of_number(value, schema)
    # A name that YAML reads as something else, such as a number or a date.
    is_misread = value is not None and not isinstance(value, str | list | dict)
    if is_misread and "string" in types:
        return "; put it in quotes, as it is to be read"
    return ""


def _of_choice(value: Any, choices: list[str]) -> str:
    if not isinstance(value, str):
        return ""
    if {"mm", "m"} <= set(choices) and value.lower() in _OTHER_LENGTHS:
        return "; export in mm or m"
    return did_you_mean(value.lower(), choices)


def _of_list(value: Any, schema: dict[str, Any]) -> str:
    if isinstance(value, dict):
        return "; begin each entry with '- '"
    if not isinstance(value, str):
        return ""
    items = schema.get("items", {})
    if items.get("type") == "object":
        first = next(iter(items.get("properties", {"name": None})))
        return f"; write each entry in a line of its own, such as '- {first}: ...'"
    return f"; write [{value}]"


def _of_number(value: Any, schema: dict[str, Any]) -> str:
    """Handle percent, a unit after the number, and a decimal comma."""
    if isinstance(value, str):
        return _of_number_as_text(value, schema)
    if not isinstance(value, int | float) or isinstance(value, bool):
        return ""
    most = schema.get("maximum", float("inf"))
    is_share = "x-unit" not in schema and most <= 1 and schema.get("minimum", 0) >= 0
    # A division of a whole number of 400 digits would overflow.
    if is_share and 2 <= value <= 100 * most:
        return _as_share(float(value))
    return ""


def _of_number_as_text(value: str, schema: dict[str, Any]) -> str:
    if _COMMA.fullmatch(value):
        return f"; write {value.replace(',', '.')}, with a point"
    number_and_unit = _WITH_UNIT.fullmatch(value)
    if number_and_unit is None:
        return ""
    number, written_unit = number_and_unit.groups()
    if written_unit == "%":
        return _as_share(float(number))
    unit = schema.get("x-unit")
    if unit:
        return f"; write the number alone, in {unit}"
    return "; write the number alone"


def _as_share(percent: float) -> str:
    return f"; write {percent / 100:g} for {percent:g} %"


# Turn a violation of the schema into a message that a user can act on.

#: Similarity of two keys from which a neighbour is meant, not the same key elsewhere.
#: Unit: 1 (the ratio of `difflib`). Origin: chosen.
SURE = 0.8

_OF_VALUE = {"type", "enum", "minItems", "maxItems", "pattern", "minLength", *_BOUNDS}


def dotted(path: Iterable[str | int]) -> str:
    """Write a key path as a user would: ``recordings[0].file``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text = _join(text, str(part))
    return text


def describe(errors: Iterable[ValidationError], schema: dict[str, Any]) -> list[str]:
    """Return one line for each mistake: key, what was expected, what was found.

    Parameters
    ----------
    errors : iterable of ValidationError
        Violations of the schema.
    schema : dict
        The whole schema, in which unknown keys are searched for.
    """
    lines = [line for error in errors for line in _lines(error, schema)]
    # Without repeated lines: 3.5 violates both type and range of a whole number.
    return list(dict.fromkeys(lines))


def _lines(error: ValidationError, schema: dict[str, Any]) -> list[str]:
    place = dotted(error.absolute_path)
    violated = cast("dict[str, Any]", error.schema)
    if error.validator in _OF_VALUE:
        line = f"{place}: expected {in_words(violated)}, found {found(error.instance)}"
        return [line + hint(error.instance, violated)]
    if error.validator == "uniqueItems":
        return [f"{place}: expected each entry once, found {found(error.instance)}"]
    if error.validator not in ("additionalProperties", "required"):
        return [f"{place}: {error.message}"]
    known = list(violated["properties"])
    present = [str(key) for key in cast("dict[str, Any]", error.instance)]
    unknown = [key for key in present if key not in known]
    if error.validator == "additionalProperties":
        return [_unknown_key(key, place, known, schema) for key in unknown]
    missing = [key for key in violated["required"] if key not in present]
    return [
        f"{_join(place, key)}: expected this key, found none"
        for key in missing
        if not did_you_mean(key, unknown)  # misspelt: reported already
    ]


def found(value: Any) -> str:
    """Show a value as it stands in the file, shortened."""
    if value is None:
        return "null (nothing)"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        shown = f"'{value[:60]}'"
        if _NUMBER.fullmatch(value):
            shown += " (text; write it without quotes)"
        return shown
    if isinstance(value, dict):
        keys = [str(key) for key in value]
        return f"keys with values ({', '.join(keys[:4])})"
    if isinstance(value, list):
        if not value:
            return "none"
        entries = [str(entry) for entry in value[:4]]
        if len(value) > 4:
            entries.append("...")
        return f"{len(value)} ({', '.join(entries)})"
    return str(value)


#: Keys that were removed, by their whole name, and what to do instead.
REMOVED = {
    "sections.tail_fraction": (
        "this key was removed: sections are now chosen from landings, "
        "not from tails of frames (see sections.rule); delete the line"
    ),
    "input.most_unpacked_mb": (
        "this key was removed: what a file may unpack to now follows from its size and "
        "the free memory; delete the line"
    ),
}


def _unknown_key(
    key: str, place: str, known: Sequence[str], schema: dict[str, Any]
) -> str:
    whole = _join(place, key)
    message = f"{whole}: expected a known key, found '{key}'"
    if whole in REMOVED:
        return f"{message}; {REMOVED[whole]}"
    if not place and products.is_missing(key):
        not_here = "a part of hopdata that is not installed"
        how = f"run pip install 'hopdata[{key}]', or delete the block"
        return f"{message}, {not_here}; {how}"
    if place == "simulation" and key in SCENES:
        return f"{message}; write 'scene: {key}' to simulate it"
    section, _, inner = key.partition(".")
    if inner and section in known:
        line = f"'{section}:' and, indented in the next line, '{inner}:'"
        return f"{message}; write {line}"
    near = did_you_mean(key, known)
    if not get_close_matches(key, known, n=1, cutoff=SURE):
        elsewhere = _elsewhere(key, place, schema)
        if elsewhere:
            near = f"; did you mean '{elsewhere}'?"
    return message + (near or f"; the keys here are {', '.join(known)}")


def _elsewhere(key: str, place: str, schema: dict[str, Any]) -> str:
    """Find the key in another section, preferably below `place`."""
    paths = [path for path in _paths(schema) if path.rpartition(".")[2] == key]
    for path in paths:
        if place and path.startswith(f"{place}."):
            return path
    return paths[0] if paths else ""


def _paths(schema: dict[str, Any], place: str = "") -> Iterator[str]:
    for key, inner in schema.get("properties", {}).items():
        path = _join(place, key)
        yield path
        yield from _paths(inner, path)


def _join(place: str, key: str) -> str:
    return f"{place}.{key}" if place else key
