"""Would the tests notice? Make small wrong changes, one at a time, and run the tests.

    python tests/mutants.py run [ROOM ...] --each 8 --seed 1     sample, test, resume
    python tests/mutants.py report                               what survived, as a table

The changes are those of cosmic-ray: another operator, another limit of a comparison, a
number that is one larger, `not` before a condition, a loop that does not run. Each room
of `ROOMS` gives as many as ``--each``, drawn with the seed from all that can be made in
its functions. A change is made in a copy of the committed and changed files, so the
checkout stays as it is. The test at the same path runs first; if it does not notice,
the other tests of its folder follow. Each result is one line of
``build/mutants/results.csv``, with the test that noticed, which must pass without the
change. A change is tried again if its module is another one since, and if it survived,
also if the tests are.

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
from functools import cache
from pathlib import Path

import numpy as np

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


Change = tuple[str, str]  # module, and the lines before and after


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
    digest, tests
        Digests of the module and of its tests, by which an old result is known.
    """

    room: str
    module: str
    operator: str
    occurrence: int
    line: int
    digest: str
    tests: str


@dataclass(frozen=True)
class Tried(Mutant):
    """A mutant, and what became of it.

    Attributes
    ----------
    outcome
        ``killed`` or ``survived``.
    noticed
        The test that failed, or what else ended the run; empty for a survivor.
    seconds
        How long its tests ran.
    change
        The lines before and after.
    """

    outcome: str
    noticed: str
    seconds: float
    change: str


def modules_of(room: str, checkout: Path) -> list[Path]:
    """Return the modules of a room, as paths below ``src/hopdata``."""
    package = checkout / "src" / "hopdata"
    folder = package / ROOMS[room]
    others = [package / path for name, path in ROOMS.items() if name != room]
    inner = [other for other in others if folder in other.parents]
    found = []
    for path in sorted(folder.rglob("*.py")):
        belongs_to_another = any(other in path.parents for other in inner)
        if path.name != "__init__.py" and not belongs_to_another:
            found.append(path.relative_to(package))
    return found


def paths_of_tests(module: Path, checkout: Path) -> tuple[list[Path], list[Path]]:
    """Return the tests at the path of a module, and the others of its folder.

    Of the others, those of a module with the beginning of its name are first, as those
    of `floor` are for `floor_motion`.
    """
    folder = checkout / "tests" / module.parent
    same = [
        folder / f"test_{module.stem}.py",
        *sorted((folder / module.stem).glob("test_*.py")),
    ]
    if module.parts[0] == "hybrid":  # its tests that need scenes
        same.append(checkout / "tests/scenes/hybrid" / f"test_{module.stem}.py")
    own = [path for path in same if path.is_file()]

    def is_distant(path: Path) -> bool:
        return not module.stem.startswith(path.stem.removeprefix("test_"))

    others = [path for path in sorted(folder.glob("test_*.py")) if path not in own]
    others.sort(key=is_distant)
    return (
        [path.relative_to(checkout) for path in own],
        [path.relative_to(checkout) for path in others],
    )


Place = tuple[int, int]  # line, counted from one, and column


def span(node: ast.stmt | ast.expr) -> tuple[Place, Place]:
    """Return where a node begins and ends."""
    end = (node.end_lineno or node.lineno, node.end_col_offset or node.col_offset)
    return (node.lineno, node.col_offset), end


def decides_nothing(node: ast.AST) -> bool:
    """Whether a statement only says something: raises an error, or writes a log."""
    if isinstance(node, ast.Raise):
        return True
    if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)):
        return False
    called = node.value.func
    return (
        isinstance(called, ast.Attribute)
        and isinstance(called.value, ast.Name)
        and called.value.id == "logger"
    )


class Running:
    """The places of a module at which a change may change a result.

    They are in the bodies of functions, but not in annotations and in the texts of
    errors and logs.
    """

    def __init__(self, source: str) -> None:
        self.inside: list[tuple[Place, Place]] = []
        self.outside: list[tuple[Place, Place]] = []
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.FunctionDef):
                self.inside += [span(statement) for statement in node.body]
                # A function in a function begins with a line of annotations.
                arguments = [*node.args.args, *node.args.kwonlyargs]
                annotations = [one.annotation for one in arguments]
                annotations.append(node.returns)
                self.outside += [span(one) for one in annotations if one is not None]
            elif isinstance(node, ast.AnnAssign):
                self.outside.append(span(node.annotation))
            elif isinstance(node, ast.stmt) and decides_nothing(node):
                self.outside.append(span(node))

    def __contains__(self, place: Place) -> bool:
        """Whether a change at a place may change a result."""
        is_inside = any(begin <= place < end for begin, end in self.inside)
        return is_inside and not any(
            begin <= place < end for begin, end in self.outside
        )


