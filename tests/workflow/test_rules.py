"""What is written from the stages is up to date, and each key repeats only what it should."""

import re
from pathlib import Path

import pytest

from hopdata.config.schema import load_schema
from hopdata.stages import LINE

ROOT = Path(__file__).parents[2]
#: Stages that run again if a key changes; stages after these run too. This table states
#: what should be; that of docs/results.md is found by changing each key.
FIRST = {
    "seed": ["simulate", "prediction", "constraint_subspaces", "verdict"],
    "simulation.*": ["simulate"],
    "recordings.simulation.*": ["simulate"],
    "motion_capture.*": ["simulate"],
    "motion_capture.noise_m": ["simulate", "quality"],
    "recordings.file": ["import_recording", "quality"],
    "recordings.exclude": ["import_recording", "mode_schedules"],
    "recordings.begins_s": ["home_frame"],
    "recordings.block": ["verdict"],
    "markers.*": ["import_recording"],
    "markers.body": ["import_recording", "floor_compensation", "inspection"],
    "input.*": ["import_recording"],
    "quality.*": ["import_recording"],
    # The inspection tells what filters and wobble do to the study's own contacts and states.
    "feet": ["floor_compensation", "inspection"],
    "floor.*": ["floor_compensation", "inspection"],
    "filling.longest_s": ["floor_compensation", "inspection"],
    "filling.largest_share": ["mode_schedules"],
    "touchdowns.method": ["foot_contacts", "inspection"],
    "touchdowns.*": ["foot_contacts", "mode_schedules", "inspection"],
    "touchdowns.ambiguous_below": ["mode_schedules", "inspection"],
    "touchdowns.ambiguous": ["mode_schedules", "home_frame", "inspection"],
    "sections.*": ["poincare_sections", "inspection", "quality"],
    "sections.grid_nodes": ["section_densities"],
    "home.*": ["home_frame", "inspection"],
    "states.*": ["poincare_sections", "home_frame", "inspection"],
    "units.*": ["normalisation"],
    "prediction.*": ["prediction"],
    "subspaces.*": ["constraint_subspaces"],
    "distances.*": ["constraint_subspaces"],
    "verdict.*": ["verdict"],
    "report.expected_noise_m": ["quality"],
    # These decide what is asked for, or concern rules that are no stages.
    # The keys that it sets are keys of their own.
    "printed": [],
    "report.language": [],
    "distances.enabled": [],
    "figures.*": [],
    "external.*": [],
    "scaling_study.*": [],
    "dissertation.*": [],
    "steering.*": [],
    "recordings.contacts.*": [],
    "recordings.forces.*": [],
    # A new name is a new folder.
    "study": [],
    "recordings.name": [],
}


@pytest.fixture
def writers(monkeypatch):
    """Return the modules that write what follows from the stages."""
    monkeypatch.syspath_prepend(ROOT / "packaging")
    import graph
    import keys
    import rules

    return {"graph": graph, "keys": keys, "rules": rules}


def test_what_follows_from_the_stages_is_up_to_date(writers):
    for path, text in writers["rules"].written().items():
        assert path.read_text() == text, f"{path}: run make rules"


def expected(name):
    """Return the stages of a key, or those of the section that it is in."""
    if name in FIRST:
        return FIRST[name]
    section = name
    while "." in section:
        section = section.rpartition(".")[0]
        if f"{section}.*" in FIRST:
            return FIRST[f"{section}.*"]
    raise AssertionError(f"say in FIRST which stages take {name}")


def test_each_key_repeats_only_the_stages_that_take_it(writers):
    found = writers["keys"].repeated(LINE)
    assert len(found) > 100
    assert found == {name: expected(name) for name in found}


def test_every_section_of_the_schema_is_looked_at(writers):
    found = {name.partition(".")[0] for name in writers["keys"].repeated(LINE)}
    assert {*load_schema()["properties"]} <= found | {"steering", "dissertation"}


@pytest.mark.parametrize(
    ("stages", "spared"),
    [
        (["normalisation"], {"verdict", "quality", "home_frame"}),
        (["verdict"], {"prediction", "constraint_subspaces", "landing_maps"}),
        (["section_densities"], {"mode_schedules", "verdict"}),
        (["foot_contacts"], {"floor_compensation", "inspection"}),
    ],
)
def test_what_runs_after_a_stage_is_what_takes_its_results(writers, stages, spared):
    after = {*writers["keys"].after(LINE, stages)}
    assert not spared & after
    if stages == ["normalisation"]:
        assert after == {"prediction", "constraint_subspaces", "landing_maps"}


def test_the_rules_state_every_file_and_key(writers):
    text = writers["rules"].rules_text(LINE)
    for name, stage in LINE.stages.items():
        rule = re.search(rf"^rule {name}:\n(.*?)(?=^rule |\Z)", text, re.M | re.S)[1]
        for result in stage.results.values():
            place = result.path.replace("{", "{{").replace("}", "}}")
            file = f'f"{{RESULTS}}/{place}"'
            if stage.makes_all(result):
                file = f"each_recording({file})"
            assert f"        {result.name}={file}," in rule
        for taken in [*stage.inputs, *stage.keys, *stage.sources]:
            assert f"        {taken}=" in rule


def test_the_picture_shows_every_rule_and_no_box_upon_another(writers):
    graph = writers["graph"]
    before = graph.reduced(graph.rules_before(LINE))
    rows = graph.rows_of(before)
    places = [(graph.COLUMNS.get(name, graph.CHAIN), rows[name]) for name in before]
    assert len({*places}) == len(places)
    picture = graph.drawing(LINE)
    for name in before:
        assert f">{name}</text>" in picture
    assert all(rows[one] < rows[name] for name in before for one in before[name])
