"""The report: one HTML page that needs no other file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from hopdata.arrays import pd
from hopdata.feet import foot_names
from hopdata.messages import Message
from hopdata.notes import Note
from hopdata.report import formatting as show
from hopdata.report import tables, verdict, what_now
from hopdata.report.inputs import (
    ReportInputs,
    as_yaml,
    count_feet,
    placed_pictures,
    rendered,
)
from hopdata.report.language import require_language
from hopdata.report.losses import lost_for_how_they_came_down
from hopdata.report.methods import forward_of, methods
from hopdata.report.scene import landings_scene

# The key numbers at the top of the page, which captions may also use.

# Source of a recording that was simulated.
SIMULATION = "simulation"

# Cases of the scaling study other than the scene itself.
CONTROLS = ("coupling", "impulse", "delay", "study")


def study_facts(inputs: ReportInputs) -> dict[str, Any]:
    """Gather the facts of a study; every key is always present, None if unknown.

    Returns
    -------
    dict
        Counts (int): ``n_recordings, n_frames``; ``n_descents`` of the body;
        ``n_landings``, those in which a foot of the study lands; ``n_not_landed``, the
        others; ``n_used`` of the landings and ``n_excluded``, the rest of them;
        ``after_contacts``, from the last contact to the post section (median);
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
        forces; ``mainly``, which orders differ most or surest, in words;
        ``feet``, their names with their numbers. ``simulated``, whether the
        recordings are of a simulation; ``noise_left``, the share of the noise that
        the corrected map allows for, if it is not all. ``forward``, which way that is
        in the home frame.
    """
    truth = inputs.truth or {}
    slopes = _by_name(truth, "scaling_slope_")
    scenes = [case for case in slopes if case not in CONTROLS]
    rad = partial(show.fixed, decimals=2)
    return {
        "study": inputs.study,
        **_counts(inputs),
        **_heights(inputs.sections or {}),
        **_units(inputs.units or {}),
        **_models(inputs),
        "distances": _medians(
            inputs.distances, "kind", "median_distance", tables.KIND_NAMES, rad
        ),
        "labels_right": _labels_right(truth),
        "slopes": slopes,
        "scaling": {
            "scene": scenes[0] if scenes else None,
            "controls": len(slopes) - len(scenes),
        },
        "method": _method(inputs.touchdowns),
        "printed": _by_printed_methods(inputs.provenance),
        "has_forces": _has_forces(inputs.overlay),
        "estimate_errors": _by_name(truth, "map_estimate_error_"),
        "verdict": verdict.verdict_facts(inputs.verdict, inputs.truth),
        "one_or_own": verdict.one_or_own_facts(inputs.one_or_own, _feet(inputs)),
        "feet": _numbered(_feet(inputs)),
        "simulated": bool(truth) or inputs.simulated or _from_simulation(inputs),
        "mainly": str((inputs.verdict or {}).get("main_contrast") or ""),
        "noise_left": _noise_allowed_for(inputs.notes),
        "forward": str(forward_of((inputs.provenance or {}).get("config") or {})),
    }


def _noise_allowed_for(notes: Sequence[str | Mapping[str, Any]]) -> str | None:
    """Return the share of the noise that the corrected map allows for, if not all."""
    shares = [
        note["removed"]
        for note in notes
        if isinstance(note, Mapping) and "removed" in note
    ]
    if not shares:
        return None
    return show.with_unit(show.significant(100 * min(shares), 2), "%")


def _method(touchdowns: pd.DataFrame | None) -> str | None:
    """Return the method that found the contacts; None if it is not known."""
    if touchdowns is None or touchdowns.empty or "method" not in touchdowns:
        return None
    return str(touchdowns["method"].iloc[0])


def _from_simulation(inputs: ReportInputs) -> bool:
    """Return whether the source of all recordings is a simulation."""
    sources = [one.get("source") for one in inputs.recordings]
    return bool(sources) and all(one == SIMULATION for one in sources)


def _by_printed_methods(provenance: Mapping[str, Any] | None) -> bool:
    """Return whether one key set all methods of the dissertation."""
    config = (provenance or {}).get("config") or {}
    return config.get("printed") is True


def _has_forces(overlay: Mapping[str, pd.DataFrame]) -> bool:
    """Return whether contacts were compared with forces, of a plate or another file."""
    summary = overlay.get("contact_overlay_summary")
    if summary is None or summary.empty:
        return False
    return bool(summary["source"].isin(["forces", "plates"]).any())


def _counts(inputs: ReportInputs) -> dict[str, Any]:
    names = {str(item.get("name")) for item in inputs.recordings}
    n_frames = sum(item.get("n_frames") or 0 for item in inputs.recordings)
    counts: dict[str, Any] = {
        "n_recordings": len(names),
        "n_frames": n_frames or None,
        "n_descents": None,
        "n_landings": None,
        "n_not_landed": None,
        "n_used": None,
        "n_excluded": None,
        "n_schedules": None,
        "spread": None,
        "after_contacts": None,
    }
    table = inputs.touchdowns
    if table is None:
        return counts
    used = table[~tables.excluded(table)]
    n_landings = int((table["reason"] != tables.NO_FOOT_LANDED).sum())
    counts["n_recordings"] = len(names | set(table["recording"].astype(str)))
    counts["n_descents"] = len(table)
    counts["n_landings"] = n_landings
    counts["n_not_landed"] = len(table) - n_landings
    counts["n_used"] = len(used)
    counts["n_excluded"] = n_landings - len(used)
    counts["n_schedules"] = int(used["schedule"].replace("", None).nunique())
    if len(used):
        counts["spread"] = _shown(used["spread_s"].median(), 1e3, "ms")
        last_s = used.filter(regex="^contact_.*_s$").max(axis=1)
        after_s = (used["t_post_s"] - last_s).median()
        counts["after_contacts"] = _shown(after_s, 1e3, "ms")
    return counts


def _heights(sections: Mapping[str, Any]) -> dict[str, str | bool | None]:
    pre_m = show.scaled(sections.get("pre_height_m"), 1.0)
    post_m = show.scaled(sections.get("post_height_m"), 1.0)
    travel_m = None
    if pre_m is not None and post_m is not None:
        travel_m = pre_m - post_m
    lowest_m = sections.get("min_foot_threshold_m")
    highest_m = sections.get("max_foot_threshold_m")
    decided = sections.get("chosen_by") or {}
    held = sections.get("landing_shares") or {}
    beside = sections.get("other_rule") or {}
    return {
        "pre": _shown(pre_m, 1e3, "mm"),
        "post": _shown(post_m, 1e3, "mm"),
        "travel": _shown(travel_m, 1e3, "mm"),
        "min_threshold": _shown(lowest_m, 1e3, "mm", decimals=1),
        "max_threshold": _shown(highest_m, 1e3, "mm", decimals=1),
        "landings_only": sections.get("frames") == "landings",
        "printed_rule": sections.get("rule") == "printed",
        "pre_given": decided.get("pre_height_m") == "config",
        "post_given": decided.get("post_height_m") == "config",
        "pre_held": _share_in_words(held.get("pre")),
        "post_held": _share_in_words(held.get("post")),
        "bandwidth": _shown(sections.get("bandwidth_m"), 1e3, "mm", decimals=1),
        "beside_pre": _shown(beside.get("pre_height_m"), 1e3, "mm"),
        "beside_post": _shown(beside.get("post_height_m"), 1e3, "mm"),
    }


def _share_in_words(share: float | None) -> str | None:
    """Write a share in whole per cent, rounded down, so that 100 % means all."""
    if share is None:
        return None
    return show.with_unit(str(math.floor(100 * share)), "%")


def _units(units: Mapping[str, Any]) -> dict[str, str | None]:
    length = _shown(units.get("length_unit_m"), 1e3, "mm")
    time = _shown(units.get("time_unit_s"), 1e3, "ms")
    if not length or not time:
        return {"units": None}
    return {"units": f"{length} and {time}"}


def _models(inputs: ReportInputs) -> dict[str, Any]:
    medians = _medians(inputs.prediction, "model", "median_mse", tables.MODEL_NAMES)
    fitted = []
    not_fitted = []
    for model, name in tables.MODEL_NAMES.items():
        if medians[model] is None:
            not_fitted.append(name)
        else:
            fitted.append(name)
    return {
        "medians": medians,
        "fitted": show.words(fitted),
        "not_fitted": show.words(not_fitted),
    }


def _medians(
    table: Any,
    by: str,
    column: str,
    names: Mapping[str, str],
    shown: Callable[..., str] = show.significant,
) -> dict[str, str | None]:
    """Return the median in a column by name, as text; None if it is missing."""
    found: dict[str, Any] = {}
    if table is not None:
        found = dict(zip(table[by].astype(str), table[column], strict=True))
    medians: dict[str, str | None] = {}
    for name in names:
        median = found.get(name)
        medians[name] = None if show.is_missing(median) else shown(median)
    return medians


def _labels_right(
    truth: Mapping[str, Mapping[str, Any]],
) -> dict[str, tuple[str, str | None]]:
    """Return correct mode schedules by method, %: of those used, of all landings."""
    prefix = "labels_right_"
    of_all = "labels_right_of_all_"
    others = (of_all, "labels_right_unambiguous_")
    shares = {}
    for name, entry in truth.items():
        if not name.startswith(prefix) or name.startswith(others):
            continue
        method = name.removeprefix(prefix)
        share = _percent(entry)
        if share:
            shares[method.replace("_", " ")] = (
                share,
                _percent(truth.get(of_all + method)),
            )
    return shares


def _by_name(truth: Mapping[str, Mapping[str, Any]], prefix: str) -> dict[str, str]:
    """Return the entries whose names begin with the prefix, by the rest of them."""
    found = {}
    for name, entry in truth.items():
        if name.startswith(prefix) and not show.is_missing(entry.get("value")):
            found[name.removeprefix(prefix)] = show.fixed(entry["value"], 2)
    return found


def _percent(entry: Mapping[str, Any] | None) -> str | None:
    return _shown((entry or {}).get("value"), 100, "%", decimals=1)


def _shown(
    value: Any, factor: float, unit: str, *, decimals: int | None = None
) -> str | None:
    """Format with the unit, to three digits or `decimals` decimals; None if missing."""
    number = show.scaled(value, factor)
    if number is None:
        return None
    if decimals is None:
        text = show.significant(number)
    else:
        text = show.fixed(number, decimals)
    return show.with_unit(text, unit)


GAPS = "recording_gaps"
# Figures and sections of two claims of the dissertation: neither tells a C1 map from
# another, so only a study by its methods shows them. The dissertation's page explains
# both.
PRINTED_CLAIMS = {"fig2_4_prediction", "fig2_5_distances"}
OF_PRINTED_CLAIMS = ("prediction", "distances")
#: Entries of ``truth.json`` about these figures.
OF_PRINTED_FIGURES = ("near_below_all_below_far", "random_clearance")
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
        If a caption names a fact that does not exist, or if nothing is translated to
        the language.
    """
    require_language(inputs.language)
    facts = study_facts(inputs)
    hidden = _empty(inputs)
    if not facts["printed"]:
        hidden |= PRINTED_CLAIMS
    shown = [one for one in inputs.figures if one.name not in hidden]
    known = inputs.verdict or {}
    return rendered(
        "report.html.j2",
        language=inputs.language,
        study=inputs.study,
        facts=facts,
        answer=verdict.answer(known),
        outlook=verdict.worded(known, "outlook"),
        mainly=verdict.worded(known, "main_contrast"),
        contacts=verdict.contacts_told(known),
        highlights=_highlights(facts, inputs),
        keys=_keys_of(facts, inputs),
        lights=tables.lights(inputs.quality),
        scene=landings_scene(inputs.levelled, inputs.touchdowns),
        pictures=placed_pictures(shown, facts, PLACES, "others"),
        all_seen=_all_seen(inputs),
        tables=_tables(inputs),
        notes=_notes(inputs),
        verdict_meaning=verdict.meaning(inputs.verdict),
        verdict_reach=verdict.reach(inputs.verdict),
        measured=verdict.measured(),
        methods=methods(inputs, facts),
        limits=what_now.limits(inputs.verdict, excluded=facts["n_excluded"]),
        headline=what_now.decisive(inputs.verdict),
        advice=what_now.further_advice(
            inputs.verdict,
            excluded=facts["n_excluded"] or 0,
            landings=facts["n_landings"] or 0,
        ),
        documentation=what_now.DOCUMENTATION,
        campaign=what_now.CAMPAIGN,
        distances_asked=inputs.distances_asked,
        verdict_notes=_verdict_notes(inputs),
        config=as_yaml(_configuration(inputs)),
        only_settings=inputs.settings is not None,
    )


