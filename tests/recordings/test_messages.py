"""What this room says: a template for each code, and values that JSON can hold."""

import json
import re
import tomllib

import numpy as np
import pytest
from made_up_hopper import (
    MARKERS,
    hopping,
    with_frozen,
    with_gap,
    with_spike,
    with_swap,
)

from hopdata.messages import PACKAGE, Message
from hopdata.recording import Recording
from hopdata.recordings.plausibility import notes
from hopdata.recordings.quality.inspection import inspect_recording
from hopdata.recordings.quality.roles import guess_roles
from hopdata.recordings.raw import RawRecording

TEMPLATES = tomllib.loads((PACKAGE / "recordings/messages.toml").read_text("utf-8"))


def test_each_code_has_a_template_and_each_template_is_used():
    source = "".join(path.read_text("utf-8") for path in PACKAGE.rglob("*.py"))
    assert set(TEMPLATES) <= set(re.findall(r'"recordings\.(\w+)"', source))
    said = set(re.findall(r'Message\(\s*"recordings\.(\w+)"', source))
    assert len(said) > len(TEMPLATES) / 2
    assert said <= set(TEMPLATES)


@pytest.fixture(scope="module")
def inspection():
    """A recording with a fault of each kind."""
    time, positions = hopping(1)
    positions = with_swap(positions, "hip1", "toe2", 900, 960)
    positions = with_spike(positions, "hip2", 700, 0.05)
    positions = with_frozen(positions, "hip3", 1200, 1240)
    positions = with_gap(positions, "toe1", 100, 400)
    positions[1500:1520] = positions[1400:1420]
    positions[1600:, 1] += 0.1
    time = time.copy()
    time[300:] += 0.05
    time[500] += 0.004
    time[501] = time[500]
    raw = RawRecording(MARKERS, time, positions, 120.0, "m", unit_is_stated=False)
    return inspect_recording(raw)


def messages(inspection):
    roles = guess_roles(inspection)
    yield from (inspection.unit.why, inspection.up.why, inspection.rate.why)
    yield from (suspect.message for suspect in inspection.suspects())
    yield from (*inspection.lost, *inspection.treated, *roles.problems)
    yield from filter(None, (*roles.reasons.values(), *roles.unsure.values()))
    recording = Recording.from_arrays(
        np.arange(len(inspection.time)) / 120.0,
        inspection.positions,
        MARKERS,
        feet=MARKERS[3:6],
        body=MARKERS[:3],
    )
    yield from notes(recording)


def test_messages_go_through_json_and_back(inspection):
    found = list(messages(inspection))
    kinds = {suspect.kind for suspect in inspection.suspects()}
    assert {"swap", "spike", "jump", "frozen", "copy", "dropped", "rate"} <= kinds
    for message in found:
        again = Message.from_dict(json.loads(json.dumps(message.to_dict())))
        assert str(again) == str(message)
        assert again.code == message.code


def test_the_text_of_a_fault_is_its_message(inspection):
    for suspect in inspection.suspects():
        assert suspect.text == str(suspect.message)
        assert set(suspect.markers) <= set(MARKERS)
        for name in suspect.markers:
            assert name in suspect.text
