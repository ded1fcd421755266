"""Which contact orders differ: a field for each two orders, and for each two feet."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from hopdata.figures import style
from hopdata.figures.schedule import ARROW

NO_SIZES = "This study has no size of a difference for each two contact orders."
NONE_FOUND = "No two orders are found to differ"
# Titles of the fields of maps and of jumps.
TITLES = {
    "map": "difference between the maps\n(% of the map)",
    "jump": "jump of the outcome\n(% of what it varies)",
}
# Height of the figure: of its frame, and of each row of fields.
FRAME_MM = 40.0
ROW_MM = 9.0
# The palest colour of a difference that was found, and that of none.
PALEST = 0.35
NOTHING = "#EDEDED"


@style.styled
def orders_figure(verdict: Mapping[str, Any]) -> Figure:
    """Draw which contact orders, or feet, differ, and by how much.

    Parameters
    ----------
    verdict : mapping
        Contents of ``verdict.json``.

    Returns
    -------
    Figure
        (a) Sizes of the differences between maps. (b) Sizes of the jumps where two feet
        exchange their order, if there can be any. Only differences that were found are
        coloured; the intervals of all fields hold together.
    """
    effects = verdict.get("orders") or []
    if not effects:
        return style.message_figure(NO_SIZES, width_mm=style.DOUBLE_COLUMN_MM)
    parts = {}
    for of in TITLES:
        found = [effect for effect in effects if effect["of"] == of]
        if found:
            parts[of] = found
    last_matters = _last_matters(verdict)
    names = {of: _names(found, by_last=last_matters) for of, found in parts.items()}
    rows = max(len(some) for some in names.values())
    figure = style.paper_figure(style.DOUBLE_COLUMN_MM, FRAME_MM + ROW_MM * rows)
    widths = [max(2, len(some) - 1) for some in names.values()]
    panels = figure.subplots(1, len(parts), squeeze=False, width_ratios=widths)[0]
    for axes, of in zip(panels, parts, strict=True):
        _draw_fields(axes, parts[of], names[of])
        axes.set_title(TITLES[of], fontsize=style.pt(7))
    style.letters(panels)
    some_differ = any(effect["low"] > 0.0 for effect in effects)
    message = verdict.get("mainly") or NONE_FOUND
    colour = style.VERMILION if some_differ else style.INK
    figure.suptitle(
        message[0].upper() + message[1:],
        color=colour,
        fontsize=style.pt(9),
        fontweight="bold",
        x=0.01,
        ha="left",
    )
    sure = f"{100 * float(verdict['confidence']):g} %"
    grey = f"grey: not found to differ (small: the size not excluded, at {sure})"
    figure.supxlabel(grey, fontsize=style.pt(7))
    return figure


def _last_matters(verdict: Mapping[str, Any]) -> bool:
    """Return whether the orders differ mainly by the foot that touches last."""
    message = verdict.get("messages", {}).get("mainly", {})
    inner = message.get("values", {}).get("maps", message)
    return str(inner.get("code", "")).startswith("maps.end")


def _names(effects: Sequence[Mapping[str, Any]], *, by_last: bool) -> list[str]:
    """Return the orders, or the feet, in the order of their rows."""
    names = {str(effect[side]) for effect in effects for side in ("first", "second")}
    if _are_feet(effects):
        feet = {foot for name in names for foot in name.split(">")}
        return sorted(feet, key=int)

    def place(name: str) -> list[int]:
        feet = [int(foot) for foot in name.split(">")]
        return feet[::-1] if by_last else feet

    return sorted(names, key=place)


def _are_feet(effects: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether feet are compared: a pair then is two feet in either order."""
    return len(str(effects[0]["first"]).split(">")) == 2


def _draw_fields(
    axes: Axes, effects: Sequence[Mapping[str, Any]], names: Sequence[str]
) -> None:
    """Draw a triangle with one field for each pair."""
    are_feet = _are_feet(effects)
    largest = max(0.2, *(float(effect["estimate"]) for effect in effects))
    for effect in effects:
        ends = [str(effect["first"]), str(effect["second"])]
        if are_feet:
            ends = ends[0].split(">")
        column, row = sorted(names.index(end) for end in ends)
        _draw_field(axes, (column, row), effect, largest)
    labels = [name.replace(">", ARROW) for name in names]
    if are_feet:
        labels = [f"foot {name}" for name in names]
    axes.set_xticks(range(len(names) - 1), labels[:-1], rotation=90)
    axes.set_yticks(range(1, len(names)), labels[1:])
    axes.set_xlim(-0.5, len(names) - 1.5)
    axes.set_ylim(len(names) - 0.5, 0.5)
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _draw_field(
    axes: Axes, at: tuple[int, int], effect: Mapping[str, Any], largest: float
) -> None:
    """Draw one field: the size if it was found, or how large it could be."""
    column, row = at
    look: dict[str, Any] = {"facecolor": NOTHING}
    words = f"< {_percent(effect['high'])}"
    writing: dict[str, Any] = {"fontsize": style.pt(6), "color": style.INK}
    if effect["low"] > 0.0:
        strength = PALEST + (1.0 - PALEST) * float(effect["estimate"]) / largest
        look = {"facecolor": style.VERMILION, "alpha": strength}
        words = _percent(effect["estimate"])
        writing = {"fontsize": style.pt(8), "color": style.INK, "fontweight": "bold"}
    corner = (column - 0.47, row - 0.47)
    axes.add_patch(Rectangle(corner, 0.94, 0.94, linewidth=0, **look))
    axes.text(column, row, words, ha="center", va="center", **writing)


def _percent(share: float) -> str:
    return f"{float(f'{100 * share:.2g}'):g}"
