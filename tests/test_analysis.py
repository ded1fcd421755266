"""A study in one process; `tests/workflow` tests that its bytes are those of the workflow."""

import inspect
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pandas as pd
import pytest
from made_up_hopper import MARKERS, hopping
from written_files import write_c3d

import hopdata as hd
from hopdata.config.consistency import feet_of
from hopdata.errors import ArgumentError, absent
from hopdata.figures.style import save_figure
from hopdata.landings.contacts.timing import METHODS
from hopdata.maps import subspaces
from hopdata.maps.verdict.model import LEFT
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.readers.hdf5 import read_recording, write_recording
from hopdata.stages import LINE
from plain_columns import shadowed

FEET, BODY = ["foot1", "foot2", "foot3"], ["body1", "body2", "body3"]


@pytest.fixture(scope="module")
def study(sample_path):
    """Return two minutes of the sample, from arrays, with names that no simulation gives."""
    whole = read_recording(sample_path).part(slice(12_000))
    markers = [f"my {name}" for name in whole.markers]
    roles = {
        "feet": [f"my {name}" for name in FEET],
        "body": [f"my {name}" for name in BODY],
    }
    recording = hd.Recording.from_arrays(
        whole.time, whole.positions, markers, **roles, name="monday"
    )
    told = []
    return hd.analyse(recording, progress=told.append), told


@pytest.fixture(scope="module")
def short_study(sample_path):
    """Return a study of 40 s of the sample."""
    return hd.study(read_recording(sample_path).part(slice(4_000)))


#: From a flea to an elephant; each is a study.
ANIMALS = [1 / 256, 0.01, 1.3, 4.0] if "ALL" in os.environ else [1 / 256]


@pytest.mark.parametrize("size", ANIMALS)
def test_what_is_found_does_not_depend_on_the_size_of_the_animal(short_study, size):
    one, seen = short_study, short_study.imported[0]
    root = np.sqrt(size)
    copy = {"time": root * seen.time, "positions": size * seen.positions}
    copy = replace(seen, **copy, rate_hz=seen.rate_hz / root)
    assert copy.scale == pytest.approx(size * seen.scale, rel=1e-12)
    assert 0.5 < seen.scale < 2
    other = hd.study(copy)
    np.testing.assert_allclose(
        other.floors["hopper"].moved_m, one.floors["hopper"].moved_m
    )
    table, same = other.touchdowns, one.touchdowns
    assert (~same["excluded"]).sum() > 30
    for name in table:
        if name.endswith("_s"):
            np.testing.assert_allclose(
                table[name] / root, same[name], atol=2e-7
            )  # rounded
        elif name.endswith("probability"):
            np.testing.assert_allclose(table[name], same[name], atol=1e-3)
        else:
            assert table[name].equals(same[name]), name
    places = one.pairs.x.shape[1] // 2
    for found, expected in ((other.pairs.x, one.pairs.x), (other.pairs.y, one.pairs.y)):
        np.testing.assert_allclose(
            found[:, :places] / size, expected[:, :places], atol=1e-5
        )
        np.testing.assert_allclose(
            found[:, places:] / root, expected[:, places:], atol=1e-5
        )


def test_stages_are_told_in_their_order(study):
    assert study[1][:4] == [
        "import_recording monday",
        "floor_compensation monday",
        "foot_contacts",
        "poincare_sections",
    ]
    assert study[1].index("home_frame") < study[1].index("verdict")
    names = {one.split()[0] for one in study[1]} - {"page"}
    assert names <= {*LINE.stages}


def test_what_a_notebook_looks_at(study):
    study = study[0]
    assert study.verdict.sentence in repr(study)
    assert "<svg" in study._repr_html_()
    used = study.touchdowns[~study.touchdowns["excluded"]]
    assert len(used) == len(study.pairs) > 150
    assert set(study.quality["status"]) <= {"good", "look", "poor", "not asked"}
    assert study.figures.schedule().axes
    assert "verdict" in dir(study.figures)
    recording = study.recordings[0]
    for one in (
        study,
        study.figures,
        study.verdict,
        study.verdict.effect,
        study.pairs,
        recording,
    ):
        name = next(name for name in dir(one) if not name.startswith("_"))
        with pytest.raises(hd.HopdataError, match=f"did you mean '{name}'") as told:
            _ = getattr(one, f"{name}s")
        assert isinstance(told.value, AttributeError)
        assert len(repr(one)) < 200
        assert not hasattr(one, "_repr_latex_")
    with pytest.raises(
        AttributeError, match=r"has no attribute 'xyz'; it has verdict, plan$"
    ):
        raise absent("it", "xyz", ["verdict", "_hidden", "plan"])
    assert study.tables["drift"].columns[0]


