"""One look for all figures: paper sizes, colours that colour-blind readers can tell apart."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import wraps
from math import isfinite
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure

from hopdata.errors import ConfigError, require_choice
from hopdata.figures.catalogue import FORMATS
from hopdata.jobs import whole_file

# Lines with bands, and logarithmic axes with plain numbers: what figures of errors share.


def banded_line(
    axes: Axes,
    x: pd.Series,
    y: pd.Series,
    band: tuple[pd.Series, pd.Series],
    line: tuple[Any, ...],
    size: float = 2.5,
) -> None:
    """Draw a line with a pale band from low to high.

    `line` is its label, colour, dash and marker, `size` that of the markers.
    """
    label, colour, dash, marker = line
    axes.fill_between(x, *band, color=colour, alpha=0.15, linewidth=0)
    axes.plot(x, y, color=colour, linestyle=dash, marker=marker, markersize=size, label=label)


def box(axes: Axes, place: float, quantiles: Sequence[float], colour: str, **options: Any) -> None:
    """Draw a box from its five quantiles; `options` are those of `Axes.bxp` and ``alpha``."""
    line = {"color": INK, "linewidth": 0.8}
    names = ("whislo", "q1", "med", "q3", "whishi")
    face = {"facecolor": colour, "alpha": options.pop("alpha", 0.55), "edgecolor": INK}
    axes.bxp(
        [dict(zip(names, quantiles, strict=True))], positions=[place], showfliers=False,
        patch_artist=True, boxprops=face, medianprops={"color": INK, "linewidth": 1.2},
        whiskerprops=line, capprops=line, manage_ticks=False, **options,
    )  # fmt: skip


def name_rows(axes: Axes, labels: Sequence[str]) -> None:
    """Let rows 0, 1, ... stand from the top, each with its label."""
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(max(len(labels), 1) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)


def interval(middle: float, low: float, high: float) -> list[list[float]] | None:
    """Return the error bar from `low` to `high`, none where they are not known."""
    known = isfinite(low) and isfinite(high)
    return [[middle - low], [high - middle]] if known else None


def note(axes: Axes, text: str, at: tuple[float, float], offset: Any, **options: Any) -> None:
    """Write a small text beside a place, `offset` points from it; `options` of `annotate`."""
    options = {"textcoords": "offset points", "fontsize": 6, **options}
    axes.annotate(text, xy=at, xytext=offset, **options)


def plain_numbers(axis: Axis) -> None:
    """Write the numbers of a logarithmic axis as they are, and none at minor ticks."""
    axis.set_minor_locator(ticker.NullLocator())
    axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))


Arguments = ParamSpec("Arguments")

STYLE_FILE = Path(__file__).with_name("hopdata.mplstyle")

SINGLE_COLUMN_MM = 85.0
DOUBLE_COLUMN_MM = 175.0
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

# Box behind a text that may stand on a line.
ON_WHITE = {"facecolor": "white", "linewidth": 0, "pad": 0.8}

FOOT_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
FOOT_DASHES: tuple[str | tuple[float, tuple[float, ...]], ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1.5, 1.2)),
    (0, (5, 1.2, 1.5, 1.2)),
    (0, (8, 2)),
    (0, (3, 1, 1, 1, 1, 1)),
)

LONGEST_LABEL = 24
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@contextmanager
def style_context() -> Iterator[None]:
    """Let matplotlib's defaults and the hopdata style alone hold within.

    A sign that the font lacks is drawn as a box, and no more is said of it.
    """
    with matplotlib.rc_context(fname=str(STYLE_FILE)), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .*missing from font")
        yield


def styled(draw: Callable[Arguments, Figure]) -> Callable[Arguments, Figure]:
    """Let a drawing function run within the style and leave no trace of it outside."""

    @wraps(draw)
    def draw_in_style(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Figure:
        with style_context():
            figure = draw(*args, **kwargs)
            _write_powers(figure)
            return figure

    return draw_in_style


def _write_powers(figure: Figure) -> None:
    """Write powers of ten on logarithmic axes as 10⁻³, since text is not read as mathematics."""
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        if isinstance(axis.get_major_formatter(), ticker.LogFormatterMathtext):
            axis.set_major_formatter(_Powers())
        if isinstance(axis.get_minor_formatter(), ticker.LogFormatterMathtext):
            axis.set_minor_formatter(_Powers())


class _Powers(ticker.LogFormatterSciNotation):
    """Matplotlib's formatter of powers, but with the signs of Unicode."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        text = super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")
        base, _, power = text.replace(r"\times", "×").partition("^{")
        return base + power.removesuffix("}").translate(SUPERSCRIPTS)


