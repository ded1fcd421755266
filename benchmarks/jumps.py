"""Jumps on two feet: what is found in recordings that were not used to choose anything.

    python benchmarks/jumps.py --out jumps.csv [--seeds 5] [--only KIND ...] [--run]

The files are made up and hold 22 landings: eleven trials of a jump from a box and a
rebound, or two series of eleven counter-movement jumps with seconds of standing
between. Body and feet fall freely. A foot is rigid; its toes touch first and its heel
30 to 80 ms later, and the right foot lands up to 25 ms before or after the left. A
contact stops at once or within some milliseconds. Rates of 100 to 250 Hz and noise of
0.3 to 1 mm change from seed to seed, as do unit, vertical axis and format. A foot
marker is hidden for some frames at one contact in twenty.

Each row is one study, as a user makes it: `hopdata init` on the first file, the others
added to it, `hopdata check`, and the study's stages in this process (with `--run`,
`hopdata run`). `feet` says whether the feet are those that init chose, or heel and toe
are joined into one (`sides`, if init chose otherwise). `found` counts landings with all
feet timed within 30 ms; `used` those that the study keeps; `right` is the share of
right orders among the `sure` ones, `likely_right` among all that are found.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from scipy.interpolate import BPoly

from hopdata.__main__ import main as hopdata
from hopdata.analysis import Study
from hopdata.arrays import GRAVITY_M_S2 as G
from hopdata.arrays import FloatArray
from hopdata.config.consistency import feet_of
from hopdata.config.loading import load_config

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "tests" / "recordings")]

from qtm_files import qtm_text  # noqa: E402
from trc_files import trc_text  # noqa: E402

LANDINGS, SAME_S, FAR = 22, 0.03, 1.0
PELVIS = ("LASI", "RASI", "LPSI", "RPSI")
NAMES = (*PELVIS, "C7", "LTOE", "LHEE", "LANK", "RTOE", "RHEE", "RANK")
PELVIS_AT = np.array(
    [[0.1, 0.12, 1.0], [0.1, -0.12, 1.0], [-0.08, 0.05, 1.02], [-0.08, -0.05, 1.02]]
)
#: Markers of a foot: distances from the tip of the toes, back and up, m.
PLACES = {"TOE": (0.03, 0.025), "HEE": (0.25, 0.04), "ANK": (0.2, 0.09)}
TIPTOE_M = 0.08  # height of the body on tiptoe above standing


@dataclass(frozen=True)
class Kind:
    """A kind of files: contacts give for `soft_s`; where a trial begins and ends."""

    trials: bool = True
    soft_s: float = 0.002
    begins: str = "on the box"
    ends_s: float = 1.5
    gaps: bool = True


KINDS = {
    "box": Kind(),
    "box, hard": Kind(soft_s=0.0),
    "box, soft 5 ms": Kind(soft_s=0.005),
    "box, soft 8 ms": Kind(soft_s=0.008),
    "box, begins in the air": Kind(begins="in the air"),
    "box, begins in the air, soft 8 ms": Kind(begins="in the air", soft_s=0.008),
    "box, ends in the landing": Kind(ends_s=0.15),
    "box, no gaps": Kind(gaps=False),
    "series": Kind(trials=False),
    "series, soft 8 ms": Kind(trials=False, soft_s=0.008),
}


class Path1D:
    """A height made of consecutive parts, each a function of time."""

    def __init__(self) -> None:
        """Start without parts."""
        self.begins: list[float] = []
        self.parts: list[Any] = []

    def add(self, begin: float, part: Any) -> None:
        """Append a part that begins at an instant, s."""
        self.begins.append(begin)
        self.parts.append(part)

    def __call__(self, t: FloatArray) -> FloatArray:
        """Return the heights, m, at the times (n,), s."""
        which = np.clip(np.searchsorted(self.begins, t, side="right") - 1, 0, None)
        out = np.empty(len(t))
        for k, part in enumerate(self.parts):
            out[which == k] = part(t[which == k])
        return out


def between(t0: float, start: list[float], t1: float, end: list[float]) -> Any:
    """Return the quintic between two instants with given (height, velocity, acceleration)."""
    return BPoly.from_derivatives([t0, t1], [start, end])


def fall(t0: float, height: float, speed: float) -> Any:
    return lambda t: height + speed * (t - t0) - 0.5 * G * (t - t0) ** 2


@dataclass
class Foot:
    """Flights of one side: (leaves, from height, toes touch, heel touches, pitch, own motion)."""

    flights: list[tuple[float, float, float, float, float, FloatArray]]


def make(
    kind: Kind, jumps: int, rng: np.random.Generator, rate: float, noise: float
) -> Any:
    """Return positions (N, M, 3), m, z up, and true contacts {marker: (jumps,)}, s."""
    body, t, feet = Path1D(), 0.0, (Foot([]), Foot([]))
    drop = rng.uniform(0.3, 0.45) if kind.trials else 0.0
    body.add(-FAR, lambda t: np.full(len(t), drop))
    t += rng.uniform(1.0, 2.0)
    apexes: list[float] = []
    for jump in range(jumps):
        level = drop if jump == 0 else 0.0
        if level:  # steps off and falls freely
            body.add(t, fall(t, level, 0.0))
            leave, speed, top = t, 0.0, level
        else:
            depth, sink, push = (
                rng.uniform(0.2, 0.3),
                rng.uniform(0.35, 0.5),
                rng.uniform(0.2, 0.3),
            )
            speed, top = 0.5 * G * rng.uniform(0.38, 0.55), TIPTOE_M
            if jump and kind.trials:  # rebounds from the end of the landing
                sink = 0.0
            else:
                body.add(t, between(t, [0, 0, 0], t + sink, [-depth, 0, 12.0]))
                last = [-depth, 0, 12.0]
            leave = t + sink + push
            body.add(t + sink, between(t + sink, last, leave, [top, speed, -G]))
            body.add(leave, fall(leave, top, speed))
        apexes.append(leave + speed / G)
        # The body lands on tiptoe, slightly lower than at take-off.
        lower = TIPTOE_M - rng.uniform(0.0, 0.03)
        touch = leave + (speed + np.sqrt(speed**2 + 2 * G * (top - lower))) / G
        landing_speed = speed - G * (touch - leave)
        late = rng.uniform(0, 0.025) * rng.choice([-1, 1])
        contacts = touch + max(late, 0.0), touch + max(-late, 0.0)
        sink = rng.uniform(0.14, 0.25)
        # The leg absorbs the speed over a depth that follows from its braking.
        depth = lower + 0.45 * landing_speed * sink
        last = [depth, 0, rng.uniform(5, 15)]
        nadir = touch + sink
        body.add(touch, between(touch, [lower, landing_speed, -G], nadir, last))
        for foot, contact in zip(feet, contacts, strict=True):
            leaves = leave - rng.uniform(0, 0.03)
            heel = contact + rng.uniform(0.03, 0.08)
            pitch = (heel - contact) * rng.uniform(4.0, 7.0)
            wobble = np.array([rng.normal(0, 0.1), rng.normal(0, 2.0)])
            foot.flights.append((leaves, level, contact, heel, pitch, wobble))
        t = nadir
        if not (kind.trials and jump == 0 and jumps > 1):
            rise = rng.uniform(0.5, 0.9)
            body.add(t, between(t, last, t + rise, [0, 0, 0]))
            body.add(t + rise, lambda t: np.zeros(len(t)))
            t += rise + (kind.ends_s if jump == jumps - 1 else rng.uniform(1.0, 3.0))
    first = apexes[0] + rng.uniform(0.02, 0.06) if kind.begins == "in the air" else 0.0
    last_s = feet[0].flights[-1][2] + kind.ends_s if kind.ends_s < 0.5 else t
    time = np.arange(np.ceil(first * rate + rng.random()) / rate, last_s, 1 / rate)
    positions = np.empty((len(time), len(NAMES), 3))
    sway = np.cumsum(rng.normal(0, 1, (len(time), 2)), axis=0)
    sway = 0.01 * sway / max(np.abs(sway).max(), 1e-9)
    smooth = np.exp(-0.5 * np.linspace(-3, 3, max(int(0.4 * rate), 3)) ** 2)
    sway = np.apply_along_axis(np.convolve, 0, sway, smooth / smooth.sum(), mode="same")
    height, forward = body(time), np.zeros(len(time))
    if kind.trials:
        leave = feet[0].flights[0][0]
        forward = 0.45 * np.clip((time - leave) / (feet[0].flights[0][2] - leave), 0, 1)
    lean = 0.15 * np.minimum(height, 0)  # the trunk bends forward as the body sinks
    for m, place in enumerate(PELVIS_AT):
        turned = place[2] + place[0] * np.sin(lean)
        positions[:, m] = np.column_stack(
            [place[0] + forward, place[1] + 0 * time, turned + height]
        )
        positions[:, m, :2] += sway
    positions[:, 4] = np.column_stack([forward - lean, 0 * time, 1.45 + 1.02 * height])
    positions[:, 4, :2] += 1.4 * sway
    truth: dict[str, list[float]] = {}
    for side, foot in enumerate(feet):
        tip, pitch = _tip(foot, body, time, drop, kind.soft_s)
        for k, (name, (back, up)) in enumerate(PLACES.items()):
            m = NAMES.index("LR"[side] + name)
            positions[:, m, 0] = (
                0.16 - back * np.cos(pitch) - up * np.sin(pitch) + forward
            )
            positions[:, m, 1] = (0.12 + 0.01 * k) * (1 - 2 * side)
            positions[:, m, 2] = tip + back * np.sin(pitch) + up * np.cos(pitch)
        truth["LR"[side] + "TOE"] = [flight[2] for flight in foot.flights]
        truth["LR"[side] + "HEE"] = [flight[3] for flight in foot.flights]
    positions += rng.normal(0, noise, positions.shape)
    if kind.gaps:
        _hide(positions, time, truth, rng)
    return positions, {name: np.array(at) - time[0] for name, at in truth.items()}


def _tip(
    foot: Foot, body: Path1D, time: FloatArray, drop: float, soft_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return the height of the tip of the toes, m, and the pitch of the foot (heel up), rad."""
    tip, pitch = np.where(time < foot.flights[0][0], drop, 0.0), np.zeros(len(time))
    for leaves, level, contact, heel, angle, wobble in foot.flights:
        own = np.array([leaves, contact])
        ends = body(own)
        fly = (time >= leaves) & (time < contact)
        share = (time[fly] - leaves) / (contact - leaves)
        follow = body(time[fly]) - ends[0] - (ends[1] - ends[0]) * share
        s = time[fly] - contact
        own_way = (wobble[0] * s + 0.5 * wobble[1] * s**2) * (
            1 - np.clip(-s / 0.2, 0, 1) ** 2
        ) ** 2
        tip[fly] = np.maximum(level * (1 - share) + follow + own_way, 0.0)
        # Speed just before the contact, which a soft contact absorbs.
        step = 1e-5
        around = body(contact - step * np.array([2.0, 1.0]))
        speed = (around[1] - around[0]) / step - (ends[1] - ends[0] + level) / (
            contact - leaves
        )
        speed += wobble[0]
        after = time >= contact
        s = time[after] - contact
        if soft_s:
            back = np.clip((0.25 - s) / 0.1, 0, 1)
            tip[after] += speed * soft_s * (1 - np.exp(-s / soft_s)) * back
        # The pitch rises in the push-off, changes to its landing value in flight, and
        # ends at the heel's contact.
        push = (
            (time >= leaves - 0.12) & (time < leaves)
            if not level
            else np.zeros(len(time), bool)
        )
        pitch[push] = 0.6 * np.clip((time[push] - leaves + 0.12) / 0.12, 0, 1) ** 2
        begin = 0.0 if level else 0.6
        bend = 3 * share**2 - 2 * share**3
        pitch[fly] = begin + (angle - begin) * bend
        roll = (time >= contact) & (time < heel)
        part = (time[roll] - contact) / (heel - contact)
        pitch[roll] = angle * (1 - 0.3 * part - 0.7 * part**2)
        if soft_s:  # the heel sinks in like the toes
            rest = time >= heel
            rate = -angle * 1.7 / (heel - contact)
            s = time[rest] - heel
            back = np.clip((0.25 - s) / 0.1, 0, 1)
            pitch[rest] += rate * soft_s * (1 - np.exp(-s / soft_s)) * back
        pitch[time >= heel + 0.25] = 0.0
    return tip, pitch


