"""A campaign of studies that goes on where it was interrupted."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from bodies import Body

Rows = list[dict[str, Any]]


def run(
    file: Path,
    columns: Sequence[str],
    judged: Callable[..., Rows],
    tasks: Sequence[tuple[Any, ...]],
    *,
    named: Sequence[str],
    jobs: int,
) -> None:
    """Judge the studies that have no row in the file, and append theirs.

    Parameters
    ----------
    file, columns
        Table of the studies, and its columns.
    judged
        Function of a task that returns its rows.
    tasks, named
        Arguments of `judged`, and the columns that hold them.
    jobs
        Number of processes.
    """
    done: set[tuple[Any, ...]] = set()
    if file.exists():
        known = pd.read_csv(file)
        done = set(zip(*(known[name] for name in named), strict=True))
    # Compiled once, before the processes that inherit it start.
    Body(0).landings(2, np.random.default_rng(0))
    with ProcessPoolExecutor(jobs) as pool, file.open("a", newline="") as out:
        writer = csv.DictWriter(out, columns)
        if not done:
            writer.writeheader()
        waiting = [pool.submit(judged, *task) for task in tasks if task not in done]
        for finished in as_completed(waiting):
            writer.writerows(finished.result())
            out.flush()
