"""A cannon ball shot upwards: its apex, and where it lands."""

from scipy.integrate import solve_ivp


def upward_cannon(t, y):
    return [y[1], -9.81]


def hit_ground(t, y):
    return y[0]


hit_ground.terminal = True
hit_ground.direction = -1


def apex(t, y):
    return y[1]


shot = solve_ivp(
    upward_cannon, [0, 100], [0, 50], events=(hit_ground, apex), dense_output=True
)
highest = shot.sol(shot.t_events[1][0])
