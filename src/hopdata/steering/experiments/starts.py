"""Random starts: poses at which the operator lets the hopper go, and the chance of each run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import chosen, require_choice
from hopdata.steering.experiments.tasks import EXPERIMENTS, FACING, HEADINGS, to_origin
from hopdata.steering.streams import FLOOR, START

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Start:
    """One start: its number, its pose (3,) m, m, rad, and the seed of all chance after it.

    Runs of different controllers from one start meet the same kicks and the same noise.
    """

    number: int
    pose: FloatArray
    seed: np.random.SeedSequence

    def streams(self) -> tuple[np.random.Generator, np.random.Generator, np.random.Generator]:
        """Return generators of kicks, noise and gaps, new ones at every call."""
        fresh = np.random.SeedSequence(self.seed.entropy, spawn_key=self.seed.spawn_key)
        kicks, noise, gaps = (np.random.default_rng(one) for one in fresh.spawn(3))
        return kicks, noise, gaps


def draw_starts(
    experiment: str, heading: str, number: int, *, distance_m: float, seed: int
) -> list[Start]:
    """Draw the starts of an experiment.

    Parameters
    ----------
    experiment : str
        A name of `EXPERIMENTS`. To the origin they lie at `distance_m` in any direction, turns
        begin at the origin.
    heading : {"facing", "any"}
        Whether the hopper faces the origin at first.
    number : int
        How many; the first ones are the same whatever the number.
    distance_m : float
    seed : int
        The study's.
    """
    require_choice("heading", heading, HEADINGS)
    manoeuvre, _ = chosen("experiment", experiment, EXPERIMENTS)
    place = list(EXPERIMENTS).index(experiment)
    starts = []
    for k in range(number):
        stream = np.random.SeedSequence(seed, spawn_key=(START, place, k))
        bearing, turn = np.random.default_rng(stream).uniform(-np.pi, np.pi, 2)
        x, y = distance_m * np.array([np.cos(bearing), np.sin(bearing)])
        if not to_origin(manoeuvre):
            pose = np.array([0.0, 0.0, turn])
        elif heading == FACING:
            pose = np.array([x, y, np.arctan2(-y, -x)])
        else:
            pose = np.array([x, y, turn])
        starts.append(Start(k, pose, stream))
    return starts


def floor_stream(seed: int) -> np.random.Generator:
    """Return the stream from which the floor of all experiments is drawn."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(FLOOR,)))
