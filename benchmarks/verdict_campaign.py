"""How often the verdict errs on bodies, mechanisms and conditions that are not ours.

    python benchmarks/verdict_campaign.py --out verdict_campaign.csv [run | table]
        [--studies 40] [--first 1000] [--cells REGEX] [--jobs 2]

`run` judges the studies that are missing, `table` makes the tables of those that are
there; without either, both. A cell is one combination of mechanism, feet, spread of the
contacts, scatter of the legs, noise, session, fault and number of landings. A study is
one body (`bodies.py`), drawn from its own seed, with landings and errors of its own.
Cells that differ only in how the landings are seen share landings, so their errors come
together. Seeds 0 to 99 are for choosing how the verdict works, seeds from 1000 on, the
default, only for reporting.

One row for each study is appended to ``verdict_campaign_studies.csv`` as soon as it is
judged, and a run that was interrupted goes on with those that have no row. A study that
raises an error has a row with its text. Remove the file to judge anew. All rows but
their processor times are the same at any number of jobs.

``verdict_campaign.csv`` has one row for each cell. Shares are of the studies that gave a
number. `called_different` and `called_none` are shares of all studies. The bound and
the interval of derivatives are compared with their exact difference at the simultaneous
contact (`bound_holds`, `interval_holds`); those of jumps with the exact jump.

If the difference saturates, the bound over the landings is compared with what the
mechanism makes on average over them (`bound_holds_average`). `saturates` is the share
of studies that find this. They give no bound at the contact, so `bound_holds` is of the
others; their intervals hold if the low end does.

Of positions that a low-pass has smoothed, the verdict is asked as a study asks it: with
the reason that the recording's filter gives, if it cuts off low. One cell keeps the
filter to itself. For
each rival (`verdict_rivals.py`), `_found` is the share that it calls different itself,
and `_equal` the share above the 95 % quantile of its statistic in the C1 twin of the
cell, that is at equal size.

``verdict_campaign_detectable.csv`` has one row for each mechanism and truth: of the
steady, faultless studies whose truth is 0.8 to 1.25 of `detectable`, the share in which
the verdict finds it, with its 95 % interval (Wilson). 80 % are promised.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from bodies import (
    CHOOSE,
    JUMPING,
    REPORT,
    SATURATING,
    SESSIONS,
    Body,
    Landings,
    Truth,
    body_of_size,
)
from body_motion import MECHANISMS
from body_seen import Seen, Study, study
from statsmodels.stats.proportion import proportion_confint
from verdict_rivals import RIVALS, rivals

from hopdata.landings.checks import blurred
from hopdata.landings.contacts.altered import FILTER_DELAYS
from hopdata.maps.verdict import judge
from hopdata.maps.verdict.judge import Verdict

STUDIES = 40
FLIPS = 999
KINKS = (0.15, 0.6)  # sizes of the differences, drawn evenly on a logarithmic scale
JUMPS = (0.06, 0.3)
AVERAGED_OVER = 40  # landings
OF_MANY_ORDERS = 240  # landings whose orders are compared, with more than three feet
NEAR_DETECTABLE = (0.8, 1.25)


def low_pass(cut_off_hz: float) -> dict[str, float]:
    """Return how landings are seen through a low-pass filter."""
    return {"blur_s": 1.0 / (2.0 * np.pi * cut_off_hz)}


#: What is wrong with how the landings are seen.
ERRORS: dict[str, dict[str, float]] = {
    "none": {},
    "alike": {"alike": 0.9},
    "low-passed": low_pass(6.0),
    "low-passed at 12 Hz": low_pass(12.0),
    "low-passed, not told": low_pass(6.0),
    "drift": {"drift_rad": 0.010},
}

#: Cut-off frequencies that the recordings tell, Hz.
TOLD_HZ = {"low-passed": 6.0, "low-passed at 12 Hz": 12.0}


@dataclass(frozen=True)
class Scene:
    """What moves: cells of one scene share their landings."""

    mechanism: str = "c1"
    feet: int = 3
    spread_ms: float = 10.0
    scatter_mm: float = 0.0
    session: str = "steady"
    simulated: int = 1000

    @property
    def name(self) -> str:
        """Return a name with all that defines the scene."""
        return (
            f"{self.mechanism}, {self.feet} feet, {self.spread_ms:g} ms, "
            f"legs {self.scatter_mm:g} mm, {self.session}, {self.simulated}"
        )


@dataclass(frozen=True)
class Cell:
    """A scene, and how it is seen."""

    scene: Scene = Scene()
    landings: int = 1000
    noise_mm: float = 0.6
    errors: str = "none"
    fault: str = ""

    @property
    def name(self) -> str:
        """Return a name with all that defines the cell."""
        return (
            f"{self.scene.name}: {self.landings} landings, noise {self.noise_mm:g} mm, "
            f"errors {self.errors}, fault {self.fault or 'none'}"
        )


def cell(landings: int = 1000, **settings: Any) -> Cell:
    """Return the cell with these settings of scene or sight."""
    of_sight = {"noise_mm", "errors", "fault"}
    sight = {key: value for key, value in settings.items() if key in of_sight}
    moving = {key: value for key, value in settings.items() if key not in of_sight}
    simulated = max(landings, Scene.simulated)
    return Cell(Scene(simulated=simulated, **moving), landings, **sight)


def all_cells() -> list[Cell]:
    """Return the cells of the campaign: one setting or two differ from the first."""
    cells = []
    for mechanism in MECHANISMS:
        cells += [cell(mechanism=mechanism), cell(300, mechanism=mechanism)]
    for mechanism in ("c1", "clutch", "rank", "stick"):
        cells += [cell(600, mechanism=mechanism), cell(2000, mechanism=mechanism)]
    for mechanism in ("clutch", "side", "stick", "latch"):
        cells.append(cell(mechanism=mechanism, scatter_mm=8.0))
    for mechanism in ("c1", "reflex", "rank"):
        for scatter_mm in (2.0, 4.0, 8.0, 14.0):
            cells.append(cell(mechanism=mechanism, scatter_mm=scatter_mm))
    for mechanism in ("c1", "clutch", "rank"):
        cells += _cells_of(mechanism)
    return list(dict.fromkeys(cells))


def _cells_of(mechanism: str) -> list[Cell]:
    """Return the cells in which conditions vary."""
    settings: list[dict[str, Any]] = []
    for feet in (2, 4, 6):
        settings += [{"feet": feet}, {"feet": feet, "scatter_mm": 8.0}]
    settings += [{"noise_mm": noise_mm} for noise_mm in (0.2, 1.5, 3.0)]
    settings += [{"spread_ms": spread_ms} for spread_ms in (2.0, 5.0, 20.0)]
    settings += [
        {"spread_ms": 2.0, "noise_mm": 1.5},
        {"spread_ms": 5.0, "noise_mm": 3.0},
        {"spread_ms": 20.0, "noise_mm": 3.0},
        {"scatter_mm": 8.0, "noise_mm": 1.5},
        {"session": "softening", "scatter_mm": 8.0},
    ]
    changing = [session for session in SESSIONS if session != "steady"]
    for session in changing:
        settings += [{"session": session}, {"session": session, "noise_mm": 0.2}]
    settings += [{"errors": errors} for errors in ERRORS if errors != "none"]
    faults = ("swapped markers", "slips", "double bounces", "outlying instants")
    settings += [{"fault": fault} for fault in faults]
    return [cell(mechanism=mechanism, **one) for one in settings]


# One study.


def source(seed: int, *names: str) -> np.random.Generator:
    """Return the source of random numbers of a study for what is named."""
    labels = [crc32(name.encode()) for name in names]
    return np.random.default_rng(np.random.SeedSequence([seed, *labels]))


def filter_told(landings: Landings, cut_off_hz: float) -> str:
    """Return why a study would not trust states from such a filter; empty if it does."""
    n = len(landings)
    touchdowns = {
        "recording": ["low-passed"] * n,
        "excluded": [False] * n,
        "t_pre_s": np.zeros(n),
        "t_post_s": landings.ends,
        "common_foot1_s": np.full(n, FILTER_DELAYS / cut_off_hz),
    }
    return blurred(pd.DataFrame(touchdowns))


def asked(data: Study, seed: int, filtered: str = "") -> Verdict:
    """Return the verdict on a study, of which a filter may be known."""
    return judge(
        data.x,
        data.y,
        data.instants,
        seed=seed,
        instants_se=data.instants_se,
        feet=data.feet,
        feet_se=data.feet_se,
        time=data.time,
        blocks=data.blocks,
        blurred=filtered,
        flips=FLIPS,
    )


def moved(scene: Scene, seed: int) -> tuple[Body, Landings, Truth]:
    """Return the body of a study, its landings and their exact differences."""
    limits = KINKS
    if scene.mechanism in JUMPING:
        limits = JUMPS
    size = np.exp(source(seed, scene.name, "size").uniform(*np.log(limits)))
    body = body_of_size(
        float(size),
        seed=seed,
        mechanism=scene.mechanism,
        feet=scene.feet,
        spread_s=1e-3 * scene.spread_ms,
        scatter_m=1e-3 * scene.scatter_mm,
    )
    rng = source(seed, scene.name, "landings")
    landings = body.landings(scene.simulated, rng, SESSIONS[scene.session])
    over = 0
    if scene.mechanism in SATURATING:
        over = AVERAGED_OVER
    most = OF_MANY_ORDERS
    if scene.mechanism == "c1":
        most = OF_MANY_ORDERS // 4
    return body, landings, body.truth(landings, over, most)


def judged(one: Cell, seed: int, body: Body, landings: Landings) -> dict[str, Any]:
    """Return what the verdict and its rivals say of one study."""
    seen = Seen(noise_m=1e-3 * one.noise_mm, fault=one.fault, **ERRORS[one.errors])
    rng = source(seed, one.name, "errors")
    used = landings.some(slice(one.landings))
    data = study(body, used, rng, seen)
    filtered = ""
    if one.errors in TOLD_HZ:
        filtered = filter_told(used, TOLD_HZ[one.errors])
    began = time.process_time()
    verdict = asked(data, seed, filtered)
    row: dict[str, Any] = {
        "judge_s": time.process_time() - began,
        "conclusion": verdict.conclusion,
        "foretold": verdict.contacts_r2,
        "saturates": int(verdict.saturates),
        "notes": " ".join(sorted({note.code for note in verdict.notes})),
    }
    for prefix, size in (("", verdict.effect), ("jump_", verdict.jump)):
        if size is not None:
            row |= {f"{prefix}{name}": getattr(size, name) for name in OF_SIZE}
    if verdict.effect_over_landings is not None:
        row["over_upper_bound"] = verdict.effect_over_landings.upper_bound
    for name, (statistic, found) in rivals(data.x, data.y, data.instants, seed).items():
        row[name] = statistic
        row[f"{name}_found"] = int(found)
    return row


OF_PROMISE = [
    "mechanism",
    "truth",
    "studies",
    "found_share",
    "found_low",
    "found_high",
]
OF_SIZE = [
    "estimate",
    "low",
    "high",
    "upper_bound",
    "detectable",
    "allowed",
    "p_value",
]
SETTINGS = [
    "mechanism",
    "feet",
    "spread_ms",
    "scatter_mm",
    "session",
    "landings",
    "noise_mm",
    "errors",
    "fault",
]
COLUMNS = [
    "cell",
    "seed",
    *SETTINGS,
    "error",
    "leg",
    "strength",
    "spread_seen_ms",
    "true_kink",
    "true_jump",
    "true_average",
    "conclusion",
    *OF_SIZE,
    *(f"jump_{name}" for name in OF_SIZE),
    "over_upper_bound",
    "saturates",
    "foretold",
    "notes",
    "judge_s",
    *(f"{name}{end}" for name in RIVALS for end in ("", "_found")),
]


def settings_of(one: Cell) -> dict[str, Any]:
    """Return what defines a cell."""
    both = asdict(one.scene) | asdict(one)
    return {"cell": one.name, **{name: both[name] for name in SETTINGS}}


def studies_of(scene: Scene, seed: int, cells: list[Cell]) -> list[dict[str, Any]]:
    """Return one row for each cell of a scene; errors become rows."""
    rows = [{**settings_of(one), "seed": seed} for one in cells]
    try:
        body, landings, truth = moved(scene, seed)
    except Exception as error:  # no study may end the campaign
        return [row | {"error": told(error)} for row in rows]
    exact = {
        "leg": body.drawn_leg,
        "strength": body.strength,
        "spread_seen_ms": 1e3 * np.sqrt(np.mean(np.var(landings.instants, axis=1))),
        "true_kink": truth.kink,
        "true_jump": truth.jump,
        "true_average": truth.averaged,
    }
    for row, one in zip(rows, cells, strict=True):
        row |= exact
        try:
            row |= judged(one, seed, body, landings)
        except Exception as error:  # no study may end the campaign
            row["error"] = told(error)
    return rows


def told(error: Exception) -> str:
    """Return an error in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}"[:300]


