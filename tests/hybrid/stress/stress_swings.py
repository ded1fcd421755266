"""Random oscillating systems whose guard lies just within, or beyond, a turning point of its path.

If a step spans most of an oscillation, such a guard falls and rises again unseen from
the step's ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from stress_case import Case, Expected
from stress_systems import swinging

END, GRID, BLOCK = 3.0, 6000, 100
RTOL, ATOL = 1e-9, 1e-11
NEAREST, FARTHEST = (
    1e-3,
    0.3,
)  # of the guard's range: from its surface to the turning point
CLEAR = 3e-4  # of that range: the grid cannot resolve levels closer to a turning point
NEWTON = 6
DIGITS = 9  # decimals of drawn numbers
# Of times and states: what errors of steps may add up to over a few oscillations
OFF = 1e-6
METHODS = ("taylor", "dop853", "auto")


@dataclass(frozen=True)
class Swing:
    """An affine field y' = A y + b, its start, and the direction of the guard's plane."""

    matrix: np.ndarray
    constant: np.ndarray
    start: np.ndarray
    normal: np.ndarray


def turning(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return a matrix that rotates all states into each other, with slight damping."""
    drawn = rng.normal(size=(n, n))
    return (drawn - drawn.T - 0.1 * np.eye(n)) * rng.uniform(0.5, 10.0)


def several(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return a matrix of pairs that rotate independently, slow and fast."""
    matrix = np.zeros((n, n))
    for i in range(0, n - 1, 2):
        rate, damping = 10.0 ** rng.uniform(-0.3, 1.3), rng.uniform(0.0, 0.3)
        matrix[i : i + 2, i : i + 2] = [[-damping, rate], [-rate, -damping]]
    return matrix


def springs(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return the matrix of masses on springs: positions, then speeds."""
    half = n // 2
    drawn = rng.normal(size=(half, half))
    matrix = np.zeros((n, n))
    matrix[:half, half : 2 * half] = np.eye(half)
    matrix[half : 2 * half, :half] = -(drawn @ drawn.T) * 10.0 ** rng.uniform(0.0, 2.0)
    return matrix


def damped(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return an unstructured matrix with damping from none to strong."""
    return rng.normal(size=(n, n)) - np.diag(
        rng.uniform(0.0, 10.0 ** rng.uniform(0.0, 1.5), n)
    )


KINDS = (turning, several, springs, damped)


def draw(rng: np.random.Generator) -> Swing:
    """Draw a system of 2 to 8 states of very different sizes, in few digits: same anywhere."""
    n = int(rng.choice([2, 3, 4, 5, 8]))
    matrix = KINDS[int(rng.integers(len(KINDS)))](rng, n)
    start = rng.normal(size=n) * 10.0 ** rng.uniform(-2.0, 0.0, size=n)
    normal = np.eye(n)[0] if rng.random() < 0.3 else rng.normal(size=n)
    return Swing(
        *(
            np.round(part, DIGITS)
            for part in (matrix, rng.normal(size=n), start, normal)
        )
    )


def flow(swing: Swing, span: float) -> np.ndarray:
    """Return the matrix that advances (y, 1) by `span`."""
    n = len(swing.start)
    augmented = np.zeros((n + 1, n + 1))
    augmented[:n, :n], augmented[:n, n] = swing.matrix, swing.constant
    return np.asarray(expm(augmented * span))


def path(swing: Swing) -> np.ndarray:
    """Return (y, 1) at GRID + 1 instants: those of a block, advanced block by block."""
    on, rows = flow(swing, END / GRID), [np.append(swing.start, 1.0)]
    while len(rows) < BLOCK:
        rows.append(on @ rows[-1])
    far, blocks = flow(swing, BLOCK * END / GRID).T, [np.array(rows)]
    while len(blocks) <= GRID // BLOCK:
        blocks.append(blocks[-1] @ far)
    return np.concatenate(blocks)[: GRID + 1]


def crossing_time(swing: Swing, state: np.ndarray, level: float) -> float:
    """Return the time from `state`, the last grid point before, to the guard's crossing."""
    n, span = len(swing.start), 0.5 * END / GRID
    for _ in range(NEWTON):
        y = (flow(swing, span) @ state)[:n]
        rate = swing.normal @ (swing.matrix @ y + swing.constant)
        span -= (swing.normal @ y - level) / rate
    return float(span)


def level_of(rng: np.random.Generator, h: np.ndarray) -> float | None:
    """Return a level of the guard near one of its turning points; None if there is no clear one."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(h)))) + 1
    size = np.ptp(h)
    if len(turns) == 0 or size < 1e-3 * np.abs(h).max():
        return None
    turn = rng.choice(turns)
    below = 1.0 if h[turn] > h[turn - 1] else -1.0
    level = h[turn] - below * size * np.exp(rng.uniform(*np.log([NEAREST, FARTHEST])))
    level = np.round(level, DIGITS)
    known = h[[0, *turns, -1]]
    return float(level) if np.abs(known - level).min() > CLEAR * size else None


def swing_cases(count: int, seed: int = 11) -> list[Case]:
    """Return random cases with every crossing known: `count` systems, each by every method."""
    rng, cases, number = np.random.default_rng(seed), [], 0
    while number < count:
        swing = draw(rng)
        rows = path(swing)
        h = rows[:, :-1] @ swing.normal
        level = level_of(rng, h)
        if level is None:
            continue
        sides = np.sign(h - level).astype(int)
        before = np.flatnonzero(sides[1:] != sides[:-1])
        events = tuple(
            (
                k * END / GRID + crossing_time(swing, rows[k], level),
                0,
                int(sides[k + 1]),
            )
            for k in before
        )
        size = max(1.0, np.abs(rows).max())
        answer = Expected(
            events, rows[-1, :-1], OFF, OFF * size, mode=(int(sides[-1]),)
        )
        params = np.concatenate(
            [swing.matrix.ravel(), swing.constant, swing.normal, [level]]
        )
        options = {"params": params, "rtol": RTOL, "atol": ATOL}
        cases.extend(
            Case("swing", f"{number}, {len(swing.start)} states, {method}",
                 swinging(len(swing.start)), (0.0, END), swing.start, (answer,),
                 {**options, "method": method})
            for method in METHODS
        )  # fmt: skip
        number += 1
    return cases
