"""Size, power, coverage and stated detectable difference of the verdict, over whole studies.

    python benchmarks/verdict_power.py --out verdict_power.csv [--studies 40] [--first
    9100]
        [--only kappa] [--simulated]
    python benchmarks/verdict_power.py --out verdict_bodies.csv --only body --studies 1
    --first 9500

The landings are C1 landings of two systems, observed in many ways, and three kinds of
control. A study draws the apexes of its landings from a long gait, with its own kicks
and preloads. Its landings are integrated, observed frame by frame with noise, and
judged: all together, in groups of 500 and of 1,000, and joined with those of other
studies, five or ten at a time. Kinds that differ only in how they are observed share
the landings of a seed, so they are not independent of one another. Hoppers of other
shapes are judged only on request; each is a kind of its own, and one row holds them
all. docs/verdict.md says what was chosen on which seeds.

Simulated studies and verdicts are kept beside the table in ``verdict_studies/`` (0.7 MB
per study) and are not repeated; remove its JSON files to judge the same studies anew.
There is one row per kind and number of landings; ``verdict_studies.csv``, beside it,
has one row per verdict. `found_share` is the share of studies with a difference, with
its 95 % interval (Wilson). `interval_covers` and `bound_covers` are the shares whose
interval or one-sided bound contains the true difference, and `detectable` is the median
size that they claim to find in 80 % of studies. `jumps_share` is the share in which the
outcome is said to jump, `jump_worst` the largest estimated jump.
``verdict_promise.csv`` gives the share found of kinks of the size `detectable`, added
to C1 landings along those of a control or against them. ``group_power.csv`` is about
groups: each subject is 400 or 1,000 landings of a study, drawn with replacement from
those of one kind. `mixed` takes half of them from C1 and half from a control; `paired`
is the difference of the squares between the two as conditions, with the share in which
it is found and covered. `true_rms` is the rms of the exact differences, `shown_rms` the
average of it that their studies show.
"""

from __future__ import annotations

import argparse
import json
import os
import re
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from functools import lru_cache
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from observed_landings import (
    NO_HEIGHT_M,
    Apexes,
    apexes_of,
    see_landings,
    states_at,
    tracks_of,
    true_states,
)
from statsmodels.stats.proportion import proportion_confint
from verdict_kinds import HOPPER_SECTIONS, WHOLE, Kind, kinds

from hopdata.errors import AnalysisError
from hopdata.jobs import whole_file
from hopdata.landings.states.fits import WINDOWS_S
from hopdata.maps.coordinates import kinks
from hopdata.maps.draws import named_generator
from hopdata.maps.truth.maps import input_root, marker_motions
from hopdata.maps.verdict import judge
from hopdata.maps.verdict.comparison import (
    compared,
    contrasts,
    relative_size,
    squared_size,
)
from hopdata.maps.verdict.effect import EffectSize, effect_size
from hopdata.maps.verdict.group import GroupVerdict, compare_conditions, judge_group
from hopdata.maps.verdict.inputs import (
    LEAST_CLASS,
    Contacts,
    SectionLandings,
    contact_orders,
    section_landings,
)
from hopdata.maps.verdict.model import KinkFit, fit_kinks
from hopdata.maps.verdict.session import Session
from hopdata.scenes.scene import Control
from hopdata.synthesis.exact_maps import section_jacobians
from hopdata.synthesis.landings import (
    SectionHeights,
    TrueLandings,
    input_coordinates,
    true_landings,
)
from hopdata.synthesis.trial import run_trial

FIRST_SEED = 9100

# Hops of the gait from which apexes are drawn, and the trials that they are of.
GAIT_HOPS = 2000
TRIALS = 4

# Hops, and milliseconds of each, from which sections are found.
SECTION_HOPS = 300
SECTION_MS = 700

INSTANT_NOISE_S = 0.0006

# Landings that are judged together, beside all of a study (`WHOLE`).
FEWEST = 500
FEW = 1000
# Numbers of studies joined into larger ones, 2,000 landings each.
JOINED = (5, 10)

