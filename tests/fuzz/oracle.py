"""What foreign data may cost and do: each input enters its door in a watched process.

An input passes if its door returns a result that fits together, or raises a
`HopdataError` whose lines name the file and can be shown on a terminal. It fails with

- `traceback`: any other exception, NumPy's warnings among them;
- `time`: more CPU time than `MOST_CPU_S`, or no end;
- `memory`: more than ten times its size and more than `LEAST_MEMORY`, of the process
  and of those that it starts;
- `end`: the process ended;
- `message`: an error of more than one line, of a very long one, with escape codes, or
  without the file;
- `outside`: a file written, a program started or a connection opened elsewhere;
- `result`: a result that cannot be, for example a time that is not finite.
"""

import io
import os
import pickle
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
TESTS = HERE.parent

# The promise: CPU time, s; memory as a multiple of the input, and at least so many bytes.
MOST_CPU_S = 10.0
MOST_COPIES = 10
LEAST_MEMORY = 1_000_000_000
# A process on a shared machine gets a part of its time only.
WALL_PER_CPU = 12
LEAST_WALL_S = 90.0
# Address space is more than memory: libraries reserve what they never touch.
SPARE_ADDRESSES = 1 << 30
# Characters of a line that can be read: some thirty lines of a terminal.
LONGEST_LINE = 2500
LENGTH = struct.Struct("<Q")
# Unit of the largest memory that a system tells, bytes.
MAXRSS = 1 if sys.platform == "darwin" else 1024
# Folders in which a program may write though no input names them.
HARMLESS = ("/dev/", "/proc/self/")


@dataclass(frozen=True)
class Verdict:
    """What became of one input.

    Attributes
    ----------
    fault : str
        Empty, or the kind of fault (see above).
    told : str
        The message, or what failed.
    where : str
        For a traceback, the innermost line of hopdata: two inputs with the same fault
        and place are the same find.
    refused : bool
        Whether the door refused the input with an error, as it may.
    cpu_s, memory : float, int
        What it took: CPU time, s, and the growth of the largest memory, bytes.
    """

    fault: str = ""
    told: str = ""
    where: str = ""
    refused: bool = False
    cpu_s: float = 0.0
    memory: int = 0

    @property
    def signature(self):
        return f"{self.fault} {self.where}".strip()


class FaultError(Exception):
    """A promise that was broken; the first argument is the kind of fault."""


# The watched process.


class Watched:
    """A process that lets inputs enter doors, one after another; it is restarted if it dies."""

    def __init__(self, most_cpu_s=MOST_CPU_S, doors="doors"):
        self.most_cpu_s = most_cpu_s
        self._doors = doors
        self._process = None
        self.starts = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()

    def enter(self, door, name, data):
        """Let one input enter; return its verdict."""
        if self._process is None or self._process.poll() is not None:
            self._start()
        process = self._process
        watch = threading.Timer(
            max(LEAST_WALL_S, WALL_PER_CPU * self.most_cpu_s), self._kill
        )
        watch.start()
        try:
            _send(process.stdin, (door, name, data))
            return Verdict(**_receive(process.stdout))
        except (OSError, EOFError):
            code = process.wait()
            return _of_end(code)
        finally:
            watch.cancel()

    def _start(self):
        self.end()
        self.starts += 1
        self._folder = tempfile.mkdtemp(prefix="hopdata-fuzz-")
        temporary = Path(self._folder, "tmp")
        temporary.mkdir()
        command = [sys.executable, str(HERE / "oracle.py")]
        command += [self._folder, str(self.most_cpu_s), self._doors]
        environment = {
            **os.environ,
            "OPENBLAS_NUM_THREADS": "1",
            "TMPDIR": str(temporary),
            "PYTHONDONTWRITEBYTECODE": "1",
            "MPLCONFIGDIR": self._folder,
        }
        environment.pop("NUMBA_CACHE_DIR", None)
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            start_new_session=os.name == "posix",
        )

    def _kill(self):
        """End the process with those that it started."""
        if self._process is None or self._process.poll() is not None:
            return
        if os.name == "posix":
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
        else:
            self._process.kill()

    def end(self):
        if self._process is None:
            return
        self._kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                pipe.close()
        shutil.rmtree(self._folder, ignore_errors=True)
        self._process = None


