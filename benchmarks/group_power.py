"""Size and power of what a group of subjects says, over groups drawn from simulated studies.

    python benchmarks/group_power.py --out group_power.csv [--studies 24] [--landings 400]

Whole small studies are simulated, seen and judged as in ``verdict_power.py``, each of another seed.
A group draws its subjects from those of one kind with replacement; `mixed` takes half of them from
C1 and half from the first control. `true_rms` is the rms of the subjects' exact differences,
`shown_rms` what their studies show of it on average. What is simulated is kept in
``group_studies/`` beside the table.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace
from pathlib import Path

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from verdict_power import gait, kinds, observed

from hopdata.jobs import whole_file, write_table
from hopdata.maps.verdict import judge
from hopdata.maps.verdict.group import judge_group

FIRST_SEED, GROUPS = 6000, 40
KINDS = ("C1", "kappa 0.1")
SUBJECTS = (4, 8, 16)


def study(name: str, landings: int, seed: int, folder: Path) -> dict[str, float | str]:
    """Return the verdict on one small study as a row."""
    kind, file = replace(kinds()[name], hops=landings), folder / f"{name}_{landings}_{seed}.npz"
    if not file.exists():
        rng = np.random.default_rng([seed, *name.encode()])
        with whole_file(file) as part, part.open("wb") as stream:
            np.savez(stream, **observed(kind, gait(kind, folder), rng))
    seen = np.load(file)
    answer = judge(seen["before"], seen["after"], seen["instants"], seed=seed, flips=999)
    assert answer.effect is not None, answer.sentence
    return {"kind": name, "true": float(seen["true_effect"]), **asdict(answer.effect)}


def groups(studies: pd.DataFrame) -> pd.DataFrame:
    """Return one row a kind and number of subjects."""
    by_kind = dict(list(studies.groupby("kind", sort=False)))
    rng, rows = np.random.default_rng(FIRST_SEED), []
    for name in [*KINDS, "mixed"]:
        parts = [by_kind[one] for one in (KINDS if name == "mixed" else [name])]
        pool = pd.concat(parts)
        true, shown = (
            float(np.sqrt(max(0.0, x)))
            for x in ((pool["true"] ** 2).mean(), pool["squared"].mean())
        )
        for subjects in SUBJECTS:
            found = []
            for number in range(GROUPS):
                drawn = pd.concat(
                    part.iloc[rng.integers(0, len(part), subjects // len(parts))] for part in parts
                )
                drawn = drawn.assign(subject=[f"s{one}" for one in range(len(drawn))])
                found.append(judge_group(drawn, seed=number))
            rows.append(
                {
                    "kind": name,
                    "subjects": subjects,
                    "groups": GROUPS,
                    "studies": len(pool),
                    "true_rms": true,
                    "shown_rms": shown,
                    "found_alone": float(np.mean(pool["low"] > 0)),
                    "found_share": np.mean([one.conclusion == "different" for one in found]),
                    "none_share": np.mean([one.conclusion == "no difference" for one in found]),
                    "covers_true": np.mean([one.low <= true <= one.high for one in found]),
                    "covers_shown": np.mean([one.low <= shown <= one.high for one in found]),
                    "bound_covers": np.mean([one.upper_bound >= true for one in found]),
                    "estimate_median": np.median([one.estimate for one in found]),
                    "bound_median": np.median([one.upper_bound for one in found]),
                    "i2_median": np.median([one.combined.i2 for one in found]),
                }
            )
    return pd.DataFrame(rows)


def main() -> None:
    """Simulate what studies are missing, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--studies", type=int, default=24)
    parser.add_argument("--landings", type=int, default=400)
    options = parser.parse_args()
    folder = options.out.parent / "group_studies"
    folder.mkdir(parents=True, exist_ok=True)
    seeds = range(FIRST_SEED, FIRST_SEED + options.studies)
    rows = [study(name, options.landings, seed, folder) for name in KINDS for seed in seeds]
    write_table(options.out, groups(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()
