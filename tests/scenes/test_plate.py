"""The plate on its bed of springs: mechanics, energy, symmetry and a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hopdata.hybrid import solve
from hopdata.scenes.plate import (
    N_MEMORY,
    PLATE_SPAN,
    PLATE_START,
    Plate,
    compression,
    plate_end,
    plate_field,
    plate_field_jacobian,
    plate_field_of_sums,
    plate_guard,
    plate_guards,
    plate_jacobian,
    plate_rate_bound,
    update_sums,
)

TILTED = np.array([0.07, 0.93, 0.21, -0.3, -1.1, 0.8])
FALL = np.array([0.0, 2.4, 0.06, 0.0, 0.0, 0.0])


def rates(plate, y):
    dy = np.empty(6)
    mode = np.where(plate.compressions(y) > 0, 1, -1)
    plate_field(0.0, y, mode, np.array(plate.params), dy)
    return dy


def gradient(function, y, step=1e-6):
    """Return central differences of a function of the state, last axis along the state."""
    nudges = step * np.eye(len(y))
    return np.array(
        [(function(y + e) - function(y - e)) / (2 * step) for e in nudges]
    ).T


def potential(plate, y):
    return plate.energy(np.concatenate([y[:3], np.zeros(3)]))


def test_forces_are_the_gradient_of_the_energy():
    plate = Plate(9, damping_n_s_m=0.0, mass_kg=1.3)
    down = gradient(lambda q: potential(plate, q), TILTED)[:3]
    inertia = np.array([1.3, 1.3, plate.inertia_kg_m2])
    assert inertia * rates(plate, TILTED)[3:] == pytest.approx(-down, rel=1e-8)


def test_damping_takes_power_from_each_spring_in_contact():
    plate = Plate(9)
    guards_h, guards_rate = np.empty(9), np.empty(9)
    dy = rates(plate, TILTED)
    arguments = (np.array(plate.params), guards_h, guards_rate)
    plate_guards(0.0, TILTED, dy, np.ones(9, dtype=np.int64), *arguments)
    power = gradient(plate.energy, TILTED) @ dy
    lost = 20.0 / 9 * np.sum(guards_rate[guards_h > 0] ** 2)
    assert 0 < (guards_h > 0).sum() < 9
    assert power == pytest.approx(-lost, rel=1e-7)


def test_the_reaction_is_normal_to_the_plate():
    dy = rates(Plate(9), TILTED)
    along = np.array([np.cos(TILTED[2]), np.sin(TILTED[2])])
    assert dy[3:5] @ along + 9.81 * along[1] == pytest.approx(0.0, abs=1e-13)


def test_guards_are_the_compressions_and_their_rates():
    plate, h, hdot = Plate(5), np.empty(5), np.empty(5)
    dy = rates(plate, TILTED)
    plate_guards(
        0.0, TILTED, dy, np.ones(5, dtype=np.int64), np.array(plate.params), h, hdot
    )
    assert h == pytest.approx(plate.compressions(TILTED), abs=1e-15)
    assert hdot == pytest.approx(gradient(plate.compressions, TILTED) @ dy, rel=1e-8)
    alone = [compression(i, TILTED, np.array(plate.params)) for i in range(5)]
    assert h == pytest.approx(alone, abs=1e-15)


def test_the_gradients_are_those_of_the_compressions():
    plate = Plate(5)
    expected = gradient(plate.compressions, TILTED)[:, :3]
    assert plate.gradients(TILTED) == pytest.approx(expected, abs=1e-9)


def test_the_end_of_the_first_bounce():
    plate = Plate()
    found = solve(
        plate.system(), PLATE_SPAN, PLATE_START, params=plate.params, rtol=1e-13, atol=1e-14
    )  # fmt: skip
    assert np.abs(found.y_end - plate_end()).max() < 1e-11
    assert found.n_events == 2 * plate.n_contacts


@pytest.mark.parametrize("n", [1, 2, 7, 35])
def test_springs_stand_evenly_over_the_bed(n):
    places = Plate(n, half_width_m=1.5).spring_places_m
    assert places == pytest.approx(
        np.linspace(-1.5, 1.5, n) if n > 1 else [0.0], abs=1e-15
    )


@pytest.mark.parametrize("n", [1, 2, 5, 35])
def test_energy_is_kept_without_damping(n):
    plate = Plate(n, damping_n_s_m=0.0)
    start = FALL if n > 1 else np.array([0.0, 2.4, 0.0, 0.0, 0.0, 0.0])
    solution = solve(
        plate.system(), (0, 1.5), start, params=plate.params, rtol=1e-12, atol=1e-13
    )
    assert solution.status == 0
    assert len(solution.events) >= 2 * n
    assert np.ptp(plate.energy(solution.y)) < 1e-9 * plate.energy(start)


def test_energy_falls_with_damping():
    plate = Plate(7)
    solution = solve(plate.system(), (0, 2.0), FALL, params=plate.params)
    assert solution.status == 0
    assert plate.energy(solution.y_end) < 0.7 * plate.energy(FALL)


def test_mirror_image():
    plate, mirror = Plate(8), np.array([-1.0, 1.0, -1.0, -1.0, 1.0, -1.0])
    ends = [
        solve(plate.system(), (0, 1), start, params=plate.params, rtol=1e-12).y_end
        for start in (FALL, mirror * FALL)
    ]
    assert mirror * ends[0] == pytest.approx(ends[1], abs=1e-9)


def test_a_level_plate_is_a_mass_on_one_spring():
    plate = Plate(6, damping_n_s_m=0.0)
    g, omega, speed = 9.81, np.sqrt(2000.0), np.sqrt(2 * 9.81)
    stance = 2 * np.arctan2(speed / omega, -g / omega**2) / omega
    solution = solve(
        plate.system(), (0, 1), [0, 2.0, 0, 0, 0, 0], params=plate.params,
        rtol=1e-12, atol=1e-13,
    )  # fmt: skip
    assert solution.events.direction.tolist() == [1] * 6 + [-1] * 6
    assert solution.events.time[:6] == pytest.approx(speed / g, abs=1e-12)
    assert solution.events.time[6:] == pytest.approx(speed / g + stance, abs=1e-10)
    assert solution.y_end[[0, 2, 3, 5]] == pytest.approx(0.0, abs=1e-12)


def test_each_spring_is_met_where_it_stands():
    plate = Plate(5)
    solution = solve(
        plate.system(), (0, 2), FALL, params=plate.params, rtol=1e-11, atol=1e-12
    )
    at_events = plate.compressions(solution.events.before.T)
    own = at_events[solution.events.guard, np.arange(len(solution.events))]
    assert np.abs(own).max() < 1e-12
    assert np.abs(at_events).max() > 0.01


def restarted(plate, state, until):
    """Return end and number of events by scipy, with forces from Newton's law on a tilted line."""
    places, k, c = (
        plate.spring_places_m,
        2000.0 / plate.n_contacts,
        20.0 / plate.n_contacts,
    )
    now, touching, flips = 0.0, np.zeros(plate.n_contacts, dtype=bool), 0

    def slope(_t, y):
        normal = np.array([-np.sin(y[2]), np.cos(y[2])])
        contact = np.stack([places[touching], np.full(touching.sum(), np.nan)])
        contact[1] = y[1] + np.tan(y[2]) * (contact[0] - y[0])
        h = plate.rest_length_m - contact[1]
        # Rate of the line's height above a fixed point.
        climb = (
            y[4] - np.tan(y[2]) * y[3] + (contact[0] - y[0]) * y[5] / np.cos(y[2]) ** 2
        )
        forces = normal[:, None] * (k * h - c * climb) / normal[1]
        arms = contact - y[:2, None]
        moment = np.sum(arms[0] * forces[1] - arms[1] * forces[0])
        ax, az = forces.sum(axis=1)
        return np.array([*y[3:], ax, az - 9.81, 3.0 * moment])

    def event(i):
        def value(_t, y):
            return plate.compressions(y)[i]

        value.terminal, value.direction = True, -1 if touching[i] else 1
        return value

    while now < until:
        part = solve_ivp(
            slope, (now, until), state, method="DOP853", rtol=1e-13, atol=1e-14,
            events=[event(i) for i in range(plate.n_contacts)],
        )  # fmt: skip
        now, state = part.t[-1], part.y[:, -1]
        for i, times in enumerate(part.t_events):
            touching[i] ^= len(times) > 0
            flips += len(times)
    return state, flips


