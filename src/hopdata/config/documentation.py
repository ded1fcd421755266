"""The page of documentation that the schema makes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from hopdata.config.schema import in_words, load_schema

INTRODUCTION = """\
# Configuration

A study is one YAML file, such as `config/config.yaml`. Keys that it leaves out take the defaults
below. `hopdata check FILE` tells whether a configuration and its recordings are sound.

This page is made from `src/hopdata/config/schema.yaml`; change it there, then run
`hopdata config-docs --out docs/configuration.md`.
"""
HEAD = "| key | meaning | unit | default | value |\n|---|---|---|---|---|\n"


def configuration_page(schema: dict[str, Any] | None = None) -> str:
    """Write the Markdown page on all keys.

    Parameters
    ----------
    schema : dict, optional
        The JSON schema; by default that of the configuration.

    Returns
    -------
    str
        Markdown, with a table for each section.
    """
    schema = load_schema() if schema is None else schema
    single = {k: s for k, s in schema["properties"].items() if not _is_section(s)}
    rows = [_row(k, s, k in schema["required"]) for k, s in single.items() if "items" not in s]
    parts = [INTRODUCTION, HEAD + "".join(rows)]
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
    required = inner.get("required", ())
    if keys:
        yield HEAD + "".join(_row(k, s, k in required) for k, s in keys.items())
    for key, deeper in inner["properties"].items():
        if _is_section(deeper):
            yield from _sections(f"{heading}.{key}", deeper)


def _row(key: str, schema: dict[str, Any], required: bool) -> str:
    default = "required" if required else f"`{json.dumps(schema.get('default'))}`"
    cells = [f"`{key}`", schema["description"], schema.get("x-unit", ""), default, in_words(schema)]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def _is_section(schema: dict[str, Any]) -> bool:
    entries = schema.get("items", {})
    return schema.get("type") == "object" or entries.get("type") == "object"
