"""A difference that fades towards the simultaneous contact is told from a kink."""

import numpy as np
import pytest
from tests.maps.verdict.kinked_landings import SPREAD_S, landings

from hopdata.maps.coordinates import kinks
from hopdata.maps.verdict.growth import allowed_slopes, corners, growth
from hopdata.maps.verdict.judge import judge


def last(t):
    return t.max(axis=1) - t.mean(axis=1)


def square(t):
    return 0.3 * np.ptp(t, axis=1) ** 2


def noted(shape):
    """Return conclusion and notes of landings whose outcome has a shape of the instants."""
    data = landings(450, curvature=0.0)
    t = data.instants - data.instants.mean(axis=1, keepdims=True)
    spread = np.sqrt(np.mean(t**2))
    change = SPREAD_S * shape(t / spread)
    after = data.after.copy()
    # All markers move, and move faster, along x.
    after[:, 0:9:3] += change[:, None]
    after[:, 9::3] += 20.0 * change[:, None]
    errors = np.full_like(data.instants, 0.0004)
    verdict = judge(
        data.before, after, data.instants, instants_se=errors, seed=1, flips=199
    )
    notes = {note.code: note.values for note in verdict.notes}
    return verdict, notes


def test_a_difference_that_fades_is_different_and_noted():
    verdict, notes = noted(square)
    assert verdict.conclusion == "different"
    assert "Reservation: it seems to fade" in verdict.sentence
    assert float(notes["maps.grows"]["slope"]) == pytest.approx(1.0, abs=0.25)
    (said,) = [one for one in verdict.notes if one.code == "maps.grows"]
    # The slope is that of one family of shapes: it is not told as a number in words.
    assert not any(letter.isdigit() for letter in said.reason)


def test_a_kink_is_not_noted():
    verdict, notes = noted(last)
    assert verdict.conclusion == "different"
    assert "Reservation" not in verdict.sentence
    assert not {"maps.grows", "maps.may_grow"} & {*notes}


def test_two_feet_have_nothing_that_grows():
    """The square of the time between two contacts is smooth."""
    assert growth(None, np.zeros((5, 2)), np.zeros((2, 2))) is None


@pytest.mark.parametrize("feet", [3, 4])
def test_kinks_are_corners_and_a_linear_part(feet):
    instants = np.random.default_rng(feet).standard_normal((200, feet))
    for columns, is_enough in ((corners(instants), True), (instants[:, :0], False)):
        shapes = np.column_stack([columns, instants])
        found = np.linalg.lstsq(shapes, kinks(instants), rcond=None)[0]
        left = np.abs(kinks(instants) - shapes @ found).max()
        assert (left < 1e-12) == is_enough


def test_slopes_within_a_likelihood_are_allowed():
    slopes = np.array([-0.5, 0.0, 0.5, 1.0])
    found = allowed_slopes(slopes, np.array([90.0, 10.0, 20.0, 90.0]))
    assert found.slope == 0.0
    assert found.low == pytest.approx(-0.5 * 3.84 / 80.0, abs=0.05)
    assert found.high == pytest.approx(0.5 * 3.84 / 10.0, abs=0.05)
