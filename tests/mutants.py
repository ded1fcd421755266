"""Would the tests notice? Make small wrong changes, one at a time, and run the tests.

    python tests/mutants.py run [ROOM ...] --each 8 --seed 1     sample, test, resume
    python tests/mutants.py report                               what survived, as a table

The changes are those of cosmic-ray: another operator, another limit of a comparison, a
number that is one larger, `not` before a condition, a loop that does not run. Each room
of `ROOMS` gives as many as ``--each``, drawn with the seed from all that can be made in
its functions. A change is made in a copy of the committed and changed files, so the
checkout stays as it is. The test at the same path runs first; if it does not notice,
the tests of the room follow. Each result is one line of ``build/mutants/results.csv``;
a change whose file and tests are still the same is not tried again.

A survivor is read: either a test is missing, or the change is equivalent (it changes no
result). The reason for that is written into ``tests/equivalent_mutants.csv``.
"""

from __future__ import annotations

import argparse
import ast
import csv
import hashlib
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_item import MutationSpec, TestOutcome

ROOT = Path(__file__).parents[1]
WORK = ROOT / "build" / "mutants"
COPY = WORK / "checkout"
RESULTS = WORK / "results.csv"
EQUIVALENT = ROOT / "tests" / "equivalent_mutants.csv"
TIMEOUT_S = 600.0  # a mutant that loops for ever is caught, at the latest then
# Each room: the folder of its modules, whose tests are at the same path.
ROOMS = {
    "verdict": "maps/verdict",
    "maps": "maps",
    "contacts": "landings/contacts",
    "sections": "landings/sections",
    "states": "landings/states",
    "landings": "landings",
    "driver": "hybrid/driver",
    "readers": "recordings/readers",
    "quality": "recordings/quality",
    "checks": "commands",
}
# Swaps such as `+` for `>>` raise at once and say nothing about the tests.
OPERATORS = (
    *("core/ReplaceBinaryOperator_Add_Sub", "core/ReplaceBinaryOperator_Sub_Add"),
    *("core/ReplaceBinaryOperator_Mul_Div", "core/ReplaceBinaryOperator_Div_Mul"),
    *("core/ReplaceBinaryOperator_BitOr_BitAnd",),
    *("core/ReplaceBinaryOperator_BitAnd_BitOr",),
    *("core/ReplaceComparisonOperator_Lt_LtE", "core/ReplaceComparisonOperator_LtE_Lt"),
    *("core/ReplaceComparisonOperator_Gt_GtE", "core/ReplaceComparisonOperator_GtE_Gt"),
    *("core/ReplaceComparisonOperator_Lt_Gt", "core/ReplaceComparisonOperator_Gt_Lt"),
    *("core/ReplaceComparisonOperator_Eq_NotEq",),
    *("core/ReplaceComparisonOperator_NotEq_Eq",),
    *("core/ReplaceUnaryOperator_Delete_USub", "core/ReplaceUnaryOperator_Delete_Not"),
    *("core/ReplaceAndWithOr", "core/ReplaceOrWithAnd", "core/AddNot"),
    *("core/ReplaceTrueWithFalse", "core/ReplaceFalseWithTrue"),
    *("core/ReplaceBreakWithContinue", "core/ReplaceContinueWithBreak"),
    *("core/NumberReplacer", "core/ZeroIterationForLoop"),
)


@dataclass(frozen=True)
class Mutant:
    """One small wrong change.

    Attributes
    ----------
    room, module
        Where it is made; the module as a path below ``src/hopdata``.
    operator, occurrence
        What is changed: cosmic-ray's operator, and which of its places in the module.
    line
        Line of the change.
    digest
        Digest of the module and its tests, by which an old result is known.
    """

    room: str
    module: str
    operator: str
    occurrence: int
    line: int
    digest: str


@dataclass(frozen=True)
class Tried:
    """A mutant, and what became of it: ``killed``, ``survived`` or ``equivalent``."""

    room: str
    module: str
    operator: str
    occurrence: int
    line: int
    digest: str
    outcome: str
    seconds: float
    change: str


