"""Work and precision: time of a trajectory against the error of its end, our solver and peers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hopdata.figures.style import (
    BLUE,
    DOUBLE_COLUMN_MM,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    letter,
    message_figure,
    paper_figure,
    styled,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# way: its colour, line style and marker; of a package alike in colour.
WAYS: dict[str, tuple[str, Any, str]] = {
    "hopdata, call": (BLUE, "-", "o"),
    "hopdata, batch": (BLUE, (0, (4, 1.5)), "o"),
    "heyoka": (VERMILION, "-", "s"),
    "CVODE, C": (GREEN, "-", "^"),
    "CVODE, scikit-sundae": (GREEN, (0, (4, 1.5)), "^"),
    "diffrax": (PURPLE, "-", "D"),
    "SciPy, Numba": (ORANGE, "-", "v"),
    "SciPy, Python": (ORANGE, (0, (4, 1.5)), "v"),
    "MuJoCo": (SKY, "-", "P"),
}
OTHER_WAY = (GREY, "-", "x")
SCENE_NAMES = {
    "octant": "three affine modes (table 4.3)",
    "vertical_hopper": "hopper in one dimension",
    "plate": "plate on 35 springs",
}


@styled
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
        return message_figure("No work-precision results: no solver finished.")
    figure = paper_figure(DOUBLE_COLUMN_MM, 88.0)
    panels = figure.subplots(1, len(scenes), sharex=True, sharey=True, squeeze=False)[0]
    strong = chosen[chosen["best_of_way"]]
    for number, (axes, scene) in enumerate(zip(panels, scenes, strict=True)):
        best = strong[strong["scene"] == scene]
        pairs = zip(best["way"], best["method"], strict=True)
        _draw_scene(axes, done[done["scene"] == scene], set(pairs))
        axes.axvline(float(chosen["error"].iloc[0]), color=INK, linewidth=0.6, linestyle=":")
        axes.set_title(SCENE_NAMES.get(scene, scene), loc="left")
        letter(axes, "abcdefgh"[number])
    _label(panels)
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


def _label(panels: Any) -> None:
    for axes in panels:
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.grid()
        axes.set_xlabel("largest error of the final state\n(SI units; table 4.3 has none)")
    panels[0].set_ylabel("time of a trajectory (µs)")


def _add_legend(figure: Figure, seen: list[str]) -> None:
    """Name each way once: in the order of `WAYS`, then those it does not know."""
    from matplotlib.lines import Line2D

    names = [way for way in WAYS if way in seen] + [way for way in seen if way not in WAYS]
    handles = []
    for way in names:
        colour, dash, marker = WAYS.get(way, OTHER_WAY)
        handles.append(
            Line2D([], [], color=colour, linestyle=dash, marker=marker, markersize=2.6, label=way)
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=5, handlelength=2.6)
