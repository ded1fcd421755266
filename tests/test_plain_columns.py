"""What the tests of tables look for is found where it is, and only there."""

import pandas as pd

from plain_columns import counted_from_zero, shadowed


def test_numbers_that_count_from_zero_are_found():
    table = pd.DataFrame(
        {
            "frame": [0, 1, 1, 2],
            "landing": [1, 2, 2, 3],
            "gaps": [0, 2, 1, 0],
            "name": [*"abcd"],
        }
    )
    assert counted_from_zero(table) == ["frame"]
    assert shadowed(table.rename(columns={"gaps": "index"})) == ["index"]
