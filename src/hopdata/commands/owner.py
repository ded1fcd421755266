"""Who is at work in a folder: a run that was killed is told from one that lives.

Snakemake locks the files of a run but does not say whose lock it is, so the lock of a
killed run stands for ever. Each run therefore leaves a record: host, process, and when
that process began, since the system gives the number of a dead process to another. A
Snakemake that hopdata did not start leaves none, so a lock is removed only if no
Snakemake is at work in the folder.

The Snakefile calls `begin` before Snakemake looks at its lock, and `begun` once the run
has locked its files. Between the two no other run can begin here, nor take a lock over.
A take-over may itself be killed: the record of the dead run goes last, so that the next
run finds it and does the rest.
"""

import atexit
import json
import os
import platform
import shlex
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

from hopdata.foreign.limits import end_with

_Result = TypeVar("_Result")

LOCKS = Path(".snakemake/locks")
RECORDS = Path(".snakemake/hopdata")

#: Time by which the start of a run may seem to move while it lives: a day.
#: Unit: s. Origin: chosen. Where the system does not count from its own start, the
#: start of a process follows the clock, which may be set by hours: by a wrong time
#: zone, or by the network after a wrong battery clock. 1.5 times larger: another
#: process with the number of a killed run is told from it only if they began 1.5 days
#: apart, and until then the lock has to be removed by hand.
_CLOCK_S = 86_400.0

#: Longest wait for another run that is about to begin here.
#: Unit: s. Origin: chosen. The other plans its jobs meanwhile: 10,000 subjects take
#: less. A run inside a job of the other would wait for it for ever. 1.5 times larger:
#: such a run begins half a minute later.
_BEGINNING_S = 60.0

#: Time in which jobs of a killed run must end once they are asked to.
#: Unit: s. Origin: chosen. They do nothing at their end, so the system needs some ms.
#: 1.5 times larger: a job that does not end is killed 1.5 times later.
_ENDING_S = 5.0

PROC = Path("/proc")
BEGINNING = RECORDS / "beginning"  # locked by a run that begins
SCRIPTS = Path(".snakemake/scripts")  # Snakemake's copies of scripts, one a job
#: Set by `hopdata run` for its Snakemake to its own number: it tells itself who holds a
#: lock.
STARTED_BY_HOPDATA = "HOPDATA_RUN"
#: Options with which Snakemake only says what it would do.
DRY = {"-n", "--dry-run", "--dryrun"}
#: Options with which Snakemake runs no jobs.
_NO_JOBS = DRY | {
    *("--unlock", "--lint", "--summary", "-S", "--detailed-summary", "-D", "--dag"),
    *("--rulegraph", "--filegraph", "--d3dag", "--list", "--list-rules", "-l"),
    *("--list-target-rules", "--lt", "--cleanup-metadata", "--touch", "-t"),
    *("--list-input-changes", "--li", "--list-code-changes", "--lc"),
    *("--list-params-changes", "--lp", "--archive", "--report", "--containerize"),
    *("--generate-unit-tests", "--delete-all-output", "--print-compilation"),
}
#: Snakemake's short options without a value, after which another may follow: ``-np``.
_WITHOUT_VALUE = "DFSafhklnptv"
#: How often locks are read, or written, that others remove meanwhile. Each further time
#: takes another run that ends in the same instant.
_TRIES = 20


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


# The record of a run.


@contextmanager
def recorded(study: str, pid: int) -> Iterator[None]:
    """Keep the record of a run while it is at work."""
    record = _write_record(study, pid)
    try:
        yield
    finally:
        with suppress(OSError):
            record.unlink()


def _write_record(study: str, pid: int) -> Path:
    """Write the record of a process that is alive, and return its file.

    On a full disk the file is there but empty; its name still tells host and process.
    """
    record = RECORDS / f"{platform.node()}-{pid}.json"
    began = _began(pid)
    if began is None:
        began = time.time()
    with suppress(OSError):  # Snakemake itself complains if a folder is not writable
        if _is_alive(pid):
            RECORDS.mkdir(parents=True, exist_ok=True)
            owner = Owner(study, platform.node(), pid, began, ticks_of(pid))
            record.write_text(json.dumps(asdict(owner)), encoding="utf-8")
    return record


