"""Mistakes in the blocks `contacts` and `forces` of a recording."""

import copy
import shutil
from pathlib import Path

import pytest

import hopdata
from hopdata.config.consistency import (
    expected_noise_m,
    feet_of,
    knows_truth,
    nearest_file,
)
from hopdata.config.loading import load_config
from hopdata.errors import ConfigError
from hopdata.recordings.importing import import_recording
from hopdata.recordings.readers.hdf5 import write_recording

SOUND = {
    "study": "plate",
    "recordings": [
        {
            "name": "one",
            "file": "one.tsv",
            "contacts": {"file": "switches.csv"},
            "forces": {
                "file": "plate.txt",
                "rate_hz": 1000,
                "columns": [{"name": "Fz", "feet": ["heel", "toe"]}, {"name": "heel"}],
            },
        }
    ],
    "markers": {"body": ["b1", "b2", "b3"], "feet": ["heel", "toe"]},
}


def edited(block, **given):
    config = copy.deepcopy(SOUND)
    config["recordings"][0][block].update(given)
    return config


def joined(*feet, markers=("heel", "toe", "other")):
    config = copy.deepcopy(SOUND)
    config["markers"]["feet"] = list(markers)
    config["recordings"][0] = {"name": "one", "file": "one.tsv"}
    config["feet"] = [{"name": name, "markers": list(of)} for name, of in feet]
    return config


def test_feet_of_several_markers_are_named_in_the_order_of_the_first():
    config = joined(("left", ("toe", "heel")), markers=("other", "heel", "toe"))
    assert feet_of(load_config(config, check_files=False)) == ["other", "left"]
    config["recordings"][0]["contacts"] = {
        "file": "a.csv",
        "columns": [{"name": "left"}],
    }
    load_config(config, check_files=False)
    config["recordings"][0]["contacts"]["columns"] = [{"name": "heel"}]
    with pytest.raises(
        ConfigError, match=r"expected feet of markers.feet \(other, left\)"
    ):
        load_config(config, check_files=False)


@pytest.mark.parametrize(
    ("feet", "said"),
    [
        (
            [("left", ("heel", "tow"))],
            r"feet\[0\].markers: .*found 'tow'; did you mean 'toe'",
        ),
        (
            [("a", ("heel", "toe")), ("b", ("toe", "other"))],
            r"feet\[1\].markers\[0\]: .*'toe' in feet\[0\]",
        ),
        (
            [("other", ("heel", "toe"))],
            r"feet\[0\].name: expected a name of its own, found 'other'",
        ),
        ([("all", ("heel", "toe", "other"))], "expected 2 to 6 feet, found 1"),
    ],
)
def test_feet_that_do_not_fit_their_markers(feet, said):
    with pytest.raises(ConfigError, match=said):
        load_config(joined(*feet), check_files=False)


def test_seven_feet_and_simulated_ones_are_refused():
    seven = [f"f{k}" for k in range(7)]
    with pytest.raises(ConfigError, match="expected 2 to 6 feet, found 7"):
        load_config(joined(markers=seven), check_files=False)
    config = joined(("left", ("foot1", "foot2")), markers=("foot1", "foot2", "foot3"))
    config["recordings"][0] = {"name": "one"}
    config["markers"]["body"] = ["body1", "body2", "body3"]
    with pytest.raises(
        ConfigError, match="feet: expected none beside the simulated recording one"
    ):
        load_config(config, check_files=False)


def test_defaults_are_filled_in():
    config = load_config(SOUND, check_files=False)
    (recording,) = config["recordings"]
    assert recording["contacts"]["unit"] == "s"
    assert recording["contacts"]["columns"] == []
    assert recording["forces"]["threshold_share"] == 0.05
    assert recording["forces"]["columns"][1] == {"name": "heel", "feet": []}
    assert config["external"] == {"window_s": 0.05}
    assert load_config(config, check_files=False) == config


def test_a_recording_has_neither_by_default():
    config = copy.deepcopy(SOUND)
    config["recordings"] = [{"name": "one", "file": "one.tsv"}]
    (recording,) = load_config(config, check_files=False)["recordings"]
    assert recording["contacts"]["file"] is None
    assert recording["forces"]["file"] is None


