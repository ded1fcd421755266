# ruff: noqa: ARG005, RET504 (as people write it)
"""A damped pendulum: when it passes its lowest point, and its turning points."""

import numpy as np
from scipy.integrate import solve_ivp


def pend(t, y, b, c):
    theta, omega = y
    dydt = [omega, -b * omega - c * np.sin(theta)]
    return dydt


b = 0.25
c = 5.0
passes = lambda t, y, *args: y[0]  # noqa: E731 (as people write it)
turns = lambda t, y, *args: y[1]  # noqa: E731
turns.direction = -1
swings = solve_ivp(
    pend,
    (0, 10),
    [np.pi - 0.1, 0.1],
    args=(b, c),
    events=[passes, turns],
    t_eval=np.linspace(0, 10, 101),
    rtol=1e-9,
    atol=1e-9,
)