def test_no_column_of_a_table_shadows_an_attribute(study):
    study = study[0]
    tables = {**study.tables, "quality": study.quality}
    tables["schedules"] = study.mode_schedules().schedules
    for name, by_recording in [*tables.items()]:
        if isinstance(by_recording, dict):
            tables |= {f"{name} {key}": one for key, one in by_recording.items()}
            del tables[name]
    tables |= study.contacts
    tables["plan"] = hd.plan(study)
    tables["long"] = study.imported[0].to_pandas("long")
    inspected = hd.inspect(study.imported[0])
    tables |= {"inspected": inspected.table, "suspects": inspected.suspects}
    found = hd.contacts(study.imported[0].between(0, 5))
    tables |= {"contacts": found.table, "orders": found.orders}
    tables["curves"] = found.curves(found.orders)
    assert len(tables) > 20
    assert {
        name: shadowed(table) for name, table in tables.items() if shadowed(table)
    } == {}
    assert shadowed(pd.DataFrame({"mean": [1], "class": [1], "mean_mm": [1]})) == [
        "mean",
        "class",
    ]


def test_all_is_saved_where_no_noise_is_expected(study, tmp_path):
    study = study[0]
    study.save(tmp_path)
    checks = json.loads((tmp_path / "quality.json").read_text())
    assert any(check["value"] is None for check in checks)
    drawn = (tmp_path / "figures" / "verdict.svg").read_text()

    loaded = hd.load(tmp_path)
    assert loaded.verdict == study.verdict
    assert repr(loaded).endswith(f"'monday': {study.verdict.sentence}>")
    assert [*loaded.tables] == [*study.tables]
    for name, table in study.tables.items():
        pd.testing.assert_frame_equal(loaded.tables[name], table, check_exact=True)
    np.testing.assert_array_equal(loaded.pairs.x, study.pairs.x)
    np.testing.assert_array_equal(loaded.quality["value"], study.quality["value"])
    assert loaded.sections == study.sections
    save_figure(loaded.plot(), tmp_path / "again", formats=["svg"])
    assert (tmp_path / "again.svg").read_text() == drawn
    assert loaded.methods() == study.methods()
    found = loaded.foot_contacts().contacts["monday"]
    pd.testing.assert_frame_equal(found, study.contacts["monday"], check_exact=True)
    level = loaded.floor_compensation()["monday"].level
    np.testing.assert_array_equal(level.positions, study.recordings[0].positions)
    (tmp_path / "level" / "monday.h5").unlink()
    loaded = replace(loaded)
    for wrong, told in (
        (lambda: loaded.recordings, "level/monday.h5.*, found none"),
        (lambda: loaded.plot("verdit"), "did you mean 'verdict'"),
        (lambda: hd.load(tmp_path / "verdict.json"), "folder: expected the folder of"),
        (lambda: hd.load(tmp_path.parent), f"no provenance.*: {tmp_path.name}"),
    ):
        with pytest.raises(hd.HopdataError, match=told):
            wrong()


def test_a_folder_that_is_not_whole_or_of_another_version_is_told(study, tmp_path):
    saved = study[0].save(tmp_path / "version 1.2")  # no file, for all its dot
    touchdowns = saved / "tables" / "touchdowns.csv"
    table = touchdowns.read_text()
    touchdowns.write_text(table.replace("touchdown,", "index,", 1))
    with pytest.raises(hd.HopdataError, match=r"columns as .*found index, as before"):
        _ = hd.load(saved).touchdowns
    touchdowns.write_text(table)
    assert hd.load(saved).touchdowns["touchdown"].min() == 1
    from_0 = pd.read_csv(touchdowns)
    from_0["touchdown"] -= 1
    from_0.to_csv(touchdowns, index=False)
    with pytest.raises(hd.HopdataError, match=r"count from 1, found one that is 0"):
        _ = hd.load(saved).touchdowns
    touchdowns.unlink()
    with pytest.raises(hd.HopdataError, match=r"found none named tables/touchdowns.cs"):
        hd.load(saved)
    provenance = json.loads((saved / "provenance.json").read_text())
    provenance["versions"]["hopdata"] = "0.0.9"
    (saved / "provenance.json").write_text(json.dumps(provenance))
    with pytest.raises(hd.HopdataError, match=r"hopdata 0\.1\.0, found one of 0\.0\.9"):
        hd.load(saved)
    del provenance["config"]
    (saved / "provenance.json").write_text(json.dumps(provenance))
    with pytest.raises(hd.HopdataError, match="the versions and the configuration"):
        hd.load(saved)
    (saved / "provenance.json").unlink()
    with pytest.raises(hd.HopdataError, match="its run has not ended"):
        hd.load(saved)


def test_no_name_of_a_figure_computes_anything(short_study):
    figures = hd.study(short_study.imported[0]).figures
    assert figures.verdict.__doc__.startswith("Draw the verdict")
    assert "<td>Draw the verdict" in figures._repr_html_()
    assert not figures._study._returned
    with pytest.raises(hd.HopdataError, match="the arguments ax, style"):
        figures.verdict(axes=3)


def test_the_name_of_a_file_is_no_folder(study, tmp_path):
    for name in ("results.h5", "results.CSV", "page.html"):
        with pytest.raises(
            ArgumentError, match="folder: expected the name of a folder, found"
        ):
            study[0].save(tmp_path / name)
    (tmp_path / "written").write_text("before")
    with pytest.raises(
        ArgumentError, match="folder: expected the name of a folder, found"
    ):
        study[0].save(tmp_path / "written")
    assert [path.name for path in tmp_path.iterdir()] == ["written"]


