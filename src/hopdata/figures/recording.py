"""A recording as it was measured: the heights of its markers over time."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hopdata.arrays import FloatArray
from hopdata.feet import foot_places
from hopdata.figures import style

#: Frames from which on lines are drawn as pixels, also in SVG and PDF.
#: Unit: 1. Origin: chosen.
MANY_FRAMES = 20_000
#: Markers without a role that get a line in the legend.
#: Unit: 1. Origin: chosen.
MOST_NAMED = 8
HEIGHT_MM = 60.0
OTHERS = "#9a9a9a"
NOTHING = "No frame, or no marker, to show."


@style.styled
def heights_figure(
    time_s: FloatArray,
    heights_m: Mapping[str, FloatArray],
    roles: Mapping[str, str],
) -> Figure:
    """Draw the heights of the feet and the body's mean; without roles of all markers.

    Parameters
    ----------
    time_s : (N,) array
        Time of each frame, s.
    heights_m : mapping of str to (N,) array
        Height of each marker, m; NaN where it was not seen, which leaves a gap.
    roles : mapping of str to str
        Role of each marker, as in `hopdata.Recording`.
    """
    if not len(time_s) or not heights_m:
        return style.message_figure(NOTHING, width_mm=style.WIDEST_PANEL_MM)
    figure = style.paper_figure(style.WIDEST_PANEL_MM, HEIGHT_MM)
    axes = figure.subplots()
    line: dict[str, Any] = {"linewidth": 0.8, "rasterized": len(time_s) > MANY_FRAMES}
    feet = [name for name in heights_m if roles[name] == "foot"]
    body = [name for name in heights_m if roles[name] == "body"]
    if body:
        mean_m = np.mean([heights_m[name] for name in body], axis=0)
        axes.plot(time_s, mean_m, color=style.INK, label="body (mean)", **line)
    for name, place in foot_places(feet).items():
        look = {**line, **style.foot_line(place)}
        axes.plot(time_s, heights_m[name], label=style.label_of(name), **look)
    if not feet and not body:
        are_few = len(heights_m) <= MOST_NAMED
        for number, (name, height_m) in enumerate(heights_m.items()):
            look = {**line, "color": OTHERS}
            if are_few:
                look |= {**style.foot_line(number), "label": style.label_of(name)}
            axes.plot(time_s, height_m, **look)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("height (m)")
    axes.margins(x=0.0)
    handles, labels = axes.get_legend_handles_labels()
    if labels:
        figure.legend(
            handles, labels, loc="outside upper left", ncols=min(len(labels), 6)
        )
    else:
        axes.set_title(f"{len(heights_m)} markers", fontsize=style.pt(7))
    return figure
