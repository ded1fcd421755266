import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hopdata.errors import ConfigError
from hopdata.steering.trial import ControlGrid, eulerian_excitation

GRIDS = st.builds(
    ControlGrid,
    n_angles=st.integers(1, 20),
    n_steps=st.integers(1, 5),
    repeats=st.integers(1, 4),
)


def generator(seed):
    return np.random.default_rng(np.random.SeedSequence(seed))


def counts(grid, start, steps):
    """How often each move was made, by angle and step."""
    angles = (start + np.concatenate([[0], np.cumsum(steps[:-1])])).astype(int) % grid.n_angles
    made = np.zeros((grid.n_angles, len(grid.steps)), dtype=int)
    np.add.at(made, (angles, steps + grid.n_steps), 1)
    return made


@settings(max_examples=40, deadline=None)
@given(grid=GRIDS, start=st.integers(0, 30), seed=st.integers(0, 2**32))
def test_an_eulerian_sequence_makes_every_move_as_often_as_wanted(grid, start, seed):
    found = eulerian_excitation(grid, generator(seed), start=start)
    assert (counts(grid, found.start, found.steps) == grid.repeats).all()
    assert len(found.steps) == grid.n_angles * len(grid.steps) * grid.repeats
    assert found.start == start % grid.n_angles
    assert found.steps.sum() % grid.n_angles == 0


@settings(max_examples=20, deadline=None)
@given(grid=GRIDS, seed=st.integers(0, 2**32))
def test_each_lap_makes_every_move_once(grid, seed):
    found = eulerian_excitation(grid, generator(seed))
    lap = found.steps[: grid.n_angles * len(grid.steps)]
    assert (counts(grid, found.start, lap) == 1).all()


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


def test_the_largest_swing_is_the_dissertation_s_and_all_end_where_they_began():
    swings = eulerian_excitation(ControlGrid(), generator(2), start=5).swings
    assert np.abs(swings).max() == pytest.approx(np.deg2rad(67.5))
    assert swings.sum() == pytest.approx(0.0, abs=1e-9)


def test_a_seed_gives_the_same_sequence_again():
    first, again, other = (
        eulerian_excitation(ControlGrid(), generator(s)).steps for s in (3, 3, 4)
    )
    np.testing.assert_array_equal(first, again)
    assert (other != first).any()


@pytest.mark.parametrize("name", ["n_angles", "n_steps", "repeats"])
def test_sizes_below_one_are_refused(name):
    with pytest.raises(ConfigError, match=f"{name}: expected at least 1, found 0"):
        ControlGrid(**{name: 0})
