"""Figs. 2.2 and 2.3 by the printed method above, and by hopdata's below."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from matplotlib.figure import Figure

from hopdata.arrays import pd
from hopdata.figures import style
from hopdata.figures.schedule import schedule_figure
from hopdata.figures.sections import sections_figure

HEADINGS = {"printed": "As printed", "ours": "hopdata's method"}

# Height of each half of Fig. 2.2, and of Fig. 2.3, with its heading.
SECTIONS_MM = 92.0
SCHEDULE_MM = 80.0


@style.styled
def sections_by_both(tables: Mapping[str, pd.DataFrame]) -> Figure:
    """Draw Fig. 2.2 by both methods, with the axes of the printed figure.

    Parameters
    ----------
    tables : mapping
        ``sections``, one row a method, and by method ``<method>_frames`` and
        ``<method>_densities``.
    """
    by_method = tables["sections"].set_index("method")

    def one(method: str, place: Any) -> None:
        sections = dict(by_method.loc[method])
        frames = tables[f"{method}_frames"]
        densities = tables[f"{method}_densities"]
        sections_figure(frames, densities, sections, landings=False, ax=place)

    return _stacked(one, SECTIONS_MM)


@style.styled
def schedule_by_both(tables: Mapping[str, pd.DataFrame]) -> Figure:
    """Draw Fig. 2.3, one landing, by both methods.

    Parameters
    ----------
    tables : mapping
        By method, ``<method>_example`` and ``<method>_touchdown``.
    """

    def one(method: str, place: Any) -> None:
        example = tables[f"{method}_example"]
        schedule_figure(example, tables[f"{method}_touchdown"], ax=place)

    return _stacked(one, SCHEDULE_MM)


def _stacked(draw: Callable[[str, Any], None], height_mm: float) -> Figure:
    """Draw the methods below one another, each under its heading."""
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 2 * height_mm)
    places: Any = figure.subfigures(2, 1)
    for place, method in zip(places, HEADINGS, strict=True):
        place.suptitle(HEADINGS[method], fontsize=style.pt(9), fontweight="bold")
        draw(method, place.subfigures(1, 1))
    return figure
