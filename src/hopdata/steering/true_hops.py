"""Hops of the simulated robot with what only the simulator knows: contacts and states.

A row is a hop from one stance to the next, as in the table of frame changes
(Sec. 3.4.1). Its mode schedule is two orders: in which the legs lift off from the first
stance, and in which they land for the second. With three legs there are 36.
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.feet import order_name
from hopdata.rigid import relative, turned, wrapped
from hopdata.scenes.body import YAW
from hopdata.scenes.scene import Control
from hopdata.steering import robot as plant
from hopdata.steering.frame_changes import FrameChanges
from hopdata.steering.strides import TURN, USED, TextArray
from hopdata.synthesis.hops import Hop

VELOCITY = slice(6, 9)  # columns of the state of a body


@dataclass(frozen=True)
class TrueHops:
    """Hops from stance to stance, with their true contact orders and states.

    Parameters
    ----------
    changes : FrameChanges
        Boom angle, swing and frame change of each of the n hops, without noise.
    previous_swing_rad : (n,) array
        Swing in the hop before.
    apex : (n, 12) array
        State in flight at which the hop begins, as `hopdata.scenes.body` has it, after
        the random kick. Position, heading and horizontal velocity are those in the
        frame of the first stance.
    lift_off : (n,) str array
        Order in which the legs leave the first stance, such as "3>1>2".
    landing : (n,) str array
        Order in which they touch down for the second.
    """

    changes: FrameChanges
    previous_swing_rad: FloatArray
    apex: FloatArray
    lift_off: TextArray
    landing: TextArray

    def __len__(self) -> int:
        return len(self.changes)

    @property
    def schedule(self) -> TextArray:
        """Mode schedule of each hop, (n,): both orders, such as "3>1>2, 1>2>3"."""
        spaced = np.char.add(self.lift_off, ", ")
        return np.asarray(np.char.add(spaced, self.landing))

    def rows(self, chosen: BoolArray | IntArray | slice) -> TrueHops:
        """Return some of the hops, chosen by number or by a boolean for each."""
        numbers = np.arange(len(self))[chosen]
        return TrueHops(
            changes=self.changes.rows(numbers),
            previous_swing_rad=self.previous_swing_rad[numbers],
            apex=self.apex[numbers],
            lift_off=self.lift_off[numbers],
            landing=self.landing[numbers],
        )


def true_hops(
    robot: plant.SteeredHopper,
    swings_rad: Iterable[float],
    *,
    seed: int | np.random.SeedSequence,
    control: Control | None = None,
) -> TrueHops:
    """Let the simulated robot make these swings, and return its hops with the truth.

    It hops on without being carried back, since a hop does not depend on where it is
    made. After a fall it is released anew. A hop counts if all legs stood in it and in
    the one before.

    Parameters
    ----------
    robot : SteeredHopper
    swings_rad : iterable of float
        Swing in the flight of each hop, rad.
    seed : int or SeedSequence
        Seed of the kicks.
    control : Control, optional
        Lands in place of the robot, from each apex of the robot's own hops: its
        landings may break the conditions for a continuously differentiable flow.

    Returns
    -------
    TrueHops
        At most one row fewer than there are swings.

    Raises
    ------
    AnalysisError
        If no hop counts.
    """
    rng = np.random.default_rng(seed)
    apex = plant.released(robot, np.zeros(3))
    before: plant.SteeredHop | None = None
    rows = []
    for swing in swings_rad:
        same_kicks = deepcopy(rng)
        own = plant.steer_hop(robot, apex, swing, rng=rng)
        landed = own
        if control is not None:
            landed = plant.steer_hop(
                robot, apex, swing, rng=same_kicks, control=control
            )
        if before is not None and _stood(landed):
            rows.append((before, landed))
        before = None
        if _stood(own):
            before = own
        apex = own.end
        if own.stance.fell:
            apex = plant.released(robot, np.zeros(3))
    if not rows:
        raise AnalysisError.at("true hops", "hops in which all legs stand", "none")
    return _table(rows)


def _stood(hop: plant.SteeredHop) -> bool:
    """Tell whether all legs stood at once, and the robot did not fall."""
    return not hop.stance.fell and hop.hop.all_stood()


def _table(rows: list[tuple[plant.SteeredHop, plant.SteeredHop]]) -> TrueHops:
    """Return the hops from the stance of the first to that of the second of a pair."""
    firsts = [first for first, _ in rows]
    seconds = [second for _, second in rows]
    poses = np.array([hop.stance.pose for hop in firsts])
    ends = np.array([hop.stance.pose for hop in seconds])
    changes = FrameChanges.hops(
        recording=np.full(len(rows), "simulated"),
        time_s=np.array([hop.stance.time_s for hop in firsts]),
        boom_angle_rad=np.array([hop.start.boom_angle_rad for hop in seconds]) % TURN,
        swing_rad=np.array([hop.swing_rad for hop in seconds]),
        change=relative(poses, ends),
        reason=np.full(len(rows), USED, dtype="<U32"),
    )
    return TrueHops(
        changes=changes,
        previous_swing_rad=np.array([hop.swing_rad for hop in firsts]),
        apex=_in_frames(poses, np.array([hop.hop.start_state for hop in seconds])),
        lift_off=np.array([_order(hop.hop, down=False) for hop in firsts]),
        landing=np.array([_order(hop.hop, down=True) for hop in seconds]),
    )


def _in_frames(poses: FloatArray, states: FloatArray) -> FloatArray:
    """Return states (n, 12) with place, heading and velocity in frames at poses."""
    headings = poses[:, 2]
    moved = states.copy()
    away = states[:, :3].copy()
    away[:, :2] -= poses[:, :2]
    moved[:, :3] = turned(away, headings)
    moved[:, YAW] = wrapped(states[:, YAW] - headings)
    moved[:, VELOCITY] = turned(states[:, VELOCITY], headings)
    return moved


def _order(hop: Hop, *, down: bool) -> str:
    """Return the order of the legs' first touchdowns, or of their last lift-offs.

    For example "3>1>2".
    """
    legs = hop.event_leg[hop.event_down == down].tolist()
    if not down:
        legs.reverse()
    order = list(dict.fromkeys(legs))
    if not down:
        order.reverse()
    return order_name(order)
