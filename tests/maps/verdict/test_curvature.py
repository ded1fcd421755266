"""A map that is strongly curved over the landings is told so, and no other."""

from dataclasses import replace

import numpy as np
import pytest
from kinked_landings import in_section, landings, marker_states

from hopdata.maps.verdict import judge
from hopdata.maps.verdict.limits import curved
from hopdata.maps.verdict.model import fit_kinks
from hopdata.maps.verdict.smooth import Curvature

CODE = "maps.strongly_curved"
SPREADS = np.array([0.03, 0.03, 0.07, 0.07, 0.07, 0.3, 0.3, 0.2])
OUTCOMES = np.array([0.01, 0.01, 0.02, *([0.01] * 2), *([0.05] * 3), *([0.2] * 3)])


def with_sines(size, *, of_range=1.0, **options):
    """Return landings with sines of four combinations of the states among the outcomes."""
    data = landings(450, noise=0.1, **options)
    rng = np.random.default_rng(96)
    along = rng.standard_normal((8, 4))
    along /= np.linalg.norm(along, axis=0)
    directions = size * rng.standard_normal((4, 11)) * OUTCOMES
    sines = np.sin(1.5 * of_range * (data.x / SPREADS) @ along)
    y = data.y + sines @ directions
    before, after = marker_states(data.x, y, rng)
    return replace(data, before=before, after=after, y=y)


def noted(data):
    """Return the values of the note, None if there is none, and the verdict."""
    verdict = judge(data.before, data.after, data.instants, seed=3, flips=199)
    found = [note.values for note in verdict.notes if note.code == CODE]
    return (found or [None])[0], verdict


@pytest.mark.parametrize("other", [{}, {"strength": 0.3}, {"jump": 0.4}])
def test_a_strongly_curved_map_is_noted(other):
    values, verdict = noted(with_sines(2.0, **other))
    assert values is not None
    assert float(values["share"].split()[0]) > 10.0
    assert float(values["times"]) > 1.2
    (said,) = [note.reason for note in verdict.notes if note.code == CODE]
    assert f"{values['times']} times" in said


@pytest.mark.parametrize(
    "ordinary",
    [
        {},
        {"curvature": 1.0},
        {"strength": 0.3},
        {"strength": 2.0},
        {"jump": 0.4},
        {"cubic": 0.2},
        {"noise": 3.0},
        {"feet": 4},
        {"spent_within": 0.5, "strength": 2.0},
    ],
)
def test_an_ordinary_map_is_not(ordinary):
    assert noted(landings(**({"n": 450} | ordinary)))[0] is None


def test_a_smaller_range_of_states_bends_less():
    """As of a range of 0.3; what is left is below the limit."""
    assert noted(with_sines(2.0, of_range=0.3))[0] is None


@pytest.mark.parametrize("k", [0.2, -0.2])
def test_share_and_slopes_are_those_of_a_known_cube(k):
    """All outcomes are w + k (w^3 - 3 w) and noise; the slope at zero is 1 - 3 k."""
    rng = np.random.default_rng(4)
    state = rng.standard_normal((4000, 8))
    w = state[:, 3]
    cube = w + k * (w**3 - 3.0 * w)
    errors = 0.3 * rng.standard_normal((4000, 11))
    outcomes = (cube[:, None] + errors) * np.arange(1.0, 12.0)
    instants = 0.5 * state[:, :2] @ rng.standard_normal((2, 3))
    found = fit_kinks(in_section(instants, outcomes, state), 1.0).curvature()

    (_, mean_slope, _), (left,), *_ = np.polyfit(w, cube, 2, full=True)
    share = left / len(w) / (np.var(cube) + 0.3**2)
    assert found.share == pytest.approx(share, rel=0.05)
    by_mean_slope = abs((1.0 - 3.0 * k) / mean_slope)
    assert found.by_mean_slope == pytest.approx(by_mean_slope, rel=0.05)


@pytest.mark.parametrize("n", [150, 600])
@pytest.mark.parametrize("noise", [1.0, 10.0])
def test_noise_is_no_curvature(n, noise):
    """Of 150 landings of much noise, chance alone gives a share of up to 0.09."""
    rng = np.random.default_rng([5, n])
    state = rng.standard_normal((n, 8))
    outcomes = state @ rng.standard_normal((8, 11))
    outcomes += noise * rng.standard_normal(outcomes.shape)
    instants = state[:, :2] @ rng.standard_normal((2, 3))
    found = fit_kinks(in_section(instants, outcomes, state), 1.0).curvature()
    assert curved(found) == []
    assert found.by_mean_slope == pytest.approx(1.0, abs=0.05)


def test_steps_have_no_curvature_of_their_own():
    assert curved(None) == []


def test_a_share_beyond_limit_and_chance_is_noted():
    assert curved(Curvature(share=0.02, error=0.0, by_mean_slope=1.5)) == []
    assert len(curved(Curvature(share=0.03, error=0.0, by_mean_slope=1.5))) == 1
    assert curved(Curvature(share=0.03, error=0.011, by_mean_slope=1.5)) == []