def _of_end(code):
    """Return the verdict on an input during which the process ended."""
    if -code in (signal.SIGKILL, getattr(signal, "SIGXCPU", None)):
        return Verdict("time", f"the process had to be ended ({code})")
    return Verdict("end", f"the process ended with code {code}", f"code {code}")


def _send(pipe, content):
    data = pickle.dumps(content)
    pipe.write(LENGTH.pack(len(data)) + data)
    pipe.flush()


def _receive(pipe):
    head = pipe.read(LENGTH.size)
    if len(head) < LENGTH.size:
        raise EOFError
    return pickle.loads(pipe.read(*LENGTH.unpack(head)))


# The side of the watched process.


def judged(attempt, most_cpu_s=MOST_CPU_S):
    """Let an input enter; return its verdict."""
    allowance = max(LEAST_MEMORY, MOST_COPIES * attempt.n_bytes)
    Cost.limit(most_cpu_s, allowance)
    cost = Cost()
    guard.begin(attempt.folder, attempt.loads_pickles)
    verdict = _outcome(attempt)
    found = guard.end()
    cpu_s, memory = cost.so_far()
    Cost.lift()
    fault, told, where = verdict.fault, verdict.told, verdict.where
    if found:
        fault, told, where = "outside", found, found.split("/")[0]
    elif not fault and memory > allowance:
        fault, told = "memory", f"{memory / 1e6:.0f} MB for {attempt.n_bytes} bytes"
    elif not fault and cpu_s > most_cpu_s:
        fault, told = "time", f"{cpu_s:.1f} s of CPU"
    return Verdict(fault, told, where, verdict.refused, cpu_s, memory)


@dataclass(frozen=True)
class Attempt:
    """An input at its door.

    Attributes
    ----------
    enter : callable
        Takes nothing; returns a result or raises.
    check : callable
        Takes the result; raises AssertionError if it cannot be.
    n_bytes : int
        Length of the input, which limits the memory.
    folder : Path
        Where files may be written.
    names : tuple of str
        An error names one of these; none are needed if it is empty.
    loads_pickles : bool
        Whether the door is one of pickles, that of machine code.
    """

    enter: Callable[[], Any]
    check: Callable[[Any], None]
    n_bytes: int
    folder: Path
    names: tuple[str, ...] = ()
    loads_pickles: bool = False


def _outcome(attempt):
    from hopdata.errors import HopdataError

    printed = io.StringIO()
    try:
        with redirect_stdout(printed), redirect_stderr(printed):
            result = attempt.enter()
        _require_showable("printed", printed.getvalue().splitlines())
        attempt.check(result)
    except HopdataError as error:
        return _of_message(error, attempt.names)
    except FaultError as fault:
        return Verdict(fault.args[0], str(fault.args[1]))
    except Exception as error:
        fault = "traceback"
        if isinstance(error, AssertionError):
            fault = "result"
        if isinstance(error, MemoryError):
            fault = "memory"
        last = traceback.extract_tb(error.__traceback__)
        return Verdict(
            fault, f"{type(error).__name__}: {error}"[:300], _place(last, error)
        )
    except SystemExit as error:
        return Verdict("end", f"SystemExit: {error}", "SystemExit")
    return Verdict()


def _place(frames, error):
    """Return the innermost line of hopdata, or of these tests, on the way to an error."""
    ours = [
        one
        for one in frames
        if "hopdata" in one.filename.replace(os.sep, "/").split("/src/")[-1]
    ]
    at = (ours or list(frames))[-1]
    return f"{type(error).__name__} at {Path(at.filename).name}:{at.name}"


def _of_message(error, names):
    lines = [str(one) for one in error.args]
    try:
        _require_showable("error", str(error).splitlines())
    except FaultError as fault:
        return Verdict(fault.args[0], str(fault.args[1]), type(error).__name__)
    text = str(error)
    if error.code == "foreign.failed" and "odd_reader" not in text:
        # A traceback of hopdata's own reader, which its door has made one line.
        return Verdict("traceback", text[:300], _without_numbers(text))
    if len(text.splitlines()) > max(1, len(lines)):
        return Verdict("message", f"more lines than mistakes: {text!r}"[:300])
    longest = max(map(len, text.splitlines()), default=0)
    if longest > LONGEST_LINE:
        return Verdict("message", f"{longest} characters: {text!r}"[:300], "long")
    if names and not any(name in text for name in names):
        return Verdict("message", f"no file named: {text!r}"[:300], "no file")
    return Verdict(told=text[:300], refused=True)


