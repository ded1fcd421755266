import re
from html.parser import HTMLParser

import pytest
from made_up import SOUND, SOUND_ITEMS, install, item
from test_browser import CHROMIUM, seen

import hopdata
from hopdata.dissertation.items import read_items
from hopdata.dissertation.making import Failure, Record, make_part
from hopdata.dissertation.report.document import build_document, stated
from hopdata.dissertation.report.page import build_page


@pytest.fixture
def items(tmp_path):
    (tmp_path / "made_up.toml").write_text(SOUND_ITEMS)

    (tmp_path / "other.toml").write_text(item(94) + item(95))
    return read_items(tmp_path)


@pytest.fixture
def record(tmp_path, monkeypatch):
    install(monkeypatch, "made_up", SOUND)
    return make_part("made_up", tmp_path / "made_up", [3, 4], formats=["svg", "png"])


@pytest.fixture
def folders(tmp_path):
    return {"made_up": tmp_path / "made_up", "other": tmp_path / "other"}


FAILED = Record("other", failure=Failure("<no> MuJoCo", "install it"))


class Outline(HTMLParser):
    """Names of places, goals of links, and the text of a page."""

    def __init__(self, page):
        super().__init__()
        self.places, self.goals, self.text = [], [], []
        self.feed(page)

    def handle_starttag(self, _tag, attributes):
        found = dict(attributes)
        if "id" in found:
            self.places.append(found["id"])
        if "#" in found.get("href", ""):
            self.goals.append(found["href"].removeprefix("#"))

    def handle_data(self, data):
        self.text.append(data)


def text_of(page):
    return " ".join(" ".join(Outline(page).text).split())


def test_items_stand_in_the_order_of_the_text_under_their_chapters(
    items, record, folders
):
    outline = Outline(build_page(items, [record, FAILED], folders))
    places = [name for name in outline.places if re.match("chapter|item", name)]
    assert places == [
        *("chapter-I", "item-1"),
        *("chapter-II", "item-32"),
        *("chapter-IV", "item-93", "item-94", "item-95"),
    ]
    assert set(outline.goals) <= set(outline.places)
    assert len(outline.places) == len(set(outline.places))


def test_the_summary_counts_and_links_what_differs_and_what_is_missing(
    items, record, folders
):
    page = build_page(items, [record, FAILED], folders)
    summary = page.partition('<section id="chapter-I">')[0]
    told = text_of(summary.partition("</style>")[2])
    assert "Of 2 results, 1 agrees and 1 differs." in told
    assert "2 items cannot be made here." in told
    assert "93 Order of the method the printed fit takes" in told
    assert "94 Item 94 <no> MuJoCo; install it" in told
    assert "32 Affine maps" not in told, "it agrees"
    assert set(Outline(summary).goals) >= {f"item-{n}" for n in (1, 32, 93, 94, 95)}
    assert "median over 2 seeds" in told


def test_a_row_says_its_standing_in_a_word_and_a_sign(items, record, folders):
    page = build_page(items, [record, FAILED], folders)
    rows = page.partition('<section id="chapter-I">')[2]
    for sign, word in (("●", "built"), ("✓", "agrees"), ("≠", "differs")):
        assert f"{sign} {word}" in text_of(rows)
    assert text_of(rows).count("! cannot be made") == 2
    assert "slope 4.5 (4.0 to 5.0)" in text_of(rows)
    assert "&lt;no&gt; MuJoCo" in page
    assert "<no>" not in page


def test_a_figure_stands_beside_its_printed_description(items, record, folders):
    page = build_page(items, [record], folders)
    assert page.count("data:image/svg+xml") == 1
    told = text_of(page)
    assert "As printed: error over step, both logarithmic" in told
    assert "How to read it: Steeper is better." in told
    undrawn = Record("made_up", [3], record.rows, [], failed_figures={})
    page = build_page(items, [undrawn], folders)
    assert page.count("data:image/") == 0
    assert "This figure cannot be drawn: the part made_up drew no" in text_of(page)
    assert 'id="undrawn"' in page


def test_a_figure_of_two_rows_is_shown_once(tmp_path, items, record, folders):
    also = tmp_path / "also"
    also.mkdir()
    (also / "made_up.toml").write_text(
        SOUND_ITEMS + item(97, figure="fig4_2_order", figure_printed="as above")
    )
    page = build_page(read_items(also), [record], folders)
    assert page.count("data:image/svg+xml") == 1


def test_the_page_loads_nothing(items, record, folders):
    page = build_page(items, [record, FAILED], folders)
    assert "://" not in page.replace("http://www.w3.org", "")
    assert "<script" not in page


def test_a_row_leads_to_its_numbers_and_the_page_says_who_made_it(
    items, record, folders
):
    page = build_page(items, [record, FAILED], folders)
    assert page.count('href="parts/made_up/rows.json"') == 3
    assert 'href="parts/other' not in page, "it has no numbers"
    assert f"Made by hopdata {hopdata.__version__}, numpy " in page


# What a browser finds: console output, width, faults of accessibility, what is hidden.
ASK = """<script>
addEventListener("load", async () => {
  const found = { told, wide: document.documentElement.scrollWidth };
  found.violations = (await axe.run()).violations.map((one) =>
    `${one.id}: ${one.nodes.map((node) => node.html.slice(0, 120)).join(" | ")}`);
  found.heads = [...document.querySelectorAll("thead")].map((one) => one.offsetHeight > 0);
  document.documentElement.dataset.found = JSON.stringify(found);
});
</script>"""


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (390, True)])
def test_the_page_in_a_browser(width, dark, tmp_path, items, record, folders):
    scheme = ["--blink-settings=preferredColorScheme=0"] if dark else []
    page = build_page(items, [record, FAILED], folders)
    found = seen(page, tmp_path, *scheme, width=width, ask=ASK)
    assert found["told"] == []
    assert found["wide"] <= width, "the page is wider than its window"
    assert found["violations"] == []
    # On a phone a row is a card, whose cells say what they are.
    assert set(found["heads"]) == {width > 700}


def test_the_document_has_the_same_rows(items, record):
    document = build_document(items, [record, FAILED])
    rows = re.findall(r"^\| (\d+) \| (.*)$", document, re.MULTILINE)
    assert [int(number) for number, _ in rows] == [1, 32, 93, 94, 95]
    headings = re.findall(r"^### (.*)$", document, re.MULTILINE)
    assert headings[:3] == ["Section 1.2", "Section 2.2", "Section 4.4"]
    order = next(line for line in document.splitlines() if line.startswith("| 93"))
    assert "| slope 4.20 | slope 4.5 (4.0 to 5.0) | ≠ differs | the printed" in order
    assert "affine \\| least squares" in document
    assert "\n\n\n" not in document
    for one in items:
        assert f"| {' | '.join(stated(one))} |" in document
    widths = {len(re.findall(r"(?<!\\)\|", line)) for line in document.splitlines()}
    assert widths == {0, 8}
