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