def _without_numbers(text):
    """Return the end of a message, alike for all inputs with the same fault."""
    return re.sub(r"\d+", "0", text.rpartition("found")[2])[:60]


def _require_showable(what, lines):
    """Require that lines can be shown on a terminal as they are."""
    for line in lines:
        wrong = [c for c in line if not c.isprintable() and c != "\t"]
        if wrong:
            raise FaultError("message", f"{what}: {wrong[0]!r} in {line!r}"[:300])


class Cost:
    """CPU time and memory of this process and its children, from here on."""

    def __init__(self):
        _reset_peaks()
        self._before = _peak()
        self._before_children = _peak_of_ended()
        self._cpu_s = _cpu_s()

    def so_far(self):
        """Return CPU time, s, and the growth of the peak, bytes."""
        grown = max(0, _peak() - self._before)
        # A child begins as a copy of this process, and shares what it does not change.
        of_ended = _peak_of_ended()
        if of_ended > self._before_children:
            grown = max(grown, of_ended - self._before)
        return _cpu_s() - self._cpu_s, grown

    @staticmethod
    def limit(most_cpu_s, allowance):
        with suppress(ImportError, OSError, ValueError):
            import resource

            used = resource.getrusage(resource.RUSAGE_SELF)
            until = int(used.ru_utime + used.ru_stime + most_cpu_s) + 2
            _, hard = resource.getrlimit(resource.RLIMIT_CPU)
            resource.setrlimit(resource.RLIMIT_CPU, (until, hard))
            addresses = int(_status("VmSize")) + allowance + SPARE_ADDRESSES
            _, hard = resource.getrlimit(resource.RLIMIT_AS)
            resource.setrlimit(resource.RLIMIT_AS, (addresses, hard))

    @staticmethod
    def lift():
        with suppress(ImportError, OSError, ValueError):
            import resource

            for kind in (resource.RLIMIT_CPU, resource.RLIMIT_AS):
                _, hard = resource.getrlimit(kind)
                resource.setrlimit(kind, (hard, hard))


def _status(key, pid="self"):
    """Return a size of a process, bytes, as Linux tells it."""
    with open(f"/proc/{pid}/status", encoding="ascii", errors="replace") as file:
        for line in file:
            if line.startswith(f"{key}:"):
                return int(line.split()[1]) * 1024
    raise OSError(key)


def _family():
    """Return the numbers of this process and its children."""
    own = [os.getpid()]
    with suppress(OSError):
        for thread in os.listdir("/proc/self/task"):
            text = Path(f"/proc/self/task/{thread}/children").read_text("ascii")
            own += [int(one) for one in text.split()]
    return own


def _reset_peaks():
    for pid in _family():
        try:
            with open(f"/proc/{pid}/clear_refs", "w") as file:
                file.write("5")
        except OSError:
            return False
    return True


def _peak_of_ended():
    """Return the largest memory of any child that has ended, bytes."""
    with suppress(ImportError):
        import resource

        return MAXRSS * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return 0


def _peak():
    """Return the largest memory of this process and its living children, bytes."""
    total = 0
    for pid in _family():
        with suppress(OSError):
            total += _status("VmHWM", pid)
    if total:
        return total
    with suppress(ImportError):
        import resource

        return MAXRSS * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return 0


def _cpu_s():
    times = os.times()
    total = times.user + times.system + times.children_user + times.children_system
    ticks = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100
    for pid in _family()[1:]:
        with suppress(OSError, ValueError, IndexError):
            stat = Path(f"/proc/{pid}/stat").read_text("ascii", errors="replace")
            fields = stat.rpartition(")")[2].split()
            total += (int(fields[11]) + int(fields[12])) / ticks
    return total


