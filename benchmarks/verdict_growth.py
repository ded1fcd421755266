"""Whether a verdict tells a kink from curvature, and from a sharp bend of a smooth map.

    python benchmarks/verdict_growth.py --out verdict_growth.csv [--studies 10]
        [--first 5000] [--jobs 2]

Studies are of bodies (`bodies.py`) on three feet. The kinds `clutch`, `reflex`,
`damping`, `side` and `twist` are mechanisms that make kinks, of the exact sizes of the
campaign. The other kinds add to the outcomes of a C1 body a function of its contact
instants, in random directions: `kink`, the last contact less the mean; `square`, the
square of the time from the first contact to the last, which has no derivative at the
simultaneous contact, and bends where two feet exchange their order away from it;
`bend 0.5`, `bend 1` and `bend 2`, the times between the contacts of each pair, rounded
over as many contact spreads: smooth maps. Beside linear and squared terms of the state
a function explains `ADDED` of the standard deviation of each outcome; for bends this is
said of the kink that they round.

One row for each study is appended to ``verdict_growth_studies.csv``, and a run that was
interrupted goes on with those that have no row.

``verdict_growth.csv`` has one row for each kind, of 1,000 landings. `different` is the
number of studies that are called so, by derivatives. Of these, `saturates`, `grows` and
`may_grow` are those that say so, the last two by a note; `slope_...` are of the studies
with one of these notes. `wrong` are those whose interval does not hold the size at the
simultaneous contact, and `wrong_noted` those of them with the note `grows`; the size of
`kink` is not known. Seeds 0 to 9 were used to choose; those from 5000 on, the default,
were not.

``verdict_shapes.csv`` beside it is of differences that fade with the delay in a shape of
their own (`fading.py`), such as none that the verdict fits. `low_holds` are the studies
whose `low` is not above the size at the simultaneous contact, `average_holds` those
whose bound over the landings is not below the average, and `high_holds` those of the
`saturates` whose `high` is not below the size. `none_wrong` are those called *no
difference* whose time constant is above `holds_from`, although the size at the contact
is above the margin.

``verdict_unseen.csv`` is of smaller ones in more noise, of most of which saturation is
not found. Of the studies that are called *different* so, `interval_holds` are those
whose interval holds the size at the simultaneous contact; `over_twice` those of which
this is more than twice `high`; and `twice_wrong` those of them whose time constant is
above `twice_high_from`, so that the verdict excludes it.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, product
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from bodies import Landings
from body_seen import Seen, study
from campaigns import read_options, run, write_table
from fading import DELAYS, SHAPES, fading_landings
from verdict_campaign import asked, cell, moved, source

from hopdata.maps.verdict import judge

MECHANISMS = ("clutch", "reflex", "damping", "side", "twist")
ADDED_KINDS = ("kink", "square", "bend 0.5", "bend 1", "bend 2")
LANDINGS = 1000
ADDED = 0.05
NOTES = ("grows", "may_grow")
COLUMNS = (
    "kind",
    "seed",
    "different",
    "saturates",
    *NOTES,
    "slope",
    "wrong",
)
# Differences that fade: their time constants, and what is told of each study.
TIME_CONSTANTS_MS = (3.0, 6.0)
FADING_LANDINGS = 900
SHAPES_TABLE = "verdict_shapes.csv"
OF_FADING = ("shape", "delay", "time_constant_ms")
FADING_COUNTS = (
    "different",
    "no_difference",
    "saturates",
    "low_holds",
    "average_holds",
    "none_wrong",
)
FADING_COLUMNS = (
    *OF_FADING,
    "seed",
    "true",
    "true_average",
    *FADING_COUNTS,
    "high_holds",
    "low",
    "estimate",
    "over",
)
# The same of smaller differences in more noise, so that saturation stays unseen.
UNSEEN_TABLE = "verdict_unseen.csv"
UNSEEN_MS = (3.0, 5.0, 8.0, 12.0)
UNSEEN_LANDINGS = 1000
UNSEEN_STRENGTH = 100.0
UNSEEN_NOISE = 0.15
UNSEEN_COUNTS = ("different", "unseen", "interval_holds", "over_twice", "twice_wrong")
UNSEEN_COLUMNS = (
    *OF_FADING,
    "seed",
    "true",
    "true_average",
    *UNSEEN_COUNTS,
    "low",
    "estimate",
    "high",
    "twice_high_from_ms",
)
STUDIES = 10
FIRST_SEED = 5000


def shape(kind: str, instants: np.ndarray) -> np.ndarray:
    """Return the function (n,) of instants (n, feet) that a kind adds."""
    spread = np.sqrt(np.mean(np.var(instants, axis=1)))
    t = instants / spread
    if kind == "kink":
        return t.max(axis=1) - t.mean(axis=1)
    if kind == "square":
        return np.ptp(t, axis=1) ** 2
    width = float(kind.removeprefix("bend "))
    return sum(np.hypot(a - b, width) for a, b in combinations(t.T, 2))


def with_added(kind: str, landings: Landings, rng: np.random.Generator) -> Landings:
    """Return landings with the function added to their outcomes."""
    state = landings.inputs[:, :8]
    squares = [a * b for a, b in combinations([*state.T, *state.T], 2)]
    smooth = np.column_stack([np.ones(len(state)), state, *squares])
    added = shape(kind, landings.instants)
    like = added
    if kind.startswith("bend"):
        # As large, far from the simultaneous contact, as the kink that it rounds.
        like = shape("bend 0", landings.instants)
    rest = like - smooth @ np.linalg.lstsq(smooth, like, rcond=None)[0]
    scale = ADDED * landings.outcomes.std(axis=0) / rest.std()
    scale *= rng.choice([-1.0, 1.0], len(scale))
    outcomes = landings.outcomes + (added - added.mean())[:, None] * scale
    return replace(landings, outcomes=outcomes)


def judged(kind: str, seed: int) -> list[dict[str, Any]]:
    """Return what the verdict says of one body."""
    mechanism = kind if kind in MECHANISMS else "c1"
    one = cell(LANDINGS, mechanism=mechanism)
    body, landings, truth = moved(one.scene, seed)
    true = 0.0
    if kind in MECHANISMS:
        true = truth.kink
    if kind in ADDED_KINDS:
        landings = with_added(kind, landings, source(seed, kind))
    data = study(body, landings, source(seed, one.name, "errors"), Seen())
    verdict = asked(data, seed)
    found = verdict.conclusion == "different" and verdict.decided_by == "effect"
    row = {"kind": kind, "seed": seed, "different": int(found)}
    row["saturates"] = int(verdict.saturates)
    if found and kind != "kink":
        row["wrong"] = int(not verdict.effect.low <= true <= verdict.effect.high)
    noted = {note.code: note.values for note in verdict.notes}
    for name in NOTES:
        row[name] = int(f"maps.{name}" in noted)
        if row[name]:
            row["slope"] = noted[f"maps.{name}"]["slope"]
    return [row]


def judged_fading(
    shape: str, delay: str, time_constant_ms: float, seed: int
) -> list[dict[str, Any]]:
    """Return what the verdict says of a difference that fades."""
    time_constant_s = 1e-3 * time_constant_ms
    data = fading_landings(
        shape, delay, time_constant_s, seed, landings=FADING_LANDINGS
    )
    verdict = judge(data.before, data.after, data.instants, seed=seed)
    size = verdict.effect
    over = verdict.effect_over_landings
    true = data.at_contact
    none = verdict.conclusion == "no difference"
    covered = verdict.holds_from is not None and time_constant_s <= verdict.holds_from
    row = {"shape": shape, "delay": delay, "time_constant_ms": time_constant_ms}
    row |= {"seed": seed, "true": true, "true_average": data.average}
    row["different"] = int(verdict.conclusion == "different")
    row["no_difference"] = int(none)
    row["saturates"] = int(verdict.saturates)
    row["low_holds"] = int(size.low <= true)
    row["high_holds"] = int(true <= size.high)
    row["average_holds"] = int(data.average <= over.upper_bound)
    # What "no difference" says of the contact: it holds of what fades more slowly.
    row["none_wrong"] = int(none and true > verdict.margin and not covered)
    row |= {"low": size.low, "estimate": size.estimate, "over": over.estimate}
    return [row]


def judged_unseen(
    shape: str, delay: str, time_constant_ms: float, seed: int
) -> list[dict[str, Any]]:
    """Return what the verdict says of a small difference that fades."""
    data = fading_landings(
        shape,
        delay,
        1e-3 * time_constant_ms,
        seed,
        landings=UNSEEN_LANDINGS,
        strength=UNSEEN_STRENGTH,
        noise=UNSEEN_NOISE,
    )
    verdict = judge(data.before, data.after, data.instants, seed=seed)
    size = verdict.effect
    true = data.at_contact
    row = {"shape": shape, "delay": delay, "time_constant_ms": time_constant_ms}
    row |= {"seed": seed, "true": true, "true_average": data.average}
    different = verdict.conclusion == "different"
    row["different"] = int(different)
    row["unseen"] = int(verdict.twice_high_from is not None)
    if row["unseen"]:
        from_ms = 1e3 * verdict.twice_high_from
        over = true > 2.0 * size.high
        row["interval_holds"] = int(size.low <= true <= size.high)
        row["over_twice"] = int(over)
        row["twice_wrong"] = int(over and time_constant_ms > from_ms)
        row["twice_high_from_ms"] = from_ms
    row |= {"low": size.low, "estimate": size.estimate, "high": size.high}
    return [row]


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each kind."""
    found = []
    for kind in [*ADDED_KINDS, *MECHANISMS]:
        part = rows[rows["kind"] == kind]
        different = part[part["different"] == 1]
        row = {"kind": kind, "studies": len(part), "different": len(different)}
        row |= {name: different[name].sum() for name in ("saturates", *NOTES)}
        row["wrong"] = different["wrong"].sum()
        row["wrong_noted"] = (different["wrong"] * different["grows"]).sum()
        row["slope_median"] = different["slope"].median()
        row["slope_least"] = different["slope"].min()
        row["slope_largest"] = different["slope"].max()
        found.append(row)
    return pd.DataFrame(found)