def test_a_file_with_its_roles_gives_the_recording_s_numbers(study, sample_path):
    read = hd.read(sample_path, feet=FEET, body=BODY, name="monday")
    again = hd.analyse(read.part(slice(12_000)))
    assert again.verdict == study[0].verdict


def test_nothing_is_imported_before_it_is_used():
    code = (
        "import sys, hopdata; assert {'analyse', 'solve'} <= set(dir(hopdata)); "
        "assert not {'numpy', 'pandas', 'numba'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
    with pytest.raises(
        AttributeError, match="no attribute 'analyze'; did you mean 'analyse'"
    ):
        _ = hd.analyze


ARRAYS = {
    "time": np.arange(5) / 100,
    "positions": np.zeros((5, 2, 3)),
    "markers": ["toe", "hip"],
}


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (
            {"time": [0.0, 0.1, 0.1, 0.2, 0.3]},
            "each later than the one before by at most 0.5 s",
        ),
        ({"time": 10 * np.arange(5)}, "found shape (5,), [ 0. 10.] at frame 1"),
        ({"time": [0, 1e-3, np.nan, 3e-3, 4e-3]}, "[0.001   nan] at frame 2"),
        ({"positions": np.zeros((5, 3, 2))}, "positions: expected shape (5, 2, 3)"),
        ({"markers": ["toe"]}, "positions: expected shape (5, 1, 3)"),
        (
            {"markers": ["toe", "toe"]},
            "markers: expected each name once, found toe, toe",
        ),
        (
            {"positions": [[1], [1, 2]]},
            "positions: expected an array of numbers, found setting",
        ),
        (
            {"time": ["noon"]},
            "time: expected an array of numbers, found could not convert",
        ),
        ({"body": 3}, "body: expected a list of marker names, found 3"),
        (
            {"feet": ["to"]},
            "feet: expected one of toe, hip, found 'to'; did you mean 'toe'",
        ),
    ],
)
def test_wrong_arrays_are_told_by_name(changed, told):
    given = {**ARRAYS, "feet": ["toe"], "body": ["hip"], **changed}
    with pytest.raises(hd.HopdataError, match=re.escape(told)):
        hd.Recording.from_arrays(**given)


def test_recordings_in_a_list_are_one_study(sample_path):
    whole = hd.read(sample_path, feet=FEET, body=BODY)
    monday = replace(
        whole.part(slice(4000)), name="monday", source="", source_sha256=""
    )
    friday = replace(monday, name="friday", positions=whole.positions[4000:8000])
    both = hd.study([monday, friday], study="week")
    counts = both.touchdowns.groupby("recording").size()
    alone = [len(hd.study(one).contacts[one.name]) for one in (monday, friday)]
    assert counts[["monday", "friday"]].tolist() == alone
    other = replace(friday, roles=("other", *friday.roles[1:]))
    for wrong, told in (
        ([monday, other], "source: expected the same markers in the same order"),
        ([monday, sample_path], "source: expected a file, .*, found list"),
        ([monday, monday], "recordings"),
        ([], "source: expected a file, .*, found list"),
    ):
        with pytest.raises(hd.HopdataError, match=told):
            hd.study(wrong)


def test_millimetres_for_metres_and_a_text_for_a_list_are_told(sample_path):
    whole = hd.read(sample_path, feet=FEET, body=BODY).part(slice(3000))
    roles = {"feet": FEET, "body": BODY}
    large = hd.Recording.from_arrays(
        whole.time, 1e3 * whole.positions, whole.markers, **roles
    )
    with pytest.raises(
        hd.HopdataError, match=r"scale.*multiply the positions by 0.001"
    ):
        hd.analyse(large)
    lying = hd.Recording.from_arrays(
        whole.time, whole.positions[:, :, [0, 2, 1]], whole.markers, **roles
    )
    with pytest.raises(
        hd.HopdataError, match=r"vertical axis.*z up: reorder yours to match"
    ):
        hd.analyse(lying)
    for wrong, told in (
        ({"feet": FEET}, "feet, body: expected names of markers of .*boom.*body=.."),
        (
            {"body": BODY, "feet": ["foot9", "foot1"]},
            "expected a marker of the file.*'foot9'",
        ),
        ({**roles, "input": {"rate": 3}}, "input.rate"),
        (
            {"body": BODY, "foot": FEET},
            "analyse: expected one of its .* arguments, found 'foot'",
        ),
    ):
        with pytest.raises(hd.HopdataError, match=told):
            hd.analyse(sample_path, **wrong)
    with pytest.raises(
        hd.HopdataError, match=r"hd\.read or hd\.Recording\.from_arrays"
    ):
        hd.analyse(whole.positions)
    with pytest.raises(hd.HopdataError, match="feet: expected a list of marker names"):
        hd.analyse(sample_path, feet="foot1", body=BODY)


