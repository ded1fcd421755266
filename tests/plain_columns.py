"""Columns of tables: each can be written as an attribute, as in ``table.contact_s``."""

import keyword

import pandas as pd


def shadowed(table):
    """Return the columns of a table that a user cannot write as an attribute.

    A DataFrame has an attribute of this name, or Python a keyword.
    """
    return [
        name
        for name in table.columns
        if hasattr(pd.DataFrame, str(name)) or keyword.iskeyword(str(name))
    ]


def shadowed_in(folder):
    """Return these columns of all tables in a folder, by file."""
    files = sorted(folder.rglob("*.csv"))
    assert files, folder
    found = {str(file): shadowed(pd.read_csv(file, nrows=1)) for file in files}
    return {file: columns for file, columns in found.items() if columns}


def counted_from_zero(table):
    """Return the columns of a table that number something from 0, as 0, 1, 2, ..."""
    found = []
    for name in table.columns:
        numbers = list(pd.unique(table[name].dropna()))
        is_number = pd.api.types.is_numeric_dtype(table[name])
        if is_number and len(numbers) > 2 and numbers == list(range(len(numbers))):
            found.append(name)
    return found


def counted_from_zero_in(folder):
    """Return these columns of all tables in a folder, by file."""
    files = sorted(folder.rglob("*.csv"))
    assert files, folder
    found = {str(file): counted_from_zero(pd.read_csv(file)) for file in files}
    return {file: columns for file, columns in found.items() if columns}
