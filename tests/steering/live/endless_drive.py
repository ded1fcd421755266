"""A drive in its own process until it is told to end. Arguments: port, port of the swings, log."""

import sys
import threading

from test_drive import LENIENT, Controller, geometry

from hopdata.steering.live.actuator import UdpBoom
from hopdata.steering.live.drive import drive
from hopdata.steering.live.log import DriveLog

port, swing_port, path = sys.argv[1:]
with UdpBoom(int(swing_port)) as boom:
    drive(
        geometry(), Controller(), boom, port=int(port), stop=threading.Event(), limits=LENIENT, armed=True,
        log=DriveLog(path, 4, setup={}, files={}),
    )  # fmt: skip
