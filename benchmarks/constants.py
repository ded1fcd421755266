"""Constants of the code: where each comes from, and what it moves (docs/constants.md).

    python benchmarks/constants.py run [ROOM ...]    try each, larger and smaller; resume
    python benchmarks/constants.py page              write docs/constants.md

A constant that steers a detector, an estimate or the verdict has a comment above it with
a line ``#: Unit: ... Origin: ...``. The page is made from these comments. ``run`` makes
each 1.5 times larger and 1.5 times smaller in a copy of the package, and repeats three
studies: the bundled sample, its control, and a runner if the public recording is there
(config/runner.yaml says where from). It keeps one row a constant, factor and study in
``benchmarks/last_run/constants.csv``; rows of constants and code that have not changed
are not made again.
"""

from __future__ import annotations

import argparse
import ast
import csv
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from itertools import groupby
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "hopdata"
COPY = ROOT / "build" / "constants"
TABLE = ROOT / "benchmarks" / "last_run" / "constants.csv"
PAGE = ROOT / "docs" / "constants.md"
STUDIES = {
    "sample": "config/config.yaml",
    "control": "config/sample_control.yaml",
    "runner": "config/runner.yaml",
}
FACTOR = 1.5
TIMEOUT_S = 300
ORIGIN = re.compile(
    r"Unit: (?P<unit>.+?)\. Origin: (?P<origin>\w+)[:.]?\s*(?P<why>.*)", re.S
)
HEADER = (
    "| constant | value | unit | what it decides | origin | what it moves |",
    "|---|---|---|---|---|---|",
)
ORIGINS = ("derived", "table", "convention", "rounding", "measured", "chosen")
# Rooms whose constants a study reaches. Those of the integrator, the scenes and steering
# have tests and benchmarks of their own.
STUDIED = ("recordings", "landings", "maps")

# The study of the copy: its numbers, as JSON on the last line.
PROGRAM = """
import json, sys
import numpy as np
import hopdata as hd
study = hd.study(sys.argv[1])
verdict = study.verdict
touchdowns = study.touchdowns
used = touchdowns[touchdowns["reason"] == ""]
instants = used.filter(regex="^contact_").to_numpy(float)
sections = study.sections
effect = verdict.effect
print(json.dumps({
    "pre_m": sections.pre_height_m,
    "post_m": sections.post_height_m,
    "n_used": len(used),
    "instants_s": np.nan_to_num(instants).tolist(),
    "conclusion": verdict.conclusion,
    "estimate": effect.estimate if effect else None,
    "bound": effect.upper_bound if effect else None,
}))
"""


@dataclass(frozen=True)
class Constant:
    """A number of the code, with the comment above it.

    Attributes
    ----------
    module, name, line
        Where it stands: a path below ``src/hopdata``, and the line of its assignment.
    value
        The text of the assignment's right-hand side.
    decides, unit, origin, why
        The parts of the comment.
    """

    module: str
    name: str
    line: int
    value: str
    decides: str
    unit: str
    origin: str
    why: str

    @property
    def room(self) -> str:
        """The folder of the package that the module is in; empty for those beside them."""
        folders = Path(self.module).parent.parts
        return folders[0] if folders else ""


@dataclass(frozen=True)
class Moved:
    """What one study said with one constant changed."""

    module: str
    name: str
    factor: str
    study: str
    digest: str
    conclusion: str
    estimate: str
    bound: str
    n_used: str
    pre_mm: str
    post_mm: str
    instants_ms: str


def constants(package: Path = PACKAGE) -> Iterator[Constant]:
    """Yield the constants whose comment states unit and origin, in the code's order."""
    for path in sorted(package.rglob("*.py")):
        lines = path.read_text("utf-8").splitlines()
        for node in ast.parse("\n".join(lines)).body:
            if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
                continue
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            told = comment_above(lines, node.lineno - 1)
            stated = ORIGIN.search(told)
            if stated is None or not isinstance(targets[0], ast.Name):
                continue
            yield Constant(
                module=str(path.relative_to(package)),
                name=targets[0].id,
                line=node.lineno,
                value=ast.unparse(node.value),
                decides=told[: stated.start()].strip(),
                unit=stated["unit"],
                origin=stated["origin"],
                why=stated["why"].strip(),
            )


