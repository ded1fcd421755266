"""What ended a job that no mistake of the user ended: memory, disk, a missing file.

The same causes are told by an exception, if the job could still say so, and by the text
or the signal that is left if it could not.
"""

import errno
import re
import signal
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")
#: Where the system shows its control groups.
GROUPS = Path("/sys/fs/cgroup")
_AGAIN = "run the same command again"

#: What to do, by cause.
MEMORY = (
    "memory ran out; run it with fewer jobs at once (--cores 1), where more memory is "
    "free, or on a shorter recording"
)
SPACE = "the disk is full; free some space, then run the same command again"
QUOTA = "the quota of disk space is used up; free some, then run the same command again"
FILE_SIZE = "a file may not grow that large here; raise the limit (ulimit -f)"
READ_ONLY = "this place cannot be written; run where it can, or make it writable"
MISSING = "it is missing; bring it back if it is yours, then run the same command again"
FORBIDDEN = "access is denied; change its permissions, then run the same command again"
FAILING = "the disk or the shared folder failed; run the same command again"
NO_PROCESS = (
    "no process could be started, for want of memory or of processes (ulimit -u); run "
    "it with fewer jobs at once (--cores 1), then the same command again"
)
OPEN_FILES = "too many files are open; raise the limit (ulimit -n)"

#: Names of the system's error numbers; Windows lacks some.
_BY_NAME = {
    "ENOMEM": MEMORY,
    "ENOSPC": SPACE,
    "EDQUOT": QUOTA,
    "EFBIG": FILE_SIZE,
    "EROFS": READ_ONLY,
    "ENOENT": MISSING,
    "EACCES": FORBIDDEN,
    "EPERM": FORBIDDEN,
    "EIO": FAILING,
    "ESTALE": FAILING,
    "EMFILE": OPEN_FILES,
    "ENFILE": OPEN_FILES,
}
#: What the system and libraries say where memory is lacking. The second line is what
#: h5py says, and Python where it may not make a thread.
_OF_MEMORY = re.compile(
    r"MemoryError|[Oo]ut of memory|Cannot allocate memory|std::bad_alloc|"
    r"can't allocate|Resource temporarily unavailable|can't start new thread|"
    r"Memory allocation still failed|failed to map segment|"
    r"unable to mmap|[Uu]nable to allocate"
)
#: Texts of the system and of libraries that give a cause away.
_BY_TEXT = (
    (_OF_MEMORY, MEMORY),
    (re.compile("No space left on device|database or disk is full"), SPACE),
    (re.compile("[Qq]uota exceeded"), QUOTA),
    (re.compile("File too large|File size limit"), FILE_SIZE),
    (re.compile("Read-only file system"), READ_ONLY),
    (re.compile("Permission denied"), FORBIDDEN),
    (re.compile("Input/output error|Stale file handle"), FAILING),
    (re.compile("Too many open files"), OPEN_FILES),
)


class ServerEndedError(RuntimeError):
    """The process whose forks the jobs are has ended, before it made one."""

    def __init__(self) -> None:
        super().__init__(
            "expected the process that runs the jobs to live, found that it was ended; "
            "perhaps by the system, for lack of memory"
        )


class NoForkError(OSError):
    """The system allows no further process, for want of memory or of processes."""


def error_number(error: BaseException) -> int | None:
    """Return the system's number of an error; h5py gives it only in its message."""
    in_message = re.search(r"errno = (\d+)", str(error))
    if in_message:
        return int(in_message[1])
    number: int | None = getattr(error, "errno", None)
    return number


def cause_of(error: BaseException) -> str:
    """Say what ended a job and what to do, by its exception; empty if not known."""
    if isinstance(error, MemoryError):
        return MEMORY
    if not isinstance(error, (OSError, RuntimeError, ImportError)):
        return ""
    number = error_number(error)
    if number is None:
        return cause_in(str(error))
    cause = _BY_NAME.get(errno.errorcode.get(number, ""), "")
    place = getattr(error, "filename", None)
    if cause and place:
        return f"{place}: {cause}"
    if cause and number in (errno.ENOENT, errno.EACCES, errno.EPERM):
        return f"{error}: {cause}"
    return cause


