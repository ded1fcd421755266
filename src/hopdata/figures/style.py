"""Style shared by all figures: paper sizes, and colours that all readers can tell."""

import math
import os
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import wraps
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import Collection
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from hopdata.errors import ConfigError, chosen, require, require_choice
from hopdata.figures.catalogue import FORMATS, function_of
from hopdata.jobs import read_json, read_table, whole_file

# Elements shared by figures: bands, boxes, row labels, notes, logarithmic axes with
# plain numbers.


def banded_line(
    axes: Axes, x: pd.Series, y: pd.Series, band: Any, line: tuple[Any, ...]
) -> None:
    """Draw a line with a pale band; `line` has its label, colour, dashes and marker."""
    label, colour, dash, marker = line
    axes.fill_between(x, *band, color=colour, alpha=0.15, linewidth=0)
    axes.plot(
        x, y, color=colour, linestyle=dash, marker=marker, markersize=2.5, label=label
    )


def box(
    axes: Axes, place: float, quantiles: Sequence[float], colour: str, **options: Any
) -> None:
    """Draw a box from five quantiles, with `options` of `Axes.bxp`, and ``alpha``."""
    line = {"color": INK, "linewidth": 0.8}
    median = {"color": INK, "linewidth": 1.2}
    face = {"facecolor": colour, "alpha": options.pop("alpha", 0.55), "edgecolor": INK}
    names = ("whislo", "q1", "med", "q3", "whishi")
    statistics = dict(zip(names, quantiles, strict=True))
    axes.bxp(
        [statistics],
        positions=[place],
        showfliers=False,
        patch_artist=True,
        boxprops=face,
        medianprops=median,
        whiskerprops=line,
        capprops=line,
        manage_ticks=False,
        **options,
    )


def name_rows(axes: Axes, labels: Sequence[str]) -> None:
    """Label rows 0, 1, ... from the top."""
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(max(len(labels), 1) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)


def note(
    axes: Axes, text: str, at: tuple[float, float], offset: Any, **options: Any
) -> None:
    """Write a small text `offset` points from a place, with `options` of `annotate`."""
    size = pt(options.pop("fontsize", TEXT_PT))
    options.setdefault("textcoords", "offset points")
    axes.annotate(text, xy=at, xytext=offset, fontsize=size, **options)


def lacking(axes: Axes, x: float, y: float, text: str, transform: Any = None) -> None:
    """Write in grey, centred on a place, what is missing."""
    look: Any = {"ha": "center", "va": "center", "color": GREY, "bbox": ON_WHITE}
    axes.text(x, y, text, transform=transform or axes.transData, **look)


def plain_numbers(axis: Axis) -> None:
    """Show the numbers of a logarithmic axis as they are, and none at minor ticks."""
    axis.set_minor_locator(ticker.NullLocator())
    axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))


# Numbers on an axis that has no two powers of ten, at most.
NUMBERS_WITHIN = 5


def numbers_within_a_decade(axis: Axis) -> None:
    """Write plain numbers on a logarithmic axis that has no two powers of ten.

    Such an axis would have one number, or odd ones at minor ticks.
    """
    low, high = sorted(axis.get_view_interval())
    powers = math.floor(math.log10(high)) - math.ceil(math.log10(low)) + 1
    if powers > 1:
        return
    plain_numbers(axis)
    axis.set_major_locator(ticker.MaxNLocator(NUMBERS_WITHIN))


STYLE_FILE = Path(__file__).with_name("hopdata.mplstyle")

SINGLE_COLUMN_MM = 85.0
DOUBLE_COLUMN_MM = 175.0
# The widest panel. A narrow window (500 px) stacks panels at their own size, so none of
# them is cut and no letter shrinks.
WIDEST_PANEL_MM = 120.0
MM_PER_INCH = 25.4

# The palette of Okabe and Ito (2008), by name.
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
YELLOW = "#F0E442"
BLUE = "#0072B2"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#8C8C8C"
INK = "#222222"

# Box behind a text that may overlap a line.
ON_WHITE = {"facecolor": "white", "linewidth": 0, "pad": 0.8}

# What a colour means in the figures of a study, of a recording and of contacts. Colours
# mark the feet; shades say how sure something is. Orange and red stand last, since
# readers take them for a warning.
FOOT_COLOURS = (BLUE, GREEN, PURPLE, SKY, ORANGE, VERMILION)
BETWEEN_SECTIONS = YELLOW
FOUND = INK
NOT_FOUND = GREY
# Methods and cases beside each other have shades, dashes and marks: dark is what is
# ours or C1, and pale what is printed or not C1. Others stand between and beyond these.
OURS = INK
PRINTED = "#949494"
SHADE = "#5a5a5a"
PALE = "#bcbcbc"
# Size and sign of an entry of a map, with white for zero.
OF_SIGNS = "BrBG"
MEANINGS = {
    "a foot": FOOT_COLOURS,
    "between the two sections": (BETWEEN_SECTIONS,),
}
FOOT_MARKS = ("o", "s", "^", "D", "v", "P")
FOOT_DASHES: tuple[str | tuple[float, tuple[float, ...]], ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1.5, 1.2)),
    (0, (5, 1.2, 1.5, 1.2)),
    (0, (8, 2)),
    (0, (3, 1, 1, 1, 1, 1)),
)

