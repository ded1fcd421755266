"""Which entries of a field's Jacobian may differ from zero, and how to use it.

The user gives the pattern. From it follow the groups of columns that one difference
serves (Curtis, Powell and Reid, *J. Inst. Maths Applics* 13, 1974), the order of the
states in which the factors of the matrix stay small, and the places of all entries in
them. All of this is done once per system, in Python; a step reads it by its address.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hopdata.arrays import IntArray
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.methods.directory import DIRECTORY_SLOTS, SLOTS

WANTED = (
    "a matrix (n, n) that is not zero where dy[i] depends on y[j] (SciPy's sparse or "
    "an array), the bandwidths (lower, upper), or 'auto'"
)


class Pattern:
    """The places of a Jacobian (n, n) that may differ from zero.

    Parameters
    ----------
    n_states : int
        Number of rows and columns.
    rows, columns : (nnz,) arrays of int
        The places, in any order.
    bandwidths : tuple of int, optional
        Diagonals below and above the main one, if the pattern was given by them.
    is_proven : bool
        Whether it follows from the field's code for all states, modes and parameters.
    """

    def __init__(
        self,
        n_states: int,
        rows: IntArray,
        columns: IntArray,
        bandwidths: tuple[int, int] | None = None,
        is_proven: bool = False,
    ) -> None:
        places = np.unique(rows.astype(np.int64) * n_states + columns)
        self.n_states = n_states
        self.rows = places // n_states
        self.columns = places % n_states
        self.bandwidths = bandwidths
        self.is_proven = is_proven

    def __repr__(self) -> str:
        return f"<pattern of {len(self.rows)} of {self.n_states}^2 derivatives>"

    @cached_property
    def _key(self) -> tuple[Any, ...]:
        content = self.rows.tobytes() + self.columns.tobytes()
        return self.n_states, self.bandwidths, hashlib.sha256(content).hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Pattern) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[Any, ...]:
        given = self.n_states, self.rows, self.columns, self.bandwidths
        return Pattern, (*given, self.is_proven)

    @property
    def given_shape(self) -> tuple[int, int]:
        """Shape of the array that the user's `@jacobian` fills.

        It has one row for each diagonal or, if the pattern was given as a matrix, one
        row with all entries.
        """
        if self.bandwidths is None:
            return 1, len(self.rows)
        return sum(self.bandwidths) + 1, self.n_states

    @cached_property
    def given_places(self) -> IntArray:
        """Place of each entry in that array, counted row by row."""
        if self.bandwidths is None:
            return np.arange(len(self.rows))
        diagonal = self.bandwidths[1] + self.rows - self.columns
        return diagonal * self.n_states + self.columns

    @cached_property
    def row_starts(self) -> IntArray:
        """First entry of each row, and the number of entries, (n + 1,)."""
        return starts_of(self.rows, self.n_states)

    @cached_property
    def colours(self) -> IntArray:
        """Group of each column: no row has entries in two columns of a group, (n,)."""
        if self.bandwidths is not None:
            return np.arange(self.n_states) % (sum(self.bandwidths) + 1)
        from hopdata.hybrid.methods.ordering import colour_columns

        by_column = np.argsort(self.columns, kind="stable")
        rows_of = self.rows[by_column]
        column_starts = starts_of(self.columns, self.n_states)
        best: IntArray | None = None
        largest_first = np.argsort(-np.diff(column_starts), kind="stable")
        for sequence in (np.arange(self.n_states), largest_first):
            found = colour_columns(
                sequence, column_starts, rows_of, self.row_starts, self.columns
            )
            if best is None or found.max() < best.max():
                best = found
        assert best is not None
        return best

    @cached_property
    def structure(self) -> Structure:
        """What a step needs to know of it."""
        return Structure(self)


def starts_of(groups: IntArray, n_groups: int) -> IntArray:
    """Return where each group starts in a list sorted by group, and the list's end."""
    counts = np.bincount(groups, minlength=n_groups)
    return np.concatenate([[0], np.cumsum(counts)])


def pattern_of(given: Any, n_states: int) -> Pattern | None:
    """Return the pattern that a user describes.

    Raises
    ------
    ArgumentError
        If it is neither a matrix of this size nor a pair of bandwidths.
    """
    if given is None:
        return None
    if isinstance(given, Pattern):
        # A system with its parameters as states has more of them.
        return given if given.n_states == n_states else None
    if isinstance(given, tuple | list) and len(given) == 2 and np.ndim(given[0]) == 0:
        return _banded(given, n_states)
    if hasattr(given, "tocoo"):
        shape = given.shape
        found = given.tocoo()
        rows = found.row
        columns = found.col
    else:
        try:
            array = np.asarray(given) != 0
        except (TypeError, ValueError):
            array = np.zeros(())
        expect(array.ndim == 2, "sparsity", WANTED, repr(given))
        shape = array.shape
        rows, columns = np.nonzero(array)
    wanted = f"a matrix of shape ({n_states}, {n_states})"
    expect(shape == (n_states, n_states), "sparsity", wanted, f"shape {shape}")
    return Pattern(n_states, rows, columns)


