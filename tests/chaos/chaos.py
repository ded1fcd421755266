"""Disturb a study again and again, and require that the same command puts it right.

    python tests/chaos/chaos.py --events 1000 --seed 1

The study is a minute of the bundled sample, by the rules and scripts of the workflow. An
event unmakes a part of its results, runs Snakemake, and disturbs the run or its files.
Then the same command is repeated. All files must have the bytes of a run that nobody
disturbed; while the cause lasts (a full disk), one sentence must say what to do.

Each event draws from a seed of its own, so that ``--only 17`` repeats event 17. What
happened is appended to ``events.jsonl``; a program that is started again goes on there.
Snakemake is a fork that has imported itself (``tests/workflow/forked.py``), and its jobs
are forks as for a user (`hopdata.forks`), of a server that is given its libraries. Those
of the event `commands` are started as by a user.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import psutil

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "workflow"))

from checkouts import copy_checkout, part_of_sample  # noqa: E402

from hopdata.causes import oom_kills  # noqa: E402
from hopdata.commands import deaths  # noqa: E402

STUDY = """\
study: small
recordings: [{name: one, file: data/part.h5}]
markers: {body: [body1, body2, body3], feet: [foot1, foot2, foot3], boom: [boom]}
prediction: {bootstraps: 20, train: 30, test: 10, minimum_class: 15}
verdict: {flips: 99}
figures: {formats: [svg]}
distances: {enabled: false}
"""
SECONDS = 60
RESULTS = Path("results/small")
TARGETS = [
    *("verdict.json", "units.json", "sections.json"),
    *("tables/touchdowns.csv", "tables/markers.csv"),
]
#: The figures and the page, which some events ask for too.
PAGE = ["figures/verdict.svg", "report.html"]
#: Share of the events that do: these take half as long again.
WITH_PAGE = 0.15
#: Files of the study by the stage that makes them, in the order of the stages.
MADE = [
    ["recordings/one.h5"],
    ["tables/markers.csv", "tables/gap_times.csv", "tables/faults.csv"],
    ["level/one.h5", "level/one.json"],
    ["contacts/one.csv"],
    ["sections.json"],
    ["schedules/kink.csv"],
    ["pairs.h5", "tables/touchdowns.csv", "tables/example_touchdown.csv"],
    ["units.json"],
    ["verdict.json", "tables/verdict_orders.csv"],
]
#: What differs from run to run: times. The page and its record tell them.
_NOT_COMPARED = {"logs", "benchmarks", ".sha256", "report.html", "provenance.json"}
LONGEST_S = 300
_DAY_S = 86_400


class FindingError(Exception):
    """What should not be."""


@dataclass
class Run:
    """How a run ended, and what it said."""

    code: int
    said: str

    @property
    def sentence(self) -> str:
        """The sentence that a user of ``hopdata run`` reads; empty if there is none."""
        lines = self.said.splitlines(keepends=True)
        told = [line for line in lines if line.startswith("hopdata: error:")]
        if told and "please report" not in told[-1]:
            return told[-1].strip()
        if "cannot be locked" in self.said:
            return "locked"
        reason = deaths.why(lines, oom_before=None)
        is_mistake = "tells no more" in reason or "please report" in reason
        return "" if is_mistake else reason


def compiled_in(code: Path | None) -> dict[str, str]:
    """Return what a process must know to keep its compiled code in a folder."""
    return {} if code is None else {"NUMBA_CACHE_DIR": str(code)}


class Server:
    """A process that forks a Snakemake for each run; everything it starts is known."""

    def __init__(self, folder: Path, code: Path | None, logs: Path) -> None:
        self._folder = folder
        self._environment = {
            **os.environ,
            "PYTHONPATH": str((folder / "src").resolve()),
            **compiled_in(code),
        }
        program = ROOT / "tests" / "workflow" / "forked.py"
        self._process = subprocess.Popen(
            [sys.executable, program],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        self._files: list[Path] = []
        self._logs = logs
        logs.mkdir(parents=True, exist_ok=True)

    def start(self, *arguments: str) -> None:
        """Begin a run."""
        self._files = [self._logs / f"{os.getpid()}.{kind}" for kind in ("out", "err")]
        for file in self._files:
            file.write_text("")
        names = [str(file) for file in self._files]
        ask = [str(self._folder), self._environment, [*arguments], names]
        print(json.dumps(ask), file=self._process.stdin, flush=True)

    def end(self) -> Run:
        """Wait for the end of the run."""
        code = int(self._process.stdout.readline())
        said = "".join(file.read_text(errors="replace") for file in self._files)
        return Run(code, said)

    def run(self, *arguments: str) -> Run:
        """Run without a disturbance."""
        self.start(*arguments)
        return self.end()

    def session(self) -> list[psutil.Process]:
        """Return all living processes that this one has started, also indirectly."""
        found = []
        for process in psutil.process_iter():
            with suppress(OSError, psutil.Error):
                if process.pid == self._process.pid:
                    continue
                if os.getsid(process.pid) == self._process.pid:
                    found.append(process)
        return found

    def driver(self) -> list[psutil.Process]:
        """Return Snakemake's process, if it lives."""
        return [one for one in self.session() if _parent(one) == self._process.pid]

    def jobs(self) -> list[psutil.Process]:
        """Return the processes of jobs, also those that outlived their Snakemake."""
        return [one for one in self.session() if _parent(one) != self._process.pid]

    def stop(self) -> None:
        """End everything."""
        kill(self.session())
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


