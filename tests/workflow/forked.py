"""Run Snakemake like ``python -m snakemake``, without importing it each time: saves 1 s a run.

Each line on stdin is a run: its folder, environment, arguments, and files for stdout
and stderr. It is executed by a fork of this process, which has imported Snakemake but
nothing of hopdata; its exit code is written as a line to stdout. A script that it runs
is a fork in turn, which saves another half second each.
"""

import gc
import json
import os
import runpy
import signal
import subprocess
import sys
import traceback
from importlib import import_module

import PIL.Image
from numba.core.registry import cpu_target
from snakemake.benchmark import benchmarked
from snakemake.cli import get_argument_parser
from snakemake.script import PythonScript

# Imports of Snakemake, its rules and the scripts at run time.
LIBRARIES = (
    *("h5py", "jinja2", "jsonschema", "numba", "numpy", "pandas", "smart_open"),
    *(
        "matplotlib.backends.backend_svg",
        "matplotlib.figure",
        "matplotlib.style",
        "nbformat",
    ),
    *(
        "scipy.linalg",
        "scipy.optimize",
        "scipy.signal",
        "scipy.spatial",
        "scipy.special",
    ),
    *("scipy.stats", "sklearn.gaussian_process", "threadpoolctl"),
)
TIMEOUT_S = 1200


def serve():
    """Fork for each line, and return it in the fork; exit at the end of the lines."""
    for line in sys.stdin:
        if not (run := os.fork()):
            return json.loads(line)
        print(os.waitstatus_to_exitcode(os.waitpid(run, 0)[1]), flush=True)
    return sys.exit()


def execute_script(script, file, edit=False):
    """Run a job's script with the preamble that Snakemake writes, and end as it ends."""
    if not (job := os.fork()):
        os._exit(_code_of(file))
    with benchmarked(job, script.bench_record):
        code = os.waitstatus_to_exitcode(os.waitpid(job, 0)[1])
    if code:
        raise subprocess.CalledProcessError(code, file)


def _code_of(file):
    # A thread that does not exist in this fork may have held the locks of the old
    # streams.
    sys.stdout, sys.stderr = (
        os.fdopen(number, "w", closefd=False) for number in (1, 2)
    )
    try:
        runpy.run_path(file, run_name="__main__")
    except SystemExit as end:
        return end.code or 0
    except BaseException:
        traceback.print_exc()
        return 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return 0


get_argument_parser()  # also imports the plugins
for library in LIBRARIES:
    import_module(library)
# What Numba and Pillow load only at their first use.
cpu_target.typing_context.refresh()
cpu_target.target_context.refresh()
PIL.Image.init()
gc.freeze()  # no fork searches, and thereby copies, all these modules for garbage
PythonScript.execute_script = execute_script
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