def _banded(given: Any, n_states: int) -> Pattern:
    """Return the pattern of a band matrix."""
    whole = all(isinstance(one, int | np.integer) for one in given)
    inside = whole and all(0 <= one < n_states for one in given)
    wanted = f"bandwidths (lower, upper), whole numbers from 0 to {n_states - 1}"
    expect(inside, "sparsity", wanted, repr(given))
    lower, upper = map(int, given)
    rows = []
    columns = []
    for offset in range(-lower, upper + 1):
        row = np.arange(max(0, -offset), min(n_states, n_states - offset))
        rows.append(row)
        columns.append(row + offset)
    return Pattern(
        n_states, np.concatenate(rows), np.concatenate(columns), (lower, upper)
    )


# The matrix I / (GAMMA dt) - J is factorised in one of two ways.
#
# As a band, with partial pivoting: no indices, contiguous loops. As a general sparse
# matrix, whose factors have the pattern that symmetric elimination gives, without
# pivoting; a solution that is not accurate then shortens the step, which makes the
# diagonal larger (see `sparse`).

#: Operations of a band's elimination that take the time of one of a sparse matrix.
#: Unit: 1. Origin: measured: 3.1 to 4 for heat on grids of 10 to 64 points a side
#: (processor time of whole steps).
BAND_IS_FASTER = 3.5

#: Width of a band, in diagonals, up to which no other way is tried.
#: Unit: 1. Origin: chosen.
NARROW = 16


@dataclass(frozen=True)
class Factors:
    """Places of the entries of the factors.

    Parameters
    ----------
    order : (n,) array of int
        The state that comes first, second, ...
    below, above : int
        Diagonals of the band below and above the main one, in this order; zero of a
        general sparse matrix.
    starts, columns, diagonal : arrays of int
        Of a general sparse matrix: first entry of each row of the factors, (n + 1,),
        the column of each entry, and the entry on the diagonal of each row, (n,). They
        are empty of a band.
    """

    order: IntArray
    below: int
    above: int
    starts: IntArray
    columns: IntArray
    diagonal: IntArray

    @property
    def is_band(self) -> bool:
        """Whether the matrix is stored as a band."""
        return len(self.columns) == 0

    @property
    def is_narrow(self) -> bool:
        """Whether it is a band for which no other way is tried."""
        return self.is_band and self.below + self.above + 1 <= NARROW

    @property
    def width(self) -> int:
        """Entries of a row of the band, with room for row exchanges."""
        return 2 * self.below + self.above + 1

    @property
    def size(self) -> int:
        """Number of entries."""
        if self.is_band:
            return self.width * len(self.order)
        return len(self.columns)


def bandwidths_in(order: IntArray, pattern: Pattern) -> tuple[int, int]:
    """Return the diagonals below and above the main one if the states are reordered."""
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    offset = place[pattern.rows] - place[pattern.columns]
    return int(max(0, offset.max(initial=0))), int(max(0, -offset.min(initial=0)))


def band_operations(below: int, above: int, n_states: int) -> float:
    """Return the operations of a band's elimination with row exchanges."""
    return float(n_states) * below * (below + above + 1)


def factors_of(pattern: Pattern) -> Factors:
    """Return the factors that take the least time.

    Without SciPy the states keep their order.
    """
    n = pattern.n_states
    nothing = np.empty(0, dtype=np.int64)
    order = np.arange(n)
    below, above = bandwidths_in(order, pattern)
    band = Factors(order, below, above, nothing, nothing, nothing)
    if band.is_narrow:
        return band
    try:
        from hopdata.hybrid.methods import ordering

        narrow = ordering.narrow_order(n, pattern.rows, pattern.columns)
    except ImportError:
        return band
    below, above = bandwidths_in(narrow, pattern)
    if band_operations(below, above, n) < band_operations(band.below, band.above, n):
        band = Factors(narrow, below, above, nothing, nothing, nothing)
    if band.is_narrow:
        return band
    order = ordering.sparse_order(n, pattern.rows, pattern.columns)
    starts, columns, diagonal = ordering.symbolic(
        order, pattern.rows, pattern.columns, n
    )
    right = starts[1:] - diagonal - 1  # entries right of the diagonal, as below it
    sparse_operations = float((right.astype(float) ** 2).sum())
    operations = band_operations(band.below, band.above, n)
    if operations < BAND_IS_FASTER * sparse_operations:
        return band
    return Factors(order, 0, 0, starts, columns, diagonal)


