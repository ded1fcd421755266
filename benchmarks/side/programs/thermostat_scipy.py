# ruff: noqa: ARG001, D100 (a program as a user writes it)
from scipy.integrate import solve_ivp


def room(t, y, heating):
    return 0.1 * (15.0 - y[0]) + heating


def cold(t, y, heating):
    return y[0] - 19.0


def warm(t, y, heating):
    return 21.0 - y[0]


cold.terminal, cold.direction = True, -1
warm.terminal, warm.direction = True, -1
t, y, heating = 0.0, [20.0], 1
while t < 60.0:
    part = solve_ivp(
        room, (t, 60.0), y, events=(cold, warm), args=(heating,), rtol=1e-9, atol=1e-12
    )
    t, y = part.t[-1], part.y[:, -1]
    if part.status == 1:
        heating = len(part.t_events[0])
print(*y)
