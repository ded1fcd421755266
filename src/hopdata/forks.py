"""How a job starts: its script runs in a fork of one process that knows the libraries.

Snakemake starts Python anew for each script. A stage of a recording of 10 s works for
less time than Python takes to import what it needs, so a study of many recordings, or a
group of many subjects, was mostly imports. Here the scripts of a run are forks of one
process, the server. What the first job of a rule has imported, the server imports
before it forks for the second, so a rule that runs once imports nothing twice.

`workflow/rules/folder.smk` has Snakemake call it. Everything else is as Snakemake does
it: the same file is executed, with the same folder, arguments, threads and exit code,
and its process is measured for the rule's `benchmark`. A job that dies takes no other
with it. If Snakemake dies, the server ends its jobs; if the server dies, its jobs are
killed and reported as such. Only Linux has all of this: elsewhere, and for scripts with
several threads or an environment of their own, Snakemake starts Python as ever.
"""

from __future__ import annotations

import atexit
import errno
import gc
import json
import os
import runpy
import selectors
import signal
import socket
import subprocess
import sys
import threading
import traceback
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO, TextIO

from hopdata.causes import NoForkError, ServerEndedError
from hopdata.foreign.limits import end_with

#: Most bytes of a request: what a job is told before it begins.
LONGEST_REQUEST = 2**16
#: What Snakemake tells the numerical libraries of a job with one thread, which they
#: read when they are loaded.
ONE_THREAD = {
    f"{library}_NUM_THREADS": "1"
    for library in ("OMP", "GOTO", "OPENBLAS", "MKL", "NUMEXPR")
} | {"VECLIB_MAXIMUM_THREADS": "1"}
#: In place of the number of a process: the server has outdated code. A negative number
#: is that of the system's error, for which there is no fork.
OUTDATED = 0
#: How long the end of a run waits for the server to end, s.
_END_S = 10.0


# In Snakemake's process.


def may_fork() -> bool:
    """Tell whether jobs may be forks: only Linux has all that this takes."""
    return sys.platform.startswith("linux")


@dataclass
class Job:
    """A fork that waits to begin, so that it can be measured from its beginning.

    Attributes
    ----------
    pid
        Its process.
    """

    pid: int
    _answers: TextIO
    _gate: BinaryIO

    def wait(self) -> int:
        """Let it begin; return its exit code, or minus the signal that ended it."""
        self._gate.close()
        with self._answers:
            line = self._answers.readline()
        if not line:
            # The server was ended, and the system has killed its forks.
            return -signal.SIGKILL
        return int(line)


def new_server() -> tuple[socket.socket, subprocess.Popen[bytes]]:
    """Start a server; return the way of its requests, and its process."""
    requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ExitStack() as unless_started, theirs:
        unless_started.enter_context(requests)
        number = theirs.fileno()
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "hopdata.forks", str(number)],
            pass_fds=[number],
            stdin=subprocess.DEVNULL,
            env=os.environ | ONE_THREAD,
        )
        unless_started.pop_all()
    return requests, process