def _verdict_notes(inputs: ReportInputs) -> list[str | Message]:
    """Return what limits the answer: the notes of the verdict, and lost landings."""
    known = inputs.verdict or {}
    notes = [_note(note) for note in verdict.further_notes(known)]
    lost = lost_for_how_they_came_down(inputs.touchdowns, known)
    if lost is not None:
        notes.append(lost)
    return notes


def _configuration(inputs: ReportInputs) -> Any:
    """Return the keys that the study sets or, if that is not known, all keys."""
    if inputs.settings is not None:
        return inputs.settings
    return (inputs.provenance or {}).get("config")


def _keys_of(facts: Mapping[str, Any], inputs: ReportInputs) -> list[Key]:
    """Return the key numbers whose sections this page has."""
    absent: set[str] = set()
    if not facts["printed"]:
        absent.update(OF_PRINTED_CLAIMS)
    if not inputs.truth:
        absent.add("truth")
    return [key for key in KEYS.values() if key.table not in absent]


def _empty(inputs: ReportInputs) -> set[str]:
    """Return the figures that would show nothing."""
    empty = set()
    if _all_seen(inputs):
        empty.add(GAPS)
    if inputs.one_or_own is None or inputs.one_or_own.empty:
        empty.add("one_or_own")
    if not verdict.verdict_facts(inputs.verdict)["found"]:
        empty.add("verdict_orders")
    return empty


