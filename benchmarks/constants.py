"""Constants of the code: where each comes from, and what it moves (docs/constants.md).

    python benchmarks/constants.py run [ROOM ...]    try each, larger and smaller; resume
    python benchmarks/constants.py page              write docs/constants.md

A constant that steers a detector, an estimate or the verdict has a comment above it with
a line ``#: Unit: ... Origin: ...``. The page is made from these comments. ``run`` makes
each 1.5 times larger and 1.5 times smaller in a copy of the package, and repeats three
studies: the bundled sample, its control, and the bundled runner (config/runner.yaml). The constants of a module are first changed all
together: if that moves nothing, none of them is tried alone. The run keeps one row a
constant, factor and study in ``benchmarks/last_run/constants.csv``; rows of constants
and code that have not changed are not made again.
"""

from __future__ import annotations

import argparse
import ast
import csv
import hashlib
import json
import os
import re
import select
import shutil
import signal
import sys
import traceback
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from importlib import import_module
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
FACTORS = {"x 1.5": 1.5, "/ 1.5": 1 / 1.5}
TIMEOUT_S = 300
# What a reader would see: a share of the landings, a part of the bound, the height of a
# section, and a third of the stated errors of the instants (0.3 ms; the runner, 3 ms).
SHARE = 0.01
PART = 0.05
SECTION_MM = 2.0
INSTANTS_MS = {"sample": 0.1, "control": 0.1, "runner": 1.0}
ORIGIN = re.compile(
    r"Unit: (?P<unit>.+?)\. Origin: (?P<origin>\w+)[:.]?\s*(?P<why>.*)", re.S
)
# What a study says that ended in an error: the error's name and its words.
ENDED = re.compile(r"[\w.]*Error: ")
# What names a place that has the number: a program, a test, a table or a page.
PLACE = re.compile(r"\.py\b|\.md\b|\.csv\b")
HEADER = (
    "| constant | value | unit | what it decides | origin | what it moves |",
    "|---|---|---|---|---|---|",
)
ORIGINS = ("derived", "table", "convention", "rounding", "measured", "chosen")
# Rooms whose constants a study reaches. Those of the integrator, the scenes and steering
# have tests and benchmarks of their own.
STUDIED = ("recordings", "landings", "maps")

# Modules beside the room of recordings whose constants the quality table shows.
OF_QUALITY = ("landings/stability.py", "landings/checks.py")
# Libraries that each study needs. They are imported once, and each study is a copy of
# this process in which hopdata itself is imported anew.
LIBRARIES = (
    *("numba", "pandas", "h5py", "jsonschema", "yaml", "matplotlib"),
    *("scipy.stats", "scipy.optimize", "scipy.interpolate", "scipy.signal"),
    *("sklearn.decomposition", "sklearn.metrics"),
)


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
    quality: str


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


def changed_source(
    source: str, changed: Constant | Sequence[Constant], factor: float
) -> str:
    """Return a module with constants multiplied; whole numbers stay whole."""
    if isinstance(changed, Constant):
        changed = [changed]
    names = {one.name for one in changed}
    lines = source.splitlines(keepends=True)
    # From the last to the first, so that line numbers stay true.
    for node in reversed(ast.parse(source).body):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        if not isinstance(target, ast.Name) or target.id not in names:
            continue
        value = node.value
        end = value.end_lineno or value.lineno
        before = lines[value.lineno - 1].encode()[: value.col_offset].decode()
        after = lines[end - 1].encode()[value.end_col_offset :].decode()
        product = scaled(value, ast.unparse(value), factor)
        if target.id.endswith("QUANTILES"):
            product = with_scaled_tails(ast.literal_eval(value), factor)
        lines[value.lineno - 1 : end] = [f"{before}{product}{after}"]
    return "".join(lines)


def with_scaled_tails(quantiles: Sequence[float], factor: float) -> str:
    """Return the text of quantiles whose distances from the nearer end are multiplied."""
    moved = []
    for quantile in quantiles:
        low = quantile * factor
        high = 1 - (1 - quantile) * factor
        moved.append(low if quantile < 0.5 else high)
    return repr(tuple(moved))