def test_against_scipy_with_newtons_law():
    plate = Plate(4)
    end, flips = restarted(plate, FALL, 0.9)
    solution = solve(
        plate.system(), (0, 0.9), FALL, params=plate.params, rtol=1e-12, atol=1e-13
    )
    assert flips == len(solution.events) >= 8
    assert np.abs(solution.y_end - end).max() < 1e-10


def test_initial_states():
    states = Plate(3).initial_states(150, seed=4)
    assert states.shape == (150, 6)
    assert np.all(
        (states[:, 1] > 2) & (states[:, 1] < 3) & (np.abs(states[:, 2]) < 0.1)
    )
    assert np.ptp(states[:, 1]) > 0.9
    assert not states[:, [0, 3, 4, 5]].any()
    assert np.array_equal(states, Plate(9).initial_states(150, seed=4))


@pytest.mark.parametrize(
    ("name", "value"), [("n_contacts", 0), ("mass_kg", 0.0), ("damping_n_s_m", -1.0)]
)
def test_impossible_parameters(name, value):
    with pytest.raises(ValueError, match="expected"):
        Plate(**{name: value})


# The sparse form of the plate against the plain one.

N = 12
PLATE = Plate(N)
PLATE_INCREMENTAL_TILTED = np.array([0.07, 0.93, 0.21, -0.3, -1.1, 0.8])
LOCKS = np.where(np.random.default_rng(3).random(N) < 0.6, 1, -1)


