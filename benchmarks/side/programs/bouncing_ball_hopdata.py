# ruff: noqa: ARG001, D100 (a program as a user writes it)
from hopdata.hybrid import System, solve


def fall(t, y):
    return y[1], -9.8


def floor(t, y):
    return y[0]


def bounce(t, y):
    return y[0], -0.8 * y[1]


ball = System(fall, floor, bounce, n_states=2, directions=(-1,), guard_names=("floor",))
print(*solve(ball, (0.0, 25.0), [50.0, 0.0]).y_end)
