"""Size and power of the verdict, on studies of the dissertation's size.

    python benchmarks/verdict_power.py --out verdict_power.csv [--studies 200] [--hops 2860]

False alarms on hoppers whose landing is C1, of several stiffnesses, noises, spreads and preloads;
and how often three kinds of control are told from them. On the first 24 studies of a condition the
other tests, the printed overlap at k = 17 and the ratio of operator norms stand beside it. One row
a condition; beside it ``verdict_studies.csv``, one row a study.

For each hopper one long gait is simulated; a study draws its landings from it without replacement,
with noise of its own. Two studies share a twentieth of their landings, with the phases of the
frames, but no noise.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from statsmodels.stats.proportion import proportion_confint
from true_tracks import (
    Apexes,
    apexes_of,
    joined,
    operator_ratio,
    printed_overlap,
    see_landings,
    true_states,
)

from hopdata.errors import AnalysisError
from hopdata.landings.states.fits import WINDOWS_S
from hopdata.maps.coordinates import output_weights
from hopdata.maps.verdict import judge
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.scene import Control
from hopdata.synthesis.exact_maps import section_jacobians
from hopdata.synthesis.landings import SectionHeights, TrueLandings, true_landings
from hopdata.synthesis.trial import Kicks, MarkerOptions, run_trial

POINTS_M = np.array(MarkerOptions().body_m)
SECTIONS = SectionHeights(0.502, 0.2774, POINTS_M)  # those of the bundled sample
POOL_STUDIES, TRIALS = 20, 8
NOISE_M, INSTANT_NOISE_S = 0.0006, 0.0006
RATE_HZ = 100.0
TIME_UNIT_S = 0.03
LEVEL = 0.05
BESIDE = 24  # studies of a condition on which the slower statistics are worked out too, by default


@dataclass(frozen=True)
class Condition:
    """A hopper with its disturbances, a control and the noise it is seen with."""

    name: str
    hopper: HopperParameters
    kicks: Kicks
    control: Control
    noise_m: float = NOISE_M

    @property
    def gait(self) -> str:
        """Conditions of one gait share apex states."""
        return f"{self.hopper}{self.kicks}"


def conditions() -> list[Condition]:
    """All conditions; the first word of a name is the kind."""
    hopper, kicks, none = HopperParameters(), Kicks(), Control()
    variants = {
        "C1": (hopper, kicks, NOISE_M),
        "C1 softer legs": (replace(hopper, stiffness_n_m=60.0, preload_n=19.0), kicks, NOISE_M),
        "C1 stiffer legs": (replace(hopper, stiffness_n_m=120.0, preload_n=25.0), kicks, NOISE_M),
        "C1 half the noise": (hopper, kicks, NOISE_M / 2),
        "C1 twice the noise": (hopper, kicks, NOISE_M * 2),
        "C1 half the kicks": (hopper, replace(kicks, angular_velocity_rad_s=0.125), NOISE_M),
        "C1 larger kicks": (hopper, replace(kicks, angular_velocity_rad_s=0.35), NOISE_M),
        "C1 equal preloads": (hopper, replace(kicks, preload_fraction=0.0), NOISE_M),
        "C1 uneven preloads": (hopper, replace(kicks, preload_fraction=0.1), NOISE_M),
    }
    rows = [Condition(name, h, k, none, noise) for name, (h, k, noise) in variants.items()]
    for kappa in (0.025, 0.05, 0.075, 0.1, 0.15, 0.2, 0.4):
        rows.append(Condition("kappa", hopper, kicks, Control(coupling=kappa)))
    for eps in (0.1, 0.2, 0.3):
        rows.append(Condition("eps", hopper, kicks, Control(impulse=eps)))
    for tau in (0.005, 0.01):
        rows.append(Condition("tau", hopper, kicks, Control(delay_s=tau)))
    return rows


def label(condition: Condition) -> str:
    """Name and strength."""
    return f"{condition.name} {strength(condition.control):g}"


def strength(control: Control) -> float:
    """Return the one strength that is not zero, or zero; a delay in ms."""
    return control.coupling or control.impulse or 1e3 * control.delay_s


def apexes(condition: Condition, hops: int, seed: int) -> Apexes:
    """Apexes of one trial."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    trial = run_trial(condition.hopper, hops=hops, rate_hz=10.0, rng=rng, kicks=condition.kicks)
    return apexes_of(trial)


