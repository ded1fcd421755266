"""Gradients at instants that are special, and where there is none."""

import numpy as np
import pytest

from hopdata.errors import ArgumentError
from hopdata.hybrid import System, field, guards, layout, on_event, solve
from hopdata.hybrid.gradients import gradient

TIGHT = {"rtol": 1e-12, "atol": 1e-13}
G = 9.81


@field
def two_bodies(t, y, mode, params, dy):  # heights and their rates, on springy floors
    for k in range(2):
        dy[k], dy[2 + k] = y[2 + k], -G
        if mode[k] > 0:
            dy[2 + k] -= params[k] * y[k]


@guards
def floors(t, y, dy, mode, params, h, hdot):
    for k in range(2):
        h[k], hdot[k] = -y[k], -dy[k]


@on_event
def bounce(t, y, mode, params, guard, direction):
    if direction > 0:
        y[2 + guard] *= -0.8
    return 0


NAMES = ("one", "other")
SPRINGY = System(two_bodies, floors, n_states=4, guard_names=NAMES)
BOUNCING = System(two_bodies, floors, bounce, n_states=4, guard_names=NAMES)
FIRST = System(
    two_bodies, floors, bounce, n_states=4, guard_names=NAMES, directions=(1, 1),
    terminal=(True, False),
)  # fmt: skip
PARAMS = [300.0, 200.0]


def last(t, y, params):
    return y[0] + 2.0 * y[1] + 0.5 * y[2] - y[3] + 3.0 * t


def slopes(lose, at, step=1e-5):
    found = []
    for axis in np.eye(len(at)):
        found.append((lose(at + step * axis) - lose(at - step * axis)) / (2.0 * step))
    return np.array(found)


def test_guards_that_only_change_the_field_may_flip_together():
    start = [1.0, 1.0, 0.0, 0.0]
    options = {"params": PARAMS, "method": "dop853", **TIGHT}
    found = gradient(SPRINGY, (0.0, 1.0), start, at_end=last, **options)
    forward = solve(SPRINGY, (0.0, 1.0), start, jacobian="params", **options)
    assert forward.events.time[0] == forward.events.time[1]
    weights = np.array([1.0, 2.0, 0.5, -1.0])
    np.testing.assert_allclose(found.by_start, weights @ forward.jacobian, rtol=1e-9)
    np.testing.assert_allclose(
        found.by_params, weights @ forward.sensitivity, rtol=1e-9
    )


@pytest.mark.parametrize(("height", "known"), [(1.0, False), (1.01, True)])
def test_handlers_at_one_instant_leave_no_derivative(height, known):
    start = [1.0, height, 0.0, 0.0]
    found = gradient(BOUNCING, (0.0, 0.7), start, params=PARAMS, at_end=last)
    assert found.success == known
    assert np.isfinite(found.by_start).all() == known
    if not known:
        assert found.status == layout.TIE_IN_JACOBIAN
        assert "Several guards" in found.message


def test_the_time_of_an_end_by_an_event_counts():
    def lose(start):
        return gradient(
            FIRST, (0.0, np.inf), start, params=PARAMS, at_end=last, **TIGHT
        )

    start = np.array([1.0, 1.2, 0.1, 0.0])
    found = lose(start)
    assert found.status == layout.TERMINATED
    by_difference = slopes(lambda one: lose(one).value, start)
    np.testing.assert_allclose(found.by_start, by_difference, rtol=1e-7, atol=1e-7)


@on_event
def stick(t, y, mode, params, guard, direction):
    y[1] *= -0.5
    return 0


