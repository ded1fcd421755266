"""Events that pile up: their limit, and rest."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest

from hopdata.hybrid import System, field, guards, on_event, solve
from hopdata.hybrid.layout import GRAZING_IN_JACOBIAN, ZENO

G = 9.81


@field
def fall(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], -9.81


@guards
def table(t, y, dy, mode, params, h, hdot):  # params: restitution, amplitude, turn
    h[0] = params[1] * np.sin(params[2] * t) - y[0]
    hdot[0] = params[1] * params[2] * np.cos(params[2] * t) - dy[0]


@on_event
def bounce(t, y, mode, params, guard, direction):
    if direction == 1:
        own = params[1] * params[2] * np.cos(params[2] * t)
        y[1] = own - params[0] * (y[1] - own)
    return 0


ball = System(fall, table, bounce, n_states=2, guard_names=("table",))
resting = replace(ball, sliding=("table",), on_zeno="rest")


def limit_of_bounces(restitution, height=1.0):
    first = np.sqrt(2.0 * height / G)
    return first * (1.0 + restitution) / (1.0 - restitution)


@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.8, 0.9])
def test_the_limit_of_a_ball_that_bounces(restitution):
    solution = solve(ball, (0.0, 30.0), [1.0, 0.0], params=[restitution, 0.0, 1.0])
    exact = limit_of_bounces(restitution)
    found = solution.limit
    assert solution.status == ZENO
    assert f"t = {found.time:.17g}" in solution.message
    # Better than where the run had to end, and within its own estimate.
    assert abs(found.time - exact) <= 2.0 * found.time_error
    assert found.time_error < 1e-12
    assert abs(found.time - exact) < abs(solution.t_end - exact)
    assert (np.abs(found.state) <= 2.0 * found.state_error + 1e-15).all()


@field
def carried(t, y, mode, params, dy):
    dy[0] = 1.0


@guards
def geometric(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - params[0], dy[0]


@on_event
def shrink(t, y, mode, params, guard, direction):
    # Gaps of 2^-1, 2^-2, ..., and from the tenth on again of a half.
    if direction > 0:
        mode[1] += 1
        gap = 0.5 ** mode[1]
        if mode[1] > 10:
            gap = 0.5
        y[0] = params[0] - gap
    return 0


def test_gaps_that_shrink_and_then_do_not_are_no_accumulation():
    system = System(
        carried,
        geometric,
        shrink,
        n_states=1,
        guard_names=("ramp",),
        n_extra_modes=1,
    )
    solution = solve(system, (0.0, 20.0), [0.0], params=[1.0])
    assert solution.success
    assert solution.limit is None
    # 1 + (1 - 2^-10) s, then each half second.
    rest = 20.0 - (2.0 - 0.5**10)
    assert len(solution.events.of("ramp", direction=1)) == 11 + int(rest / 0.5)


@pytest.mark.parametrize("restitution", [0.1, 0.3, 0.5, 0.8])
def test_a_ball_comes_to_rest(restitution):
    solution = solve(resting, (0.0, 30.0), [1.0, 0.0], params=[restitution, 0.0, 1.0])
    log = solution.events
    assert solution.success
    assert log.direction[-1] == 4
    assert abs(log.time[-1] - limit_of_bounces(restitution)) < 1e-10
    np.testing.assert_array_equal(solution.mode, [0])
    np.testing.assert_allclose(solution.y_end, 0.0, atol=1e-11)


def test_a_ball_at_rest_leaves_a_table_that_falls_faster():
    shaken = [0.5, 0.1, 11.0]
    solution = solve(resting, (0.0, 6.0), [1.0, 0.0], params=shaken)
    log = solution.events
    assert solution.success
    leaves = log.time[log.direction == -3]
    # Where the table's acceleration is that of gravity, on its way to more.
    np.testing.assert_allclose(0.1 * 11.0**2 * np.sin(11.0 * leaves), G, rtol=1e-8)
    assert len(leaves) >= 3
    assert (np.cos(11.0 * leaves) > 0.0).all()
    # In between it is carried.
    rests = log.time[log.direction == 4]
    middle = 0.5 * (rests[0] + leaves[0])
    there = solve(resting, (0.0, 6.0), [1.0, 0.0], params=shaken, t_eval=[middle])
    assert abs(there.y[0, 0] - 0.1 * np.sin(11.0 * middle)) < 1e-9


#: The derivative of one that rests compiles for 10 s.
BALLS = [ball, resting] if "ALL" in os.environ else [ball]


@pytest.mark.parametrize("system", BALLS)
def test_there_is_no_derivative_at_the_limit(system):
    params = [0.5, 0.0, 1.0]
    solution = solve(system, (0.0, 9.0), [1.0, 0.0], params=params, jacobian=True)
    # The bounces graze, before they pile up.
    assert solution.status in (GRAZING_IN_JACOBIAN, ZENO)


@pytest.mark.parametrize("restitution", [0.5, 0.8])
def test_a_jacobian_that_is_lost_in_a_pile_up_tells_guard_limit_and_way_out(
    restitution,
):
    params = [restitution, 0.0, 1.0]
    lost = solve(ball, (0.0, 9.0), [1.0, 0.0], params=params, jacobian=True)
    assert lost.status == GRAZING_IN_JACOBIAN
    assert abs(lost.limit.time - limit_of_bounces(restitution)) < 1e-9
    for told in (
        f"Guard '{ball.guard_names[0]}' is grazed at",
        f"Its events pile up, {lost.n_events} of them so far",
        f"limit is t = {lost.limit.time:.17g}",
        "End the run before",
    ):
        assert told in lost.message
    piled = solve(ball, (0.0, 9.0), [1.0, 0.0], params=params)
    assert piled.status == ZENO
    assert "on_zeno='rest'" in piled.message


@field
def swung(t, y, mode, params, dy):
    dy[0] = 1.0


@guards
def last_grazes(t, y, dy, mode, params, h, hdot):
    # Crossed at 1, 1.5, 1.75 and 1.875, at gaps that halve; then grazed at params[0].
    one, two, three, four = y[0] - 1.0, y[0] - 1.5, y[0] - 1.75, y[0] - 1.875
    away = y[0] - params[0]
    rise = one * two * three * four
    slope = two * three * four + one * three * four
    slope += one * two * four + one * two * three
    h[0] = rise * away**3
    hdot[0] = (slope * away**3 + 3.0 * rise * away**2) * dy[0]


def test_a_graze_behind_gaps_that_shrink_is_no_pile_up():
    system = System(swung, last_grazes, n_states=1, guard_names=("line",))
    found = solve(system, (0.0, 4.0), [0.0], params=[3.0], jacobian=True)
    assert found.status == GRAZING_IN_JACOBIAN
    np.testing.assert_allclose(found.events.time, [1, 1.5, 1.75, 1.875], atol=1e-8)
    assert found.limit is None
    assert "pile up" not in found.message


def test_wrong_declarations_are_refused():
    with pytest.raises(ValueError, match="on_zeno"):
        replace(ball, on_zeno="go on")
    with pytest.raises(ValueError, match="on_zeno"):
        replace(ball, on_zeno="rest")
