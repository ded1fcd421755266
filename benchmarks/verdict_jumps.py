"""Whether a verdict tells a jump of the outcome from what only resembles one.

    python benchmarks/verdict_jumps.py --out verdict_jumps.csv [--studies 5]
        [--first 6000] [--jobs 2]

A body lands on three to five feet with a tilt and velocities that set its contact
instants, 10 ms apart. Its outcomes are a quadratic function of its state, and what the
kind of study adds for each pair of feet, as a function of the delay from the one contact
to the other, in spreads of the contacts:

    nothing        a C1 map
    kink           the delay where it is positive: a difference that lasts
    fading W       a kink that is spent after W spreads
    bend W         a smooth step of the width W: a C1 map, sharp where W is small
    jump           a step, for one pair of feet
    jump, kink     and jump, fading W: a step for one pair, beside what all pairs have

One row for each study is appended to ``verdict_jumps_studies.csv``, and a run that was
interrupted goes on with those that have no row.

``verdict_jumps.csv`` has one row for each kind and number of feet, of `LANDINGS`
landings. `named` is the number of studies whose jump is named (its `low` is above
zero), `or_bend` that of the named whose note says that a sharp bend would look the
same, and `unsure` that of those whose jump is not named for such a bend. Of the named,
`holds` counts intervals that hold the true size, and `ratio_median` and
`ratio_largest` are estimates over true sizes. `saturates` counts studies whose
difference is said to fade. Seeds below 6000 were used to choose.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from campaigns import read_options, run, write_table
from fading import CONTACT_SPREAD_S, FALLING, MARKERS_M, SPREADS

from hopdata.maps.truth.maps import marker_motions, marker_states
from hopdata.maps.verdict import judge
from hopdata.maps.verdict.inputs import halves

LANDINGS = 600
STUDIES = 5
FIRST_SEED = 6000
FEET_M = np.array(
    [[0.22, 0.03], [0.08, 0.21], [-0.17, 0.14], [-0.19, -0.11], [0.05, -0.22]]
)
# Three feet of these five would stand in a row; they have places of their own.
THREE_FEET_M = np.array([[0.22, 0.03], [-0.10, 0.19], [-0.12, -0.17]])
# Standard deviations of what the map makes of the state: place and angles, velocity, spin.
OUTCOMES = np.repeat([0.01, 0.05, 0.2], [5, 3, 3])
CURVATURE = 0.03
NOISE = 0.06
CONTACT_ERROR_S = 0.0003
JUMPING_PAIR = (0, 2)


@dataclass(frozen=True)
class Kind:
    """What the outcome has for a delay, in shares of `OUTCOMES`.

    `kink` is the slope by a spread of delay, spent after `fades_over` spreads; `bend`
    the half height of a smooth step of the width `bend_width`; `jump` the step of one
    pair.
    """

    kink: float = 0.0
    fades_over: float = np.inf
    bend: float = 0.0
    bend_width: float = 1.0
    jump: float = 0.0


KINDS = {
    "nothing": Kind(),
    "kink": Kind(kink=1.0),
    "fading 0.3": Kind(kink=2.0, fades_over=0.3),
    "fading 1": Kind(kink=2.0, fades_over=1.0),
    "bend 0.1": Kind(bend=0.5, bend_width=0.1),
    "bend 0.3": Kind(bend=0.5, bend_width=0.3),
    "bend 1": Kind(bend=0.5, bend_width=1.0),
    "jump": Kind(jump=1.0),
    "jump, kink": Kind(jump=1.0, kink=1.0),
    "jump, fading 0.5": Kind(jump=1.0, kink=2.0, fades_over=0.5),
}
FEET = (3, 4, 5)
COLUMNS = (
    "kind",
    "feet",
    "seed",
    "conclusion",
    "named",
    "or_bend",
    "unsure",
    "saturates",
    "true",
    "low",
    "estimate",
    "high",
)


@dataclass(frozen=True)
class Study:
    """Landings as `judge` takes them, and the true size of their jump."""

    before: np.ndarray
    after: np.ndarray
    instants: np.ndarray
    jump: float


def feet_m(feet: int) -> np.ndarray:
    """Return the places (feet, 2) of the feet in the body, m."""
    if feet == len(THREE_FEET_M):
        return THREE_FEET_M
    return FEET_M[:feet]


def contacts_of(state: np.ndarray, feet: int, rng: np.random.Generator) -> np.ndarray:
    """Return the contact instants (n, feet), in spreads."""
    places = feet_m(feet)
    slopes = np.zeros((8, feet))
    slopes[0], slopes[1] = places.T
    slopes[5], slopes[6] = 0.3 * places[:, 1], -0.3 * places[:, 0]
    slopes[2:5] = 0.02 * rng.standard_normal((3, 1))
    between = slopes - slopes.mean(axis=1, keepdims=True)
    slopes /= np.sqrt(np.mean(np.sum(between**2, axis=0)))
    bends = CURVATURE * rng.standard_normal((8, feet))
    return state @ slopes + (state**2 - 1.0) @ bends


def landings(kind: Kind, feet: int, seed: int) -> Study:
    """Return the landings of one study."""
    rng = np.random.default_rng(seed)
    state = rng.standard_normal((LANDINGS, 8))
    instants = contacts_of(state, feet, rng)
    linear = rng.standard_normal((8, 11)) * OUTCOMES
    squares = CURVATURE * rng.standard_normal((8, 8, 11)) * OUTCOMES
    outcomes = state @ linear + np.einsum("ni,nj,ijo->no", state, state, squares)

    for early, late in combinations(range(feet), 2):
        direction = rng.standard_normal(11) * OUTCOMES
        delay = instants[:, early] - instants[:, late]
        outcomes += np.outer(_added(kind, delay), direction)
    mean_map = np.linalg.lstsq(state, outcomes - outcomes.mean(axis=0), rcond=None)[0]
    step = kind.jump * rng.standard_normal(11) * OUTCOMES
    first, other = JUMPING_PAIR
    outcomes += np.outer(instants[:, first] > instants[:, other], step)
    outcomes += NOISE * np.sqrt(8.0) * OUTCOMES * rng.standard_normal(outcomes.shape)

    before = np.hstack([np.zeros((LANDINGS, 3)), state * SPREADS]) + FALLING
    errors = CONTACT_ERROR_S * rng.standard_normal(instants.shape)
    return Study(
        marker_states(before, MARKERS_M),
        marker_states(outcomes, MARKERS_M),
        CONTACT_SPREAD_S * instants + errors,
        _size(step, mean_map, pairs=feet * (feet - 1) // 2),
    )


def _added(kind: Kind, delay: np.ndarray) -> np.ndarray:
    """Return what all pairs have for their delay."""
    late = np.maximum(delay, 0.0)
    if np.isfinite(kind.fades_over):
        late = kind.fades_over * np.tanh(late / kind.fades_over)
    return kind.kink * late + kind.bend * np.tanh(delay / kind.bend_width)


def _size(step: np.ndarray, mean_map: np.ndarray, pairs: int) -> float:
    """Return the size of one pair's jump, as the verdict measures that of all pairs."""
    motions = marker_motions(MARKERS_M)
    power = np.sum((motions @ mean_map.T) ** 2, axis=1)
    changes = (motions @ step) ** 2 / pairs
    return float(np.sqrt(changes @ halves(power)))


