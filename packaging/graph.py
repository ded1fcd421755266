"""Draw the rules as a graph, from top to bottom in their order."""

from hopdata.line import Line


def drawing(line: Line) -> str:
    return ""
