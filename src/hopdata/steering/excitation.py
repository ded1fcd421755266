"""Sequences of boom angles that excite every control on a grid (dissertation, Algorithm 1).

The boom angle takes `n_angles` equally spaced values, and in each flight it moves by up to
`n_steps` of them either way. Every one of these moves is wanted `repeats` times. The moves are the
edges of a directed graph in which as many edges enter each angle as leave it, so it has an Eulerian
circuit: a sequence without a superfluous hop.
"""

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import require


@dataclass(frozen=True, kw_only=True)
class ControlGrid:
    """The controls to excite; the defaults are the dissertation's, 336 hops.

    Parameters
    ----------
    n_angles : int
        Number of equally spaced boom angles (printed N_p).
    n_steps : int
        Largest number of grid steps that the boom moves in one hop, either way (printed N_v).
    repeats : int
        How often each move is wanted (printed N_c).

    Raises
    ------
    ConfigError
        If one of them is below 1.
    """

    n_angles: int = 16
    n_steps: int = 3
    repeats: int = 3

    def __post_init__(self) -> None:
        for name in ("n_angles", "n_steps", "repeats"):
            require(getattr(self, name) >= 1, name, "at least 1", getattr(self, name))

    @property
    def step_rad(self) -> float:
        """Angle between neighbours on the grid."""
        return 2 * np.pi / self.n_angles

    @property
    def steps(self) -> IntArray:
        """Moves from every angle, (2 n_steps + 1,), in grid steps; positive counter-clockwise."""
        return np.arange(-self.n_steps, self.n_steps + 1)


@dataclass(frozen=True)
class Excitation:
    """A sequence of n moves on a grid, between n + 1 angles.

    Parameters
    ----------
    grid : ControlGrid
    start : int
        Index of the first boom angle.
    steps : (n,) array of int
        Move in the flight after each stance, in grid steps.
    """

    grid: ControlGrid
    start: int
    steps: IntArray

    @property
    def swings(self) -> FloatArray:
        """Swing in the flight after each stance but the last, (n,), rad."""
        return np.asarray(self.steps * self.grid.step_rad, dtype=float)


def eulerian_excitation(
    grid: ControlGrid, rng: np.random.Generator, *, start: int = 0
) -> Excitation:
    """Draw a sequence that makes every move exactly as often as wanted, and ends where it began.

    It goes in laps, each of which makes every move once, so that the first lap covers the grid
    already. Each is drawn with equal probability from all Eulerian circuits: a uniform random tree
    of last moves to the start (Wilson 1996), the other moves in random order (the BEST theorem of
    van Aardenne-Ehrenfest and de Bruijn).

    Parameters
    ----------
    grid : ControlGrid
    rng : numpy Generator
    start : int
        Index of the first boom angle.
    """
    root = start % grid.n_angles
    laps = [_random_lap(grid, rng, root) for _ in range(grid.repeats)]
    return Excitation(grid, root, np.concatenate(laps))


def _random_lap(grid: ControlGrid, rng: np.random.Generator, root: int) -> IntArray:
    """Return an Eulerian circuit that makes every move once, as steps."""
    last = _random_tree(grid, rng, root)
    orders = [rng.permutation(grid.steps).tolist() for _ in range(grid.n_angles)]
    for k in range(grid.n_angles):
        if k != root:
            orders[k].remove(last[k])
            orders[k].append(int(last[k]))
    lap, k = [], root
    while orders[k]:
        lap.append(orders[k].pop(0))
        k = (k + lap[-1]) % grid.n_angles
    return np.array(lap, dtype=int)


def _random_tree(grid: ControlGrid, rng: np.random.Generator, root: int) -> IntArray:
    """Step from each angle towards the root along a uniform random spanning tree, (n_angles,).

    By loop-erased random walks: a walk's last exit from each angle is what remains of it.
    """
    step = np.zeros(grid.n_angles, dtype=int)
    in_tree = np.zeros(grid.n_angles, dtype=bool)
    in_tree[root] = True
    for k in range(grid.n_angles):
        here = k
        while not in_tree[here]:
            step[here] = rng.choice(grid.steps)
            here = (here + step[here]) % grid.n_angles
        here = k
        while not in_tree[here]:
            in_tree[here] = True
            here = (here + step[here]) % grid.n_angles
    return step


# Streams of chance under the seed of an excitation: first number of the key.

START = 0  # then the experiment's place and the number of the start
FLOOR, EXCITATION, TRIAL, TRAINING = 1, 10, 11, 12


def child(seed: np.random.SeedSequence, *key: int) -> np.random.SeedSequence:
    """Return the stream of a seed that this key names, the same at every call."""
    return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *key))
