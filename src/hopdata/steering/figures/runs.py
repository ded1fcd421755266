"""Figures of the steering study: a run as a film, outcomes, and a run in the arena."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image as Images

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.figures import style

# Size of a picture of the film.
WIDTH_MM = 90.0
HEIGHT_MM = 112.0
DPI = 110.0
# Speed of the film relative to real time.
SPEED = 2.0
# Number of colours of its palette.
COLOURS = 48
# Space around the run.
MARGIN_M = 0.25
# Duration of the last picture.
LAST_S = 1.5
NO_RUN = "No stance was seen in any run, so there is none to show."


def save_film(path: str | Path, film: pd.DataFrame, curves: pd.DataFrame) -> None:
    """Write a film of one run as an animated GIF; without a run, a picture says so.

    Parameters
    ----------
    path : path
    film : DataFrame
        Markers of the run in evenly spaced frames: ``time_s, marker, x_m, y_m, z_m``;
        body markers, and the boom's as ``boom``.
    curves : DataFrame
        Stances of the same run, as for `steering_run_figure`; the rows "measured" are
        used.

    Raises
    ------
    AnalysisError
        If there is a run, but fewer than two frames of it.
    """
    from hopdata.jobs import whole_file

    if curves.empty:
        with whole_file(path) as temporary:
            _still(NO_RUN).save(temporary, format="GIF")
        return
    times = film["time_s"].drop_duplicates().to_numpy()
    if len(times) < 2:
        raise AnalysisError.at("film", "frames of a run", len(times))
    with style.style_context():
        pictures = _pictures(film, curves[curves["curve"] == "measured"], times)
    each_ms = round(1000 * float(np.diff(times).mean()) / SPEED)
    last_ms = round(1000 * LAST_S)
    durations = [each_ms] * (len(pictures) - 1) + [last_ms]
    with whole_file(path) as temporary:
        pictures[0].save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=pictures[1:],
            duration=durations,
            loop=0,
            optimize=False,
            disposal=1,
        )


def _still(message: str) -> Images.Image:
    """Return a picture that says why there is no film."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    with style.style_context():
        figure = style.message_figure(message, width_mm=WIDTH_MM)
        figure.set_dpi(DPI)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]).quantize(COLOURS)


def _pictures(
    film: pd.DataFrame, stances: pd.DataFrame, times: Any
) -> list[Images.Image]:
    """Draw all frames: the static parts once, and the moving ones on top."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    names = list(film["marker"].unique())
    places = film[["x_m", "y_m", "z_m"]].to_numpy().reshape(len(times), len(names), 3)
    figure, moving, reach = _stage(places)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    still = canvas.copy_from_bbox(figure.bbox)  # type: ignore[attr-defined]
    palette: Images.Image | None = None
    pictures = []
    for time, markers in zip(times, places, strict=True):
        canvas.restore_region(still)  # type: ignore[attr-defined]
        _move(moving, time, markers, stances, reach)
        for artist in moving.values():
            artist.axes.draw_artist(artist)
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
        if palette is None:
            palette = picture.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
        pictures.append(picture.quantize(palette=palette, dither=Image.Dither.NONE))
    return pictures


def _stage(places: Any) -> tuple[Figure, dict[str, Any], float]:
    """Return the figure, its moving artists, and half the board's length, m."""
    figure = style.paper_figure(WIDTH_MM, HEIGHT_MM)
    figure.set_dpi(DPI)
    above, side = figure.subplots(2, 1, sharex=True, height_ratios=(4.2, 1))
    low = np.fmin(np.nanmin(places, axis=(0, 1))[:2], 0) - MARGIN_M
    high = np.fmax(np.nanmax(places, axis=(0, 1))[:2], 0) + MARGIN_M
    middle = (low + high) / 2
    half = max(high - low) / 2
    left, bottom = middle - half
    right, top = middle + half
    above.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", ylabel="y (m)")
    highest = 1.1 * float(np.nanmax(places[..., 2]))
    side.set(ylim=(-0.05, highest), xlabel="x (m)", ylabel="height (m)")
    side.axhline(0.0, color=style.INK, linewidth=0.8)
    above.plot(0, 0, marker="*", color=style.VERMILION, mec="white", ms=12)
    return figure, _moving(above, side), 2 * half


