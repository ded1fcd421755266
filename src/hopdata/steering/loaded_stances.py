"""Stances as the dissertation's robot noticed them, beside those that cameras see.

The robot took it for a stance when the current of each of its three leg motors fell
below a threshold (Sec. 3.3, footnote 2). In flight a motor holds the preload of its
leg; as soon as the leg touches down, the floor does. The scene has no motors, so the
printed event is read as the instant from which all legs carry load at once. Cameras see
the lowest point of the body instead, and report it a few frames later.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.errors import AnalysisError
from hopdata.steering import robot as plant
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.stances import StanceDetector
from hopdata.synthesis.hops import Hop

#: Longest time between a true stance and a reported one that are the same.
#: Unit: s. Origin: derived: half of the shortest hop.
SAME_STANCE_S = 0.2


@dataclass(frozen=True)
class Noticed:
    """Stances of a run, noticed in both ways.

    Parameters
    ----------
    stances : DataFrame
        One row per hop: ``lowest_s``, the true lowest point; ``loaded_s``, when all
        legs carry load; ``found_s``, the lowest point as the cameras' frames give it,
        and ``recognised_s``, the frame that revealed it; NaN where that did not happen.
    n_false : int
        Stances that the cameras recognised where there was none.
    """

    stances: pd.DataFrame
    n_false: int


def all_loaded_s(hop: Hop) -> float:
    """Return when all legs first carry load at once, s after the apex; NaN if never."""
    n_legs = len(hop.preloads_n)
    # Each event is a leg that touches down or lifts off.
    standing = np.cumsum(np.where(hop.event_down, 1, -1))
    everyone = np.flatnonzero(standing == n_legs)
    if not len(everyone):
        return float(np.nan)
    return float(hop.event_time[everyone[0]])


def noticed_stances(
    robot: plant.SteeredHopper,
    geometry: HopperGeometry,
    *,
    hops: int,
    seed: int,
    rate_hz: float = 100.0,
) -> Noticed:
    """Let the robot hop with random swings, and notice its stances in both ways.

    Parameters
    ----------
    robot : SteeredHopper
    geometry : HopperGeometry
        Its noise, on each coordinate of each marker, is that of the cameras.
    hops : int
    seed : int
        Seed of swings, kicks and noise.
    rate_hz : float
        Frame rate of the cameras.

    Raises
    ------
    AnalysisError
        If the robot falls.
    """
    streams = np.random.SeedSequence(seed).spawn(3)
    swings, kicks, noises = (np.random.default_rng(stream) for stream in streams)
    detector = StanceDetector(geometry, rate_hz=rate_hz)
    apex = plant.released(robot, np.zeros(3))
    rows = []
    reported = []
    for _ in range(hops):
        limit = robot.swing_limit_rad
        swing = float(swings.uniform(-limit, limit))
        hop = plant.steer_hop(robot, apex, swing, rng=kicks, rate_hz=rate_hz)
        if hop.stance.fell:
            raise AnalysisError.at("stances", "a robot that hops on", hop.hop.ending)
        loaded = hop.start.time_s + all_loaded_s(hop.hop)
        rows.append({"lowest_s": hop.stance.time_s, "loaded_s": loaded})
        # The last marker is that of the boom.
        body = hop.markers[:, :-1]
        seen = body + geometry.noise_m * noises.standard_normal(body.shape)
        heights = seen[..., 2].mean(axis=1)
        for time_s, height_m in zip(hop.frame_time_s, heights, strict=True):
            stance = detector.feed(float(time_s), float(height_m))
            if stance is not None:
                reported.append((stance.time_s, stance.recognised_s))
        apex = hop.end
    table = pd.DataFrame(rows)
    found, n_false = _matched(table["lowest_s"].to_numpy(), reported)
    table[["found_s", "recognised_s"]] = found
    return Noticed(table, n_false)


def _matched(
    lowest_s: FloatArray, reported: Sequence[tuple[float, float]]
) -> tuple[FloatArray, int]:
    """Return what was reported of each true stance, (n, 2), s, and the false reports.

    A report is of the nearest true stance. It is false if none is near, or if there
    was a report of that one before.
    """
    found = np.full((len(lowest_s), 2), np.nan)
    n_false = 0
    for stance_s, recognised_s in reported:
        apart = np.abs(lowest_s - stance_s)
        nearest = int(apart.argmin())
        is_new = np.isnan(found[nearest, 0])
        if apart[nearest] < SAME_STANCE_S and is_new:
            found[nearest] = (stance_s, recognised_s)
        else:
            n_false += 1
    return found, n_false
