"""Templates: where they are, and how they are filled in."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).with_name("templates")


def environment() -> Environment:
    """Return where templates come from and how they are filled in."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(TEMPLATES),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def as_yaml(config: Any) -> str:
    """Write a configuration as YAML; nothing for none."""
    import yaml

    return yaml.safe_dump(config, sort_keys=False, allow_unicode=True) if config else ""
