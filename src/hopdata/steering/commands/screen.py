"""The operator's screen of ``hopdata drive``, and the keys that are typed there."""

from __future__ import annotations

import math
import os
import sys
import time
from typing import TYPE_CHECKING

from hopdata.commands import terminal
from hopdata.errors import printable
from hopdata.messages import Message

if TYPE_CHECKING:
    from hopdata.steering.live.buffer import Stream
    from hopdata.steering.live.log import DriveLog
    from hopdata.steering.live.loop import ControlLoop, Decision
    from hopdata.steering.strides import Input, State, StrideAxes

# Time between two pictures on the screen, s.
DRAW_S = 0.25

# What the operator types to arm the drive.
ARM_KEY = "a"


class Screen:
    """Shows state, pose, hop, plan, time left and faults: a picture, or a line per hop.

    The picture is drawn on a terminal. There, a and Enter arm the drive. Enter alone,
    or after anything else, is the operator's stop key: the boom rests and the drive is
    over.
    """

    def __init__(
        self,
        title: str,
        seconds: float | None,
        command_s: float,
        log: DriveLog,
        axes: StrideAxes,
    ) -> None:
        self._axes = axes
        self._seconds = seconds
        self._command_s = command_s
        self._log = log
        self._begun = time.monotonic()
        self._drawn = self._begun
        self._hops = 0
        self._n_rests_told = 0
        self._n_steps_told = 0
        self._boom_told = False
        self._refusal = ""
        self._last_hop = "no stance yet"
        self._is_live = is_on_terminal()
        self._n_lines_drawn = 0
        print(title)
        if self._is_live:
            print("a and Enter: arm it, at first and after each rest")
            print("Enter or Ctrl-C: the robot rests, and it ends")

    def decided(self, decision: Decision) -> None:
        """Record the decision at a stance; called in the loop's thread."""
        self._hops += 1
        x, y, heading = decision.pose
        last_hop = (
            f"hop {self._hops:3d}  {_metres('x', x)}, {_metres('y', y)}, "
            f"{_degrees('heading', heading)}{self._states_of(decision)}\n"
            f"         {decision.outcome}: {self._swing_of(decision)}"
        )
        if decision.reason is not None:
            last_hop += f"; {decision.reason}"
        self._last_hop = last_hop
        if not self._is_live:
            print(" ".join(last_hop.split()), flush=True)

    def _states_of(self, decision: Decision) -> str:
        """Return the states of the robot at the stance."""
        from hopdata.steering.live.decisions import is_hopper

        if is_hopper(self._axes):
            return f", {_degrees('boom', decision.boom_angle_rad)}"
        values = zip(self._axes.states, decision.state, strict=True)
        return "".join(f", {_in_unit(one, value)}" for one, value in values)

    def _swing_of(self, decision: Decision) -> str:
        """Return what was sent, and how long the plan took, if there was one."""
        if math.isnan(decision.command[0]):
            names = " or ".join(self._axes.input_names).replace("_", " ")
            return f"no {names} is sent"
        values = zip(self._axes.inputs, decision.command, strict=True)
        sent = ", ".join(_in_unit(one, value) for one, value in values)
        if math.isnan(decision.planning_s):
            return sent
        planning_ms = 1e3 * decision.planning_s
        spare_ms = 1e3 * (self._command_s - decision.since_stance_s)
        return f"{sent}, plan took {planning_ms:.1f} ms, {spare_ms:.0f} ms to spare"

    def look(self, loop: ControlLoop, stream: Stream) -> None:
        """React to the operator's keys and update the display."""
        if not self._boom_told:
            self._boom_told = True
            print(loop.watch.says_of_boom(), flush=True)
        typed = _typed_line() if self._is_live else None
        if typed == ARM_KEY:
            refused = loop.arm()
            self._refusal = "" if refused is None else f"NOT ARMED: {refused}"
        elif typed is not None:
            loop.end(Message("steering.operators_key"))
        if self._is_live:
            self._draw(loop, stream)
        else:
            self._tell_rests(loop)

    def _tell_rests(self, loop: ControlLoop) -> None:
        """Print the rests and the states since the last look."""
        rests = loop.watch.rests
        for rest in rests[self._n_rests_told :]:
            print(f"the {loop.watch.what} rests: {rest.cause}", flush=True)
        self._n_rests_told = len(rests)

    def _draw(self, loop: ControlLoop, stream: Stream) -> None:
        """Draw the picture over the last one, unless that is too young."""
        now = time.monotonic()
        if now < self._drawn + DRAW_S:
            return
        self._drawn = now
        lines = self._picture(loop, stream, now - self._begun)
        up = f"\033[{self._n_lines_drawn}A" if self._n_lines_drawn else ""
        columns = os.get_terminal_size().columns or 80  # 0 where nobody has set it
        width = columns - 1  # wrapped lines would leave remains
        drawn = [f"\033[K{printable(line[:width])}" for line in lines]
        screen = terminal.raw_stream(sys.stdout)
        print(up + "\n".join(drawn), file=screen, flush=True)
        self._n_lines_drawn = len(lines)

    def _picture(self, loop: ControlLoop, stream: Stream, passed_s: float) -> list[str]:
        left = ""
        if self._seconds is not None:
            left = f", {max(0.0, self._seconds - passed_s):.0f} s left"
        counts = stream.counts
        frames = f"{counts.frames} frames, {counts.missing} missing"
        state = f"stream {stream.states.status.state}"
        rests = loop.watch.rests
        lasting = "; ".join(map(str, list(loop.watch.machine.lasting.values())))
        last_rest = f", the last: {rests[-1].cause}" if rests else ""
        lines = [
            f"{passed_s:6.0f} s{left}; {state}, {frames}, {counts.garbled} garbled",
            f"{str(loop.state).upper()}  {self._what_next(loop)}",
            *self._last_hop.splitlines(),
            f"faults   {lasting or 'none now'}; rests so far: {len(rests)}{last_rest}",
        ]
        if self._log.failure:  # otherwise the logger has said it
            lines.append(f"log      {self._log.failure}")
        return lines

    def _what_next(self, loop: ControlLoop) -> str:
        """Return what the operator can do in this state."""
        state = loop.state
        if state == "armed":
            return "the first swing is sent at the next stance"
        if state not in ("waiting", "resting"):
            return str(loop.watch.cause or "")
        if self._refusal and loop.watch.machine.lasting:
            return self._refusal
        why = f"{loop.watch.cause}; " if state == "resting" else ""
        return f"{why}a and Enter to arm it"


