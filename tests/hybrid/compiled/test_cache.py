"""Machine code outlives the process, where the user wants it, and never its source."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest

import hopdata
from hopdata.hybrid.compiled.cache import cache_directory

SCENE = """
from numba import njit
from hopdata.hybrid import System, field, solve
from speeds import speed

@field
def run(t, y, mode, params, dy):
    dy[0] = speed(t)

if __name__ == "__main__":
    solution = solve(System(run, n_states=1), (0, 1), [0.0])
    print(solution.y_end[0], run._compiled.cache_hits)
"""
SPEEDS = """
from numba import njit

@njit
def speed(t):
    return {speed}
"""


def run_scene(folder: Path) -> tuple[float, int, float]:
    """Run the scene in a process of its own: (result, cache hits, wall time)."""
    source = str(Path(hopdata.__file__).parents[1])
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "scene.py"], cwd=folder, capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": source},
    )  # fmt: skip
    result, hits = done.stdout.split()
    return float(result), int(hits), time.perf_counter() - start


def test_second_process_loads_and_an_edited_helper_is_noticed(tmp_path):
    (tmp_path / "scene.py").write_text(SCENE)
    (tmp_path / "speeds.py").write_text(SPEEDS.format(speed="3.0"))
    first, second = run_scene(tmp_path), run_scene(tmp_path)
    assert first[:2] == pytest.approx((3.0, 0), abs=1e-12)
    assert second[:2] == pytest.approx((3.0, 1), abs=1e-12)
    (tmp_path / "speeds.py").write_text(SPEEDS.format(speed="4.0"))
    assert run_scene(tmp_path)[:2] == pytest.approx((4.0, 0), abs=1e-12)
    print(f"new scene {first[2]:.2f} s, known scene {second[2]:.2f} s, imports included")


@pytest.fixture
def source_function(tmp_path):
    (tmp_path / "sources").mkdir()
    path = tmp_path / "sources" / "module.py"
    path.write_text("def function():\n    return 1\n")
    names: dict = {}
    exec(compile(path.read_text(), str(path), "exec"), names)
    return names["function"]


def test_beside_the_source(source_function, monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    with cache_directory(source_function, "abc") as cached:
        assert cached
        expected = tmp_path / "sources" / "__pycache__" / "hopdata-abc"
        assert Path(numba.config.CACHE_DIR) == expected
    assert numba.config.CACHE_DIR == ""


def test_where_the_user_says(source_function, monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "mine"))
    with cache_directory(source_function, "abc"):
        assert Path(numba.config.CACHE_DIR) == tmp_path / "mine" / "hopdata-abc"
    assert str(tmp_path / "mine") == numba.config.CACHE_DIR
    assert not (tmp_path / "sources" / "__pycache__").exists()


def test_in_the_users_cache_if_the_source_is_not_writable(source_function, monkeypatch, tmp_path):
    (tmp_path / "sources" / "__pycache__").write_text("a file where the folder should be")
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "home"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    with cache_directory(source_function, "abc") as cached:
        assert cached
        assert Path(numba.config.CACHE_DIR).is_relative_to(tmp_path / "home")


def test_nowhere_if_there_is_no_file():
    names: dict = {}
    exec("def function():\n    return 1\n", names)
    with cache_directory(names["function"], "abc") as cached:
        assert not cached


def test_the_directory_is_restored_after_an_error(source_function, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    with pytest.raises(KeyError), cache_directory(source_function, "abc"):
        raise KeyError
    assert numba.config.CACHE_DIR == ""


OWN_SYSTEM = """
from numba.core import event
from hopdata.hybrid import System, field, guards, on_event, solve

@field
def fall(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], -params[0]

@guards
def floor(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = -y[0], -dy[0]

@on_event
def bounce(t, y, mode, params, guard, direction):
    y[1] = -0.5 * y[1] if direction > 0 else y[1]
    return 0

ball = System(fall, floor, bounce, n_states=2, guard_names=("floor",))
with event.install_recorder("numba:run_pass") as passes:
    print(solve(ball, (0, 1), [1.0, 0.0], params=(9.81,)).y_end.tolist())
print([one._compiled.cache_hits for one in (fall, floor, bounce)], len(passes.buffer) > 0)
"""


def run_own_system(folder, command=("own.py",), **options):
    """Run a user's script in a process of its own: what it prints, and all files in its folder."""
    source = str(Path(hopdata.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": source}
    environment.pop("NUMBA_CACHE_DIR", None)  # the driver's cache stays where it is
    done = subprocess.run(
        [sys.executable, *command], cwd=folder, capture_output=True, text=True, check=True,
        env=environment, **options,
    )  # fmt: skip
    files = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    return done.stdout.splitlines(), files


def test_the_next_process_compiles_nothing(tmp_path):
    """Neither driver nor callbacks: all are loaded, no compiler runs, and no file is written."""
    (tmp_path / "own.py").write_text(OWN_SYSTEM)
    (first, counts), files = run_own_system(tmp_path)
    assert counts == "[0, 0, 0] True"
    assert len([path for path in files if path.suffix == ".nbc"]) == 3
    (second, counts), files_after = run_own_system(tmp_path)
    assert counts == "[1, 1, 1] False"
    assert second == first
    assert files_after == files


def test_functions_typed_at_a_prompt(tmp_path):
    """They have no file, so they are compiled anew, and leave nothing behind."""
    script = "exec(compile(__import__('sys').stdin.read(), '<stdin>', 'exec'))"
    printed, files = run_own_system(tmp_path, ("-c", script), input=OWN_SYSTEM)
    assert printed[1] == "[0, 0, 0] True"
    assert files == {}
