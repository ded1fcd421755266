"""Studies of a group: a table lists the subjects, each gets its own study, one page shows all."""

import csv
import logging
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hopdata.arrays import pd
from hopdata.errors import AnalysisError, ConfigError, HopdataError, require

NEEDED, KNOWN = (
    ("subject", "file"),
    ("subject", "file", "recording", "session", "condition"),
)
logger = logging.getLogger("hopdata")


def read_group(config: str | Path) -> dict[str, Any]:
    """Read the configuration of a group and its table of samples.

    Parameters
    ----------
    config : path
        A study's configuration with ``samples``, a tab-separated table, in place of
        ``recordings``. The table has one row per file with the columns `subject`,
        `file` (empty: simulated) and any of `condition`, `session` and `recording`. The
        page shows further columns. Rows with the same subject and condition form one
        study.

    Returns
    -------
    dict
        ``study``, ``verdict`` (margin and confidence) and ``members``: name -> subject,
        condition, further columns and the configuration of the member's study. Its seed
        is derived from the group's seed and the member's name.

    Raises
    ------
    ConfigError
        If the configuration or the table is wrong.
    """
    from hopdata.config.loading import load_config, read_yaml
    from hopdata.jobs import study_name
    from hopdata.maps.draws import named_generator

    content = {
        "figures": {"formats": ["svg"]},
        **read_yaml(config),
    }  # pages show only SVG
    require("recordings" not in content, str(config), "samples or recordings", "both")
    file = Path(str(content.pop("samples")))
    members: dict[str, Any] = {}
    seen: dict[Path, int] = {}
    for line, row in _rows(file).items():
        who = row["subject"], row.get("condition", "")
        name = study_name("_".join(filter(None, who)))
        new: dict[str, Any] = {"subject": who[0], "condition": who[1], "further": {}}
        new["config"] = {**content, "study": name, "recordings": []}
        member = members.setdefault(name.casefold(), new)
        here, known = f"{file}, line {line}", (member["subject"], member["condition"])
        require(bool(row["subject"]), f"{here}: subject", "a name", "nothing")
        wanted = "names that differ in more than case, accents and signs, as they name folders"
        found = ", ".join(repr(" ".join(one).strip()) for one in (known, who))
        require(who == known, f"{here}: subject, condition", wanted, found)
        other = seen.setdefault(Path(row["file"] or f"simulated {line}"), line)
        found = f"'{row['file']}' in line {other} as well"
        require(line == other, f"{here}: file", "each file once", found)
        for key in (key for key in row if key not in KNOWN):
            member["further"].setdefault(key, []).append(row[key])
        recordings = member["config"]["recordings"]
        parts = (row.get("session", ""), row.get("recording", ""))
        recording = "_".join(filter(None, parts)) or f"recording{len(recordings) + 1}"
        recordings.append({"name": study_name(recording), "file": row["file"] or None})
    # Report a mistake in the common part once, before any job starts.
    first = next(iter(members.values()))["config"]["recordings"]
    whole = load_config(
        {**content, "recordings": first}, files=[config], check_files=False
    )
    named = {member["config"]["study"]: member for member in members.values()}
    for name, member in named.items():
        seed = named_generator(whole["seed"], "group", name).integers(2**32)
        member["config"]["seed"] = int(seed)
        for key, texts in member[
            "further"
        ].items():  # join the values of all the member's files
            member["further"][key] = ", ".join(dict.fromkeys(filter(None, texts)))
    return {
        "study": whole["study"],
        "verdict": {key: whole["verdict"][key] for key in ("margin", "confidence")},
        "members": named,
    }


def _rows(file: Path) -> dict[int, dict[str, str]]:
    """Return the rows of the table of samples by line number; lines that begin with # are skipped.

    All values are text.
    """
    try:
        lines = enumerate(file.read_text(encoding="utf-8-sig").splitlines(), start=1)
    except (OSError, UnicodeDecodeError) as error:
        found = str(getattr(error, "strerror", error))
        raise ConfigError.at(
            f"samples: {file}", "a readable table, in UTF-8", found
        ) from None
    cells = {
        line: _cells(f"{file}, line {line}", text)
        for line, text in lines
        if text.strip() and not text.startswith("#")
    }
    names = cells.pop(min(cells), []) if cells else []
    while names and not names[-1]:  # spreadsheets leave trailing tabs
        names.pop()
    found = f"{len(cells)} rows of {', '.join(names) or 'nothing'}"
    wanted = (
        f"a row for each file, no column twice, and the columns {', '.join(NEEDED)}"
    )
    fits = bool(cells) and {*NEEDED} <= {*names} and len({*names}) == len(names)
    require(fits, f"samples: {file}", f"{wanted}, separated by tabs", found)
    wanted = f"the {len(names)} columns {', '.join(names)}, separated by tabs"
    for line, row in cells.items():
        fits = len(row) > names.index("file") and not any(row[len(names) :])
        require(fits, f"{file}, line {line}", wanted, f"{len(row)}")
    empty = [""] * len(names)  # a row may lack its last columns
    rows = {
        line: dict(zip(names, row + empty, strict=False)) for line, row in cells.items()
    }
    for name in ("file", "condition"):
        without = [line for line, row in rows.items() if not row.get(name)]
        place = f"{file}, line {min(without, default=0)}: {name}"
        require(
            len(without) in (0, len(rows)),
            place,
            "a value in each row or in none",
            "nothing",
        )
    return rows


