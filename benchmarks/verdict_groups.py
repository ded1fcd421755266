"""How often the verdict on a group errs: subjects are bodies that are not ours.

    python benchmarks/verdict_groups.py --out verdict_groups.csv [--subjects 48]
        [--first 3000] [--jobs 2]

A subject is one body (`bodies.py`), drawn from its own seed, so subjects differ in
shape, mass, legs and landings. Each kind of subject is judged with 400 and with 1,000
landings. Groups of 4, 8 and 16 are drawn from the subjects of a kind without
replacement, 40 of each; the groups of a kind share subjects. `half` has as many C1
subjects as subjects with `clutch`. `conditions` compares the C1 body of each subject
with the same body with `clutch`, within subjects.

One row for each study is appended to ``verdict_groups_studies.csv``, and a run that was
interrupted goes on with those that have no row. Seeds from 3000 on were never used for
a choice.

``verdict_groups.csv`` has one row for each kind, number of landings and size of group:
`found` and `none` are the shares called different and of no difference larger than 0.2;
`interval_holds` and `bound_holds` those that hold the rms over the group of the exact
sizes at the simultaneous contact. `heterogeneous` is the share of groups whose Q has a
p-value below 0.05. Of `conditions`, `found` are the groups in which they are said to
differ, and `p_small` those whose p-value is below 0.05.

``verdict_groups_levels.csv`` has what it costs that two rules share the level of a group:
the shares of 200 groups that are called different by the mean alone (`mean`), by both
rules as they share the level (`shared`), by each at half of it (`halves`) and with no
joint level (`separate`: the mean at 0.025, the number of studies at 0.05). `fewest` is the
number of studies that are enough, and `fewest_of_half` that with halves. `some` is the
share of groups in which a study is different on its own, `some_jump` that in which only
its jump is, and `some_jump_holds` that in which such a jump holds after Holm.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from body_seen import Seen, study
from campaigns import run
from scipy.stats import binom, t
from verdict_campaign import asked, cell, moved, source

from hopdata.maps.verdict.group import (
    GroupVerdict,
    compare_conditions,
    differ,
    joint_level,
    judge_group,
    jumps_that_hold,
)

SUBJECTS = 48
FIRST_SEED = 3000
KINDS = ("c1", "clutch")
LANDINGS = (400, 1000)
SIZES = (4, 8, 16)
GROUPS = 40
OF_GROUP = ("squared", "squared_error", "along_error", "allowed", "left")
LEVELS_TABLE = "verdict_groups_levels.csv"
LEVELS_SIZES = (4, 5, 6, 7, 8, 12, 14, 16, 20, 24)
LEVELS_GROUPS = 200
# Share of the subjects that have a kink.
WITH_KINKS = {"c1": 0.0, "third": 1.0 / 3.0, "half": 0.5, "clutch": 1.0}
LEVEL = 0.05
COLUMNS = (
    "kind",
    "seed",
    "landings",
    "true",
    "conclusion",
    "decided_by",
    "jump_p_value",
    "low",
    *OF_GROUP,
)


def studies_of(kind: str, seed: int) -> list[dict[str, Any]]:
    """Return the verdicts on one subject, a row for each number of landings."""
    one = cell(max(LANDINGS), mechanism=kind)
    body, landings, truth = moved(one.scene, seed)
    rows = []
    for number in LANDINGS:
        rng = source(seed, one.name, "errors")
        data = study(body, landings.some(slice(number)), rng, Seen())
        verdict = asked(data, seed)
        row = {"kind": kind, "seed": seed, "landings": number, "true": truth.kink}
        row["conclusion"] = verdict.conclusion
        row["decided_by"] = verdict.decided_by
        if verdict.jump is not None and verdict.decided_by == "jump":
            row["jump_p_value"] = verdict.jump.p_value
        if verdict.effect is not None:
            effect = asdict(verdict.effect)
            row |= {name: effect[name] for name in ("low", *OF_GROUP)}
        rows.append(row)
    return rows


def tables(studies: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each kind, number of landings and size of group."""
    studies = studies.sort_values(["kind", "seed"]).dropna(subset=["squared"])
    studies = studies.assign(subject=studies["seed"].map(str))
    rows = []
    for number, of_number in studies.groupby("landings"):
        rng = np.random.default_rng(FIRST_SEED)
        by_kind = dict(list(of_number.groupby("kind")))
        for kind, size in product([*by_kind, "half"], SIZES):
            kinds = [kind] if kind != "half" else ["c1", "clutch"]
            parts = [by_kind[one] for one in kinds]
            drawn = [drawn_from(parts, size, rng) for _ in range(GROUPS)]
            found = [(judge_group(group), group) for group in drawn]
            row = {"kind": kind, "landings": number, "subjects": size}
            rows.append(row | summary(found))
        for size in SIZES:
            row = {"kind": "conditions", "landings": number, "subjects": size}
            rows.append(row | compared(by_kind["c1"], by_kind["clutch"], size, rng))
    return pd.DataFrame(rows)


def drawn_from(
    parts: list[pd.DataFrame], size: int, rng: np.random.Generator
) -> pd.DataFrame:
    """Return a group with as many subjects of each part, drawn without replacement."""
    each = size // len(parts)
    some = [part.iloc[rng.permutation(len(part))[:each]] for part in parts]
    group = pd.concat(some)
    return group.assign(subject=[f"s{number}" for number in range(len(group))])


