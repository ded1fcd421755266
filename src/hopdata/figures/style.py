"""One look for all figures: paper sizes, colours that colour-blind readers can tell apart."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import lru_cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

from hopdata.errors import ConfigError, did_you_mean
from hopdata.jobs import whole_file

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

# Lines with bands, and logarithmic axes with plain numbers: what figures of errors share.


def banded_line(
    axes: Axes, x: pd.Series, y: pd.Series, band: tuple[pd.Series, pd.Series], line: tuple[Any, ...]
) -> None:
    """Draw a line with a pale band from low to high; `line` is its label, colour, dash, marker."""
    label, colour, dash, marker = line
    axes.fill_between(x, *band, color=colour, alpha=0.15, linewidth=0)
    axes.plot(x, y, color=colour, linestyle=dash, marker=marker, markersize=2.5, label=label)


def plain_numbers(axis: Axis) -> None:
    """Write the numbers of a logarithmic axis as they are, and none at minor ticks."""
    from matplotlib.ticker import FuncFormatter, NullLocator

    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


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


# Figures to files: the same data give the same bytes, and all formats are written or none.

# A date or a library version in the file would change its bytes without a change of the data.
METADATA: Mapping[str, Mapping[str, str | None]] = {
    "svg": {"Date": None, "Creator": "hopdata"},
    "png": {"Software": "hopdata"},
    "pdf": {"CreationDate": None, "Creator": "hopdata", "Producer": "hopdata"},
}
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
    _check(formats, dpi)
    base = Path(path)
    targets = tuple(base.with_name(f"{base.name}.{suffix}") for suffix in formats)
    with ExitStack() as whole, style_context(), _laid_out(figure):
        for target, suffix in zip(targets, formats, strict=True):
            draft = whole.enter_context(whole_file(target))
            metadata: dict[str, Any] = dict(METADATA[suffix])
            figure.savefig(draft, format=suffix, dpi=dpi, metadata=metadata)
    return targets


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Lay the figure out once for all formats, not once in each.

    Without an engine, and a style that asks for one, matplotlib draws once to save a format; with
    one it draws twice.
    """
    import matplotlib

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


def _check(formats: Sequence[str], dpi: float) -> None:
    for name in formats:
        if name not in METADATA:
            raise ConfigError(
                f"figures.formats: expected one of {', '.join(METADATA)}, found '{name}'"
                f"{did_you_mean(name, METADATA)}"
            )
    if not dpi > 0:
        raise ConfigError(f"figures.dpi: expected a positive number, found {dpi}")