def _metres(name: str, place_m: float) -> str:
    if math.isnan(place_m):
        return f"{name} not seen"
    return f"{name} {place_m:+.2f} m"


def _degrees(name: str, angle_rad: float) -> str:
    if math.isnan(angle_rad):
        return f"{name} not seen"
    # Rounded first: a little less than a turn is 0, not 360.
    return f"{name} {round(math.degrees(angle_rad)) % 360:3d} deg"


def _in_unit(axis: Input | State, value: float) -> str:
    """Return a state or an input with its unit."""
    name = axis.name.replace("_", " ")
    if math.isnan(value):
        return f"{name} not known"
    return f"{name} {value:+.2f} {axis.unit.replace('_', '/')}"


def is_on_terminal() -> bool:
    """Tell whether an operator sees the screen and can type."""
    return sys.stdout.isatty() and sys.stdin.isatty()


def _typed_line() -> str | None:
    """Return the line that was typed since the last call, if one was; never wait."""
    if sys.platform == "win32":
        return _typed_on_windows()
    import select

    ready, _, _ = select.select([sys.stdin], [], [], 0.0)
    if not ready:
        return None
    line = sys.stdin.readline()
    return line.strip() if line else None  # None at the end of the input


# Keys that were typed on Windows, up to Enter.
_typed: list[str] = []


def _typed_on_windows() -> str | None:
    import msvcrt

    while msvcrt.kbhit():  # type: ignore[attr-defined, unused-ignore]
        key = msvcrt.getwch()  # type: ignore[attr-defined, unused-ignore]
        if key in "\r\n":
            line = "".join(_typed).strip()
            _typed.clear()
            return line
        _typed.append(key)
    return None
