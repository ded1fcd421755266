"""The one-dimensional hopper against its closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from hopdata.hybrid import solve
from hopdata.scenes.vertical_hopper import VerticalHopper, hopper_end, hopper_states

PRELOADED = VerticalHopper(rest_length_m=1.05)
DAMPED = VerticalHopper(damping_n_s_m=6.0, rest_length_m=1.02)


def stance(hopper, speed):
    """Return closed-form height above contact and velocity in stance; touchdown is at -`speed`."""
    natural = hopper.stiffness_n_m / hopper.mass_kg
    decay = 0.5 * hopper.damping_n_s_m / hopper.mass_kg
    omega = np.sqrt(natural - decay**2)
    rest = (
        hopper.rest_length_m - hopper.contact_length_m - hopper.gravity_m_s2 / natural
    )
    cosine, sine = -rest, (-speed - decay * rest) / omega

    def height(t):
        swing = cosine * np.cos(omega * t) + sine * np.sin(omega * t)
        return rest + np.exp(-decay * t) * swing

    def velocity(t):
        along = (omega * sine - decay * cosine) * np.cos(omega * t)
        across = (omega * cosine + decay * sine) * np.sin(omega * t)
        return np.exp(-decay * t) * (along - across)

    return height, velocity, np.pi / omega


def exact_hops(hopper, drop_height, n_hops):
    """Return the instants of touchdown and lift-off, and the speeds there."""
    g = hopper.gravity_m_s2
    speed = np.sqrt(2 * g * (drop_height - hopper.contact_length_m))
    time, instants, speeds = speed / g, [], []
    for _ in range(n_hops):
        height, velocity, half = stance(hopper, speed)
        ground = brentq(height, 0.3 * half, 1.9 * half, xtol=1e-16, rtol=1e-15)
        instants += [time, time + ground]
        speeds += [-speed, velocity(ground)]
        speed = velocity(ground)
        time += ground + 2 * speed / g
    return np.array(instants), np.array(speeds)


@pytest.mark.parametrize("hopper", [VerticalHopper(), PRELOADED, DAMPED])
def test_against_closed_form(hopper):
    instants, speeds = exact_hops(hopper, 2.0, 3)
    end = instants[-1] + 0.01
    solution = solve(
        hopper.system(),
        (0, end),
        [2.0, 0.0],
        params=hopper.params,
        rtol=1e-12,
        atol=1e-14,
    )
    assert solution.status == 0
    assert solution.events.direction.tolist() == [-1, 1] * 3
    assert np.abs(solution.events.time - instants).max() < 1e-10
    assert np.abs(solution.events.before[:, 1] - speeds).max() < 1e-9
    assert np.abs(solution.events.before[:, 0] - 1.0).max() < 1e-14


def test_the_closed_form_at_any_time_and_at_the_end():
    hopper, times = VerticalHopper(), np.linspace(0.0, 3.0, 200)
    solution = solve(
        hopper.system(), (0.0, 3.0), [2.0, 0.0], params=hopper.params, rtol=1e-12,
        atol=1e-13, t_eval=times,
    )  # fmt: skip
    exact = hopper_states(hopper, 2.0, times)
    assert np.abs(solution.y - exact).max() < 1e-10
    assert hopper_end(hopper, 2.0, 2.0) == pytest.approx(
        hopper_states(hopper, 2.0, [2.0])[:, 0], abs=1e-12
    )
    with pytest.raises(ValueError, match="in flight"):
        hopper_end(hopper, 2.0, 0.5)
    with pytest.raises(ValueError, match="preload"):
        hopper_states(PRELOADED, 2.0, times)


def test_parameters_matter():
    instants, _ = exact_hops(VerticalHopper(), 2.0, 3)
    others, _ = exact_hops(DAMPED, 2.0, 3)
    assert np.abs(instants - others).max() > 1e-3


def test_energy_is_kept_over_ten_thousand_hops():
    hopper = VerticalHopper()
    solution = solve(
        hopper.system(), (0, 10_070.0), [2.0, 0.0], params=hopper.params,
        rtol=1e-13, atol=1e-15, t_eval=[10_070.0],
    )  # fmt: skip
    assert solution.status == 0
    assert len(solution.events.of("contact", direction=-1)) >= 10_000
    drift = hopper.energy(solution.y_end) / hopper.energy([2.0, 0.0]) - 1
    assert abs(drift) < 1e-8


def test_damping_takes_energy():
    solution = solve(DAMPED.system(), (0, 5), [2.0, 0.0], params=DAMPED.params)
    assert DAMPED.energy(solution.y_end) < 0.8 * DAMPED.energy([2.0, 0.0])


def test_energy_is_continuous_at_contact():
    above, below = PRELOADED.energy(
        np.array([[1.0 + 1e-12, 1.0 - 1e-12], [-3.0, -3.0]])
    )
    assert above == pytest.approx(below, rel=1e-10)


def test_impossible_parameters():
    with pytest.raises(ValueError, match="mass and stiffness > 0"):
        VerticalHopper(stiffness_n_m=-1.0)


@pytest.mark.parametrize("stiffness", [1.0e2, 1e6, 1e10])
def test_stiff_legs(stiffness):
    hopper = VerticalHopper(stiffness_n_m=stiffness)
    instants, _ = exact_hops(hopper, 2.0, 2)
    end = instants[-1] + 0.1
    solution = solve(
        hopper.system(), (0, end), [2.0, 0.0], params=hopper.params, rtol=1e-11
    )
    assert solution.status == 0
    assert np.abs(solution.events.time - instants).max() < 1e-8


@pytest.mark.parametrize("rtol", [1e-3, 1e-9])
def test_a_phase_is_one_step_of_a_series(rtol):
    """Three flights and two stances of half a period each, exact to rounding at any tolerance."""
    hopper = VerticalHopper()
    solution = solve(
        hopper.system(), (0.0, 2.0), [2.0, 0.0], params=hopper.params, rtol=rtol
    )
    assert solution.n_steps == len(solution.events) + 1 == 5
    instants, _ = exact_hops(hopper, 2.0, 2)
    assert solution.events.time == pytest.approx(instants, abs=1e-14)
    assert hopper.energy(solution.y_end) == pytest.approx(
        hopper.energy([2.0, 0.0]), rel=1e-14
    )
