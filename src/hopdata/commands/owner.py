"""Who is at work in a folder: a run that was killed is told from one that lives.

Snakemake locks the files of a run but does not say whose lock it is, so the lock of a
killed run stands for ever. Each run therefore leaves a record: host, process, and when
that process began, since the system gives the number of a dead process to another. A
Snakemake that hopdata did not start leaves none, so a lock is removed only if no
Snakemake is at work in the folder.
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
from typing import Any

LOCKS = Path(".snakemake/locks")
RECORDS = Path(".snakemake/hopdata")

#: Time by which the start of a run may seem to move while it lives: a day.
#: Unit: s. Origin: chosen. Where the system does not count from its own start, the
#: start of a process follows the clock, which may be set by hours: by a wrong time
#: zone, or by the network after a wrong battery clock. 1.5 times larger: another
#: process with the number of a killed run is told from it only if they began 1.5 days
#: apart, and until then the lock has to be removed by hand.
_CLOCK_S = 86_400.0

PROC = Path("/proc")


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
    ticks : str
        The same, by the start of the machine and the ticks since then, which no change
        of the clock moves; empty where the system does not tell.
    """

    study: str
    host: str
    pid: int
    began_s: float
    ticks: str = ""

    def __str__(self) -> str:
        since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(self.began_s))
        process = f"process {self.pid} on {self.host}, since {since}"
        return f"the run of '{self.study}' ({process})"

    @property
    def is_here(self) -> bool:
        """Whether the process runs, or ran, on this machine."""
        return self.host == platform.node()

    @property
    def is_dead(self) -> bool:
        """Whether the process has surely ended; that of another machine never has."""
        if not self.is_here:
            return False
        if not _is_alive(self.pid):
            return True
        ticks = ticks_of(self.pid)
        if ticks and self.ticks:
            return ticks != self.ticks
        began = _began(self.pid)
        if began is None:  # it lives, and may be the run
            return False
        return abs(began - self.began_s) > _CLOCK_S


def _is_alive(pid: int) -> bool:
    """Tell whether a process of this machine is alive; one that may not be seen is."""
    import psutil

    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False
    except psutil.AccessDenied:
        return True


def _began(pid: int) -> float | None:
    """Return when a process of this machine began, s since 1970; None if not known."""
    import psutil

    try:
        return float(psutil.Process(pid).create_time())
    except psutil.Error:
        return None


def ticks_of(pid: int) -> str:
    """Return when a process began, by the machine's start; nothing if not known."""
    try:
        boot = (PROC / "sys/kernel/random/boot_id").read_text().strip()
        stat = (PROC / str(pid) / "stat").read_text(errors="replace")
    except OSError:
        return ""
    # The second field is the name in parentheses, which may itself hold spaces and
    # parentheses. The start is field 22, so it is the twentieth after the name.
    after_name = stat.rpartition(")")[2].split()
    if not boot or len(after_name) < 20:
        return ""
    return f"{boot} {after_name[19]}"


@contextmanager
def recorded(study: str, pid: int) -> Iterator[None]:
    """Keep the record of a run while it is at work."""
    record = RECORDS / f"{platform.node()}-{pid}.json"
    alive = _is_alive(pid)
    began = _began(pid)
    if began is None:
        began = time.time()
    with suppress(OSError):  # Snakemake itself complains if a folder is not writable
        if alive:
            RECORDS.mkdir(parents=True, exist_ok=True)
            owner = Owner(study, platform.node(), pid, began, ticks_of(pid))
            record.write_text(json.dumps(asdict(owner)), encoding="utf-8")
    try:
        yield
    finally:
        with suppress(OSError):
            record.unlink()


def owners() -> dict[Path, Owner]:
    """Return the runs that left a record in the current folder, by its file."""
    found = {}
    for record in sorted(RECORDS.glob("*.json")):
        with suppress(OSError, ValueError, TypeError, KeyError):
            content = json.loads(record.read_text(encoding="utf-8"))
            found[record] = Owner(
                study=str(content["study"]),
                host=str(content["host"]),
                pid=int(content["pid"]),
                began_s=float(content["began_s"]),
                # Records of earlier versions have none.
                ticks=str(content.get("ticks", "")),
            )
    return found