def cause_in(text: str) -> str:
    """Say what ended a job and what to do, by what was said; empty if not known."""
    for pattern, cause in _BY_TEXT:
        if pattern.search(text):
            return cause
    return ""


def tells_of_memory(text: str) -> bool:
    """Tell whether what was said means that memory was lacking."""
    return _OF_MEMORY.search(text) is not None


def signal_name(number: int) -> str:
    """Return the name of a signal, as ``SIGKILL``; its number if it has none here."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


@dataclass(frozen=True)
class OomKills:
    """How many processes the system has killed since memory ran out.

    Attributes
    ----------
    on_machine
        All of them; None if the system does not tell, as only Linux does.
    in_group
        Those of the control group of this process; None if that may not be read.
    group
        The file with the count of the group.
    """

    on_machine: int | None
    in_group: int | None = None
    group: Path | None = None


def oom_kills() -> OomKills:
    """Count the processes that this system has killed since memory ran out."""
    on_machine = _counted(PROC / "vmstat")
    group = _group_file()
    if group is None:
        return OomKills(on_machine)
    in_group = _counted(group)
    if in_group is None:
        return OomKills(on_machine)
    return OomKills(on_machine, in_group, group)


def _counted(file: Path) -> int | None:
    """Return the number behind ``oom_kill`` in a file of the system."""
    try:
        for line in file.read_text(encoding="ascii").splitlines():
            name, _, number = line.partition(" ")
            if name == "oom_kill":
                return int(number)
    except (OSError, ValueError):
        return None
    return None


def _group_file() -> Path | None:
    """Return where the kills in the control group of this process are counted.

    The second version of the groups counts those of groups within it too. The first
    does not, and its outermost group holds what nobody has put into another.
    """
    try:
        lines = (PROC / "self/cgroup").read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return None
    file = None
    for line in lines:
        parts = line.split(":", 2)
        if len(parts) < 3:
            continue
        _, controllers, place = parts
        if "memory" in controllers.split(",") and place != "/":
            return GROUPS / "memory" / place.lstrip("/") / "memory.oom_control"
        if not controllers:
            file = GROUPS / place.lstrip("/") / "memory.events"
    return file


def killed_told(before: OomKills | None) -> str:
    """Say what ended a process by SIGKILL, and what to do.

    Parameters
    ----------
    before
        `oom_kills` before the process began.
    """
    now = oom_kills()
    if before is not None:
        is_same_group = now.group is not None and now.group == before.group
        if is_same_group and _is_more(now.in_group, before.in_group):
            return f"the system killed it: {MEMORY}"
        # The group of both tells that it was another's process; without it, or in
        # another group, it may have been this one.
        if not is_same_group and _is_more(now.on_machine, before.on_machine):
            return f"the system has killed a process, perhaps this one: {MEMORY}"
    return (
        "it was killed (SIGKILL) by a person, by a limit of time, or since memory "
        f"ran out; {_AGAIN}, with --cores 1 if memory is short"
    )


def _is_more(now: int | None, before: int | None) -> bool:
    return now is not None and before is not None and now > before


def signal_told(number: int, *, oom_before: OomKills | None) -> str:
    """Say what a signal that ended a process means, and what to do.

    Parameters
    ----------
    number
        Of the signal.
    oom_before
        `oom_kills` before the process began.
    """
    name = signal_name(number)
    if name == "SIGKILL":
        return killed_told(oom_before)
    if name in {"SIGTERM", "SIGINT", "SIGHUP"}:
        return f"it was ended from outside ({name}); {_AGAIN}"
    if name == "SIGXCPU":
        return f"its limit of CPU time is used up ({name}; ulimit -t); raise it"
    if name == "SIGXFSZ":
        return FILE_SIZE
    if name in {"SIGABRT", "SIGSEGV", "SIGBUS", "SIGILL", "SIGFPE"}:
        return (
            f"it crashed ({name}), which a lack of memory, a full disk or a damaged "
            f"installation may cause; {_AGAIN}, with --cores 1 if memory is short"
        )
    return f"it was ended by {name}; {_AGAIN}"
