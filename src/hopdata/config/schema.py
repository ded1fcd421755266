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
from hopdata.scenes import SCENES, STANDARD, scene_class

if TYPE_CHECKING:
    from jsonschema import ValidationError

SCHEMA_FILE = Path(__file__).with_name("schema.yaml")

_TYPES = {
    "number": "a number", "integer": "a whole number", "string": "text", "null": "null",
    "boolean": "true or false", "array": "a list", "object": "keys with values",
}  # fmt: skip
_BOUNDS = {
    "exclusiveMinimum": "above {}", "minimum": "at least {}",
    "exclusiveMaximum": "below {}", "maximum": "at most {}",
}  # fmt: skip


@cache
def load_schema(scene: str = STANDARD) -> dict[str, Any]:
    """Return the JSON schema of the configuration with a scene's keys; do not modify it."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    schema: dict[str, Any] = yaml.load(
        SCHEMA_FILE.read_text(encoding="utf-8"), Loader=loader
    )
    _take_choices(schema)
    for product in products.installed():
        schema["properties"] |= product.block()
    simulation = schema["properties"]["simulation"]["properties"]
    if scene != STANDARD:
        del simulation[STANDARD]
        simulation[scene] = _scene_block(scene)
    return schema


def _take_choices(schema: dict[str, Any]) -> None:
    """Replace ``enum: module:TABLE`` in the schema by the names of that table."""
    for key, inner in schema.items():
        if key == "enum" and isinstance(inner, str):
            schema[key] = list(resolve_name(inner))
        elif isinstance(inner, dict):
            _take_choices(inner)


def _scene_block(name: str) -> dict[str, Any]:
    """Return the schema of a scene's parameters, as declared by its dataclass."""
    kind = scene_class(name)
    bare = [one.name for one in fields(kind) if type(one.default) not in _KINDS]
    require(
        not bare,
        f"scene {name}",
        "a number as default of each parameter",
        ", ".join(bare),
    )
    keys = {
        one.name: {
            "type": _KINDS[type(one.default)],
            "default": one.default,
            **one.metadata,
        }
        for one in fields(kind)
    }
    description = " ".join(str(kind.__doc__).split("\n\n")[0].split())
    return {
        "description": description, "type": "object", "additionalProperties": False,
        "default": {}, "properties": keys,
    }  # fmt: skip


_KINDS = {int: "integer", float: "number"}


def in_words(schema: dict[str, Any]) -> str:
    """Describe a valid value, for example ``"a number above 0 and at most 1, or null"``.

    Parameters
    ----------
    schema : dict
        Schema of one key.
    """
    if "enum" in schema:
        return "one of " + ", ".join(f"'{choice}'" for choice in schema["enum"])
    types = schema.get("type", "object")
    types = [types] if isinstance(types, str) else list(types)
    words = " or ".join(_TYPES[t] for t in types if t != "null")
    words += _items_in_words(schema)
    bounds = [
        text.format(f"{schema[key]:.12g}")
        for key, text in _BOUNDS.items()
        if key in schema
    ]
    words += " " * bool(bounds) + " and ".join(bounds)
    words += f" ({schema['x-pattern']})" if "x-pattern" in schema else ""
    return words + (", or null" if "null" in types else "")


def _items_in_words(schema: dict[str, Any]) -> str:
    """Describe how many entries a list has, and of what kind."""
    if schema.get("type") != "array":
        return ""
    least, most = schema.get("minItems", 0), schema.get("maxItems")
    number = f"{least} to {most}" if most else f"at least {least}"
    words = " of " + (
        f"{least} " if least == most else f"{number} " if least or most else ""
    )
    items = schema.get("items", {})
    kind = {"string": "names", "number": "numbers"}.get(
        str(items.get("type")), "entries"
    )
    if number == "at least 1" and kind == "entries":
        kind = "entry"
    return words + kind + (f", each {in_words(items)}" if "enum" in items else "")


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
        schema = deepcopy(load_schema())
        others = {name: _scene_block(name) for name in SCENES if name != STANDARD}
        schema["properties"]["simulation"]["properties"] |= others
    single = {k: s for k, s in schema["properties"].items() if not _is_section(s)}
    rows = [
        _row(k, s, k in schema["required"])
        for k, s in single.items()
        if "items" not in s
    ]
    parts = [schema["description"], HEAD + "".join(rows)]
    for key, section in schema["properties"].items():
        if _is_section(section) or "items" in section:
            parts += _sections(key, section)
    return "\n".join(parts)


def _sections(path: str, section: dict[str, Any]) -> Iterator[str]:
    """Yield a table for this section, then one for each section within it."""
    inner = section.get("items", section)
    heading = f"{path}[]" if "items" in section else path
    yield f"## `{heading}`\n\n{section['description']}\n"
    keys = {k: s for k, s in inner["properties"].items() if not _is_section(s)}
    if keys:
        yield HEAD + "".join(
            _row(k, s, k in inner.get("required", ())) for k, s in keys.items()
        )
    for key, deeper in inner["properties"].items():
        if _is_section(deeper):
            yield from _sections(f"{heading}.{key}", deeper)


def _row(key: str, schema: dict[str, Any], required: bool) -> str:
    default = "required" if required else f"`{json.dumps(schema.get('default'))}`"
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
    """Return advice on how to write the value, to end a message; empty if there is none.

    Parameters
    ----------
    value : any
        Value in the file.
    schema : dict
        Schema of the value's key.
    """
    kinds = schema.get("type", ())
    kinds = [kinds] if isinstance(kinds, str) else list(kinds)
    if isinstance(value, bool) and ("enum" in schema or "string" in kinds):
        return QUOTE_TRUTHS
    if "enum" in schema:
        return _of_choice(value, [str(choice) for choice in schema["enum"]])
    if "array" in kinds:
        return _of_list(value, schema)
    if {"number", "integer"} & set(kinds):
        return _of_number(value, schema)
    is_slip = (
        not isinstance(value, str | list | dict) and value is not None
    )  # a YAML misreading
    return (
        "; put it in quotes, as it is to be read"
        if is_slip and "string" in kinds
        else ""
    )


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
    if schema.get("items", {}).get("type") == "object":
        first = next(iter(schema["items"].get("properties", {"name": None})))
        return f"; write each entry in a line of its own, such as '- {first}: ...'"
    return f"; write [{value}]"


