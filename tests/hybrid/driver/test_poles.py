"""Guards with poles: h changes its sign through infinity, and its rate is larger still."""

import numpy as np
import pytest

from hopdata.hybrid import System, solve


def clock(t, y):
    return 1.0


def tangent(t, y):
    return np.tan(0.5 * y[0]) - 3.0


def quotient(t, y, p):
    return p[1] * (1.0 / (y[0] - p[0]) - 5.0)


@pytest.mark.parametrize("rtol", [1e-3, 1e-9])
def test_a_guard_flips_at_its_poles_and_roots(rtol):
    system = System(clock, tangent, n_states=1, guard_names=("h",))
    run = solve(system, (0.0, 20.0), [0.0], rtol=rtol)
    turns = 2.0 * np.pi * np.arange(3)
    roots = 2.0 * np.arctan(3.0) + turns
    poles = np.pi + turns
    assert run.success
    assert run.proven
    expected = np.sort([*roots, *poles])
    np.testing.assert_allclose(run.events.time, expected, atol=1e-13)
    assert run.events.direction.tolist() == 3 * [1, -1]


@pytest.mark.parametrize("pole", [0.3, 0.31, 0.37, 0.4, 0.1234])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_follows_a_pole_is_seen(pole, sign):
    system = System(clock, quotient, n_states=1, guard_names=("h",))
    run = solve(system, (0.0, 1.0), [0.0], params=[pole, sign])
    assert run.success
    np.testing.assert_allclose(run.events.time, [pole, pole + 0.2], atol=1e-14)
    assert run.events.direction.tolist() == [sign, -sign]


def squared(t, y, p):
    return 1.0 / (y[0] - p[0]) ** 2 - 5.0


def test_a_pole_without_a_change_of_sign_is_no_flip():
    system = System(clock, squared, n_states=1, guard_names=("h",))
    run = solve(system, (0.0, 1.5), [0.0], params=[0.731])
    width = 5.0**-0.5
    expected = [0.731 - width, 0.731 + width]
    np.testing.assert_allclose(run.events.time, expected, atol=1e-13)


def orbit(t, y):
    return y[1], -y[0]


def beside_a_drive(t, y, p):
    return 1.0 / (y[0] - p[0] * np.sin(p[1] * t)) - 2.0


@pytest.mark.parametrize("seed", [724, 728])
def test_a_step_from_one_pole_to_the_next(seed):
    draw = np.random.default_rng(seed)
    params = [draw.uniform(0.3, 3), draw.uniform(0.3, 4)]
    system = System(orbit, beside_a_drive, n_states=2, guard_names=("h",))
    start = draw.normal(size=2)
    run = solve(system, (0.0, 12.0), start, params=params, rtol=1e-6, dense_output=True)
    t = np.linspace(0.0, 12.0, 300_001)
    signs = np.sign(beside_a_drive(t, run(t), params))
    places = t[1:][np.diff(signs) != 0.0]
    np.testing.assert_allclose(run.events.time, places, atol=5e-5)
