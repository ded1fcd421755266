"""How many names, lines and levels a recording's file may have, and what it unpacks to.

A file is a claim: a few bytes can name millions of markers, nest a thousand groups or
unpack to gigabytes. Readers compare each claim with these limits before they act on it.
Memory and time in all follow from the file's size (`hopdata.foreign.budget`).
All limits leave room for ten million frames, which are rows and not names, links or
longer lines.
"""

from pathlib import Path

from hopdata.foreign.budget import COPIES, unpacked_most

#: Markers of a recording.
#: Unit: 1. Origin: chosen. The largest systems track some hundred; the unnamed
#: fragments of an hour of tracking are some thousand. 1.5 times larger: a bad file is
#: refused after 1.5 times the work, about 5 s.
MOST_MARKERS = 20_000

#: Length of a line of text.
#: Unit: bytes. Origin: derived: three coordinates of all markers at 25 characters each.
#: 1.5 times larger: 1.5 times the memory for a line that is split, some 30 bytes a
#: byte.
LONGEST_LINE = 1_500_000

#: Columns of a text table.
#: Unit: 1. Origin: derived: the coordinates of all markers, and some counters. pandas
#: takes some 20 us for each. 1.5 times larger: 1.5 times the time for a bad file, about
#: 3 s.
MOST_COLUMNS = 3 * MOST_MARKERS + 100

#: Cells of text that are split or parsed at a time.
#: Unit: 1. Origin: chosen. They take 8 bytes each once parsed, about 60 before. 1.5
#: times larger: 1.5 times the memory of a block, about 250 MB; the times do not change.
MOST_CELLS = 4_000_000

#: What one byte of deflated data can expand to at most.
#: Unit: bytes. Origin: derived: 258 bytes for 2 bits.
DEFLATE_MOST = 1032

#: Links of an HDF5 file, and items of a MAT file.
#: Unit: 1. Origin: chosen. MATLAB writes one for each cell of a cell array. 1.5 times
#: larger: 1.5 times the time for a bad file, about 1 s.
MOST_LINKS = 20_000

#: Matrices of a MAT file up to version 7: variables, fields and cells.
#: Unit: 1. Origin: chosen. 1.5 times larger: 1.5 times the time for a bad file, about
#: 3 s.
MOST_MATRICES = 100_000

#: Groups within groups.
#: Unit: 1. Origin: chosen. Real files have about five levels. 1.5 times larger: no
#: difference.
DEEPEST = 32


def require_unpacked(n_bytes: int, most_mb: float) -> None:
    """Refuse content that would use more memory than a file may.

    Raises
    ------
    ValueError
        If it would; the message does not name the file.
    """
    if n_bytes > 1e6 * most_mb:
        found = f"found {n_bytes / 1e6:.0f} MB; export it in parts if it is right"
        raise ValueError(
            f"expected at most {most_mb:g} MB once it is unpacked, {found}"
        )


def require_memory(n_bytes: int, most_mb: float) -> None:
    """Refuse content whose texts and objects would use more than a process may.

    Parameters
    ----------
    n_bytes : int
        Memory of all that is made before there are arrays.
    most_mb : float
        Memory that the arrays may take, MB.

    Raises
    ------
    ValueError
        If it would; the message does not name the file.
    """
    require_unpacked(n_bytes, COPIES * most_mb)


def unpacked_mb(path: Path) -> float:
    """Return the memory that the numbers of a file may take, MB, from its size."""
    return unpacked_most(path.stat().st_size) / 1e6


def require_few(what: str, number: int, most: int) -> None:
    """Refuse more names, links or levels than any sound file has.

    Raises
    ------
    ValueError
        If there are more; the message does not name the file.
    """
    if number > most:
        raise ValueError(f"expected at most {most:,} {what}, found {number:,}")
