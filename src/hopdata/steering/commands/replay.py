"""``hopdata replay``: the log of a drive, played again."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hopdata.commands import terminal
from hopdata.errors import counted, require
from hopdata.steering.commands.parts import parts_of, robot_of

if TYPE_CHECKING:
    from hopdata.steering.live.loop import Observers

# A frame rate that no camera reaches; JSON may hold any number.
MOST_HZ = 1e6


def replay(options: argparse.Namespace) -> int:
    """Feed a log to the same controller; exit code 1 if a plan differs."""
    from hopdata.steering.live.limits import Limits
    from hopdata.steering.live.log_reading import read_log
    from hopdata.steering.live.loop import checks_of, observers_of
    from hopdata.steering.live.replay import replay as replayed

    log = read_log(options.log)
    _require_settings(options.log, log.setup)
    named = options.robot or log.setup.get("robot")
    robot = robot_of(named, by_user=options.robot is not None)
    geometry, controller = parts_of(log.setup, log.files, robot)
    rate_hz = log.setup["rate_hz"]
    limits = Limits(**log.setup["limits"])
    observers: Observers = observers_of(geometry, rate_hz)
    if robot is not None:
        observers = robot.observers(geometry, rate_hz)
    plans = replayed(
        log,
        observers,
        controller,
        limits=limits,
        checks=checks_of(geometry, rate_hz, limits),
    )
    parts = [
        f"simulated {named or 'hopper'}"
        if log.setup["simulated"]
        else "recorded robot",
        counted(len(log.frames), "frame"),
        counted(len(log.decisions), "stance"),
        counted(len(plans), "plan"),
    ]
    print(f"{options.log}: {', '.join(parts)}")
    for event in log.events[log.events["kind"] == "rest"].itertuples():
        print(f"  at rest at {event.sent_s:.3f} s: {event.text}")
    other = plans[~plans["same"]]
    for plan in other.to_dict("records"):
        inputs = f"planned {_listed(plan['then'])} then, {_listed(plan['now'])} now"
        print(f"  {plan['told_s']:.3f} s: {inputs}")
    n_same = len(plans) - len(other)
    print(f"{n_same} of {counted(len(plans), 'plan')} the same to the bit")
    return terminal.PROBLEM if len(other) else terminal.OK


def _listed(inputs: Sequence[float]) -> str:
    return ", ".join(map(repr, inputs))


def _require_settings(log: Path, setup: Mapping[str, Any]) -> None:
    """Require the settings that a drive stores in its log, each of its kind.

    Raises
    ------
    ConfigError
        If one is missing or of another kind.
    """
    from hopdata.steering.live.limits import Limits

    place = f"{log}: setup"
    heading = setup.get("heading_deg")
    is_goal = heading is None or _is_number(heading)
    if heading is None:
        to: Any = setup.get("to")
        is_pair = isinstance(to, list) and len(to) == 2
        is_goal = is_pair and all(map(_is_number, to))
    require(is_goal, place, "a goal: heading_deg, or to", f"{setup.get('to')!r}"[:40])
    named = setup.get("robot")
    is_name = named is None or isinstance(named, str)
    require(is_name, f"{place}.robot", "a name", f"{named!r}"[:40])
    for key in ("adaptive", "simulated"):
        value = setup.get(key)
        require(isinstance(value, bool), f"{place}.{key}", "true or false", value)
    rate_hz: Any = setup.get("rate_hz")
    is_rate = _is_number(rate_hz) and 0 < rate_hz < MOST_HZ
    require(is_rate, f"{place}.rate_hz", "a frame rate", f"{rate_hz!r}"[:40])
    limits = setup.get("limits")
    known = {one.name for one in fields(Limits)}
    is_sound = (
        isinstance(limits, dict)
        and {"swing_rad"} <= {*limits} <= known
        and all(map(_is_number, limits.values()))
    )
    wanted = f"numbers for {', '.join(sorted(known))}"
    require(is_sound, f"{place}.limits", wanted, f"{limits!r}"[:40])


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return math.isfinite(value)
