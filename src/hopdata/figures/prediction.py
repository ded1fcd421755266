"""Figure 2.4: prediction errors of models of the landing, over the bootstraps."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdata.figures import style

# In the order of the dissertation, with the label of each box.
MODELS: Mapping[str, str] = {
    "specialised": "affine\n(specialised)",
    "near": "affine\n(near)",
    "all": "affine\n(all)",
    "far": "affine\n(far)",
    "specialised_mean": "mean\n(specialised)",
    "mean": "mean\n(all)",
}
AFFINE = ("specialised", "near", "all", "far")
# A wider gap separates the affine models from the means.
PLACES = {name: i + 0.4 * (name not in AFFINE) for i, name in enumerate(MODELS)}
# Margin beyond the boxes, relative to their range, so that no whisker touches the
# frame.
ROOM = 0.04
QUANTILES = ("p2_5", "q25", "median_mse", "q75", "p97_5")
# Shades of the boxes.
OF_AFFINE = "#7a7a7a"
OF_MEAN = "#d0d0d0"


@style.styled
def prediction_figure(summary: pd.DataFrame, units: Mapping[str, Any]) -> Figure:
    """Draw Fig. 2.4: box plots of the bootstrapped combined mean-squared error.

    Parameters
    ----------
    summary : DataFrame
        One row per model: ``model``, the quantiles ``p2_5, q25, median_mse, q75,
        p97_5`` of the MSE in squared normalised units, and optionally ``n_train``,
        ``n_test``, ``n_classes``. A model without a row, or with a NaN, is marked "not
        fitted".
    units : mapping
        ``length_unit_m`` and ``time_unit_s``, the units of normalisation.

    Returns
    -------
    Figure
        One logarithmic axis with a place for each model; whiskers from 2.5 % to 97.5 %.
    """
    rows = {str(row["model"]): row for row in summary.to_dict("records")}
    fitted = [name for name in MODELS if _is_fitted(rows.get(name))]
    if not fitted:
        return style.message_figure(
            "No model could be fitted: there are too few touchdowns used."
        )
    figure = style.paper_figure(style.WIDEST_PANEL_MM, 72.0)
    axes = figure.subplots()
    axes.set_yscale("log")
    axes.set_ylim(_round_limits([rows[name][q] for name in fitted for q in QUANTILES]))
    for name, place in PLACES.items():
        if name not in fitted:
            words = "not fitted:\ntoo few\ntouchdowns"
            style.lacking(axes, place, 0.5, words, axes.get_xaxis_transform())
            continue
        colour = OF_MEAN
        if name in AFFINE:
            colour = OF_AFFINE
        quantiles = [float(rows[name][q]) for q in QUANTILES]
        style.box(axes, place, quantiles, colour, widths=0.5)
        _write_share(axes, place, rows[name], rows.get("mean"))
    _label(axes, rows, units)
    return figure


def _is_fitted(row: Mapping[Any, Any] | None) -> bool:
    return row is not None and all(np.isfinite(row.get(q, np.nan)) for q in QUANTILES)


def _write_share(
    axes: Axes, place: float, row: Mapping[Any, Any], mean: Mapping[Any, Any] | None
) -> None:
    """Write the median beside its box, relative to that of the mean if there is one."""
    median = float(row.get("median_mse", np.nan))
    of_mean = float((mean or {}).get("median_mse", np.nan))
    text = significant(median)
    if of_mean > 0:
        text = f"{significant(100 * median / of_mean)} %"
    at = (place + 0.25, median)
    style.note(axes, text, at, (2.5, 0), va="center", bbox=style.ON_WHITE)


def _label(
    axes: Axes, rows: Mapping[str, Mapping[Any, Any]], units: Mapping[str, Any]
) -> None:
    ticks = [f"{text}{_split(rows.get(name))}" for name, text in MODELS.items()]
    axes.set_xticks(list(PLACES.values()), ticks)
    axes.tick_params(axis="x", length=0)
    axes.set_xlim(-0.5, max(PLACES.values()) + 0.7)
    shares = ""
    if _is_fitted(rows.get("mean")):
        shares = "\n%: of the error of the mean (all)"
    axes.set_xlabel(f"model (touchdowns to train / to test in each bootstrap){shares}")
    axes.set_ylabel(f"combined prediction MSE (units²)\n{units_text(units)}")
    # The range is often less than one decade.
    axes.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    style.plain_numbers(axes.yaxis)
    axes.grid(axis="y", which="major")


def _round_limits(values: Sequence[float]) -> tuple[float, float]:
    """Return the ticks (1, 2 or 5 times 10^n) next outside all values and a margin."""
    low = min(values)
    high = max(values)
    if low <= 0:
        # A logarithmic axis has no zero.
        low = high / 1e6 if high > 0 else 1e-6
    high = max(high, low)
    margin = (high / low) ** ROOM
    bottom = low / margin
    top = high * margin

    first_decade = math.floor(math.log10(bottom)) - 1
    last_decade = math.ceil(math.log10(top)) + 1
    ticks: list[float] = []
    for decade in range(first_decade, last_decade + 1):
        ticks.extend(step * 10.0**decade for step in (1, 2, 5))
    return max(t for t in ticks if t < bottom), min(t for t in ticks if t > top)


def _split(row: Mapping[Any, Any] | None) -> str:
    """Return the sizes of training and test sets, as a third line under the name."""
    if row is None or not _is_fitted(row):
        return ""
    n_train = row.get("n_train", np.nan)
    n_test = row.get("n_test", np.nan)
    if not np.isfinite([n_train, n_test]).all():
        return ""
    return f"\n{n_train:.0f} / {n_test:.0f}"


def units_text(units: Mapping[str, Any]) -> str:
    """Return the units of normalisation as printed: ``units: 29.1 mm and 27 ms``."""
    length_m = units.get("length_unit_m")
    time_s = units.get("time_unit_s")
    if length_m is None or time_s is None:
        return "units not determined"
    length_mm = float(length_m) * 1e3
    time_ms = float(time_s) * 1e3
    return f"units: {significant(length_mm)} mm and {significant(time_ms)} ms"


def significant(value: float) -> str:
    """Format to three significant digits, without an exponent where that reads well."""
    if abs(value) >= 1000:
        return f"{value:.0f}"
    return f"{value:.3g}"