def _hide(
    positions: FloatArray,
    time: FloatArray,
    truth: dict[str, list[float]],
    rng: np.random.Generator,
) -> None:
    """Hide a foot's marker at one contact in twenty, and a marker of the pelvis now and then."""
    for name, contacts in truth.items():
        for contact in contacts:
            if rng.random() < 1 / 20:
                first = int(np.searchsorted(time, contact)) + int(rng.integers(-6, 3))
                positions[
                    max(first, 0) : first + int(rng.integers(1, 5)), NAMES.index(name)
                ] = np.nan
    for _ in range(int(rng.poisson(len(time) / 2000 + 0.3))):
        first = int(rng.integers(0, len(time)))
        positions[first : first + int(rng.integers(3, 12)), int(rng.integers(0, 4))] = (
            np.nan
        )


def write(
    folder: Path, kind: Kind, seed: int, number: int
) -> tuple[list[Path], list[Any]]:
    """Write the files of one study, and return them with the truth of each."""
    rng = np.random.default_rng(np.random.SeedSequence([20261125, seed, number]))
    rate = (100.0, 120.0, 200.0, 250.0)[seed % 4]
    noise, style = rng.uniform(3e-4, 1e-3), seed % 3
    files, truths = [], []
    for trial in range(11 if kind.trials else 2):
        seen, truth = make(kind, 2 if kind.trials else 11, rng, rate, noise)
        file = folder / f"trial{trial + 1:02d}.{('tsv', 'trc', 'trc')[style]}"
        if style == 0:
            text = qtm_text(
                1e3 * seen, names=NAMES, frequency=f"{rate:g}", counters=False
            )
            text = "\n".join(
                "\t".join("" if field == "nan" else field for field in line.split("\t"))
                for line in text.split("\r\n")
            )
        elif style == 1:
            text = trc_text(1e3 * seen[..., [1, 2, 0]], NAMES, rate_hz=rate)  # y up
        else:
            text = trc_text(seen, NAMES, rate_hz=rate, unit="m")
        file.write_text(text, encoding="utf-8")
        files.append(file)
        truths.append(truth)
    return files, truths


