import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hopdata import digests
from hopdata.errors import AnalysisError, DamagedError, StorageError
from hopdata.jobs import (
    read_json,
    read_table,
    read_tables,
    reported,
    whole_file,
    write_json,
    write_table,
)
from hopdata.recording import Recording
from hopdata.recordings.readers.hdf5 import write_recording


def test_a_users_mistake_is_one_line_and_exit_code_1(tmp_path, capsys):
    log = tmp_path / "logs" / "job.log"
    with pytest.raises(SystemExit) as caught, reported(log):
        raise AnalysisError("sections.pre_height_m: expected more than 0.3, found 0.2")
    assert caught.value.code == 1
    assert capsys.readouterr().err.splitlines() == [
        "hopdata: error: sections.pre_height_m: expected more than 0.3, found 0.2"
    ]
    assert "expected more than 0.3" in log.read_text()
    assert "Traceback" not in log.read_text()


def test_a_defect_keeps_its_traceback(tmp_path):
    with pytest.raises(ZeroDivisionError), reported(tmp_path / "job.log"):
        _ = 1 / 0
    assert "Traceback" in (tmp_path / "job.log").read_text()


def test_names_that_look_like_numbers_or_nothing_come_back(tmp_path):
    table = pd.DataFrame(
        {
            "recording": ["NA", "null", "nan"],
            "foot": ["01", "02", "NA"],
            "x": [1.5, np.nan, np.inf],
        }
    )
    write_table(tmp_path / "a.csv", table)
    pd.testing.assert_frame_equal(read_table(tmp_path / "a.csv"), table)


def test_late_instants_keep_their_digits(tmp_path):
    times = [1_700_000_000.123456, np.nan, 12.5]
    write_table(
        tmp_path / "a.csv", pd.DataFrame({"t_pre_s": times, "height_m": [1e4 / 3] * 3})
    )
    back = read_table(tmp_path / "a.csv")
    np.testing.assert_allclose(back["t_pre_s"], times, rtol=0, atol=1e-6)
    assert (tmp_path / "a.csv").read_text().splitlines()[1].endswith(",3333.33333")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("t_pre_s", "1.23456789012"),
        ("duration_s", "1.23456789012"),
        ("speed_m_s", "1.23456789"),
        ("error_mm_s", "1.23456789"),
        ("spin_rad_s", "1.23456789"),
    ],
)
def test_times_have_more_digits_than_rates(tmp_path, name, text):
    write_table(tmp_path / "a.csv", pd.DataFrame({name: [1.2345678901234567]}))
    assert (tmp_path / "a.csv").read_text().splitlines() == [name, text]


def test_what_a_killed_process_left_of_a_file_is_removed(tmp_path):
    other = tmp_path / ".table.csv.bak.7.part"
    for left in (tmp_path / ".table[1].csv.12345.part", other):
        left.touch()
    write_json(tmp_path / "table[1].csv", {})
    assert sorted(tmp_path.iterdir()) == sorted([other, tmp_path / "table[1].csv"])


def test_a_file_is_whole_or_not_there(tmp_path):
    target = tmp_path / "table.csv"
    target.write_text("old")

    def fail_halfway():
        with whole_file(target) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_halfway()
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["table.csv"]


def of_numbers(path):
    write_table(path, pd.DataFrame({"x": np.arange(20_000) / 7}))


def of_a_recording(path):
    rng = np.random.default_rng(1)
    time, positions = np.arange(50_000) / 100, rng.normal(size=(50_000, 2, 3))
    write_recording(
        path, Recording.from_arrays(time, positions, ["a", "b"], feet=["a"], body=["b"])
    )


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # raised by h5py
@pytest.mark.parametrize("write", [of_numbers, of_a_recording])
def test_a_full_disk_is_told_in_a_line_and_nothing_is_left(tmp_path, write):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        with pytest.raises(
            StorageError, match=r"out: expected a writable file, found: File too"
        ):
            write(tmp_path / "out")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []
    write(tmp_path / "out")
    assert (tmp_path / "out").stat().st_size > 100_000


FULL_DISK = """
import resource, sys
from test_jobs import of_a_recording
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
of_a_recording(sys.argv[1])
"""


def test_a_process_that_meets_a_full_disk_ends_as_others_do(tmp_path):
    command = [sys.executable, "-c", FULL_DISK, str(tmp_path / "out")]
    here = {"cwd": Path(__file__).parent, "capture_output": True, "text": True}
    done = subprocess.run(command, check=False, **here)
    assert done.returncode == 1, done.returncode
    assert "StorageError" in done.stderr.splitlines()[-1]


