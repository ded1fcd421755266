"""Functions that tests of the door call in another process."""

import os
import signal
import socket
import subprocess
import sys
import time

import numpy as np

from hopdata.errors import ConfigError
from hopdata.messages import Message
from hopdata.recording import Event


def echo(*arguments):
    return arguments


def event():
    return [Event("touch", 1.5)], Message("recordings.frames", {"number": 3})


def many_bytes(n_bytes):
    return np.zeros(n_bytes, np.uint8)


def endless():
    while True:
        pass


def asleep():
    time.sleep(100)


def ask_for_50_gb():
    return np.ones(50_000_000_000 // 8)


def ask_for_more_and_more():
    kept = []
    while True:
        kept.append(b"x" * 10_000_000)


def ask_in_words():
    raise OSError("Can't open object (unable to allocate a buffer)")


def crash():
    os.kill(os.getpid(), signal.SIGSEGV)


def killed():
    os.kill(os.getpid(), signal.SIGKILL)


def ended():
    os._exit(0)


def left():
    raise SystemExit(4)


def noisy():
    print("hello" * 100_000)
    os.write(1, b"junk")
    sys.stderr.write("junk")
    return "said"


def connect():
    socket.create_connection(("127.0.0.1", 9), 2)


def connect_beneath_python():
    import ctypes

    library = ctypes.CDLL(None, use_errno=True)
    number = library.socket(socket.AF_INET, socket.SOCK_DGRAM, 0)
    # Port 53 of a documentation network (RFC 5737), in network order.
    address = bytes([2, 0, 0, 53, 192, 0, 2, 1]) + bytes(8)
    return library.connect(number, address, 16)


def write(path):
    with open(path, "w") as file:
        file.write("x")


def write_beneath_python(path):
    import ctypes

    library = ctypes.CDLL(None)
    library.signal(int(signal.SIGXFSZ), 1)  # ignored
    number = library.open(path.encode(), os.O_WRONLY | os.O_CREAT, 0o600)
    return library.write(number, b"x" * 100, 100)


def run_program():
    subprocess.run(["true"], check=True)


def load_pickle():
    import pickle

    return len(pickle.loads(pickle.dumps(os.getpid)))


def no_plain_value():
    return [object()]


def too_deep():
    value = []
    for _ in range(100):
        value = [value]
    return value


def mistaken():
    raise ConfigError.at("here", "a", "b", key="markers.body")


def mistaken_with_code():
    raise ConfigError(Message("recordings.frames", {"number": 3}))


def wrong():
    return {}["x"]


def search_path():
    return sys.path


def environment():
    return os.getcwd(), os.getpid(), os.getppid()


def nested():
    from hopdata.foreign import door

    return door.read("calls:environment", place="inside", n_bytes=1)[1], os.getpid()


def limits():
    import resource

    names = ("RLIMIT_DATA", "RLIMIT_AS", "RLIMIT_CPU", "RLIMIT_CORE", "RLIMIT_FSIZE")
    return {name: resource.getrlimit(getattr(resource, name)) for name in names}


def raise_own_limit():
    import resource

    resource.setrlimit(resource.RLIMIT_CPU, (3600, 3600))
