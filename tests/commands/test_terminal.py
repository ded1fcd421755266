"""What a command shows on a terminal, and that a pipe gets plain text."""

import errno
import io
import json
import os
import re
import subprocess
import sys
from contextlib import suppress

import pytest
from checkouts import ROOT
from made_up_files import export
from made_up_hopper import MARKERS, hopping, with_spike

from hopdata.commands import terminal

SIGNS = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
COLOURS = re.compile(r"\x1b\[[0-9;]*[34][0-8][0-9;]*m")


def on_a_terminal(code, **environment):
    """Run Python code on a terminal of 100 columns; return all that is written to it."""
    ours, theirs = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.DEVNULL,
        stdout=theirs,
        stderr=theirs,
        env={
            **os.environ,
            "PYTHONPATH": str(ROOT / "src"),
            "TERM": "xterm-256color",
            "COLUMNS": "100",
            **environment,
        },
    )
    os.close(theirs)
    written = b""
    try:
        while part := os.read(ours, 65536):
            written += part
    except OSError as error:
        if error.errno != errno.EIO:  # by which a terminal tells that nobody writes
            raise
    finally:
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=60)
        os.close(ours)
    return process.returncode, written.decode("utf-8")


def inspect(file, **environment):
    code = "from hopdata.__main__ import main\n"
    code += f"raise SystemExit(main(['inspect', {str(file)!r}]))"
    return on_a_terminal(code, **environment)


@pytest.fixture
def faulty(tmp_path):
    names = ("[bold]", ":smile:", *MARKERS[2:])  # no markup of rich
    return export(tmp_path, with_spike(hopping(3)[1], "hip2", 400, 0.06), names=names)


def test_inspect_draws_its_tables(faulty):
    code, written = inspect(faulty, COLUMNS="80")
    assert code == 1
    text = SIGNS.sub("", written)
    lines = text.replace("\r", "\n").split("\n")
    assert all(len(line) <= 80 for line in lines if faulty.name not in line)
    assert re.search(r"marker +height +between +gaps", text)
    assert re.search(r"\[bold\] +[▁▂▃▄▅▆▇█]{40} +0.14 to 0.43 m +no gap", text)
    assert re.search(r"kind +frame +s +what", text)
    assert re.search(r"spike +401 +4.000 +:smile: is 60.1 mm off for 1 frame", text)
    assert "1 suspect: 1 spike." in text
    assert "2000 at 100 Hz" in text


def test_progress_is_shown_and_taken_away(faulty):
    _, written = inspect(faulty)
    assert f"reading {faulty.parent}"[:40] in SIGNS.sub("", written)
    assert "\x1b[2K" in written  # the line is erased


def test_without_colours_if_these_are_not_wanted(faulty):
    assert not COLOURS.search(inspect(faulty, NO_COLOR="1")[1])
    assert COLOURS.search(inspect(faulty)[1])  # the progress has some


def test_a_terminal_without_these_signs_gets_ascii(faulty):
    code, written = inspect(faulty, PYTHONIOENCODING="ascii")
    assert code == 1
    assert "#####" in written
    assert written.isascii()


def test_a_table_in_a_pipe_is_the_plain_text(capsys):
    terminal.print_table({"n": "right"}, [["1"], ["2"]], plain="n\n1\n2")
    assert capsys.readouterr().out == "n\n1\n2\n"


def test_stages_in_a_log_are_a_line_each(capsys):
    with terminal.progress_bar("sample") as show:
        show(
            0, 10, "code is compiled"
        )  # told at once, since the first job may take long
        show(1, 10, "about 9 s left")  # no stage has ended, and it was told of just now
        show(2, 10, "about 8 s left", "rule 1.0 s")
        show(10, 10, "after 9.5 s")
    assert capsys.readouterr().err == (
        "sample: 0 of 10 jobs done, code is compiled\n"
        "sample: rule 1.0 s; 2 of 10 jobs done, about 8 s left\n"
        "sample: 10 of 10 jobs done, after 9.5 s\n"
    )


