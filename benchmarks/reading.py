"""Reading a day of recordings: time, memory and frames, beside the usual libraries.

    python benchmarks/reading.py --out reading.csv

A recording with 182,611 frames of 6 markers, as many as in the dissertation, is written
in every format (TSV as QTM writes it, with 3 decimals). There is one row per format and
reader. `time_s` is the shortest of `--rounds` readings, with the readers of a format
taking turns. `ratio` is that time over the peer's (below 1 the row is faster).
`memory_mb` is the growth of the process beyond its memory after reading one small file,
and `memory_over_array` is the growth over the size of the position array (N x M x 3
doubles, 26.3 MB). `frames` is the number of frames returned, of 182,611. pandas only
parses TSV into columns and checks nothing.

Beside it, `reading_agreement.csv` compares the C3D and the text file of the 3.5 m/s
treadmill run: largest differences of positions and time stamps, and coordinates that
only one file has. It says "absent" if the files are missing (see the README of this
repository).

`damaged_files.csv` tests that each damaged recording ends in a recording or in a
message that a user can act on. Small sound files of all formats
(`tests/recordings/damage.py`) are damaged in seeded ways: bytes flipped; pieces cut
off, doubled or removed; counts and sizes falsified; fields of text replaced. Each is
read like a user's file, from import to the plausibility checks, in a process that may
use 1 GB more memory than it starts with and 10 s per file. There is one row per sound
file: how many of its damaged copies were read (`recordings`), how many were refused
with a `RecordingError` that names the file, what was expected and what was found
(`refused`), and the outcomes that must not occur: `other_exceptions`, `crashes`,
`hangs`. `slowest_ms` is the longest time of one file, `peak_mb` the largest memory of
the reading process, including Python and libraries. `failing` lists the numbers of
files with such outcomes; `--only NUMBER` makes one of them again.
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
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

TESTS = Path(__file__).resolve().parent.parent / "tests" / "recordings"
sys.path[:0] = [str(TESTS)]

from damage import case, corpus, placed, read  # noqa: E402
from mat_files import qtm_struct, write_mat5, write_mat73  # noqa: E402
from trc_files import trc_text  # noqa: E402
from written_files import write_c3d, write_qtm_tsv  # noqa: E402

from hopdata.recording import Recording  # noqa: E402
from hopdata.recordings.importing import import_recording  # noqa: E402
from hopdata.recordings.raw import RawRecording  # noqa: E402
from hopdata.recordings.readers.formats import read_raw  # noqa: E402
from hopdata.recordings.readers.hdf5 import write_recording  # noqa: E402

N_FRAMES, RATE_HZ = 182_611, 100.0
MARKERS = ("body1", "body2", "body3", "foot1", "foot2", "foot3")
ROOT = Path(__file__).resolve().parent.parent
FOLDERS = (ROOT / "data/external", ROOT.parent / "shared/recordings/treadmill_running")
C3D, TEXT = "RBDS001runT35.c3d", "RBDS001runT35_markers.txt"
HEADER_LINES = 11  # header lines of the TSV file written here


def made_up(n_frames: int) -> RawRecording:
    """Return markers that wander within a metre, in mm, with one frame in a hundred unseen."""
    rng = np.random.default_rng(np.random.SeedSequence(20261121))
    positions = 500 + np.cumsum(rng.normal(0, 0.5, (n_frames, len(MARKERS), 3)), axis=0)
    positions[rng.random(positions.shape[:2]) < 0.01] = np.nan
    positions = np.round(positions, 3)
    return RawRecording(
        MARKERS, np.arange(n_frames) / RATE_HZ, positions, RATE_HZ, "mm"
    )


def write_all(folder: Path, raw: RawRecording) -> dict[str, Path]:
    """Write one recording in all formats; the key is the name of the format."""
    paths = {name: folder / name.replace(" ", "_") for name in FORMATS}
    write_qtm_tsv(paths["qtm.tsv"], raw)
    write_c3d(paths["float.c3d"], raw)
    write_c3d(paths["whole numbers.c3d"], raw, whole_numbers=True)
    struct = qtm_struct(raw.positions, list(raw.markers), rate_hz=RATE_HZ)
    write_mat5(paths["version 5.mat"], struct)
    write_mat73(paths["version 7.3.mat"], struct)
    paths["mm.trc"].write_text(trc_text(raw.positions, raw.markers, rate_hz=RATE_HZ))
    roles = ("body",) * 3 + ("foot",) * 3
    write_recording(
        paths["own.h5"],
        Recording("a", raw.time, raw.positions / 1000, MARKERS, roles, RATE_HZ),
    )
    return paths


def by_pandas(path: Path) -> int:
    return len(pd.read_csv(path, sep="\t", skiprows=HEADER_LINES - 1, header=None))


def by_scipy(path: Path) -> int:
    from scipy.io import loadmat

    return int(
        loadmat(path)["trial"]["Trajectories"][0, 0]["Labeled"][0, 0]["Data"][
            0, 0
        ].shape[2]
    )


def by_ezc3d(path: Path) -> int:
    import ezc3d

    return int(ezc3d.c3d(str(path))["data"]["points"].shape[2])


def by_hopdata(path: Path) -> int:
    return len(read_raw(path).time)


Reader = Callable[[Path], int]
READERS: dict[str, Reader] = {
    "hopdata": by_hopdata, "pandas": by_pandas, "scipy": by_scipy, "ezc3d": by_ezc3d,
}  # fmt: skip
FORMATS = {
    "qtm.tsv": "pandas", "float.c3d": "ezc3d", "whole numbers.c3d": "ezc3d",
    "version 5.mat": "scipy", "version 7.3.mat": "", "mm.trc": "", "own.h5": "",
}  # fmt: skip


def grown_mb(reader: str, small: Path, path: Path) -> float:
    """Return how much a fresh process grows when it reads a file after a small one, MB."""
    command = [sys.executable, __file__, "--measure", reader, str(small), str(path)]
    return float(
        subprocess.run(command, check=True, capture_output=True, text=True).stdout
    )


def most_memory_mb() -> float:
    """Return the peak memory of this process, MB, excluding its parent's."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(x for x in status.read_text().splitlines() if x.startswith("VmHWM"))
        return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measure(reader: str, small: Path, path: Path) -> None:
    READERS[reader](small)
    before = most_memory_mb()
    READERS[reader](path)
    print(most_memory_mb() - before)


