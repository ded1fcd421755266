"""The process in which something foreign is read: a fork of this one, or a server.

A fork begins with all libraries that this process has loaded, so it costs some
hundredths of a second, and its limits can never be raised. It is used where it is
sound: on Linux, in a process with one thread of Python. Elsewhere (a notebook, macOS,
Windows) one process is started when it is first needed, and reads one thing after
another; it ends with this process.
"""

from __future__ import annotations

import atexit
import gc
import io
import os
import subprocess
import sys
import threading
import tracemalloc
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

import hopdata
from hopdata import causes
from hopdata.errors import HopdataError
from hopdata.foreign import limits
from hopdata.foreign.budget import MOST_WORDS, Budget
from hopdata.foreign.plain import EndedError, WrongFrameError, receive, send
from hopdata.foreign.watch import MEMORY, Watch
from hopdata.messages import Message

#: Wall-clock time in which a server must start.
#: Unit: s. Origin: chosen. It takes 0.3 s on a computer of 2020, and a minute from a
#: slow network disk. 1.5 times larger: where it hangs at its start, the first file
#: waits 1.5 times longer.
START_S = 120.0

#: Wall-clock time in which a process that is killed must end.
#: Unit: s. Origin: chosen. The system needs some ms. 1.5 times larger: a process that
#: the system cannot end, say on a dead network disk, is left 1.5 times later.
_END_S = 10.0

# What a server sends when it is ready.
_READY = "ready"

# Exit code of a fork that could not even send why it failed.
_UNSENT = 70

# Errors that led to one another which are looked at: they may lead round in a circle.
_MOST_CAUSES = 20

# Bytes of a pipe, where they can be chosen.
_PIPE_BYTES = 1 << 20

_is_inside = False


@dataclass(frozen=True)
class Request:
    """A function to call apart.

    Attributes
    ----------
    function
        Its place, ``"module:name"``.
    arguments
        Its arguments: plain values (`hopdata.foreign.plain.send`).
    budget
        What it may spend.
    kinds
        Dataclasses that may be in what it returns.
    libraries
        Modules that it imports, which are no part of what it may spend.
    """

    function: str
    arguments: tuple[Any, ...]
    budget: Budget
    kinds: tuple[type, ...] = ()
    libraries: tuple[str, ...] = ()

    def import_libraries(self) -> None:
        """Import the function's module, and the libraries that are installed."""
        for module in (self.function.partition(":")[0], *self.libraries):
            with suppress(ImportError):
                import_module(module)


@dataclass(frozen=True)
class Failure:
    """Why nothing came back.

    Attributes
    ----------
    name
        The name of the message: memory, time, waits, ended, failed, reply, folder or
        start.
    words
        What was found, if the message tells more.
    """

    name: str
    words: str = ""


@dataclass(frozen=True)
class Answer:
    """What came back: a value, an error of hopdata, or a failure."""

    value: Any = None
    error: HopdataError | None = None
    failure: Failure | None = None


def is_inside() -> bool:
    """Tell whether this process is one in which something foreign is read."""
    return _is_inside


def may_fork() -> bool:
    """Tell whether a fork of this process is sound: Linux, and one thread of Python."""
    return sys.platform.startswith("linux") and len(sys._current_frames()) == 1


def call(request: Request) -> Answer:
    """Call a function in another process, within its budget."""
    try:
        os.getcwd()
    except OSError:
        return Answer(failure=Failure("folder"))
    if may_fork():
        request.import_libraries()  # so that the fork has them
        return _call_fork(request)
    return server.call(request)


# A fork.


def _call_fork(request: Request) -> Answer:
    """Call a function in a fork of this process, which ends with this call."""
    folders = limits.own_search_path()
    parent = os.getpid()
    try:
        from_child, to_parent = os.pipe()
    except OSError as error:
        return Answer(failure=Failure("start", str(error)))
    try:
        with warnings.catch_warnings():
            # Python warns of forks where a library has threads; those of BLAS survive.
            warnings.simplefilter("ignore", DeprecationWarning)
            pid = os.fork()
    except OSError as error:
        os.close(from_child)
        os.close(to_parent)
        return Answer(failure=Failure("start", str(error)))
    if pid == 0:
        try:
            _be_fork(to_parent, folders, parent, request)
        finally:
            os._exit(_UNSENT)
    os.close(to_parent)
    kill = partial(_kill, pid)
    exit_code = partial(_exit_code, pid)
    with io.FileIO(from_child, "rb") as stream:
        try:
            answer = _received(stream, pid, kill, exit_code, request)
        finally:
            kill()  # if it has not ended
            _reap(pid)
    return answer


