"""Memory is reused by the next integration of a plate, and never shared."""

from __future__ import annotations

from equal_runs import same_bytes

from hopdata.hybrid import solve
from hopdata.scenes.plate import Plate


def test_the_memory_of_a_scene_begins_anew():
    plate = Plate(n_contacts=5)
    system, start = plate.system(sums=True), (0.0, 1.5, 0.05, 0.0, 0.0, 0.0)
    ends = [solve(system, (0, 0.4), start, params=plate.params) for _ in range(3)]
    assert len(ends[0].events) > 0
    assert same_bytes(ends[0], ends[1])
    assert same_bytes(ends[0], ends[2])
