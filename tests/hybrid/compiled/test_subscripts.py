"""Elements that are named by number are compared with the lengths that the system has."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid import System, field, guards, solve
from hopdata.hybrid.compiled.subscripts import elements_named, largest_subscripts


def test_reading_writing_and_changing():
    def f(t, y, mode, params, dy):
        dy[0], dy[1] = y[1], -params[3]
        if mode[2] > 0:
            dy[4] += 1.0

    assert largest_subscripts(f) == {"y": 1, "params": 3, "dy": 4, "mode": 2}


def test_numbers_that_are_no_subscripts():
    def f(t, y, mode, params, dy):
        dy[0] = y[-1] * 7 + max(t, 9) + (t < 5 < params[len(params) - 1])
        dy[1:3] = 0.0

    def g(t, y, mode, params, dy):
        y = np.append(y, 1.0)
        dy[0] = y[8] * 7 + max(t, 9) + (t < 5 < params[t])
        dy[1:3] = 0.0

    assert largest_subscripts(f) == {}  # it may look at the length before it reads
    assert largest_subscripts(g) == {"dy": 0}
    assert largest_subscripts(print) == {}


def test_elements_that_alone_can_matter():
    def g(t, y, dy, mode, params, h, hdot):
        for k in range(len(h)):
            h[k], hdot[k] = y[k] + params[0], dy[0] + y[1] * dy[3]

    assert elements_named(g, 2) == {0, 3}
    assert elements_named(g, 0) == frozenset()  # the time
    assert elements_named(g, 1) is None  # by a variable
    assert elements_named(print, 0) is None


def test_elements_that_may_all_matter():
    def handed_on(t, y, dy):
        return np.dot(y, dy) + dy[0]

    def from_the_end(t, y, dy):
        return dy[0] + dy[-1]

    def sliced(t, y, dy):
        return dy[0] + dy[1:3].sum()

    def renamed(t, y, dy):
        rate = dy
        return rate[4] + dy[0]

    def enclosed(t, y, dy):
        return dy[0] + sum(dy[k] for k in (1, 2))

    def replaced(t, y, dy):
        dy = y
        return dy[0]

    for function in (handed_on, from_the_end, sliced, renamed, enclosed, replaced):
        assert elements_named(function, 2) is None


@field
def spring(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -params[1] * y[0]


@guards
def walls(t, y, dy, mode, params, h, hdot):
    h[1] = y[0]
    hdot[1] = dy[0]


def test_too_few_states_or_guards():
    with pytest.raises(ValueError, match=r"field 'spring' .* uses y\[1\], but y has the length 1"):
        System(spring, n_states=1)
    with pytest.raises(ValueError, match=r"guards 'walls' .* uses h\[1\], but h has the length 1"):
        System(spring, walls, n_states=2, guard_names=("wall",))


def test_too_few_parameters():
    system = System(spring, n_states=2)
    with pytest.raises(ValueError, match=r"uses params\[1\], but params has the length 1"):
        solve(system, (0, 1), [1.0, 0.0], params=(1.0,))
    assert solve(system, (0, 1), [1.0, 0.0], params=(1.0, 4.0)).success
