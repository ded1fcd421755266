"""A stiff relaxation oscillation, by two implicit methods and with its Jacobian."""

import numpy as np
from scipy.integrate import solve_ivp

mu = 100.0


def van_der_pol(t, y):
    dydt = np.zeros(2)
    dydt[0] = y[1]
    dydt[1] = mu * (1 - y[0] ** 2) * y[1] - y[0]
    return dydt


def jacobian(t, y):
    return np.array([[0, 1], [-2 * mu * y[0] * y[1] - 1, mu * (1 - y[0] ** 2)]])


options = {"t_eval": np.linspace(0, 150, 31), "rtol": 1e-8, "atol": 1e-8}
radau = solve_ivp(van_der_pol, (0, 150), [2, 0], "Radau", jac=jacobian, **options)
bdf = solve_ivp(van_der_pol, (0, 150), [2, 0], method="BDF", **options)
