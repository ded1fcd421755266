"""Guards that sleep: the same events of the plate, with fewer evaluations."""

from __future__ import annotations

import numpy as np
import pytest
from equal_runs import assert_same_events

from hopdata.hybrid import (
    solve,
)
from hopdata.scenes.plate import Plate


def test_a_plate_on_fifty_springs():
    plate = Plate(50)
    start = np.array([0.0, 2.4, 0.06, 0.0, 0.0, 0.0])
    plain = solve(plate.system(), (0, 2), start, params=plate.params)
    sparse = solve(plate.system(sparse=True), (0, 2), start, params=plate.params)
    assert_same_events(plain, sparse, tolerance=1e-7)
    assert len(plain.events) >= 50
    assert sparse.n_guard_evaluations < 50 * plain.n_guard_evaluations / 2


@pytest.mark.parametrize("form", ["sums", "sparse"])
def test_two_runs_begin_with_the_same_memory(form):
    plate = Plate(12)
    start = np.array([0.0, 1.4, 0.06, 0.0, 0.0, 0.0])
    system = plate.system(**{form: True})
    first, second = (
        solve(system, (0, 1), start, params=plate.params) for _ in range(2)
    )
    assert len(first.events) > 0
    assert first.y_end.tobytes() == second.y_end.tobytes()
    zeros = solve(system, (0, 1), start, params=plate.params, memory=np.zeros(3))
    assert zeros.y_end.tobytes() == first.y_end.tobytes()


def test_a_memory_of_the_wrong_length_is_named():
    plate = Plate(12)
    system = plate.system(sums=True)
    start = np.zeros(6)
    with pytest.raises(ValueError, match="memory: expected 3 numbers, found 2"):
        solve(system, (0, 1), start, params=plate.params, memory=[0.0, 0.0])
    with pytest.raises(ValueError, match="memory: expected 0 numbers, found 1"):
        solve(plate.system(), (0, 1), start, params=plate.params, memory=[0.0])


@pytest.mark.parametrize("tilt", [0.05, 1e-3, 1e-6])
def test_a_flat_landing_looks_at_few_guards(tilt):
    """However close the contacts are, a step is clipped to the first and wakes few guards.

    A third of the evaluations are by ranges: one of each guard awake, in each step.
    """
    plate = Plate(600)
    start = [0.0, 2.0, tilt, 0.0, 0.0, 0.0]
    solution = solve(
        plate.system(sparse=True), (0, 0.6), start, params=plate.params, rtol=1e-6
    )
    events = solution.events
    assert len(events) >= 600
    assert sorted(events.guard[:600].tolist()) == list(range(600))
    assert solution.n_steps < 1.1 * len(events)
    assert solution.n_guard_evaluations < 120 * len(events)
