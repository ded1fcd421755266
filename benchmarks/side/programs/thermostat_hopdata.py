# ruff: noqa: ARG001, D100 (a program as a user writes it)
from hopdata.hybrid import System, solve


def room(t, y, mode):
    return 0.1 * (15.0 - y[0]) + mode[2]


def thresholds(t, y):
    return y[0] - 19.0, 21.0 - y[0]


def switch(t, y, mode, guard):
    mode[2] = 1 - guard


thermostat = System(
    room, thresholds, switch, n_states=1, guard_names=("cold", "warm"), n_extra_modes=1,
    directions=(-1, -1),
)  # fmt: skip
print(*solve(thermostat, (0.0, 60.0), [20.0], mode=[1]).y_end)