# Characters of a label.
LONGEST_LABEL = 24
# Size of an axes relative to its grid cell, before the layout.
SHARE_OF_AXES = 0.77
# Text size of the style file, to which sizes given to `pt` refer.
TEXT_PT = 7.0


@dataclass(frozen=True)
class Journal:
    """Widths of one and two columns, mm, and scale factors of text and lines."""

    single_mm: float = SINGLE_COLUMN_MM
    double_mm: float = DOUBLE_COLUMN_MM
    text: float = 1.0
    line: float = 1.0


STYLES = {
    "nature": Journal(89.0, 183.0),
    "ieee": Journal(88.9, 181.9, text=7.5 / 7),
    "poster": Journal(212.5, 437.5, text=2.5, line=2.5),
}
OWN = Journal()
_JOURNAL: ContextVar[Journal] = ContextVar("journal", default=OWN)
_PLACE: ContextVar[Any] = ContextVar("place", default=None)
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@contextmanager
def style_context() -> Iterator[None]:
    """Apply matplotlib's defaults and the hopdata style only.

    A glyph missing from the font is drawn as a box, without a warning.
    """
    with matplotlib.rc_context(fname=str(STYLE_FILE)), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .*missing from font")
        _scale_text(_JOURNAL.get().text)
        yield


def _scale_text(factor: float) -> None:
    scaled = [key for key in matplotlib.rcParams if SCALED.fullmatch(key)]
    for key in scaled:
        if not isinstance(matplotlib.rcParams[key], str):
            matplotlib.rcParams[key] *= factor


SCALED = re.compile(
    r"font\.size|.*\.(label|title)size|.*(label|title)?pad"
    r"|legend\.fontsize|[xy]tick.*size"
)


def styled(draw: Callable[..., Figure]) -> Callable[..., Any]:
    """Run a drawing function within the style, without effects on the user's own style.

    It gets two more arguments. ``ax`` is where to draw: a figure or subfigure, or an
    axes of a grid. A figure with one axes is drawn into that axes itself; otherwise it
    fills the place of the axes. ``style``, one of `STYLES`, sets the width of the
    columns and the size of the text. With ``ax`` alone, the user's own style applies,
    with smaller text if there is less room than on paper. It returns the figure or,
    with ``ax``, what was drawn into.

    Raises
    ------
    ConfigError
        If the style is unknown, or `ax` is nothing to draw into.
    """

    @wraps(draw)
    def draw_in_style(
        *args: Any, ax: Any = None, style: str | None = None, **kwargs: Any
    ) -> Any:
        journal = _JOURNAL.get()
        if style is not None:
            journal = chosen("style", style, STYLES)
        place = _PLACE.get()
        if ax is not None:
            place = _Place(ax)
        # In the user's own place, the user's own style applies.
        is_users = place is not None and style is None
        context = matplotlib.rc_context() if is_users else style_context()

        journal_before = _JOURNAL.set(journal)
        place_before = _PLACE.set(place)
        try:
            with context:
                figure = draw(*args, **kwargs)
                _write_powers(figure)
                if style is not None:
                    _fit_lines(figure, journal)
        finally:
            _JOURNAL.reset(journal_before)
            _PLACE.reset(place_before)
        return figure if ax is None else place.drawn

    return draw_in_style


