"""The tangent of short steps: its order, what it saves, and that its error is controlled."""

from __future__ import annotations

import numpy as np
import pytest
from jacobian_checks import carried, gap
from scipy.integrate import solve_ivp

from hopdata.hybrid import System, field, jacobian, solve
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.driver.layout import PHI_MOTION, PHI_ROWS
from hopdata.hybrid.methods import motion, products, short_tangent
from hopdata.hybrid.methods.tangent import LOOSER
from hopdata.scenes.plate import Plate

N = 3
CONSTANT, VARYING = np.random.default_rng(7).normal(size=(2, N, N))
ROWS = (3 + short_tangent.BLOCKS) * N + PHI_ROWS


def derivative(t):
    return CONSTANT + np.sin(3.0 * t) * VARYING


def stage_jacobian(t, dt, rtol, s, mode, params, atol, phi):
    phi[N : 2 * N] = derivative(t)


def plain_fma(a, b, c):
    """The product and sum of compiled code, for plain Python: rounded twice."""
    return a * b + c


class Table(np.ndarray):
    """A table whose rows may be run over, as in compiled code: entry e of a block."""

    def __getitem__(self, at):
        if isinstance(at, tuple):
            row, column = at
            return self.reshape(-1).view(np.ndarray)[row * N + column]
        return super().__getitem__(at)

    def __setitem__(self, at, value):
        if isinstance(at, tuple):
            self.reshape(-1).view(np.ndarray)[at[0] * N + at[1]] = value
        else:
            super().__setitem__(at, value)


def short_flow(dt, rtol=1e-6):
    """The flow's Jacobian over dt, its error by its own account, and the motion squared."""
    fastest = with_digest(motion.fastest_motion, N=N)
    names = {"STAGE_JACOBIAN": stage_jacobian, "FASTEST_MOTION": fastest, "N": N}
    add = with_digest(products.add_product_numbers, N=N, fma=plain_fma)
    step = with_digest(short_tangent.short_tangent, ADD_PRODUCT=add, **names)
    phi = np.zeros((ROWS, N)).view(Table)
    phi[:N] = np.eye(N)
    error = step(0.0, dt, rtol, np.zeros((40, N)), None, None, None, phi)
    return np.array(phi[N : 2 * N]), error, phi[3 * N + PHI_MOTION, 0]


def exact_flow(dt):
    def rates(t, phi):
        return (derivative(t) @ phi.reshape(N, N)).ravel()

    flow = solve_ivp(rates, (0, dt), np.eye(N).ravel(), rtol=1e-13, atol=1e-14, method="DOP853")
    return flow.y[:, -1].reshape(N, N)


def test_it_is_of_fourth_order():
    errors = [np.abs(short_flow(dt)[0] - exact_flow(dt)).max() for dt in (0.2, 0.1, 0.05)]
    assert errors[0] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5.0, abs=0.5)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(5.0, abs=0.5)


def test_it_judges_its_error_by_the_fastest_motion():
    _, loose, fastest = short_flow(0.1, rtol=1e-6)
    _, tight, _ = short_flow(0.1, rtol=1e-8)
    assert tight == pytest.approx(100.0 * loose)
    assert fastest >= np.abs(np.diag(CONSTANT)).max() ** 2 / 2


@pytest.mark.parametrize("form", [{}, {"sums": True}])
def test_dense_events_need_few_more_evaluations_of_the_field(form):
    """A step that is taken again for its Jacobian would double them."""
    plate, start = Plate(20), [0.0, 2.2, 0.07, 0.0, 0.0, 0.0]
    options = {"params": plate.params, "rtol": 1e-6, "atol": 1e-6}
    state = solve(plate.system(**form), (0, 1), start, **options)
    both = solve(plate.system(**form), (0, 1), start, jacobian=True, **options)
    assert len(both.events) == len(state.events) > 20
    assert both.nfev < 1.5 * state.nfev
    exact = carried(plate.system(**form), (0, 1), start, params=plate.params)
    assert gap(both.jacobian, exact.jacobian) < 1e-5


@field
def cascade_field(t, y, mode, params, dy):
    dy[0] = 1.0
    dy[1] = np.sin(params[0] * y[0])


@jacobian
def cascade_jacobian(t, y, mode, params, jac):
    jac[1, 0] = params[0] * np.cos(params[0] * y[0])


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("rate", [0.3, 3.0, 300.0])
def test_a_derivative_that_changes_though_nothing_moves_as_fast_is_followed(rtol, rate):
    """What drives another state, and is not driven by it, counts as no motion, however fast."""
    cascade = System(cascade_field, jacobian=cascade_jacobian, n_states=2)
    options = {"params": (rate,), "rtol": rtol, "atol": rtol, "method": "dopri5"}
    found = solve(cascade, (0.0, 2.0), (0.4, 0.0), jacobian=True, **options)
    exact = np.sin(rate * 2.4) - np.sin(rate * 0.4)
    most = LOOSER * rtol * rate * found.n_steps
    np.testing.assert_allclose(found.jacobian, [[1.0, 0.0], [exact, 1.0]], rtol=0.0, atol=most)
