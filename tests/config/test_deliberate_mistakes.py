"""Deliberate mistakes: messages name file, line, key, what was expected and found, and a remedy.

The whole message is compared, so this table also lists the messages that users see.
"""

from pathlib import Path

import pytest

from hopdata.config.loading import key_lines, load_config, place_of
from hopdata.config.schema import hint
from hopdata.errors import ConfigError
from hopdata.landings.contacts import timing as contacts
from hopdata.scenes import SCENES

FILE = """\
study: trial
recordings:
  - name: one
    file: one.tsv
markers:
  body: [b1, b2, b3]
  feet: [heel, toe]
"""
SIMULATED = """\
study: trial
recordings:
  - name: one
markers:
  body: [body1, body2, body3]
  feet: [foot1, foot2, foot3]
"""
RECORDINGS = "recordings:\n  - name: one\n    file: one.tsv"
GRAVITIES = "expected one of 'learned', 'free', 'known'"
METHODS = f"expected one of {', '.join(map(repr, contacts.METHODS))}"
SCENE_NAMES = ", ".join(map(repr, SCENES))

# Mistake: the file's text, the line that the message names, and the rest of the
# message.
ADDED = {
    "verdict: a key misspelt": (
        "verdict: {margn: 0.1}",
        "8: verdict.margn: expected a known key, found 'margn'; did you mean 'margin'?",
    ),
    "verdict: a percentage": (
        "verdict:\n  confidence: 95",
        "9: verdict.confidence: expected a number at least 0.5 and at most 0.999, found 95; "
        "write 0.95 for 95 %",
    ),
    "verdict: a percent sign": (
        "verdict:\n  margin: 20 %",
        "9: verdict.margin: expected a number above 0.1 and at most 1, found '20 %'; "
        "write 0.2 for 20 %",
    ),
    "verdict: half a flip": (
        "verdict:\n  power: 0.9\n  flips: 1999.5",
        "10: verdict.flips: expected a whole number at least 99 and at most 1000000, found 1999.5",
    ),
    "verdict: a list": (
        "verdict:\n  - margin: 0.1",
        "8: verdict: expected keys with values, found 1 ({'margin': 0.1})",
    ),
    "steering: a key misspelt": (
        "steering: {recording: [one]}",
        "8: steering.recording: expected a known key, found 'recording'; "
        "did you mean 'recordings'?",
    ),
    "steering: no such recording, no boom": (
        "steering:\n  recordings: [onne]",
        "9: steering.recordings[0]: expected one of the recordings (one), found 'onne'; did you "
        "mean 'one'?\n"
        "study.yaml, line 9: steering.recordings: expected one marker on the boom (markers.boom), "
        "on whose angle the frame changes depend, found none",
    ),
    "steering: swings beyond the limit": (
        "steering:\n  excitation: {n_steps: 4}",
        "9: steering.excitation.n_steps: expected swings within steering.robot.swing_limit_rad "
        "(1.178 rad), found 4 steps of 0.3927 rad",
    ),
    "steering: nothing left to test with": (
        "steering:\n  excitation: {repeats: 1}\n  model: {training_hops: 112}",
        "10: steering.model.training_hops: expected at most 109 of the 112 hops of the excitation, "
        "so that some are left to test with, found 112",
    ),
    "steering: there from the start": (
        "steering:\n  experiments: {distance_m: 0.1}",
        "9: steering.experiments.distance_m: expected more than steering.experiments.arrived_m "
        "(0.11), found 0.1",
    ),
    "steering: way-points that one stance visits both": (
        "steering:\n  experiments: {waypoints_m: [[0, 0], [1, 0], [1, 0.2]]}",
        "9: steering.experiments.waypoints_m[2]: expected more than twice "
        "steering.experiments.arrived_m (0.22 m) from the point before, found 0.2 m",
    ),
    "steering: a leg too many": (
        "steering:\n  robot:\n    preload_shares: [1, 1, 1, 1]",
        "10: steering.robot.preload_shares: expected a list of 3 numbers, found 4 (1, 1, 1, 1)",
    ),
    "steering: degrees": (
        "steering:\n  robot:\n    swing_limit_rad: 67.5 deg",
        "10: steering.robot.swing_limit_rad: expected a number above 0 and at most 3.14159265359, "
        "found '67.5 deg'; write the number alone, in rad",
    ),
    "distances: too few": (
        "distances: {pairs: -1}",
        "8: distances.pairs: expected a whole number at least 2 and at most 1000000, found -1",
    ),
    "distances: misspelt": (
        "distance: {pairs: 30}",
        "8: distance: expected a known key, found 'distance'; did you mean 'distances'?",
    ),
    "floor: a word for a truth value": (
        "floor: {enabled: 'yes'}",
        "8: floor.enabled: expected true or false, found 'yes'",
    ),
    "touchdowns: a number for a choice": (
        "touchdowns: {gravity: 9.81}",
        f"8: touchdowns.gravity: {GRAVITIES}, found 9.81",
    ),
    "touchdowns: nearly a choice": (
        "touchdowns: {gravity: know}",
        f"8: touchdowns.gravity: {GRAVITIES}, found 'know'; did you mean 'known'?",
    ),
    "touchdowns: a capital": (
        "touchdowns: {method: Kink}",
        f"8: touchdowns.method: {METHODS}, found 'Kink'; did you mean 'kink'?",
    ),
    "touchdowns: yes for a choice": (
        "touchdowns: {method: yes}",
        f"8: touchdowns.method: {METHODS}, found true; "
        "yes, no, on and off are true and false unless they are in quotes",
    ),
    "touchdowns: milliseconds": (
        "touchdowns: {window_before_s: 60}",
        "8: touchdowns.window_before_s: expected a number above 0 and at most 1, or null, found 60",
    ),
    "touchdowns: a unit behind the number": (
        "touchdowns: {window_after_s: 60 ms}",
        "8: touchdowns.window_after_s: expected a number above 0 and at most 1, or null, "
        "found '60 ms'; write the number alone, in s",
    ),
    "a decimal comma": (
        "sections:\n  threshold_sigmas: 2,5",
        "9: sections.threshold_sigmas: expected a number above 0 and at most 20, found '2,5'; "
        "write 2.5, with a point",
    ),
    "a dot between section and key": (
        "sections.grid_nodes: 128",
        "8: sections.grid_nodes: expected a known key, found 'sections.grid_nodes'; "
        "write 'sections:' and, indented in the next line, 'grid_nodes:'",
    ),
    "a capital axis": (
        "input: {vertical_axis: Z}",
        "8: input.vertical_axis: expected one of 'auto', 'x', 'y', 'z', '-x', '-y', '-z', "
        "found 'Z'; did you mean 'z'?",
    ),
    "a format twice": (
        "figures: {formats: [png, png]}",
        "8: figures.formats: expected each entry once, found 2 (png, png)",
    ),
    "no strain at all": (
        "quality: {largest_body_strain: 0}",
        "8: quality.largest_body_strain: expected a number above 0 and at most 1, found 0",
    ),
}
SIMULATION = {
    "control: another name for it": (
        "simulation:\n  control: {kappa: 0.2}",
        "8: simulation.control.kappa: expected a known key, found 'kappa'; "
        "the keys here are coupling, impulse, delay_s",
    ),
    "control: out of range": (
        "simulation:\n  control: {coupling: 2}",
        "8: simulation.control.coupling: expected a number at least -1 and at most 1, found 2",
    ),
    "control: one level too high": (
        "simulation: {coupling: 0.2}",
        "7: simulation.coupling: expected a known key, found 'coupling'; "
        "did you mean 'simulation.control.coupling'?",
    ),
    "control: another unit": (
        "simulation:\n  control: {delay_ms: 10}",
        "8: simulation.control.delay_ms: expected a known key, found 'delay_ms'; "
        "did you mean 'delay_s'?",
    ),
    "scene: a name misspelt": (
        "simulation: {scene: hoper}",
        f"7: simulation.scene: expected one of {SCENE_NAMES}, or MODULE:CLASS, found "
        "'hoper'; "
        "did you mean 'hopper'?",
    ),
    "scene: the parameters of another": (
        "simulation:\n  quadruped: {mass_kg: 2}",
        "8: simulation.quadruped: expected a known key, found 'quadruped'; "
        "write 'scene: quadruped' to simulate it",
    ),
    "scene: a parameter misspelt": (
        "simulation:\n  scene: quadruped\n  quadruped: {mass: 2}",
        "9: simulation.quadruped.mass: expected a known key, found 'mass'; did you mean 'mass_kg'?",
    ),
    "scene: a parameter out of range": (
        "simulation:\n  scene: quadruped\n  quadruped: {mass_kg: 0}",
        "9: simulation.quadruped.mass_kg: expected a number above 0, found 0",
    ),
    "scene: a control that it does not know": (
        "simulation:\n  scene: quadruped\n  control: {impulse: 0.2}",
        "9: simulation.control.impulse: expected 0, since the scene quadruped knows coupling only, "
        "found 0.2",
    ),
    "scene: too weak": (
        "simulation:\n  scene: quadruped\n  quadruped: {preload_n: 12}",
        "9: simulation.quadruped: expected preload_n - stiffness_n_m release_extension_m > 6.62 N, "
        "the weight per leg, found 3.56 N: it cannot lift off",
    ),
    "integrator: a scene that resets states": (
        "simulation:\n  scene: quadruped\n  integrator: printed",
        "9: simulation.integrator: expected driver beside simulation.scene: quadruped, which "
        "resets states, as the printed method cannot, found printed",
    ),
    "integrator: a control that resets states": (
        "simulation:\n  control: {impulse: 0.1}\n  integrator: printed",
        "9: simulation.integrator: expected driver beside simulation.control.impulse, which "
        "resets states, as the printed method cannot, found printed",
    ),
    "scales: the smallest first": (
        "scaling_study: {scales: [0.1, 1.0]}",
        "7: scaling_study.scales: expected the largest first and each smaller than the one "
        "before, found 1 after 0.1",
    ),
}
REPLACED = {
    "recordings: no dash": (
        (RECORDINGS, "recordings:\n  name: one\n  file: one.tsv"),
        "2: recordings: expected a list of at least 1 entry, "
        "found keys with values (name, file); begin each entry with '- '",
    ),
    "recordings: a file alone": (
        (RECORDINGS, "recordings: one.tsv"),
        "2: recordings: expected a list of at least 1 entry, found 'one.tsv'; "
        "write each entry in a line of its own, such as '- name: ...'",
    ),
    "recordings: a number for a file": (
        ("file: one.tsv", "file: 12"),
        "4: recordings[0].file: expected text or a list, or null, found 12",
    ),
    "recordings: a second file that is not there": (
        ("file: one.tsv", "file: [one.tsv, two.tsv]"),
        "4: recordings[0].file[1]: expected a file, found no 'two.tsv'; did you mean 'one.tsv'?",
    ),
    "recordings: another key": (
        ("file: one.tsv", "path: one.tsv"),
        "4: recordings[0].path: expected a known key, found 'path'; "
        "the keys here are name, file, begins_s, block, exclude, simulation, contacts, forces",
    ),
    "recordings: a space in the name": (
        ("name: one", "name: day one"),
        "3: recordings[0].name: expected text (letters, digits, `_` and `-`, "
        "a letter or digit first, at most 100), found 'day one'",
    ),
    "recordings: the wrong file name": (
        ("file: one.tsv", "file: on.tsv"),
        "4: recordings[0].file: expected a file, found no 'on.tsv'; did you mean 'one.tsv'?",
    ),
    "feet without brackets": (
        ("[heel, toe]", "heel, toe"),
        "7: markers.feet: expected a list of 2 to 18 names, found 'heel, toe'; write [heel, toe]",
    ),
    "a role misspelt": (
        ("feet:", "foot:"),
        "7: markers.foot: expected a known key, found 'foot'; did you mean 'feet'?",
    ),
}
TABLE = {
    **{name: (f"{FILE}{added}\n", told) for name, (added, told) in ADDED.items()},
    **{
        name: (f"{SIMULATED}{added}\n", told)
        for name, (added, told) in SIMULATION.items()
    },
    **{
        name: (FILE.replace(*change), told) for name, (change, told) in REPLACED.items()
    },
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.tsv").write_text("not read here")
    return tmp_path


def told(text):
    Path("study.yaml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_config("study.yaml")
    return str(caught.value)


@pytest.mark.parametrize("mistake", TABLE)
def test_each_mistake_is_told_in_one_line(folder, mistake):
    text, expected = TABLE[mistake]
    assert told(text) == f"study.yaml, line {expected}"


@pytest.mark.parametrize("base", [FILE, SIMULATED])
def test_without_the_mistake_the_file_is_sound(folder, base):
    Path("study.yaml").write_text(base)
    assert load_config("study.yaml")["study"] == "trial"


def test_a_missing_key_has_no_line(folder):
    text = FILE.replace("study: trial\n", "")
    assert told(text) == "study.yaml: study: expected this key, found none"


def test_a_colon_without_its_space(folder):
    message = told("study:trial\n" + FILE.partition("\n")[2])
    assert message.startswith("study.yaml, line 2, column 11: expected YAML")
    assert message.endswith(
        "is there a space behind each colon, also in the line above?"
    )


def test_lines_of_keys_and_entries(folder):
    Path("study.yaml").write_text(FILE)
    lines = key_lines("study.yaml")
    assert lines["markers.feet"] == lines["markers.feet[1]"] == 7
    assert lines["recordings[0].file"] == 4
    assert key_lines("absent.yaml") == {}


def test_of_several_files_the_last_that_has_the_key_is_named(folder):
    Path("first.yaml").write_text(FILE + "seed: 1\n")
    Path("second.yaml").write_text("seed: -1\n")
    files = ["first.yaml", "second.yaml"]
    assert place_of("seed: expected 0", files, "?") == "second.yaml, line 1"
    assert place_of("study: expected text", files, "?") == "first.yaml, line 1"
    assert place_of("colour: expected", files, "?") == "?"


@pytest.mark.parametrize("value", [None, True, [1], {"a": 1}, "word", 3])
def test_hints_are_given_only_where_something_comes_to_mind(value):
    assert hint(value, {"type": "number"}) == ""
    assert ("in quotes" in hint(value, {"type": "string"})) == (value in (True, 3))
