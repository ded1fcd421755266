"""Lines with bands, and logarithmic axes with plain numbers: what figures of errors share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis


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