def shortest(
    readers: dict[str, Reader], path: Path, rounds: int
) -> dict[str, tuple[float, int]]:
    """Return the shortest time, s, and the number of frames of each reader; they take turns."""
    best = dict.fromkeys(readers, (np.inf, 0))
    for _ in range(rounds):
        for name, reader in readers.items():
            start = time.perf_counter()
            frames = reader(path)
            best[name] = (min(best[name][0], time.perf_counter() - start), frames)
    return best


def rows(folder: Path, rounds: int) -> list[dict[str, object]]:
    small_folder = folder / "small"
    small_folder.mkdir()
    small = write_all(small_folder, made_up(100))
    raw = made_up(N_FRAMES)
    result: list[dict[str, object]] = []
    for name, path in write_all(folder, raw).items():
        readers = {key: READERS[key] for key in ("hopdata", FORMATS[name]) if key}
        try:
            best = shortest(readers, path, rounds)
        except ImportError:
            best = shortest({"hopdata": by_hopdata}, path, rounds)
        for reader in readers:
            row: dict[str, object] = {"format": name, "reader": reader}
            if reader not in best:
                result.append({**row, "time_s": "absent"})
                continue
            seconds, frames = best[reader]
            grown = grown_mb(reader, small[name], path)
            peer = best.get(FORMATS[name])
            result.append(
                {**row, "file_mb": path.stat().st_size / 1e6, "frames": frames, "time_s": seconds,
                 "ratio": seconds / peer[0] if peer else "",
                 "memory_mb": grown, "memory_over_array": grown * 2**20 / raw.positions.nbytes}
            )  # fmt: skip
    return result


