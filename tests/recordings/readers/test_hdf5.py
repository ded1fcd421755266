"""Recordings and their truth survive a round trip through a file; broken files are refused."""

import hashlib
from dataclasses import fields, replace

import h5py
import numpy as np
import pytest

from hopdata.errors import RecordingError
from hopdata.recording import Recording, Truth
from hopdata.recordings.readers.hdf5 import read_recording, read_truth, write_recording

FRAMES, LANDINGS = 500, 4


def arrays_equal(first, second):
    for f in fields(first):
        a, b = getattr(first, f.name), getattr(second, f.name)
        if isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b, err_msg=f.name)
            assert a.dtype == b.dtype, f.name
        else:
            assert a == b, f.name


@pytest.fixture
def recording():
    rng = np.random.default_rng(1)
    positions = rng.uniform(-1, 1, (FRAMES, 5, 3)).astype(np.float32).astype(float)
    positions[7:9, 2] = np.nan
    return Recording(
        name="trial 1",
        time=np.arange(FRAMES) / 100,
        positions=positions,
        markers=("b1", "b2", "b3", "fü1", "foot 2"),
        roles=("body",) * 3 + ("foot",) * 2,
        rate_hz=100.0,
        source="trial.tsv",
        source_sha256="ab" * 32,
        vertical_axis="y",
    )


@pytest.fixture
def truth():
    rng = np.random.default_rng(2)
    times = rng.uniform(0, 5, (LANDINGS, 2))
    times[1, 0] = np.nan
    return Truth(
        contact_times=times,
        apex_times=rng.uniform(0, 5, LANDINGS),
        complete=np.array([True, False, True, True]),
        foot_down=rng.random((FRAMES, 2)) < 0.5,
        body_height=rng.random(FRAMES).astype(np.float32).astype(float),
        contact_points=rng.normal(size=(LANDINGS, 2, 2)),
        floor_at_contacts=rng.normal(size=(LANDINGS, 2)),
        apex_states=rng.normal(size=(LANDINGS, 12)),
        preloads_n=rng.normal(size=(LANDINGS, 2)),
        noise_m=0.0006,
        parameters_json='{"seed": 1}',
        true_effect=0.25,
    )


def test_a_recording_and_its_truth_come_back_as_they_were(tmp_path, recording, truth):
    path = tmp_path / "new folder" / "trial.h5"
    write_recording(path, recording, truth)
    arrays_equal(read_recording(path), recording)
    arrays_equal(read_truth(path), truth)


def test_a_truth_that_does_not_say_how_far_the_maps_are_apart(tmp_path, recording, truth):
    write_recording(tmp_path / "a.h5", recording, truth)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file["truth"].attrs["true_effect"]
    assert np.isnan(read_truth(tmp_path / "a.h5").true_effect)


def test_a_recording_without_truth_has_none(tmp_path, recording):
    write_recording(tmp_path / "a.h5", recording)
    assert read_truth(tmp_path / "a.h5") is None


def test_file_holds_what_the_contract_names(tmp_path, recording):
    write_recording(tmp_path / "a.h5", recording)
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["time"].shape == (FRAMES,)
        assert file["positions"].shape == (FRAMES, 5, 3)
        assert list(file.attrs["markers"]) == list(recording.markers)
        assert {"name", "roles", "rate_hz", "vertical_axis", "source", "source_sha256"} <= set(
            file.attrs
        )
        assert file.attrs["hopdata_version"]


def test_equal_content_gives_equal_bytes(tmp_path, recording, truth):
    digests = []
    for name, content in (("a", recording), ("b", recording), ("c", replace(recording, name="x"))):
        write_recording(tmp_path / name, content, truth)
        digests.append(hashlib.sha256((tmp_path / name).read_bytes()).hexdigest())
    assert digests[0] == digests[1] != digests[2]


def test_float32_rounds_far_below_any_noise(tmp_path, recording):
    odd = replace(recording, positions=recording.positions * (1 + 1e-9) / 3)
    write_recording(tmp_path / "a.h5", odd)
    error = np.nanmax(np.abs(read_recording(tmp_path / "a.h5").positions - odd.positions))
    assert 0 < error < 1e-7


