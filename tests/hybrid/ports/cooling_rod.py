"""A rod that cools from one end, in 12 pieces: a linear stiff system."""

import numpy as np
from scipy.integrate import solve_ivp

n = 12
k = 400.0
A = k * (
    np.diag(-2 * np.ones(n)) + np.diag(np.ones(n - 1), 1) + np.diag(np.ones(n - 1), -1)
)


def heat(t, u):
    dudt = np.zeros_like(u)
    for i in range(n):
        left = u[i - 1] if i > 0 else 0.0
        right = u[i + 1] if i < n - 1 else 0.0
        dudt[i] = k * (left - 2 * u[i] + right)
    return dudt


def half_cold(t, u):
    return np.max(u) - 0.5


half_cold.terminal = True
rod = solve_ivp(
    heat, (0, 1), np.ones(n), "Radau", events=half_cold, jac=A, rtol=1e-8, atol=1e-10
)
