"""The linearisation of a system at one instant: its field, guard gradients and handler.

Derivatives are exact, by dual numbers (`numbers.derivatives`), where the functions
compile for them; for others they are extrapolated differences. Values are those of the
plain Python functions: a few hundred evaluations need no compiler.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, compress

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import ArgumentError
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.system import System

#: Step of the differences that give derivatives; extrapolated, their error is STEP^4.
#: Unit: 1, of a coordinate's size. Origin: chosen.
STEP = 1e-3
#: Difference within which slopes by differences and by the guards' rates agree; only
#: for guards that do not compile for dual numbers.
#: Unit: 1. Origin: chosen.
SAME_SLOPE = 1e-6
#: A state this close to a guard's surface lies on it.
#: Unit: 1, of the guard's scale. Origin: chosen.
ON_GUARD = 1e-9


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
        The instant at which the system is linearised.
    rate : (n,) array
        Field f.
    gradients : (n_guards, n) array
        Derivative Dh of each event function with respect to the state.
    time_rates : (n_guards,) array
        Derivative of each event function with respect to time, at a fixed state.
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
        """Sums |Dh_i f_i| + |dh/dt| that bound the rates, (n_guards,)."""
        return np.abs(self.gradients) @ np.abs(self.rate) + np.abs(self.time_rates)


def instant(
    system: System,
    state: ArrayLike,
    *,
    params: ArrayLike,
    mode: Sequence[int],
    t: float,
    sliding: Sequence[str] = (),
) -> Instant:
    """Return a checked state of the hybrid system; all locks must be set.

    Those of the guards named in `sliding` may be 0.
    """
    if isinstance(system, System):
        system.current()  # compiles called functions anew if their globals have changed
    y = np.array(state, dtype=np.float64)
    has_all_states = y.shape == (system.n_states,)
    expect(has_all_states, "state", f"shape ({system.n_states},)", y.shape)

    # The locks of the guards stand first; a scene may have modes of its own behind.
    modes = np.array(mode, dtype=np.int64)
    has_all_modes = modes.shape == (system.n_modes,)
    expect(has_all_modes, "mode", f"{system.n_modes} integers", modes.shape)
    locks = modes[: system.n_guards]
    is_set = np.isin(locks, (-1, 1))
    may_be_open = np.isin(system.guard_names, sliding)
    are_locks = bool((is_set | ((locks == 0) & may_be_open)).all())
    expect(are_locks, "mode", "locks -1 or +1 (0 only of guards that may slide)", locks)

    given = np.array(params, dtype=np.float64).ravel()
    memory = np.zeros(getattr(system, "n_memory", 0))
    return Instant(float(t), y, modes, np.concatenate([given, memory]))


def state_scale(system: System, scale: ArrayLike | None) -> FloatArray:
    """Return the size of each state coordinate, (n,); 1 unless given."""
    given = np.asarray(1.0 if scale is None else scale)
    sizes = np.broadcast_to(given, (system.n_states,))
    expect((sizes > 0).all(), "scale", "numbers > 0", repr(scale))
    return sizes.astype(np.float64)


def field_at(system: System, at: Instant) -> FloatArray:
    """Return the field at an instant, (n,)."""
    rate = np.zeros(len(at.y))
    system.field.function(at.t, at.y, at.mode, at.params, rate)
    return rate


def guards_at(
    system: System, at: Instant, dy: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the event functions, and their rates for the state's rate `dy`."""
    h = np.zeros(system.n_guards)
    rates = np.zeros(system.n_guards)
    if system.guards is not None:
        system.guards.function(at.t, at.y, dy, at.mode, at.params, h, rates)
    elif system.guard is not None:
        for k in range(system.n_guards):
            system.guard.function(at.t, at.y, dy, at.mode, at.params, k, h, rates)
    return h, rates


