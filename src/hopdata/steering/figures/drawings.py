"""Drawings of the steering experiments: the board in the way, and the live loop."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from hopdata.arrays import FloatArray
from hopdata.figures import style
from hopdata.figures.robot import draw_body, projected
from hopdata.steering.figures.runs import BOARD, BOARD_BEFORE, draw_headings

# The board in the hopper's way (Fig. 3.7).

# Drawn height of the board and half of its drawn length: it acts only on a hopper that
# stands, and is as long as the floor.
HEIGHT_M = 0.16
HALF_M = 0.6
THICK_M = 0.04


@style.styled
def board_figure(sketch: pd.DataFrame, stances: pd.DataFrame) -> Figure:
    """Draw a hopper that pushes a board along x.

    Parameters
    ----------
    sketch : DataFrame
        The hopper's parts, from `hopdata.synthesis.sketch.hopper_sketch`.
    stances : DataFrame
        One row per stance: ``x_m, y_m, heading_rad``, ``board_m`` (where the board
        stands after it) and ``touched``. The first one is before the board is touched.
        ``reach_m`` and ``drag_n`` are those of the board.

    Returns
    -------
    Figure
        (a) The first stance that touches the board, seen from one side. (b) All
        stances from above, with the board's first and last place.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 72.0)
    left, right = figure.subplots(1, 2, width_ratios=(1.35, 1))
    shown = stances[stances["touched"]]
    if shown.empty:
        shown = stances
    _draw_side(left, sketch, shown.iloc[0])
    _draw_above(right, stances)
    style.letters([left, right])
    return figure


def _draw_side(axes: Axes, sketch: pd.DataFrame, stance: pd.Series) -> None:
    """Draw the hopper at a stance, and the board ahead of it."""
    # The board stands along y; the drawing follows the hopper, which touches it.
    ahead_m = float(stance["reach_m"])
    feet = sketch[sketch["kind"] == "foot"]
    floor_m = float(feet["z_m"].min())
    for face, colour in zip(_board_faces(ahead_m, floor_m), _SHADES, strict=True):
        axes.fill(*projected(face).T, facecolor=colour, edgecolor=style.INK, lw=0.5)
    pose = (0.0, 0.0, float(stance["heading_rad"]))
    draw_body(axes, sketch, pose=pose, floor=False)
    _name_reach(axes, ahead_m, floor_m)
    top = projected(np.array([ahead_m, 0.8 * HALF_M, floor_m + HEIGHT_M]))
    board = f"board: resists with {stance['drag_n']:g} N\nwhile it is pushed"
    style.note(axes, board, tuple(top), (-2, 18), ha="right", va="bottom")
    _draw_push(axes, ahead_m, floor_m + HEIGHT_M / 2)
    axes.set_aspect("equal")
    axes.margins(0.06)
    axes.set_axis_off()


def _name_reach(axes: Axes, ahead_m: float, floor_m: float) -> None:
    """Draw an arrow of two heads from the hopper's centre to the board, beside both."""
    start = projected(np.array([0.0, -0.5, floor_m]))
    end = projected(np.array([ahead_m, -0.5, floor_m]))
    arrow: Any = {"arrowstyle": "<->", "lw": 0.7, "color": style.INK, "shrinkA": 0}
    axes.annotate("", tuple(end), tuple(start), arrowprops=arrow)
    reach = f"touches it {ahead_m:.2f} m ahead of its centre"
    middle = (start + end) / 2
    style.note(axes, reach, tuple(middle), (0, -5), ha="center", va="top")


def _draw_push(axes: Axes, ahead_m: float, height_m: float) -> None:
    """Draw an arrow from the board in the direction in which it is pushed."""
    start = projected(np.array([ahead_m, 0.0, height_m]))
    end = projected(np.array([ahead_m + 0.3, 0.0, height_m]))
    # A line that is not seen makes room for the arrow.
    x, y = np.stack([start, end]).T
    axes.plot(x, y, lw=0)
    arrow: Any = {"arrowstyle": "-|>", "lw": 1.6, "color": style.INK}
    axes.annotate("", tuple(end), tuple(start), arrowprops=arrow, zorder=9)


_SHADES = (BOARD, "#a58742", BOARD_BEFORE)


def _board_faces(ahead_m: float, floor_m: float) -> list[FloatArray]:
    """Return the board's front, side and top, (4, 3) each."""
    near = ahead_m
    far = ahead_m + THICK_M
    low = floor_m
    high = floor_m + HEIGHT_M
    front = [
        (near, -HALF_M, low),
        (near, HALF_M, low),
        (near, HALF_M, high),
        (near, -HALF_M, high),
    ]
    side = [
        (near, -HALF_M, low),
        (far, -HALF_M, low),
        (far, -HALF_M, high),
        (near, -HALF_M, high),
    ]
    top = [
        (near, -HALF_M, high),
        (near, HALF_M, high),
        (far, HALF_M, high),
        (far, -HALF_M, high),
    ]
    return [np.array(face) for face in (front, side, top)]


