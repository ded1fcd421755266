"""Small systems with exact solutions, shared by the tests of the integrator.

They are compiled once and vary by their parameters, so the tests spend little time
compiling.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from hopdata.hybrid import System, field, guards, on_event


@field
def ladder_field(t, y, mode, params, dy):
    n = len(params) // 2
    rate = 1.0
    for k in range(n):
        if mode[k] > 0:
            rate += params[n + k]
    dy[0] = rate
    dy[1] = y[0]


@guards
def ladder_guards(t, y, dy, mode, params, h, hdot):
    for k in range(len(h)):
        h[k] = y[0] - params[k]
        hdot[k] = dy[0]


def ladder(n_guards: int, **options) -> System:
    """Return a point that moves at speed 1, plus ``params[n + k]`` beyond each ``params[k]``."""
    names = tuple(f"rung{k}" for k in range(n_guards))
    return System(ladder_field, ladder_guards, n_states=2, guard_names=names, **options)


def ladder_solution(rungs, gains, end):
    """Return the instants at which the rungs are passed from 0, and the position at `end`."""
    order = np.argsort(rungs, kind="stable")
    time, place, speed, instants = 0.0, 0.0, 1.0, np.full(len(rungs), np.inf)
    for k in order:
        time += (rungs[k] - place) / speed
        place, instants[k] = rungs[k], time
        speed += gains[k]
    last = [k for k in order if instants[k] <= end]
    start = instants[last[-1]] if last else 0.0
    speed = 1.0 + sum(gains[k] for k in last)
    return instants, (rungs[last[-1]] if last else 0.0) + speed * (end - start)


@field
def fall_field(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -params[0]


@guards
def floor_guard(t, y, dy, mode, params, h, hdot):
    h[0] = params[1] - y[0]
    hdot[0] = -dy[0]


@on_event
def rebound(t, y, mode, params, guard, direction):
    if direction > 0:
        y[1] = -params[2] * y[1]
    return 0


@on_event
def stop_at_once(t, y, mode, params, guard, direction):
    return 1


def ball(**options) -> System:
    """Return a ball under gravity params[0], a floor at params[1], restitution params[2]."""
    return System(
        fall_field, floor_guard, options.pop("on_event", rebound),
        n_states=2, guard_names=("floor",), **options,
    )  # fmt: skip


@guards
def table_guard(t, y, dy, mode, params, h, hdot):
    h[0] = params[1] + params[2] * np.sin(params[3] * t) - y[0]
    hdot[0] = params[2] * params[3] * np.cos(params[3] * t) - dy[0]


@on_event
def rebound_from_table(t, y, mode, params, guard, direction):
    if direction > 0:
        speed = params[2] * params[3] * np.cos(params[3] * t)
        y[1] = speed - params[4] * (y[1] - speed)
    return 0


def table_ball() -> System:
    """Return a ball on a table at params[1] that shakes by params[2] at params[3] rad/s."""
    return System(
        fall_field, table_guard, rebound_from_table, n_states=2, guard_names=("table",)
    )


@field
def pull_field(t, y, mode, params, dy):
    dy[0], dy[1], dy[2], dy[3] = y[2], y[3], params[0], -params[0]


@guards
def touch_guard(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - y[1], dy[0] - dy[1]


@on_event
def bump(t, y, mode, params, guard, direction):
    if direction > 0:
        mean, half = 0.5 * (y[2] + y[3]), 0.5 * params[1] * (y[2] - y[3])
        y[2], y[3] = mean - half, mean + half
    return 0


def bumping_pair() -> System:
    """Return two equal bodies that attract each other by params[0]; restitution is params[1]."""
    return System(pull_field, touch_guard, bump, n_states=4, guard_names=("touch",))


@guards
def ceiling_guard(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - params[1]
    hdot[0] = dy[0]


def throw(**options) -> System:
    """Return a ball thrown against a ceiling at params[1], which it passes freely."""
    return System(
        fall_field, ceiling_guard, n_states=2, guard_names=("ceiling",), **options
    )


@field
def towards_field(t, y, mode, params, dy):
    dy[0] = -params[0] if mode[0] > 0 else params[1]


@guards
def origin_guard(t, y, dy, mode, params, h, hdot):
    h[0] = y[0]
    hdot[0] = dy[0]


def sliding() -> System:
    """Return a point drawn to the origin from both sides, at speeds params[0] and params[1]."""
    return System(towards_field, origin_guard, n_states=1, guard_names=("origin",))


@field
def growth_field(t, y, mode, params, dy):
    dy[0] = params[0] * y[0]
    dy[1] = np.sqrt(params[1] - t)


def growth() -> System:
    """Return exponential growth, and a component that is NaN after the time params[1]."""
    return System(growth_field, n_states=2)


@guards
def failing_guard(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - 1e9
    h[1] = np.log(params[1] - t)
    hdot[0], hdot[1] = dy[0], -1.0 / (params[1] - t)


@field
def balance_field(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = (params[0] - y[0]) - params[0]


def balance() -> System:
    """Return a mass on a spring of rate 1 under the weight params[0], balanced by another force."""
    return System(balance_field, n_states=2)


@field
def raising_field(t, y, mode, params, dy):
    dy[0] = 1.0
    if y[0] > params[0]:
        raise ValueError("beyond the edge of the map")
    dy[1] = 0.0


def raising() -> System:
    """Return a point at speed 1 whose field raises a ValueError beyond params[0]."""
    return System(raising_field, n_states=2)


@field(compiled=False)
def py_raising_field(t, y, mode, params, dy):
    if y[0] > params[0]:
        raise LookupError("no such place", 3)
    dy[0], dy[1] = 1.0, 0.0


@cache
def py_raising() -> System:
    """Return the same in Python, with an exception that has arguments."""
    return System(py_raising_field, n_states=2)


@field
def relay_field(t, y, mode, params, dy):
    dy[0] = 1.0
    dy[1] = 1.0 if mode[2] > 0 else 0.0


@guards
def relay_guards(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - 1.0, dy[0]
    h[1], hdot[1] = (1.0 if mode[2] > 0 else -1.0), 0.0


@on_event
def relay_event(t, y, mode, params, guard, direction):
    if guard == 0:
        mode[2] = direction
    return 0


def relay() -> System:
    """Return a guard `first` at 1 whose handler pushes guard `second` across its surface."""
    return System(
        relay_field, relay_guards, relay_event, n_states=2,
        guard_names=("first", "second"), n_extra_modes=1,
    )  # fmt: skip


@field
def row_field(t, y, mode, params, dy):
    n = len(y) // 2
    for i in range(n):
        dy[i], dy[n + i] = y[n + i], -params[n + 1] * y[i]


@guards
def row_gaps(t, y, dy, mode, params, h, hdot):
    for i in range(len(h)):
        h[i], hdot[i] = y[i + 1] - y[i], dy[i + 1] - dy[i]


@on_event
def collide(t, y, mode, params, guard, direction):
    n = len(y) // 2
    a, b = n + guard, n + guard + 1
    if direction < 0 and params[n] == 1.0 and params[guard] == params[guard + 1]:
        swapped = y[a]
        y[a], y[b] = y[b], swapped
    elif direction < 0:
        share = (1.0 + params[n]) * (y[b] - y[a]) / (params[guard] + params[guard + 1])
        y[a], y[b] = y[a] + params[guard + 1] * share, y[b] - params[guard] * share
    return 0


@on_event
def collide_and_unlock(t, y, mode, params, guard, direction):
    n = len(y) // 2
    if direction < 0:
        a, b = n + guard, n + guard + 1
        mode[guard] = 1
        share = (1.0 + params[n]) * (y[b] - y[a]) / (params[guard] + params[guard + 1])
        y[a], y[b] = y[a] + params[guard + 1] * share, y[b] - params[guard] * share
    return 0


@cache
def row_of_balls(n: int, **options) -> System:
    """Return n balls on a line: params are masses, restitution, and rate of a spring to the origin.

    The spring's rate is per unit of mass. A gap's lock is +1 between impacts.
    """
    options = {"on_event": collide, **options}
    names = tuple(f"gap{i}" for i in range(n - 1))
    return System(
        row_field, guards=row_gaps, n_states=2 * n, guard_names=names, **options
    )
