"""The directory of a sparse Jacobian: numbers and addresses that a step reads.

It is made by `sparsity.Structure`. The driver needs it, too, so it is a module of its
own: a change of it compiles the driver anew.
"""

from typing import NamedTuple

from hopdata.hybrid.compiled.memory import IntVector
from hopdata.hybrid.compiled.records import reader
from hopdata.hybrid.layout import numbers


class Directory(NamedTuple):
    """What a step reads of the structure.

    `columns` are sorted by colour, and so are the entries in `entry`, `row_of` and
    `column_of`. `first_column` and `first_entry` say where each colour starts.
    """

    n_entries: int
    n_colours: int
    given_rows: int  # shape of the array that the user's function fills
    given_columns: int
    below: int
    above: int
    matrix: int  # row of the states where the matrix begins
    right: int  # row of the right-hand side of a linear system
    work: int  # row of its unknowns in the order of elimination
    duals: int  # row of the states where rows of duals begin
    is_natural: int  # whether that order is the states' own
    colour_of: IntVector  # of each column
    columns: IntVector
    first_column: IntVector
    entry: IntVector
    row_of: IntVector
    column_of: IntVector
    first_entry: IntVector
    given_places: IntVector
    row_starts: IntVector  # entries row by row
    entry_columns: IntVector
    places: IntVector  # place of each entry in the matrix
    diagonal: IntVector  # and of each state's diagonal entry
    order: IntVector
    factor_starts: IntVector
    factor_columns: IntVector
    factor_diagonal: IntVector
    alike: IntVector  # rows from each one on whose factors have the same columns


N_PLAIN = 11  # items of a directory that are numbers
N_VIEWS = len(Directory._fields) - N_PLAIN
DIRECTORY_SLOTS = N_PLAIN + 2 * N_VIEWS
SLOTS = dict(
    zip(
        (name.upper() for name in Directory._fields),
        [*numbers(N_PLAIN), *(N_PLAIN + 2 * numbers(N_VIEWS))],
        strict=True,
    )
)
directory_of = reader(SLOTS, Directory)
