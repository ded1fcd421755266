# ruff: noqa: RUF059 (as people write it)
"""A ball that loses a tenth of its speed at each bounce, restarted in a loop."""

import numpy as np
from scipy.integrate import solve_ivp

g = 9.81
restitution = 0.9


def fall(t, y):
    height, velocity = y
    return np.array([velocity, -g])


def floor(t, y):
    return y[0]


floor.terminal = True
floor.direction = -1

time, state = 0.0, [2.0, 0.0]
bounces = []
while time < 4.0:
    flight = solve_ivp(fall, (time, 4.0), state, events=floor, max_step=0.2)
    time = flight.t[-1]
    if flight.status == 1:
        bounces.append(time)
        state = [0.0, -restitution * flight.y[1, -1]]
number = np.array([len(bounces)])
instants = np.array(bounces)
