"""Systems in lanes: as accurate as the driver, no lost events, bytes independent of neighbours."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from bent_systems import bent, bent_params
from stress_quick import ball_on_table

from hopdata.hybrid import System, field, guards, on_event, solve, solve_batch
from hopdata.hybrid.arguments import SMALLEST_RTOL
from hopdata.hybrid.layout import NO_LOCK, SLIDING, STATE_NOT_FINITE

SPAN = (0.0, 6.0)
COUNT = 200
OPTIONS = {"method": "dop853", "workers": 1}


@cache
def swings():
    """Return starts and parameters of pendulums among three guards, two of which bend."""
    rng = np.random.default_rng(11)
    params = [
        bent_params(
            rng.uniform(-1.0, 1.0, 3), drive=rng.uniform(0.0, 0.4), tilts=rng.uniform(-0.1, 0.1, 3),
            sways=[0.0, 0.1, 0.2], gains=rng.uniform(-0.5, 0.5, 3),
        )
        for _ in range(2 * COUNT)
    ]  # fmt: skip
    y0 = rng.uniform(-2.0, 2.0, (2 * COUNT, 2))
    params = np.array(params)
    status = solve_batch(bent(3), SPAN, y0, params=params, **OPTIONS).status
    ends = status == 0
    slides = status == SLIDING
    return y0[ends][:COUNT], params[ends][:COUNT], y0[slides], params[slides]


def swung(rows=slice(None), **options):
    y0, params, *_ = swings()
    return solve_batch(
        bent(3), SPAN, y0[rows], params=params[rows], **(OPTIONS | options)
    )


@cache
def in_lanes():
    return swung(lanes=True)


def assert_same(found, wanted, rows):
    """Assert that everything known of each system has the same bytes."""
    for name in ("y_end", "t_end", "mode", "n_events", "n_steps", "nfev", "status"):
        assert (
            getattr(found, name).tobytes() == getattr(wanted, name)[rows].tobytes()
        ), name


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-9, 1e-12])
def test_as_good_as_the_driver(rtol):
    tolerance = {"rtol": rtol, "atol": 1e-3 * rtol}
    best = swung(rtol=SMALLEST_RTOL, atol=1e-15, lanes=False)
    plain = swung(lanes=False, **tolerance)
    here = swung(lanes=True, **tolerance)
    assert here.success
    assert here.lanes_reason == ""
    assert here.lanes.mean() > 0.97
    assert not plain.lanes.any()
    assert here.n_events.tolist() == best.n_events.tolist()
    assert here.mode.tolist() == best.mode.tolist()
    assert best.n_events.max() == 8
    off, plainly_off = (
        np.abs(one.y_end - best.y_end).max(axis=1) for one in (here, plain)
    )
    assert (
        off.max() < 10 * plainly_off.max()
    )  # errors of one system grow ten thousandfold
    for part in (0.5, 0.95):
        assert np.quantile(off, part) < 3 * np.quantile(plainly_off, part)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_bytes_depend_on_no_neighbour(workers):
    order = np.random.default_rng(3).permutation(COUNT)
    assert_same(swung(order, workers=workers, lanes=True), in_lanes(), order)
    assert_same(
        swung([7, 7], lanes=True), in_lanes(), [7, 7]
    )  # all lanes but two are empty
    assert_same(swung([7], lanes=True), in_lanes(), [7])


def test_a_system_alone_and_in_a_batch_have_the_same_bytes():
    """So have those that leave their lanes, whatever the driver's threads."""
    y0, params, sliding, their_params = swings()
    asked = [(y0[:2], params[:2], False), (sliding[:2], their_params[:2], True)]
    for starts, numbers, lanes in asked:
        batch = solve_batch(
            bent(3), SPAN, starts, params=numbers, lanes=lanes, **OPTIONS
        )
        assert not batch.lanes.any()
        for row, (start, own) in enumerate(zip(starts, numbers, strict=True)):
            one = solve(bent(3), SPAN, start, params=own, method="dop853")
            assert one.y_end.tobytes() == batch.y_end[row].tobytes()
            assert one.mode.tobytes() == batch.mode[row].tobytes()
            assert one.n_steps == batch.n_steps[row]


