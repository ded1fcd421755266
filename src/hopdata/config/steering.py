"""Mistakes in what a configuration says of steering."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi
from typing import Any

from hopdata.errors import did_you_mean

ROUNDING = 1e-9


def steering_mistakes(config: dict[str, Any]) -> Iterator[str]:
    """Yield what does not fit together in the block ``steering``."""
    steering = config["steering"]
    if steering["recordings"]:
        yield from _wrong_recordings(config)
    else:
        yield from _wrong_excitation(steering)
    yield from _wrong_distances(steering["experiments"])


def _wrong_recordings(config: dict[str, Any]) -> Iterator[str]:
    known = [entry["name"] for entry in config["recordings"]]
    for i, name in enumerate(config["steering"]["recordings"]):
        if name not in known:
            yield (
                f"steering.recordings[{i}]: expected one of the recordings ({', '.join(known)}), "
                f"found '{name}'{did_you_mean(name, known)}"
            )
    if len(config["markers"]["boom"]) != 1:
        found = ", ".join(config["markers"]["boom"]) or "none"
        yield (
            "steering.recordings: expected one marker on the boom (markers.boom), on whose angle "
            f"the frame changes depend, found {found}"
        )


def _wrong_excitation(steering: dict[str, Any]) -> Iterator[str]:
    angles, steps, repeats = (
        steering["excitation"][key] for key in ("n_angles", "n_steps", "repeats")
    )
    limit, largest = steering["robot"]["swing_limit_rad"], 2 * pi * steps / angles
    if largest > limit + ROUNDING:
        yield (
            f"steering.excitation.n_steps: expected swings within steering.robot.swing_limit_rad "
            f"({limit:.4g} rad), found {steps} steps of {2 * pi / angles:.4g} rad"
        )
    hops, wanted = angles * (2 * steps + 1) * repeats, steering["model"]["training_hops"]
    # The first stance ends no hop, and a test takes two.
    if wanted > hops - 3:
        yield (
            f"steering.model.training_hops: expected at most {max(0, hops - 3)} of the {hops} hops "
            f"of the excitation, so that some are left to test with, found {wanted}"
        )


def _wrong_distances(experiments: dict[str, Any]) -> Iterator[str]:
    arrived, stay, start = (experiments[key] for key in ("arrived_m", "stay_m", "distance_m"))
    if stay < arrived:
        yield (
            f"steering.experiments.stay_m: expected at least arrived_m ({arrived:g} m), "
            f"found {stay:g} m"
        )
    for key in ("arrived_m", "printed_arrived_m"):
        if experiments[key] >= start:
            yield (
                f"steering.experiments.distance_m: expected more than {key} "
                f"({experiments[key]:g} m), found {start:g} m"
            )
