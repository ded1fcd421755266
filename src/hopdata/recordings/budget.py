"""What a file may cost, known from its size before it is read.

A file is a claim: a few bytes can name millions of markers, nest a thousand groups or
unpack to gigabytes. Readers compare each claim with these limits before they act on it.
All limits leave room for ten million frames, which are rows and not names, links or
longer lines.
"""

from pathlib import Path

#: Memory that all numbers of a packed file may take, as the default of
#: input.most_unpacked_mb in the schema.
#: Unit: MB. Origin: chosen. 1.5 times larger: 1.5 times the memory that a damaged file
#: can ask for.
MOST_UNPACKED_MB = 2000.0

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

#: CPU time that the trial of an HDF5 file may take at least.
#: Unit: s. Origin: chosen. 1.5 times larger: 1.5 times the wait for the answer about a
#: file on which the library hangs.
_LEAST_S = 2.0

#: The same for each object of the file.
#: Unit: s. Origin: measured: 0.5 ms an object on one core of 2020; this is four times
#: as much.
_S_PER_OBJECT = 2e-3

#: Length of an object of such a file.
#: Unit: bytes. Origin: measured: about that.
_BYTES_PER_OBJECT = 400

#: Bytes of the file for each second.
#: Unit: 1/s. Origin: measured: 200 MB a second on one core of 2020; this is a tenth.
_BYTES_PER_S = 20e6


def require_unpacked(n_bytes: int, most_mb: float) -> None:
    """Refuse content that would use more memory than a file may.

    Raises
    ------
    ValueError
        If it would; the message does not name the file.
    """
    if n_bytes > 1e6 * most_mb:
        raise ValueError(
            f"expected at most {most_mb:g} MB once it is unpacked "
            "(input.most_unpacked_mb, --most-unpacked-mb), "
            f"found {n_bytes / 1e6:.0f} MB; raise the limit if the file is right"
        )


def require_few(what: str, number: int, most: int) -> None:
    """Refuse more names, links or levels than any sound file has.

    Raises
    ------
    ValueError
        If there are more; the message does not name the file.
    """
    if number > most:
        raise ValueError(f"expected at most {most:,} {what}, found {number:,}")


def seconds_to_read(path: str | Path) -> float:
    """Return the CPU time that reading a file may take at most, s, from its size."""
    n_bytes = Path(path).stat().st_size
    n_objects = min(n_bytes / _BYTES_PER_OBJECT, MOST_LINKS)
    return _LEAST_S + _S_PER_OBJECT * n_objects + n_bytes / _BYTES_PER_S
