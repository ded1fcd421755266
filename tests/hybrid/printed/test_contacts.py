"""Several events within one step, on a system whose exact trajectory the method can follow."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ladder, ladder_solution

from hopdata.hybrid.printed import PrintedOptions, region_of, resolve_contacts
from hopdata.hybrid.printed.contacts import heun3_step, impact_fractions
from hopdata.hybrid.printed.roots import FINDERS

each = pytest.mark.parametrize("options", [PrintedOptions(name) for name in FINDERS], ids=FINDERS)
LONG = 3.0


def resolve(rungs, gains, options=None):
    """Resolve a step of the ladder from rest at 0, which in its first mode moves at speed 1."""
    region = region_of(ladder(len(rungs)), (*rungs, *gains))
    wrong_end = np.array([LONG, 0.5 * LONG**2])
    locks = region.first_locks(0.0, np.zeros(2))
    return resolve_contacts(region, 0.0, np.zeros(2), LONG, wrong_end, locks, options)


@each
@pytest.mark.parametrize("rungs", [[0.5, 1.0, 1.25], [2.5, 0.3, 0.31], [1.0, 1.0, 1.0]])
def test_any_order_of_events(rungs, options):
    gains = [0.5, -0.9, 3.0]
    found = resolve(rungs, gains, options)
    instants, end = ladder_solution(rungs, gains, LONG)
    assert found.y[0] == pytest.approx(end, abs=1e-14)
    assert {one.guard: one.time for one in found.crossings} == pytest.approx(
        {k: time for k, time in enumerate(instants) if time <= LONG}, abs=1e-14
    )
    assert found.locks.tolist() == [1 if time <= LONG else -1 for time in instants]


def test_guards_that_a_later_mode_does_not_reach_are_not_crossed():
    found = resolve([0.5, 1.5], [-0.9, 0.0])
    assert [one.guard for one in found.crossings] == [0]
    assert found.y[0] == pytest.approx(0.5 + 0.1 * 2.5)


def test_guards_that_only_a_later_mode_reaches_are():
    found = resolve([0.5, 4.0], [2.0, 0.0])
    assert [one.guard for one in found.crossings] == [0, 1]


def test_slopes_not_refreshed_bend_the_state_at_later_events():
    """As printed, the second spline has the slopes of the first mode at both ends."""
    rungs, gains = [0.5, 1.5], [1.0, 1.0]
    end = ladder_solution(rungs, gains, LONG)[1]
    stale = resolve(rungs, gains, PrintedOptions(refresh_slopes=False))
    assert resolve(rungs, gains).y[0] == pytest.approx(end, abs=1e-14)
    assert abs(stale.y[0] - end) > 0.1


@each
@pytest.mark.parametrize("beyond", [1e-17, 0.0, -1e-17])
def test_a_second_guard_at_the_surface_has_an_instant(options, beyond):
    """Crossing together, guards are at zero to rounding: with +1e-17 there is no bracket."""
    region = region_of(ladder(1), (0.0, 1.0))
    y0, y1, f = np.array([beyond, 0.0]), np.array([1.0, 0.0]), np.array([1.0, 0.0])
    locks, candidates = np.array([-1]), np.array([0])
    parts = impact_fractions(region, 0.0, y0, f, 1.0, y1, f, locks, candidates, options)
    assert parts == pytest.approx([0.0], abs=2e-17)


def test_an_event_at_the_very_end_leaves_no_step():
    found = resolve([LONG], [1.0])
    assert [(one.guard, one.time) for one in found.crossings] == [(0, LONG)]
    assert found.y[0] == LONG
    assert found.locks.tolist() == [1]


def test_heun_is_of_third_order():
    steps, errors = 0.05 / 2.0 ** np.arange(5), []
    for dt in steps:
        end = heun3_step(lambda t, y: y * np.cos(t), 0.0, np.ones(1), np.ones(1), dt)
        errors.append(abs(end[0] - np.exp(np.sin(dt))))
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(4.0, abs=0.1)
