"""Guards that bend, or move faster than the state: no contact is missed, none is spurious."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from stress_case import judge, turned_back
from stress_quick import (
    FAMILIES,
    MEMBERS,
    METHODS,
    RTOLS,
    ball_on_table,
    bounces,
    members,
    quick,
    quick_member,
    table_member,
)

from hopdata.hybrid import System, field, guards, solve, solve_batch
from hopdata.hybrid.layout import ZENO


@pytest.mark.parametrize("family", FAMILIES)
def test_no_contact_of_a_family_is_missed(family):
    for rtol in RTOLS:
        for case in members(family, rtol):
            for method in METHODS:
                options = {**case.options, "method": method}
                verdict = judge(
                    replace(case, system=quick(method == "taylor"), options=options)
                )
                assert verdict.right, (case, options, verdict)


@pytest.mark.parametrize("family", [one for one in FAMILIES if one != "after an event"])
def test_no_contact_of_a_family_is_missed_on_the_way_back(family):
    for rtol in RTOLS:
        for method, case in zip(METHODS, members(family, rtol), strict=False):
            options = {**case.options, "method": method}
            case = replace(case, system=quick(method == "taylor"), options=options)
            assert judge(turned_back(case)).right, case


@pytest.mark.parametrize("rtol", RTOLS)
def test_no_contact_with_a_shaking_table_is_missed(rtol):
    rng = np.random.default_rng(3)
    for _ in range(5 * MEMBERS):
        case = table_member(rng, rtol)
        assert judge(case).right, (case.y0, case.options)


@pytest.mark.parametrize("rtol", RTOLS)
def test_a_ball_does_not_pass_through_the_table(rtol):
    params = np.array([0.493, 0.0726, 25.17, 0.0])
    right = bounces(params, 0.6334, 1.5)
    assert right is not None
    end = solve(ball_on_table(), (0.0, 1.5), [0.6334, 0.0], params=params, rtol=rtol)
    assert end.success
    assert len(end.events) == len(right[0])
    assert np.abs(end.y_end - right[1]).max() < 1e-9


def test_batches_and_jacobians_miss_none():
    for family in ("surface", "sine of the state", "table", "after an event"):
        rng = np.random.default_rng(8)
        for _ in range(MEMBERS):
            case = quick_member(family, rng, 1e-9)
            options = {**case.options, "jacobian": True, "method": "dop853"}
            assert judge(replace(case, options=options)).right, (family, case.options)
            starts = np.tile(np.asarray(case.y0), (3, 1))
            batch = solve_batch(case.system, case.t_span, starts, **case.options)
            assert (batch.n_events == len(case.answers[0].events)).all(), (
                family,
                case.options,
            )
            alone = solve(case.system, case.t_span, case.y0, **case.options)
            assert (batch.y_end == alone.y_end).all()


@field
def growing(t, y, mode, params, dy):
    dy[0] = y[0]


@guards
def at_integers(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = np.sin(np.pi * y[0]), np.pi * np.cos(np.pi * y[0]) * dy[0]


@pytest.mark.parametrize("rtol", RTOLS)
def test_a_state_that_grows_passes_each_integer(rtol):
    """Many events in one step, at any tolerance: the path may be off, but it passes them all."""
    system = System(growing, at_integers, n_states=1, guard_names=("integer",))
    solution = solve(
        system, (0.0, np.log(199.5 / 0.5)), [0.5], rtol=rtol, atol=1e-3 * rtol
    )
    assert solution.success
    passed = np.arange(1, int(solution.y_end[0]) + 1)
    assert np.abs(solution.events.before[:, 0] - passed).max() < 1e-9 * passed[-1]
    assert rtol > 1e-5 or len(passed) == 199


@field
def gliding(t, y, mode, params, dy):
    dy[0] = 1.0


@guards
def told_wrongly(t, y, dy, mode, params, h, hdot):
    """Fill in a wave whose rate is params[0] times the right one, with noise of size params[1]."""
    rate = 3.0 * np.cos(3.0 * y[0]) * dy[0]
    noise = np.sin(1e9 * y[0] % 6.283)
    h[0], hdot[0] = np.sin(3.0 * y[0]) - 0.5, params[0] * rate + params[1] * noise


@pytest.mark.parametrize(
    ("factor", "noise"),
    [(0.0, 0.0), (-1.0, 0.0), (2.5, 0.0), (1.0, 30.0), (1.0, 1e-6), (1.1, 0.0)],
)
def test_wrong_rates_make_no_flip_pass_unseen(factor, noise):
    system = System(gliding, told_wrongly, n_states=1, guard_names=("wave",))
    solution = solve(system, (0.0, 10.0), [0.0], params=[factor, noise])
    first, second = np.arcsin(0.5) / 3.0, (np.pi - np.arcsin(0.5)) / 3.0
    turns = np.arange(5) * 2.0 * np.pi / 3.0
    expected = np.sort(np.concatenate([first + turns, second + turns]))
    if factor < 0.0 or noise > 3.0:  # its sign is wrong on the surface
        assert solution.status == ZENO
        assert abs(solution.t_end - expected).min() < 1e-9
        return
    assert solution.success
    assert np.abs(solution.events.time - expected[expected < 10.0]).max() < 1e-9


@guards
def narrow(t, y, dy, mode, params, h, hdot):
    """Fill in a root that does not exist beyond 2."""
    if y[0] > 2.0:
        raise ValueError("beyond the end of the world")
    h[0], hdot[0] = np.sqrt(2.0 - y[0]) - 1.2, -0.5 * dy[0] / np.sqrt(2.0 - y[0])


def test_guards_are_asked_on_the_path_only():
    system = System(gliding, narrow, n_states=1, guard_names=("root",))
    solution = solve(system, (0.0, 1.999), [0.0])
    assert solution.success
    assert abs(solution.events.time[0] - (2.0 - 1.2**2)) < 1e-12