# The campaign.


def run(file: Path, cells: list[Cell], seeds: Iterable[int], jobs: int) -> None:
    """Judge the studies that have no row in the file, and append theirs."""
    done = finished(file)
    tasks = []
    for seed in seeds:
        of_scenes: dict[Scene, list[Cell]] = {}
        for one in cells:
            if (one.name, seed) not in done:
                of_scenes.setdefault(one.scene, []).append(one)
        tasks += [(scene, seed, missing) for scene, missing in of_scenes.items()]
    if not tasks:
        return
    # Compiled once, before the processes that inherit it start.
    Body(0).landings(2, np.random.default_rng(0))
    began = time.monotonic()
    count = 0
    with ProcessPoolExecutor(jobs) as pool, file.open("a", newline="") as out:
        writer = csv.DictWriter(out, COLUMNS)
        if not done and not file.stat().st_size:
            writer.writeheader()
        waiting = [pool.submit(studies_of, *task) for task in tasks]
        for finished_scene in as_completed(waiting):
            for row in finished_scene.result():
                writer.writerow({key: shown(value) for key, value in row.items()})
                count += 1
            out.flush()
            minutes = (time.monotonic() - began) / 60
            print(f"\r{count} studies in {minutes:.1f} min", end="", flush=True)
    print()


