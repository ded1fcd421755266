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

# The film: its size, speed relative to real time, number of colours, margin about the
# run, and duration of the last picture.
WIDTH_MM = 90.0
HEIGHT_MM = 112.0
DPI = 110.0
SPEED = 2.0
COLOURS = 48
MARGIN_M = 0.25
LAST_S = 1.5
BOARD = "#8a6d2f"
BOARD_BEFORE = "#d8c9a8"  # where the board first was
NO_RUN = "No stance was seen in any run, so there is none to show."


def save_film(path: str | Path, film: pd.DataFrame, curves: pd.DataFrame) -> None:
    """Write a film of one run as an animated GIF, whole or not at all.

    Without a run, its only picture says so.

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
    durations = [each_ms] * (len(pictures) - 1) + [round(1000 * LAST_S)]
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

    n_markers = film["marker"].nunique()
    coordinates = film[["x_m", "y_m", "z_m"]].to_numpy()
    positions = coordinates.reshape(len(times), n_markers, 3)
    figure, moving, reach = _stage(positions)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    still = canvas.copy_from_bbox(figure.bbox)  # type: ignore[attr-defined]
    palette: Images.Image | None = None
    pictures = []
    for time, markers in zip(times, positions, strict=True):
        canvas.restore_region(still)  # type: ignore[attr-defined]
        _move(moving, time, markers, stances, reach)
        for artist in moving.values():
            artist.axes.draw_artist(artist)
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
        if palette is None:
            palette = picture.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
        pictures.append(picture.quantize(palette=palette, dither=Image.Dither.NONE))
    return pictures


def _stage(positions: Any) -> tuple[Figure, dict[str, Any], float]:
    """Return the figure with its static parts, and the moving artists.

    The last value is half the board's length, m.
    """
    figure = style.paper_figure(WIDTH_MM, HEIGHT_MM)
    figure.set_dpi(DPI)
    above, side = figure.subplots(2, 1, sharex=True, height_ratios=(4.2, 1))
    # What is shown of the floor includes the origin, 0.
    floor = positions[..., :2]
    low = np.fmin(np.nanmin(floor, axis=(0, 1)), 0) - MARGIN_M
    high = np.fmax(np.nanmax(floor, axis=(0, 1)), 0) + MARGIN_M
    middle = (low + high) / 2
    half = max(high - low) / 2
    left, bottom = middle - half
    right, top = middle + half
    above.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", ylabel="y (m)")
    highest = 1.1 * float(np.nanmax(positions[..., 2]))
    side.set(ylim=(-0.05, highest), xlabel="x (m)", ylabel="height (m)")
    side.axhline(0.0, color=style.INK, linewidth=0.8)
    above.plot(0, 0, marker="*", color=style.INK, mec="white", ms=12)
    return figure, _moving(above, side), 2 * half


def _moving(above: Any, side: Any) -> dict[str, Any]:
    """Return the moving artists, which are drawn on top of the static picture."""

    def line(axes: Any, kind: str, **look: Any) -> Any:
        return axes.plot([], [], kind, animated=True, **look)[0]

    body: Any = {"color": style.SHADE, "alpha": 0.75, "animated": True}
    corner: Any = {"transform": above.transAxes, "va": "top", "animated": True}
    boom: Any = {"color": style.INK, "markevery": [1]}  # a marker at its end only
    return {
        "board_line": line(above, "-", color=BOARD, lw=3),
        "path": line(above, "o-", color=style.GREY, ms=2.5, lw=0.9),
        "body": above.fill([0, 0, 0], [0, 0, 0], **body)[0],
        "boom": line(above, "o-", lw=1.6, ms=5, **boom),
        "time": above.text(0.02, 0.98, "", **corner),
        "side_body": line(side, "o-", color=style.SHADE, lw=2, ms=3),
        "side_boom": line(side, "o-", lw=1.2, ms=4, **boom),
    }


def _board_axes(stances: pd.DataFrame) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors into the board and along it, (2,); NaN without a board."""
    way = stances[["board_x", "board_y"]].iloc[0].to_numpy(dtype=float)
    return way, np.array([-way[1], way[0]])


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
    way, across = _board_axes(stances)
    if past.empty:
        board_m = float(stances["board_first_m"].iloc[0])
    else:
        board_m = past["board_m"].iloc[-1]
    middle = board_m * way
    ends = np.stack([middle - reach * across, middle + reach * across])
    moving["board_line"].set_data(*ends.T)


