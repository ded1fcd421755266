"""Output of a command: exit codes, tables and progress on a terminal, written files.

Tables and progress are drawn by rich, but only on a terminal: what goes into a pipe or
a log is plain text. Rich is loaded when something is drawn, since it takes time.
"""

from __future__ import annotations

import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TextIO, cast

from hopdata.errors import NO_BREAK_SPACES, HopdataError, printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from hopdata.commands.progress import Show

# Exit codes of a command; argparse itself exits with 2 on a wrong command line.

OK = 0
PROBLEM = 1
INTERRUPTED = 130


# What is written to a terminal. Names and messages come from files, and a terminal
# obeys what it is told between letters: it moves, hides and links text, and fills the
# clipboard. So all that a command prints passes `printable`.


class Screened:
    """A stream that passes on text without what a terminal would obey.

    Line ends and tabs stay. What hopdata itself tells the terminal goes to `raw`.

    Parameters
    ----------
    raw : text stream
        Where the text goes.
    """

    def __init__(self, raw: TextIO) -> None:
        self.raw = raw

    def write(self, text: str) -> int:
        """Write a text."""
        screened = printable(text, keep=f"\n\t{NO_BREAK_SPACES}")
        encoding = getattr(self.raw, "encoding", None) or "utf-8"
        # Of a stream in ASCII, as of some schedulers, ± becomes a question mark.
        self.raw.write(screened.encode(encoding, "replace").decode(encoding))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write texts, one after the other."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.raw, name)


@contextmanager
def screened() -> Iterator[None]:
    """Pass all that is printed meanwhile, in this process, through `printable`."""
    before = (sys.stdout, sys.stderr)
    sys.stdout = cast("TextIO", Screened(before[0]))
    sys.stderr = cast("TextIO", Screened(before[1]))
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def raw_stream(stream: TextIO) -> TextIO:
    """Return the stream to which hopdata may write what a terminal obeys."""
    return stream.raw if isinstance(stream, Screened) else stream


def width(most: int) -> int:
    """Return the columns of the terminal that shows stdout, at most so many."""
    if not sys.stdout.isatty():
        return most
    return max(40, min(most, shutil.get_terminal_size().columns))


def note(text: str) -> None:
    """Print a note, whole words to a line on a terminal."""
    line = f"note: {text}"
    if sys.stdout.isatty():
        line = textwrap.fill(
            line, width(10**4), subsequent_indent="  ", break_on_hyphens=False
        )
    print(line)


# Tables on stdout.

Side = Literal["left", "right"]


def draw_table(
    columns: Mapping[str, Side], rows: Iterable[Iterable[str]], *, title: str = ""
) -> None:
    """Draw a table on a terminal.

    Parameters
    ----------
    columns : mapping
        Heading of each column, and the side to which its cells are flush.
    rows : iterable of iterables of str
        Its cells.
    title : str
        What the table shows.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(title=title or None, title_justify="left", box=SIMPLE_HEAD)
    for heading, side in columns.items():
        table.add_column(heading, justify=side)
    for row in rows:
        table.add_row(*map(printable, row))
    _console().print(table)


def print_table(
    columns: Mapping[str, Side], rows: Iterable[Iterable[str]], *, plain: str
) -> None:
    """Draw a table if stdout is a terminal; else print it as `plain`, in plain text."""
    if sys.stdout.isatty():
        draw_table(columns, rows)
    else:
        print(plain)


def _console(*, stderr: bool = False) -> Console:
    """Return a console that shows text as it is: names may look like markup."""
    from rich.console import Console

    stream = raw_stream(sys.stderr if stderr else sys.stdout)
    return Console(file=stream, markup=False, emoji=False, highlight=False)


# Progress on stderr, gone when the work is done.


@contextmanager
def progress_line(first: str = "") -> Iterator[Callable[[str], None]]:
    """Show the step of some work on a terminal, and nothing elsewhere.

    Parameters
    ----------
    first : str
        The first step.

    Yields
    ------
    callable
        Shows another step.
    """
    if not sys.stderr.isatty():
        yield lambda _step: None
        return
    with _console(stderr=True).status(_waiting(first)) as status:
        yield lambda step: status.update(_waiting(step))


def _waiting(step: str) -> str:
    return f"{printable(step)} ..." if step else ""


#: Time after which a run that no terminal shows says how far it is, though no stage
#: has ended: half a minute.
#: Unit: s. Origin: chosen. 1.5 times larger: a line each 45 s for a long stage.
_QUIET_S = 30.0


@contextmanager
def progress_bar(title: str) -> Iterator[Show]:
    """Show a line for each stage of a run that has ended; a bar below on a terminal.

    Parameters
    ----------
    title : str
        What the stages belong to.

    Yields
    ------
    callable
        `hopdata.commands.progress.Show`.
    """
    if not sys.stderr.isatty():
        yield stage_lines(title)
        return
    with _drawn_progress() as progress:
        task = progress.add_task(printable(title), total=None, remark="")

        def show(done: int, of: int, remark: str, stage: str = "") -> None:
            if stage:
                progress.console.print(f"  {printable(stage)}", soft_wrap=True)
            shown = printable(remark)
            progress.update(task, completed=done, total=of, remark=shown)

        yield show


def stage_lines(title: str) -> Show:
    """Return what tells of a run on stderr in lines, as in a log.

    There is a line before the first job, one for each stage that has ended, and of a
    long stage some meanwhile.
    """
    last_s = time.monotonic()

    def show(done: int, of: int, remark: str, stage: str = "") -> None:
        nonlocal last_s
        now_s = time.monotonic()
        if not stage and 0 < done < of and now_s - last_s < _QUIET_S:
            return
        last_s = now_s
        how_far = f"{done} of {of} jobs done, {remark}"
        told = f"{stage}; {how_far}" if stage else how_far
        print(f"{title}: {told}", file=sys.stderr, flush=True)

    return show


def _drawn_progress() -> Progress:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.table import Column

    def text(pattern: str, width: int | None = None) -> TextColumn:
        # What is long is cut, so that the bar stays one line.
        column = Column(no_wrap=True, overflow="ellipsis", max_width=width)
        return TextColumn(pattern, markup=False, table_column=column)

    return Progress(
        text("{task.description}", width=20),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        text("jobs done {task.fields[remark]}"),
        console=_console(stderr=True),
    )


# Files written by a command: complete or not at all, with one clear message.


def write_text(path: Path, text: str) -> None:
    """Write a text file, creating the folders on its path.

    Raises
    ------
    HopdataError
        If the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        found = f"expected a file that can be written, found: {error.strerror}"
        raise HopdataError(f"{path}: {found}") from None
