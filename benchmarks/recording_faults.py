"""How reliably `hopdata inspect` finds planted faults, and what it reports in clean recordings.

    python benchmarks/recording_faults.py --out recording_faults.csv

The recordings are of the simulated hopper, each with one fault in known markers and
frames. There is one row per camera (rate and noise) and kind of fault. `found` is the
share of recordings in which the fault is reported with its markers and frames (a swap
that ends in a gap may end anywhere in it); `named` is the share in which nothing else
is reported. The rows "clean" and "gaps" have no fault: `false_alarms` is the number of
faults reported in all their recordings, `hours` their total length, and `guessed` the
share of them in which unit, vertical axis and the roles of all markers are guessed
right.

`floor_faults.csv`, beside it, compares the fitted floor with the true one where a foot
hangs low, drags, or stands on something.

The hopper is simulated with the default curved floor, and then its feet are moved
according to the fault. There is one row per fault, height and estimator: `ours` is
`hopdata.landings.floor.fit_floor`; `tukey`, `huber` and `least squares` are single
regressions of the same rest points by statsmodels (RLM, RLM, OLS), with the same
polynomial and mount heights. Errors are taken at the true contacts, as root mean square
over the seeds: `floor_mm` of the floor, minus its mean; `mounts_mm` of the worst foot's
mount height relative to the other feet; `level_mm` of the mean of floor and mount
together over the feet; and `rms_mm` of their root mean square, which says how far from
zero a foot on the floor is afterwards. `efficiency`, for the clean recordings only, is
the square of `floor_mm` of least squares over that of the row.

The faults are: `hangs`, one foot's rests are too high by that height in the given share
of the run; `drags`, the foot slides in flight at that height, with slow waves of half
the height, in the given share; `obstacle`, all feet rest that much higher within a disc
that holds about the given share of the steps.

`filling.csv`, beside it, shows for gaps of the body markers what filling gains, and how
far the filled positions are from the truth.

The hopper is simulated once for each number of body markers and observed with and
without drop-outs of all markers, including the feet. There is one row for each kind of
gaps and each way to fill them: `none`, the methods of `hopdata.landings.filling`, and
scipy's `CubicSpline` through all seen positions of each marker, which ignores contacts
and bodies. Gaps of up to `longest_s` are filled; the default of the configuration is
`rigid` up to 0.1 s.

`error_mm` is the rms distance of filled positions from the true ones, per coordinate;
`worst_mm` is its 99 % quantile, and `seen_mm` the same rms of the seen positions, which
is their noise. Used touchdowns are compared with those of the same recording without
any gap; `won` counts those gained over `none`. Errors of the states at the sections are
relative to the integrated landings, separately for touchdowns that depend on filled
positions (from 0.22 s before the pre section to 0.22 s after the post section) and for
those that do not.

`moved_floors.csv`, beside it (alone with `--moved`), has floors that rise over the
recording, sway in 20 s or drop once half-way, under the hopper and the quadruped, with
120 landings. It also has the same bodies on a fixed floor, larger and smaller: lengths
times `size`, times times its square root, noise in proportion. There is one row for
each, worst and median over the seeds: `refused` recordings; `moving`, recordings
reported to have a moving floor; the share `used` of the true landings; `right`, the
share of right orders among the sure ones; the rms error of the instants, over the
square root of the size; rms error over stated error; and the rms residual of the best
affine map from one section to the other, in standard deviations of the coordinates.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.landings.filling import fill_gaps, mark_filled
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.floor_rests import rest_points, thinned
from hopdata.landings.floor_surface import FloorModel, design, polynomial_terms
from hopdata.landings.sections.select import select_sections
from hopdata.landings.states.assemble import assemble_pairs, exclude_stateless
from hopdata.landings.states.pairs import Pairs
from hopdata.landings.touchdowns import touchdown_table
from hopdata.maps.truth.scoring import match_landings, state_errors, true_rows
from hopdata.recording import Recording
from hopdata.recordings.plausibility import check_fall, check_rigid
from hopdata.recordings.quality.inspection import Faults, Inspection, inspect_recording
from hopdata.recordings.quality.roles import guess_roles
from hopdata.recordings.quality.stretches import marker_gaps
from hopdata.recordings.raw import RawRecording
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.scaling import known_scene, true_states
from hopdata.synthesis.simulate import simulate_recording
from hopdata.truth import Truth

CAMERAS = ((100.0, 0.0003), (100.0, 0.0006), (100.0, 0.0012), (250.0, 0.0006))
HOPS = 50
RECORDINGS = 20
GAPS = {"rate_per_min": 20.0, "mean_s": 0.1}
ROLES = {"body": 3, "foot": 3, "boom": 1}


@dataclass(frozen=True)
class Planted:
    """A recording with a fault, and how to recognise the fault among those reported."""

    positions: FloatArray
    is_found: Callable[[Faults], bool]


def swap(length: int, gap: int) -> Callable[[Recording, np.random.Generator], Planted]:
    """Exchange two markers for `length` frames, unseen for `gap` frames before each end."""

    def plant(recording: Recording, rng: np.random.Generator) -> Planted:
        pair = rng.choice(len(recording.markers), 2, replace=False)
        start = int(rng.integers(100, len(recording.time) - length - 100))
        stop = start + length
        positions = recording.positions.copy()
        positions[start:stop, pair] = recording.positions[start:stop, pair[::-1]]
        for end in (start, stop):
            positions[end - gap : end, pair] = np.nan
        names = {recording.markers[m] for m in pair}

        def is_found(faults: Faults) -> bool:
            return any(
                set(s.markers) == names
                and s.start == start
                and s.stop is not None
                and stop - gap <= s.stop <= stop
                for s in faults.swaps
            )

        return Planted(positions, is_found)

    return plant


def spike(
    size_m: float, length: int
) -> Callable[[Recording, np.random.Generator], Planted]:
    """Move a marker aside for a few frames."""

    def plant(recording: Recording, rng: np.random.Generator) -> Planted:
        m = int(rng.integers(len(recording.markers)))
        start = int(rng.integers(10, len(recording.time) - 10))
        way = rng.normal(size=3)
        positions = recording.positions.copy()
        positions[start : start + length, m] += size_m * way / np.linalg.norm(way)
        expected = (m, start, start + length)

        def is_found(faults: Faults) -> bool:
            return any((s.marker, s.start, s.stop) == expected for s in faults.spikes)

        return Planted(positions, is_found)

    return plant


def frozen(length: int) -> Callable[[Recording, np.random.Generator], Planted]:
    """Let a marker repeat one position."""

    def plant(recording: Recording, rng: np.random.Generator) -> Planted:
        m = int(rng.integers(len(recording.markers)))
        start = int(rng.integers(10, len(recording.time) - length - 10))
        positions = recording.positions.copy()
        positions[start : start + length, m] = positions[start, m]
        expected = (recording.markers[m], start, start + length)

        def is_found(faults: Faults) -> bool:
            return any((f.marker, f.start, f.stop) == expected for f in faults.frozen)

        return Planted(positions, is_found)

    return plant


FAULTS = {
    "swap for 1 frame": swap(1, 0),
    "swap for 50 frames": swap(50, 0),
    "swap for 200 frames in gaps of 10": swap(200, 10),
    "swap for 200 frames in gaps of 80": swap(200, 80),
    "spike of 10 mm": spike(0.01, 1),
    "spike of 20 mm": spike(0.02, 1),
    "spike of 30 mm": spike(0.03, 1),
    "spike of 50 mm": spike(0.05, 1),
    "spike of 50 mm for 3 frames": spike(0.05, 3),
    "frozen for 5 frames": frozen(5),
    "frozen for 50 frames": frozen(50),
}


def simulated(seed: int, rate_hz: float, noise_m: float, **camera: Any) -> Recording:
    """Simulate the hopper as this camera sees it."""
    seen = {"rate_hz": rate_hz, "noise_m": noise_m, **camera}
    return simulate_recording({"hops": HOPS}, seen, seed=seed)[0]


def inspected(recording: Recording, positions: FloatArray) -> Inspection:
    """Inspect positions in mm, as a file would hold them."""
    raw = RawRecording(
        recording.markers, recording.time, 1e3 * positions, recording.rate_hz, unit="mm"
    )
    return inspect_recording(raw)


def is_guessed(inspection: Inspection, recording: Recording) -> bool:
    """Return whether unit, axis and all roles are right, and the checks pass."""
    roles = guess_roles(inspection)
    found = (roles.body, roles.feet, roles.boom)
    right = tuple(recording.names(role) for role in ROLES)
    check_fall(recording)
    check_rigid(recording)
    return found == right and (inspection.unit.value, inspection.up.value) == (
        "mm",
        "z",
    )


def without_fault(rate_hz: float, noise_m: float, n: int) -> Iterator[dict[str, Any]]:
    """Yield the rows without a fault."""
    for kind, camera in (("clean", {}), ("gaps", {"gaps": GAPS})):
        alarms, guessed, seconds = 0, 0, 0.0
        for seed in range(n):
            recording = simulated(seed, rate_hz, noise_m, **camera)
            inspection = inspected(recording, recording.positions)
            alarms += inspection.n_problems
            guessed += is_guessed(inspection, recording)
            seconds += inspection.duration_s
        yield {
            "fault": kind,
            "recordings": n,
            "false_alarms": alarms,
            "hours": seconds / 3600,
            "guessed": guessed / n,
        }


def with_fault(rate_hz: float, noise_m: float, n: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each kind of fault."""
    for number, (kind, plant) in enumerate(FAULTS.items()):
        found = named = 0
        for seed in range(n):
            recording = simulated(1000 + seed, rate_hz, noise_m)
            rng = np.random.default_rng(
                np.random.SeedSequence(seed, spawn_key=(number,))
            )
            planted = plant(recording, rng)
            faults = inspected(recording, planted.positions).faults
            is_found = planted.is_found(faults)
            found += is_found
            named += is_found and faults.count == 1
        yield {"fault": kind, "recordings": n, "found": found / n, "named": named / n}