def rows_alike(factors: Factors) -> IntArray:
    """Return how many rows from each one on have the same columns to their right.

    A row is like the next if it has the next row's columns right of the diagonal, and
    one more, the next row's diagonal itself. Rows of dense blocks are of this kind.
    """
    if factors.is_band:
        return np.empty(0, dtype=np.int64)
    n = len(factors.order)
    rows = np.arange(n)
    right = factors.starts[1:] - factors.diagonal - 1
    first = np.full(n, n)  # column right of the diagonal; n if there is none
    first[right > 0] = factors.columns[factors.diagonal[right > 0] + 1]
    # A row's other columns are among those of the row with the number of the first.
    like_next = (first[:-1] == rows[1:]) & (right[:-1] == right[1:] + 1)
    last = np.flatnonzero(np.append(~like_next, True))
    return last[np.searchsorted(last, rows)] - rows + 1


class Structure:
    """A directory in memory, and the arrays to which it refers.

    Parameters
    ----------
    pattern : Pattern
        Pattern of the Jacobian.

    Attributes
    ----------
    n_colours : int
        Number of groups of columns.
    factors : Factors
        Places of the entries of the factors.
    entry_rows, matrix_rows : int
        Rows of states that the Jacobian's entries and the matrix take.
    address : int
        Address of the directory.
    """

    def __init__(self, pattern: Pattern) -> None:
        n = pattern.n_states
        self.factors = factors_of(pattern)
        colours = pattern.colours
        self.n_colours = int(colours.max()) + 1
        by_colour = np.lexsort((pattern.rows, colours[pattern.columns]))
        order = self.factors.order
        place = np.empty_like(order)
        place[order] = np.arange(n)
        given_rows, given_columns = pattern.given_shape
        n_entries = len(pattern.rows)
        largest = max(self.factors.size, given_rows * given_columns)
        self.entry_rows = -(-n_entries // n)
        self.matrix_rows = -(-largest // n)
        self._arrays = {
            "colour_of": colours,
            "columns": np.argsort(colours, kind="stable"),
            "first_column": starts_of(colours, self.n_colours),
            "entry": by_colour,
            "row_of": pattern.rows[by_colour],
            "column_of": pattern.columns[by_colour],
            "first_entry": starts_of(colours[pattern.columns], self.n_colours),
            "given_places": pattern.given_places,
            "row_starts": pattern.row_starts,
            "entry_columns": pattern.columns,
            "places": self._places(place[pattern.rows], place[pattern.columns]),
            "diagonal": self._places(place, place),
            "order": order,
            "factor_starts": self.factors.starts,
            "factor_columns": self.factors.columns,
            "factor_diagonal": self.factors.diagonal,
            "alike": rows_alike(self.factors),
        }
        self._numbers = {
            "n_entries": n_entries,
            "n_colours": self.n_colours,
            "given_rows": given_rows,
            "given_columns": given_columns,
            "below": self.factors.below,
            "above": self.factors.above,
            "is_natural": int(np.array_equal(order, np.arange(n))),
        }

    def _places(self, rows: IntArray, columns: IntArray) -> IntArray:
        """Return the places in the matrix of entries, given in its own order."""
        factors = self.factors
        if factors.is_band:
            return rows * factors.width + columns - rows + factors.below
        n = len(factors.order)
        # The rows of the factors are sorted, so their places are, too.
        row_of = np.repeat(np.arange(n), np.diff(factors.starts))
        return np.searchsorted(row_of * n + factors.columns, rows * n + columns)

    @property
    def work_rows(self) -> int:
        """Rows of states after the first one of the Jacobian's entries."""
        return self.entry_rows + self.matrix_rows + 2

    def address_for(self, first: int) -> int:
        """Return the address of the directory if row `first` holds the first entries.

        All systems and threads share it: the row is the same for all.
        """
        matrix = first + self.entry_rows
        right = matrix + self.matrix_rows
        rows = {
            "matrix": matrix,
            "right": right,
            "work": right + 1,
            "duals": right + 2,
        }
        if "directory" not in vars(self):
            directory = np.zeros(DIRECTORY_SLOTS, dtype=np.int64)
            for name, number in (self._numbers | rows).items():
                directory[SLOTS[name.upper()]] = number
            for name, array in self._arrays.items():
                kept = np.ascontiguousarray(array, dtype=np.int64)
                self._arrays[name] = kept
                slot = SLOTS[name.upper()]
                directory[slot] = kept.ctypes.data
                directory[slot + 1] = len(kept)
            self.directory = directory
        return int(self.directory.ctypes.data)
