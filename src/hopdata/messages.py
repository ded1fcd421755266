"""Messages as data: a code with its values, put into words by the templates of a room.

A room keeps its sentences in one file, ``<room>/messages.toml``: a template for each
name, with its values in braces as in `str.format`. A second language is a second file
beside it, such as ``messages.de.toml``; what it lacks is said in English. Nothing reads
a sentence to decide something: it compares codes.
"""

from __future__ import annotations

import math
import string
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parent
ENGLISH = "en"
# Ending of the templates for readers of a terminal.
IN_SHELL = "_in_shell"


# Size from which digits no longer stand for themselves, as in 1e+20.
_HUGE = 1e15


def without_exponent(value: float, digits: int = 2) -> str:
    """Write a number to some digits, as a reader would: 130 and not 1.3e+02."""
    return _WORDS.format_field(float(value), f".{digits}g")


class _Words(string.Formatter):
    """Puts values into templates, large numbers without an exponent."""

    def format_field(self, value: Any, format_spec: str) -> str:
        """Write one value."""
        text = str(super().format_field(value, format_spec))
        if format_spec.endswith("g") and "e+" in text and abs(value) < _HUGE:
            return f"{float(text):.0f}"
        return text


_WORDS = _Words()


@dataclass(frozen=True)
class Message:
    """Something to say.

    Attributes
    ----------
    code
        The room and the name of the template, such as ``"maps.too_few_landings"``.
    values
        The template's values: numbers, texts or other messages.
    """

    code: str
    values: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.text()

    def text(self, language: str = ENGLISH) -> str:
        """Return the message in words.

        Raises
        ------
        KeyError
            If no template has this code, or the template asks for a missing value.
        """
        words = {}
        for name, value in self.values.items():
            words[name] = value.text(language) if isinstance(value, Message) else value
        return _WORDS.vformat(_template(self.code, language), (), words)

    def to_dict(self) -> dict[str, Any]:
        """Return code, values and the English sentence, for JSON."""
        values = {}
        for name, value in self.values.items():
            values[name] = value.to_dict() if isinstance(value, Message) else value
        return {"code": self.code, "values": values, "text": self.text()}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Message:
        """Return the message of which `to_dict` made `content`."""
        values = {}
        for name, value in content["values"].items():
            is_message = isinstance(value, Mapping) and "code" in value
            values[name] = cls.from_dict(value) if is_message else value
        return cls(content["code"], values)


def in_per_cent(share: float) -> float:
    """Return a share in per cent as sentences, pages and figures show it.

    It has two digits or, from 100 % on, is whole: two digits would show an upper end of
    105 % as 100 %.
    """
    if abs(share) < 1.0:
        return float(f"{100.0 * share:.2g}")
    return float(f"{100.0 * share:.0f}")


def at_least_in_per_cent(share: float) -> float:
    """Return the low end of an interval, rounded down as by `in_per_cent`."""
    return -at_most_in_per_cent(-share)


def at_most_in_per_cent(share: float) -> float:
    """Return the high end of an interval, or a bound, rounded up as by `in_per_cent`.

    A bound that is rounded to the nearest number may say more than was shown.
    """
    if share == 0.0 or not math.isfinite(share):
        return 100.0 * share
    step = 1.0
    if abs(share) < 1.0:
        tens = math.floor(math.log10(abs(100.0 * share)))
        step = 10.0 ** (tens - 1)
    # 29 % is 28.999999999999996 in binary digits.
    steps = math.ceil(round(100.0 * share / step, 9))
    return float(f"{steps * step:.12g}")


def in_shell(message: Message) -> Message:
    """Return a message in the words for a reader of a terminal.

    Where these differ from those for Python, such as an option in place of an argument,
    a second template has ``_in_shell`` at the end of its name.
    """
    room, _, name = message.code.partition(".")
    if f"{name}{IN_SHELL}" not in _templates(room, ENGLISH):
        return message
    return Message(f"{message.code}{IN_SHELL}", message.values)


class Messages(tuple[Message, ...]):
    """Several messages, each of which is a line when they are printed or shown."""

    def __str__(self) -> str:
        return "\n".join(str(one) for one in self)

    def __repr__(self) -> str:
        return str(self) or "()"


class Lines(tuple[str, ...]):
    """Several texts, each of which is a line when they are printed or shown."""

    def __str__(self) -> str:
        return "\n".join(self)

    def __repr__(self) -> str:
        return str(self) or "()"


def languages() -> list[str]:
    """Return English and the further languages that some room has sentences in."""
    further = {
        path.suffixes[0].lstrip(".") for path in PACKAGE.glob("*/messages.*.toml")
    }
    return [ENGLISH, *sorted(further)]


def _template(code: str, language: str) -> str:
    room, _, name = code.partition(".")
    translated = _templates(room, language)
    if name in translated:
        return translated[name]
    return _templates(room, ENGLISH)[name]


@cache
def _templates(room: str, language: str) -> dict[str, str]:
    file = "messages.toml" if language == ENGLISH else f"messages.{language}.toml"
    path = PACKAGE / room / file
    if not path.exists():
        return {}
    return dict(tomllib.loads(path.read_text("utf-8")))
