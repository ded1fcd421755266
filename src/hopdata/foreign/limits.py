"""What a process that reads something foreign may not do: the hard limits, set once.

Each limit is set where the system has it. Memory and time are also watched from
outside (`hopdata.foreign.watch`), so that a system without limits has those two.
"""

from __future__ import annotations

import math
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from hopdata.foreign.budget import Budget, used_memory

# Address space beyond data: libraries and files that are mapped.
_MAPPED = 1 << 30

# Numbers of Linux's `prctl` and `unshare`.
_SET_DEATH_SIGNAL, _SET_NO_NEW_PRIVILEGES = 1, 38
_NEW_NETWORK, _NEW_USER = 0x40000000, 0x10000000

# Files that a process may open.
_MOST_FILES = 256

# What Python says before it does something (`sys.audit`), and what is refused: the
# network, other programs, changes of files, and pickles.
_REFUSED_ROOMS = ("socket.", "ftplib.", "http.client.", "urllib.", "smtplib.")
_REFUSED = frozenset(
    (
        *("subprocess.Popen", "pty.spawn", "os.system", "os.exec", "os.posix_spawn"),
        *("os.spawn", "os.fork", "os.forkpty", "os.startfile", "os.startfile/2"),
        *("os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.link", "os.symlink"),
        *("os.truncate", "os.chmod", "os.chown", "shutil.rmtree", "shutil.move"),
        "pickle.find_class",
    )
)
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


def confine(folders: Sequence[str]) -> None:
    """Take from this process, for good, all that reading does not need.

    Its search path becomes `folders`; it writes no file, no compiled code and no core,
    opens no socket, starts no program, and loads no pickle. Where the system allows it,
    the process also has a network of its own without any device, and gains no rights.

    Parameters
    ----------
    folders : sequence of str
    """
    sys.path[:] = folders
    sys.dont_write_bytecode = True
    _no_new_rights()
    _no_network()
    _limit("RLIMIT_CORE", 0)
    _limit("RLIMIT_FSIZE", 0)
    _limit("RLIMIT_NOFILE", _MOST_FILES)
    sys.addaudithook(_refuse)


def spend_at_most(budget: Budget, *, for_good: bool) -> None:
    """Limit the CPU time and the memory that this process may take from here on.

    Parameters
    ----------
    budget : Budget
    for_good : bool
        Whether the limits may never be raised again; otherwise the next call may.
    """
    space, data = used_memory()
    if data:  # where it is unknown, the memory is watched from outside
        _limit("RLIMIT_DATA", data + budget.memory, for_good=for_good)
        _limit("RLIMIT_AS", space + budget.memory + _MAPPED, for_good=for_good)
    with suppress(ImportError):
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        until_s = math.ceil(used.ru_utime + used.ru_stime + budget.cpu_s)
        _limit("RLIMIT_CPU", until_s, for_good=for_good)


def own_search_path() -> list[str]:
    """Return Python's search path without the working folder.

    The folder of hopdata itself stays, also if it is the working folder.
    """
    here = os.path.realpath(os.curdir)
    own = os.path.dirname(os.path.dirname(os.path.dirname(__file__)))
    folders = []
    for folder in sys.path:
        if not folder:
            continue
        place = os.path.realpath(folder)
        if place != here or place == os.path.realpath(own):
            folders.append(os.path.abspath(folder))
    return folders


def _limit(name: str, most: int, *, for_good: bool = True) -> None:
    """Set a limit of this process, at most that of its user or batch system."""
    try:
        import resource
    except ImportError:  # Windows
        return
    kind = getattr(resource, name, None)
    if kind is None:
        return
    with suppress(OSError, ValueError):
        _, hard = resource.getrlimit(kind)
        # Of CPU time the first signal tells what happens, and the second ends.
        room = 1 if name == "RLIMIT_CPU" else 0
        if hard != resource.RLIM_INFINITY:
            most = min(most, max(hard - room, 0))
        if for_good:
            hard = most + room
        resource.setrlimit(kind, (most, hard))


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuse what Python is about to do, if reading does not need it."""
    if event == "open":
        path, mode, flags = arguments
        writes = isinstance(flags, int) and flags & _WRITES
        changes = isinstance(mode, str) and set(mode) & set("wax+")
        is_by_name = not isinstance(path, int)  # and no pipe that is open already
        if (writes or changes) and is_by_name and path != os.devnull:
            raise PermissionError(f"expected only to read, found {path} to be written")
        return
    if event in _REFUSED or event.startswith(_REFUSED_ROOMS):
        raise PermissionError(f"expected only to read, found {event}")


def end_with(parent: int) -> None:
    """Have this process killed when its parent ends, or the thread that started it.

    Only Linux can do so; elsewhere nothing is done.

    Parameters
    ----------
    parent : int
        Number of the parent's process, from before this one was started.
    """
    library = _linux_library()
    if library is not None:
        library.prctl(_SET_DEATH_SIGNAL, int(signal.SIGKILL), 0, 0, 0)
        if os.getppid() != parent:  # it has ended before this could be asked for
            os.kill(os.getpid(), signal.SIGKILL)


def _no_new_rights() -> None:
    """Gain no rights by programs."""
    library = _linux_library()
    if library is not None:
        library.prctl(_SET_NO_NEW_PRIVILEGES, 1, 0, 0, 0)


def _no_network() -> None:
    """Leave the network, where the system lets a user do so."""
    library = _linux_library()
    if library is None:
        return
    is_refused = library.unshare(_NEW_NETWORK) != 0
    # In a user space of its own any user may leave. Root would lose there the right to
    # read what belongs to others.
    if is_refused and os.geteuid() != 0:
        library.unshare(_NEW_NETWORK | _NEW_USER)


def _linux_library() -> Any:
    """Return the functions of Linux's C library; None elsewhere, or without it."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        import ctypes

        return ctypes.CDLL(None)
    except (ImportError, OSError):
        return None
