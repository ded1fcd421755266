# ruff: noqa: ARG001, D100 (a program as a user writes it)
from scipy.integrate import solve_ivp


def fall(t, y):
    return y[1], -9.8


def floor(t, y):
    return y[0]


floor.terminal, floor.direction = True, -1
t, y = 0.0, [50.0, 0.0]
while t < 25.0:
    part = solve_ivp(fall, (t, 25.0), y, events=floor, rtol=1e-9, atol=1e-12)
    t, y = part.t[-1], part.y[:, -1]
    if part.status == 1:
        y[1] = -0.8 * y[1]
print(*y)