def owners() -> dict[Path, Owner]:
    """Return the runs that left a record in the current folder, by its file."""
    found = {}
    for record in sorted(RECORDS.glob("*.json")):
        try:
            found[record] = _read_record(record)
        except (OSError, ValueError, TypeError, KeyError):
            named = _named_by(record)
            if named is not None:
                found[record] = named
    return found


def _read_record(record: Path) -> Owner:
    content = json.loads(record.read_text(encoding="utf-8"))
    return Owner(
        study=str(content["study"]),
        host=str(content["host"]),
        pid=int(content["pid"]),
        began_s=float(content["began_s"]),
        # Records of earlier versions have none.
        ticks=str(content.get("ticks", "")),
    )


def _named_by(record: Path) -> Owner | None:
    """Return the run that the name of a damaged record tells; None if it tells none."""
    host, _, number = record.stem.rpartition("-")
    if not host or not number.isdigit():
        return None
    try:
        written_s = record.stat().st_mtime
    except OSError:
        return None
    return Owner("a study", host, int(number), written_s)


# The beginning of a run.


def options_of(words: Iterable[str]) -> set[str]:
    """Return the options on Snakemake's command line: ``-np`` is ``-n`` and ``-p``.

    Values and targets among the words are returned as they are. An abbreviation, such
    as ``--dry``, also gives the options without jobs that it may stand for: Snakemake
    refuses one that may stand for others as well.
    """
    found = set()
    for word in words:
        found.add(word)
        if word.startswith("--"):
            found |= _abbreviated(word)
        if not word.startswith("-") or word.startswith("--"):
            continue
        for letter in word[1:]:
            found.add(f"-{letter}")
            if letter not in _WITHOUT_VALUE:
                break  # what follows is its value
    return found


def _abbreviated(word: str) -> set[str]:
    """Return the long options without jobs that a word begins."""
    beginning = word.partition("=")[0]
    if beginning == "--":
        return set()
    return {option for option in _NO_JOBS if option.startswith(beginning)}


#: What this process holds while it begins: the open file that it has locked.
_held: list[Any] = []
#: Whether this process has begun a run; a Snakefile may be read more than once.
_begun: list[str] = []


def begin(study: str, argv: Iterable[str]) -> bool:
    """Record this process as a run of `study`, and take over the lock of a dead one.

    Say in one line what was found. Nothing is done if Snakemake runs no jobs, and at
    every call but the first. Other runs that begin here wait until `begun`.

    Parameters
    ----------
    study : str
    argv : iterable of str
        Snakemake's command line.

    Returns
    -------
    bool
        Whether this run is the only one here, and will run jobs.
    """
    words = [*argv]
    if _NO_JOBS & options_of(words):
        return False
    if _begun:
        return not is_locked()
    _begun.append(study)
    _end_with_hopdata()
    _hold_beginning()
    pid = os.getpid()
    record = _write_record(study, pid)
    atexit.register(_remove_own, record, pid)
    told = release_dead(apart_from=record)
    if not told and is_locked():
        told = _locked(words, record)
    if told:
        print(f"hopdata: {told}", file=sys.stderr, flush=True)
    return not is_locked()


def _end_with_hopdata() -> None:
    """End this Snakemake when the `hopdata run` that has started it is killed.

    Nobody would hear what it says, and the same command would be refused until it has
    ended by itself. Its lock stays, so the next run tells whose it was.
    """
    parent = os.getppid()
    # A Snakemake that runs within a job of that run has another parent.
    if os.environ.get(STARTED_BY_HOPDATA) == str(parent):
        end_with(parent)


def begun() -> None:
    """Let other runs begin: this one has locked its files."""
    while _held:
        _held.pop().close()


def _remove_own(record: Path, pid: int) -> None:
    """Remove a record at the end of its process, not at that of a fork of it."""
    if os.getpid() == pid:
        with suppress(OSError):
            record.unlink()


def _hold_beginning() -> None:
    """Wait until no other run is about to begin here, and keep others from it.

    The system ends this when the process ends, however it does. Without locks (Windows,
    some file servers) runs do not wait for one another.
    """
    with suppress(ImportError, OSError):
        import fcntl

        RECORDS.mkdir(parents=True, exist_ok=True)
        file = BEGINNING.open("a")
        _held.append(file)
        until = time.monotonic() + _BEGINNING_S
        while time.monotonic() < until:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                time.sleep(0.05)
            else:
                return


