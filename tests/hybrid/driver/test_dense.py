"""The interpolant: fourth order inside a step, exact at its ends, and its derivative."""

from __future__ import annotations

import numpy as np
import pytest
from bent_systems import affine_landing, bent, bent_params, landing
from hybrid_systems import ball, growth

from hopdata.hybrid import solve
from hopdata.hybrid.methods.table import TABLEAUS


def error_between_mesh_points(step, *, where):
    """Return the largest error at a fraction of each step, relative to the error at its end."""
    times = np.arange(0.0, 1.0 - step / 2, step) + where * step
    solution = solve(
        growth(), (0, 1), [1.0, 0.0], params=(1.0, 4.0), rtol=0.9, atol=1e9,
        max_step=step, first_step=step, t_eval=times,
    )  # fmt: skip
    return np.abs(solution.y[0] - np.exp(times)).max()


@pytest.mark.parametrize("where", [0.25, 0.5, 0.8])
def test_samples_converge_with_order_four_or_better(where):
    steps = 1.0 / np.array([8, 16, 32, 64])
    errors = [error_between_mesh_points(step, where=where) for step in steps]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 3.9 < order < 5.6


def test_the_interpolant_meets_the_mesh():
    bare = solve(growth(), (0, 1), [1.0, 0.0], params=(1.0, 4.0))
    near = np.nextafter(bare.t[1:-1], 0.0)
    sampled = solve(growth(), (0, 1), [1.0, 0.0], params=(1.0, 4.0), t_eval=near)
    assert np.abs(sampled.y - bare.y[:, 1:-1]).max() < 1e-14


# Samples: as accurate as the steps, continuous, for each method, through events and
# jumps.

PARAMS = bent_params(
    [0.5, 0.7, 1.0], drive=0.3, tilts=[0.2, -0.3, 0.4], gains=[0.4, -0.8, -0.5]
)
START = [0.0, 1.2]
TIMES = np.linspace(0, 2, 801)
METHODS = pytest.mark.parametrize("method", ["auto", *TABLEAUS, "rosenbrock"])


def swing(**options):
    return solve(bent(3), (0, 2), START, params=PARAMS, **options)


@pytest.fixture(scope="module")
def truth():
    return swing(rtol=1e-13, atol=1e-14, t_eval=TIMES).y


@METHODS
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10])
def test_samples_are_as_good_as_the_tolerance(truth, method, tolerance):
    found = swing(method=method, rtol=tolerance, atol=tolerance, t_eval=TIMES)
    assert found.t.tolist() == TIMES.tolist()
    assert (
        np.abs(found.y - truth).max() < 30 * tolerance
    )  # interpolants have a lower order than steps


@METHODS
def test_they_do_not_change_the_integration(method):
    bare = swing(method=method)
    sampled = swing(method=method, t_eval=TIMES)
    assert sampled.y_end.tobytes() == bare.y_end.tobytes()
    assert sampled.events.records.tobytes() == bare.events.records.tobytes()
    assert sampled.n_steps == bare.n_steps
    assert sampled.y[:, -1].tobytes() == sampled.y_end.tobytes()


@METHODS
def test_they_are_continuous_from_step_to_step(method):
    mesh = swing(method=method).t[1:-1]
    around = np.unique([np.nextafter(mesh, -1), mesh, np.nextafter(mesh, 9)])
    found = swing(method=method, t_eval=around)
    steps = np.abs(np.diff(found.y))[:, np.diff(around) < 1e-15]
    assert steps.shape[1] >= 2 * len(mesh)
    assert steps.max() < 4e-15


@METHODS
def test_at_the_mesh_they_are_the_steps(method):
    bare = swing(method=method)
    sampled = swing(method=method, t_eval=bare.t)
    assert sampled.y.tobytes() == bare.y.tobytes()


@METHODS
def test_which_other_times_are_wanted_does_not_matter(method):
    every = swing(method=method, t_eval=TIMES).y
    some = swing(method=method, t_eval=TIMES[3::7]).y
    assert some.tobytes() == np.ascontiguousarray(every[:, 3::7]).tobytes()


def test_a_swing_by_taylor():
    times = np.linspace(0, 3, 500)
    found = solve(
        affine_landing(), (0, 3), [1.0, 0.0], params=(0, 0, -1.0, 0), t_eval=times
    )
    rest = -9.81 / 400.0
    assert np.abs(found.y[0] - rest - (1.0 - rest) * np.cos(20 * times)).max() < 1e-11


@pytest.mark.parametrize("method", ["auto", "rosenbrock"])
def test_in_a_stiff_mode(method):
    """The mass creeps on a damper of 1e6; samples lie between steps of a tenth of a second."""
    damping = 1e6
    stiffness = 2e6
    times = np.linspace(0.6, 2.4, 200)
    found = solve(
        landing(), (0, 2.4), [1.0, 0.0], params=(damping, stiffness, 9.0), method=method,
        atol=[1e-14, 1e-12], t_eval=times,
    )  # fmt: skip
    fall = np.sqrt(2 / 9.81)
    rest = -9.81 / stiffness  # of the creep, to a relative 1e-6
    rate = stiffness / damping
    start = -9.81 * fall / damping
    creep = rest + (start - rest) * np.exp(-rate * (times - fall))
    assert np.abs(found.y[0] - creep).max() < 1e-5 * abs(rest)


def test_at_the_instant_of_a_jump_the_state_is_that_after_it():
    system = ball(directions=(1,))
    options = {"params": (2.0, 0.0, 0.5)}
    time = solve(system, (0, 1.5), [1.0, 0.0], **options).events.time[0]
    around = [np.nextafter(time, 0), time, np.nextafter(time, 9)]
    found = solve(system, (0, 1.5), [1.0, 0.0], t_eval=around, **options)
    assert found.y[1] == pytest.approx([-2.0, 1.0, 1.0], abs=1e-12)


def test_the_ends_of_the_span():
    found = swing(t_eval=[0.0, 2.0])
    assert found.y[:, 0].tolist() == START
    assert found.y[:, 1].tolist() == found.y_end.tolist()
    assert swing(t_eval=[2.0]).y.tolist() == found.y[:, 1:].tolist()
    assert swing(t_eval=[0.0]).y.tolist() == found.y[:, :1].tolist()
    one = solve(bent(3), (1, 1), START, params=PARAMS, t_eval=[1.0])
    assert one.y[:, 0].tolist() == START
