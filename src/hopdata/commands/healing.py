"""What of an earlier run is damaged, and is made again by the next.

A file that differs from what its job wrote gets the mark that Snakemake gives to the
files of a job that has begun and not ended. So what is damaged takes the way of what
is half written: Snakemake makes it again, and an interrupted repair is repeated.
"""

import base64
import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from hopdata.digests import changed_in
from hopdata.errors import printable

MARKS = Path(".snakemake/incomplete")
METADATA = Path(".snakemake/metadata")
#: Longest name of Snakemake's records; longer ones are cut into folders.
_LONGEST_NAME = 254


def heal(*folders: str | Path) -> str:
    """Have the damaged files of finished jobs made again.

    Call it only while no run is at work here: a file that is being written differs from
    its digest.

    Returns
    -------
    str
        What was found, in one line; empty if nothing.
    """
    changed: dict[Path, Path] = {}
    for folder in folders:
        changed |= changed_in(folder)
    damaged = [str(what) for what in changed.values()]
    of_records = [*_with_damaged_record()]
    with suppress(OSError):  # Snakemake itself complains if a folder is not writable
        for file in [*map(str, changed), *of_records]:
            _mark(file)
        # Last: a record that is gone can no longer tell that it was damaged.
        for file in of_records:
            _record(METADATA, file).unlink(missing_ok=True)
    told = []
    if damaged:
        told.append(_told(damaged, "not as written (damaged, or changed by hand)"))
    if of_records:
        told.append(_told(of_records, "known from a damaged record of Snakemake"))
    return "; ".join(told)


def _told(files: Sequence[str], what: str) -> str:
    first = printable(files[0])
    if len(files) == 1:
        return f"{first} is {what}; it is made again"
    more = len(files) - 1
    return f"{first} and {more} more are {what}; they are made again"


def _mark(file: str) -> None:
    """Mark a file as that of a job that has not ended, as Snakemake does."""
    mark = _record(MARKS, file)
    mark.parent.mkdir(parents=True, exist_ok=True)
    mark.write_text(json.dumps({"external_jobid": None}), encoding="utf-8")


def _record(folder: Path, file: str) -> Path:
    """Return where Snakemake keeps what it knows of a file."""
    coded = base64.urlsafe_b64encode(Path(file).as_posix().encode()).decode()
    parts = [
        coded[start : start + _LONGEST_NAME]
        for start in range(0, len(coded), _LONGEST_NAME)
    ]
    return folder.joinpath(*(f"@{part}" for part in parts[:-1]), parts[-1])


def _with_damaged_record() -> Iterator[str]:
    """Yield the files whose records Snakemake could not read.

    It stops at some of them without naming the record, and takes the others for files
    of which nothing is known: it would not notice a changed key.
    """
    for place in METADATA.rglob("*"):
        if not place.is_file():
            continue
        try:
            content = json.loads(place.read_bytes())
        except (OSError, ValueError):  # not text, or not JSON
            content = None
        if isinstance(content, dict):
            continue
        with suppress(ValueError):
            parts = place.relative_to(METADATA).parts
            coded = "".join(part.removeprefix("@") for part in parts)
            yield base64.urlsafe_b64decode(coded).decode()