def _all_seen(inputs: ReportInputs) -> bool:
    """Return whether there are neither gaps nor faults, so nothing to draw of them."""
    seen = [item.get("seen") == 1.0 for item in inputs.recordings]
    no_faults = inputs.faults is not None and inputs.faults.empty
    return bool(seen) and all(seen) and no_faults


@dataclass(frozen=True)
class Key:
    """What a key number is called, what it means, and where it is shown in full.

    Attributes
    ----------
    place
        Ending of the link to its explanation.
    name, means
        Its name and its meaning.
    table
        Section of the page that shows it in full.
    file
        File that holds it.
    """

    place: str
    name: Message
    means: Message
    table: str
    file: str


def _key(place: str, table: str, file: str, name: str = "") -> Key:
    title = Message(f"report.{name or place}")
    return Key(place, title, Message(f"report.{place}_means"), table, file)


#: Key numbers, in the order of the page.
KEYS = {
    key.place: key
    for key in (
        _key("difference", "verdict", "verdict.json"),
        _key("quality", "quality", "quality.json", "quality_of_the_data"),
        _key("recordings", "recordings", "tables/markers.csv"),
        _key("touchdowns", "excluded", "tables/touchdowns.csv", "used"),
        _key("orders", "touchdowns", "tables/touchdowns.csv"),
        _key("travel", "sections", "sections.json"),
        _key("units", "sections", "units.json"),
        _key("affine", "prediction", "tables/prediction_summary.csv"),
        _key("one", "prediction", "tables/prediction_summary.csv"),
        _key("right", "truth", "truth.json", "right_word"),
    )
}


