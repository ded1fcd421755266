"""A planar hopper learns to hop faster and higher: leg angles and thrusts of six hops.

A body of 1 kg on a massless springy leg of 1 m. In flight the leg is held at an angle,
in stance it pushes harder while it extends. Each hop has its own angle and thrust. An
optimiser finds all twelve from one gradient per trial, through 24 contacts and apexes.
"""

import numpy as np
from scipy.optimize import minimize

from hopdata.hybrid import System, field, guards, on_event
from hopdata.hybrid.gradients import gradient

HOPS = 6
SPEED, HEIGHT = 3.5, 1.15  # wanted at the last apex, m/s and m
STIFFNESS = 250.0  # N/m


@field
def hopper(t, y, mode, params, dy):  # x, z (m), their rates, and x of the foot
    dy[0], dy[1], dy[2], dy[3], dy[4] = y[2], y[3], 0.0, -9.81, 0.0
    if mode[0] > 0:  # the foot is down
        along, up = y[0] - y[4], y[1]
        length = np.hypot(along, up)
        rate = (along * y[2] + up * y[3]) / length
        extends = 0.5 * (1.0 + np.tanh(5.0 * rate))
        force = STIFFNESS * (1.0 - length) + params[HOPS + mode[4]] * extends
        dy[2] += force * along / length
        dy[3] += force * up / length


@guards
def surfaces(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = -1.0, 0.0  # the leg is folded from lift-off to the apex
    if mode[0] > 0:  # how much the leg is compressed
        along, up = y[0] - y[4], y[1]
        length = np.hypot(along, up)
        h[0], hdot[0] = 1.0 - length, -(along * dy[0] + up * dy[1]) / length
    elif mode[3] > 0:  # how deep the foot is
        h[0], hdot[0] = np.cos(params[mode[4]]) - y[1], -dy[1]
    h[1], hdot[1] = -y[3], -dy[3]  # the body sinks: an apex
    h[2], hdot[2] = 0.5 - y[1], -dy[1]  # it has fallen


@on_event
def change(t, y, mode, params, guard, direction):
    if guard == 0 and direction > 0:
        y[4] = y[0] + np.sin(params[mode[4]])
    elif guard == 0:
        mode[3] = 0  # the leg is folded
    elif guard == 1 and mode[3] == 0:
        mode[3] = 1  # and held out for the next hop
        mode[4] += 1
        if mode[4] == HOPS:
            return 1
    return 0


robot = System(
    hopper, surfaces, change, n_states=5, guard_names=("leg", "apex", "fallen"),
    directions=(0, 1, 1), terminal=(False, False, True), n_extra_modes=2,
)  # fmt: skip
start = [0.0, 1.05, 2.5, 0.0, 0.0]  # at an apex, with the leg held out


def miss(t, y, params):
    effort = 0.0
    for hop in range(HOPS):
        effort += params[HOPS + hop] ** 2
    return (y[2] - SPEED) ** 2 + 10.0 * (y[1] - HEIGHT) ** 2 + 1e-5 * effort


def stumble(t, before, after, guard, direction, params):
    if guard != 1:
        return 0.0
    low = max(1.02 - before[1], 0.0)  # too low an apex to swing the leg, m
    return 100.0 * low * low


def trial(params):
    """Return the miss of the speed and the height, with its derivatives."""
    return gradient(
        robot, (0.0, 10.0), start, params=params, mode=[1, 0],
        at_end=miss, at_event=stumble, rtol=1e-8,
    )  # fmt: skip


guess = np.array([0.26] * HOPS + [0.0] * HOPS)  # rad, N
before = trial(guess)


def cost(params):
    tried = trial(params)
    return tried.value, tried.by_params


best = minimize(
    cost, guess, jac=True, method="L-BFGS-B",
    bounds=[(0.1, 0.5)] * HOPS + [(0.0, 40.0)] * HOPS,
    options={"maxiter": 60},
)  # fmt: skip
after = trial(best.x)
for name, one in (("guess", before), ("found", after)):
    speed, height = one.solution.y_end[2], one.solution.y_end[1]
    print(f"{name}: {speed:.3f} m/s, {height:.3f} m, miss {one.value:.2e}")
print(f"{best.nfev} trials; angles {best.x[:HOPS].round(3)}")
print(f"thrusts {best.x[HOPS:].round(2)}")