def _be_fork(
    to_parent: int, folders: Sequence[str], parent: int, request: Request
) -> None:
    """Read in the fork, send the answer, and end."""
    global _is_inside
    _is_inside = True
    gc.freeze()  # what it shares with its parent is neither copied nor closed
    tracemalloc.stop()
    _close_all_but(to_parent)
    _default_signals()
    limits.confine(folders)
    limits.end_with(parent)
    limits.spend_at_most(request.budget, for_good=True)
    with io.FileIO(to_parent, "wb") as stream:
        _answer(stream, request)
        # Nothing that the parent has begun is flushed or ended here.
        os._exit(0)


def _close_all_but(kept: int) -> None:
    """Close the files of the parent, and give the standard ones to nobody."""
    nobody = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1, 2):
        if standard != kept:
            os.dup2(nobody, standard)
    for name in os.listdir("/proc/self/fd"):
        number = int(name)
        if number > 2 and number != kept:
            with suppress(OSError):
                os.close(number)
    # What the parent's have not yet written is not written a second time.
    sys.stdin = io.StringIO()
    sys.stdout = io.TextIOWrapper(io.FileIO(1, "w", closefd=False), "utf-8")
    sys.stderr = sys.stdout


def _default_signals() -> None:
    import signal

    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGXCPU", "SIGALRM", "SIGCHLD"):
        signal.signal(getattr(signal, name), signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, ())


def _kill(pid: int) -> None:
    """End a fork; it must not have been reaped, or its number may be another's."""
    import signal

    with suppress(OSError):
        os.kill(pid, signal.SIGKILL)


def _exit_code(pid: int) -> int | None:
    """Wait for the end of a fork; return its exit code, negative for a signal.

    Its number stays its own until `_reap`: the watch, or the end of the call, may still
    send a signal to it.
    """
    try:
        ended = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    except OSError:  # somebody else has waited
        return None
    if ended is None:
        return None
    if ended.si_code == os.CLD_EXITED:
        return ended.si_status
    return -ended.si_status


def _reap(pid: int) -> None:
    """Give the number of a fork that ends back to the system."""
    with suppress(OSError):  # somebody else has waited
        os.waitpid(pid, 0)


# A server.


