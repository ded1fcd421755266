"""Saltation matrices against known flows."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball, ladder, sliding
from jacobian_checks import saltation_product

from hopdata.errors import ArgumentError
from hopdata.hybrid import System, field, guards, on_event, solve
from hopdata.hybrid.first_order import (
    NoDerivativeError,
    NotTransversalError,
    bouligand_derivative,
    check_c1,
    project_onto_section,
    saltation_matrix,
)
from hopdata.hybrid.first_order.event_selected import CONTINUOUS
from hopdata.hybrid.first_order.second_order import ADDITIVE


def test_bounce_is_the_textbook_one():
    """The state is (height, velocity), restitution e: [[-e, 0], [-g (1 + e) / v, -e]]."""
    g, e, v = 9.81, 0.8, -2.0
    found = saltation_product(ball(), [0.0, v], [0], params=(g, 0.0, e), mode=[-1])
    np.testing.assert_allclose(
        found, [[-e, 0], [-g * (1 + e) / v, -e]], rtol=1e-10, atol=1e-10
    )


@field
def drift_field(t, y, mode, params, dy):
    dy[0] = 1.0 if mode[0] < 0 else 3.0
    dy[1] = t if mode[0] < 0 else -t


@guards
def moving_guard(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - params[0] * t
    hdot[0] = dy[0] - params[0]


@on_event
def push_in_time(t, y, mode, params, guard, direction):
    y[1] += params[1] * t * y[0]
    return 0


def drift(**options):
    return System(
        drift_field, moving_guard, n_states=2, guard_names=("wall",), **options
    )


def test_moving_guard():
    """Deviation a of y0 meets it later by a / (1 - w); from then on y0 gains 2 per unit of time."""
    w, t = 0.25, 2.0
    found = saltation_product(drift(), [w * t, 0.0], [0], params=(w, 0), mode=[-1], t=t)
    expected = [[1 + 2 / (1 - w), 0], [-2 * t / (1 - w), 1]]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def exact_drift(y, w, c, t, end):
    """Return the flow from y at t, before the wall y0 = w t, to the time `end`, beyond it."""
    meets = (y[0] - t) / (w - 1)  # y0 + (s - t) = w s
    y0, y1 = w * meets, y[1] + (meets**2 - t**2) / 2
    y1 += c * meets * y0
    return np.array([y0 + 3 * (end - meets), y1 - (end**2 - meets**2) / 2])


def test_reset_that_depends_on_state_and_time():
    w, c, t = 0.25, 0.7, 2.0
    found = saltation_product(
        drift(on_event=push_in_time), [w * t, 0.0], [0], params=(w, c), mode=[-1], t=t
    )
    # The exact flow holds on both sides of t; both fields have unit state transition.
    here, step = np.array([w * t, 0.0]), 1e-5
    columns = [
        np.subtract(*(exact_drift(here + s * step * e, w, c, t, t) for s in (1, -1)))
        / (2 * step)
        for e in np.eye(2)
    ]
    np.testing.assert_allclose(found, np.array(columns).T, atol=1e-9)


def test_it_takes_the_field_before_to_the_field_after():
    rng = np.random.default_rng(1)
    before, after, slope = rng.normal(size=(3, 4))
    np.testing.assert_allclose(
        saltation_matrix(before, after, slope) @ before, after, rtol=1e-12
    )


def test_a_guard_at_rest_is_refused():
    with pytest.raises(NotTransversalError):
        saltation_matrix([1.0, 0.0], [2.0, 0.0], [0.0, 1.0])


# Orders of crossing: which occur, and their effect.


@field
def bar_field(t, y, mode, params, dy):
    dy[0], dy[1] = y[2], y[3]
    dy[2], dy[3] = -9.81, 0.0
    for k in range(len(params)):
        if mode[k] > 0:
            dy[2] += 20.0
            dy[3] += 60.0 * params[k]


@guards
def bar_guards(t, y, dy, mode, params, h, hdot):
    for k in range(len(params)):
        h[k] = -y[0] - params[k] * np.sin(y[1])
        hdot[k] = -dy[0] - params[k] * np.cos(y[1]) * dy[1]


def pieces_of_bar(places):
    """Return a bar (height, angle, velocities) that lands on all contacts at once."""
    names = tuple(f"contact{k}" for k in range(len(places)))
    system = System(bar_field, bar_guards, n_states=4, guard_names=names)
    state, mode = [0.0, 0.0, -1.0, 0.0], [-1] * len(places)
    return bouligand_derivative(system, state, params=places, mode=mode)


@pytest.mark.parametrize(
    "places", [(-1.0, 0.5), (-1.0, 0.2, 1.0), (-1.0, -0.3, 0.2, 0.7)]
)
def test_a_bar_meets_its_contacts_from_one_end_to_the_other(places):
    """For contacts on a line, height and angle allow only the two monotone orders."""
    d = pieces_of_bar(places)
    n = len(places)
    orders = d.pieces()
    ascending = tuple(range(n))
    assert {order.guards for order in orders} == {ascending, ascending[::-1]}
    for order in orders:
        assert d.order(order.direction) == order.guards
        assert np.linalg.norm(order.direction) == pytest.approx(1.0)
        np.testing.assert_allclose(order.matrix, orders[0].matrix, atol=1e-13)


def test_guards_with_one_surface_are_crossed_together():
    d = bouligand_derivative(
        ladder(2), [1.0, 0.0], params=(1, 1, 0.5, 2.0), mode=[-1, -1]
    )
    orders = d.pieces()
    assert len(orders) == 2
    np.testing.assert_allclose(orders[0].matrix, orders[1].matrix, atol=1e-15)
    np.testing.assert_allclose(orders[0].matrix[0, 0], 3.5)


def test_a_guard_that_is_not_approached_is_refused():
    through = bouligand_derivative(sliding(), [0.0], params=(-1.0, 2.0), mode=[-1])
    np.testing.assert_allclose(through([1.0]), [0.5])
    leaving = bouligand_derivative(sliding(), [0.0], params=(1.0, -2.0), mode=[-1])
    with pytest.raises(
        NotTransversalError, match="guard origin: expected to be approached"
    ):
        leaving([1.0])


def test_a_guard_that_is_met_without_an_end_is_refused():
    """The field points back from beyond: the trajectory would slide."""
    back = bouligand_derivative(sliding(), [0.0], params=(1.0, 2.0), mode=[-1])
    for ask in (lambda: back([1.0]), back.pieces):
        with pytest.raises(NoDerivativeError, match="again and again"):
            ask()


# A rocking block, which one corner may hit twice at one instant.

MASS = 2.0
CORNERS = (-0.3, 0.3)


@field
def block_field(t, y, mode, params, dy):  # height, tilt, and their rates
    dy[0], dy[1], dy[2], dy[3] = y[2], y[3], -9.81, 0.0


@guards
def block_corners(t, y, dy, mode, params, h, hdot):
    for k, x in enumerate((-0.3, 0.3)):
        h[k], hdot[k] = -y[0] - x * y[1], -dy[0] - x * dy[1]


@on_event
def corner_hits(t, y, mode, params, guard, direction):
    if direction > 0:
        x = -0.3 if guard == 0 else 0.3
        speed = y[2] + x * y[3]
        impulse = -(1.0 + params[0]) * speed / (1.0 / 2.0 + x * x / params[1])
        y[2] += impulse / 2.0
        y[3] += impulse * x / params[1]
    return 0


@on_event
def corner_hits_either_way(t, y, mode, params, guard, direction):
    x = -0.3 if guard == 0 else 0.3
    speed = y[2] + x * y[3]
    impulse = -(1.0 + params[0]) * speed / (1.0 / 2.0 + x * x / params[1])
    y[2] += impulse / 2.0
    y[3] += impulse * x / params[1]
    return 0


def block(handler=corner_hits, **options):
    return System(
        block_field,
        block_corners,
        handler,
        n_states=4,
        guard_names=("left", "right"),
        **options,
    )


def flown(state, duration):
    """Return a state in free flight after some time, or before it."""
    y = np.array(state)
    y[:2] += duration * y[2:]
    y[0] -= 9.81 * duration**2 / 2.0
    y[2] -= 9.81 * duration
    return y


HIT_TWICE = 0.05
HIT_ONCE = MASS * CORNERS[1] ** 2  # a corner is the centre of percussion of the other


@pytest.mark.parametrize(
    ("inertia", "words"),
    [
        (HIT_TWICE, {(0, 0, 1, 1, 0, 0), (1, 1, 0, 0, 1, 1)}),
        (HIT_ONCE, {(0, 0, 1, 1), (1, 1, 0, 0)}),
    ],
)
def test_a_corner_that_is_hit_again_at_one_instant_is_followed(inertia, words):
    """States nearby make the events of a piece, and end where its matrix says."""
    params = (0.5, inertia)
    state = np.array([0.0, 0.0, -1.4, 0.0])
    flow = bouligand_derivative(block(), state, params=params, mode=[-1, -1])
    pieces = flow.pieces()
    assert {piece.guards for piece in pieces} == words
    step = 1e-6
    for piece in pieces:
        assert flow.order(piece.direction) == piece.guards
        beside = state + step * piece.direction
        run = solve(
            block(),
            (0.0, 0.053),
            flown(beside, -0.05),
            params=params,
            rtol=1e-12,
            atol=1e-14,
        )
        assert tuple(run.events.guard) == piece.guards
        end = flown(piece.state + step * piece.matrix @ piece.direction, 0.003)
        # The rest is of second order: some 10 times the square of the step. The next
        # corner lands 5 ms after the first.
        np.testing.assert_allclose(run.y_end, end, rtol=0, atol=1e-9)


def test_impacts_that_commute_are_not_said_to_depend_on_their_order():
    """A run has no Jacobian through either pair of impacts, and knows not of which."""
    told = set()
    for inertia in (HIT_TWICE, HIT_ONCE):
        params = (0.5, inertia)
        start = flown([0.0, 0.0, -1.4, 0.0], -0.05)
        run = solve(block(), (0.0, 0.053), start, params=params, jacobian=True)
        assert run.status == -11
        assert "and their order may matter: the flow depends on it, " in run.message
        assert "does not exist or is unknown" in run.message
        options = {"params": params, "mode": [-1, -1]}
        pieces = bouligand_derivative(block(), flown(start, 0.05), **options).pieces()
        told.add(bool(np.allclose(pieces[0].matrix, pieces[1].matrix, atol=1e-9)))
    assert told == {False, True}


def test_impulses_break_other_lines_than_that_of_accelerations():
    """Those that do not commute have two products, and those that do have one."""
    for inertia, passed in ((HIT_TWICE, False), (HIT_ONCE, True)):
        options = {"params": (0.5, inertia), "mode": [-1, -1]}
        report = check_c1(block(), [0.0, 0.0, -1.4, 0.0], **options)
        *_, added = report.fopas
        assert added.condition == ADDITIVE
        assert (added.passed, added.value) == (True, 0.0)
        assert report.products.passed == passed
        assert CONTINUOUS in report.reasons


def test_a_crossing_against_its_direction_is_no_event():
    """As in a run: the lock flips, and the handler is not called."""
    options = {"params": (0.5, HIT_TWICE), "mode": [-1, -1]}
    state = [0.0, 0.0, -1.4, 0.0]
    right = bouligand_derivative(block(), state, **options).pieces()
    one_way = block(corner_hits_either_way, directions=(1, 1))
    found = bouligand_derivative(one_way, state, **options).pieces()
    assert [piece.guards for piece in found] == [piece.guards for piece in right]
    for piece, wanted in zip(found, right, strict=True):
        np.testing.assert_allclose(piece.matrix, wanted.matrix, rtol=1e-12)
    either_way = bouligand_derivative(block(corner_hits_either_way), state, **options)
    with pytest.raises(NoDerivativeError, match="again and again"):
        either_way.pieces()


@pytest.mark.parametrize("speed", [-1.4, -1.1, -0.3])
def test_a_corner_that_an_impact_stops_is_at_rest(speed):
    """Rounding leaves some speed, which is not that of a corner that is left."""
    options = {"params": (0.0, HIT_ONCE), "mode": [-1, -1]}
    flow = bouligand_derivative(block(), [0.0, 0.0, speed, 0.1], **options)
    assert {piece.guards for piece in flow.pieces()} == {(0, 1), (1, 0)}


def test_many_guards_are_found_by_random_deviations():
    bar = pieces_of_bar(tuple(np.linspace(-1, 1, 9)))
    assert {order.guards for order in bar.pieces()} == {
        tuple(range(9)),
        tuple(range(8, -1, -1)),
    }
    for order in bar.pieces():
        assert bar.order(order.direction) == order.guards


# Impact states of a falling ball, whose derivative is known.

G = 9.81


def impact(height, speed, floor_speed):
    """Return the state where a ball meets a floor that rises from 0 at t = 0, and the time."""
    down = speed - floor_speed
    t = (down + np.sqrt(down**2 + 2 * G * height)) / G
    return np.array([floor_speed * t, speed - G * t]), t


@pytest.mark.parametrize("floor_speed", [0.0, 0.3])
def test_derivative_of_the_impact_state(floor_speed):
    start, step = np.array([1.2, 0.4]), 1e-6
    state, t = impact(*start, floor_speed)
    flow, rate = np.array([[1, t], [0, 1]]), np.array([state[1], -G])
    found = project_onto_section(flow, rate, [-1.0, 0.0], time_rate=floor_speed)
    columns = [
        (
            impact(*(start + step * e), floor_speed)[0]
            - impact(*(start - step * e), floor_speed)[0]
        )
        / (2 * step)
        for e in np.eye(2)
    ]
    np.testing.assert_allclose(found, np.array(columns).T, atol=1e-8)


def test_a_section_at_rest_maps_into_itself():
    rng = np.random.default_rng(2)
    flow, rate, slope = rng.normal(size=(4, 4)), rng.normal(size=4), rng.normal(size=4)
    np.testing.assert_allclose(
        slope @ project_onto_section(flow, rate, slope), 0, atol=1e-13
    )
    np.testing.assert_allclose(
        project_onto_section(np.eye(4), rate, slope) @ rate, 0, atol=1e-13
    )


def test_grazing_is_refused():
    with pytest.raises(NotTransversalError):
        project_onto_section(np.eye(2), [0.0, 1.0], [1.0, 0.0])


def falling(t, y):
    return y[1], -9.81


def feet(t, y):
    return -y[0]


def bounce_of_six(t, y, mode, p, guard, direction):
    return y[0], -0.5 * y[1]


def bounce(t, y, p, guard, direction):
    return y[0], -0.5 * y[1]


def test_a_state_that_a_handler_of_six_arguments_returns_is_refused():
    """The driver refuses it, too."""
    state = [0.0, -1.0]
    wrong = System(falling, feet, bounce_of_six, n_states=2, guard_names=("foot",))
    with pytest.raises(ArgumentError, match="on_event: expected 0 to go on"):
        check_c1(wrong, state, mode=[-1])
    right = System(falling, feet, bounce, n_states=2, guard_names=("foot",))
    assert check_c1(right, state, mode=[-1]).verdict
