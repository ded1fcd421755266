"""A capacitor that a relay charges and discharges between two thresholds."""

import numpy as np
from scipy.integrate import solve_ivp

R, C, SUPPLY = 10e3, 100e-6, 5.0
LOW, HIGH = 1.0, 4.0


def charge(t, v):
    return (SUPPLY - v[0]) / (R * C)


def discharge(t, v):
    return -v[0] / (R * C)


def is_high(t, v):
    return v[0] - HIGH


def is_low(t, v):
    return v[0] - LOW


is_high.terminal = is_low.terminal = True

t, v = 0.0, [0.0]
switched = []
while len(switched) < 8:
    charging = len(switched) % 2 == 0
    field, event = (charge, is_high) if charging else (discharge, is_low)
    part = solve_ivp(field, (t, t + 10.0), v, events=event, rtol=1e-9, atol=1e-12)
    t, v = part.t[-1], part.y[:, -1]
    switched.append(t)
periods = np.diff(switched)