def candidates(room: str, checkout: Path) -> Iterator[Mutant]:
    """Yield every change that can be made in the functions of a room."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator

    for module in modules_of(room, checkout):
        source = (checkout / "src" / "hopdata" / module).read_text("utf-8")
        running = Running(source)
        own, others = paths_of_tests(module, checkout)
        digest = digest_of([checkout / "src" / "hopdata" / module])
        tests = digest_of([checkout / path for path in [*own, *others]])
        nodes = list(ast_nodes(get_ast(source)))
        for name in OPERATORS:
            operator = get_operator(name)()
            places = [
                place for node in nodes for place in operator.mutation_positions(node)
            ]
            for occurrence, (start, _) in enumerate(places):
                if start in running:
                    yield Mutant(
                        room=room,
                        module=str(module),
                        operator=name,
                        occurrence=occurrence,
                        line=start[0],
                        digest=digest,
                        tests=tests,
                    )


def digest_of(paths: Iterable[Path]) -> str:
    """Return a digest of the contents of files."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def sampled(room: str, each: int, seed: int, checkout: Path) -> list[Mutant]:
    """Draw mutants of a room, first a module and then one of its changes.

    So that a long module does not hide the short ones.
    """
    draw = np.random.default_rng(np.random.SeedSequence([seed, *room.encode()]))
    by_module: dict[str, list[Mutant]] = {}
    for one in candidates(room, checkout):
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
    names = set(listed.stdout.splitlines())
    for path in [*COPY.glob("src/**/*.py"), *COPY.glob("tests/**/*.py")]:
        if not (ROOT / path.relative_to(COPY)).exists():
            path.unlink()
    for name in sorted(names):
        source = ROOT / name
        target = COPY / name
        if not source.is_file():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.exists() or target.read_bytes() != source.read_bytes():
            shutil.copyfile(source, target)


def command_of(groups: Iterable[Iterable[str]]) -> str:
    """Return the command that runs groups of tests in the copy, one after the other.

    The copy comes first on Python's path, before the package that is installed.
    """
    python = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0"]
    python += ["-p", "no:cacheprovider"]
    steps = [
        shlex.join(["cd", str(COPY)]),
        f"export PYTHONPATH={shlex.quote(str(COPY / 'src'))}",
    ]
    steps += [shlex.join([*python, *tests]) for tests in groups if tests]
    return shlex.join(["sh", "-c", " && ".join(steps)])


@cache
def passes_unchanged(test: str) -> bool:
    """Whether a test passes in the copy without a change."""
    done = subprocess.run(
        shlex.split(command_of([[test]])), check=False, capture_output=True
    )
    return done.returncode == 0


def what_noticed(output: str) -> str:
    """Return the test that failed, from what pytest printed.

    A module that can no longer be imported is an ``ERROR`` of its test. Without either
    the process crashed or took too long, and the last line says what is known.
    """
    lines = output.splitlines() or [""]
    for line in lines:
        if line.startswith(("FAILED ", "ERROR ")):
            return line.partition(" ")[2].partition(" - ")[0]
    return lines[-1]


