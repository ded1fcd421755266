"""Two tanks in a row; the inflow is shut when the lower one is full for the second time."""

import numpy as np
from scipy.integrate import solve_ivp


def tanks(t, h, inflow, areas):
    out = np.sqrt(np.maximum(h, 0.0))
    feed = inflow * (1.0 + np.sin(t))
    return np.array([(feed - out[0]) / areas[0], (out[0] - out[1]) / areas[1]])


def full(t, h, inflow, areas):
    return h[1] - 1.1


def turns(t, h, inflow, areas):
    return tanks(t, h, inflow, areas)[0]


events = [full, turns]
events[0].terminal = 2
events[0].direction = 1
turns.direction = -1.0
areas = np.array([1.0, 0.5])
filled = solve_ivp(
    tanks,
    (0, 40),
    [0.5, 0.2],
    events=events,
    args=(1.0, areas),
    vectorized=True,
    rtol=1e-8,
    atol=1e-10,
)
