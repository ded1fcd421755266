"""The sparse plate against the plain one."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid import solve
from hopdata.scenes.plate import Plate, plate_field, plate_field_jacobian, plate_guards
from hopdata.scenes.plate_incremental import (
    N_MEMORY,
    plate_field_of_sums,
    plate_guard,
    plate_jacobian,
    plate_rate_bound,
    update_sums,
)

N = 12
PLATE = Plate(N)
TILTED = np.array([0.07, 0.93, 0.21, -0.3, -1.1, 0.8])
LOCKS = np.where(np.random.default_rng(3).random(N) < 0.6, 1, -1)


def params_with(locks):
    """Parameters and memory after the springs in contact have touched one by one."""
    params = np.concatenate([PLATE.params, np.zeros(N_MEMORY)])
    for k in np.flatnonzero(locks > 0):
        update_sums(0.0, TILTED, locks, params, int(k), 1)
    return params


def rates(y, locks=LOCKS):
    dy = np.empty(6)
    plate_field(0.0, y, locks, np.array(PLATE.params), dy)
    return dy


def test_field_of_sums_is_the_field():
    dy = np.empty(6)
    plate_field_of_sums(0.0, TILTED, LOCKS, params_with(LOCKS), dy)
    assert dy == pytest.approx(rates(TILTED), rel=1e-13)


def test_sums_are_exact_however_often_springs_come_and_go():
    params = params_with(LOCKS)
    before = params.copy()
    for k in np.random.default_rng(0).integers(0, 10_000, 2000):
        assert update_sums(0.0, TILTED, LOCKS, params, int(k), 1) == 0
        assert update_sums(0.0, TILTED, LOCKS, params, int(k), -1) == 0
    assert np.array_equal(params, before)


def test_one_guard_is_one_of_the_guards():
    h, hdot, one, rate = (np.full(N, np.nan) for _ in range(4))
    dy, params = rates(TILTED), np.array(PLATE.params)
    plate_guards(0.0, TILTED, dy, LOCKS, params, h, hdot)
    for k in range(N):
        plate_guard(0.0, TILTED, dy, LOCKS, params, k, one, rate)
    assert one == pytest.approx(h, abs=1e-15)
    assert rate == pytest.approx(hdot, abs=1e-15)
    alone = np.full(N, np.nan)
    plate_guard(0.0, TILTED, dy, LOCKS, params, 4, alone, rate)
    assert np.flatnonzero(np.isfinite(alone)).tolist() == [4]


@pytest.mark.parametrize("spin", [-3.0, 0.0, 0.1, 5.0])
def test_rate_bound_is_the_largest_rate(spin):
    h, hdot, y = np.empty(N), np.empty(N), TILTED.copy()
    y[5] = spin
    dy, params = rates(y), np.array(PLATE.params)
    plate_guards(0.0, y, dy, LOCKS, params, h, hdot)
    bound = plate_rate_bound(0.0, y, dy, LOCKS, params)
    assert bound == pytest.approx(np.abs(hdot).max(), rel=1e-14)


@pytest.mark.parametrize("locks", [LOCKS, -np.ones(N, dtype=int), np.ones(N, dtype=int)])
def test_jacobian_is_the_derivative(locks):
    jac, plain, step = np.zeros((6, 6)), np.zeros((6, 6)), 1e-6
    plate_jacobian(0.0, TILTED, locks, params_with(locks), jac)
    plate_field_jacobian(0.0, TILTED, locks, np.array(PLATE.params), plain)
    assert plain == pytest.approx(jac, rel=1e-12, abs=1e-11)
    columns = [
        (rates(TILTED + e, locks) - rates(TILTED - e, locks)) / (2 * step) for e in step * np.eye(6)
    ]
    assert jac == pytest.approx(np.array(columns).T, rel=1e-7, abs=1e-6)


def both(plate, start, until, **options):
    """Solutions in the plain form and, after the choice in the options, in another."""
    form = options.pop("form", "sparse")
    span, given = (0.0, until), {"params": plate.params, "rtol": 1e-11, "atol": 1e-12} | options
    memory = plate.memory(start)
    return (
        solve(plate.system(), span, start, **given),
        solve(plate.system(**{form: True}), span, start, memory=memory, **given),
    )


@pytest.mark.parametrize("form", ["sums", "sparse"])
@pytest.mark.parametrize("n", [1, 12, 90])
def test_the_same_flight_as_the_plain_form(n, form):
    start = np.array([0.0, 2.4, 0.06 * (n > 1), 0.0, 0.0, 0.0])
    plain, other = both(Plate(n), start, 2.0, form=form)
    assert other.status == plain.status == 0
    assert np.array_equal(other.events.guard, plain.events.guard)
    assert np.abs(other.events.time - plain.events.time).max() < 1e-10
    assert np.abs(other.y_end - plain.y_end).max() < 1e-10


@pytest.mark.parametrize("form", ["sums", "sparse"])
def test_a_start_in_contact(form):
    assert PLATE.memory(TILTED)[0] == np.sum(PLATE.compressions(TILTED) > 0) > 0
    plain, other = both(PLATE, TILTED, 0.5, form=form)
    assert np.abs(other.y_end - plain.y_end).max() < 1e-10


def test_the_flow_has_one_jacobian():
    start, step, until = np.array([0.1, 1.2, 0.06, 0.2, -1.0, 0.3]), 1e-6, 0.3
    plain, sparse = both(PLATE, start, until, rtol=1e-12, jacobian=True)
    assert len(plain.events) >= N
    ends = [
        [
            solve(
                PLATE.system(), (0.0, until), start + e, params=PLATE.params, rtol=1e-13, atol=1e-14
            ).y_end
            for e in (nudge, -nudge)
        ]
        for nudge in step * np.eye(6)
    ]
    columns = np.array([(up - down) / (2 * step) for up, down in ends]).T
    scale = np.abs(columns).max()
    assert np.abs(plain.jacobian - columns).max() < 1e-6 * scale
    assert np.abs(sparse.jacobian - plain.jacobian).max() < 1e-9 * scale
