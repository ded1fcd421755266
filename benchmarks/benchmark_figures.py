"""Draw a figure of the benchmarks from their tables.

    python benchmarks/benchmark_figures.py map_error results/benchmarks/map_error.csv
    --out map_error

The workflow has a rule for each figure (`BENCHMARK_FIGURES` in
`workflow/rules/benchmarks.smk`).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.figures import style
from hopdata.jobs import read_table

# Colour and marker of each curve in turn.
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


# Way: colour, line style and marker. Ways of one package share a colour.
WAYS: dict[str, tuple[str, Any, str]] = {
    "hopdata, call": (style.BLUE, "-", "o"),
    "hopdata, batch": (style.BLUE, (0, (4, 1.5)), "o"),
    "heyoka": (style.VERMILION, "-", "s"),
    "heyoka, batch": (style.VERMILION, (0, (4, 1.5)), "s"),
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
    "rocking_block": "rocking block (Housner)",
    "neuron": "neuron (McKean)",
    "chua": "Chua's circuit",
    "buck_converter": "buck converter",
    "gears": "gears with backlash",
    "bouncing_ball": "bouncing ball",
    "shaken_ball": "ball on a shaken table",
    "spiking_neuron": "neuron (Izhikevich)",
    "boost_converter": "boost converter",
    "wall_pendulum": "pendulum with a wall",
    "three_body": "three bodies (Arenstorf)",
    "rimless_wheel": "rimless wheel",
    "stick_slip": "mass that sticks and slips",
}
MOST_ACROSS = 3  # panels in a row


@style.styled
def work_precision_figure(table: pd.DataFrame, chosen: pd.DataFrame) -> Figure:
    """Draw the time of a trajectory against the error of its end, one panel per scene.

    Parameters
    ----------
    table : DataFrame
        One row per scene, solver and setting: ``scene, way, method, setting, error_max,
        time_median_us, time_q25_us, time_q75_us``. Rows without a time are left out.
    chosen : DataFrame
        One row per scene and solver: ``scene, way, method, error`` (of the comparison),
        and ``best_of_way``, whether the line is emphasised.

    Returns
    -------
    Figure
        One line per solver, with the quartiles of its times. The chosen method of each
        way is emphasised, the others are faint. A dotted line marks the error of the
        comparison.
    """
    done = table[table["time_median_us"].notna() & (table["error_max"] > 0)]
    scenes = list(dict.fromkeys(done["scene"]))
    if not scenes:
        return style.message_figure("No work-precision results: no solver finished.")
    rows, across = -(-len(scenes) // MOST_ACROSS), min(len(scenes), MOST_ACROSS)
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 26.0 + 62.0 * rows)
    grid = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False)
    panels = grid.ravel()[: len(scenes)]
    strong = chosen[chosen["best_of_way"]]
    for axes, scene in zip(panels, scenes, strict=True):
        best = strong[strong["scene"] == scene]
        pairs = zip(best["way"], best["method"], strict=True)
        _draw_scene(axes, done[done["scene"] == scene], set(pairs))
        axes.axvline(
            float(chosen["error"].iloc[0]),
            color=style.INK,
            linewidth=0.6,
            linestyle=":",
        )
        axes.set_title(SCENE_NAMES.get(scene, scene), loc="left")
    style.letters(panels)
    for axes in grid.ravel():
        axes.set(xscale="log", yscale="log")
        axes.grid()
    for axes in panels[-across:]:  # the lowest panel of each column
        axes.set_xlabel(
            "largest error of the final state\n(SI units; table 4.3 has none)"
        )
        axes.tick_params(labelbottom=True)
    for axes in grid.ravel()[len(scenes) :]:
        axes.remove()
    for axes in grid[:, 0]:
        axes.set_ylabel("time of a trajectory (µs)")
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
    """Add one legend entry per way, in the order of `WAYS`, then those not listed there."""
    from matplotlib.lines import Line2D

    names = [way for way in WAYS if way in seen] + [
        way for way in seen if way not in WAYS
    ]
    handles = []
    for way in names:
        colour, dash, marker = WAYS.get(way, OTHER_WAY)
        look: Any = {
            "color": colour,
            "linestyle": dash,
            "marker": marker,
            "markersize": 2.6,
        }
        handles.append(Line2D([], [], label=way, **look))
    figure.legend(
        handles=handles, loc="outside lower center", ncols=5, handlelength=2.6
    )


# Times beside ours at one error: a row for each system, a mark for each package.

# Way: colour, marker, and whether it is filled. Batches are open.
RIVALS: dict[str, tuple[str, str, bool]] = {
    "heyoka": (style.VERMILION, "s", True),
    "heyoka, batch": (style.VERMILION, "s", False),
    "CVODE, C": (style.GREEN, "^", True),
    "diffrax": (style.PURPLE, "D", True),
    "SciPy, Numba": (style.ORANGE, "v", True),
    "hopdata, batch": (style.BLUE, "o", False),
}
RIVAL_NAMES = {"CVODE, C": "CVODE (C)", "SciPy, Numba": "SciPy"}
OUR_CALL = "hopdata, call"
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Ways that panels leave out: as slow as SciPy with compiled functions.
AS_SLOW = ("SciPy, Python", "CVODE, scikit-sundae")


@style.styled
def side_by_side_figure(chosen: pd.DataFrame) -> Figure:
    """Draw the time of each package relative to ours, one row per system.

    Parameters
    ----------
    chosen : DataFrame
        One row per scene and solver: ``scene, way, error, time_us, ratio`` (its time
        over that of our call) and ``best_of_way``; others are left out.

    Returns
    -------
    Figure
        A mark for each package in each system, on a logarithmic axis; batches are
        open. The line at 1 is our call, whose time stands beside it.
    """
    best = chosen[chosen["best_of_way"].astype(bool)]
    scenes = list(dict.fromkeys(best["scene"]))
    if not scenes:
        return style.message_figure("No side by side results: no solver finished.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 30.0 + 6.5 * len(scenes))
    axes = figure.subplots()
    rows = {scene: len(scenes) - 1 - k for k, scene in enumerate(scenes)}
    for row in rows.values():
        axes.axhline(row, color=style.GREY, linewidth=0.4, alpha=0.4, zorder=0)
    axes.axvline(1.0, color=style.BLUE, linewidth=1.6, zorder=1)
    for way, (colour, marker, filled) in RIVALS.items():
        marks = best[(best["way"] == way) & best["ratio"].notna()]
        axes.plot(
            marks["ratio"], marks["scene"].map(rows), linestyle="none", color=colour,
            marker=marker, markersize=4.2, markerfacecolor=colour if filled else "white",
            label=RIVAL_NAMES.get(way, way), zorder=3,
        )  # fmt: skip
    axes.set(xscale="log", ylim=(-0.7, len(scenes) - 0.3))
    axes.set_yticks(list(rows.values()), [SCENE_NAMES.get(one, one) for one in rows])
    axes.tick_params(axis="y", length=0)
    axes.xaxis.set_major_formatter(ticker.FuncFormatter(_times))
    axes.grid(axis="x")
    power = round(np.log10(float(best["error"].iloc[0])))
    axes.set_xlabel(
        "time of a trajectory over that of a call of hopdata, "
        f"both at an error of 10{str(power).translate(RAISED)}"
    )
    _write_our_times(axes, best[best["way"] == OUR_CALL], rows)
    figure.legend(loc="outside upper center", ncols=6, handletextpad=0.2)
    return figure


def _times(value: float, _: object) -> str:
    """Return a factor as it is read: 0.1, 1, 10."""
    return f"{value:g}"


def _write_our_times(axes: Axes, ours: pd.DataFrame, rows: dict[str, int]) -> None:
    """Write the time of our call at the right of each row."""
    for scene, time_us in zip(ours["scene"], ours["time_us"], strict=True):
        if np.isfinite(time_us):
            axes.annotate(
                f"{time_us:.0f} µs", (1.0, rows[scene]), (4, 0), va="center",
                xycoords=axes.get_yaxis_transform(), textcoords="offset points",
                color=style.BLUE,
            )  # fmt: skip
    axes.annotate(
        "hopdata", (1.0, len(rows) - 0.3), (4, 1), va="bottom", color=style.BLUE,
        xycoords=axes.get_yaxis_transform(), textcoords="offset points",
    )  # fmt: skip


def side_by_side_panels_figure(table: pd.DataFrame, chosen: pd.DataFrame) -> Figure:
    """Draw time against error, one panel per system, with each way's fastest method.

    The tables are those of `work_precision_figure`. Ways in `AS_SLOW` are left out.
    """
    best = chosen[chosen["best_of_way"].astype(bool) & ~chosen["way"].isin(AS_SLOW)]
    drawn = table.merge(best[["scene", "way", "method"]])
    return work_precision_figure(drawn, chosen)


# Error of the estimated landing map by number of landings, for levels of noise.

# Estimator: label, colour, line style, marker. OLS on rigid-body coordinates equals the
# printed one except for rounding, and is left out.
ESTIMATORS: dict[str, tuple[str, str, Any, str]] = {
    "printed": ("least squares, as printed", style.GREY, "-", "o"),
    "corrected": ("corrected for noise", style.ORANGE, (0, (5, 1.5)), "s"),
    "curved": ("with curvature", style.BLUE, (0, (1.5, 1.2)), "^"),
    "corrected_curved": ("with both", style.VERMILION, "-", "D"),
}
STATES = {
    "split_fit": "states split at contacts",
    "savitzky_golay": "states by 7-frame cubic",
}


@style.styled
def map_error_figure(table: pd.DataFrame) -> Figure:
    """Draw the errors, with a row of panels per way of fitting states and a column per noise.

    Parameters
    ----------
    table : DataFrame
        One row per setting: ``states`` (of `STATES`), ``noise_mm``, ``estimator`` (of
        `ESTIMATORS`; others are left out), ``landings``, and over the draws ``median,
        q05, q95``.

    Returns
    -------
    Figure
        Logarithmic axes; bands from 5 to 95 %.
    """
    ways = [way for way in STATES if (table["states"] == way).any()]
    if not ways:
        return style.message_figure("No errors of maps to show.")
    noises = sorted(table["noise_mm"].unique())
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 20.0 + 47.0 * len(ways))
    panels = figure.subplots(
        len(ways), len(noises), sharex=True, sharey=True, squeeze=False
    )
    for row, way in zip(panels, ways, strict=True):
        for axes, noise in zip(row, noises, strict=True):
            _draw_errors(
                axes, table[(table["states"] == way) & (table["noise_mm"] == noise)]
            )
        row[0].set_ylabel(f"relative error of the map\n{STATES[way]}")
    for axes, noise in zip(panels[0], noises, strict=True):
        axes.set_title(f"{noise:g} mm" if noise > 0 else "no noise")
    for axes in panels[-1]:
        axes.set_xlabel("landings")
    style.letters(panels.flat)
    axes = panels[0, 0]  # all panels share its scales
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(ticker.FixedLocator([60, 250, 1000, 3000]))
    axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    for axis in (axes.xaxis, axes.yaxis):
        style.plain_numbers(axis)
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4
    )
    return figure


def _draw_errors(axes: Axes, table: pd.DataFrame) -> None:
    for estimator, line in ESTIMATORS.items():
        rows = table[table["estimator"] == estimator].sort_values("landings")
        if rows.empty:
            continue
        style.banded_line(
            axes, rows["landings"], rows["median"], (rows["q05"], rows["q95"]), line
        )
    axes.grid(axis="y")


# Size and power of the verdict: false alarms, differences found, and the sizes
# estimated.

SAME = "C1"
# Kind of control: label, colour, marker.
CONTROLS = {
    "kappa": ("coupled forces, κ", style.VERMILION, "s"),
    "eps": ("rigid impulses, ε", style.GREEN, "^"),
    "tau": ("contact by velocity, τ", style.ORANGE, "D"),
}
LEVEL, WANTED_POWER = 0.05, 0.8
TOLERATED = (0.02, 0.08)


@style.styled
def verdict_power_figure(table: pd.DataFrame) -> Figure:
    """Draw how often simulated studies find a difference, and its size.

    Parameters
    ----------
    table : DataFrame
        One row per condition and number of landings: ``condition`` (those that begin
        with ``C1`` have no difference), ``asked`` (landings of a study; the largest
        number is shown), ``true_effect``, ``found_share`` with its interval
        ``found_low`` and ``found_high``, ``effect_mean`` and ``effect_sd``.

    Returns
    -------
    Figure
        (a) False alarms for C1 landings; (b) power by true difference; (c) ratio of
        estimated to true difference. Bars are 95 % intervals in (a) and (b), standard
        deviations in (c).
    """
    if table.empty:
        return style.message_figure("No simulated studies to show.")
    whole = table["asked"] <= 2100  # larger ones join several studies
    most = (
        table[whole].groupby("condition")["asked"].max().min()
    )  # all conditions have it
    table = table[table["asked"] == most]
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 66.0)
    left, middle, right = figure.subplots(1, 3)
    same = table["condition"].str.startswith(SAME)
    _draw_alarms(left, table[same])
    none = table[table["condition"] == SAME]
    for kind in CONTROLS:
        rows = table[table["condition"].str.startswith(f"{kind} ")]
        if len(rows):
            _draw_power(middle, rows, kind)
            _draw_sizes(right, rows, kind)
    _label_power(middle, none)
    _label_sizes(right, table[~same])
    figure.legend(
        *middle.get_legend_handles_labels(), loc="outside upper right", ncols=4
    )
    style.letters((left, middle, right))
    return figure


def _draw_alarms(axes: Axes, rows: pd.DataFrame) -> None:
    places = np.arange(len(rows))[::-1]
    share = rows["found_share"].to_numpy()
    bars = np.abs(rows[["found_low", "found_high"]].to_numpy().T - share)
    axes.axvspan(
        *(100 * edge for edge in TOLERATED), color=style.GREY, alpha=0.2, linewidth=0
    )
    axes.axvline(100 * LEVEL, color=style.INK, linewidth=0.6)
    axes.errorbar(
        100 * share, places, xerr=100 * bars, fmt="o", color=style.BLUE, markersize=3
    )
    names = [
        str(name).removeprefix(SAME).strip() or "hopper" for name in rows["condition"]
    ]
    axes.set_yticks(places, names)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("false alarms (%)\ngrey: 2 to 8 %, line: nominal")


def _draw_power(axes: Axes, rows: pd.DataFrame, kind: str) -> None:
    label, colour, marker = CONTROLS[kind]
    ordered = rows.sort_values("true_effect")
    share = ordered["found_share"].to_numpy()
    bars = np.abs(ordered[["found_low", "found_high"]].to_numpy().T - share)
    axes.errorbar(
        ordered["true_effect"], 100 * share, yerr=100 * bars,
        color=colour, marker=marker, markersize=3, label=label,
    )  # fmt: skip


def _label_power(axes: Axes, none: pd.DataFrame) -> None:
    if len(none):
        axes.plot(
            [0.0],
            100 * none["found_share"],
            "o",
            color=style.BLUE,
            markersize=3,
            label="hopper",
        )
    axes.axhline(
        100 * WANTED_POWER, color=style.INK, linewidth=0.6, linestyle=(0, (4, 2))
    )
    axes.set_ylim(-3.0, 103.0)
    axes.set_xlabel("true difference (share of the map)")
    axes.set_ylabel("studies that find a difference (%)")


def _draw_sizes(axes: Axes, rows: pd.DataFrame, kind: str) -> None:
    _, colour, marker = CONTROLS[kind]
    axes.errorbar(
        rows["true_effect"], rows["effect_mean"], yerr=rows["effect_sd"],
        fmt=marker, color=colour, markersize=3,
    )  # fmt: skip


def _label_sizes(axes: Axes, rows: pd.DataFrame) -> None:
    most = float(rows[["true_effect", "effect_mean"]].max().max()) if len(rows) else 1.0
    axes.plot([0.0, most], [0.0, most], color=style.GREY, linewidth=0.8, zorder=0)
    axes.set_xlabel("true difference (share of the map)")
    axes.set_ylabel("estimated difference")


# Published foot-strike detectors beside ours: errors, and orders that are right.


@style.styled
def foot_strikes_figure(table: pd.DataFrame) -> Figure:
    """Draw the errors of each detector's instants, and how often its order is right.

    Parameters
    ----------
    table : DataFrame
        One row per condition and method: ``condition``, ``method``, ``found``,
        ``bias_ms``, ``sd_ms`` and ``order_right``; NaN where a method finds nothing.

    Returns
    -------
    Figure
        A panel of errors, with a line from bias - sd to bias + sd for each condition,
        and a panel of orders.
    """
    table = table[np.isfinite(table["sd_ms"].astype(float))]
    if not len(table):
        return style.message_figure("No detector found anything.")
    methods = list(dict.fromkeys(table["method"]))[::-1]
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 95.0)
    errors, orders = figure.subplots(1, 2, sharey=True, width_ratios=(2, 1))
    conditions = list(dict.fromkeys(table["condition"]))
    for k, (condition, (colour, marker)) in enumerate(
        zip(conditions, LOOKS, strict=False)
    ):
        rows = table[table["condition"] == condition]
        place = np.array([methods.index(method) for method in rows["method"]], float)
        place += 0.3 - 0.6 * k / max(len(conditions) - 1, 1)
        errors.errorbar(
            rows["bias_ms"], place, xerr=rows["sd_ms"], fmt=marker, color=colour, markersize=3,
            linewidth=1.0, label=condition,
        )  # fmt: skip
        orders.plot(
            100 * rows["order_right"], place, marker, color=colour, markersize=3
        )
    errors.axvline(0.0, color=style.GREY, linewidth=0.8, zorder=0)
    errors.set_yticks(range(len(methods)), methods)
    errors.set_xlabel("error of an instant: bias and standard deviation (ms)")
    orders.set_xlabel("orders right (%)")
    orders.set_xlim(0.0, 103.0)
    figure.legend(loc="outside upper center", ncols=2, fontsize=6)
    return figure


# What a study costs by the length of its recordings.


@style.styled
def study_cost_figure(table: pd.DataFrame) -> Figure:
    """Draw the memory of the largest process and the processor time per frame, by number of frames.

    Parameters
    ----------
    table : DataFrame
        One row per size: ``frames``, ``peak_mb``, ``cpu_us_per_frame``.
    """
    if not len(table):
        return style.message_figure("No study was measured.")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 60.0)
    memory, times = figure.subplots(1, 2)
    memory.plot(table["frames"], table["peak_mb"], "o-", color=style.BLUE)
    memory.axhline(3000.0, color=style.GREY, linestyle=":")
    memory.set_ylabel("largest process (MB)")
    times.plot(table["frames"], table["cpu_us_per_frame"], "o-", color=style.BLUE)
    times.set_ylabel("processor time of a frame (µs)")
    for axes in (memory, times):
        axes.set_xscale("log")
        axes.margins(y=0.1)
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("frames")
    style.letters((memory, times))
    return figure


FIGURES: dict[str, Callable[..., Figure]] = {
    "work_precision": work_precision_figure,
    "side_by_side": side_by_side_figure,
    "side_by_side_panels": side_by_side_panels_figure,
    "map_error": map_error_figure,
    "verdict_power": verdict_power_figure,
    "foot_strikes": foot_strikes_figure,
    "study_cost": study_cost_figure,
}


def main(figures: Mapping[str, Callable[..., Figure]] = FIGURES) -> None:
    """Draw the figure that the command line names, of these."""
    parser = argparse.ArgumentParser(description="Draw a figure of the benchmarks.")
    parser.add_argument("figure", choices=figures)
    parser.add_argument(
        "tables", type=Path, nargs="+", help="CSV tables that it is drawn from"
    )
    parser.add_argument("--out", type=Path, required=True, help="path without a suffix")
    parser.add_argument("--formats", nargs="+", default=["svg", "png"])
    parser.add_argument("--dpi", type=float, default=200.0)
    options = parser.parse_args()
    figure = figures[options.figure](*map(read_table, options.tables))
    style.save_figure(figure, options.out, formats=options.formats, dpi=options.dpi)


if __name__ == "__main__":
    main()
