"""Excitations: what is commanded in a trial from which a model is learned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import require
from hopdata.steering.strides import TURN, Input, StrideAxes


@dataclass(frozen=True, kw_only=True)
class ControlGrid:
    """The controls to excite; the defaults are the dissertation's, 336 hops.

    Parameters
    ----------
    n_angles : int
        Number of equally spaced boom angles (N_p in print).
    n_steps : int
        Largest number of grid steps that the boom moves in one hop, either way (N_v in
        print).
    repeats : int
        How often each move is to be made (N_c in print).

    Raises
    ------
    ConfigError
        If one of them is not a whole number of at least 1.
    """

    n_angles: int = 16
    n_steps: int = 3
    repeats: int = 3

    def __post_init__(self) -> None:
        for name, size in vars(self).items():
            is_sound = isinstance(size, int | np.integer) and bool(size >= 1)
            require(is_sound, name, "a whole number of at least 1", f"{size!r}")

    @property
    def step_rad(self) -> float:
        """Angle between neighbours on the grid."""
        return TURN / self.n_angles

    @property
    def steps(self) -> IntArray:
        """Moves from every angle, (2 n_steps + 1,), in grid steps.

        Positive ones are counter-clockwise.
        """
        return np.arange(-self.n_steps, self.n_steps + 1)


def eulerian_excitation(
    grid: ControlGrid, rng: np.random.Generator | int
) -> FloatArray:
    """Draw a sequence that makes every move exactly `repeats` times.

    It ends where it began. It consists of laps that make every move once, so the first
    lap already covers the grid. Each lap is drawn uniformly from all Eulerian circuits.

    Returns
    -------
    (n,) array
        Swing in the flight after each stance except the last, rad.
    """
    rng = np.random.default_rng(rng)
    laps = [_random_lap(grid.n_angles, grid.steps, rng) for _ in range(grid.repeats)]
    return np.asarray(grid.step_rad * np.concatenate(laps))


def _random_lap(n_angles: int, steps: IntArray, rng: np.random.Generator) -> IntArray:
    """Return an Eulerian circuit that makes every move once, as grid steps.

    It is uniformly random if the last moves from the angles are a uniform random tree
    towards the first angle and the others are in random order (the BEST theorem of van
    Aardenne-Ehrenfest and de Bruijn).
    """
    last = _random_tree(n_angles, steps, rng)
    exits = [rng.permutation(steps).tolist() for _ in range(n_angles)]
    for k in range(1, n_angles):
        exits[k].remove(last[k])
        exits[k].append(int(last[k]))
    return eulerian_circuit(exits)


def eulerian_circuit(exits: Sequence[Sequence[int]]) -> IntArray:
    """Return a circuit from angle 0 that makes every move once (Hierholzer 1873).

    Parameters
    ----------
    exits : sequence of sequences of int
        Moves from each angle of a ring, in grid steps, in the order in which they are
        tried. As many moves must lead to each angle as from it, and each must be in
        reach.

    Returns
    -------
    (n,) array of int
        The moves in order.
    """
    left = [list(moves)[::-1] for moves in exits]
    circuit: list[int] = []
    # Where the walk is, and the moves that led there. Where it cannot go on, it is
    # taken back to the last angle with moves left, and what it took back comes later.
    walk = [(0, 0)]
    while walk:
        angle = walk[-1][0]
        if left[angle]:
            move = left[angle].pop()
            walk.append(((angle + move) % len(left), move))
        else:
            circuit.append(walk.pop()[1])
    # The last is the start, to which no move led.
    return np.array(circuit[-2::-1], dtype=int)


def _random_tree(n_angles: int, steps: IntArray, rng: np.random.Generator) -> IntArray:
    """Draw a uniform random spanning tree (Wilson 1996).

    It is a step from each angle towards the first, (n_angles,), drawn by loop-erased
    random walks, of which the last exit from each angle remains.
    """
    step = np.zeros(n_angles, dtype=int)
    in_tree = np.zeros(n_angles, dtype=bool)
    in_tree[0] = True
    for k in range(n_angles):
        here = k
        while not in_tree[here]:
            step[here] = rng.choice(steps)
            here = (here + step[here]) % n_angles
        here = k
        while not in_tree[here]:
            in_tree[here] = True
            here = (here + step[here]) % n_angles
    return step


def random_excitation(grid: ControlGrid, rng: np.random.Generator | int) -> FloatArray:
    """Draw moves at random until all have been made (Algorithm 1).

    The next angle is drawn with the weight ``1 / n_steps + its number of moves still to
    make``, from those to which a move is still to be made, or from all in reach if
    there are none. This corrects what the printed algorithm omits or mistakes: the size
    of its matrix, the draw itself, the copy of the matrix, and the last angle, without
    which the last move would not be commanded.

    Returns
    -------
    (n,) array
        Swing in the flight after each stance except the last, rad.
    """
    rng = np.random.default_rng(rng)
    wanted = np.full((grid.n_angles, len(grid.steps)), grid.repeats)
    made: list[int] = []
    k = 0
    while wanted.any():
        choices = np.flatnonzero(wanted[k])
        if not len(choices):
            choices = np.arange(len(grid.steps))
        reached = (k + grid.steps[choices]) % grid.n_angles
        weights = wanted[reached].sum(axis=1) + 1 / grid.n_steps
        move = rng.choice(choices, p=weights / weights.sum())
        wanted[k, move] = max(wanted[k, move] - 1, 0)
        made.append(int(grid.steps[move]))
        k = (k + made[-1]) % grid.n_angles
    return grid.step_rad * np.array(made)


# Any robot.

#: Steps of a grid of angles between no input and its farther limit.
#: Unit: 1. Origin: table: the dissertation's grid, with 16 angles for its hopper.
STEPS_TO_LIMIT = 3
#: Most angles of a grid.
#: Unit: 1. Origin: chosen: a lap of the grid has seven times as many strides.
MOST_ANGLES = 48


def excitation(
    axes: StrideAxes, strides: int, rng: np.random.Generator | int
) -> FloatArray:
    """Draw inputs that excite a robot of which only its axes are known.

    An input that moves an angle makes every move between the angles of a grid, in laps:
    see `eulerian_excitation`. The others are a Latin hypercube within their limits, in
    random order.

    Parameters
    ----------
    axes : StrideAxes
    strides : int
        Number of strides, n. A lap of a grid of angles that is cut short leaves some
        moves out.
    rng : Generator or int

    Returns
    -------
    (n, U) array
        Inputs of each stride.

    Raises
    ------
    ConfigError
        If there is no stride.
    """
    require(strides >= 1, "strides", "at least 1", strides)
    rng = np.random.default_rng(rng)
    moving = {state.moved_by for state in axes.periodic}
    columns: dict[str, FloatArray] = {}
    for one in axes.inputs:
        moves = _moves(one) if one.name in moving else None
        if moves is not None:
            columns[one.name] = _laps(*moves, strides, rng)
    others = [one for one in axes.inputs if one.name not in columns]
    if others:
        # Each of n equal parts of the limits holds one of n values.
        parts = np.tile(np.arange(strides), (len(others), 1))
        shares = (rng.permuted(parts, axis=1) + rng.random(parts.shape)) / strides
        for one, share in zip(others, shares, strict=True):
            columns[one.name] = one.lower + (one.upper - one.lower) * share
    return np.column_stack([columns[one.name] for one in axes.inputs])


def _moves(command: Input) -> tuple[int, IntArray] | None:
    """Return the number of angles of a grid and the moves within limits, in steps.

    Nothing is returned if the limits are too narrow, or the moves do not lead to all
    angles.
    """
    farthest = max(abs(command.lower), abs(command.upper))
    # Limits are rounded, which must not cost a step.
    n_angles = int(np.ceil(STEPS_TO_LIMIT * TURN / farthest - 1e-9))
    n_angles = max(n_angles, 2 * STEPS_TO_LIMIT + 1)
    if n_angles > MOST_ANGLES:
        return None
    step = TURN / n_angles
    first = int(np.ceil(command.lower / step - 1e-9))
    last = int(np.floor(command.upper / step + 1e-9))
    moves = np.arange(first, last + 1)
    if np.gcd.reduce(moves, initial=n_angles) > 1:
        return None
    return n_angles, moves


def _laps(
    n_angles: int, moves: IntArray, strides: int, rng: np.random.Generator
) -> FloatArray:
    """Return laps of a grid of angles up to a number of strides, rad."""
    n_laps = int(np.ceil(strides / (n_angles * len(moves))))
    laps = [_random_lap(n_angles, moves, rng) for _ in range(n_laps)]
    return np.asarray(TURN / n_angles * np.concatenate(laps)[:strides])
