# ruff: noqa: ARG001, D100 (a program as a user writes it)
from sksundae.cvode import CVODE

heating = [1.0]


def room(t, y, dy):
    dy[0] = 0.1 * (15.0 - y[0]) + heating[0]


def thresholds(t, y, h):
    h[0], h[1] = y[0] - 19.0, 21.0 - y[0]


thresholds.terminal, thresholds.direction = [True, True], [-1, -1]
thermostat = CVODE(
    room, method="Adams", rtol=1e-9, atol=1e-12, eventsfn=thresholds, num_events=2
)
t, y = 0.0, [20.0]
while t < 60.0:
    thermostat.init_step(t, y)
    part = thermostat.step(60.0, tstop=60.0)
    t, y = part.t, part.y
    heating[0] = 1.0 - heating[0]
print(*y)
