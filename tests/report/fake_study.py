"""A study's results as plain data, made without the workflow."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pandas as pd

from hopdata.maps.one_or_own import COLUMNS
from hopdata.report.inputs import ReportFigure, ReportInputs
from hopdata.report.page import PLACES

CAPTIONS = Path(__file__).parents[2] / "workflow" / "captions"
NUMBERED = (
    "fig2_2_sections",
    "fig2_3_schedule",
    "fig2_4_prediction",
    "fig2_5_distances",
)
NAMES = tuple(PLACES)  # all figures that have a place of their own
SVG = b'<svg xmlns="http://www.w3.org/2000/svg" width="240.9pt" height="99pt"></svg>'


def captions() -> dict[str, str]:
    return {name: (CAPTIONS / f"{name}.md").read_text() for name in NAMES}


def figures(image: bytes = SVG) -> list[ReportFigure]:
    return [
        ReportFigure(name, image, "image/svg+xml", text)
        for name, text in captions().items()
    ]


def touchdowns(
    n: int = 431,
    n_feet: int = 3,
    recordings: tuple[str, ...] = ("hopper",),
    seed: int = 5,
) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    orders = [">".join(str(i + 1) for i in p) for p in permutations(range(n_feet))]
    bad = rng.random(n) < 0.06
    reasons = [
        "foot 2 down before the pre section",
        "foot 1 not down at the post section",
    ]
    return pd.DataFrame(
        {
            "recording": rng.choice(recordings, n),
            "touchdown": np.arange(n),
            "method": "kink",
            "t_pre_s": 0.64 * np.arange(n),
            "t_post_s": 0.64 * np.arange(n) + 0.13,
            "schedule": np.where(bad, "", rng.choice(orders, n)),
            "probability": rng.uniform(0.8, 1.0, n),
            "spread_s": rng.gamma(4.0, 0.0027, n),
            "excluded": bad,
            "reason": np.where(bad, rng.choice(reasons, n), ""),
        }
    ).assign(**{"order_class": lambda table: table["schedule"]})


def sections() -> dict[str, object]:
    return {
        "min_foot_threshold_m": 0.00143,
        "max_foot_threshold_m": 0.00271,
        "pre_height_m": 0.4991,
        "post_height_m": 0.2883,
        "rule": "landings",
        "bandwidth_m": 0.0021,
        "landing_shares": {"pre": 1.0, "post": 0.979},
        "pre_speed_m_s": 1.25,
        "post_speed_m_s": 1.43,
        "instant_shift_s_m": {
            "pre": {"usual": 0.8, "large": None},
            "post": {"usual": 0.699, "large": 0.813},
        },
        "depth": {
            "shallowest_m": 0.2913,
            "deepest_m": 0.2713,
            "share": 0.15,
            "misfit": [0.0157, 0.0188, 0.0239],
            "n_landings": 300,
        },
        "other_rule": {
            "rule": "printed",
            "pre_height_m": 0.5087,
            "post_height_m": 0.3075,
        },
        "frames": "all",
        "min_foot_mode": {
            "height_m": -0.0002,
            "sigma_m": 0.00054,
            "bandwidth_m": 0.00011,
        },
    }


def floors(names: tuple[str, ...] = ("hopper",)) -> dict[str, dict[str, object]]:
    floor = {
        "degree": 3,
        "degree_wanted": 3,
        "n_points": 10234,
        "n_outliers": 41,
        "residual_rms_m": 0.00058,
        "foot_offsets_m": [0.0002, -0.0001, -0.0001],
        "note": "",
    }
    return {name: dict(floor) for name in names}


def prediction() -> pd.DataFrame:
    rows = [
        ("specialised", 6, 1.95e-3),
        ("near", 1, 2.03e-3),
        ("all", 1, 3.13e-3),
        ("far", 1, 3.79e-3),
        ("specialised_mean", 6, 15.4e-3),
        ("mean", 1, 29.5e-3),
    ]
    table = pd.DataFrame(rows, columns=["model", "n_classes", "median_mse"])
    factors = {"q25": 0.91, "q75": 1.12, "p2_5": 0.74, "p97_5": 1.51}
    return table.assign(
        n_train=52,
        n_test=18,
        **{key: factor * table["median_mse"] for key, factor in factors.items()},
        worst_position_mm=70 * np.sqrt(table["median_mse"]),
        worst_velocity_m_s=2.6 * np.sqrt(table["median_mse"]),
    )


def distances() -> pd.DataFrame:
    rows = [
        ("in_class", 2.99, 0.12, 0.5),
        ("cross_class", 3.10, 0.12, 0.73),
        ("noised_identity", 2.268, 0.098, 0.0001),
        ("random", 3.7605, 0.102, 1.0),
    ]
    table = pd.DataFrame(
        rows, columns=["kind", "mean_distance", "sd", "auc_against_in_class"]
    )
    shifts = {
        "q05": -1.64,
        "q25": -0.67,
        "median_distance": 0.0,
        "q75": 0.67,
        "q95": 1.64,
    }
    quantiles = {
        key: table["mean_distance"] + z * table["sd"] for key, z in shifts.items()
    }
    return table.assign(n=1000, **quantiles)


def truth() -> dict[str, dict[str, object]]:
    return {
        "labels_right_of_all_kink": _entry(
            0.951, "1", "Right over all true landings, kink method"
        ),
        "labels_right_unambiguous_kink": _entry(
            0.9989, "1", "Right where sure, kink method"
        ),
        "labels_right_kink": _entry(
            0.9791, "1", "Share of right mode schedules, kink method"
        ),
        "labels_right_velocity_minimum": _entry(
            0.949, "1", "Share of right mode schedules, printed"
        ),
        "contact_rms_kink": _entry(
            0.912, "ms", "Rms error of the contact instants, kink method"
        ),
        "unmatched_kink": _entry(
            0, "touchdowns", "Touchdowns without a true landing nearby"
        ),
        "section_pre_error": _entry(
            -0.42, "mm", "pre section found minus that of the truth"
        ),
        "near_below_all_below_far": _entry(True, "yes/no", "Whether near < all < far"),
        "floor_residual_rms": _entry(
            None, "mm", "Rms of fitted minus true floor height"
        ),
    }


def _entry(value: object, unit: str, what: str) -> dict[str, object]:
    return {"value": value, "unit": unit, "what": what}


def verdict(**changes: object) -> dict[str, object]:
    return {
        "conclusion": "no difference",
        "sentence": "No difference larger than 0.12 of the map, at 95 % confidence.",
        "outlook": "7.5 % would be found; to see 10 % you would need about 600 landings.",
        "compared": "6 contact orders",
        "n_feet": 3,
        "n_landings": 986,
        "n_window": 700,
        "confidence": 0.95,
        "margin": 0.2,
        "power": 0.8,
        "flips": 1999,
        "effect": {
            "estimate": 0.04,
            "low": 0.0,
            "high": 0.131,
            "upper_bound": 0.117,
            "detectable": 0.0752,
            "p_value": 0.728,
        },
        "landings_needed": 558,
        "notes": [],
    } | changes


def orders() -> list[dict[str, object]]:
    sizes = {"estimate": 0.04, "low": 0.0, "high": 0.2, "p_value": 0.7}
    return [{"of": "map", "first": "1>2>3", "second": "2>1>3", **sizes}]


def no_answer() -> dict[str, object]:
    reason = "120 landings are too few for second-order terms"
    return verdict(
        conclusion="cannot tell",
        sentence=f"These data cannot tell: {reason}.",
        outlook="",
        effect=None,
        landings_needed=None,
        notes=[{"what": "verdict", "reason": reason}],
    )


def quality() -> list[dict[str, object]]:
    seen = {
        "what": "frames seen, worst marker",
        "value": 97.2,
        "unit": "%",
        "good": 99.0,
    }
    noise = {
        "what": "noise of a coordinate over expected",
        "value": None,
        "unit": "",
        "good": 1.5,
    }
    seen, noise = ({**one, "about": "Recordings"} for one in (seen, noise))
    return [
        seen | {"poor": 95.0, "status": "look", "remark": "foot2 in hopper; longest gap 0.4 s"},
        noise | {"poor": 3.0, "status": "not known", "remark": "0.6 mm found; none configured"},
        noise | {"what": "drift, in spreads", "about": "Stability", "value": 0.1, "poor": 3.0,
                 "status": "good", "remark": "nothing beyond three standard errors"},
    ]  # fmt: skip


def faults(n: int = 2) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "recording": "hopper",
            "kind": ["spike", *["dropped"] * (n - 1)],
            "marker": ["body1", *[np.nan] * (n - 1)],
            "start_s": 1.25,
            "stop_s": 1.26,
            "remark": ["61.0 mm", *["2 frames"] * (n - 1)],
        }
    )


def remarks(n: int = 1) -> pd.DataFrame:
    return pd.DataFrame(
        {"recording": "hopper", "remark": ["a.trc: unit: taken for mm"] * n}
    )


def one_or_own() -> pd.DataFrame:
    row = dict.fromkeys(COLUMNS, 1.0)
    row |= {"outcome": "climb", "unit": "mm/s", "order": "2>1>3"}
    return pd.DataFrame([row | {"n_landings": 621, "n_orders": 6}])


def provenance() -> dict[str, object]:
    return {
        "study": "sample",
        "seed": 20261121,
        "config": {"study": "sample", "seed": 20261121, "floor": {"degree": 3}},
        "inputs": {"data/sample/hopper.h5": "9f86d081884c7d659a2feaa0c55ad015" * 2},
        "versions": {"hopdata": "0.1.0", "numpy": "2.3.1"},
        "python": "3.11.7",
        "machine": "Linux x86_64",
        "stage_seconds": {"level_hopper": 1.31, "prediction": 2.2, "sections": 0.9},
    }


def printed_study(**changes: object) -> ReportInputs:
    """Return a full study by the dissertation's methods, whose page shows more."""
    record = provenance()
    record["config"] = {"study": "sample", "printed": True}
    return full_study(**({"provenance": record} | changes))


def full_study(**changes: object) -> ReportInputs:
    parts: dict[str, object] = {
        "study": "sample",
        "figures": figures(),
        "recordings": [
            {
                "name": "hopper",
                "source": "hopper.h5",
                "n_frames": 29440,
                "duration_s": 294.39,
                "rate_hz": 100.0,
                "n_feet": 3,
                "n_body": 3,
                "seen": 0.9987,
            }
        ],
        "touchdowns": touchdowns(),
        "sections": sections(),
        "units": {"length_unit_m": 0.02913, "time_unit_s": 0.027},
        "provenance": provenance(),
        "floors": floors(),
        "prediction": prediction(),
        "distances": distances(),
        "truth": truth(),
        "verdict": verdict(orders=orders()),
        "one_or_own": one_or_own(),
        "quality": quality(),
        "faults": faults(),
        "remarks": remarks(),
        "notes": [
            {
                "what": "splits of 52/18 instead of 120/41",
                "reason": "class 1>2>3 has 70",
            }
        ],
    }
    return ReportInputs(**(parts | changes))  # type: ignore[arg-type]
