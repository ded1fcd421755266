# ruff: noqa: ARG001, D100 (a program as a user writes it)
from hopdata.hybrid import System, solve


def membrane(t, y):
    v, u = y
    return 0.04 * v * v + 5.0 * v + 150.0 - u, 0.02 * (0.2 * v - u)


def threshold(t, y):
    return y[0] - 30.0


def spike(t, y):
    return -65.0, y[1] + 8.0


neuron = System(
    membrane, threshold, spike, n_states=2, guard_names=("spike",), directions=(1,)
)
print(*solve(neuron, (0.0, 200.0), [-65.0, -13.0]).y_end)
