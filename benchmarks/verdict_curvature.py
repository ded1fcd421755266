"""Whether sizes are right where the landing map is strongly curved.

    python benchmarks/verdict_curvature.py --out verdict_curvature.csv [--studies 8]
        [--first 8000] [--jobs 2]

A body lands on three feet with a tilt and velocities that set its contact instants,
10 ms apart. Its outcomes are a quadratic function of its state, the time between the
contacts of each pair of feet in random directions, and what the kind of study adds: a
function of four random combinations w of the states (rms 1), in random directions:

    quadratic           nothing
    sine, strong sine   sin(1.5 w), as large as the linear part makes of a state; twice
    short sine          sin(2 w), twice as large
    cube                (w + w^3 / 3) / 2, twice as large
    nearer sine         the strong sine with 0.6 of the range of all states

Orders differ by `SIZE` of the mean map at the simultaneous contact.

One row for each study is appended to ``verdict_curvature_studies.csv``, and a run that
was interrupted goes on with those that have no row.

``verdict_curvature.csv`` has one row for each kind and number of landings. `noted` is
the number of studies with the note ``maps.strongly_curved``. `share_...` are of the
outcomes' variance, what terms of the second order leave and those of the third explain.
`ratio_...` are estimates over true sizes, `holds` the intervals and `bound_holds` the
bounds that hold the true size. `by_mean_slope` is by what factor the size is larger as a
share of the mean slope over the landings (median). `detectable` is a median. Seeds below
8000 were used to choose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, permutations, product
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from campaigns import read_options, run, write_table
from fading import CONTACT_SPREAD_S, FALLING, MARKERS_M, SPREADS

from hopdata.maps.truth.maps import marker_motions, marker_states
from hopdata.maps.verdict import data, judge
from hopdata.maps.verdict.comparison import compared
from hopdata.maps.verdict.effect import contrasts, relative_size
from hopdata.maps.verdict.smooth import Curvature
from hopdata.maps.verdict.window import fit_of_best_window

LANDINGS = (300, 600, 1500)
STUDIES = 8
FIRST_SEED = 8000
SIZE = 0.4
FEET = 3
FEET_M = np.array([[0.22, 0.03], [-0.10, 0.19], [-0.12, -0.17]])
# Standard deviations of what the map makes of a state: place and angles, velocity, spin.
OUTCOMES = np.repeat([0.01, 0.05, 0.2], [5, 3, 3])
SQUARES = 0.15
NOISE = 0.06
CONTACT_ERROR_S = 0.0003
COMBINATIONS = 4
NOTE = "maps.strongly_curved"


@dataclass(frozen=True)
class Kind:
    """What is added to a quadratic map: a function of w, and its slope at zero."""

    added: Callable[[np.ndarray], np.ndarray] = np.zeros_like
    slope: float = 0.0
    strength: float = 1.0
    of_range: float = 1.0


def sine(w: np.ndarray) -> np.ndarray:
    """Return a sine of the states."""
    return np.sin(1.5 * w)


def short_sine(w: np.ndarray) -> np.ndarray:
    """Return a sine that bends more."""
    return np.sin(2.0 * w)


def cube(w: np.ndarray) -> np.ndarray:
    """Return a cube that is steeper than its slope at zero."""
    return (w + w**3 / 3.0) / 2.0


KINDS = {
    "quadratic": Kind(),
    "sine": Kind(sine, 1.5),
    "strong sine": Kind(sine, 1.5, strength=2.0),
    "short sine": Kind(short_sine, 2.0, strength=2.0),
    "cube": Kind(cube, 0.5, strength=2.0),
    "nearer sine": Kind(sine, 1.5, strength=2.0, of_range=0.6),
}
COLUMNS = (
    "kind",
    "landings",
    "seed",
    "conclusion",
    "noted",
    "share",
    "by_mean_slope",
    "true",
    "low",
    "estimate",
    "high",
    "upper_bound",
    "detectable",
)


@dataclass(frozen=True)
class Study:
    """Landings as `judge` takes them."""

    before: np.ndarray
    after: np.ndarray
    instants: np.ndarray
    instants_se: np.ndarray


def contact_slopes(rng: np.random.Generator) -> np.ndarray:
    """Return the slopes (8, feet) of the contact instants by the state, in spreads."""
    slopes = np.zeros((8, FEET))
    slopes[0], slopes[1] = FEET_M.T
    slopes[5], slopes[6] = 0.3 * FEET_M[:, 1], -0.3 * FEET_M[:, 0]
    slopes[2:5] = 0.02 * rng.standard_normal((3, 1))
    between = slopes - slopes.mean(axis=1, keepdims=True)
    return np.asarray(slopes / np.sqrt(np.mean(np.sum(between**2, axis=0))))


def landings(kind: Kind, number: int, seed: int) -> Study:
    """Return the landings of one study, whose orders differ by `SIZE`."""
    of_body = np.random.default_rng([seed, 1])
    slopes = contact_slopes(of_body)
    linear = of_body.standard_normal((8, 11)) * OUTCOMES
    squares = SQUARES * of_body.standard_normal((8, 8, 11)) * OUTCOMES
    along = of_body.standard_normal((8, COMBINATIONS))
    along /= np.linalg.norm(along, axis=0)
    added = kind.strength * of_body.standard_normal((COMBINATIONS, 11)) * OUTCOMES
    pairs = list(combinations(range(FEET), 2))
    kinks = of_body.standard_normal((len(pairs), 11)) * OUTCOMES

    at_contact = linear + kind.slope * along @ added
    kinks *= SIZE / _size(at_contact, kinks, slopes, pairs)

    rng = np.random.default_rng([seed, 2])
    state = kind.of_range * rng.standard_normal((number, 8))
    instants = state @ slopes
    outcomes = state @ linear + np.einsum("ni,nj,ijo->no", state, state, squares)
    outcomes += kind.added(state @ along) @ added
    for kink, (i, j) in zip(kinks, pairs, strict=True):
        outcomes += np.outer(np.abs(instants[:, i] - instants[:, j]), kink)
    outcomes += NOISE * np.sqrt(8.0) * OUTCOMES * rng.standard_normal(outcomes.shape)

    before = np.hstack([np.zeros((number, 3)), state * SPREADS]) + FALLING
    errors = CONTACT_ERROR_S * rng.standard_normal(instants.shape)
    return Study(
        marker_states(before, MARKERS_M),
        marker_states(outcomes, MARKERS_M),
        CONTACT_SPREAD_S * instants + errors,
        np.full(instants.shape, CONTACT_ERROR_S),
    )


def _size(
    at_contact: np.ndarray,
    kinks: np.ndarray,
    slopes: np.ndarray,
    pairs: list[tuple[int, int]],
) -> float:
    """Return the size of these kinks, relative to the map at the simultaneous contact."""
    orders = np.array(list(permutations(range(FEET))))
    maps = []
    for place in np.argsort(orders, axis=1):
        own = at_contact.copy()
        for kink, (i, j) in zip(kinks, pairs, strict=True):
            later = np.sign(place[i] - place[j])
            own += later * np.outer(slopes[:, i] - slopes[:, j], kink)
        maps.append(marker_motions(MARKERS_M) @ own.T)
    weights = contrasts(orders, np.ones(len(orders)))
    return relative_size(np.array(maps), weights)


def curvature(study: Study) -> Curvature:
    """Return how strongly the map bends over the landings."""
    measured = data.measured(
        study.before, study.after, study.instants, study.instants_se
    )
    measured = data.with_feet(measured, None, None)
    measured = data.with_session(measured, None, None)
    sound = measured.sound_landings().landings
    found = fit_of_best_window(sound, compared(sound)).curvature()
    if found is None:
        raise ValueError("expected a fit of kinks, found none")
    return found


def judged(name: str, number: int, seed: int) -> list[dict[str, Any]]:
    """Return what the verdict says of one study."""
    study = landings(KINDS[name], number, seed)
    verdict = judge(
        study.before,
        study.after,
        study.instants,
        instants_se=study.instants_se,
        seed=seed,
    )
    effect = verdict.effect
    if effect is None:
        raise ValueError(f"{name}, seed {seed}: expected a size, found none")
    bent = curvature(study)
    row = {"kind": name, "landings": number, "seed": seed}
    row["conclusion"] = verdict.conclusion
    row["noted"] = int(NOTE in {note.code for note in verdict.notes})
    row |= {"share": bent.share, "by_mean_slope": bent.by_mean_slope}
    row["true"] = SIZE
    for value in COLUMNS[COLUMNS.index("low") :]:
        row[value] = getattr(effect, value)
    return [row]


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each kind and number of landings."""
    found = []
    for name, number in product(KINDS, LANDINGS):
        part = rows[(rows["kind"] == name) & (rows["landings"] == number)]
        row = {"kind": name, "landings": number, "studies": len(part)}
        row["different"] = int((part["conclusion"] == "different").sum())
        row["noted"] = int(part["noted"].sum())
        row |= _ends("share", part["share"])
        row |= _ends("ratio", part["estimate"] / part["true"])
        inside = (part["low"] <= part["true"]) & (part["true"] <= part["high"])
        row["holds"] = int(inside.sum())
        row["bound_holds"] = int((part["true"] <= part["upper_bound"]).sum())
        row["by_mean_slope"] = part["by_mean_slope"].median()
        row["detectable"] = part["detectable"].median()
        found.append(row)
    return pd.DataFrame(found)


def _ends(name: str, values: pd.Series) -> dict[str, float]:
    return {
        f"{name}_least": values.min(),
        f"{name}_median": values.median(),
        f"{name}_largest": values.max(),
    }


def main() -> None:
    """Judge the studies and write the table."""
    args = read_options(__doc__, studies=STUDIES, first_seed=FIRST_SEED)
    file = args.out.with_name("verdict_curvature_studies.csv")
    tasks = list(product(KINDS, LANDINGS, args.seeds))
    named = ("kind", "landings", "seed")
    run(file, COLUMNS, judged, tasks, named=named, jobs=args.jobs)
    write_table(table(pd.read_csv(file)), args.out)


if __name__ == "__main__":
    main()