def try_one(mutant: Mutant) -> Tried:
    """Make one change in the copy, and run the tests that should notice."""
    from cosmic_ray.mutating import mutate_and_test
    from cosmic_ray.work_item import MutationSpec, TestOutcome

    path = COPY / "src" / "hopdata" / mutant.module
    spec = MutationSpec(path, mutant.operator, mutant.occurrence, (0, 0), (0, 1))
    begin = time.monotonic()
    groups = paths_of_tests(Path(mutant.module), COPY)
    command = command_of([[str(path) for path in group] for group in groups])
    result = mutate_and_test([spec], command, TIMEOUT_S)
    seconds = round(time.monotonic() - begin, 1)
    output = result.output or ""
    if result.test_outcome is TestOutcome.SURVIVED:
        outcome = "survived"
        noticed = ""
    elif result.test_outcome is TestOutcome.KILLED:
        outcome = "killed"
        noticed = what_noticed(output)
        if "::" in noticed and not passes_unchanged(noticed):
            sys.exit(f"expected a test that passes without a change, found {noticed}")
    else:
        sys.exit(f"{mutant}: expected a change and its tests, found\n{output}")
    change = [
        line
        for line in (result.diff or "").splitlines()
        if line[:1] in "+-" and line[:3] not in ("+++", "---")
    ]
    return Tried(
        **asdict(mutant),
        outcome=outcome,
        noticed=noticed,
        seconds=seconds,
        change="\n".join(change),
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


def is_known(mutant: Mutant, results: Iterable[Tried], same: set[Change]) -> bool:
    """Whether it is already known what becomes of a change.

    New tests cannot bring back what was killed, nor notice what changes no result, so
    only the other survivors are tried again after the tests have changed.
    """
    for one in results:
        if identity(one) == identity(mutant) and (
            one.outcome == "killed"
            or one.tests == mutant.tests
            or (one.module, one.change) in same
        ):
            return True
    return False


def run(rooms: Iterable[str], each: int, seed: int) -> None:
    """Try a sample of each room; what has been tried already is not tried again."""
    copy_checkout()
    for room in rooms:
        results = known_results()
        drawn = sampled(room, each, seed, COPY)
        sample = [one for one in drawn if not is_known(one, results, equivalents())]
        for mutant in sample:
            result = try_one(mutant)
            keep(result)
            place = f"{result.module}:{result.line}"
            print(
                f"{result.outcome:9} {result.seconds:6.1f} s  {place}  {result.noticed}"
            )
            if result.outcome == "survived":
                print(result.change)


def identity(mutant: Mutant) -> tuple[str, str, int, str]:
    """Return what two entries of the same change have in common."""
    return mutant.module, mutant.operator, mutant.occurrence, mutant.digest


def equivalents() -> set[Change]:
    """Return the changes that were shown to change no result: module and change."""
    if not EQUIVALENT.exists():
        return set()
    with EQUIVALENT.open(newline="", encoding="utf-8") as file:
        return {(row["module"], row["change"]) for row in csv.DictReader(file)}


def of_this_checkout(results: Iterable[Tried]) -> list[Tried]:
    """Return the last result of each change, of modules that are still the same."""
    last: dict[tuple[str, str, int, str], Tried] = {}
    for one in results:
        path = ROOT / "src" / "hopdata" / one.module
        if path.is_file() and digest_of([path]) == one.digest:
            last[identity(one)] = one
    return list(last.values())


def report(results: Iterable[Tried], same: set[Change]) -> list[Tried]:
    """Print a table of the rooms, and the survivors; return these.

    Parameters
    ----------
    results
        What became of each change.
    same
        The changes that change no result: module and change.
    """
    rows: dict[str, list[Tried]] = {}
    for one in results:
        rows.setdefault(one.room, []).append(one)
    missed: list[Tried] = []
    print(f"{'room':10} {'tried':>6} {'killed':>7} {'equivalent':>11} {'survived':>9}")
    for room, tried in rows.items():
        killed = [one for one in tried if one.outcome == "killed"]
        left = [one for one in tried if one.outcome == "survived"]
        unseen = [one for one in left if (one.module, one.change) not in same]
        missed += unseen
        n_same = len(left) - len(unseen)
        print(f"{room:10} {len(tried):6} {len(killed):7} {n_same:11} {len(unseen):9}")
    for one in missed:
        print(f"\n{one.module}:{one.line}\n{one.change}")
    return missed


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    runs = commands.add_parser("run", help="try a sample")
    runs.add_argument("rooms", nargs="*", metavar="ROOM", help=", ".join(ROOMS))
    runs.add_argument("--each", type=int, default=8, help="how many of each room")
    runs.add_argument("--seed", type=int, default=1)
    commands.add_parser("report", help="show what was found")
    asked = parser.parse_args()
    if asked.command == "run":
        unknown = sorted(set(asked.rooms) - set(ROOMS))
        if unknown:
            parser.error(f"expected rooms among {', '.join(ROOMS)}, found {unknown}")
        run(asked.rooms or ROOMS, asked.each, asked.seed)
    report(of_this_checkout(known_results()), equivalents())


if __name__ == "__main__":
    main()
