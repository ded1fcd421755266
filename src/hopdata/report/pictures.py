"""Figures as a page needs them: the image within the text, its size on paper, its caption."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hopdata.report.captions import Caption, render_caption
from hopdata.report.inputs import ReportFigure

DOUBLE_COLUMN_PT = 496.0


@dataclass(frozen=True)
class Picture:
    """A figure as the template needs it; `width_pt` is its size on paper."""

    source: str
    width_pt: float
    caption: Caption


def picture_of(figure: ReportFigure, facts: Mapping[str, Any]) -> Picture:
    """Fill in the caption and put the image into a URL.

    Raises
    ------
    ConfigError
        If the caption names a fact that does not exist.
    """
    caption = render_caption(figure.caption, facts, name=figure.name)
    source = ""
    if figure.image:
        encoded = base64.b64encode(figure.image).decode("ascii")
        source = f"data:{figure.media_type};base64,{encoded}"
    return Picture(source, _width_pt(figure), caption)


def _width_pt(figure: ReportFigure) -> float:
    """Width on paper that an SVG asks for; a full text width for anything else."""
    found = re.search(rb'<svg[^>]*?\swidth="([0-9.]+)pt"', figure.image[:4000])
    return float(found.group(1)) if found else DOUBLE_COLUMN_PT
