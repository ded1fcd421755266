"""Figure 2.2: how foot heights and body height determine the Poincaré sections."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from hopdata.arrays import BoolArray, FloatArray
from hopdata.figures import style

# Decades of the density of a foot's height.
DECADES_SHOWN = 4
# Heights at which branches may be labelled, in reaches of the foot above its threshold.
LABEL_BANDS = ((0.25, 0.45), (0.45, 0.65), (0.65, 0.85))
# Length of such a label and its distance from the branch, in ranges of body height.
LABEL_LENGTH = 0.42
# Space around the points, as a share of their range.
MARGIN = 0.03
THRESHOLDS = ("min_foot_threshold_m", "max_foot_threshold_m")
DASHED: dict[str, Any] = {"color": style.INK, "lw": 0.8, "ls": (0, (4, 2)), "zorder": 3}
DOTTED: dict[str, Any] = {**DASHED, "ls": (0, (1, 2))}


@dataclass(frozen=True)
class _Side:
    """Half of the figure: a foot height, its threshold, and frames that it selects."""

    letter: str
    section: str
    # The foot height that decides.
    foot: str
    # Position of all feet in the selected frames.
    where: str
    # Position of some feet in the other frames.
    otherwise: str
    # Curve of the body's heights at the contact that bounds the section.
    contact: str
    # Curve of those at the turning point on its other side.
    turn: str

    @property
    def condition(self) -> str:
        return f"all feet {self.where}"


SIDES = (
    _Side("a", "pre", "min_foot", "up", "down", "first_contact", "top"),
    _Side("b", "post", "max_foot", "down", "up", "last_contact", "lowest"),
)
# The section by the rule beside the chosen one.
RULES_IN_WORDS = {
    "printed": "section by the printed rule",
    "landings": "section chosen from landings",
}


@style.styled
def sections_figure(
    frames: pd.DataFrame,
    densities: pd.DataFrame,
    sections: Mapping[str, Any],
    *,
    landings: bool = True,
) -> Figure:
    """Draw Fig. 2.2: foot and body heights, their densities, thresholds and sections.

    Parameters
    ----------
    frames : DataFrame
        One row per frame: ``min_foot_m``, ``max_foot_m``, ``body_m``, m; ``landing``,
        whether it belongs to a descent in which all feet land. If the sections are of
        landings, other frames are grey.
    densities : DataFrame
        Tidy curves: ``curve``, ``height_m``, ``density_per_m``. Curves drawn:
        ``min_foot`` and ``max_foot`` (marginal); body height ``body_given_all_up``,
        ``body_given_all_down`` and, in the other frames, ``body_given_some_down``,
        ``body_given_some_up``; body height in landings, ``top``, ``first_contact``,
        ``last_contact`` and ``lowest``.
    sections : mapping
        ``min_foot_threshold_m``, ``max_foot_threshold_m``, ``pre_height_m``,
        ``post_height_m``, ``frames``; ``held``, the share of the landings that each
        section holds; ``decided``, and ``beside``, the heights by the other rule.
    landings : bool
        Whether to draw the densities in landings, which the printed figure lacks.

    Returns
    -------
    Figure
        Two halves, one per section, of 3 x 2 axes (2 x 2 without the densities in
        landings) with shared height axes. The range
        between the sections is yellow, as in Fig. 2.3. The scatter plot is rasterised.
    """
    if frames.empty:
        return style.message_figure(
            "No frame to draw: the recording holds no complete frames."
        )
    height_mm = 104.0
    if not landings:
        height_mm = 86.0
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, height_mm)
    # One for the pre section, on the left, and one for the post section.
    halves: Any = figure.subfigures(1, 2, wspace=0.02)
    for half, side in zip(halves, SIDES, strict=True):
        _draw_side(half, side, frames, densities, sections, landings)
    handles = _legend_handles(sections, landings)
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _draw_side(
    half: SubFigure,
    side: _Side,
    frames: pd.DataFrame,
    densities: pd.DataFrame,
    sections: Mapping[str, Any],
    with_landings: bool,
) -> None:
    heights = [1, 2.3]
    if with_landings:
        heights = [1, 1, 2.3]
    grid = half.add_gridspec(
        len(heights), 2, width_ratios=(1, 2.8), height_ratios=heights
    )
    scatter = half.add_subplot(grid[-1, 1])
    beside = half.add_subplot(grid[-1, 0], sharey=scatter)
    above = half.add_subplot(grid[-2, 1], sharex=scatter)
    with_sections = [scatter, above]
    if with_landings:
        landings = half.add_subplot(grid[0, 1], sharex=scatter)
        _draw_landing_density(landings, side, densities)
        with_sections.append(landings)
    threshold = _height(sections, f"{side.foot}_threshold_m")
    _draw_scatter(scatter, side, frames, threshold, sections)
    scatter.set(
        xlim=_span(frames[["body_m"]], sections, ("pre_height_m", "post_height_m")),
        ylim=_span(frames[["min_foot_m", "max_foot_m"]], sections, THRESHOLDS),
    )
    _draw_foot_density(beside, side, densities)
    _draw_body_density(above, side, densities)
    _draw_threshold((scatter, beside), threshold)
    _draw_sections(with_sections, sections, side)
    title = f"{side.section.capitalize()} section: {_said(sections, side)}"
    half.suptitle(
        f"{side.letter}   {title}",
        color=style.INK,
        x=0.02,
        ha="left",
        fontsize=style.pt(8),
        fontweight="bold",
    )


def _said(sections: Mapping[str, Any], side: _Side) -> str:
    """Say where a section lies, and how many landings it holds by count."""
    height = _height(sections, f"{side.section}_height_m")
    if height is None:
        return "not found"
    said = f"{height:.0f} mm"
    if sections.get("chosen_by", {}).get(f"{side.section}_height_m") == "config":
        said += " (given)"
    held = sections.get("landing_shares", {}).get(side.section)
    if held is not None:
        said += f", holds {np.floor(100 * held):.0f} % of landings"
    return said


def _draw_scatter(
    axes: Axes,
    side: _Side,
    frames: pd.DataFrame,
    threshold: float | None,
    sections: Mapping[str, Any],
) -> None:
    of_landings = sections.get("frames") == "landings"
    body = frames["body_m"].to_numpy() * 1e3
    foot = frames[f"{side.foot}_m"].to_numpy() * 1e3
    landing = frames["landing"].to_numpy(bool)
    if threshold is None:
        chosen = np.zeros(len(foot), bool)
    elif side.where == "up":
        chosen = foot > threshold
    else:
        chosen = foot < threshold
    if threshold is not None and of_landings:
        chosen &= landing
    if threshold is not None and not of_landings:
        lines = _section_lines(sections, side)
        _name_branches(axes, body, foot, landing, threshold, lines)
    look: Any = {"s": 1.2, "alpha": 0.35, "linewidths": 0, "rasterized": True}
    for mask, colour in ((~chosen, style.GREY), (chosen, style.FOUND)):
        axes.scatter(body[mask], foot[mask], c=colour, **look)
    axes.set_xlabel("mean body height (mm)")
    axes.tick_params(labelleft=False)


def _name_branches(
    axes: Axes,
    body: FloatArray,
    foot: FloatArray,
    landing: BoolArray,
    threshold: float,
    lines: list[float],
) -> None:
    """Label the two branches of frames in the air as descent and ascent.

    Each label stands beside its branch, at the lowest height at which none of the
    vertical `lines`, mm, crosses it.
    """
    length = LABEL_LENGTH * np.ptp(body)
    waiting = ["descent", "ascent"]
    for low, high in LABEL_BANDS:
        reach = foot.max() - threshold
        bottom = threshold + low * reach
        top = threshold + high * reach
        inside = (bottom < foot) & (foot < top)
        if not (inside & landing).any() or not (inside & ~landing).any():
            continue
        places = {
            "descent": float(np.median(body[inside & landing])),
            "ascent": float(np.median(body[inside & ~landing])),
        }
        middle = (bottom + top) / 2
        # A copy, since what is labelled waits no longer.
        for name in list(waiting):
            place = places[name]
            if place == min(places.values()):
                begin = float(place - length)
                shift = -12
                side = "right"
            else:
                begin = place
                shift = 12
                side = "left"
            if any(begin < line < begin + length for line in lines):
                continue
            look = {"ha": side, "va": "center", "fontsize": 7}
            style.note(axes, name, (place, middle), (shift, 0), **look)
            waiting.remove(name)


def _section_lines(sections: Mapping[str, Any], side: _Side) -> list[float]:
    """Return the heights of a section by either rule, mm."""
    key = f"{side.section}_height_m"
    heights = (_height(sections, key), _height(sections.get("other_rule", {}), key))
    return [height for height in heights if height is not None]


def _draw_foot_density(axes: Axes, side: _Side, densities: pd.DataFrame) -> None:
    height, density = _curve(densities, side.foot)
    which = {"min_foot": "lowest", "max_foot": "highest"}[side.foot]
    axes.set_ylabel(f"{which} foot height (mm)")
    axes.set_xlabel("density (1/m)")
    if not len(height):
        style.lacking(axes, 0.5, 0.5, "no density", axes.transAxes)
        return
    axes.semilogx(density, height, color=style.INK, linewidth=0.7)
    axes.set_xlim(density.max() / 10**DECADES_SHOWN, density.max() * 2)
    axes.minorticks_off()


def _draw_body_density(axes: Axes, side: _Side, densities: pd.DataFrame) -> None:
    axes.tick_params(labelbottom=False)
    axes.set_ylabel("density (1/m)")
    given = f"body_given_all_{side.where}"
    others = f"body_given_some_{side.otherwise}"
    for name, colour in ((others, style.GREY), (given, style.FOUND)):
        height, density = _curve(densities, name)
        axes.plot(height, density, color=colour)
        axes.fill_between(height, density, color=colour, alpha=0.15, linewidth=0)
    if not len(_curve(densities, given)[0]):
        style.lacking(axes, 0.5, 0.5, f"no frame with {side.condition}", axes.transAxes)
    axes.set_ylim(bottom=0)
    axes.locator_params(axis="y", nbins=4)


def _draw_landing_density(axes: Axes, side: _Side, densities: pd.DataFrame) -> None:
    """Draw the body's heights in landings: at the contact, and at the turn beyond."""
    axes.tick_params(labelbottom=False)
    axes.set_ylabel("density (1/m)")
    for name, colour in ((side.turn, style.GREY), (side.contact, style.INK)):
        height, density = _curve(densities, name)
        axes.plot(height, density, color=colour, linewidth=0.9)
    if not len(_curve(densities, side.contact)[0]):
        style.lacking(axes, 0.5, 0.5, "no landings", axes.transAxes)
    axes.set_ylim(bottom=0)
    axes.locator_params(axis="y", nbins=3)