# Success rates, and hops to the goal, of all controllers over the seeds.

LOOKS = {
    "none": ("boom at rest", style.GREY, "v"),
    "random": ("random swings", style.PALE, "^"),
    "printed": ("printed controller", style.PRINTED, "s"),
    "planner": ("planner", style.OURS, "o"),
    "adaptive": ("planner that goes on learning", style.SHADE, "P"),
    "ceiling": ("planner that knows the true map", style.SHADE, "D"),
}
TASKS = {
    "origin": "to the origin",
    "origin_board": "to the origin,\nboard in the way",
    "turn": "half turn",
    "turn_board": "half turn,\nboard in the way",
    "waypoints": "way-points",
}
APART = 0.17  # offset between controllers of one task
MEDIAN: dict[str, Any] = {"mec": "white", "mew": 0.4, "ms": 4.5}  # look of a median


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
    rates, hops = panels[:2]
    hops.sharey(rates)
    for k, (name, (label, colour, mark)) in enumerate(LOOKS.items()):
        offset = APART * (k - (len(LOOKS) - 1) / 2)
        for row, task in enumerate(tasks):
            own = runs[(runs["experiment"] == task) & (runs["controller"] == name)]
            if not own.empty:
                _draw_rates(rates, own, row + offset, colour, mark)
                _draw_hops(hops, own, row + offset, colour, mark)
        if name in set(runs["controller"]):
            rates.plot([], [], mark, color=colour, ms=4, label=label)
    rates.set_yticks(range(len(tasks)), [TASKS[task] for task in tasks])
    rates.set(ylim=(len(tasks) - 0.5, -0.5), xlim=(-3, 103))
    rates.set_xlabel("runs that succeeded (%)")
    if "planner" in set(runs["controller"]):
        dashed: Any = {"color": style.INK, "linewidth": 0.6, "linestyle": (0, (4, 2))}
        rates.axvline(90, label="required of the planner", **dashed)
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
    axes: Axes, runs: pd.DataFrame, row: float, colour: str, mark: str
) -> None:
    """Draw the success rates of a controller in a task: each seed, and the median."""
    shares = 100 * runs.groupby("seed")["success"].mean()
    axes.plot([shares.min(), shares.max()], [row] * 2, color=colour, lw=0.9)
    axes.plot(shares, np.full(len(shares), row), "|", color=colour, ms=4)
    axes.plot(shares.median(), row, mark, color=colour, **MEDIAN)


def _draw_hops(
    axes: Axes, runs: pd.DataFrame, row: float, colour: str, mark: str
) -> None:
    """Draw the hops of the successful runs of a controller in a task."""
    arrived = runs.loc[runs["success"], "hops"]
    if arrived.empty:
        return
    axes.plot(arrived.quantile([0.05, 0.95]), [row] * 2, color=colour, lw=0.9)
    axes.plot(arrived.median(), row, mark, color=colour, **MEDIAN)


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
    "pure": ("pure simulation", style.PRINTED, (0, (1.2, 1.2)), ""),
    "response": ("simulated control response", style.SHADE, (0, (4, 1.5)), "x"),
    "measured": ("simulated run", style.INK, "-", "o"),
}
POINT = "point"  # rows of the table that are way-points
# Panel: its column, label and factor.
OVER_TIME = {
    "x": ("x_m", "x (m)", 1.0),
    "y": ("y_m", "y (m)", 1.0),
    "h": ("heading_rad", "heading (°)", 180 / np.pi),
}
TICK_M = 0.07  # length of a line that shows a heading
BESIDE_M = 0.12  # drawn length of the board beyond the path on each side


# Height of a figure of one run, and of one of two.
ONE_RUN_MM = 88.0
TWO_RUNS_MM = 158.0