def params_with(locks):
    """Return parameters and memory after the springs in contact have touched one by one."""
    params = np.concatenate([PLATE.params, np.zeros(N_MEMORY)])
    for k in np.flatnonzero(locks > 0):
        update_sums(0.0, PLATE_INCREMENTAL_TILTED, locks, params, int(k), 1)
    return params


def rates_plate_incremental(y, locks=LOCKS):
    dy = np.empty(6)
    plate_field(0.0, y, locks, np.array(PLATE.params), dy)
    return dy


def test_field_of_sums_is_the_field():
    dy = np.empty(6)
    plate_field_of_sums(0.0, PLATE_INCREMENTAL_TILTED, LOCKS, params_with(LOCKS), dy)
    assert dy == pytest.approx(
        rates_plate_incremental(PLATE_INCREMENTAL_TILTED), rel=1e-13
    )


def test_sums_are_exact_however_often_springs_come_and_go():
    params = params_with(LOCKS)
    before = params.copy()
    for k in np.random.default_rng(0).integers(0, 10_000, 2000):
        assert update_sums(0.0, PLATE_INCREMENTAL_TILTED, LOCKS, params, int(k), 1) == 0
        assert (
            update_sums(0.0, PLATE_INCREMENTAL_TILTED, LOCKS, params, int(k), -1) == 0
        )
    assert np.array_equal(params, before)


