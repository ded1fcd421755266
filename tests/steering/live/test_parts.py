"""The declared parts of the live loop are those that a drive consists of."""

import importlib
import threading
from itertools import pairwise

import numpy as np
import pytest

from hopdata.steering import robot as plant
from hopdata.steering.experiments.tasks import Unheeding
from hopdata.steering.live import parts
from hopdata.steering.live.drive import drive
from hopdata.steering.live.log import DriveLog
from hopdata.steering.live.simulated import LiveHopper, SimulatedBoom, SimulatedStream
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.trial import record_trial

ROBOT = plant.SteeredHopper()


def found(owner):
    """Return what ``module:name`` or ``module:name.method`` names."""
    module, _, name = owner.partition(":")
    one = importlib.import_module(f"hopdata.steering.live.{module}")
    for attribute in name.split("."):
        one = getattr(one, attribute)
    return one


def test_a_drive_has_the_declared_threads_and_no_others(tmp_path):
    swings = [0.9, 0.9, 0.9, -0.9, -0.9] * 4
    geometry = calibrate(record_trial(ROBOT, swings, seed=1).recording)
    boom = SimulatedBoom()
    stream = SimulatedStream(LiveHopper(ROBOT, boom.newest))
    log = DriveLog(
        tmp_path / "drive.h5", len(geometry.body_names) + 1, setup={}, files={}
    )
    alive = set()

    def look(_loop, _stream):
        alive.update(one.name for one in threading.enumerate())

    drive(
        geometry,
        Unheeding(0.3, np.random.default_rng(0)),
        boom,
        stream=stream,
        stop=threading.Event(),
        seconds=0.5,
        on_look=look,
        log=log,
    )
    ours = {name for name in alive if name.startswith("hopdata-")}
    assert ours == set(parts.threads(simulated=True))


def test_the_threads_of_a_drive_by_cameras_and_without_a_log():
    names = parts.threads(log=False)
    assert parts.STREAM in names
    assert parts.SIMULATED not in names
    assert parts.LOG not in names


@pytest.mark.parametrize("part", parts.PARTS, ids=lambda part: part.name)
def test_each_part_is_a_class_that_starts_a_thread_of_its_name(part):
    if part.kind == "outside":
        assert part.owner == ""
        return
    owner = found(part.owner)
    assert isinstance(owner, type)
    if part.kind == "store":
        assert owner.__name__ == part.name
        return
    module = importlib.import_module(owner.__module__)
    with open(module.__file__, encoding="utf-8") as source:
        assert f'"{part.name}"' in source.read()


@pytest.mark.parametrize(
    "flow", parts.FLOWS, ids=lambda flow: f"{flow.source}>{flow.target}"
)
def test_each_flow_is_a_method_between_declared_parts(flow):
    names = {part.name for part in parts.PARTS}
    assert {flow.source, flow.target} <= names
    if flow.by:
        assert callable(found(flow.by))


def test_the_printed_figure_is_a_chain_from_cameras_to_the_planning_thread():
    printed = [(flow.source, flow.target) for flow in parts.FLOWS if flow.printed]
    chain = [parts.CAMERAS, parts.STREAM, parts.BUFFER, parts.CONTROL]
    assert list(pairwise(chain)) == printed[:3]
    drawn = {part.name for part in parts.PARTS if part.printed}
    assert drawn == {*chain, parts.ROBOT}
