"""`hopdata close-landings`: the same in the terminal."""

import pandas as pd

from hopdata_own.close_landings import close_landings


def count(options):
    """Print how many landings of a study are close; return the exit code."""
    touchdowns = pd.read_csv(options.study / "tables" / "touchdowns.csv")
    found = close_landings(touchdowns, at_most_ms=options.at_most)
    print(f"{len(found)} of {len(touchdowns)} landings within {options.at_most:g} ms")
    return 0
