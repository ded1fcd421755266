"""A damped oscillator backward in time, to times that are given, with limited steps."""

import numpy as np
from scipy.integrate import solve_ivp

omega, zeta = 2.0, 0.05


def damped(t, x):
    return x[1], -(omega**2) * x[0] - 2 * zeta * omega * x[1]


def through_zero(t, x):
    return x[0]


def at_five(t, x):
    return t - 5


through_zero.direction = 1
when = np.linspace(10, 0, 41)
came_from = solve_ivp(
    damped,
    [10, 0],
    np.array([1, 0]),
    t_eval=when,
    events=(through_zero, at_five),
    first_step=0.01,
    max_step=0.1,
    method="DOP853",
    dense_output=True,
    rtol=1e-9,
    atol=1e-9,
)
halfway = came_from.sol(came_from.t_events[1])