class _Place:
    """Where a user wants a figure drawn, with the methods of a figure that we call."""

    def __init__(self, ax: Any) -> None:
        if not isinstance(ax, Axes | FigureBase):
            raise ConfigError.at("ax", "axes or a figure", f"a {type(ax).__name__}")
        root = ax if isinstance(ax, Figure) else ax.figure
        if isinstance(root, Figure) and root.get_layout_engine() is None:
            root.set_layout_engine("constrained")  # items outside the axes need room
        self.drawn: Any = ax

    def fit_text(self, width_mm: float, height_mm: float) -> None:
        """Shrink text if the place is smaller than a figure of this size."""
        if isinstance(self.drawn, Axes):
            box = self.drawn.get_window_extent()
            share = SHARE_OF_AXES
        else:
            box = self.drawn.bbox
            share = 1.0
        dots_a_mm = self.drawn.figure.dpi * share / MM_PER_INCH
        room = min(box.width / width_mm, box.height / height_mm) / dots_a_mm
        _scale_text(min(1.0, room * TEXT_PT / matplotlib.rcParams["font.size"]))
        if isinstance(self.drawn, Axes):
            self.drawn.tick_params(labelsize=matplotlib.rcParams["xtick.labelsize"])
            for axis in (self.drawn.xaxis, self.drawn.yaxis):
                axis.label.set_fontsize(matplotlib.rcParams["axes.labelsize"])

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the figure, or of a subfigure in place of an axes."""
        if isinstance(self.drawn, Axes):
            if name == "axes":
                return [self.drawn]
            if name == "legend":
                return self._legend
            if name == "text":
                return self._text
            self._replace_axes()
        return getattr(self.drawn, name)

    def _replace_axes(self) -> None:
        """Put a subfigure in the place of the axes."""
        axes = self.drawn
        spec = axes.get_subplotspec()
        if spec is None:
            raise ConfigError(
                "ax: expected an axes of a grid, or a figure, for several panels"
            )
        self.drawn = axes.figure.add_subfigure(spec)
        axes.remove()

    def subplots(self, *grid: Any, **options: Any) -> Any:
        if not grid and not options and isinstance(self.drawn, Axes):
            return self.drawn
        return self.__getattr__("subplots")(*grid, **options)

    def _legend(self, *handles: Any, **options: Any) -> Any:
        return self.drawn.legend(*handles, ncols=options.get("ncols", 1))

    def _text(self, x: float, y: float, words: str, **look: Any) -> Any:
        self.drawn.set_axis_off()
        return self.drawn.text(x, y, words, transform=self.drawn.transAxes, **look)


def _fit_lines(figure: Any, journal: Journal) -> None:
    """Scale lines and markers with the text, and update the size of tick labels."""
    for axes in figure.axes:
        axes.tick_params(labelsize=matplotlib.rcParams["xtick.labelsize"])
    if journal.line == 1.0:
        return
    ticks = range(4)  # the markers of ticks
    for artist in figure.findobj(
        lambda one: isinstance(one, Line2D | Patch | Collection)
    ):
        artist.set_linewidth(journal.line * np.asarray(artist.get_linewidth()))
        if isinstance(artist, Line2D) and artist.get_marker() not in ticks:
            artist.set_markersize(journal.line * artist.get_markersize())


def pt(size: float) -> float:
    """Return a text size in points in this style, given that in the style file."""
    return float(size * matplotlib.rcParams["font.size"] / TEXT_PT)


def _write_powers(figure: Figure) -> None:
    """Write powers of ten as 10⁻³, since text is not parsed as mathematics."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(axis.get_major_formatter(), ticker.LogFormatterMathtext):
                axis.set_major_formatter(_Powers())
            if isinstance(axis.get_minor_formatter(), ticker.LogFormatterMathtext):
                axis.set_minor_formatter(_Powers())


class _Powers(ticker.LogFormatterSciNotation):
    """Matplotlib's formatter of powers, with Unicode superscripts."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        text = (
            super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")
        )
        base, _, power = text.replace(r"\times", "×").partition("^{")
        return base + power.removesuffix("}").translate(SUPERSCRIPTS)


def label_of(name: str) -> str:
    """Return a name as shown in figures: one short line that a legend does not omit."""
    printable = "".join(c if c.isprintable() else " " for c in name)
    label = " ".join(printable.split())
    if not label:
        return "?"
    if len(label) > LONGEST_LABEL:
        label = label[: LONGEST_LABEL - 1] + "…"
    if label.startswith("_"):
        return f" {label}"  # a legend omits names that begin with this
    return label


def paper_figure(width_mm: float, height_mm: float) -> Figure:
    """Return an empty figure of this size, mm, with automatic layout, or the user's."""
    place = _PLACE.get()
    if place is not None:
        place.fit_text(width_mm, height_mm)
        return place  # type: ignore[no-any-return]
    journal = _JOURNAL.get()
    column = {SINGLE_COLUMN_MM: journal.single_mm, DOUBLE_COLUMN_MM: journal.double_mm}
    width = column.get(width_mm, width_mm * journal.text) / MM_PER_INCH
    height = height_mm * journal.text / MM_PER_INCH
    return _Shown(figsize=(width, height))


class _Shown(Figure):
    """A figure that a notebook displays without pyplot."""

    def _repr_svg_(self) -> str:
        picture = StringIO()
        with style_context():
            self.savefig(picture, format="svg", metadata=dict(FORMATS["svg"]))
        return picture.getvalue()


@styled
def message_figure(message: str, *, width_mm: float = SINGLE_COLUMN_MM) -> Figure:
    """Return a figure that says why there is nothing to draw."""
    figure = paper_figure(width_mm, 25.0)
    figure.text(0.5, 0.5, message, ha="center", va="center", color=INK, wrap=True)
    return figure


