"""Compiled systems of the stress cases: a few that vary by their parameters.

`selected`: an affine field for each mode, plane guards. `swinging`: one affine field
that is declared as such, one plane guard. `clock`: a clock x and an integral z of the
locks, with guards that are chosen functions of x. `mass`: a mass on a floor with spring
and damper.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.hybrid import System, affine, field, guards, on_event

POWER, JUMP, SINE, PAIR, BOWL, TIME = range(6)  # kinds of the clock's guards


def names(count: int) -> tuple[str, ...]:
    """Return names of guards."""
    return tuple(f"g{k}" for k in range(count))


# params: 1 if affine, offsets (K), normals (K, n), constants (2^K, n), matrices (2^K,
# n, n)


@field
def selected_field(t, y, mode, params, dy):
    n, count, row = len(y), len(mode), 0
    for k in range(count):
        if mode[k] > 0:
            row += 1 << k
    constants = 1 + count * (n + 1)
    matrices = constants + (1 << count) * n
    for i in range(n):
        dy[i] = params[constants + row * n + i]
        if params[0] > 0.0:
            for j in range(n):
                dy[i] += params[matrices + (row * n + i) * n + j] * y[j]


@guards
def selected_guards(t, y, dy, mode, params, h, hdot):
    n, count = len(y), len(h)
    for k in range(count):
        h[k], hdot[k] = -params[1 + k], 0.0
        for i in range(n):
            normal = params[1 + count + k * n + i]
            h[k] += normal * y[i]
            hdot[k] += normal * dy[i]


@cache
def selected(
    n_states: int, n_guards: int, terminal: tuple[bool, ...] | None = None
) -> System:
    """Return an affine field for each set of locks; guard k is the plane normal.y = offset."""
    return System(
        selected_field, selected_guards, n_states=n_states, guard_names=names(n_guards),
        terminal=terminal,
    )  # fmt: skip


def selected_params(
    offsets: ArrayLike,
    normals: ArrayLike,
    constants: ArrayLike,
    matrices: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Return params of `selected`; a mode's row is the sum of 2^k over the locks k that are +1."""
    parts = [[matrices is not None], offsets, normals, constants]
    parts += [] if matrices is None else [matrices]
    return np.concatenate(
        [np.ravel(np.asarray(part, dtype=np.float64)) for part in parts]
    )


# params: matrix (n, n), constant (n), normal (n), offset


@field
def swinging_field(t, y, mode, params, dy):
    n = len(y)
    for i in range(n):
        dy[i] = params[n * n + i]
        for j in range(n):
            dy[i] += params[i * n + j] * y[j]


@affine
def swinging_affine(mode, params, a, b):
    n = len(b)
    for i in range(n):
        b[i] = params[n * n + i]
        for j in range(n):
            a[i, j] = params[i * n + j]


@guards
def swinging_guard(t, y, dy, mode, params, h, hdot):
    n = len(y)
    normal = n * (n + 1)
    h[0], hdot[0] = -params[normal + n], 0.0
    for i in range(n):
        h[0] += params[normal + i] * y[i]
        hdot[0] += params[normal + i] * dy[i]


@cache
def swinging(n_states: int) -> System:
    """Return y' = A y + b, with the plane normal.y = offset as its guard."""
    return System(
        swinging_field, swinging_guard, affine=swinging_affine, n_states=n_states,
        guard_names=names(1),
    )  # fmt: skip


# params: (kind, a, b, c) of each guard, gains (K), increment of x by the handler


@field
def clock_field(t, y, mode, params, dy):
    count = len(params) // 5
    dy[0], dy[1] = 1.0, 0.0
    for k in range(count):
        if mode[k] > 0:
            dy[1] += params[4 * count + k]


@guards
def clock_guards(t, y, dy, mode, params, h, hdot):
    for k in range(len(h)):
        kind, a, b, c = (
            int(params[4 * k]),
            params[4 * k + 1],
            params[4 * k + 2],
            params[4 * k + 3],
        )
        x = y[0] - a
        if kind == POWER:
            h[k], hdot[k] = c * x ** int(b), c * b * x ** (int(b) - 1) * dy[0]
        elif kind == JUMP:
            h[k], hdot[k] = (b if x >= 0.0 else -b) + c * x, c * dy[0]
        elif kind == SINE:
            h[k], hdot[k] = np.sin(b * x) - c, b * np.cos(b * x) * dy[0]
        elif kind == PAIR:
            h[k], hdot[k] = c * x * (x - b), c * (2.0 * x - b) * dy[0]
        elif kind == BOWL:
            h[k], hdot[k] = b * x * x - c, 2.0 * b * x * dy[0]
        else:
            h[k], hdot[k] = np.sin(b * (t - a)) - c, b * np.cos(b * (t - a))


@on_event
def push(t, y, mode, params, guard, direction):
    count = (len(params) - 1) // 5
    if guard == 0 and mode[count] == 0:  # once
        mode[count] = 1
        y[0] += params[5 * count]
    return 0


@cache
def clock(n_guards: int, terminal: tuple[bool, ...] | None = None) -> System:
    """Return x' = 1, z' = the sum of the gains of the locks that are +1."""
    return System(
        clock_field,
        clock_guards,
        n_states=2,
        guard_names=names(n_guards),
        terminal=terminal,
    )


@cache
def pushed_clock(n_guards: int) -> System:
    """Return a clock whose handler advances it once, when guard 0 is first crossed."""
    return System(
        clock_field,
        clock_guards,
        push,
        n_states=2,
        guard_names=names(n_guards),
        n_extra_modes=1,
    )


def clock_params(
    kinds: Sequence[tuple[float, float, float, float]], gains: Sequence[float]
) -> NDArray[np.float64]:
    """Return params of `clock`."""
    return np.concatenate([np.ravel(kinds), gains])


# params: gravity, stiffness / mass, damping / mass


@field
def mass_field(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], -params[0]
    if mode[0] > 0:
        dy[1] -= params[1] * y[0] + params[2] * y[1]


@guards
def mass_guards(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = -y[0], -dy[0]


@cache
def mass() -> System:
    """Return a mass at height y[0] above a floor; below 0, spring and damper act."""
    return System(mass_field, mass_guards, n_states=2, guard_names=("floor",))


@field
def rotor_field(t, y, mode, params, dy):
    dy[0], dy[1] = -params[0] * y[1], params[0] * y[0]
    dy[2] = 1.0 + (params[2] if mode[0] > 0 else 0.0)


@guards
def rotor_guards(t, y, dy, mode, params, h, hdot):
    # The Chebyshev polynomial of order params[1] of cos: the cosine of that multiple of
    # the angle.
    before, value, slope_before, slope = 1.0, y[0], 0.0, 1.0
    for _ in range(int(params[1]) - 1):
        before, value, slope_before, slope = (
            value, 2.0 * y[0] * value - before,
            slope, 2.0 * value + 2.0 * y[0] * slope - slope_before,
        )  # fmt: skip
    h[0], hdot[0] = value, slope * dy[0]


@cache
def rotor() -> System:
    """Return (cos, sin) of the angle params[0] t; the guard is cos(params[1] angle)."""
    return System(rotor_field, rotor_guards, n_states=3, guard_names=("cosine",))