class _Guard:
    """An audit hook of Python: what is written, started or connected outside a folder."""

    folder = ""
    temporary = ""
    also: tuple[str, ...] = ()
    found = ""
    loads_pickles = False

    def begin(self, folder, loads_pickles):
        self.loads_pickles = loads_pickles
        self.found = ""
        self.folder = os.path.realpath(folder)

    def end(self):
        self.folder = ""
        return self.found

    def __call__(self, event, arguments):
        if not self.folder or self.found:
            return
        if event == "open":
            path, mode, flags = arguments
            writes = isinstance(flags, int) and flags & (
                os.O_WRONLY | os.O_RDWR | os.O_CREAT
            )
            writes = writes or (
                isinstance(mode, str) and any(c in mode for c in "wax+")
            )
            if writes:
                self._require_inside("writes", path)
        elif event in ("os.mkdir", "os.remove", "os.rmdir", "os.rename", "os.link"):
            self._require_inside(event, arguments[0])
        elif event in ("os.symlink", "shutil.rmtree"):
            self._require_inside(event, arguments[-1 if event == "os.symlink" else 0])
        elif event in ("socket.connect", "os.system", "os.exec", "urllib.Request"):
            self.found = f"{event}/{arguments[1:]!r}"[:200]
        elif event == "subprocess.Popen" and not _is_own_child(arguments[0]):
            self.found = f"{event}/{arguments[0]!r}"[:200]
        elif event == "pickle.find_class" and not self.loads_pickles:
            self.found = f"{event}/{arguments!r}"[:200]

    def _require_inside(self, event, path):
        if not isinstance(path, str | bytes | os.PathLike):
            return
        place = os.path.realpath(os.fsdecode(path))
        allowed = (self.folder, self.temporary, *self.also, *HARMLESS)
        # Machine code and bytecode are kept beside the code.
        if not place.startswith(allowed) and "__pycache__" not in place:
            self.found = f"{event}/{place}"


def _is_own_child(program):
    return os.fsdecode(program) == sys.executable


guard = _Guard()


def serve(folder, most_cpu_s, doors_name):
    """Answer each input that stands on stdin with its verdict."""
    import warnings
    from importlib import import_module

    inputs, outputs = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what is printed must not stand among the verdicts
    sys.path[:0] = [str(HERE), *_test_folders()]
    os.chdir(folder)
    doors = import_module(doors_name).DOORS
    guard.temporary = os.path.realpath(tempfile.gettempdir())
    sys.addaudithook(guard)
    place = Path(folder, "case")
    warm = set()
    warnings.simplefilter("error")
    with suppress(EOFError):
        while True:
            door, name, data = _receive(inputs)
            if door not in warm:
                warm_up(doors[door], place / "home")
                warm.add(door)
            verdict = enter_door(doors[door], name, data, place, most_cpu_s)
            _send(outputs, vars(verdict))


def warm_up(door, home):
    """Let a sound input enter, since imports cost a process once and no input more."""
    for name, data in [*door.sound.items()][:1]:
        _emptied(home)
        with suppress(Exception), redirect_stdout(io.StringIO()):
            door.enter(door.place(home, name, data))


def _emptied(folder):
    """Make a folder empty, and the working folder; it is not made anew, which is slow."""
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    for one in [*folder.iterdir()]:
        if one.is_dir() and not one.is_symlink():
            shutil.rmtree(one, ignore_errors=True)
        else:
            one.unlink()


def enter_door(door, name, data, folder, most_cpu_s=MOST_CPU_S):
    """Write an input and its companions into a folder, and let it enter there."""
    home = folder / "home"
    _emptied(home)
    path = door.place(home, name, data)
    names = ()
    if door.names_file:
        files = [one.name for one in home.rglob("*") if one.is_file()]
        names = (*files, *door.names)
    attempt = Attempt(
        enter=lambda: door.enter(path),
        check=door.check,
        n_bytes=len(data),
        folder=home,
        names=names,
        loads_pickles=door.loads_pickles,
    )
    verdict = judged(attempt, most_cpu_s)
    stray = sorted(str(one.name) for one in folder.iterdir() if one != home)
    for one in stray:
        shutil.move(folder / one, tempfile.mkdtemp())
    if stray and not verdict.fault:
        return Verdict("outside", f"{stray} beside the folder", "stray")
    return verdict


def _test_folders():
    """Return the folders of helper modules that tests share, as in `pyproject.toml`."""
    import tomllib

    root = TESTS.parent
    table = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))
    named = table["tool"]["pytest"]["ini_options"]["pythonpath"]
    return [str(root / one) for one in named]


if __name__ == "__main__":
    serve(sys.argv[1], float(sys.argv[2]), sys.argv[3])
