from html.parser import HTMLParser

from hopdata.report.inspection_page import InspectionPage, SvgPicture, build_inspection_page
from hopdata.report.table import Table

SVG = b'<svg width="300.5pt" height="20pt"></svg>'


def page(**changes):
    parts = {
        "title": "mon<day>.tsv",
        "answer": "Nothing wrong.",
        "highlights": [("Rate", "100 Hz", "0 frames dropped")],
        "notes": [],
        "pictures": [SvgPicture(SVG, "Where each marker was seen", "One bar a marker.")],
        "tables": [Table("Markers", ("marker", "gaps"), (("hip & toe", "3"),))],
    }
    return build_inspection_page(InspectionPage(**{**parts, **changes}))


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.opened, self.found = [], []

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag not in ("meta", "img"):
            self.opened.append(tag)

    def handle_endtag(self, tag):
        assert self.opened.pop() == tag


def test_the_page_is_whole_and_loads_nothing():
    tags = Tags()
    tags.feed(page())
    assert tags.opened == []
    sources = [attrs["src"] for tag, attrs in tags.found if tag == "img"]
    assert sources == [SvgPicture(SVG, "", "").source]
    assert sources[0].startswith("data:image/svg+xml;base64,")
    assert not any("href" in attrs for _, attrs in tags.found)


def test_text_from_the_file_is_escaped():
    text = page(notes=["<script>"])
    assert "<script>" not in text
    assert "mon&lt;day&gt;.tsv" in text
    assert "hip &amp; toe" in text


def test_the_picture_s_width_is_that_of_the_svg():
    assert SvgPicture(SVG, "", "").width_pt == 300.5
    assert SvgPicture(b"<svg></svg>", "", "").width_pt == 496.0