def scaled(value: ast.expr, text: str, factor: float) -> str:
    """Return the text of a multiplied number, or of a tuple of them."""
    if isinstance(value, ast.Tuple):
        each = [scaled(one, ast.unparse(one), factor) for one in value.elts]
        return f"({', '.join(each)},)"
    numbers = [one.value for one in ast.walk(value) if isinstance(one, ast.Constant)]
    names = [one for one in ast.walk(value) if isinstance(one, ast.Name)]
    if not names and all(isinstance(number, int) for number in numbers):
        return f"max(round(({text}) * {factor!r}), 1)"
    return f"({text}) * {factor!r}"


def study_with(config: str, with_quality: bool) -> dict[str, object] | str:
    """Run a study by the copy of the package; return its numbers, or the error."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        with os.fdopen(writing, "w", encoding="utf-8") as pipe:
            pipe.write(told_by_child(config, with_quality))
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, encoding="utf-8") as pipe:
        ready, _, _ = select.select([pipe], [], [], TIMEOUT_S)
        if not ready:
            os.kill(child, signal.SIGKILL)
        told = pipe.read()
    os.waitpid(child, 0)
    if not told:
        return "no end"
    found: dict[str, object] | str = json.loads(told)
    return found


def told_by_child(config: str, with_quality: bool) -> str:
    """Return as JSON what a study finds, or the last line of its error."""
    sys.path.insert(0, str(COPY))
    try:
        return json.dumps(numbers_of(config, with_quality))
    except BaseException:
        return json.dumps(traceback.format_exc().strip().splitlines()[-1][:200])


def numbers_of(config: str, with_quality: bool) -> dict[str, object]:
    """Return the numbers of a study that a constant may move."""
    import hopdata as hd

    study = hd.study(config)
    verdict = study.verdict
    touchdowns = study.touchdowns
    used = touchdowns[touchdowns["reason"] == ""]
    instants = used.filter(regex="^contact_").to_numpy(float)
    effect = verdict.effect
    numbers = {
        "pre_m": study.sections.pre_height_m,
        "post_m": study.sections.post_height_m,
        "n_used": len(used),
        "instants_s": np.nan_to_num(instants).tolist(),
        "conclusion": verdict.conclusion,
        "estimate": effect.estimate if effect else None,
        "bound": effect.upper_bound if effect else None,
        "quality": [],
    }
    if with_quality:
        table = study.quality.map(str)
        numbers["quality"] = table.agg(" ".join, axis=1).tolist()
    return numbers


def difference(
    found: dict[str, object] | str, base: dict[str, object]
) -> dict[str, str]:
    """Return what a study says beside what it said with the constants as they are."""
    if isinstance(found, str):
        return {
            **dict.fromkeys(named("conclusion", "quality"), ""),
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
    told["quality"] = str(rows_that_differ(found["quality"], base["quality"]))
    return told


def rows_that_differ(found: object, before: object) -> int:
    """Count the rows of a quality table that say something else than before."""
    assert isinstance(found, list)
    assert isinstance(before, list)
    if not found:  # not asked for
        return 0
    return len(set(before) - set(found)) + max(len(found) - len(before), 0)


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


def run(rooms: Iterable[str], matching: str, studies: Iterable[str]) -> None:
    """Try every constant of the rooms in the studies; what is known is not tried again."""
    for library in LIBRARIES:
        import_module(library)
    # One thread a study, whatever the machine has.
    import_module("threadpoolctl").threadpool_limits(1)
    shutil.rmtree(COPY, ignore_errors=True)
    shutil.copytree(PACKAGE, COPY / "hopdata", symlinks=True)
    base = {}
    for study in studies:
        found = study_with(STUDIES[study], with_quality=True)
        if isinstance(found, str):
            print(f"{study}: passed over: {found}")
        else:
            base[study] = found
    tried = [
        one
        for one in constants()
        if one.room in rooms and re.search(matching, one.name)
    ]
    for module, in_module in groupby(tried, key=lambda one: one.module):
        together = list(in_module)
        for label, factor in FACTORS.items():
            for study, before in base.items():
                try_module(module, together, Trial(study, label, factor, before))


@dataclass(frozen=True)
class Trial:
    """One study with constants changed by one factor, and what it says without."""

    study: str
    label: str
    factor: float
    before: dict[str, object]


def try_module(module: str, together: Sequence[Constant], trial: Trial) -> None:
    """Try a module's constants together and, if they move anything, each alone."""
    source = (PACKAGE / module).read_text("utf-8")
    digest = hashlib.sha256(source.encode()).hexdigest()[:12]
    known = {
        row.name
        for row in known_rows()
        if (row.module, row.factor, row.study, row.digest)
        == (module, trial.label, trial.study, digest)
    }
    left = [one for one in together if one.name not in known]
    if not left:
        return
    said = changed_study(module, left, trial)
    if not says_other(said, trial):
        keep_rows(
            [Moved(module, one.name, *trial_of(trial), digest, **said) for one in left]
        )
        return
    for one in left:
        if len(left) > 1:
            said = changed_study(module, [one], trial)
        keep_rows([Moved(module, one.name, *trial_of(trial), digest, **said)])