def _moving(above: Any, side: Any) -> dict[str, Any]:
    """Return the moving artists, animated: drawn on top of the static picture."""

    def line(axes: Any, shape: str, colour: str, **look: Any) -> Any:
        (artist,) = axes.plot([], [], shape, color=colour, animated=True, **look)
        return artist

    board = line(above, "-", BOARD_LAST, lw=3)
    path = line(above, "o-", style.GREY, ms=2.5, lw=0.9)
    nowhere = [0, 0, 0]
    (body,) = above.fill(nowhere, nowhere, color=style.BLUE, alpha=0.75, animated=True)
    boom = line(above, "o-", style.INK, lw=1.6, ms=5, markevery=[1])
    time = above.text(
        0.02, 0.98, "", transform=above.transAxes, va="top", animated=True
    )
    return {
        "board_line": board,
        "path": path,
        "body": body,
        "boom": boom,
        "time": time,
        "side_body": line(side, "o-", style.BLUE, lw=2, ms=3),
        "side_boom": line(side, "o-", style.INK, lw=1.2, ms=4, markevery=[1]),
    }


def _board_axes(stances: pd.DataFrame) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors into the board and along it, (2,); NaN without a board."""
    into = stances[["board_x", "board_y"]].iloc[0].to_numpy(dtype=float)
    along = np.array([-into[1], into[0]])
    return into, along


def _move(
    moving: dict[str, Any],
    time: float,
    markers: Any,
    stances: pd.DataFrame,
    reach: float,
) -> None:
    """Update all moving artists to this time."""
    body = markers[:-1]
    boom = markers[-1]
    centre = body.mean(axis=0)
    past = stances[stances["time_s"] <= time]
    ring = np.concatenate([body, body[:1]])
    moving["path"].set_data(past["x_m"], past["y_m"])
    moving["body"].set_xy(ring[:, :2])
    moving["boom"].set_data([centre[0], boom[0]], [centre[1], boom[1]])
    moving["time"].set_text(f"hop {max(0, len(past) - 1)}, {max(0.0, time):.1f} s")
    moving["side_body"].set_data(ring[:, 0], ring[:, 2])
    moving["side_boom"].set_data([centre[0], boom[0]], [centre[2], boom[2]])
    into, along = _board_axes(stances)
    distance = float(stances["board_first_m"].iloc[0])
    if not past.empty:
        distance = past["board_m"].iloc[-1]
    ends = np.stack([distance * into - reach * along, distance * into + reach * along])
    moving["board_line"].set_data(ends[:, 0], ends[:, 1])


# Success rates, and hops to the goal, of all controllers over the seeds.

LOOKS = {
    "none": ("boom at rest", style.GREY, "v"),
    "random": ("random swings", style.ORANGE, "^"),
    "printed": ("printed controller", style.VERMILION, "s"),
    "planner": ("planner", style.BLUE, "o"),
    "adaptive": ("planner that goes on learning", style.PURPLE, "P"),
    "ceiling": ("planner that knows the true map", style.GREEN, "D"),
}
TASKS = {
    "origin": "to the origin",
    "origin_board": "to the origin,\nboard in the way",
    "turn": "half turn",
    "turn_board": "half turn,\nboard in the way",
}
# Offset between the controllers of one task, in rows.
APART = 0.17
# Success that is required of the planner, per cent.
REQUIRED = 90


@style.styled
def steering_outcomes_figure(
    outcomes: pd.DataFrame, runs: pd.DataFrame, horizons: pd.DataFrame
) -> Figure:
    """Draw success rates and hops to the goal of all controllers.

    Parameters
    ----------
    outcomes : DataFrame
        From `hopdata.steering.experiments.outcomes.outcome_table`.
    runs : DataFrame
        One row per run: ``experiment, controller, seed, success, hops``.
    horizons : DataFrame
        ``horizon, runs, succeeded`` of the printed controller; no rows if none was
        asked for.

    Returns
    -------
    Figure
        (a) Success rate of each seed, from the worst to the best, and the median,
        filled. If the planner takes part, the rate that is required of it. (b) Hops of
        the successful runs, median and 5 to 95 %. (c) Success rate by horizon, if any
        horizon was asked for.
    """
    if outcomes.empty:
        return style.message_figure("No run was made.")
    tasks = [task for task in TASKS if task in set(outcomes["experiment"])]
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 24.0 + 17.0 * len(tasks))
    widths = [1.2, 1.2]
    if not horizons.empty:
        widths.append(0.8)
    panels = figure.subplots(1, len(widths), width_ratios=widths)
    rates = panels[0]
    hops = panels[1]
    hops.sharey(rates)
    controllers = set(runs["controller"])
    for number, (name, (label, colour, mark)) in enumerate(LOOKS.items()):
        beside = APART * (number - (len(LOOKS) - 1) / 2)
        for row, task in enumerate(tasks):
            own = runs[(runs["experiment"] == task) & (runs["controller"] == name)]
            if not own.empty:
                _draw_rates(rates, own, row + beside, colour, mark)
                _draw_hops(hops, own, row + beside, colour, mark)
        if name in controllers:
            rates.plot([], [], mark, color=colour, ms=4, label=label)
    rates.set_yticks(range(len(tasks)), [TASKS[task] for task in tasks])
    rates.set(
        ylim=(len(tasks) - 0.5, -0.5), xlim=(-3, 103), xlabel="runs that succeeded (%)"
    )
    if "planner" in controllers:
        dashed: Any = {"color": style.INK, "linewidth": 0.6, "linestyle": (0, (4, 2))}
        rates.axvline(REQUIRED, label="required of the planner", **dashed)
    hops.set(xlabel="hops to the goal", xlim=(0, None))
    hops.tick_params(labelleft=False)
    for axes in (rates, hops):
        axes.tick_params(axis="y", length=0)
        for between in range(1, len(tasks)):
            axes.axhline(between - 0.5, color=style.GREY, linewidth=0.3)
    if not horizons.empty:
        _draw_horizons(panels[2], horizons)
    style.lettered(figure, panels, ncols=3)
    return figure


def _draw_rates(
    axes: Axes, runs: pd.DataFrame, place: float, colour: str, mark: str
) -> None:
    """Draw the success rate of each seed, from worst to best, and the median."""
    rates = 100 * runs.groupby("seed")["success"].mean()
    axes.plot([rates.min(), rates.max()], [place, place], color=colour, lw=0.9)
    axes.plot(rates, np.full(len(rates), place), "|", color=colour, ms=4)
    axes.plot(rates.median(), place, mark, color=colour, **OUTLINED)


def _draw_hops(
    axes: Axes, runs: pd.DataFrame, place: float, colour: str, mark: str
) -> None:
    """Draw the hops of the successful runs: median, and 5 to 95 %."""
    hops = runs.loc[runs["success"], "hops"]
    if hops.empty:
        return
    axes.plot(hops.quantile([0.05, 0.95]), [place, place], color=colour, lw=0.9)
    axes.plot(hops.median(), place, mark, color=colour, **OUTLINED)


# Look of a median.
OUTLINED: Any = {"mec": "white", "mew": 0.4, "ms": 4.5}


def _draw_horizons(axes: Axes, horizons: pd.DataFrame) -> None:
    """Draw the success rate of the printed controller by its horizon."""
    _, colour, mark = LOOKS["printed"]
    shares = 100 * horizons["succeeded"] / horizons["runs"]
    axes.plot(horizons["horizon"], shares, mark + "-", color=colour, ms=4)
    axes.set(ylim=(-3, 103), xlabel="horizon (hops)", ylabel="to the origin (%)")


# Figs. 3.5, 3.6, 3.8 and 3.9: one run in the arena and over time, compared with the
# model.

# Curve: its label, colour, line style and marker, in drawing order: the measured one is
# on top.
CURVES: dict[str, tuple[str, str, Any, str]] = {
    "pure": ("pure simulation", style.VERMILION, (0, (1.2, 1.2)), ""),
    "response": ("simulated control response", style.BLUE, (0, (4, 1.5)), "x"),
    "measured": ("simulated run", style.INK, "-", "o"),
}
# Panel: its column, label and factor.
OVER_TIME = {
    "x": ("x_m", "x (m)", 1.0),
    "y": ("y_m", "y (m)", 1.0),
    "h": ("heading_rad", "heading (°)", 180 / np.pi),
}
# Length of a line that shows a heading.
TICK_M = 0.07
# Drawn length of the board beyond the path on each side.
BESIDE_M = 0.12
# Colours of the board at its first and its last place.
BOARD_FIRST = "#d8c9a8"
BOARD_LAST = "#8a6d2f"


@style.styled
def steering_run_figure(
    curves: pd.DataFrame, *, experiment: str | None = None
) -> Figure:
    """Draw one run.

    Parameters
    ----------
    curves : DataFrame
        Three curves of one run: the example of
        `hopdata.steering.experiments.study.experiments_of`.
    experiment : str, optional
        Experiment to draw, if `curves` holds several.

    Returns
    -------
    Figure
        (a) The arena: path, headings, goal, and the first and last place of the board.
        (b) x, (c) y and (d) heading over time. Curves of a controller that predicts
        nothing are left out.
    """
    if experiment is not None:
        curves = curves[curves["experiment"] == experiment]
    if curves.empty:
        return style.message_figure(NO_RUN)
    turn = str(curves["experiment"].iloc[0]).startswith("turn")
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 88.0)
    panels = figure.subplot_mosaic("ax;ay;ah", width_ratios=(1.15, 1))
    kinds = [name for name in CURVES if _is_drawn(curves, name)]
    _draw_arena(panels["a"], curves, kinds, turn)
    for panel, (column, label, factor) in OVER_TIME.items():
        for name in kinds:
            curve, *look = CURVES[name]
            rows = curves[curves["curve"] == name]
            values = rows[column] * factor
            _draw_curve(panels[panel], rows["time_s"], values, look, label=curve)
        panels[panel].margins(y=0.12)
        panels[panel].set_ylabel(label)
    _draw_goals(panels, curves, turn)
    panels["h"].set_xlabel("time (s)")
    for above in "xy":
        panels[above].sharex(panels["h"])
        panels[above].tick_params(labelbottom=False)
    figure.align_ylabels([panels[name] for name in "xyh"])
    style.letters(panels[name] for name in "axyh")
    curve_handles, curve_labels = panels["x"].get_legend_handles_labels()
    place_handles, place_labels = panels["a"].get_legend_handles_labels()
    figure.legend(
        [*reversed(curve_handles), *place_handles],
        [*reversed(curve_labels), *place_labels],
        loc="outside upper center",
        ncols=7,
    )
    return figure


def _is_drawn(curves: pd.DataFrame, name: str) -> bool:
    """Return whether a curve is drawn: what was measured, and predictions if any."""
    if name == "measured":
        return True
    known = int(curves.loc[curves["curve"] == name, "x_m"].notna().sum())
    if name == "pure":
        return known >= 2  # it begins at a stance that was measured
    return known >= 1


def _draw_curve(
    axes: Axes, x: pd.Series, y: pd.Series, look: Any, **options: Any
) -> None:
    colour, dash, mark = look
    size = 3.0
    if mark == "o":
        size = 2.2
    axes.plot(x, y, color=colour, ls=dash, marker=mark, ms=size, mew=0.7, **options)


def _draw_goals(panels: dict[str, Axes], curves: pd.DataFrame, turn: bool) -> None:
    """Draw the goal as a thin line: zero in x and y, or half a turn to that side."""
    if not turn:
        for name in "xy":
            panels[name].axhline(0.0, color=style.GREY, linewidth=0.6, zorder=0)
        return
    last = curves.loc[curves["curve"] == "measured"]["heading_rad"].dropna().iloc[-1]
    panels["h"].axhline(np.sign(last) * 180, color=style.GREY, linewidth=0.6, zorder=0)


def _draw_arena(
    axes: Axes, curves: pd.DataFrame, kinds: Sequence[str], turn: bool
) -> None:
    for name in kinds:
        _, *look = CURVES[name]
        rows = curves[curves["curve"] == name]
        _draw_curve(axes, rows["x_m"], rows["y_m"], look)
    measured = curves[curves["curve"] == "measured"]
    _draw_headings(axes, measured)
    _draw_board(axes, measured)
    if not turn:
        axes.plot(
            0,
            0,
            "*",
            color=style.VERMILION,
            mec="white",
            mew=0.5,
            ms=10,
            zorder=5,
            label="goal",
        )
        angle = np.linspace(0, 2 * np.pi, 73)
        near = float(curves["near"].iloc[0])
        axes.plot(
            near * np.cos(angle),
            near * np.sin(angle),
            color=style.GREY,
            linewidth=0.6,
            zorder=0,
        )
    start = measured.dropna(subset=["x_m"]).iloc[0]
    hollow: Any = {"color": "white", "mec": style.INK, "ms": 5, "mew": 0.9, "zorder": 4}
    axes.plot(start["x_m"], start["y_m"], "o", label="start", **hollow)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.set(xlabel="x (m)", ylabel="y (m)")


def _draw_headings(axes: Axes, measured: pd.DataFrame) -> None:
    x = measured["x_m"].to_numpy()
    y = measured["y_m"].to_numpy()
    heading = measured["heading_rad"].to_numpy()
    dx = TICK_M * np.cos(heading)
    dy = TICK_M * np.sin(heading)
    axes.plot(
        np.stack([x, x + dx]),
        np.stack([y, y + dy]),
        color=style.INK,
        linewidth=0.5,
        zorder=1,
    )


def _draw_board(axes: Axes, measured: pd.DataFrame) -> None:
    """Draw the board, as wide as the path: pale at first, dark at last."""
    first_m = measured["board_first_m"].iloc[0]
    distances_m = measured["board_m"].dropna()
    if np.isnan(first_m) or distances_m.empty:
        return
    into, along = _board_axes(measured)
    sideways = measured[["x_m", "y_m"]].dropna().to_numpy() @ along
    sides = (sideways.min() - BESIDE_M, sideways.max() + BESIDE_M)
    for distance, colour, label in (
        (float(first_m), BOARD_FIRST, "board, first"),
        (float(distances_m.iloc[-1]), BOARD_LAST, "board, last"),
    ):
        ends = np.stack([distance * into + side * along for side in sides])
        axes.plot(
            ends[:, 0],
            ends[:, 1],
            label=label,
            color=colour,
            linewidth=3,
            solid_capstyle="butt",
            zorder=0,
        )
