"""The drawings in the documents show the scene and the code as they are."""

import importlib.util
import json
import re
from html import unescape
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def drawings():
    path = ROOT / "packaging" / "drawings.py"
    spec = importlib.util.spec_from_file_location("drawings", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def drawn(drawings):
    return drawings.drawn()


def words_of(svg):
    """Return the texts of an SVG, without the numbers of its axes."""
    found = re.findall(r"<text[^>]*>([^<]*)</text>", svg)
    texts = {unescape(text).strip() for text in found}
    return {text for text in texts if re.search("[A-Za-z]{2}", text)}


@pytest.mark.parametrize("name", ["robot", "live_loop", "answer"])
def test_a_drawing_says_what_would_be_drawn_now(drawn, name):
    expected = set()
    for axes in drawn[name].axes:
        labels = [axes.get_xlabel(), axes.get_ylabel(), axes.get_title(loc="left")]
        for text in [*axes.texts, *labels]:
            shown = text if isinstance(text, str) else text.get_text()
            expected |= {line.strip() for line in shown.splitlines()}
    expected = {text for text in expected if re.search("[A-Za-z]{2}", text)}
    svg = (ROOT / "docs" / f"{name}.svg").read_text(encoding="utf-8")
    assert expected <= words_of(svg)
    assert len(expected) > 5


def test_the_answer_is_of_the_sample_and_code_of_today(drawings, drawn, tmp_path):
    """Every line of the picture is as it would be drawn now, but for the last bits of places."""
    answer = json.loads(drawings.ANSWER.read_text("utf-8"))
    assert answer["sample_sha256"] == drawings.digest_of_sample()
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (told,) = re.findall(r"!\[([^\]]+)\]\(docs/answer.svg\)", readme)
    assert answer["verdict"]["sentence"].startswith(told)
    (now,) = drawings.save_figure(drawn["answer"], tmp_path / "answer", formats=["svg"])
    before = (ROOT / "docs" / "answer.svg").read_text(encoding="utf-8")
    for shown in (SIZES, STYLES):
        assert re.findall(shown, before) == re.findall(shown, now.read_text("utf-8"))


# Sizes and texts, and colours and letters, of an SVG.
SIZES = r"<text[^>]*>[^<]*</text>|<svg[^>]*>"
STYLES = r'style="[^"]*"'


@pytest.mark.parametrize(
    ("page", "name"), [("steering.md", "robot"), ("live.md", "live_loop")]
)
def test_a_page_shows_it(page, name):
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert re.search(rf"!\[[^\]]+\]\({name}\.svg\)", text)
