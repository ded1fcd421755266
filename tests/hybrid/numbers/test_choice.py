"""Guards that are left out of evaluations for ranges: where, and with the same results."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hopdata.hybrid import System, field, guards, on_event, solve
from hopdata.hybrid.layout import TOO_MANY_EVENTS
from hopdata.hybrid.numbers import guards as ranged
from hopdata.hybrid.numbers.choice import may_be_left_out

LEVEL = 0.25
N = 150


def twice(x):
    return 2.0 * x


@guards
def levels(t, y, dy, mode, params, h, hdot):
    slope = math.cos(t) * params[0]
    rate = dy[0] + math.sin(t) * params[0]
    for k in range(len(h)):
        level = LEVEL * (k - 60) + slope
        h[k], hdot[k] = y[0] - level, rate


@guards
def reads_mode(t, y, dy, mode, params, h, hdot):
    for k in range(len(h)):
        h[k] = y[0] - k * mode[0]
        hdot[k] = dy[0]


@guards
def reads_itself(t, y, dy, mode, params, h, hdot):
    for k in range(len(h)):
        h[k] = y[0]
        h[k] -= k
        hdot[k] = dy[0]


@guards
def reads_another(t, y, dy, mode, params, h, hdot):
    for k in range(1, len(h)):
        h[k] = h[0] - k
        hdot[k] = dy[0]
    h[0] = y[0]


@guards
def hides_itself(t, y, dy, mode, params, h, hdot):
    other = h
    for k in range(len(h)):
        other[k] = y[0] - k
        hdot[k] = dy[0]


@guards
def by_rates(t, y, dy, mode, params, h, hdot):
    v = dy[0]
    w = v + 1.0
    for k in range(len(h)):
        h[k] = min(w, y[0]) - k
        hdot[k] = dy[0]


@guards
def branches(t, y, dy, mode, params, h, hdot):
    for k in range(len(h)):
        h[k] = y[0] - k
        if y[0] > 1.0:
            h[k] = y[0] - 2.0 * k
        hdot[k] = dy[0]


@guards
def calls_in_loop(t, y, dy, mode, params, h, hdot):
    for k in range(len(h)):
        h[k] = math.sin(y[0]) - k
        hdot[k] = math.cos(y[0]) * dy[0]


@guards
def calls_own(t, y, dy, mode, params, h, hdot):
    far = twice(y[0])
    for k in range(len(h)):
        h[k] = far - k
        hdot[k] = 2.0 * dy[0]


@guards
def fills_all(t, y, dy, mode, params, h, hdot):
    h[:] = y[0]
    hdot[:] = dy[0]


REFUSED = (
    reads_mode, reads_itself, reads_another, hides_itself, by_rates, branches,
    calls_in_loop, calls_own,
)  # fmt: skip


@pytest.mark.parametrize("given", REFUSED, ids=lambda one: one.function.__name__)
def test_what_may_not_be_left_out(given):
    assert not may_be_left_out(given)


def test_what_may_be_left_out():
    assert may_be_left_out(levels)


@field
def swing(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -math.sin(y[0]) - 0.02 * y[1]


@on_event
def kick(t, y, mode, params, guard, direction):
    if direction > 0 and guard % 5 == 0:
        y[1] *= -0.9
    if guard % 7 == 0:
        params[0] += 0.01
    if guard % 11 == 0:
        mode[(guard + 75) % 150] *= -1
    return 0


def system_of(handler):
    names = tuple(map(str, range(N)))
    return System(swing, levels, on_event=handler, n_states=2, guard_names=names)


def outcomes(handler, tolerance):
    found = []
    for speed in (0.4, 1.3, 2.5):
        options = {"params": [0.1], "rtol": tolerance, "atol": tolerance}
        options["max_events"] = 500  # some kicks chatter
        found.append(solve(system_of(handler), (0.0, 12.0), [0.3, speed], **options))
    return found


@pytest.mark.parametrize("handler", [None, kick], ids=["smooth", "kicked"])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-9])
def test_same_bytes_whether_guards_are_left_out_or_not(handler, tolerance, monkeypatch):
    assert system_of(handler).branches.leaves_out
    some = outcomes(handler, tolerance)
    monkeypatch.setattr(ranged, "MANY_GUARDS", N + 1)
    assert not system_of(handler).branches.leaves_out
    for one, other in zip(some, outcomes(handler, tolerance), strict=True):
        assert one.status == other.status
        assert one.status in (0, TOO_MANY_EVENTS)
        assert one.n_unproven == other.n_unproven
        assert one.y.tobytes() == other.y.tobytes()
        assert one.events.time.tobytes() == other.events.time.tobytes()
        assert one.events.guard.tobytes() == other.events.guard.tobytes()
    assert len(some[2].events) > 20


def test_few_guards_are_all_evaluated():
    few = System(swing, levels, n_states=2, guard_names=("a", "b"))
    assert not few.branches.leaves_out
    assert np.isfinite(solve(few, (0.0, 1.0), [0.3, 0.4], params=[0.1]).y_end).all()
