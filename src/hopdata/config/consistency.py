"""What the schema cannot see: whether the parts of a configuration fit each other."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

from hopdata.config.external import external_files, external_mistakes
from hopdata.config.files import recording_files
from hopdata.config.steering import steering_mistakes
from hopdata.errors import did_you_mean

RESERVED_STUDIES = ("benchmarks", "both_sides")  # whose results have these folders already


def _repeated_names(config: dict[str, Any]) -> Iterator[str]:
    seen: dict[str, int] = {}
    for i, recording in enumerate(config["recordings"]):
        name = recording["name"]
        if name.lower() in seen:  # some file systems do not tell case apart
            first = seen[name.lower()]
            yield (
                f"recordings[{i}].name: expected a name of its own, "
                f"found '{name}' as in recordings[{first}]"
            )
        seen.setdefault(name.lower(), i)


def _repeated_markers(config: dict[str, Any]) -> Iterator[str]:
    seen: dict[str, str] = {}
    for role, names in config["markers"].items():
        for name in names:
            if name in seen:
                other = f"in markers.{seen[name]}" if seen[name] != role else "twice"
                yield f"markers.{role}: expected each marker once, found '{name}' {other}" + (
                    " as well" if seen[name] != role else ""
                )
            seen.setdefault(name, role)


def _home_marker(config: dict[str, Any]) -> Iterator[str]:
    marker, body = config["home"]["marker"], config["markers"]["body"]
    if marker is not None and marker not in body:
        yield (
            f"home.marker: expected a body marker ({', '.join(body)}), "
            f"found '{marker}'{did_you_mean(marker, body)}"
        )


def _sections_in_order(config: dict[str, Any]) -> Iterator[str]:
    pre, post = (config["sections"][key] for key in ("pre_height_m", "post_height_m"))
    if pre is not None and post is not None and not pre > post:
        yield (
            f"sections.pre_height_m: expected more than sections.post_height_m ({post:g} m), "
            f"found {pre:g} m"
        )


def _enough_samples(config: dict[str, Any]) -> Iterator[str]:
    components, samples = (config["subspaces"][key] for key in ("components", "samples"))
    if components is not None and components >= samples:
        yield (
            f"subspaces.components: expected fewer than subspaces.samples ({samples}), since "
            f"{samples} samples span {samples - 1} dimensions, found {components}"
        )


def _scales_in_order(config: dict[str, Any]) -> Iterator[str]:
    scales = config["scaling_study"]["scales"]
    for one, following in pairwise(scales):
        if not following < one:
            yield (
                f"scaling_study.scales: expected the largest first and each smaller than the one "
                f"before, found {following:g} after {one:g}"
            )
            return


def _simulated_markers(config: dict[str, Any]) -> Iterator[str]:
    """Yield the first marker that the simulation, where there is one, will not make."""
    if all(recording["file"] is not None for recording in config["recordings"]):
        return
    n_body = len(config["motion_capture"]["markers"]["body_m"])
    n_feet = config["simulation"]["hopper"]["n_legs"]
    made = [f"body{i + 1}" for i in range(n_body)] + [f"foot{i + 1}" for i in range(n_feet)]
    made.append("boom")
    for role, names in config["markers"].items():
        for name in names:
            if name not in made:
                yield (
                    f"markers.{role}: expected a marker of the simulation ({', '.join(made)}), "
                    f"found '{name}'{did_you_mean(name, made)}"
                )
                return


def _simulated_files(config: dict[str, Any]) -> Iterator[str]:
    for i, recording in enumerate(config["recordings"]):
        given = [key for key, value in recording["simulation"].items() if value is not None]
        if recording["file"] is not None and given:
            yield (
                f"recordings[{i}].simulation: expected nothing beside a file, "
                f"found {', '.join(given)}"
            )


def _repeated_files(config: dict[str, Any]) -> Iterator[str]:
    """Yield files that are named twice: their landings would count twice."""
    known: dict[str, str] = {}
    for key, name in recording_files(config):
        first = known.setdefault(os.path.realpath(name), key)
        if first != key:
            yield f"{key}: expected each file once, found '{name}' in {first} as well"


def _braces(config: dict[str, Any]) -> Iterator[str]:
    """Yield files that the workflow cannot name: it takes what stands in braces for a wildcard."""
    for key, name in [*recording_files(config), *external_files(config)]:
        if "{" in name or "}" in name:
            yield f"{key}: expected a path without braces, found '{name}'; rename the file"


def _reserved_study(config: dict[str, Any]) -> Iterator[str]:
    """Yield a study whose folder is that of the project's own results."""
    if config["study"] in RESERVED_STUDIES:
        yield (
            f"study: expected another name than {' and '.join(RESERVED_STUDIES)}, whose folders "
            f"under results/ are taken, found '{config['study']}'"
        )


def _enough_flips(config: dict[str, Any]) -> Iterator[str]:
    """Yield a number of sign flips with which no p-value can be small enough."""
    flips, confidence = (config["verdict"][key] for key in ("flips", "confidence"))
    if (1 + flips) * (1 - confidence) <= 1:
        yield (
            f"verdict.flips: expected more than {1 / (1 - confidence) - 1:.0f}, with fewer no "
            f"p-value is below {1 - confidence:.3g}, found {flips}"
        )


CHECKS: list[Callable[[dict[str, Any]], Iterator[str]]] = [
    _repeated_names,
    _repeated_markers,
    _home_marker,
    _sections_in_order,
    _enough_samples,
    _scales_in_order,
    _simulated_markers,
    _simulated_files,
    external_mistakes,
    _repeated_files,
    _braces,
    _reserved_study,
    _enough_flips,
    steering_mistakes,
]
