"""Draw one step of the integrator for the documents: docs/integrator_step.svg.

    python packaging/hybrid/drawing.py

A guard is drawn along the interpolant of one step. The interpolant is a polynomial of
degree 4, as that of DOPRI5, and the guard is affine. So the ranges in the picture are
what the driver computes: the least and the largest Bernstein coefficient of a piece, of
the guard and of its rate. The pieces are those that its rules leave, if a piece that is
not decided is halved.
"""

from dataclasses import dataclass
from math import comb
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.polynomial import Polynomial

from hopdata.arrays import FloatArray
from hopdata.figures.style import save_figure

DOCS = Path(__file__).parents[2] / "docs"
# The guard along the step, x from 0 to 1, and after the event.
ALONG = Polynomial([0.60, -1.55, 2.10, 2.80, -4.50])
AFTER = Polynomial([0.0, -1.5, 3.0])  # from the event on
LAST = 1.17
# Colours: clear pieces, the piece with the flip, what is only tried, and text.
CLEAR, FLIPPING, TRIED, INK = "#4477aa", "#cc5500", "#999999", "#222222"


@dataclass(frozen=True)
class Piece:
    """A piece of the step, the range of the guard in it, and what is decided."""

    start: float
    end: float
    low: float
    high: float
    flips: bool


def bernstein(polynomial: Polynomial, start: float, end: float) -> FloatArray:
    """Return the Bernstein coefficients of a polynomial over a piece."""
    over = polynomial(Polynomial([start, end - start])).coef
    n = len(over) - 1
    return np.array(
        [
            sum(comb(k, j) / comb(n, j) * over[j] for j in range(k + 1))
            for k in range(n + 1)
        ]
    )


def pieces(start: float = 0.0, end: float = 1.0) -> list[Piece]:
    """Return the pieces of the step from left to right, up to that with the flip."""
    values = bernstein(ALONG, start, end)
    rates = bernstein(ALONG.deriv(), start, end)
    low, high = float(values.min()), float(values.max())
    if low > 0.0 or high < 0.0:
        return [Piece(start, end, low, high, flips=False)]
    if rates.max() < 0.0 and ALONG(end) < 0.0 < ALONG(start):
        return [Piece(start, end, low, high, flips=True)]
    middle = 0.5 * (start + end)
    return [*pieces(start, middle), *pieces(middle, end)]


def draw_pieces(axes: Axes) -> None:
    """Draw the range of the guard in each piece."""
    for piece in pieces():
        colour = FLIPPING if piece.flips else CLEAR
        corner = (piece.start, piece.low)
        width, height = piece.end - piece.start, piece.high - piece.low
        for filled in (True, False):
            look = {"facecolor": colour, "alpha": 0.15, "edgecolor": "none"}
            if not filled:
                look = {"facecolor": "none", "edgecolor": colour, "linewidth": 1.0}
            axes.add_patch(Rectangle(corner, width, height, **look))


def draw_path(axes: Axes, flip: float) -> None:
    """Draw the guard along the interpolant, and on from the event."""
    before, beyond = np.linspace(0.0, flip, 200), np.linspace(flip, 1.0, 50)
    after = np.linspace(flip, LAST, 50)
    axes.plot(before, ALONG(before), color=INK, linewidth=2.2)
    axes.plot(beyond, ALONG(beyond), color=TRIED, linewidth=1.4, linestyle=(0, (3, 2)))
    axes.plot(after, AFTER(after - flip), color=INK, linewidth=2.2)
    for x, y in ((0.0, ALONG(0.0)), (flip, 0.0)):
        axes.plot(x, y, "o", color=INK, markersize=6, zorder=5)
    axes.plot(1.0, ALONG(1.0), "o", color=TRIED, markersize=6, zorder=5)


def draw_labels(axes: Axes, flip: float) -> None:
    """Write what is seen, with a thin line to each, numbered as in the text."""
    event = flip + 0.13
    labels = [
        ("1  step: from here ...", (0.10, 0.86), (0.0, ALONG(0.0)), INK),
        (
            "2  interpolant: the state\nbetween both ends",
            (0.47, 0.83), (0.55, ALONG(0.55)), INK,
        ),
        (
            "3  ranges without zero:\nno flip in these pieces",
            (0.24, -0.24), (0.31, pieces()[0].low), CLEAR,
        ),
        (
            "4  falls all through:\none flip in this piece",
            (0.60, -0.36), (0.77, -0.25), FLIPPING,
        ),
        (
            "5  landing: the step is\ntaken again, to here",
            (1.02, 0.66), (flip + 0.004, 0.03), INK,
        ),
        (
            "6  event: the lock turns,\nanother field",
            (1.15, 0.20), (event, AFTER(event - flip)), INK,
        ),
    ]  # fmt: skip
    for text, at, to, colour in labels:
        line = {"arrowstyle": "-", "color": colour, "linewidth": 0.8, "shrinkA": 2}
        axes.annotate(
            text, to, at, color=colour, fontsize=9.5, ha="center", va="center",
            zorder=6, arrowprops=line,
        )  # fmt: skip
    end = float(ALONG(1.0))
    axes.text(
        1.02, end, "... tried to here", color="#666666", fontsize=9.5, va="center"
    )
    axes.text(0.005, -0.045, "surface, h = 0", fontsize=9.5, va="top")


def step_figure() -> Figure:
    """Return the picture of a step."""
    roots = [root.real for root in ALONG.roots() if abs(root.imag) < 1e-9]
    flip = float(min(root for root in roots if root > 0.0))
    figure = Figure(figsize=(7.6, 4.0), layout="constrained")
    axes = figure.add_subplot()
    draw_pieces(axes)
    axes.axhline(0.0, color=INK, linewidth=0.9)
    draw_path(axes, flip)
    draw_labels(axes, flip)
    draw_lock(axes, flip)
    axes.set(xlim=(-0.03, 1.29), ylim=(-0.98, 1.0), xticks=[], yticks=[])
    axes.set_xlabel("time", loc="right")
    axes.set_ylabel("guard h(t, y)")
    axes.spines[["top", "right", "left", "bottom"]].set_visible(False)
    return figure


def draw_lock(axes: Axes, flip: float) -> None:
    """Draw the lock below: it changes at the event only."""
    high, low = -0.74, -0.90
    axes.plot([0.0, flip, flip, LAST], [high, high, low, low], color=INK, linewidth=1.4)
    axes.text(
        0.005, high + 0.03, "lock of the guard, which the field reads: +1", fontsize=9.5
    )
    axes.text(LAST + 0.005, low, "-1", fontsize=9.5, va="center")


if __name__ == "__main__":
    save_figure(step_figure(), DOCS / "integrator_step", formats=["svg"])
