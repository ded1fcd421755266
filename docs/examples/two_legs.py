"""A body of 1 kg on two springy legs 0.4 m apart: its tilt decides which lands."""

from hopdata.hybrid import System, field, guards, on_event, solve


@field
def body(t, y, mode, params, dy):  # y: height (m), tilt (rad), and their rates
    dy[0], dy[1], dy[2], dy[3] = y[2], y[3], -9.81, 0.0
    for leg, side in enumerate((-0.2, 0.2)):
        if mode[leg] > 0:  # this foot is down
            push = params[0] * (0.5 - y[0] - side * y[1])
            dy[2], dy[3] = dy[2] + push, dy[3] + 10.0 * side * push


@guards
def feet(
    t, y, dy, mode, params, h, hdot
):  # depth of each foot below the floor, and its rate
    for leg, side in enumerate((-0.2, 0.2)):
        h[leg], hdot[leg] = 0.5 - y[0] - side * y[1], -dy[0] - side * dy[1]


@on_event
def count(t, y, mode, params, guard, direction):
    mode[2] += direction > 0  # the scene's own integer: landings so far
    return 1 if mode[2] == 4 else 0


robot = System(
    body, feet, count, n_states=4, guard_names=("left", "right"), n_extra_modes=1
)
solution = solve(robot, (0.0, 10.0), [0.7, 0.01, 0.0, 0.0], params=[400.0], rtol=1e-9)
log = solution.events
for time, foot, direction in zip(log.time, log.guard, log.direction, strict=True):
    what = "lands" if direction > 0 else "lifts off"
    print(f"{time:.9f} s  {log.guard_names[foot]} foot {what}")
print(solution.message)