# The fitted floor where a foot hangs low, drags, or stands on something.

DEGREE = 5
FLOOR_FAULTS = (
    ("clean", 0.0, 0.0),
    *(("hangs", share, mm) for share in (0.3, 0.5, 0.7) for mm in (4.0, 8.0, 15.0)),
    *(("drags", share, mm) for share in (0.3, 0.6) for mm in (4.0, 15.0)),
    *(("obstacle", share, mm) for share in (0.1, 0.3) for mm in (4.0, 8.0, 15.0)),
)


def spoilt(
    recording: Recording, truth: Truth, fault: str, share: float, height_m: float
) -> Recording:
    """Move the feet according to a fault."""
    positions = recording.positions.copy()
    feet = recording.indices("foot")
    late = recording.time > (1 - share) * recording.time[-1]
    down = truth.foot_down
    if fault == "hangs":
        positions[late & down[:, 0], feet[0], 2] += height_m
    elif fault == "drags":
        wave = height_m * (1 + 0.5 * np.sin(2 * np.pi * recording.time / 2.0))
        floor = _true_floor(recording, truth, feet[0])
        moved = late & ~down[:, 0]
        noise = np.random.default_rng(0).normal(0, truth.noise_m, len(wave))
        positions[moved, feet[0], 2] = (floor + wave + noise)[moved]
    elif fault == "obstacle":
        stands = np.concatenate(
            [positions[down[:, k], f, :2] for k, f in enumerate(feet)]
        )
        centre = np.median(stands, axis=0) + np.array([0.2, 0.1])
        radius = np.quantile(np.hypot(*(stands - centre).T), share)
        for k, foot in enumerate(feet):
            inside = np.hypot(*(positions[:, foot, :2] - centre).T) < radius
            positions[inside & down[:, k], foot, 2] += height_m
    return replace(recording, positions=positions)


