"""One key, ``printed: true``, sets all printed variants."""

from functools import reduce
from operator import getitem

import pytest
import yaml
from jsonschema import Draft202012Validator

from hopdata.config.loading import load_config
from hopdata.config.schema import (
    configuration_page,
    default_of,
    load_schema,
    printed_keys,
)
from hopdata.errors import ConfigError

SOUND = {
    "study": "trial",
    "recordings": [{"name": "one", "file": "one.tsv"}],
    "markers": {"body": ["b1", "b2", "b3"], "feet": ["heel", "toe"]},
}


def loaded(**keys):
    return load_config({**SOUND, **keys}, check_files=False)


def value(config, path):
    return reduce(getitem, path.split("."), config)


def entry(path):
    whole = load_schema()
    return reduce(lambda schema, key: schema["properties"][key], path.split("."), whole)


PRINTED = printed_keys()


def test_the_stages_of_the_study_have_a_printed_variant():
    stages = {path.partition(".")[0] for path in PRINTED}
    assert {"sections", "touchdowns", "states"} <= stages


@pytest.mark.parametrize("path", PRINTED)
def test_the_key_sets_every_printed_variant(path):
    printed = loaded(printed=True)
    assert value(printed, path) == PRINTED[path]
    assert value(printed, path) != value(loaded(), path)
    assert value(loaded(printed=False), path) == entry(path)["default"]


@pytest.mark.parametrize("path", PRINTED)
def test_a_printed_value_is_one_that_a_user_may_write(path):
    Draft202012Validator(entry(path)).validate(PRINTED[path])


@pytest.mark.parametrize("path", PRINTED)
def test_a_key_of_the_user_wins(path):
    section, _, rest = path.partition(".")
    default = entry(path)["default"]
    keys = default
    for key in reversed(rest.split(".")):
        keys = {key: keys}
    mixed = loaded(printed=True, **{section: keys})
    assert value(mixed, path) == default
    others = [other for other in PRINTED if other != path]
    assert {other: value(mixed, other) for other in others} == {
        other: PRINTED[other] for other in others
    }


def test_keys_without_a_printed_variant_keep_their_defaults():
    plain = loaded()
    printed = loaded(printed=True)
    changed = set()
    for block, content in plain.items():
        if content != printed[block]:
            changed.add(block)
    assert changed == {"printed", *(path.partition(".")[0] for path in PRINTED)}


def test_anything_but_true_or_false_is_refused():
    with pytest.raises(ConfigError, match="printed: expected true or false, found"):
        loaded(printed="maybe")


def test_an_empty_section_takes_printed_values_too():
    text = "sections:\n  # rule: landings\n"
    printed = loaded(printed=True, **yaml.safe_load(text))
    assert printed["sections"]["rule"] == "printed"


def test_the_whole_configuration_says_the_same_when_read_again():
    printed = loaded(printed=True)
    assert load_config(printed, check_files=False) == printed


def test_a_default_is_printed_only_where_it_is_annotated():
    annotated = {"default": 1, "x-printed": 2}
    assert default_of(annotated, printed=True) == 2
    assert default_of(annotated, printed=False) == 1
    assert default_of({"default": 1}, printed=True) == 1


def test_the_page_tells_the_printed_value():
    row = next(
        line for line in configuration_page().splitlines() if "| `rule` |" in line
    )
    assert '`"landings"`; if `printed`: `"printed"`' in row


# The printed method cannot reset a state.

SIMULATED = [{"name": "one"}]
MARKERS = {"body": ["body1", "body2", "body3"], "feet": ["foot1", "foot2"]}
RESETTING = [{"scene": "quadruped"}, {"control": {"impulse": 0.1}}]


@pytest.mark.parametrize("simulation", RESETTING)
def test_what_the_printed_integrator_cannot_do_is_refused_with_the_way_out(simulation):
    keys = {"recordings": SIMULATED, "markers": MARKERS, "printed": True}
    with pytest.raises(ConfigError) as caught:
        loaded(**keys, simulation=simulation)
    lines = str(caught.value).splitlines()
    assert len(lines) == 1
    assert "simulation.integrator: expected driver beside simulation." in lines[0]
    assert lines[0].endswith("by printed: true; set simulation.integrator: driver")
    by_driver = loaded(**keys, simulation={**simulation, "integrator": "driver"})
    assert by_driver["simulation"]["integrator"] == "driver"
    # Nothing is simulated if there is a file.
    assert loaded(printed=True, simulation=simulation)["printed"]


def test_what_the_printed_integrator_can_do_is_allowed():
    keys = {"recordings": SIMULATED, "markers": MARKERS, "printed": True}
    for control in ({}, {"coupling": 0.3}, {"delay_s": 0.01}):
        found = loaded(**keys, simulation={"control": control})
        assert found["simulation"]["integrator"] == "printed"
