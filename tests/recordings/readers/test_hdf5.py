"""Recordings and their truth survive a round trip through a file; broken files are refused."""

import hashlib
import struct
from dataclasses import fields, replace

import h5py
import numpy as np
import pytest

from hopdata.errors import RecordingError
from hopdata.recording import Recording
from hopdata.recordings.readers import hdf5_checks
from hopdata.recordings.readers.hdf5 import read_recording, read_truth, write_recording
from hopdata.seal import seal_for
from hopdata.truth import Truth

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


def test_the_lengths_of_legs_are_kept_where_they_scatter(tmp_path, recording, truth):
    path = tmp_path / "trial.h5"
    scattered = replace(truth, longer_m=np.full((LANDINGS, 2), 0.004))
    write_recording(path, recording, scattered)
    arrays_equal(read_truth(path), scattered)
    write_recording(path, recording, truth)
    assert read_truth(path).longer_m is None


def test_a_truth_that_does_not_say_how_far_the_maps_are_apart(
    tmp_path, recording, truth
):
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
        assert {
            "name",
            "roles",
            "rate_hz",
            "vertical_axis",
            "source",
            "source_sha256",
        } <= set(file.attrs)
        assert file.attrs["hopdata_version"]


def test_equal_content_gives_equal_bytes(tmp_path, recording, truth):
    digests = []
    for name, content in (
        ("a", recording),
        ("b", recording),
        ("c", replace(recording, name="x")),
    ):
        write_recording(tmp_path / name, content, truth)
        digests.append(hashlib.sha256((tmp_path / name).read_bytes()).hexdigest())
    assert digests[0] == digests[1] != digests[2]


@pytest.mark.parametrize("far_m", [0.0, 1e5, 1e7])
def test_positions_keep_every_digit_wherever_the_origin_is(tmp_path, recording, far_m):
    odd = replace(recording, positions=far_m + recording.positions / 3)
    write_recording(tmp_path / "a.h5", odd)
    np.testing.assert_array_equal(
        read_recording(tmp_path / "a.h5").positions, odd.positions
    )
    single = odd.positions.astype(np.float32)  # as earlier versions stored them
    assert np.nanmax(np.abs(single - odd.positions)) > 0


def test_a_file_of_an_earlier_version_is_read(tmp_path, recording):
    """Its positions are float32, which float64 holds exactly."""
    write_recording(tmp_path / "a.h5", recording)
    single = (recording.positions / 3).astype(np.float32)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file["positions"]
        file.create_dataset("positions", data=single)
    found = read_recording(tmp_path / "a.h5").positions
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found, single)


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
        (
            "time",
            np.array([b"x"] * FRAMES),
            "dataset 'time': expected an array of numbers",
        ),
        ("time", 5.0, "dataset 'time': expected an array of numbers"),
        ("time", np.zeros((FRAMES, 2)), "time: expected an array of shape"),
        ("positions", np.zeros((FRAMES, 5, 3), complex), "found complex128"),
        ("positions", None, "expected hopdata's own layout, with the datasets 'time'"),
        ("@markers", 5, "attribute 'markers': expected a list of texts, found 5"),
        ("@markers", h5py.Empty("f"), "attribute 'markers': expected a list of texts"),
        (
            "@roles",
            ["body"] * 4 + ["wing"],
            "roles: expected any of body, foot.*found 'wing'",
        ),
        ("@rate_hz", "fast", "attribute 'rate_hz': expected a number, found fast"),
        ("@rate_hz", None, "attribute 'rate_hz': expected a number, found none"),
        (
            "@vertical_axis",
            "q",
            "vertical_axis: expected any of x, y, z, -x, -y, -z, found 'q'",
        ),
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


def test_damaged_bytes_are_never_another_error(
    tmp_path, recording, truth, served, impatient
):
    path = tmp_path / "a.h5"
    write_recording(path, recording, truth)
    unsealed(path)  # or none of the damaged bytes would reach the library
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


def unsealed(path):
    """Take the checksum off a file, as older versions wrote it."""
    path.write_bytes(path.read_bytes()[: -len(seal_for(path))])


def test_a_flipped_bit_is_never_read_as_another_recording(tmp_path, recording):
    """Without the checksum, names are read as others: that is what it is for."""
    path = tmp_path / "a.h5"
    write_recording(path, recording)
    sealed, name = path.read_bytes(), b"foot 2"
    for place in [*range(0, len(sealed) - 80, 101), sealed.index(name)]:
        path.write_bytes(flipped(sealed, place))
        with pytest.raises(RecordingError, match="others; it is damaged, copy it anew"):
            read_recording(path)
    path.write_bytes(sealed)
    unsealed(path)
    path.write_bytes(flipped(path.read_bytes(), sealed.index(name)))
    assert read_recording(path).markers[-1] == "noot 2"


def flipped(content, place):
    """Return bytes of which one bit is flipped."""
    damaged = bytearray(content)
    damaged[place] ^= 8
    return bytes(damaged)


