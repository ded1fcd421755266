"""``hopdata drive --rehearse``: acts that must bring a robot to rest, in a table."""

from __future__ import annotations

import argparse
import logging
import math
from typing import TYPE_CHECKING

from hopdata.commands import terminal
from hopdata.errors import counted
from hopdata.steering.commands.excite import GEOMETRY
from hopdata.steering.commands.parts import limits_of, no_model, robot_of

if TYPE_CHECKING:
    from hopdata.steering.live.rehearsed_acts import Performed
    from hopdata.steering.live.robots import DrivenRobot

# Columns of the table of a rehearsal.
ACT_WIDTH = 50
REST_WIDTH = 37

# Time of an act of a rehearsal on a free machine, on the average, s.
ACT_S = 2.0


def rehearse(options: argparse.Namespace) -> int:
    """Perform each act that must bring the boom to rest, or list them for a robot."""
    if options.host is not None:
        _list_acts(options)
        return terminal.OK
    return _perform_acts(options)


def _list_acts(options: argparse.Namespace) -> None:
    from hopdata.steering.live.rehearsed_acts import all_acts
    from hopdata.steering.observation.geometry import load_geometry

    robot = robot_of(options.robot)
    limits = limits_of(options, robot)
    if options.model is None:
        raise no_model()
    geometry = load_geometry(options.model / GEOMETRY)
    print(
        "With the robot on a rope, and a hand on the emergency stop. "
        "Begin each act while it"
    )
    print(
        "hops, or while you lift it and set it down: "
        "without a stance no swing is sent.\n"
    )
    what = _what_moves(robot)
    print(f"  {'do this':{ACT_WIDTH}}  the {what} must rest, and the screen must say")
    for act in all_acts(geometry, limits, robot):
        if act.by_hand:
            print(f"  {act.by_hand:{ACT_WIDTH}}  {act.rest}")


def _perform_acts(options: argparse.Namespace) -> int:
    from hopdata.steering.live.rehearsal import perform, simulated_geometry
    from hopdata.steering.live.rehearsed_acts import all_acts

    robot = robot_of(options.robot)
    limits = limits_of(options, robot)
    if robot is None:
        with terminal.progress_line("learning the geometry of the simulated hopper"):
            geometry = simulated_geometry()
    else:
        robot.simulation()  # refused at once if there is none
        geometry = robot.geometry
    print(f"SIMULATED {options.robot or 'hopper'}; there is no robot")
    n_acts = len(all_acts(geometry, limits, robot))
    print(f"{counted(n_acts, 'act')}, some {n_acts * ACT_S:.0f} s on a free machine\n")
    columns = f"{'act':{ACT_WIDTH}}  {'rest expected':{REST_WIDTH}}"
    print(f"  {columns}  {'ms':>5}  what happened")
    wrong = 0
    logging.disable(logging.ERROR)  # the table says what the loop would log
    try:
        with terminal.progress_line(f"act 1 of {n_acts}") as progress:
            for number, done in enumerate(perform(geometry, limits, robot), 1):
                print(_row(done), flush=True)
                if not done.is_right:
                    wrong += 1
                if number < n_acts:
                    progress(f"act {number + 1} of {n_acts}")
    finally:
        logging.disable(logging.NOTSET)
    if wrong:
        print(f"\n{counted(wrong, 'act')} without the rest expected: do not drive")
        return terminal.PROBLEM
    what = _what_moves(robot)
    print(f"\neach act has brought the {what} to rest, until it was armed again")
    return terminal.OK


def _what_moves(robot: DrivenRobot | None) -> str:
    """Return what messages call the part that the inputs move."""
    from hopdata.steering.frame_changes import HOPPER
    from hopdata.steering.live.decisions import moved_part

    return moved_part(HOPPER if robot is None else robot.axes)


def _row(done: Performed) -> str:
    """Return a row of the table; a "!" marks an act without the rest expected."""
    act = done.act
    mark = " " if done.is_right else "!"
    after_ms = "-" if math.isnan(done.after_s) else f"{1e3 * done.after_s:.0f}"
    happened = str(done.cause or "NO REST")
    if done.moved:
        happened = f"MOVED after its rest: {happened}"
    elif done.resumed:
        happened = f"WENT ON by itself: {happened}"
    elif not done.obeyed:
        arming = "COULD be armed again" if act.is_over else "COULD NOT be armed again"
        happened = f"{arming}: {happened}"
    elif done.after_s > act.within_s:
        happened = f"TOO LATE, beyond {1e3 * act.within_s:.0f} ms: {happened}"
    columns = f"{act.name:{ACT_WIDTH}}  {act.rest:{REST_WIDTH}}"
    return f"{mark} {columns}  {after_ms:>5}  {happened}"
