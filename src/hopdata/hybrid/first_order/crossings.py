"""Crossings where a guard may slide, or where one may be crossed again.

At the surface of a guard that may slide, the neighbours of a trajectory cross it, or
begin to slide along it: then the field after it is Filippov's mix, and the saltation
matrix is the projection onto the surface along the difference of both fields (Filippov
1988; Dieci and Lopez 2011). A guard slides on while another one is crossed, unless its
share of the upper field leaves the interval from 0 to 1: then it lets go at once. Where
a trajectory leaves a surface by itself, its share has just come to 0 or 1, so the mix
is the field into which it leaves: the matrix is the identity.

In an instant of this module, the lock of a guard that slides is 0.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.hybrid.first_order import linearise as local
from hopdata.hybrid.first_order.linearise import Instant, Linearisation
from hopdata.hybrid.sliding.flags import LEAVES, SLIDES
from hopdata.hybrid.sliding.mix import ADDITIVE
from hopdata.hybrid.system import System

#: Distance of a share from 0 or 1 within which a guard lets go.
#: Unit: 1. Origin: chosen: states at which it does are known to their rounding.
EDGE = 1e-9

#: Least rate of a guard that is approached.
#: Unit: 1, of the sum of the sizes of the rate's terms. Origin: chosen.
APPROACHED = 1e-9


class NoDerivativeError(ValueError):
    """The neighbours of a trajectory do not stay beside it, or not in one way."""


def surfaces_of(system: System) -> tuple[int, ...]:
    """Return the guards that may slide."""
    return tuple(system.guard_names.index(name) for name in system.sliding)


class Mix:
    """Filippov's mix at an instant, for the guards whose lock is 0.

    Parameters
    ----------
    system : System
        Field and guards.
    at : Instant
        The instant.
    scale : (n,) array
        Size of each coordinate.

    Attributes
    ----------
    here : Linearisation
        The mixed field, and the guards.
    guards : list of int
        Guards that slide.
    shares, slopes : (s,) array
        The share of each one's upper field, and the difference of its rates by the
        upper and the lower field.
    projection : (n, n) array
        What takes the neighbours onto the surfaces.
    """

    def __init__(self, system: System, at: Instant, scale: FloatArray) -> None:
        self.guards = [k for k in surfaces_of(system) if at.mode[k] == 0]
        mode = at.mode.copy()
        mode[self.guards] = -1
        lowest = replace(at, mode=mode)
        below = local.linearise(system, lowest, scale)
        fields = []
        for k in self.guards:
            mode = lowest.mode.copy()
            mode[k] = 1
            fields.append(local.field_at(system, replace(at, mode=mode)))
        n = system.n_states
        changes = np.reshape(fields, (len(self.guards), n)) - below.rate
        self._check_sum(system, lowest, below.rate, changes)
        gradients = below.gradients[self.guards]
        matrix = gradients @ changes.T
        self.slopes = np.diag(matrix)
        names = [system.guard_names[k] for k in self.guards]
        if (self.slopes >= 0.0).any() or not np.isfinite(matrix).all():
            raise NoDerivativeError(
                f"guards {names}: the fields on both sides do not point at a surface "
                "along which the trajectory slides (a two-fold, where both are tangent "
                "to it, has no unique field)"
            )
        try:
            back = np.linalg.solve(matrix, gradients)
            self.shares = np.linalg.solve(matrix, -below.guard_rates[self.guards])
        except np.linalg.LinAlgError:
            raise NoDerivativeError(
                f"guards {names}: no mix of the fields keeps them at zero"
            ) from None
        self.projection = np.eye(n) - changes.T @ back
        rate = below.rate + self.shares @ changes
        self.here = replace(below, instant=at, rate=rate)

    def _check_sum(
        self, system: System, lowest: Instant, below: FloatArray, changes: FloatArray
    ) -> None:
        """Raise if the changes of the field by several guards do not add up."""
        if len(self.guards) < 2:
            return
        mode = lowest.mode.copy()
        mode[self.guards] = 1
        together = local.field_at(system, replace(lowest, mode=mode))
        off = np.abs(together - below - changes.sum(axis=0))
        size = np.abs(together) + np.abs(below) + np.abs(changes).sum(axis=0)
        if (off > ADDITIVE * size).any():
            names = [system.guard_names[k] for k in self.guards]
            raise NoDerivativeError(
                f"guards {names}: the rate along all of these surfaces is not unique, "
                "because one lock changes the field otherwise for each lock of another"
            )

    @property
    def lets_go(self) -> tuple[int, int] | None:
        """The guard that lets go first, and to which side; None if none does."""
        if not self.guards:
            return None
        beyond = np.maximum(self.shares - 1.0, -self.shares)
        worst = int(np.argmax(beyond))
        if beyond[worst] < -EDGE:
            return None
        return self.guards[worst], 1 if self.shares[worst] > 0.5 else -1


def handled(system: System, at: Instant, guard: int, told: int) -> Instant:
    """Return the instant after the handler of a guard, which is told a direction."""
    y = at.y.copy()
    mode = at.mode.copy()
    params = at.params.copy()
    if system.on_event is not None and local.is_event(system, guard, told):
        system.on_event.function(at.t, y, mode, params, guard, told)
    return Instant(at.t, y, mode, params)


def settled(system: System, at: Instant, scale: FloatArray) -> Mix:
    """Return the mix once all guards have let go that do not slide any longer."""
    found = Mix(system, at, scale)
    for _ in range(2 * len(surfaces_of(system))):
        released = found.lets_go
        if released is None:
            break
        guard, way = released
        mode = at.mode.copy()
        mode[guard] = way
        at = handled(system, replace(at, mode=mode), guard, LEAVES * way)
        found = Mix(system, at, scale)
    return found


def slides(system: System, at: Instant, guard: int, scale: FloatArray) -> bool:
    """Return whether the fields on both sides of a guard point at it."""
    if guard not in surfaces_of(system):
        return False
    rates = []
    for side in (-1, 1):
        mode = at.mode.copy()
        mode[guard] = side
        here = Mix(system, replace(at, mode=mode), scale).here
        size = APPROACHED * here.guard_scales[guard]
        rates.append(-side * here.guard_rates[guard] - size)
    return min(rates) > 0.0


def after_crossing(
    system: System, at: Instant, guard: int, scale: FloatArray
) -> tuple[Instant, Instant, int]:
    """Return the instant before a guard's handler and after it, and what it is told."""
    told = -int(at.mode[guard])
    mode = at.mode.copy()
    mode[guard] = told
    if slides(system, at, guard, scale):
        mode[guard] = 0
        told *= SLIDES
    entered = replace(at, mode=mode)
    return entered, handled(system, entered, guard, told), told