@field
def thrown(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -G


@guards
def ceiling(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - params[0], dy[0]


CEILING = System(
    thrown, ceiling, stick, n_states=2, guard_names=("ceiling",), directions=(1,)
)


def height(t, y, params):
    return y[0]


@pytest.mark.parametrize(
    ("beyond", "known"), [(1e-3, True), (1e-9, False), (1e-14, False), (-1e-3, True)]
)
def test_a_graze_has_no_derivative(beyond, known):
    start = [0.0, np.sqrt(2.0 * G * (1.0 + beyond))]
    found = gradient(CEILING, (0.0, 0.5), start, params=[1.0], at_end=height)
    forward = solve(CEILING, (0.0, 0.5), start, params=[1.0], jacobian=True)
    assert found.success == forward.success == known
    if not known:
        assert found.status == layout.GRAZING_IN_JACOBIAN
        assert np.isnan(found.by_start).all()


@field
def pressed(t, y, mode, params, dy):  # a spring as long as the memory says
    dy[0], dy[1] = y[1], -params[0]
    if mode[0] > 0:
        dy[1] += params[1] * (params[2] - y[0])


@guards
def contact(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = 0.5 - y[0], -dy[0]


@on_event
def remember(t, y, mode, params, guard, direction):
    if direction > 0:
        params[2] = 0.1 * y[1] ** 2 * params[0] * t
    return 0


REMEMBERS = System(
    pressed, contact, remember, n_states=2, guard_names=("contact",), n_memory=1
)


def test_what_a_handler_remembers_of_the_state_counts():
    def lose(both):
        return gradient(
            REMEMBERS, (0.0, 1.5), both[:2], params=both[2:], at_end=height, **TIGHT
        )

    both = np.array([1.0, 0.2, 9.81, 300.0])
    found = lose(both)
    assert found.solution.n_events >= 3
    by_difference = slopes(lambda one: lose(one).value, both)
    gradients = [*found.by_start, *found.by_params]
    np.testing.assert_allclose(gradients, by_difference, rtol=1e-5, atol=1e-8)


@field
def many_operations(t, y, mode, params, dy):
    total = 0.0
    for k in range(3000):
        total += np.sin(params[0] * y[0] + 0.001 * k)
    dy[0] = -total / 3000.0


LONG = System(many_operations, n_states=1)


def long_height(t, y, params):
    total = 0.0
    for k in range(5000):
        total += y[0] * k
    return total


def test_a_tape_that_is_too_short_grows():
    found = gradient(LONG, (0.0, 0.5), [1.0], params=[0.7], at_end=long_height)
    forward = solve(LONG, (0.0, 0.5), [1.0], params=[0.7], jacobian="params")
    factor = 5000 * 4999 / 2
    np.testing.assert_allclose(found.by_start, factor * forward.jacobian[0], rtol=1e-7)
    np.testing.assert_allclose(
        found.by_params, factor * forward.sensitivity[0], rtol=1e-7
    )


def unknown(t, y, params):
    return np.linalg.det(np.outer(y, y))


def undefined(t, y, params):
    return np.log(-1.0 - y[0] ** 2)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"t_span": (1.0, 0.0)}, "t_span: expected an end not before the start"),
        ({"method": "taylor"}, "method: expected one of dopri5, dop853"),
        ({"at_end": None}, "at least one of them"),
        ({"at_end": unknown}, "unknown: expected a function whose derivative"),
        ({"y0": [1.0]}, "y0: expected shape"),
        ({"y0": [np.nan, 0.0]}, "y0: expected finite numbers"),
    ],
)
def test_a_wrong_argument_is_told(options, told):
    given = {"t_span": (0.0, 0.1), "y0": [0.0, 1.0], "at_end": height} | options
    span, start = given.pop("t_span"), given.pop("y0")
    with pytest.raises(ArgumentError, match=told):
        gradient(CEILING, span, start, params=[1.0], **given)


def test_a_loss_that_is_not_a_number_is_a_status():
    found = gradient(CEILING, (0.0, 0.1), [0.0, 1.0], params=[1.0], at_end=undefined)
    assert found.status == layout.JACOBIAN_NOT_FINITE
    assert np.isnan(found.value)