def true_size(condition: Condition, states: np.ndarray, landings: TrueLandings) -> float:
    """Relative difference of the true derivatives, in the measure of the verdict's effect."""
    from hopdata.synthesis.landings import input_coordinates

    try:
        maps = section_jacobians(condition.hopper, condition.control, states, SECTIONS).maps
    except AnalysisError:
        return float("nan")
    inputs = input_coordinates(landings.pre_state, SECTIONS.centre_m)
    root = np.linalg.cholesky(np.cov(inputs, rowvar=False))
    shape = POINTS_M - POINTS_M.mean(axis=0)
    scaled = output_weights(shape, TIME_UNIT_S)[:, None] * (maps @ root)
    rows, columns = np.triu_indices(len(maps), 1)
    change = np.mean(np.sum((scaled[rows] - scaled[columns]) ** 2, axis=(1, 2)))
    return float(np.sqrt(change / np.sum(scaled.mean(axis=0) ** 2)))


@dataclass(frozen=True)
class Pool:
    """Landings that studies are drawn from, L of them, with the robot's motion about each.

    `folder` holds times (L, W), s, and states (L, W, 12), which all processes share.
    """

    landings: TrueLandings
    folder: Path

    @property
    def times(self) -> np.ndarray:
        """Frames of each landing, from its apex, s."""
        return np.load(self.folder / "times.npy", mmap_mode="r")

    @property
    def motion(self) -> np.ndarray:
        """States in these frames."""
        return np.load(self.folder / "motion.npy", mmap_mode="r")


def filmed(
    condition: Condition, starts: Apexes, landings: TrueLandings, key: list[int], folder: Path
) -> Pool:
    """Work out the motion about each landing, and keep it in a folder."""
    times, motion = true_states(
        condition.hopper, condition.control, starts, rate_hz=RATE_HZ,
        until_s=float(np.nanmax(landings.post_time_s[landings.whole])) + max(WINDOWS_S),
        rng=np.random.default_rng(np.random.SeedSequence(key)),
    )  # fmt: skip
    np.save(folder / "times.npy", times)
    np.save(folder / "motion.npy", motion)
    return Pool(landings, folder)


def one_study(
    task: tuple[Condition, Pool, int, bool, list[int]],
) -> dict[str, float]:
    """Draw, observe and judge the landings of one study."""
    condition, pool, hops, beside, key = task
    landings = pool.landings
    rng = np.random.default_rng(np.random.SeedSequence(key))
    chosen = np.sort(rng.choice(len(landings), min(hops, len(landings)), replace=False))
    whole = chosen[landings.whole[chosen]]
    seen = see_landings(
        pool.times[whole], pool.motion[whole], _rows(landings, whole), SECTIONS,
        noise_m=condition.noise_m, instant_noise_s=INSTANT_NOISE_S, rng=rng,
    )  # fmt: skip
    start = time.perf_counter()
    answer = judge(
        seen.before, seen.after, seen.instants, seed=key[-1], time_unit_s=TIME_UNIT_S,
        flips=999, all_windows=False,
    )  # fmt: skip
    seconds = time.perf_counter() - start
    if answer.effect is None or answer.test is None:
        raise AnalysisError(answer.sentence)
    within, across, auc = printed_overlap(seen, key[-1]) if beside else (np.nan,) * 3
    return {
        "landings": len(seen.before),
        "p": answer.test.p_value,
        "effect": answer.effect.estimate,
        "low": answer.effect.low,
        "high": answer.effect.high,
        "upper_bound": answer.effect.upper_bound,
        "detectable": answer.effect.detectable,
        "window": answer.windows[0].window,
        "printed_in_class_rad": within,
        "printed_cross_class_rad": across,
        "printed_auc": auc,
        "operator_ratio": operator_ratio(seen, rng) if beside else np.nan,
        "seconds": np.nan if beside else seconds,
    }