def excluding(**span):
    config = copy.deepcopy(SOUND)
    config["recordings"][0]["exclude"] = [
        {"from_s": 2.0, "to_s": 3.0, "reason": "fell"} | span
    ]
    return config


def test_spans_that_are_left_out():
    assert (
        load_config(excluding(), check_files=False)["recordings"][0]["exclude"][0][
            "to_s"
        ]
        == 3.0
    )
    whole = copy.deepcopy(SOUND)
    whole["recordings"][0]["exclude"] = [
        {"reason": "belt"},
        {"reason": "fell", "landings": [3]},
    ]
    first, second = load_config(whole, check_files=False)["recordings"][0]["exclude"]
    assert first == {
        "from_s": None,
        "to_s": None,
        "landings": [],
        "markers": [],
        "reason": "belt",
    }
    assert second["landings"] == [3]


def in_blocks(*labels):
    config = copy.deepcopy(SOUND)
    first = config["recordings"][0]
    config["recordings"] = [
        {**first, "name": f"trial{i}", "file": f"{i}.tsv", "block": label}
        for i, label in enumerate(labels)
    ]
    return config


def test_all_recordings_may_have_blocks():
    loaded = load_config(in_blocks("sand", "mat", "sand"), check_files=False)
    assert [one["block"] for one in loaded["recordings"]] == ["sand", "mat", "sand"]
    loaded = load_config(in_blocks(None, None), check_files=False)
    assert [one["begins_s"] for one in loaded["recordings"]] == [None, None]


