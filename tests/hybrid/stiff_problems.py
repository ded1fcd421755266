"""Stiff problems of two states with exact solutions: params[0] selects one, params[1] stiffens.

All share one field, so that the tests spend little time compiling.
"""

from __future__ import annotations

import mpmath
import numpy as np
from method_harness import Stepper, compiled, specialised

from hopdata.hybrid.methods import stiff

SMOOTH, KAPS, FOLLOWER, CONTACT = 0.0, 1.0, 2.0, 3.0


@compiled
def field(t, y, mode, params, dy):
    a, b, rate = y[0], y[1], params[1]
    if params[0] == SMOOTH:  # exact: exp(sin t), 1 / (1 + t)
        dy[0] = a * np.cos(t) * b * (1.0 + t)
        dy[1] = -b * b + np.sin(a - np.exp(np.sin(t)))
    elif params[0] == KAPS:  # exact from (1, 1): exp(-2 t), exp(-t), however stiff
        dy[0] = -(rate + 2.0) * a + rate * b * b
        dy[1] = a - b - b * b
    elif params[0] == FOLLOWER:  # exact: sin t, exp(cos t)
        dy[0] = -rate * (a - np.sin(t)) + np.cos(t)
        dy[1] = -a * b
    else:  # a mass on a damper of this rate, a spring, and a square law
        dy[0] = b
        dy[1] = -params[2] - rate * b - params[3] * a - params[4] * a * a


@compiled
def jacobian(t, y, mode, params, jac):
    a, b, rate = y[0], y[1], params[1]
    if params[0] == SMOOTH:
        swing = np.cos(a - np.exp(np.sin(t)))
        jac[0, 0], jac[0, 1] = np.cos(t) * b * (1.0 + t), a * np.cos(t) * (1.0 + t)
        jac[1, 0], jac[1, 1] = swing, -2.0 * b
    elif params[0] == KAPS:
        jac[0, 0], jac[0, 1] = -(rate + 2.0), 2.0 * rate * b
        jac[1, 0], jac[1, 1] = 1.0, -1.0 - 2.0 * b
    elif params[0] == FOLLOWER:
        jac[0, 0] = -rate
        jac[1, 0], jac[1, 1] = -b, -a
    else:
        jac[0, 1] = 1.0
        jac[1, 0], jac[1, 1] = -params[3] - 2.0 * params[4] * a, -rate


def exact(params, t):
    """Return the solution of the first three problems."""
    solutions = {
        SMOOTH: (np.exp(np.sin(t)), 1.0 / (1.0 + t)),
        KAPS: (np.exp(-2.0 * t), np.exp(-t)),
        FOLLOWER: (np.sin(t), np.exp(np.cos(t))),
    }
    return np.array(solutions[params[0]])


def damped_contact(weight, damping, stiffness, y, t):
    """Return the solution of the contact without its square law, in 40 digits."""
    with mpmath.workdps(40):
        half, k = mpmath.mpf(damping) / 2, mpmath.mpf(stiffness)
        root = mpmath.sqrt(half**2 - k)
        slow, fast = -k / (half + root), -half - root
        rest = -mpmath.mpf(weight) / k
        c1 = (mpmath.mpf(y[1]) - fast * (mpmath.mpf(y[0]) - rest)) / (slow - fast)
        c2 = mpmath.mpf(y[0]) - rest - c1
        e1, e2 = c1 * mpmath.exp(slow * t), c2 * mpmath.exp(fast * t)
        return np.array([float(rest + e1 + e2), float(slow * e1 + fast * e2)])


CODES = {}


def made(given):
    names = {"FIELD": field, "JACOBIAN": jacobian, "N": 2}
    template = stiff.jacobian_by_user if given else stiff.jacobian_by_differences
    return Stepper(
        stiff, field, 2,
        FILL_JACOBIAN=specialised(template, **names),
        TIME_DERIVATIVE=specialised(stiff.time_derivative, **names),
        PREPARE=specialised(stiff.prepare_dense, **names),
        SOLVE=specialised(stiff.solve_dense, **names),
    )  # fmt: skip


def stepper(params, t, y, *, given=True, rtol=1e-9, atol=1e-12):
    """Return a Rosenbrock stepper at (t, y), with the Jacobian given or by differences."""
    if given not in CODES:
        CODES[given] = made(given)
    one = CODES[given]
    one.s[:] = np.nan
    one.params, one.rtol = np.array(params, dtype=float), rtol
    one.atol = np.full(2, atol) if np.isscalar(atol) else np.array(atol)
    one.start(t, y)
    return one