class Server:
    """A process that calls one function after another; it starts when it is needed.

    Parameters
    ----------
    program : str, optional
        Its Python program; by default one that serves.
    start_s : float
        Wall-clock time in which it must start, s.
    """

    def __init__(self, program: str | None = None, *, start_s: float = START_S) -> None:
        self._program = program
        self._start_s = start_s
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0  # a fork of the process that started it must not use it
        self._lock = threading.RLock()

    @property
    def is_alive(self) -> bool:
        """Whether it has started, in this process, and not ended."""
        if self._process is None or self._owner != os.getpid():
            return False
        return self._process.poll() is None

    def call(self, request: Request) -> Answer:
        """Call a function in the server, within its budget."""
        with self._lock:
            try:
                process = self._ready()
            except (OSError, EOFError, ValueError) as error:
                words = str(error) or "it ends at once"
                return Answer(failure=Failure("start", words))
            try:
                answer = self._asked(process, request)
            except BaseException:  # interrupted: its answer would be taken for the next
                self.end()
                raise
            if answer.failure is not None and answer.failure.name != "failed":
                self.end()
            return answer

    def _ready(self) -> subprocess.Popen[bytes]:
        """Return the process, started anew if there is none.

        Raises
        ------
        OSError, EOFError, ValueError
            If it cannot be started.
        """
        if self.is_alive and self._process is not None:
            return self._process
        self.end()
        program = self._program
        if program is None:
            program = serving_program()
        process = subprocess.Popen(
            [sys.executable, "-I", "-c", program],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
            bufsize=0,
        )
        self._process, self._owner = process, os.getpid()
        assert process.stdout is not None
        watch = threading.Timer(self._start_s, process.kill)
        watch.start()
        try:
            if receive(process.stdout, 0) != _READY:
                raise WrongFrameError("something else than that it is ready")
        except BaseException:
            self.end()
            raise
        finally:
            watch.cancel()
        return process

    def _asked(self, process: subprocess.Popen[bytes], request: Request) -> Answer:
        assert process.stdin is not None
        assert process.stdout is not None
        asked = {
            "function": request.function,
            "arguments": request.arguments,
            "budget": asdict(request.budget),
            "libraries": request.libraries,
            "folder": os.getcwd(),
        }
        with suppress(OSError):  # it has ended, which shows when it is to answer
            send(process.stdin, asked)
        exit_code = partial(self._exit_code, process)
        return _received(process.stdout, process.pid, process.kill, exit_code, request)

    def _exit_code(self, process: subprocess.Popen[bytes]) -> int | None:
        with suppress(subprocess.TimeoutExpired):
            return process.wait(_END_S)
        return None

    def end(self) -> None:
        """End the process, if there is one; that of a process it forked from stays."""
        process = self._process
        self._process = None
        if process is None or self._owner != os.getpid():
            return
        with suppress(OSError):
            process.kill()
        with suppress(subprocess.TimeoutExpired):
            process.wait(_END_S)
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError, ValueError):
                if pipe is not None:
                    pipe.close()


def serving_program() -> str:
    """Return the program of a server, which imports the hopdata of this process.

    It has this process's search path without the working folder, and hopdata's own.
    """
    folders = limits.own_search_path()
    own = str(Path(hopdata.__file__).resolve().parents[1])
    if own not in folders:
        folders.append(own)
    lines = [
        "import sys",
        f"sys.path[:] = {folders!r}",
        f"from {__name__} import serve",
        "serve()",
    ]
    return "\n".join(lines)


def serve() -> None:
    """Answer one request after another, from what was stdin to what was stdout."""
    global _is_inside
    _is_inside = True
    requests = os.dup(0)
    answers = os.dup(1)
    nobody = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1, 2):
        os.dup2(nobody, standard)
    limits.confine(sys.path)  # it ends where its requests do
    with (
        io.FileIO(requests, "rb") as from_parent,
        io.FileIO(answers, "wb") as to_parent,
    ):
        send(to_parent, _READY)
        while True:
            try:
                asked = receive(from_parent, sys.maxsize)
            except EndedError:
                return
            os.chdir(asked["folder"])
            budget = Budget(**asked["budget"])
            arguments = tuple(asked["arguments"])
            libraries = tuple(asked["libraries"])
            request = Request(asked["function"], arguments, budget, (), libraries)
            request.import_libraries()
            limits.spend_at_most(budget, for_good=False)
            _answer(to_parent, request)


#: The server of this process.
server = Server()
atexit.register(server.end)


# What both do.


def _answer(stream: io.FileIO, request: Request) -> None:
    """Call the function, and send what it returns or how it fails."""
    _widen(stream)
    try:
        # Numbers that overflow are judged by the result, as those that do not: a
        # warning of NumPy would be the same words for every file.
        with np.errstate(all="ignore"):
            value = resolve_name(request.function)(*request.arguments)
        answer: dict[str, Any] = {"value": value}
    except BaseException as error:
        answer = _told(error)
    try:
        send(stream, answer)
    except BrokenPipeError:
        return
    except (TypeError, ValueError) as error:
        send(stream, {"failure": "reply", "words": str(error)})
    except MemoryError:
        send(stream, {"failure": MEMORY, "words": ""})


def _told(error: BaseException) -> dict[str, Any]:
    """Return an error as plain values: of hopdata, for lack of memory, or any other.

    Lack of memory comes first: a reader may have made an error of hopdata of it.
    """
    if _lacks_memory(error):
        return {"failure": MEMORY, "words": ""}
    if isinstance(error, HopdataError):
        lines = [one if isinstance(one, Message) else str(one) for one in error.args]
        kind = type(error).__name__
        return {"error": {"kind": kind, "lines": lines, "key": error.key}}
    words = " ".join(str(error).split())
    place = _innermost(error)
    return {
        "failure": "failed",
        "words": f"{type(error).__name__}: {words[:MOST_WORDS]}{place}",
    }


