# ruff: noqa: ARG001, D100 (a program as a user writes it)
from sksundae.cvode import CVODE


def fall(t, y, dy):
    dy[0], dy[1] = y[1], -9.8


def floor(t, y, h):
    h[0] = y[0]


floor.terminal, floor.direction = [True], [-1]
ball = CVODE(fall, method="Adams", rtol=1e-9, atol=1e-12, eventsfn=floor, num_events=1)
t, y = 0.0, [50.0, 0.0]
while t < 25.0:
    ball.init_step(t, y)
    part = ball.step(25.0, tstop=25.0)
    t, y = part.t, part.y
    if t < 25.0:
        y[1] = -0.8 * y[1]
print(*y)
