"""Derivatives of the field by differences, in any units."""

from __future__ import annotations

import numpy as np
import pytest
from method_harness import NO_MODE, specialised
from stiff_problems import CONTACT, FOLLOWER, KAPS, SMOOTH, field, jacobian

from hopdata.hybrid.methods import differences
from hopdata.hybrid.methods.rows import K1, W1, Y

JAC, RATE = W1, W1 + 2
CODES = {}


def code(name):
    if name not in CODES:
        template = getattr(differences, name)
        CODES[name] = specialised(template, FIELD=field, JACOBIAN=jacobian, N=2)
    return CODES[name]


def table(params, t, y):
    s = np.full((W1 + 3, 2), np.nan)
    s[Y] = y
    field(t, s[Y], NO_MODE, params, s[K1])
    return s


def by(name, params, t, dt, y, atol=(1e-12, 1e-12)):
    params = np.array(params, dtype=float)
    s = table(params, t, y)
    count = code(name)(t, dt, s, NO_MODE, params, np.array(atol), JAC)
    return s[JAC : JAC + 2].copy(), count


@pytest.mark.parametrize(
    ("params", "y"),
    [
        ((SMOOTH, 0.0), (1.5, 0.7)),
        ((KAPS, 1e6), (1.0, 1.0)),
        ((FOLLOWER, 1e4), (0.4, 2.0)),
        ((CONTACT, 10.0, 9.81, 1e3, 1e5), (-0.01, -3.0)),
        ((CONTACT, 1e12, 9.81, 1e3, 1e5), (-0.01, -1e-12)),
    ],
)
def test_differences_agree_with_the_derivative(params, y):
    found, count = by("jacobian_by_differences", params, 0.3, 1e-3, y)
    given, none = by("jacobian_by_user", params, 0.3, 1e-3, y)
    assert (count, none) == (4, 0)
    scale = np.abs(given) + 1e-3  # the smallest entries are of size 1
    assert np.all(np.abs(found - given) < 1e-8 * scale + 2e-9 * np.abs(given).max(axis=1)[:, None])


@pytest.mark.parametrize("atol", [1e-12, 0.0])
def test_at_rest_at_the_origin(atol):
    """Neither state nor slope tells the size of the position: its tolerance does, if it can."""
    found, _ = by("jacobian_by_differences", (CONTACT, 10.0, 0.0, 1e3, 0.0), 0.0, 1e-3, (0.0, 0.0),
                  (atol, atol))  # fmt: skip
    assert found == pytest.approx(np.array([[0.0, 1.0], [-1e3, -10.0]]), rel=1e-9, abs=1e-9)


def test_a_state_below_its_tolerance_counts_as_zero():
    """An increment in proportion to 1e-30 would drown in the rounding of the weight."""
    params, y = (CONTACT, 10.0, 9.81, 1e3, 0.0), (1e-30, 1e-30)
    found, _ = by("jacobian_by_differences", params, 0.0, 1e-3, y)
    assert found == pytest.approx(np.array([[0.0, 1.0], [-1e3, -10.0]]), rel=1e-4, abs=1e-12)


@pytest.mark.parametrize("scale", [2.0**-40, 2.0**40])
def test_units_of_length_change_nothing(scale):
    weight, rate, spring, square, y = 9.81, 1e3, 1e4, 1e6, np.array([-0.01, -3.0])
    plain, _ = by("jacobian_by_differences", (CONTACT, rate, weight, spring, square), 0.0, 1e-3, y)
    scaled = (CONTACT, rate, weight * scale, spring, square / scale)
    atol = np.full(2, 1e-12 * scale)
    found, _ = by("jacobian_by_differences", scaled, 0.0, 1e-3, y * scale, atol)
    assert np.array_equal(found, plain)


def rate_of(params, t, dt, y):
    params = np.array(params, dtype=float)
    s = table(params, t, y)
    count = code("time_derivative")(t, dt, s, NO_MODE, params, RATE)
    return s[RATE].copy(), count


def test_the_time_derivative():
    rate, t, y = 1e3, 0.7, (0.2, 1.5)
    found, count = rate_of((FOLLOWER, rate), t, 1e-2, y)
    assert count == 3
    assert found[0] == pytest.approx(rate * np.cos(t) - np.sin(t), rel=1e-9)
    assert found[1] == 0.0


@pytest.mark.parametrize("t", [0.0, 1e6])
def test_a_field_that_does_not_depend_on_time_costs_one_evaluation(t):
    found, count = rate_of((KAPS, 1e3), t, 1e-9, (1.0, 1.0))
    assert count == 1
    assert found.tolist() == [0.0, 0.0]


def test_late_in_time_the_increment_is_still_felt():
    """A step of 1e-9 at 1e6 seconds: 2^-9 of it would vanish in the rounding of the time."""
    t, rate = 1e6, 1.0
    found, count = rate_of((FOLLOWER, rate), t, 1e-9, (0.2, 1.5))
    assert count == 3
    assert found[0] == pytest.approx(rate * np.cos(t) - np.sin(t), abs=1e-3)
