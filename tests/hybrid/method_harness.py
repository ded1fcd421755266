"""Runs one method without the integrator's driver: its templates are specialised for a field."""

from __future__ import annotations

from types import FunctionType

import numba
import numpy as np

from hopdata.hybrid.layout import END, K1, KEND, P1, W1, Y

compiled = numba.njit(error_model="numpy")
NO_MODE = np.zeros(0, dtype=np.int64)
NO_ADDRESS = 0  # of a field, which is compiled in


@compiled
def row(s, r):
    """Return a row of an array, as the templates take it from a view."""
    return s[r]


@compiled
def square(s, first):
    """Return the square block of an array that starts at row `first`."""
    return s[first : first + s.shape[1]]


def specialised(template, **names):
    """Compile a template function with these globals inserted, to work on arrays."""
    known = {**template.__globals__, "row": row, "square": square, **names}
    return compiled(FunctionType(template.__code__, known))


class Stepper:
    """A method, a field and the table of states, advanced one step at a time."""

    def __init__(
        self,
        method,
        field,
        n,
        *,
        params=(),
        mode=NO_MODE,
        rtol=1e-9,
        atol=1e-12,
        **names,
    ):
        names = {"FIELD": field, "N": n, **names}
        self.method, self.field, self.n = method, field, n
        self.step_code = specialised(method.step, **names)
        self.interpolant_code = specialised(method.interpolant, **names)
        self.params, self.mode = np.array(params, dtype=float), np.array(mode)
        self.rtol, self.atol = (
            rtol,
            np.full(n, atol) if np.isscalar(atol) else np.array(atol),
        )
        self.s = np.zeros((W1 + method.work_rows(n), n))
        self.s[P1:] = np.nan  # exposes reads of what was never written

    def start(self, t, y):
        self.t, self.s[Y] = t, y
        self.field(t, self.s[Y], self.mode, self.params, self.s[K1])

    def step(self, dt):
        """Return the error of a step, which is not yet accepted."""
        self.dt = dt
        known = self.t, dt, self.rtol, self.s, self.mode, self.params, self.atol
        return self.step_code(*known, NO_ADDRESS)

    def accept(self):
        self.t += self.dt
        self.s[Y], self.s[K1] = self.s[END], self.s[KEND]

    def interpolate(self, theta):
        """Return the state at `theta` of the last step, from its powers or alternating ones."""
        known = self.t, self.dt, self.s, self.mode, self.params
        degree = self.interpolant_code(*known, NO_ADDRESS)
        powers, total = self.method.__name__.endswith("taylor"), np.zeros(self.n)
        for k in range(degree - 1, 0, -1):
            other = theta if powers or k % 2 == 0 else 1.0 - theta
            total = other * (total + self.s[P1 + k])
        return self.s[Y] + theta * (self.s[P1] + total)

    def run(self, t_end, dt, most_steps=100_000):
        """Integrate to `t_end` with step control; return the steps taken and rejected."""
        taken = rejected = 0
        while self.t < t_end:
            dt = min(dt, t_end - self.t)
            error = self.step(dt)
            factor = 0.9 / max(error, 1e-300) ** (1.0 / self.method.ORDER)
            if error <= 1.0:
                self.accept()
                taken += 1
                dt *= min(10.0, max(0.2, factor))
            else:
                rejected += 1
                dt *= max(0.2, factor) if np.isfinite(error) else 0.1
            assert taken + rejected < most_steps
        return taken, rejected

    def run_fixed(self, t_end, steps):
        """Integrate in equal steps; return the largest error estimate."""
        start, largest = self.t, 0.0
        for k in range(steps):
            largest = max(largest, self.step((t_end - start) / steps))
            self.accept()
            self.t = start + (k + 1) * (t_end - start) / steps
        return largest
