"""Instants as sequences: impacts that meet at a point, cascades, and the order of handlers."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hybrid_systems import collide, collide_and_unlock, ladder, row_of_balls

from hopdata.hybrid import (
    System,
    field,
    guard,
    guards,
    on_event,
    rate_bound,
    solve,
    solve_batch,
)
from hopdata.hybrid.layout import SLIDING, TIE_IN_JACOBIAN, ZENO

END = 3.0
KINDS = ("dyadic", "rounding", "two groups", "touching", "grid")


def meeting(kind, rng):
    """Return positions and velocities of 3 to 6 balls of which several meet at one instant."""
    n = int(rng.integers(3, 7))
    if kind == "dyadic":  # all meet at exactly t = 1
        v = np.sort(rng.choice(np.arange(-16, 17), n, replace=False))[::-1] / 4.0
        return -v, v
    if kind == "rounding":  # all meet, but for some units in the last place
        v, place, time = np.sort(rng.uniform(-4, 4, n))[::-1], *rng.uniform(0.3, 1.7, 2)
        return np.maximum.accumulate(
            place - v * time + 1e-16 * rng.integers(-4, 5, n)
        ), v
    if kind == "two groups":  # each meets at t = 0.5, and later they mix
        left = rng.uniform(0, 4, n // 2)
        right = rng.uniform(-4, 0, n - n // 2)
        v = np.concatenate([np.sort(left)[::-1], np.sort(right)[::-1]])
        return np.repeat([0.0, 2.0], [len(left), len(right)]) - 0.5 * v, v
    if kind == "touching":  # some touch at the start
        return np.cumsum(rng.integers(0, 2, n)).astype(float), rng.integers(
            -8, 9, n
        ) / 4.0
    return np.cumsum(rng.integers(1, 4, n)).astype(float), rng.integers(
        -4, 5, n
    ).astype(float)


def run(
    x,
    v,
    masses,
    restitution=1.0,
    on_event=collide,
    spring=0.0,
    span=(0.0, END),
    **options,
):
    system = row_of_balls(len(x), on_event=on_event)
    return solve(
        system, span, [*x, *v], mode=[1] * (len(x) - 1), params=[*masses, restitution, spring],
        **options,
    )  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("method", ["auto", "dop853"])
def test_equal_balls_pass_as_if_free(kind, method):
    """Each impact swaps two velocities, so the positions are those of free balls, sorted."""
    rng = np.random.default_rng([1, KINDS.index(kind)])
    for _ in range(200):
        x, v = meeting(kind, rng)
        rtol = 10.0 ** -rng.integers(3, 12)
        found = run(x, v, np.ones(len(x)), method=method, rtol=rtol)
        assert found.success, found.message
        assert found.y_end[: len(x)] == pytest.approx(np.sort(x + v * END), abs=1e-12)


def test_where_the_step_ends_past_several_surfaces():
    """Two groups meet at one instant. The last gap closes slowly: its rounding takes longest."""
    x = [-1.1052496665027656, -0.5207675016697937, 2.649079006550833, 3.864853234829172,
         3.905937645722365]  # fmt: skip
    v = [2.210499333005531, 1.0415350033395874, -1.2981580131016668, -3.729706469658345,
         -3.8118752914447307]  # fmt: skip
    free = np.sort(np.array(x) + END * np.array(v))
    for rtol in 10.0 ** -np.arange(3, 12):
        found = run(x, v, np.ones(5), rtol=rtol)
        assert found.success, found.message
        assert found.y_end[:5] == pytest.approx(free, abs=1e-12)


def test_slow_and_fast_gaps_far_from_the_origin():
    """A slow gap's rounding leaves the instant unsure by far more than that of a fast one."""
    rng = np.random.default_rng(8)
    for _ in range(600):
        n = int(rng.integers(3, 7))
        v = np.sort(rng.uniform(-4, 4, n))[::-1] * 10.0 ** rng.integers(-6, 1)
        v = v + rng.uniform(-1, 1) * 10.0 ** rng.integers(-2, 3)
        place = rng.uniform(-1, 1) * 10.0 ** rng.integers(0, 7)
        x = np.maximum.accumulate(place - v * rng.uniform(0.1, 2.0))
        found = run(x, v, np.ones(n), rtol=10.0 ** -rng.integers(6, 12))
        assert found.success, found.message
        size = np.abs(x).max() + END * np.abs(v).max()
        assert found.y_end[:n] == pytest.approx(np.sort(x + v * END), abs=1e-12 * size)


