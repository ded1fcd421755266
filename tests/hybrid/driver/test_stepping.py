"""The choice of the method: by density of events, stiffness of the mode, and form of the system."""

from __future__ import annotations

import numpy as np
import pytest
from bent_systems import affine_landing, bent, bent_params, landing
from stiff_problems import damped_contact

from hopdata.hybrid import System, field, solve, solve_batch
from hopdata.hybrid.layout import METHOD
from hopdata.hybrid.methods.table import AUTOMATIC

CHEAP, HIGH_ORDER, STIFF = range(3)
FAR = bent_params([50.0, 60.0, 70.0], drive=0.3)
DENSE = bent_params(np.linspace(-1, 1, 300))


@field
def drift(t, y, mode, params, dy):
    dy[0] = 1.0


DRIFTING = System(drift, n_states=1)


def last_method(solution):
    return AUTOMATIC[solution.counts[METHOD]]


@pytest.mark.parametrize("rtol", [1e-4, 1e-9])
def test_high_order_where_events_are_sparse(rtol):
    found = solve(bent(3), (0, 20), [0.0, 1.2], params=FAR, rtol=rtol, atol=rtol)
    cheap = solve(
        bent(3), (0, 20), [0.0, 1.2], params=FAR, rtol=rtol, atol=rtol, method="dopri5"
    )
    assert last_method(found) == "dop853"
    assert found.n_steps < cheap.n_steps


@pytest.mark.parametrize("rtol", [1e-4, 1e-9])
def test_the_cheap_one_where_they_are_dense(rtol):
    system = bent(300)
    options = {"params": DENSE, "rtol": rtol, "atol": rtol}
    found = solve(system, (0, 1.5), [-0.9, 1.0], **options)
    high = solve(system, (0, 1.5), [-0.9, 1.0], method="dop853", **options)
    assert last_method(found) == "dopri5"
    assert found.nfev < high.nfev
    assert np.abs(found.y_end - high.y_end).max() < 100 * rtol


def test_back_to_high_order_after_a_dense_stretch():
    """All guards lie within the first tenth of the path."""
    params = bent_params(np.linspace(0.01, 0.1, 60))
    inside = solve(bent(60), (0, 0.05), [0.0, 1.2], params=params)
    beyond = solve(bent(60), (0, 1.0), [0.0, 1.2], params=params)
    assert 0 < len(inside.events) < len(beyond.events) == 60
    assert last_method(inside) == "dopri5"
    assert last_method(beyond) == "dop853"


def test_no_choice_no_change():
    for method in ("dopri5", "dop853", "rosenbrock"):
        found = solve(bent(3), (0, 5), [0.0, 1.2], params=FAR, method=method)
        assert found.counts[METHOD] == 0
        assert found.success


@pytest.mark.parametrize("method", ["auto", "rosenbrock"])
@pytest.mark.parametrize("damping", [1e2, 1e4, 1e6, 1e7, 1e8, 1e9])
def test_a_landing_on_a_strong_damper(damping, method):
    fall = np.sqrt(2 / 9.81)
    params = (damping, 2.0 * damping, 9.0)
    atol = [1e-9 * 3.0 / damping, 1e-9]
    found = solve(
        landing(), (0, fall + 2.0), [1.0, 0.0], params=params, method=method, atol=atol
    )
    exact = damped_contact(9.81, damping, 2.0 * damping, [0.0, -9.81 * fall], 2.0)
    assert found.status == 0
    assert found.events.time == pytest.approx([fall], abs=1e-14)
    assert (np.abs(found.y_end - exact) < 10 * (atol + 1e-9 * np.abs(exact))).all()
    assert found.n_steps < 150
    assert found.nfev < 2000


@pytest.mark.parametrize("method", ["dopri5", "dop853"])
def test_an_explicit_method_needs_steps_by_the_stiffness(method):
    """The landing on a damper of 1e6 needs more than 1000 times as many."""
    options = {"params": (1e6, 2e6, 9.0), "atol": [3e-15, 1e-9]}
    chosen = solve(landing(), (0, 2.4), [1.0, 0.0], **options)
    explicit = solve(
        landing(), (0, 2.4), [1.0, 0.0], method=method, max_steps=100_000, **options
    )
    assert explicit.status == -4
    assert explicit.n_steps == 100_000 > 1000 * chosen.n_steps