def shown(value: Any) -> Any:
    """Return a value as the rows have it."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return value


def finished(file: Path) -> set[tuple[str, int]]:
    """Return cell and seed of each row; a last line that is not whole is removed.

    Raises
    ------
    SystemExit
        If the rows have other columns, as those of another version do.
    """
    if not file.exists():
        return set()
    text = file.read_bytes()
    whole = text.rfind(b"\n") + 1
    if whole < len(text):
        with file.open("r+b") as out:
            out.truncate(whole)
    with file.open(newline="") as rows:
        reader = csv.DictReader(rows)
        if whole and reader.fieldnames != COLUMNS:
            raise SystemExit(f"{file}: rows of another version; move it away")
        return {(row["cell"], int(row["seed"])) for row in reader}


# The tables.


def read(file: Path) -> pd.DataFrame:
    """Return the rows, in an order that no run decides, with what follows from them."""
    rows = pd.read_csv(file, dtype={"fault": str, "error": str, "notes": str})
    order = {one.name: number for number, one in enumerate(all_cells())}
    rows["number"] = rows["cell"].map(order)
    rows = rows.sort_values(["number", "seed"], ignore_index=True)
    for name in ("fault", "error", "notes"):
        rows[name] = rows[name].fillna("")
    rows["different"] = rows["conclusion"] == "different"
    rows["bound"] = rows["upper_bound"] >= rows["true_kink"]
    rows["bound_average"] = rows["over_upper_bound"] >= rows["true_average"]
    rows["found_to_saturate"] = rows["saturates"] == 1
    rows["interval"] = _within(rows, "true_kink", "")
    rows["jump_bound"] = rows["jump_upper_bound"] >= rows["true_jump"]
    rows["jump_interval"] = _within(rows, "true_jump", "jump_")
    return rows


def _within(rows: pd.DataFrame, true: str, prefix: str) -> pd.Series:
    above = rows[f"{prefix}low"] <= rows[true]
    below = rows[true] <= rows[f"{prefix}high"]
    return above & below


def cell_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each cell."""
    twins = {
        tuple(part[SETTINGS[1:]].iloc[0]): part
        for _, part in rows[rows["mechanism"] == "c1"].groupby("cell")
    }
    found = []
    for _, part in rows.groupby("cell", sort=False):
        first = part.iloc[0]
        twin = twins.get(tuple(first[SETTINGS[1:]]))
        found.append({name: first[name] for name in SETTINGS} | _summary(part, twin))
    return pd.DataFrame(found)


