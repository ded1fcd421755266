"""Comparison of a field with the pattern that the user gives of its Jacobian.

A dependence outside the pattern is first suspected, where the change of the field along
a random direction is not what the derivatives in the pattern predict. It is then proven
without any tolerance: a component of the field that does not depend on a state keeps
its very bits when that state changes. So a pattern that is right is never refused.
"""

from collections.abc import Callable

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import kept_njit
from hopdata.errors import ArgumentError
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.kernel import call_field
from hopdata.hybrid.compiled.memory import view
from hopdata.hybrid.methods.sparsity import Pattern
from hopdata.hybrid.methods.stiff import CUBE_ROOT_OF_EPS

Rates = Callable[[FloatArray], FloatArray]

#: Difference between a change and its prediction, relative to the terms of the
#: prediction, from which a component is suspected.
#: Unit: 1. Origin: chosen: far above the truncation of central differences; what is
#: suspected wrongly costs a few evaluations.
SUSPECT = 1e-6

#: Rounding of the field, relative to its largest value, below which nothing is
#: suspected.
#: Unit: 1. Origin: rounding: a hundred units in the last place of a double.
FIELD_ROUNDING = 100 * 2.0**-52

#: Most components that are examined at one point, the most suspicious first.
#: Unit: 1. Origin: chosen.
MOST_SUSPECTS = 8

#: Distance of the second point from the start, as a fraction of the states' size. At
#: the start itself a dependence may be hidden by a factor that is zero.
#: Unit: 1. Origin: chosen.
ASIDE = 1e-3


@kept_njit(error_model="numpy")
def evaluate(
    address: int, t: float, table: FloatArray, mode: IntArray, params: FloatArray
) -> None:
    """Evaluate the field at the first row of a table into the second."""
    states = view(table)
    call_field(address, t, states, 0, view(mode), view(params), states, 1)


def rates_of(field: Callback, t: float, mode: IntArray, params: FloatArray) -> Rates:
    """Return the field as a function of the state alone."""

    def rates(y: FloatArray) -> FloatArray:
        table = np.stack([y, np.full(len(y), np.nan)])
        if field.compiled:
            evaluate(field.address, t, table, mode.copy(), params.copy())
        else:
            field.function(t, table[0], mode.copy(), params.copy(), table[1])
        return table[1]

    return rates


def check_pattern(
    field: Callback,
    pattern: Pattern,
    t: float,
    y: FloatArray,
    mode: IntArray,
    n_guards: int,
    params: FloatArray,
) -> None:
    """Raise an error if the field depends on a state outside the pattern.

    It is examined at the start and beside it, with the locks that are not given on both
    sides.

    Raises
    ------
    ArgumentError
        If so; it names the component and the state.
    """
    draw = np.random.default_rng(np.random.SeedSequence(len(y)))
    sizes = np.maximum(np.abs(y), np.abs(y).mean())
    sizes[sizes == 0.0] = 1.0
    aside = y + ASIDE * sizes * draw.uniform(-1.0, 1.0, len(y))
    sides = (-1, 1) if n_guards > 0 else (1,)
    for side in sides:
        locked = mode.copy()
        locks = locked[:n_guards]
        locks[locks == 0] = side
        rates = rates_of(field, t, locked, params)
        for point in (y, aside):
            _check_at(rates, pattern, point, CUBE_ROOT_OF_EPS * sizes, draw)


def _check_at(
    rates: Rates,
    pattern: Pattern,
    y: FloatArray,
    increments: FloatArray,
    draw: np.random.Generator,
) -> None:
    """Compare the field with its pattern at one point."""
    here = rates(y)
    direction = increments * draw.uniform(0.5, 1.5, len(y))
    direction *= draw.choice([-1.0, 1.0], len(y))
    above = y + direction
    below = y - direction
    risen = rates(above)
    fallen = rates(below)
    terms = _derivatives(rates, pattern, y, increments)
    terms *= (above - below)[pattern.columns]
    n = pattern.n_states
    predicted = np.bincount(pattern.rows, terms, n)
    size = SUSPECT * np.bincount(pattern.rows, np.abs(terms), n)
    size += FIELD_ROUNDING * (np.abs(risen) + np.abs(fallen))
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.abs(risen - fallen - predicted) / size
    excess[~(excess > 1.0)] = 0.0
    for row in np.argsort(-excess, kind="stable")[:MOST_SUSPECTS]:
        if excess[row] > 0.0 and np.isfinite(here[row]):
            _examine(rates, pattern, y, here, direction, int(row))


def _derivatives(
    rates: Rates, pattern: Pattern, y: FloatArray, increments: FloatArray
) -> FloatArray:
    """Return the derivatives in the pattern by differences, (nnz,)."""
    found = np.zeros(len(pattern.rows))
    colours = pattern.colours
    of_entries = colours[pattern.columns]
    for colour in range(int(colours.max()) + 1):
        shift = np.where(colours == colour, increments, 0.0)
        above = y + shift
        below = y - shift
        change = rates(above) - rates(below)
        ours = np.flatnonzero(of_entries == colour)
        span = (above - below)[pattern.columns[ours]]
        found[ours] = change[pattern.rows[ours]] / span
    return found


def _examine(
    rates: Rates,
    pattern: Pattern,
    y: FloatArray,
    here: FloatArray,
    direction: FloatArray,
    row: int,
) -> None:
    """Raise an error if one component changes with the states outside its pattern."""
    first, last = pattern.row_starts[row : row + 2]
    outside = np.setdiff1d(np.arange(pattern.n_states), pattern.columns[first:last])

    def changes(states: IntArray) -> bool:
        moved = y.copy()
        moved[states] += direction[states]
        there = rates(moved)[row]
        return bool(np.isfinite(there) and there != here[row])

    if not changes(outside):
        return
    while len(outside) > 1:
        half = len(outside) // 2
        if changes(outside[:half]):
            outside = outside[:half]
        else:
            outside = outside[half:]
    raise ArgumentError(
        f"sparsity: expected a pattern with every derivative of the field that is not "
        f"zero, found that dy[{row}] depends on y[{outside[0]}], which is not in it"
    )
