"""hopdata where POSIX is not: what the tree holds, what the code calls, and a study without it."""

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path, PurePosixPath

import pytest
from checkouts import copy_checkout, part_of_sample

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "hopdata"
GONE = tomllib.loads(Path(__file__).with_name("posix_only.toml").read_text("utf-8"))
MODULES = set(GONE.pop("modules"))
# It exists on Windows, where it ends the process, whatever the signal.
GONE["os"].append("kill")
# Called only where another function of the same file has asked: by `limit` of a trial, which
# has found the module; by a fork of `foreign.apart`, which is made on Linux alone; and where
# `foreign.limits` has found the library of Linux.
ASKED_BEFORE = {
    *(
        "_set_limit",
        "_call_fork",
        "_be_fork",
        "_close_all_but",
        "_default_signals",
        "_kill",
        "_exit_code",
        "_no_network",
        "end_with",
    ),
}
# Works on Linux alone: the rules of a folder ask its `may_fork`, and use it nowhere else.
LINUX_ALONE = {"src/hopdata/forks.py"}
# What a guard of a name that may be missing can catch.
CAUGHT = {"AttributeError", "ImportError", "ModuleNotFoundError"}

# Names that Windows refuses, whatever their suffix.
RESERVED = {"con", "prn", "aux", "nul"} | {
    f"{port}{number}" for port in ("com", "lpt") for number in range(1, 10)
}

STUDY = """
study: short
recordings: [{name: hopper, file: data/Läufer 1.h5}]
markers: {body: [body1, body2, body3], feet: [foot1, foot2, foot3], boom: [boom]}
prediction: {bootstraps: 20, train: 30, test: 10, minimum_class: 15}
distances: {enabled: false}
verdict: {flips: 99}
figures: {formats: [svg]}
"""


def wrong_on_windows(path):
    """Say what Windows would refuse about a relative path, or nothing."""
    for part in PurePosixPath(path).parts:
        if re.search(r'[<>:"|?*\\\x00-\x1f]', part) or part[-1] in ". ":
            return f"{path}: a character that Windows refuses"
        if part.split(".")[0].lower() in RESERVED:
            return f"{path}: a name that Windows keeps for a device"
    # A path has 260 characters at most, and a user's folder takes some of them.
    return f"{path}: too long" if len(path) > 160 else ""


def test_what_windows_refuses_is_found():
    for path in ("a:b", "docs/aux.md", "x/Con", "end.", "back\\slash", "a" * 161):
        assert wrong_on_windows(path)
    assert not wrong_on_windows("docs/auxiliary.md")


def test_the_tree_can_be_cloned_everywhere():
    listed = subprocess.run(
        ["git", "ls-files", "-s", "-z"], cwd=ROOT, capture_output=True, check=True
    )
    entries = listed.stdout.decode("utf-8").split("\0")[:-1]
    assert len(entries) > 500
    names = [entry.split("\t", 1)[1] for entry in entries]
    # A clone on Windows has a text file in the place of a link.
    assert [entry for entry in entries if entry.startswith("120000")] == []
    assert [*filter(None, map(wrong_on_windows, names))] == []
    assert len({name.casefold() for name in names}) == len(names)


def posix_uses(tree):
    """Yield each use of what exists on POSIX alone: its line, name and functions."""

    def visit(node, functions):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            functions = [*functions, node]
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name in MODULES:
                    yield node.lineno, alias.name, functions
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                if node.module in MODULES or alias.name in GONE.get(node.module, ()):
                    yield node.lineno, f"{node.module}.{alias.name}", functions
        if isinstance(node, ast.Attribute):
            of = ast.unparse(node.value)
            if node.attr in GONE.get(of, ()):
                yield node.lineno, f"{of}.{node.attr}", functions
        for inner in ast.iter_child_nodes(node):
            yield from visit(inner, functions)

    return visit(tree, [])


def asks(function):
    """Tell whether a function asks if a name exists, or catches that it does not."""
    for node in ast.walk(function):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id in {"hasattr", "getattr"}:
                return True
            if node.func.id == "suppress" and CAUGHT & {*map(ast.unparse, node.args)}:
                return True
        if isinstance(node, ast.ExceptHandler) and node.type is not None:
            caught = set(re.findall(r"\w+", ast.unparse(node.type)))
            if caught & CAUGHT:
                return True
        if ast.unparse(node) in {"os.name", "sys.platform"}:
            return True
    return False