@style.styled
def steering_run_figure(
    curves: pd.DataFrame, *, experiment: str | None = None
) -> Figure:
    """Draw one run, or those of two controllers from the same start.

    Parameters
    ----------
    curves : DataFrame
        Three curves of each run: the example of
        `hopdata.steering.experiments.study.experiments_of`.
    experiment : str, optional
        Experiment to draw, if `curves` holds several.

    Returns
    -------
    Figure
        (a) The arena: path, headings, goal, and the first and last place of the board.
        (b) x, (c) y and (d) heading over time. Curves of a controller that predicts
        nothing are left out. Of two controllers, the dissertation's comes first, and
        the other below it in the same way. Except with way-points, both arenas have the
        same scale.
    """
    if experiment is not None:
        curves = curves[curves["experiment"] == experiment]
    if curves.empty:
        return style.message_figure(NO_RUN)
    shown = sorted(curves["controller"].unique(), key=list(LOOKS).index)
    runs = [curves[curves["controller"] == name] for name in shown]
    height_mm = ONE_RUN_MM
    if len(runs) > 1:
        height_mm = TWO_RUNS_MM
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, height_mm)
    # The arena of a run stands beside its three curves over time.
    mosaic: Any = []
    for k in range(len(runs)):
        mosaic += [[f"a{k}", f"{panel}{k}"] for panel in OVER_TIME]
    drawn = figure.subplot_mosaic(mosaic, width_ratios=(1.15, 1))
    every: list[dict[str, Axes]] = []
    for k, run in enumerate(runs):
        panels = {panel: drawn[f"{panel}{k}"] for panel in ("a", *OVER_TIME)}
        _draw_run(panels, run)
        every.append(panels)
        if len(runs) == 1:
            continue
        panels["a"].set_title(_outcome_of(run))
        if not (run["curve"] == POINT).any():
            # The corners of all paths make the arenas alike. Among way-points one that
            # is lost would hide the other.
            panels["a"].update_datalim(_corners(curves))
            panels["a"].autoscale_view()
    figure.align_ylabels([panels[name] for panels in every for name in OVER_TIME])
    style.letters([axes for panels in every for axes in panels.values()])
    # The measured curve, which is drawn last, comes first; then what is in the arena.
    known: dict[str, Any] = {}
    for panels in every:
        lines, line_names = panels["x"].get_legend_handles_labels()
        known |= dict(zip(line_names[::-1], lines[::-1], strict=True))
    for panels in every:
        marks, mark_names = panels["a"].get_legend_handles_labels()
        known |= dict(zip(mark_names, marks, strict=True))
    figure.legend(known.values(), known.keys(), loc="outside upper center", ncols=7)
    return figure


def _draw_run(panels: dict[str, Axes], curves: pd.DataFrame) -> None:
    """Draw the arena, and x, y and heading over time, of one run."""
    turn = str(curves["experiment"].iloc[0]).startswith("turn")
    kinds = [name for name in CURVES if _is_drawn(curves, name)]
    _draw_arena(panels["a"], curves, kinds, turn)
    for panel, (column, label, factor) in OVER_TIME.items():
        axes = panels[panel]
        for name in kinds:
            curve, *look = CURVES[name]
            rows = curves[curves["curve"] == name]
            values = rows[column] * factor
            _draw_curve(axes, rows["time_s"], values, look, label=curve)
        axes.margins(y=0.12)
        axes.set_ylabel(label)
    _draw_goals(panels, curves, turn)
    panels["h"].set_xlabel("time (s)")
    for above in "xy":
        panels[above].sharex(panels["h"])
        panels[above].tick_params(labelbottom=False)


def _outcome_of(curves: pd.DataFrame) -> str:
    """Return who made a run, and how it ended, in a few words."""
    who = LOOKS[str(curves["controller"].iloc[0])][0]
    hops = int((curves["curve"] == "measured").sum()) - 1
    done = "arrived"
    if str(curves["experiment"].iloc[0]).startswith("turn"):
        done = "turned"
    if bool(curves["success"].iloc[0]):
        return f"{who}: {done} after {hops} hops"
    return f"{who}: not {done} in {hops} hops"


def _corners(curves: pd.DataFrame) -> FloatArray:
    """Return the lower left and upper right corner of all paths, (2, 2), m."""
    places = curves[["x_m", "y_m"]]
    return np.array([places.min(), places.max()])


def _is_drawn(curves: pd.DataFrame, name: str) -> bool:
    """Return whether a curve is drawn: the measured one, and what was predicted."""
    if name == "measured":
        return True
    n_known = int(curves.loc[curves["curve"] == name, "x_m"].notna().sum())
    # The pure simulation begins at a stance that was measured.
    least = 1
    if name == "pure":
        least = 2
    return n_known >= least


def _draw_curve(
    axes: Axes, x: pd.Series, y: pd.Series, look: Any, **options: Any
) -> None:
    """Draw a curve in its colour, line style and marker."""
    colour, dash, mark = look
    size = 3.0
    if mark == "o":
        size = 2.2
    axes.plot(x, y, color=colour, ls=dash, marker=mark, ms=size, mew=0.7, **options)


