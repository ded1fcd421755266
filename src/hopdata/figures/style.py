"""One look for all figures: paper sizes, colours that colour-blind readers can tell apart."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Arguments = ParamSpec("Arguments")

STYLE_FILE = Path(__file__).with_name("hopdata.mplstyle")

SINGLE_COLUMN_MM = 85.0
DOUBLE_COLUMN_MM = 175.0
MM_PER_INCH = 25.4
MM_PER_M = 1000.0
MS_PER_S = 1000.0

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
    import matplotlib

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
    from matplotlib.ticker import LogFormatterMathtext

    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        if isinstance(axis.get_major_formatter(), LogFormatterMathtext):
            axis.set_major_formatter(_powers()())
        if isinstance(axis.get_minor_formatter(), LogFormatterMathtext):
            axis.set_minor_formatter(_powers()())


@lru_cache(maxsize=1)
def _powers() -> Any:
    """Return matplotlib's formatter of powers, but with the signs of Unicode."""
    from matplotlib.ticker import LogFormatterSciNotation

    class Powers(LogFormatterSciNotation):
        def __call__(self, x: float, pos: int | None = None) -> str:
            text = super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")
            base, _, power = text.replace(r"\times", "×").partition("^{")
            return base + power.removesuffix("}").translate(SUPERSCRIPTS)

    return Powers


def label_of(name: str) -> str:
    """Return a name as figures show it: one short line, which a legend does not leave out."""
    plain = " ".join("".join(c if c.isprintable() else " " for c in name).split()) or "?"
    if len(plain) > LONGEST_LABEL:
        plain = plain[: LONGEST_LABEL - 1] + "…"
    return f" {plain}" if plain.startswith("_") else plain


def paper_figure(width_mm: float, height_mm: float) -> Figure:
    """Return an empty figure of this size, mm, laid out without overlaps."""
    from matplotlib.figure import Figure

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


def letter(axes: Axes, text: str) -> None:
    """Write a bold panel letter at the upper left, outside the axes."""
    axes.annotate(
        text,
        xy=(0, 1),
        xycoords="axes fraction",
        xytext=(-4, 4),
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontweight="bold",
        fontsize=8,
    )
