"""Who is at work in a folder: a run that was killed is told from one that lives.

Snakemake locks the files of a run but does not say whose lock it is, so the lock of a killed
run stands for ever. Each run therefore leaves a record: host, process, and when that process
began, since the system gives the number of a dead process to another.
"""

import json
import os
import platform
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

LOCKS = Path(".snakemake/locks")
RECORDS = Path(".snakemake/hopdata")
# s; the start of a process is known to 0.01 s, but follows the clock where that is set. 1.5 times
# larger: no difference, since numbers of processes come round after hours.
_CLOCK_S = 2.0


@dataclass(frozen=True)
class Owner:
    """A run of Snakemake.

    Parameters
    ----------
    study : str
    host : str
        Name of the machine.
    pid : int
        Number of Snakemake's process there.
    began_s : float
        When this process began, s since 1970.
    """

    study: str
    host: str
    pid: int
    began_s: float

    def __str__(self) -> str:
        since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(self.began_s))
        return f"the run of '{self.study}' (process {self.pid} on {self.host}, since {since})"

    @property
    def is_here(self) -> bool:
        """Whether the process runs, or ran, on this machine."""
        return self.host == platform.node()

    @property
    def is_dead(self) -> bool:
        """Whether the process is known to have ended; that of another machine never is."""
        if not self.is_here:
            return False
        began = _began(self.pid)
        return began is None or abs(began - self.began_s) > _CLOCK_S


def _began(pid: int) -> float | None:
    """Return when a process of this machine began, s since 1970; None if there is none."""
    import psutil

    try:
        process = psutil.Process(pid)
        if process.status() == psutil.STATUS_ZOMBIE:
            return None
        return float(process.create_time())
    except psutil.NoSuchProcess:
        return None
    except psutil.AccessDenied:  # another user's: it lives, and cannot be told from its start
        return time.time()


@contextmanager
def recorded(study: str, pid: int) -> Iterator[None]:
    """Keep the record of a run while it is at work."""
    record = RECORDS / f"{platform.node()}-{pid}.json"
    began = _began(pid)
    with suppress(OSError):  # Snakemake itself complains if a folder is not writable
        if began is not None:
            RECORDS.mkdir(parents=True, exist_ok=True)
            owner = Owner(study, platform.node(), pid, began)
            record.write_text(json.dumps(asdict(owner)), encoding="utf-8")
    try:
        yield
    finally:
        with suppress(OSError):
            record.unlink()


def owners() -> dict[Path, Owner]:
    """Return the runs that left a record in the current folder, by the record's file."""
    found = {}
    for record in sorted(RECORDS.glob("*.json")):
        with suppress(OSError, ValueError, TypeError, KeyError):
            content = json.loads(record.read_text(encoding="utf-8"))
            found[record] = Owner(
                str(content["study"]),
                str(content["host"]),
                int(content["pid"]),
                float(content["began_s"]),
            )
    return found


def is_locked() -> bool:
    """Tell whether a run has locked files in the current folder."""
    return any(LOCKS.glob("*.lock"))


def release_dead() -> str:
    """Remove the lock of a killed run, and its record; return what was done, or nothing.

    The lock stays while any run here is alive or may be, since it may be that run's.
    """
    known = owners()
    dead = {record: owner for record, owner in known.items() if owner.is_dead}
    told = ""
    if dead and len(dead) == len(known) and is_locked():
        shutil.rmtree(LOCKS, ignore_errors=True)
        killed = " and ".join(map(str, dead.values()))
        told = f"{killed} was killed; its lock is removed, and what it left unfinished is made anew"
    for record in dead:
        with suppress(OSError):
            os.unlink(record)
    return told


def who_is_at_work() -> str:
    """Name the runs that may hold the lock of the current folder."""
    alive = [owner for owner in owners().values() if not owner.is_dead]
    elsewhere = [owner for owner in alive if not owner.is_here]
    how = f"if none is at work: rm -r {LOCKS}"
    if not alive:
        return f"a run is at work here that hopdata did not start, or one was killed; {how}"
    told = " and ".join(map(str, alive))
    return f"{told} is at work here" + (f"; {how}" if elsewhere else "; wait for its end")