def agreement() -> pd.DataFrame:
    """Compare the two files of the 3.5 m/s run."""
    for folder in FOLDERS:
        if (folder / C3D).is_file() and (folder / TEXT).is_file():
            break
    else:
        return pd.DataFrame([{"what": "files of the 3.5 m/s run", "value": "absent"}])
    names = read_raw(folder / C3D).markers
    markers = {"body": names[:3], "feet": names[3:9], "boom": names[9:]}
    a, b = (
        import_recording(folder / file, name="run", markers=markers, vertical_axis="y")[
            0
        ]
        for file in (C3D, TEXT)
    )
    apart = np.abs(a.positions - b.positions)
    unseen = np.isnan(a.positions) != np.isnan(b.positions)
    facts = {
        "markers": len(names),
        "frames": len(a.time),
        "frames_of_text_file": len(b.time),
        "largest_difference_of_positions_mm": 1e3 * np.nanmax(apart),
        "largest_difference_of_time_s": np.abs(a.time - b.time).max(),
        "coordinates_seen_in_one_only": int(unseen.sum()),
    }
    return pd.DataFrame([{"what": key, "value": value} for key, value in facts.items()])


# Damaged recordings.

DAMAGE_SEED = 20261121
LIMIT_S, LIMIT_BYTES = 10, 1 << 30


def read_damaged(first: int, files: int, folder: Path) -> None:
    """Read the files from `first` on, and report each outcome on stdout."""
    sound = corpus()
    names = list(sound)
    pages = (
        int(Path("/proc/self/statm").read_text().split()[0])
        if sys.platform == "linux"
        else 0
    )
    if pages:
        used = pages * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (used + LIMIT_BYTES, used + LIMIT_BYTES))
    for number in range(first, files):
        name, data = case(sound, names, DAMAGE_SEED, number)
        path = placed(folder, name, data)
        print(json.dumps({"number": number, "begun": True}), flush=True)
        signal.alarm(LIMIT_S)
        start = time.perf_counter()
        try:
            outcome, note = (
                ("refused" if isinstance(read(path), str) else "recordings"),
                "",
            )
        except Exception as error:
            outcome, note = "other_exceptions", f"{type(error).__name__}: {error}"
        signal.alarm(0)
        seconds = time.perf_counter() - start
        peak = most_memory_mb()
        print(json.dumps({"number": number, "outcome": outcome, "note": note, "ms": 1e3 * seconds,
                          "peak": peak}), flush=True)  # fmt: skip


def fates(files: int) -> list[dict[str, object]]:
    """Return the outcome of each file; a process that dies is replaced by another."""
    found: list[dict[str, object]] = []
    with TemporaryDirectory() as folder:
        while len(found) < files:
            command = [sys.executable, __file__, "--damaged", folder]
            command += [str(len(found)), "--files", str(files)]
            with subprocess.Popen(
                command, stdout=subprocess.PIPE, text=True
            ) as process:
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
                raise RuntimeError(
                    f"the reading process ended with {process.returncode}"
                )
    return found


def fate_table(found: list[dict[str, object]]) -> pd.DataFrame:
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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="CSV file to write")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--files", type=int, default=21_000, help="damaged files")
    parser.add_argument(
        "--only", type=int, help="write this damaged file here, and read it"
    )
    parser.add_argument("--measure", nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("--damaged", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        reader, small, path = options.measure
        measure(reader, Path(small), Path(path))
        return
    if options.damaged:
        inside, first = options.damaged
        read_damaged(int(first), options.files, Path(inside))
        return
    if options.only is not None:
        sound = corpus()
        name, data = case(sound, list(sound), DAMAGE_SEED, options.only)
        print(name, read(placed(Path(), name, data)))
        return
    with TemporaryDirectory() as folder:
        table = pd.DataFrame(rows(Path(folder), options.rounds))
    beside, found = agreement(), fates(options.files)
    for report in found:
        if report["note"]:
            print(report["number"], report["note"])
    fate = fate_table(found)
    print(*(part.to_string(index=False) for part in (table, beside, fate)), sep="\n")
    if options.out:
        place = options.out.with_name
        options.out.parent.mkdir(parents=True, exist_ok=True)
        table.to_csv(options.out, index=False, float_format="%.4g", lineterminator="\n")
        beside.to_csv(place("reading_agreement.csv"), index=False, lineterminator="\n")
        fate.to_csv(place("damaged_files.csv"), index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
