"""A pendulum among many guards, evaluated together or one by one, and a damped landing.

The pendulum's parameters are its drive and, for each guard, its position, its tilt
towards the speed, its sway with time, and the gain of the torque beyond it. With these
parameters, one compiled field serves for Jacobians, batches, and guards that sleep.
"""

from __future__ import annotations

import numpy as np

from hopdata.hybrid import (
    System,
    affine,
    field,
    guard,
    guards,
    jacobian,
    on_event,
    rate_bound,
)


@field
def bent_field(t, y, mode, params, dy):
    n = (len(params) - 1) // 4
    torque = params[0] * np.cos(2.0 * t) - np.sin(y[0])
    for k in range(n):
        if mode[k] > 0:
            torque += params[1 + 3 * n + k] * (1.0 + y[0] * y[1])
    dy[0] = y[1]
    dy[1] = torque


@jacobian
def bent_jacobian(t, y, mode, params, jac):
    n = (len(params) - 1) // 4
    jac[0, 1] = 1.0
    jac[1, 0] = -np.cos(y[0])
    for k in range(n):
        if mode[k] > 0:
            jac[1, 0] += params[1 + 3 * n + k] * y[1]
            jac[1, 1] += params[1 + 3 * n + k] * y[0]


@guards
def bent_guards(t, y, dy, mode, params, h, hdot):
    n = len(h)
    for k in range(n):
        place, tilt, sway = params[1 + k], params[1 + n + k], params[1 + 2 * n + k]
        h[k] = y[0] + tilt * y[1] - place - sway * np.sin(t)
        hdot[k] = dy[0] + tilt * dy[1] - sway * np.cos(t)


@guard
def bent_guard(t, y, dy, mode, params, k, h, hdot):
    n = (len(params) - 1) // 4
    place, tilt, sway = params[1 + k], params[1 + n + k], params[1 + 2 * n + k]
    h[k] = y[0] + tilt * y[1] - place - sway * np.sin(t)
    hdot[k] = dy[0] + tilt * dy[1] - sway * np.cos(t)


@rate_bound
def bent_bound(t, y, dy, mode, params):
    n = (len(params) - 1) // 4
    tilt, sway = 0.0, 0.0
    for k in range(n):
        tilt = max(tilt, abs(params[1 + n + k]))
        sway = max(sway, abs(params[1 + 2 * n + k]))
    return abs(dy[0]) + tilt * abs(dy[1]) + sway


@on_event
def turn_back(t, y, mode, params, guard, direction):
    """Reflect the speed where a guard with a tilt above 1 is crossed upwards."""
    n = (len(params) - 1) // 4
    if params[1 + n + guard] > 1.0 and direction > 0:
        y[1] = -y[1]
    return 0


def names(n):
    return tuple(f"bar{k}" for k in range(n))


def bent(n: int, **options) -> System:
    """Return the pendulum, state (angle, speed), with all guards in one function."""
    return System(
        bent_field, bent_guards, options.pop("on_event", None), n_states=2, guard_names=names(n),
        **options,
    )  # fmt: skip


def bent_sparse(n: int, **options) -> System:
    """Return the pendulum with guards evaluated one by one, which sleep when far away."""
    bound = options.pop("rate_bound", bent_bound)
    return System(
        bent_field,
        guard=bent_guard,
        rate_bound=bound,
        n_states=2,
        guard_names=names(n),
        **options,
    )


def bent_params(places, *, drive=0.0, tilts=0.0, sways=0.0, gains=0.0):
    n = len(places)
    columns = [
        np.broadcast_to(np.asarray(c, dtype=float), n) for c in (tilts, sways, gains)
    ]
    return np.concatenate([[drive], places, *columns])


@field
def landing_field(t, y, mode, params, dy):
    damping, stiffness = params[0], params[1]
    dy[0] = y[1]
    dy[1] = -9.81 - 400.0 * y[0] if mode[1] > 0 else -9.81
    if mode[0] > 0 and mode[1] < 0:
        dy[1] -= damping * y[1] + stiffness * y[0]


@guards
def landing_guards(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = -y[0], -dy[0]
    h[1], hdot[1] = t - params[2], 1.0


def landing() -> System:
    """Return a mass that falls onto a damper and a spring, which are removed at time params[2].

    From then on it oscillates about another height at 20 radians per second.
    """
    return System(
        landing_field, landing_guards, n_states=2, guard_names=("floor", "release")
    )


@affine
def landing_affine(mode, params, a, b):
    a[0, 1] = 1.0
    b[1] = -9.81
    if mode[1] > 0:
        a[1, 0] = -400.0
    elif mode[0] > 0:
        a[1, 0], a[1, 1] = -params[1], -params[0]
    if mode[1] < 0 and params[3] > 0.0:
        b[1] = -9.0  # differs from `landing_field`


def affine_landing() -> System:
    """Return it with its affine form, which is wrong before the release if params[3] is not 0."""
    return System(
        landing_field, landing_guards, affine=landing_affine, n_states=2,
        guard_names=("floor", "release"),
    )  # fmt: skip
