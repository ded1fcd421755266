"""The Lorenz system at given times, with parameters from an enclosing function."""

import numpy as np
from scipy.integrate import solve_ivp


def make_lorenz(sigma, rho, beta):
    def lorenz(t, xyz):
        x, y, z = xyz
        xdot = sigma * (y - x)
        ydot = rho * x - y - x * z
        zdot = x * y - beta * z
        return np.array([xdot, ydot, zdot])

    return lorenz


t_eval = np.linspace(0.0, 8.0, 161)
options = {"method": "DOP853", "t_eval": t_eval, "rtol": 1e-11, "atol": 1e-11}
chaotic = solve_ivp(make_lorenz(10.0, 28.0, 8 / 3), (0, 8), [1.0, 1.0, 1.0], **options)
settled = solve_ivp(make_lorenz(10.0, 14.0, 8 / 3), (0, 8), [1.0, 1.0, 1.0], **options)
