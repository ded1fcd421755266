"""The table over worlds: each cell once, finished rows kept, worlds that differ in one thing."""

from concurrent.futures import Future

import numpy as np
import pytest
import worlds
from worlds import ANEW, AS_IT_WAS, PLAIN, UNLEARNED, WORLDS, cells

from hopdata.steering.robot import SteeredHopper


def row_of(cell, starts=10):
    done = {"starts": starts, "arrived": 3, "hops": 20.0, "fell": 0, "late": 7}
    key = {"seed": cell.seed, "world": cell.world, "model": cell.model}
    key["controller"] = cell.controller
    return {**key, **done, "late_commands": 0, "note": ""}


def test_what_is_the_same_by_construction_is_made_once():
    asked = list(cells([1], list(WORLDS), worlds.CONTROLLERS))
    assert len(set(asked)) == len(asked)
    plain = {cell.model for cell in asked if cell.world == PLAIN}
    assert plain == {ANEW, UNLEARNED}
    delayed = {cell.model for cell in asked if cell.world == "delay 50 ms"}
    assert delayed == {AS_IT_WAS}  # an excitation is recorded: no delay in it
    slippery = {cell.model for cell in asked if cell.world == "friction 0.2"}
    assert slippery == {ANEW, AS_IT_WAS, UNLEARNED}
    unlooking = {cell.world for cell in asked if cell.controller == "none"}
    assert "noise 2 mm" not in unlooking


def test_finished_rows_are_kept_and_only_the_others_are_made(tmp_path, monkeypatch):
    asked = list(cells([2, 1], [PLAIN, "friction 0.2"], ["planner"]))
    out = tmp_path / "worlds.csv"
    first = {asked[0]: {**row_of(asked[0]), "arrived": 9}}
    worlds.write_rows(out, first)
    assert list(worlds.finished(out)) == [asked[0]]

    class Now:
        """Does the work at once, in this process."""

        def __init__(self, *_, **__):
            self.made = []

        def __enter__(self):
            return self

        def __exit__(self, *_):
            assert set(self.made) == set(asked[1:])

        def submit(self, _, cell, starts):
            self.made.append(cell)
            done = Future()
            done.set_result(row_of(cell, starts))
            return done

    monkeypatch.setattr(worlds, "ProcessPoolExecutor", Now)
    worlds.made(out, asked, 10, 1)
    rows = worlds.finished(out)
    assert set(rows) == set(asked)
    assert rows[asked[0]]["arrived"] == 9
    assert [cell.seed for cell in rows] == sorted(cell.seed for cell in asked)
    with pytest.raises(SystemExit, match="expected rows of 5 starts"):
        worlds.made(out, asked, 5, 1)


@pytest.mark.parametrize("name", [name for name in WORLDS if name != PLAIN])
def test_a_world_differs_from_the_plain_one(name):
    plain = SteeredHopper()
    of_world = WORLDS[name]
    robot = of_world.robot(plain)
    assert (robot != plain) == of_world.changes_robot
    differs = {
        "camera": of_world.noise_m is not None,
        "transport": of_world.transport != WORLDS[PLAIN].transport,
        "observation": of_world.observation != "corrected",
    }
    assert of_world.changes_robot + sum(differs.values()) == 1
    if of_world.preloaded is not None:
        more = np.array(robot.preload_shares) / plain.preload_shares
        assert sorted(more.round(9).tolist()) == [1.0, 1.0, 1.1]
