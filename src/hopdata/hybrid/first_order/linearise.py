"""What a system is to first order at one instant: its field, its guards' slopes, its handler.

The functions of the system are run as plain Python: a few hundred evaluations need no compiler.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.system import System

STEP = 1e-3  # of differences, in units of a coordinate's size; extrapolated, they err by STEP^4
SAME_SLOPE = 1e-6  # differences and rates along unit vectors are then two views of one slope
ON_GUARD = 1e-9  # of the guard's own scale: how far off a surface a state still lies on it


@dataclass(frozen=True)
class Instant:
    """A state of the hybrid system: time (s), y (n,), mode (m,) and parameters (p,)."""

    t: float
    y: FloatArray
    mode: IntArray
    params: FloatArray

    def moved(self, y: FloatArray, t: float) -> Instant:
        """Return the same mode and parameters at another state and time."""
        return replace(self, y=y, t=t)


@dataclass(frozen=True)
class Linearisation:
    """Field and guards at an instant, in its mode.

    Parameters
    ----------
    instant : Instant
        Where.
    rate : (n,) array
        The field f.
    gradients : (n_guards, n) array
        Derivative Dh of each event function with respect to the state.
    time_rates : (n_guards,) array
        Derivative of each event function with respect to time, at a state at rest.
    """

    instant: Instant
    rate: FloatArray
    gradients: FloatArray
    time_rates: FloatArray

    @property
    def guard_rates(self) -> FloatArray:
        """Rates of the event functions along the field, Dh f + dh/dt, (n_guards,)."""
        return self.gradients @ self.rate + self.time_rates

    @property
    def guard_scales(self) -> FloatArray:
        """The sums |Dh_i f_i| + |dh/dt| that bound the rates, (n_guards,); they have no sign."""
        return np.abs(self.gradients) @ np.abs(self.rate) + np.abs(self.time_rates)


def instant(
    system: System, state: ArrayLike, *, params: ArrayLike, mode: Sequence[int], t: float
) -> Instant:
    """Return a state of the hybrid system, checked; all locks must be set."""
    y = np.array(state, dtype=np.float64)
    locks = np.array(mode, dtype=np.int64)
    expect(y.shape == (system.n_states,), "state", f"shape ({system.n_states},)", y.shape)
    expect(locks.shape == (system.n_modes,), "mode", f"{system.n_modes} integers", locks.shape)
    given = locks[: system.n_guards]
    expect(np.isin(given, (-1, 1)).all(), "mode", "locks -1 or +1", given)
    memory = np.zeros(getattr(system, "n_memory", 0))
    numbers = np.concatenate([np.array(params, dtype=np.float64).ravel(), memory])
    return Instant(float(t), y, locks, numbers)


def state_scale(system: System, scale: ArrayLike | None) -> FloatArray:
    """Return the size of each state coordinate, (n,); 1 unless given."""
    sizes = np.broadcast_to(np.asarray(1.0 if scale is None else scale), (system.n_states,))
    expect((sizes > 0).all(), "scale", "numbers > 0", repr(scale))
    return sizes.astype(np.float64)


def field_at(system: System, at: Instant) -> FloatArray:
    """Return the field, (n,)."""
    rate = np.zeros(len(at.y))
    system.field.function(at.t, at.y, at.mode, at.params, rate)
    return rate


def guards_at(system: System, at: Instant, dy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return event functions, and their rates when the state changes at the rate `dy`."""
    h, rates = np.zeros(system.n_guards), np.zeros(system.n_guards)
    if system.guards is not None:
        system.guards.function(at.t, at.y, dy, at.mode, at.params, h, rates)
    elif system.guard is not None:
        for k in range(system.n_guards):
            system.guard.function(at.t, at.y, dy, at.mode, at.params, k, h, rates)
    return h, rates


