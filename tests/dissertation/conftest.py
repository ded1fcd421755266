"""All that the parts of the dissertation make in its tests."""

import pytest

from hopdata.dissertation import rows
from plain_columns import shadowed


@pytest.fixture(scope="session", autouse=True)
def plain_tables():
    """Look at the columns of the tables of every part that a test makes."""
    make = rows.Made.__init__

    def looked_at(made, *given, **named):
        make(made, *given, **named)
        for name, table in made.tables.items():
            assert shadowed(table) == [], name

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rows.Made, "__init__", looked_at)
        yield