def _rows(landings: TrueLandings, rows: np.ndarray) -> TrueLandings:
    return TrueLandings(*(getattr(landings, name)[rows] for name in landings.__dataclass_fields__))


def studies(args: argparse.Namespace) -> Iterator[pd.DataFrame]:
    """All studies of one condition after the other."""
    gaits: dict[str, Apexes] = {}
    with ProcessPoolExecutor(args.workers) as pool:
        for number, condition in enumerate(conditions()):
            if args.only and args.only not in label(condition):
                continue
            began = time.perf_counter()
            if condition.gait not in gaits:
                share = args.hops * POOL_STUDIES // TRIALS
                seeds = [args.seed + 1000 * k for k in range(TRIALS)]
                parts = pool.map(apexes, [condition] * TRIALS, [share] * TRIALS, seeds)
                gaits[condition.gait] = joined(list(parts))
            starts = gaits[condition.gait]
            landings = true_landings(
                condition.hopper, condition.control, starts.after, starts.preloads_n, SECTIONS
            )
            whole = _rows(landings, np.flatnonzero(landings.whole))
            size = true_size(condition, starts.after, whole)
            with TemporaryDirectory() as folder:
                drawn_from = filmed(condition, starts, landings, [args.seed, number], Path(folder))
                tasks = [
                    (condition, drawn_from, args.hops, k < args.beside, [args.seed, number, k])
                    for k in range(args.studies)
                ]
                table = pd.DataFrame(list(pool.map(one_study, tasks, chunksize=4)))
            table.insert(0, "condition", condition.name)
            table.insert(1, "strength", strength(condition.control))
            table.insert(2, "true_effect", size)
            seconds = time.perf_counter() - began
            alarms = np.mean(table["p"] < LEVEL)
            print(
                f"{label(condition)}: {alarms:.3f} below {LEVEL}, "
                f"true {size:.3f}, found {table['effect'].mean():.3f} ({seconds:.0f} s)",
                flush=True,
            )
            yield table


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """One row a condition: shares of positive verdicts with intervals, and sizes."""
    rows = []
    for (name, level), part in table.groupby(["condition", "strength"], sort=False):
        found = int(np.sum(part["p"] < LEVEL))
        low, high = proportion_confint(found, len(part), method="wilson")
        true = part["true_effect"].iloc[0]
        rows.append(
            {
                "condition": name,
                "strength": level,
                "true_effect": true,
                "studies": len(part),
                "landings": part["landings"].mean(),
                "found_share": found / len(part),
                "found_low": low,
                "found_high": high,
                "effect_mean": part["effect"].mean(),
                "effect_sd": part["effect"].std(),
                "interval_covers": np.mean((part["low"] <= true) & (true <= part["high"])),
                "bound_covers": np.mean(part["upper_bound"] >= true),
                "upper_bound_mean": part["upper_bound"].mean(),
                "detectable_mean": part["detectable"].mean(),
                "window_mean": part["window"].mean(),
                "seconds_per_verdict": part["seconds"].median(),
                "studies_beside": int(part["printed_auc"].notna().sum()),
                "printed_in_class_rad": part["printed_in_class_rad"].mean(),
                "printed_cross_class_rad": part["printed_cross_class_rad"].mean(),
                "printed_auc": part["printed_auc"].mean(),
                "operator_ratio_mean": part["operator_ratio"].mean(),
                "operator_ratio_sd": part["operator_ratio"].std(),
            }
        )
    return pd.DataFrame(rows)


def main() -> None:
    """Run all studies and write both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--studies", type=int, default=200, help="studies a condition")
    parser.add_argument("--hops", type=int, default=2860, help="hops a study")
    parser.add_argument(
        "--beside", type=int, default=BESIDE, help="studies with all statistics, the slow ones too"
    )
    parser.add_argument("--only", default="", help="conditions whose label holds this text")
    parser.add_argument("--seed", type=int, default=20261121)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    args = parser.parse_args()
    table = pd.concat(studies(args), ignore_index=True)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(args.out.with_name("verdict_studies.csv"), index=False, float_format="%.6g")
    summary(table).to_csv(args.out, index=False, float_format="%.6g")
    print(summary(table).to_string(index=False))


if __name__ == "__main__":
    main()
