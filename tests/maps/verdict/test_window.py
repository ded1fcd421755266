"""Which landings a study is judged by, and what small studies show."""

import os
from dataclasses import replace

import numpy as np
import pytest
from kinked_landings import in_section

from hopdata.maps.coordinates import kinks, monomials
from hopdata.maps.verdict import shrunk, window
from hopdata.maps.verdict.comparison import compared, squared_size
from hopdata.maps.verdict.effect import effect_size, landings_needed
from hopdata.maps.verdict.inputs import WINDOW
from hopdata.maps.verdict.model import left_by_window, nearest
from hopdata.maps.verdict.window import fit_of_best_window

N_STUDIES = 200 if "ALL" in os.environ else 120
ANGLES = 2.0 * np.pi * np.arange(3) / 3.0


def _study(seed, n, *, kink=0.0, cubic=0.02, noise=0.3):
    """Return n landings of a body with tilt and seven other inputs, on three feet."""
    rng = np.random.default_rng([7, seed])
    x = rng.standard_normal((n, 8))
    instants = x[:, :2] @ np.array([np.cos(ANGLES), np.sin(ANGLES)])
    cubes = monomials(x, (3,))
    y = x @ rng.standard_normal((8, 11))
    y += cubic * cubes @ rng.standard_normal((cubes.shape[1], 11))
    y += kink * kinks(instants)[:, -1:] * rng.standard_normal(11)
    return in_section(instants, y + noise * rng.standard_normal((n, 11)), x)


def _size(landings, seed, *, allowed=None):
    comparison = compared(landings)
    fit = fit_of_best_window(landings, comparison)
    root = squared_size(fit, landings, comparison)
    if allowed is not None:
        fit = replace(fit, allowed=allowed)
    generator = np.random.default_rng(seed)
    return effect_size(
        fit, root, generator=generator, confidence=0.95, power=0.8, flips=99
    )


def test_random_signs_hold_their_level_beside_shrunk_terms():
    """Of C1 studies the test that allows for nothing finds 5 %: no more and no less."""
    found = [_size(_study(k, 160), k, allowed=0.0).p_value for k in range(N_STUDIES)]
    # Limits of a binomial distribution: fewer or more are as rare as 0.2 %.
    fewest, most = {200: (2, 20), 120: (1, 14)}[N_STUDIES]
    assert fewest <= np.sum(np.array(found) <= 0.05) <= most
    # Three standard errors of the mean of even draws: 0.06 of 200.
    assert abs(np.mean(found) - 0.5) < 3.0 / np.sqrt(12 * N_STUDIES)


def test_small_studies_find_more_with_all_landings_and_shrunk_terms(monkeypatch):
    """Beside the nearest 85 % alone and without terms of third order."""

    def found():
        how = {"kink": 1.0, "cubic": 0.03, "noise": 0.6}
        sizes = [_size(_study(1000 + k, 200, **how), k) for k in range(16)]
        return sum(size.low > 0.0 for size in sizes)

    now = found()
    monkeypatch.setattr(window, "WIDER", ())
    monkeypatch.setattr(shrunk, "VARIANCES", (0.0,))
    assert now >= found() + 3


@pytest.mark.parametrize(("noise", "share"), [(2.0, 1.0), (0.02, WINDOW)])
def test_where_noise_is_large_all_landings_are_used(noise, share):
    landings = _study(1, 400, noise=noise)
    fit = fit_of_best_window(landings, compared(landings))
    assert len(fit.rows) == round(share * 400)


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_wider_window_remembers_what_the_nearest_landings_show(seed, monkeypatch):
    landings = _study(seed, 300, noise=1.0)
    wide = _size(landings, seed)
    monkeypatch.setattr(window, "WIDER", ())
    alone = _size(landings, seed)
    assert wide.allowed_nearest == alone.allowed != wide.allowed
    # Directions and signs are others: those of other errors.
    assert wide.detectable_nearest == pytest.approx(alone.detectable, rel=0.15)
    assert wide.detectable < wide.detectable_nearest
    own = (alone.detectable, alone.allowed)
    assert (alone.detectable_nearest, alone.allowed_nearest) == own


def test_a_larger_study_is_planned_by_the_nearest_landings():
    """It needs less than by the pilot's window and, in the median, no more than planned."""
    saved = []
    of_planned = []
    of_a_quarter = []
    for seed in range(1, 6):
        pilot = _size(_study(seed, 300, noise=1.0), 1)
        assert pilot.least_allowed == pilot.allowed_nearest < 0.12 < pilot.allowed
        needed = pilot.landings_needed(300, 0.2, 3)
        of_window = landings_needed(300, pilot.detectable, pilot.allowed, 0.2, 3)
        saved.append(of_window / needed)
        other = 10 * seed + 1
        of_planned.append(_size(_study(other, needed, noise=1.0), 2).detectable)
        few = _size(_study(other, needed // 4, noise=1.0), 2)
        of_a_quarter.append(few.detectable)
    assert min(saved) > 1.0
    assert np.median(saved) > 1.3
    assert np.median(of_planned) < 0.2 < min(of_a_quarter)


@pytest.mark.parametrize(
    ("n", "along", "few", "far"),
    [
        (300, 0.0, True, False),
        (4000, 0.0, False, False),
        (4000, 0.2, False, True),
        (300, 1.0, False, True),
    ],
)
def test_few_landings_are_told_from_contacts_far_apart(n, along, few, far):
    """A linear map was told to have its contacts far apart, for want of landings."""
    rng = np.random.default_rng(3)
    x = rng.standard_normal((n, 8))
    instants = x[:, :2] @ np.array([np.cos(ANGLES), np.sin(ANGLES)])
    y = x @ rng.standard_normal((8, 11))
    y += along * x[:, :1] ** 3 * rng.standard_normal(11)
    y += 1.0 * rng.standard_normal((n, 11))
    landings = in_section(instants, y, x)
    fit = fit_of_best_window(landings, compared(landings))
    assert fit.wants_landings(landings.bent) is few
    assert fit.leaves_more(landings.bent) is (few or far)


def test_more_is_left_where_contacts_lie_farther_apart():
    """The spread of normal tilts is 1.23 times that of their nearest 85 %."""
    instants = _study(2, 4000).expected
    more = left_by_window(instants, 1.0)
    assert more == pytest.approx(1.226**2.2, rel=0.02)
    assert left_by_window(instants, WINDOW) == 1.0


def test_the_nearest_landings_are_those_of_least_spread():
    instants = np.array([[0.0, 3.0], [0.0, 1.0], [0.0, 2.0], [4.0, 0.0]])
    assert nearest(instants, 0.5).tolist() == [1, 2]
    assert nearest(instants, 1.0).tolist() == [0, 1, 2, 3]
