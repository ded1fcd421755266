"""Whether a system has the second-order form of table 1.1's second column at a state.

Such a system (force-position additive, section 3.1 of reference CRB22 of the
dissertation) is event-selected; half of its coordinates are positions and the others
their velocities; its guards depend on the positions alone; and its contacts add
accelerations: with several feet down, each adds what it adds alone. Then the saltation
matrices commute, and the flow is C1.

The velocities need not be the rates of the positions: angles change at rates that
depend on the angular velocity and the attitude. It is enough that the rates of the
positions determine the velocities, and are the same in every mode. With these rates as
coordinates in place of the velocities, the contacts still add accelerations, because
they enter linearly.

All of this is found by evaluating the system at the state and at a few states beside
it, in every mode: at the instant of a contact a spring does not push yet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.hybrid.first_order import linearise as local
from hopdata.hybrid.first_order.finding import Finding
from hopdata.hybrid.first_order.linearise import Combination, Instant
from hopdata.hybrid.system import System

GROUPED = "coordinates are positions and velocities"
BY_POSITION = "guards depend on position alone"
ADDITIVE = "contacts add accelerations (additive)"
#: Condition number from which rates of positions do not determine the velocities.
#: Unit: 1. Origin: chosen.
SINGULAR = 1e8
#: Error of a sum of accelerations that is left out of account.
#: Unit: 1, of the largest. Origin: rounding: 64 units in the last place.
ROUNDING = 64 * np.finfo(float).eps
Fields = Sequence[Mapping[Combination, FloatArray]]


def second_order_form(
    system: System,
    start: Instant,
    active: Sequence[int],
    scale: FloatArray,
    seed: int,
    tolerance: float,
    positions: Sequence[int] | None,
) -> tuple[Finding, ...]:
    """Return findings on positions and velocities, on guards, and on accelerations.

    Parameters
    ----------
    system : System
        Field, guards and handler.
    start : Instant
        State and mode before the crossings.
    active : sequence of int
        Guards that are crossed.
    scale : (n,) array
        Size of each coordinate.
    seed : int
        Seed of the states beside `start`, and of combinations of more than eight
        guards.
    tolerance : float
        Relative difference below which two numbers count as equal.
    positions : sequence of int, optional
        Coordinates that are positions; by default those whose rate is another
        coordinate or, if these are not half of all, the first half.
    """
    combinations = list(local.lock_combinations(active, seed))
    places = local.neighbours(start, scale, local.STEP, seed)
    fields = [
        {
            crossed: local.field_at(system, local.in_mode(system, place, crossed))
            for crossed in combinations
        }
        for place in places
    ]
    grouped, found = _grouped(system, places, fields, scale, tolerance, positions)
    return (
        grouped,
        _by_position(system, places, active, scale, found, tolerance),
        _additive(fields, scale, tolerance),
    )


def position_pairs(
    places: Sequence[Instant], fields: Fields, scale: FloatArray, tolerance: float
) -> dict[int, int]:
    """Return the coordinates whose rate is another one in every mode, with that."""
    n = len(scale)
    agree = np.ones((n, n), dtype=bool)  # rate of the first is the second
    for place, field in zip(places, fields, strict=True):
        allowed = tolerance * np.maximum(scale, np.abs(place.y))
        for rate in field.values():
            agree &= np.abs(rate[:, None] - place.y[None, :]) <= allowed[None, :]
    np.fill_diagonal(agree, False)
    velocities = [np.flatnonzero(row) for row in agree]
    return {i: int(row[0]) for i, row in enumerate(velocities) if len(row) == 1}


def why_not_positions(
    system: System,
    places: Sequence[Instant],
    fields: Fields,
    scale: FloatArray,
    tolerance: float,
    positions: Sequence[int],
) -> str:
    """Return why the others are not the velocities of these; empty if they are."""
    n = len(scale)
    chosen = list(positions)
    n_chosen = len(set(chosen))
    if 2 * n_chosen != n or not set(chosen) <= set(range(n)):
        return f"{n_chosen} positions among {n} coordinates are not half of them"
    others = np.setdiff1d(np.arange(n), chosen)
    for place, field in zip(places, fields, strict=True):
        rates = np.array([rate[chosen] for rate in field.values()])
        allowed = tolerance * np.maximum(scale[chosen], np.abs(rates).max(axis=0))
        changed = np.flatnonzero(np.ptp(rates, axis=0) > allowed)
        if len(changed) > 0:
            first = chosen[changed[0]]
            return f"y[{first}] is none, as contacts change its rate itself"
        slopes = local.derivative_of_field(system, place, scale)[chosen]
        if not np.linalg.cond(slopes[:, others] * scale[others]) < SINGULAR:
            return f"the rates of {chosen} do not determine the other coordinates"
    return ""


#: What a user does where the coordinates are not positions and velocities.
OTHERWISE = (
    "others may be given as positions=; with a memory of footholds no half of the "
    "coordinates will do"
)


def _grouped(
    system: System,
    places: Sequence[Instant],
    fields: Fields,
    scale: FloatArray,
    tolerance: float,
    positions: Sequence[int] | None,
) -> tuple[Finding, list[int]]:
    """Return the finding on positions and velocities, and the supposed positions.

    There are none if they would not be half of the coordinates.
    """
    n = len(scale)
    pairs = position_pairs(places, fields, scale, tolerance)
    if positions is not None:
        chosen = list(positions)
        listed = f"{chosen}, as given"
    elif 2 * len(pairs) == n and set(pairs.values()).isdisjoint(pairs):
        chosen = list(pairs)
        listed = ", ".join(f"y[{i}] with its velocity y[{k}]" for i, k in pairs.items())
    else:
        chosen = list(range(n // 2))
        listed = "the first half, and the others their velocities"
    needed = f"= {n // 2}"
    what = "coordinates that are positions"
    why = why_not_positions(system, places, fields, scale, tolerance, chosen)
    if why:
        detail = f"{what}: tried {listed}; {why} ({OTHERWISE})"
        if 2 * len(set(chosen)) != n or not set(chosen) <= set(range(n)):
            chosen = []
        return Finding(GROUPED, False, 0.0, needed, detail), chosen
    detail = f"{what}: {listed}"
    return Finding(GROUPED, True, float(len(chosen)), needed, detail), chosen


def _by_position(
    system: System,
    places: Sequence[Instant],
    active: Sequence[int],
    scale: FloatArray,
    positions: Sequence[int],
    tolerance: float,
) -> Finding:
    """Return the finding on whether guards change with anything but the positions."""
    detail = "largest share of velocities and time in the change of a guard"
    if not positions:
        return Finding(BY_POSITION, False, np.nan, f"<= {tolerance:g}", detail)
    is_position = np.isin(np.arange(len(scale)), positions)
    worst = 0.0
    for place in places:
        here = local.linearise(system, place, scale)
        parts = np.abs(here.gradients[list(active)]) * scale
        in_time = np.abs(here.time_rates[list(active)])
        other = parts[:, ~is_position].sum(axis=1) + in_time
        whole = parts.sum(axis=1) + in_time
        share = np.divide(other, whole, out=np.ones_like(whole), where=whole > 0)
        worst = max(worst, float(share.max()))
    return Finding.at_most(BY_POSITION, worst, tolerance, detail)


def _additive(fields: Fields, scale: FloatArray, tolerance: float) -> Finding:
    """Return the finding on whether crossed guards add to the rates what each adds.

    That they add nothing to the rates of positions is part of another line.
    """
    apart = 0.0
    effect = 0.0
    for field in fields:
        free = field[()]
        alone = {}
        for crossed, rate in field.items():
            if len(crossed) == 1:
                alone[crossed[0]] = rate - free
        largest = max(float(np.max(np.abs(rate) / scale)) for rate in field.values())
        rounding = ROUNDING * largest
        for crossed, rate in field.items():
            added = rate - free
            beyond_sum = added - np.sum([alone[guard] for guard in crossed], axis=0)
            off = float(np.max(np.abs(beyond_sum) / scale))
            apart = max(apart, off - rounding)
            effect = max(effect, float(np.max(np.abs(added) / scale)))
    value = apart / effect if effect > 0 else 0.0
    detail = (
        "largest deviation from the sum of what each contact adds alone, over the "
        "largest change of a rate by contacts"
    )
    return Finding.at_most(ADDITIVE, value, tolerance, detail)
