"""The flow's Jacobian along smooth arcs: each method, both forms of the field's derivative."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_systems import bent, bent_field, bent_jacobian, bent_params, landing
from hybrid_systems import balance, growth
from jacobian_checks import carried, differences, gap
from scipy.integrate import solve_ivp

from hopdata.hybrid import System, field, jacobian, solve, solve_batch
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.layout import PHI_MOTION, PHI_ROWS
from hopdata.hybrid.methods import tangent, taylor
from hopdata.hybrid.methods.explicit import Tableau
from hopdata.hybrid.methods.method import explicit_method
from hopdata.hybrid.methods.table import TABLEAUS
from hopdata.hybrid.methods.tangent import LOOSER

FAR = bent_params([50.0, 60.0, 70.0], drive=0.3)
METHODS = pytest.mark.parametrize("method", ["auto", *TABLEAUS])


@METHODS
def test_without_events_it_is_the_derivative(method):
    found = carried(bent(3), (0, 3), [0.0, 1.2], params=FAR, method=method)
    assert len(found.events) == 0
    assert (
        gap(found.jacobian, differences(bent(3), (0, 3), [0.0, 1.2], params=FAR))
        < 1e-10
    )


@METHODS
def test_a_field_without_divergence_keeps_areas(method):
    found = carried(bent(3), (0, 10), [0.4, 1.2], params=FAR, method=method)
    assert np.linalg.det(found.jacobian) == pytest.approx(1.0, abs=1e-10)


def test_exponential_growth():
    found = carried(growth(), (0, 2), [1.0, 0.0], params=(0.7, 4.0))
    assert found.jacobian == pytest.approx(
        np.diag([np.exp(1.4), 1.0]), rel=1e-11, abs=1e-11
    )


@METHODS
def test_it_converges_with_the_tolerance(method):
    exact = carried(bent(3), (0, 3), [0.3, 1.2], params=FAR).jacobian
    errors = [
        gap(solve(bent(3), (0, 3), [0.3, 1.2], params=FAR, method=method, jacobian=True,
                  rtol=rtol, atol=rtol).jacobian, exact)
        for rtol in (1e-4, 1e-7, 1e-10)
    ]  # fmt: skip
    assert errors[0] < 1e-2
    assert errors[1] < 1e-5
    assert errors[2] < 1e-8


@METHODS
def test_a_given_derivative_duals_and_differences_agree(method):
    params = bent_params([0.5, 0.7, 1.0], drive=0.3, tilts=0.2, gains=[0.4, -0.8, -0.5])
    options = {"params": params, "method": method}
    given = carried(bent(3, jacobian=bent_jacobian), (0, 2), [0.0, 1.2], **options)
    by_duals = carried(bent(3), (0, 2), [0.0, 1.2], **options)
    np.testing.assert_allclose(by_duals.y_end, given.y_end, rtol=1e-13)
    assert gap(by_duals.jacobian, given.jacobian) < 1e-14
    assert given.nfev == by_duals.nfev
    assert by_duals.by_differences == ""
    in_python = replace(bent(3), field=field(compiled=False)(bent_field.function))
    by_differences = carried(in_python, (0, 2), [0.0, 1.2], **options)
    np.testing.assert_allclose(by_differences.y_end, given.y_end, rtol=1e-12)
    assert gap(by_differences.jacobian, given.jacobian) < 1e-11
    assert given.nfev < by_differences.nfev
    assert by_differences.by_differences == "field: it runs as plain Python"
    assert by_differences.by_differences in by_differences.message


@pytest.mark.parametrize("angle", [1e-3, 1e-6, 0.0])
def test_units_of_the_state_do_not_matter(angle):
    """The field is linear, so the Jacobian is that of any other start."""
    given = carried(
        balance(), (0, 1), [angle, 0.0], params=(0.0,), method="dopri5", max_step=0.01
    )
    exact = [[np.cos(1), np.sin(1)], [-np.sin(1), np.cos(1)]]
    assert np.abs(given.jacobian - exact).max() < 1e-12


@pytest.mark.parametrize("method", TABLEAUS)
@pytest.mark.parametrize("angle", [1e-13, 1e-16, 1e-20])
def test_a_state_near_zero_beside_terms_that_cancel(angle, method):
    """An example is an angle that is zero except for rounding, beside the weight."""
    options = {"params": (9.81,), "method": method, "max_step": 0.01}
    found = carried(balance(), (0, 1), [angle, 0.0], **options)
    exact = [[np.cos(1), np.sin(1)], [-np.sin(1), np.cos(1)]]
    assert np.abs(found.jacobian - exact).max() < 1e-13


@METHODS
def test_at_an_equilibrium(method):
    found = carried(balance(), (0, 20), [0.0, 0.0], params=(0.0,), method=method)
    exact = [[np.cos(20), np.sin(20)], [-np.sin(20), np.cos(20)]]
    assert np.abs(found.jacobian - exact).max() < 1e-9


def test_no_time_no_change():
    found = solve(bent(3), (1, 1), [0.0, 1.2], params=FAR, jacobian=True)
    assert found.jacobian.tolist() == np.eye(2).tolist()


def test_it_is_not_there_unless_asked_for():
    options = {"params": FAR}
    assert solve(bent(3), (0, 1), [0.0, 1.2], **options).jacobian is None
    assert (
        solve(bent(3), (0, 1), [0.0, 1.2], jacobian=True, **options).jacobian
        is not None
    )
    assert solve(bent(3), (0, 1), [0.0, 1.2], **options).jacobian is None


def test_each_integration_begins_with_the_identity():
    batch = solve_batch(
        bent(3), (0, 1), np.tile([0.0, 1.2], (3, 1)), params=FAR, jacobian=True
    )
    single = solve(bent(3), (0, 1), [0.0, 1.2], params=FAR, jacobian=True)
    for matrix in batch.jacobian:
        assert matrix.tobytes() == single.jacobian.tobytes()


def test_the_chain_rule():
    first = carried(bent(3), (0, 1), [0.0, 1.2], params=FAR)
    second = carried(bent(3), (1, 2), first.y_end, params=FAR, mode=first.mode)
    whole = carried(bent(3), (0, 2), [0.0, 1.2], params=FAR)
    assert gap(second.jacobian @ first.jacobian, whole.jacobian) < 1e-12


def test_a_stiff_method_has_none():
    with pytest.raises(ValueError, match=r"jacobian: .*'taylor', found 'rosenbrock'"):
        solve(
            landing(),
            (0, 1),
            [1.0, 0.0],
            params=(1, 1, 9),
            method="rosenbrock",
            jacobian=True,
        )


def test_more_steps_than_the_driver_takes_in_one_call():
    long = solve(bent(3), (0, 2), [0.0, 1.2], params=FAR, jacobian=True, max_step=8e-6)
    assert long.n_steps > 200_000
    assert (
        gap(long.jacobian, carried(bent(3), (0, 2), [0.0, 1.2], params=FAR).jacobian)
        < 1e-9
    )


@field
def at_rest(t, y, mode, params, dy):
    dy[0] = dy[1] = 0.0


@jacobian
def turning(t, y, mode, params, jac):
    jac[0, 1] = params[0]
    jac[1, 0] = -params[0]


def test_steps_too_short_for_the_time_to_go_on_end_in_a_status():
    """Only the Jacobian demands these steps; the state allows any step."""
    system = System(at_rest, n_states=2, jacobian=turning)
    options = {"jacobian": True, "method": "dopri5"}
    found = solve(system, (1, 2), [1.0, 0.0], params=(1e18,), **options)
    assert found.status == -1
    assert found.n_steps < 100
    slow = solve(system, (1, 2), [1.0, 0.0], params=(3.0,), **options)
    exact = [[np.cos(3), np.sin(3)], [-np.sin(3), np.cos(3)]]
    assert np.abs(slow.jacobian - exact).max() < 1e-7


@jacobian
def odd_jacobian(t, y, mode, params, jac):
    jac[0, 1] = 1.0
    jac[1, 0] = np.nan
    if params[0] > 0.0:
        raise ValueError("no derivative with a drive")


def test_an_exception_of_the_derivative_is_raised():
    system = bent(3, jacobian=odd_jacobian)
    with pytest.raises(ValueError, match=r"^no derivative with a drive(\n|$)"):
        solve(system, (0, 1), [0.0, 1.2], params=FAR, jacobian=True, method="dopri5")
    with pytest.raises(ValueError, match=r"^no derivative with a drive(\n|$)"):
        solve_batch(
            system, (0, 1), [[0.0, 1.2]] * 3, params=FAR, jacobian=True, method="dopri5"
        )
    assert solve(system, (0, 1), [0.0, 1.2], params=FAR).success


def test_a_derivative_that_is_not_finite_is_a_failure():
    params = bent_params([50.0, 60.0, 70.0])
    options = {"params": params, "jacobian": True, "method": "dopri5"}
    found = solve(bent(3, jacobian=odd_jacobian), (0, 1), [0.0, 1.2], **options)
    assert not found.success


# The tangent of short steps: its order, its saving, and control of its error.

N = 3
CONSTANT, VARYING = np.random.default_rng(7).normal(size=(2, N, N))
ROWS = (4 + tangent.BLOCKS) * N + PHI_ROWS


def derivative(t):
    return CONSTANT + np.sin(3.0 * t) * VARYING


def stage_jacobian(t, dt, rtol, s, mode, params, atol, phi, field, jacobian, along):
    phi[N : 2 * N] = derivative(t)


def plain_fma(a, b, c):
    """Return the fused product and sum of compiled code, in plain Python rounded twice."""
    return a * b + c


class Table(np.ndarray):
    """A table whose rows may be overrun, as in compiled code: entry e of a block."""

    width = N

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


def short_flow(dt, rtol=1e-6, rows=ROWS):
    """Return the flow's Jacobian over dt, its own error estimate, and the motion squared."""
    names = {
        "stage_jacobian": stage_jacobian,
        "fastest_motion": taylor.fastest_motion.py_func,
    }
    multiply = with_digest(tangent.multiply.py_func, fma=plain_fma)
    add = with_digest(tangent.add_product.py_func, multiply=multiply, fma=plain_fma)
    for name in ("write_sizes", "change_of", "error_of_change"):
        names[name] = getattr(tangent, name).py_func
    step = with_digest(tangent.short_tangent, add_product=add, **names)
    phi = np.zeros((rows, N)).view(Table)
    phi[:N] = np.eye(N)
    s = np.zeros((40, N))
    error = step(0.0, dt, rtol, s, None, None, np.zeros(N), phi, 0, 0, [0])
    return np.array(phi[N : 2 * N]), error, phi[3 * N + PHI_MOTION, 0]


