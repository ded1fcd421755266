"""A drive in a process of its own, until it is told to end: port, port of the swings, folder."""

import sys
import threading

from test_drive import LENIENT, Controller, geometry

from hopdata.steering.live.boom import UdpBoom
from hopdata.steering.live.drive import drive

port, swing_port, folder = sys.argv[1:]
with UdpBoom(int(swing_port)) as boom:
    drive(
        geometry(), Controller(), boom, port=int(port), stop=threading.Event(), limits=LENIENT,
        folder=folder,
    )  # fmt: skip
