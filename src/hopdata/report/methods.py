"""The methods paragraph of a paper: what was done with this study, in its numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from hopdata.arrays import Shown, pd
from hopdata.errors import counted, with_names
from hopdata.feet import foot_names
from hopdata.foreign.working_folder import is_own
from hopdata.messages import Message
from hopdata.report.formatting import records, significant
from hopdata.report.inputs import ReportInputs, count_feet, joined_feet
from hopdata.report.tables import NO_FOOT_LANDED, excluded
from hopdata.report.verdict import measured, notes_of, step_like_jump

BIBTEX = Path(__file__).with_name("references.bib")
# Packages whose versions a paper states.
STATED = ("numpy", "scipy", "numba", "snakemake")
# A method that finds the contacts -> how it is said.
FOUND_BY = {
    "kink": "report.methods_by_kink",
    "velocity_minimum": "report.methods_by_minimum",
    "velocity_minimum_parabola": "report.methods_by_minimum",
}
# A method that finds the states at the sections -> how it is said.
STATES_BY = {
    "split_fit": "report.methods_split_fit",
    "savitzky_golay": "report.methods_savitzky_golay",
}
# Sources of contacts that are onsets of force.
OF_FORCES = ("forces", "plates")
# Reasons that are told one by one; the others are counted together.
MOST_REASONS = 5
# Key of the reference to hopdata itself, which the text names by its version.
ITSELF = "hopdata"
# What is compared if there are many feet.
PAIRS_OF_FEET = "maps.pairs_of_feet"
# What the interval of a difference leaves open, if saturation is not found.
MAY_BE_LARGER = "maps.may_be_larger"

# A note that successive landings err alike.
ERR_ALIKE = "maps.err_alike"
# A size -> what a smooth map may leave of it.
ALLOWED_OF = {
    "effect": "report.methods_allowed_of_bends",
    "jump": "report.methods_allowed_of_jumps",
}

# How each is cited in the text, by its key among the references.
CITED = {
    "burden2016": "Burden et al. 2016",
    "hemerik2020": "Hemerik et al. 2020",
    "westfall1993": "Westfall and Young 1993",
    "patterson1971": "Patterson and Thompson 1971",
    "carroll2006": "Carroll et al. 2006",
    "numpy": "Harris et al. 2020",
    "scipy": "Virtanen et al. 2020",
    "numba": "Lam et al. 2015",
    "snakemake": "Mölder et al. 2021",
}


@dataclass(frozen=True, repr=False)
class Methods(Shown):
    """A methods paragraph.

    Attributes
    ----------
    text
        Plain sentences with the numbers of the study.
    bibtex
        The references that it cites, as BibTeX.
    """

    text: str
    bibtex: str

    def _told(self) -> str:
        """Return paragraph and references, ready to copy."""
        return f"{self.text}\n\n{self.bibtex}".rstrip("\n")

    def __repr__(self) -> str:
        return self._told()

    def _repr_html_(self) -> str:
        return f"<p>{escape(self.text)}</p><pre>{escape(self.bibtex)}</pre>"


def methods(inputs: ReportInputs, facts: Mapping[str, Any]) -> Methods:
    """Return the methods paragraph of a study.

    Parameters
    ----------
    inputs : ReportInputs
        Tables and records of the study; what is not known is left out.
    facts : mapping
        From `hopdata.report.page.study_facts`.
    """
    record = inputs.provenance or {}
    config = record.get("config") or {}
    parts = [
        _of_recordings(inputs, facts, config),
        _of_gaps(inputs),
        _of_floor(inputs, config),
        *_of_contacts(inputs, facts),
        *_of_landings(inputs, facts),
        *_of_sections(inputs, facts, config),
        *_of_verdict(inputs.verdict or {}),
        _of_software(record),
    ]
    text = " ".join(str(part) for part in parts if part)
    version = (record.get("versions") or {}).get("hopdata")
    return Methods(text.replace("\u00a0", " "), references(text, CITED, version))


def references(text: str, cited: Mapping[str, str], version: str | None) -> str:
    """Return the references that a text cites, and hopdata itself, as BibTeX.

    Parameters
    ----------
    text : str
        The text.
    cited : mapping
        How each reference is cited in a text, by its key.
    version : str, optional
        That of hopdata, if it is known.
    """
    entries = BIBTEX.read_text(encoding="utf-8").split("\n@")
    every = [entries[0], *(f"@{one}" for one in entries[1:])]
    found = []
    for entry in every:
        key = entry.partition("{")[2].partition(",")[0]
        if key == ITSELF or (key in cited and cited[key] in text):
            found.append(entry.strip())
    of_version = f"  version = {{{version}}},\n" if version else ""
    return "\n".join(found).replace("  version = {},\n", of_version) + "\n"


def _of_recordings(
    inputs: ReportInputs, facts: Mapping[str, Any], config: Mapping[str, Any]
) -> Message | None:
    """Say what was recorded, or simulated, and of which markers."""
    recordings = inputs.recordings
    rates = sorted({one["rate_hz"] for one in recordings if one.get("rate_hz")})
    if not rates or not facts["n_frames"]:
        return None
    one = recordings[0]
    markers = config.get("markers") or {}
    values = {
        "recordings": counted(facts["n_recordings"], "recording"),
        "frames": f"{facts['n_frames']:,}",
        "rate": " and ".join(f"{rate:g}" for rate in rates),
        "body": _counted_names(one.get("n_body"), markers.get("body")),
        "feet": _feet(one, inputs),
    }
    if not facts["simulated"]:
        return Message("report.methods_recordings", values)
    entries = config.get("recordings") or [{}]
    if any(entry.get("file") for entry in entries) or "simulation" not in config:
        return Message("report.methods_simulated", values)
    scene = str(config["simulation"].get("scene"))
    of_hopdata = "" if is_own(scene) else " of hopdata"
    values["scene"] = f"scene {scene}{of_hopdata}"
    cameras = config["motion_capture"]
    values["noise"] = f"{1e3 * cameras['noise_m']:.2g}"
    values["noise_of"] = cameras["noise_of"]
    return Message("report.methods_scene", values)


def _feet(recording: Mapping[str, Any], inputs: ReportInputs) -> Message:
    """Name the feet, and of each the markers if some feet have several."""
    names = foot_names(_columns(inputs))
    joined = joined_feet(inputs.provenance)
    number = count_feet(recording, inputs.provenance)
    if not joined:
        values = {"feet": _counted_names(number, names)}
        return Message("report.methods_feet", values)
    own = {name: (name,) for name in names} | joined
    listed = [f"{foot} ({', '.join(markers)})" for foot, markers in own.items()]
    values = {"count": "1 foot" if number == 1 else f"{number} feet"}
    values["feet"] = ", ".join(listed)
    return Message("report.methods_joined_feet", values)


def _columns(inputs: ReportInputs) -> Sequence[Any]:
    return () if inputs.touchdowns is None else tuple(inputs.touchdowns.columns)


def _counted_names(number: Any, names: Sequence[str] | None) -> str:
    """Return a number, and the names if they are as many."""
    if not names or len(names) != number:
        return str(number)
    return f"{number} ({', '.join(names)})"


def _of_gaps(inputs: ReportInputs) -> Message | None:
    """Say how many positions were filled in, and how many landings hang on them."""
    filled = inputs.filled
    if filled is None or filled.empty or not filled["filled"].sum():
        return None
    values = {
        "filled": f"{int(filled['filled'].sum()):,}",
        "missing": f"{int(filled['missing'].sum()):,}",
    }
    return Message("report.methods_filled", values)


def _of_floor(inputs: ReportInputs, config: Mapping[str, Any]) -> Message | None:
    """Say from what heights are measured."""
    degrees = sorted({one["degree"] for one in inputs.floors.values()})
    if degrees:
        values = {
            "degree": " to ".join(str(one) for one in {*degrees[:1], *degrees[-1:]})
        }
        return Message("report.methods_floor", values)
    if (config.get("floor") or {}).get("enabled") is False:
        return Message("report.methods_no_floor")
    return None


def _of_contacts(inputs: ReportInputs, facts: Mapping[str, Any]) -> list[Message]:
    """Say how the contacts were found, and how sure they are."""
    table = inputs.touchdowns
    if table is None or facts["n_used"] is None:
        return []
    said = [Message(FOUND_BY.get(str(facts["method"]), "report.methods_by_other"))]
    if facts["method"] == "kink" and joined_feet(inputs.provenance):
        said.append(Message("report.methods_first_marker"))
    used = table[~excluded(table)]
    alone_ms = _median_ms(used, "se_")
    common_ms = _median_ms(used, "common_")
    if alone_ms:
        errors = _range_of(alone_ms)
        code = "report.methods_errors_of_feet"
        if errors == _range_of(alone_ms[:1]):
            code = "report.methods_errors"
        said.append(Message(code, {"errors": errors}))
    if max(common_ms, default=0.0) > 0.0:
        values = {"errors": _range_of(common_ms)}
        said.append(Message("report.methods_common", values))
    return said + _of_forces(inputs)


def _of_forces(inputs: ReportInputs) -> list[Message]:
    """Say how contacts compare with onsets of force, if some are known."""
    summary = inputs.overlay.get("contact_overlay_summary")
    if summary is None or summary.empty:
        return []
    known = summary[summary["source"].isin(OF_FORCES) & summary["bias_s"].notna()]
    each = [_bias(row) for row in records(known)]
    if not each:
        return []
    listed = "; ".join(str(one) for one in each)
    return [Message("report.methods_beside_forces", {"each": listed})]


def _bias(row: Mapping[str, Any]) -> Message:
    """Return how late contacts are beside the onsets in one column of forces."""
    values = {
        "bias": f"{1e3 * row['bias_s']:+.1f}",
        "low": f"{1e3 * row['bias_low_s']:+.1f}",
        "high": f"{1e3 * row['bias_high_s']:+.1f}",
        "sd": f"{1e3 * row['robust_sd_s']:.1f}",
        "contacts": counted(int(row["n_matched"]), "contact"),
        "column": row["column"],
    }
    return Message("report.methods_bias", values)


def _median_ms(used: pd.DataFrame, kind: str) -> list[float]:
    """Return the median of an error of each foot, ms; feet without one are left out."""
    columns = [name for name in used.columns if name.startswith(kind)]
    medians = 1e3 * used[columns].median()
    return [float(one) for one in medians if one == one]


def _range_of(values: Sequence[float]) -> str:
    """Return the least and the largest of some values to two digits."""
    least = significant(min(values), 2)
    most = significant(max(values), 2)
    return least if least == most else f"{least} to {most}"


def _of_landings(inputs: ReportInputs, facts: Mapping[str, Any]) -> list[Message]:
    """Say which landings were used, why others were not, and how sure orders are."""
    if inputs.touchdowns is None or facts["n_used"] is None:
        return []
    values = {
        "descents": f"{facts['n_descents']:,}",
        "landings": f"{facts['n_landings']:,}",
        "used": f"{facts['n_used']:,}",
        "excluded": f"{facts['n_excluded']:,}",
        "reasons": _reasons(inputs.touchdowns),
    }
    said = []
    if facts["n_not_landed"]:
        said.append(Message("report.methods_descents", values))
    if facts["n_excluded"] == 0:
        said.append(Message("report.methods_landings_used", values))
    else:
        said.append(Message("report.methods_landings_excluded", values))
    if facts["n_used"]:
        said.append(_of_orders(inputs, facts))
        if facts["method"] == "kink":
            said.append(Message("report.methods_order_probability"))
    return said


def _reasons(touchdowns: pd.DataFrame) -> str:
    """Return the reasons of landings not used with their numbers, the rarest as one."""
    out = touchdowns[excluded(touchdowns)]
    out = out[out["reason"] != NO_FOOT_LANDED]
    reasons = out["reason"].astype(object).fillna("").replace("", "no reason given")
    named = [with_names(str(one), touchdowns) for one in reasons]
    counts = Counter(named).most_common()
    told = [f"{reason}: {number}" for reason, number in counts[:MOST_REASONS]]
    rest = sum(number for _, number in counts[MOST_REASONS:])
    if rest:
        told.append(f"other reasons: {rest}")
    return "; ".join(told)


def _of_orders(inputs: ReportInputs, facts: Mapping[str, Any]) -> Message:
    """Say how many orders occur, and how many landings leave theirs unsure."""
    table = inputs.touchdowns
    assert table is not None  # it has landings
    used = table[~excluded(table)]
    unsure = int((used["order_class"] == "ambiguous").sum())
    record = (inputs.provenance or {}).get("config") or {}
    number = facts["n_schedules"]
    values = {
        "orders": "one order" if number == 1 else f"{number} orders",
        "used": f"{facts['n_used']:,}",
        "unsure": f"{unsure:,}",
        "below": f"{(record.get('touchdowns') or {}).get('ambiguous_below', 0.9):g}",
    }
    if unsure:
        return Message("report.methods_orders_unsure", values)
    return Message("report.methods_orders", values)


def forward_of(config: Mapping[str, Any]) -> Message:
    """Return which way is forward in the home frame of a study."""
    markers = (config.get("home") or {}).get("marker")
    if not markers:
        return Message("report.forward_to_farthest")
    if isinstance(markers, str):
        markers = [markers]
    if len(markers) == 1:
        return Message("report.forward_to_one", {"marker": markers[0]})
    all_but_last = ", ".join(markers[:-1])
    listed = Message("report.pair", {"first": all_but_last, "second": markers[-1]})
    return Message("report.forward_between", {"markers": listed})


def _of_sections(
    inputs: ReportInputs, facts: Mapping[str, Any], config: Mapping[str, Any]
) -> list[Message]:
    """Say where states were taken, how these heights were chosen, and from what."""
    if not facts["pre"] or not facts["post"]:
        return []
    said = [
        Message(
            "report.methods_sections", {"pre": facts["pre"], "post": facts["post"]}
        ),
        forward_of(config),
    ]
    if facts["after_contacts"]:
        after = {"after": facts["after_contacts"]}
        said.insert(1, Message("report.methods_after_contacts", after))
    if facts["pre_given"] and facts["post_given"]:
        said.append(Message("report.methods_heights_given"))
    elif facts["printed_rule"]:
        said.append(Message("report.methods_heights_printed"))
    else:
        said.append(Message("report.methods_heights"))
    said += _of_early_contacts(inputs)
    by = (config.get("states") or {}).get("method")
    if by in STATES_BY:
        said.append(Message(STATES_BY[by]))
    return said


def _of_early_contacts(inputs: ReportInputs) -> list[Message]:
    """Say in how many landings a foot touched before the pre section."""
    table = inputs.touchdowns
    if table is None or "t_pre_s" not in table:
        return []
    used = table[~excluded(table)]
    instants = [name for name in table.columns if name.startswith("contact_")]
    early_s = used["t_pre_s"] - used[instants].min(axis=1)
    number = int((early_s > 0.0).sum())
    if not number:
        return []
    values = {
        "landings": counted(number, "landing"),
        "most": significant(1e3 * early_s.max(), 2),
    }
    return [Message("report.methods_early", values)]


def _of_verdict(verdict: Mapping[str, Any]) -> list[Message]:
    """Say how the answer was found; of a study without a size, that there is none."""
    if not verdict:
        return []
    effect = verdict.get("effect")
    jump_decides = verdict.get("decided_by") == "jump"
    if effect is None and not jump_decides:
        return [_not_judged(verdict)]
    known = verdict.get("n_landings") or 0
    n_fitted = verdict.get("n_window") or known
    counts: dict[str, Any] = {"landings": f"{known:,}", "fitted": f"{n_fitted:,}"}
    counts["far_off"] = _far_off(verdict)
    fitted = Message("report.methods_landings_all", counts)
    if n_fitted < known:
        fitted = Message("report.methods_landings_nearest", counts)
    values = {
        "flips": f"{verdict.get('flips') or 0:,}",
        "confidence": f"{100 * verdict['confidence']:g} %",
        "margin": f"{100 * verdict['margin']:g} %",
        "fitted": fitted,
        "landings": f"{known:,}",
        **CITED,
    }
    said = [Message("report.methods_map", values), _assumed(verdict)]
    if effect is not None and not jump_decides:
        pair = "report.methods_two_orders"
        mean = "report.methods_over_orders"
        what = verdict.get("messages", {}).get("compared") or {}
        if what.get("code") == PAIRS_OF_FEET:
            pair = "report.methods_two_feet"
            mean = "report.methods_over_landings"
        values["pair"] = Message(pair)
        values["mean"] = Message(mean)
        said.append(Message("report.methods_size", values))
    if verdict.get("jump"):
        said += _of_jump(verdict)
    said += _of_ends(verdict)
    if effect is not None and not jump_decides:
        said += _of_contact(verdict)
    answer = "report.methods_answer"
    if verdict.get("jump"):
        answer = "report.methods_answer_or_jump"
    said.append(Message(answer, values))
    said.append(measured())
    return said


def _assumed(verdict: Mapping[str, Any]) -> Message:
    """Say what the random signs assume of the errors of landings."""
    for note in notes_of(verdict):
        if note.code == ERR_ALIKE:
            return Message("report.methods_assumed_alike", note.values)
    return Message("report.methods_assumed")


def _of_jump(verdict: Mapping[str, Any]) -> list[Message]:
    """Say what the size of a jump is, and how its test and that of bends share."""
    said = [Message("report.methods_jump")]
    levels = verdict.get("levels") or {}
    if {"effect", "jump"} <= {*levels}:
        values = {
            "of_bends": _per_cent(levels["effect"]),
            "of_jumps": _per_cent(levels["jump"]),
            "level": _per_cent(1.0 - verdict["confidence"]),
        }
        said.append(Message("report.methods_levels", values))
    like_jump = step_like_jump(verdict)
    if like_jump is not None:
        said.append(like_jump)
    return said


def _of_ends(verdict: Mapping[str, Any]) -> list[Message]:
    """Say how the ends of an interval allow for what a smooth map may leave."""
    left = []
    for name, of_what in ALLOWED_OF.items():
        allowed = (verdict.get(name) or {}).get("allowed")
        if allowed is not None:
            values = {"size": f"{allowed:.3g}"}
            left.append(Message(of_what, values))
    if not left:
        return []
    each: Message = left[0]
    if len(left) > 1:
        each = Message("report.pair", {"first": left[0], "second": left[1]})
    return [Message("report.methods_ends", {"each": each})]


def _per_cent(share: float) -> str:
    return f"{significant(100 * share, 2)} %"


def _of_contact(verdict: Mapping[str, Any]) -> list[Message]:
    """Say what the interval of a difference leaves open at the simultaneous contact."""
    sentence = verdict.get("messages", {}).get("sentence") or {}
    reservation = sentence.get("values", {}).get("reservation") or {}
    if reservation.get("code") != MAY_BE_LARGER:
        return []
    return [Message.from_dict(reservation)]


def _far_off(verdict: Mapping[str, Any]) -> Message | str:
    """Say how many landings the verdict left out as far off; nothing if none."""
    rows = [len(some) for some in (verdict.get("gross_errors") or {}).values()]
    if not rows:
        return ""
    return Message("report.methods_far_off", {"count": f"{sum(rows):,}"})


def _not_judged(verdict: Mapping[str, Any]) -> Message:
    """Say that no maps were compared, and why."""
    so_far = verdict.get("preliminary") or {}
    orders = so_far.get("orders") or []
    known = verdict.get("n_landings") or 0
    few = known < so_far.get("least_landings", 0)
    values = {"landings": f"{known:,}", "least": so_far.get("least_landings")}
    if few and len(orders) == 1:
        return Message("report.methods_few_of_one_order", values)
    if few:
        return Message("report.methods_few", values)
    if len(orders) == 1:
        return Message("report.methods_one_order")
    return Message("report.methods_not_judged")


def _of_software(record: Mapping[str, Any]) -> Message | None:
    versions = record.get("versions") or {}
    if "hopdata" not in versions:
        return None
    others = [
        f"{name} {versions[name]}, {CITED[name]}" for name in STATED if name in versions
    ]
    values = {
        "version": versions["hopdata"],
        "others": "; ".join(others),
        "seed": (record.get("config") or {}).get("seed", 0),
    }
    return Message("report.methods_software", values)