# Groups of each kind, the numbers of their subjects, and the landings of a subject.
GROUPS = 40
SUBJECTS = (4, 8, 16, 30)
SUBJECT_LANDINGS = 400
GROUP_KINDS = (
    *(
        "C1",
        "C1 larger kicks",
        "C1 stiffer legs",
        "C1 drifting",
        "C1 quadruped",
        "kappa 0.05",
    ),
    *("kappa 0.1", "eps 0.2", "tau 10 ms", "quadruped kappa 0.1"),
)
MIXED = ("C1", "kappa 0.1")
PROMISED = ("kappa 0.1", "eps 0.2", "tau 10 ms")
OBSERVED = ("before", "after", "instants")


def kept(file: Path, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return the arrays in a file, which is written first if it does not exist."""
    if not file.exists():
        arrays = make()
        with whole_file(file) as part, part.open("wb") as stream:
            np.savez(stream, **arrays)
    return dict(np.load(file))


def gait_file(kind: Kind, folder: Path) -> Path:
    """Return the file with the gait of a kind, which may be shared with other kinds."""
    name = f"{kind.led_by or kind.scene}{kind.kicks}"
    return folder / f"gait_{sha256(name.encode()).hexdigest()[:16]}.npz"


def gait(kind: Kind, folder: Path) -> np.ndarray:
    """Return states (L, 12) at the apexes of a long gait, before their kicks; cached in a file."""

    def trial(number: int) -> Apexes:
        return apexes_of(
            run_trial(
                kind.led_by or kind.scene, hops=GAIT_HOPS // TRIALS, rate_hz=10.0,
                kicks=kind.kicks, rng=np.random.default_rng([77, number]),
            )
        )  # fmt: skip

    def before() -> dict[str, Any]:
        return {
            "before": np.concatenate([trial(number).before for number in range(TRIALS)])
        }

    return kept(gait_file(kind, folder), before)["before"]


def sections_of(kind: Kind, folder: Path) -> SectionHeights:
    """Return the sections of a kind, or find them from its landings.

    Of the landings that start above the median apex, the upper section lies at the
    highest first contacts and the lower one at the lowest last contacts, except for 1
    in 100.
    """
    if kind.sections is not None:
        return kind.sections
    points_m = HOPPER_SECTIONS.points_m

    def found() -> dict[str, Any]:
        still = replace(kind, hops=SECTION_HOPS, control=Control())
        apexes = starts(still, gait(kind, folder), np.random.default_rng(2))
        times = 1e-3 * np.arange(-1, SECTION_MS)
        heights = tracks_of(states_at(kind.scene, Control(), apexes, times), points_m)
        heights = heights[..., 2].mean(axis=2)
        asked = SectionHeights(float(np.median(heights[:, 1])), NO_HEIGHT_M, points_m)
        contact = true_landings(
            kind.scene,
            Control(),
            apexes.after,
            apexes.preloads_n,
            asked,
            rtol=1e-6,
            workers=1,
        ).contact_s
        rows = np.flatnonzero((contact < times[-1]).all(axis=1))
        first, last = (
            heights[rows, np.searchsorted(times, one)]
            for one in (contact[rows].min(axis=1), contact[rows].max(axis=1))
        )
        return {"pre": np.quantile(first, 0.99), "post": np.quantile(last, 0.01)}

    name = gait_file(kind, folder).name.replace("gait", "sections")
    heights = kept(gait_file(kind, folder).with_name(name), found)
    return SectionHeights(float(heights["pre"]), float(heights["post"]), points_m)


def starts(kind: Kind, before: np.ndarray, rng: np.random.Generator) -> Apexes:
    """Draw the apexes of a study and kick them."""
    before = before[rng.integers(0, len(before), kind.hops)]
    kick = np.zeros_like(before)
    kick[:, 6:9] = kind.kicks.velocity_m_s * rng.standard_normal((kind.hops, 3))
    kick[:, 9:] = kind.kicks.angular_velocity_rad_s * rng.standard_normal(
        (kind.hops, 3)
    )
    uneven = kind.kicks.preload_fraction * rng.standard_normal(
        (kind.hops, kind.scene.n_legs)
    )
    return Apexes(before, before + kick, kind.scene.preload_n * (1.0 + uneven))


@lru_cache(maxsize=1)
def moved(
    name: str, seed: int, folder: Path
) -> tuple[TrueLandings, np.ndarray, np.ndarray]:
    """Return an unobserved study: whole landings, and times and states about them."""
    kind, rng = kinds()[name], np.random.default_rng([seed, *name.encode()])
    apexes = starts(kind, gait(kind, folder), rng)
    landings = true_landings(
        kind.scene, kind.control, apexes.after, apexes.preloads_n, sections_of(kind, folder),
        rtol=1e-6, workers=1,
    )  # fmt: skip
    rows = np.flatnonzero(landings.whole)
    part = some(landings, rows)
    times, motion = true_states(
        kind.scene, kind.control, apexes.some(rows), rate_hz=kind.rate_hz, rng=rng,
        until_s=float(np.nanmax(part.post_time_s)) + max(WINDOWS_S),
    )  # fmt: skip
    return part, times, motion


def some(landings: TrueLandings, rows: np.ndarray) -> TrueLandings:
    """Return the given rows of the landings."""
    return TrueLandings(*(getattr(landings, name)[rows] for name in vars(landings)))


def observed(name: str, seed: int, folder: Path) -> dict[str, Any]:
    """Simulate and observe one study: its pairs, contact instants, and true difference."""
    kind, rng = kinds()[name], np.random.default_rng([seed, 1, *name.encode()])
    part, times, motion = moved(kind.moves_as or name, seed, folder)
    if kind.thinned:
        ahead = (np.diff(part.contact_s, axis=1) > 0).all(axis=1)
        rows = np.flatnonzero(~ahead | (rng.random(len(part)) < 0.12))
        part, times, motion = some(part, rows), times[rows], motion[rows]
    spoil, sections = kind.spoil, sections_of(kind, folder)
    seen = see_landings(
        times, motion, part, sections, noise_m=kind.noise_m, rng=rng,
        instant_noise_s=INSTANT_NOISE_S,
        spoil=None if spoil is None else lambda tracks: spoil(tracks, rng, kind.rate_hz),
    )  # fmt: skip
    instants = (
        seen.instants if kind.relabel is None else kind.relabel(seen.instants, rng)
    )
    true, part = 0.0, some(part, seen.rows)
    if kind.control.active:
        root = input_root(input_coordinates(part.pre_state, sections.centre_m))
        true = true_size(name, root, part.contact_s, folder)
    return {
        "before": seen.before,
        "after": seen.after,
        "instants": instants,
        "true_effect": true,
    }


def exact_maps(name: str, folder: Path) -> dict[str, Any]:
    """Return `schedules` and `maps` of a kind's exact Jacobians, which its studies share.

    They are taken at the simultaneous contact nearest to the mean of the landings that
    count. The result is empty if the body does not sink from there to the post section.
    """
    kind = kinds()[name]

    def exact() -> dict[str, Any]:
        apexes = starts(kind, gait(kind, folder), np.random.default_rng(1))
        sections = sections_of(kind, folder)
        landings = true_landings(
            kind.scene, kind.control, apexes.after, apexes.preloads_n, sections, rtol=1e-6,
            workers=1,
        )  # fmt: skip
        whole = apexes.after[landings.whole]
        try:
            found = section_jacobians(kind.scene, kind.control, whole, sections)
        except AnalysisError as error:
            print(f"{name}: true difference not known, {error}", flush=True)
            return {"schedules": [], "maps": np.empty((0, 11, 8))}
        return {"schedules": found.schedules, "maps": found.maps}

    return kept(folder / f"exact_{name.replace(' ', '_')}.npz", exact)


def true_size(name: str, root: np.ndarray, instants: np.ndarray, folder: Path) -> float:
    """Return the relative difference of the exact Jacobians as the verdict measures it, or NaN."""
    exact, points_m = (
        exact_maps(name, folder),
        sections_of(kinds()[name], folder).points_m,
    )
    orders = np.array(
        [[int(foot) - 1 for foot in name.split(">")] for name in exact["schedules"]]
    )
    seen, counts = contact_orders(instants, LEAST_CLASS)
    often = {tuple(order): n for order, n in zip(seen.tolist(), counts, strict=True)}
    counts = np.array([often.get(tuple(order), 0) for order in orders.tolist()])
    kept = counts > 0
    if np.sum(kept) < 2:
        return np.nan
    maps = marker_motions(points_m) @ exact["maps"][kept] @ root
    return relative_size(maps, contrasts(orders[kept], counts[kept]))


def study_file(name: str, seed: int, folder: Path) -> Path:
    """Return the file of a simulated study."""
    return folder / f"{name.replace(' ', '_')}_{seed}.npz"


def simulate(name: str, seed: int, folder: Path) -> dict[str, Any]:
    """Return one study, simulating it if it is not kept yet."""
    return kept(study_file(name, seed, folder), lambda: observed(name, seed, folder))


def one_study(name: str, seed: int, folder: Path, simulated: bool) -> Path | None:
    """Return the file with the verdicts on a study; None if only simulations are wanted."""
    source = study_file(name, seed, folder)
    if simulated and not source.exists():
        return None
    file = source.with_suffix(".json")
    if file.exists():
        return file
    study, hops = simulate(name, seed, folder), kinds()[name].hops
    seen = len(study["before"])
    parts = [(n, first) for n in (FEWEST, FEW) for first in range(0, seen - n + 1, n)]
    rows = [
        judged(name, study, seed, first, asked)
        for asked, first in [*parts, *((n, 0) for n in sorted({WHOLE, hops}))]
    ]
    with whole_file(file) as part:
        part.write_text(json.dumps(rows))
    return file


def large_study(name: str, seeds: range, folder: Path) -> Path | None:
    """Return the file with the verdict on joined studies; None if one is not simulated."""
    file = folder / f"{name.replace(' ', '_')}_{seeds[0]}_to_{seeds[-1]}.json"
    sources = [study_file(name, seed, folder) for seed in seeds]
    if not file.exists():
        if not all(source.exists() for source in sources):
            return None
        parts = [np.load(source) for source in sources]
        study = {key: np.concatenate([part[key] for part in parts]) for key in OBSERVED}
        study["true_effect"] = np.mean([part["true_effect"] for part in parts])
        with whole_file(file) as part:
            row = judged(name, study, seeds[0], 0, 2 * FEW * len(seeds))
            part.write_text(json.dumps([row]))
    return file


def judged(name: str, study: Any, seed: int, first: int, asked: int) -> dict[str, Any]:
    """Return the verdict on some landings of a study as one row."""
    parts = (study[part][first : first + asked] for part in OBSERVED)
    answer = judge(*parts, seed=seed + first, flips=999)
    row: dict[str, Any] = {
        "condition": name,
        "strength": kinds()[name].strength,
        "seed": seed,
    }
    row |= {
        "asked": asked,
        "landings": answer.n_landings,
        "conclusion": answer.conclusion,
    }
    row["true_effect"] = float(study["true_effect"])
    if answer.jump:
        row |= {"jump": answer.jump.estimate, "jump_low": answer.jump.low}
    return row | (asdict(answer.effect) if answer.effect else {})


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per kind (one for all bodies) and number of landings, of answered studies."""
    rows = []
    names = table["condition"].str.replace(r"body \d+", "other bodies", regex=True)
    table = table.assign(condition=names).dropna(subset=["low"])
    for (name, asked), part in table.groupby(["condition", "asked"], sort=False):
        found = int(np.sum(part["low"] > 0))
        low, high = proportion_confint(found, len(part), method="wilson")
        known = part.dropna(subset=["true_effect"])
        true = known["true_effect"]
        covered = (known["low"] <= true) & (true <= known["high"])
        rows.append(
            {
                "condition": name,
                "strength": part["strength"].iloc[0],
                "asked": asked,
                "studies": len(part),
                "landings": part["landings"].mean(),
                "true_effect": true.mean(),
                "found_share": found / len(part),
                "found_low": low,
                "found_high": high,
                "effect_mean": part["estimate"].mean(),
                "effect_sd": part["estimate"].std(),
                "interval_covers": covered.mean(),
                "bound_covers": np.mean(known["upper_bound"] >= true),
                "low_median": part["low"].median(),
                "high_median": part["high"].median(),
                "upper_bound_median": part["upper_bound"].median(),
                "upper_bound_worst": part["upper_bound"].max(),
                "detectable": part["detectable"].median(),
                "jumps_share": np.mean(part["jump_low"] > 0),
                "jump_worst": part["jump"].max(),
                "no_difference_share": np.mean(part["conclusion"] == "no difference"),
            }
        )
    return pd.DataFrame(rows)


def promise(seeds: range, folder: Path) -> pd.DataFrame:
    """Return one row per control, number of landings and sign: the share found of what is promised.

    Kinks as shown by all studies of a control together, scaled to `detectable`, are
    added to C1 landings: in the control's direction (`sign` 1) and opposite to it (-1).
    """
    found = []
    for name in PROMISED:
        parts = [simulate(name, seed, folder) for seed in seeds]
        joined = (np.concatenate([one[key] for one in parts]) for key in OBSERVED)
        fit = fit_kinks(at_sections(*joined))
        shown = fit.seen @ fit.coefficients
        for seed, asked in product(seeds, (FEWEST, FEW, WHOLE)):
            study = simulate("C1", seed, folder)
            for first in range(0, max(1, len(study["before"]) - asked + 1), asked):
                landings = at_sections(
                    *(study[k][first : first + asked] for k in OBSERVED)
                )
                fit, root, effect = judged_kinks(landings, seed + first)
                ratio = effect.detectable / np.linalg.norm(
                    root @ (fit.seen.T @ shown).ravel()
                )
                added = ratio * kinks(landings.expected) @ shown
                for sign in (1, -1):
                    outputs = landings.outputs + sign * (added - added.mean(axis=0))
                    more = judged_kinks(
                        replace(landings, outputs=outputs), seed + first
                    )[2]
                    found.append(
                        {
                            "control": name,
                            "asked": asked,
                            "sign": sign,
                            "found": more.low > 0,
                        }
                        | {"detectable": effect.detectable, "shown": more.estimate}
                    )
    rows = pd.DataFrame(found).groupby(["control", "asked", "sign"], sort=False)
    return rows.agg(
        studies=("found", "size"), detectable=("detectable", "median"), shown=("shown", "mean"),
        found_share=("found", "mean"),
    ).reset_index()  # fmt: skip


def at_sections(
    before: np.ndarray, after: np.ndarray, instants: np.ndarray
) -> SectionLandings:
    """Return landings of a steady session in the coordinates of the verdict."""
    n = len(instants)
    steady = Session.of(np.arange(n, dtype=float), np.zeros(n, dtype=np.int64))
    return section_landings(before, after, Contacts(instants), steady)


def judged_kinks(
    landings: SectionLandings, seed: int
) -> tuple[KinkFit, np.ndarray, EffectSize]:
    """Return the kinks, the root of their squared size, and the effect size that follows."""
    fit = fit_kinks(landings)
    root = squared_size(fit, landings, compared(landings))
    rng = named_generator(seed, "verdict", "signs")
    return (
        fit,
        root,
        effect_size(fit, root, generator=rng, confidence=0.95, power=0.8, flips=999),
    )


def subjects(name: str, seed: int, folder: Path) -> list[dict[str, Any]]:
    """Return the verdicts on the smaller subjects contained in a study."""
    study = simulate(name, seed, folder)
    firsts = range(0, 2 * FEW, SUBJECT_LANDINGS)
    return [judged(name, study, seed, first, SUBJECT_LANDINGS) for first in firsts]


def groups(studies: pd.DataFrame) -> pd.DataFrame:
    """Return one row per kind, number of landings and number of subjects."""
    rng, rows = np.random.default_rng(FIRST_SEED), []
    for asked, of_size in studies.groupby("asked"):
        by_kind = dict(list(of_size.groupby("condition", sort=False)))
        for name, count in product([*by_kind, "mixed", "paired"], SUBJECTS):
            parts = [
                by_kind[one]
                for one in (MIXED if name in ("mixed", "paired") else [name])
            ]
            pool = pd.concat(parts)
            true = (pool["true_effect"] ** 2).mean()
            row = {
                "kind": name,
                "landings": asked,
                "subjects": count,
                "studies": len(pool),
            }
            row |= {"groups": GROUPS, "found_alone": float(np.mean(pool["low"] > 0))}
            if name == "paired":
                rows.append(row | _paired(parts, count, rng))
                continue
            found = [
                judge_group(_drawn(parts, count // len(parts), rng))
                for _ in range(GROUPS)
            ]
            rows.append(row | _summed(found, np.sqrt(true), pool["squared"].mean()))
    return pd.DataFrame(rows)


def _drawn(
    parts: list[pd.DataFrame], each: int, rng: np.random.Generator
) -> pd.DataFrame:
    drawn = pd.concat(part.iloc[rng.integers(0, len(part), each)] for part in parts)
    return drawn.assign(subject=[f"s{one}" for one in range(len(drawn))])


def _summed(found: list[GroupVerdict], true: float, shown: float) -> dict[str, float]:
    return {
        "true_rms": true,
        "shown_rms": float(np.sqrt(max(0.0, shown))),
        "found_share": np.mean([one.conclusion == "different" for one in found]),
        "none_share": np.mean([one.conclusion == "no difference" for one in found]),
        "covers_true": np.mean([one.low <= true <= one.high for one in found]),
        "bound_covers": np.mean([one.upper_bound >= true for one in found]),
        "estimate_median": np.median([one.estimate for one in found]),
        "low_median": np.median([one.low for one in found]),
        "high_median": np.median([one.high for one in found]),
        "bound_median": np.median([one.upper_bound for one in found]),
        "i2_median": np.median([one.combined.i2 for one in found]),
    }


def _paired(
    parts: list[pd.DataFrame], subjects: int, rng: np.random.Generator
) -> dict[str, float]:
    true = np.subtract(*((part["true_effect"] ** 2).mean() for part in parts))
    tables = []
    for _ in range(GROUPS):
        both = [_drawn([part], subjects, rng) for part in parts]
        tables.append(compare_conditions(pd.concat(both)).iloc[0])
    table = pd.DataFrame(tables)
    return {
        "true_rms": np.sqrt(abs(true)),
        "found_share": np.mean(table["p_value"] < 0.05),
        "covers_true": np.mean((table["low"] <= true) & (true <= table["high"])),
        "estimate_median": np.sqrt(table["difference"].abs().median()),
    }


def main() -> None:
    """Run the missing studies and write the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--studies", type=int, default=40, help="studies of each kind")
    parser.add_argument(
        "--first", type=int, default=FIRST_SEED, help="seed of the first study"
    )
    parser.add_argument(
        "--only",
        default=r"^(?!.*body)",
        help="kinds whose name matches this expression",
    )
    parser.add_argument(
        "--simulated", action="store_true", help="judge only existing simulations"
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    args = parser.parse_args()
    folder = args.out.parent / "verdict_studies"
    folder.mkdir(parents=True, exist_ok=True)
    names = [name for name in kinds() if re.search(args.only, name)]
    seeds = range(args.first, args.first + args.studies)
    tasks = [
        (name, seed, folder, args.simulated) for seed, name in product(seeds, names)
    ]
    with ProcessPoolExecutor(args.workers) as pool:
        if not args.simulated:
            gaits = {
                gait_file(kind, folder): kind
                for name, kind in kinds().items()
                if name in names
            }
            list(pool.map(gait, gaits.values(), [folder] * len(gaits)))
            controlled = [name for name in names if kinds()[name].control.active]
            list(pool.map(exact_maps, controlled, [folder] * len(controlled)))
        files = [*pool.map(one_study, *zip(*tasks, strict=True), chunksize=len(names))]
        together = [
            (name, seeds[first : first + count], folder)
            for count, name in product(JOINED, names)
            for first in range(0, len(seeds) - count + 1, count)
        ]
        files += pool.map(large_study, *zip(*together, strict=True)) if together else []
        rows = [row for file in files if file for row in json.loads(file.read_text())]
        if set(GROUP_KINDS) <= set(names) and not args.simulated:
            drawn = [(name, seed, folder) for name in GROUP_KINDS for seed in seeds]
            small = pool.map(subjects, *zip(*drawn, strict=True))
            larger = [
                r for r in rows if r["asked"] == FEW and r["condition"] in GROUP_KINDS
            ]
            found = groups(
                pd.DataFrame([*larger, *(row for study in small for row in study)])
            )
            found.to_csv(
                args.out.with_name("group_power.csv"), index=False, float_format="%.4g"
            )
    table = pd.DataFrame(rows)
    order = {name: number for number, name in enumerate(names)}
    table = table.sort_values(
        ["condition", "asked"],
        key=lambda c: c.map(lambda v: order.get(v, v)),
        ignore_index=True,
    )
    beside = args.out.with_name
    table.to_csv(beside("verdict_studies.csv"), index=False, float_format="%.6g")
    if {"C1", *PROMISED} <= set(names):
        promised = promise(seeds, folder)
        promised.to_csv(beside("verdict_promise.csv"), index=False, float_format="%.4g")
    summary(table).to_csv(args.out, index=False, float_format="%.6g")
    print(summary(table).to_string(index=False))


if __name__ == "__main__":
    main()