def test_json_refuses_nan_and_comes_back(tmp_path):
    write_json(tmp_path / "a.json", {"x": 0.1})
    assert read_json(tmp_path / "a.json") == {"x": 0.1}
    with pytest.raises(ValueError):
        write_json(tmp_path / "b.json", {"x": float("nan")})
    assert not (tmp_path / "b.json").exists()
    assert json.loads((tmp_path / "a.json").read_text())


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.json", b"{"),
        ("a.json", b"\xff"),
        ("a.json", b"[" * 100_000),
        ("a.json", b"1" * 5000),
        ("a.csv", b'a,b\n"1,2\n'),
        ("a.csv", b"a,b\n\xff,1\n"),
        ("a.csv", b"a\n1,2\n1,2,3\n"),
        ("a.csv", b"a\n" + b"1," * 300_000),
    ],
)
def test_results_that_cannot_be_read_are_one_line(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    read = read_json if name.endswith("json") else read_table
    with pytest.raises(
        DamagedError, match=f"{name}: expected whole .*run again$"
    ) as told:
        read(path)
    assert "\n" not in str(told.value)
    assert len(str(told.value)) < 300 + len(str(path))


def test_tables_keep_empty_text_and_nine_digits(tmp_path):
    table = pd.DataFrame(
        {
            "recording": ["001", "002"],
            "schedule": ["1>2", ""],
            "reason": ["", "no contact"],
            "t": [1 / 3, 2.0],
        }
    )
    write_table(tmp_path / "t.csv", table)
    back = read_table(tmp_path / "t.csv")
    assert back["recording"].tolist() == ["001", "002"]
    assert back["schedule"].tolist() == ["1>2", ""]
    assert back["reason"].tolist() == ["", "no contact"]
    assert back["t"].tolist() == pytest.approx([1 / 3, 2.0], rel=1e-9)


def test_tables_without_rows_leave_the_types_of_the_others_alone(tmp_path):
    full = pd.DataFrame(
        {"recording": ["a", "b"], "touchdown": [0, 1], "excluded": [True, False]}
    )
    write_table(tmp_path / "full.csv", full)
    write_table(tmp_path / "empty.csv", full[:0])
    paths = [tmp_path / name for name in ("empty.csv", "full.csv", "empty.csv")]
    pd.testing.assert_frame_equal(read_tables(paths), read_table(paths[1]))
    assert read_tables(paths[:1]).columns.tolist() == full.columns.tolist()


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError(), "import_one: memory ran out; run it with fewer jobs at once"),
        (
            OSError(28, "No space left on device", "a.csv"),
            "import_one: a.csv: the disk is",
        ),
        (
            FileNotFoundError(2, "No such file", "in.csv"),
            "import_one: in.csv: it is missi",
        ),
    ],
)
def test_what_the_machine_lacks_is_one_line_with_the_job(tmp_path, capsys, error, said):
    log = tmp_path / "logs" / "import_one.log"
    with pytest.raises(SystemExit), reported(log):
        raise error
    told = capsys.readouterr().err
    assert told.startswith(f"hopdata: error: {said}")
    assert told.count("\n") == 1
    assert "Traceback" in log.read_text()
    assert f"ERROR hopdata: {said}" in log.read_text()


def test_a_full_disk_while_writing_names_file_job_and_what_to_do(tmp_path, capsys):
    with (
        pytest.raises(SystemExit),
        reported(tmp_path / "units.log"),
        whole_file(tmp_path / "units.json"),
    ):
        raise OSError(28, "No space left on device")
    told = capsys.readouterr().err
    assert "units: " in told
    assert (
        "units.json: expected a writable file, found: No space left on device" in told
    )
    assert "then run the same command again" in told
    assert not (tmp_path / "units.json").exists()


def test_a_job_keeps_digests_and_refuses_a_damaged_input(tmp_path, capsys):
    first, second = tmp_path / "a.csv", tmp_path / "b.csv"
    with reported(tmp_path / "a.log", [], [first]):
        first.write_text("whole")
    with reported(tmp_path / "b.log", [first], [second]):
        second.write_text(first.read_text())
    assert not digests.is_changed(second)
    first.write_text("whale")
    done = []
    with pytest.raises(SystemExit), reported(tmp_path / "b.log", [first], [second]):
        done.append(1)
    assert not done
    assert "a.csv: expected the bytes that were written" in capsys.readouterr().err


def test_a_job_keeps_digests_of_all_that_it_writes_in_its_folder(tmp_path):
    folder = tmp_path / "members" / "anna"
    folder.mkdir(parents=True)
    (folder / "notes.txt").write_text("of the user")
    (folder / "old.csv").write_text("whole")
    row = folder / "member.json"
    with reported(tmp_path / "a.log", [], [row, folder / "report.html"], folder):
        for name in ("member.json", "report.html", "verdict.json", "old.csv"):
            with whole_file(folder / name) as draft:
                draft.write_text("whole")
    assert digests.changed_in(tmp_path) == {}
    for name in ("old.csv", "verdict.json"):
        (folder / name).write_text("whale")
        assert digests.changed_in(tmp_path) == {row: folder / name}
        (folder / name).write_text("whole")
    # What the job did not write is not its own, and an output speaks for itself.
    (folder / "notes.txt").write_text("changed")
    assert digests.changed_in(tmp_path) == {}
    (folder / "report.html").write_text("whale")
    assert [*digests.changed_in(tmp_path)] == [folder / "report.html"]


def test_a_job_that_failed_keeps_no_digest_of_what_it_left(tmp_path):
    made = tmp_path / "a.csv"
    made.write_text("half")
    with pytest.raises(ZeroDivisionError), reported(tmp_path / "a.log", [], [made]):
        raise ZeroDivisionError
    assert not digests.place_of(made).exists()


@pytest.mark.skipif(os.name == "nt", reason="Windows cannot ask for a process")
def test_the_draft_of_a_living_process_is_left_and_of_a_dead_one_removed(tmp_path):
    with subprocess.Popen([sys.executable, "-c", "pass"]) as ended:
        pass
    living = tmp_path / f".a.csv.{os.getppid()}.part"
    dead = tmp_path / f".a.csv.{ended.pid}.part"
    for draft in (living, dead):
        draft.touch()
    with whole_file(tmp_path / "a.csv") as draft:
        draft.write_text("1")
    assert living.exists()
    assert not dead.exists()