def c3d_of(folder, positions, markers=MARKERS):
    """Write a file that states no roles."""
    path = folder / "hops.c3d"
    time = np.arange(len(positions)) / 100
    write_c3d(path, RawRecording(tuple(markers), time, 1e3 * positions, 100.0, "mm"))
    return path


def test_roles_are_those_of_the_file_and_otherwise_guessed(tmp_path):
    whole = hd.Recording.from_arrays(
        *(*hopping(5, n_frames=800), MARKERS), feet=MARKERS[3:6], body=MARKERS[:3]
    )
    stated = tmp_path / "stated.h5"
    write_recording(stated, whole)
    read = hd.read(stated)
    assert (read.names("foot"), read.names("body")) == (MARKERS[3:6], MARKERS[:3])

    guessed = c3d_of(tmp_path, hopping(5, n_frames=800)[1])
    bare = hd.read(guessed)
    assert bare.markers == MARKERS
    assert {*bare.roles} == {"other"}
    read = hd.guess(bare)
    assert {*read.names("foot")} == {*MARKERS[3:6]}
    assert {*read.names("body")} == {*MARKERS[:3]}
    assert "feet guessed: toe1, toe2, toe3; rest near the floor" in read.remarks[-2]
    np.testing.assert_array_equal(read["toe1"], bare["toe1"])
    alone = hd.contacts(bare)
    assert len(alone.found) > 9
    assert alone.messages[0].code == "landings.role_guessed"
    pd.testing.assert_frame_equal(alone.table, hd.contacts(guessed).table)
    by_hand = bare.with_roles(feet=MARKERS[3:6], body=MARKERS[:3])
    pd.testing.assert_frame_equal(alone.table, hd.contacts(by_hand).table)
    told = []
    prepared = hd.study(guessed, progress=told.append)
    assert {*prepared.config["markers"]["feet"]} == {*MARKERS[3:6]}
    assert any("markers.feet: toe1" in line for line in told)
    of_arrays = hd.study(bare, progress=told.append)
    for key in ("markers", "sections", "feet"):
        assert of_arrays.config[key] == prepared.config[key]
    assert any(line.startswith("foot: toe1") for line in told)
    by_foot = {"front": MARKERS[3:5], "back": MARKERS[5:6]}
    joined = hd.study(bare.with_roles(feet=by_foot, body=MARKERS[:3]))
    assert feet_of(joined.config) == ["front", "back"]
    assert joined.recordings[0].names("foot") == ("front", "back")
    assert joined.recordings[0].joined == ()