def _summary(part: pd.DataFrame, twin: pd.DataFrame | None) -> dict[str, Any]:
    judged_ones = part[part["error"] == ""]
    known = judged_ones.dropna(subset=["upper_bound"])
    steps = known.dropna(subset=["jump_upper_bound"])
    kinked = known[known["true_kink"] > 0.05]
    stepped = steps[steps["true_jump"] > 0.02]
    bounded = known[~known["found_to_saturate"]]
    row = {
        "seeds": _purpose(part["seed"]),
        "studies": len(part),
        "failed": len(part) - len(judged_ones),
        "without_number": len(judged_ones) - len(known),
        "called_different": judged_ones["different"].mean(),
        "called_none": (judged_ones["conclusion"] == "no difference").mean(),
        "kink_found": (known["low"] > 0).mean(),
        "jump_found": (steps["jump_low"] > 0).mean(),
        "bound_holds": bounded["bound"].mean(),
        "bound_holds_average": known["bound_average"].mean(),
        "saturates": known["found_to_saturate"].mean(),
        "interval_holds": known["interval"].mean(),
        "jump_bound_holds": steps["jump_bound"].mean(),
        "jump_interval_holds": steps["jump_interval"].mean(),
        "spread_seen_ms": known["spread_seen_ms"].median(),
        "bound_median": known["upper_bound"].median(),
        "detectable_median": known["detectable"].median(),
        "allowed_median": known["allowed"].median(),
        "true_kink": known["true_kink"].median(),
        "true_jump": known["true_jump"].median(),
        "true_average": known["true_average"].median(),
        "estimate_over_true": (kinked["estimate"] / kinked["true_kink"]).median(),
        "jump_over_true": (stepped["jump_estimate"] / stepped["true_jump"]).median(),
        "foretold": known["foretold"].median(),
        "judge_s": judged_ones["judge_s"].median(),
    }
    if part["mechanism"].iloc[0] not in SATURATING:
        row["bound_holds_average"] = np.nan
    for name in RIVALS:
        row[f"{name}_found"] = judged_ones[f"{name}_found"].mean()
        row[f"{name}_equal"] = np.nan
        if twin is not None:
            limit = twin[name].quantile(0.95, interpolation="higher")
            row[f"{name}_equal"] = (judged_ones[name] > limit).mean()
    return row