def test_wanted_times():
    times = np.linspace(*SPAN, 50)
    # The driver counts the interpolants for these times, too.
    done = np.flatnonzero(in_lanes().lanes)
    here = swung(done, t_eval=times, lanes=True)
    assert_same(here, in_lanes(), done)
    best = swung(done, t_eval=times, rtol=1e-13, atol=1e-15, lanes=False)
    assert here.y.shape == best.y.shape
    plain = swung(done, t_eval=times, lanes=False)
    assert np.abs(here.y - best.y).max() < 3 * np.abs(plain.y - best.y).max()
    assert here.y[:, :, 0].tolist() == swings()[0][done].tolist()
    assert here.y[:, :, -1].tolist() == here.y_end.tolist()


@field
def driven(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -np.sin(y[0]) + 0.2 * mode[0]


@guards
def levels(t, y, dy, mode, params, h, hdot):
    for g in range(len(h)):
        bend = params[0] * np.sin(y[1])
        h[g] = y[0] + bend - 0.07 * (g - 22.0)
        hdot[g] = dy[0] + params[0] * np.cos(y[1]) * dy[1]


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_where_most_steps_end_in_flips(rtol):
    """These steps then end on the interpolant, as long as it is as accurate as another step."""
    system = System(
        driven, levels, n_states=2, guard_names=[f"level {g}" for g in range(45)]
    )
    rng = np.random.default_rng(8)
    times = np.linspace(*SPAN, 40)
    y0 = rng.uniform(-1.5, 1.5, (COUNT, 2))
    params = rng.uniform(0.0, 0.2, (COUNT, 1))

    def ends(rtol, lanes, rows=slice(None)):
        return solve_batch(
            system, SPAN, y0[rows], params=params[rows], rtol=rtol, atol=1e-3 * rtol, t_eval=times,
            lanes=lanes, **OPTIONS,
        )  # fmt: skip

    best = ends(1e-13, False)
    plain = ends(rtol, False)
    here = ends(rtol, True)
    assert here.lanes.mean() > 0.9  # a few turn round at a level
    assert here.n_events.tolist() == best.n_events.tolist()
    assert (
        here.nfev.sum() < 20 * here.n_steps.sum()
    )  # 12 per step, 28 if each were repeated
    off, plainly_off = (
        np.abs(one.y - best.y).max(axis=(1, 2)) for one in (here, plain)
    )
    # The driver examines these guards in windows, in a fifth more steps than lanes
    # take: its median error is 2.5 times smaller than without windows. The largest are
    # as before.
    for part, factor in ((0.5, 7.5), (0.95, 3.0)):
        assert np.quantile(off, part) < factor * np.quantile(plainly_off, part)
    order = rng.permutation(COUNT)
    assert_same(ends(rtol, True, order), here, order)


NARROW = """
import sys
import numpy as np
from bent_systems import bent
from hopdata.hybrid import solve_batch
from hopdata.hybrid.lanes.vectors import WIDTH
given = np.load(sys.argv[1])
found = solve_batch(
    bent(3), (0.0, 6.0), given["y0"], params=given["params"], method="dop853", lanes=True, workers=1
)
np.savez(sys.argv[2], width=WIDTH, **{name: getattr(found, name) for name in sys.argv[3:]})
"""
KNOWN = (
    "y_end",
    "t_end",
    "mode",
    "n_events",
    "n_steps",
    "nfev",
    "status",
    "lanes",
    "n_close",
)


@pytest.mark.skipif(
    "ALL" not in os.environ,
    reason="compiles the lanes twice more, half a minute: ALL=1",
)
def test_bytes_depend_on_no_processor(tmp_path):
    """Four lanes of plain instructions, without fused ones, give the results of this processor."""
    y0, params, *_ = swings()
    np.savez(tmp_path / "starts.npz", y0=y0, params=params)
    plain = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    environment = {**os.environ, **plain, "PYTHONPATH": str(Path(__file__).parents[1])}
    subprocess.run(
        [sys.executable, "-c", NARROW, tmp_path / "starts.npz", tmp_path / "ends.npz", *KNOWN],
        env=environment, check=True,
    )  # fmt: skip
    found = np.load(tmp_path / "ends.npz")
    assert found["width"] == 4
    assert found["lanes"].mean() > 0.97  # the driver does the others
    for name in KNOWN:
        assert found[name].tobytes() == getattr(in_lanes(), name).tobytes(), name


def test_resets_and_terminal_events():
    """A ball bounces from a table at rest: its speed is reversed; the lock flips back at once."""
    y0 = np.column_stack([np.linspace(0.5, 3.0, 40), np.zeros(40)])
    for options in ({}, {"terminal": (True,)}):
        system = replace(ball_on_table(), **options)
        asked = {"params": [[0.7, 0.0, 1.0, 0.0]] * len(y0), "rtol": 1e-10}
        here = solve_batch(system, (0.0, 1.5), y0, lanes=True, **OPTIONS, **asked)
        plain = solve_batch(system, (0.0, 1.5), y0, lanes=False, **OPTIONS, **asked)
        assert here.lanes.all()
        assert here.status.tolist() == plain.status.tolist()
        assert here.mode.tolist() == plain.mode.tolist()
        assert here.n_events.tolist() == plain.n_events.tolist()
        assert here.n_events.max() == (1 if options else 10)
        assert here.culprit.tolist() == plain.culprit.tolist()
        assert np.allclose(here.y_end, plain.y_end, rtol=0, atol=1e-11)
        assert np.allclose(here.t_end, plain.t_end, rtol=0, atol=1e-12)


def test_what_lanes_give_up_the_driver_does():
    """Sliding, guards that stay on their surface, and step limits end as in single integrations."""
    *_, y0, params = swings()
    here = solve_batch(bent(3), SPAN, y0, params=params, lanes=True, **OPTIONS)
    plain = solve_batch(bent(3), SPAN, y0, params=params, lanes=False, **OPTIONS)
    assert set(plain.status) == {SLIDING}
    assert len(y0) > 10
    assert not here.lanes.any()
    assert_same(here, plain, slice(None))
    few = swung(lanes=True, max_steps=25)
    assert {0, -4} == set(few.status.tolist())
    assert not few.lanes[few.status == -4].any()


@field
def branching(t, y, mode, params, dy):
    dy[0] = 1.0 if y[0] > 0.0 else 2.0


@field
def arrays_inside(t, y, mode, params, dy):
    room = np.zeros(1)
    room[0] = y[0]
    dy[0] = room[0]


@field(compiled=False)
def plain_python(t, y, mode, params, dy):
    dy[0] = 1.0


@guards
def far_away(t, y, dy, mode, params, h, hdot):
    h[:] = 1.0
    hdot[:] = 0.0


@pytest.mark.parametrize(
    ("system", "options", "said"),
    [
        (
            System(branching),
            {},
            "line {} (dy[0] = 1.0 if y[0] > 0.0 else 2.0): it branches on the state",
        ),
        (
            System(arrays_inside),
            {},
            "line {} (room[0] = y[0]): it writes a state or the time into an array",
        ),
        (System(plain_python), {}, "runs as plain Python"),
        (
            System(branching, far_away, guard_names=tuple(map(str, range(63)))),
            {},
            "63 guards",
        ),
        (System(branching), {"jacobian": True, "method": "dopri5"}, "Jacobian"),
        (System(branching), {"method": "dopri5"}, "'dopri5'"),
    ],
)
def test_why_there_are_no_lanes(system, options, said):
    y0 = np.linspace(0.5, 1.0, 3)[:, None]
    batch = solve_batch(system, (0.0, 1.0), y0, lanes=True, workers=1, **options)
    assert batch.success
    if "{}" in said:  # the function, and its line
        function = system.field.function
        place = f"field {function.__name__!r}, "
        below = {"branching": 2, "arrays_inside": 3}[function.__name__]
        line = inspect.getsourcelines(function)[1] + below
        assert batch.lanes_reason.startswith(place + said.format(line))
    else:
        assert said in batch.lanes_reason
    assert not batch.lanes.any()
    plain = solve_batch(system, (0.0, 1.0), y0, workers=1, **options)
    assert plain.y_end.tobytes() == batch.y_end.tobytes()
    assert "3" in plain.lanes_reason
    assert "lanes=True" in plain.lanes_reason
    refused = solve_batch(system, (0.0, 1.0), y0, lanes=False, workers=1, **options)
    assert refused.lanes_reason == "lanes=False was given"


@field
def pulled(t, y, mode, params, dy):
    dy[0] = params[0] + (params[2] if mode[1] > 0 else 0.0)
    dy[1] = params[1] + (params[3] if mode[0] > 0 else 0.0)


@guards
def both_axes(t, y, dy, mode, params, h, hdot):
    h[0] = y[0]
    hdot[0] = dy[0]
    h[1] = y[1] + (params[4] if mode[2] > 0 else -params[4])
    hdot[1] = dy[1]


def point(handler=None):
    """Return a point that may cross two axes: one system, compiled once, for all handlers below."""
    return System(
        pulled, both_axes, handler, n_states=2, guard_names=("x", "y"), n_extra_modes=1
    )  # fmt: skip


@on_event
def start_again(t, y, mode, params, guard, direction):
    if t > 2.95:
        raise OverflowError("too late")
    if direction > 0:
        y[0] = -1.0
        params[0] = 0.5 * params[0]
    return 0


def test_handlers_that_raise_or_change_parameters():
    """No lane sees another's parameters, and an exception is raised as by the driver.

    `test_quick_lanes` has the same for parameters that all systems share.
    """
    system = point(start_again)
    y0 = [[-1.0, -1.0], [-0.9, -1.0], [-0.8, -1.0]]
    options = {"params": [[1.0, 0.0, 0.0, 0.0, 0.0]] * 3, "workers": 1, "lanes": True}
    here = solve_batch(system, (0.0, 2.95), y0, **options)
    assert here.success, here.message
    assert here.lanes.all()
    np.testing.assert_allclose(
        here.y_end[:, 0], [-0.025, -0.9875, -0.9625], rtol=0, atol=1e-12
    )
    with pytest.raises(OverflowError, match="too late"):
        solve_batch(system, (0.0, 3.5), y0, **options)


@on_event
def no_lock(t, y, mode, params, guard, direction):
    mode[0] = int(params[3])
    return 0


@pytest.mark.parametrize("lock", [0, 7, -7])
def test_a_lock_that_is_none_is_named(lock):
    """Else its guard would never flip again, or flip to a lock that the field does not know."""
    system = point(no_lock)
    y0 = [[-1.0, -99.0], [-0.9, -99.0], [4.0, -99.0]]
    params = [[1.0, 0.0, 0.0, lock, 0.0]] * 3
    batch = solve_batch(system, (0.0, 2.0), y0, params=params, lanes=True)
    assert batch.status.tolist() == [NO_LOCK, NO_LOCK, 0]
    assert "lock of guard 'x'" in batch.message
    assert batch.lanes.tolist() == [False, False, True]
    assert batch.t_end == pytest.approx([1.0, 0.9, 2.0])


@on_event
def spoil(t, y, mode, params, guard, direction):
    y[1] = params[3]
    return 1


def test_a_state_spoilt_at_a_terminal_event_is_no_success():
    system = point(spoil)
    y0 = [[-1.0, -99.0], [-0.9, -99.0], [4.0, -99.0]]
    params = [
        [1.0, 0.0, 0.0, np.nan, 0.0],
        [1.0, 0.0, 0.0, -50.0, 0.0],
        [1.0, 0.0, 0.0, 0.0, 0.0],
    ]
    batch = solve_batch(system, (0.0, 2.0), y0, params=params, lanes=True)
    assert batch.status.tolist() == [STATE_NOT_FINITE, 1, 0]
    assert batch.lanes.tolist() == [False, True, True]


@on_event
def push(t, y, mode, params, guard, direction):
    if guard == 0:
        mode[2] = direction
    return 0


def test_a_handler_that_pushes_another_guard_across():
    y0 = np.column_stack([np.linspace(-1.5, -0.1, 15), np.zeros(15)])
    options = {"params": [[1.0, 0.0, 0.0, 1.0, 1.0]] * len(y0), **OPTIONS}
    here = solve_batch(point(push), (0.0, 2.0), y0, lanes=True, **options)
    plain = solve_batch(point(push), (0.0, 2.0), y0, lanes=False, **options)
    assert here.lanes.all()
    assert here.n_events.tolist() == plain.n_events.tolist() == [2] * len(y0)
    assert here.mode.tolist() == plain.mode.tolist()
    assert np.allclose(here.y_end, plain.y_end, rtol=0, atol=1e-9)


def test_locks_of_guards_on_their_surfaces_at_the_start_are_those_of_the_driver():
    """Rates decide, which depend on the other lock; neither is an event."""
    system = point()
    pulls = [[0.5, 0.5], [-3, 0], [0, -3], [-1.5, 0.5], [-3, 2], [-1, 0]]
    y0 = np.repeat([[0.0, 0.0], [0.0, -0.4], [-0.3, 0.0]], len(pulls), axis=0)
    params = [[1.0, 1.0, *pull, 0.0] for pull in pulls] * 3
    options = {"params": params, "workers": 1}
    here = solve_batch(system, (0.0, 1.0), y0, lanes=True, **options)
    plain = solve_batch(system, (0.0, 1.0), y0, lanes=False, **options)
    assert here.lanes.sum() > len(pulls)
    assert here.n_events.tolist() == plain.n_events.tolist()
    assert here.mode.tolist() == plain.mode.tolist()
    assert np.allclose(here.y_end, plain.y_end, rtol=0, atol=1e-9)
