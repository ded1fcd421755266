"""``python -m hopdata.dissertation NAME``: make a part of the page, print its rows."""

import sys

# The working folder comes first on Python's path, and nothing in it is imported.
if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]

import argparse
import logging
import os
from collections.abc import Sequence
from pathlib import Path

from hopdata.dissertation.making import BUNDLED, Record, make_part, seeds_of

OK = 0
PROBLEM = 1

FOLDER = Path("results", "dissertation", "parts")


def main(arguments: Sequence[str] | None = None) -> int:
    """Make one part, and print its rows; return 1 if something could not be made."""
    options = _parser().parse_args(arguments)
    logging.basicConfig(format="%(levelname)s %(message)s")
    folder = (options.out or FOLDER / options.part).resolve()
    os.chdir(BUNDLED)
    record = make_part(
        options.part,
        folder,
        seeds_of(options.seed, options.seeds),
        formats=options.formats,
        dpi=options.dpi,
    )
    if options.quiet:
        return OK
    return _print(record)


def _parser() -> argparse.ArgumentParser:
    program = "python -m hopdata.dissertation"
    parser = argparse.ArgumentParser(prog=program, description=__doc__)
    parser.add_argument("part", help="a module of hopdata.dissertation.parts")
    parser.add_argument("--out", type=Path, help="folder of its record and figures")
    parser.add_argument("--seed", type=int, default=1, help="of the study; 1")
    parser.add_argument("--seeds", type=int, default=5, help="repetitions; 5")
    parser.add_argument("--formats", nargs="+", default=["svg", "png"])
    parser.add_argument("--dpi", type=float, default=200.0)
    parser.add_argument("--quiet", action="store_true", help="print no rows")
    return parser


def _print(record: Record) -> int:
    """Print the rows as the page will show them."""
    from hopdata.dissertation.items import read_part
    from hopdata.dissertation.report.entries import entries_of, faults_of

    entries = entries_of(read_part(record.part), [record])
    for entry in entries:
        item = entry.item
        print(f"{item.number} {item.title} (Sec. {item.section})")
        print(f"  printed: {item.printed}")
        print(f"  printed method: {entry.printed_method}")
        print(f"  hopdata: {entry.ours}")
        print(f"  {entry.sign} {entry.word}: {entry.why or entry.failure or ''}")
    for figure in record.figures:
        print(f"figure {figure}")
    faults = faults_of(entries, [record])
    for fault in faults:
        print(f"hopdata: {fault.line}", file=sys.stderr)
    return PROBLEM if faults else OK


if __name__ == "__main__":
    sys.exit(main())