def exact_flow(dt):
    def rates(t, phi):
        return (derivative(t) @ phi.reshape(N, N)).ravel()

    flow = solve_ivp(
        rates, (0, dt), np.eye(N).ravel(), rtol=1e-13, atol=1e-14, method="DOP853"
    )
    return flow.y[:, -1].reshape(N, N)


def test_it_is_of_fourth_order():
    errors = [
        np.abs(short_flow(dt)[0] - exact_flow(dt)).max() for dt in (0.2, 0.1, 0.05)
    ]
    assert errors[0] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5.0, abs=0.5)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(5.0, abs=0.5)


def test_it_judges_its_error_by_the_fastest_motion():
    _, loose, fastest = short_flow(0.1, rtol=1e-6)
    _, tight, _ = short_flow(0.1, rtol=1e-8)
    assert tight == pytest.approx(100.0 * loose)
    assert fastest >= np.abs(np.diag(CONSTANT)).max() ** 2 / 2


def method_of(n_stages):
    """Return a method of third order that has this many stages, for N states."""
    tableau = Tableau(
        order=3,
        nodes=(0.5,) * (n_stages - 1),
        stages=tuple((0.5 / k,) * k for k in range(1, n_stages)),
        weights=(1.0 / n_stages,) * n_stages,
        errors=((0.0,) * (n_stages + 1),),
        dense=(),
        dense_error=1,
        stiff_tenths=20,
    )
    return explicit_method(
        tableau, System(at_rest, n_states=N).methods("auto", True).scene
    )