@pytest.fixture(scope="module")
def file_of_others(tmp_path_factory):
    """Return a file in which toe3 lands between the landings of toe1 and toe2."""
    positions = hopping(5, n_frames=800)[1]
    down = positions[:, 3, 2] < positions[:, 3, 2].min() + 0.02
    period = int(np.median(np.diff(np.flatnonzero(np.diff(down.astype(int)) > 0))))
    positions[:, 5] = np.roll(positions[:, 5], period // 2, axis=0)
    return c3d_of(tmp_path_factory.mktemp("others"), positions)


TWO = {"feet": [*MARKERS[3:5]], "body": [*MARKERS[:3]]}
BY_FOOT = {**TWO, "feet": {"left": MARKERS[3:4], "right": MARKERS[4:5]}}


@pytest.mark.parametrize(
    "asked",
    [
        lambda file: (file, TWO),
        lambda file: (file, {"markers": TWO}),
        lambda file: (hd.read(file, **TWO), {}),
        lambda file: (hd.read(file, **TWO, vertical_axis="z"), {}),
        lambda file: ([hd.read(file).with_roles(**TWO)], {}),
    ],
)
def test_other_feet_are_told_by_all_ways_to_a_study(asked, file_of_others):
    source, keys = asked(file_of_others)
    told = []
    config = hd.study(source, **keys, progress=told.append).config
    assert config["markers"] == {**TWO, "boom": []}
    assert config["sections"]["frames"] == "landings"
    assert "sections.frames: landings, since other feet land too (toe3)" in told
    said = hd.study(source, **keys, sections={"frames": "all"}).config
    assert said["sections"]["frames"] == "all"


def test_feet_are_given_by_their_markers_in_all_calls(file_of_others):
    by_foot = {"left": ["toe1", "toe3"], "right": ["toe2"]}
    roles = {"feet": by_foot, "body": TWO["body"]}
    config = hd.study(file_of_others, **TWO).config
    for source, keys in (
        (file_of_others, roles),
        (hd.read(file_of_others, **roles), {}),
        (config, {"feet": by_foot}),
    ):
        found = hd.study(source, **keys).config
        assert feet_of(found) == ["left", "right"]
        assert found["markers"]["feet"] == ["toe1", "toe3", "toe2"]


def test_frames_are_all_where_no_other_feet_land(tmp_path):
    file = c3d_of(tmp_path, hopping(5, n_frames=800)[1])
    for source, keys in ((file, TWO), (hd.read(file, **TWO), {})):
        assert hd.study(source, **keys).config["sections"]["frames"] == "all"


def test_a_role_that_is_not_given_stays(file_of_others):
    config = hd.study(file_of_others, **TWO).config
    other = hd.study(config, feet=["toe2", "toe3"]).config["markers"]
    assert other == {"feet": ["toe2", "toe3"], "body": TWO["body"], "boom": []}


def test_files_are_joined_by_the_markers_that_all_have(tmp_path):
    _, positions = hopping(5, n_frames=400)
    first = c3d_of(tmp_path, positions)
    (tmp_path / "later").mkdir()
    second = c3d_of(tmp_path / "later", positions[:, :-1], MARKERS[:-1])
    joined = hd.read([first, second])
    assert joined.markers == MARKERS[:-1]
    assert any(
        "left out: 1 marker, which not all of the 2 files have" in remark
        for remark in joined.remarks
    )


def test_roles_that_cannot_be_guessed_are_asked_for_in_one_line(tmp_path):
    time, positions = hopping(5, n_frames=800)
    still = c3d_of(tmp_path, np.repeat(positions[:1], len(time), axis=0))
    bare = hd.read(still)  # which needs no roles
    for ask, wanted in (
        (lambda: hd.study(still), r"feet, body: .*markers\.feet: "),
        (lambda: hd.guess(bare), r"give the roles by recording\.with_roles\(feet=\["),
        (lambda: hd.study(bare), r"give the roles by recording\.with_roles\(feet=\["),
        (
            lambda: hd.study(bare.with_roles(feet=MARKERS[3:6])),
            r"the role body, found none: recording\.with_roles\(body=\[",
        ),
    ):
        with pytest.raises(hd.HopdataError, match=wanted) as told:
            ask()
        assert "\n" not in str(told.value)
    # One of the roles alone is no guess.
    with pytest.raises(hd.HopdataError, match="feet, body: expected names of markers"):
        hd.study(still, feet=MARKERS[3:6])
    only_feet = hd.read(still, feet=MARKERS[3:6])
    assert only_feet.names("foot") == MARKERS[3:6]
    assert len(only_feet.markers) == len(MARKERS)


@pytest.mark.parametrize(
    ("function", "misspelt", "meant"),
    [
        ("analyse", "bdy", "body"),
        ("analyse", "touchdwns", "touchdowns"),
        ("study", "progess", "progress"),
        ("study", "steerng", "steering"),
        ("read", "fet", "feet"),
        ("read", "rate", "rate_hz"),
        ("synthesize", "nam", "name"),
        ("synthesize", "simulaton", "simulation"),
        ("contacts", "fles", "files"),
        ("contacts", "gravty", "gravity"),
    ],
)
def test_a_misspelt_argument_is_compared_with_all_that_a_function_takes(
    function, misspelt, meant
):
    with pytest.raises(ArgumentError) as told:
        getattr(hd, function)("hopper", **{misspelt: 1})
    assert str(told.value).startswith(f"{function}: ")
    assert str(told.value).endswith(f"{misspelt!r}; did you mean {meant!r}?")


def test_no_public_function_lets_any_name_through():
    public = [getattr(hd, name) for name in hd.__all__]
    for function in filter(inspect.isfunction, public):
        kinds = inspect.signature(function).parameters.values()
        if any(one.kind is one.VAR_KEYWORD for one in kinds):
            with pytest.raises(ArgumentError, match="'xq_'"):
                function("hopper", xq_=1)


STATES = np.zeros((20, 18))
TINY = hd.Recording.from_arrays(*hopping(5, n_frames=200), MARKERS, **TWO)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda: hd.judge(STATES, STATES, STATES), "judge: expected .* 'seed'"),
        (
            lambda: hd.Study.save(None, folders=1),
            "Study.save: expected the arguments folder, .* 'folders'",
        ),
        (lambda: hd.Study.report(None, None), "file: expected a path .*, found None"),
        (
            lambda: hd.Study.save(None, 3),
            "folder: expected a path to write to, found 3",
        ),
        (
            lambda: hd.judge(STATES, STATES, STATES, seed=1, flip=9),
            "did you mean 'flips'",
        ),
        (
            lambda: hd.judge("a", STATES, STATES, seed=1),
            "x: expected an array of numbers",
        ),
        (
            lambda: hd.judge(*2 * [STATES[:, :17]], STATES, seed=1),
            r"\(n, 6B\).*\(20, 17\)",
        ),
        (
            lambda: hd.judge(STATES, STATES, STATES, seed=1, confidence=95),
            "confidence: .* 95",
        ),
        (
            lambda: hd.judge(STATES, STATES, STATES, seed=1, power="80 %"),
            "power: .* between .* 80 %",
        ),
        (
            lambda: hd.judge(STATES, STATES, STATES, seed=1, margin=None),
            r"margin: .* \(0, 1\]",
        ),
        (
            lambda: hd.judge(STATES, STATES, STATES, seed=1, margin=20),
            r"margin: .* found 20",
        ),
        (
            lambda: hd.judge(STATES, STATES, STATES, seed=None),
            "seed: .* whole number, 0 or more",
        ),
        (
            lambda: hd.judge(STATES, STATES, STATES, seed=1, flips=9),
            "flips: .* 20 or more, found 9",
        ),
        (
            lambda: hd.judge(STATES[:, :0], STATES[:, :0], STATES, seed=1),
            r"6B.*\(20, 0\)",
        ),
        (lambda: hd.plan("x"), "pilot: expected a study or its verdict, found 'x'"),
        (lambda: hd.read("a.c3d", units="mm"), "read: .*'units'; did you mean 'unit'"),
        (lambda: hd.read("a.c3d", rate_hz="fast"), "input.rate_hz: expected a number"),
        (lambda: hd.read([], feet=FEET), "file: expected a path or a list of paths"),
        (lambda: hd.read(b"abc"), "file: expected a path or a list of paths"),
        (lambda: hd.read(["a.c3d", 3]), "file: expected a path or a list of paths"),
        (
            lambda: hd.study("a.c3d", feet=FEET, markers={"feet": FEET}),
            "feet, body: expected each role once, found feet= and markers=",
        ),
        (
            lambda: hd.study("a.c3d", markers="toe"),
            "markers: expected keys with values",
        ),
        (
            lambda: hd.study(TINY, recordings=[{"block": "sand"}]),
            r"recordings\[0\]\.name: expected this key",
        ),
        (
            lambda: hd.study(TINY, recordings={"name": "tiny"}),
            "recordings: expected a list of at least 1 entry",
        ),
        (
            lambda: hd.study(TINY, markers=TWO),
            r"feet, body: expected none beside a recording.*recording\.with_roles",
        ),
        (lambda: hd.analyse("a.c3d", input="mm"), "input: expected keys with values"),
        (lambda: hd.analyse("a.c3d", progress=True), "progress: expected a function"),
        (
            lambda: hd.synthesize("hopper", simulation=20),
            "simulation: expected keys with values",
        ),
        (
            lambda: hd.Recording.from_arrays([0, 1], STATES),
            "from_arrays: .*'markers'",
        ),
        (
            lambda: hd.Recording.from_arrays([0, 0.1], STATES, FEET),
            r"positions: expected shape \(2, 3, 3\)",
        ),
        (
            lambda: hd.Recording("a", [0, 1], STATES, (), (), 1.0),
            "time: expected an array of",
        ),
    ],
)
def test_wrong_calls_are_told_by_name_in_a_line(wrong, told):
    with pytest.raises(hd.HopdataError, match=told) as caught:
        wrong()
    assert "\n" not in str(caught.value)