def _true_floor(recording: Recording, truth: Truth, foot: int) -> FloatArray:
    """Return the true floor height under a foot at each frame, that of the nearest true contact."""
    from scipy.spatial import cKDTree

    seen = np.isfinite(truth.contact_times)
    _, nearest = cKDTree(truth.contact_points[seen]).query(
        recording.positions[:, foot, :2]
    )
    return truth.floor_at_contacts[seen][nearest]


def peer(
    recording: Recording, name: str
) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Regress the same rest points by statsmodels; return floor and mounts by place."""
    import statsmodels.api as sm

    rest = rest_points(recording)
    rest = thinned(rest.take(np.abs(rest.above_mode) <= 0.06), 10000)
    rest = rest.take(np.abs(rest.above_mode) <= 0.02)
    scale = float(np.abs(rest.points[:, :2]).max())
    terms = polynomial_terms(DEGREE)
    n = len(rest.start_m)
    contrasts = np.vstack([np.eye(n - 1), -np.ones((1, n - 1))])
    columns = np.hstack(
        [design(rest.points[:, :2] / scale, terms), contrasts[rest.foot]]
    )
    norms = {
        "tukey": sm.robust.norms.TukeyBiweight(),
        "huber": sm.robust.norms.HuberT(),
    }
    heights = rest.points[:, 2]
    if name == "least squares":
        found = sm.OLS(heights, columns).fit().params
    else:
        found = sm.RLM(heights, columns, M=norms[name]).fit().params
    offsets = contrasts @ found[len(terms) :]

    def height(places: FloatArray, foot: FloatArray) -> FloatArray:
        flat = places.reshape(-1, 2) / scale
        floor = (design(flat, terms) @ found[: len(terms)]).reshape(places.shape[:-1])
        return np.asarray(floor + foot * offsets)

    return height


def ours(recording: Recording) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Fit by `fit_floor`."""
    floor: FloorModel = fit_floor(recording, degree=DEGREE)

    def height(places: FloatArray, foot: FloatArray) -> FloatArray:
        return np.asarray(
            floor.height(places[..., 0], places[..., 1]) + foot * floor.foot_offsets_m
        )

    return height


