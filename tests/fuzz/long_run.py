"""`make fuzz`: a search for inputs that break a promise, guided by the lines they reach.

    python tests/fuzz/long_run.py --minutes 60 --seed 1 --cores 2 [--doors c3d mat ...]

Each door gets its share of the time in slices of a minute. The inputs that reached
something new are kept in `build/fuzz`, where a later run goes on. An input that breaks a
promise is tried again in a fresh process (`oracle`), made as small as it can be without
another fault, and put into `tests/fuzz/found` with a line in `found.csv`. What lies there
is tried by every test run; so it is committed with the mend.
"""

import argparse
import csv
import hashlib
import json
import os
import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import oracle

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
FOUND = HERE / "found"
LIST = FOUND / "found.csv"
COLUMNS = ("file", "door", "fault", "told")
WORK = ROOT / "build" / "fuzz"
SLICE_S = 60
SHORTEST_S = 8  # a search takes some seconds to begin
HANGS_S = 20  # wall-clock time of one input
MOST_TRIALS = 300
MOST_KEPT = 200_000  # bytes of an input that is committed


def known():
    """Return the rows of what was found."""
    if not LIST.exists():
        return []
    with LIST.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def run_slice(door, seconds, seed):
    """Search at one door for some seconds; return how many inputs entered.

    A search ends with an input on which its process ends or hangs, as the HDF5 library
    does on some; then another one begins.
    """
    end = time.monotonic() + seconds
    n_inputs = 0
    left = seconds
    while left > SHORTEST_S:
        code, n_more = _searched(door, left, seed)
        n_inputs += n_more
        seed += 100_000
        if code == 0:
            break
        left = end - time.monotonic()
    return n_inputs


def _searched(door, seconds, seed):
    """Start a search; return its exit code and the number of inputs."""
    folder = WORK / door
    finds = folder / "finds"
    finds.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, str(HERE / "target.py"), door]
    command += [str(folder / "corpus"), str(finds)]
    command += [f"-max_total_time={seconds:.0f}", f"-seed={seed}", "-rss_limit_mb=0"]
    command += ["-print_final_stats=1", f"-timeout={HANGS_S}"]
    command += [f"-artifact_prefix={finds}/"]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    with (folder / "log.txt").open("wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, env=environment)
        try:
            code = process.wait(seconds + 10 * HANGS_S)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
    said = (folder / "log.txt").read_text("utf-8", "replace")
    counts = [int(one) for one in re.findall(r"^#(\d+)", said, re.MULTILINE)]
    counts += [int(one) for one in re.findall(r"executed_units: +(\d+)", said)]
    if code and (finds / "current").exists():  # the process ended within an input
        data = (finds / "current").read_bytes()
        (finds / hashlib.sha256(data).hexdigest()[:12]).write_bytes(data)
    return code, max(counts, default=0)


def judge_finds(door, watched):
    """Try again what a search found; keep what fails again, made small."""
    sys.path[:0] = [one for one in oracle._test_folders() if one not in sys.path]
    from doors import DOORS

    names = [*DOORS[door].sound]
    kept = 0
    for find in sorted((WORK / door / "finds").glob("*")):
        data = find.read_bytes()
        if find.name != "current" and data:
            name = names[data[0] % len(names)]
            kept += keep(door, name, data[1:], watched)
        find.unlink()
    return kept


def keep(door, name, data, watched):
    """Keep an input if it fails in a way that is not known; return whether it was kept."""
    verdict = watched.enter(door, name, data)
    is_known = any(
        row["door"] == door and row["fault"] == verdict.signature for row in known()
    )
    if not verdict.fault or is_known:
        return False
    small = minimised(door, name, data, verdict, watched)
    if len(small) > MOST_KEPT:
        print(f"{door}: {len(small)} bytes are too many to keep: {verdict}", flush=True)
        return False
    digest = hashlib.sha256(small).hexdigest()[:10]
    file = f"{door}-{digest}-{name}"
    FOUND.mkdir(exist_ok=True)
    (FOUND / file).write_bytes(small)
    rows = [
        *known(),
        dict(zip(COLUMNS, (file, door, verdict.signature, verdict.told), strict=True)),
    ]
    with LIST.open("w", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    print(f"found: {file}: {verdict.signature}: {verdict.told}", flush=True)
    return True


def minimised(door, name, data, verdict, watched):
    """Leave out pieces of an input as long as it fails in the same way."""
    trials = 0
    length = len(data) // 2
    while length and trials < MOST_TRIALS and verdict.cpu_s < oracle.MOST_CPU_S / 10:
        at = 0
        while at < len(data) and trials < MOST_TRIALS:
            shorter = data[:at] + data[at + length :]
            trials += 1
            again = watched.enter(door, name, shorter)
            if again.signature == verdict.signature:
                data = shorter
            else:
                at += length
        length //= 2
    return data


def search(door_names, minutes, seed, cores):
    """Search at all doors in turn; return the number of inputs and finds of each door."""
    end = time.monotonic() + 60 * minutes
    counts = dict.fromkeys(door_names, 0)
    finds = dict.fromkeys(door_names, 0)
    slice_s = min(SLICE_S, max(2 * SHORTEST_S, 60 * minutes * cores / len(door_names)))
    waiting, turn = [], 0

    def work():
        nonlocal turn
        with oracle.Watched() as watched:
            while time.monotonic() < end:
                if not waiting:
                    waiting.extend(door_names)
                    turn += 1
                door = waiting.pop(0)
                seconds = min(slice_s, end - time.monotonic())
                counts[door] += run_slice(door, seconds, 1000 * seed + turn)
                finds[door] += judge_finds(door, watched)

    with ThreadPoolExecutor(cores) as pool:
        for one in [pool.submit(work) for _ in range(cores)]:
            one.result()
    return counts, finds


def main():
    """Search, and tell what was found."""
    sys.path[:0] = oracle._test_folders()
    from doors import DOORS

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--doors", nargs="*", default=[*DOORS], choices=[*DOORS])
    given = parser.parse_args()
    doors = given.doors or [*DOORS]
    cores = min(given.cores, len(doors))
    begin = time.monotonic()
    counts, finds = search(doors, given.minutes, given.seed, cores)
    for door in doors:
        kept = len([*(WORK / door / "corpus").glob("*")])
        print(
            f"{door:12} {counts[door]:9,} inputs, {kept:6,} kept, {finds[door]} found"
        )
    total, n_found = sum(counts.values()), sum(finds.values())
    minutes = (time.monotonic() - begin) / 60
    print(f"{total:,} inputs in {minutes:.0f} min: {n_found} new finds")
    (WORK / "last.json").write_text(
        json.dumps({"inputs": counts, "found": finds}) + "\n"
    )
    return int(n_found > 0)


if __name__ == "__main__":
    sys.exit(main())