def modules_of(room: str) -> list[Path]:
    """Return the modules of a room, as paths below ``src/hopdata``."""
    package = ROOT / "src" / "hopdata"
    folder = package / ROOMS[room]
    others = [package / path for name, path in ROOMS.items() if name != room]
    inner = [other for other in others if folder in other.parents]
    found = []
    for path in sorted(folder.rglob("*.py")):
        belongs_to_another = any(other in path.parents for other in inner)
        if path.name != "__init__.py" and not belongs_to_another:
            found.append(path.relative_to(package))
    return found


def tests_of(module: Path) -> tuple[list[Path], list[Path]]:
    """Return the tests at the path of a module, and all tests of its folder."""
    folder = Path("tests") / module.parent
    same = [
        folder / f"test_{module.stem}.py",
        *sorted((ROOT / folder / module.stem).glob("test_*.py")),
    ]
    own = [path for path in same if (ROOT / path).is_file()]
    every = [path.relative_to(ROOT) for path in (ROOT / folder).glob("test_*.py")]
    return own, sorted(every)


def lines_in_functions(source: str) -> set[int]:
    """Return the numbers of the lines that run: bodies of functions without docstrings.

    Annotations and the arguments of decorators change no result.
    """
    lines: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            for statement in body:
                lines.update(range(statement.lineno, (statement.end_lineno or 0) + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.AnnAssign | ast.Raise):
            lines -= set(range(node.lineno, (node.end_lineno or 0) + 1))
    return lines


def candidates(room: str) -> Iterator[Mutant]:
    """Yield every change that can be made in the functions of a room."""
    for module in modules_of(room):
        path = ROOT / "src" / "hopdata" / module
        running = lines_in_functions(path.read_text("utf-8"))
        digest = digest_of(module)
        nodes = list(ast_nodes(get_ast_from_path(path)))
        for name in OPERATORS:
            operator = get_operator(name)()
            places = [
                place for node in nodes for place in operator.mutation_positions(node)
            ]
            for occurrence, (start, _) in enumerate(places):
                if start[0] in running:
                    yield Mutant(room, str(module), name, occurrence, start[0], digest)


def digest_of(module: Path) -> str:
    """Return a digest of a module and of the tests that may notice a change in it."""
    own, every = tests_of(module)
    digest = hashlib.sha256((ROOT / "src" / "hopdata" / module).read_bytes())
    for path in sorted({*own, *every}):
        digest.update((ROOT / path).read_bytes())
    return digest.hexdigest()[:12]


def sampled(room: str, each: int, seed: int) -> list[Mutant]:
    """Draw mutants of a room, first a module and then one of its changes.

    So that a long module does not hide the short ones.
    """
    draw = np.random.default_rng(np.random.SeedSequence([seed, *room.encode()]))
    by_module: dict[str, list[Mutant]] = {}
    for one in candidates(room):
        by_module.setdefault(one.module, []).append(one)
    chosen: list[Mutant] = []
    while by_module and len(chosen) < each:
        module = str(draw.choice(sorted(by_module)))
        waiting = by_module[module]
        chosen.append(waiting.pop(int(draw.integers(len(waiting)))))
        if not waiting:
            del by_module[module]
    return chosen


def copy_checkout() -> None:
    """Copy the files of the checkout, as they are now, to where they are changed."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    for name in listed.stdout.splitlines():
        source = ROOT / name
        target = COPY / name
        if not source.is_file():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.exists() or target.read_bytes() != source.read_bytes():
            shutil.copyfile(source, target)


def test_command(groups: Iterable[Iterable[Path]]) -> str:
    """Return the command that runs groups of tests in the copy, one after the other.

    The copy comes first on Python's path, before the package that is installed.
    """
    python = f"{shlex.quote(sys.executable)} -m pytest -q -x -n 0 -p no:cacheprovider"
    steps = [
        f"cd {shlex.quote(str(COPY))}",
        f"export PYTHONPATH={shlex.quote(str(COPY / 'src'))}",
    ]
    steps += [f"{python} {' '.join(map(str, tests))}" for tests in groups if tests]
    return f"sh -c {shlex.quote(' && '.join(steps))}"


def require_passing(room: str) -> None:
    """Refuse a room whose tests fail without a change: they would notice anything."""
    folders = {Path("tests") / module.parent for module in modules_of(room)}
    command = test_command([[*sorted(folders)]])
    if subprocess.run(shlex.split(command), check=False).returncode != 0:
        sys.exit(f"{room}: expected tests that pass in {COPY}, found a failure")


def try_one(mutant: Mutant) -> Tried:
    """Make one change in the copy, and run the tests that should notice."""
    path = COPY / "src" / "hopdata" / mutant.module
    spec = MutationSpec(path, mutant.operator, mutant.occurrence, (0, 0), (0, 1))
    begin = time.monotonic()
    command = test_command(tests_of(Path(mutant.module)))
    result = mutate_and_test([spec], command, TIMEOUT_S)
    outcome = "survived" if result.test_outcome is TestOutcome.SURVIVED else "killed"
    change = [
        line
        for line in (result.diff or "").splitlines()
        if line[:1] in "+-" and line[:3] not in ("+++", "---")
    ]
    seconds = round(time.monotonic() - begin, 1)
    return Tried(
        **asdict(mutant), outcome=outcome, seconds=seconds, change="\n".join(change)
    )


def known_results() -> list[Tried]:
    """Return what has been tried so far."""
    if not RESULTS.exists():
        return []
    with RESULTS.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return [
        Tried(
            **{
                **row,
                "occurrence": int(row["occurrence"]),
                "line": int(row["line"]),
                "seconds": float(row["seconds"]),
            }
        )
        for row in rows
    ]


def keep(result: Tried) -> None:
    """Add a result to the file."""
    RESULTS.parent.mkdir(parents=True, exist_ok=True)
    is_new = not RESULTS.exists()
    with RESULTS.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [one.name for one in fields(Tried)])
        if is_new:
            writer.writeheader()
        writer.writerow(asdict(result))


def run(rooms: Iterable[str], each: int, seed: int) -> None:
    """Try a sample of each room; what has been tried already is not tried again."""
    copy_checkout()
    tried = {identity(one) for one in known_results()}
    for room in rooms:
        sample = [
            one for one in sampled(room, each, seed) if identity(one) not in tried
        ]
        if sample:
            require_passing(room)
        for mutant in sample:
            result = try_one(mutant)
            keep(result)
            print(
                f"{result.outcome:9} {result.seconds:6.1f} s  {result.module}:{result.line}"
            )
            if result.outcome == "survived":
                print(result.change)


def identity(mutant: Mutant | Tried) -> tuple[str, str, int, str]:
    """Return what two entries of the same change have in common."""
    return mutant.module, mutant.operator, mutant.occurrence, mutant.digest


def equivalents() -> set[tuple[str, str]]:
    """Return the changes that were shown to change no result: module and change."""
    if not EQUIVALENT.exists():
        return set()
    with EQUIVALENT.open(newline="", encoding="utf-8") as file:
        return {(row["module"], row["change"]) for row in csv.DictReader(file)}


def report() -> int:
    """Print a table of the rooms and the survivors; return how many tests have missed."""
    same = equivalents()
    latest = {identity(one)[:3]: one for one in known_results()}
    rows: dict[str, list[Tried]] = {}
    for one in latest.values():
        rows.setdefault(one.room, []).append(one)
    missed = []
    print(f"{'room':10} {'tried':>6} {'killed':>7} {'equivalent':>11} {'survived':>9}")
    for room, results in rows.items():
        killed = [one for one in results if one.outcome == "killed"]
        left = [one for one in results if one.outcome == "survived"]
        unseen = [one for one in left if (one.module, one.change) not in same]
        missed += unseen
        n_same = len(left) - len(unseen)
        print(f"{room:10} {len(results):6} {len(killed):7} {n_same:11} {len(unseen):9}")
    for one in missed:
        print(f"\n{one.module}:{one.line}\n{one.change}")
    return len(missed)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    runs = commands.add_parser("run", help="try a sample")
    runs.add_argument("rooms", nargs="*", choices=[*ROOMS, []], default=[*ROOMS])
    runs.add_argument("--each", type=int, default=8, help="how many of each room")
    runs.add_argument("--seed", type=int, default=1)
    commands.add_parser("report", help="show what was found")
    asked = parser.parse_args()
    if asked.command == "run":
        run(asked.rooms, asked.each, asked.seed)
    report()


if __name__ == "__main__":
    main()
