"""Large systems with sparse Jacobians and exact solutions, shared by the tests."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from hopdata.hybrid import field, guards, jacobian, on_event


@field
def rod(t, y, mode, params, dy):
    """Heat in a rod between two ends at 0; params[0] is the distance of two points."""
    n = len(y)
    rate = 1.0 / params[0] ** 2
    for i in range(n):
        left = y[i - 1] if i > 0 else 0.0
        right = y[i + 1] if i < n - 1 else 0.0
        dy[i] = rate * (left - 2.0 * y[i] + right)


@jacobian
def rod_by_diagonals(t, y, mode, params, jac):
    n = len(y)
    rate = 1.0 / params[0] ** 2
    for i in range(n):
        jac[1, i] = -2.0 * rate
        if i > 0:
            jac[0, i] = rate
            jac[2, i - 1] = rate


@jacobian
def rod_by_entries(t, y, mode, params, jac):
    rate = 1.0 / params[0] ** 2
    k = 0
    for i in range(len(y)):
        for j in range(max(0, i - 1), min(len(y), i + 2)):
            jac[0, k] = -2.0 * rate if i == j else rate
            k += 1


def rod_start(n, modes=(1, 3)):
    """Return parameters, the start, and the exact state as a function of time."""
    gap = 1.0 / (n + 1)
    x = gap * np.arange(1, n + 1)
    shapes = [np.sin(np.pi * m * x) for m in modes]
    rates = [-4.0 / gap**2 * np.sin(0.5 * np.pi * m * gap) ** 2 for m in modes]

    def exact(t):
        return sum(
            np.exp(rate * t) * shape for rate, shape in zip(rates, shapes, strict=True)
        )

    return [gap], exact(0.0), exact


@field
def ring(t, y, mode, params, dy):
    """Heat in a closed ring."""
    n = len(y)
    for i in range(n):
        dy[i] = n * n * (y[i - 1] - 2.0 * y[i] + y[(i + 1) % n])


def ring_pattern(n):
    return sparse.diags_array(
        np.ones((5, 1)) * np.ones(n),
        offsets=[-n + 1, -1, 0, 1, n - 1],
        shape=(n, n),
    )


@field
def membrane(t, y, mode, params, dy):
    """Waves on a square of params[0] points a side: heights, then velocities.

    params[1] is the stiffness between two points.
    """
    m = int(params[0])
    n = m * m
    for i in range(m):
        for j in range(m):
            k = i * m + j
            pull = -4.0 * y[k]
            if i > 0:
                pull += y[k - m]
            if i < m - 1:
                pull += y[k + m]
            if j > 0:
                pull += y[k - 1]
            if j < m - 1:
                pull += y[k + 1]
            dy[k] = y[n + k]
            dy[n + k] = params[1] * pull - params[2] * y[n + k]


def grid_pattern(m):
    """Return the pattern of five points on a grid."""
    along = sparse.diags_array(np.ones((3, m)), offsets=[-1, 0, 1], shape=(m, m))
    one = sparse.eye_array(m)
    return sparse.kron(along, one) + sparse.kron(one, along)


def membrane_pattern(m):
    one = sparse.eye_array(m * m)
    return sparse.block_array([[None, one], [grid_pattern(m), one]])


@field
def network(t, y, mode, params, dy):
    """Relaxation to a nonlinear balance; params: rates, and three neighbours of each."""
    n = len(y)
    for i in range(n):
        a = int(params[2 * n + i])
        b = int(params[3 * n + i])
        dy[i] = params[i] * (params[n + i] * np.sin(y[a]) * y[b] - y[i]) + np.cos(t)


def network_of(seed, n):
    """Return parameters, pattern and start of a random network."""
    draw = np.random.default_rng(np.random.SeedSequence(seed))
    rates = 10.0 ** draw.uniform(0.0, 4.0, n)
    gains = draw.uniform(-0.5, 0.5, n)
    neighbours = draw.integers(0, n, (2, n))
    places = np.arange(n)
    pattern = np.eye(n, dtype=bool)
    pattern[places, neighbours[0]] = True
    pattern[places, neighbours[1]] = True
    params = np.concatenate([rates, gains, neighbours.ravel()])
    return params, pattern, draw.uniform(-1.0, 1.0, n)


@guards
def cooling(t, y, dy, mode, params, h, hdot):
    """The middle of the rod falls below params[1]."""
    middle = len(y) // 2
    h[0] = y[middle] - params[1]
    hdot[0] = dy[middle]


@field
def heated_rod(t, y, mode, params, dy):
    """The rod, heated in its middle third while mode[2] is 1."""
    n = len(y)
    rate = 1.0 / params[0] ** 2
    for i in range(n):
        left = y[i - 1] if i > 0 else 0.0
        right = y[i + 1] if i < n - 1 else 0.0
        dy[i] = rate * (left - 2.0 * y[i] + right)
        if mode[2] == 1 and n <= 3 * i < 2 * n:
            dy[i] += 40.0


@guards
def thermostat(t, y, dy, mode, params, h, hdot):
    middle = len(y) // 2
    h[0] = 1.0 - y[middle]
    h[1] = y[middle] - 1.2
    hdot[0] = -dy[middle]
    hdot[1] = dy[middle]


@on_event
def switch(t, y, mode, params, guard, direction):
    mode[2] = 1 if guard == 0 else 0
    return 0