def test_an_empty_truth_can_be_written(tmp_path, recording, truth):
    none = {
        name: getattr(truth, name)[:0]
        for name in (
            "contact_times",
            "apex_times",
            "complete",
            "contact_points",
            "floor_at_contacts",
            "apex_states",
            "preloads_n",
        )
    }
    write_recording(tmp_path / "a.h5", recording, replace(truth, **none))
    assert read_truth(tmp_path / "a.h5").contact_times.shape == (0, 2)


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path, recording, truth):
    path = tmp_path / "a.h5"
    write_recording(path, recording)
    before = path.read_bytes()
    with pytest.raises(TypeError):
        write_recording(path, recording, replace(truth, noise_m=object()))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_a_missing_file_a_text_file_and_a_foreign_file_are_refused_by_name(tmp_path):
    (tmp_path / "text.h5").write_text("Frame\tTime\n")
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["data"] = np.zeros(3)
    whole = (tmp_path / "foreign.h5").read_bytes()
    (tmp_path / "short.h5").write_bytes(whole[: len(whole) // 2])
    for name, what in (
        ("missing.h5", "no such file"),
        ("text.h5", "not an HDF5 file"),
        ("short.h5", "cut short or damaged"),
        ("foreign.h5", "not a recording"),
    ):
        with pytest.raises(RecordingError, match=f"{name}: {what}"):
            read_recording(tmp_path / name)


def test_sizes_that_disagree_are_refused(tmp_path, recording):
    write_recording(tmp_path / "a.h5", recording)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file.attrs["markers"] = ["one"]
    with pytest.raises(RecordingError, match="roles: expected 1 entries, found 5"):
        read_recording(tmp_path / "a.h5")


def test_a_truth_that_is_not_whole_is_refused(tmp_path, recording, truth):
    write_recording(tmp_path / "a.h5", recording, truth)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file["truth/apex_times"]
    with pytest.raises(RecordingError, match="truth is not whole"):
        read_truth(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("key", "value", "found"),
    [
        ("time", np.array([b"x"] * FRAMES), "dataset 'time': expected an array of numbers"),
        ("time", 5.0, "dataset 'time': expected an array of numbers"),
        ("time", np.zeros((FRAMES, 2)), "time: expected an array of shape"),
        ("positions", np.zeros((FRAMES, 5, 3), complex), "found complex128"),
        ("positions", None, "dataset 'positions': expected numbers, found none"),
        ("@markers", 5, "attribute 'markers': expected a list of texts, found 5"),
        ("@markers", h5py.Empty("f"), "attribute 'markers': expected a list of texts"),
        ("@roles", ["body"] * 4 + ["wing"], "roles: expected any of body, foot.*found 'wing'"),
        ("@rate_hz", "fast", "attribute 'rate_hz': expected a number, found fast"),
        ("@rate_hz", None, "attribute 'rate_hz': expected a number, found none"),
        ("@vertical_axis", "q", "vertical_axis: expected any of x, y, z, -x, -y, -z, found 'q'"),
        ("@name", 3, "attribute 'name': expected text, found 3"),
        ("truth/complete", "abc", "dataset 'complete': expected an array of numbers"),
        ("truth/foot_down", np.zeros((FRAMES, 3), bool), "foot_down: expected shape"),
        ("truth/apex_states", np.zeros((LANDINGS, 11)), "apex_states: expected shape"),
        ("truth/body_height", np.zeros(4), "body_height: expected shape"),
        ("truth", np.zeros(3), "truth is not whole"),
    ],
)
def test_wrong_content_is_told_with_what_was_expected(
    tmp_path, recording, truth, key, value, found
):
    path = tmp_path / "a.h5"
    write_recording(path, recording, truth)
    with h5py.File(path, "a") as file:
        store, name = (file.attrs, key[1:]) if key.startswith("@") else (file, key)
        del store[name]
        if value is not None:
            store[name] = value
    with pytest.raises(RecordingError, match=f"a.h5: .*{found}"):
        (read_truth if key.startswith("truth") else read_recording)(path)


def test_damaged_bytes_are_never_another_error(tmp_path, recording, truth):
    path = tmp_path / "a.h5"
    write_recording(path, recording, truth)
    whole, rng = path.read_bytes(), np.random.default_rng(6)
    refused = 0
    for k in range(300):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), rng.integers(1, 30)):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged[: rng.integers(len(whole))] if k % 5 == 0 else damaged)
        for read in (read_recording, read_truth):
            try:
                read(path)
            except RecordingError as error:
                refused += "a.h5: " in str(error)
    assert refused > 300