def test_results_are_shown_in_a_line_and_a_small_table(study):
    study = study[0]
    shown = (
        study.recordings[0],
        study.pairs,
        study.sections,
        study.verdict,
        study.figures,
    )
    for result in shown:
        assert len(repr(result)) < 250
        assert "array(" not in repr(result)
    for result in shown[:-1]:
        assert len(result._repr_html_()) < 4000
    for stage in (study.foot_contacts(), study.home_frame(), study.floors["monday"]):
        assert len(repr(stage)) < 300
        assert "array(" not in repr(stage)
        assert "\n" not in repr(stage)
    assert f"{study.verdict}" == study.verdict.sentence
    assert "<td>my foot1</td>" in study.recordings[0]._repr_html_()


def test_an_error_is_one_line_in_a_notebook():
    with pytest.raises(hd.HopdataError) as caught:
        hd.read("nothing.c3d", feet=FEET, body=BODY)
    told = "RecordingError: nothing.c3d: expected a file, found none"
    assert caught.value._render_traceback_() == [told]


def test_steps_one_by_one_compute_no_more_than_they_need(sample_path):
    told = []
    whole = hd.read(sample_path, feet=FEET, body=BODY)
    with pytest.raises(hd.HopdataError, match=r"frames: expected a slice.* found 5"):
        whole.part(5)
    with pytest.raises(hd.HopdataError, match="frames: expected a slice"):
        whole.part(slice(None, None, -1))
    assert whole.part(slice(0, 100, 2)).rate_hz == whole.rate_hz / 2
    recording = whole.part(slice(4_000))
    study = hd.study(recording, progress=told.append)
    assert "no verdict yet" in repr(study)
    assert study.import_recording()["hopper"].imported is recording
    level = study.floor_compensation()["hopper"].level
    assert study.recordings[0] is level
    assert abs(np.nanmin(level.feet[:, :, 2])) < 0.01
    assert told == ["import_recording hopper", "floor_compensation hopper"]
    assert list(study.foot_contacts().contacts) == ["hopper"]
    sections = study.poincare_sections().sections
    assert sections.pre_height_m > study.sections.post_height_m
    assert told[-1] == "poincare_sections"
    assert "schedule" in study.mode_schedules().schedules
    assert len(study.home_frame().pairs) == len(study.pairs)
    assert told[-2:] == ["home_frame", "normalisation"]
    assert study.verdict.sentence in repr(study)


def test_each_stage_is_a_step_of_a_study():
    steps = {*LINE.stages} - {"simulate"}
    assert steps <= {*dir(hd.Study)}


