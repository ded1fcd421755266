"""The landing map as a picture, and the scaling study."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.arrays import FloatArray
from hopdata.figures import style

# The landing map as a picture: exact and estimated maps, and their differences.

INPUTS = {
    "pitch_rad": "pitch",
    "roll_rad": "roll",
    "forward_m_s": "forward",
    "sideways_m_s": "sideways",
    "climb_m_s": "climb",
    "spin_x_rad_s": "spin x",
    "spin_y_rad_s": "spin y",
    "spin_z_rad_s": "spin z",
}
OUTPUTS = {"step_x_m": "step x", "step_y_m": "step y", "turn_rad": "turn", **INPUTS}
# Estimators needed; to first order, the errors of the printed map are those of least
# squares.
NEEDED = ("printed", "ols", "corrected_curved")
# Standard errors from zero within which a cell is grey, and that grey.
SURE = 2.0
UNSURE = "#d9d9d9"
# Rows before this one are displacements, the others come from velocities.
FIRST_VELOCITY = 5


@style.styled
def matrices_figure(
    estimates: pd.DataFrame,
    details: Mapping[str, Any],
    exact: pd.DataFrame | None = None,
) -> Figure:
    """Draw maps as images, with 8 input columns and 11 output rows.

    Parameters
    ----------
    estimates : DataFrame
        ``estimator, input, output, standardised`` (displacement of the markers, mm, for
        one standard deviation of the input), ``value, standard_error``. ``printed`` and
        ``corrected_curved`` are drawn; cells within `SURE` standard errors of zero are
        grey.
    details : mapping
        Contents of ``map_estimates.json``: the number of landings, and how much noise
        the corrected map allows for.
    exact : DataFrame, optional
        The same without ``estimator``, if the exact map is known; else without rows.

    Returns
    -------
    Figure
        Maps on the left, and differences on the right on another scale: both estimates
        minus the exact map or, if it is unknown, the printed estimate minus the
        corrected one.
    """
    tables = {name: estimates[estimates["estimator"] == name] for name in NEEDED}
    if any(table.empty for table in tables.values()):
        return style.message_figure(
            "The landing map could not be estimated: too few landings."
        )
    printed, _ = _matrix(tables["printed"])
    _, printed_error = _matrix(tables["ols"])
    best, error = _matrix(tables["corrected_curved"])
    maps = {
        "least squares,\nas printed": _sure(printed, printed_error),
        _corrected_for(details): _sure(best, error),
    }
    if exact is None or exact.empty:
        differences = {"printed\nminus corrected": _sure(printed - best, error)}
    else:
        true, _ = _matrix(exact)
        maps = {"exact": true, **maps}
        differences = {
            "printed\nminus exact": _sure(printed - true, printed_error),
            "corrected\nminus exact": _sure(best - true, error),
        }
    if not any(np.isfinite(matrix).any() for matrix in differences.values()):
        differences = {}  # noise alone explains all of them: the caption says so
    landings = f"{details['n_landings']:,} landings"
    n_panels = len(maps) + len(differences)
    width_mm = style.DOUBLE_COLUMN_MM
    if (
        n_panels == 2
    ):  # they share a bar of colours, so a narrow page keeps them together
        width_mm = style.WIDEST_PANEL_MM
    figure = style.paper_figure(width_mm, 82.0)
    panels = figure.subplots(1, n_panels, sharey=True)
    groups = (
        (panels[: len(maps)], maps, f"maps (mm per sd of the input), {landings}"),
        (panels[len(maps) :], differences, "differences\n(mm per sd of the input)"),
    )
    for axes, matrices, label in groups:
        if not matrices:
            continue
        limit = _largest(matrices.values())
        for one, (title, matrix) in zip(axes, matrices.items(), strict=True):
            image = _draw_matrix(one, matrix, limit)
            one.set(title=title, xlabel="state before")
        figure.colorbar(
            image,
            ax=list(axes),
            location="bottom",
            label=label,
            shrink=0.8,
            aspect=30,
            pad=0.02,
        )
        axes[0].tick_params(labelleft=True)
    panels[0].set_yticks(range(len(OUTPUTS)), list(OUTPUTS.values()))
    panels[0].set_ylabel("state after the landing")
    style.letters(panels)
    return figure


def _corrected_for(details: Mapping[str, Any]) -> str:
    """Return what the corrected map of this study was corrected for."""
    removed = float(details["maps"]["corrected_curved"]["noise_removed"])
    if removed >= 1.0:
        return "noise and curvature\ncorrected"
    if removed <= 0.0:
        return "curvature\ncorrected"
    return f"curvature and {100 * removed:.2g} %\nof noise corrected"


def _largest(matrices: Iterable[FloatArray]) -> float:
    """Return the largest absolute value; one if all cells are zero or unsure."""
    largest = max(float(np.nan_to_num(abs(matrix)).max()) for matrix in matrices)
    return largest if largest > 0 else 1.0


def _draw_matrix(axes: Axes, matrix: FloatArray, limit: float) -> Any:
    colours = colormaps[style.OF_SIGNS].with_extremes(bad=UNSURE)
    image = axes.imshow(matrix, cmap=colours, vmin=-limit, vmax=limit, aspect="auto")
    axes.set_xticks(range(len(INPUTS)), list(INPUTS.values()), rotation=90)
    axes.tick_params(length=0)
    axes.axhline(FIRST_VELOCITY - 0.5, color=style.INK, linewidth=0.5)
    return image


def _sure(matrix: FloatArray, error: FloatArray) -> FloatArray:
    """Return the cells that noise alone does not explain; NaN in the others."""
    return np.where(np.abs(matrix) > SURE * error, matrix, np.nan)


def _matrix(table: pd.DataFrame) -> tuple[FloatArray, FloatArray]:
    """Return outputs (11) by inputs (8), and standard errors, zero if there are none.

    Both are displacements, like the column ``standardised``.
    """
    scale = (table["standardised"] / table["value"]).abs()
    known = table.assign(error=scale * table.get("standard_error", 0.0))
    wide = known.pivot_table(
        index="output", columns="input", values=["standardised", "error"]
    )
    value = wide["standardised"].loc[list(OUTPUTS), list(INPUTS)].to_numpy(float)
    error = wide["error"].loc[list(OUTPUTS), list(INPUTS)].to_numpy(float)
    return value, error


# Label, column of the strength, colour and marker of each case other than the scene
# itself.
CASES = {
    "coupling": ("coupled forces", "coupling", style.GREY, "s"),
    "impulse": ("rigid impulses", "impulse", style.GREY, "^"),
    "delay": ("contact by velocity", "delay_s", style.GREY, "D"),
    "study": ("this study's control", "", style.GREY, "v"),
}
SYMBOLS = {"coupling": "κ = {:g}", "impulse": "ε = {:g}", "delay_s": "τ = {:g} s"}
PANELS = {
    "pooled_rms": "error of one map for all orders\n(rms, in sd of the outcomes)",
    "pooled_over_specialised": "MSE of one map\nover one for each order",
    "map_difference": "largest difference between\nthe maps of two orders (relative)",
}
# A smaller exact difference counts as zero.
SEEN = 1e-6


@style.styled
def scaling_study_figure(table: pd.DataFrame) -> Figure:
    """Draw three panels over the scale of the deviations, with one line per case.

    Parameters
    ----------
    table : DataFrame
        From `hopdata.maps.truth.scaling.scaling_table`.

    Returns
    -------
    Figure
        (a) Error of the pooled map, with its slope over all scales, and between the two
        smallest. (b) Its mean square relative to
        that of the schedules' maps. (c) Largest difference between these maps; dashed,
        between the exact maps.
    """
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, 78.0)
    panels = figure.subplots(1, 3)
    cases = list(dict.fromkeys(table["case"]))
    scales = sorted(set(table["scale"]))
    for axes, (column, label) in zip(panels, PANELS.items(), strict=True):
        for case in cases:
            _draw_case(axes, table[table["case"] == case], case, column)
        axes.set_xticks(scales, [_fraction(scale) for scale in scales])
        axes.set_xticks([], minor=True)
        axes.set(xlabel="scale of the deviations", ylabel=label)
        axes.grid(axis="y", which="major")
    _draw_guides(panels[0], table)
    style.lettered(figure, panels, ncols=3)
    for case in cases:
        exact = float(table.loc[table["case"] == case, "exact_difference"].median())
        if exact > SEEN:
            _, _, colour, _ = _shown(case)
            dashed = (0, (4, 2))
            panels[2].axhline(exact, color=colour, linestyle=dashed, linewidth=0.8)
    for axes in panels:
        style.numbers_within_a_decade(axes.yaxis)
    return figure


def _shown(case: str) -> tuple[str, str, str, str]:
    """Return label, strength, colour and marker of a case: a control, or the scene."""
    return CASES.get(case, (case, "", style.INK, "o"))


def _draw_case(axes: Axes, rows: pd.DataFrame, case: str, column: str) -> None:
    name, strength, colour, marker = _shown(case)
    slope = float(rows["slope"].iloc[0])
    fitted = "not between the sections"
    if np.isfinite(slope):
        fitted = f"slope {slope:.2f}, at the end {_last_slope(rows):.2f}"
    size = ""
    if strength:
        size = SYMBOLS[strength].format(rows[strength].iloc[0]) + "\n"
    look: dict[str, Any] = {"marker": marker, "markersize": 3.5, "color": colour}
    axes.loglog(rows["scale"], rows[column], label=f"{name}, {size}{fitted}", **look)


def _last_slope(rows: pd.DataFrame) -> float:
    """Return the slope of the error between the two smallest scales."""
    two = rows.sort_values("scale").iloc[:2]
    errors = np.log(two["pooled_rms"].to_numpy(float))
    scales = np.log(two["scale"].to_numpy(float))
    return float(np.diff(errors)[0] / np.diff(scales)[0])


# How far below the smallest error of the largest scale the guides meet, as a factor.
GUIDES_MEET = 0.5
# Slope of a guide, and its dashes.
GUIDES = {1: (0, (1, 2)), 2: (0, (6, 2, 1, 2))}


def _draw_guides(axes: Axes, table: pd.DataFrame) -> None:
    """Draw lines of slope 1 and 2 as guides for the eye, below all curves at one end.

    The legend names them: curves may run anywhere, so no text beside a guide is sure to
    stay free of lines.
    """
    scales = np.array([table["scale"].min(), table["scale"].max()])
    at_largest = table.loc[table["scale"] == scales[1], "pooled_rms"]
    meet = GUIDES_MEET * float(at_largest.min())
    for slope, dashes in GUIDES.items():
        line = meet * (scales / scales[1]) ** slope
        look: Any = {"color": style.GREY, "linewidth": 0.9, "linestyle": dashes}
        axes.plot(scales, line, label=f"slope {slope}, to compare", **look)


def _fraction(value: float) -> str:
    """Format a scale as 1/n if it is one."""
    whole = round(1 / value)
    if whole > 1 and abs(whole * value - 1) < 1e-9:
        return f"1/{whole}"
    return f"{value:g}"