def trial_of(trial: Trial) -> tuple[str, str]:
    """Return the columns of the table that name a trial."""
    return trial.label, trial.study


def changed_study(
    module: str, changed: Sequence[Constant], trial: Trial
) -> dict[str, str]:
    """Return what a study says with constants of one module changed."""
    path = COPY / "hopdata" / module
    source = (PACKAGE / module).read_text("utf-8")
    path.write_text(changed_source(source, changed, trial.factor), "utf-8")
    with_quality = module.startswith("recordings/") or module in OF_QUALITY
    found = study_with(STUDIES[trial.study], with_quality)
    path.write_text(source, "utf-8")
    return difference(found, trial.before)


def says_other(said: dict[str, str], trial: Trial) -> bool:
    """Tell whether a study says anything else than with the constants as they are."""
    return said != difference(trial.before, trial.before)


def keep_rows(made: Sequence[Moved]) -> None:
    """Put rows in the table, in place of those of the same trials."""
    places = {(row.module, row.name, row.factor, row.study) for row in made}
    others = [
        row
        for row in known_rows()
        if (row.module, row.name, row.factor, row.study) not in places
    ]
    write_rows([*others, *made])
    for row in made:
        print(*asdict(row).values(), sep="  ", flush=True)


def page() -> str:
    """Return the page of all constants: a table a room, in which each module has a row."""
    rows = known_rows()
    text = [
        "# Constants",
        "",
        "After this page you know what each number of the code decides, where it comes from, and",
        "what it moves.",
        "",
        "The last column says what a value 1.5 times larger or smaller moves in the bundled",
        "sample, its control and a public recording of a runner. A dash: not tried; *impossible*:",
        "the study ends in an error. All numbers: `benchmarks/last_run/constants.csv`, made by",
        "`benchmarks/constants.py`.",
        "",
        "| origin | the number comes from |",
        "|---|---|",
        "| *derived* | other numbers, or a formula |",
        "| *table* | a published table |",
        "| *convention* | the field |",
        "| *rounding* | the rounding of floating-point numbers |",
        "| *measured* | what is stated beside it |",
        "| *chosen* | a plain choice |",
        "",
        *measured_where(),
        "",
        *summary(rows),
    ]
    usual = usual_of(rows)
    by_room = sorted(constants(), key=lambda one: one.room or "~")
    for room, in_room in groupby(by_room, key=lambda one: one.room):
        text += [f"## {room or 'Modules beside the rooms'}", "", *HEADER]
        for module, in_module in groupby(in_room, key=lambda one: one.module):
            text.append(f"| **{module}** |" + " |" * (HEADER[0].count("|") - 2))
            text += [table_row(one, rows, usual) for one in in_module]
        text.append("")
    return "\n".join(text).rstrip() + "\n"


