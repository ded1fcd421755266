"""Mistakes in the block ``steering``: keys that do not fit each other or the study."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from math import dist, pi
from typing import Any

from hopdata.errors import did_you_mean, mismatch

ROUNDING = 1e-9  # rad: swings are sums of steps, which are rounded
#: Hops of the excitation that the model cannot be learned from.
#: Unit: 1. Origin: derived: the first stance does not end a hop, and a test needs two.
HOPS_NOT_LEARNED_FROM = 3


def mistakes(config: Mapping[str, Any]) -> Iterator[str]:
    """Yield a message for each mistake, as `hopdata.errors.mismatch` writes it."""
    steering = config["steering"]
    if steering["recordings"]:
        yield from _wrong_recordings(config)
    else:
        yield from _wrong_excitation(steering)
    yield from _starts_at_the_goal(steering["experiments"])
    yield from _close_way_points(steering["experiments"])


def _wrong_recordings(config: Mapping[str, Any]) -> Iterator[str]:
    known = [entry["name"] for entry in config["recordings"]]
    for i, name in enumerate(config["steering"]["recordings"]):
        if name not in known:
            wanted = f"one of the recordings ({', '.join(known)})"
            found = f"'{name}'{did_you_mean(name, known)}"
            yield mismatch(f"steering.recordings[{i}]", wanted, found)
    boom = config["markers"]["boom"]
    if len(boom) != 1:
        wanted = (
            "one marker on the boom (markers.boom), on whose angle the frame changes "
            "depend"
        )
        yield mismatch("steering.recordings", wanted, ", ".join(boom) or "none")


def _wrong_excitation(steering: Mapping[str, Any]) -> Iterator[str]:
    excitation = steering["excitation"]
    n_angles = excitation["n_angles"]
    n_steps = excitation["n_steps"]
    limit = steering["robot"]["swing_limit_rad"]
    largest = 2 * pi * n_steps / n_angles
    if largest > limit + ROUNDING:
        wanted = f"swings within steering.robot.swing_limit_rad ({limit:.4g} rad)"
        found = f"{n_steps} steps of {2 * pi / n_angles:.4g} rad"
        yield mismatch("steering.excitation.n_steps", wanted, found)
    n_swings = 2 * n_steps + 1
    n_hops = n_angles * n_swings * excitation["repeats"]
    asked = steering["model"]["training_hops"]
    most = n_hops - HOPS_NOT_LEARNED_FROM
    if asked > most:
        wanted = (
            f"at most {max(0, most)} of the {n_hops} hops of the excitation, "
            "so that some are left to test with"
        )
        yield mismatch("steering.model.training_hops", wanted, asked)


def _starts_at_the_goal(experiments: Mapping[str, Any]) -> Iterator[str]:
    distance = experiments["distance_m"]
    arrived = experiments["arrived_m"]
    if not distance > arrived:
        wanted = f"more than steering.experiments.arrived_m ({arrived:g})"
        yield mismatch("steering.experiments.distance_m", wanted, f"{distance:g}")


def _close_way_points(experiments: Mapping[str, Any]) -> Iterator[str]:
    """Tell of way-points of which one stance would visit two."""
    points = experiments["waypoints_m"]
    least = 2 * experiments["arrived_m"]
    for number, (here, there) in enumerate(pairwise(points), start=1):
        apart = dist(here, there)
        if not apart > least:
            wanted = (
                "more than twice steering.experiments.arrived_m "
                f"({least:g} m) from the point before"
            )
            key = f"steering.experiments.waypoints_m[{number}]"
            yield mismatch(key, wanted, f"{apart:g} m")