def test_a_file_of_an_older_version_is_read(tmp_path, recording):
    path = tmp_path / "a.h5"
    write_recording(path, recording)
    unsealed(path)
    arrays_equal(read_recording(path), recording)


def test_a_part_that_the_index_lost_is_not_read_as_zeros(tmp_path, recording):
    path = tmp_path / "a.h5"
    write_recording(path, recording)
    unsealed(path)
    content = path.read_bytes()
    with h5py.File(path) as file:
        lost = file["positions"].id.get_chunk_info(4)
    # The key of a part in the index holds its size and its place: a marker and a
    # coordinate.
    key = struct.pack("<II4Q", lost.size, 0, *lost.chunk_offset, 0)
    path.write_bytes(flipped(content, content.index(key) + 18))
    with pytest.raises(
        RecordingError, match="'/positions': expected 15 parts, found 14"
    ):
        read_recording(path)


@pytest.mark.parametrize("rate", [5e-307, 0.5, 2e5])
def test_a_rate_of_no_camera_is_refused(tmp_path, recording, rate):
    path = tmp_path / "a.h5"
    write_recording(path, recording)
    with h5py.File(path, "r+") as file:
        file.attrs["rate_hz"] = rate
    with pytest.raises(
        RecordingError, match="rate_hz: expected at least 2 and at most 100000 Hz"
    ):
        read_recording(path)


@pytest.mark.parametrize(
    ("dataset", "value", "said"),
    [
        (
            "time",
            0.0,
            "time: expected finite times that increase, found 0 s after 0.01 s",
        ),
        ("time", np.nan, "time: expected finite times that increase, found nan s"),
        ("time", np.inf, "time: expected finite times that increase, found inf s"),
        ("positions", np.inf, "positions: expected finite or missing ones"),
    ],
)
def test_times_and_coordinates_that_cannot_be_are_refused(
    tmp_path, recording, dataset, value, said
):
    path = tmp_path / "a.h5"
    write_recording(path, recording)
    with h5py.File(path, "r+") as file:
        file[dataset][2] = value
    with pytest.raises(RecordingError, match=said):
        read_recording(path)


def nested(file, depth):
    for _ in range(depth):
        file = file.create_group("g")


def soft_links(file, number):
    for k in range(number):
        file[f"l{k}"] = h5py.SoftLink("/time")


@pytest.mark.parametrize(
    ("make", "few", "many", "said"),
    [
        (nested, 20, 40, "at most 32 groups within groups, found 33"),
        (soft_links, 10, 60, "at most 50 links between its groups and datasets, found"),
    ],
)
def test_links_and_levels_are_counted_before_they_are_followed(
    tmp_path, monkeypatch, recording, make, few, many, said, read_here
):
    monkeypatch.setattr(hdf5_checks, "MOST_LINKS", 50)
    path = tmp_path / "a.h5"
    for number in (few, many):
        write_recording(path, recording)
        with h5py.File(path, "r+") as file:
            make(file, number)
        if number == few:
            read_recording(path)
    with pytest.raises(RecordingError, match=said):
        read_recording(path)


def test_as_many_links_and_levels_as_the_limits_are_read(tmp_path, monkeypatch):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        nested(file, hdf5_checks.DEEPEST - 1)  # the root is a level too
        soft_links(file, 20)
        most = hdf5_checks.DEEPEST - 1 + 20
    for limit, is_read in ((most, True), (most - 1, False)):
        monkeypatch.setattr(hdf5_checks, "MOST_LINKS", limit)
        with h5py.File(path) as file:
            if is_read:
                assert len(list(hdf5_checks.items_of(file))) == hdf5_checks.DEEPEST
            else:
                with pytest.raises(ValueError, match=f"most {most - 1} links"):
                    list(hdf5_checks.items_of(file))


@pytest.mark.parametrize(("n_bytes", "is_read"), [(500_000, True), (500_001, False)])
def test_the_limit_of_memory_holds_to_the_byte(tmp_path, n_bytes, is_read):
    """Numbers that are stored short count as long as in memory, and texts as they are."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["numbers"] = np.zeros((100, 100), np.float16)
        file["more/text"] = np.bytes_(b"a" * (n_bytes - 80_000))
    with h5py.File(path) as file:
        if is_read:
            hdf5_checks.require_sound(file, 0.5)
        else:
            with pytest.raises(ValueError, match=r"at most 0\.5 MB"):
                hdf5_checks.require_sound(file, 0.5)


def test_groups_that_hold_each_other_are_walked_once(tmp_path, recording):
    path = tmp_path / "a.h5"
    write_recording(path, recording)
    with h5py.File(path, "r+") as file:
        file.create_group("a/b")
        file["a/b/up"] = file["a"]
        file["a/b/top"] = file
    with h5py.File(path) as file:
        assert (
            sum(1 for _ in hdf5_checks.items_of(file)) == 5
        )  # the root, two groups, two datasets
    arrays_equal(read_recording(path), recording)
