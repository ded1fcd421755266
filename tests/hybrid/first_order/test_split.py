"""Positions and velocities, told apart by the field."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.first_order.split import infer_split, velocity_rank

# States (x, vx, z, vz): an oscillator in x, a fall in z; a contact pushes z.
FIELD = np.array([[0, 1, 0, 0], [-4, -0.1, 0, 0], [0, 0, 0, 1], [0, 0, -3, 0]], dtype=float)
PUSHED = np.array([False, False, False, True])
ON_HEIGHT = np.array([[0.0, 0.0, -1.0, 0.0]])


def test_interleaved_coordinates():
    assert infer_split(FIELD, PUSHED, ON_HEIGHT) == ((0, 2), (1, 3))


def test_guards_decide_where_the_field_does_not():
    """In x both coordinates move each other; the guard's is the position."""
    on_both = np.array([[0.0, 1.0, -1.0, 0.0]])
    assert infer_split(FIELD, PUSHED, on_both) == ((1, 2), (0, 3))


@pytest.mark.parametrize(
    ("field", "pushed"),
    [(np.eye(3), [False, False, True]), (FIELD, [True, True, True, False]), (np.eye(4), PUSHED)],
    ids=["odd", "pushes everywhere", "first order"],
)
def test_no_split(field, pushed):
    assert infer_split(field, np.array(pushed), np.zeros((1, len(field)))) is None


def test_rank():
    assert velocity_rank(FIELD, (0, 2), (1, 3)) == 1.0
    assert velocity_rank(FIELD, (0, 1), (2, 3)) == 0.0
    assert velocity_rank(FIELD, (0,), (1, 2, 3)) == 0.0
    assert velocity_rank(FIELD, (), ()) == 0.0
