"""Figure 2.2: how foot heights and body height choose the Poincaré sections."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREY,
    INK,
    MM_PER_M,
    ON_WHITE,
    VERMILION,
    message_figure,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.lines import Line2D

DECADES_SHOWN = 4
MARGIN = 0.03
THRESHOLDS = ("min_foot_threshold_m", "max_foot_threshold_m")
DASHED: dict[str, Any] = {"color": INK, "linewidth": 0.8, "linestyle": (0, (4, 2)), "zorder": 3}


@dataclass(frozen=True)
class _Side:
    """One half of the figure: a foot height, its threshold and the frames that it singles out."""

    letter: str
    frames_column: str
    foot_curve: str
    body_curve: str
    other_curve: str
    threshold_key: str
    foot_label: str
    condition: str
    colour: str
    above: bool


SIDES = (
    _Side(
        letter="a",
        frames_column="min_foot_m",
        foot_curve="min_foot",
        body_curve="body_given_all_up",
        other_curve="body_given_some_down",
        threshold_key="min_foot_threshold_m",
        foot_label="lowest foot height (mm)",
        condition="all feet up",
        colour=BLUE,
        above=True,
    ),
    _Side(
        letter="b",
        frames_column="max_foot_m",
        foot_curve="max_foot",
        body_curve="body_given_all_down",
        other_curve="body_given_some_up",
        threshold_key="max_foot_threshold_m",
        foot_label="highest foot height (mm)",
        condition="all feet down",
        colour=VERMILION,
        above=False,
    ),
)


@styled
def sections_figure(
    frames: pd.DataFrame, densities: pd.DataFrame, sections: Mapping[str, Any]
) -> Figure:
    """Draw Fig. 2.2: foot against body height, their densities, thresholds and sections.

    Parameters
    ----------
    frames : DataFrame
        One row a frame: ``min_foot_m``, ``max_foot_m``, ``body_m``, m.
    densities : DataFrame
        Tidy curves: ``curve``, ``height_m``, ``density_per_m``. Curves drawn: ``min_foot`` and
        ``max_foot`` (marginal); body height ``body_given_all_up``, ``body_given_all_down`` and,
        in the other frames, ``body_given_some_down``, ``body_given_some_up``.
    sections : mapping
        ``min_foot_threshold_m``, ``max_foot_threshold_m``, ``pre_height_m``, ``post_height_m``.

    Returns
    -------
    Figure
        Two halves of 2 x 2 axes that share their height axes; the scatter is rasterised.
    """
    if frames.empty:
        return message_figure("No frame to draw: the recording holds no complete frames.")
    figure = paper_figure(DOUBLE_COLUMN_MM, 88.0)
    halves: Any = figure.subfigures(1, 2, wspace=0.02)
    for half, side in zip(halves, SIDES, strict=True):
        _draw_side(half, side, frames, densities, sections)
    figure.legend(handles=_legend_handles(), loc="outside lower center", ncols=4)
    return figure


def _draw_side(
    half: SubFigure,
    side: _Side,
    frames: pd.DataFrame,
    densities: pd.DataFrame,
    sections: Mapping[str, Any],
) -> None:
    grid = half.add_gridspec(2, 2, width_ratios=(1, 2.8), height_ratios=(1, 2.3))
    scatter = half.add_subplot(grid[1, 1])
    beside = half.add_subplot(grid[1, 0], sharey=scatter)
    above = half.add_subplot(grid[0, 1], sharex=scatter)
    threshold = _height(sections, side.threshold_key)
    _draw_scatter(scatter, side, frames, threshold)
    scatter.set(
        xlim=_span(frames[["body_m"]], sections, ("pre_height_m", "post_height_m")),
        ylim=_span(frames[["min_foot_m", "max_foot_m"]], sections, THRESHOLDS),
    )
    _draw_foot_density(beside, side, densities)
    _draw_body_density(above, side, densities)
    _draw_threshold((scatter, beside), threshold)
    _draw_sections((scatter, above), sections)
    _describe(half.add_subplot(grid[0, 0]), side)


def _describe(axes: Axes, side: _Side) -> None:
    """Say in the empty corner what the two densities of this half are."""
    axes.set_axis_off()
    axes.text(0, 1, side.letter, fontweight="bold", fontsize=8, va="top")
    axes.text(
        1, 0.5, f"body height\nwhile {side.condition}\nand otherwise", ha="right", va="center"
    )


def _draw_scatter(axes: Axes, side: _Side, frames: pd.DataFrame, threshold: float | None) -> None:
    body = frames["body_m"].to_numpy() * MM_PER_M
    foot = frames[side.frames_column].to_numpy() * MM_PER_M
    chosen = foot != foot
    if threshold is not None:
        chosen = foot > threshold if side.above else foot < threshold
    for mask, colour in ((~chosen, GREY), (chosen, side.colour)):
        axes.scatter(
            body[mask], foot[mask], s=1.2, c=colour, alpha=0.35, linewidths=0, rasterized=True
        )
    axes.set_xlabel("mean body height (mm)")
    axes.tick_params(labelleft=False)


def _draw_foot_density(axes: Axes, side: _Side, densities: pd.DataFrame) -> None:
    height, density = _curve(densities, side.foot_curve)
    axes.set_ylabel(side.foot_label)
    axes.set_xlabel("density (1/m)")
    if not len(height):
        axes.text(0.5, 0.5, "no density", ha="center", transform=axes.transAxes)
        return
    axes.semilogx(density, height, color=INK, linewidth=0.7)
    axes.set_xlim(density.max() / 10**DECADES_SHOWN, density.max() * 2)
    axes.minorticks_off()


def _draw_body_density(axes: Axes, side: _Side, densities: pd.DataFrame) -> None:
    axes.tick_params(labelbottom=False)
    axes.set_ylabel("density (1/m)")
    for name, colour in ((side.other_curve, GREY), (side.body_curve, side.colour)):
        height, density = _curve(densities, name)
        axes.plot(height, density, color=colour)
        axes.fill_between(height, density, color=colour, alpha=0.15, linewidth=0)
    if not len(_curve(densities, side.body_curve)[0]):
        text = f"no frame with {side.condition}"
        axes.text(0.5, 0.5, text, ha="center", transform=axes.transAxes, bbox=ON_WHITE)
    axes.set_ylim(bottom=0)
    axes.locator_params(axis="y", nbins=4)


def _draw_threshold(both: tuple[Axes, Axes], threshold: float | None) -> None:
    if threshold is None:
        return
    for axes in both:
        axes.axhline(threshold, **DASHED)
    both[0].annotate(
        f"{threshold:.1f} mm",
        xy=(1, threshold),
        xycoords=("axes fraction", "data"),
        xytext=(2, 0),
        textcoords="offset points",
        va="center",
        fontsize=6,
    )


def _draw_sections(both: tuple[Axes, Axes], sections: Mapping[str, Any]) -> None:
    """Draw both sections; their labels lean away from each other so that they never overlap."""
    for name, key, lean in (("post", "post_height_m", "right"), ("pre", "pre_height_m", "left")):
        height = _height(sections, key)
        if height is None:
            continue
        for axes in both:
            axes.axvline(height, **DASHED)
        both[1].annotate(
            f"{name} {height:.0f} mm",
            xy=(height, 1),
            xycoords=("data", "axes fraction"),
            xytext=(3 if lean == "right" else -3, 2),
            textcoords="offset points",
            ha=lean,
            va="bottom",
            fontsize=6,
        )


def _legend_handles() -> list[Line2D]:
    from matplotlib.lines import Line2D

    dots = [(side.colour, f"frame with {side.condition}") for side in SIDES]
    dots.append((GREY, "other frame"))
    handles = [Line2D([], [], color=c, marker="o", ls="", ms=3, label=text) for c, text in dots]
    handles.append(Line2D([], [], label="threshold, Poincaré section", **DASHED))
    return handles


def _height(sections: Mapping[str, Any], key: str) -> float | None:
    """Height in mm, or None where the sections could not be found."""
    value = sections.get(key)
    return None if value is None or value != value else float(value) * MM_PER_M


def _curve(densities: pd.DataFrame, name: str) -> tuple[Any, Any]:
    """Heights (mm) and density (1/m) of one curve, both empty if it is missing."""
    curve = densities[densities["curve"] == name]
    return curve["height_m"].to_numpy() * MM_PER_M, curve["density_per_m"].to_numpy()


def _span(
    heights: pd.DataFrame, sections: Mapping[str, Any], keys: tuple[str, ...]
) -> tuple[float, float]:
    """Limits in mm that hold all of these heights, those of the sections, and a margin."""
    marks = [mark for mark in (_height(sections, key) for key in keys) if mark is not None]
    low = min([float(heights.min().min()) * MM_PER_M, *marks])
    high = max([float(heights.max().max()) * MM_PER_M, *marks])
    margin = MARGIN * (high - low) or 1.0
    return low - margin, high + margin
