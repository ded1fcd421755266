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
_DRAFTS = ".part"
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


def states_in(folder: str | Path) -> dict[Path, tuple[int, int]]:
    """Return by which numbers one sees that a file below a folder was written anew."""
    found = {}
    for place, _, names in os.walk(folder):
        if Path(place).name == FOLDER:
            continue
        for name in names:
            if name.endswith(_DRAFTS):  # of a killed process
                continue
            status = os.lstat(os.path.join(place, name))
            found[Path(place, name)] = (status.st_ino, status.st_mtime_ns)
    return found


def keep_further(output: str | Path, files: Iterable[str | Path]) -> None:
    """Keep the digests of further files of a job below that of one of its outputs.

    Parameters
    ----------
    output : path
        The output; its own digest is kept already, or it has none (see `keep`).
    files : iterable of path
        Files in its folder, or below that.
    """
    if not place_of(output).exists():
        return
    folder = Path(output).parent
    lines = [
        f"{digest_of(file)}  {Path(file).relative_to(folder).as_posix()}\n"
        for file in sorted(map(Path, files))
    ]
    with place_of(output).open("a", encoding="utf-8", newline="\n") as kept:
        kept.writelines(lines)


def is_changed(file: str | Path) -> bool:
    """Tell whether a file differs from what a job wrote; it does not if none is known.

    Raises
    ------
    OSError
        If the file, or its digest, cannot be read.
    """
    own, _ = _kept(file)
    return bool(own) and own.partition(b" ")[0] != digest_of(file).encode()


def _kept(file: str | Path) -> tuple[bytes, list[bytes]]:
    """Return the line of a file's own digest, and those of further files of its job."""
    try:
        own, *further = place_of(file).read_bytes().split(b"\n")
    except (FileNotFoundError, NotADirectoryError):
        return b"", []
    # A digest without its text is damaged.
    return own or b"\0", [line for line in further if line]


def further_change(file: str | Path) -> Path | None:
    """Return the first further file of a file's job that is not as written, or None.

    Raises
    ------
    OSError
        If one of them cannot be read.
    """
    for line in _kept(file)[1]:
        digest, _, name = line.partition(b"  ")
        place = Path(file).parent / os.fsdecode(name)
        if not place.is_file() or digest_of(place).encode() != digest:
            return place
    return None


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


def changed_in(folder: str | Path) -> dict[Path, Path]:
    """Return the files below a folder that differ from what was written, in order.

    Files without a digest count as whole, and those that cannot be read as changed.

    Returns
    -------
    dict
        By file what is not as written: itself, or a further file of its job.
    """
    files = sorted(_with_digest(folder))
    if not files:
        return {}
    # Reading waits for the disk, and the digest is computed outside of Python's lock.
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        found = zip(files, pool.map(_change, files), strict=True)
        return {file: change for file, change in found if change is not None}


def _with_digest(folder: str | Path) -> Iterator[Path]:
    for place, _, names in os.walk(folder):
        if Path(place).name != FOLDER:
            continue
        for name in names:
            file = Path(place).parent / name.removesuffix(_ENDING)
            if name.endswith(_ENDING) and file.is_file():
                yield file


def _change(file: Path) -> Path | None:
    try:
        if is_changed(file):
            return file
        return further_change(file)
    except OSError:
        return file


def digest_of(file: str | Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits."""
    digest = hashlib.sha256()
    with Path(file).open("rb") as content:
        while True:
            block = content.read(_BLOCK)
            if not block:
                return digest.hexdigest()
            digest.update(block)