@pytest.mark.parametrize("kind", KINDS)
def test_unequal_balls_keep_order_momentum_and_energy(kind):
    rng = np.random.default_rng([2, KINDS.index(kind)])
    instants = 0
    for _ in range(100):
        x, v = meeting(kind, rng)
        masses = 10 ** rng.uniform(-2, 2, len(x))
        found = run(x, v, masses)
        assert found.success, found.message
        assert np.diff(found.y[: len(x)], axis=0).min() > -1e-12
        before = np.array([masses @ v, masses @ v**2])
        after = np.array(
            [masses @ found.y_end[len(x) :], masses @ found.y_end[len(x) :] ** 2]
        )
        assert after == pytest.approx(
            before, rel=1e-11, abs=1e-11 * (masses @ np.abs(v))
        )
        instants += len(set(found.events.time.tolist())) < len(found.events) // 2
    assert instants > 50 or kind in (
        "touching",
        "grid",
    )  # several impacts at one instant


def test_balls_on_equal_springs_meet_at_each_half_period():
    """From rest, all reach the origin at once whatever their distance."""
    rng = np.random.default_rng(3)
    for _ in range(60):
        x = np.sort(rng.uniform(-2, 2, rng.integers(3, 7)))
        found = run(x, 0 * x, np.ones(len(x)), spring=1.0, span=(0, 10.0), rtol=1e-10)
        assert found.success, found.message
        assert found.y_end[: len(x)] == pytest.approx(
            np.sort(x * np.cos(10.0)), abs=1e-8
        )
        assert len(found.events) >= 3 * len(x) * (
            len(x) - 1
        )  # three meetings, two flips an impact


@pytest.mark.parametrize("kind", KINDS[:3])
def test_backward_in_time(kind):
    rng = np.random.default_rng([4, KINDS.index(kind)])
    for _ in range(20):
        x, v = meeting(kind, rng)
        found = solve(
            row_of_balls(len(x), undo=collide), (END, 0.0), [*x, *-v], mode=[1] * (len(x) - 1),
            params=[*np.ones(len(x)), 1.0, 0.0],
        )  # fmt: skip
        assert found.success, found.message
        assert found.y_end[: len(x)] == pytest.approx(np.sort(x + v * END), abs=1e-12)


@guard
def one_gap(t, y, dy, mode, params, k, h, hdot):
    h[k] = y[k + 1] - y[k]
    hdot[k] = dy[k + 1] - dy[k]


