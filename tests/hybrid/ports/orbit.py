"""An eccentric orbit: passages of the pericentre, and five revolutions."""

import numpy as np
from scipy.integrate import solve_ivp

GM = 1.0


def two_body(t, state):
    r = state[:2]
    v = state[2:]
    a = -GM * r / np.linalg.norm(r) ** 3
    return np.concatenate((v, a))


def pericentre(t, state):
    x, y, vx, vy = state
    return x * vx + y * vy


pericentre.direction = 1


def fifth_revolution(t, state):
    return state[1]


fifth_revolution.direction = 1
fifth_revolution.terminal = 5

start = [1.2, 0.3, -0.2, 0.7]
orbit = solve_ivp(
    two_body,
    (0.0, 100.0),
    start,
    method="DOP853",
    events=[pericentre, fifth_revolution],
    rtol=1e-10,
    atol=1e-10,
)