def table_of_fading(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each shape, delay and time constant."""
    found = []
    for names, part in rows.groupby(list(OF_FADING), sort=False):
        saturating = part[part["saturates"] == 1]
        row = dict(zip(OF_FADING, names, strict=True))
        row["studies"] = len(part)
        row["true_median"] = part["true"].median()
        row["average_median"] = part["true_average"].median()
        row |= {name: part[name].sum() for name in FADING_COUNTS}
        row["high_holds"] = saturating["high_holds"].sum()
        row["estimate_median"] = saturating["estimate"].median()
        found.append(row)
    return pd.DataFrame(found)


def table_of_unseen(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each shape, delay and time constant."""
    found = []
    for names, part in rows.groupby(list(OF_FADING), sort=False):
        unseen = part[part["unseen"] == 1]
        row = dict(zip(OF_FADING, names, strict=True))
        row["studies"] = len(part)
        row["true_median"] = part["true"].median()
        row["average_median"] = part["true_average"].median()
        row |= {name: int(part[name].sum()) for name in UNSEEN_COUNTS}
        row["high_median"] = unseen["high"].median()
        row["twice_high_from_ms"] = unseen["twice_high_from_ms"].median()
        found.append(row)
    return pd.DataFrame(found)


def in_order_of_shapes(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the studies of differences that fade in the order of the tables."""
    order = {shape: place for place, shape in enumerate(SHAPES)}
    return rows.sort_values(
        [*OF_FADING, "seed"], key=lambda column: column.replace(order), kind="stable"
    )


def main() -> None:
    """Judge the studies and write the table."""
    args = read_options(__doc__, studies=STUDIES, first_seed=FIRST_SEED)
    file = args.out.with_name("verdict_growth_studies.csv")
    kinds = [*ADDED_KINDS, *MECHANISMS]
    tasks = [(kind, seed) for seed, kind in product(args.seeds, kinds)]
    run(file, COLUMNS, judged, tasks, named=("kind", "seed"), jobs=args.jobs)
    write_table(table(pd.read_csv(file)), args.out)

    file = args.out.with_name("verdict_shapes_studies.csv")
    tasks = list(product(SHAPES, DELAYS, TIME_CONSTANTS_MS, args.seeds))
    named = (*OF_FADING, "seed")
    run(file, FADING_COLUMNS, judged_fading, tasks, named=named, jobs=args.jobs)
    rows = in_order_of_shapes(pd.read_csv(file))
    write_table(table_of_fading(rows), args.out.with_name(SHAPES_TABLE))

    file = args.out.with_name("verdict_unseen_studies.csv")
    tasks = list(product(SHAPES, DELAYS, UNSEEN_MS, args.seeds))
    run(file, UNSEEN_COLUMNS, judged_unseen, tasks, named=named, jobs=args.jobs)
    rows = in_order_of_shapes(pd.read_csv(file))
    write_table(table_of_unseen(rows), args.out.with_name(UNSEEN_TABLE))


if __name__ == "__main__":
    main()
