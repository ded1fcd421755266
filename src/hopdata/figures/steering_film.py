"""A run as a short film: from above, with path, body and boom, and from the side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.errors import AnalysisError
from hopdata.figures.style import BLUE, GREY, INK, VERMILION, paper_figure, style_context

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure
    from PIL import Image as Images

WIDTH_MM, HEIGHT_MM, DPI = 90.0, 112.0, 110.0
SPEED = 2.0  # how much faster than it was
COLOURS = 48
MARGIN_M = 0.25
LAST_S = 1.5  # how long the last picture stays


def save_film(path: str | Path, film: pd.DataFrame, curves: pd.DataFrame) -> None:
    """Write a film of one run as an animated GIF, whole or not at all.

    Parameters
    ----------
    path : path
    film : DataFrame
        Markers of the run in evenly spaced frames: ``time_s, marker, x_m, y_m, z_m``; body markers,
        and the boom's as ``boom``.
    curves : DataFrame
        The same run's stances, as for `hopdata.figures.steering_run`: the rows of "measured".

    Raises
    ------
    AnalysisError
        If there are fewer than two frames.
    """
    from hopdata.jobs import whole_file

    times = film["time_s"].drop_duplicates().to_numpy()
    if len(times) < 2:
        raise AnalysisError(f"film: expected frames of a run, found {len(times)}")
    with style_context():
        pictures = _pictures(film, curves[curves["curve"] == "measured"], times)
    duration_ms = round(1000 * float(np.diff(times).mean()) / SPEED)
    durations = [duration_ms] * (len(pictures) - 1) + [round(1000 * LAST_S)]
    with whole_file(path) as temporary:
        pictures[0].save(
            temporary, format="GIF", save_all=True, append_images=pictures[1:],
            duration=durations, loop=0, optimize=False, disposal=1,
        )  # fmt: skip


def _pictures(film: pd.DataFrame, stances: pd.DataFrame, times: Any) -> list[Images.Image]:
    """Draw all frames: what stands still once, what moves on top of it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    names = list(film["marker"].unique())
    places = film[["x_m", "y_m", "z_m"]].to_numpy().reshape(len(times), len(names), 3)
    figure, axes, moving = _stage(places, stances)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    still = canvas.copy_from_bbox(figure.bbox)  # type: ignore[attr-defined]
    palette: Images.Image | None = None
    pictures = []
    for time, markers in zip(times, places, strict=True):
        canvas.restore_region(still)  # type: ignore[attr-defined]
        _move(moving, time, markers, stances)
        for panel, artists in zip(axes, moving["by_panel"], strict=True):
            for artist in artists:
                panel.draw_artist(artist)
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
        if palette is None:
            palette = picture.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
        pictures.append(picture.quantize(palette=palette, dither=Image.Dither.NONE))
    return pictures


def _stage(places: Any, stances: pd.DataFrame) -> tuple[Figure, Any, dict[str, Any]]:
    """Return the empty stage: figure, the panels from above and from the side, what moves."""
    figure = paper_figure(WIDTH_MM, HEIGHT_MM)
    figure.set_dpi(DPI)
    above, side = figure.subplots(2, 1, sharex=True, height_ratios=(4.2, 1))
    low = np.fmin(np.nanmin(places, axis=(0, 1))[:2], 0) - MARGIN_M
    high = np.fmax(np.nanmax(places, axis=(0, 1))[:2], 0) + MARGIN_M
    middle, half = (low + high) / 2, max(high - low) / 2
    above.set_xlim(middle[0] - half, middle[0] + half)
    above.set_ylim(middle[1] - half, middle[1] + half)
    above.set_aspect("equal")
    above.set_ylabel("y (m)")
    side.set_ylim(-0.05, 1.1 * float(np.nanmax(places[..., 2])))
    side.axhline(0.0, color=INK, linewidth=0.8)
    side.set_ylabel("height (m)")
    side.set_xlabel("x (m)")
    above.plot(0, 0, marker="*", color=VERMILION, mec="white", ms=12)
    moving = _moving(above, side)
    moving["board"] = _board_ends(stances, 4 * half)
    return figure, (above, side), moving


def _moving(above: Any, side: Any) -> dict[str, Any]:
    """Return what moves, made for drawing on top of the still picture."""
    parts: dict[str, Any] = {
        "board_line": above.plot([], [], color="#8a6d2f", lw=3, animated=True)[0],
        "path": above.plot([], [], "o-", color=GREY, ms=2.5, lw=0.9, animated=True)[0],
        "body": above.fill([0, 0, 0], [0, 0, 0], color=BLUE, alpha=0.75, animated=True)[0],
        "boom": above.plot([], [], "o-", color=INK, lw=1.6, ms=5, markevery=[1], animated=True)[0],
        "time": above.text(0.02, 0.98, "", transform=above.transAxes, va="top", animated=True),
        "side_body": side.plot([], [], "o-", color=BLUE, lw=2, ms=3, animated=True)[0],
        "side_boom": side.plot([], [], "o-", color=INK, lw=1.2, ms=4, markevery=[1],
                               animated=True)[0],
    }  # fmt: skip
    first: list[Artist] = [parts[name] for name in ("board_line", "path", "body", "boom", "time")]
    parts["by_panel"] = (first, [parts["side_body"], parts["side_boom"]])
    return parts


def _board_ends(stances: pd.DataFrame, width: float) -> Any:
    """Return direction and half width vector of the board, None without one."""
    way = stances[["board_x", "board_y"]].iloc[0].to_numpy(dtype=float)
    if not np.isfinite(way).all():
        return None
    return way, np.array([-way[1], way[0]]) * width / 2


def _move(moving: dict[str, Any], time: float, markers: Any, stances: pd.DataFrame) -> None:
    """Bring everything to where it was at this time."""
    body, boom = markers[:-1], markers[-1]
    centre = body.mean(axis=0)
    past = stances[stances["time_s"] <= time]
    ring = np.concatenate([body, body[:1]])
    moving["path"].set_data(past["x_m"], past["y_m"])
    moving["body"].set_xy(ring[:, :2])
    moving["boom"].set_data([centre[0], boom[0]], [centre[1], boom[1]])
    moving["time"].set_text(f"hop {max(0, len(past) - 1)}, {max(0.0, time):.1f} s")
    moving["side_body"].set_data(ring[:, 0], ring[:, 2])
    moving["side_boom"].set_data([centre[0], boom[0]], [centre[2], boom[2]])
    if moving["board"] is not None:
        way, across = moving["board"]
        place = float(stances["board_first_m"].iloc[0]) if past.empty else past["board_m"].iloc[-1]
        ends = np.stack([place * way - across, place * way + across])
        moving["board_line"].set_data(ends[:, 0], ends[:, 1])
