import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hopdata.errors import ConfigError
from hopdata.steering.excitation import ControlGrid, eulerian_excitation, random_excitation

GRIDS = st.builds(
    ControlGrid,
    n_angles=st.integers(1, 20),
    n_steps=st.integers(1, 5),
    repeats=st.integers(1, 4),
)


def generator(seed):
    return np.random.default_rng(np.random.SeedSequence(seed))


def test_the_printed_grid_wants_336_hops():
    assert ControlGrid().n_moves == 336


@settings(max_examples=40, deadline=None)
@given(grid=GRIDS, start=st.integers(0, 30), seed=st.integers(0, 2**32))
def test_an_eulerian_sequence_makes_every_move_as_often_as_wanted(grid, start, seed):
    found = eulerian_excitation(grid, generator(seed), start=start)
    assert (found.counts == grid.repeats).all()
    assert len(found.steps) == grid.n_moves
    assert found.coverage == 1.0
    assert found.indices[0] == found.indices[-1] == start % grid.n_angles


@settings(max_examples=20, deadline=None)
@given(grid=GRIDS, seed=st.integers(0, 2**32))
def test_each_lap_makes_every_move_once(grid, seed):
    found = eulerian_excitation(grid, generator(seed))
    assert (found.first(grid.n_moves // grid.repeats).counts == 1).all()


@settings(max_examples=20, deadline=None)
@given(grid=GRIDS, start=st.integers(0, 30), seed=st.integers(0, 2**32))
def test_a_random_sequence_ends_when_all_moves_are_made(grid, start, seed):
    found = random_excitation(grid, generator(seed), start=start)
    assert (found.counts >= grid.repeats).all()
    assert (found.first(len(found.steps) - 1).counts < grid.repeats).sum() == 1


def test_the_random_sequence_as_printed_is_near_minimal():
    lengths = [len(random_excitation(ControlGrid(), generator(s)).steps) for s in range(20)]
    assert min(lengths) >= 336
    assert np.median(lengths) < 1.25 * 336


def test_the_draw_prefers_angles_with_more_moves_left():
    # From angle 0 of three, with one repeat and n_steps 1, weights are 3 + 1 each; a move that
    # leads back to angle 0 finds one fewer there on the second draw: 2 + 1 against 3 + 1.
    grid = ControlGrid(n_angles=3, n_steps=1, repeats=1)
    second = []
    for seed in range(4000):
        steps = random_excitation(grid, generator(seed), limit=2).steps
        if steps[0] == 1:
            second.append(steps[1])
    back = np.mean(np.array(second) == -1)  # from 1 to 0
    expected = 3 / (3 + 4 + 4)
    assert abs(back - expected) < 4 * np.sqrt(expected * (1 - expected) / len(second))


def test_a_limit_cuts_the_sequence_and_the_coverage_says_so():
    found = random_excitation(ControlGrid(), generator(1), limit=100)
    assert len(found.steps) == 100
    assert found.coverage == pytest.approx(np.minimum(found.counts, 3).sum() / 336)
    assert 0.2 < found.coverage <= 100 / 336


def test_all_eulerian_circuits_are_equally_likely():
    # Three angles, steps -1, 0, 1, from angle 0: the complete digraph with loops.
    grid = ControlGrid(n_angles=3, n_steps=1, repeats=1)
    n = 6000
    seen = {}
    for seed in range(n):
        lap = tuple(eulerian_excitation(grid, generator(seed)).steps)
        seen[lap] = seen.get(lap, 0) + 1
    # The BEST theorem: 3 trees, 2!^3 circuits up to rotation, each from its 3 starts at 0.
    assert len(seen) == 3 * 2**3 * 3
    expected = n / len(seen)
    chi_square = sum((count - expected) ** 2 / expected for count in seen.values())
    assert chi_square < 71 + 4 * np.sqrt(2 * 71)


def test_angles_follow_the_swings_past_the_back():
    found = eulerian_excitation(ControlGrid(), generator(2), start=5)
    angles = found.angles(first_rad=np.pi)
    np.testing.assert_allclose(np.diff(angles), found.swings)
    assert np.abs(found.swings).max() == pytest.approx(np.deg2rad(67.5))
    on_grid = np.pi + found.indices * found.grid.step_rad
    np.testing.assert_allclose(np.exp(1j * angles), np.exp(1j * on_grid), atol=1e-9)


def test_a_seed_gives_the_same_sequence_again():
    for draw in (eulerian_excitation, random_excitation):
        first, again, other = (draw(ControlGrid(), generator(s)).steps for s in (3, 3, 4))
        np.testing.assert_array_equal(first, again)
        assert len(other) != len(first) or (other != first).any()


@pytest.mark.parametrize("name", ["n_angles", "n_steps", "repeats"])
def test_sizes_below_one_are_refused(name):
    with pytest.raises(ConfigError, match=f"{name}: expected at least 1, found 0"):
        ControlGrid(**{name: 0})
