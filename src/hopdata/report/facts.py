"""The few numbers that the page opens with, and that captions may name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from hopdata.report.formatting import fixed, is_missing, significant, with_unit, words
from hopdata.report.inputs import ReportInputs
from hopdata.report.landing_tables import excluded
from hopdata.report.result_tables import KIND_NAMES, MODEL_NAMES
from hopdata.report.verdict import verdict_facts

NO_FOOT_LANDED = "no foot landed"  # the reason in the table of touchdowns


def two_decimals(value: Any) -> str:
    """Format a distance in rad."""
    return fixed(value, 2)


def study_facts(inputs: ReportInputs) -> dict[str, Any]:
    """Gather the facts of a study; every key is always there, None where it is not known.

    Returns
    -------
    dict
        Counts (int): ``n_recordings, n_frames``; ``n_descents`` of the body; ``n_landings``, those
        in which a foot of the study lands; ``n_not_landed``, the others; ``n_used`` of the
        landings and ``n_excluded``, the rest of them; ``n_schedules`` of those used;
        texts with units (``pre, post, travel, min_threshold, max_threshold, length_unit,
        time_unit, units, spread``), ``landings_only`` (sections made
        from the body's descents alone), ``medians`` of the fitted models (normalised) and
        ``distances`` (rad) by name, ``fitted`` and ``not_fitted`` as text, ``split``,
        ``labels_right`` by method (%), and ``study``.
    """
    return {
        "study": inputs.study,
        **_counts(inputs),
        **_heights(inputs.sections or {}),
        **_units(inputs.units or {}),
        **_models(inputs),
        "distances": _medians(inputs.distances, "kind", KIND_NAMES, two_decimals),
        "labels_right": _labels_right(inputs.truth or {}),
        "slopes": _by_name(inputs.truth or {}, "scaling_slope_"),
        "estimate_errors": _by_name(inputs.truth or {}, "map_estimate_error_"),
        "verdict": verdict_facts(inputs.verdict),
    }


def _counts(inputs: ReportInputs) -> dict[str, Any]:
    names = {str(item.get("name")) for item in inputs.recordings}
    frames = [item["n_frames"] for item in inputs.recordings if item.get("n_frames")]
    table = inputs.touchdowns
    counts: dict[str, Any] = dict.fromkeys(
        (
            "n_descents",
            "n_landings",
            "n_not_landed",
            "n_used",
            "n_excluded",
            "n_schedules",
            "spread",
        )
    )
    if table is not None:
        used = table[~excluded(table)]
        landings = int((table["reason"] != NO_FOOT_LANDED).sum())
        names |= set(table["recording"].astype(str))
        counts = {
            "n_descents": len(table),
            "n_landings": landings,
            "n_not_landed": len(table) - landings,
            "n_used": len(used),
            "n_excluded": landings - len(used),
            "n_schedules": int(used["schedule"].replace("", None).nunique()),
            "spread": _shown(used["spread_s"].median() if len(used) else None, 1e3, "ms"),
        }
    return {"n_recordings": len(names), "n_frames": sum(frames) or None, **counts}


def _heights(sections: Mapping[str, Any]) -> dict[str, str | bool | None]:
    pre, post = sections.get("pre_height_m"), sections.get("post_height_m")
    travel = None if is_missing(pre) or is_missing(post) else float(pre) - float(post)  # type: ignore[arg-type]
    return {
        "pre": _shown(pre, 1e3, "mm"),
        "post": _shown(post, 1e3, "mm"),
        "travel": _shown(travel, 1e3, "mm"),
        "min_threshold": _tenths_of_mm(sections.get("min_foot_threshold_m")),
        "landings_only": sections.get("frames") == "landings",
        "max_threshold": _tenths_of_mm(sections.get("max_foot_threshold_m")),
    }


def _units(units: Mapping[str, Any]) -> dict[str, str | None]:
    length = _shown(units.get("length_unit_m"), 1e3, "mm")
    time = _shown(units.get("time_unit_s"), 1e3, "ms")
    both = f"{length} and {time}" if length and time else None
    return {"length_unit": length, "time_unit": time, "units": both}


def _models(inputs: ReportInputs) -> dict[str, Any]:
    medians = _medians(inputs.prediction, "model", MODEL_NAMES)
    split = None
    if inputs.prediction is not None and {"n_train", "n_test"} <= set(inputs.prediction):
        rows = inputs.prediction[["n_train", "n_test"]].dropna().to_numpy()
        split = f"{rows[0][0]:.0f}/{rows[0][1]:.0f}" if len(rows) else None
    return {
        "medians": medians,
        "fitted": words([MODEL_NAMES[m] for m in MODEL_NAMES if medians[m] is not None]),
        "not_fitted": words([MODEL_NAMES[m] for m in MODEL_NAMES if medians[m] is None]),
        "split": split,
    }


def _medians(
    table: Any, column: str, names: Mapping[str, str], show: Callable[[Any], str] = significant
) -> dict[str, str | None]:
    found: dict[str, Any] = {}
    if table is not None:
        found = dict(zip(table[column].astype(str), table["median"], strict=True))
    return {name: None if is_missing(found.get(name)) else show(found[name]) for name in names}


def _labels_right(truth: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[str, str | None]]:
    """Right mode schedules by method, in per cent: of the touchdowns used, of all landings."""
    prefix, of_all = "labels_right_", "labels_right_of_all_"
    others = (of_all, "labels_right_unambiguous_")
    methods = [
        name.removeprefix(prefix)
        for name in truth
        if name.startswith(prefix) and not name.startswith(others)
    ]
    return {
        method.replace("_", " "): (share, _percent(truth.get(of_all + method)))
        for method in methods
        if (share := _percent(truth[prefix + method]))
    }


def _by_name(truth: Mapping[str, Mapping[str, Any]], prefix: str) -> dict[str, str]:
    """Entries whose names begin with the prefix, by the rest of their names."""
    return {
        name.removeprefix(prefix): fixed(entry["value"], 2)
        for name, entry in truth.items()
        if name.startswith(prefix) and not is_missing(entry.get("value"))
    }


def _percent(entry: Mapping[str, Any] | None) -> str | None:
    if entry is None or is_missing(entry.get("value")):
        return None
    return with_unit(f"{100 * entry['value']:.1f}", "%")


def _tenths_of_mm(height_m: Any) -> str | None:
    return None if is_missing(height_m) else with_unit(fixed(float(height_m) * 1e3, 1), "mm")


def _shown(value: Any, factor: float, unit: str) -> str | None:
    return None if is_missing(value) else with_unit(significant(float(value) * factor), unit)