def judged(name: str, feet: int, seed: int) -> list[dict[str, Any]]:
    """Return what the verdict says of one study."""
    study = landings(KINDS[name], feet, seed)
    errors = np.full(study.instants.shape, CONTACT_ERROR_S)
    verdict = judge(
        study.before, study.after, study.instants, instants_se=errors, seed=seed
    )
    row = {"kind": name, "feet": feet, "seed": seed}
    row["conclusion"] = verdict.conclusion
    row["true"] = study.jump
    row["saturates"] = int(verdict.saturates)
    codes = {note.code for note in verdict.notes}
    row["or_bend"] = int("maps.jump_or_bend" in codes)
    row["unsure"] = int("maps.jump_unsure" in codes)
    jump = verdict.jump
    row["named"] = int(jump is not None and jump.low > 0.0)
    if jump is not None:
        row |= {"low": jump.low, "estimate": jump.estimate, "high": jump.high}
    return [row]


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each kind and number of feet."""
    found = []
    for name, feet in product(KINDS, FEET):
        part = rows[(rows["kind"] == name) & (rows["feet"] == feet)]
        named = part[part["named"] == 1]
        row = {"kind": name, "feet": feet, "studies": len(part)}
        row["different"] = int((part["conclusion"] == "different").sum())
        row |= {
            key: int(part[key].sum())
            for key in ("saturates", "named", "or_bend", "unsure")
        }
        row["true_median"] = part["true"].median()
        inside = (named["low"] <= named["true"]) & (named["true"] <= named["high"])
        row["holds"] = int(inside.sum())
        real = named[named["true"] > 0.0]
        ratio = real["estimate"] / real["true"]
        row["ratio_median"] = ratio.median()
        row["ratio_largest"] = ratio.max()
        found.append(row)
    return pd.DataFrame(found)


def main() -> None:
    """Judge the studies and write the table."""
    args = read_options(__doc__, studies=STUDIES, first_seed=FIRST_SEED)
    file = args.out.with_name("verdict_jumps_studies.csv")
    tasks = list(product(KINDS, FEET, args.seeds))
    named = ("kind", "feet", "seed")
    run(file, COLUMNS, judged, tasks, named=named, jobs=args.jobs)
    write_table(table(pd.read_csv(file)), args.out)


if __name__ == "__main__":
    main()
