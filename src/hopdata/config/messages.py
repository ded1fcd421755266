"""From what the schema rejects to a line that a user can act on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, cast

from hopdata.config.hints import hint
from hopdata.config.schema import in_words
from hopdata.errors import did_you_mean

if TYPE_CHECKING:
    from jsonschema import ValidationError

SURE = 0.8  # similarity above which a neighbour is meant, rather than the same key elsewhere
_OF_VALUE = {
    "type",
    "enum",
    "minimum",
    "exclusiveMinimum",
    "maximum",
    "exclusiveMaximum",
    "minItems",
    "maxItems",
    "pattern",
    "minLength",
}


def dotted(path: Iterable[str | int]) -> str:
    """Write a key path as a user would: ``recordings[0].file``."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def describe(errors: Iterable[ValidationError], schema: dict[str, Any]) -> list[str]:
    """One line for each mistake: key, what was expected, what was found.

    Parameters
    ----------
    errors : iterable of ValidationError
        What the schema rejects.
    schema : dict
        The whole schema; an unknown key is looked for elsewhere in it.
    """
    lines = [line for error in errors for line in _lines(error, schema)]
    return list(dict.fromkeys(lines))  # 3.5 breaks both type and range of a whole number


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
        if key not in present and not did_you_mean(key, unknown)  # a misspelt key is told already
    ]


def found(value: Any) -> str:
    """Show a value as it stands in the file, shortened."""
    if value is None:
        return "null (nothing)"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f"'{value[:60]}'" + (" (text; write it without quotes)" if _is_number(value) else "")
    if isinstance(value, dict):
        return "keys with values (" + ", ".join(map(str, list(value)[:4])) + ")"
    if isinstance(value, list):
        shown = ", ".join(str(entry) for entry in value[:4])
        return f"{len(value)} ({shown}{', ...' if len(value) > 4 else ''})" if value else "none"
    return str(value)


def _unknown_key(key: str, place: str, known: Sequence[str], schema: dict[str, Any]) -> str:
    near = did_you_mean(key, known)
    if not get_close_matches(key, known, n=1, cutoff=SURE):
        elsewhere = _elsewhere(key, place, schema)
        near = f"; did you mean '{elsewhere}'?" if elsewhere else near
    section, _, inner = key.partition(".")
    if inner and section in known:
        near = f"; write '{section}:' and, indented in the next line, '{inner}:'"
    near = near or f"; the keys here are {', '.join(known)}"
    return f"{_join(place, key)}: expected a known key, found '{key}'{near}"


def _elsewhere(key: str, place: str, schema: dict[str, Any]) -> str:
    """Find the key in another section, preferably below `place`."""
    paths = [dotted(path) for path in _paths(schema) if path[-1] == key]
    below = [path for path in paths if place and path.startswith(f"{place}.")]
    return next(iter([*below, *paths]), "")


def _paths(schema: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for key, inner in schema.get("properties", {}).items():
        yield (*path, key)
        yield from _paths(inner, (*path, key))


def _join(place: str, key: str) -> str:
    return f"{place}.{key}" if place else key


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
