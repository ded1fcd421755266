"""The sender: calls the boom's driver, insists on a rest, and sends heartbeats."""

import logging
import math
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from hopdata.steering.live.actuator import Driven, driver_of
from hopdata.steering.live.buffer import Worker
from hopdata.steering.live.decisions import Numbers
from hopdata.steering.live.packets import LiveError

#: Time between rests that are sent again.
#: Unit: s. Origin: chosen.
REPEAT_S = 0.01
#: Time after the last look of the watch in which heartbeats are still sent.
#: Unit: s. Origin: chosen: ten looks of the watch.
PERMITTED_S = 0.1
#: Heartbeats that wait for an answer, whose times are kept.
#: Unit: 1. Origin: chosen.
MOST_UNHEARD = 1000
#: Longest time for the last rest to arrive.
#: Unit: s. Origin: chosen.
LAST_REST_S = 1.0

logger = logging.getLogger(__name__)


class Command:
    """Inputs on their way to the actuator, and what became of them.

    `done` is set once the boom's driver has returned, or a newer command came before it
    was called (`replaced`). `sent_s` is when the driver returned, s; `error` is what it
    raised, if anything. A command that nobody waits for any more is `withdrawn`: the
    driver is not called for it.
    """

    def __init__(self, inputs: Numbers, *, is_rest: bool) -> None:
        self.inputs = inputs
        self.is_rest = is_rest
        self.done = threading.Event()
        self.replaced = False
        self.withdrawn = False
        self.sent_s = math.nan
        self.error: BaseException | None = None


