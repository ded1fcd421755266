"""The report: one HTML page that needs no other file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from hopdata.arrays import pd
from hopdata.report import formatting as show
from hopdata.report import tables, verdict
from hopdata.report.inputs import ReportInputs, as_yaml, placed_pictures, rendered
from hopdata.report.scene import landings_scene

# The key numbers at the top of the page, which captions may also use.

# Cases of the scaling study other than the scene itself.
CONTROLS = ("coupling", "impulse", "delay", "study")
COUNTS = (
    "n_descents",
    "n_landings",
    "n_not_landed",
    "n_used",
    "n_excluded",
    "n_schedules",
)


def study_facts(inputs: ReportInputs) -> dict[str, Any]:
    """Gather the facts of a study; every key is always present, None if unknown.

    Returns
    -------
    dict
        Counts (int): ``n_recordings, n_frames``; ``n_descents`` of the body;
        ``n_landings``, those in which a foot of the study lands; ``n_not_landed``, the
        others; ``n_used`` of the landings and ``n_excluded``, the rest of them;
        ``n_schedules`` among those used. Texts with units (``pre, post, travel,
        min_threshold, max_threshold, bandwidth, units, spread``; by the other rule
        ``beside_pre, beside_post``; shares of the landings ``pre_held, post_held``).
        ``printed_rule`` (whether sections are knees of densities), ``pre_given,
        post_given`` (whether the configuration sets them), ``landings_only`` (whether
        the densities are of the body's descents only), ``medians`` of the fitted models
        (normalised) and ``distances`` (rad) by name, ``fitted`` and ``not_fitted`` as
        text, ``labels_right`` by method (%), and ``study``. ``method``, by which the
        contacts were found; ``scaling``, the ``scene`` of the scaling study and how
        many ``controls`` it has; ``has_forces``, whether contacts were compared with
        forces.
    """
    rad = partial(show.fixed, decimals=2)
    slopes = _by_name(inputs.truth or {}, "scaling_slope_")
    return {
        "study": inputs.study,
        **_counts(inputs),
        **_heights(inputs.sections or {}),
        **_units(inputs.units or {}),
        **_models(inputs),
        "distances": _medians(inputs.distances, "kind", tables.KIND_NAMES, rad),
        "labels_right": _labels_right(inputs.truth or {}),
        "slopes": slopes,
        "scaling": {
            "scene": next((case for case in slopes if case not in CONTROLS), None),
            "controls": sum(case in CONTROLS for case in slopes),
        },
        "method": _method(inputs.touchdowns),
        "has_forces": _has_forces(inputs.overlay),
        "estimate_errors": _by_name(inputs.truth or {}, "map_estimate_error_"),
        "verdict": verdict.verdict_facts(inputs.verdict, inputs.truth),
    }


def _method(touchdowns: pd.DataFrame | None) -> str | None:
    """Return the method that found the contacts; None if it is not known."""
    if touchdowns is None or touchdowns.empty or "method" not in touchdowns:
        return None
    return str(touchdowns["method"].iloc[0])


def _has_forces(overlay: Mapping[str, pd.DataFrame]) -> bool:
    """Return whether contacts were compared with forces, the only ones to have thresholds."""
    thresholds = overlay.get("contact_overlay_thresholds")
    return thresholds is not None and not thresholds.empty


def _counts(inputs: ReportInputs) -> dict[str, Any]:
    names = {str(item.get("name")) for item in inputs.recordings}
    frames = [item["n_frames"] for item in inputs.recordings if item.get("n_frames")]
    table = inputs.touchdowns
    counts: dict[str, Any] = dict.fromkeys((*COUNTS, "spread"))
    if table is not None:
        used = table[~tables.excluded(table)]
        landings = int((table["reason"] != tables.NO_FOOT_LANDED).sum())
        names |= set(table["recording"].astype(str))
        orders = int(used["schedule"].replace("", None).nunique())
        others = len(table) - landings, len(used), landings - len(used), orders
        counts |= zip(COUNTS, (len(table), landings, *others), strict=True)
        counts["spread"] = _shown(
            used["spread_s"].median() if len(used) else None, 1e3, "ms"
        )
    return {"n_recordings": len(names), "n_frames": sum(frames) or None, **counts}


def _heights(sections: Mapping[str, Any]) -> dict[str, str | bool | None]:
    pre, post = (
        show.scaled(sections.get(f"{side}_height_m"), 1.0) for side in ("pre", "post")
    )
    decided = sections.get("decided") or {}
    held = sections.get("held") or {}
    beside = sections.get("beside") or {}
    return {
        "pre": _shown(pre, 1e3, "mm"),
        "post": _shown(post, 1e3, "mm"),
        "travel": _shown(
            None if pre is None or post is None else pre - post, 1e3, "mm"
        ),
        "min_threshold": _shown(
            sections.get("min_foot_threshold_m"), 1e3, "mm", decimals=1
        ),
        "landings_only": sections.get("frames") == "landings",
        "printed_rule": sections.get("rule") == "printed",
        "pre_given": decided.get("pre_height_m") == "config",
        "post_given": decided.get("post_height_m") == "config",
        "pre_held": _share_in_words(held.get("pre")),
        "post_held": _share_in_words(held.get("post")),
        "bandwidth": _shown(sections.get("bandwidth_m"), 1e3, "mm", decimals=1),
        "beside_pre": _shown(beside.get("pre_height_m"), 1e3, "mm"),
        "beside_post": _shown(beside.get("post_height_m"), 1e3, "mm"),
        "max_threshold": _shown(
            sections.get("max_foot_threshold_m"), 1e3, "mm", decimals=1
        ),
    }


def _share_in_words(share: float | None) -> str | None:
    """Write a share in whole per cent, rounded down, so that 100 % means all."""
    if share is None:
        return None
    return show.with_unit(str(math.floor(100 * share)), "%")


def _units(units: Mapping[str, Any]) -> dict[str, str | None]:
    length = _shown(units.get("length_unit_m"), 1e3, "mm")
    time = _shown(units.get("time_unit_s"), 1e3, "ms")
    return {"units": f"{length} and {time}" if length and time else None}


def _models(inputs: ReportInputs) -> dict[str, Any]:
    medians, names = (
        _medians(inputs.prediction, "model", tables.MODEL_NAMES),
        tables.MODEL_NAMES,
    )
    return {
        "medians": medians,
        "fitted": show.words([names[m] for m in names if medians[m] is not None]),
        "not_fitted": show.words([names[m] for m in names if medians[m] is None]),
    }


def _medians(
    table: Any,
    column: str,
    names: Mapping[str, str],
    shown: Callable[..., str] = show.significant,
) -> dict[str, str | None]:
    found: dict[str, Any] = {}
    if table is not None:
        found = dict(zip(table[column].astype(str), table["median"], strict=True))
    return {
        name: None if show.is_missing(found.get(name)) else shown(found[name])
        for name in names
    }


def _labels_right(
    truth: Mapping[str, Mapping[str, Any]],
) -> dict[str, tuple[str, str | None]]:
    """Return correct mode schedules by method, in per cent: of touchdowns used, of all landings."""
    prefix, of_all = "labels_right_", "labels_right_of_all_"
    methods = [
        name.removeprefix(prefix)
        for name in truth
        if name.startswith(prefix)
        and not name.startswith((of_all, "labels_right_unambiguous_"))
    ]
    return {
        method.replace("_", " "): (share, _percent(truth.get(of_all + method)))
        for method in methods
        if (share := _percent(truth[prefix + method]))
    }


def _by_name(truth: Mapping[str, Mapping[str, Any]], prefix: str) -> dict[str, str]:
    """Return the entries whose names begin with the prefix, by the rest of their names."""
    return {
        name.removeprefix(prefix): show.fixed(entry["value"], 2)
        for name, entry in truth.items()
        if name.startswith(prefix) and not show.is_missing(entry.get("value"))
    }


def _percent(entry: Mapping[str, Any] | None) -> str | None:
    return _shown((entry or {}).get("value"), 100, "%", decimals=1)


def _shown(
    value: Any, factor: float, unit: str, *, decimals: int | None = None
) -> str | None:
    """Format with its unit, to three digits or `decimals` decimals; None if it is missing."""
    if (number := show.scaled(value, factor)) is None:
        return None
    text = (
        show.significant(number) if decimals is None else show.fixed(number, decimals)
    )
    return show.with_unit(text, unit)


GAPS = "recording_gaps"
PLACES: dict[str, str] = show.WORDS["places"]


def build_report(inputs: ReportInputs) -> str:
    """Build the page of a study.

    Parameters
    ----------
    inputs : ReportInputs
        Tables and figures; the page says which parts are missing.

    Returns
    -------
    str
        A complete HTML document that includes style and figures and loads nothing.

    Raises
    ------
    ConfigError
        If a caption names a fact that does not exist.
    """
    facts, all_seen = study_facts(inputs), _all_seen(inputs)
    shown = [f for f in inputs.figures if not (all_seen and f.name == GAPS)]
    return rendered(
        "report.html.j2",
        study=inputs.study,
        facts=facts,
        highlights=_highlights(facts, inputs),
        lights=tables.lights(inputs.quality),
        scene=landings_scene(inputs.levelled, inputs.touchdowns),
        pictures=placed_pictures(shown, facts, PLACES, "others"),
        all_seen=all_seen,
        tables=_tables(inputs),
        notes=[_note(note) for note in (*inputs.notes, *_floor_notes(inputs.floors))],
        verdict_meaning=verdict.meaning(inputs.verdict),
        distances_asked=inputs.distances_asked,
        verdict_notes=[_note(note) for note in (inputs.verdict or {}).get("notes", ())],
        config=as_yaml((inputs.provenance or {}).get("config")),
    )


def _all_seen(inputs: ReportInputs) -> bool:
    """Return whether there are neither gaps nor faults, so that a figure of them would be empty."""
    seen = [item.get("seen") == 1.0 for item in inputs.recordings]
    return (
        bool(seen) and all(seen) and inputs.faults is not None and inputs.faults.empty
    )


def _highlights(
    facts: Mapping[str, Any], inputs: ReportInputs
) -> list[tuple[str, str, str]]:
    """Return name, value and remark of each key number; the value says so if it is unknown."""
    frames = f"{show.count(facts['n_frames'])} frames" if facts["n_frames"] else ""
    between = f"pre section {facts['pre']}, post section {facts['post']}"
    feet = max((item.get("n_feet") or 0 for item in inputs.recordings), default=0)
    possible = f"of {show.count(math.factorial(feet))} possible, in the touchdowns used"
    of_all = [possible] if feet > 1 else []
    apart = [f"median spread of contacts {facts['spread']}"] if facts["spread"] else []
    weigh = "position and velocity errors weigh the same"
    cards = [
        (
            "Difference of the maps",
            facts["verdict"]["difference"],
            facts["verdict"]["remark"],
        ),
        ("Quality of the data", *tables.quality_summary(inputs.quality)),
        ("Recordings", show.count(facts["n_recordings"]), frames),
        ("Touchdowns used", show.count(facts["n_used"]), _of_landings(facts)),
        (
            "Contact orders seen",
            show.count(facts["n_schedules"]),
            "; ".join(of_all + apart),
        ),
        (
            "Travel through the touchdown",
            facts["travel"],
            between if facts["travel"] else "",
        ),
        ("Units of length and time", facts["units"], weigh if facts["units"] else ""),
        ("Affine model over mean", *_gain(inputs.prediction)),
    ]
    if inputs.prediction is not None:
        cards.append(
            ("One model over one per order", *_price_of_one(inputs.prediction))
        )
    for method, (share, of_all) in facts["labels_right"].items():
        missed = f"; {of_all} of all true landings" if of_all else ""
        cards.append((f"Orders right, {method}", share, f"of those used{missed}"))
    return [(name, _known(value), remark) for name, value, remark in cards]


def _of_landings(facts: Mapping[str, Any]) -> str:
    """Say how many landings there are, and how many further descents of the body."""
    if not facts["n_descents"]:
        return ""
    landings, others = facts["n_landings"], facts["n_not_landed"]
    found = f"of {show.count(landings)} landing{'' if landings == 1 else 's'}"
    found += f", {show.count(facts['n_excluded'])} excluded"
    of_descents = f"{show.count(others)} of {show.count(facts['n_descents'])} descents"
    return found + (f"; no foot of the study landed in {of_descents}" if others else "")


def _known(value: str | None) -> str:
    return "not known" if value in (None, "", show.MISSING) else str(value)


def _price_of_one(prediction: pd.DataFrame) -> tuple[str | None, str]:
    """Return the error of the unspecialised affine model over that of the specialised ones."""
    ratio = _ratio(prediction, "all", "specialised")
    remark = (
        "ratio of median MSE; curvature alone also raises it above 1: see the verdict"
    )
    absent = (None, "needs an affine model of each order")
    return absent if ratio is None else (show.significant(ratio, 3), remark)


def _gain(prediction: pd.DataFrame | None) -> tuple[str | None, str]:
    """Return the affine model's error over the mean's, specialised if those were fitted."""
    for affine, mean, which in (("specialised", "specialised_mean", "both specialised"),
                                ("all", "mean", "both unspecialised")):  # fmt: skip
        ratio = None if prediction is None else _ratio(prediction, affine, mean)
        if ratio is not None:
            return show.significant(ratio, 2), f"ratio of median MSE, {which}"
    return None, ""


def _ratio(prediction: pd.DataFrame, model: str, other: str) -> float | None:
    medians = dict(
        zip(prediction["model"].astype(str), prediction["median"], strict=True)
    )
    one, two = medians.get(model, 0), medians.get(other, 0)
    return one / two if one > 0 and two > 0 else None


def _tables(inputs: ReportInputs) -> dict[str, show.Table | None]:
    return {
        "quality": tables.quality_table(inputs.quality),
        "faults": tables.faults_table(inputs.faults),
        "remarks": tables.remarks_table(inputs.remarks),
        "excluded": tables.excluded_table(inputs.touchdowns, inputs.levelled),
        "recordings": tables.recordings_table(inputs.recordings),
        "filled": tables.filled_table(inputs.filled, inputs.touchdowns),
        "floor": tables.floor_table(inputs.floors),
        "sections": tables.sections_table(inputs.sections),
        "schedules": tables.schedules_table(inputs.touchdowns),
        "exclusions": tables.exclusions_table(inputs.touchdowns),
        "overlay": tables.agreement_table(inputs.overlay),
        "unmatched": tables.unmatched_table(inputs.overlay),
        "thresholds": tables.thresholds_table(inputs.overlay),
        "prediction": tables.prediction_table(inputs.prediction),
        "distances": tables.distances_table(inputs.distances),
        "truth": tables.truth_table(inputs.truth),
        **tables.record_tables(inputs.provenance or {}),
    }


def _floor_notes(floors: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Say which floor models have a lower degree than requested, and why."""
    return [
        f"floor of {name}: degree {floor['degree']} instead of {floor['degree_wanted']}"
        + (f" ({floor['note']})" if floor.get("note") else "")
        for name, floor in floors.items()
        if floor.get("degree", 0) < floor.get("degree_wanted", 0)
    ]


def _note(note: str | Mapping[str, Any]) -> str:
    if isinstance(note, str):
        return note
    return ": ".join(str(note[key]) for key in ("what", "reason") if note.get(key))