def _parent(process: psutil.Process) -> int:
    with suppress(psutil.Error):
        return int(process.ppid())
    return -1


def kill(processes: list[psutil.Process], how: int = signal.SIGKILL) -> None:
    """Send a signal to processes."""
    for process in processes:
        with suppress(psutil.Error):
            process.send_signal(how)
    if how == signal.SIGKILL:
        psutil.wait_procs(processes, timeout=5)


@dataclass
class Place:
    """A checkout with its study, the files of an undisturbed run, and a server, or two.

    Its compiled code has a folder of its own, which events damage; if that is None, it is
    the package's own, which none damages.
    """

    folder: Path
    code: Path | None
    ram: bool = False
    server: Server = field(init=False)
    whole: dict[str, bytes] = field(default_factory=dict)
    seconds: float = 10.0
    has_page: bool = False
    without_page: set[str] = field(default_factory=set)

    def make(self) -> None:
        """Build the checkout, and run the study once."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self.ram = mounted(self.folder)
        copy_checkout(self.folder)
        part_of_sample(self.folder / "data/part.h5", SECONDS)
        (self.folder / "small.yaml").write_text(STUDY)
        # A clock that jumps changes the date of the source, which must not lie ahead.
        os.utime(self.folder / "data/part.h5", (time.time() - _DAY_S,) * 2)
        os.chdir(self.folder)
        self.server = Server(self.folder, self.code, self.folder.parent / "first")
        self.run_undisturbed()
        self.without_page = {*self.files()}
        self.has_page = True
        self.run_undisturbed()
        self.whole = self.files()

    @cached_property
    def other(self) -> Server:
        """A second server, for events that want one."""
        return Server(self.folder, self.code, self.folder.parent / "second")

    def servers(self) -> list[Server]:
        """Return the servers that run."""
        if "other" in vars(self):
            return [self.server, self.other]
        return [self.server]

    def run_undisturbed(self) -> None:
        """Run, and end this program if even that fails."""
        run = self.server.run(*self.command())
        if run.code:
            raise SystemExit(run.said)

    def targets(self) -> list[str]:
        """Return the files that this event asks for."""
        names = TARGETS + PAGE if self.has_page else TARGETS
        return [str(RESULTS / name) for name in names]

    def command(self) -> list[str]:
        """Return the one command that is given again and again."""
        options = ["--cores", "2", "--configfile", "small.yaml"]
        return [*options, "--", *self.targets()]

    def files(self) -> dict[str, bytes]:
        """Return the results that must not differ from run to run."""
        found = {}
        for path in sorted(RESULTS.rglob("*")):
            parts = set(path.relative_to(RESULTS).parts)
            if path.is_file() and not parts & _NOT_COMPARED:
                found[str(path.relative_to(RESULTS))] = path.read_bytes()
        return found

    def reset(self) -> None:
        """Begin anew after a finding, so that the next event does not inherit it."""
        for server in self.servers():
            kill(server.session())
        shutil.rmtree(RESULTS, ignore_errors=True)
        shutil.rmtree(".snakemake", ignore_errors=True)
        self.run_undisturbed()

    def leave(self) -> None:
        """End what runs, and remove the folder."""
        for server in self.servers():
            server.stop()
        os.chdir(ROOT)
        if self.ram:
            subprocess.run(["umount", "-l", self.folder], check=False)
        shutil.rmtree(self.folder, ignore_errors=True)


def mounted(folder: Path) -> bool:
    """Give the folder a small disk of its own in memory, as only root may."""
    ask = ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(folder)]
    try:
        return subprocess.run(ask, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


# Events. Each returns what it did, and what must be undone before all can be well.

Undo = Callable[[], None]
Event = Callable[[Place, random.Random], tuple[str, Undo | None]]


def unmake(draw: random.Random) -> str:
    """Remove what the last stages have made, so that a run has something to do."""
    first = draw.randrange(len(MADE))
    for stage in MADE[first:]:
        for name in stage:
            if draw.random() < 0.9:
                (RESULTS / name).unlink(missing_ok=True)
    return f"from {MADE[first][0]} on"


def ask_for_page(place: Place, draw: random.Random) -> None:
    """Have this event ask for the page or not; remove it, or a part, if it does."""
    place.has_page = draw.random() < WITH_PAGE
    if place.has_page:
        for name in PAGE[draw.randrange(len(PAGE)) :]:
            (RESULTS / name).unlink(missing_ok=True)


def wait(place: Place, draw: random.Random) -> float:
    """Wait for a part of a run's time; often briefly, as a run begins."""
    share = draw.random() ** 2
    seconds = share * place.seconds
    time.sleep(seconds)
    return seconds


