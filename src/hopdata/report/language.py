"""The language of a page: sentences by their codes, and words by the English ones.

A second language is two files: ``messages.<language>.toml`` with the sentences, as in
every room (`hopdata.messages`), and ``words.<language>.toml`` with a translation of
each title, heading and name that a table shows. What they lack is said in English.
"""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from hopdata.errors import require_choice
from hopdata.messages import ENGLISH, Message, languages

FOLDER = Path(__file__).parent

#: Languages that a page may have: English, and those in which some room has sentences.
LANGUAGES = tuple(languages())


def require_language(language: str) -> None:
    """Raise a `ConfigError` unless some room has sentences in the language."""
    require_choice("report.language", language, languages())


def said(content: Any, language: str = ENGLISH) -> Any:
    """Return a message or a word in the language; anything else as it is."""
    if isinstance(content, Message):
        return content.text(language)
    if isinstance(content, str):
        return _words(FOLDER / f"words.{language}.toml").get(content, content)
    return content


def sentence(name: str, language: str = ENGLISH, **values: Any) -> str:
    """Return a sentence of the report's ``messages.toml`` in the language."""
    return Message(f"report.{name}", values).text(language)


@cache
def _words(path: Path) -> dict[str, str]:
    """Return the translations of English words; none if there is no such file."""
    if not path.exists():
        return {}
    return dict(tomllib.loads(path.read_text("utf-8")))
