"""How reliable the guesses of `hopdata init` are: sure and right, sure and wrong, or unsure.

    python benchmarks/guesses.py --out guesses.csv [--recordings FOLDER] [--seeds 5]

The recordings are the two bundled ones, made-up hoppers and, if they have been fetched,
the runners and OpenSim's test files below FOLDER; their units, vertical axes and parts
are known. Each is cut into pieces of several lengths at seeded places. There is one row
for each guess and kind of change to the pieces:

- `up`: turned so that each of the six directions points up; the file does not state it.
- `unit`: scaled to mm, cm, m or inches; the file states the unit (`stated`), states
  nothing (`silent`), or wrongly states mm or m (`misstated`).
- `rate`: stated correctly, or as half or twice its value, with or without a column of
  time. `removed`: not stated at all; right then means that one of the two candidates is
  within a tenth.
- `roles`: which markers are feet and body, with the original names, and with the names
  `m1`, `m2`
  ... in another order. Right is a choice of markers that are all on feet, or all on one of pelvis,
  trunk and head.

Made-up people who walk, run, jump, stand, sit, squat, stoop or lie, in the marker sets of
`tests/recordings/quality/made_up_people.py`, stand for the files that most laboratories
have; there are rows for each posture:

- `people, up`: as a C3D file with z up, and as a TRC file with y up, neither of which
  states it. Who lies straight looks like who stands, and should be asked about.
- `people, other up`: as a C3D file with y up, and as a TRC file with z up. Who lies in
  them along the usual axis looks all the more like who stands.
- `people, feet`: right is a choice of markers on feet only.
- `people, unit`: stated rightly.

A stated rate is sure unless the time stamps or free fall contradict it: `half` and
`twice` count how often a wrong one is not seen by free fall alone. For unsure guesses,
`init` asks by the name of the key and offers two candidates; `asked` are questions
without candidates. `wrong_sure` is the share that matters; it should be at most 1 %.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd

from hopdata.recordings.axes import DIRECTIONS, rotate_up
from hopdata.recordings.quality.frame_rate import guess_rate
from hopdata.recordings.quality.free_fall import UNITS_IN_M
from hopdata.recordings.quality.inspection import inspect_recording
from hopdata.recordings.quality.orientation import guess_unit_and_up
from hopdata.recordings.quality.roles import guess_roles
from hopdata.recordings.raw import METRES_PER_UNIT, RawRecording
from hopdata.recordings.readers.formats import read_raw

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "tests/recordings/quality")]
from made_up_hopper import MARKERS, hopping  # noqa: E402
from made_up_people import MARKER_SETS, POSTURES, in_file, person  # noqa: E402

SEED = 20261124
LENGTHS_S = (2.0, 5.0, 15.0, 60.0)
# Vertical direction of the files where it is known; the unit is the one they state
KNOWN = {
    "hopper.h5": "z", "control.h5": "z", "RBDS001runT25markers.tsv": "z", "RBDS001runT35.c3d": "y",
    "RBDS032runT35markers.txt": "y", "dataWithBlanksForMissingMarkers.trc": "z", "init100.trc": "z",
    "dataWithNaNsOfDifferentCases.trc": "y", "std_walking2_markers.trc": "z",
    "subject01_synthetic_marker_data.trc": "y", "walk_free_01.trc": "y", "abdbonepin.trc": "",
}  # fmt: skip
FEET = re.compile("asy|heel|mt[0-9]|toe|cal$|midfoot|foot", re.IGNORECASE)
BODIES = [
    re.compile(names, re.IGNORECASE)
    for names in (
        "asis|psis|iliac|sacral|[lr](asi|psi)$|[lr]hjc|body[0-9]|hip[0-9]|boom",
        "sternum|strn|clav|t10|c7|acromi|scapula|shoulder",
        "head|[lr][fb]hd|temple",
    )
]


@dataclass(frozen=True)
class Piece:
    """A stretch of a recording in m, z up (if `up` is known), and the file that it comes from."""

    file: str
    raw: RawRecording
    up: bool


def pieces(folder: Path, seed: int, n_seeds: int) -> Iterator[Piece]:
    """Cut all recordings."""
    files = [*(ROOT / "data/sample").glob("*.h5"), *folder.rglob("*.*")]
    for path in sorted(path for path in files if path.name in KNOWN):
        raw, up = read_raw(path), KNOWN[path.name]
        if (
            path.name == "std_walking2_markers.trc"
        ):  # states 250 Hz, time stamps have 25 Hz
            raw = replace(raw, rate_hz=25.0)
        metres = rotate_up(raw.positions * METRES_PER_UNIT[raw.unit], up or "z")
        whole = replace(raw, positions=metres, unit="m", stated_up="")
        yield from (
            Piece(path.name, part, bool(up)) for part in _cut(whole, seed, n_seeds)
        )
    for k in range(n_seeds):
        time, positions = hopping(seed % 100_000 + k)
        raw = RawRecording(MARKERS, time, positions, 100.0, "m")
        yield from (Piece("made-up hopper", part, True) for part in _cut(raw, seed, 1))


def _cut(raw: RawRecording, seed: int, n_seeds: int) -> Iterator[RawRecording]:
    rng = np.random.default_rng(np.random.SeedSequence([seed, len(raw.time)]))
    for length in LENGTHS_S:
        n = round(length * raw.rate_hz)
        if n >= len(raw.time):
            yield raw
            return
        for start in rng.integers(0, len(raw.time) - n, n_seeds):
            part = slice(int(start), int(start) + n)
            yield replace(
                raw, time=raw.time[part], positions=raw.positions[part], events=()
            )


def turned(positions: np.ndarray, up: str) -> np.ndarray:
    """Turn positions with z up into those of a file in which `up` points up."""
    return positions @ np.linalg.inv(rotate_up(np.eye(3), up))


def outcome(right: bool, sure: bool) -> str:
    return f"{'right' if right else 'wrong'}_{'sure' if sure else 'unsure'}"


def _up(piece: Piece, _rng: np.random.Generator) -> Iterator[tuple[str, str]]:
    for up in DIRECTIONS if piece.up else ():
        _, guess = guess_unit_and_up(
            replace(piece.raw, positions=turned(piece.raw.positions, up))
        )
        yield up, outcome(guess.value == up, guess.is_sure)


def _unit(piece: Piece, _rng: np.random.Generator) -> Iterator[tuple[str, str]]:
    for unit, metres in UNITS_IN_M.items():
        scaled = replace(piece.raw, positions=piece.raw.positions / metres)
        for said in ("", "mm", "m"):
            guess, _ = guess_unit_and_up(
                replace(scaled, unit=said or "mm", unit_is_stated=bool(said))
            )
            kind = "silent" if not said else "stated" if said == unit else "misstated"
            yield f"{kind}, {unit}", outcome(guess.value == unit, guess.is_sure)


def _rate(piece: Piece, _rng: np.random.Generator) -> Iterator[tuple[str, str]]:
    raw = piece.raw
    for change, factor in (("stated", 1.0), ("half", 0.5), ("twice", 2.0)):
        wrong = replace(raw, rate_hz=factor * raw.rate_hz)
        if factor != 1.0:
            guess = guess_rate(wrong, "m")
            yield f"{change}, with time stamps", outcome(False, guess.is_sure)
        counted = replace(wrong, time=np.arange(len(raw.time)) / wrong.rate_hz)
        guess = guess_rate(counted, "m")
        yield change, outcome(factor == 1.0, guess.is_sure)
    guess = guess_rate(replace(raw, rate_hz=100.0), "m", is_stated=False)
    if guess.value:
        candidates = [float(guess.value), float(guess.other)]
        right = any(abs(rate / raw.rate_hz - 1) <= 0.1 for rate in candidates)
        yield "removed", outcome(right, sure=False)
    else:
        yield "removed", "asked"


def _roles(piece: Piece, rng: np.random.Generator) -> Iterator[tuple[str, str]]:
    raw = piece.raw
    order = rng.permutation(len(raw.markers))
    plain = tuple(f"m{k + 1}" for k in range(len(order)))
    for change, names, places in (
        ("as they are", raw.markers, np.arange(len(order))),
        ("shuffled", plain, order),
    ):
        own = dict(zip(names, np.array(raw.markers)[places].tolist(), strict=True))
        asked = replace(raw, markers=names, positions=raw.positions[:, places])
        found = guess_roles(inspect_recording(asked, unit="m", up="z"))
        feet, body = (
            [own[name] for name in chosen] for chosen in (found.feet, found.body)
        )
        right = bool(feet) and all(FEET.search(name) for name in feet)
        yield (
            f"feet, {change}",
            outcome(right, "feet" not in found.unsure) if feet else "asked",
        )
        right = any(all(part.search(name) for name in body) for part in BODIES)
        yield (
            f"body, {change}",
            outcome(right, "body" not in found.unsure) if body else "asked",
        )


def people(seed: int) -> Iterator[tuple[str, str, str, str]]:
    """Guess about made-up people: rows of marker set, guess, posture and outcome."""
    for s, marker_set in enumerate(MARKER_SETS):
        for p, posture in enumerate(POSTURES):
            made = person([seed, s, p], posture, marker_set)
            time = np.arange(len(made.positions)) / made.rate_hz
            raw = RawRecording(made.names, time, made.positions, made.rate_hz, "m")
            for up, suffix, kind in (
                ("z", ".c3d", "people, up"),
                ("y", ".trc", "people, up"),
                ("y", ".c3d", "people, other up"),
                ("z", ".trc", "people, other up"),
            ):
                positions = in_file(made.positions, up)
                file = replace(raw, positions=positions, suffix=suffix)
                unit, guess = guess_unit_and_up(file)
                found = outcome(guess.value == up, guess.is_sure)
                yield marker_set, kind, posture, found
                if kind == "people, up":
                    found = outcome(unit.value == "m", unit.is_sure)
                    yield marker_set, "people, unit", posture, found
            roles = guess_roles(inspect_recording(raw, unit="m", up="z"))
            found = "asked"
            if roles.feet:
                is_right = set(roles.feet) <= made.feet
                found = outcome(is_right, "feet" not in roles.unsure)
            yield marker_set, "people, feet", posture, found


GUESSES = {"up": _up, "unit": _unit, "rate": _rate, "roles": _roles}


def main() -> None:
    parser = argparse.ArgumentParser(description="Honesty of guesses.")
    parser.add_argument("--out", type=Path, help="CSV file to write")
    parser.add_argument(
        "--recordings", type=Path, default=ROOT.parent / "shared/recordings"
    )
    parser.add_argument("--seeds", type=int, default=5, help="pieces of each length")
    parser.add_argument(
        "--seed", type=int, default=SEED, help="seed of pieces and hoppers"
    )
    kinds = [*GUESSES, "people"]
    parser.add_argument("--only", choices=kinds, nargs="*", default=kinds)
    parser.add_argument(
        "--verbose", action="store_true", help="name wrong and sure guesses"
    )
    options = parser.parse_args()
    rows = []
    for number, piece in enumerate(
        pieces(options.recordings, options.seed, options.seeds)
    ):
        for guess, made in GUESSES.items():
            if guess not in options.only:
                continue
            rng = np.random.default_rng(np.random.SeedSequence([options.seed, number]))
            for change, what in made(piece, rng):
                rows.append((piece.file, guess, change, what))
                if options.verbose and what.startswith("wrong_sure"):
                    print(piece.file, f"{len(piece.raw.time)} frames:", guess, change)
    if "people" in options.only:
        for k in range(options.seeds):
            for row in people(options.seed % 100_000 + k):
                rows.append(row)
                if options.verbose and row[-1] == "wrong_sure":
                    print(*row)
    table = pd.DataFrame(rows, columns=["file", "guess", "change", "outcome"])
    counts = pd.crosstab([table["guess"], table["change"]], table["outcome"])
    names = ["right_sure", "right_unsure", "wrong_unsure", "asked", "wrong_sure"]
    counts = counts.reindex(columns=names, fill_value=0)
    of_all = counts.groupby(level=0).sum()
    of_all.index = pd.MultiIndex.from_tuples(
        [(g, "all") for g in of_all.index], names=counts.index.names
    )
    counts = pd.concat([counts, of_all]).sort_index()
    counts["wrong_sure_%"] = (100 * counts["wrong_sure"] / counts.sum(axis=1)).round(1)
    print(counts.to_string())
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        counts.reset_index().to_csv(options.out, index=False, lineterminator="\n")


if __name__ == "__main__":
    main()