def is_locked() -> bool:
    """Tell whether a run has locked files in the current folder."""
    return any(LOCKS.glob("*.lock"))


def lock_is_dead() -> bool:
    """Tell whether the lock of the current folder is known to be that of a killed run.

    It is if hopdata knows of a run, each run that it knows of is dead, and no Snakemake
    that somebody else started is at work here, or may be.
    """
    known = owners().values()
    if not known or not all(owner.is_dead for owner in known):
        return False
    here, perhaps = snakemakes()
    return not here and not perhaps


def snakemakes() -> tuple[list[int], list[int]]:
    """Return the Snakemakes of this machine that work here, and those that perhaps do.

    Returns
    -------
    here : list of int
        Numbers of the processes whose working folder is the current one.
    perhaps : list of int
        Those whose working folder may not be seen, of a user who owns locks here.
    """
    import psutil

    folder = Path.cwd().resolve()
    here = []
    perhaps = []
    for process in psutil.process_iter():
        if process.pid == os.getpid():
            continue
        try:
            if not _runs_snakemake(process):
                continue
            if Path(process.cwd()).resolve() == folder:
                here.append(process.pid)
        except psutil.NoSuchProcess:  # it has just ended
            continue
        except (psutil.AccessDenied, OSError):
            if _may_own_lock(process):
                perhaps.append(process.pid)
    return here, perhaps


def _runs_snakemake(process: Any) -> bool:
    """Tell whether a process is ``snakemake`` or ``python -m snakemake``."""
    import psutil

    try:
        words = process.cmdline()
    except psutil.AccessDenied:  # only its name may be seen
        name = process.name().lower()
        return "snakemake" in name or "python" in name
    if process.status() == psutil.STATUS_ZOMBIE:
        return False
    return any(Path(word).stem == "snakemake" for word in words)


def _may_own_lock(process: Any) -> bool:
    """Tell whether a process may have locked files here: its user owns a lock."""
    import psutil

    try:
        user = process.uids().effective
        return user in {lock.stat().st_uid for lock in LOCKS.glob("*.lock")}
    except psutil.NoSuchProcess:
        return False
    except (psutil.AccessDenied, AttributeError, OSError):
        return True  # not known; Windows has no such numbers


def release_dead() -> str:
    """Remove the lock of a killed run, and its record.

    The lock stays while any run here is alive or may be, since it may be that run's. If
    that is a Snakemake without a record, the records stay too: it may be a job that has
    outlived its killed run, and the lock can be removed after its end.

    Returns
    -------
    str
        What was done; empty if nothing.
    """
    known = owners()
    dead = {record: owner for record, owner in known.items() if owner.is_dead}
    done = ""
    if dead and len(dead) == len(known) and is_locked():
        if not lock_is_dead():
            return ""
        shutil.rmtree(LOCKS, ignore_errors=True)
        killed = " and ".join(map(str, dead.values()))
        anew = "what it left unfinished is made anew"
        done = f"{killed} was killed; its lock is removed, and {anew}"
    for record in dead:
        with suppress(OSError):
            os.unlink(record)
    return done


def who_is_at_work() -> str:
    """Name the runs that may hold the lock of the current folder."""
    alive = [owner for owner in owners().values() if not owner.is_dead]
    elsewhere = [owner for owner in alive if not owner.is_here]
    how = f"if none is at work: rm -r {LOCKS}"
    if alive:
        runs = " and ".join(map(str, alive))
        if elsewhere:
            return f"{runs} is at work here; {how}"
        return f"{runs} is at work here; wait for its end"
    here, perhaps = snakemakes()
    if here:
        numbers = " and ".join(map(str, here))
        return f"Snakemake (process {numbers}) is at work here; wait for its end"
    if perhaps:
        numbers = " and ".join(map(str, perhaps))
        return f"process {numbers} may be a Snakemake that is at work here; {how}"
    return f"a run is at work here that hopdata did not start, or one was killed; {how}"