MISTAKES = {
    "a recording without a block": (
        in_blocks("sand", None),
        ["recordings[1].block", "a label, as others have one", "found null"],
    ),
    "empty span": (
        excluding(to_s=2.0),
        ["recordings[0].exclude[0].to_s", "more than from_s (2 s)", "found 2 s"],
    ),
    "a landing in a span": (
        excluding(landings=[2]),
        [
            "recordings[0].exclude[0].landings",
            "no other choice beside them, found from_s",
        ],
    ),
    "an unseen marker unknown": (
        excluding(markers=["hel"]),
        ["recordings[0].exclude[0].markers", "found 'hel'", "did you mean 'heel'"],
    ),
    "span without a reason": (
        excluding(reason=""),
        ["recordings[0].exclude[0].reason"],
    ),
    "foot unknown": (
        edited("forces", columns=[{"name": "Fz", "feet": ["hel"]}]),
        [
            "recordings[0].forces.columns[0].feet",
            "(heel, toe)",
            "'hel'",
            "did you mean 'heel'",
        ],
    ),
    "column is no foot": (
        edited("contacts", columns=[{"name": "switch"}]),
        ["recordings[0].contacts.columns[0].feet", "found 'switch'"],
    ),
    "column twice": (
        edited("forces", columns=[{"name": "Fz", "feet": ["heel"]}] * 2),
        [
            "recordings[0].forces.columns[1].name",
            "found 'Fz' in recordings[0].forces.col",
        ],
    ),
    "columns without a file": (
        edited("forces", file=None),
        ["recordings[0].forces.file", "beside the columns, found null"],
    ),
    "labels without times": (
        edited("contacts", label_column="foot"),
        ["recordings[0].contacts.time_column", "beside label_column"],
    ),
    "newtons of body weights": (
        edited("forces", unit="body_weight", threshold_n=20),
        ["recordings[0].forces.threshold_n", "threshold_share", "found 20 N"],
    ),
    "unit": (
        edited("forces", unit="lbf"),
        ["recordings[0].forces.unit", "'kN'", "found 'lbf'"],
    ),
    "rate": (
        edited("forces", rate_hz=0),
        ["recordings[0].forces.rate_hz", "above 0", "found 0"],
    ),
    "misspelt": (
        edited("forces", treshold_n=20),
        ["recordings[0].forces.treshold_n", "did you mean 'threshold_n'"],
    ),
    "no column name": (
        edited("forces", columns=[{"feet": ["heel"]}]),
        ["recordings[0].forces.columns[0].name: expected this key"],
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told(mistake):
    config, parts = MISTAKES[mistake]
    with pytest.raises(ConfigError) as caught:
        load_config(config, check_files=False)
    assert str(caught.value).count("\n") == 0
    for part in ("expected", "found", *parts):
        assert part in str(caught.value)


def test_missing_files_are_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("one.tsv", "switches.csv", "plates.txt"):
        (tmp_path / name).touch()
    with pytest.raises(
        ConfigError, match=r"recordings\[0\].forces.file: .*mean 'plates.txt'"
    ):
        load_config(SOUND)


def test_a_file_or_a_configuration_that_is_nearby_is_named(tmp_path, monkeypatch):
    inner = tmp_path / "study" / "config"
    inner.mkdir(parents=True)
    (inner.parent / "one.tsv").touch()
    (inner / "one.yaml").touch()
    for place in (inner, tmp_path):
        monkeypatch.chdir(place)
        told = nearest_file(Path("one.tsv"))
        assert told.startswith(f"; it is in {inner.parent}: ")
    monkeypatch.chdir(inner)
    assert nearest_file(Path("two.tsv")) == f" in {inner}"
    assert nearest_file(Path("ones.yaml")) == "; did you mean 'one.yaml'?"


FEET, BODY = ["foot1", "foot2", "foot3"], ["body1", "body2", "body3"]


def of_files(*files, markers=None, axis="z"):
    """Return the part of a configuration that decides whether a truth is known."""
    entries = [{"name": f"one{i}", "file": file} for i, file in enumerate(files)]
    return {
        "recordings": entries,
        "markers": markers or {"body": BODY, "feet": FEET},
        "input": {"vertical_axis": axis},
    }


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Return files of one recording: with its truth, without it, and under another suffix."""
    folder = tmp_path_factory.mktemp("stored")
    recording, truth = hopdata.synthesize(simulation={"hops": 2})
    write_recording(folder / "with.h5", recording, truth)
    write_recording(folder / "without.h5", recording)
    (folder / "damaged.h5").write_bytes((folder / "with.h5").read_bytes()[:2_000])
    shutil.copy(folder / "with.h5", folder / "WITH.HDF5")
    return folder


def test_a_truth_is_known_by_what_a_file_holds(stored):
    with_truth, without = (str(stored / name) for name in ("with.h5", "without.h5"))
    assert knows_truth(of_files(with_truth))
    assert knows_truth(of_files(str(stored / "WITH.HDF5")))
    assert knows_truth(of_files(without, with_truth))
    assert knows_truth(of_files(None))  # simulated
    assert knows_truth(of_files(with_truth, axis="auto"))
    for nothing in (without, "a.csv", "missing.h5", str(stored / "damaged.h5")):
        assert not knows_truth(of_files(nothing))


def test_a_truth_that_importing_drops_is_not_known(stored):
    """Of joined files, of another choice of markers, of axes that are turned."""
    file = str(stored / "with.h5")
    fewer = {"body": BODY, "feet": FEET[:2]}
    for config in (
        of_files([file, file]),
        of_files(file, markers=fewer),
        of_files(file, axis="y"),
    ):
        assert not knows_truth(config)
    for markers, axis in ((fewer, "z"), ({"body": BODY, "feet": FEET}, "y")):
        options = {"name": "one", "markers": markers, "vertical_axis": axis}
        assert import_recording(file, **options)[1] is None
    again = {"body": BODY[::-1], "feet": FEET[::-1]}
    assert knows_truth(of_files(file, markers=again))
    assert import_recording(file, name="one", markers=again)[1] is not None


def test_the_noise_of_a_distance_is_compared_as_that_of_a_coordinate():
    simulated = {
        "study": "trial",
        "recordings": [{"name": "one"}],
        "markers": {"body": ["body1", "body2", "body3"], "feet": ["foot1", "foot2"]},
    }
    each = load_config(simulated)
    assert expected_noise_m(each) == each["motion_capture"]["noise_m"] == 0.0006
    apart = load_config({**simulated, "motion_capture": {"noise_of": "distance"}})
    assert expected_noise_m(apart) == pytest.approx(0.0006 / 2**0.5)