def test_one_guard_is_one_of_the_guards():
    h, hdot, one, rate = (np.full(N, np.nan) for _ in range(4))
    dy, params = (
        rates_plate_incremental(PLATE_INCREMENTAL_TILTED),
        np.array(PLATE.params),
    )
    plate_guards(0.0, PLATE_INCREMENTAL_TILTED, dy, LOCKS, params, h, hdot)
    for k in range(N):
        plate_guard(0.0, PLATE_INCREMENTAL_TILTED, dy, LOCKS, params, k, one, rate)
    assert one == pytest.approx(h, abs=1e-15)
    assert rate == pytest.approx(hdot, abs=1e-15)
    alone = np.full(N, np.nan)
    plate_guard(0.0, PLATE_INCREMENTAL_TILTED, dy, LOCKS, params, 4, alone, rate)
    assert np.flatnonzero(np.isfinite(alone)).tolist() == [4]


@pytest.mark.parametrize("spin", [-3.0, 0.0, 0.1, 5.0])
def test_rate_bound_is_the_largest_rate(spin):
    h, hdot, y = np.empty(N), np.empty(N), PLATE_INCREMENTAL_TILTED.copy()
    y[5] = spin
    dy, params = rates_plate_incremental(y), np.array(PLATE.params)
    plate_guards(0.0, y, dy, LOCKS, params, h, hdot)
    bound = plate_rate_bound(0.0, y, dy, LOCKS, params)
    assert bound == pytest.approx(np.abs(hdot).max(), rel=1e-14)


@pytest.mark.parametrize(
    "locks", [LOCKS, -np.ones(N, dtype=int), np.ones(N, dtype=int)]
)
def test_jacobian_is_the_derivative(locks):
    jac, plain, step = np.zeros((6, 6)), np.zeros((6, 6)), 1e-6
    plate_jacobian(0.0, PLATE_INCREMENTAL_TILTED, locks, params_with(locks), jac)
    plate_field_jacobian(
        0.0, PLATE_INCREMENTAL_TILTED, locks, np.array(PLATE.params), plain
    )
    assert plain == pytest.approx(jac, rel=1e-12, abs=1e-11)
    columns = [
        (
            rates_plate_incremental(PLATE_INCREMENTAL_TILTED + e, locks)
            - rates_plate_incremental(PLATE_INCREMENTAL_TILTED - e, locks)
        )
        / (2 * step)
        for e in step * np.eye(6)
    ]
    assert jac == pytest.approx(np.array(columns).T, rel=1e-7, abs=1e-6)


def both(plate, start, until, **options):
    """Return solutions in the plain form and in the form that the options choose."""
    form = options.pop("form", "sparse")
    span, given = (
        (0.0, until),
        {"params": plate.params, "rtol": 1e-11, "atol": 1e-12} | options,
    )
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
    assert (
        PLATE.memory(PLATE_INCREMENTAL_TILTED)[0]
        == np.sum(PLATE.compressions(PLATE_INCREMENTAL_TILTED) > 0)
        > 0
    )
    plain, other = both(PLATE, PLATE_INCREMENTAL_TILTED, 0.5, form=form)
    assert np.abs(other.y_end - plain.y_end).max() < 1e-10


def test_the_flow_has_one_jacobian():
    start, step, until = np.array([0.1, 1.2, 0.06, 0.2, -1.0, 0.3]), 1e-6, 0.3
    options = {"rtol": 1e-12, "jacobian": True, "method": "dop853"}
    plain, sparse = both(PLATE, start, until, **options)
    assert len(plain.events) >= N
    ends = [
        [
            solve(
                PLATE.system(),
                (0.0, until),
                start + e,
                params=PLATE.params,
                rtol=1e-13,
                atol=1e-14,
            ).y_end
            for e in (nudge, -nudge)
        ]
        for nudge in step * np.eye(6)
    ]
    columns = np.array([(up - down) / (2 * step) for up, down in ends]).T
    scale = np.abs(columns).max()
    assert np.abs(plain.jacobian - columns).max() < 1e-6 * scale
    assert np.abs(sparse.jacobian - plain.jacobian).max() < 1e-9 * scale
