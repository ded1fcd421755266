from dataclasses import make_dataclass
from pathlib import Path

import pytest

from hopdata.config import schema as schemas
from hopdata.config.schema import configuration_page, load_schema
from hopdata.errors import ConfigError

PAGE = Path(__file__).parents[2] / "docs/configuration.md"


def keys(schema):
    for key, inner in schema.get("properties", {}).items():
        yield key, inner
        yield from keys(inner.get("items", inner))


def test_the_page_is_up_to_date():
    assert PAGE.read_text(encoding="utf-8") == configuration_page(), (
        "run: hopdata config-docs --out docs/configuration.md"
    )


def test_every_key_stands_on_the_page_with_its_meaning():
    page = configuration_page()
    for key, schema in keys(load_schema()):
        assert f"`{key}`" in page or f".{key}`" in page or f"{key}[]`" in page
        assert schema["description"].split("|")[0] in page


def test_a_row_tells_meaning_unit_default_and_range():
    row = next(
        line for line in configuration_page().splitlines() if "`rest_speed_m_s`" in line
    )
    assert "| m/s | `null` | a number above 0 and at most 10, or null |" in row


def test_a_new_key_appears_by_itself():
    key = {
        "type": "integer",
        "description": "Of note | and bar.",
        "default": 3,
        "maximum": 9,
    }
    section = {
        "type": "object",
        "description": "A section.",
        "properties": {"new_key": key},
    }
    page = configuration_page(
        {"description": "", "properties": {"part": section}, "required": []}
    )
    assert "## `part`\n\nA section.\n" in page
    assert (
        "| `new_key` | Of note \\| and bar. |  | `3` | a whole number at most 9 |"
        in page
    )


def test_a_scene_with_a_parameter_without_a_default_is_named_with_it(monkeypatch):
    bare = make_dataclass("Bare", [("mass_kg", float), ("legs", int, 2)])
    monkeypatch.setattr(schemas, "scene_class", lambda _name: bare)
    with pytest.raises(ConfigError, match=r"scene bare: .* default .*, found mass_kg$"):
        load_schema("bare")