def label_of(name: str) -> str:
    """Return a name as figures show it: one short line, which a legend does not leave out."""
    plain = " ".join("".join(c if c.isprintable() else " " for c in name).split()) or "?"
    if len(plain) > LONGEST_LABEL:
        plain = plain[: LONGEST_LABEL - 1] + "…"
    return f" {plain}" if plain.startswith("_") else plain


def paper_figure(width_mm: float, height_mm: float) -> Figure:
    """Return an empty figure of this size, mm, laid out without overlaps."""
    return Figure(figsize=(width_mm / MM_PER_INCH, height_mm / MM_PER_INCH))


@styled
def message_figure(message: str, *, width_mm: float = SINGLE_COLUMN_MM) -> Figure:
    """Return a figure that says in words why there is nothing to draw."""
    figure = paper_figure(width_mm, 25.0)
    figure.text(0.5, 0.5, message, ha="center", va="center", color=INK, wrap=True)
    return figure


def foot_colour(number: int) -> str:
    """Colour of the foot with this number, counted from 0; repeats after six feet."""
    return FOOT_COLOURS[number % len(FOOT_COLOURS)]


def foot_dash(number: int) -> str | tuple[float, tuple[float, ...]]:
    """Line style of the foot with this number, counted from 0; repeats after six feet."""
    return FOOT_DASHES[number % len(FOOT_DASHES)]


def foot_line(number: int) -> dict[str, Any]:
    """Colour and line style of the foot with this number, as keywords of a line."""
    return {"color": foot_colour(number), "linestyle": foot_dash(number)}


def letters(panels: Iterable[Axes]) -> None:
    """Write a, b, c ... at the upper left of each panel in turn."""
    for axes, text in zip(panels, "abcdefghijklmnopqrstuvwxyz", strict=False):
        letter(axes, text)


def letter(axes: Axes, text: str) -> None:
    """Write a bold panel letter at the upper left, outside the axes."""
    axes.annotate(
        text, xy=(0, 1), xycoords="axes fraction", xytext=(-4, 4), textcoords="offset points",
        ha="right", va="bottom", fontweight="bold", fontsize=8,
    )  # fmt: skip


# Figures to files: the same data give the same bytes, and all formats are written or none.

DECIMALS = 9  # of a place, in parts of the figure


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
        As returned by the functions of this package.
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
    if not dpi > 0:
        raise ConfigError(f"figures.dpi: expected a positive number, found {dpi}")
    base = Path(path)
    targets = tuple(base.with_name(f"{base.name}.{suffix}") for suffix in formats)
    with ExitStack() as whole, style_context(), _laid_out(figure):
        for target, suffix in zip(targets, formats, strict=True):
            draft = whole.enter_context(whole_file(target))
            metadata: dict[str, Any] = dict(FORMATS[suffix])
            figure.savefig(draft, format=suffix, dpi=dpi, metadata=metadata)
    return targets


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Lay the figure out once for all formats, not once in each.

    Without an engine, and a style that asks for one, matplotlib draws once to save a format; with
    one it draws twice.
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
    """Round the places of the axes: the last bits of a layout differ from process to process.

    In an SVG they would show in the names of clip paths, which are digests of their numbers.
    """
    for axes in figure.axes:
        is_in_layout = axes.get_in_layout()
        left, bottom, width, height = (
            round(value, DECIMALS) for value in axes.get_position(original=True).bounds
        )
        axes.set_position((left, bottom, width, height))
        axes.set_in_layout(is_in_layout)  # which `set_position` takes it out of
