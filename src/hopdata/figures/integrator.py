"""Work and precision: time of a trajectory against the error of its end, our solver and peers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.figures import style

# Figure 4.2: how the error of the final state falls with the step, for each method.

# Colour and marker of each method in turn. Curves may lie on one another, so markers are hollow,
# of different shapes, and the earlier ones larger.
LOOKS: tuple[tuple[str, str], ...] = (
    (style.BLUE, "o"),
    (style.ORANGE, "s"),
    (style.VERMILION, "x"),
    (style.SKY, "+"),
    (style.GREY, "*"),
    (style.INK, "^"),
    (style.GREEN, "D"),
    (style.PURPLE, "v"),
)
LARGEST, SMALLEST = 6.5, 2.6  # points
MOST_MARKERS = 24
LIGHT_GREY = "#d4d4d4"  # opaque, so that intervals on one another look like one


@style.styled
def order_figure(errors: pd.DataFrame) -> Figure:
    """Draw Fig. 4.2: error against the inverse of the longest step, on logarithmic axes.

    Parameters
    ----------
    errors : DataFrame
        One row a method and step: ``method``, ``max_step``, ``error_rms``, ``in_fit`` (whether the
        order was fitted to it), ``fitted_order`` and ``fitted_error`` (the line's error there).
        A method whose order is NaN has no line.

    Returns
    -------
    Figure
        A curve a method, the line fitted to it dashed, and the steps it was fitted to on grey.
    """
    if not (errors["error_rms"] > 0).any():
        return style.message_figure("No errors: no method was measured.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 95.0)
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log")
    names = list(dict.fromkeys(errors["method"]))
    for place, name in enumerate(names):
        rows = errors[errors["method"] == name].sort_values("max_step")
        _draw_method(axes, rows, place, len(names))
    shown = errors.loc[errors["error_rms"] > 0, "error_rms"]
    axes.set_ylim(shown.min() / 3, shown.max() * 5)
    axes.set_xlabel("1/ε, inverse of the longest step (dimensionless)")
    axes.set_ylabel("RMS error of the final state (dimensionless)")
    axes.grid(visible=True, which="major")
    axes.minorticks_off()
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper")
    return figure


def _draw_method(axes: Axes, rows: pd.DataFrame, place: int, count: int) -> None:
    colour, marker = LOOKS[place % len(LOOKS)]
    size = LARGEST - (LARGEST - SMALLEST) * place / max(count - 1, 1)
    inverse = 1.0 / rows["max_step"].to_numpy()
    used, order = rows["in_fit"].to_numpy(dtype=bool), float(rows["fitted_order"].iloc[0])
    if np.isfinite(order):
        _draw_fit(axes, inverse, rows["fitted_error"].to_numpy(), used, colour)
    axes.plot(
        inverse, rows["error_rms"], color=colour, linestyle=":", linewidth=0.8, marker=marker,
        markersize=size, markerfacecolor="none", markeredgewidth=0.8, label=_name(rows, order),
        markevery=max(1, len(rows) // MOST_MARKERS), zorder=3 + place,
    )  # fmt: skip


def _draw_fit(
    axes: Axes, inverse: np.ndarray, line: np.ndarray, used: np.ndarray, colour: str
) -> None:
    axes.plot(inverse, line, color=colour, linestyle="--", linewidth=0.7, label="_fit", zorder=2)
    wide: dict[str, Any] = {"linewidth": 9, "solid_capstyle": "butt"}
    axes.plot(inverse[used], line[used], color=LIGHT_GREY, label="_interval", zorder=1, **wide)


def _name(rows: pd.DataFrame, order: float) -> str:
    fitted = f"order {order:.2f}" if np.isfinite(order) else "no straight part"
    return f"{rows['method'].iloc[0]}\n{fitted}"


# Figure 4.3: the hopper's trajectory by MuJoCo and by our integrator, beside the exact one.

# solver: its colour, its line style, its width.
LINES: dict[str, tuple[str, Any, float]] = {
    "exact": (style.GREY, (0, (1, 1)), 2.2),
    "MuJoCo default contact": (style.BLUE, (0, (5, 1.5)), 1.0),
    "MuJoCo best at 2 ms": (style.PURPLE, (0, (5, 1.2, 1.5, 1.2)), 1.0),
    "hopdata": (style.VERMILION, "-", 0.8),
}
# quantity: its unit, as it ends the names of columns and as the reader sees it.
QUANTITIES = {"height": ("m", "m"), "velocity": ("m_s", "m/s")}


@style.styled
def calibration_figure(trajectories: pd.DataFrame) -> Figure:
    """Draw Fig. 4.3: height and velocity above, the sizes of their residuals below.

    Parameters
    ----------
    trajectories : DataFrame
        One row a solver and instant: ``solver`` (of `LINES`), ``time_s``, ``height_m``,
        ``velocity_m_s``, and ``height_residual_m``, ``velocity_residual_m_s``, which are the
        deviations from the exact solution.

    Returns
    -------
    Figure
        Two columns; the residuals are on a logarithmic axis, where an exact value has no place.
    """
    if trajectories.empty:
        return style.message_figure("No trajectories to compare.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 95.0)
    axes = figure.subplots(2, 2, sharex=True, height_ratios=(1, 1))
    for (upper, lower), (quantity, (end, unit)) in zip(axes.T, QUANTITIES.items(), strict=True):
        _draw(upper, trajectories, f"{quantity}_{end}", residual=False)
        _draw(lower, trajectories, f"{quantity}_residual_{end}", residual=True)
        upper.set_ylabel(f"{quantity} ({unit})")
        lower.set_ylabel(f"|{quantity} residual| ({unit})")
        lower.set_xlabel("time (s)")
    style.letters(axes.flat)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _draw(axes: Axes, trajectories: pd.DataFrame, column: str, *, residual: bool) -> None:
    """Draw a column for each solver: as it is, or its size on a logarithmic axis."""
    for solver, (colour, dash, width) in LINES.items():
        rows = trajectories[trajectories["solver"] == solver]
        if rows.empty or (residual and solver == "exact"):
            continue
        values = rows[column].abs().where(rows[column] != 0) if residual else rows[column]
        line: Any = {"color": colour, "linestyle": dash, "linewidth": width, "label": solver}
        axes.plot(rows["time_s"], values, **line)
    if residual:
        axes.set_yscale("log")
        axes.grid(axis="y")


# Figure 4.4: run time on the plate by number of contacts, for MuJoCo and our integrator.

# solver: what the reader sees, its colour, its line style.
SERIES: dict[str, tuple[str, str, Any]] = {
    "MuJoCo contact 2 ms": ("MuJoCo, its contacts, 2 ms", style.BLUE, (0, (5, 1.5))),
    "MuJoCo callback 2 ms": ("MuJoCo, our springs, 2 ms", style.GREEN, (0, (5, 1.2, 1.5, 1.2))),
    "hopdata": ("hopdata", style.VERMILION, "-"),
    "hopdata sums": ("hopdata, sums kept", style.ORANGE, (0, (1.5, 1.2))),
}


@style.styled
def scaling_figure(times: pd.DataFrame, marginal: pd.DataFrame) -> Figure:
    """Draw Fig. 4.4: run time (a), marginal run time (b) and error (c) by number of contacts.

    Parameters
    ----------
    times : DataFrame
        One row a solver (of `SERIES`; others are left out) and number of contacts: ``solver``,
        ``n_contacts``, ``time_median_us_per_s``, ``time_q25_us_per_s``, ``time_q75_us_per_s``,
        ``error_median`` and ``error_max``.
    marginal : DataFrame
        One row a solver and window: ``solver``, ``window`` (only ``local`` is drawn),
        ``n_contacts``, ``marginal_us_per_contact_s``, ``low95_us_per_contact_s``,
        ``high95_us_per_contact_s``.

    Returns
    -------
    Figure
        Bands are quartiles in (a), 95 % confidence in (b), and median to largest in (c).
    """
    if times.empty:
        return style.message_figure("No run times to compare.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 66.0)
    left, middle, right = figure.subplots(1, 3)
    local = marginal[marginal["window"] == "local"]
    _bands(left, times, "time_q25_us_per_s", "time_median_us_per_s", "time_q75_us_per_s")
    _bands(
        middle, local,
        "low95_us_per_contact_s", "marginal_us_per_contact_s", "high95_us_per_contact_s",
    )  # fmt: skip
    _bands(right, times, "error_median", "error_median", "error_max")
    left.set_ylabel("run time per simulated second (µs)")
    middle.set_ylabel("run time per further contact (µs/s)")
    right.set_ylabel("error of the final state (m, rad, 1/s)")
    left.set_yscale("log")
    right.set_yscale("log")
    middle.axhline(0.0, color="#333333", linewidth=0.5)
    for axes in (left, middle, right):
        axes.set_xlabel("number of contacts")
        axes.grid(axis="y")
    style.letters((left, middle, right))
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _bands(axes: Axes, table: pd.DataFrame, low: str, middle: str, high: str) -> None:
    """Draw a line and the band about it for each solver."""
    for solver, (label, colour, dash) in SERIES.items():
        rows = table[table["solver"] == solver].sort_values("n_contacts")
        if rows.empty:
            continue
        n = rows["n_contacts"]
        axes.fill_between(n, rows[low], rows[high], color=colour, alpha=0.2, linewidth=0)
        axes.plot(n, rows[middle], color=colour, linestyle=dash, label=label)


# way: its colour, line style and marker; of a package alike in colour.
WAYS: dict[str, tuple[str, Any, str]] = {
    "hopdata, call": (style.BLUE, "-", "o"),
    "hopdata, batch": (style.BLUE, (0, (4, 1.5)), "o"),
    "heyoka": (style.VERMILION, "-", "s"),
    "CVODE, C": (style.GREEN, "-", "^"),
    "CVODE, scikit-sundae": (style.GREEN, (0, (4, 1.5)), "^"),
    "diffrax": (style.PURPLE, "-", "D"),
    "SciPy, Numba": (style.ORANGE, "-", "v"),
    "SciPy, Python": (style.ORANGE, (0, (4, 1.5)), "v"),
    "MuJoCo": (style.SKY, "-", "P"),
}
OTHER_WAY = (style.GREY, "-", "x")
SCENE_NAMES = {
    "octant": "three affine modes (table 4.3)",
    "vertical_hopper": "hopper in one dimension",
    "plate": "plate on 35 springs",
}


@style.styled
def work_precision_figure(table: pd.DataFrame, chosen: pd.DataFrame) -> Figure:
    """Draw the time of a trajectory against the error of its end, one panel a scene.

    Parameters
    ----------
    table : DataFrame
        One row a scene, solver and setting: ``scene, way, method, setting, error_max,
        time_median_us, time_q25_us, time_q75_us``. Rows without a time are left out.
    chosen : DataFrame
        One row a scene and solver: ``scene, way, method, error`` (at which they are compared), and
        ``best_of_way``, whether the line is drawn strongly.

    Returns
    -------
    Figure
        One line a solver, with the quartiles of its times; the chosen method of each way strong,
        the others faint. A dotted line at the error at which they are compared.
    """
    done = table[table["time_median_us"].notna() & (table["error_max"] > 0)]
    scenes = list(dict.fromkeys(done["scene"]))
    if not scenes:
        return style.message_figure("No work-precision results: no solver finished.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 88.0)
    panels = figure.subplots(1, len(scenes), sharex=True, sharey=True, squeeze=False)[0]
    strong = chosen[chosen["best_of_way"]]
    for number, (axes, scene) in enumerate(zip(panels, scenes, strict=True)):
        best = strong[strong["scene"] == scene]
        pairs = zip(best["way"], best["method"], strict=True)
        _draw_scene(axes, done[done["scene"] == scene], set(pairs))
        axes.axvline(float(chosen["error"].iloc[0]), color=style.INK, linewidth=0.6, linestyle=":")
        axes.set_title(SCENE_NAMES.get(scene, scene), loc="left")
        style.letter(axes, "abcdefgh"[number])
    for axes in panels:
        axes.set(xscale="log", yscale="log")
        axes.grid()
        axes.set_xlabel("largest error of the final state\n(SI units; table 4.3 has none)")
    panels[0].set_ylabel("time of a trajectory (µs)")
    _add_legend(figure, list(dict.fromkeys(done["way"])))
    return figure


def _draw_scene(axes: Axes, rows: pd.DataFrame, strong: set[tuple[Any, Any]]) -> None:
    for key, line in rows.groupby(["way", "method"], sort=False):
        way, method = key
        colour, dash, marker = WAYS.get(str(way), OTHER_WAY)
        ordered = line.sort_values("setting", ascending=False)
        error, median = ordered["error_max"], ordered["time_median_us"]
        if (way, method) not in strong:
            axes.plot(error, median, color=colour, linewidth=0.5, alpha=0.35, zorder=1)
            continue
        spread = [median - ordered["time_q25_us"], ordered["time_q75_us"] - median]
        axes.errorbar(
            error, median, yerr=spread, color=colour, linestyle=dash, marker=marker, markersize=2.6,
            elinewidth=0.5, zorder=3, label=f"{way}: {method}",
        )  # fmt: skip


def _add_legend(figure: Figure, seen: list[str]) -> None:
    """Name each way once: in the order of `WAYS`, then those it does not know."""
    from matplotlib.lines import Line2D

    names = [way for way in WAYS if way in seen] + [way for way in seen if way not in WAYS]
    handles = []
    for way in names:
        colour, dash, marker = WAYS.get(way, OTHER_WAY)
        look: Any = {"color": colour, "linestyle": dash, "marker": marker, "markersize": 2.6}
        handles.append(Line2D([], [], label=way, **look))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, handlelength=2.6)
