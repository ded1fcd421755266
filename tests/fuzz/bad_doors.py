"""Doors that break each promise once, for the test of the oracle."""

import os
import pickle
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from doors import Door, nothing

from hopdata.errors import ConfigError, RecordingError

GIGABYTE = 1_000_000_000


def _refuses(path):
    raise RecordingError.at(path, "a recording", "something else")


def _raises(path):
    return {}[path.name]


def _warns(_):
    return np.float64(1) / np.zeros(1)


def _exits(_):
    sys.exit(3)


def _dies(_):
    os._exit(7)


def _loops(_):
    while True:
        pass


def _takes_long(_):
    end = time.process_time() + 0.8
    while time.process_time() < end:
        pass


def _touches(_):
    np.ones(int(1.2 * GIGABYTE) // 8)


def _reserves(_):
    np.empty(3 * GIGABYTE // 8)


_CHILD = "b = bytearray(1_200_000_000); print(1, flush=True); input()"


def _child_touches(_):
    command = [sys.executable, "-c", _CHILD]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    limits = {"preexec_fn": _without_limits}
    KEPT.append(subprocess.Popen(command, **pipes, **limits))
    KEPT[-1].stdout.readline()


def _without_limits():
    """Lift the limits, as a child does that sets its own."""
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (hard, hard))


KEPT: list = []


def _colours(path):
    raise _ColourfulError(f"{path}: \x1b[31mred")


class _ColourfulError(RecordingError):
    def __str__(self):
        return str(self.args[0])


def _prints(_):
    print("\x1b[2J")


def _breaks(path):
    raise _ColourfulError(f"{path}: one\ntwo")


def _talks(path):
    raise _ColourfulError(f"{path}: {'on ' * 1000}")


def _names_none(_):
    raise ConfigError("something is wrong")


def _writes(_):
    place = Path(__file__).with_name("written.txt")
    with place.open("r+"):  # there is none, so nothing is left behind
        pass


def _starts(_):
    subprocess.run(["true"], check=False)


def _connects(_):
    with socket.socket() as one:
        one.settimeout(0.1)
        one.connect(("127.0.0.1", 9))


def _loads(_):
    pickle.loads(pickle.dumps(Path(tempfile.gettempdir())))


def _is_finite(_):
    raise AssertionError("no finite time")


def _copies(path):
    return np.ones(5 * path.stat().st_size, np.uint8)


def _door(enter, check=nothing):
    return Door(dict, enter, check)


DOORS = {
    "sound": _door(Path.read_bytes),
    "refuses": _door(_refuses),
    "raises": _door(_raises),
    "warns": _door(_warns),
    "exits": _door(_exits),
    "dies": _door(_dies),
    "loops": _door(_loops),
    "takes_long": _door(_takes_long),
    "touches_memory": _door(_touches),
    "reserves_memory": _door(_reserves),
    "lets_a_child_touch_memory": _door(_child_touches),
    "colours_its_error": _door(_colours),
    "prints_escapes": _door(_prints),
    "breaks_its_error": _door(_breaks),
    "talks_on_and_on": _door(_talks),
    "names_no_file": _door(_names_none),
    "writes_outside": _door(_writes),
    "starts_a_program": _door(_starts),
    "connects": _door(_connects),
    "loads_a_pickle": _door(_loads),
    "returns_nonsense": _door(nothing, _is_finite),
    "copies": _door(_copies),
}