def test_a_log_of_a_long_stage_says_how_far_it_is(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "_QUIET_S", 0.0)
    with terminal.progress_bar("sample") as show:
        show(1, 10, "about 9 s left")
    assert capsys.readouterr().err == "sample: 1 of 10 jobs done, about 9 s left\n"


def test_jobs_on_a_terminal_are_a_bar_of_one_line():
    code = (
        "from hopdata.commands import terminal\n"
        "with terminal.progress_bar('[b]sample' + 90 * 'e') as show:\n"  # no markup of rich
        "    show(3, 10, '[b]about 8 s left', '[b]rule 1.0 s')\n"
    )
    returned, written = on_a_terminal(code, COLUMNS="80")
    assert returned == 0, written
    lines = SIGNS.sub("", written).replace("\r", "\n").split("\n")
    assert all(len(line) <= 80 for line in lines)
    assert "  [b]rule 1.0 s" in lines
    bar = r"\[b\]sampleeeeeeeeeee… .* +3/10 jobs done \[b\]about 8 s left *"
    assert any(re.fullmatch(bar, line) for line in lines)


def test_plan_and_doctor_draw_their_tables(tmp_path):
    verdict = {"n_landings": 500, "n_feet": 2, "power": 0.8, "sentence": ""}
    verdict |= {"margin": 0.2, "effect": {"detectable": 0.4, "allowed": 0.1}}
    file = tmp_path / "verdict.json"
    file.write_text(json.dumps(verdict))
    begin = "from hopdata.__main__ import main\n"
    code, written = on_a_terminal(f"{begin}raise SystemExit(main(['plan', '{file}']))")
    assert code == 0, written
    text = SIGNS.sub("", written)
    assert re.search(r"difference +landings *\r\n *─+", text)
    assert re.search(r"20 % +\d[\d,]+", text)
    _, written = on_a_terminal(f"{begin}raise SystemExit(main(['doctor']))")
    assert re.search(r"python +\d+\.\d+", SIGNS.sub("", written))


def test_what_a_command_prints_tells_the_terminal_nothing(capsys):
    raw = sys.stdout
    with terminal.screened():
        print("a\x1b[31mb\n\tc\u202e 5\u00a0%")
        sys.stderr.writelines(["d\x07", "e\rf\n"])
        assert sys.stdout.isatty() == raw.isatty()
        print("\x1b[K", file=terminal.raw_stream(sys.stdout), end="")  # hopdata's own
    assert sys.stdout is raw
    out, err = capsys.readouterr()
    assert out == "a?[31mb\n\tc? 5\u00a0%\n\x1b[K"
    assert err == "d?e f\n"


def test_names_of_files_tell_the_terminal_nothing(tmp_path):
    """Each command prints through `screened`; that of a file it cannot find, say."""
    code, written = inspect(tmp_path / "a\x1b]0;title\x07\u202eb.tsv")
    assert code == 1
    assert "a?]0;title??b.tsv" in SIGNS.sub("", written)
    assert "\x1b]" not in written


def test_a_cell_tells_the_terminal_nothing():
    code = "from hopdata.commands.terminal import draw_table\n"
    code += "draw_table({'name': 'left'}, [['a\\x1b[2Jb'], ['左足']])"
    _, written = on_a_terminal(code)
    assert "a?[2Jb" in written
    assert "左足" in written
    assert "\x1b[2J" not in written


def test_what_a_stream_cannot_encode_becomes_a_question_mark():
    raw = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    stream = terminal.Screened(raw)
    stream.write("0.3 \u00b1 0.1 ms\n")
    stream.flush()
    assert raw.buffer.getvalue() == b"0.3 ? 0.1 ms\n"
    plain = io.StringIO()  # has no encoding
    terminal.Screened(plain).write("0.3 \u00b1 0.1 ms\n")
    assert plain.getvalue() == "0.3 \u00b1 0.1 ms\n"
