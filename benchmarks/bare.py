"""What a method costs by itself: its steps in one loop, without events, step control or a driver.

Along a path (states and modes of a solution), in machine code: the field alone, called by its
address as the driver does; and whole steps of an explicit method with the field compiled into it,
so with its stages' sums and its error norm, and nothing else. Each step goes on from the last, as
in an integration: a processor works on steps that do not wait for one another at the same time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hopdata.hybrid import System, solve
from hopdata.hybrid.compiled.kernel import call_field
from hopdata.hybrid.compiled.memory import address_of, array_of, int_vector, view
from hopdata.hybrid.layout import END, K1, KEND, W1, Y
from hopdata.hybrid.methods.explicit import Tableau
from hopdata.hybrid.methods.method import Scene, explicit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

EVALUATIONS = 20_000  # at least, in a row
IN_A_ROW = 8  # evaluations at one state, as a step has them in one mode
TINY_STEP = 1e-7  # s: the states are given, so it need not be of use


@dataclass(frozen=True)
class Path:
    """Where a system was.

    Parameters
    ----------
    system : System
    params : (p,) array
    states : (N, n) array
    modes : (N, m) array of int
    """

    system: System
    params: FloatArray
    states: FloatArray
    modes: IntArray

    @property
    def rounds(self) -> int:
        """How often to go along it."""
        return EVALUATIONS // (IN_A_ROW * len(self.states)) + 1


def path_of(
    system: System, t_span: tuple[float, float], y0: Sequence[float], params: Sequence[float],
    mode: Sequence[int] | None,
) -> Path:  # fmt: skip
    """Return the path of a solution, a state for each step."""
    whole, start = (
        solve(system, span, y0, params=params, mode=mode, method="dopri5")
        for span in (t_span, (t_span[0], t_span[0]))
    )
    modes = np.vstack([start.mode, whole.events.mode])
    last_event = np.searchsorted(whole.events.time, whole.t, side="right")
    states = np.ascontiguousarray(whole.y.T)
    return Path(system, np.array(params, dtype=np.float64), states, modes[last_event])


@njit(error_model="numpy")
def _evaluate(
    address: int, states: FloatArray, modes: IntArray, params: FloatArray, rounds: int
) -> None:
    table, p, out = view(states), view(params), view(np.empty((1, states.shape[1])))
    for _ in range(rounds):
        for i in range(len(states)):
            mode = int_vector(address_of(view(modes)) + 8 * i * modes.shape[1], modes.shape[1])
            for _ in range(IN_A_ROW):
                call_field(address, 0.0, table, i, mode, p, out, 0)


@njit(error_model="numpy")
def _take_steps(
    step: Any, states: FloatArray, modes: IntArray, params: FloatArray, room: FloatArray,
    atol: FloatArray, rounds: int,
) -> float:  # fmt: skip
    s, allowed, total, n_modes = view(room), view(atol), 0.0, modes.shape[1]
    for _ in range(rounds):
        for i in range(len(states)):
            mode = array_of(int_vector(address_of(view(modes)) + 8 * i * n_modes, n_modes))
            for j in range(states.shape[1]):
                s[Y, j], s[K1, j] = states[i, j], 1.0
            for _ in range(IN_A_ROW):
                total += step(0.0, TINY_STEP, 1e-9, s, mode, params, allowed)
                for j in range(states.shape[1]):
                    s[Y, j], s[K1, j] = s[END, j], s[KEND, j]
    return total


def best_time(run: Callable[[], object], repeats: int) -> float:
    """Return the least time of a run, s: what is done is the same each time, the rest is noise."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def once(run: Callable[[], object], count: int) -> Callable[[], float]:
    """Return a function that tells what one of `count` in a run takes now, ns."""
    run()
    return lambda: 1e9 * best_time(run, 1) / count


def field_timer(path: Path) -> Callable[[], float]:
    """Return a function that times the field: ns for an evaluation, on the average on the path."""
    address = path.system.field.address
    arguments = (address, path.states, path.modes, path.params, path.rounds)
    return once(lambda: _evaluate(*arguments), path.rounds * len(path.states) * IN_A_ROW)


def step_timer(path: Path, tableau: Tableau) -> Callable[[], float]:
    """Return a function that times a bare step of an explicit method, ns."""
    n = path.system.n_states
    step = njit(error_model="numpy")(explicit(tableau, Scene(path.system.field, n)).step)
    room, atol = np.zeros((W1 + tableau.work_rows, n)), np.full(n, 1e-9)
    arguments = (step, path.states, path.modes, path.params, room, atol, path.rounds)
    return once(lambda: _take_steps(*arguments), path.rounds * len(path.states) * IN_A_ROW)