class Sender(Worker):
    """Calls the boom in a thread of its own; a driver that blocks delays nobody else.

    Only the newest command counts: it replaces those that the driver has not been
    given. A rest is sent again every `REPEAT_S` until the driver returns without an
    error and the boom, if it can tell, has heard it. Before `start` commands are sent
    in the caller's thread, as on a simulated clock.

    Heartbeats are sent as long as somebody says that the loop is alive (`permit`); a
    loop that hangs must not look alive to the robot.
    """

    def __init__(
        self,
        boom: Driven,
        clock: Callable[[], float],
        alive_s: float = 0.02,
        rest: Numbers = (0.0,),
    ) -> None:
        super().__init__("hopdata-boom", self._run)
        self._boom: Any = boom
        self._drive = driver_of(boom)
        self.rest = rest
        self._clock = clock
        self._alive_s = alive_s
        # Numbers and times of heartbeats that are not answered yet.
        self._unheard: deque[tuple[int, float]] = deque()
        self._beats = 0
        self._next_beat_s = -math.inf
        self._permitted_s = math.inf
        names = ("alive", "heard")
        self.is_acknowledging = all(hasattr(boom, name) for name in names)
        self._waiting: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._last: Command | None = None
        self._unheard_rest: Command | None = None
        self._called_s = math.inf  # when the driver was called that has not returned
        self._fails_to_tell = False

    def put(self, inputs: Numbers) -> Command:
        """Give the actuator inputs; returns at once if the thread runs."""
        command = Command(inputs, is_rest=inputs == self.rest)
        self._last = command
        if self._thread.ident is None:
            self._send(command)
        else:
            self._waiting.put(command)
        return command

    def again(self) -> None:
        """Send what is due again: a rest that is not heard, and the next heartbeat.

        For callers without a thread.
        """
        if self._thread.ident is None:
            self._insist()
            self._beat()

    def permit(self) -> None:
        """Say that the loop is alive; heartbeats go on for `PERMITTED_S`."""
        self._permitted_s = self._clock()

    def unheard_s(self) -> float:
        """Return for how long the oldest heartbeat has not been answered, s."""
        if not self._unheard:
            return 0.0
        with suppress(IndexError):  # it may be answered meanwhile
            return max(0.0, self._clock() - self._unheard[0][1])
        return 0.0

    def blocked_s(self) -> float:
        """Return for how long the driver has not returned, s; 0 if it is not called."""
        return max(0.0, self._clock() - self._called_s)

    def close(self) -> None:
        """Stop the thread, after `LAST_REST_S` at most for the last command to arrive.

        Raises
        ------
        LiveError
            If the driver does not return.
        """
        if self._thread.ident is None or self._stop.is_set():
            return
        until_s = time.monotonic() + LAST_REST_S
        if self._last is not None:
            self._last.done.wait(LAST_REST_S)
        while self._unheard_rest is not None and time.monotonic() < until_s:
            time.sleep(0.1 * REPEAT_S)
        self._stop.set()
        self._thread.join(LAST_REST_S)
        if self._thread.is_alive():
            raise LiveError(
                f"the boom's driver has not returned for {self.blocked_s():.1f} s"
            )
        if self._unheard_rest is not None:
            logger.error("the boom did not acknowledge the last rest")

    def _run(self) -> None:
        while not self._stop.is_set():
            command = self._newest()
            if command is None:
                self._insist()
            else:
                self._send(command)
            self._beat()

    def _newest(self) -> Command | None:
        """Return the newest command within `REPEAT_S`, if any; it replaces others."""
        newest: Command | None = None
        with suppress(queue.Empty):
            newest = self._waiting.get(timeout=REPEAT_S)
            while True:
                following = self._waiting.get_nowait()
                newest.replaced = True
                newest.done.set()
                newest = following
        return newest

    def _insist(self) -> None:
        """Send a rest again that failed, or that the boom has not heard."""
        rest = self._unheard_rest
        if rest is None:
            return
        if rest.error is None and self._is_heard():
            self._unheard_rest = None
        else:
            self._send(rest)

    def _beat(self) -> None:
        """Send the next heartbeat if it is due, and see which were answered."""
        if not self.is_acknowledging:
            return
        now = self._clock()
        self._called_s = now
        try:
            heard = int(self._boom.heard())
            while self._unheard and self._unheard[0][0] <= heard:
                self._unheard.popleft()
            is_alive = now - self._permitted_s <= PERMITTED_S
            if now >= self._next_beat_s and is_alive:
                self._beats += 1
                self._next_beat_s = now + self._alive_s
                if len(self._unheard) < MOST_UNHEARD:  # the oldest one counts
                    self._unheard.append((self._beats, now))
                self._boom.alive(self._beats)
        except BaseException as error:  # whatever it is, the thread goes on
            if not self._fails_to_tell:
                logger.error("the boom cannot tell whether it has heard: %r", error)
            self._fails_to_tell = True
        finally:
            self._called_s = math.inf

    def _is_heard(self) -> bool:
        """Ask a boom that can tell; one that fails to tell has not heard."""
        asked = getattr(self._boom, "acknowledged", None)
        if asked is None:
            return True
        self._called_s = self._clock()
        try:
            return bool(asked())
        except BaseException as error:  # whatever it is, the thread goes on
            if not self._fails_to_tell:
                logger.error("the boom cannot tell whether it has heard: %r", error)
            self._fails_to_tell = True
            return False
        finally:
            self._called_s = math.inf

    def _send(self, command: Command) -> None:
        if command.withdrawn:
            command.done.set()
            return
        self._unheard_rest = command if command.is_rest else None
        failed_before = command.error is not None
        self._called_s = self._clock()
        try:
            self._drive(command.inputs)
            failure: BaseException | None = None
        except BaseException as error:  # whatever it is, the thread goes on
            failure = error
            if command.is_rest and not failed_before:
                logger.error("the boom failed to rest: %r", error)
        self._called_s = math.inf
        if math.isnan(command.sent_s) and failure is None:
            command.sent_s = self._clock()
        command.error = failure  # last, since others look at it meanwhile
        command.done.set()


def rest_within(boom: Driven, seconds: float, rest: Numbers = (0.0,)) -> bool:
    """Command an actuator to rest from a thread of its own.

    Return whether its driver has returned. For the end of a drive, where the sender's
    thread may never have begun, or is blocked.
    """
    returned = threading.Event()

    def send() -> None:
        with suppress(Exception):  # the robot may be gone
            driver_of(boom)(rest)
        returned.set()

    threading.Thread(target=send, name="hopdata-last-rest", daemon=True).start()
    return returned.wait(seconds)
