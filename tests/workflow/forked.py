"""Run Snakemake like ``python -m snakemake``, without importing it each time: saves 1 s a run.

Each line on stdin is a run: its folder, environment, arguments, and files for stdout
and stderr. It is executed by a fork of this process, which has imported Snakemake but
nothing of hopdata; its exit code is written as a line to stdout. Its jobs begin as for a
user, as forks of a server (`hopdata.forks`), which here has imported the libraries too:
saves another half second a job.
"""

import gc
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import time
from importlib import import_module

import PIL.Image
from numba.core.registry import cpu_target
from snakemake.cli import get_argument_parser

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


class Fork:
    """A fork of this process, with what is asked of a `subprocess.Popen`."""

    def __init__(self, pid):
        self.pid = pid
        self.returncode = None

    def poll(self):
        if self.returncode is None:
            ended, status = os.waitpid(self.pid, os.WNOHANG)
            if ended:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout):
        until = time.monotonic() + timeout
        while self.poll() is None:
            if time.monotonic() > until:
                raise subprocess.TimeoutExpired("a fork", timeout)
            time.sleep(0.005)
        return self.returncode


def give_a_warm_server(forks):
    """Make the first server of the run's jobs now: a fork with the libraries.

    Snakemake has threads once it runs, which no fork should have. If the run wants
    another server, as the first was killed, it starts that as for a user.
    """
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    pid = os.fork()
    if not pid:
        ours.close()
        os.environ.update(forks.ONE_THREAD, PYTHONSAFEPATH="1")
        sys.path.remove(folder)
        forks.be_server(theirs.detach())
        os._exit(0)
    theirs.close()
    warm = [(ours, Fork(pid))]
    new_server = forks.new_server

    def warm_server():
        return warm.pop() if warm else new_server()

    forks.new_server = warm_server


get_argument_parser()  # also imports the plugins
for library in LIBRARIES:
    import_module(library)
# What Numba and Pillow load only at their first use.
cpu_target.typing_context.refresh()
cpu_target.target_context.refresh()
PIL.Image.init()
gc.freeze()  # no fork searches, and thereby copies, all these modules for garbage
folder, environment, arguments, files = serve()
signal.alarm(TIMEOUT_S)
for number, file in enumerate([os.devnull, *files]):
    os.dup2(os.open(file, os.O_RDWR), number)
os.chdir(folder)
os.environ.clear()
os.environ.update(environment)
sys.path[:1] = [folder, environment["PYTHONPATH"]]
give_a_warm_server(import_module("hopdata.forks"))
sys.argv = ["", *arguments]
runpy.run_module("snakemake", run_name="__main__", alter_sys=True)
