"""A study in one process; that its bytes are the workflow's is tested in `workflow`."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest

import hopdata as hd
from hopdata.recordings.readers.hdf5 import read_recording

FEET, BODY = ["foot1", "foot2", "foot3"], ["body1", "body2", "body3"]


@pytest.fixture(scope="module")
def study(sample_path):
    """Two minutes of the sample, from arrays."""
    whole = read_recording(sample_path).part(slice(12_000))
    recording = hd.Recording.from_arrays(
        whole.time, whole.positions, whole.markers, feet=FEET, body=BODY, name="monday"
    )
    told = []
    return hd.analyse(recording, progress=told.append), told


def test_stages_are_told_in_their_order(study):
    assert study[1][:3] == ["reading", "levelling monday", "contacts of monday"]
    assert study[1].index("sections") < study[1].index("verdict")


def test_what_a_notebook_looks_at(study):
    study = study[0]
    assert study.verdict.sentence in repr(study)
    assert "<svg" in study._repr_html_()
    used = study.touchdowns[~study.touchdowns["excluded"]]
    assert len(used) == len(study.pairs) > 150
    assert set(study.quality["status"]) <= {"good", "look", "poor", "not known"}
    assert study.figures.schedule().axes
    assert study.tables["drift"].columns[0]


def test_all_is_saved_where_no_noise_is_expected(study, tmp_path):
    study[0].save(tmp_path)
    checks = json.loads((tmp_path / "quality.json").read_text())
    assert any(check["value"] is None for check in checks)
    assert (tmp_path / "figures" / "verdict.svg").is_file()


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
    with pytest.raises(AttributeError, match="no attribute 'analyze'"):
        _ = hd.analyze


ARRAYS = {"time": np.arange(5.0), "positions": np.zeros((5, 2, 3)), "markers": ["toe", "hip"]}


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"time": [0.0, 0.1, 0.1, 0.2, 0.3]}, "time: expected two frames or more, each later"),
        ({"positions": np.zeros((5, 3, 2))}, "positions: expected shape (5, 2, 3)"),
        ({"markers": ["toe"]}, "positions: expected shape (5, 1, 3)"),
        ({"feet": ["to"]}, "feet: expected any of ('toe', 'hip'), found 'to'; did you mean 'toe'"),
    ],
)
def test_wrong_arrays_are_told_by_name(changed, told):
    given = {**ARRAYS, "feet": ["toe"], "body": ["hip"], **changed}
    with pytest.raises(hd.HopdataError, match=re.escape(told)):
        hd.Recording.from_arrays(**given)


def test_millimetres_for_metres_and_a_text_for_a_list_are_told(sample_path):
    whole = hd.read(sample_path, feet=FEET, body=BODY).part(slice(3000))
    roles = {"feet": FEET, "body": BODY}
    large = hd.Recording.from_arrays(whole.time, 1e3 * whole.positions, whole.markers, **roles)
    with pytest.raises(hd.HopdataError, match="scale"):
        hd.analyse(large)
    with pytest.raises(hd.HopdataError, match="feet: expected a list of marker names"):
        hd.analyse(sample_path, feet="foot1", body=BODY)