def test_explicit_again_when_the_damper_is_gone():
    options = {"params": (1e6, 2e6, 2.0)}
    damped = solve(landing(), (0, 1.9), [1.0, 0.0], **options)
    found = solve(landing(), (0, 6.0), [1.0, 0.0], **options)
    assert last_method(damped) == "rosenbrock"
    assert last_method(found) == "dop853"
    assert found.events.guard.tolist() == [0, 1]
    assert found.n_steps < 500
    freed = solve(landing(), (0, 2.0), [1.0, 0.0], **options).y_end
    rest = np.array([-9.81 / 400.0, 0.0])
    swing = 20.0 * (6.0 - 2.0)
    turn = [[np.cos(swing), np.sin(swing) / 20], [-20 * np.sin(swing), np.cos(swing)]]
    assert found.y_end == pytest.approx(rest + turn @ (freed - rest), abs=2e-8)


def test_each_of_a_batch_begins_with_the_same_method():
    """A stiff trajectory does not pass its method on to the next."""
    params = np.array([[1e7, 2e7, 9.0], [1.0, 300.0, 9.0]] * 3)
    batch = solve_batch(landing(), (0, 2.0), np.tile([1.0, 0.0], (6, 1)), params=params)
    for place in range(2):
        single = solve(landing(), (0, 2.0), [1.0, 0.0], params=params[place])
        assert (batch.y_end[place::2] == single.y_end).all()
        assert (batch.nfev[place::2] == single.nfev).all()


AFFINE = (5.0, 300.0, 1.0, 0.0)


@pytest.mark.parametrize("method", ["auto", "taylor"])
def test_taylor_through_a_landing(method):
    found = solve(affine_landing(), (0, 2), [1.0, 0.0], params=AFFINE, method=method)
    other = solve(landing(), (0, 2), [1.0, 0.0], params=AFFINE, rtol=1e-13, atol=1e-14)
    assert found.events.guard.tolist() == other.events.guard.tolist()
    assert found.events.time == pytest.approx(other.events.time, abs=1e-12)
    assert found.y_end == pytest.approx(other.y_end, abs=1e-10)
    assert found.n_steps < other.n_steps


@pytest.mark.parametrize("jacobian", [False, True])
def test_an_affine_form_of_another_field_is_found_out(jacobian):
    wrong = (*AFFINE[:3], 1.0)
    found = solve(affine_landing(), (0, 2), [1.0, 0.0], params=wrong, jacobian=jacobian)
    assert found.status == -9
    assert found.t_end == 0.0
    assert (
        "@affine function does not give the @field function's value at t = 0"
        in found.message
    )
    explicit = solve(
        affine_landing(), (0, 2), [1.0, 0.0], params=wrong, method="dop853"
    )
    assert explicit.success


def test_an_affine_form_that_is_wrong_in_a_later_mode_is_found_out_there():
    """The form is wrong before the release at t = 1, at 0.2 s; it is right for a start after it."""
    wrong = (*AFFINE[:3], 1.0)
    after = solve(affine_landing(), (1.5, 2), [1.0, 0.0], params=wrong, mode=[-1, 1])
    assert after.success
    before = solve(affine_landing(), (0.2, 2), [1.0, 0.0], params=wrong)
    assert before.status == -9


@pytest.mark.parametrize("size", [0.5, 2.0])
def test_the_first_step_is_as_long_as_the_state_takes_to_grow_by_itself(size):
    """So it is for a state below its tolerance, too, and whatever the time span."""
    begin = size * 1e-6
    options = {"rtol": 1e-13, "atol": 1e-6, "method": "dopri5", "debug": True}
    found = solve(DRIFTING, (0.0, 1.0), [begin], **options)
    assert found.t[1] == pytest.approx(begin, rel=1e-6)
    assert found.y_end[0] == pytest.approx(1.0 + begin, rel=1e-12)
