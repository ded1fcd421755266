"""Machine code outlives the process, in the user's chosen place, but never its source."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import llvmlite.binding as llvm
import numba
import pytest
from numba.core import caching

import hopdata
from hopdata.code_cache import (
    brought_code,
    cache_directory,
    compiled_in_cache,
    kept_njit,
    made_with,
)
from hopdata.hybrid.driver import loop as entry
from hopdata.seal import Seal, seal_for, seal_of, sealed

PACKAGE = Path(hopdata.__file__).parent

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
    """Run the scene in a separate process: (result, cache hits, wall time)."""
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
    print(
        f"new scene {first[2]:.2f} s, known scene {second[2]:.2f} s, imports included"
    )


@pytest.fixture
def source_function(tmp_path):
    (tmp_path / "sources").mkdir()
    path = tmp_path / "sources" / "module.py"
    path.write_text("def function():\n    return 1\n")
    names: dict = {}
    exec(compile(path.read_text(), str(path), "exec"), names)
    return names["function"]


def test_beside_the_source(source_function, monkeypatch, tmp_path):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    with cache_directory(source_function, "abc") as cached:
        assert cached
        expected = tmp_path / "sources" / "__pycache__" / "hopdata-abc"
        assert Path(numba.config.CACHE_DIR) == expected
    assert numba.config.CACHE_DIR == ""


def test_where_the_user_says(source_function, monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "mine"))
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "mine"))
    with cache_directory(source_function, "abc"):
        assert Path(numba.config.CACHE_DIR) == tmp_path / "mine" / "hopdata-abc"
    assert str(tmp_path / "mine") == numba.config.CACHE_DIR
    assert not (tmp_path / "sources" / "__pycache__").exists()


def test_in_the_users_cache_if_the_source_is_not_writable(
    source_function, monkeypatch, tmp_path
):
    (tmp_path / "sources" / "__pycache__").write_text(
        "a file where the folder should be"
    )
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "home"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    with cache_directory(source_function, "abc") as cached:
        assert cached
        assert Path(numba.config.CACHE_DIR).is_relative_to(tmp_path / "home")


@pytest.fixture
def no_home(source_function, monkeypatch, tmp_path):
    """Return a function whose cache can be neither beside it nor in its user's home."""
    (tmp_path / "sources" / "__pycache__").write_text(
        "a file where the folder should be"
    )
    for name in ("HOME", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(name, str(tmp_path / "sources" / "module.py"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return source_function


def test_else_among_the_temporary_files(no_home, tmp_path):
    with cache_directory(no_home, "abc") as folder:
        assert folder.parent.parent == tmp_path
        assert str(folder) == numba.config.CACHE_DIR
    assert folder.parent.stat().st_mode & 0o777 == 0o700


def test_not_where_others_can_write(no_home, tmp_path):
    with cache_directory(no_home, "abc") as folder:
        folder.parent.chmod(0o777)
    with cache_directory(no_home, "abc") as folder:
        assert folder is None


@pytest.mark.parametrize("home", ["", "not/absolute"])
def test_not_where_the_process_happens_to_be(no_home, monkeypatch, tmp_path, home):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", home)
    with cache_directory(no_home, "abc") as folder:
        assert folder.parent.name.startswith("hopdata-")
    assert not (tmp_path / "not").exists()
    assert not (tmp_path / "hopdata").exists()


def test_where_the_users_folder_cannot_be_written(no_home, monkeypatch, tmp_path):
    monkeypatch.setattr(
        numba.config, "CACHE_DIR", str(tmp_path / "sources" / "module.py" / "x")
    )
    with cache_directory(no_home, "abc") as folder:
        assert folder.parent.parent == tmp_path


WITHOUT_ANY_FOLDER = """
import tempfile

tempfile.tempdir = "/dev/null"
from hopdata.scenes.body import cross

print(cross((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
"""


def test_import_where_nothing_can_be_written(tmp_path):
    """With a read-only install and no home, each process compiles the kernels, and they work."""
    package = tmp_path / "hopdata"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in {path.parent for path in package.rglob("*.py")}:
        (folder / "__pycache__").write_text("a file where the folder should be")
    nowhere = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"), "/dev/null")
    environment = {**os.environ, **nowhere, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_ANY_FOLDER],
        check=False,
        capture_output=True,
        text=True,
        env=environment,
    )
    assert (done.stdout, done.stderr) == ("(0.0, 0.0, 1.0)\n", "")


def test_types_that_are_given_are_compiled_at_once(monkeypatch, tmp_path):
    """The decorator compiles, one process at a time; later, several would compile the same."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert kept_njit("f8(f8)")(abs_of).signatures == [(numba.float64,)]
    assert kept_njit()(abs_of).signatures == []


def abs_of(number):
    return abs(number)


def tiny_driver(desk, flags):
    return desk + flags


def test_compiling_the_driver_is_said_once(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(entry, "_run", tiny_driver)
    entry.compiled_run.__wrapped__()
    first, kept, last = capsys.readouterr().err.splitlines()
    assert "compiling the integrator" in first
    assert "15 s" in first
    assert "later processes load it" in kept
    assert last.endswith(f"it is kept in {tmp_path}")
    entry.compiled_run.__wrapped__()
    assert capsys.readouterr().err == ""


def test_what_to_do_where_the_driver_cannot_be_kept(monkeypatch, capsys, no_home):
    monkeypatch.setattr(entry, "_run", no_home)
    monkeypatch.setattr(tempfile, "tempdir", "/dev/null")
    no_home.__code__ = tiny_driver.__code__.replace(
        co_filename=no_home.__code__.co_filename
    )
    entry.compiled_run.__wrapped__()
    assert "set NUMBA_CACHE_DIR" in capsys.readouterr().err.splitlines()[-1]


def test_nowhere_if_there_is_no_file():
    names: dict = {}
    exec("def function():\n    return 1\n", names)
    with cache_directory(names["function"], "abc") as cached:
        assert not cached


def test_the_directory_is_restored_after_an_error(source_function, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
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
    """Run a user's script in a separate process; return its output and all files in its folder."""
    source = str(Path(hopdata.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": source}
    environment.pop(
        "NUMBA_CACHE_DIR", None
    )  # keeps the driver's cache in its usual place
    done = subprocess.run(
        [sys.executable, *command], cwd=folder, capture_output=True, text=True, check=True,
        env=environment, **options,
    )  # fmt: skip
    files = {
        path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()
    }
    return done.stdout.splitlines(), files


def test_the_next_process_compiles_nothing(tmp_path):
    """Driver and callbacks are all loaded: no compiler runs and no file is written."""
    (tmp_path / "own.py").write_text(OWN_SYSTEM)
    (first, counts), files = run_own_system(tmp_path)
    assert counts == "[0, 0, 0] True"
    assert len([path for path in files if path.suffix == ".nbc"]) == 3
    (second, counts), files_after = run_own_system(tmp_path)
    assert counts == "[1, 1, 1] False"
    assert second == first
    assert files_after == files


def test_functions_typed_at_a_prompt(tmp_path):
    """They have no file, so they are compiled anew and leave nothing behind."""
    script = "exec(compile(__import__('sys').stdin.read(), '<stdin>', 'exec'))"
    printed, files = run_own_system(tmp_path, ("-c", script), input=OWN_SYSTEM)
    assert printed[1] == "[0, 0, 0] True"
    assert files == {}


WAITS = """
import sys, time
from pathlib import Path
from hopdata.code_cache import compiled_in_cache

def compile_it(cached):
    with Path(sys.argv[1]).open("a") as log:
        print("begins", file=log, flush=True)
        time.sleep(0.3)
        print("ends", file=log)

compiled_in_cache(Path.exists, "0123456789abcdef", compile_it)
"""


def test_one_process_compiles_while_the_others_wait(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    command = [sys.executable, "-c", WAITS, str(tmp_path / "log")]
    for process in [subprocess.Popen(command, env=environment) for _ in range(3)]:
        assert process.wait(timeout=120) == 0
    assert (tmp_path / "log").read_text().split() == ["begins", "ends"] * 3


COMPILES = """
from hopdata.hybrid.driver import loop

def tiny_driver(desk, flags):
    return desk + flags

loop._run = tiny_driver
print(loop.compiled_run().ctypes(40, 2))
"""


def test_only_the_process_that_compiles_the_driver_says_so(tmp_path):
    (tmp_path / "tiny.py").write_text(COMPILES)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    command = [sys.executable, str(tmp_path / "tiny.py")]
    folder = tmp_path / "kept" / f"hopdata-{entry.driver_digest()}"
    folder.mkdir(parents=True)
    with (folder / "lock").open("a") as lock:
        fcntl = pytest.importorskip("fcntl")
        fcntl.flock(lock, fcntl.LOCK_EX)
        both = [subprocess.Popen(command, env=environment, **pipes) for _ in range(2)]
        time.sleep(
            3.0
        )  # now both wait, or one waits and the other will find it compiled
    said = [process.communicate(timeout=120) for process in both]
    assert [out for out, _ in said] == ["42\n", "42\n"]
    assert sum("compiling" in error for _, error in said) == 1


@pytest.fixture
def brought(monkeypatch, tmp_path):
    """Provide the machine code of `tiny_driver` like a wheel; return a way to rewrite it."""
    monkeypatch.setattr("hopdata.code_cache.BROUGHT", tmp_path)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    compiler = numba.cfunc(entry.RUN_NATIVE, error_model="numpy")
    compiled = compiler(tiny_driver)
    machine = llvm.Target.from_default_triple().create_target_machine(
        jit=True, reloc="static"
    )
    code = machine.emit_object(llvm.parse_assembly(compiled.inspect_llvm()))

    def write(versions=None, features=(), needed=()):
        line = json.dumps(
            [versions or made_with(), compiled.native_name, features, needed]
        )
        with sealed(tmp_path / "tiny_driver-0123"):
            (tmp_path / "tiny_driver-0123").write_bytes(line.encode() + b"\n" + code)
        return compiled_in_cache(tiny_driver, "0123", lambda _: None)

    return write


def test_machine_code_that_a_wheel_brought_is_taken(brought):
    features = [name for name, there in llvm.get_host_cpu_features().items() if there]
    code = brought(features=features, needed=["pow"])
    assert (
        ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)(code.address)(
            40, 2
        )
        == 42
    )


@pytest.mark.parametrize(
    "what",
    [
        {"versions": ["0.1", "0.1", "vax"]},
        {"features": ["fma9"]},
        {"needed": ["no_such"]},
    ],
)
def test_what_does_not_fit_is_compiled_here(brought, what):
    assert brought(**what) is None


@pytest.mark.parametrize(
    "setting", [("CPU_NAME", "generic"), ("CPU_FEATURES", "-avx2")]
)
def test_a_processor_that_the_user_names_is_compiled_for(brought, monkeypatch, setting):
    monkeypatch.setattr(numba.config, *setting)
    assert brought() is None


CALLER = """
import sys
from hopdata.code_cache import kept_njit

@kept_njit(inline="never")
def callee(x):
    return x + 1.0

@kept_njit("f8(f8)")
def caller(x):
    return 2.0 * callee(x)

@kept_njit()
def later(x):
    return callee(x) - 1.0

print(caller(1.0), later(2.0), sum(later.stats.cache_hits.values()))
"""


@pytest.fixture
def cached(tmp_path):
    """Return a function that runs two compiled functions and what they call, and their files."""
    (tmp_path / "callers.py").write_text(CALLER)
    place = tmp_path / "kept"
    paths = os.pathsep.join([str(PACKAGE.parent), str(tmp_path)])
    environment = os.environ | {"NUMBA_CACHE_DIR": str(place), "PYTHONPATH": paths}

    def run():
        command = [sys.executable, "-c", "import callers"]
        return subprocess.run(
            command, env=environment, capture_output=True, text=True, check=False
        )

    assert run().stdout.split()[:2] == ["4.0", "2.0"]
    return run, place


def flipped(content):
    changed = bytearray(content)
    changed[len(content) // 2] ^= 8
    return bytes(changed)


DAMAGES = {
    "cut": lambda content: content[:60],
    "empty": lambda _: b"",
    "zeros": lambda content: bytes(len(content)),
    "flipped": flipped,
    "other text": lambda _: b"cos\nsystem\n(S'false'\ntR.x",
}


@pytest.mark.parametrize("pattern", ["*.nbi", "*.nbc"])
def test_damaged_files_are_told_removed_and_compiled_anew(cached, pattern):
    run, place = cached
    damages = list(DAMAGES)
    for first in (0, 2):  # of five damages, each is done to one of three files
        files = sorted(place.rglob(pattern))
        assert (
            len({file.name.split("-")[0] for file in files}) == 3
        )  # two callers and a callee
        for file, damage in zip(files, damages[first:], strict=False):
            file.write_bytes(DAMAGES[damage](file.read_bytes()))
        ended = run()
        assert ended.returncode == 0, ended.stderr
        assert ended.stdout.split() == ["4.0", "2.0", "0"]
        told = [line for line in ended.stderr.splitlines() if "compiled anew" in line]
        assert len(told) == len(ended.stderr.splitlines()) == 3
        assert all(seal_of(file) is Seal.WHOLE for file in place.rglob("*.nb?"))
    again = run()
    assert again.stderr == ""
    assert again.stdout.split() == ["4.0", "2.0", "1"]  # taken from the cache


def test_files_of_an_older_version_are_replaced_without_a_word(cached):
    run, place = cached
    for file in place.rglob("*.nb?"):
        file.write_bytes(file.read_bytes()[: -len(seal_for(file))])
    ended = run()
    assert ended.stdout.split() == ["4.0", "2.0", "0"]
    assert ended.stderr == ""
    assert all(seal_of(file) is Seal.WHOLE for file in place.rglob("*.nb?"))


def test_numbas_settings_in_a_study_folder_do_not_say_where_code_is_kept(
    source_function, monkeypatch, tmp_path
):
    """Code in a cache is run, so a folder that someone sent must not name one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    # Other tests of this process may have left a folder that is gone.
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    (tmp_path / ".numba_config.yaml").write_text("cache_dir: theirs\n")
    numba.config.reload_config()
    try:
        assert numba.config.CACHE_DIR == "theirs"
        with cache_directory(source_function, "abc") as folder:
            assert folder.parent == tmp_path / "sources" / "__pycache__"
    finally:
        (tmp_path / ".numba_config.yaml").unlink()
        numba.config.reload_config()
    assert numba.config.CACHE_DIR == ""


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="Windows has other permissions")
def test_a_folder_into_which_others_could_write_is_emptied_and_closed(
    source_function, monkeypatch, tmp_path
):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "mine"))
    folder = tmp_path / "mine" / "hopdata-abc"
    folder.mkdir(parents=True)
    (folder / "theirs.nbi").write_bytes(b"x")
    folder.chmod(0o777)
    with cache_directory(source_function, "abc") as found:
        assert found == folder
    assert [*folder.iterdir()] == []
    assert folder.stat().st_mode & 0o777 == 0o700
    (folder / "own.nbi").write_bytes(b"x")
    with cache_directory(source_function, "abc") as found:
        assert [one.name for one in found.iterdir()] == ["own.nbi"]


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="Windows has other permissions")
@pytest.mark.parametrize("what", ["a link", "another user's", "open to all"])
def test_a_place_of_others_is_not_used(source_function, monkeypatch, tmp_path, what):
    place = tmp_path / "mine"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(place))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    place.mkdir()
    if what == "a link":
        (tmp_path / "theirs").mkdir()
        (place / "hopdata-abc").symlink_to(tmp_path / "theirs")
    elif what == "open to all":
        place.chmod(0o777)
    else:
        (place / "hopdata-abc").mkdir()
        theirs = os.stat(place / "hopdata-abc")
        real = Path.lstat

        def lstat(path):
            found = real(path)
            if found.st_ino != theirs.st_ino:
                return found
            fields = [*found[:10]]
            fields[4] = found.st_uid + 1
            return os.stat_result(fields)

        monkeypatch.setattr(Path, "lstat", lstat)
    with cache_directory(source_function, "abc") as found:
        assert found is not None
        assert place not in found.parents


def test_a_file_of_another_user_is_removed_and_not_run(cached):
    """Its checksum is sound, so only its owner tells."""
    run, place = cached
    if not hasattr(os, "getuid") or os.getuid() != 0:
        pytest.skip("only root can give a file away")
    files = sorted(place.rglob("*.nb?"))
    for file in files:
        os.chown(file, 65534, 65534)
    ended = run()
    assert ended.stdout.split() == ["4.0", "2.0", "0"]
    assert "of another user; it is removed and not run" in ended.stderr
    assert all(file.stat().st_uid == 0 for file in place.rglob("*.nb?"))


def test_other_users_of_numba_keep_its_own_files(source_function):
    own = caching.IndexDataCacheFile
    with cache_directory(source_function, "abc"):
        assert caching.IndexDataCacheFile is not own
    assert caching.IndexDataCacheFile is own


def test_damaged_code_of_a_wheel_is_not_used(brought, tmp_path):
    assert brought() is not None
    file = tmp_path / "tiny_driver-0123"
    whole = file.read_bytes()
    for damage in (flipped, lambda content: content[:-200], lambda _: b""):
        file.write_bytes(damage(whole))
        assert brought_code(tiny_driver, "0123") is None
    file.write_bytes(whole)
    assert brought_code(tiny_driver, "0123") is not None
