"""Run Snakemake as ``python -m snakemake`` does, without importing it each time: a second a run.

Each line on stdin is a run: its folder, environment, arguments, files for its stdout and stderr.
A fork of this process, which has imported Snakemake and nothing of hopdata, does it; its exit code
is a line on stdout.
"""

import json
import os
import runpy
import signal
import sys

import jsonschema  # noqa: F401, as those below: what Snakemake and its rules import when they run
import pandas as pd  # noqa: F401
import smart_open  # noqa: F401
from snakemake.cli import get_argument_parser

get_argument_parser()  # imports the plugins, too
TIMEOUT_S = 1200


def serve():
    """Fork for each line, and return it in the fork; end with the lines."""
    for line in sys.stdin:
        if not (run := os.fork()):
            return json.loads(line)
        print(os.waitstatus_to_exitcode(os.waitpid(run, 0)[1]), flush=True)
    return sys.exit()


folder, environment, arguments, files = serve()
signal.alarm(TIMEOUT_S)
for number, file in enumerate([os.devnull, *files]):
    os.dup2(os.open(file, os.O_RDWR), number)
os.chdir(folder)
os.environ.clear()
os.environ.update(environment)
sys.path[:1] = [folder, environment["PYTHONPATH"]]
sys.argv = ["", *arguments]
runpy.run_module("snakemake", run_name="__main__", alter_sys=True)