def test_distances_that_are_not_asked_for_are_not_made(monkeypatch, tmp_path):
    def made(*_, **__):
        raise AssertionError("subspaces were made")

    monkeypatch.setattr(subspaces, "bootstrap_subspaces", made)
    recording, _ = hd.synthesize(simulation={"hops": 60})
    study = hd.study(
        recording, distances={"enabled": False}, prediction={"bootstraps": 2}
    )
    assert {"distances", "distance_summary"}.isdisjoint(study.tables)
    assert "distances" not in study.figures.names
    assert "fig2_5_distances" not in study.figures.names.values()
    assert (
        "constraint subspaces" not in study.report(tmp_path / "page.html").read_text()
    )
    with pytest.raises(AssertionError, match="subspaces were made"):
        _ = hd.study(recording, prediction={"bootstraps": 2}).tables


@pytest.mark.parametrize("method", METHODS)
def test_contacts_of_a_study_are_those_of_its_method(sample_path, method):
    recording = hd.read(sample_path, feet=FEET, body=BODY).part(slice(4000))
    study = hd.study(recording, touchdowns={"method": method})
    found, table = study.contacts["hopper"], study.touchdowns
    assert set(found["method"]) == set(table["method"]) == {method}
    names = [f"contact_{foot}_s" for foot in FEET]
    same = found[names].iloc[1:].to_numpy() == table[names].iloc[1:].to_numpy()
    assert len(found) == len(table)
    assert same[~table["excluded"].to_numpy()[1:]].all()


def write_trc(path, recording):
    """Write a recording as TRC with y up."""
    n_frames = len(recording.time)
    turned = (1e3 * recording.positions[:, :, [1, 2, 0]]).reshape(n_frames, -1)
    rows = np.c_[np.arange(n_frames), recording.time, turned]
    axes = [f"{axis}{i + 1}" for i in range(len(recording.markers)) for axis in "XYZ"]
    head = [
        "PathFileType\t4\t(X/Y/Z)\tlying.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
        f"100\t100\t{n_frames}\t{len(recording.markers)}\tmm",
        "Frame#\tTime\t" + "\t\t\t".join(recording.markers),
        "\t\t" + "\t".join(axes),
    ]
    lines = ["\t".join(f"{value:.6g}" for value in row) for row in rows]
    path.write_text("\n".join([*head, *lines]) + "\n")


def test_the_vertical_axis_of_a_file_is_guessed(sample_path, tmp_path):
    whole = hd.read(sample_path, feet=FEET, body=BODY).part(slice(3000))
    write_trc(tmp_path / "lying.trc", whole)
    read = hd.read(tmp_path / "lying.trc", feet=FEET, body=BODY)
    assert read.vertical_axis == "y"
    assert not [remark for remark in read.remarks if "vertical_axis" in remark]
    np.testing.assert_allclose(read.feet[:, :, 2], whole.feet[:, :, 2], atol=1e-5)


def test_an_axis_that_is_not_sure_is_told_where_roles_are_given(sample_path, tmp_path):
    whole = hd.read(sample_path, feet=FEET, body=BODY).part(slice(200))
    file = tmp_path / "still.trc"
    # Nothing moves, and the body is as far beside its feet as above them.
    still = np.repeat(whole.positions[:1], 200, axis=0)
    body = [whole.markers.index(name) for name in BODY]
    above = still[0, body, 2].mean()
    still[:, body, 0] += above
    noise = np.random.default_rng(1).normal(0, 3e-4, still.shape)
    write_trc(file, replace(whole, positions=still + noise))
    read = hd.read(file, feet=FEET, body=BODY)
    (told,) = [remark for remark in read.remarks if "vertical_axis" in remark]
    assert told.startswith(f"{file}: vertical_axis: {read.vertical_axis} or ")
    assert f"{read.vertical_axis} is not sure (" in told
    given = hd.read(file, feet=FEET, body=BODY, vertical_axis="y")
    assert not [remark for remark in given.remarks if "vertical_axis" in remark]
    with pytest.raises(hd.HopdataError, match=r"input\.vertical_axis: auto"):
        hd.read(file, feet=FEET, body=BODY, vertical_axis="auto")


def test_a_simulated_recording_with_its_truth():
    recording, truth = hd.synthesize(simulation={"hops": 5}, seed=3)
    assert recording.names("foot") == tuple(FEET)
    assert len(truth.contact_times) >= 4
    again = hd.synthesize(simulation={"hops": 5}, seed=3)[0]
    np.testing.assert_array_equal(recording.positions, again.positions)
    with pytest.raises(hd.HopdataError, match=r"simulation\.scene"):
        hd.synthesize("hoper")


def test_what_is_simulated_for_a_study_names_no_folder_that_is_gone():
    markers = {"body": BODY, "feet": FEET}
    config = {"study": "jumps", "markers": markers, "recordings": [{"name": "one"}]}
    (recording,) = hd.study(config | {"simulation": {"hops": 5}}).imported
    assert recording.source == "simulated/one.h5"


def test_a_plan_halves_the_difference_for_four_times_the_landings(study):
    """Beyond what the nearest landings leave: two minutes use others too."""
    effect = study[0].verdict.effect
    least = effect.allowed_nearest
    assert LEFT <= least < 0.11 < effect.allowed
    needed = hd.plan(study[0], [least + 0.04, least + 0.02])["landings"]
    assert needed[1] == pytest.approx(4 * needed[0], rel=0.01)