def said(*arguments: str) -> tuple[int, str]:
    """Run a command of hopdata in this process; return its exit code and its output."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        code = hopdata(list(arguments))
    return code, out.getvalue()


def table_of(config: str, run: bool) -> pd.DataFrame:
    """Return the touchdowns of a study."""
    if run:
        said("run", config, "--cores", "1")
        name = yaml.safe_load(Path(config).read_text())["study"]
        return pd.read_csv(
            f"results/{name}/tables/touchdowns.csv", keep_default_na=True
        )
    return Study(load_config(config)).mode_schedules().schedules


def compare(
    table: pd.DataFrame, truths: list[Any], feet: dict[str, list[str]]
) -> dict[str, Any]:
    """Count what was found; feet are given by name, each with its markers."""
    rows = {"used": 0, "found": 0, "sure": 0, "right": 0, "likely_right": 0}
    errors: list[float] = []
    reasons: Counter[str] = Counter()
    for number, truth in enumerate(truths):
        own = table[table["recording"] == f"trial{number + 1:02d}"]
        true = np.array(
            [np.min([truth[m] for m in markers], axis=0) for markers in feet.values()]
        )
        near = own[[f"contact_{foot}_s" for foot in feet]].to_numpy(float)
        se, common = (
            own[[f"{what}_{foot}_s" for foot in feet]].to_numpy(float)
            for what in ("se", "common")
        )
        for landing in true.T:
            away = np.abs(near - landing).max(axis=1)
            hit = np.flatnonzero(away < SAME_S)
            if not len(hit):
                spans = own[["t_pre_s", "t_post_s"]].to_numpy(float)
                here = (spans[:, 0] < landing.max() + 0.1) & ~(
                    spans[:, 1] < landing.min() - 0.1
                )
                why = own.loc[here, "reason"]
                reasons[str(why.iloc[0]) if len(why) else "no descent"] += 1
                continue
            row = own.iloc[hit[0]]
            rows["found"] += 1
            rows["used"] += not row["excluded"]
            if row["excluded"]:
                reasons[f"({row['reason']})"] += 1
            stated = np.hypot(se[hit[0]], common[hit[0]])
            errors += ((near[hit[0]] - landing) / stated).tolist()
            right = (np.argsort(near[hit[0]]) == np.argsort(landing)).all()
            rows["likely_right"] += right
            rows["sure"] += row["order_class"] != "ambiguous"
            rows["right"] += right and row["order_class"] != "ambiguous"
    z = np.array(errors)
    return rows | {
        "ambiguous": 1 - rows["sure"] / max(rows["found"], 1),
        "error_over_stated": float(np.sqrt(np.mean(z**2))) if len(z) else np.nan,
        "phantoms": int((table["reason"] != "no foot of the study landed").sum())
        - LANDINGS,
        "reasons": "; ".join(f"{k}: {v}" for k, v in reasons.most_common()),
    }


def measure(name: str, seed: int, *, run: bool, check: bool) -> list[dict[str, Any]]:
    """Return the rows of one kind and seed: feet as init has them, and sides."""
    kind, rows = KINDS[name], []
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            files, truths = write(Path(folder), kind, seed, list(KINDS).index(name))
            code, told = said("init", files[0].name, "-o", "config.yaml")
            config = yaml.safe_load(Path("config.yaml").read_text())
            guessed = config["markers"]["feet"] or []
            right = {"LTOE", "LHEE", "RTOE", "RHEE"} == {*guessed}
            body = ", ".join(config["markers"]["body"] or [])
            init = f"{code}: {config.get('feet', guessed)}; body {body}"
            init += "" if code == 0 else f" {told.strip().splitlines()[-1]}"
            config["recordings"] = [{"name": f.stem, "file": f.name} for f in files]
            if not right:
                config["markers"]["feet"] = ["LTOE", "LHEE", "RTOE", "RHEE"]
                config["markers"]["body"] = list(PELVIS)
                config.pop("feet", None)
            joined = {one["name"]: one["markers"] for one in config.get("feet", ())}
            names = feet_of(
                {"feet": config.get("feet", []), "markers": config["markers"]}
            )
            feet = {name: joined.get(name, [name]) for name in names}
            sides = {"left": ["LTOE", "LHEE"], "right": ["RTOE", "RHEE"]}
            for label in ("init", "sides")[: 2 - (feet == sides)]:
                if label == "sides":
                    feet = sides
                    config["feet"] = [
                        {"name": k, "markers": v} for k, v in feet.items()
                    ]
                    order = [m for k in feet for m in feet[k]]
                    config["markers"]["feet"] = order
                Path("config.yaml").write_text(yaml.safe_dump(config))
                code, told = (
                    said("check", "config.yaml")
                    if check and label == "init"
                    else (-1, "")
                )
                row = {
                    "kind": name,
                    "feet": label,
                    "seed": seed,
                    "init": init * (label == "init"),
                }
                try:
                    row |= compare(table_of("config.yaml", run), truths, feet)
                except Exception as error:  # reported in the table
                    row |= {"reasons": f"{type(error).__name__}: {error}"}
                last = [
                    x
                    for x in told.splitlines()
                    if "error" in x or "will be used" in x or "sound" in x
                ]
                rows.append(
                    row
                    | {"check": f"{code} {' | '.join(last)}"[:300] if code >= 0 else ""}
                )
        finally:
            os.chdir(before)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4])
    parser.add_argument("--only", nargs="*", help="names of kinds")
    parser.add_argument("--no-check", action="store_true")
    parser.add_argument("--run", action="store_true", help="run the whole workflow")
    arguments = parser.parse_args()
    rows = []
    for name in arguments.only or KINDS:
        for seed in arguments.seeds:
            found = measure(name, seed, run=arguments.run, check=not arguments.no_check)
            rows += found
            for row in found:
                print(
                    {
                        k: round(v, 2) if isinstance(v, float) else v
                        for k, v in row.items()
                    },
                    flush=True,
                )
    table = pd.DataFrame(rows)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(arguments.out, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
