"""The stages: what one returns is what the next takes, and each may be called alone."""

import inspect
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from hopdata.landings.states.pairs import Pairs
from hopdata.line import Key, Kind, Line, key, results, saved
from hopdata.provenance import stage_digest
from hopdata.recordings.readers.hdf5 import read_recording
from hopdata.stages import (
    LINE,
    TABLE,
    floor_compensation,
    foot_contacts,
    home_frame,
    mode_schedules,
    normalisation,
    poincare_sections,
    verdict,
)

SCRIPT = Path(__file__).parents[1] / "workflow" / "scripts" / "stage.py"
#: What is returned, by the name of the result: as it is written in the class.
RETURNED = {
    field.name: field.type
    for stage in LINE.stages.values()
    for field in fields(stage.returned)
}


@pytest.mark.parametrize("name", LINE.stages)
def test_a_stage_takes_what_another_makes(name):
    """Types are compared as text: mypy checks each function, but not what joins them."""
    stage = LINE.stages[name]
    parameters = inspect.signature(stage.function).parameters
    for taken in stage.inputs:
        expected = RETURNED[taken].replace("Recording | WithTruth", "Recording")
        maker = LINE.maker_of(taken)
        if maker.makes_all(LINE.results[taken]):
            assert "recording" not in stage.per
        elif "recording" in LINE.results[taken].wildcards - {*stage.per}:
            expected = f"dict[str, {expected}]"
        assert parameters[taken].annotation == expected


def test_each_stage_comes_after_those_whose_results_it_takes():
    seen = set()
    for name in LINE.stages:
        assert {*LINE.before(name)} <= seen
        seen.add(name)


def test_each_result_and_each_file_is_made_once():
    every = [
        result for stage in LINE.stages.values() for result in stage.results.values()
    ]
    assert len({one.name for one in every}) == len(every)
    assert len({one.path for one in every}) == len(every)


def test_a_result_has_the_wildcards_of_its_stage():
    for stage in LINE.stages.values():
        for result in stage.results.values():
            by_recording = RETURNED[result.name].startswith("dict[str, ")
            assert stage.makes_all(result) == by_recording
            of_all = {"recording"} if by_recording else set()
            assert result.wildcards == {*stage.per} | of_all, result.path


def test_a_stage_called_alone_takes_the_defaults_of_the_schema(sample_path):
    recording = read_recording(sample_path).part(slice(6000))
    before = recording.positions.copy()
    ready = floor_compensation(recording)
    assert (recording.positions == before).all(), "the user's own is not changed"
    assert ready.floor_model.degree_wanted == 5
    level = {"hopper": ready.level}
    contacts = foot_contacts(level).contacts
    sections = poincare_sections(level, contacts).sections
    schedules = mode_schedules("kink", level, contacts, sections).schedules
    found = home_frame(level, sections, schedules)
    assert len(found.pairs) == (~found.touchdowns["excluded"]).sum() > 60
    assert normalisation(found.pairs, units={"length_m": 0.1}).units[
        "length_unit_m"
    ] == pytest.approx(0.1)
    flat = floor_compensation(recording, floor={"enabled": False})
    assert flat.floor_model.degree == 0


def test_the_verdict_is_given_feet_session_time_and_blocks(monkeypatch):
    rng = np.random.default_rng(0)
    n = 6
    pairs = Pairs(
        x=rng.random((n, 18)),
        y=rng.random((n, 18)),
        schedule=np.array(["1>2"] * n),
        spread_s=np.ones(n),
        recording=np.array(["a", "a", "b", "b", "c", "c"]),
        touchdown=np.arange(n) + 1,
        body_markers=("p", "q", "r"),
        instants=rng.random((n, 2)),
        feet=rng.random((n, 2, 3)),
        feet_se=rng.random((n, 2, 3)),
        time_s=np.arange(n) + 0.5,
    )
    given = {}

    def noting(*_, **named):
        given.update(named)
        return SimpleNamespace(orders=[], gross_errors={})

    monkeypatch.setattr("hopdata.maps.verdict.judge", noting)
    monkeypatch.setattr("hopdata.landings.checks.blurred", lambda _: "")
    touchdowns = pd.DataFrame(
        columns=["recording", "touchdown", "t_pre_s", "contact_heel_s", "contact_toe_s"]
    )
    blocks = {"a": "mat", "b": "sand", "c": "mat"}
    verdict(pairs, touchdowns, options={}, blocks=blocks, seed=1)
    for name, field in (("feet", "feet"), ("feet_se", "feet_se"), ("time", "time_s")):
        np.testing.assert_array_equal(given[name], getattr(pairs, field))
    np.testing.assert_array_equal(given["blocks"] == "sand", pairs.recording == "b")
    assert [*given["foot_names"]] == ["heel", "toe"]
    verdict(pairs, touchdowns, options={}, blocks=dict.fromkeys("abc"), seed=1)
    np.testing.assert_array_equal(given["blocks"], pairs.recording)


def test_only_a_stage_s_own_text_and_modules_are_in_its_digest():
    digests = {name: digest_of(name) for name in LINE.stages}
    assert len({*digests.values()}) == len(digests)
    texts, modules = LINE.sources("verdict")
    assert "def verdict(" in texts[1]
    assert "def prediction(" not in "".join(texts)
    assert "hopdata.landings.states.pairs" in modules
    assert "hopdata.recordings.readers.hdf5" not in modules


def digest_of(name):
    texts, modules = LINE.sources(name)
    return stage_digest(texts, modules, script=SCRIPT)


@results
class Twice:
    twice: list[int] = saved("tables/twice_{recording}.csv", TABLE)


def double(recording, numbers, *, seed=key("seed"), excluded=key("recordings.exclude")):
    """Double numbers."""
    return Twice([seed * one for one in numbers if one not in excluded])


double.__annotations__["return"] = "Twice"


def test_a_stage_of_another_line():
    line = Line()
    called = line.stage(per=("recording",))(double)
    stage = line.stages["double"]
    assert (stage.inputs, stage.takes) == (("numbers",), ("recording",))
    assert stage.summary == "Double numbers."
    config = {"seed": 3, "recordings": [{"name": "one", "exclude": [2]}]}
    assert stage.settings(config, "one") == {"seed": 3, "excluded": [2]}
    assert line.results["twice"].wildcards == {"recording"}
    assert line.maker_of("twice") is stage
    assert called("one", [1, 2], seed=3).twice == [3, 6]


def test_a_key_is_a_value_a_section_or_derived():
    config = {"a": {"b": 1, "c": 2}, "recordings": [{"name": "x", "exclude": [7]}]}
    assert Key("a.b").value(config) == 1
    assert Key("a", ("b",)).value(config) == {"c": 2}
    assert Key(lambda found: found["a"]["c"]).value(config) == 2
    assert Key("recordings.exclude").value(config) == {"x": [7]}
    assert Key("recordings.exclude").value(config, "x") == [7]
    of_one = Key(lambda found, name: f"{name} {found['a']['b']}")
    assert of_one.of_each_recording
    assert of_one.value(config, "x") == "x 1"


def test_what_a_file_rounds_a_later_stage_gets_rounded():
    kind = Kind(write="builtins:print", read="builtins:open", stored="builtins:round")
    assert kind.as_stored(1.2) == 1
    assert kind.modules == {"builtins"}
    assert Kind(write="a:b", read="c:d").as_stored(1.2) == 1.2
