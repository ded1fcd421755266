"""Models of the frame change: Figure 3.3, learning curve, smoothness of the kernel."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.arrays import FloatArray
from hopdata.figures import style

# Figure 3.3: the frame change of a hop over boom angle and swing, and its uncertainty.

# Column of the tables: title, label with unit, whether the colours are centred on zero.
COMPONENTS = {
    "dx_mm": ("forward", "Δx (mm)", False),
    "dy_mm": ("sideways", "Δy (mm)", True),
    "dtheta_deg": ("turn", "Δθ (degrees)", True),
}
# Colour maps of a component, of one that is centred on zero, and of deviations.
ONE_SIDED = "cividis"
ABOUT_ZERO = style.OF_SIGNS
SPREAD = "Greys"
# Quantiles of the hops that the colours cover.
COVERED = [0.02, 0.98]


@style.styled
def frame_change_figure(maps: pd.DataFrame, hops: pd.DataFrame) -> Figure:
    """Draw three maps above their standard deviations, together with the hops.

    Parameters
    ----------
    maps : DataFrame
        One row per node of an even grid: ``boom_angle_rad``, ``swing_rad``, the
        predictions ``dx_mm, dy_mm, dtheta_deg``, and their standard deviations, with
        ``_sd``.
    hops : DataFrame
        Training hops: the same columns without the standard deviations.

    Returns
    -------
    Figure
        Each panel has its own scale. Dots are hops, coloured by the measured value.
    """
    if maps.empty:
        return style.message_figure("No map of frame changes to show.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 88.0)
    panels = figure.subplots(2, len(COMPONENTS), sharex=True, sharey=True)
    bar: Any = {"location": "bottom", "aspect": 25, "pad": 0.03}
    for k, (name, (title, label, centred)) in enumerate(COMPONENTS.items()):
        upper = panels[0, k]
        image = _draw_component(upper, maps, hops, name, centred=centred)
        upper.set_title(title)
        figure.colorbar(image, ax=upper, label=label, **bar)
        lower = panels[1, k]
        image = _draw_deviation(lower, maps, hops, f"{name}_sd")
        figure.colorbar(image, ax=lower, label=f"sd of {label}", **bar)
    _axes(panels)
    style.letters(panels.flat)
    return figure


@style.styled
def printed_and_own_figure(
    printed: pd.DataFrame, own: pd.DataFrame, hops: pd.DataFrame
) -> Figure:
    """Draw Figure 3.3 by the printed model above the study's own, on the same hops.

    Parameters
    ----------
    printed, own : DataFrame
        Maps as for `frame_change_figure`, without need of the standard deviations.
    hops : DataFrame
        Training hops.

    Returns
    -------
    Figure
        Three panels of each, with one scale for a component. Swings are drawn at one
        scale, too; where the own map goes farther, lines show how far the printed one
        does.
    """
    if printed.empty or own.empty:
        return style.message_figure("No map of frame changes to show.")
    largest = [float(maps["swing_rad"].max()) for maps in (printed, own)]
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 92.0)
    panels = figure.subplots(2, len(COMPONENTS), sharex=True, height_ratios=largest)
    bar: Any = {"location": "bottom", "aspect": 25, "pad": 0.03}
    for k, (name, (title, label, centred)) in enumerate(COMPONENTS.items()):
        values = pd.concat([printed[name], own[name]])
        colours, limits = _colours(values, hops[name], centred)
        above, below = panels[:, k]
        rows = zip((above, below), (printed, own), largest, strict=True)
        for axes, maps, swing in rows:
            is_inside = hops["swing_rad"].abs() <= swing + 1e-9
            image = _draw_map(axes, maps, name, colours, limits)
            _draw_hops(axes, hops[is_inside], name, colours, limits)
        above.set_title(title)
        if largest[1] > largest[0]:
            for swing in (-largest[0], largest[0]):
                below.axhline(swing, color=style.INK, linewidth=0.6, linestyle=":")
        figure.colorbar(image, ax=panels[:, k], label=label, **bar)
    _axes(panels)
    quarters = [-np.pi / 4, 0.0, np.pi / 4]
    for row, swing in zip(panels, largest, strict=True):
        for axes in row:
            axes.set_yticks(quarters, ["−π/4", "0", "π/4"])
            # A table is rounded: what is meant to be the last tick must not be cut off.
            axes.set_ylim(-swing - 1e-6, swing + 1e-6)
    for axes in panels[0]:
        axes.tick_params(labelbottom=False)
    panels[0, 0].set_ylabel("printed model\nswing Δφ (rad)")
    panels[1, 0].set_ylabel("hopdata's model\nswing Δφ (rad)")
    style.letters(panels.flat)
    return figure


def _draw_component(
    axes: Axes, maps: pd.DataFrame, hops: pd.DataFrame, name: str, *, centred: bool
) -> Any:
    """Draw a component of the frame change, with the hops in the same colours."""
    colours, limits = _colours(maps[name], hops[name], centred)
    image = _draw_map(axes, maps, name, colours, limits)
    _draw_hops(axes, hops, name, colours, limits)
    return image


def _draw_hops(
    axes: Axes,
    hops: pd.DataFrame,
    name: str,
    colours: str,
    limits: tuple[float, float],
) -> None:
    """Draw hops as dots in the colour of their measured component."""
    axes.scatter(
        hops["boom_angle_rad"],
        hops["swing_rad"],
        c=hops[name],
        cmap=colours,
        vmin=limits[0],
        vmax=limits[1],
        s=5,
        linewidths=0.3,
        edgecolors=style.INK,
    )


def _draw_deviation(
    axes: Axes, maps: pd.DataFrame, hops: pd.DataFrame, name: str
) -> Any:
    """Draw the standard deviation of a component, and where the hops are."""
    limits = (maps[name].min(), maps[name].max())
    image = _draw_map(axes, maps, name, SPREAD, limits)
    dots: Any = {"color": style.INK, "s": 1.5, "linewidths": 0}
    axes.scatter(hops["boom_angle_rad"], hops["swing_rad"], **dots)
    return image


def _colours(
    predicted: pd.Series, measured: pd.Series, centred: bool
) -> tuple[str, tuple[float, float]]:
    """Return a colour map, and limits that cover the map and nearly all hops."""
    values = np.concatenate([predicted, np.quantile(measured, COVERED)])
    low = float(values.min())
    high = float(values.max())
    if centred:
        largest = max(abs(low), abs(high))
        return ABOUT_ZERO, (-largest, largest)
    return ONE_SIDED, (low, high)


def _draw_map(
    axes: Axes, maps: pd.DataFrame, name: str, colours: str, limits: tuple[float, float]
) -> Any:
    """Draw a column of the table over boom angle and swing."""
    wide = maps.pivot_table(index="swing_rad", columns="boom_angle_rad", values=name)
    angle = wide.columns.to_numpy(float)
    swing = wide.index.to_numpy(float)
    return axes.imshow(
        wide.to_numpy(float),
        cmap=colours,
        vmin=limits[0],
        vmax=limits[1],
        aspect="auto",
        origin="lower",
        interpolation="bilinear",
        extent=(*_edges(angle), *_edges(swing)),
    )


def _edges(nodes: FloatArray) -> tuple[float, float]:
    """Return the outer edges of the cells around evenly spaced nodes."""
    half = (nodes[-1] - nodes[0]) / (len(nodes) - 1) / 2
    return float(nodes[0] - half), float(nodes[-1] + half)


def _axes(panels: Any) -> None:
    """Set ticks and labels, and mark where the turn begins and ends."""
    turns = [-2, -1, 0, 1, 2, 3, 4]
    labels = ["−2π", "", "0", "", "2π", "", "4π"]
    for axes in panels.ravel():
        for turn in (0.0, 2 * np.pi):
            axes.axvline(turn, color=style.INK, linewidth=0.6, linestyle=(0, (4, 2)))
        axes.set_xticks([turn * np.pi for turn in turns], labels)
        axes.set_yticks([-1, 0, 1])
    for axes in panels[-1]:
        axes.set_xlabel("boom angle φ (rad)")
    for axes in panels[:, 0]:
        axes.set_ylabel("swing Δφ (rad)")


# Error of predicted frame changes over the number of training hops.

# Model: its label, colour, line style and marker.
LINES: dict[str, tuple[str, str, Any, str]] = {
    "printed": ("as printed", style.GREY, "-", "o"),
    "recommended": ("periodic, standardised", style.OURS, "-", "s"),
}
PANELS = {"dx": "forward (mm)", "dy": "sideways (mm)", "dtheta": "turn (degrees)"}


@style.styled
def learning_curve_figure(table: pd.DataFrame) -> Figure:
    """Draw the errors of three components, one panel each.

    Parameters
    ----------
    table : DataFrame
        One row per setting: ``model`` (of `LINES`; others are ignored), ``component``
        (of `PANELS`), ``hops``, and over random sets of hops ``rmse, rmse_q05,
        rmse_q95``.

    Returns
    -------
    Figure
        Means over the number of hops (logarithmic), with bands from 5 to 95 % of the
        sets.
    """
    if not table["model"].isin(LINES).any():
        return style.message_figure("No learning curve to show.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 62.0)
    panels = figure.subplots(1, len(PANELS))
    for axes, (component, label) in zip(panels, PANELS.items(), strict=True):
        _draw_learning_curve(axes, table[table["component"] == component])
        axes.set(title=label, xscale="log", xlabel="hops learned from")
        sizes = sorted(table["hops"].unique())
        axes.xaxis.set_major_locator(ticker.FixedLocator(sizes))
        style.plain_numbers(axes.xaxis)
    panels[0].set_ylabel("rms error of a hop")
    style.lettered(figure, panels, ncols=4)
    return figure


def _draw_learning_curve(axes: Axes, table: pd.DataFrame) -> None:
    """Draw the errors of one component."""
    for model, line in LINES.items():
        rows = table[table["model"] == model].sort_values("hops")
        band = (rows["rmse_q05"], rows["rmse_q95"])
        style.banded_line(axes, rows["hops"], rows["rmse"], band, line)
    axes.grid(axis="y")


# How well kernels of four smoothnesses predict, by what is fitted and in which units.

# Reading: its label, colour, line style and marker.
READINGS: dict[str, tuple[str, str, Any, str]] = {
    "printed, all fixed": ("printed formula, nothing fitted", style.GREY, "-", "o"),
    "printed, length fitted": ("length fitted, mm", style.PRINTED, (0, (5, 1.5)), "v"),
    "printed, length and noise fitted, mm": (
        "length and noise fitted, mm", style.SHADE, (0, (3, 1, 1, 1)), "D",
    ),
    "printed, length and noise fitted, m": (
        "length and noise fitted, m", style.PALE, (0, (1.5, 1.2)), "^",
    ),
    "standardised, all fitted": ("standardised, all fitted", style.OURS, "-", "s"),
}  # fmt: skip
DATA = {"smooth truth": "analytic, smooth", "hopper": "hopper"}
COLUMNS = {"dx": "forward", "dy": "sideways", "dtheta": "turn"}
SMOOTHNESSES = {0.5: "1/2", 1.5: "3/2", 2.5: "5/2", np.inf: "∞"}
FLOOR = -0.15  # lower values are drawn here
SHIFT = 0.05  # offset between readings of one smoothness


@style.styled
def kernel_smoothness_figure(table: pd.DataFrame) -> Figure:
    """Draw the fraction of variance that is predicted, by smoothness.

    Parameters
    ----------
    table : DataFrame
        One row per setting: ``data`` (of `DATA`), ``reading`` (of `READINGS`),
        ``component`` (of `COLUMNS`), ``smoothness``, ``r2`` and its standard error
        ``r2_se``.

    Returns
    -------
    Figure
        One row of panels per data set. Values below `FLOOR` are drawn at `FLOOR`.
    """
    rows = [name for name in DATA if (table["data"] == name).any()]
    if not rows:
        return style.message_figure("No kernels to compare.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 22.0 + 40.0 * len(rows))
    panels = figure.subplots(
        len(rows), len(COLUMNS), sharex=True, sharey=True, squeeze=False
    )
    for line, data in zip(panels, rows, strict=True):
        for axes, component in zip(line, COLUMNS, strict=True):
            chosen = (table["data"] == data) & (table["component"] == component)
            _draw_smoothness(axes, table[chosen])
        line[0].set_ylabel(f"{DATA[data]}\nR² of other hops")
    for k, title in enumerate(COLUMNS.values()):
        panels[0, k].set_title(title)
        panels[-1, k].set_xlabel("smoothness ν of the kernel")
    panels[0, 0].set_xticks(range(len(SMOOTHNESSES)), list(SMOOTHNESSES.values()))
    panels[0, 0].set_yticks([0, 0.25, 0.5, 0.75, 1])
    style.lettered(figure, panels.flat, ncols=3)
    return figure


def _draw_smoothness(axes: Axes, table: pd.DataFrame) -> None:
    """Draw the readings beside each other, for one component of one data set."""
    smoothnesses = list(SMOOTHNESSES)
    for k, (reading, (label, colour, dash, marker)) in enumerate(READINGS.items()):
        rows = table[table["reading"] == reading].sort_values("smoothness")
        ticks = np.array([smoothnesses.index(value) for value in rows["smoothness"]])
        axes.errorbar(
            ticks + SHIFT * (k - 2),
            rows["r2"].clip(lower=FLOOR),
            yerr=np.where(rows["r2"] > FLOOR, rows["r2_se"], 0),
            color=colour,
            linestyle=dash,
            marker=marker,
            markersize=3,
            elinewidth=0.6,
            label=label,
        )
    axes.set_ylim(FLOOR - 0.05, 1.05)
    axes.grid(axis="y")
