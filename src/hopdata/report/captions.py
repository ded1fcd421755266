"""Captions: short texts beside the workflow, whose numbers are filled in from the tables."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hopdata.errors import ConfigError
from hopdata.report.formatting import NO_BREAK_SPACE

PERCENT = re.compile(r"(?<=\d) %")
SPACES = re.compile(r"[ \t\n]+")  # a no-break space between number and unit stays


@dataclass(frozen=True)
class Caption:
    """A caption ready to print: its title, its paragraphs and a text for those who cannot see."""

    title: str
    paragraphs: tuple[str, ...]
    alt: str


def render_caption(template: str, facts: Mapping[str, Any], *, name: str) -> Caption:
    """Fill in a caption.

    Parameters
    ----------
    template : str
        Jinja text: a line ``# Title``, then paragraphs; one that begins with ``Alt:`` describes
        the picture for those who cannot see it.
    facts : mapping
        As given by `hopdata.report.facts.study_facts`.
    name : str
        Name of the figure: the title and alternative text of a caption that has none, and the
        place in error messages.

    Raises
    ------
    ConfigError
        If the caption names a fact that does not exist, or is not valid Jinja.
    """
    from jinja2 import Environment, StrictUndefined, TemplateError

    environment = Environment(undefined=StrictUndefined, autoescape=False, trim_blocks=True)
    try:
        text = environment.from_string(template).render(facts)
    except TemplateError as error:
        raise ConfigError(f"caption of {name}: {error}") from error
    blocks = [_tidied(block) for block in text.split("\n\n") if block.strip()]
    titles = [block[1:].strip() for block in blocks if block.startswith("#")]
    alts = [block.removeprefix("Alt:").strip() for block in blocks if block.startswith("Alt:")]
    body = tuple(block for block in blocks if not block.startswith(("#", "Alt:")))
    title = titles[0] if titles else name
    return Caption(title=title, paragraphs=body, alt=alts[0] if alts else title)


def _tidied(block: str) -> str:
    """Make one line of a paragraph, in which no line break parts a number from its per cent."""
    return PERCENT.sub(f"{NO_BREAK_SPACE}%", SPACES.sub(" ", block).strip())
