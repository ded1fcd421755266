"""The table of samples of a group: who belongs to it, and the study of each member."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hopdata.errors import ConfigError, require
from hopdata.foreign.texts import text_of

#: Columns that the table must have.
NEEDED = ("subject", "file")
#: Columns with a meaning; the page of the group shows the others.
KNOWN = ("subject", "file", "recording", "session", "condition")
#: Columns whose cells are all filled or all empty.
ALL_OR_NONE = ("file", "condition")

# Columns that a message names; a table of one endless line would fill the terminal.
MOST_SHOWN = 20

#: Rows of a table of samples.
#: Unit: 1. Origin: chosen. 10,000 subjects with ten files each; they take 4 s.
MOST_ROWS = 100_000

#: Cells of a table of samples. A row may lack its last columns, so few bytes can ask
#: for many.
#: Unit: 1. Origin: chosen. 10,000 subjects with ten files each and 40 columns.
MOST_CELLS = 4_000_000


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
    from hopdata.maps.draws import named_generator

    given = read_yaml(config)
    is_group = isinstance(given, dict) and "samples" in given
    require(is_group, str(config), "a configuration with 'samples'", "another one")
    require("recordings" not in given, str(config), "samples or recordings", "both")
    # Pages show only SVG.
    content = {"figures": {"formats": ["svg"]}, **given}
    file = Path(str(content.pop("samples")))
    members = _members(file, content)
    # Report a mistake in the common part once, before any job starts.
    first = members[0]["config"]["recordings"]
    common = {**content, "recordings": first}
    whole = load_config(common, files=[config], check_files=False)
    named = {member["config"]["study"]: member for member in members}
    for name, member in named.items():
        generator = named_generator(whole["seed"], "group", name)
        member["config"]["seed"] = int(generator.integers(2**32))
        for column, texts in member["further"].items():
            # The values of all the member's files, each once.
            member["further"][column] = ", ".join(dict.fromkeys(filter(None, texts)))
    return {
        "study": whole["study"],
        "verdict": {key: whole["verdict"][key] for key in ("margin", "confidence")},
        "members": named,
    }


def _members(file: Path, content: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Gather the rows into members, in the order of their first rows."""
    from hopdata.jobs import study_name

    members: dict[str, dict[str, Any]] = {}
    first_lines: dict[Path, int] = {}
    for line, row in _rows(file).items():
        here = f"{file}, line {line}"
        subject = row["subject"]
        condition = row.get("condition", "")
        name = study_name("_".join(filter(None, (subject, condition))))
        # Some file systems do not distinguish upper and lower case.
        member = members.setdefault(
            name.casefold(), _new_member(name, subject, condition, content)
        )
        require(bool(subject), f"{here}: subject", "a name", "nothing")
        _require_same_names(here, member, subject, condition)
        _require_new_file(here, row["file"], line, first_lines)
        for column, text in row.items():
            if column not in KNOWN:
                member["further"].setdefault(column, []).append(text)
        recordings = member["config"]["recordings"]
        parts = filter(None, (row.get("session", ""), row.get("recording", "")))
        recording = "_".join(parts) or f"recording{len(recordings) + 1}"
        recordings.append({"name": study_name(recording), "file": row["file"] or None})
    return [*members.values()]


def _new_member(
    name: str, subject: str, condition: str, content: Mapping[str, Any]
) -> dict[str, Any]:
    return {
        "subject": subject,
        "condition": condition,
        "further": {},
        "config": {**content, "study": name, "recordings": []},
    }


def _require_same_names(
    here: str, member: Mapping[str, Any], subject: str, condition: str
) -> None:
    known = (member["subject"], member["condition"])
    own = (subject, condition)
    found = ", ".join(repr(" ".join(one).strip()) for one in (known, own))
    wanted = (
        "names that differ in more than case, accents and signs, as they name folders"
    )
    require(own == known, f"{here}: subject, condition", wanted, found)


def _require_new_file(
    here: str, file: str, line: int, first_lines: dict[Path, int]
) -> None:
    place = Path(file or f"simulated {line}")
    other = first_lines.setdefault(place, line)
    found = f"'{file}' in line {other} as well"
    require(line == other, f"{here}: file", "each file once", found)


def _rows(file: Path) -> dict[int, dict[str, str]]:
    """Return the rows by line number; lines that begin with # are skipped.

    All values are text.
    """
    cells = {
        line: _cells(f"{file}, line {line}", text)
        for line, text in _lines(file).items()
        if text.strip() and not text.startswith("#")
    }
    names = []
    if cells:
        names = cells.pop(min(cells))
    while names and not names[-1]:  # spreadsheets leave trailing tabs
        names.pop()
    complete = bool(cells) and {*NEEDED} <= {*names} and len({*names}) == len(names)
    wanted = (
        f"a row for each file, no column twice, and the columns {', '.join(NEEDED)}, "
    )
    wanted += "separated by tabs"
    shown = names[:MOST_SHOWN]
    if len(names) > MOST_SHOWN:
        shown.append(f"{len(names) - MOST_SHOWN} more")
    found = f"{len(cells)} rows of {', '.join(shown) or 'nothing'}"
    require(complete, f"samples: {file}", wanted, found)
    wanted = f"at most {MOST_ROWS:,} rows"
    require(len(cells) <= MOST_ROWS, f"samples: {file}", wanted, f"{len(cells):,}")
    n_cells = len(cells) * len(names)
    wanted = f"at most {MOST_CELLS:,} cells"
    require(n_cells <= MOST_CELLS, f"samples: {file}", wanted, f"{n_cells:,}")
    rows = {}
    wanted = f"the {len(names)} columns {', '.join(shown)}, separated by tabs"
    for line, row in cells.items():
        fits = len(row) > names.index("file") and not any(row[len(names) :])
        require(fits, f"{file}, line {line}", wanted, f"{len(row)}")
        empty = [""] * len(names)  # a row may lack its last columns
        rows[line] = dict(zip(names, row + empty, strict=False))
    for name in ALL_OR_NONE:
        without = [line for line, row in rows.items() if not row.get(name)]
        uniform = len(without) in (0, len(rows))
        place = f"{file}, line {min(without, default=0)}: {name}"
        require(uniform, place, "a value in each row or in none", "nothing")
    return rows


def _lines(file: Path) -> dict[int, str]:
    """Return the lines of a file by number, from 1."""
    text = text_of(
        file,
        wanted="a readable table, in UTF-8",
        place=f"samples: {file}",
    )
    return dict(enumerate(text.splitlines(), start=1))


def _cells(place: str, line: str) -> list[str]:
    """Split a line at its tabs; a tab in quotes belongs to its cell."""
    try:
        cells = next(csv.reader([line], delimiter="\t"))
    except csv.Error as error:
        wanted = (
            f"cells of at most {csv.field_size_limit():,} characters, separated by tabs"
        )
        raise ConfigError.at(place, wanted, str(error)) from None
    return [cell.strip() for cell in cells]
