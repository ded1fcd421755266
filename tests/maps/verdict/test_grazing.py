"""Whether the post section is grazed, from the states at it."""

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.maps.verdict.grazing import bent_share, grazing


def states(fall_m_s, markers=3):
    """Return states of markers that fall alike; they also spin, which says nothing."""
    n = len(fall_m_s)
    y = np.random.default_rng(9).standard_normal((n, 6 * markers))
    velocity = y[:, 3 * markers :].reshape(n, markers, 3)
    velocity[:, :, 2] -= velocity[:, :, 2].mean(axis=1, keepdims=True)
    velocity[:, :, 2] -= np.asarray(fall_m_s)[:, None]
    return y


def falls(depth, n=500, seed=1):
    """Return speeds at a depth of a body that stands, on average, at depth 1."""
    energy = 1.0 + 0.1 * np.random.default_rng(seed).standard_normal(n)
    squared = energy - depth**2
    return np.sqrt(squared[squared > 0])


def test_a_section_that_is_crossed_fast_is_hardly_bent():
    found = grazing(states(falls(0.5)))
    assert found.usual_time_per_height == pytest.approx(1 / np.sqrt(0.75), rel=0.02)
    assert found.scatter == pytest.approx(0.1 / 0.75, rel=0.1)
    assert found.bent < 0.003
    assert found.rising == 0.0


def test_a_section_among_the_lowest_points_is_bent():
    bent = [grazing(states(falls(depth))).bent for depth in (0.5, 0.8, 0.9, 0.95)]
    assert bent == sorted(bent)
    assert bent[-1] > 0.1
    assert grazing(states(falls(0.95))).large_time_per_height > 4


def test_the_bend_is_that_of_a_cubic_beside_the_root():
    squared = np.linspace(0.5, 1.5, 2001)
    inner = squared[(squared >= 0.51) & (squared <= 1.49)]
    cubic = np.polynomial.Polynomial.fit(inner, np.sqrt(inner), 3)
    slope = 0.5 / np.sqrt(inner)
    missed = cubic.deriv()(inner) - slope
    expected = np.sqrt(np.mean(missed**2) / np.mean(slope**2))
    assert bent_share(squared) == pytest.approx(expected, rel=1e-6)
    assert bent_share(np.full(50, 0.7)) == 0.0


def test_units_do_not_matter_to_the_shares():
    y = states(falls(0.9))
    found, other = grazing(y), grazing(1000 * y)
    assert other.bent == pytest.approx(found.bent, rel=1e-9)
    assert other.scatter == pytest.approx(found.scatter, rel=1e-9)
    expected = found.usual_time_per_height / 1000
    assert other.usual_time_per_height == pytest.approx(expected, rel=1e-9)


def test_a_body_that_rises_is_told():
    fall = np.concatenate([falls(0.9, 300), np.full(30, -0.05)])
    found = grazing(states(fall))
    assert found.rising == pytest.approx(30 / len(fall))
    assert found.large_time_per_height == np.inf


def test_what_is_not_known_is_left_out_and_too_few_are_refused():
    y = states(falls(0.9, 100))
    with_gaps = np.concatenate([y, np.full((5, 18), np.nan)])
    assert grazing(with_gaps) == grazing(y)
    with pytest.raises(AnalysisError, match="at least 20 landings, found 19"):
        grazing(y[:19])
    with pytest.raises(AnalysisError, match="one row per landing"):
        grazing(y[:, :17])