@dataclass(frozen=True)
class Card:
    """A key number with its value and a remark; the value says so if it is unknown."""

    key: Key
    name: Message
    value: Message | str
    remark: Message | str = ""


def _card(
    place: str,
    value: str | None,
    remark: Message | str | None = None,
    name: Message | None = None,
) -> Card:
    known: Message | str = Message("report.not_known")
    if value not in (None, "", show.MISSING):
        known = str(value)
    key = KEYS[place]
    return Card(key, name or key.name, known, remark or "")


def _highlights(facts: Mapping[str, Any], inputs: ReportInputs) -> list[Card]:
    """Return the cards of the key numbers."""
    difference = facts["verdict"]["difference"]
    frames = None
    if facts["n_frames"]:
        frames = Message("report.frames", {"frames": show.count(facts["n_frames"])})
    between = None
    if facts["travel"]:
        between = _between_sections(facts)
    weigh = None
    if facts["units"]:
        weigh = Message("report.weigh_the_same")
    cards = [
        _card("difference", difference, verdict.remark(inputs.verdict, inputs.truth)),
        _card("quality", *tables.quality_summary(inputs.quality)),
        _card("recordings", show.count(facts["n_recordings"]), frames),
        _card("touchdowns", show.count(facts["n_used"]), _of_landings(facts)),
        _card(
            "orders", show.count(facts["n_schedules"]), _orders_remark(facts, inputs)
        ),
        _card("travel", facts["travel"], between),
        _card("units", facts["units"], weigh),
    ]
    if facts["printed"]:
        cards.append(_card("affine", *_gain(inputs.prediction)))
    if facts["printed"] and inputs.prediction is not None:
        cards.append(_card("one", *_price_of_one(inputs.prediction)))
    for method, (share, of_all) in facts["labels_right"].items():
        name = Message("report.right", {"method": method})
        remark = Message("report.right_of_used")
        if of_all:
            remark = Message("report.right_of_all", {"of_all": of_all})
        cards.append(_card("right", share, remark, name))
    return cards