def differentiate(
    function: Callable[[Instant], FloatArray], at: Instant, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives (r, n) and (r,) with respect to state and time.

    Central differences at two steps are extrapolated (Richardson).
    """
    steps = STEP * np.maximum(scale, np.abs(at.y))
    axes = np.eye(len(at.y))

    def along_axis(axis: FloatArray, by: float) -> FloatArray:
        return function(at.moved(at.y + by * axis, at.t))

    def in_time(by: float) -> FloatArray:
        return function(at.moved(at.y, at.t + by))

    by_coordinate = []
    for axis, step in zip(axes, steps, strict=True):
        by_coordinate.append(_extrapolated(partial(along_axis, axis), step))
    by_time = _extrapolated(in_time, STEP)
    return np.array(by_coordinate).T, by_time


def derivative_of_field(system: System, at: Instant, scale: FloatArray) -> FloatArray:
    """Return the derivative of the field with respect to the state, (n, n)."""
    exact = system.exact.field(at.t, at.y, at.mode, at.params)
    if exact is not None:
        return exact
    return differentiate(lambda p: field_at(system, p), at, scale)[0]


def _extrapolated(along: Callable[[float], FloatArray], step: float) -> FloatArray:
    """Return the derivative at 0 from differences over a step and its half."""
    wide = (along(step) - along(-step)) / (2 * step)
    narrow = (along(step / 2) - along(-step / 2)) / step
    # The error of either grows as the square of its step: that of `narrow` is a quarter
    # of that of `wide`, so a third of what they differ by.
    return narrow + (narrow - wide) / 3


def linearise(system: System, at: Instant, scale: FloatArray) -> Linearisation:
    """Return the linearisation: the field and the gradients of the guards."""
    rate = field_at(system, at)
    exact = system.exact.guards(at.t, at.y, rate, at.mode, at.params)
    if exact is None:
        exact = gradients_by_rates(system, at, scale)
    return Linearisation(at, rate, *exact)


def gradients_by_rates(
    system: System, at: Instant, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the gradients of guards that do not compile for dual numbers.

    The guards' rates are linear in `dy`, so unit vectors give their gradients exactly
    if the scene computes rates from `dy`. A scene may instead use velocities in the
    state, which equal `dy` on a trajectory. In that case differences of the event
    functions give the gradients.
    """
    at_rest = np.zeros(system.n_states)
    h, rates_by_time = guards_at(system, at, at_rest)
    rates_by_state = []
    for axis in np.eye(system.n_states):
        _, rates = guards_at(system, at, axis)
        rates_by_state.append(rates - rates_by_time)
    by_rates = np.array(rates_by_state).T

    def surfaces(place: Instant) -> FloatArray:
        return guards_at(system, place, at_rest)[0]

    slopes, slopes_by_time = differentiate(surfaces, at, scale)
    off = np.abs(by_rates - slopes) @ scale + np.abs(rates_by_time - slopes_by_time)
    size = np.abs(slopes) @ scale + np.abs(slopes_by_time)
    rounding = 4 * (system.n_states + 1) * np.finfo(float).eps * np.abs(h) / STEP
    agree = off <= SAME_SLOPE * size + rounding
    gradients = np.where(agree[:, None], by_rates, slopes)
    return gradients, np.where(agree, rates_by_time, slopes_by_time)


def is_event(system: System, guard: int, way: int) -> bool:
    """Return whether a crossing this way is an event; else only the lock flips."""
    if system.directions is None:
        return True
    return system.directions[guard] * way >= 0


def cross(system: System, at: Instant, guard: int) -> Instant:
    """Return the hybrid state after a guard is crossed and its handler has run."""
    y = at.y.copy()
    mode = at.mode.copy()
    params = at.params.copy()
    way = -int(mode[guard])
    mode[guard] = way
    if system.on_event is not None and is_event(system, guard, way):
        told = system.on_event.function(at.t, y, mode, params, guard, way)
        if isinstance(told, tuple | list | np.ndarray):
            raise ArgumentError(
                "on_event: expected 0 to go on or 1 to stop, as it takes all six "
                f"arguments, found {told}: change y itself, or leave an argument out"
            )
    return Instant(at.t, y, mode, params)


def active_guards(
    system: System,
    here: Linearisation,
    guards: Sequence[int | str] | None,
    scale: FloatArray,
) -> tuple[int, ...]:
    """Return the indices of the guards named, or of those on whose surface it lies."""
    if guards is None:
        h = guards_at(system, here.instant, here.rate)[0]
        on_surface = np.abs(h) <= ON_GUARD * (np.abs(here.gradients) @ scale)
        return tuple(np.flatnonzero(on_surface).tolist())
    names = list(system.guard_names)
    unknown = [one for one in guards if isinstance(one, str) and one not in names]
    expect(not unknown, "guards", f"names among {names}", unknown)
    chosen = []
    for one in guards:
        index = names.index(one) if isinstance(one, str) else int(one)
        chosen.append(index)
    are_different = len(set(chosen)) == len(chosen)
    exist = all(0 <= index < len(names) for index in chosen)
    wanted = f"different ones of {names}"
    expect(are_different and exist, "guards", wanted, tuple(guards))
    return tuple(chosen)


# The system for each combination of the locks of some guards.

#: Number of guards up to which all combinations of their locks are checked.
#: Unit: 1. Origin: chosen: 256 combinations.
ALL_COMBINATIONS_UP_TO = 8
Combination = tuple[int, ...]


def lock_combinations(guards: Sequence[int], seed: int = 0) -> Iterator[Combination]:
    """Yield the sets of guards that may have been crossed, with increasing indices.

    These are all 2^n sets up to n = 8. Beyond, they are 256: none, each one, all, and
    random ones.
    """
    chosen = tuple(sorted(guards))
    n = len(chosen)
    if n <= ALL_COMBINATIONS_UP_TO:
        for size in range(n + 1):
            yield from combinations(chosen, size)
        return
    none: Combination = ()
    each_alone = [(guard,) for guard in chosen]
    found = {none, chosen, *each_alone}
    rng = np.random.default_rng(seed)
    while len(found) < 2**ALL_COMBINATIONS_UP_TO:
        is_crossed = rng.random(n) < 0.5
        found.add(tuple(compress(chosen, is_crossed)))
    yield from sorted(found, key=_small_ones_first)


def _small_ones_first(combination: Combination) -> tuple[int, Combination]:
    """Return by what combinations are sorted: their length, then their guards."""
    return len(combination), combination


def mode_fields(
    system: System,
    start: Instant,
    guards: Sequence[int],
    scale: FloatArray,
    seed: int = 0,
) -> dict[Combination, Linearisation]:
    """Return field and guards for each combination of locks, by the guards crossed."""
    fields = {}
    for crossed in lock_combinations(guards, seed):
        after = start
        for guard in crossed:
            after = cross(system, after, guard)
        fields[crossed] = linearise(system, after, scale)
    return fields


# The system at states beside the one that is checked.

#: Number of states beside the one that is checked; more would find rarer exceptions.
#: Unit: 1. Origin: chosen.
BESIDE = 8


def neighbours(
    start: Instant, scale: FloatArray, radius: float, seed: int
) -> list[Instant]:
    """Return an instant and some beside it, by a small step in a random direction.

    Steps are at most `radius` of each coordinate, or of its size where that is larger.
    """
    steps = radius * np.maximum(scale, np.abs(start.y))
    rng = np.random.default_rng(seed)
    directions = rng.uniform(-1.0, 1.0, (BESIDE, len(start.y)))
    beside = [start.moved(start.y + steps * one, start.t) for one in directions]
    return [start, *beside]


def in_mode(system: System, place: Instant, crossed: Combination) -> Instant:
    """Return a place in the mode in which these guards have been crossed.

    A handler may change the mode and the parameters. Jumps of the state are another
    condition, so they are left out here.
    """
    after = place
    for guard in crossed:
        after = cross(system, after, guard).moved(place.y, place.t)
    return after
