import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hopdata import __version__
from hopdata.__main__ import COMMANDS, main
from hopdata.recordings.readers.hdf5 import read_recording, write_recording

ROOT = Path(__file__).parents[1]
CONFIG = """\
study: trial
recordings:
  - name: hopper
    file: {file}
markers:
  body: [body1, body2, body3]
  feet: [foot1, foot2, foot3]
"""


def hopdata(*arguments, **options):
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    command = [sys.executable, "-m", "hopdata", *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env=environment, **options
    )


@pytest.fixture(scope="module")
def short_sample(sample_path, tmp_path_factory):
    """Write the first 100 s of the bundled recording, which suffice for the checks."""
    path = tmp_path_factory.mktemp("short") / "hopper.h5"
    write_recording(path, read_recording(sample_path).part(slice(10_000)))
    return path


@pytest.fixture
def config(tmp_path, short_sample):
    path = tmp_path / "config.yaml"
    path.write_text(CONFIG.format(file=short_sample))
    return path


def edited(config, old, new):
    text = config.read_text()
    assert old in text
    config.write_text(text.replace(old, new))
    return str(config)


def test_check_sums_up_a_sound_study(config, capsys):
    assert main(["check", str(config)]) == 0
    out, err = capsys.readouterr()
    assert "study trial" in out
    assert "at 100 Hz" in out
    assert "foot1, foot2, foot3" in out
    assert "100 % of all markers" in out
    assert out.rstrip().endswith("is sound")
    assert err == ""


def test_check_does_not_call_sound_what_it_has_a_note_on(
    config, short_sample, capsys, tmp_path
):
    recording = read_recording(short_sample)
    recording.positions[::9, recording.markers.index("body3")] = np.nan
    write_recording(tmp_path / "gap.h5", recording, None)
    assert (
        main(["check", edited(config, str(short_sample), str(tmp_path / "gap.h5"))])
        == 0
    )
    *told, last = capsys.readouterr().out.splitlines()
    unseen = "markers that many frames do not show: body3 (11 %)"
    assert f"note: {tmp_path / 'gap.h5'}: {unseen}" in told
    assert last == f"{config} can be run, but see the notes above"


def test_check_names_a_simulated_recording(config, capsys, short_sample):
    text = config.read_text().replace(f"    file: {short_sample}\n", "")
    config.write_text(text)
    assert main(["check", str(config)]) == 0
    assert "hopper: simulated, 1000 hops" in capsys.readouterr().out