def foot_mark(number: int) -> str:
    """Return the mark of a foot, numbered from 0; repeats after six feet."""
    return FOOT_MARKS[number % len(FOOT_MARKS)]


def foot_colour(number: int) -> str:
    """Return the colour of a foot, numbered from 0; repeats after six feet."""
    return FOOT_COLOURS[number % len(FOOT_COLOURS)]


def foot_dash(number: int) -> str | tuple[float, tuple[float, ...]]:
    """Return the line style of a foot, numbered from 0; repeats after six feet."""
    return FOOT_DASHES[number % len(FOOT_DASHES)]


def foot_line(number: int) -> dict[str, Any]:
    """Return colour and line style of a foot, from 0, as keywords of a line."""
    return {"color": foot_colour(number), "linestyle": foot_dash(number)}


def letters(panels: Iterable[Axes]) -> None:
    """Write a bold a, b, c ... at the upper left of each panel, outside the axes."""
    look: Any = {
        "xycoords": "axes fraction",
        "ha": "right",
        "va": "bottom",
        "fontweight": "bold",
    }
    for axes, text in zip(panels, "abcdefghijklmnopqrstuvwxyz", strict=False):
        note(axes, text, (0, 1), (-4, 4), fontsize=8, **look)


def lettered(figure: Figure, panels: Iterable[Axes], ncols: int) -> None:
    """Letter the panels, and put the legend of the first panel above all of them."""
    panels = list(panels)
    letters(panels)
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=ncols
    )


# Figures to files: the same data give the same bytes, and either all formats are
# written or none.

# Decimals of a position, as a fraction of the figure.
DECIMALS = 9


def save_figure(
    figure: Figure,
    path: str | os.PathLike[str],
    *,
    formats: Sequence[str] = ("svg", "png"),
    dpi: float = 200.0,
) -> tuple[Path, ...]:
    """Write a figure in several formats, all or none.

    Parameters
    ----------
    figure : Figure
        From the functions of this package.
    path : path
        Name without suffix; ``.svg``, ``.png`` or ``.pdf`` is added.
    formats : sequence of str
        Any of ``"svg"``, ``"png"``, ``"pdf"``.
    dpi : float
        Pixels per inch of a PNG, and of the rasterised parts of the others.

    Returns
    -------
    tuple of Path
        The files written, in the order of `formats`.

    Raises
    ------
    ConfigError
        If a format is not one of the three, or `dpi` is not positive.
    """
    for name in formats:
        require_choice("figures.formats", name, FORMATS)
    require(dpi > 0, "figures.dpi", "a positive number", dpi)
    base = Path(path)
    targets = tuple(base.with_name(f"{base.name}.{suffix}") for suffix in formats)
    with ExitStack() as whole, style_context(), _laid_out(figure):
        for target, suffix in zip(targets, formats, strict=True):
            draft = whole.enter_context(whole_file(target))
            figure.savefig(
                draft, format=suffix, dpi=dpi, metadata=dict(FORMATS[suffix])
            )
    return targets


def draw(name: str, files: Sequence[str], base: str | Path, **options: Any) -> None:
    """Draw a figure of the catalogue from its files and save it.

    Parameters
    ----------
    name : str
        A name in `catalogue.FIGURES`.
    files : sequence of path
        The files of `catalogue.tables_of`, in that order.
    base : path
        Path of the figure without its suffix.
    options
        Options of `save_figure`.
    """
    content: list[Any] = []
    for path in files:
        read = read_json if path.endswith(".json") else read_table
        content.append(read(path))
    save_figure(function_of(name)(*content), base, **options)


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Lay the figure out once for all formats, instead of once for each.

    Without a layout engine, and a style that asks for one, matplotlib draws once to
    save a format; with one it draws twice.
    """
    engine = figure.get_layout_engine()
    if engine is not None and figure.axes:
        engine.execute(figure)
        _round_positions(figure)
    with matplotlib.rc_context({"figure.constrained_layout.use": False}):
        figure.set_layout_engine(None)
        try:
            yield
        finally:
            figure.set_layout_engine(engine)


def _round_positions(figure: Figure) -> None:
    """Round the positions of the axes: a layout's last bits differ between processes.

    In an SVG they would change the names of clip paths, which are digests of their
    numbers.
    """
    for axes in figure.axes:
        is_in_layout = axes.get_in_layout()
        bounds = axes.get_position(original=True).bounds
        left, bottom, width, height = (round(value, DECIMALS) for value in bounds)
        axes.set_position((left, bottom, width, height))
        # `set_position` takes the axes out of the layout.
        axes.set_in_layout(is_in_layout)
