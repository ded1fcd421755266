"""Landings of two bodies in one table, and of one body however it is recorded."""

import numpy as np
import pytest

from hopdata.maps.truth.maps import marker_states
from hopdata.maps.verdict import judge
from hopdata.maps.verdict.pooled import of_more_bodies

MARKERS_M = np.array([[0.13, 0.03, -0.01], [-0.07, 0.11, 0.02], [-0.06, -0.14, -0.01]])
FALLING = np.array([0, 0, 0, 0, 0, 0, 0, -1.5, 0, 0, 0])
SPREADS = np.array([0.03, 0.03, 0.07, 0.07, 0.07, 0.3, 0.3, 0.2])


def seen(number, seed, *, moved_m=0.0, noise_m=0.00025):
    """Return marker states (n, 18) of a body, one of whose markers was moved."""
    rng = np.random.default_rng(seed)
    state = np.hstack(
        [np.zeros((number, 3)), SPREADS * rng.standard_normal((number, 8))]
    )
    markers = MARKERS_M + np.array([[moved_m, 0.0, 0.0], [0.0] * 3, [0.0] * 3])
    states = marker_states(state + FALLING, markers)
    states[:, :9] += noise_m * rng.standard_normal((number, 9))
    return states


def exchanged(states):
    """Return states with two markers exchanged in one landing of twenty."""
    some = np.arange(0, len(states), 20)
    states[some, :6] = states[some][:, [3, 4, 5, 0, 1, 2]]
    return states


def soft(states):
    """Return states in which one marker slides on the skin, by up to 4 cm."""
    states[:, 0] += 0.04 * np.random.default_rng(1).uniform(size=len(states))
    return states


@pytest.mark.parametrize("number", [150, 600])
@pytest.mark.parametrize(
    "recorded",
    [
        np.asarray,
        exchanged,
        soft,
        lambda states: states.round(3),
        lambda states: states.astype(np.float32),
    ],
    ids=["as it is", "exchanged", "soft", "in mm", "in four bytes"],
)
def test_one_body_is_not_taken_for_two(number, recorded):
    for seed in range(20):
        assert not of_more_bodies(recorded(seen(number, seed)))
        assert not of_more_bodies(recorded(seen(number, seed, noise_m=0.0)))


@pytest.mark.parametrize("moved_m", [0.005, 0.03])
@pytest.mark.parametrize("share", [0.2, 0.5])
def test_two_bodies_are_told_in_any_order_and_unit(moved_m, share):
    first = round(300 * share)
    for seed in range(5):
        both = np.vstack(
            [seen(first, seed), seen(300 - first, seed + 50, moved_m=moved_m)]
        )
        mixed = np.random.default_rng(seed).permutation(both)
        assert of_more_bodies(both)
        assert of_more_bodies(1000.0 * mixed)


def test_three_bodies_are_told():
    moved = (0.0, 0.01, 0.02)
    some = [seen(100, seed, moved_m=one) for seed, one in enumerate(moved)]
    assert of_more_bodies(np.vstack(some))


def study(*, moved_m):
    """Return landings of two bodies as `judge` takes them."""
    rng = np.random.default_rng(5)
    states = rng.standard_normal((400, 8))
    angle = 2 * np.pi * np.arange(3) / 3
    instants = 0.01 * states[:, :2] @ np.array([np.sin(angle), np.cos(angle)])
    smooth = rng.standard_normal((8, 11)) * np.repeat([0.01, 0.05, 0.2], [5, 3, 3])
    outcomes = states @ smooth
    outcomes += 0.1 * outcomes.std(axis=0) * rng.standard_normal(outcomes.shape)
    before = np.hstack([np.zeros((400, 3)), SPREADS * states]) + FALLING
    other = MARKERS_M + np.array([[moved_m, 0.0, 0.0], [0.0] * 3, [0.0] * 3])
    bodies = np.arange(400) % 2
    x = marker_states(before, MARKERS_M)
    x[bodies == 1] = marker_states(before, other)[bodies == 1]
    x += 0.00025 * rng.standard_normal(x.shape)
    return x, marker_states(outcomes, MARKERS_M), instants, bodies


@pytest.mark.parametrize(
    ("moved_m", "with_blocks", "told"),
    [(0.02, False, True), (0.02, True, False), (0.0, False, False)],
)
def test_a_verdict_says_so_only_without_blocks(moved_m, with_blocks, told):
    x, y, instants, bodies = study(moved_m=moved_m)
    blocks = bodies if with_blocks else None
    zero = np.zeros_like(instants)
    found = judge(x, y, instants, instants_se=zero, blocks=blocks, seed=1, flips=99)
    assert found.effect is not None
    codes = [note.code for note in found.notes]
    assert ("maps.more_bodies" in codes) == told
