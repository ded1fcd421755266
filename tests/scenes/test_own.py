"""A scene of the user's own: found where it is said, refused where a file says it alone."""

import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import hopdata as hd
from hopdata.__main__ import main
from hopdata.config.loading import load_config, what_is_set
from hopdata.errors import ArgumentError, ConfigError
from hopdata.foreign.working_folder import SAID, digests_of
from hopdata.provenance import own_code
from hopdata.scenes import own, scene_class
from hopdata.scenes.quadruped import Quadruped
from hopdata.scenes.scene import Control, Scene
from hopdata.synthesis.scaling import known_scene
from hopdata.synthesis.simulate import Simulation

MODULE = """
import my_numbers
from dataclasses import dataclass
from hopdata.scenes.quadruped import Quadruped
from hopdata.scenes.scene import Scene

@dataclass(frozen=True, kw_only=True)
class Stiff(Quadruped):
    "A stiffer one."
    side_stiffness_n_m: float = my_numbers.STIFF

class Part(Scene):
    pass

number = 3
print("its code runs")
"""
CONFIG = """\
study: own
recordings: [{name: simulated}]
markers: {body: [body1, body2, body3], feet: [foot1, foot2, foot3, foot4]}
simulation:
  hops: 3
  scene: odd_lab:Stiff
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(SAID, "")
    Path("odd_lab.py").write_text(MODULE)
    Path("my_numbers.py").write_text("STIFF = 90.0\n")
    Path("own.yaml").write_text(CONFIG)
    before = {*sys.modules}
    yield tmp_path
    for name in {*sys.modules} - before:
        if name in ("odd_lab", "my_numbers"):
            del sys.modules[name]
    own._HANDED_OVER.clear()


def test_a_name_in_a_file_alone_runs_no_code(capsys):
    assert main(["check", "own.yaml"]) == 1
    said = capsys.readouterr()
    assert "its code runs" not in said.out
    assert said.err == (
        "hopdata: error: own.yaml, line 6: simulation.scene: expected --scene "
        "odd_lab:Stiff in the command, or the variable HOPDATA_SCENE=odd_lab:Stiff, "
        "found its name in a file alone, which may not run code\n"
    )
    with pytest.raises(ConfigError, match="HOPDATA_SCENE"):
        hd.study("own.yaml")
    os.environ[SAID] = "odd_lab:Other"
    with pytest.raises(ConfigError, match="HOPDATA_SCENE"):
        scene_class("odd_lab:Stiff")


def test_a_scene_that_the_command_names_is_checked(capsys):
    assert main(["check", "own.yaml", "--scene", "odd_lab:Stiff"]) == 0
    assert "is sound" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["check", "run", "plan", "contacts"])
def test_each_command_that_reads_a_configuration_takes_the_scene(
    command, capsys, monkeypatch
):
    reached = []
    for module in ("run", "plan"):
        place = f"hopdata.commands.{module}.run_workflow"
        monkeypatch.setattr(place, lambda *given, **_: reached.append(given) or 1)
    expected = "found its name in a file alone"
    assert main([command, "own.yaml"]) == 1
    assert expected in capsys.readouterr().err
    assert not reached
    main([command, "own.yaml", "--scene", "odd_lab:Stiff"])
    assert expected not in capsys.readouterr().err
    assert os.environ[SAID] == "odd_lab:Stiff"  # which the jobs inherit
    assert bool(reached) == (command in ("run", "plan"))


def test_what_a_finished_study_set_is_known_without_its_scene():
    os.environ[SAID] = "odd_lab:Stiff"
    config = load_config("own.yaml")
    with_it = what_is_set(config)
    assert with_it["simulation"] == {"hops": 3, "scene": "odd_lab:Stiff"}
    os.environ[SAID] = ""
    del sys.modules["odd_lab"], sys.modules["my_numbers"]
    without = what_is_set(config)
    assert without["simulation"].pop("odd_lab:Stiff")["side_stiffness_n_m"] == 90.0
    assert without == with_it
    assert "odd_lab" not in sys.modules
    with pytest.raises(ConfigError, match="HOPDATA_SCENE"):
        load_config("own.yaml")


def test_a_scene_by_name_and_as_an_object_give_the_same():
    options = {"simulation": {"hops": 2}, "seed": 3}
    named, truth = hd.synthesize("odd_lab:Stiff", **options)
    kind = sys.modules["odd_lab"].Stiff
    given, _ = hd.synthesize(kind(), **options)
    np.testing.assert_array_equal(named.positions, given.positions)
    heavy, of_heavy = hd.synthesize(kind(mass_kg=2.8), **options)
    assert (heavy.positions[:99] != given.positions[:99]).any()
    assert known_scene(truth).scene == kind()
    assert known_scene(of_heavy).scene == kind(mass_kg=2.8)
    # A bundled scene keeps its name.
    _, plain = hd.synthesize(Quadruped(), **options)
    assert json.loads(plain.parameters_json)["simulation"]["scene"] == "quadruped"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("odd_lab:Stif", "found no 'Stif' in odd_lab; it has Stiff, Part"),
        ("odd_lab:number", "found odd_lab:number, which is none"),
        ("odd_lab:Part", "expected a scene that defines rest_feet, system, vector"),
        ("no_lab:Stiff", "expected no_lab.py in .*, found neither"),
        ("bad_lab:Stiff", "found ZeroDivisionError: .*, in bad_lab.py, line 2$"),
    ],
)
def test_what_is_wrong_with_a_scene_is_said(name, message):
    Path("bad_lab.py").write_text("\n1 / 0\n")
    with pytest.raises(ConfigError, match=message):
        hd.synthesize(name)


def test_what_is_no_scene_is_refused_without_its_content():
    @dataclass
    class Wide:
        text: str = "many words"

    with pytest.raises(ArgumentError, match=r"found one of type Wide$"):
        hd.synthesize(Wide())
    with pytest.raises(ArgumentError, match=r"found a class; write Quadruped\(\)$"):
        hd.synthesize(Quadruped)


def test_functions_that_the_exact_maps_cannot_call_are_told():
    from hopdata.hybrid import System

    def stay(_t, y):
        return y

    @dataclass(frozen=True, kw_only=True)
    class Plain(Quadruped):
        def system(self, _variant=None):
            return System(stay, n_states=20)

    with pytest.raises(ConfigError, match="expected @field with all of its"):
        hd.synthesize(Plain())


def test_the_digests_are_those_of_all_its_files():
    found = digests_of("odd_lab")
    assert [*found] == ["my_numbers.py", "odd_lab.py"]
    Path("my_numbers.py").write_text("STIFF = 91.0\n")
    changed = digests_of("odd_lab")
    assert changed["my_numbers.py"] != found["my_numbers.py"]
    assert changed["odd_lab.py"] == found["odd_lab.py"]
    config = {"recordings": [{"name": "a", "file": None}]}
    config["simulation"] = {"scene": "odd_lab:Stiff"}
    assert own_code(config) == changed
    config["simulation"] = {"scene": "quadruped"}
    assert own_code(config) == {}


class Uncontrolled(Quadruped):
    """A scene that offers no control."""

    controls = ()


def test_what_a_scene_offers_of_controls_is_told():
    coupled = Control(coupling=0.3)
    Simulation(name="odd", scene=Quadruped(), control=coupled)
    with pytest.raises(ConfigError, match="knows none of them, found"):
        Simulation(name="odd", scene=Uncontrolled(), control=coupled)
    with pytest.raises(ConfigError, match="knows coupling only, found"):
        Simulation(name="odd", scene=Quadruped(), control=Control(impulse=2.0))


@dataclass(frozen=True, kw_only=True)
class Weak(Quadruped):
    """A quadruped too weak to lift off by the law of springs."""

    preload_n: float = 12.0


@dataclass(frozen=True, kw_only=True)
class Hydraulic(Weak):
    """The same, with legs of another law."""

    def require_take_off(self, key):
        pass


class NoSprings(Scene):
    """A scene whose legs have neither stiffness nor release."""

    mass_kg, preload_n, gravity_m_s2 = 1.0, 0.1, 9.81
    rest_feet = system = vector = None


def test_legs_that_are_no_springs_are_not_refused():
    with pytest.raises(ConfigError, match="override require_take_off"):
        Weak().require_take_off("simulation.x")
    with pytest.raises(ConfigError) as builtin:
        Quadruped(preload_n=12.0).require_take_off("simulation.quadruped")
    assert str(builtin.value).endswith("it cannot lift off")
    Hydraulic().require_take_off("simulation.x")
    NoSprings().require_take_off("simulation.x")