def unasked(text, name):
    """Return what a source calls without asking whether it exists."""
    found = []
    for line, what, functions in posix_uses(ast.parse(text)):
        is_asked = any(asks(one) or one.name in ASKED_BEFORE for one in functions)
        if not is_asked:
            found.append(f"{name}:{line}: {what}")
    return found


def test_a_call_without_its_other_half_is_found():
    assert unasked("import fcntl", "a") == ["a:1: fcntl"]
    assert unasked("def f():\n    from os import fork", "a") == ["a:2: os.fork"]
    assert unasked("def f():\n    return os.getuid()", "a") == ["a:2: os.getuid"]
    assert unasked("def f(p):\n    p.send(signal.SIGKILL)", "a") == [
        "a:2: signal.SIGKILL"
    ]
    asked = "def f():\n    if hasattr(os, 'getuid'):\n        return os.getuid()"
    assert unasked(asked, "a") == []
    assert unasked("def f():\n    return os.getpid()", "a") == []


def test_no_call_of_posix_is_without_its_other_half():
    files = [*PACKAGE.rglob("*.py"), *(ROOT / "workflow").rglob("*.py")]
    assert len(files) > 300
    found = []
    for file in files:
        name = file.relative_to(ROOT).as_posix()
        text = file.read_text("utf-8")
        if name in LINUX_ALONE:
            assert 'return sys.platform.startswith("linux")' in text
            continue
        found += unasked(text, name)
    assert found == []
    rules = (ROOT / "workflow" / "rules" / "folder.smk").read_text("utf-8")
    assert "if may_fork() and IS_OWN:\n    PythonScript.execute_script =" in rules


def without_posix(folder, *arguments, **more):
    """Run Python where hopdata misses what Windows lacks, and no text is UTF-8 unsaid."""
    path = [str(Path(__file__).with_name("without_posix")), str(ROOT / "src")]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(path),
        "PYTHONWARNDEFAULTENCODING": "1",
        # What a console of western Europe can show.
        "PYTHONIOENCODING": "cp1252",
    }
    environment |= more
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment,
        capture_output=True, encoding="cp1252", check=False, timeout=600,
    )  # fmt: skip


DEPRIVED = """
import os, signal
from pathlib import Path
print(hasattr(os, "getuid"), hasattr(os, "fork"), hasattr(signal, "SIGKILL"))
for what in ("import resource", "Path('/proc/self/stat').read_text('utf-8')", "open(os.__file__)"):
    try:
        exec(what)
    except Exception as error:
        print(type(error).__name__)
with open("x.txt", "w", encoding="utf-8") as file:
    for change in (os.replace, Path.rename):
        try:
            change(Path("x.txt"), "y.txt")
        except OSError as error:
            print(type(error).__name__)
"""


def test_the_calls_are_taken_away(tmp_path):
    run = without_posix(tmp_path, "-c", DEPRIVED)
    assert run.stdout.split() == [
        *("False", "False", "False"),
        *("ModuleNotFoundError", "FileNotFoundError", "EncodingWarning"),
        *("PermissionError", "PermissionError"),
    ], run.stderr


EVERY = """
import importlib, pkgutil, hopdata
n = 0
for module in pkgutil.walk_packages(hopdata.__path__, "hopdata."):
    if module.name.endswith("__main__") or ".workflow." in module.name:
        continue
    try:
        importlib.import_module(module.name)
    except ModuleNotFoundError as error:
        # A library that an installation may lack.
        assert error.name in {"qtm_rt", "gymnasium", "mujoco", "ezc3d", "openpyxl", "xarray"}, error
    n += 1
print(n)
"""


def test_every_module_is_imported_without_posix(tmp_path):
    run = without_posix(tmp_path, "-c", EVERY)
    assert run.returncode == 0, run.stderr
    assert int(run.stdout) > 300


@pytest.mark.workflow
def test_a_study_runs_without_posix(tmp_path):
    """Its folder has a space and a letter that is not in ASCII, as users' folders may."""
    folder = copy_checkout(tmp_path / "Eigene Läufe")
    part_of_sample(folder / "data/Läufer 1.h5", 60)
    (folder / "config/short.yaml").write_text(STUDY, encoding="utf-8")
    run = without_posix(
        folder, "-m", "hopdata", "run", "config/short.yaml",
        "--cores", "2", "--", "results/short/verdict.json",
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    results = folder / "results" / "short"
    verdict = json.loads((results / "verdict.json").read_text("utf-8"))
    assert "conclusion" in verdict
    made = [
        path.relative_to(folder).as_posix()
        for place in (results, folder / ".snakemake")
        for path in place.rglob("*")
    ]
    assert [*filter(None, map(wrong_on_windows, made))] == []