def measure(
    height: Callable[[FloatArray, FloatArray], FloatArray], truth: Truth
) -> dict[str, float]:
    """Return errors at the true contacts; the true mount heights are all zero."""
    seen = np.isfinite(truth.contact_times)
    floor = (height(truth.contact_points, np.zeros(1)) - truth.floor_at_contacts)[seen]
    both = np.where(
        seen, height(truth.contact_points, np.ones(1)) - truth.floor_at_contacts, 0
    )
    zero = np.zeros((1, truth.contact_points.shape[1], 2))
    mounts = (height(zero, np.ones(1)) - height(zero, np.zeros(1)))[0]
    return {
        "floor_mm": 1e3 * float(floor.std()),
        "mounts_mm": 1e3 * float(np.abs(mounts).max()),
        "level_mm": 1e3 * float(both[seen].mean()),
        "rms_mm": 1e3 * float(np.sqrt(np.mean(both[seen] ** 2))),
    }


ESTIMATORS: dict[
    str, Callable[[Recording], Callable[[FloatArray, FloatArray], FloatArray]]
] = {
    "ours": ours,
    "tukey": lambda r: peer(r, "tukey"),
    "huber": lambda r: peer(r, "huber"),
    "least squares": lambda r: peer(r, "least squares"),
}


def _rms_of(values: pd.Series) -> float:
    return float(np.sqrt(np.mean(values**2)))


def floor_table(hops: int, seeds: int) -> pd.DataFrame:
    """Simulate, spoil, fit and tabulate."""
    rows: list[dict[str, Any]] = []
    for seed in range(seeds):
        recording, truth = simulate_recording({"hops": hops}, seed=seed)
        for fault, share, mm in FLOOR_FAULTS:
            bad = spoilt(recording, truth, fault, share, 1e-3 * mm)
            for name, estimator in ESTIMATORS.items():
                found = measure(estimator(bad), truth)
                where = {
                    "fault": fault,
                    "share": share,
                    "height_mm": mm,
                    "estimator": name,
                }
                rows.append({**where, **found})
    keys = ["fault", "share", "height_mm", "estimator"]
    table = pd.DataFrame(rows).groupby(keys, sort=False).agg(_rms_of).reset_index()
    clean = table["fault"] == "clean"
    best = table.loc[clean & (table["estimator"] == "least squares"), "floor_mm"].iloc[
        0
    ]
    table["efficiency"] = np.where(clean, (best / table["floor_mm"]) ** 2, np.nan)
    return table


