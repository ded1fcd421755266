"""Checks whether texts of a drawn figure overlap or leave the page."""

from __future__ import annotations

from itertools import combinations

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from hopdata.figures.style import style_context


def text_faults(figure: Figure) -> list[str]:
    """Return pairs of visible texts that overlap by over a pixel, and texts cut by the edge."""
    with style_context():
        renderer = FigureCanvasAgg(figure).get_renderer()
        figure.draw_without_rendering()
        hidden = _undrawn(figure)
        texts = [
            (text.get_text().replace("\n", " "), text.get_window_extent(renderer))
            for text in figure.findobj(Text)
            if text.get_visible() and text.get_text().strip() and text not in hidden
        ]
    page = figure.bbox
    faults = [
        f"'{name}' leaves the page"
        for name, box in texts
        if min(box.x0, box.y0) < -1 or box.x1 > page.x1 + 1 or box.y1 > page.y1 + 1
    ]
    for (one, a), (two, b) in combinations(texts, 2):
        wide = min(a.x1, b.x1) - max(a.x0, b.x0)
        high = min(a.y1, b.y1) - max(a.y0, b.y0)
        if wide > 1 and high > 1:
            faults.append(f"'{one}' over '{two}'")
    return faults


def texts_crossed_by_upright_lines(axes: Axes) -> list[str]:
    """Return the texts of the axes that a line from below to above runs through or touches."""
    figure = axes.figure.figure
    with style_context():
        renderer = FigureCanvasAgg(figure).get_renderer()
        figure.draw_without_rendering()
        texts = [
            (text.get_text(), text.get_window_extent(renderer)) for text in axes.texts
        ]
    lines = [line.get_window_extent(renderer) for line in axes.lines]
    for pieces in axes.collections:
        if isinstance(pieces, LineCollection):
            for ends in pieces.get_segments():
                lines.append(Bbox(axes.transData.transform(ends)))
    crossed = []
    for line in lines:
        is_upright = line.width < 3 < line.height
        for words, box in texts:
            beside = line.x1 < box.x0 - 1 or line.x0 > box.x1 + 1
            apart = line.y1 < box.y0 or line.y0 > box.y1
            if is_upright and not (beside or apart):
                crossed.append(words)
    return crossed


def _undrawn(figure: Figure) -> set[Text]:
    """Return texts that are never drawn: tick labels outside the limits or on axes that are off."""
    hidden: set[Text] = set()
    for axes in figure.findobj(Axes):
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                if not (axes.axison and low <= tick.get_loc() <= high):
                    hidden |= {tick.label1, tick.label2}
    return hidden