def approached(
    here: Linearisation, guards: tuple[int, ...], sizes: FloatArray | float = 0.0
) -> list[int]:
    """Return the guards whose surfaces the neighbours are still to meet.

    `sizes` (n_guards,) are those of the rates before the first crossing: what an impact
    has stopped is at rest, whatever rounding has left of its rate.
    """
    least = APPROACHED * np.maximum(here.guard_scales, sizes)
    towards = -here.instant.mode[: len(least)] * here.guard_rates
    return [k for k in guards if towards[k] > least[k]]


def after_law(
    system: System, at: Instant, guards: tuple[int, ...], scale: FloatArray
) -> Instant:
    """Return the instant after a law for several guards at once.

    As in the driver, it is asked again where its own state lets guards flip again.
    """
    assert system.together is not None
    for _ in range(2 + 2 * len(guards)):
        flips = approached(local.linearise(system, at, scale), guards)
        if not flips:
            return at
        mode = at.mode.copy()
        due = np.zeros(system.n_guards, dtype=np.int64)
        for k in flips:
            due[k] = -mode[k]
            mode[k] = due[k]
        if len(flips) == 1:
            at = handled(system, replace(at, mode=mode), flips[0], int(due[flips[0]]))
            continue
        y = at.y.copy()
        params = at.params.copy()
        system.together.function(at.t, y, mode, params, due)
        at = Instant(at.t, y, mode, params)
    raise NoDerivativeError("together: its state lets guards flip without an end")
