"""What may be spent on something foreign, from its size and the machine's free memory.

A file is a claim: a few bytes can ask for gigabytes or for ever. So memory, time and
the size of what comes back follow from the number of bytes that are there and from what
the machine has left. Nobody has to choose them.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

#: Memory that the numbers of any file may take, however small it is.
#: Unit: bytes. Origin: derived: with COPIES and OWN_MEMORY a small file can ask for
#: 1 GB.
LEAST_UNPACKED = 250_000_000

#: Memory of the numbers for each byte of a larger file.
#: Unit: 1. Origin: chosen. Deflated positions take two to four times their bytes; an
#: export in which trajectories are seen in a few per cent of the frames takes some
#: forty times.
MOST_PER_BYTE = 50

#: Copies of the numbers that a library and a reader may hold at a time.
#: Unit: 1. Origin: chosen.
COPIES = 3

#: Memory of the process that reads beside that: the libraries' own, once they work.
#: Unit: bytes. Origin: chosen.
OWN_MEMORY = 250_000_000

#: Part of the free memory that one file may take.
#: Unit: 1. Origin: chosen.
SHARE_OF_FREE = 0.6

#: CPU time for anything, however small.
#: Unit: s. Origin: chosen. A plugin has to import what it needs, too. 1.5 times larger:
#: 1.5 times the wait for the answer about a file on which a library hangs.
LEAST_S = 3.0

#: Bytes that are read in a second at least.
#: Unit: 1/s. Origin: measured: a workbook of Excel with rounded numbers, the slowest of
#: all formats, takes 1.2 s a MB on one core of 2024; this is a sixth of that speed.
BYTES_PER_S = 1.5e5

#: Wall-clock time over CPU time.
#: Unit: 1. Origin: chosen. A shared or slow machine gives a process a part of its time.
WALL_PER_CPU = 20

#: Wall-clock time in which a process that reads may sleep without any work.
#: Unit: s. Origin: chosen.
LONGEST_SLEEP_S = 8.0

# Bytes of the head of a reply: all names, remarks and events of a file.
MOST_HEAD = 32_000_000

# Levels of the lists and tables in the head.
DEEPEST = 32

# Characters of somebody else's error that are told.
MOST_WORDS = 500


@dataclass(frozen=True)
class Budget:
    """What may be spent on something of a known size.

    Attributes
    ----------
    n_bytes
        Its size, bytes.
    unpacked
        Memory that its numbers may take, and the arrays that come back, bytes.
    memory
        Memory that the process may take beyond what it begins with, bytes.
    cpu_s, wall_s
        CPU and wall-clock time that the process may take, s.
    is_short
        Whether free memory, and not the size, sets the limit.
    """

    n_bytes: int
    unpacked: int
    memory: int
    cpu_s: float
    wall_s: float
    is_short: bool


def budget_for(n_bytes: int, free: int | None = None) -> Budget:
    """Return what may be spent on something of `n_bytes` bytes.

    Parameters
    ----------
    n_bytes : int
        Its size, bytes.
    free : int, optional
        Memory that is free, bytes; by default that of the machine (`free_memory`).
    """
    if free is None:
        free = free_memory()
    most = int(SHARE_OF_FREE * free)
    unpacked = unpacked_most(n_bytes)
    memory = OWN_MEMORY + COPIES * unpacked
    is_short = memory > most
    if is_short:
        memory = most
        unpacked = min(unpacked, most)
    cpu_s = LEAST_S + n_bytes / BYTES_PER_S
    return Budget(n_bytes, unpacked, memory, cpu_s, WALL_PER_CPU * cpu_s, is_short)


def unpacked_most(n_bytes: int) -> int:
    """Return the memory that the numbers of a file of `n_bytes` may take, bytes."""
    return max(LEAST_UNPACKED, MOST_PER_BYTE * n_bytes)


def free_memory() -> int:
    """Return the memory that this process can still have, bytes.

    The least of what the machine, a control group (a container or a batch job) and the
    limits of the user leave.
    """
    import psutil

    left = [int(psutil.virtual_memory().available)]
    left += _left_in_groups()
    left += _left_to_user()
    return max(min(left), 0)


def _left_in_groups(proc: Path = Path("/proc"), sys: Path = Path("/sys")) -> list[int]:
    """Return what the control groups of this process leave, bytes, in any version."""
    left = []
    with suppress(OSError):
        for line in (proc / "self/cgroup").read_text().splitlines():
            _, kinds, name = line.split(":", 2)
            if kinds == "":
                root = sys / "fs/cgroup"
                files = ("memory.max", "memory.current")
            elif "memory" in kinds.split(","):
                root = sys / "fs/cgroup/memory"
                files = ("memory.limit_in_bytes", "memory.usage_in_bytes")
            else:
                continue
            for folder in _groups_about(root, name):
                with suppress(OSError, ValueError):
                    most = int((folder / files[0]).read_text())
                    used = int((folder / files[1]).read_text())
                    left.append(most - used + _reclaimable(folder))
    return left


def _groups_about(root: Path, name: str) -> list[Path]:
    """Return the folders of a control group and of those that hold it, up to the root.

    A batch system may limit the job, and run each of its tasks in a group below it that
    has no limit of its own. In a container the name may be that outside; its own group
    is then the root.
    """
    own = root / name.lstrip("/")
    return [own, *(place for place in own.parents if place.is_relative_to(root))]


def _reclaimable(folder: Path) -> int:
    """Return the bytes of cached files that a control group would give up.

    With those of the groups that it holds, where it tells both: it is charged for them.
    """
    found = {}
    with suppress(OSError, ValueError):
        for line in (folder / "memory.stat").read_text().splitlines():
            key, _, value = line.partition(" ")
            if key in ("inactive_file", "total_inactive_file"):
                found[key] = int(value)
    return max(found.values(), default=0)


def _left_to_user() -> list[int]:
    """Return what the limits of the user leave of address space and data, bytes."""
    try:
        import resource
    except ImportError:  # Windows
        return []
    left = []
    space, data = used_memory()
    for kind, used in ((resource.RLIMIT_AS, space), (resource.RLIMIT_DATA, data)):
        soft, _ = resource.getrlimit(kind)
        if soft != resource.RLIM_INFINITY:
            left.append(soft - used)
    return left


def used_memory() -> tuple[int, int]:
    """Return address space and data of this process, bytes; 0 where unknown."""
    try:
        import resource

        pages = Path("/proc/self/statm").read_text().split()
    except (ImportError, OSError):
        return 0, 0
    size = resource.getpagesize()
    return int(pages[0]) * size, int(pages[5]) * size
