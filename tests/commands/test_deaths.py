"""Snakemake's page of text ends in one line with the job and the cause."""

import errno
from pathlib import Path

import pytest

from hopdata.causes import NoForkError, ServerEndedError
from hopdata.commands.deaths import tell, why

PAGE = """\
rule floor_compensation:
    input: results/a/recordings/one.h5
RuleException:
CalledProcessError in file "line.smk", line 70:
{how}
[Sat Nov 28 19:50:42 2026]
Error in rule floor_compensation:
    message: None
    jobid: 3
    output: results/a/level/one.h5
    log: results/a/logs/floor_compensation_one.log (check log file(s) for error details)
Shutting down, this might take some time.
"""
DIED = "Command 'python x' died with <Signals.SIGKILL: 9>."
STATUS = "Command 'python x' returned non-zero exit status {}."


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("results/a/logs").mkdir(parents=True)
    return tmp_path


def told(how):
    return why(PAGE.format(how=how).splitlines(keepends=True), oom_before=None)


@pytest.mark.parametrize("how", [DIED, STATUS.format(137)])
def test_a_job_that_was_killed_is_named_with_its_signal(folder, how):
    assert told(how).startswith("floor_compensation_one: it was killed (SIGKILL)")


@pytest.mark.parametrize("status", [128, 255])
def test_a_code_of_no_signal_is_none(folder, status):
    said = told(STATUS.format(status))
    assert said == "floor_compensation_one: it failed, and its log tells no more"


def test_the_line_is_printed_from_the_logs(folder, capsys):
    Path("a.log").write_text(PAGE.format(how=DIED))
    tell(["a.log"], oom_before=None)
    printed = capsys.readouterr().err
    assert printed.startswith("hopdata: error: floor_compensation_one: it was killed")
    Path("a.log").write_text("Nothing to be done.\n")
    tell(["a.log"], oom_before=None)
    assert capsys.readouterr().err == ""


def test_of_two_jobs_that_failed_each_keeps_its_own_reason(folder):
    other = PAGE.format(how=DIED).replace("floor_compensation", "verdict")
    said = PAGE.format(how=STATUS.format(1)) + other
    assert why([said], oom_before=None).startswith("verdict_one: it was killed")
    said = PAGE.format(how=DIED) + other
    assert why([said], oom_before=None).startswith("floor_compensation_one: it was kil")


def test_what_the_job_itself_said_comes_first(folder):
    log = Path("results/a/logs/floor_compensation_one.log")
    log.write_text(
        "INFO hopdata: begins\nERROR hopdata: a.h5: expected feet, found none\n"
    )
    assert told(STATUS.format(1)) == "a.h5: expected feet, found none"


def test_a_cause_in_the_text_is_told_with_the_job(folder):
    text = "MemoryError\n" + STATUS.format(1)
    assert told(text).startswith("floor_compensation_one: memory ran out")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ServerEndedError(), "the process that starts the jobs has ended; probably it"),
        (NoForkError(errno.EAGAIN, "Resource unavailable"), "(ulimit -u); run it with"),
        (NoForkError(errno.EMFILE, "Too many open files"), "raise the limit (ulimit"),
    ],
)
def test_a_job_that_could_not_begin_is_told(folder, error, words):
    page = PAGE.replace("CalledProcessError", type(error).__name__)
    lines = page.format(how=error).splitlines(keepends=True)
    said = why(lines, oom_before=None)
    assert said.startswith("floor_compensation_one: ")
    assert words in said


def test_a_crash_without_a_word_names_the_job(folder):
    assert told(STATUS.format(1)) == (
        "floor_compensation_one: it failed, and its log tells no more"
    )


def test_a_mistake_of_hopdata_is_told_with_the_log_to_send(folder):
    log = Path("results/a/logs/floor_compensation_one.log")
    log.write_text(
        "ERROR hopdata: unexpected error\nTraceback (most recent call last):\n"
        '  File "a.py", line 3, in b\n    c\nKeyError: 4\n\n'
    )
    assert told(STATUS.format(1)) == (
        f"floor_compensation_one: unexpected KeyError: 4; please report it with {log}"
    )


def test_snakemake_itself_may_lack_something():
    said = ["OSError: [Errno 28] No space left on device\n"]
    assert why(said, oom_before=None).startswith("Snakemake: the disk is full")
    missing = "MissingInputException in rule a:\nMissing input files for rule a:\n"
    missing += "    output: b\n    affected files:\n        data/monday.tsv\n"
    assert why([missing], oom_before=None).startswith("data/monday.tsv: it is missing")


def test_a_place_that_cannot_be_written_is_named_before_any_job_runs():
    said = "ProtectedOutputException in rule a:\nWrite-protected output files for rule"
    said += " a:\n    output: results/a/b\n    affected files:\n        results/a/b\n"
    told = why([said], oom_before=None)
    assert told.startswith("results/a/b: this place cannot be written; run where")


def test_what_is_not_known_is_not_invented():
    assert (
        why(["Building DAG of jobs...\n", "WorkflowError: odd\n"], oom_before=None)
        == ""
    )
