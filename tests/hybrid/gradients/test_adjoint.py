"""Gradients over events: against the forward derivative and central differences."""

import os
from contextlib import contextmanager
from math import sin
from types import SimpleNamespace

import numpy as np
import pytest

from hopdata.hybrid import System, field, guards, on_event, solve
from hopdata.hybrid.gradients import adjoint, backward, gradient

TIGHT = {"rtol": 1e-12, "atol": 1e-13}


@field
def fall(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -params[0]


@guards
def floor(t, y, dy, mode, params, h, hdot):
    h[0] = -y[0]
    hdot[0] = -dy[0]


@on_event
def bounce(t, y, mode, params, guard, direction):
    if direction > 0:
        y[1] *= -params[1]
    return 0


BALL = System(fall, floor, bounce, n_states=2, guard_names=("floor",))


@field
def body(t, y, mode, params, dy):
    dy[0], dy[1], dy[2], dy[3] = y[2], y[3], -9.81, 0.0
    for leg in range(2):
        side = -params[1] if leg == 0 else params[1]
        if mode[leg] > 0:
            push = params[0] * (0.5 - y[0] - side * y[1]) - params[2] * y[2]
            dy[2], dy[3] = dy[2] + push, dy[3] + 10.0 * side * push


@guards
def feet(t, y, dy, mode, params, h, hdot):
    for leg in range(2):
        side = -params[1] if leg == 0 else params[1]
        h[leg], hdot[leg] = 0.5 - y[0] - side * y[1], -dy[0] - side * dy[1]


LEGS = System(body, feet, n_states=4, guard_names=("left", "right"))


@field
def pendulum(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], np.sin(y[0])


@guards
def next_spoke(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - params[1] - params[0], dy[0]


@on_event
def change_spoke(t, y, mode, params, guard, direction):
    if direction > 0:
        y[0], y[1] = y[0] - 2.0 * params[0], np.cos(2.0 * params[0]) * y[1]
    return 0


WHEEL = System(pendulum, next_spoke, change_spoke, n_states=2, guard_names=("spoke",))


@field
def membrane(t, y, mode, params, dy):
    dy[0] = 0.04 * y[0] ** 2 + 5.0 * y[0] + 140.0 - y[1] + params[0]
    dy[1] = params[1] * (0.2 * y[0] - y[1])


@guards
def threshold(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - 30.0, dy[0]


@on_event
def spike(t, y, mode, params, guard, direction):
    if direction > 0:
        y[0], y[1] = -65.0, y[1] + params[2]
    return 0


# The lock follows the reset silently.
NEURON = System(
    membrane, threshold, spike, n_states=2, guard_names=("spike",), directions=(1,)
)


@field
def room(t, y, mode, params, dy):
    dy[0] = params[0] * (15.0 + sin(0.1 * t) - y[0])
    if mode[2] > 0:
        dy[0] += params[1]


@guards
def thresholds(t, y, dy, mode, params, h, hdot):
    h[0], h[1] = params[2] - y[0], y[0] - params[3]
    hdot[0], hdot[1] = -dy[0], dy[0]


@on_event
def switch(t, y, mode, params, guard, direction):
    mode[2] = 1 if guard == 0 else 0
    return 0


THERMOSTAT = System(
    room, thresholds, switch, n_states=1, guard_names=("cold", "warm"), n_extra_modes=1,
    directions=(1, 1),
)  # fmt: skip


@field
def driven(t, y, mode, params, dy):  # van der Pol's, whose force depends on the side
    dy[0] = y[1]
    dy[1] = params[0] * (1.0 - y[0] ** 2) * y[1] - y[0]
    dy[1] += params[1] if mode[0] > 0 else -params[1]


@guards
def side(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0], dy[0]


STIFF = System(driven, side, n_states=2, guard_names=("side",))


CASES = {
    "ball": (BALL, (0.0, 2.0), [1.0, 0.1], [9.81, 0.8], None),
    "legs": (LEGS, (0.0, 0.8), [0.7, 0.01, 0.0, 0.0], [400.0, 0.2, 3.0], None),
    "wheel": (WHEEL, (0.0, 12.0), [-0.24, 0.6], [0.3, 0.06], None),
    "neuron": (NEURON, (0.0, 90.0), [-65.0, -13.0], [10.0, 0.02, 8.0], None),
    "thermostat": (THERMOSTAT, (0.0, 40.0), [18.0], [0.1, 1.0, 19.0, 21.0], [1]),
    "stiff": (STIFF, (0.0, 60.0), [2.0, 0.0], [15.0, 0.1], None),
}


def last(t, y, params):
    total = 0.0
    for i in range(len(y)):
        total += (1.0 + 0.5 * i) * y[i]
    return total


def instants(t, before, after, guard, direction, params):
    return direction * t * (1.0 + before[0] * after[-1]) + params[0] * guard


def path(t, y, mode, params):
    return 0.01 * y[0] ** 2 * params[0] + (y[-1] if mode[0] > 0 else 0.0)


def close(found, expected, digits):
    found = np.asarray(found)
    scale = np.max(np.abs(expected))
    return np.max(np.abs(found - expected)) <= 10.0**-digits * scale


#: Each compiles for 2 s. The wheel and the neuron are reset at events, as the ball is,
#: and the legs have all losses below: with `ALL=1`.
IN_SHORT = CASES if "ALL" in os.environ else ("ball", "thermostat", "stiff")


@pytest.mark.parametrize("name", IN_SHORT)
def test_the_gradient_is_the_forward_derivative_transposed(name):
    system, span, start, params, mode = CASES[name]
    options = {"params": params, "mode": mode, "method": "dop853", **TIGHT}
    found = gradient(system, span, start, at_end=last, **options)
    forward = solve(system, span, start, jacobian="params", **options)
    assert found.success
    assert forward.success
    assert forward.n_events >= 2
    weights = 1.0 + 0.5 * np.arange(len(start))
    assert close([found.value], weights @ forward.y_end, 8)
    assert close(found.by_start, weights @ forward.jacobian, 8)
    assert close(found.by_params, weights @ forward.sensitivity, 8)


#: Compiling the three losses takes 2 s a system; above, each has its gradient.
WITH_ALL_LOSSES = CASES if "ALL" in os.environ else ("legs",)


@pytest.mark.parametrize("name", WITH_ALL_LOSSES)
def test_all_losses_together_have_the_slope_of_central_differences(name):
    system, span, start, params, mode = CASES[name]
    losses = {"at_end": last, "at_event": instants, "along": path}

    def lose(both):
        return gradient(
            system, span, both[: len(start)], params=both[len(start) :], mode=mode,
            **losses, **TIGHT,
        )  # fmt: skip

    both = np.array([*start, *params])
    found = lose(both)
    rng = np.random.default_rng(58)
    for _ in range(2):
        aside = 1e-6 * rng.uniform(-1.0, 1.0, len(both)) * np.maximum(abs(both), 0.01)
        slope = 0.5 * (lose(both + aside).value - lose(both - aside).value)
        along = np.array([*found.by_start, *found.by_params]) * aside
        assert abs(along.sum() - slope) <= 2e-6 * abs(along).sum()


def test_what_compiles_for_long_is_said(monkeypatch):
    said = []

    @contextmanager
    def heard(what):
        said.append(what)
        yield

    for module in (adjoint, backward):
        monkeypatch.setattr(module, "said_if_long", heard)
    gradient(BALL, (0.0, 0.8), [1.0, 0.0], params=[9.81, 0.8], at_end=last)
    assert said[0] == "the functions of a system for gradients"
    said.clear()
    # The pass is the same for all systems, and compiled once.
    kinds = []
    fresh = SimpleNamespace(signatures=kinds, compile=kinds.append, typeof_pyval=type)
    monkeypatch.setattr(backward, "_dispatcher", lambda: fresh)
    for _ in range(2):
        assert backward.compiled_backward(1, 2.0) is fresh
    assert said == ["the functions of the pass backward"]
    assert kinds == [(int, float)]