@contextmanager
def _none_begins() -> Iterator[None]:
    """Keep runs from beginning while it is decided whether one of them is dead."""
    if _held or not RECORDS.exists():
        yield
        return
    _hold_beginning()
    try:
        yield
    finally:
        begun()


def _locked(words: list[str], own: Path) -> str:
    """Tell the user of a plain Snakemake who holds the lock, and how to remove it.

    `hopdata run` tells this itself. Snakemake refuses a locked folder without a word on
    the command that unlocks it, but only if the locked files are its own.
    """
    if os.environ.get(STARTED_BY_HOPDATA):
        return ""
    others = [run for record, run in owners().items() if record != own]
    living = [run for run in others if run.is_here and not run.is_dead]
    if living:
        return f"{LOCKS}: {_at_work(living)}; wait for its end"
    program = words[:1]
    if words[0].endswith("__main__.py"):
        program = [sys.executable, "-m", "snakemake"]
    unlock = shlex.join([*program, *words[1:], "--unlock"])
    return (
        f"{LOCKS}: another run is active in this folder, or one was killed; if "
        "Snakemake refuses to start and no other run is active, unlock the folder: "
        f"{unlock}"
    )


# The lock.


def keep_locks_of_others(persistence: Any) -> None:
    """Have Snakemake remove its own locks at its end, and no others.

    Snakemake 9.27 removes the folder of all locks; 9.14 does not. Another run that
    locks its files in that moment ends in a traceback, or is at work without a lock.

    Parameters
    ----------
    persistence : type
        Snakemake's class of what it keeps in files; it is changed. Its ``--unlock``
        still removes all locks.
    """
    remove_all = persistence._delete_locks
    if remove_all.__module__ == __name__:  # a Snakefile may be included twice
        return
    read = persistence._read_locks
    write = persistence._write_locks

    def remove_own(self: Any) -> None:
        for lock in self._lockfile.values():
            Path(lock).unlink(missing_ok=True)
        self._lockfile.clear()

    def read_those_that_stay(self: Any) -> list[tuple[str, str]]:
        return _unless_removed(lambda: [*read(self)])

    def write_again(self: Any, kind: str, files: Iterable[str]) -> None:
        listed = [*files]

        def once() -> None:
            os.makedirs(self._lockdir, exist_ok=True)
            write(self, kind, listed)

        _unless_removed(once)

    persistence._delete_locks = remove_own
    persistence.cleanup_locks = remove_all
    persistence._read_locks = read_those_that_stay
    persistence._write_locks = write_again


def _unless_removed(do: Callable[[], _Result]) -> _Result:
    """Do something with locks, again if a run that ends removes them meanwhile."""
    for _ in range(_TRIES - 1):
        with suppress(FileNotFoundError):
            return do()
    return do()


def is_locked() -> bool:
    """Tell whether a run has locked files in the current folder."""
    return any(LOCKS.glob("*.lock"))


def lock_is_dead() -> bool:
    """Tell whether the lock of the current folder is known to be that of a killed run.

    It is if hopdata knows of a run, each run that it knows of is dead, and no Snakemake
    that somebody else started is at work here, or may be.
    """
    return _none_at_work(owners().values())


def _none_at_work(known: Iterable[Owner]) -> bool:
    """Tell whether all runs that left a record are dead, and no other is here."""
    runs = [*known]
    if not runs or not all(owner.is_dead for owner in runs):
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
    if not words or process.status() == psutil.STATUS_ZOMBIE:
        return False
    program = Path(words[0])
    # Others, such as `timeout 60 snakemake`, only start one.
    if program.stem != "snakemake" and "python" not in program.name.lower():
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


def release_dead(apart_from: Path | None = None) -> str:
    """Remove the lock of a killed run, its record, and what it was about to write.

    The lock stays while any run here is alive or may be, since it may be that run's. If
    that is a Snakemake without a record, the records stay too: it may be a job that has
    outlived its killed run, and the lock can be removed after its end. Jobs of the
    killed run that are still at work are ended, since they write the same files.

    Parameters
    ----------
    apart_from : Path, optional
        Record of a run that does not count: the caller's own.

    Returns
    -------
    str
        What was done; empty if nothing.
    """
    with _none_begins():
        known = owners()
        known.pop(apart_from, None)  # type: ignore[arg-type]
        dead = {record: owner for record, owner in known.items() if owner.is_dead}
        done = ""
        if dead and len(dead) == len(known) and is_locked():
            if not _none_at_work(known.values()):
                return ""
            was = "was" if len(dead) == 1 else "were"
            done = f"{_names(dead.values())} {was} killed; {_take()}"
        for record in dead:
            with suppress(OSError):
                os.unlink(record)
    return done


