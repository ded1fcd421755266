"""The tangents of short steps run as plain Python, on a linear equation that is known."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.driver.layout import PHI_MOTION, PHI_ROWS
from hopdata.hybrid.methods import motion, products, short_tangent

N = 3
CONSTANT, VARYING = np.random.default_rng(7).normal(size=(2, N, N))
ROWS = (3 + short_tangent.BLOCKS) * N + PHI_ROWS
BEGIN = 0.3  # s


def derivative(t):
    return CONSTANT + np.sin(3.0 * t) * VARYING


def stage_jacobian(t, dt, rtol, s, mode, params, atol, phi):
    phi[N : 2 * N] = derivative(t)


def plain_fma(a, b, c):
    """The product and sum of compiled code, for plain Python: rounded twice."""
    return a * b + c


class Table(np.ndarray):
    """A table whose rows may be run over, as in compiled code: entry e of a block."""

    def __getitem__(self, at):
        if isinstance(at, tuple):
            row, column = at
            return self.reshape(-1).view(np.ndarray)[row * N + column]
        return super().__getitem__(at)

    def __setitem__(self, at, value):
        if isinstance(at, tuple):
            self.reshape(-1).view(np.ndarray)[at[0] * N + at[1]] = value
        else:
            super().__setitem__(at, value)


def flow(template, dt, rtol=1e-6):
    """The flow's Jacobian over dt, its error by its own account, and the motion squared."""
    names = {"STAGE_JACOBIAN": stage_jacobian, "N": N}
    add = with_digest(products.add_product_numbers, N=N, fma=plain_fma)
    names["FASTEST_MOTION"] = with_digest(motion.fastest_motion, N=N)
    step = with_digest(template, ADD_PRODUCT=add, **names)
    phi = np.zeros((ROWS, N)).view(Table)
    phi[:N] = np.eye(N)
    error = step(BEGIN, dt, rtol, np.zeros((40, N)), None, None, None, phi)
    return np.array(phi[N : 2 * N]), error, phi[3 * N + PHI_MOTION, 0]


def exact_flow(dt):
    def rates(t, phi):
        return (derivative(t) @ phi.reshape(N, N)).ravel()

    span = (BEGIN, BEGIN + dt)
    solution = solve_ivp(rates, span, np.eye(N).ravel(), rtol=1e-13, atol=1e-14, method="DOP853")
    return solution.y[:, -1].reshape(N, N)


def error_of(template, dt):
    """Largest error of the flow's Jacobian over dt."""
    return np.abs(flow(template, dt)[0] - exact_flow(dt)).max()