def _draw_threshold(both: tuple[Axes, Axes], threshold: float | None) -> None:
    if threshold is None:
        return
    for axes in both:
        axes.axhline(threshold, **{**DASHED, "zorder": 0.5})
    look: Any = {"xycoords": ("axes fraction", "data"), "va": "center"}
    style.note(both[0], f"{threshold:.1f} mm", (1, threshold), (2, 0), **look)


def _draw_sections(
    each: Iterable[Axes], sections: Mapping[str, Any], side: _Side
) -> None:
    """Draw a section, that by the other rule, and the range between both sections."""
    other = _height(sections.get("other_rule", {}), f"{side.section}_height_m")
    own = _height(sections, f"{side.section}_height_m")
    pre = _height(sections, "pre_height_m")
    post = _height(sections, "post_height_m")
    yellow: Any = {
        "color": style.BETWEEN_SECTIONS,
        "alpha": 0.35,
        "linewidth": 0,
        "zorder": -1,
    }
    for axes in each:
        if other is not None:
            axes.axvline(other, **DOTTED)
        if pre is not None and post is not None:
            axes.axvspan(post, pre, **yellow)
        if own is not None:
            axes.axvline(own, **DASHED)


def _legend_handles(sections: Mapping[str, Any], landings: bool) -> list[Artist]:
    chosen = " or ".join(f"{side.condition} ({side.letter})" for side in SIDES)
    dots = [(style.FOUND, chosen), (style.NOT_FOUND, "other frames")]
    dot: Any = {"marker": "o", "ls": "", "ms": 3}
    handles: list[Artist] = []
    for colour, text in dots:
        handles.append(Line2D([], [], color=colour, label=text, **dot))
    handles.append(Line2D([], [], label="threshold, section", **DASHED))
    between: Any = {"facecolor": style.BETWEEN_SECTIONS, "alpha": 0.35, "linewidth": 0}
    handles.append(Patch(label="transition, pre to post", **between))
    if _height(sections.get("other_rule", {}), "pre_height_m") is not None:
        rule = sections["other_rule"]["rule"]
        label = RULES_IN_WORDS.get(rule, f"section by the rule {rule}")
        handles.append(Line2D([], [], label=label, **DOTTED))
    if landings:
        curves = ((style.INK, "contact"), (style.GREY, "turn"))
        for colour, name in curves:
            label = f"landings: at a {name}"
            handles.append(Line2D([], [], color=colour, lw=0.9, label=label))
    return handles


def _height(sections: Mapping[str, Any], key: str) -> float | None:
    """Return a height in mm, or None if the sections could not be found."""
    value = sections.get(key)
    if value is None or np.isnan(value):
        return None
    return float(value) * 1e3


def _curve(densities: pd.DataFrame, name: str) -> tuple[Any, Any]:
    """Return heights (mm) and density (1/m) of a curve, both empty if it is missing."""
    curve = densities[densities["curve"] == name]
    height_mm = curve["height_m"].to_numpy() * 1e3
    return height_mm, curve["density_per_m"].to_numpy()


def _span(
    heights: pd.DataFrame, sections: Mapping[str, Any], keys: tuple[str, ...]
) -> tuple[float, float]:
    """Return limits in mm that include all heights and the sections, with a margin."""
    low = float(heights.min().min()) * 1e3
    high = float(heights.max().max()) * 1e3
    for key in keys:
        mark = _height(sections, key)
        if mark is not None:
            low = min(low, mark)
            high = max(high, mark)
    margin = MARGIN * (high - low)
    if margin == 0.0:
        margin = 1.0
    return low - margin, high + margin