def _of_number(value: Any, schema: dict[str, Any]) -> str:
    """Handle percent, a unit after the number, and a decimal comma."""
    if isinstance(value, str):
        if _COMMA.fullmatch(value):
            return f"; write {value.replace(',', '.')}, with a point"
        found = _WITH_UNIT.fullmatch(value)
        if found and found.group(2) == "%":
            return _as_share(float(found.group(1)))
        unit = schema.get("x-unit")
        return (
            f"; write the number alone{f', in {unit}' if unit else ''}" if found else ""
        )
    if not isinstance(value, int | float) or isinstance(value, bool):
        return ""
    most = schema.get("maximum", float("inf"))
    is_share = "x-unit" not in schema and most <= 1 and schema.get("minimum", 0) >= 0
    return (
        _as_share(float(value))
        if is_share and value >= 2 and value / 100 <= most
        else ""
    )


def _as_share(percent: float) -> str:
    return f"; write {percent / 100:g} for {percent:g} %"


# Turn a violation of the schema into a message that a user can act on.

SURE = (
    0.8  # similarity from which a neighbour is meant rather than the same key elsewhere
)
_OF_VALUE = {"type", "enum", "minItems", "maxItems", "pattern", "minLength", *_BOUNDS}


def dotted(path: Iterable[str | int]) -> str:
    """Write a key path as a user would: ``recordings[0].file``."""
    text = ""
    for part in path:
        text += (
            f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
        )
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
    # Drop duplicate lines: 3.5 violates both type and range of a whole number.
    return list(
        dict.fromkeys(line for error in errors for line in _lines(error, schema))
    )


def _lines(error: ValidationError, schema: dict[str, Any]) -> list[str]:
    place, local = dotted(error.absolute_path), cast("dict[str, Any]", error.schema)
    if error.validator in _OF_VALUE:
        told = f"{place}: expected {in_words(local)}, found {found(error.instance)}"
        return [told + hint(error.instance, local)]
    if error.validator == "uniqueItems":
        return [f"{place}: expected each entry once, found {found(error.instance)}"]
    if error.validator not in ("additionalProperties", "required"):
        return [f"{place}: {error.message}"]
    known = list(local["properties"])
    present = [str(key) for key in cast("dict[str, Any]", error.instance)]
    unknown = [key for key in present if key not in known]
    if error.validator == "additionalProperties":
        return [_unknown_key(key, place, known, schema) for key in unknown]
    return [
        f"{_join(place, key)}: expected this key, found none"
        for key in local["required"]
        if key not in present
        and not did_you_mean(key, unknown)  # misspelt: reported already
    ]


def found(value: Any) -> str:
    """Show a value as it stands in the file, shortened."""
    if value is None:
        return "null (nothing)"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        told = " (text; write it without quotes)" if _NUMBER.fullmatch(value) else ""
        return f"'{value[:60]}'{told}"
    if isinstance(value, dict):
        return "keys with values (" + ", ".join(map(str, list(value)[:4])) + ")"
    if isinstance(value, list):
        shown = ", ".join(str(entry) for entry in value[:4])
        return (
            f"{len(value)} ({shown}{', ...' if len(value) > 4 else ''})"
            if value
            else "none"
        )
    return str(value)


#: Keys that were removed, by their whole name, and what to do instead.
REMOVED = {
    "sections.tail_fraction": (
        "this key was removed: sections are now chosen from landings, not from tails of frames "
        "(see sections.rule); delete the line"
    ),
}


def _unknown_key(
    key: str, place: str, known: Sequence[str], schema: dict[str, Any]
) -> str:
    whole = _join(place, key)
    if whole in REMOVED:
        return f"{whole}: expected a known key, found '{key}'; {REMOVED[whole]}"
    if not place and products.is_missing(key):
        return (
            f"{key}: expected a known key, found '{key}', a part of hopdata that is not "
            f"installed; run pip install 'hopdata[{key}]', or delete the block"
        )
    near = did_you_mean(key, known)
    if not get_close_matches(key, known, n=1, cutoff=SURE):
        elsewhere = _elsewhere(key, place, schema)
        near = f"; did you mean '{elsewhere}'?" if elsewhere else near
    section, _, inner = key.partition(".")
    if inner and section in known:
        near = f"; write '{section}:' and, indented in the next line, '{inner}:'"
    if place == "simulation" and key in SCENES:
        near = f"; write 'scene: {key}' to simulate it"
    near = near or f"; the keys here are {', '.join(known)}"
    return f"{_join(place, key)}: expected a known key, found '{key}'{near}"


def _elsewhere(key: str, place: str, schema: dict[str, Any]) -> str:
    """Find the key in another section, preferably below `place`."""
    paths = [path for path in _paths(schema) if path.rpartition(".")[2] == key]
    below = [path for path in paths if place and path.startswith(f"{place}.")]
    return next(iter([*below, *paths]), "")


def _paths(schema: dict[str, Any], place: str = "") -> Iterator[str]:
    for key, inner in schema.get("properties", {}).items():
        yield _join(place, key)
        yield from _paths(inner, _join(place, key))


def _join(place: str, key: str) -> str:
    return f"{place}.{key}" if place else key
