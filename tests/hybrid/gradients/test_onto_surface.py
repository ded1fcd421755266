"""Gradients over handlers that put the state exactly onto another guard's surface."""

import numpy as np
import pytest

from hopdata.hybrid import System, field, guards, on_event
from hopdata.hybrid.gradients import gradient
from hopdata.hybrid.layout import TIE_IN_JACOBIAN


@field
def halved_behind_the_line(t, y, mode, params, dy):
    dy[0], dy[1] = 1.0, 0.0
    if mode[0] > 0:
        dy[1] = 0.4
    if mode[1] > 0:
        dy[0] = 0.5


@guards
def place_and_line(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - 0.5, dy[0]
    h[1], hdot[1] = y[1], dy[1]


@on_event
def towards_line(t, y, mode, params, guard, direction):
    if guard == 0 and params[0] == 0.0:
        y[1] = 0.0
    elif guard == 0:
        y[1] += params[0]
    elif params[1] != 0.0:
        y[0] += params[1]
    return 0


PUT = System(
    halved_behind_the_line,
    place_and_line,
    towards_line,
    n_states=2,
    guard_names=("place", "line"),
)


def last(t, y, params):
    return y[0] + 2.0 * y[1]


@pytest.mark.parametrize(
    ("params", "by_start", "by_step"),
    [
        # All are put onto the line at 0.5 - y[0], and cross it.
        ((0.0, 0.0), [1.3, 0.0], 0.0),
        # All are pushed across.
        ((0.501, 0.0), [1.3, 2.0], 2.0),
        # All meet the line later, at 0.5 - y[0] - (y[1] + 0.499) / 0.4.
        ((0.499, 0.0), [1.3, 0.75], 0.75),
        # One start alone: its neighbours meet the line later, or are pushed across.
        ((0.5, 0.0), None, None),
        # The line's own handler changes the state.
        ((0.0, 0.1), None, None),
    ],
)
def test_a_handler_that_puts_the_state_onto_another_surface(params, by_start, by_step):
    found = gradient(PUT, (0.0, 1.5), [0.0, -0.5], params=params, at_end=last)
    if by_start is None:
        assert found.status == TIE_IN_JACOBIAN
        assert np.isnan(found.by_start).all()
        assert "from this start only" in found.message
        return
    assert found.success
    np.testing.assert_allclose(found.by_start, by_start, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.by_params[0], by_step, rtol=0, atol=1e-9)