def test_a_plan_notes_the_least_number_of_landings(study):
    """Where a difference asks for it; three feet have no size of fewer than 150."""
    small = study[0].verdict.effect.allowed_nearest + 0.02
    told = [hd.plan(study[0], [size]) for size in (small, 5.0)]
    noted = ["the fewest of 3 feet" in str(one.attrs["notes"]) for one in told]
    assert [int(one["landings"].iloc[0]) == 150 for one in told] == noted
    assert noted == [False, True]


def test_a_plan_asks_for_no_difference_that_smooth_terms_may_leave(study):
    """Contacts far apart leave more than a tenth."""
    verdict = study[0].verdict
    wide = replace(
        verdict,
        effect=replace(
            verdict.effect,
            detectable=0.6,
            allowed=0.55,
            detectable_nearest=0.7,
            allowed_nearest=0.55,
        ),
    )
    assert hd.plan(wide)["difference"].between(0.57, 1).all()


def test_positions_have_named_axes_where_xarray_is_installed(sample_path):
    recording = hd.read(sample_path, feet=FEET, body=BODY).part(slice(50))
    if find_spec("xarray") is None:
        with pytest.raises(hd.HopdataError, match="expected the package xarray"):
            recording.to_xarray()
    else:
        array = recording.to_xarray()["position"]
        foot = array.sel(keypoints="foot2", space="z").squeeze()
        np.testing.assert_array_equal(foot, recording.feet[:, 1, 2])
        assert array.attrs["units"] == "m"


@pytest.fixture(scope="module")
def spoiled(sample_path):
    """Return a recording in which a marker of one landing is 10 mm off, after contact."""
    recording = read_recording(sample_path).part(slice(12_000))
    off_s = recording.time - SPOILED_S
    at = (off_s > 0.12) & (off_s < 0.16)
    positions = recording.positions.copy()
    positions[at, recording.markers.index("body1"), 0] += 0.01
    return replace(recording, positions=positions)


#: Instant at the pre section of a landing of the sample, s.
SPOILED_S = 38.178

#: Fewer draws than usual: the answer does not matter.
FEW_FLIPS = {"flips": 99}


def excluding(recording, touchdowns):
    """Return the study of a recording without some landings."""
    exclude = [{"landings": touchdowns, "reason": "tried"}]
    entry = {"name": "hopper", "exclude": exclude}
    return hd.study(recording, recordings=[entry], verdict=FEW_FLIPS)


def test_a_landing_that_is_far_off_is_named_as_exclude_takes_it(spoiled, tmp_path):
    """Its row among the pairs was printed, which is another landing's number."""
    study = excluding(spoiled, [5, 9, 20])
    (far_off,) = study.verdict.far_off
    assert study.verdict.gross_errors == {"markers_apart": [far_off["row"]]}
    assert far_off["touchdown"] == far_off["row"] + 3
    assert far_off["t_pre_s"] == pytest.approx(SPOILED_S, abs=0.001)

    number = far_off["touchdown"]
    (note,) = [one for one in study.verdict.notes if one.code == "maps.gross_errors"]
    assert f"hopper, touchdown {number} (at 38.18 s)" in note.reason
    page = study.report(tmp_path / "page.html").read_text().replace("\u00a0", " ")
    assert note.reason in page
    of_page = page[page.index("Every landing that is not used") :]
    row = re.search("<tr>(?:(?!</tr>).)*far off.*?</tr>", of_page, re.DOTALL)[0]
    assert "left out of the verdict as far off: body markers" in row
    assert re.findall(r"<td[^>]*>([\d.]+)</td>", row) == [str(number), "38.18"]

    # The number that is printed leaves out that very landing, and no other.
    again = excluding(spoiled, [5, 9, 20, number])
    assert not again.verdict.far_off
    assert not again.verdict.gross_errors
    names = set(study.pairs.touchdown) - set(again.pairs.touchdown)
    assert names == {number}


def test_landings_that_are_far_off_are_kept_where_that_is_asked_for(spoiled):
    keys = {"flips": 99, "keep_far_off": True}
    study = hd.study(spoiled, verdict=keys)
    without = hd.study(spoiled, verdict=FEW_FLIPS)
    assert study.verdict.n_landings == without.verdict.n_landings + 1
    assert not study.verdict.far_off
    codes = [note.code for note in study.verdict.notes]
    assert "maps.far_off_kept" in codes
    assert "maps.gross_errors" not in codes
    codes = [note.code for note in without.verdict.notes]
    assert "maps.far_off_kept" not in codes


def test_the_page_of_a_study_holds_its_landings(study, tmp_path):
    page = study[0].report(tmp_path / "page.html").read_text()
    # A number and its unit stay together.
    assert study[0].verdict.sentence in page.replace("\u00a0", " ")
    assert page.count("<canvas") == 1
    assert page.count('class="small"') == study[0].touchdowns["excluded"].sum()
    assert len(page) < 1_500_000
