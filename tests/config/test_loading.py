from dataclasses import asdict
from inspect import signature
from math import ceil
from pathlib import Path
from pkgutil import resolve_name

import pytest
import yaml

from hopdata.config.consistency import files_of, simulation_of
from hopdata.config.loading import load_config, read_yaml, what_is_set
from hopdata.config.schema import in_words, load_schema
from hopdata.errors import ConfigError
from hopdata.scenes import SCENES, scene_class

ROOT = Path(__file__).parents[2]

SOUND = """\
study: trial
seed: 7
recordings:
  - name: one
    file: one.tsv
markers:
  body: [b1, b2, b3]
  feet: [heel, toe]
home:
  marker: b1
sections:
  threshold_sigmas: 0.002
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a working directory with the recording that `SOUND` names."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.tsv").write_text("not read here")
    return tmp_path


def load(text):
    Path("study.yaml").write_text(text)
    return load_config("study.yaml")


def plain_leaves(value):
    children = value.values() if isinstance(value, dict) else value
    for child in children:
        if isinstance(child, dict | list):
            assert type(child) in (dict, list)
            yield from plain_leaves(child)
        else:
            yield child


def test_a_recording_has_no_file_one_or_several():
    entries = [{"file": None}, {"file": "a.tsv"}, {"file": ["a.tsv", "b.c3d"]}, {}]
    assert [files_of(e) for e in entries] == [[], ["a.tsv"], ["a.tsv", "b.c3d"], []]


def test_what_is_no_number_at_all_has_no_hint(folder):
    with pytest.raises(ConfigError, match=r"verdict.margin: expected .*found '1.2.3%'"):
        load(SOUND + "verdict: {margin: 1.2.3%}\n")


def test_whole_numbers_may_be_written_with_a_point(folder):
    config = load(SOUND.replace("seed: 7", "seed: 7.0") + "floor: {degree: 1.0}\n")
    assert (config["seed"], config["floor"]["degree"]) == (7, 1)
    assert isinstance(config["seed"], int)
    assert isinstance(config["floor"]["degree"], int)


def test_what_is_given_stays_and_the_rest_is_filled_in(folder):
    config = load(SOUND)
    assert config["study"] == "trial"
    assert config["seed"] == 7
    assert config["markers"] == {
        "body": ["b1", "b2", "b3"],
        "feet": ["heel", "toe"],
        "boom": [],
    }
    assert config["sections"]["threshold_sigmas"] == 0.002
    assert config["sections"]["grid_nodes"] == 1024
    assert config["prediction"] == {
        "bootstraps": 1000,
        "train": 120,
        "test": 41,
        "minimum_class": 40,
        "draws": "distinct",
    }
    assert config["simulation"]["hopper"]["mass_kg"] == 2.3
    assert set(config) == set(load_schema()["properties"])
    assert {type(leaf) for leaf in plain_leaves(config)} <= {
        str,
        int,
        float,
        bool,
        type(None),
    }


def test_a_file_and_its_mapping_give_the_same_and_loading_is_idempotent(folder):
    config = load(SOUND)
    mapping = yaml.safe_load(SOUND)
    assert load_config(mapping) == config
    assert mapping == yaml.safe_load(SOUND)
    assert load_config(config) == config


def test_defaults_are_copied_not_shared(folder):
    first = load(SOUND)
    first["figures"]["formats"].append("pdf")
    first["sections"]["grid_nodes"] = 1
    again = load(SOUND)
    assert again["figures"]["formats"] == ["svg", "png"]
    assert again["sections"]["grid_nodes"] == 1024


def test_an_empty_section_means_its_defaults(folder):
    assert load(SOUND + "floor:\n  # degree: 2\n")["floor"]["degree"] == 5


def test_the_home_marker_is_by_default_left_to_the_recordings(folder):
    assert load(SOUND)["home"]["marker"] == "b1"
    assert load(SOUND.replace("marker: b1", ""))["home"]["marker"] is None


def test_numbers_in_either_notation(folder):
    for text in ("2e-3", "2.0e-3", "+2E-3", "0.002"):
        config = load(SOUND.replace("0.002", text))
        assert config["sections"]["threshold_sigmas"] == 0.002


def test_a_recording_without_a_file_is_simulated(folder):
    text = SOUND.replace("    file: one.tsv\n", "")
    text = text.replace("b1, b2, b3", "body1, body2, body3").replace(
        "heel, toe", "foot1, foot2"
    )
    config = load(text.replace("marker: b1", "marker: body2"))
    own = {"hops": None, "duration_s": None}
    (recording,) = config["recordings"]
    assert recording["file"] is None
    assert recording["simulation"] == own


def test_a_recording_may_have_its_own_length(folder):
    text = SOUND.replace("file: one.tsv", "simulation: {duration_s: 5.5}")
    text = text.replace("b1, b2, b3", "body1, body2, body3").replace(
        "heel, toe", "foot1, foot2"
    )
    text = text.replace("markers:", "  - name: two\nmarkers:").replace(
        "marker: b1", "marker: body2"
    )
    config = load(text + "simulation: {hops: 7, duration_s: 9}\n")
    one, two = (simulation_of(config, name) for name in ("one", "two"))
    assert (one["hops"], one["duration_s"]) == (7, 5.5)
    assert two == config["simulation"]
    assert {**one, "duration_s": 9} == two


@pytest.mark.parametrize("name", ["thesis", "control"])
def test_the_dissertation_s_study_has_its_size(name):
    config = load_config(ROOT / "config" / f"{name}.yaml")
    rate = config["motion_capture"]["rate_hz"]
    lengths = [
        simulation_of(config, r["name"])["duration_s"] for r in config["recordings"]
    ]
    assert (rate, config["motion_capture"]["noise_m"]) == (100.0, 0.0006)
    assert sum(ceil(length * rate) for length in lengths) == 182_611


def test_the_control_differs_from_the_study_by_what_lands_alone():
    thesis, control = (
        load_config(ROOT / "config" / f"{n}.yaml") for n in ("thesis", "control")
    )
    assert control["simulation"].pop("control") == {
        "coupling": 0.4,
        "impulse": 0.0,
        "delay_s": 0.0,
    }
    assert not any(thesis["simulation"].pop("control").values())
    assert {**control, "study": "thesis"} == thesis


def test_files_need_not_exist_if_nobody_asks(folder):
    config = load_config(
        yaml.safe_load(SOUND.replace("one.tsv", "later.tsv")), check_files=False
    )
    assert config["recordings"][0]["file"] == "later.tsv"


# Mistake: text of SOUND and its replacement, and what the message must name.
MISTAKES = {
    "misspelt section": (
        "sections:",
        "sectoins:",
        ["sectoins: expected a known key", "did you mean 'sections'"],
    ),
    "misspelt key": (
        "threshold_sigmas",
        "threshold_sigms",
        [
            "sections.threshold_sigms",
            "expected a known key",
            "did you mean 'threshold_sigmas'",
        ],
    ),
    "misspelt required key": (
        "markers:",
        "marker:",
        ["marker: expected a known key", "did you mean 'markers'"],
    ),
    "key one level too high": (
        "seed: 7",
        "threshold_sigmas: 0.1",
        ["threshold_sigmas: expected", "did you mean 'sections.threshold_sigmas'"],
    ),
    "unlike any key": (
        "marker: b1",
        "colour: red",
        ["home.colour", "the keys here are marker"],
    ),
    "no markers": (
        "markers:\n  body: [b1, b2, b3]\n  feet: [heel, toe]\n",
        "",
        ["markers: expected this key, found none"],
    ),
    "no study": ("study: trial\n", "", ["study: expected this key, found none"]),
    "study with a slash": (
        "study: trial",
        "study: ../x",
        ["study: expected text", "'../x'"],
    ),
    "study is a number": (
        "study: trial",
        "study: 7",
        ["study: expected text", "found 7; put it in quotes"],
    ),
    "study is a date": (
        "study: trial",
        "study: 2026-11-22",
        ["2026-11-22; put it in quotes"],
    ),
    "study is off": (
        "study: trial",
        "study: off",
        ["found false; yes, no, on and off are true"],
    ),
    "seed in words": (
        "seed: 7",
        "seed: seven",
        ["seed: expected a whole number", "'seven'"],
    ),
    "negative seed": (
        "seed: 7",
        "seed: -1",
        ["seed: expected", "at least 0", "found -1"],
    ),
    "seed true": (
        "seed: 7",
        "seed: true",
        ["seed: expected a whole number", "found true"],
    ),
    "out of range": (
        "0.002",
        "21",
        [
            "sections.threshold_sigmas: expected a number above 0 and at most 20",
            "found 21",
        ],
    ),
    "number in quotes": (
        "0.002",
        "'0.002'",
        ["expected a number", "'0.002'", "without quotes"],
    ),
    "not a number": (
        "0.002",
        ".nan",
        ["sections.threshold_sigmas", "a finite number", "nan"],
    ),
    "nothing": (
        "0.002",
        "",
        ["sections.threshold_sigmas: expected a number", "found null"],
    ),
    "choice": (
        "home:",
        "touchdowns: {method: kinks}\nhome:",
        [
            "touchdowns.method: expected one of 'kink', 'velocity_minimum'",
            "found 'kinks'",
        ],
    ),
    "section is a word": (
        "home:\n  marker: b1",
        "home: b1",
        ["home: expected keys", "'b1'"],
    ),
    "rate 0": (
        "home:",
        "input: {rate_hz: 0}\nhome:",
        ["input.rate_hz", "above 0", "found 0"],
    ),
    "unknown unit": (
        "home:",
        "input: {unit: cm}\nhome:",
        ["input.unit", "'mm'", "found 'cm'; export in mm or m"],
    ),
    "one foot": (
        "[heel, toe]",
        "[heel]",
        ["markers.feet: expected a list of 2 to 18 names"],
    ),
    "two body markers": (
        "b1, b2, b3",
        "b1, b2",
        ["markers.body", "at least 3", "found 2 (b1"],
    ),
    "marker in two roles": (
        "heel, toe",
        "heel, b2",
        [
            "markers.feet[1]: expected each marker once",
            "'b2' in markers.body[1] as well",
        ],
    ),
    "marker twice": (
        "heel, toe",
        "toe, toe",
        ["markers.feet[1]", "'toe' in markers.feet[0]"],
    ),
    "home is no body marker": (
        "marker: b1",
        "marker: heel",
        ["home.marker: expected a body marker (b1, b2, b3)", "found 'heel'"],
    ),
    "missing file": (
        "one.tsv",
        "onne.tsv",
        [
            "recordings[0].file: expected a file",
            "no 'onne.tsv'",
            "did you mean 'one.tsv'",
        ],
    ),
    "one of two files missing": (
        "one.tsv",
        "[one.tsv, onne.tsv]",
        [
            "recordings[0].file[1]: expected a file",
            "no 'onne.tsv'",
            "did you mean 'one.tsv'",
        ],
    ),
    "a file twice": (
        "one.tsv",
        "[one.tsv, one.tsv]",
        [
            "recordings[0].file[1]: expected each file once",
            "found 'one.tsv' in recordings[0].file[0]",
        ],
    ),
    "a file in two recordings": (
        "markers:",
        "  - {name: again, file: ./one.tsv}\nmarkers:",
        [
            "recordings[1].file: expected each file once",
            "in recordings[0].file as well",
        ],
    ),
    "braces": (
        "file: one.tsv",
        "file: one.tsv\n    contacts: {file: 'on {1}.csv'}",
        [
            "recordings[0].contacts.file: expected a path without braces, found 'on {1}.csv'"
        ],
    ),
    "a study of our own": (
        "study: trial",
        "study: both_sides",
        [
            "study: expected a name other than benchmarks and both_sides",
            "found 'both_sides'",
        ],
    ),
    "too few sign flips": (
        "markers:",
        "verdict: {flips: 99, confidence: 0.999}\nmarkers:",
        ["verdict.flips: expected more than 999", "found 99"],
    ),
    "an empty list of files": ("one.tsv", "[]", ["recordings[0].file", "found none"]),
    "missing folder": (
        "one.tsv",
        "data/one.tsv",
        ["recordings[0].file", "there is no folder"],
    ),
    "recordings of one name": (
        "markers:",
        "  - {name: One, file: one.tsv}\nmarkers:",
        ["recordings[1].name: expected each name once", "in recordings[0].name"],
    ),
    "length of a file": (
        "file: one.tsv",
        "file: one.tsv\n    simulation: {hops: 3}",
        ["recordings[0].simulation: expected nothing beside a file", "found hops"],
    ),
    "no recordings": (
        "\n  - name: one\n    file: one.tsv",
        " []",
        ["recordings: expected a list of at least 1", "found none"],
    ),
    "marker that nobody simulates": (
        "    file: one.tsv\n",
        "",
        ["markers.body: expected a marker of the simulation (body1", "found 'b1'"],
    ),
    "a key that was removed": (
        "threshold_sigmas: 0.002",
        "tail_fraction: 0.002",
        [
            "sections.tail_fraction: expected a known key",
            "chosen from landings",
            "sections.rule",
        ],
    ),
    "a limit that follows from the file": (
        "threshold_sigmas: 0.002",
        "threshold_sigmas: 0.002\ninput:\n  most_unpacked_mb: 500",
        [
            "input.most_unpacked_mb: expected a known key",
            "follows from its size",
            "delete the line",
        ],
    ),
    "sigmas beside knees": (
        "  threshold_sigmas: 0.002",
        "  rule: printed\n  threshold_sigmas: 2.5",
        [
            "sections.threshold_sigmas: expected none beside sections.rule: printed",
            "found 2.5",
        ],
    ),
    "a bandwidth beside heights": (
        "  threshold_sigmas: 0.002",
        "  pre_height_m: 0.5\n  post_height_m: 0.3\n  bandwidth_m: 0.002",
        [
            "sections.bandwidth_m: expected none beside heights that are given",
            "found 0.002",
        ],
    ),
    "sections upside down": (
        "threshold_sigmas: 0.002",
        "pre_height_m: 0.2\n  post_height_m: 0.3",
        ["sections.pre_height_m: expected more than", "(0.3)", "found 0.2"],
    ),
    "more components than samples": (
        "home:",
        "subspaces: {components: 30}\nhome:",
        [
            "subspaces.components: expected fewer than subspaces.samples (30)",
            "found 30",
        ],
    ),
    "key twice": (
        "seed: 7",
        "seed: 7\nseed: 8",
        ["line 3, column 1", "the key 'seed' twice"],
    ),
    "within itself": (
        "home:\n",
        "floor: &f {degree: *f}\nhome:\n",
        ["one within itself"],
    ),
    "not YAML": ("[heel, toe]", "[heel, toe", ["line 9", "expected YAML"]),
    "tabs": (
        "  marker: b1",
        "\tmarker: b1",
        ["line 10, column 1", "expected YAML", "not with tabs"],
    ),
    "a list": (SOUND, "- study: trial\n", ["expected keys with values", "found list"]),
    "empty": (SOUND, "", ["expected keys with values", "found nothing"]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told_with_file_key_expectation_and_finding(folder, mistake):
    old, new, parts = MISTAKES[mistake]
    assert old in SOUND
    with pytest.raises(ConfigError) as caught:
        load(SOUND.replace(old, new))
    message = str(caught.value)
    for part in ("expected", "found", *parts):
        assert part in message
    assert all(line.startswith("study.yaml") for line in message.splitlines())
    assert len(message.splitlines()) <= 3


def test_several_mistakes_are_told_at_once_and_each_once(folder):
    text = SOUND.replace("seed: 7", "seed: 7.5").replace("heel, toe", "heel")
    with pytest.raises(ConfigError) as caught:
        load(text + "  grid_nodes: 1.5\n")
    assert len(str(caught.value).splitlines()) == 3


def test_a_hundred_mistakes_are_cut_short(folder):
    text = SOUND + "".join(f"  key{i}: 1\n" for i in range(100))
    with pytest.raises(ConfigError, match="and 90 more mistakes"):
        load(text)


def test_a_missing_configuration_is_told(folder):
    with pytest.raises(
        ConfigError, match=r"absent.yaml: expected a readable configuration"
    ):
        load_config("absent.yaml")


def test_a_mapping_is_named_by_its_files_which_are_looked_into(folder):
    Path("study.yaml").write_text(SOUND)
    with pytest.raises(ConfigError, match=r"^study.yaml: study: expected this key"):
        load_config(
            {"recordings": [{"name": "a"}], "markers": {}}, files=["study.yaml"]
        )
    Path("study.yaml").write_text(SOUND + "seed: 8\n")
    with pytest.raises(ConfigError, match="the key 'seed' twice"):
        load_config(yaml.safe_load(SOUND), files=["study.yaml"])


@pytest.mark.parametrize(
    "name",
    [
        "biped.yaml",
        "config.yaml",
        "control.yaml",
        "half_spread.yaml",
        "hexapod.yaml",
        "printed.yaml",
        "quadruped.yaml",
        "runner.yaml",
        "runner_forces.yaml",
        "thesis.yaml",
    ],
)
def test_the_configurations_that_come_along_are_sound(name):
    config = load_config(ROOT / "config" / name, check_files=False)
    assert config["study"] == {"config.yaml": "sample"}.get(name, Path(name).stem)


UNITS = {
    "_m": "m",
    "_s": "s",
    "_kg": "kg",
    "_hz": "Hz",
    "_mb": "MB",
    "_n": "N",
    "_rad": "rad",
    "_m_s": "m/s",
    "_rad_s": "rad/s",
    "_m_s2": "m/s²",
    "_n_m": "N/m",
    "_n_s_m": "N s/m",
    "_kg_m2": "kg m²",
    "_per_min": "1/min",
}
DOTS = {"figures.dpi": "dots per inch"}


def schemas(schema, path=""):
    for key, inner in schema.get("properties", {}).items():
        yield f"{path}{key}", inner
        yield from schemas(inner.get("items", inner), f"{path}{key}.")


EVERY_KEY = {
    path: schema for scene in SCENES for path, schema in schemas(load_schema(scene))
}


@pytest.mark.parametrize(("path", "schema"), EVERY_KEY.items())
def test_every_key_has_a_meaning_a_kind_and_a_default_that_fits(path, schema):
    from jsonschema import Draft202012Validator

    assert len(schema["description"]) > 10
    assert in_words(schema)
    if schema.get("type") == "object":
        assert schema["additionalProperties"] is False
    if "default" in schema and schema.get("type") != "object":
        Draft202012Validator(schema).validate(schema["default"])
    if schema.get("type") in ("number", ["number", "null"]):
        suffix = max((u for u in UNITS if path.endswith(u)), key=len, default=None)
        assert schema.get("x-unit") == UNITS.get(suffix, DOTS.get(path))


def test_the_simulation_has_the_same_keys_and_defaults_as_the_schema():
    from hopdata.synthesis.camera import MotionCapture
    from hopdata.synthesis.simulate import Simulation

    config = load_config(yaml.safe_load(SOUND), check_files=False)
    assert config["motion_capture"] == listed(asdict(MotionCapture()))
    for name in SCENES:
        content = {**yaml.safe_load(SOUND), "simulation": {"scene": name}}
        default = asdict(Simulation(name=name, scene=scene_class(name)()))
        default = {"scene": default.pop("name"), name: default.pop("scene"), **default}
        assert load_config(content, check_files=False)["simulation"] == listed(default)


def listed(value):
    """Return the value with lists for tuples, as in YAML."""
    if isinstance(value, dict):
        return {key: listed(inner) for key, inner in value.items()}
    return (
        [listed(inner) for inner in value] if isinstance(value, list | tuple) else value
    )


# The functions that take a section's keys as their options, and the keys that go
# elsewhere.
STAGES = {
    "input": ["hopdata.recordings.importing:import_recording"],
    "floor": ["hopdata.landings.floor:fit_floor"],
    "filling": ["hopdata.landings.filling:fill_gaps"],
    "sections": ["hopdata.landings.sections.select:select_sections"],
    "touchdowns": [
        "hopdata.landings.contacts.find:find_study_landings",
        "hopdata.landings.touchdowns:touchdown_table",
    ],
    "states": ["hopdata.landings.states.assemble:assemble_pairs"],
    "units": ["hopdata.maps.units:choose_units"],
    "prediction": ["hopdata.maps.prediction:bootstrap_prediction"],
    "subspaces": ["hopdata.maps.subspaces:bootstrap_subspaces"],
    "distances": ["hopdata.maps.subspaces:measure_distances"],
    "scaling_study": ["hopdata.synthesis.scaling:study_landings"],
    "figures": ["hopdata.figures.style:save_figure"],
}
ELSEWHERE = {
    ("filling", "largest_share"),
    ("sections", "grid_nodes"),
    ("distances", "enabled"),
}


@pytest.mark.parametrize("section", STAGES)
def test_the_keys_of_a_section_are_the_options_of_its_stage(section):
    stages = STAGES[section]
    options = {
        k: v
        for one in stages
        for k, v in signature(resolve_name(one)).parameters.items()
    }
    content = {**yaml.safe_load(SOUND), "sections": {}}
    config = load_config(content, check_files=False)
    for key, default in config[section].items():
        if (section, key) not in ELSEWHERE:
            assert key in options, (
                f"{section}.{key}: no option of {' or '.join(stages)}"
            )
            assert listed(options[key].default) == default, (
                f"{section}.{key}: another default"
            )


def test_aliases_that_unfold_to_very_much_are_refused(tmp_path):
    lines = ["study: a", "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 7)]
    file = tmp_path / "config.yaml"
    file.write_text("\n".join(lines))
    with pytest.raises(
        ConfigError, match=r"at most 100,000 keys and values, found 12,345,687 once"
    ):
        load_config(file)


def test_an_alias_that_repeats_a_little_is_as_if_written_out(tmp_path):
    file = tmp_path / "config.yaml"
    file.write_text("one: &one {a: 1, b: [2]}\nother: {<<: *one, c: 3}\nthird: *one\n")
    assert read_yaml(file) == {
        "one": {"a": 1, "b": [2]},
        "other": {"a": 1, "b": [2], "c": 3},
        "third": {"a": 1, "b": [2]},
    }


@pytest.mark.parametrize(
    "value",
    ["!!timestamp now", "!!bool maybe", '!!int ""', "!!float one", "!!binary é"],
)
def test_a_value_that_does_not_fit_its_tag_is_told_with_its_line(tmp_path, value):
    file = tmp_path / "a.yaml"
    file.write_text(f"study: a\nseed: {value}\n", encoding="utf-8")
    with pytest.raises(
        ConfigError, match=r"a\.yaml, line 2, column 7: expected YAML, found: "
    ):
        read_yaml(file)
    file.write_text("study: a\nseed: !!int 3\nday: !!timestamp 2020-01-02\n")
    assert read_yaml(file)["seed"] == 3


CONFIGS = sorted((ROOT / "config").glob("*.yaml"))


@pytest.mark.parametrize("file", CONFIGS, ids=[file.stem for file in CONFIGS])
def test_what_is_set_makes_the_whole_configuration_again(file):
    if file.stem == "group":
        pytest.skip("a table of studies")
    config = load_config(file, check_files=False)
    kept = what_is_set(config)
    assert load_config(kept, check_files=False) == config
    assert {"study", "recordings", "markers"} <= {*kept}
    assert "steering" not in kept
    lines = yaml.safe_dump(kept).count("\n")
    assert lines < yaml.safe_dump(config).count("\n") / 3


def test_a_key_with_its_default_is_not_set():
    config = load_config(ROOT / "config" / "config.yaml", check_files=False)
    default = config["verdict"]["margin"]
    config["verdict"]["margin"] = default / 2
    assert what_is_set(config)["verdict"] == {"margin": default / 2}
    config["verdict"]["margin"] = default
    assert "verdict" not in what_is_set(config)