def measured_where() -> list[str]:
    """Return how many of the measured numbers a program or page has."""
    measured = [one for one in constants() if one.origin == "measured"]
    named = sum(PLACE.search(one.why) is not None for one in measured)
    return [
        f"Of {len(measured)} measured numbers {named} name the benchmark, test, table or page that has the",
        "measurement. No program makes the others again.",
    ]


def summary(rows: Sequence[Moved]) -> list[str]:
    """Return the paragraphs on what constants move more than a reader would ignore."""
    usual = usual_of(rows)
    tried = {(row.module, row.name) for row in rows}
    moving = {(row.module, row.name) for row in rows if moves(row, usual[run_of(row)])}
    large: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if is_large(row, usual[run_of(row)]):
            words = f"{row.study} {row.factor}: {moves(row, usual[run_of(row)])}"
            large.setdefault((row.module, row.name), []).append(words)
    if not tried:
        return []
    text = [
        "## What moves an answer",
        "",
        *numbers_tried(rows),
        "",
        *baselines(usual),
        "",
        f"Of {len(tried)} numbers that were tried, {len(tried) - len(moving)} move nothing in",
        "these studies: they decide what is refused or noticed in less sound data, or how numbers",
        f"are rounded. {len(moving) - len(large)} move something that no reader would see. These",
        f"{len(large)} change a conclusion, or by more than is said the number of landings",
        f"({SHARE:.0%}), estimate or bound ({PART:.0%} of the bound), a section",
        f"({SECTION_MM:g} mm), or contact instants (rms; a third of their stated error).",
        "",
        "| constant | what it moves |",
        "|---|---|",
    ]
    for (module, name), words in large.items():
        text.append(f"| `{name}` ({module}) | {'; '.join(words)} |".replace("||", "|"))
    text.append("")
    return [*text, *impossible_values(rows)]


def impossible_values(rows: Iterable[Moved]) -> list[str]:
    """Return a table of the values with which no study runs; nothing if there are none."""
    found: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if is_impossible(row):
            words = f"{row.study} {row.factor}: {row.conclusion}"
            found.setdefault((row.module, row.name), []).append(words)
    if not found:
        return []
    text = [
        "With these values a study ends in an error. They count as moving nothing:",
        "",
        "| constant | what a study says |",
        "|---|---|",
    ]
    for (module, name), words in found.items():
        text.append(f"| `{name}` ({module}) | {'; '.join(words)} |")
    return [*text, ""]


def is_impossible(row: Moved) -> bool:
    """Tell whether a study ended in an error, so that nothing was measured."""
    return ENDED.match(row.conclusion) is not None


def numbers_tried(rows: Iterable[Moved]) -> list[str]:
    """Return a line for each room: how many numbers were tried in which study."""
    places = {
        (row.module.split("/")[0], row.study, row.module, row.name) for row in rows
    }
    counts = Counter((room, study) for room, study, _, _ in places)
    lines = []
    for room in sorted({room for room, _ in counts}):
        told = [f"{counts[room, study]} in the {study}" for study in STUDIES]
        lines.append(f"- Tried in `{room}`: {', '.join(told)}.")
    return lines


def baselines(usual: dict[tuple[str, str], dict[str, str]]) -> list[str]:
    """Return what the studies say with nothing changed: a row for each room and study.

    Rooms are run on different days, so a verdict that was changed in between says
    something else. A row that a constant moves is compared with its own room only.
    """
    text = [
        "Rooms were tried on different days, so each has a baseline:",
        "",
        "| room | study | landings | estimate | bound |",
        "|---|---|---|---|---|",
    ]
    for (room, study), said in sorted(usual.items()):
        numbers = [said[name] or "none" for name in ("n_used", "estimate", "bound")]
        text.append(f"| `{room}` | {study} | {' | '.join(numbers)} |")
    return text


