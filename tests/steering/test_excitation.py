"""Excitations: each move occurs as often as requested, for any robot."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from steered_hops import LIMIT, WALKER

from hopdata.errors import ConfigError
from hopdata.steering.excitation import (
    ControlGrid,
    eulerian_circuit,
    eulerian_excitation,
    excitation,
    random_excitation,
)
from hopdata.steering.frame_changes import hopper_axes
from hopdata.steering.strides import TURN, Input, State, StrideAxes


def rng(seed=0):
    return np.random.default_rng(np.random.SeedSequence(seed))


GRIDS = st.builds(
    ControlGrid,
    n_angles=st.integers(1, 20),
    n_steps=st.integers(1, 5),
    repeats=st.integers(1, 4),
)


def moves(swings, grid):
    """Return swings as numbers of grid steps."""
    return np.rint(swings / grid.step_rad).astype(int)


def counts(grid, steps):
    """Return how often each move was made, by angle and step."""
    angles = np.concatenate([[0], np.cumsum(steps[:-1])]).astype(int) % grid.n_angles
    made = np.zeros((grid.n_angles, len(grid.steps)), dtype=int)
    np.add.at(made, (angles, steps + grid.n_steps), 1)
    return made


@settings(max_examples=40, deadline=None)
@given(grid=GRIDS, seed=st.integers(0, 2**32))
def test_an_eulerian_sequence_makes_every_move_as_often_as_wanted(grid, seed):
    found = moves(eulerian_excitation(grid, rng(seed)), grid)
    assert (counts(grid, found) == grid.repeats).all()
    assert len(found) == grid.n_angles * len(grid.steps) * grid.repeats
    assert found.sum() % grid.n_angles == 0


@settings(max_examples=20, deadline=None)
@given(grid=GRIDS, seed=st.integers(0, 2**32))
def test_each_lap_makes_every_move_once(grid, seed):
    found = moves(eulerian_excitation(grid, rng(seed)), grid)
    lap = found[: grid.n_angles * len(grid.steps)]
    assert (counts(grid, lap) == 1).all()


def test_all_eulerian_circuits_are_equally_likely():
    # Three angles, steps -1, 0, 1, from angle 0: the complete digraph with loops.
    grid = ControlGrid(n_angles=3, n_steps=1, repeats=1)
    n = 6000
    seen = {}
    for seed in range(n):
        lap = tuple(moves(eulerian_excitation(grid, rng(seed)), grid))
        seen[lap] = seen.get(lap, 0) + 1
    # The BEST theorem: 3 trees, 2!^3 circuits up to rotation, each from its 3 starts at
    # 0.
    assert len(seen) == 3 * 2**3 * 3
    expected = n / len(seen)
    chi_square = sum((count - expected) ** 2 / expected for count in seen.values())
    assert chi_square < 71 + 4 * np.sqrt(2 * 71)


def test_the_largest_swing_is_the_dissertation_s_and_all_end_where_they_began():
    swings = eulerian_excitation(ControlGrid(), rng(2))
    assert np.abs(swings).max() == pytest.approx(np.deg2rad(67.5))
    assert swings.sum() == pytest.approx(0.0, abs=1e-9)


def test_a_seed_gives_the_same_sequence_again():
    first, again, other = (
        eulerian_excitation(ControlGrid(), rng(s)) for s in (3, 3, 4)
    )
    np.testing.assert_array_equal(first, again)
    assert (other != first).any()


@pytest.mark.parametrize("name", ["n_angles", "n_steps", "repeats"])
@pytest.mark.parametrize("size", [0, 2.5, "16"])
def test_sizes_below_one_are_refused(name, size):
    with pytest.raises(
        ConfigError, match=rf"{name}: expected a whole .* found {size!r}"
    ):
        ControlGrid(**{name: size})


@pytest.mark.parametrize("draw", [eulerian_excitation, random_excitation])
def test_a_seed_does_for_its_generator(draw):
    np.testing.assert_array_equal(
        draw(ControlGrid(), 5), draw(ControlGrid(), np.random.default_rng(5))
    )


@settings(max_examples=20, deadline=None)
@given(grid=GRIDS, seed=st.integers(0, 2**32))
def test_a_random_sequence_ends_when_all_moves_are_made(grid, seed):
    found = moves(random_excitation(grid, rng(seed)), grid)
    assert (counts(grid, found) >= grid.repeats).all()
    assert (counts(grid, found[:-1]) < grid.repeats).sum() == 1


def test_the_random_sequence_as_printed_is_near_minimal():
    lengths = [len(random_excitation(ControlGrid(), rng(s))) for s in range(20)]
    assert min(lengths) >= 336
    assert np.median(lengths) < 1.25 * 336


def test_the_draw_prefers_angles_with_more_moves_left():
    # From angle 0 of three, with one repeat and n_steps 1, weights are 3 + 1 each. A
    # move back to angle 0 leaves one fewer there for the second draw: 2 + 1 against 3 +
    # 1.
    grid = ControlGrid(n_angles=3, n_steps=1, repeats=1)
    second = []
    for seed in range(2000):
        steps = moves(random_excitation(grid, rng(seed)), grid)
        if steps[0] == 1:
            second.append(steps[1])
    back = np.mean(np.array(second) == -1)  # from 1 to 0
    expected = 3 / (3 + 4 + 4)
    assert abs(back - expected) < 4 * np.sqrt(expected * (1 - expected) / len(second))


def test_a_seed_gives_the_same_random_sequence_again():
    first, again = (random_excitation(ControlGrid(), rng(3)) for _ in range(2))
    np.testing.assert_array_equal(first, again)


@settings(max_examples=30, deadline=None)
@given(grid=GRIDS, seed=st.integers(0, 2**32))
def test_moves_in_any_order_make_a_circuit(grid, seed):
    # Most orders lead back to the start before all moves are made.
    stream = rng(seed)
    exits = [stream.permutation(grid.steps).tolist() for _ in range(grid.n_angles)]
    assert (counts(grid, eulerian_circuit(exits)) == 1).all()


def test_the_walk_is_taken_back_where_it_ends_too_early():
    assert eulerian_circuit([[0, 1], [1, 0]]).tolist() == [0, 1, 0, 1]
    assert eulerian_circuit([[1, 0], [1, 0]]).tolist() == [1, 0, 1, 0]
    # Tried as they stand, 1 and -1 lead back to the start while others are left.
    back_early = [[1, -1], [-1, 0, 1], [0, -1, 1]]
    made = eulerian_circuit(back_early)
    assert np.bincount(made + 1).tolist() == [3, 2, 3]


def test_the_hopper_is_excited_the_same_by_its_axes_alone():
    grid = ControlGrid()
    swings = excitation(hopper_axes(LIMIT), 336, rng(3))
    np.testing.assert_allclose(swings[:, 0], eulerian_excitation(grid, rng(3)))
    cut_short = excitation(hopper_axes(LIMIT), 100, rng(3))
    np.testing.assert_array_equal(cut_short, swings[:100])


@pytest.mark.parametrize("limits", [(-1.2, 0.3), (0.0, 0.8), (0.4, 1.0), (-0.5, 0.5)])
def test_moves_of_an_angle_are_within_the_limits_and_cover_the_grid(limits):
    lower, upper = limits
    axes = StrideAxes(
        periodic=(State(name="phase", moved_by="step"),),
        inputs=(Input(name="step", lower=lower, upper=upper),),
    )
    n_angles = int(np.ceil(3 * TURN / max(-lower, upper) - 1e-9))
    step = TURN / n_angles
    n_moves = int(np.floor(upper / step + 1e-9) - np.ceil(lower / step - 1e-9)) + 1
    made = excitation(axes, n_angles * n_moves, rng())[:, 0]
    assert lower - 1e-9 <= made.min() < made.max() <= upper + 1e-9
    number = np.rint(made / step).astype(int)
    np.testing.assert_allclose(number * step, made, atol=1e-12)
    angle = np.append(0, np.cumsum(number)[:-1]) % n_angles
    assert len(set(zip(angle.tolist(), number.tolist(), strict=True))) == len(made)


def test_other_inputs_fill_their_limits():
    inputs = excitation(WALKER, 60, rng(1))
    assert inputs.shape == (60, 2)
    push = inputs[:, 1]
    # A Latin hypercube has one value in each sixtieth of the range, in random order.
    assert np.array_equal(np.sort(np.floor(60 * push / 20).astype(int)), np.arange(60))
    assert abs(np.corrcoef(push[1:], push[:-1])[0, 1]) < 0.3
    np.testing.assert_array_equal(inputs, excitation(WALKER, 60, rng(1)))
    assert not np.array_equal(inputs, excitation(WALKER, 60, rng(2)))


def test_an_angle_that_hardly_moves_is_no_grid():
    narrow = StrideAxes(
        periodic=(State(name="phase", moved_by="step"),),
        inputs=(Input(name="step", lower=-0.01, upper=0.02),),
    )
    made = excitation(narrow, 40, rng())[:, 0]
    assert len(np.unique(made)) == 40
    assert -0.01 <= made.min() < made.max() <= 0.02


def test_no_strides_are_an_error():
    with pytest.raises(ConfigError, match="at least 1"):
        excitation(WALKER, 0, rng())