def comment_above(lines: list[str], row: int) -> str:
    """Return the comment of ``#:`` lines that ends above a line, as one text."""
    words: list[str] = []
    while row > 0 and lines[row - 1].startswith("#:"):
        row -= 1
        words.insert(0, lines[row].removeprefix("#:").strip())
    return " ".join(words)


def changed_source(source: str, constant: Constant, factor: float) -> str:
    """Return a module with one constant multiplied; whole numbers stay whole."""
    lines = source.splitlines(keepends=True)
    for node in ast.parse(source).body:
        if node.lineno == constant.line and isinstance(
            node, ast.Assign | ast.AnnAssign
        ):
            assert node.value is not None
            value = node.value
            end = value.end_lineno or value.lineno
            before = lines[value.lineno - 1].encode()[: value.col_offset].decode()
            after = lines[end - 1].encode()[value.end_col_offset :].decode()
            number = ast.get_source_segment(source, value)
            product = f"({number}) * {factor!r}"
            whole = isinstance(value, ast.Constant) and isinstance(value.value, int)
            if whole:
                product = f"max(round({product}), 1)"
            lines[value.lineno - 1 : end] = [f"{before}{product}{after}"]
    return "".join(lines)


def study_with(config: str) -> dict[str, object] | str:
    """Run a study by the copy of the package; return its numbers, or the error."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, config],
            cwd=ROOT,
            env={**environment(), "PYTHONPATH": str(COPY)},
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "no end"
    if done.returncode != 0:
        return done.stderr.strip().splitlines()[-1][:200]
    found: dict[str, object] = json.loads(done.stdout.splitlines()[-1])
    return found


def environment() -> dict[str, str]:
    """Return the environment of a study: one thread, whatever the machine has."""
    return {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def difference(
    found: dict[str, object] | str, base: dict[str, object]
) -> dict[str, str]:
    """Return what a study says beside what it said with the constants as they are."""
    if isinstance(found, str):
        return {
            **dict.fromkeys(named("conclusion", "instants_ms"), ""),
            "conclusion": found,
        }
    told = {"conclusion": str(found["conclusion"]), "n_used": str(found["n_used"])}
    for name in ("estimate", "bound"):
        value = found[name]
        told[name] = "" if value is None else f"{value:.4f}"
    for name in ("pre", "post"):
        shift = 1e3 * (float(str(found[f"{name}_m"])) - float(str(base[f"{name}_m"])))
        told[f"{name}_mm"] = f"{shift:+.3f}"
    instants, before = np.array(found["instants_s"]), np.array(base["instants_s"])
    told["instants_ms"] = "other landings"
    if instants.shape == before.shape and instants.size:
        told["instants_ms"] = f"{1e3 * np.sqrt(np.mean((instants - before) ** 2)):.4f}"
    return told


def named(first: str, last: str) -> list[str]:
    """Return the names of the columns of the table from one to another."""
    every = [one.name for one in fields(Moved)]
    return every[every.index(first) : every.index(last) + 1]


def known_rows() -> list[Moved]:
    """Return the rows made so far."""
    if not TABLE.exists():
        return []
    with TABLE.open(newline="", encoding="utf-8") as file:
        return [Moved(**row) for row in csv.DictReader(file)]


def write_rows(rows: Iterable[Moved]) -> None:
    """Write the table, whole."""
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    draft = TABLE.with_suffix(".part")
    with draft.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(
            file, [one.name for one in fields(Moved)], lineterminator="\n"
        )
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)
    draft.replace(TABLE)


def run(rooms: Iterable[str], matching: str) -> None:
    """Try every constant of the rooms in every study; what is known is not tried again."""
    shutil.copytree(PACKAGE, COPY / "hopdata", dirs_exist_ok=True, symlinks=True)
    base = {}
    for study, config in STUDIES.items():
        found = study_with(config)
        if isinstance(found, str):
            print(f"{study}: passed over: {found}")
        else:
            base[study] = found
    rows = known_rows()
    done = {(row.module, row.name, row.factor, row.study, row.digest) for row in rows}
    for constant in constants():
        if constant.room not in rooms or not re.search(matching, constant.name):
            continue
        path = COPY / "hopdata" / constant.module
        source = path.read_text("utf-8")
        digest = hashlib.sha256(source.encode()).hexdigest()[:12]
        for label, factor in (("x 1.5", FACTOR), ("/ 1.5", 1 / FACTOR)):
            path.write_text(changed_source(source, constant, factor), "utf-8")
            for study, before in base.items():
                if (constant.module, constant.name, label, study, digest) in done:
                    continue
                moved = difference(study_with(STUDIES[study]), before)
                row = Moved(
                    constant.module, constant.name, label, study, digest, **moved
                )
                place = (row.module, row.name, label, study)
                rows = [
                    r for r in rows if (r.module, r.name, r.factor, r.study) != place
                ]
                rows.append(row)
                write_rows(rows)
                print(*asdict(row).values(), sep="  ", flush=True)
        path.write_text(source, "utf-8")


def page() -> str:
    """Return the page of all constants: a section a room, a table a module."""
    rows = known_rows()
    text = [
        "# Constants",
        "",
        "Every number that steers a detector, an estimate or the verdict, as the comment above",
        "it states: what it decides, its unit and where it comes from. *Derived*: from other",
        "numbers or a formula. *Table*: from a published table. *Convention*: of the field.",
        "*Rounding*: of floating-point numbers. *Measured*: by the benchmark or test that is",
        "named. *Chosen*: a plain choice. The last column says what a value 1.5 times larger or",
        "smaller moves in the bundled sample, in its control and in a public recording of a",
        "runner (`benchmarks/constants.py`; all numbers: `benchmarks/last_run/constants.csv`).",
        "A dash: not tried. This page is written by `make docs` from the code.",
        "",
    ]
    by_room = sorted(constants(), key=lambda one: one.room or "~")
    for room, in_room in groupby(by_room, key=lambda one: one.room):
        text += [f"## {room or 'Modules beside the rooms'}", ""]
        for module, in_module in groupby(in_room, key=lambda one: one.module):
            text += [f"### {module}", "", *HEADER]
            text += [table_row(one, rows) for one in in_module]
            text.append("")
    return "\n".join(text).rstrip() + "\n"


def table_row(constant: Constant, rows: Iterable[Moved]) -> str:
    """Return a constant as a row of its module's table."""
    origin = constant.origin
    if constant.why:
        origin += f": {constant.why}"
    cells = [
        f"`{constant.name}`",
        f"`{constant.value}`",
        constant.unit,
        constant.decides,
        origin,
        told_of(constant, rows),
    ]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def told_of(constant: Constant, rows: Iterable[Moved]) -> str:
    """Return in a few words what a constant moves."""
    own = [r for r in rows if (r.module, r.name) == (constant.module, constant.name)]
    if not own:
        return "-"
    same: dict[str, list[Moved]] = {}
    for row in rows:
        same.setdefault(row.study, []).append(row)
    words = []
    for row in own:
        moved = moves(row, same[row.study])
        if moved:
            words.append(f"{row.study} {row.factor}: {moved}")
    return "; ".join(words) or "nothing"