def differentiate(
    function: Callable[[Instant], FloatArray], at: Instant, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives (r, n) and (r,) with respect to state and time, by differences.

    Central differences at two steps, extrapolated (Richardson).
    """
    steps = STEP * np.maximum(scale, np.abs(at.y))
    columns = [
        _extrapolated(lambda s, e=e: function(at.moved(at.y + s * e, at.t)), step)  # type: ignore[misc]
        for step, e in zip(steps, np.eye(len(at.y)), strict=True)
    ]
    in_time = _extrapolated(lambda s: function(at.moved(at.y, at.t + s)), STEP)
    return np.array(columns).T, in_time


def _extrapolated(along: Callable[[float], FloatArray], step: float) -> FloatArray:
    wide = (along(step) - along(-step)) / (2 * step)
    narrow = (along(step / 2) - along(-step / 2)) / step
    return narrow + (narrow - wide) / 3


def linearise(system: System, at: Instant, scale: FloatArray) -> Linearisation:
    """Return the field and the slopes of the guards.

    The rates of the guards are linear in `dy`: unit vectors give their slopes exactly, if the
    scene computes them from `dy`. A scene may also use velocities of the state instead, since on a
    trajectory both are the same; then differences of the event functions give the slopes.
    """
    nothing = np.zeros(system.n_states)
    h, in_time = guards_at(system, at, nothing)
    exact = np.array([guards_at(system, at, e)[1] - in_time for e in np.eye(system.n_states)]).T
    slopes, slopes_in_time = differentiate(lambda p: guards_at(system, p, nothing)[0], at, scale)
    off = np.abs(exact - slopes) @ scale + np.abs(in_time - slopes_in_time)
    size = np.abs(slopes) @ scale + np.abs(slopes_in_time)
    rounding = 4 * (system.n_states + 1) * np.finfo(float).eps * np.abs(h) / STEP
    trusted = off <= SAME_SLOPE * size + rounding
    gradients = np.where(trusted[:, None], exact, slopes)
    in_time = np.where(trusted, in_time, slopes_in_time)
    return Linearisation(at, field_at(system, at), gradients, in_time)


def cross(system: System, at: Instant, guard: int) -> Instant:
    """Return the hybrid state after the crossing of one guard: lock flipped, handler run."""
    y, mode, params = at.y.copy(), at.mode.copy(), at.params.copy()
    mode[guard] = -mode[guard]
    if system.on_event is not None:
        system.on_event.function(at.t, y, mode, params, guard, int(mode[guard]))
    return Instant(at.t, y, mode, params)


def active_guards(
    system: System, here: Linearisation, guards: Sequence[int | str] | None, scale: FloatArray
) -> tuple[int, ...]:
    """Return the numbers of the guards named, or of those on whose surface the state lies."""
    if guards is None:
        h = guards_at(system, here.instant, here.rate)[0]
        on_surface = np.abs(h) <= ON_GUARD * (np.abs(here.gradients) @ scale)
        return tuple(np.flatnonzero(on_surface).tolist())
    names = list(system.guard_names)
    chosen = tuple(names.index(g) if isinstance(g, str) else int(g) for g in guards)
    fits = len(set(chosen)) == len(chosen) and all(0 <= k < len(names) for k in chosen)
    expect(fits, "guards", f"different ones of {names}", tuple(guards))
    return chosen


# The system in every combination of the locks of some guards.

ALL_COMBINATIONS_UP_TO = 8
Combination = tuple[int, ...]


def lock_combinations(guards: Sequence[int], seed: int = 0) -> Iterator[Combination]:
    """Yield the sets of guards that may have been crossed, as increasing numbers.

    All 2^n up to n = 8; beyond, 256: none, each one, all, and others drawn.
    """
    chosen = tuple(sorted(guards))
    n = len(chosen)
    if n <= ALL_COMBINATIONS_UP_TO:
        for size in range(n + 1):
            yield from combinations(chosen, size)
        return
    seen = {(), chosen, *((guard,) for guard in chosen)}
    rng = np.random.default_rng(seed)
    while len(seen) < 2**ALL_COMBINATIONS_UP_TO:
        drawn = zip(chosen, rng.random(n) < 0.5, strict=True)
        seen.add(tuple(k for k, crossed in drawn if crossed))
    yield from sorted(seen, key=lambda combination: (len(combination), combination))


def mode_fields(
    system: System, start: Instant, guards: Sequence[int], scale: FloatArray, seed: int = 0
) -> dict[Combination, Linearisation]:
    """Return field and guards in each combination of locks, by the guards crossed."""

    def after(crossed: Combination) -> Linearisation:
        return linearise(system, reduce(partial(cross, system), crossed, start), scale)

    return {crossed: after(crossed) for crossed in lock_combinations(guards, seed)}
