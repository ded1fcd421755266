"""A trial of HDF5 files without a seal, since the library may never answer.

On a damaged file the HDF5 library may run for ever or end the process, and neither can
be stopped from within. So a child process first reads the whole file, with limits on
its time and memory that follow from the file's size. Files that hopdata has sealed need
no trial.

The child serves one file after another, so it costs some 0.3 s once and little for each
further file. It ends with this process. Where no child can be started, or it cannot
import hopdata, files are read without a trial: that says nothing about a file.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import hopdata
from hopdata.arrays import h5py
from hopdata.errors import RecordingError
from hopdata.recordings.budget import DEFLATE_MOST, seconds_to_read
from hopdata.recordings.readers import hdf5_checks

#: Wall-clock time of a trial over its CPU time.
#: Unit: 1. Origin: chosen. A shared or slow machine gives a process a part of its time,
#: and where CPU time cannot be limited this is the only limit. 1.5 times larger: a hang
#: that takes no CPU time is told 1.5 times later.
_WALL_PER_CPU = 20

#: Copies of a file's content that the child may hold.
#: Unit: 1. Origin: chosen.
_MEMORY_PER_BYTE = 3

#: Memory of the child beside that, which the libraries reserve when they first work.
#: Unit: bytes. Origin: chosen.
_LEAST_MEMORY = 1 << 30

#: Wall-clock time in which a child must start.
#: Unit: s. Origin: chosen. It takes 0.3 s on a computer of 2020, and a minute from a
#: slow network disk. 1.5 times larger: where a child hangs at its start, each file
#: waits 1.5 times longer.
_START_S = 120.0

#: Wall-clock time in which a child that is killed must end.
#: Unit: s. Origin: chosen. The system needs some ms. 1.5 times larger: a child that the
#: system cannot end, say on a dead network disk, is left 1.5 times later.
_END_S = 10.0

# What the child says.
READY = "ready\n"
ANSWERED = "answered\n"
NO_MEMORY = "memory\n"

_lock = threading.Lock()
_answered: set[tuple[object, ...]] = set()


def require_answer(path: str | Path, most_unpacked_mb: float) -> None:
    """Require that the HDF5 library comes to an end with a file, be it an error.

    Parameters
    ----------
    path : path
    most_unpacked_mb : float
        Most memory that the file may use, MB; may be infinite.

    Raises
    ------
    RecordingError
        If the library takes more time than a file of this size can need, or ends the
        process.
    """
    place = Path(path).resolve()
    found = place.stat()
    identity = (place, found.st_size, found.st_mtime_ns, found.st_ino)
    with _lock:
        if identity in _answered:
            return
        seconds = seconds_to_read(place)
        fault = child.fault_of(place, seconds, most_unpacked_mb)
        if not fault:
            _answered.add(identity)
            return
    wanted = f"a file that can be read in {seconds:.0f} s and within its memory"
    raise RecordingError.at(path, wanted, fault)


class Child:
    """A process that tries files, one after another; it starts when it is needed.

    Parameters
    ----------
    program : str, optional
        Its Python program; by default one that serves.
    start_s : float
        Wall-clock time in which it must start, s.
    end_s : float
        Wall-clock time in which it must end when it is killed, s.
    wall_per_cpu : float
        Wall-clock time that it may take for a file, over the CPU time.
    """

    def __init__(
        self,
        program: str | None = None,
        *,
        start_s: float = _START_S,
        end_s: float = _END_S,
        wall_per_cpu: float = _WALL_PER_CPU,
    ) -> None:
        self._program = serving_program() if program is None else program
        self._start_s = start_s
        self._end_s = end_s
        self._wall_per_cpu = wall_per_cpu
        self._process: subprocess.Popen[str] | None = None
        self._owner = 0  # a fork of the process that started it must not use it

    @property
    def is_alive(self) -> bool:
        """Whether it has started, in this process, and not ended."""
        if self._process is None or self._owner != os.getpid():
            return False
        return self._process.poll() is None

    def fault_of(self, place: Path, seconds: float, most_unpacked_mb: float) -> str:
        """Have a file read; return what went wrong, or nothing.

        Parameters
        ----------
        place : Path
            The file.
        seconds : float
            CPU time that it may take, s.
        most_unpacked_mb : float
            Most memory that the file may use, MB.
        """
        if not self.is_alive:
            self.end()
            self._process = self._started()
            self._owner = os.getpid()
        process = self._process
        if process is None:  # none can work here: the file is read without a trial
            return ""
        request = f"{seconds} {most_unpacked_mb} {os.fsencode(place).hex()}\n"
        answer = self._answer(process, request, self._wall_per_cpu * seconds)
        if answer == ANSWERED:
            return ""
        anew = "it is damaged, copy it anew"
        if answer == NO_MEMORY:
            return f"one for which the HDF5 library wants far more memory; {anew}"
        if not answer:
            with suppress(subprocess.TimeoutExpired):
                process.wait(self._end_s)
        code = process.poll()
        self.end()
        if code is None:  # it lives, and is of no use any more
            said = f"the trial says {answer.strip()!r} instead of an answer"
            return f"one on which {said}; {anew}"
        return _ended_with(code)

    def _started(self) -> subprocess.Popen[str] | None:
        """Start the process; return None if that fails, or it does not get ready."""
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        try:
            process = subprocess.Popen(
                [sys.executable, "-P", "-c", self._program],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=environment,
                encoding="ascii",
                errors="replace",
            )
        except OSError:
            return None
        assert process.stdout is not None
        watch = threading.Timer(self._start_s, process.kill)
        watch.start()
        try:
            # What an installation prints at the start of Python comes before the word.
            is_ready = READY in process.stdout
        except BaseException:
            self._close(process)
            raise
        finally:
            watch.cancel()
        if is_ready:
            return process
        self._close(process)
        return None

    def _answer(
        self, process: subprocess.Popen[str], request: str, wall_s: float
    ) -> str:
        """Return the answer; nothing if the process ended, or had to be ended."""
        watch = threading.Timer(wall_s, process.kill)
        watch.start()
        try:
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write(request)
            process.stdin.flush()
            return process.stdout.readline()
        except OSError:  # it died before it could read the line
            return ""
        except BaseException:
            # Interrupted: its answer would be taken for that of the next file.
            self.end()
            raise
        finally:
            watch.cancel()

    def end(self) -> None:
        """End the process, if there is one; that of a process it forked from stays."""
        if self._process is not None and self._owner == os.getpid():
            self._close(self._process)
        self._process = None

    def _close(self, process: subprocess.Popen[str]) -> None:
        """End a process, wait for it, and close its pipes."""
        with suppress(OSError):
            process.kill()
        with suppress(subprocess.TimeoutExpired):
            process.wait(self._end_s)
        for pipe in (process.stdin, process.stdout):
            # What it did not read cannot be written any more.
            with suppress(OSError, ValueError):
                if pipe is not None:
                    pipe.close()


def serving_program() -> str:
    """Return a child's program, which imports the hopdata of this process.

    -P keeps the working folder off Python's path, and with it a source tree that is not
    installed. So its folder is on the path for the first import, and only for that one.
    """
    folder = str(Path(hopdata.__file__).resolve().parents[1])
    lines = [
        "import sys",
        f"sys.path.insert(0, {folder!r})",
        "import hopdata",
        f"sys.path.remove({folder!r})",
        f"from {__name__} import serve",
        f"print({READY!r}, end='', flush=True)",
        "serve()",
    ]
    return "\n".join(lines)


def _ended_with(code: int) -> str:
    """Return what the exit code of a child tells about the file, and what to do."""
    endless = "one on which the HDF5 library goes on and on"
    if -code in _signals("SIGXCPU"):
        return f"{endless}; it is damaged, copy it anew"
    if -code in _signals("SIGKILL"):
        # So does a system end it that runs out of memory.
        crowded = "for which this computer has too little free memory"
        again = "try again with more free memory, or copy it anew"
        return f"{endless}, or {crowded}; {again}"
    ends = f"one that ends the HDF5 library (exit code {code})"
    return f"{ends}; it is damaged, copy it anew"


def _signals(*names: str) -> set[int]:
    """Return the numbers of signals that exist on this system."""
    import signal

    return {int(getattr(signal, name)) for name in names if hasattr(signal, name)}


#: The child of this process.
child = Child()
atexit.register(child.end)


# The child's side.


def serve() -> None:
    """Read each file that a line on stdin names, and answer each with a line."""
    for line in sys.stdin:
        seconds, most_unpacked_mb, place = line.split()
        path = Path(os.fsdecode(bytes.fromhex(place)))
        limit(path, float(seconds), float(most_unpacked_mb))
        answer = ANSWERED
        try:
            _read_all(path, float(most_unpacked_mb))
        except MemoryError:
            answer = NO_MEMORY
        except Exception:
            answer = ANSWERED  # the parent meets the same error, and tells it
        sys.stdout.write(answer)
        sys.stdout.flush()


def limit(path: Path, seconds: float, most_unpacked_mb: float) -> None:
    """Limit CPU time and memory of this process from here on, where possible."""
    try:
        import resource
    except ImportError:  # Windows
        return
    with suppress(OSError, ValueError):
        used = resource.getrusage(resource.RUSAGE_SELF)
        until = int(used.ru_utime + used.ru_stime + seconds) + 1
        _set_limit(resource.RLIMIT_CPU, until)
    with suppress(OSError, ValueError):
        most = resource.RLIM_INFINITY  # lifts the limit of an earlier file
        if most_unpacked_mb != float("inf"):
            n_pages = int(Path("/proc/self/statm").read_text().split()[0])
            own = n_pages * resource.getpagesize()
            unpacked = min(1e6 * most_unpacked_mb, DEFLATE_MOST * path.stat().st_size)
            for_file = int(_MEMORY_PER_BYTE * unpacked)
            most = own + _LEAST_MEMORY + for_file
        _set_limit(resource.RLIMIT_AS, most)


def _set_limit(kind: int, wanted: int) -> None:
    """Set a limit of this process, at most that of its user or batch system."""
    import resource

    _, hard = resource.getrlimit(kind)
    if hard == resource.RLIM_INFINITY:
        soft = wanted
    elif wanted == resource.RLIM_INFINITY:  # a negative number on some systems
        soft = hard
    else:
        soft = min(wanted, hard)
    resource.setrlimit(kind, (soft, hard))


def _read_all(path: Path, most_unpacked_mb: float) -> None:
    """Read all attributes and datasets of a file, as its readers may do."""
    with h5py.File(path, "r", locking=False) as file:
        hdf5_checks.require_sound(file, most_unpacked_mb)
        for item in hdf5_checks.items_of(file):
            for name in item.attrs:
                _attempt(hdf5_checks.checked_attribute, item, name)
            if isinstance(item, h5py.Dataset) and item.shape is not None:
                _attempt(hdf5_checks.whole_array, item)


def _attempt(read: Callable[..., Any], *arguments: Any) -> None:
    """Read one part of a file, of which other parts may still be sound."""
    try:
        read(*arguments)
    except MemoryError:
        raise
    except Exception as error:
        if "allocat" in str(error):  # h5py's words where the library lacks memory
            raise MemoryError from None
