"""Events of Snakemake become a line for each stage; its plugin tells them by itself, too."""

import logging
import re
import subprocess
import sys

import pytest
from snakemake_interface_logger_plugins.common import LogEvent

from hopdata.commands.progress import Progress, in_words, line_of, parted
from snakemake_logger_plugin_hopdata import event_of


def record(kind, at_s=0.0, **told):
    made = logging.LogRecord("snakemake", logging.INFO, "", 0, None, None, None)
    made.__dict__ |= {"event": kind, "created": at_s, **told}
    return made


def begun(job, stage, at_s):
    return record(LogEvent.JOB_INFO, at_s, jobid=job, rule_name=stage, output=["x"])


def ended(job, at_s):
    return record(LogEvent.JOB_FINISHED, at_s, job_id=job)


def test_a_stage_is_told_once_its_last_job_has_ended():
    shown = []
    progress = Progress(lambda *told: shown.append(told))
    for one in (
        record(LogEvent.RESOURCES_INFO, cores=2),
        record(LogEvent.RUN_INFO, stats={"level": 2, "verdict": 1, "total": 3}),
        begun(1, "level", 10.0),
        begun(2, "level", 11.0),
        ended(1, 12.0),
        ended(2, 14.0),
        begun(3, "verdict", 14.0),
        record(LogEvent.PROGRESS, done=2, total=21),  # with jobs that will not run
        ended(3, 15.0),
    ):
        event = event_of(one)
        if event is not None:
            progress.take(event)
    assert shown == [
        (1, 3, "after 2.0 s", ""),
        (2, 3, "after 4.0 s", "level (2 jobs) 4.0 s"),
        (3, 3, "after 5.0 s", "verdict 1.0 s"),
    ]


def test_before_the_first_job_it_is_told_once_what_may_take_long():
    shown = []
    progress = Progress(lambda *told: shown.append(told), first="compiles")
    progress.take({"event": "planned", "jobs": {}})
    assert not shown
    for _ in range(2):
        progress.take({"event": "planned", "jobs": {"level": 2}})
    assert shown == [(0, 2, "compiles")]


def test_the_time_left_is_told_once_a_job_without_compiling_has_ended():
    """Of a group of 7 on two cores, the first two jobs wait until code is compiled."""
    shown = []
    progress = Progress(lambda *told: shown.append(told[2]))
    progress.take({"event": "resources", "cores": 2})
    progress.take({"event": "planned", "jobs": {"member": 7, "group": 1, "all": 1}})
    begins_s = {1: 0, 2: 0, 3: 100, 4: 101, 5: 110, 6: 111, 7: 120}
    ends_s = {1: 100, 2: 101, 3: 110, 4: 111, 5: 120, 6: 121, 7: 130}
    steps = [(at_s, "begun", job) for job, at_s in begins_s.items()]
    steps += [(at_s, "ended", job) for job, at_s in ends_s.items()]
    for at_s, event, job in sorted(steps, key=lambda one: (one[0], one[1] == "begun")):
        told = {"event": event, "job": job, "at_s": at_s}
        progress.take(told | {"stage": "member", "makes_files": True})
    assert shown[:2] == ["after 2 min", "after 2 min"]
    # Four jobs of 10 s are left, one of which is nearly done.
    assert shown[2] == "about 16 s left"
    # In the end one job of a stage is left of which nothing is known.
    assert shown[-1] == "after 2 min"


def test_a_target_that_makes_nothing_is_no_stage():
    shown = []
    ended = []
    progress = Progress(lambda *told: shown.append(told), ended=ended.append)
    target = {"event": "begun", "job": 1, "stage": "all", "makes_files": False}
    progress.take({"event": "planned", "jobs": {"all": 1}})
    progress.take(target | {"at_s": 1.0})
    progress.take({"event": "ended", "job": 1, "at_s": 1.0})
    assert shown == [(1, 1, "after 0.0 s", "")]
    assert ended == ["all"]


def test_events_are_found_among_what_jobs_write():
    event = {"event": "ended", "job": 3}
    assert parted(line_of(event)) == ("", event)
    assert parted("half a line" + line_of(event)) == ("half a line\n", event)
    for line in ("a line\n", "\x1e no event\n", '\x1e{"a": 1}\n', "\x1e[1]\n"):
        assert parted(line) == (line, None)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.04, "0.0 s"), (9.4, "9.4 s"), (42.0, "42 s"), (130.0, "2 min")],
)
def test_times_in_words(seconds, words):
    assert in_words(seconds) == words


RULES = """
rule all:
    input: "b"
rule a:
    output: "a"
    shell: "echo loud; touch a"
rule b:
    input: "a"
    output: "b"
    log: "b.log"
    shell: "echo 'ERROR hopdata: no feet' > b.log; echo 'hopdata: error: no feet' >&2; exit 1"
"""


def test_snakemake_itself_tells_stages_and_one_message(tmp_path):
    (tmp_path / "Snakefile").write_text(RULES)
    command = [sys.executable, "-m", "snakemake", "--logger", "hopdata", "--cores", "1"]
    ran = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 1
    stage, message = ran.stderr.splitlines()
    assert re.fullmatch(r"hopdata: a [\d.]+ s; 1 of 3 jobs done, after [\d.]+ s", stage)
    assert message == "hopdata: error: no feet"
