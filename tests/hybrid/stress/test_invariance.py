"""Results do not depend on units, nor on where an integration is split or sampled."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball, throw
from stress_mass import GRAVITY
from stress_random import random_case
from stress_systems import POWER, clock, clock_params, mass

from hopdata.hybrid import Solution, solve

POWERS = [(30, 0), (-30, 0), (0, 30), (0, -30), (-30, 30), (30, 30)]


# The first step is given, because its usual choice (Hairer, Norsett, Wanner, section
# II.4) depends on the unit of time.
def same(a: Solution, b: Solution, length: float, time: float) -> None:
    """Assert that two runs differ only by their units, to the last bit."""
    unit = np.array([length, length / time])
    assert a.status == b.status == 0
    assert a.n_steps == b.n_steps
    assert (a.events.time * time).tobytes() == b.events.time.tobytes()
    assert a.events.direction.tolist() == b.events.direction.tolist()
    assert (a.y_end * unit).tobytes() == b.y_end.tobytes()


@pytest.mark.parametrize("powers", POWERS)
@pytest.mark.parametrize("atol", [0.0, 1e-12])
@pytest.mark.parametrize(("k", "c"), [(1e3, 2.0), (1e6, 0.0)])
def test_units_of_the_mass(powers, atol, k, c):
    length, time = 2.0 ** powers[0], 2.0 ** powers[1]
    unit = np.array([length, length / time])
    runs = [
        solve(
            mass(), (0, 3 * t), np.array([1.0, 0.5]) * scale, atol=atol * scale,
            first_step=1e-3 * t, params=(GRAVITY * scale[1] / t, k / t**2, c / t),
        )
        for scale, t in ((np.ones(2), 1.0), (unit, time))
    ]  # fmt: skip
    assert len(runs[0].events) > 4
    same(*runs, length, time)


@pytest.mark.parametrize("powers", POWERS)
def test_units_of_the_ball(powers):
    length, time = 2.0 ** powers[0], 2.0 ** powers[1]
    unit = np.array([length, length / time])
    runs = [
        solve(ball(), (0, 2.75 * t), scale * [1.0, 0.0], atol=1e-12 * scale, first_step=1e-3 * t,
              params=(2.0 * scale[1] / t, 0.0, 0.5))
        for scale, t in ((np.ones(2), 1.0), (unit, time))
    ]  # fmt: skip
    assert len(runs[0].events) > 4
    same(*runs, length, time)


def in_two(case_system, cut, end, y0, **options):
    """Integrate in two parts that carry over the locks; return both parts."""
    first = solve(case_system, (0.0, cut), y0, **options)
    second = solve(
        case_system, (cut, end), first.y_end, **{**options, "mode": first.mode}
    )
    return first, second


CUTS = [(at, ulps) for at in (1.0, 0.7) for ulps in (-16, -4, -2, -1, 0, 1, 2, 4, 16)]


@pytest.mark.parametrize(("at", "ulps"), CUTS)
def test_a_cut_near_an_event_neither_loses_nor_doubles_it(ulps, at):
    cut = at + ulps * np.spacing(at)
    params = clock_params([(POWER, at, 1, 1.0)], [1.0])
    parts = in_two(clock(1), cut, 3.0, [0.0, 0.0], params=params, max_steps=10_000)
    assert [part.status for part in parts] == [0, 0]
    assert sum(len(part.events) for part in parts) == 1
    assert parts[1].y_end == pytest.approx([3.0, 3.0 - at], abs=1e-14)
    assert parts[1].mode.tolist() == [1]


@pytest.mark.parametrize("offset", [-1e-3, -1e-9, -1e-12, 1e-12, 1e-9, 1e-3])
def test_a_cut_near_the_apex_neither_loses_nor_doubles_a_graze(offset):
    params, apex = (2.0, 1.0 - 1e-10), 1.0
    parts = in_two(throw(), apex + offset, 1.5, [0.0, 2.0], params=params)
    log = np.concatenate([part.events.time for part in parts])
    assert log == pytest.approx([1 - 1e-5, 1 + 1e-5], abs=1e-7)
    assert parts[1].mode.tolist() == [-1]


def test_samples_at_and_around_jumps_of_the_field():
    """The state is continuous at the instant itself; its neighbours lie on the right piece."""
    places, gains = (0.5, 1.0, 1.0 + 1e-9, 2.0), (1.0, -3.0, 5.0, -2.0)
    times = np.unique(
        [t for a in places for t in (np.nextafter(a, 0), a, np.nextafter(a, 9))]
    )
    params = clock_params([(POWER, a, 1, 1.0) for a in places], gains)
    solution = solve(clock(4), (0, 3), [0.0, 0.0], params=params, t_eval=times)
    exact = [
        sum(g * max(t - a, 0.0) for a, g in zip(places, gains, strict=True))
        for t in times
    ]
    assert solution.t.tolist() == times.tolist()
    assert np.abs(solution.y[1] - exact).max() < 1e-14
    assert np.abs(solution.y[0] - times).max() < 1e-14


def test_samples_do_not_move_events():
    case = random_case(3, affine=True)
    bare = solve(case.system, case.t_span, case.y0, **case.options)
    dense = solve(
        case.system,
        case.t_span,
        case.y0,
        **case.options,
        t_eval=np.linspace(0, 1, 1001),
    )
    assert bare.events.time.tobytes() == dense.events.time.tobytes()
    assert bare.y_end.tobytes() == dense.y_end.tobytes()