def _cells(place: str, line: str) -> list[str]:
    """Split a line of the table of samples at its tabs; a tab in quotes belongs to its cell."""
    try:
        cells = next(csv.reader([line], delimiter="\t"))
    except csv.Error as error:
        wanted = (
            f"cells of at most {csv.field_size_limit():,} characters, separated by tabs"
        )
        raise ConfigError.at(place, wanted, str(error)) from None
    return [cell.strip() for cell in cells]


def run_member(member: Mapping[str, Any], folder: Path) -> None:
    """Run the study of a member; write results, page and row (``member.json``) to `folder`.

    If the study has no answer, its row and its page give the reason. Only a lack of
    memory or disk space raises an error.
    """
    from hopdata.analysis import Study
    from hopdata.config.loading import load_config
    from hopdata.jobs import whole_file, write_json
    from hopdata.report.inputs import ReportInputs
    from hopdata.report.page import build_report

    row: dict[str, Any] = {
        key: member[key] for key in ("subject", "condition", "further")
    }
    name, reason = member["config"]["study"], ""
    try:
        study = Study(load_config(member["config"]))
        verdict = study.verdict
        if verdict.effect is None:
            reason = "; ".join(note["reason"] for note in verdict.notes)
        else:
            row |= asdict(verdict.effect)
        if verdict.jump and verdict.decided_by == "jump":
            row |= {f"jump_{key}": value for key, value in asdict(verdict.jump).items()}
        study.save(folder)
        drawn = (
            folder / "figures" if "svg" in study.config["figures"]["formats"] else None
        )
        study.report(folder / "report.html", drawn=drawn)
        checks = study.quality.to_dict("records")
        row |= {"conclusion": verdict.conclusion, "landings": verdict.n_landings}
        row |= {
            "landings_needed": verdict.landings_needed,
            "decided_by": verdict.decided_by,
        }
        row["quality"] = [[check["what"], check["status"]] for check in checks]
    except (OSError, MemoryError):
        raise
    except Exception as error:
        if not isinstance(error, HopdataError):
            logger.error("unexpected error\n%s", traceback.format_exc())
        kind = (
            ""
            if isinstance(error, HopdataError)
            else f"unexpected {type(error).__name__}: "
        )
        reason = kind + " ".join(str(error).split())
        page = build_report(ReportInputs(study=name, notes=[f"No answer: {reason}"]))
        with whole_file(folder / "report.html") as temporary:
            temporary.write_text(page, encoding="utf-8")
    write_json(folder / "member.json", {"name": name, **row, "reason": reason})


def put_together(
    rows: Sequence[Mapping[str, Any]], group: Mapping[str, Any]
) -> dict[str, Any]:
    """Combine the members' rows into the content of ``group.json``.

    Returns
    -------
    dict
        ``sentence``, ``conclusion``, ``effect`` (see `GroupVerdict`; None with a reason
        in the sentence), ``conditions`` (rows of `compare_conditions`) and ``members``.
    """
    from hopdata.maps.verdict.group import compare_conditions, judge_group, told_apart

    answered = pd.DataFrame([row for row in rows if not row["reason"]])
    found: dict[str, Any] = {
        "study": group["study"],
        "margin": group["verdict"]["margin"],
    }
    found |= {"members": list(rows), "conditions": []}
    try:
        if answered.empty:
            raise AnalysisError(
                f"no subject has an answer; the first: {rows[0]['reason']}"
            )
        if same := answered.loc[
            answered.duplicated("squared", keep=False), "subject"
        ].tolist():
            told = ", ".join(same)
            raise AnalysisError(
                f"expected different landings, found the same in: {told}"
            )
        effect = judge_group(answered, **group["verdict"])
    except AnalysisError as error:
        said = f"These data cannot tell: {error}."
        return {"conclusion": "cannot tell", "sentence": said, "effect": None, **found}
    sure = group["verdict"]["confidence"]
    conditions = compare_conditions(answered, confidence=sure)
    found["conditions"] = conditions.to_dict("records")
    left = f" Without an answer: {len(rows) - len(answered)} of {len(rows)} studies."
    said, jumps = effect.sentence, sum(row.get("decided_by") == "jump" for row in rows)
    said += f" The outcome jumps in {jumps} of them, which the size does not show." * (
        jumps > 0
    )
    said += left * (len(rows) > len(answered)) + told_apart(conditions, confidence=sure)
    return {
        "conclusion": effect.conclusion,
        "sentence": said,
        "effect": asdict(effect),
        **found,
    }
