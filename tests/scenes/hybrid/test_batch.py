"""`solve_batch` with the plate: the same bytes as `solve`."""

from __future__ import annotations

import numpy as np
from equal_runs import assert_same_row

from hopdata.hybrid import solve, solve_batch
from hopdata.scenes.plate import Plate


def test_parameters_and_states_are_not_changed():
    plate = Plate(12)
    y0, params = plate.initial_states(3, 0), np.tile(plate.params, (3, 1))
    y0_before, params_before = y0.copy(), params.copy()
    solve_batch(plate.system(sums=True), (0, 1), y0, params=params)
    assert np.array_equal(y0, y0_before)
    assert np.array_equal(params, params_before)


def test_each_has_a_memory_of_its_own():
    plate = Plate(12)
    system, y0 = (
        plate.system(sums=True),
        np.tile([0.1, 0.97, 0.05, 0.2, -1.0, 0.3], (3, 1)),
    )
    options = {"params": plate.params, "memory": plate.memory(y0[0])}
    batch = solve_batch(system, (0, 0.3), y0, **options)
    assert batch.n_events.min() > 0
    for place in range(3):
        assert_same_row(batch, place, solve(system, (0, 0.3), y0[place], **options))