def killed(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Kill a job, Snakemake, or all; once, twice or three times."""
    told = []
    for _ in range(draw.choice([1, 1, 2, 3])):
        place.server.start(*place.command())
        after = wait(place, draw)
        whom = draw.choice(["a job", "Snakemake", "all"])
        victims = place.server.session()
        if whom == "a job":
            victims = place.server.jobs()
            victims = [draw.choice(victims)] if victims else []
        elif whom == "Snakemake":
            victims = place.server.driver()
        kill(victims)
        ended = place.server.end()
        told.append(f"{whom} after {after:.2f} s: {ended.code}")
        if whom == "a job" and ended.code > 0:
            require_sentence(ended)
        if draw.random() < 0.5:  # else its jobs outlive it
            kill(place.server.session())
    return "; ".join(told), None


def asked_to_end(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Ask Snakemake, or all, to end: Ctrl-C, a limit of time, a closed terminal."""
    how = draw.choice([signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
    place.server.start(*place.command())
    after = wait(place, draw)
    if draw.random() < 0.5:
        kill(place.server.session(), how)
    else:
        kill(place.server.driver(), how)
    ended = place.server.end()
    return f"{how.name} after {after:.2f} s: {ended.code}", None


def damage(path: Path, draw: random.Random) -> str:
    """Flip a bit of a file, cut it, or empty it; often its date does not tell."""
    before = path.stat()
    content = bytearray(path.read_bytes())
    how = draw.choice(["flip", "flip", "flip", "cut", "empty", "zeros"])
    if not content:
        how = "empty"
    elif how == "flip":
        content[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
    elif how == "cut":
        del content[draw.randrange(len(content)) :]
    elif how == "zeros":
        start = draw.randrange(len(content))
        content[start : start + 512] = bytes(len(content[start : start + 512]))
    if how == "empty":
        content.clear()
    path.write_bytes(content)
    if draw.random() < 0.7:
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    return f"{how} {path}"


def damageable(draw: random.Random, code: Path | None) -> Path | None:
    """Choose a file of any kind that a run has left."""
    kinds = [
        sorted(
            p for p in RESULTS.rglob("*.*") if p.is_file() and p.suffix != ".sha256"
        ),
        sorted(RESULTS.rglob("*.sha256")),
        sorted(p for p in Path(".snakemake/metadata").rglob("*") if p.is_file()),
    ]
    # Compiling anew takes longer than all else.
    if draw.random() < 0.05 and code is not None:
        kinds = [sorted(code.rglob("*.nb?"))]
    kinds = [kind for kind in kinds if kind]
    if not kinds:
        return None
    # Results weigh as much as all others.
    kind = draw.choice([kinds[0], kinds[0], *kinds])
    return draw.choice([p for p in kind if not p.is_dir()] or kind)


def damaged(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Damage files between two runs."""
    told = []
    for _ in range(draw.choice([1, 1, 2, 5])):
        file = damageable(draw, place.code)
        if file is not None and file.is_file():
            told.append(damage(file, draw))
    return "; ".join(told), None


def damaged_meanwhile(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Damage a file while a run is at work."""
    place.server.start(*place.command())
    wait(place, draw)
    told = "nothing"
    file = damageable(draw, place.code)
    with suppress(FileNotFoundError):
        if file is not None:
            told = damage(file, draw)
    ended = place.server.end()
    if ended.code > 0:
        require_sentence(ended)
    return f"{told}: {ended.code}", None


def full_disk(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Fill the disk; or, where no disk may be made, limit the size of files."""
    if not place.ram:
        return limited(place, draw, psutil.RLIMIT_FSIZE, draw.randrange(200_000))
    free = shutil.disk_usage(".").free
    left = draw.choice([0, 4096, draw.randrange(100_000), draw.randrange(1_000_000)])
    ballast = Path("ballast")
    with ballast.open("wb") as file, suppress(OSError):
        os.posix_fallocate(file.fileno(), 0, max(free - left, 0))
    ended = place.server.run(*place.command())
    require_sentence(ended)
    return f"{left} bytes left: {ended.code}", ballast.unlink


def no_memory(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Limit the memory of a run."""
    return limited(place, draw, psutil.RLIMIT_AS, None)


def memory_group() -> tuple[Path, str] | None:
    """Make a control group, and name its file of the limit; None where that may not be."""
    for folder, limit in (
        (Path("/sys/fs/cgroup/memory"), "memory.limit_in_bytes"),
        (Path("/sys/fs/cgroup"), "memory.max"),
    ):
        group = folder / f"hopdata-chaos-{os.getpid()}"
        with suppress(OSError):
            group.mkdir(exist_ok=True)
            if (group / limit).exists():
                return group, limit
            group.rmdir()
    return None


def oom_killed(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Have the system kill what uses too much memory: Snakemake, its jobs, or a job."""
    made = memory_group()
    if made is None:
        return no_memory(place, draw)
    group, limit = made
    n_bytes = int(draw.uniform(1, 20) * 1e6)
    (group / limit).write_text(str(n_bytes))
    before = oom_kills().on_machine or 0
    place.server.start(*place.command())
    time.sleep(draw.random() * place.seconds / 4)
    for process in place.server.session():
        with suppress(OSError):
            (group / "cgroup.procs").write_text(str(process.pid))
    ended = place.server.end()
    n_killed = (oom_kills().on_machine or 0) - before
    kill(place.server.session())
    with suppress(OSError):
        group.rmdir()
    if ended.code > 0:
        require_sentence(ended)
        # The run itself has counted, in the control groups in which it was.
        reason = ended.sentence
        if n_killed and "was killed (SIGKILL) by a person" in reason:
            raise FindingError(f"the system killed a job, and was not named: {reason}")
    return f"{n_bytes / 1e6:.0f} MB, {n_killed} killed: {ended.code}", None


def limited(
    place: Place, draw: random.Random, kind: int, limit: int | None
) -> tuple[str, Undo | None]:
    """Set a limit on a run that has begun, and so on the jobs that it starts."""
    place.server.start(*place.command())
    time.sleep(draw.random() * place.seconds / 4)
    more = int(draw.random() ** 2 * 400e6)
    size = None  # if it has already ended
    for process in place.server.driver():
        with suppress(psutil.Error, OSError):
            size = limit if limit is not None else process.memory_info().vms + more
            process.rlimit(kind, (size, size))
    ended = place.server.end()
    require_sentence(ended)
    return f"limit of {size}: {ended.code}", None


def clock(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Move the dates of files, as a clock that jumps would have."""
    source = Path("data/part.h5")
    then = source.stat()
    moved = [p for p in RESULTS.rglob("*") if p.is_file() and draw.random() < 0.3]
    days = draw.choice([-400, -1, 1 / 24, 1, 400])
    if draw.random() < 0.2:
        moved = [source]
    for path in moved:
        with suppress(FileNotFoundError):
            os.utime(path, (time.time() + days * _DAY_S,) * 2)
    ended = place.server.run(*place.command())
    told = f"{len(moved)} files moved by {days:.2f} days: {ended.code}"

    def undo() -> None:
        os.utime(source, ns=(then.st_atime_ns, then.st_mtime_ns))

    if ended.code:
        try:
            require_sentence(ended)
        except FindingError:
            undo()  # a recording that is dated ahead would end all that follows
            raise
        return told, undo
    is_ahead = days > 0 and moved not in ([], [source])
    if is_ahead and "a clock is or was wrong" not in ended.said:
        raise FindingError(f"{told}, of which nothing was said")
    return told, None


def two_at_once(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Start the same command twice."""
    place.server.start(*place.command())
    time.sleep(draw.random() ** 2 * place.seconds / 2)
    place.other.start(*place.command())
    first = place.server.end()
    second = place.other.end()
    for ended in (first, second):
        if ended.code > 0:
            require_sentence(ended)
    if first.code and second.code:
        raise FindingError(f"neither run came to its end: {first.said}{second.said}")
    return f"{first.code} and {second.code}", None


def read_only(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Make a part of the folder read-only."""
    part = draw.choice(
        [RESULTS, RESULTS / "tables", RESULTS / "level", Path(".snakemake")]
    )
    part = Path(".").resolve() / part
    if not place.ram or not part.is_dir():
        return f"{part.name}: not possible here", None
    subprocess.run(["mount", "--bind", part, part], check=True)
    subprocess.run(["mount", "-o", "remount,ro,bind", part], check=True)

    def undo() -> None:
        subprocess.run(["umount", "-l", part], check=True)

    try:
        ended = place.server.run(*place.command())
        require_sentence(ended)
    except FindingError:
        undo()
        raise
    return f"{part.name}: {ended.code}", undo


def stalled(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Halt all processes now and then, as a slow shared folder does; then kill or not."""
    place.server.start(*place.command())
    for _ in range(draw.randrange(1, 4)):
        time.sleep(draw.random() * place.seconds / 8)
        halted = place.server.session()
        kill(halted, signal.SIGSTOP)
        time.sleep(draw.random())
        kill(halted, signal.SIGCONT)
    is_killed = draw.random() < 0.3
    if is_killed:
        kill(place.server.session())
    ended = place.server.end()
    if ended.code > 0:
        require_sentence(ended)
    return f"{'killed' if is_killed else 'left'}: {ended.code}", None


def commands(place: Place, draw: random.Random) -> tuple[str, Undo | None]:
    """Kill ``hopdata run`` or its Snakemake, as a user started them; run it again."""
    ask = [sys.executable, "-P", "-m", "hopdata", "run", "small.yaml", "--"]
    ask += place.targets()
    environment = {**os.environ, **compiled_in(place.code)}
    process = subprocess.Popen(
        ask, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        start_new_session=True,
    )  # fmt: skip
    time.sleep(draw.random() * max(place.seconds, 10))
    whom = draw.choice(["hopdata", "Snakemake", "all"])
    if whom == "hopdata":
        process.kill()
    elif whom == "all":
        os.killpg(process.pid, signal.SIGKILL)
    else:
        with suppress(psutil.Error):
            kill(psutil.Process(process.pid).children()[:1])
    process.wait()
    if whom != "all":
        time.sleep(1)
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    again = subprocess.run(
        ask, env=environment, capture_output=True, text=True, check=False
    )
    if again.returncode or "Traceback" in again.stderr:
        raise FindingError(
            f"hopdata run after {whom} was killed: {again.stderr[-2000:]}"
        )
    return f"{whom}: {again.stderr.splitlines()[:1]}", None


EVENTS: dict[Event, int] = {
    killed: 30,
    asked_to_end: 8,
    damaged: 20,
    damaged_meanwhile: 10,
    full_disk: 8,
    no_memory: 3,
    oom_killed: 5,
    clock: 5,
    two_at_once: 6,
    read_only: 4,
    stalled: 3,
    commands: 1,
}


# The oracle.


def require_sentence(ended: Run) -> None:
    """Require that a run that failed says in one sentence what to do."""
    if ended.code and not ended.sentence:
        raise FindingError(
            f"code {ended.code} without a sentence: {ended.said[-3000:]}"
        )


def require_whole(place: Place) -> None:
    """Repeat the command, and require the bytes of the undisturbed run."""
    began = time.monotonic()
    again = place.server.run(*place.command())
    if again.code:
        raise FindingError(
            f"the repeated command ends with {again.code}: {again.said[-3000:]}"
        )
    if "Traceback" in again.said:
        raise FindingError(
            f"the repeated command has a traceback: {again.said[-3000:]}"
        )
    place.seconds = 0.8 * place.seconds + 0.2 * max(time.monotonic() - began, 2.0)
    now = place.files()
    named = {*place.whole, *now}
    if not place.has_page:
        # What is damaged and not asked for is made again when it is.
        named -= {*place.whole} - place.without_page
    differ = sorted(
        name
        for name in named
        if place.whole.get(name) != now.get(name) and (name in TARGETS or name in now)
    )
    if differ:
        raise FindingError(
            f"other bytes: {', '.join(differ)}; said: {again.said[-2000:]}"
        )


def one_event(
    place: Place, seed: int, number: int, kind: str | None = None
) -> dict[str, object]:
    """Do one event and check what follows; return its row of the log."""
    draw = random.Random(f"{seed} {number}")
    event = draw.choices([*EVENTS], weights=[*EVENTS.values()])[0]
    if kind is not None:
        (event,) = (one for one in EVENTS if one.__name__ == kind)
    row: dict[str, object] = {"seed": seed, "event": number, "kind": event.__name__}
    row["of"] = kind or "all"
    began = time.monotonic()
    try:
        row["unmade"] = unmake(draw)
        ask_for_page(place, random.Random(f"{seed} {number} page"))
        row["page"] = place.has_page
        # These want something to work on.
        if event in (damaged, clock) and draw.random() < 0.7:
            place.server.run(*place.command())
        row["did"], undo = event(place, draw)
        if undo is not None:
            undo()
        require_whole(place)
    except FindingError as finding:
        row["finding"] = str(finding)
        Path("ballast").unlink(missing_ok=True)
        place.reset()
    row["seconds"] = round(time.monotonic() - began, 1)
    return row


def main() -> int:
    """Do the events that are not done yet; report how many of each kind, and findings."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--events", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, help="do this event alone")
    kinds = [event.__name__ for event in EVENTS]
    parser.add_argument("--kind", choices=kinds, help="do only events of this kind")
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "chaos")
    parser.add_argument(
        "--packages-code", action="store_true",
        help="use the compiled code of the package, and do not damage it",
    )  # fmt: skip
    options = parser.parse_args()
    folder = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "events.jsonl"
    rows = []
    if log.exists():
        rows = [json.loads(line) for line in log.read_text().splitlines()]
    asked = (options.seed, options.kind or "all")
    done = {
        row["event"] for row in rows if (row["seed"], row.get("of", "all")) == asked
    }
    numbers = [number for number in range(options.events) if number not in done]
    if options.only is not None:
        numbers = [options.only]
    if not numbers:
        print(f"all {options.events} events are done; {log}")
        return 1 if any("finding" in row for row in rows) else 0
    code = None if options.packages_code else folder / "code"
    place = Place(folder / "study", code)
    place.make()
    until = time.monotonic() + 60 * options.minutes
    new = []
    try:
        for number in numbers:
            if time.monotonic() > until:
                break
            row = one_event(place, options.seed, number, options.kind)
            new.append(row)
            with log.open("a") as file:
                file.write(json.dumps(row) + "\n")
            if "finding" in row:
                print(f"{number} {row['kind']}: {row['finding']}", flush=True)
    finally:
        place.leave()
    counts = Counter(str(row["kind"]) for row in new)
    findings = [row for row in new if "finding" in row]
    told = ", ".join(f"{kind} {number}" for kind, number in sorted(counts.items()))
    print(f"{len(new)} events ({told}): {len(findings)} findings; {log}")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
