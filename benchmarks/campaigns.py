"""A campaign of studies that goes on where it was interrupted."""

from __future__ import annotations

import argparse
import csv
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from bodies import Body

Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Options:
    """What the command line asks of a benchmark.

    Parameters
    ----------
    out : Path
        Table to write.
    seeds : range
        One for each study of a kind.
    jobs : int
        Number of processes.
    """

    out: Path
    seeds: range
    jobs: int


def read_options(about: str | None, *, studies: int, first_seed: int) -> Options:
    """Return what the command line asks for, by default these studies of each kind."""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--studies", type=int, default=studies, help="of each kind")
    parser.add_argument("--first", type=int, default=first_seed, help="first seed")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    args = parser.parse_args()
    return Options(args.out, range(args.first, args.first + args.studies), args.jobs)


def write_table(found: pd.DataFrame, file: Path) -> None:
    """Write a table of a benchmark, and print it."""
    found.to_csv(file, index=False, float_format="%.4g")
    print(found.to_string(index=False))


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
