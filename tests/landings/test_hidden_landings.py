"""Landings that the feet show while the body is hidden, on made-up hops of one second."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.landings.hidden_landings import find_hidden_landings
from hopdata.landings.transitions import find_transitions

TIME = np.arange(0.0, 10.0, 0.01)
PHASE = TIME % 1.0
FEET = np.where(PHASE < 0.5, 0.1 * np.sin(2 * np.pi * PHASE), 0.0)[:, None] * [1.0, 0.8]
BODY = 0.5 + 0.1 * np.sin(2 * np.pi * PHASE)
SECTIONS = {"pre_height_m": 0.53, "post_height_m": 0.47}


def hidden_landings(body, feet=FEET):
    found = find_transitions(TIME, body, **SECTIONS)
    return find_hidden_landings(TIME, feet, body, found, down_height_m=0.01, longest_gap_s=0.025)


def without(body, first, last):
    return np.where((TIME - first) * (last - TIME) > 0, np.nan, body)


def test_there_is_none_while_the_body_is_seen():
    assert len(hidden_landings(BODY)) == 0


@pytest.mark.parametrize(
    ("first", "last", "landings"),
    [(2.1, 6.9, 4), (-1.0, 3.05, 3), (6.05, 11.0, 4), (2.2, 2.8, 0), (2.3, 2.93, 0)],
)
def test_each_has_a_row_but_the_one_that_the_body_shows(first, last, landings):
    found = hidden_landings(without(BODY, first, last))
    assert len(found) == landings
    np.testing.assert_allclose(found.t_post % 1.0, 0.5, atol=0.02)
    assert ((found.t_pre > first) & (found.t_post < last)).all()
    assert (found.gap_pre >= min(last, 10.0) - max(first, 0.0) - 0.02).all()


def test_feet_that_are_hidden_too_show_nothing():
    feet = np.where(((TIME > 2.1) & (TIME < 6.9))[:, None], np.nan, FEET)
    assert len(hidden_landings(without(BODY, 2.1, 6.9), feet)) == 0


def test_one_foot_in_the_air_is_no_flight():
    feet = FEET * [1.0, 0.0]
    assert len(hidden_landings(without(BODY, 2.1, 6.9), feet)) == 0
