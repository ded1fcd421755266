"""A trial of HDF5 files without a seal in another process, in case the library never answers.

On a damaged file the HDF5 library may run for ever or end the process, and neither can be
stopped from within. So a child process first reads the whole file, with limits on its time
and memory that follow from the file's size. Files that hopdata has sealed need no trial.

The child serves one file after another, so it costs some 0.3 s once and little for each
further file. It ends with this process.
"""

import atexit
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from hopdata.arrays import h5py
from hopdata.errors import RecordingError
from hopdata.recordings.budget import DEFLATE_MOST, seconds_to_read

# Wall-clock time in units of the CPU time: a shared or slow machine gives a process a part of
# its time, and where CPU time cannot be limited this is the only limit. 1.5 times larger: a
# hang that takes no CPU time is told 1.5 times later.
_WALL_PER_CPU = 20
_MEMORY_PER_BYTE = 3  # copies of the content that the child may hold
_LEAST_MEMORY = 1 << 30  # bytes; what the libraries themselves reserve when they first work

ANSWERED = "answered\n"
NO_MEMORY = "memory\n"

_lock = threading.Lock()
_child: "subprocess.Popen[str] | None" = None
_owner = 0  # process that started the child; a fork of it must not share the pipes
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
        If the library takes more time than a file of this size can need, or ends the process.
    """
    place = Path(path).resolve()
    found = place.stat()
    identity = (place, found.st_size, found.st_mtime_ns, found.st_ino)
    with _lock:
        if identity in _answered:
            return
        seconds = seconds_to_read(place)
        fault = _tried(place, seconds, most_unpacked_mb)
        if not fault:
            _answered.add(identity)
            return
    wanted = f"a file that can be read in {seconds:.0f} s and within its memory"
    raise RecordingError.at(path, wanted, f"{fault}; it is damaged, copy it anew")


def _tried(place: Path, seconds: float, most_unpacked_mb: float) -> str:
    """Have the child read a file; return what went wrong, nothing if the library answered."""
    global _child, _owner
    if _child is None or _child.poll() is not None or _owner != os.getpid():
        try:
            _child = _started()
        except OSError:  # no process can be started here: the file is read without a trial
            return ""
        _owner = os.getpid()
    child = _child
    watch = threading.Timer(_WALL_PER_CPU * seconds, child.kill)
    watch.start()
    try:
        assert child.stdin is not None
        assert child.stdout is not None
        child.stdin.write(f"{seconds} {most_unpacked_mb} {os.fsencode(place).hex()}\n")
        child.stdin.flush()
        answer = child.stdout.readline()
    except OSError:  # the child died before it could read the line
        answer = ""
    except BaseException:  # interrupted: its answer would be taken for that of the next file
        _child = None
        child.kill()
        raise
    finally:
        watch.cancel()
    if answer == ANSWERED:
        return ""
    if answer == NO_MEMORY:
        return "one for which the HDF5 library wants far more memory"
    _child = None
    code = child.wait()
    if -code in _signals("SIGXCPU", "SIGKILL"):
        return "one on which the HDF5 library goes on and on"
    return f"one that ends the HDF5 library (exit code {code})"


def _started() -> "subprocess.Popen[str]":
    """Start the child; -P keeps the working folder off Python's path."""
    command = [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    child = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=environment,
        encoding="ascii",
    )
    atexit.register(_ended, child)
    return child


def _ended(child: "subprocess.Popen[str]") -> None:
    """End a child by closing its input, and wait for it."""
    with suppress(OSError, ValueError):
        if child.stdin is not None:
            child.stdin.close()
        if child.stdout is not None:
            child.stdout.close()
        child.kill()
        child.wait()


def _signals(*names: str) -> set[int]:
    """Return the numbers of signals that exist on this system."""
    import signal

    return {int(getattr(signal, name)) for name in names if hasattr(signal, name)}


# The child's side.


def serve() -> None:
    """Read each file that a line on standard input names, and answer each with a line."""
    for line in sys.stdin:
        seconds, most_unpacked_mb, place = line.split()
        path = Path(os.fsdecode(bytes.fromhex(place)))
        _limit(path, float(seconds), float(most_unpacked_mb))
        answer = ANSWERED
        try:
            _read_all(path, float(most_unpacked_mb))
        except MemoryError:
            answer = NO_MEMORY
        except Exception:
            answer = ANSWERED  # the parent meets the same error, and tells it
        sys.stdout.write(answer)
        sys.stdout.flush()


def _limit(path: Path, seconds: float, most_unpacked_mb: float) -> None:
    """Limit the CPU time and the memory of this process from here on, where possible."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        until = int(used.ru_utime + used.ru_stime + seconds) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (until, resource.RLIM_INFINITY))
        if most_unpacked_mb == float("inf"):
            return
        own = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        unpacked = min(1e6 * most_unpacked_mb, DEFLATE_MOST * path.stat().st_size)
        for_file = int(_MEMORY_PER_BYTE * unpacked)
        most = own + _LEAST_MEMORY + for_file
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))


def _read_all(path: Path, most_unpacked_mb: float) -> None:
    """Read all attributes and datasets of a file, as its readers may do."""
    from hopdata.recordings.readers import hdf5

    with h5py.File(path, "r", locking=False) as file:
        hdf5.require_sound(file, most_unpacked_mb)
        for item in hdf5.items_of(file):
            for name in item.attrs:
                _attempt(hdf5.checked_attribute, item, name)
            if isinstance(item, h5py.Dataset) and item.shape is not None:
                _attempt(hdf5.whole_array, item)


def _attempt(read: Callable[..., Any], *arguments: Any) -> None:
    """Read one part of a file, of which other parts may still be sound."""
    try:
        read(*arguments)
    except MemoryError:
        raise
    except Exception as error:
        if "allocat" in str(error):  # h5py's words where the library lacks memory
            raise MemoryError from None