@rate_bound
def twice_the_fastest(t, y, dy, mode, params):
    return 2.0 * np.abs(dy[: len(dy) // 2]).max()


def test_sleeping_guards_see_the_same_impacts():
    rng = np.random.default_rng(5)
    for kind in KINDS:
        for _ in range(20):
            x, v = meeting(kind, rng)
            plain = row_of_balls(len(x))
            system = System(
                plain.field, guard=one_gap, rate_bound=twice_the_fastest, on_event=plain.on_event,
                n_states=2 * len(x), guard_names=plain.guard_names,
            )  # fmt: skip
            given = {"mode": [1] * (len(x) - 1), "params": [*np.ones(len(x)), 1.0, 0.0]}
            found = solve(system, (0, END), [*x, *v], **given)
            assert found.success, found.message
            assert found.y_end[: len(x)] == pytest.approx(
                np.sort(x + v * END), abs=1e-12
            )


@pytest.mark.parametrize("restitution", [0.9, 0.5, 0.1, 0.0])
def test_inelastic_balls_keep_their_order_or_are_refused(restitution):
    """A handler that sets the lock of its guard lets bodies rest on each other."""
    rng = np.random.default_rng([6, int(10 * restitution)])
    statuses = {collide: set(), collide_and_unlock: set()}
    for _ in range(100):
        x, v = meeting(KINDS[rng.integers(len(KINDS))], rng)
        masses = 10 ** rng.uniform(-1, 1, len(x))
        for handler, seen in statuses.items():
            if restitution == 0.0 and handler is collide:
                continue  # a guard that its handler stops stays on its new side
            found = run(x, v, masses, restitution, handler)
            seen.add(found.status)
            if found.success:
                assert np.diff(found.y[: len(x)], axis=0).min() > -1e-11
                assert masses @ found.y_end[len(x) :] ** 2 <= masses @ v**2 * (
                    1 + 1e-12
                )
    for seen in statuses.values():
        assert seen <= {0, ZENO}
    assert 0 in statuses[collide_and_unlock]
    assert ZENO in statuses[collide] or restitution in (0.9, 0.0)


@pytest.mark.parametrize(("restitution", "status"), [(0.05, ZENO), (0.08, 0)])
def test_inelastic_collapse(restitution, status):
    """Three equal balls collapse below 7 - 4 sqrt(3) = 0.0718 (McNamara and Young 1992).

    They then rest on each other. A handler that sets the lock says so, and the run goes
    on.
    """
    x = np.array([-1.0, 0.0, 1.0])
    v = [1.0, 0.0, -1.0]
    found = run(x, v, np.ones(3), restitution)
    assert found.status == status, found.message
    assert status == 0 or "push guards across without an end" in found.message
    rests = run(x, v, np.ones(3), restitution, collide_and_unlock)
    assert rests.status == 0
    assert (np.ptp(rests.y_end[3:]) < 1e-15) == (status == ZENO)


# Long cascades: a light ball rests at a wall, and a heavy one arrives.


@field
def two_fly(t, y, mode, params, dy):
    dy[0] = y[2]
    dy[1] = y[3]
    dy[2] = 0.0
    dy[3] = 0.0


@guards
def wall_and_gap(t, y, dy, mode, params, h, hdot):
    h[0] = y[0]
    h[1] = y[1] - y[0]
    hdot[0] = dy[0]
    hdot[1] = dy[1] - dy[0]


@on_event
def wall_or_ball(t, y, mode, params, guard, direction):
    if direction < 0 and guard == 0:
        y[2] = -y[2]
    elif direction < 0:
        share = 2.0 * (y[3] - y[2]) / (1.0 + params[0])
        y[2], y[3] = y[2] + params[0] * share, y[3] - share
    return 0


def at_wall(handler=wall_or_ball):
    """Return a new system, whose log has its first size."""
    return System(
        two_fly, wall_and_gap, handler, n_states=4, guard_names=("wall", "ball")
    )


@pytest.mark.parametrize(("ratio", "impacts"), [(1e2, 31), (1e4, 314), (1e6, 3141)])
@pytest.mark.parametrize("dense", [False, True])
def test_impacts_count_the_digits_of_pi(ratio, impacts, dense):
    """All at one instant; the log is full long before the last (Galperin 2003)."""
    start = [0.0, 1.0, 0.0, -1.0]
    options = {"mode": [1, 1], "params": [ratio], "dense_output": dense}
    found = solve(at_wall(), (0, 2.0), start, **options)
    assert found.success, found.message
    log = found.events
    assert len(log) == found.n_events == 2 * impacts
    assert (np.abs(log.time - 1.0) < 1e-12).all()
    # the heavy ball leaves, with all energy but what the light one keeps
    assert found.y_end[3] == pytest.approx(1.0, abs=2 * ratio**-0.5)
    assert found.y_end[2] ** 2 + ratio * found.y_end[3] ** 2 == pytest.approx(
        ratio, rel=1e-9
    )
    assert (np.diff(found.t) > 0).all()
    after = found.y[:, np.searchsorted(found.t, log.time[0])]
    assert after == pytest.approx(log.after[-1], abs=1e-15)
    if dense:
        assert found(log.time[0], side="left")[2:] == pytest.approx(
            [0.0, -1.0], abs=1e-12
        )
        assert found(log.time[0])[2:] == pytest.approx(found.y_end[2:], abs=1e-12)
        assert found(1.5)[2:] == pytest.approx(found.y_end[2:], abs=1e-12)


def test_a_log_that_fills_up_within_an_instant_is_handed_over():
    start = [0.0, 1.0, 0.0, -1.0]
    pieces = []
    given = {"params": [1e4], "mode": [1, 1], "t_eval": [0.5, 1.0, 1.5]}
    system = at_wall()
    plain = solve(system, (0, 2.0), start, **given)
    counted = solve(at_wall(), (0, 2.0), start, events="count", **given)
    handed = solve(at_wall(), (0, 2.0), start, events=pieces.append, **given)
    assert counted.n_events == handed.n_events == len(plain.events) == 628
    assert len(pieces) > 1
    assert (
        np.concatenate([piece.after for piece in pieces]).tolist()
        == plain.events.after.tolist()
    )
    for one in (counted, handed):
        assert one.y.tolist() == plain.y.tolist()
        assert one.y_end.tolist() == plain.y_end.tolist()
    batch = solve_batch(at_wall(), (0, 2.0), [start] * 3, **given)
    assert batch.y[2].tolist() == plain.y.tolist()
    again = solve(system, (0, 2.0), start, **given)  # in the larger log of the first
    assert again.events.after.tolist() == plain.events.after.tolist()


@on_event
def throw_back(t, y, mode, params, guard, direction):
    if direction < 0:
        y[2] = 1.0 if guard == 0 else -1.0  # towards the other guard
        y[3] = 0.0
    return 0


def test_a_cascade_that_does_not_end_says_so():
    """Each of two handlers throws the light ball to the other guard, for ever."""
    found = solve(at_wall(throw_back), (0, 2.0), [0.0, 1.0, 0.0, -1.0], mode=[1, 1])
    assert found.status == ZENO
    assert found.t_end == pytest.approx(1.0, abs=1e-15)
    assert 10_000 < found.n_events < 11_000
    assert found.message.startswith("Events pile up at t = ")
    assert len(found.events) == found.n_events
    assert "push guards across without an end" in found.message


# The order of handlers.


@field
def passing(t, y, mode, params, dy):
    dy[0] = 1.0
    dy[1] = 0.0
    dy[2] = 0.0


@guards
def planes(t, y, dy, mode, params, h, hdot):
    for k in range(len(h)):
        h[k] = y[0] - params[k]
        hdot[k] = dy[0]


@on_event
def turn(t, y, mode, params, guard, direction):
    first = len(mode) + 4 * guard
    old = y[1]
    y[1] = params[first] * old + params[first + 1] * y[2]
    y[2] = params[first + 2] * old + params[first + 3] * y[2]
    return 0


@on_event
def turn_back(t, y, mode, params, guard, direction):
    first = len(mode) + 4 * guard
    a = params[first]
    b = params[first + 1]
    c = params[first + 2]
    d = params[first + 3]
    old = y[1]
    det = a * d - b * c
    y[1] = (d * old - b * y[2]) / det
    y[2] = (a * y[2] - c * old) / det
    return 0


@cache
def turned(n):
    names = tuple(f"plane{k}" for k in range(n))
    return System(passing, planes, turn, undo=turn_back, n_states=3, guard_names=names)


@pytest.mark.parametrize("commuting", [False, True])
@pytest.mark.parametrize("gap", [0.0, 1e-17, 1e-16, 1e-15, 1e-13])
def test_resets_at_coincident_planes(gap, commuting):
    """By number where the planes coincide; by time where they are apart by more than rounding."""
    rng = np.random.default_rng([7, int(-np.log10(gap + 1e-18))])
    differ = 0
    for _ in range(30):
        n = int(rng.integers(2, 6))
        places = rng.uniform(0.2, 1.5) + gap * rng.integers(-3, 4, n)
        matrices = rng.normal(size=(n, 2, 2))
        if commuting:
            matrices = matrices * np.eye(2)
        system = turned(n)
        start = [0.0, *rng.normal(size=2)]
        params = [*places, *matrices.ravel()]
        found = solve(system, (0, 2.0), start, params=params)
        assert found.success, found.message
        order = found.events.guard.tolist()
        assert sorted(order) == list(range(n))
        assert gap > 0.0 or order == list(range(n))
        assert gap < 1e-13 or order == np.argsort(places, kind="stable").tolist()
        expected = np.array(start[1:])
        by_number = np.array(start[1:])
        for k in range(n):
            expected = matrices[order[k]] @ expected
            by_number = matrices[k] @ by_number
        assert found.y_end[1:] == pytest.approx(expected, rel=1e-11, abs=1e-13)
        differ += not np.allclose(expected, by_number, rtol=1e-9)
        back = solve(system, (2.0, 0.0), found.y_end, params=params)
        assert gap > 0.0 or back.events.guard.tolist() == order[::-1]
        if gap == 0.0 or gap == 1e-13 or commuting:
            assert back.y_end == pytest.approx(start, rel=1e-8, abs=1e-9)
    assert differ == 0 or (gap > 0.0 and not commuting)


# Guards that are due together, of which the first turns the second back.


@field
def turning(t, y, mode, params, dy):
    dy[0] = 1.0
    dy[1] = 1.0 if mode[0] < 0 else params[0]


@guards
def two_zeros(t, y, dy, mode, params, h, hdot):
    h[0] = y[0]
    h[1] = y[1]
    hdot[0] = dy[0]
    hdot[1] = dy[1]


@field
def helped_across(t, y, mode, params, dy):
    dy[0] = -0.5 if mode[0] > 0 and mode[1] < 0 else 1.0
    dy[1] = 1.0


def test_a_guard_waits_for_others_before_it_flips_back():
    """The first guard's flip alone turns the field back; the second one's flip turns it on."""
    system = System(helped_across, two_zeros, n_states=2, guard_names=("a", "b"))
    found = solve(system, (0, 1), [-0.5, -0.5])
    assert found.status == 0
    assert found.events.guard.tolist() == [0, 1]
    assert found.y_end == pytest.approx([0.5, 0.5], abs=1e-14)
    assert solve(system, (0, 1), [-0.5, -0.5], jacobian=True).status == TIE_IN_JACOBIAN
    slides = solve(system, (0, 1), [-0.5, -0.6])  # alone, the first is not crossed
    assert slides.status == SLIDING


@on_event
def stop_first(t, y, mode, params, guard, direction):
    return 1 if guard == 0 else 0


@pytest.mark.parametrize(("speed", "crossed"), [(-1.0, [0]), (0.5, [0, 1])])
def test_a_guard_that_the_first_turns_back_is_no_event(speed, crossed):
    system = System(turning, two_zeros, n_states=2, guard_names=("a", "b"))
    found = solve(system, (0, 1), [-0.5, -0.5], params=[speed])
    assert found.events.guard.tolist() == crossed
    assert found.mode.tolist() == [1, 1 if len(crossed) == 2 else -1]
    assert found.y_end == pytest.approx([0.5, 0.5 * speed], abs=1e-14)
    carried = solve(system, (0, 1), [-0.5, -0.5], params=[speed], jacobian=True)
    if crossed == [0]:  # neighbours that meet b first cross it
        assert carried.status == TIE_IN_JACOBIAN
    else:
        assert carried.jacobian == pytest.approx(
            np.array([[1.0, 0.0], [speed - 1.0, 1.0]])
        )


@pytest.mark.parametrize(("speed", "crossed"), [(-1.0, [0]), (0.5, [0, 1])])
def test_what_is_due_at_a_terminal_event_is_an_event_still(speed, crossed):
    system = System(turning, two_zeros, stop_first, n_states=2, guard_names=("a", "b"))
    for options in ({}, {"jacobian": True}):
        found = solve(system, (0, 1), [-0.5, -0.5], params=[speed], **options)
        if not options or len(crossed) == 2:
            assert found.status == 1
            assert "'a' ended" in found.message
            assert found.events.guard.tolist() == crossed
            assert found.t_end == pytest.approx(0.5, abs=1e-15)


@on_event
def collide_once(t, y, mode, params, guard, direction):
    swapped = y[3 + guard]
    y[3 + guard] = y[4 + guard]
    y[4 + guard] = swapped
    return 1


def test_nothing_new_follows_a_terminal_event():
    """The first impact ends the run; its guard does not flip back, and the second gap opens."""
    found = run([-1.0, 0.0, 1.0], [1.0, 0.0, -1.0], np.ones(3), on_event=collide_once)
    assert found.status == 1
    assert found.events.guard.tolist() == [0, 1]
    assert found.mode.tolist() == [-1, -1]
    assert found.y_end[3:].tolist() == [0.0, -1.0, 1.0]


# Jacobians.


@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_impacts_at_one_point_have_no_jacobian_of_one_order(shift):
    x = np.array([-1.0, 0.0, 1.0 + shift])
    v = [1.0, 0.0, -1.0]
    found = run(x, v, np.ones(3), jacobian=True)
    if shift == 0.0:
        assert found.status == TIE_IN_JACOBIAN
        return
    one = np.eye(3)[::-1]  # free balls, sorted: the first is now the last
    assert found.jacobian == pytest.approx(
        np.block([[one, END * one], [0 * one, one]]), abs=1e-9
    )


def test_a_start_past_several_surfaces():
    """They flip at the start, for neighbours as well; the third is met on the way."""
    given = {"params": (0.5, 0.6, 0.9, 1.0, 1.0, 1.0), "mode": [-1, -1, -1]}
    found = solve(ladder(3), (0, 1), [0.7, 0.0], jacobian=True, **given)
    assert found.events.guard.tolist() == [0, 1, 2]
    ends = [
        [
            solve(ladder(3), (0, 1), np.array([0.7, 0.0]) + step, **given).y_end
            for step in (d, -d)
        ]
        for d in 1e-5 * np.eye(2)
    ]
    right = np.array([(up - down) / 2e-5 for up, down in ends]).T
    assert found.jacobian == pytest.approx(right, abs=1e-8)