def summary(found: list[tuple[GroupVerdict, pd.DataFrame]]) -> dict[str, float]:
    """Return shares of the groups, and medians."""
    true = np.array([np.sqrt(np.mean(group["true"] ** 2)) for _, group in found])
    low = np.array([one.low for one, _ in found])
    high = np.array([one.high for one, _ in found])
    bound = np.array([one.upper_bound for one, _ in found])
    conclusions = np.array([one.conclusion for one, _ in found])
    return {
        "groups": len(found),
        "true_median": np.median(true),
        "found": np.mean(conclusions == "different"),
        "none": np.mean(conclusions == "no difference"),
        "interval_holds": np.mean((low <= true) & (true <= high)),
        "bound_holds": np.mean(bound >= true),
        "estimate_median": np.median([one.estimate for one, _ in found]),
        "bound_median": np.median(bound),
        "heterogeneous": np.mean([one.combined.q_p_value < 0.05 for one, _ in found]),
    }


def compared(
    same: pd.DataFrame, other: pd.DataFrame, size: int, rng: np.random.Generator
) -> dict[str, float]:
    """Return in which share of groups two conditions of the same subjects differ."""
    both = sorted(set(same["subject"]) & set(other["subject"]))
    found = []
    small = []
    holds = []
    for _ in range(GROUPS):
        names = [both[number] for number in rng.permutation(len(both))[:size]]
        some = [part[part["subject"].isin(names)] for part in (same, other)]
        members = pd.concat(
            [part.assign(condition=name) for name, part in zip("ab", some, strict=True)]
        )
        row = compare_conditions(members).iloc[0]
        true = np.mean(some[0]["true"] ** 2) - np.mean(some[1]["true"] ** 2)
        found.append(differ(row))
        small.append(row["p_value"] < 0.05)
        holds.append(row["low"] <= true <= row["high"])
    return {
        "groups": GROUPS,
        "found": np.mean(found),
        "interval_holds": np.mean(holds),
        "p_small": np.mean(small),
    }


def levels(studies: pd.DataFrame) -> pd.DataFrame:
    """Return which groups are called different, by how two rules share the level."""
    studies = studies.sort_values(["kind", "seed"]).dropna(subset=["squared"])
    rng = np.random.default_rng(FIRST_SEED)
    rows = []
    for number, of_number in studies.groupby("landings"):
        by_kind = dict(list(of_number.groupby("kind")))
        for size, (kind, share) in product(LEVELS_SIZES, WITH_KINKS.items()):
            kinks = round(share * size)
            parts = [(by_kind["clutch"], kinks), (by_kind["c1"], size - kinks)]
            found = []
            for _ in range(LEVELS_GROUPS):
                some = [part.iloc[rng.permutation(len(part))[:n]] for part, n in parts]
                found.append(by_each_rule(pd.concat(some)))
            row = {"landings": number, "subjects": size, "kind": kind}
            row["fewest"] = joint_level(size, 1.0 - LEVEL)[0]
            row["fewest_of_half"] = fewest_below(size, LEVEL / 2.0)
            rows.append(row | pd.DataFrame(found).mean().to_dict())
    return pd.DataFrame(rows)


def by_each_rule(group: pd.DataFrame) -> dict[str, bool]:
    """Return whether a group is different, by the ways to share the level."""
    verdict = judge_group(group)
    model = verdict.combined
    left = np.sqrt((group["left"] ** 2).mean())
    reach = t.isf(LEVEL / 2.0, model.n - 1) * model.error
    mean = bool(max(0.0, model.mean - reach) > left**2)
    return {
        "mean": mean,
        "shared": verdict.conclusion == "different",
        "halves": mean or verdict.alone >= fewest_below(len(group), LEVEL / 2.0),
        "separate": mean or verdict.alone >= fewest_below(len(group), LEVEL),
        "some": verdict.alone > 0,
        "some_jump": bool((group["decided_by"] == "jump").any()),
        "some_jump_holds": jumps_that_hold(group["jump_p_value"]) > 0,
    }


def fewest_below(number: int, level: float) -> int:
    """Return the fewest studies of so many that false alarms give less often."""
    fewest = 1
    while not binom.sf(fewest - 1, number, LEVEL) < level:
        fewest += 1
    return fewest


def main() -> None:
    """Judge the missing subjects and write the table of groups."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument(
        "--subjects", type=int, default=SUBJECTS, help="of each kind; 16 or more"
    )
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    args = parser.parse_args()
    if args.subjects < max(SIZES):
        parser.error(f"--subjects: {max(SIZES)} or more")
    file = args.out.with_name("verdict_groups_studies.csv")
    tasks = list(product(KINDS, range(args.first, args.first + args.subjects)))
    run(file, COLUMNS, studies_of, tasks, named=("kind", "seed"), jobs=args.jobs)
    table = tables(pd.read_csv(file))
    table.to_csv(args.out, index=False, float_format="%.4g")
    print(table.to_string(index=False))
    table = levels(pd.read_csv(file))
    table.to_csv(args.out.with_name(LEVELS_TABLE), index=False, float_format="%.4g")
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
