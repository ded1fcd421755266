# ruff: noqa: RUF059 (as people write it)
"""An epidemic: the day on which most are ill, with and without measures."""

import numpy as np
from scipy.integrate import solve_ivp

N = 10_000


def deriv(t, y, N, beta, gamma):
    S, I, R = y  # noqa: E741
    new = beta * S * I / N
    dSdt = -new
    dIdt = new - gamma * I
    dRdt = gamma * I
    return dSdt, dIdt, dRdt


def peak(t, y, N, beta, gamma):
    return deriv(t, y, N, beta, gamma)[1]


peak.direction = -1
peaks = []
runs = []
for beta in (0.5, 0.25):
    run = solve_ivp(
        deriv,
        (0, 160),
        (N - 1, 1, 0),
        args=(N, beta, 1.0 / 10),
        events=peak,
        t_eval=np.arange(0, 161),
        method="LSODA",
        rtol=1e-8,
        atol=1e-8,
    )
    runs.append(run)
    peaks.append(run.t_events[0][0])
first, second = runs
days = np.array(peaks)