def _draw_goals(panels: dict[str, Axes], curves: pd.DataFrame, turn: bool) -> None:
    """Draw the goal as a thin line: zero in x and y, or half a turn to one side."""
    if (curves["curve"] == POINT).any():
        return
    if not turn:
        for name in "xy":
            panels[name].axhline(0.0, color=style.GREY, linewidth=0.6, zorder=0)
        return
    headings = curves.loc[curves["curve"] == "measured", "heading_rad"].dropna()
    half_turn_deg = np.sign(headings.iloc[-1]) * 180
    panels["h"].axhline(half_turn_deg, color=style.GREY, linewidth=0.6, zorder=0)


def _draw_arena(
    axes: Axes, curves: pd.DataFrame, kinds: Sequence[str], turn: bool
) -> None:
    """Draw the arena from above: path, headings, board, start and goal."""
    for name in kinds:
        _, *look = CURVES[name]
        rows = curves[curves["curve"] == name]
        _draw_curve(axes, rows["x_m"], rows["y_m"], look)
    measured = curves[curves["curve"] == "measured"]
    draw_headings(axes, measured)
    _draw_board(axes, measured)
    points = curves.loc[curves["curve"] == POINT, ["x_m", "y_m"]].to_numpy()
    near_m = float(curves["near"].iloc[0])
    if len(points):
        _draw_way_points(axes, points, near_m)
    elif not turn:
        _draw_goal(axes, np.zeros(2), near_m, "goal")
    start = measured.dropna(subset=["x_m"]).iloc[0]
    hollow: Any = {"color": "white", "mec": style.INK, "ms": 5, "mew": 0.9, "zorder": 4}
    axes.plot(start["x_m"], start["y_m"], "o", label="start", **hollow)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.set(xlabel="x (m)", ylabel="y (m)")


def _draw_goal(axes: Axes, point_m: FloatArray, near_m: float, label: str) -> None:
    """Draw a point to go to, (2,), and how near it counts as reached."""
    star: Any = {"color": style.INK, "mec": "white", "mew": 0.5, "ms": 10}
    axes.plot(*point_m, "*", zorder=5, label=label, **star)
    angle = np.linspace(0, 2 * np.pi, 73)
    x = point_m[0] + near_m * np.cos(angle)
    y = point_m[1] + near_m * np.sin(angle)
    axes.plot(x, y, color=style.GREY, linewidth=0.6, zorder=0)


def _draw_way_points(axes: Axes, points_m: FloatArray, near_m: float) -> None:
    """Draw way-points, (n, 2), with their numbers."""
    beside: Any = {"textcoords": "offset points", "xytext": (4, 4), "zorder": 6}
    for number, point_m in enumerate(points_m, start=1):
        label = "way-points"
        if number > 1:
            # The legend leaves out what begins with a dash.
            label = "_"
        _draw_goal(axes, point_m, near_m, label)
        axes.annotate(str(number), point_m, color=style.INK, **beside)


def draw_headings(axes: Axes, stances: pd.DataFrame) -> None:
    """Draw a short line ahead of each stance (``x_m, y_m, heading_rad``)."""
    x = stances["x_m"].to_numpy()
    y = stances["y_m"].to_numpy()
    heading = stances["heading_rad"].to_numpy()
    x_ends = np.stack([x, x + TICK_M * np.cos(heading)])
    y_ends = np.stack([y, y + TICK_M * np.sin(heading)])
    axes.plot(x_ends, y_ends, color=style.INK, linewidth=0.5, zorder=1)


def _draw_board(axes: Axes, measured: pd.DataFrame) -> None:
    """Draw the board, as wide as the path: pale where it was first, dark at last."""
    first_m = measured["board_first_m"].iloc[0]
    known_m = measured["board_m"].dropna()
    if np.isnan(first_m) or known_m.empty:
        return
    way, across = _board_axes(measured)
    sideways = measured[["x_m", "y_m"]].dropna().to_numpy() @ across
    sides = (sideways.min() - BESIDE_M, sideways.max() + BESIDE_M)
    look: Any = {"linewidth": 3, "solid_capstyle": "butt", "zorder": 0}
    places = [
        (float(first_m), BOARD_BEFORE, "board, first"),
        (float(known_m.iloc[-1]), BOARD, "board, last"),
    ]
    for board_m, colour, label in places:
        ends = np.stack([board_m * way + side * across for side in sides])
        axes.plot(ends[:, 0], ends[:, 1], color=colour, label=label, **look)