def is_large(row: Moved, usual: dict[str, str]) -> bool:
    """Tell whether a changed constant moves more than a reader would ignore."""
    if is_impossible(row):
        return False
    if row.conclusion != usual["conclusion"]:
        return True
    if abs(int(row.n_used) / int(usual["n_used"]) - 1) > SHARE:
        return True
    if usual["bound"]:
        allowed = PART * float(usual["bound"])
        for name in ("estimate", "bound"):
            value = getattr(row, name)
            if not value or abs(float(value) - float(usual[name])) > allowed:
                return True
    sections = (abs(float(row.pre_mm)), abs(float(row.post_mm)))
    if max(sections) > SECTION_MM:
        return True
    instants = row.instants_ms
    return instants[0].isdigit() and float(instants) > INSTANTS_MS[row.study]


def run_of(row: Moved) -> tuple[str, str]:
    """Return the room and the study of a row, whose rows were made by one code.

    Each room is run by itself, and what studies say with nothing changed may be another
    when the next room is run.
    """
    return row.module.split("/")[0], row.study


def usual_of(rows: Iterable[Moved]) -> dict[tuple[str, str], dict[str, str]]:
    """Return what most rows of each run say: what it says with nothing changed."""
    of_run: dict[tuple[str, str], list[Moved]] = {}
    for row in rows:
        of_run.setdefault(run_of(row), []).append(row)
    usual = {}
    for run, in_run in of_run.items():
        usual[run] = {
            name: Counter(getattr(row, name) for row in in_run).most_common(1)[0][0]
            for name in ("conclusion", "n_used", "estimate", "bound")
        }
    return usual


def table_row(
    constant: Constant,
    rows: Iterable[Moved],
    usual: dict[tuple[str, str], dict[str, str]],
) -> str:
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
        told_of(constant, rows, usual),
    ]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def told_of(
    constant: Constant,
    rows: Iterable[Moved],
    usual: dict[tuple[str, str], dict[str, str]],
) -> str:
    """Return in a few words what a constant moves."""
    own = [r for r in rows if (r.module, r.name) == (constant.module, constant.name)]
    if not own:
        return "-"
    words = []
    for row in own:
        if is_impossible(row):
            words.append(f"{row.study} {row.factor}: impossible")
        moved = moves(row, usual[run_of(row)])
        if moved:
            words.append(f"{row.study} {row.factor}: {moved}")
    return "; ".join(words) or "nothing"


def moves(row: Moved, usual: dict[str, str]) -> str:
    """Return what differs from what a study says with nothing changed."""
    if is_impossible(row):
        return ""
    told = []
    for name in ("conclusion", "n_used", "estimate", "bound"):
        value = getattr(row, name)
        if value != usual[name]:
            label = name.replace("n_used", "landings")
            told.append(f"{label} {usual[name]} to {value or 'none'}")
    for name in ("pre_mm", "post_mm"):
        value = getattr(row, name)
        if value not in ("", "+0.000", "-0.000"):
            told.append(f"{name.removesuffix('_mm')} section {value} mm")
    if row.quality not in ("", "0"):
        told.append(f"{row.quality} rows of quality")
    if row.instants_ms == "other landings":
        told.append("other landings")
    elif row.instants_ms not in ("", "0.0000"):
        told.append(f"instants {row.instants_ms} ms")
    return ", ".join(told)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    tried = commands.add_parser("run", help="try each constant, larger and smaller")
    tried.add_argument("rooms", nargs="*", default=[*STUDIED])
    tried.add_argument("--name", default="", help="only names that match this pattern")
    tried.add_argument("--studies", nargs="+", choices=STUDIES, default=[*STUDIES])
    commands.add_parser("page", help="write docs/constants.md")
    asked = parser.parse_args()
    if asked.command == "run":
        run(asked.rooms, asked.name, asked.studies)
    else:
        PAGE.write_text(page(), "utf-8")


if __name__ == "__main__":
    main()