def moves(row: Moved, others: Iterable[Moved]) -> str:
    """Return what differs from what most rows of the study say."""
    told = []
    for name in ("conclusion", "n_used", "estimate", "bound"):
        values = [getattr(other, name) for other in others]
        usual = max(set(values), key=values.count)
        value = getattr(row, name)
        if value != usual:
            told.append(f"{name.replace('n_used', 'landings')} {usual} to {value}")
    for name in ("pre_mm", "post_mm"):
        value = getattr(row, name)
        if value not in ("", "+0.000", "-0.000"):
            told.append(f"{name[:-3]} section {value} mm")
    if row.instants_ms not in ("", "0.0000"):
        told.append(
            f"instants {row.instants_ms} ms" if row.instants_ms[0].isdigit() else ""
        )
    return ", ".join(word for word in told if word)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    tried = commands.add_parser("run", help="try each constant, larger and smaller")
    tried.add_argument("rooms", nargs="*", default=[*STUDIED])
    tried.add_argument("--name", default="", help="only names that match this pattern")
    commands.add_parser("page", help="write docs/constants.md")
    asked = parser.parse_args()
    if asked.command == "run":
        run(asked.rooms, asked.name)
    else:
        PAGE.write_text(page(), "utf-8")


if __name__ == "__main__":
    main()
