"""What may be spent follows from the size of what is read and from what is free."""

import sys

import pytest

from hopdata.foreign import budget
from hopdata.foreign.budget import budget_for

PLENTY = 10**15


def test_a_small_file_may_ask_for_a_gigabyte():
    found = budget_for(0, PLENTY)
    assert found.memory == 1_000_000_000
    assert not found.is_short
    assert found == budget_for(12_000, PLENTY).__class__(
        0, found.unpacked, found.memory, found.cpu_s, found.wall_s, False
    )


def test_all_grows_with_the_size():
    small, large = budget_for(10**6, PLENTY), budget_for(10**9, PLENTY)
    assert large.unpacked == 50 * 10**9
    assert large.memory > 3 * large.unpacked
    assert large.cpu_s > 100 * small.cpu_s
    assert large.wall_s > large.cpu_s


def test_ten_million_frames_fit_where_they_are_packed():
    """Deflated positions of seven markers take a half of their 1.68 GB or more."""
    positions = 10_000_000 * 7 * 3 * 8
    assert budget_for(positions // 2, PLENTY).unpacked > 5 * positions


def test_free_memory_bounds_all():
    found = budget_for(10**9, 10**9)
    assert found.memory == 600_000_000
    assert found.unpacked == 600_000_000
    assert found.is_short


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="groups of Linux")
@pytest.mark.parametrize(
    ("line", "folder", "most", "used", "cached"),
    [
        ("0::/job/7", "fs/cgroup/job/7", "memory.max", "memory.current", "inactive"),
        (
            "4:memory:/job/7",
            "fs/cgroup/memory/job/7",
            "memory.limit_in_bytes",
            "memory.usage_in_bytes",
            "total_inactive",
        ),
        ("0::/outside", "fs/cgroup", "memory.max", "memory.current", "inactive"),
    ],
)
def test_the_limit_of_a_container_or_a_batch_job_counts(
    tmp_path, line, folder, most, used, cached
):
    proc, sys_ = tmp_path / "proc", tmp_path / "sys"
    (proc / "self").mkdir(parents=True)
    (proc / "self/cgroup").write_text(f"8:pids:/\n{line}\n")
    group = sys_ / folder
    group.mkdir(parents=True)
    (group / most).write_text("5000\n")
    (group / used).write_text("2000\n")
    assert budget._left_in_groups(proc, sys_) == [3000]
    (group / "memory.stat").write_text(f"anon 1\n{cached}_file 500\n")
    assert budget._left_in_groups(proc, sys_) == [3500]
    (group / most).write_text("max\n")
    assert budget._left_in_groups(proc, sys_) == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="groups of Linux")
@pytest.mark.parametrize(
    ("line", "root", "most", "used"),
    [
        ("0::/job/7/task", "fs/cgroup", "memory.max", "memory.current"),
        (
            "4:memory:/job/7/task",
            "fs/cgroup/memory",
            "memory.limit_in_bytes",
            "memory.usage_in_bytes",
        ),
    ],
)
def test_the_limit_of_a_job_counts_for_its_tasks(tmp_path, line, root, most, used):
    proc, sys_ = tmp_path / "proc", tmp_path / "sys"
    (proc / "self").mkdir(parents=True)
    (proc / "self/cgroup").write_text(f"{line}\n")
    job = sys_ / root / "job/7"
    (job / "task").mkdir(parents=True)
    (job / "task" / most).write_text("max\n")
    (job / "task" / used).write_text("1000\n")
    assert budget._left_in_groups(proc, sys_) == []
    (job / most).write_text("5000\n")
    (job / used).write_text("2000\n")
    # The job is charged for the cached files of its tasks, too.
    (job / "memory.stat").write_text("inactive_file 0\ntotal_inactive_file 700\n")
    assert budget._left_in_groups(proc, sys_) == [3700]


def test_the_limits_of_the_user_count():
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_AS)
    space, _ = budget.used_memory()
    if not space:
        pytest.skip("this system does not say what a process uses")
    resource.setrlimit(resource.RLIMIT_AS, (space + 10**9, before[1]))
    try:
        assert 0.5e9 < budget.free_memory() < 1.2e9
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
