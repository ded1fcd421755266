"""Damaged recordings: each must end in a recording or in a message that a user can act on.

    python benchmarks/damaged_files.py --out damaged_files.csv [--files 21000]

Small sound files of all formats (`tests/recordings/damage.py`) are damaged in seeded ways: bytes
flipped, pieces cut off, doubled or taken out, counts and sizes that lie, fields of text replaced.
Each is read as a user's file is, from import to the checks for plausibility, in a process that may
use 1 GB more memory than it begins with and 10 s a file.

One row a sound file: how many of its damaged copies were read (`recordings`), refused with a
`RecordingError` that names the file, what was expected and what was found (`refused`), and what
must not be: `other_exceptions`, `crashes`, `hangs`. `slowest_ms` is the longest time of one file,
`peak_mb` the largest memory of the reading process, Python and libraries included. `failing` lists
the numbers of the files that did what they must not; `--only NUMBER` makes one again.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd

TESTS = Path(__file__).resolve().parent.parent / "tests" / "recordings"
sys.path[:0] = [str(TESTS)]

from damage import case, corpus, placed, read  # noqa: E402
from reading import most_memory_mb  # noqa: E402

SEED = 20261121
LIMIT_S, LIMIT_BYTES = 10, 1 << 30


def work(first: int, files: int, folder: Path) -> None:
    """Read the files from `first` on, and say on stdout what became of each."""
    sound = corpus()
    names = list(sound)
    pages = int(Path("/proc/self/statm").read_text().split()[0]) if sys.platform == "linux" else 0
    if pages:
        used = pages * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (used + LIMIT_BYTES, used + LIMIT_BYTES))
    for number in range(first, files):
        name, data = case(sound, names, SEED, number)
        path = placed(folder, name, data)
        print(json.dumps({"number": number, "begun": True}), flush=True)
        signal.alarm(LIMIT_S)
        start = time.perf_counter()
        try:
            outcome, note = ("refused" if isinstance(read(path), str) else "recordings"), ""
        except Exception as error:
            outcome, note = "other_exceptions", f"{type(error).__name__}: {error}"
        signal.alarm(0)
        seconds = time.perf_counter() - start
        peak = most_memory_mb()
        print(json.dumps({"number": number, "outcome": outcome, "note": note, "ms": 1e3 * seconds,
                          "peak": peak}), flush=True)  # fmt: skip


def run(files: int) -> list[dict[str, object]]:
    """Return what became of each file; a process that dies is replaced by another."""
    found: list[dict[str, object]] = []
    with TemporaryDirectory() as folder:
        while len(found) < files:
            command = [sys.executable, __file__, "--work", folder]
            command += ["--first", str(len(found)), "--files", str(files)]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
                assert process.stdout is not None
                begun = False
                for line in process.stdout:
                    report = json.loads(line)
                    begun = "begun" in report
                    if not begun:
                        found.append(report)
            if begun:
                hung = process.returncode == -signal.SIGALRM
                outcome = "hangs" if hung else "crashes"
                found.append({"number": len(found), "outcome": outcome, "note": "",
                              "ms": 1e3 * LIMIT_S if hung else 0.0, "peak": 0.0})  # fmt: skip
            elif process.returncode:
                raise RuntimeError(f"the reading process ended with {process.returncode}")
    return found


def table(found: list[dict[str, object]]) -> pd.DataFrame:
    names = list(corpus())
    rows = pd.DataFrame(found)
    rows["file"] = [names[number % len(names)] for number in rows["number"]]
    outcomes = ("recordings", "refused", "other_exceptions", "crashes", "hangs")
    result = []
    for name, group in [*rows.groupby("file", sort=False), ("all", rows)]:
        counts = {key: int((group["outcome"] == key).sum()) for key in outcomes}
        failing = group[~group["outcome"].isin(outcomes[:2])]["number"]
        result.append(
            {"file": name, "files": len(group), **counts, "slowest_ms": group["ms"].max(),
             "peak_mb": group["peak"].max(), "failing": " ".join(map(str, failing))}
        )  # fmt: skip
    return pd.DataFrame(result)


def main() -> None:
    parser = argparse.ArgumentParser(description="Damaged recordings of all formats.")
    parser.add_argument("--out", type=Path, help="CSV file to write")
    parser.add_argument("--files", type=int, default=21_000)
    parser.add_argument("--only", type=int, help="write this damaged file here, and read it")
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--first", type=int, default=0, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        work(options.first, options.files, options.work)
        return
    if options.only is not None:
        sound = corpus()
        name, data = case(sound, list(sound), SEED, options.only)
        path = placed(Path(), name, data)
        print(name, read(path))
        return
    found = run(options.files)
    result = table(found)
    for report in found:
        if report["note"]:
            print(report["number"], report["note"])
    print(result.to_string(index=False))
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        result.to_csv(options.out, index=False, float_format="%.4g", lineterminator="\n")


if __name__ == "__main__":
    main()
