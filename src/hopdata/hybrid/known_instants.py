"""Instants that are known before: how they are given, and what the driver takes.

A step ends at each of them, and the next begins anew. They are numbers, or periodic
(`every`), which takes no memory for them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.hybrid import arguments
from hopdata.hybrid.arguments import expect

if TYPE_CHECKING:
    from hopdata.hybrid.system import System

WANTED = "times, every(period, start, ...) (from 0 without a start), or a list of them"


@dataclass(frozen=True)
class Every:
    """Periodic instants: start + k period, for all whole k and each of the starts."""

    period: float
    starts: tuple[float, ...] = (0.0,)


def every(period: float, *starts: float) -> Every:
    """Return periodic instants, for `tstops`.

    Parameters
    ----------
    period : float
        Time between two of them, s.
    *starts : float
        One instant of each sequence, s; by default 0. A pulse has two: where it begins
        and where it ends.

    Returns
    -------
    Every
        The instants start + k period, for all whole k (negative ones as well).

    Raises
    ------
    ValueError
        If the period is not positive, or a start is not finite.

    Examples
    --------
    >>> every(1e-3, 0.0, 0.3e-3)  # a pulse of 0.3 ms in each millisecond
    Every(period=0.001, starts=(0.0, 0.0003))
    """
    length = arguments.numbers_of("period", period).ravel()
    fits = len(length) == 1 and 0.0 < length[0] < inf
    expect(fits, "period", "a number > 0", period)
    given = arguments.numbers_of("starts", starts).ravel()
    expect(bool(np.isfinite(given).all()), "starts", "finite numbers", starts)
    return Every(float(length[0]), tuple(given.tolist()) or (0.0,))


class Instants(NamedTuple):
    """Known instants as the driver takes them: one row, or one for each integration.

    Parameters
    ----------
    singles : (R, k) array
        Single instants, increasing; infinity where a row has fewer.
    periods : (R, 2 m) array
        One instant and the period of each periodic sequence; a sequence with an
        infinite period has none.
    """

    singles: FloatArray
    periods: FloatArray


NONE = Instants(np.empty((1, 0)), np.empty((1, 0)))


def _row(given: Any) -> tuple[list[float], list[float]]:
    """Return single instants, and starts and periods of the others."""
    if given is None:
        return [], []
    parts = given if isinstance(given, tuple | list) else [given]
    singles: list[float] = []
    periods: list[float] = []
    for one in parts:
        if isinstance(one, Every):
            for start in one.starts:
                periods += [start, one.period]
        else:
            expect(one is not None, "tstops", WANTED, given)
            times = arguments.numbers_of("tstops", one).ravel()
            expect(bool(np.isfinite(times).all()), "tstops", "finite times", given)
            singles += times.tolist()
    return singles, periods


def instants_of(system: System, tstops: Any, params: Any) -> Instants:
    """Return the instants of a system and those of a call.

    Parameters
    ----------
    system : System
        System whose own `tstops` may be a function of the parameters.
    tstops : object
        Times, periodic instants, or a list of them; None if there are none.
    params : array_like
        Parameters, (p,), or (B, p) for many integrations.
    """
    own = system.tstops
    if tstops is None and own is None:
        return NONE
    shared = _row(tstops)
    numbers = np.atleast_2d(arguments.numbers_of("params", params))
    if callable(own):
        rows = [_row(own(one.copy())) for one in numbers]
    else:
        rows = [_row(own)]
    singles = [sorted({*shared[0], *row[0]}) for row in rows]
    periods = [[*shared[1], *row[1]] for row in rows]
    return Instants(_filled(singles, [inf]), _filled(periods, [0.0, inf]))


def _filled(rows: list[list[float]], rest: list[float]) -> FloatArray:
    """Return rows of different lengths as a table, filled by repetitions of `rest`."""
    width = max(len(row) for row in rows)
    table = np.tile(rest, (len(rows), width // len(rest)))
    for place, row in enumerate(rows):
        table[place, : len(row)] = row
    return table


def backward_instants(known: Instants | None) -> Instants | None:
    """Return the instants in the time s = -t; None if there are none."""
    if known is None:
        return None
    singles = np.sort(-known.singles, axis=1)
    singles[np.isneginf(singles)] = inf
    periods = known.periods.copy()
    periods[:, ::2] *= -1.0
    return Instants(np.sort(singles, axis=1), periods)