def _innermost(error: BaseException) -> str:
    """Return where an error was raised, in brackets; nothing if that is not known."""
    place = error.__traceback__
    if place is None:
        return ""
    while place.tb_next is not None:
        place = place.tb_next
    file = Path(place.tb_frame.f_code.co_filename).name
    return f" ({file}, line {place.tb_lineno})"


def _lacks_memory(error: BaseException | None) -> bool:
    """Tell whether an error, or one that led to it, says that memory is lacking."""
    for _ in range(_MOST_CAUSES):
        if error is None:
            return False
        if isinstance(error, MemoryError) or causes.tells_of_memory(str(error)):
            return True
        error = error.__cause__ or error.__context__
    return False


def _widen(stream: io.FileIO) -> None:
    """Give a pipe more room, where that can be done."""
    with suppress(ImportError, AttributeError, OSError):
        import fcntl

        fcntl.fcntl(stream.fileno(), fcntl.F_SETPIPE_SZ, _PIPE_BYTES)


def _rebuilt(told: dict[str, Any]) -> HopdataError:
    """Return the error of hopdata of which `_told` made plain values."""
    kind = _known_errors().get(told["kind"], HopdataError)
    error = kind(*told["lines"])
    error.key = str(told["key"])
    return error


def _known_errors() -> dict[str, type[HopdataError]]:
    """Return the errors of hopdata that this process knows, by their names."""
    known: dict[str, type[HopdataError]] = {}
    waiting: list[type[HopdataError]] = [HopdataError]
    while waiting:
        kind = waiting.pop()
        known[kind.__name__] = kind
        waiting += kind.__subclasses__()
    return known


class _Watched:
    """The stream of answers, which tells a watch when something comes."""

    def __init__(self, stream: Any, watch: Watch) -> None:
        self._stream = stream
        self._watch = watch

    def read(self, n_bytes: int, /) -> bytes | None:
        part: bytes | None = self._stream.read(n_bytes)
        self._watch.received()
        return part


def _received(
    stream: Any,
    pid: int,
    kill: Callable[[], None],
    exit_code: Callable[[], int | None],
    request: Request,
) -> Answer:
    """Return the answer of a process, or why there is none."""
    wrong = ""
    answer = None
    code = None
    kinds = (*request.kinds, Message)
    most = request.budget.unpacked
    with Watch(pid, kill, request.budget) as watch:
        try:
            answer = receive(_Watched(stream, watch), most, kinds)
        except (EndedError, OSError):
            code = exit_code()
        except WrongFrameError as error:
            wrong = str(error)
            kill()
            exit_code()
        except MemoryError:  # of this process
            kill()
            exit_code()
            return Answer(failure=Failure(MEMORY))
    if watch.found:
        return Answer(failure=Failure(watch.found))
    if wrong:
        return Answer(failure=Failure("reply", wrong))
    if answer is None:
        return Answer(failure=_end_of(code))
    return _understood(answer)


def _understood(answer: Any) -> Answer:
    """Return the parts of an answer."""
    try:
        if "value" in answer:
            return Answer(value=answer["value"])
        if "failure" in answer:
            name, words = str(answer["failure"]), str(answer["words"])
            if name in (MEMORY, "failed", "reply"):
                return Answer(failure=Failure(name, words))
        else:
            return Answer(error=_rebuilt(answer["error"]))
    except (TypeError, KeyError, AttributeError, ValueError):
        pass
    return Answer(failure=Failure("reply", "an answer of another form"))


def _end_of(code: int | None) -> Failure:
    """Return what the exit code of a process tells about what it has read."""
    if code is None:
        return Failure("ended", "it says no more")
    if code >= 0:
        return Failure("ended", f"exit code {code}")
    name = causes.signal_name(-code)
    if name == "SIGXCPU":
        return Failure("time")
    if name == "SIGKILL":  # by a system that runs out of memory
        return Failure(MEMORY)
    return Failure("ended", name)
