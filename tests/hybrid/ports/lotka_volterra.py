"""Predators and prey with the rates of four processes as arguments."""

import numpy as np
from scipy.integrate import solve_ivp


def lotkavolterra(t, z, a, b, c, d):
    x, y = z
    return [a * x - b * x * y, -c * y + d * x * y]


cycles = solve_ivp(
    lotkavolterra,
    [0, 15],
    [10, 5],
    args=(1.5, 1, 3, 1),
    dense_output=True,
    rtol=1e-9,
    atol=1e-9,
)
t = np.linspace(0, 15, 300)
z = cycles.sol(t)
calmer = solve_ivp(
    lotkavolterra, [0, 15], [10, 5], args=(1.0, 0.5, 3, 1), rtol=1e-9, atol=1e-9
)