@dataclass
class Server:
    """The process whose forks the jobs are; it is started with the first job."""

    _lock: threading.Lock = field(default_factory=threading.Lock)
    _process: subprocess.Popen[bytes] | None = None
    _requests: socket.socket | None = None
    #: Ways to servers with outdated code, whose last jobs may still be at work.
    _retired: list[socket.socket] = field(default_factory=list)

    def start(self, rule: str, file: str, environment: dict[str, str]) -> Job:
        """Make a fork for a script of a rule, with these variables besides ours.

        If the code of hopdata has changed since the server read it, another one is
        started, so that no job mixes two states of it.
        """
        request = {
            "rule": rule,
            "file": file,
            "folder": os.getcwd(),
            "environment": environment,
        }
        job = self._asked(request)
        if job is None:
            job = self._asked(request)
        if job is None:
            raise ServerEndedError
        return job

    def _asked(self, request: dict[str, Any]) -> Job | None:
        """Return a new job, or None if the server had outdated code and is retired."""
        answered, to_answer = os.pipe()
        closed, gate = os.pipe()
        answers = os.fdopen(answered, "r", encoding="ascii")
        with ExitStack() as unless_begun:
            unless_begun.enter_context(answers)
            opened = unless_begun.enter_context(os.fdopen(gate, "wb", buffering=0))
            try:
                with self._lock:
                    requests = self._at_work()
                    message = json.dumps(request).encode()
                    socket.send_fds(requests, [message], [to_answer, closed])
            except NoForkError:
                raise
            except OSError:
                raise ServerEndedError from None
            finally:
                os.close(to_answer)
                os.close(closed)
            line = answers.readline()
            if not line:
                raise ServerEndedError
            pid = int(line)
            if pid == OUTDATED:
                self._retire(requests)
                return None
            if pid < 0:
                raise NoForkError(-pid, os.strerror(-pid))
            unless_begun.pop_all()
        return Job(pid, answers, opened)

    def _retire(self, requests: socket.socket) -> None:
        """Ask this server for no more jobs; those that it has go on."""
        with self._lock:
            if self._requests is requests:
                self._retired.append(requests)
                self._process = self._requests = None

    def _at_work(self) -> socket.socket:
        """Return the way to the server, which is started unless it lives."""
        process, requests = self._process, self._requests
        if process is None or requests is None or process.poll() is not None:
            if requests is not None:
                requests.close()
            try:
                requests, self._process = new_server()
            except OSError as error:
                self._process = self._requests = None
                raise NoForkError(error.errno, error.strerror) from None
            self._requests = requests
        return requests

    def end(self) -> None:
        """End the server; it has no job any more if Snakemake has ended its own."""
        with self._lock:
            for retired in self._retired:
                retired.close()
            if self._process is None or self._requests is None:
                return
            self._requests.close()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=_END_S)
            self._process = None


# In the server.


@dataclass
class _Begun:
    """A fork at work, as the server knows it.

    Attributes
    ----------
    rule
        Whose job it is.
    answers
        Where to write its process and its exit code.
    imported
        A file in memory into which it writes the names of what it imports; None if the
        server has imported that already.
    """

    rule: str
    answers: int
    imported: int | None


def serve(number: int) -> dict[str, Any] | None:
    """Fork for each request; return the request in the fork, and None at the end.

    Parameters
    ----------
    number : int
        The socket of the requests.
    """
    requests = socket.socket(fileno=number)
    woken, wake = os.pipe()
    for end in (woken, wake):
        os.set_blocking(end, False)
    # Ctrl-C is meant for Snakemake and its jobs.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
    forks: dict[int, _Begun] = {}
    imported: dict[str, list[str]] = {}
    sources = _sources()
    with selectors.DefaultSelector() as selector:
        selector.register(requests, selectors.EVENT_READ)
        selector.register(woken, selectors.EVENT_READ)
        while True:
            ready = {key.fileobj for key, _ in selector.select()}
            if woken in ready:
                os.read(woken, LONGEST_REQUEST)
                _reap(forks, imported)
            if requests not in ready:
                continue
            message, ends, _, _ = socket.recv_fds(requests, LONGEST_REQUEST, 2)
            if not message:  # Snakemake has ended
                _kill(forks)
                return None
            request: dict[str, Any] = json.loads(message)
            if len(ends) < 2:  # the system gives only as many as may be open here
                _refuse(ends, -errno.EMFILE)
                continue
            if any(_changed(file) != known for file, known in sources.items()):
                _refuse(ends, OUTDATED)
                continue
            parent = os.getpid()
            begun, pid = _fork(request["rule"], ends, imported)
            if begun is None:
                continue
            answers, gate = ends
            if not pid:
                end_with(parent)
                others = [one.answers for one in forks.values()]
                _leave_server([*others, answers, woken, wake, requests.detach()])
                return request | {"imported": begun.imported, "gate": gate}
            sources = _sources()
            os.close(gate)
            forks[pid] = begun


