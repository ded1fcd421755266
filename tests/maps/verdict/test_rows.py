"""Which landings are gross errors, and that sound studies lose next to none."""

from dataclasses import replace

import numpy as np
import pytest
from kinked_landings import landings, seen_at_section

from hopdata.maps.verdict import judge
from hopdata.maps.verdict.rows import (
    CONTACTS,
    EXPECTED_BEYOND,
    _far_states,
    gross,
    markers_apart,
    misses,
    too_far,
)

N = 450
WRONG = np.arange(7, N, 35)  # 3 %


def verdict(data):
    return judge(data.before, data.after, data.instants, seed=3, flips=199)


def swapped(states, rows):
    """Return states (n, 18) in which the first two of three markers are swapped."""
    parts = states.reshape(len(states), 2, 3, 3).copy()
    parts[rows] = parts[rows][:, :, [1, 0, 2]]
    return parts.reshape(states.shape)


def slipped(states, rows, seed=1):
    """Return states whose body is off by as much as outcomes vary."""
    rng = np.random.default_rng(seed)
    parts = states.reshape(len(states), 2, 3, 3).copy()
    sds = parts.mean(axis=2).std(axis=0)
    parts[rows] += (rng.standard_normal((len(rows), 2, 3)) * sds)[:, :, None]
    return parts.reshape(states.shape)


def spoiled(data, how):
    if how == "swapped before":
        return replace(data, before=swapped(data.before, WRONG))
    if how == "swapped after":
        return replace(data, after=swapped(data.after, WRONG))
    if how == "slipped":
        return replace(data, after=slipped(data.after, WRONG))
    instants = data.instants.copy()
    rng = np.random.default_rng(2)
    instants[WRONG, 1] += rng.uniform(0.04, 0.1, len(WRONG))
    return replace(data, instants=instants)


REASONS = {
    "swapped before": "markers_apart",
    "swapped after": "markers_apart",
    "slipped": "outcome_far_off",
    "second bounce": "contacts_far_off",
}


@pytest.mark.parametrize("how", REASONS)
def test_mistakes_decide_nothing(how):
    for strength, conclusion in ((0.0, "no difference"), (0.3, "different")):
        data = landings(N, strength=strength)
        clean = verdict(data)
        answer = verdict(spoiled(data, how))
        assert answer.gross_errors == {REASONS[how]: (WRONG + 1).tolist()}
        assert answer.conclusion == clean.conclusion == conclusion
        ratio = answer.effect.upper_bound / clean.effect.upper_bound
        assert 1 / 1.3 < ratio < 1.3


@pytest.mark.parametrize("share", [0.25, 0.4, 0.6])
def test_another_kind_of_landings_is_no_mistake(share):
    """Most landings are drops from one height, and the rest are rebounds."""
    rng = np.random.default_rng(4)
    states = rng.standard_normal((N, 8))
    rebounds = rng.random(N) < share
    states[~rebounds, 3] *= 0.01
    assert not _far_states(states).any()


@pytest.mark.parametrize("n_wrong", [1, 13, 60])
def test_states_far_from_all_others_are_mistakes(n_wrong):
    states = np.random.default_rng(4).standard_normal((N, 8))
    states[:n_wrong, 3] += 40.0
    assert np.flatnonzero(_far_states(states)).tolist() == list(range(n_wrong))


@pytest.mark.parametrize("strength", [0.0, 0.3])
@pytest.mark.parametrize("jump", [0.0, 0.4])
@pytest.mark.parametrize("seed", range(3))
def test_sound_studies_lose_next_to_nothing(strength, jump, seed):
    data = landings(N, strength=strength, jump=jump, seed=seed)
    lost = sum(map(len, verdict(data).gross_errors.values()))
    assert lost <= 0.01 * N


def test_a_rare_order_with_another_outcome_is_no_mistake():
    """Of two feet, one comes first in a tenth of the landings, and the outcome jumps."""
    data = landings(N, feet=2, jump=1.0)
    apart = data.instants[:, 0] - data.instants[:, 1]
    rare = np.flatnonzero(apart > 0)[:25]
    kept = np.sort(np.concatenate([np.flatnonzero(apart < 0), rare]))
    few = replace(
        data,
        before=data.before[kept],
        after=data.after[kept],
        instants=data.instants[kept],
    )
    answer = verdict(few)
    assert not answer.gross_errors
    assert answer.conclusion == "different"


@pytest.mark.parametrize("freedom", [3, 5, np.inf])
def test_heavy_tails_lose_less_than_a_hundredth(freedom):
    rng = np.random.default_rng(5)
    design = np.column_stack([np.ones(600), rng.standard_normal((600, 40))])
    shares = []
    for _ in range(20):
        errors = rng.standard_normal((600, 11))
        if np.isfinite(freedom):
            errors *= np.sqrt(freedom / rng.chisquare(freedom, (600, 1)))
        missed = misses(design, design[:, 1:12] + errors)
        shares.append(np.mean(missed > too_far(missed)))
    assert np.mean(shares) < 0.007
    if freedom == np.inf:
        assert np.sum(shares) * 600 <= EXPECTED_BEYOND


def test_a_fit_is_not_moved_by_a_tenth_of_wrong_outcomes():
    rng = np.random.default_rng(6)
    design = np.column_stack([np.ones(400), rng.standard_normal((400, 30))])
    outcomes = design[:, 1:12] + 0.1 * rng.standard_normal((400, 11))
    wrong = rng.choice(400, 40, replace=False)
    outcomes[wrong] += 3.0 * rng.standard_normal((40, 11))
    missed = misses(design, outcomes)
    found = np.flatnonzero(missed > too_far(missed))
    assert set(found) == set(wrong)


def test_distances_do_not_depend_on_the_units_of_outcomes():
    rng = np.random.default_rng(7)
    design = np.column_stack([np.ones(200), rng.standard_normal((200, 10))])
    outcomes = rng.standard_normal((200, 5))
    mixed = 1e3 * outcomes @ rng.standard_normal((5, 5))
    ratio = misses(design, mixed) / misses(design, outcomes)
    assert ratio == pytest.approx(np.full(200, ratio[0]), rel=1e-6)


def test_markers_that_move_as_one_body_are_not_apart():
    data = landings(N)
    assert not markers_apart(data.before).any()
    frozen = data.before.copy()
    frozen[20, 9:12] = 0.0  # the velocity of one marker
    assert np.flatnonzero(markers_apart(frozen)).tolist() == [20]
    assert np.flatnonzero(markers_apart(swapped(data.before, [3]))).tolist() == [3]


@pytest.mark.parametrize("part", ["positions", "velocities"])
def test_rounding_sets_no_markers_apart(part):
    """One row of a body that is rigid to the last digit is rounded more coarsely."""
    states = landings(N).before
    columns = slice(0, 9) if part == "positions" else slice(9, 12)
    rounded = states.copy()
    rounded[20, columns] *= 1.0 + 1e-12
    assert not markers_apart(rounded).any()
    larger = states.copy()
    larger[20, columns] *= 1.0 + 1e-6
    assert np.flatnonzero(markers_apart(larger)).tolist() == [20]


def test_without_any_spread_nothing_is_too_far():
    assert too_far(np.zeros(10)) == np.inf


def test_instants_that_are_foretold_exactly_are_no_mistakes():
    """What is missed of them is rounding, which has tails of its own."""
    data = landings(n=400)
    exact = replace(data, instants=data.x[:, :3] @ np.diag([0.1, 0.2, 0.15]))
    found = gross(seen_at_section(exact))
    assert not found[CONTACTS].any()