def may_be_taken() -> bool:
    """Tell whether there is a lock, of no run that is known to live on this machine."""
    if not is_locked():
        return False
    if any(one.is_here and not one.is_dead for one in owners().values()):
        return False
    here, _ = snakemakes()
    return not here


def take_over() -> str:
    """Remove a lock at the user's word: of a run elsewhere, or of nobody knows whom.

    A run that is known to be at work on this machine keeps it.

    Returns
    -------
    str
        What was done; empty if nothing.
    """
    with _none_begins():
        if not may_be_taken():
            return ""
        known = owners()
        done = f"as asked, {_names(known.values())} counts as dead; {_take()}"
        for record in known:
            with suppress(OSError):
                os.unlink(record)
    return done


def _names(runs: Iterable[Owner]) -> str:
    return " and ".join(map(str, runs)) or "a run that is not known"


def _at_work(runs: Sequence[Owner]) -> str:
    """Say that runs are at work here."""
    verb = "is" if len(runs) == 1 else "are"
    return f"{_names(runs)} {verb} at work here"


def _take() -> str:
    """End what is left of a dead run, remove its drafts, then its lock; say so."""
    n_ended = _end_jobs()
    _remove_drafts()
    shutil.rmtree(LOCKS, ignore_errors=True)
    jobs = ""
    if n_ended == 1:
        jobs = "a job that it left is ended, "
    elif n_ended:
        jobs = f"{n_ended} jobs that it left are ended, "
    anew = "what it left unfinished is made anew"
    return f"its lock is removed, {jobs}and {anew}"


def _end_jobs() -> int:
    """End jobs here whose Snakemake is dead; return how many there were."""
    import psutil

    scripts = SCRIPTS.resolve()
    jobs = []
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError, IndexError):
            # Forks of a server (`hopdata.forks`) end with it, and it with Snakemake.
            folder = Path(process.cmdline()[-1]).parent
            # Names first: the disk is not asked about the words of all processes.
            if folder.name == scripts.name and folder.resolve() == scripts:
                process.terminate()
                jobs.append(process)
    _, living = psutil.wait_procs(jobs, timeout=_ENDING_S)
    for process in living:
        with suppress(psutil.Error):
            process.kill()
    psutil.wait_procs(living, timeout=_ENDING_S)
    return len(jobs)


def _remove_drafts() -> None:
    """Remove temporary files beside the files that a dead run had locked."""
    folders = set()
    for lock in LOCKS.glob("*.output.lock"):
        with suppress(OSError):
            lines = lock.read_text(encoding="utf-8", errors="replace").splitlines()
            folders |= {Path(line).parent for line in lines}
    for folder in folders:
        for draft in folder.glob(".*.part"):
            with suppress(OSError):
                draft.unlink()


def wait_for_others(seconds: float = float("inf")) -> None:
    """Wait until no files are locked here; take over the lock of a run that dies.

    Parameters
    ----------
    seconds
        Longest wait.
    """
    until = time.monotonic() + seconds
    while is_locked() and time.monotonic() < until:
        told = release_dead()
        if told:
            print(f"hopdata: {told}", file=sys.stderr, flush=True)
            return
        time.sleep(min(1.0, seconds))


def who_is_at_work() -> str:
    """Name the runs that may hold the lock of the current folder."""
    alive = [owner for owner in owners().values() if not owner.is_dead]
    elsewhere = [owner for owner in alive if not owner.is_here]
    how = f"if none is at work: hopdata run --if-locked take, or rm -r {LOCKS}"
    if alive:
        if elsewhere:
            return f"{_at_work(alive)}; {how}"
        return f"{_at_work(alive)}; wait for its end"
    here, perhaps = snakemakes()
    if here:
        numbers = " and ".join(map(str, here))
        return f"Snakemake (process {numbers}) is at work here; wait for its end"
    if perhaps:
        numbers = " and ".join(map(str, perhaps))
        return f"process {numbers} may be a Snakemake that is at work here; {how}"
    return f"a run is at work here that hopdata did not start, or one was killed; {how}"