# Gaps of the body markers and their filling.

MARKERS = (
    *((0.13, 0.03, 0.05), (-0.08, 0.11, 0.075), (-0.07, -0.14, 0.055)),
    *((0.02, -0.05, 0.1), (-0.12, 0.0, 0.03)),
)
FILLED_GAPS = {
    "short": (60.0, 0.03),
    "long": (60.0, 0.15),
}  # 1/min per marker, length in s
METHODS = ("none", "rigid", "CubicSpline")
DEFAULT_S, LONGEST_S = 0.1, 0.5
WAYS = (("none", 0.0), ("rigid", DEFAULT_S), ("CubicSpline", LONGEST_S))
CAPTURE = {"noise_m": 0.0006}


@dataclass(frozen=True)
class Case:
    """A hopper seen with and without gaps, its truth, and values that do not depend on the gaps."""

    whole: Recording
    perfect: Recording
    truth: Truth
    heights: tuple[float, float]
    true: Pairs


def observed(
    hops: int, n_body: int, seed: int, **capture: Any
) -> tuple[Recording, Truth]:
    """Simulate the hopper with its first `n_body` markers."""
    capture = {**CAPTURE, "markers": {"body_m": MARKERS[:n_body]}, **capture}
    return simulate_recording({"hops": hops}, capture, seed=seed)


def make_case(hops: int, n_body: int, seed: int) -> Case:
    """Simulate, choose the sections, and integrate the true landings to them."""
    whole, truth = observed(hops, n_body, seed)
    perfect, _ = observed(hops, n_body, seed, noise_m=0.0, resolution_m=0.0)
    flat = level(whole, fit_floor(whole))
    found = select_sections([flat])
    scene = known_scene(truth)
    sections = SectionHeights(
        found.pre_height_m, found.post_height_m, scene.body_points_m
    )
    states = true_states(truth, scene, sections)
    names = np.full(len(states.touchdown), whole.name)
    true = Pairs(
        states.x, states.y, states.schedule, states.spread_s, names, states.touchdown,
        whole.names("body"),
    )  # fmt: skip
    return Case(whole, perfect, truth, (found.pre_height_m, found.post_height_m), true)


def splined(recording: Recording, *, longest_s: float) -> Recording:
    """Fill the gaps of each body marker by scipy's spline through all its seen positions."""
    positions, filled = (
        recording.positions.copy(),
        np.zeros(recording.positions.shape[:2], bool),
    )
    short = short_gaps(recording, longest_s)
    for m in recording.indices("body"):
        is_seen = np.isfinite(positions[:, m, 0])
        spline = CubicSpline(
            recording.time[is_seen], positions[is_seen, m], extrapolate=False
        )
        positions[short[:, m], m] = spline(recording.time[short[:, m]])
        filled[:, m] = short[:, m] & np.isfinite(positions[:, m, 0])
    return replace(recording, positions=positions, filled=filled)


def short_gaps(recording: Recording, longest_s: float) -> NDArray[np.bool_]:
    """Mark the gaps that are no longer than `longest_s`, (N, M)."""
    mask = np.zeros(recording.positions.shape[:2], bool)
    for m, gaps in enumerate(marker_gaps(recording.positions, recording.markers)):
        for start, stop in gaps.stretches:
            mask[start:stop, m] = stop - start <= longest_s * recording.rate_hz + 1e-6
    return mask


def filled_by(method: str, flat: Recording, longest_s: float) -> Recording:
    """Fill by one of `METHODS`."""
    if method == "none":
        return replace(flat, filled=np.zeros(flat.positions.shape[:2], bool))
    if method == "CubicSpline":
        return splined(flat, longest_s=longest_s)
    return fill_gaps(flat, longest_s=longest_s)


def touchdowns(recording: Recording, case: Case) -> tuple[Pairs, pd.DataFrame]:
    """Return pairs and touchdowns of a levelled recording."""
    pre, post = case.heights
    table = touchdown_table(recording, pre_height_m=pre, post_height_m=post)
    table = mark_filled(recording, table)
    pairs = assemble_pairs([recording], table, pre_height_m=pre, post_height_m=post)
    return pairs, exclude_stateless(table, pairs)