@pytest.mark.parametrize("n_stages", range(1, 14))
def test_its_table_has_room_for_the_blocks_of_the_stages_and_of_short_steps(n_stages):
    rows = method_of(n_stages).tangent_rows
    assert rows == PHI_ROWS + (4 + max(n_stages, tangent.BLOCKS)) * N
    found, error, _ = short_flow(0.1, rows=rows)  # beyond the table is an IndexError
    expected, expected_error, _ = short_flow(0.1)
    assert found.tobytes() == expected.tobytes()
    assert error == expected_error


def test_short_steps_need_all_of_their_blocks():
    with pytest.raises(IndexError):
        short_flow(0.1, rows=ROWS - 1)


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
    """A state that drives another without being driven by it counts as no motion, however fast."""
    cascade = System(cascade_field, jacobian=cascade_jacobian, n_states=2)
    options = {"params": (rate,), "rtol": rtol, "atol": rtol, "method": "dopri5"}
    found = solve(cascade, (0.0, 2.0), (0.4, 0.0), jacobian=True, **options)
    exact = np.sin(rate * 2.4) - np.sin(rate * 0.4)
    most = LOOSER * rtol * rate * found.n_steps
    np.testing.assert_allclose(
        found.jacobian, [[1.0, 0.0], [exact, 1.0]], rtol=0.0, atol=most
    )
