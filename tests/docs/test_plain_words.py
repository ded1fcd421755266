"""Pages for readers: short sentences, and each begins with what its reader can do."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MOST_WORDS = 30
#: Written by a command: from the schema, the code, the messages or measurements.
GENERATED = {"configuration", "constants", "dissertation", "troubleshooting"}
#: The pages that keep to it: all that somebody writes.
PAGES = [
    *("README", "CONTRIBUTING"),
    *sorted(
        f"docs/{page.stem}"
        for page in (ROOT / "docs").glob("*.md")
        if page.stem not in GENERATED
    ),
]
#: Those that show at their beginning what hopdata is, in place of what the page is for.
OTHER_BEGINNING = {"README"}


def paragraphs(text):
    """Yield the paragraphs, list items and cells of a page, without its code."""
    text = re.sub(r"```.*?```|<!--.*?-->", " ", text, flags=re.DOTALL)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    for part in re.split(r"\n\s*\n|\n(?=\s*[-*] |\s*\d+\. |#|\||>|: )", text):
        if part.strip().startswith("|"):
            yield from part.strip().strip("|").split("|")
        else:
            yield part


def long_sentences(text):
    """Return the sentences with more words than a reader keeps in mind."""
    found = []
    for paragraph in paragraphs(text):
        for sentence in re.split(r"(?<=[.!?:;])\s+", paragraph):
            if len(re.findall(r"\S*\w\S*", sentence)) > MOST_WORDS:
                found.append(" ".join(sentence.split()))
    return found


@pytest.mark.parametrize("page", PAGES)
def test_no_sentence_is_long(page):
    assert not long_sentences((ROOT / f"{page}.md").read_text("utf-8"))


def test_a_long_sentence_is_noticed():
    assert long_sentences("# Title\n\n" + "word " * 31 + "end.")
    assert long_sentences("| a | " + "word " * 31 + "|")
    assert not long_sentences("```\n" + "word " * 40 + "\n```\n\nShort. " + "w " * 20)


@pytest.mark.parametrize("page", sorted(set(PAGES) - OTHER_BEGINNING))
def test_a_page_begins_with_what_its_reader_can_do(page):
    text = re.sub(r"<!--.*?-->", "", (ROOT / f"{page}.md").read_text("utf-8"))
    first = text.partition("\n")[2].strip()
    assert first.startswith("After this page you ")


def test_the_first_page_is_short():
    assert len((ROOT / "README.md").read_text("utf-8").split()) <= 600
