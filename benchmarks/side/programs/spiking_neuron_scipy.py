# ruff: noqa: ARG001, D100 (a program as a user writes it)
from scipy.integrate import solve_ivp


def membrane(t, y):
    v, u = y
    return 0.04 * v * v + 5.0 * v + 150.0 - u, 0.02 * (0.2 * v - u)


def threshold(t, y):
    return y[0] - 30.0


threshold.terminal, threshold.direction = True, 1
t, y = 0.0, [-65.0, -13.0]
while t < 200.0:
    part = solve_ivp(membrane, (t, 200.0), y, events=threshold, rtol=1e-9, atol=1e-12)
    t, y = part.t[-1], part.y[:, -1]
    if part.status == 1:
        y = [-65.0, y[1] + 8.0]
print(*y)
