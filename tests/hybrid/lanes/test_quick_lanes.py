"""Guards that bend, or move faster than the state, in lanes: no contact is missed.

These are the smooth families of the stress suite, compared with its exact events; guards that
branch on the state have no lanes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import stress_quick as quick
from hybrid_systems import table_ball
from numba import njit

from hopdata.hybrid import guards, solve_batch
from hopdata.hybrid.layout import ZENO

SMOOTH = [name for name in quick.FAMILIES if name not in ("abs", "max", "table")]
MEMBERS = 6  # per family and tolerance


@njit(error_model="numpy")
def height(q, t, u, v, du, dv, after):
    """Return what `stress_quick.height` returns for the smooth kinds."""
    kind, a, b, c, d = int(q[0]), q[1], q[2], q[3], q[4]
    if kind == quick.SINE:
        return np.sin(b * u + c) - d, b * np.cos(b * u + c) * du
    if kind == quick.BUMP:
        x = (u - c) / b
        bump = a * np.exp(-0.5 * x * x)
        return bump - d, -bump * x / b * du
    if kind == quick.PRODUCT:
        return (u - a) * (v - b) * c, ((v - b) * du + (u - a) * dv) * c
    if kind == quick.POWER:
        return b * (u - a) ** int(c), b * c * (u - a) ** int(c - 1) * du
    if kind == quick.SURFACE or (kind == quick.AFTER and after > 0):
        return u - a - b * np.sin(c * t + d), du - b * c * np.cos(c * t + d)
    return u - a, du


@guards
def smooth_guards(t, y, dy, mode, params, h, hdot):
    for k in range(2):
        first = quick.FIXED + k * quick.WIDTH
        h[k], hdot[k] = height(
            params[first : first + quick.WIDTH], t, y[0] + y[2], y[1], dy[0] + dy[2], dy[1], mode[2]
        )


SYSTEM = replace(quick.quick(), guards=smooth_guards, jacobian=None)


def judge(case, system):
    """Return whether the integration in lanes has the right end and number of events."""
    found = solve_batch(
        system, case.t_span, [case.y0], method="dop853", lanes=True, workers=1, **case.options
    )
    assert not found.lanes_reason, found.lanes_reason
    (answer,) = case.answers
    near = np.abs(found.y_end[0] - answer.y_end) <= answer.state_tolerance
    assert found.success, case
    assert found.n_events[0] == len(answer.events), case
    assert near.all(), case
    return found.lanes[0]


@pytest.mark.parametrize("family", SMOOTH)
def test_no_contact_of_a_family_is_missed(family):
    here = []
    for number, rtol in enumerate(quick.RTOLS):
        rng = np.random.default_rng([number, *map(ord, family)])
        for _ in range(MEMBERS):
            here.append(judge(quick.quick_member(family, rng, rtol), SYSTEM))
    # If a guard stands still on its surface, the driver often has to take over.
    least = {"x^3": 0.1, "x^5": 0.1, "sine of the state, turning": 0.7}
    assert np.mean(here) > least.get(family, 0.8)


@pytest.mark.parametrize("rtol", quick.RTOLS)
def test_no_contact_with_a_shaking_table_is_missed(rtol):
    rng = np.random.default_rng(3)
    here = []
    for _ in range(3 * MEMBERS):
        case = quick.table_member(rng, rtol)
        here.append(judge(case, quick.ball_on_table()))
    assert np.mean(here) > 0.8


def test_no_ball_falls_through_a_table_on_which_it_comes_to_rest():
    rng, n = np.random.default_rng(0), 1200
    y0 = np.column_stack([rng.uniform(0.1, 0.5, n), rng.uniform(-0.5, 0.5, n)])
    ranges = ((9.8, 9.9), (0.0, 0.0), (1e-4, 1e-3), (5.0, 20.0), (0.3, 0.5))
    params = np.column_stack([rng.uniform(*one, n) for one in ranges])
    ends = solve_batch(table_ball(), (0.0, 5.0), y0, params=params, lanes=True)
    assert not ends.lanes_reason, ends.lanes_reason
    assert ends.y_end[:, 0].min() > -2e-3
    assert set(ends.status) == {ZENO}
