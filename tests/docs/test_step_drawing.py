"""The picture of a step says what would be drawn now, and its pieces are decided."""

import importlib.util
import re
import sys
from html import unescape
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
ROUNDING = 1e-14


@pytest.fixture(scope="module")
def drawing():
    path = ROOT / "packaging" / "hybrid" / "drawing.py"
    spec = importlib.util.spec_from_file_location("drawing_of_a_step", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclass looks it up
    spec.loader.exec_module(module)
    return module


def test_the_picture_says_what_would_be_drawn_now(drawing):
    (axes,) = drawing.step_figure().axes
    lines = [axes.get_xlabel(), axes.get_ylabel()]
    for text in axes.texts:
        lines += text.get_text().splitlines()
    svg = (ROOT / "docs" / "integrator_step.svg").read_text(encoding="utf-8")
    shown = [unescape(text) for text in re.findall(r"<text[^>]*>([^<]*)</text>", svg)]
    assert len(lines) > 10
    assert {line.strip() for line in lines} == {text.strip() for text in shown}


def test_its_ranges_hold_the_guard_and_one_piece_has_the_flip(drawing):
    pieces = drawing.pieces()
    assert [piece.flips for piece in pieces] == [False, False, True]
    assert pieces[0].start == 0.0
    assert pieces[-1].end == 1.0
    for one, other in pairwise(pieces):
        assert one.end == other.start
    for piece in pieces:
        x = np.linspace(piece.start, piece.end, 1001)
        values = drawing.ALONG(x)
        assert piece.low <= values.min() + ROUNDING
        assert values.max() <= piece.high + ROUNDING
        assert piece.flips == (values.min() < 0.0)
        if piece.flips:
            assert (np.diff(values) < 0.0).all()
