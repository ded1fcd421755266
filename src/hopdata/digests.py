"""Digests of the files that jobs write: a changed bit is noticed before it is used.

A job keeps the SHA-256 of each file that it has written in a folder ``.sha256`` beside
the file, in the form of ``sha256sum``. A job that reads the file compares first, and so
does the start of a run, which makes a file that differs again. HDF5 files carry a seal
too (`hopdata.seal`), which goes with a copy; CSV, JSON, pictures and pages are what
other programs read, and have no room for one.

A digest is no protection against somebody who writes here: they can write both.
"""

import hashlib
import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from hopdata.errors import DamagedError

FOLDER = ".sha256"
_ENDING = ".sha256"
_COPIES = ".snakemake"
_BLOCK = 1 << 20  # bytes read at a time


def place_of(file: str | Path) -> Path:
    """Return the file that holds the digest of a file."""
    file = Path(file)
    return file.parent / FOLDER / f"{file.name}{_ENDING}"


def keep(files: Iterable[str | Path]) -> None:
    """Keep the digests of files that were just written; what is absent has none.

    Raises
    ------
    OSError
        If they cannot be written. The caller has not finished then, so that its files
        are made again.
    """
    for file in map(Path, files):
        # Below this folder are copies of what lies in object storage, where another
        # machine may replace it without a look at a digest that is here.
        if not file.is_file() or _COPIES in file.parts:
            continue
        place = place_of(file)
        place.parent.mkdir(exist_ok=True)
        text = f"{digest_of(file)}  {file.name}\n"
        place.write_text(text, encoding="utf-8", newline="\n")


def is_changed(file: str | Path) -> bool:
    """Tell whether a file differs from what a job wrote; it does not if none is known.

    Raises
    ------
    OSError
        If the file, or its digest, cannot be read.
    """
    try:
        kept = place_of(file).read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return kept.partition(b" ")[0] != digest_of(file).encode()


def require_unchanged(files: Iterable[str | Path]) -> None:
    """Require that files are as the jobs that made them have written them.

    Raises
    ------
    DamagedError
        If one is not.
    """
    for file in files:
        if Path(file).is_file() and is_changed(file):
            wanted = "the bytes that were written"
            found = "others: the disk is damaged, or somebody changed it"
            raise DamagedError.at(file, wanted, f"{found}; the next run makes it again")


def changed_in(folder: str | Path) -> list[Path]:
    """Return the files below a folder that differ from what was written, in order.

    Files without a digest count as whole, and those that cannot be read as changed.
    """
    files = sorted(_with_digest(folder))
    if not files:
        return []
    # Reading waits for the disk, and the digest is computed outside of Python's lock.
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        return [
            file
            for file, differs in zip(files, pool.map(_differs, files), strict=True)
            if differs
        ]


def _with_digest(folder: str | Path) -> Iterator[Path]:
    for place, _, names in os.walk(folder):
        if Path(place).name != FOLDER:
            continue
        for name in names:
            file = Path(place).parent / name.removesuffix(_ENDING)
            if name.endswith(_ENDING) and file.is_file():
                yield file


def _differs(file: Path) -> bool:
    try:
        return is_changed(file)
    except OSError:
        return True


def digest_of(file: str | Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits."""
    digest = hashlib.sha256()
    with Path(file).open("rb") as content:
        while True:
            block = content.read(_BLOCK)
            if not block:
                return digest.hexdigest()
            digest.update(block)
