"""A checksum of every byte of a file that hopdata writes, kept at the end of the file.

Libraries that read HDF5 trust the file. HDF5 protects few of its bytes: the Adler-32 of
compressed blocks misses some single flipped bits, and names, rates and places of blocks
have no checksum at all. So the SHA-256 of a file stands behind its last byte, where the
HDF5 library does not look. A program that changes the file through that library cuts
the seal off, so a changed file is not taken for a damaged one.
"""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path

_MARK = b"\nhopdata-sha256 "
_N_BYTES = len(_MARK) + 64 + 1  # the mark, 64 hexadecimal digits, a line end
_BLOCK = 1 << 20  # bytes read at a time


class Seal(Enum):
    """What the seal of a file says."""

    WHOLE = "every byte is as it was written"
    BROKEN = "the bytes differ from those that were written"
    NONE = "there is no seal: another program, or an older version, wrote or changed it"


@contextmanager
def sealed(path: Path) -> Iterator[None]:
    """Append the seal to a file that the block has written and closed."""
    yield
    with path.open("ab") as file:
        file.write(seal_for(path))


def seal_for(path: Path) -> bytes:
    """Return the seal that belongs behind the bytes of a file."""
    return _MARK + _digest(path, path.stat().st_size).encode() + b"\n"


def seal_of(path: str | Path) -> Seal:
    """Compare a file with its seal, without a look at what it holds.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    n_bytes = path.stat().st_size - _N_BYTES
    if n_bytes < 0:
        return Seal.NONE
    with path.open("rb") as file:
        file.seek(n_bytes)
        end = file.read(_N_BYTES)
    if not end.startswith(_MARK):
        return Seal.NONE
    stated = end[len(_MARK) : -1]
    if stated == _digest(path, n_bytes).encode():
        return Seal.WHOLE
    return Seal.BROKEN


def _digest(path: Path, n_bytes: int) -> str:
    """Return the SHA-256 of the first bytes of a file, in hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while n_bytes > 0:
            block = file.read(min(_BLOCK, n_bytes))
            if not block:
                break
            digest.update(block)
            n_bytes -= len(block)
    return digest.hexdigest()
