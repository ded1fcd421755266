# ruff: noqa: ARG001, D100 (a program as a user writes it)
from sksundae.cvode import CVODE


def membrane(t, y, dy):
    v, u = y
    dy[0], dy[1] = 0.04 * v * v + 5.0 * v + 150.0 - u, 0.02 * (0.2 * v - u)


def threshold(t, y, h):
    h[0] = y[0] - 30.0


threshold.terminal, threshold.direction = [True], [1]
neuron = CVODE(
    membrane, method="Adams", rtol=1e-9, atol=1e-12, eventsfn=threshold, num_events=1,
    max_num_steps=10_000,
)  # fmt: skip
t, y = 0.0, [-65.0, -13.0]
while t < 200.0:
    neuron.init_step(t, y)
    part = neuron.step(200.0, tstop=200.0)
    t, y = part.t, part.y
    if t < 200.0:
        y[:] = -65.0, y[1] + 8.0
print(*y)
