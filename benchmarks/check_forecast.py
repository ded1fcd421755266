"""What `hopdata check` predicts, what the study then finds, and how long each takes.

    python benchmarks/check_forecast.py --out check_forecast.csv [--only NAME ...]

The cases are simulated hoppers, sound or each failing in its own way (written as files
without truth, from seeds of their own), and the public recordings of the README if they
are present. Each row is one study: first `hopdata check` as a user sees it, then the
whole workflow. `used_*` are touchdowns used. `timed_off` is the largest difference in a
foot's share of timed contacts. `answer` says whether the verdict came out as forecast:
an answer if it was in reach or in doubt, none if it was out of reach. A study that
stops has no touchdowns; `same_end` then says whether `check` ended with the same
message. `seconds_*` is processor time of all processes.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from hopdata.config.loading import load_config
from hopdata.recording import Recording
from hopdata.recordings.readers.hdf5 import write_recording
from hopdata.synthesis import simulate_recording

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "recordings")]

from trc_files import trc_text  # noqa: E402

FOLDERS = (
    ROOT / "data/sample",
    ROOT / "data/external",
    *(ROOT.parent / "shared/recordings").glob("*"),
)
HOPS = 400
BODY, FEET = ["body1", "body2", "body3"], ["foot1", "foot2", "foot3"]
Fault = Callable[[Recording, np.random.Generator], Recording]


def _with(recording: Recording, change: Callable[[np.ndarray], Any]) -> Recording:
    """Return a recording with its positions changed in place."""
    positions = recording.positions.copy()
    change(positions)
    return replace(recording, positions=positions)


def _blinking(recording: Recording, rng: np.random.Generator) -> Recording:
    """Hide one foot half the time, for half a second on average."""
    hidden = np.repeat(rng.random(len(recording.time) // 50 + 1) < 0.5, 50)[
        : len(recording.time)
    ]
    return _with(recording, lambda p: p[:, 4].__setitem__(hidden, np.nan))


def _delayed(recording: Recording, rng: np.random.Generator) -> Recording:
    """Let the feet land in one order: the first 0.05 s earlier, the last 0.05 s later."""
    del rng
    return _with(
        recording,
        lambda p: [
            p.__setitem__((slice(None), m), np.roll(p[:, m], k, axis=0))
            for m, k in ((3, -5), (5, 5))
        ],
    )


def _swapped(recording: Recording, rng: np.random.Generator) -> Recording:
    del rng
    half = len(recording.time) // 2
    return _with(
        recording,
        lambda p: p[half:].__setitem__((slice(None), [3, 4]), p[half:, [4, 3]]),
    )


def _thinned(step: int) -> Fault:
    return lambda r, _: replace(
        r, time=r.time[::step], positions=r.positions[::step], rate_hz=r.rate_hz / step
    )


def _cut(frames: int) -> Fault:
    return lambda r, _: r.part(slice(0, frames))


def _in_flight(recording: Recording, rng: np.random.Generator) -> Recording:
    """End the recording at the top of a hop."""
    del rng
    return recording.part(
        slice(0, 20_000 + int(np.argmax(recording.body_height[20_000:20_070])))
    )


def _lost(first: float, marker: int) -> Fault:
    """Lose a marker after this fraction of the recording."""
    return lambda r, _: _with(
        r, lambda p: p[int(first * len(p)) :, marker].__setitem__(slice(None), np.nan)
    )


def _noisy(recording: Recording, rng: np.random.Generator) -> Recording:
    return _with(recording, lambda p: p.__iadd__(rng.normal(0, 0.004, p.shape)))


def _drifting(recording: Recording, rng: np.random.Generator) -> Recording:
    del rng
    ramp = np.linspace(0, 0.06, len(recording.time))
    return _with(recording, lambda p: p[:, :, 2].__iadd__(ramp[:, None]))


def _standing(recording: Recording, rng: np.random.Generator) -> Recording:
    """Keep the feet on the floor."""
    return _with(
        recording,
        lambda p: p[:, 3:6, 2].__setitem__(
            slice(None), rng.normal(0, 6e-4, p[:, 3:6, 2].shape)
        ),
    )


def _slipped(recording: Recording, rng: np.random.Generator) -> Recording:
    """Let a foot's marker slip up its leg by 30 mm half way through the recording."""
    del rng
    return _with(recording, lambda p: p[len(p) // 2 :, 3, 2].__iadd__(0.03))


#: Case: change to a sound recording, and additional configuration.
SYNTHETIC: dict[str, tuple[Fault, dict[str, Any]]] = {
    "sound": (lambda r, _: r, {}),
    "too short for a verdict": (_cut(6_000), {}),
    "two seconds": (_cut(200), {}),
    "a foot hidden half the time": (_blinking, {}),
    "a body marker lost half way": (_lost(0.5, 1), {}),
    "a body marker never seen": (_lost(0.0, 1), {}),
    "33 Hz": (_thinned(3), {}),
    "14 Hz": (_thinned(7), {}),
    "a floor that sinks by 60 mm": (_drifting, {}),
    "wrong vertical axis": (lambda r, _: r, {"input": {"vertical_axis": "y"}}),
    "millimetres said to be metres": (lambda r, _: r, {"input": {"unit": "m"}}),
    "two feet swapped half way": (_swapped, {}),
    "no flight": (_standing, {}),
    "one order only": (_delayed, {}),
    "ends in flight": (_in_flight, {}),
    "noise of 4 mm": (_noisy, {}),
    "a foot's marker slips": (_slipped, {}),
    "a wrong section": (lambda r, _: r, {"sections": {"pre_height_m": 0.9}}),
}
_WALK = {
    "body": ["R.ASIS", "L.ASIS", "V.Sacral"],
    "feet": ["R.Heel", "R.Toe.Tip"],
}
_RUN = {"body": ["R.ASIS", "L.ASIS", "R.PSIS"]}
_SMALL = {"body": ["body1", "body2", "body3"]}
#: Case: file, markers, and whether untracked feet also land.
PUBLIC: dict[str, tuple[str, dict[str, list[str]], bool]] = {
    **{
        f"RBDS001 2.5 m/s, {side}": (
            "RBDS001runT25markers.tsv",
            {**_SMALL, "feet": [f"{side}_heel", f"{side}_mt1", f"{side}_mt5"]},
            True,
        )
        for side in "LR"
    },
    **{
        f"{file}, {side}": (
            file,
            {**_RUN, "feet": [f"{side}.Heel.Bottom", f"{side}.MT1", f"{side}.MT5"]},
            True,
        )
        for file in (
            "RBDS001runT35.c3d",
            "RBDS001runT35_markers.txt",
            "RBDS032runT35markers.txt",
        )
        for side in "LR"
    },
    "walk_free_01": ("walk_free_01.trc", _WALK, False),
    "subject01_synthetic": ("subject01_synthetic_marker_data.trc", _WALK, False),
    "init100": ("init100.trc", _WALK, False),
    "std_walking2": (
        "std_walking2_markers.trc",
        {"body": ["RASI", "LASI", "RPSI", "LPSI"], "feet": ["RCAL", "RMT1", "RMT2"]},
        False,
    ),
    "dataWithBlanks": (
        "dataWithBlanksForMissingMarkers.trc",
        {"body": ["RASI", "LASI", "RPSI", "LPSI"], "feet": ["RCAL", "RMT1", "RMT2"]},
        False,
    ),
    "abdbonepin": (
        "abdbonepin.trc",
        {"body": ["ij", "ts", "ac"], "feet": ["EpL", "gu"]},
        False,
    ),
    "dataWithEformat": (
        "dataWithEformat.trc",
        {"body": ["C7", "RACR", "LCLAV"], "feet": ["RMCP1", "RMCP5"]},
        False,
    ),
    "dataWithNaNs": (
        "dataWithNaNsOfDifferentCases.trc",
        {"body": ["hip", "rASIS", "medKnee"], "feet": ["toe", "heel"]},
        False,
    ),
    "exampleFormat": (
        "exampleFormat.trc",
        {"body": ["marker1", "marker2", "marker3"], "feet": ["marker1", "marker2"]},
        False,
    ),
}


def synthetic_study(
    name: str, seed: np.random.SeedSequence, folder: Path
) -> dict[str, Any]:
    """Write the recording of a case, and return its configuration."""
    fault, extra = SYNTHETIC[name]
    markers = {"body": BODY, "feet": FEET, "boom": ["boom"]}
    config = load_config(
        {"study": "s", "recordings": [{"name": "one"}], "markers": markers}
    )
    number, rng = int(seed.generate_state(1)[0]), np.random.default_rng(seed)
    scene = {**config["simulation"], "hops": HOPS}
    recording, _ = simulate_recording(
        scene, config["motion_capture"], seed=(number, 0), name="one"
    )
    recording = fault(recording, rng)
    file = folder / "one.h5"
    if "unit" in extra.get("input", {}):
        file = folder / "one.trc"
        rate_hz = recording.rate_hz
        text = trc_text(1e3 * recording.positions, recording.markers, rate_hz=rate_hz)
        file.write_text(text, encoding="utf-8")
    else:
        write_recording(file, recording)
    return {
        "recordings": [{"name": "one", "file": str(file)}],
        "markers": markers,
        **extra,
    }


def public_study(name: str) -> dict[str, Any] | None:
    """Return the configuration of a public recording; None where it is absent."""
    file, markers, others = PUBLIC[name]
    found = [folder / file for folder in FOLDERS if (folder / file).is_file()]
    if not found:
        return None
    study: dict[str, Any] = {"recordings": [{"name": "one", "file": str(found[0])}]}
    if others and not file.endswith(".tsv"):
        study["input"] = {"vertical_axis": "y", "rate_hz": 150.0}
    if others:
        study["sections"] = {"frames": "landings"}
    return {**study, "markers": markers}


def run(folder: Path, *arguments: str) -> tuple[int, str, float]:
    """Run a module; return its exit code, its output, and its processor time, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = sum(after[:2]) - sum(before[:2])
    return done.returncode, done.stdout + done.stderr, seconds


def foretold(text: str, feet: list[str]) -> dict[str, Any]:
    """Parse the numbers that `hopdata check` prints."""
    found: dict[str, Any] = {
        "reach": "",
        "changes": "; ".join(re.findall(r"change +(.*)", text)),
    }
    if numbers := re.search(r"(\d+) of (\d+) will be used", text):
        found |= {"used": int(numbers[1]), "landings": int(numbers[2])}
        found["timed"] = [
            float(re.search(rf"{re.escape(foot)} (\d+) %", text)[1]) / 100  # type: ignore[index]
            for foot in feet
        ]
    if reach := re.search(r"verdict +(in reach only|[^:]+)", text):
        found["reach"] = reach[1]
    if size := re.search(r"difference of ([\d.e+]+) % of the map shows", text):
        found["detectable"] = float(size[1]) / 100
    return found


def finding(results: Path, feet: list[str]) -> dict[str, Any]:
    """Return the same numbers from the study; empty if it stopped before its touchdowns."""
    if not (results / "tables/touchdowns.csv").is_file():
        return {}
    table = pd.read_csv(results / "tables/touchdowns.csv", keep_default_na=False)
    landed = table[table["reason"] != "no foot of the study landed"]
    timed = [float((landed[f"contact_{foot}_s"] != "").mean()) for foot in feet]
    used = int((table["excluded"].astype(str) == "False").sum())
    found: dict[str, Any] = {"used": used, "landings": len(landed), "timed": timed}
    verdict = json.loads((results / "verdict.json").read_text(encoding="utf-8"))
    detectable = verdict["effect"]["detectable"] if verdict["effect"] else None
    return found | {"conclusion": verdict["conclusion"], "detectable": detectable}


def _message(text: str) -> str:
    """Return the first line of the error message of a command or study."""
    found = re.search(r"(?:hopdata: error: |Error: |ERROR: )(.*)", text)
    return re.sub(r"\s+", " ", found[1]).strip() if found else ""


def compared(name: str, study: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Check a study, then run it."""
    (folder / "study.yaml").write_text(
        yaml.safe_dump({"study": "s", **study}), encoding="utf-8"
    )
    feet = study["markers"]["feet"]
    code, said, seconds_check = run(folder, "hopdata", "check", "study.yaml")
    _, log, seconds_study = run(
        folder, "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--configfile", "study.yaml",
        "--cores", "1", "--quiet", "all",
    )  # fmt: skip
    told, found = foretold(said, feet), finding(folder / "results/s", feet)
    row: dict[str, Any] = {
        "case": name,
        "seconds_check": seconds_check,
        "seconds_study": seconds_study,
        "share": seconds_check / seconds_study,
        "used_foretold": told.get("used"),
        "landings_foretold": told.get("landings"),
        "reach": told["reach"] or "stops",
        "detectable_foretold": told.get("detectable"),
    }
    if found:
        answered = found["conclusion"] != "cannot tell"
        hopeful = told["reach"] in ("in reach", "in doubt")
        row |= {
            "used_found": found["used"],
            "landings_found": found["landings"],
            "conclusion": found["conclusion"],
            "detectable_found": found["detectable"],
            "answer": answered if hopeful else not answered,
        }
        if "timed" in told:
            row["timed_off"] = float(
                np.abs(np.subtract(told["timed"], found["timed"])).max()
            )
    else:
        logs = "".join(p.read_text() for p in (folder / "results/s/logs").glob("*.log"))
        message = _message(said[said.find("hopdata: error") :])
        row |= {
            "same_end": bool(
                code and message and message[:60] in " ".join((log + logs).split())
            )
        }
        row |= {"conclusion": "stops", "message": message}
    return row | {"changes": told["changes"]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", help="names of cases")
    arguments = parser.parse_args()
    seeds = np.random.SeedSequence(arguments.seed).spawn(len(SYNTHETIC))
    rows = []
    for name in arguments.only or [*SYNTHETIC, *PUBLIC]:
        with tempfile.TemporaryDirectory() as folder:
            if name in SYNTHETIC:
                seed = seeds[list(SYNTHETIC).index(name)]
                study: dict[str, Any] | None = synthetic_study(name, seed, Path(folder))
            else:
                study = public_study(name)
            rows.append(
                {"case": name, "conclusion": "absent"}
                if study is None
                else compared(name, study, Path(folder))
            )
        print(rows[-1], flush=True)
    table = pd.DataFrame(rows)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(arguments.out, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