MISTAKES = {
    "misspelt key": ("study:", "stduy:", ["stduy: expected a known key", "'study'"]),
    "missing file": (
        "hopper.h5",
        "hoper.h5",
        ["recordings[0].file", "did you mean 'hopper.h5'"],
    ),
    "unknown marker": (
        "body3",
        "bdy3",
        ["markers.body", "'bdy3'", "did you mean 'body3'"],
    ),
    "rate 0": (
        "markers:",
        "input: {rate_hz: 0}\nmarkers:",
        ["input.rate_hz", "found 0"],
    ),
    "m taken for mm": (
        "markers:",
        "input: {unit: mm}\nmarkers:",
        ["scale", "input.unit: m"],
    ),
    "body and feet exchanged": (
        "body: [body1, body2, body3]\n  feet: [foot1, foot2, foot3]",
        "feet: [body1, body2, body3]\n  body: [foot1, foot2, foot3]",
        ["the body above the feet"],
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line_on_stderr_and_exit_code_1(config, capsys, mistake):
    old, new, parts = MISTAKES[mistake]
    before = sorted(config.parent.rglob("*"))
    assert main(["check", edited(config, old, new)]) == 1
    out, err = capsys.readouterr()
    assert err.startswith("hopdata: error: ")
    assert err.count("\n") == 1
    assert "Traceback" not in out + err
    assert "is sound" not in out
    for part in ("expected", "found", *parts):
        assert part in err
    assert sorted(config.parent.rglob("*")) == before


def test_forces_and_contacts_are_read_too(config, capsys, tmp_path):
    plate, switches = tmp_path / "plate.csv", tmp_path / "switches.csv"
    plate.write_text("Fx,Fz\n" + "0,0\n0,30\n" * 50)
    switches.write_text("foot1,foot2,foot3\n1,2,3\n4,5,6\n")
    forces = f"{{file: {plate}, rate_hz: 100, columns: [{{name: Fz, feet: [foot1]}}]}}"
    known = f"    forces: {forces}\n    contacts: {{file: {switches}}}\n"
    edited(config, "markers:", known + "markers:")
    assert main(["check", str(config)]) == 0
    out, _ = capsys.readouterr()
    assert "force     Fz: 100 samples, 0.000 to 0.990 s, up to 30 N, of foot1" in out
    assert "contacts  foot2: 2, 2.000 to 5.000 s, of foot2" in out
    assert main(["check", edited(config, "name: Fz", "name: Fy")]) == 1
    out, err = capsys.readouterr()
    assert err.count("\n") == 1
    assert (
        "plate.csv, line 1: column: expected 'Fy' once among Fx, Fz, found no 'Fy'"
        in err
    )
    assert "is sound" not in out


def test_all_unsound_recordings_are_told(config, capsys, tmp_path):
    broken = [tmp_path / f"broken{i}.tsv" for i in range(2)]
    for file in broken:
        file.write_text("hello\n")
    more = "".join(
        f"  - {{name: r{i}, file: {file}}}\n" for i, file in enumerate(broken)
    )
    edited(config, "markers:", more + "markers:")
    assert main(["check", str(config)]) == 1
    out, err = capsys.readouterr()
    assert all(f"{file}, line 1: expected" in err for file in broken)
    assert "at 100 Hz" in out


def test_the_real_recording(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("data").symlink_to(ROOT / "data")
    assert main(["check", str(ROOT / "config/runner.yaml")]) == 0
    assert "4500 at 150 Hz, 30.0 s" in capsys.readouterr().out


def test_config_docs_writes_the_page(tmp_path, capsys):
    assert main(["config-docs", "--out", str(tmp_path / "docs/page.md")]) == 0
    assert main(["config-docs"]) == 0
    page = (tmp_path / "docs/page.md").read_text(encoding="utf-8")
    assert page == capsys.readouterr().out
    assert "## `sections`" in page


def test_config_docs_tells_where_it_cannot_write(tmp_path, capsys):
    assert main(["config-docs", "--out", str(tmp_path)]) == 1
    assert "expected a file that can be written" in capsys.readouterr().err


def test_version_and_help():
    result = hopdata("--version")
    assert (result.returncode, result.stdout) == (0, f"hopdata {__version__}\n")
    result = hopdata("check", "--help")
    assert result.returncode == 0
    assert "CONFIG" in result.stdout


@pytest.mark.parametrize(
    "arguments", [[], ["chekc", "x"], ["check"], ["run", "--cores", "0"]]
)
def test_a_wrong_command_line_is_exit_code_2(arguments):
    result = hopdata(*arguments)
    assert result.returncode == 2
    assert result.stderr.startswith("usage: hopdata")


def test_help_does_not_import_numpy():
    code = (
        "import sys\nfrom hopdata.__main__ import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'pandas', 'yaml', 'h5py'} & set(sys.modules)\nassert not heavy, heavy"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert result.returncode == 0, result.stderr


def test_a_configuration_is_loaded_without_what_is_slow_to_load():
    """Each start of a study does this, even if there is nothing to do."""
    code = (
        "import sys\nfrom hopdata.config.loading import load_config\nimport yaml\n"
        "load_config(yaml.safe_load(open('config/config.yaml')))\n"
        "heavy = {'numba', 'pandas', 'scipy', 'matplotlib', 'h5py'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert result.returncode == 0, result.stderr


def test_an_interrupt_ends_without_a_traceback():
    # A shell's background jobs and their children ignore the signal, so this enables it
    # again.
    code = (
        "import signal, time\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from hopdata.__main__ import main\nfrom hopdata.commands import check\n"
        "def busy(options):\n    print('busy', flush=True)\n    time.sleep(60)\n"
        "check.check = busy\nraise SystemExit(main(['check', 'a.yaml']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
    )
    try:
        assert process.stdout.readline() == "busy\n"
        process.send_signal(signal.SIGINT)
        err = process.communicate(timeout=30)[1]
    finally:
        process.kill()
    assert process.returncode == 130
    assert err == "hopdata: interrupted\n"


@pytest.mark.parametrize("command", ["check", "run", "plan", "clean"])
def test_a_pipe_in_place_of_a_file_keeps_nobody_waiting(command, tmp_path, capsys):
    pipe = tmp_path / "study.yaml"
    os.mkfifo(pipe)
    assert main([command, str(pipe)]) == 1
    assert capsys.readouterr().err.endswith("found a pipe\n")


def test_a_closed_pipe_is_no_error():
    command = (
        f"{sys.executable} -m hopdata config-docs | head -n 1; exit ${{PIPESTATUS[0]}}"
    )
    result = subprocess.run(
        ["bash", "-c", command],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == "# Configuration\n"


def completed(words, folder):
    """Return what bash offers for the last of the words."""
    script = hopdata("completion", "bash")
    assert script.returncode == 0, script.stderr
    line = " ".join(words)
    ask = (
        f"{script.stdout}\nCOMP_WORDS=({line})\nCOMP_CWORD={len(words) - 1}\n"
        f"COMP_LINE='{line}'\n_shtab_hopdata\nprintf '%s\\n' \"${{COMPREPLY[@]}}\""
    )
    bash = subprocess.run(
        ["bash", "-c", ask], capture_output=True, text=True, check=True, cwd=folder
    )
    return bash.stdout.split()


def test_bash_completes_commands_options_and_files(tmp_path):
    (tmp_path / "monday.yaml").touch()
    (tmp_path / "other.yaml").touch()
    assert completed(["hopdata", "do"], tmp_path) == ["doctor"]
    assert completed(["hopdata", "inspect", "--ht"], tmp_path) == ["--html"]
    for command in ("check", "run", "inspect"):
        assert completed(["hopdata", command, "mon"], tmp_path) == ["monday.yaml"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_the_script_of_each_shell_names_every_command(shell):
    script = hopdata("completion", shell).stdout
    assert all(command in script for command in COMMANDS)
    assert "--vertical-axis" in script or shell == "tcsh"


def test_an_unknown_shell_is_told():
    result = hopdata("completion", "cmd")
    assert result.returncode == 2
    assert "expected one of bash, zsh, tcsh, found 'cmd'" in result.stderr


def test_what_a_pipe_does_not_need_is_not_loaded(short_sample):
    """What draws on a terminal, and what takes a second to load."""
    code = (
        "import sys\nfrom hopdata.__main__ import main\n"
        f"main(['inspect', {str(short_sample)!r}])\n"
        "slow = {'rich', 'shtab', 'scipy.stats'} & set(sys.modules)\n"
        "assert not slow, slow"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert "\x1b" not in result.stdout + result.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a folder in use stays")
def test_a_current_folder_that_is_gone_is_told_in_one_line(
    monkeypatch, tmp_path, capsys
):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert main(["run", "study.yaml"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(
        "found that it has been removed; change to one that exists (cd)"
    )