def _draw_above(axes: Axes, stances: pd.DataFrame) -> None:
    """Draw the stances from above, and the board before and after."""
    x = stances["x_m"].to_numpy()
    y = stances["y_m"].to_numpy()
    reach_m = float(stances["reach_m"].iloc[0])
    touched = stances["touched"].to_numpy(dtype=bool)
    first_m = float(stances["board_m"].iloc[0])
    last_m = float(stances["board_m"].iloc[-1])
    width = (y.min() - 0.25, y.max() + 0.25)
    axes.plot([first_m] * 2, width, color=BOARD_BEFORE, lw=3, label="board, first")
    axes.plot([last_m] * 2, width, color=BOARD, lw=3, label="board, last")
    axes.plot(x, y, color=style.GREY, lw=0.7, zorder=1)
    draw_headings(axes, stances)
    free: Any = {"mfc": "white", "mec": style.INK, "ls": "", "marker": "o", "ms": 3.5}
    axes.plot(x[~touched], y[~touched], label="stance", **free)
    pushing: Any = {**free, "mfc": style.INK}
    axes.plot(x[touched], y[touched], label="stance that pushes", **pushing)
    limit_m = first_m - reach_m
    axes.axvline(limit_m, color=style.GREY, lw=0.6, ls=(0, (3, 2)))
    style.note(axes, "it touches", (limit_m, width[1]), (-2, 0), ha="right", va="top")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.18), ncols=2)


# The live loop (Fig. 3.4).

BOX = (1.72, 1.34)  # width and height of a box, in the units of `PLACES`
KIND_LOOK: dict[str, dict[str, Any]] = {
    "outside": {"facecolor": "white", "linestyle": (0, (3, 2))},
    "thread": {"facecolor": "#efefef"},
    "store": {"facecolor": "#d6d6d6"},
}
PLACES = {
    "cameras": (0.0, 0.0),
    "hopdata-stream": (2.4, 0.0),
    "FrameBuffer": (4.8, 0.0),
    "hopdata-control": (7.2, 0.0),
    "boom of the robot": (0.0, -2.3),
    "hopdata-boom": (2.4, -2.3),
    "hopdata-watch": (4.8, -2.3),
    "hopdata-log": (7.2, -2.3),
}


@style.styled
def loop_figure(parts: pd.DataFrame, flows: pd.DataFrame) -> Figure:
    """Draw the threads of the live loop, and what passes between them.

    Parameters
    ----------
    parts : DataFrame
        ``name, kind, owner, does, printed``: the fields of
        `hopdata.steering.live.parts.Part`.
    flows : DataFrame
        ``source, target, carries, by, printed``: those of `Flow` there.

    Returns
    -------
    Figure
        The part that the dissertation's figure has is drawn with thick lines.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 92.0)
    axes = figure.subplots()
    # A table that was read again has no empty texts.
    for flow in flows.fillna("").to_dict("records"):
        _draw_flow(axes, flow)
    for part in parts.fillna("").to_dict("records"):
        _draw_part(axes, part)
    labels = {"thread": "thread", "store": "shared", "outside": "outside"}
    for kind, label in labels.items():
        axes.fill([], [], edgecolor=style.INK, label=label, **KIND_LOOK[kind])
    axes.plot([], [], color=style.INK, lw=1.6, label="in the printed figure")
    axes.plot([], [], color=style.GREY, lw=0.7, label="added here")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, -0.1), ncols=5)
    axes.set_aspect("equal")
    axes.set(xlim=(-1.0, 8.2), ylim=(-3.3, 0.95))
    axes.set_axis_off()
    return figure


def _draw_part(axes: Axes, part: Mapping[Any, Any]) -> None:
    """Draw a part as a box: its name, its class, and what it does."""
    x, y = PLACES[part["name"]]
    width, height = BOX
    line_width, edge = _line_of(part)
    look: Any = {"ec": edge, "lw": line_width, **KIND_LOOK[part["kind"]]}
    corner = (x - width / 2, y - height / 2)
    box = FancyBboxPatch(corner, width, height, boxstyle="round,pad=0.05", **look)
    axes.add_patch(box)
    shown = part["name"]
    class_name = part["owner"].partition(":")[2]
    if part["kind"] == "thread":
        axes.text(x, y + 0.42, f"thread {part['name']}", ha="center", va="top")
        shown = class_name
    axes.text(x, y + 0.62, shown, ha="center", va="top", weight="bold")
    lines = _wrapped(part["does"], 22)
    axes.text(x, y - 0.62, lines, ha="center", va="bottom")


def _line_of(element: Mapping[Any, Any]) -> tuple[float, str]:
    """Return width, pt, and colour of the line of a part or flow: thick if printed."""
    if element["printed"]:
        return 1.6, style.INK
    return 0.7, style.GREY


def _wrapped(text: str, width: int) -> str:
    """Break a text into lines of at most this many characters."""
    import textwrap

    return "\n".join(textwrap.wrap(text, width))


def _draw_flow(axes: Axes, flow: Mapping[Any, Any]) -> None:
    """Draw an arrow between two parts, with what it carries and the method."""
    first = np.array(PLACES[flow["source"]])
    second = np.array(PLACES[flow["target"]])
    half = np.array(BOX) / 2 + 0.05
    way = second - first
    # Where the line between the centres leaves one box and enters the other.
    with np.errstate(divide="ignore"):
        share = float(np.min(half / np.abs(way)))
    start = first + share * way
    end = second - share * way
    width, colour = _line_of(flow)
    arrow: Any = {"arrowstyle": "-|>", "lw": width, "color": colour}
    arrow |= {"shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(end), tuple(start), arrowprops=arrow)
    method = flow["by"].rpartition(".")[2]
    label = flow["carries"].replace(" ", "\n", 1)
    if method:
        label = f"{label}\n.{method}()"
    x, y = (start + end) / 2
    look: Any = {"color": style.INK}
    if way[1] == 0:
        axes.text(x, y + 0.06, label, ha="center", va="bottom", **look)
    elif way[0] < 0:
        axes.text(x + 0.12, y - 0.1, label, ha="left", va="center", **look)
    else:
        axes.text(x + 0.12, y + 0.1, label, ha="left", va="center", **look)
