"""Draw the rules of the bundled sample as a graph, from top to bottom."""

from dataclasses import dataclass
from html import escape

from hopdata.line import Line

#: Rules that are no stages, with the rules before them.
OTHERS = {
    "score": ["mode_schedules", "prediction", "constraint_subspaces"],
    "figures_landings": ["section_densities", "quality"],
    "figures_maps": ["constraint_subspaces", "landing_maps", "prediction", "verdict"],
    "report": ["figures_landings", "figures_maps", "score"],
}
#: Boxes in pixels.
WIDTH = 148
HEIGHT = 30
GAP_X = 18
GAP_Y = 30
MARGIN = 12
#: The column of each rule; the user's stages stand below one another in the second.
CHAIN = 1
COLUMNS = {
    "simulate": 2,
    "inspection": 3,
    "section_densities": 4,
    "quality": 3,
    "prediction": 0,
    "landing_maps": 2,
    "verdict": 3,
    "score": 0,
    "figures_maps": 2,
    "figures_landings": 4,
    "report": 2,
}
#: Rules that stand lower than they might: in the row of another.
IN_ROW_OF = {"verdict": "prediction", "figures_landings": "figures_maps"}


@dataclass(frozen=True)
class Box:
    """Place of a rule in the picture."""

    name: str
    x: float
    y: float


def drawing(line: Line) -> str:
    """Return the graph as SVG."""
    before = reduced(rules_before(line))
    rows = rows_of(before)
    boxes = {name: _box(name, rows[name]) for name in before}
    right = max(box.x for box in boxes.values()) + WIDTH + MARGIN
    bottom = max(box.y for box in boxes.values()) + HEIGHT + MARGIN
    arrows = [
        _arrow(boxes[one], boxes[name]) for name in before for one in before[name]
    ]
    texts = [_drawn(box, line) for box in boxes.values()]
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {right} {bottom}"'
            f' width="{right}" height="{bottom}" role="img"'
            ' aria-label="The rules of the sample, and which takes results of which"'
            ' font-family="sans-serif" font-size="12.5">',
            "<!-- written by `make rules` -->",
            f'<rect width="{right}" height="{bottom}" fill="#ffffff"/>',
            *arrows,
            *texts,
            "</svg>\n",
        ]
    )


def rules_before(line: Line) -> dict[str, list[str]]:
    """Return the rules that each rule takes results of."""
    before = {name: line.before(name) for name in line.stages}
    return {**before, **OTHERS}


def reduced(before: dict[str, list[str]]) -> dict[str, list[str]]:
    """Leave out arrows that a longer way already shows."""

    def reached(name: str) -> set[str]:
        found = set(before[name])
        for one in before[name]:
            found |= reached(one)
        return found

    kept = {}
    for name, makers in before.items():
        further = set().union(*(reached(one) for one in makers))
        kept[name] = [one for one in makers if one not in further]
    return kept


def rows_of(before: dict[str, list[str]]) -> dict[str, int]:
    """Return the row of each rule: below all those that it takes results of."""
    rows: dict[str, int] = {}
    for name, makers in before.items():
        rows[name] = 1 + max((rows[one] for one in makers), default=-1)
    for name, other in IN_ROW_OF.items():
        rows[name] = max(rows[name], rows[other])
    return rows


def _box(name: str, row: int) -> Box:
    x = MARGIN + COLUMNS.get(name, CHAIN) * (WIDTH + GAP_X)
    return Box(name, x, MARGIN + row * (HEIGHT + GAP_Y))


def _arrow(start: Box, end: Box) -> str:
    """Return a curve from the bottom of one box to the top of another."""
    x1 = start.x + WIDTH / 2
    y1 = start.y + HEIGHT
    x2 = end.x + WIDTH / 2
    y2 = end.y
    middle = (y1 + y2) / 2
    path = f"M{x1} {y1} C{x1} {middle} {x2} {middle} {x2} {y2 - 6}"
    tip = f"M{x2 - 4} {y2 - 7} L{x2} {y2} L{x2 + 4} {y2 - 7} Z"
    return (
        f'<path d="{path}" fill="none" stroke="#8a8a8a" stroke-width="1.3"/>'
        f'<path d="{tip}" fill="#8a8a8a"/>'
    )


def _drawn(box: Box, line: Line) -> str:
    """Return a box with the name of its rule; stages are darker than the rest."""
    fill = "#f1f1f1"
    edge = "#9a9a9a"
    if box.name in line.stages:
        fill = "#e3edf7"
        edge = "#3a6ea5"
    return (
        f'<rect x="{box.x}" y="{box.y}" width="{WIDTH}" height="{HEIGHT}" rx="4"'
        f' fill="{fill}" stroke="{edge}"/>'
        f'<text x="{box.x + WIDTH / 2}" y="{box.y + HEIGHT / 2 + 4.5}"'
        f' text-anchor="middle" fill="#1a1a1a">{escape(box.name)}</text>'
    )
