"""Scenes backwards in time: from the end to the start, through the same events."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_systems import bent, bent_params
from equal_runs import same_instants, there_and_back
from hybrid_systems import ladder, throw

from hopdata.hybrid import (
    solve,
    solve_batch,
)
from hopdata.scenes.body import flight_mode
from hopdata.scenes.hopper import hopper_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant
from hopdata.scenes.plate import Plate
from hopdata.scenes.vertical_hopper import VerticalHopper

RTOLS = (1e-4, 1e-7, 1e-10)


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize("method", ["dopri5", "dop853", "rosenbrock", "taylor", "auto"])
def test_small_scenes_return_to_their_start(method, rtol):
    options = {"rtol": rtol, "atol": rtol, "method": method}
    for system, t_span, y0, params in (
        (octant(), T_SPAN, INITIAL_STATE, ()),
        (VerticalHopper().system(), (0.0, 1.1), [1.2, 0.0], VerticalHopper().params),
    ):
        there, back, off = there_and_back(system, t_span, y0, params=params, **options)
        assert off.max() < 100 * rtol
        assert same_instants(there, back) < 100 * rtol


PLATE, HOPPER = Plate(12), hopper_system()


# The remaining systems of these tests and of the library. The hopper's handler changes
# nothing before all its legs stand, so that it undoes itself.
SCENES = {
    "bent": (bent(3), 2.0, [0.0, 1.2], bent_params(
        [0.5, 0.7, 1.0], drive=0.3, tilts=[0.2, -0.3, 0.4], sways=[0.0, 0.1, 0.2],
        gains=[0.4, -0.3, -0.5],
    )),
    "ladder": (ladder(3), 3.0, [0.0, 0.0], (0.5, 1.0, 1.25, 0.5, -0.5, 3.0)),
    "throw": (throw(), 3.0, [0.0, 2.5], (2.0, 1.0)),
    "plate": (PLATE.system(), 0.9, [0.0, 2.2, 0.07, 0.0, 0.0, 0.0], PLATE.params),
    "hopper": (
        replace(HOPPER, undo=HOPPER.on_event), 0.015,
        [0, 0, 0.29, 0.4, 0.03, -0.02, 0.1, -0.05, -1.5, 0.1, -0.2, 0.1],
        HopperParameters().vector(),
    ),
}  # fmt: skip


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize("name", SCENES)
def test_every_scene_without_resets_returns_to_its_start(name, rtol):
    system, end, y0, params = SCENES[name]
    options = {"params": params, "rtol": rtol, "atol": rtol}
    if name == "hopper":
        options["mode"] = flight_mode(HOPPER, -1.0)
    there, back, off = there_and_back(system, (0.0, end), y0, **options)
    assert len(there.events) >= 2
    assert off.max() < 100 * rtol * max(1.0, np.abs(y0).max()), off
    assert same_instants(there, back) < 100 * rtol


def test_a_batch_goes_back_as_single_runs_do():
    ends = np.array([[0.2, 0.3, -0.3], [0.27, 0.34, -0.35]])
    times = [0.5, 0.4, 0.2]
    batch = solve_batch(
        octant(), (0.5, 0.0), ends, t_eval=times, jacobian=True, method="dop853"
    )
    assert batch.t_end.tolist() == [0.0, 0.0]
    assert batch.t.tolist() == times
    for row, end in enumerate(ends):
        one = solve(
            octant(), (0.5, 0.0), end, t_eval=times, jacobian=True, method="dop853"
        )
        assert batch.y_end[row].tobytes() == one.y_end.tobytes()
        assert np.ascontiguousarray(batch.y[row]).tobytes() == one.y.tobytes()
        assert batch.jacobian[row].tobytes() == one.jacobian.tobytes()


def test_the_jacobian_backward_is_the_inverse():
    there = solve(octant(), T_SPAN, INITIAL_STATE, jacobian=True)
    back = solve(octant(), T_SPAN[::-1], there.y_end, jacobian=True)
    assert there.jacobian @ back.jacobian == pytest.approx(np.eye(3), abs=1e-12)
