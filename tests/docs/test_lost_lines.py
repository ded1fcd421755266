"""No line of a page is lost: MyST takes one that begins with "%" for a comment."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("benchmarks/*.md")]
CODE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


def lost_lines(text):
    """Return the lines that the site would not show."""
    prose = CODE.sub("", text)
    return [line for line in prose.splitlines() if re.match(r"\s*%(\W|$)", line)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_line_is_lost(page):
    assert lost_lines(page.read_text(encoding="utf-8")) == []


def test_a_lost_line_is_noticed():
    assert lost_lines("holds 98\n  % of the landings\n") == ["  % of the landings"]
    assert lost_lines("holds 98 %\nof them\n```\n% comment\n```\n") == []
