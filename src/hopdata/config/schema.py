"""The schema of the configuration, as a plain dict, and what it says in words."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

SCHEMA_FILE = Path(__file__).with_name("schema.yaml")

_TYPES = {
    "number": "a number",
    "integer": "a whole number",
    "string": "text",
    "boolean": "true or false",
    "array": "a list",
    "object": "keys with values",
    "null": "null",
}
_BOUNDS = {
    "exclusiveMinimum": "above {}",
    "minimum": "at least {}",
    "exclusiveMaximum": "below {}",
    "maximum": "at most {}",
}


@lru_cache(maxsize=1)
def load_schema() -> dict[str, Any]:
    """Return the JSON schema of the configuration; do not change it."""
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    schema: dict[str, Any] = yaml.load(SCHEMA_FILE.read_text(encoding="utf-8"), Loader=loader)
    return schema


def in_words(schema: dict[str, Any]) -> str:
    """Say what a value must be, for example ``"a number above 0 and at most 1, or null"``.

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
    bounds = [text.format(f"{schema[key]:.12g}") for key, text in _BOUNDS.items() if key in schema]
    if bounds:
        words += " " + " and ".join(bounds)
    if "x-pattern" in schema:
        words += f" ({schema['x-pattern']})"
    return words + (", or null" if "null" in types else "")


def _items_in_words(schema: dict[str, Any]) -> str:
    """Say how many entries a list has, and of what kind."""
    if schema.get("type") != "array":
        return ""
    least, most = schema.get("minItems", 0), schema.get("maxItems")
    number = f"{least} to {most}" if most else f"at least {least}"
    words = " of " + (f"{least} " if least == most else f"{number} " if least or most else "")
    items = schema.get("items", {})
    kind = {"string": "names", "number": "numbers"}.get(str(items.get("type")), "entries")
    if number == "at least 1" and kind == "entries":
        kind = "entry"
    choices = f", each {in_words(items)}" if "enum" in items else ""
    return words + kind + choices