def state_row(case: Case, recording: Recording) -> dict[str, float]:
    """Return the touchdowns used, and errors of their states with and without filled positions."""
    pairs, table = touchdowns(recording, case)
    contacts = {recording.name: case.truth.contact_times}
    rows = true_rows(pairs, table, case.true, contacts, recording.names("foot"))
    share = table.set_index("touchdown")["filled_share"].loc[pairs.touchdown].to_numpy()
    out: dict[str, float] = {
        "descents": len(table),
        "used": int((~table["excluded"]).sum()),
        "rest_on_filled": int((share > 0).sum()),
    }
    for kind, chosen in (("filled", share > 0), ("seen", share == 0)):
        errors = state_errors(pairs, case.true, np.where(chosen, rows, -1))
        for row in errors.to_dict("records"):
            section = row["section"]
            out[f"{kind}_{section}_position_mm"] = row["position_rms_mm"]
            out[f"{kind}_{section}_velocity_mm_s"] = row["velocity_rms_mm_s"]
    return out


def rows_of(
    case: Case, n_body: int, kind: str, gappy: Recording
) -> list[dict[str, Any]]:
    """Return one row per method for one recording with gaps."""
    floor = fit_floor(gappy)
    flat, perfect = level(gappy, floor), level(case.perfect, floor)
    bodies = flat.indices("body")
    missing = ~np.isfinite(flat.positions[:, bodies]).all(axis=2)
    noise = (flat.positions - perfect.positions)[:, bodies][~missing]
    whole = replace(
        level(case.whole, floor), filled=np.zeros(flat.positions.shape[:2], bool)
    )
    used_whole = int((~touchdowns(whole, case)[1]["excluded"]).sum())
    rows = []
    for method, longest_s in WAYS:
        recording = filled_by(method, flat, longest_s)
        assert recording.filled is not None
        error = (recording.positions - perfect.positions)[recording.filled]
        rows.append(
            {
                "body_markers": n_body,
                "gaps": kind,
                "rate_per_min": FILLED_GAPS[kind][0],
                "mean_s": FILLED_GAPS[kind][1],
                "method": method,
                "longest_s": longest_s,
                "missing": int(missing.sum()),
                "filled": len(error),
                "error_mm": 1e3 * _rms(error),
                "worst_mm": 1e3 * _far(error),
                "seen_mm": 1e3 * _rms(noise),
                "used_without_gaps": used_whole,
                **state_row(case, recording),
            }
        )
    for row in rows:
        row["won"] = row["used"] - rows[0]["used"]
    return rows


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _far(values: FloatArray) -> float:
    return float(np.quantile(np.abs(values), 0.99)) if values.size else float("nan")


def filling_table(hops: int, seed: int) -> pd.DataFrame:
    """Simulate, fill and tabulate."""
    rows: list[dict[str, Any]] = []
    for n_body in (3, 4, 5):
        case = make_case(hops, n_body, seed)
        for kind, (rate, mean) in FILLED_GAPS.items():
            gaps = {"rate_per_min": rate, "mean_s": mean}
            gappy, _ = observed(hops, n_body, seed, gaps=gaps)
            rows += rows_of(case, n_body, kind, gappy)
    return pd.DataFrame(rows)


SCENES = {"hopper": {}, "quadruped": {"scene": "quadruped"}}
MOVES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "rise": lambda t: t / t[-1],
    "sway": lambda t: 0.5 * np.sin(2 * np.pi * t / 20.0),
    "step": lambda t: (t < 0.5 * t[-1]).astype(float),
}
MOVED_BY_M, SIZES = (0.02, 0.05), (0.003, 0.03, 0.3, 3.0, 10.0)
SURE = 0.9


