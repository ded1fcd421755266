"""The page on one recording: one HTML file that needs no other."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hopdata import __version__
from hopdata.report.table import Table

TEMPLATES = Path(__file__).with_name("templates")
DEFAULT_WIDTH_PT = 496.0


@dataclass(frozen=True)
class SvgPicture:
    """An SVG with its title and caption."""

    svg: bytes
    title: str
    caption: str

    @property
    def source(self) -> str:
        """The picture as a data URL."""
        return "data:image/svg+xml;base64," + base64.b64encode(self.svg).decode("ascii")

    @property
    def width_pt(self) -> float:
        """Width on paper that the SVG asks for."""
        found = re.search(rb'<svg[^>]*?\swidth="([0-9.]+)pt"', self.svg[:4000])
        return float(found.group(1)) if found else DEFAULT_WIDTH_PT


@dataclass(frozen=True)
class InspectionPage:
    """What the page shows.

    Parameters
    ----------
    title : str
        Name of the file.
    answer : str
        One sentence: what was found.
    highlights : sequence of (name, value, remark)
        Facts on top.
    notes : sequence of str
        What the reader should look at.
    pictures : sequence of SvgPicture
        Figures.
    tables : sequence of Table
        Tables.
    """

    title: str
    answer: str
    highlights: Sequence[tuple[str, str, str]]
    notes: Sequence[str]
    pictures: Sequence[SvgPicture]
    tables: Sequence[Table]


def build_inspection_page(page: InspectionPage) -> str:
    """Write the page as a complete HTML document."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("inspection.html.j2").render(
        title=page.title,
        answer=page.answer,
        highlights=page.highlights,
        notes=page.notes,
        pictures=page.pictures,
        tables=page.tables,
        style=(TEMPLATES / "report.css").read_text(encoding="utf-8"),
        version=__version__,
    )