def _purpose(seeds: pd.Series) -> str:
    if seeds.isin(REPORT).all():
        return "report"
    if seeds.isin(CHOOSE).all():
        return "choose"
    return "mixed"


def detectable_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each mechanism and truth: how often `detectable` is found."""
    plain = (
        (rows["session"] == "steady")
        & (rows["errors"] == "none")
        & (rows["fault"] == "")
        & (rows["mechanism"] != "c1")
    )
    found = []
    for mechanism, part in rows[plain].groupby("mechanism", sort=False):
        truths = [("true_kink", "")]
        if mechanism in SATURATING:
            truths.append(("true_average", ""))
        if mechanism in JUMPING:
            truths = [("true_jump", "jump_")]
        for true, prefix in truths:
            ratio = part[true] / part[f"{prefix}detectable"]
            near = part[ratio.between(*NEAR_DETECTABLE)]
            hits = int((near[f"{prefix}low"] > 0).sum())
            low, high = np.nan, np.nan
            if len(near):
                low, high = proportion_confint(hits, len(near), method="wilson")
            row = {"mechanism": mechanism, "truth": true, "studies": len(near)}
            row |= {"found_share": hits / max(len(near), 1)}
            found.append(row | {"found_low": low, "found_high": high})
    return pd.DataFrame(found, columns=OF_PROMISE)


def tables(out: Path, file: Path) -> None:
    """Write the tables of the rows that are there."""
    rows = read(file)
    of_cells = cell_table(rows)
    of_cells.to_csv(out, index=False, float_format="%.3g")
    promised = detectable_table(rows)
    beside = out.with_name("verdict_campaign_detectable.csv")
    promised.to_csv(beside, index=False, float_format="%.3g")
    columns = ["studies", "called_different", "bound_holds", "bound_median"]
    print(of_cells[[*SETTINGS, *columns]].to_string(index=False))
    print(promised.to_string(index=False))


def main() -> None:
    """Run the missing studies and write the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("what", nargs="?", choices=["run", "table"])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--studies", type=int, default=STUDIES, help="of each cell")
    parser.add_argument("--first", type=int, default=REPORT[0], help="first seed")
    parser.add_argument("--cells", default="", help="cells whose name matches")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    args = parser.parse_args()
    args.out.parent.mkdir(parents=True, exist_ok=True)
    file = args.out.with_name("verdict_campaign_studies.csv")
    if args.what != "table":
        cells = [one for one in all_cells() if re.search(args.cells, one.name)]
        seeds = range(args.first, args.first + args.studies)
        run(file, cells, seeds, args.jobs)
    if args.what != "run":
        tables(args.out, file)


if __name__ == "__main__":
    main()
