"""Each pointer of a message, docstring or comment to a page's heading finds it there."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
#: `docs/PAGE.md`, `docs/PAGE.md, Heading` and `docs/PAGE.md, "Heading"`; or the page alone,
#: without its folder, beside a heading in quotes.
POINTER = re.compile(
    r'docs/(?P<page>\w+)\.md(?:, (?:"(?P<quoted>[^"]+)"|(?P<plain>[A-Z][^).;,]*)))?'
    r'|(?<![\w/])(?P<bare>[a-z_]+)\.md, "(?P<beside>[^"]+)"'
)


def texts_of(path):
    """Yield the strings and the comments of a program, or a whole file of another kind."""
    text = path.read_text("utf-8")
    if ".md" not in text or path.suffix != ".py":
        yield text
        return
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
    comments, last = [], -1
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            if token.start[0] != last + 1:
                comments.append("")
            comments[-1] += " " + token.string.lstrip("#:")
            last = token.start[0]
    yield from comments


def headings(page):
    """Return the headings of a page, and the words in bold that begin a paragraph."""
    text = (DOCS / f"{page}.md").read_text("utf-8")
    text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    found = re.findall(r"^#+ (.+)$|^(?:- )?\*\*(.+?)\.?\*\*", text, flags=re.M)
    return {plain(one or other) for one, other in found}


def plain(heading):
    """Return a heading without its marks."""
    return re.sub('[`"]', "", heading).strip()


def lost(text):
    """Return the pointers in a text whose page or heading does not exist."""
    missing = []
    for match in POINTER.finditer(" ".join(text.split())):
        page = match["page"] or match["bare"]
        heading = match["quoted"] or match["plain"] or match["beside"]
        found = (DOCS / f"{page}.md").exists()
        if found and heading:
            found = plain(heading) in headings(page)
        if not found:
            missing.append(match[0])
    return missing


@pytest.mark.parametrize("folder", ["src", "workflow", "benchmarks"])
def test_pointers_to_pages_find_their_headings(folder):
    kinds = {".py", ".toml", ".smk", ".yaml"}
    files = [path for path in (ROOT / folder).rglob("*") if path.suffix in kinds]
    found = {
        str(path.relative_to(ROOT)): missing
        for path in sorted(files)
        if (missing := [one for text in texts_of(path) for one in lost(text)])
    }
    assert not found


@pytest.mark.parametrize(
    ("text", "missing"),
    [
        ("see docs/sliding.md, Limits.", 0),
        ("see docs/sliding.md,\n    Limits).", 0),
        ("see docs/sliding.md, Surfaces must be independent)", 1),
        ('docs/contacts_method.md, "No such heading"', 1),
        ("docs/no_such_page.md", 1),
        ('decisions.md, "No such heading"', 1),
    ],
)
def test_a_pointer_to_nothing_is_found(text, missing):
    assert len(lost(text)) == missing