def _fork(
    rule: str, ends: list[int], imported: dict[str, list[str]]
) -> tuple[_Begun | None, int]:
    """Fork; return what is begun, and the number of the fork, which is 0 in it.

    Where the system allows no fork, nothing is begun, and the job is told why. Other
    jobs go on.
    """
    begun = _Begun(rule, ends[0], None)
    try:
        begun.imported = _begin(rule, imported)
        pid = os.fork()
    except OSError as error:
        if begun.imported is not None:
            os.close(begun.imported)
        _refuse(ends, -(error.errno or errno.EAGAIN))
        return None, 0
    if pid:
        _answer(begun, pid)
    return begun, pid


def _leave_server(ends: list[int]) -> None:
    """Give up, in a fork, what only the server needs."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for end in ends:
        os.close(end)


def _changed(file: str) -> int:
    """Return when a file was last changed, ns; 0 if it is gone."""
    try:
        return os.stat(file).st_mtime_ns
    except OSError:
        return 0


def _sources() -> dict[str, int]:
    """Return the files of hopdata that this process has imported, and their times."""
    files = [
        getattr(module, "__file__", None)
        for name, module in [*sys.modules.items()]
        if name.partition(".")[0] == "hopdata"
    ]
    return {file: _changed(file) for file in [__file__, *files] if file}


def _begin(rule: str, imported: dict[str, list[str]]) -> int | None:
    """Import what an earlier job of this rule has imported, once.

    Return a file in memory for the names of what a first job will import.
    """
    if rule not in imported:
        return os.memfd_create(rule)
    names, imported[rule] = imported[rule], []
    for name in names:
        # Not all that is listed as a module can be imported by its name.
        with suppress(Exception):
            import_module(name)
    if names:
        gc.freeze()  # no fork searches, and thereby copies, all these for garbage
    return None


def _refuse(ends: list[int], number: int) -> None:
    """Tell, where there is a way, why there is no fork."""
    with suppress(OSError, IndexError):
        os.write(ends[0], f"{number}\n".encode())
    for end in ends:
        os.close(end)


def _reap(forks: dict[int, _Begun], imported: dict[str, list[str]]) -> None:
    """Tell the exit codes of forks that have ended, and learn what they imported."""
    while forks:
        pid, status = os.waitpid(-1, os.WNOHANG)
        if not pid:
            return
        ended = forks.pop(pid)
        if ended.imported is not None:
            text = Path(f"/proc/self/fd/{ended.imported}").read_text(encoding="utf-8")
            os.close(ended.imported)
            if text:
                imported.setdefault(ended.rule, text.split())
        _answer(ended, os.waitstatus_to_exitcode(status))
        os.close(ended.answers)


def _answer(begun: _Begun, number: int) -> None:
    with suppress(BrokenPipeError):  # Snakemake has just died
        os.write(begun.answers, f"{number}\n".encode())


def _kill(forks: dict[int, _Begun]) -> None:
    for pid in forks:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


# In a fork.


def run(request: dict[str, Any]) -> int:
    """Run a job's script as Python would; return its exit code."""
    with os.fdopen(request["gate"], "rb") as gate:
        gate.read()  # until Snakemake closes its end
    before = {*sys.modules}
    os.chdir(request["folder"])
    os.environ.update(request["environment"])
    sys.argv = [request["file"]]
    code = _code_of(request["file"])
    if request["imported"] is not None:
        names = [name for name in [*sys.modules] if name not in before]
        with os.fdopen(request["imported"], "w", encoding="utf-8") as told:
            told.write("\n".join(name for name in names if not name.startswith("__")))
    return code


def _code_of(file: str) -> int:
    """Execute a file; return the exit code of a process that did no more than that."""
    try:
        runpy.run_path(file, run_name="__main__")
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return end.code or 0
        print(end.code, file=sys.stderr)
        return 1
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def _end(code: int) -> None:
    """End this process, without taking all modules apart, which takes 0.1 s."""
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and not thread.daemon:
            thread.join()
    atexit._run_exitfuncs()  # there is no public name
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


def be_server(number: int) -> None:
    """Serve the requests of a socket; each fork runs its script, and ends."""
    request = serve(number)
    if request is not None:
        _end(run(request))


if __name__ == "__main__":
    be_server(int(sys.argv[1]))