def moved_table(seeds: range, hops: int) -> pd.DataFrame:
    """Return one row for each body and movement of its floor, and for each size of the body."""
    rows = []
    for body, scene in SCENES.items():
        seen = [
            simulate_recording({"hops": hops, **scene}, {}, seed=[s, 26]) for s in seeds
        ]
        cases = [("still", 0.0, 1.0), *(("still", 0.0, size) for size in SIZES)]
        cases += [(move, far, 1.0) for move in MOVES for far in MOVED_BY_M]
        for move, far, size in cases:
            found = pd.DataFrame([_on_moved(*one, move, far, size) for one in seen])
            row = {"body": body, "size": size, "floor": move, "by_mm": 1e3 * far}
            row |= {name: int(found.pop(name).sum()) for name in ("refused", "moving")}
            for name in found:
                worst = (
                    found[name].min()
                    if name in ("used", "right")
                    else found[name].max()
                )
                row |= {name: found[name].median(), f"{name}_worst": worst}
            rows.append(row)
            print(row, flush=True)
    return pd.DataFrame(rows)


def _on_moved(
    recording: Recording, truth: Truth, move: str, far_m: float, size: float
) -> dict[str, float]:
    """Measure what is found in one recording."""
    root, positions = np.sqrt(size), size * recording.positions
    if move in MOVES:
        positions[:, :, 2] += far_m * MOVES[move](recording.time)[:, None]
    seen = {"time": root * recording.time, "rate_hz": recording.rate_hz / root}
    recording = replace(recording, **seen, positions=positions)
    try:
        floor = fit_floor(recording)
        flat = level(recording, floor)
        sections = select_sections([flat])
        heights = {
            name: getattr(sections, name) for name in ("pre_height_m", "post_height_m")
        }
        table = touchdown_table(flat, **heights)
        pairs = assemble_pairs([flat], table, **heights)
    except AnalysisError:
        return {"refused": True, "moving": False}
    used = table[~table["excluded"]].set_index("touchdown").loc[pairs.touchdown]
    kinds = ("contact", "se", "common")
    instant, own, common = (
        used.filter(regex=f"^{k}_.*_s$").to_numpy() / root for k in kinds
    )
    landing = match_landings(instant, truth.contact_times)
    error = (instant - truth.contact_times[landing])[landing >= 0]
    stated = np.hypot(own, common)[landing >= 0]
    order = np.argsort(instant, axis=1) == np.argsort(
        truth.contact_times[landing], axis=1
    )
    sure = (used["probability"].to_numpy() >= SURE) & (landing >= 0)
    x, y = ((z - z.mean(axis=0)) / z.std(axis=0) for z in (pairs.x, pairs.y))
    left = y - x @ np.linalg.lstsq(x, y, rcond=1e-6)[0]
    return {
        "refused": False,
        "moving": floor.moves,
        "used": len(pairs) / int(np.isfinite(truth.contact_times).all(axis=1).sum()),
        "right": float(order.all(axis=1)[sure].mean()),
        "rms_ms": 1e3 * _rms(error),
        "over_stated": _rms(error / stated),
        "map_residual": _rms(left),
    }


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--recordings", type=int, default=RECORDINGS)
    parser.add_argument("--floor-seeds", type=int, default=5)
    parser.add_argument("--filled-hops", type=int, default=500)
    parser.add_argument(
        "--moved", action="store_true", help="only moved_floors.csv, into --out"
    )
    parser.add_argument(
        "--moved-seeds", type=int, nargs=2, default=(61, 65), help="first, last"
    )
    options = parser.parse_args()
    out: Path = options.out
    out.parent.mkdir(parents=True, exist_ok=True)
    first, last = options.moved_seeds
    moved = moved_table(range(first, last + 1), 120)
    moved_to = out if options.moved else out.with_name("moved_floors.csv")
    moved.to_csv(moved_to, index=False, float_format="%.4g")
    if options.moved:
        return
    rows = [
        {"rate_hz": rate_hz, "noise_mm": 1e3 * noise_m, **row}
        for rate_hz, noise_m in CAMERAS
        for measure in (without_fault, with_fault)
        for row in measure(rate_hz, noise_m, options.recordings)
    ]
    pd.DataFrame(rows).to_csv(out, index=False, float_format="%.4g")
    floor = floor_table(300, options.floor_seeds)
    floor.to_csv(out.with_name("floor_faults.csv"), index=False, float_format="%.6g")
    filled = filling_table(options.filled_hops, 20261121)
    filled.to_csv(out.with_name("filling.csv"), index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