def _between_sections(facts: Mapping[str, Any]) -> Message:
    """Say where the map begins and ends, and how long after the last contact."""
    heights = {"pre": facts["pre"], "post": facts["post"]}
    between = Message("report.between_sections", heights)
    if not facts["after_contacts"]:
        return between
    after = Message("report.after_contacts", {"after": facts["after_contacts"]})
    return Message("report.both", {"one": between, "other": after})


def _orders_remark(
    facts: Mapping[str, Any], inputs: ReportInputs
) -> Message | str | None:
    """Say how many orders are possible, and how far apart the contacts are."""
    counts = [count_feet(item, inputs.provenance) for item in inputs.recordings]
    feet = max((number or 0 for number in counts), default=0)
    number = show.count(math.factorial(feet))
    possible = Message("report.possible_orders", {"number": number})
    spread = Message("report.spread", {"spread": facts["spread"]})
    if feet > 1 and facts["spread"]:
        return Message("report.both", {"one": possible, "other": spread})
    if feet > 1:
        return possible
    if facts["spread"]:
        return spread
    return None


def _of_landings(facts: Mapping[str, Any]) -> Message | None:
    """Say how many landings there are, and how many further descents of the body."""
    if not facts["n_descents"]:
        return None
    counts = {
        "landings": show.count(facts["n_landings"]),
        "excluded": show.count(facts["n_excluded"]),
    }
    name = "of_one_landing" if facts["n_landings"] == 1 else "of_landings"
    found = Message(f"report.{name}", counts)
    if not facts["n_not_landed"]:
        return found
    values = {
        "landings": found,
        "others": show.count(facts["n_not_landed"]),
        "descents": show.count(facts["n_descents"]),
    }
    return Message("report.without_feet", values)


def _price_of_one(prediction: pd.DataFrame) -> tuple[str | None, Message]:
    """Return the error of the unspecialised affine model over that of the others."""
    ratio = _ratio(prediction, "all", "specialised")
    if ratio is None:
        return None, Message("report.one_absent")
    return show.significant(ratio, 3), Message("report.one_remark")


def _gain(prediction: pd.DataFrame | None) -> tuple[str | None, Message | None]:
    """Return the affine model's error over the mean's, specialised if fitted."""
    if prediction is None:
        return None, None
    ratio = _ratio(prediction, "specialised", "specialised_mean")
    if ratio is not None:
        return show.significant(ratio, 2), Message("report.affine_specialised")
    ratio = _ratio(prediction, "all", "mean")
    if ratio is not None:
        return show.significant(ratio, 2), Message("report.affine_all")
    return None, None


