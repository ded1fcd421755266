"""A drawing of the hopper from its scene: assembly, force of a leg, and boom."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.arrays import FloatArray
from hopdata.figures import style

# Direction from which the assembly is seen, degrees: azimuth of the eye from the body's
# x axis, and its height.
AZIMUTH_DEG = -104.0
ELEVATION_DEG = 27.0
AXIS_M = 0.17  # drawn length of an axis of the body
PLATE_COLOUR = "#d9dee3"
# Colours mark the feet; the counterweight, and the phases of a leg, have shades.
WEIGHT_COLOUR = style.SHADE
LANDING = style.INK
PUSH_OFF = style.GREY
FLOOR_COLOUR = "#ece7dd"
MARKER: dict[str, Any] = {
    "marker": "o",
    "mfc": "white",
    "mec": style.INK,
    "mew": 0.9,
    "ls": "",
    "zorder": 6,
}
CIRCLE: dict[str, Any] = {"color": style.GREY, "lw": 0.7, "ls": (0, (3, 2))}
# A counterweight this near to the body's axis is drawn as neutral.
NEUTRAL_M = 0.01
BODY = "body marker"
POINT = ["x_m", "y_m", "z_m"]
PANELS = ("assembly", "leg", "boom")
WIDTHS = {"assembly": 1.5, "leg": 1.0, "boom": 1.15}


@style.styled
def robot_figure(
    sketch: pd.DataFrame, forces: pd.DataFrame, *, panels: Sequence[str] = PANELS
) -> Figure:
    """Draw a hopper.

    Parameters
    ----------
    sketch : DataFrame
        Points of its parts, from `hopdata.synthesis.sketch.hopper_sketch`:
        ``kind, name, x_m, y_m, z_m``.
    forces : DataFrame
        Force of a leg by gap, from `hopdata.synthesis.sketch.leg_forces`:
        ``phase, gap_m, force_n``.
    panels : sequence of str
        Which of `PANELS` to draw, in this order: the assembly with its markers and
        axes, the force of one leg over its gap, and the boom from above.

    Returns
    -------
    Figure
    """
    width = style.DOUBLE_COLUMN_MM
    figure = style.paper_figure(width, 68.0)
    ratios = [WIDTHS[name] for name in panels]
    drawn = figure.subplots(1, len(panels), width_ratios=ratios, squeeze=False)[0]
    for axes, name in zip(drawn, panels, strict=True):
        if name == "assembly":
            draw_assembly(axes, sketch)
        elif name == "leg":
            draw_forces(axes, forces)
        else:
            draw_boom(axes, sketch)
    style.letters(drawn)
    return figure


# The assembly, seen from one side above.


def projected(
    points: FloatArray,
    azimuth_deg: float = AZIMUTH_DEG,
    elevation_deg: float = ELEVATION_DEG,
) -> FloatArray:
    """Return places in the picture, (..., 2), of points (..., 3), without perspective.

    The first coordinate is to the right, the second up.
    """
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    away = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    up = -np.sin(elevation) * away
    up[2] = np.cos(elevation)
    picture = np.column_stack([right, up])
    return np.asarray(np.asarray(points) @ picture)


def places(sketch: pd.DataFrame, kind: str) -> FloatArray:
    """Return the points of one kind, (n, 3)."""
    rows = sketch.loc[sketch["kind"] == kind, POINT]
    return np.asarray(rows.to_numpy(dtype=float))


def draw_assembly(axes: Axes, sketch: pd.DataFrame) -> None:
    """Draw all parts of a hopper that stands on its rest feet, with their names."""
    draw_body(axes, sketch)
    feet = places(sketch, "foot")
    below: Any = {"ha": "center", "va": "top"}
    for k, at in enumerate(projected(feet)):
        colour = style.foot_colour(k)
        style.note(axes, f"foot {k + 1}", tuple(at), (0, -5), color=colour, **below)
    _draw_axes(axes)
    _name_parts(axes, sketch)
    length_m = float(-feet[0, 2])
    radius_m = float(np.hypot(*feet[0, :2]))
    text = (
        f"feet at rest length: {radius_m:.2f} m from the axis,\n"
        f"{length_m:.2f} m below the origin"
    )
    corner: Any = {"textcoords": "axes fraction", "xycoords": "axes fraction"}
    style.note(axes, text, (0, 0), (0.0, -0.03), ha="left", va="top", **corner)
    axes.set_aspect("equal")
    axes.margins(0.1)
    axes.set_axis_off()


def _name_parts(axes: Axes, sketch: pd.DataFrame) -> None:
    """Name counterweight, body markers, motor and circle, with a line to each."""
    weight = projected(places(sketch, "counterweight"))[0]
    motor = projected(places(sketch, "boom centre"))[0]
    body = projected(places(sketch, BODY))
    leftmost = body[body[:, 0].argmin()]
    circle = projected(places(sketch, "circle"))
    topmost = circle[circle[:, 1].argmax()]
    line = {"arrowstyle": "-", "lw": 0.5, "color": style.GREY}
    named = [
        ("counterweight,\nboom marker on it", weight, (8, -52), "left"),
        (f"{len(body)} body markers", leftmost, (-12, 10), "right"),
        ("boom's motor", motor, (36, -27), "left"),
        ("circle of the boom", topmost, (14, 16), "left"),
    ]
    look: Any = {"va": "center", "arrowprops": line, "zorder": 8}
    for text, at, offset, side in named:
        style.note(axes, text, tuple(at), offset, ha=side, **look)


def draw_body(
    axes: Axes,
    sketch: pd.DataFrame,
    *,
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    floor: bool = True,
) -> None:
    """Draw legs, plate, boom and markers of a hopper at a pose (x m, y m, heading)."""
    turn = _turn(pose[2])
    base = np.array([pose[0], pose[1], 0.0])

    def seen(kind: str) -> FloatArray:
        return projected(places(sketch, kind) @ turn.T + base)

    if floor:
        foot = places(sketch, "foot")[0]
        radius_m = 1.25 * np.hypot(foot[0], foot[1])
        disc = _ring(radius_m, foot[2]) @ turn.T + base
        axes.fill(*projected(disc).T, color=FLOOR_COLOUR, zorder=0)
    corners = seen("plate")
    hub = seen("origin")[0]
    plate: Any = {"facecolor": PLATE_COLOUR, "edgecolor": style.INK, "lw": 0.8}
    axes.fill(*corners.T, zorder=3, **plate)
    for k, (corner, foot) in enumerate(zip(corners, seen("foot"), strict=True)):
        colour = style.foot_colour(k)
        _draw_line(axes, hub, corner, color=style.INK, lw=0.5, zorder=4)
        _draw_line(axes, corner, foot, color=colour, lw=2.4, zorder=2)
        axes.plot(*foot, ms=5, **{**MARKER, "mec": colour})
    axes.plot(*seen("circle").T, zorder=2, **CIRCLE)
    centre = seen("boom centre")[0]
    weight = seen("counterweight")[0]
    _draw_line(axes, centre, weight, color=style.INK, lw=1.6, zorder=5)
    axes.plot(*centre, "s", color=style.INK, ms=4, zorder=5)
    axes.plot(*weight, "o", color=WEIGHT_COLOUR, ms=9, mec=style.INK, zorder=5)
    axes.plot(*seen("boom marker")[0], ms=3.5, **MARKER)
    axes.plot(*seen(BODY).T, ms=4.5, **MARKER)


def _draw_line(axes: Axes, start: FloatArray, end: FloatArray, **look: Any) -> None:
    """Draw a straight line between two places in the picture, (2,) each."""
    x, y = np.stack([start, end]).T
    axes.plot(x, y, **look)


def _ring(radius_m: float, height_m: float) -> FloatArray:
    """Return points (n, 3) of a horizontal circle about the axis, m."""
    angle = np.linspace(0.0, 2 * np.pi, 97)
    x = radius_m * np.cos(angle)
    y = radius_m * np.sin(angle)
    height = np.full(len(angle), height_m)
    return np.column_stack([x, y, height])


def _turn(heading_rad: float) -> FloatArray:
    """Return the rotation (3, 3) about the vertical."""
    cos = np.cos(heading_rad)
    sin = np.sin(heading_rad)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _draw_axes(axes: Axes) -> None:
    """Draw the axes of the body at its origin."""
    origin = projected(np.zeros(3))
    arrow = {"arrowstyle": "-|>", "lw": 0.9, "color": style.INK, "shrinkA": 0}
    tips = projected(AXIS_M * np.eye(3))
    axes.plot(*tips.T, lw=0)  # an arrow beyond the limits would not be drawn
    for name, tip in zip("xyz", tips, strict=True):
        axes.annotate("", tuple(tip), tuple(origin), arrowprops=arrow, zorder=7)
        along = tip - origin
        away = 5 * along / np.linalg.norm(along)
        look: Any = {"ha": "center", "va": "center", "color": style.INK}
        style.note(axes, name, tuple(tip), tuple(away), zorder=7, **look)


# The force of a leg.


def draw_forces(axes: Axes, forces: pd.DataFrame) -> None:
    """Draw the force of a leg over its gap: it jumps to the preload at touchdown."""
    looks = {
        "flight": (style.GREY, "-"),
        "landing": (LANDING, "-"),
        "push-off": (PUSH_OFF, (0, (4, 1.5))),
    }
    for phase, (colour, dash) in looks.items():
        rows = forces[forces["phase"] == phase]
        axes.plot(1e3 * rows["gap_m"], rows["force_n"], color=colour, ls=dash, lw=1.5)
    landing = forces[forces["phase"] == "landing"]
    push_off = forces[forces["phase"] == "push-off"]
    preload_n = float(landing["force_n"].iloc[0])
    shortest = push_off.iloc[0]
    longest = push_off.iloc[-1]
    release_mm = float(1e3 * longest["gap_m"])
    release_n = float(longest["force_n"])
    drop: Any = {"lw": 0.8, "ls": ":"}
    axes.plot([0, 0], [0, preload_n], color=LANDING, **drop)
    axes.plot([release_mm] * 2, [0, release_n], color=PUSH_OFF, **drop)
    rise_n = shortest["force_n"] - release_n
    way_m = shortest["gap_m"] - longest["gap_m"]
    slope = -rise_n / way_m
    of_landing = f"touchdown: at once the\npreload, {preload_n:.0f} N"
    of_push_off = (
        f"push-off, once all legs\nhave stood: lift-off at\n{release_mm:.0f} mm"
    )
    told = [
        (of_landing, LANDING, 0.99),
        (of_push_off, PUSH_OFF, 0.83),
    ]
    corner: Any = {"textcoords": "axes fraction", "xycoords": "axes fraction"}
    look: Any = {"ha": "right", "va": "top", **corner}
    for text, colour, height in told:
        style.note(axes, text, (1, 1), (1.0, height), color=colour, **look)
    middle = push_off.iloc[2 * len(push_off) // 3]
    at = (1e3 * middle["gap_m"], middle["force_n"])
    stiffness = f"{slope:.0f} N/m"
    style.note(axes, stiffness, at, (4, 2), ha="left", va="bottom")
    axes.set(xlabel="height of the foot at rest length (mm)", ylabel="force (N)")
    axes.set_ylim(0, 1.45 * forces["force_n"].max())
    axes.set_title("one leg, without its damping")


# The boom, from above.


def draw_boom(axes: Axes, sketch: pd.DataFrame) -> None:
    """Draw the boom from above: its circle, and what one swing reaches of it."""
    feet = places(sketch, "foot")[:, :2]
    plate = places(sketch, "plate")[:, :2]
    circle = places(sketch, "circle")[:, :2]
    reached = places(sketch, "reached")[:, :2]
    centre = places(sketch, "boom centre")[0, :2]
    weight = places(sketch, "counterweight")[0, :2]
    axes.fill(*plate.T, facecolor=PLATE_COLOUR, edgecolor=style.INK, lw=0.6)
    for k, (corner, foot) in enumerate(zip(plate, feet, strict=True)):
        colour = style.foot_colour(k)
        _draw_line(axes, corner, foot, color=colour, lw=1.6)
        axes.plot(*foot, ms=4, **{**MARKER, "mec": colour})
        style.note(axes, str(k + 1), tuple(foot), (5, 4), color=colour)
    axes.plot(*circle.T, **CIRCLE)
    if len(reached):
        axes.plot(*reached.T, color=style.PALE, lw=4, zorder=2)
    _draw_line(axes, centre, weight, color=style.INK, lw=1.6, zorder=3)
    axes.plot(*centre, "s", color=style.INK, ms=4, zorder=3)
    axes.plot(*weight, "o", color=WEIGHT_COLOUR, ms=8, mec=style.INK, zorder=4)
    axes.plot(0, 0, "+", color="white", ms=9, mew=1.2, zorder=5)
    beside: Any = {"ha": "left", "va": "center"}
    style.note(axes, "motor", tuple(centre), (5, -7), **beside)
    if np.hypot(*weight) < NEUTRAL_M:
        text = "neutral: counterweight\non the body's axis"
        line = {"arrowstyle": "-", "lw": 0.5, "color": style.GREY}
        style.note(axes, text, tuple(weight), (16, -38), arrowprops=line, **beside)
    if len(reached):
        ends = reached[[0, -1]] - centre
        half = 0.5 * _angle_between(ends[0], ends[1])
        text = f"one swing: up to ±{np.degrees(half):.1f}°"
        top = circle[circle[:, 1].argmax()]
        style.note(axes, text, tuple(top), (0, 5), ha="center", va="bottom")
    axes.set_aspect("equal")
    axes.margins(0.1)
    axes.set(xlabel="x of the body (m)", ylabel="y of the body (m)")
    axes.set_title("boom, from above")


def _angle_between(first: FloatArray, second: FloatArray) -> float:
    """Return the angle from one vector to another, counter-clockwise, in [0, 2 pi)."""
    end = np.arctan2(second[1], second[0])
    start = np.arctan2(first[1], first[0])
    return float((end - start) % (2 * np.pi))