def _ratio(prediction: pd.DataFrame, model: str, other: str) -> float | None:
    models = prediction["model"].astype(str)
    medians = dict(zip(models, prediction["median_mse"], strict=True))
    one = medians.get(model, 0)
    two = medians.get(other, 0)
    if one > 0 and two > 0:
        return float(one / two)
    return None


def _tables(inputs: ReportInputs) -> dict[str, show.Table | None]:
    return {
        "quality": tables.quality_table(inputs.quality),
        "faults": tables.faults_table(inputs.faults),
        "remarks": tables.remarks_table(inputs.remarks),
        "excluded": tables.excluded_table(
            inputs.touchdowns,
            inputs.levelled,
            (inputs.verdict or {}).get("far_off") or (),
        ),
        "recordings": tables.recordings_table(inputs.recordings, inputs.provenance),
        "filled": tables.filled_table(inputs.filled, inputs.touchdowns),
        "floor": tables.floor_table(inputs.floors),
        "sections": tables.sections_table(
            inputs.sections, is_levelled=bool(inputs.floors)
        ),
        "schedules": tables.schedules_table(inputs.touchdowns),
        "lags": tables.study_lags_table(inputs.lags),
        "exclusions": tables.exclusions_table(inputs.touchdowns),
        "overlay": tables.agreement_table(inputs.overlay),
        "unmatched": tables.unmatched_table(inputs.overlay),
        "thresholds": tables.thresholds_table(inputs.overlay),
        "own_devices": tables.own_devices_table(inputs.overlay),
        "prediction": tables.prediction_table(inputs.prediction),
        "distances": tables.distances_table(inputs.distances),
        "orders": verdict.orders_table(inputs.verdict, _feet(inputs)),
        "one_or_own": verdict.one_or_own_table(
            inputs.one_or_own, _feet(inputs), inputs.verdict
        ),
        "truth": tables.truth_table(_truth_shown(inputs)),
        **tables.record_tables(inputs.provenance or {}),
    }


def _truth_shown(inputs: ReportInputs) -> dict[str, Any]:
    """Return what is known of the truth, of what this page shows."""
    truth = dict(inputs.truth or {})
    if not _by_printed_methods(inputs.provenance):
        for name in OF_PRINTED_FIGURES:
            truth.pop(name, None)
    return truth


def _feet(inputs: ReportInputs) -> tuple[str, ...]:
    """Return the names of the feet, as schedules number them."""
    if inputs.touchdowns is None:
        return ()
    return foot_names(inputs.touchdowns.columns)


def _numbered(feet: Sequence[str]) -> str:
    """Return feet with their numbers, ``1 toe, 2 heel``; empty if there are none."""
    return ", ".join(f"{number} {name}" for number, name in enumerate(feet, start=1))


def _floor_notes(floors: Mapping[str, Mapping[str, Any]]) -> Sequence[Message]:
    """Say which floor models have a lower degree than requested, and why."""
    notes = []
    for name, floor in floors.items():
        degree = floor.get("degree", 0)
        wanted = floor.get("degree_wanted", 0)
        if degree >= wanted:
            continue
        values = {"recording": name, "degree": degree, "wanted": wanted}
        if floor.get("note"):
            values["why"] = floor["note"]
            notes.append(Message("report.lower_degree_because", values))
        else:
            notes.append(Message("report.lower_degree", values))
    return notes


def _notes(inputs: ReportInputs) -> list[str | Message]:
    """Return what could not be done; what has one reason is told together."""
    of_reason: dict[str, list[str]] = {}
    others: list[str | Message] = []
    for one in inputs.notes:
        if isinstance(one, str | Message):
            others.append(one)
            continue
        note = Note.from_dict(one)
        if note.what and note.reason and not note.code:
            of_reason.setdefault(note.reason, []).append(note.what)
        else:
            others.append(_note(note))
    together = []
    for reason, about in of_reason.items():
        together.append(_note(Note("; ".join(about), reason)))
    return [*together, *others, *_floor_notes(inputs.floors)]


def _note(note: Note) -> str | Message:
    """Return a note in the words of its code, or in its own if it has none."""
    what = verdict.subject_of(note)
    reason = verdict.reason_of(note)
    if not what or not reason:
        return str(what or reason)
    return Message("report.note", {"what": what, "reason": reason})
