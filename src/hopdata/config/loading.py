"""Load a configuration: read, fill in the defaults, check against the schema and with itself."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any

from hopdata.config.external import external_files, external_mistakes
from hopdata.config.lines import place_of
from hopdata.config.messages import describe, dotted
from hopdata.config.recordings import files_of
from hopdata.config.schema import load_schema
from hopdata.config.steering import steering_mistakes
from hopdata.config.yaml_file import read_yaml
from hopdata.errors import ConfigError, did_you_mean

MOST_MISTAKES = 10
RESERVED_STUDIES = ("benchmarks", "both_sides")  # whose results have these folders already
_POWER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")


def load_config(
    source: str | Path | Mapping[str, Any],
    *,
    files: Iterable[str | Path] = (),
    check_files: bool = True,
) -> dict[str, Any]:
    """Load and check a configuration.

    Parameters
    ----------
    source : path or mapping
        A YAML file, or what others have read from `files` (and perhaps changed since).
    files : iterable of path
        Where the mapping comes from: named in messages, and looked into for keys that stand twice.
    check_files : bool
        Whether the recordings' files must exist; they are relative to the working directory.

    Returns
    -------
    dict
        The whole configuration in plain types, with every key of the schema.

    Raises
    ------
    ConfigError
        One line for each mistake: file, key, what was expected and what was found.
    """
    files = list(files or ())
    if isinstance(source, Mapping):
        content: Any = source
        for file in files:
            read_yaml(file)
    else:
        content, files = read_yaml(source), [source]
    place = ", ".join(map(str, files)) or "configuration"
    if not isinstance(content, Mapping):
        kind = "nothing" if content is None else type(content).__name__
        raise ConfigError(
            f"{place}: expected keys with values, such as 'study: name', found {kind}"
        )
    schema = load_schema()
    try:
        config: dict[str, Any] = _with_defaults(content, schema)
    except RecursionError:
        raise ConfigError(f"{place}: expected a tree of keys, found one within itself") from None
    _raise_all(place, files, _schema_mistakes(config, schema))
    checks = [*CHECKS, _missing_files] if check_files else CHECKS
    _raise_all(place, files, [mistake for check in checks for mistake in check(config)])
    config["home"]["marker"] = config["home"]["marker"] or config["markers"]["body"][0]
    return config


def _with_defaults(value: Any, schema: dict[str, Any]) -> Any:
    """Copy `value` into plain types, with the defaults of all keys that it leaves out."""
    if value is None and schema.get("default") == {}:
        value = {}  # a section whose keys are all commented out
    if isinstance(value, Mapping):
        properties = schema.get("properties", {})
        filled = {key: _with_defaults(v, properties.get(key, {})) for key, v in value.items()}
        for key, inner in properties.items():
            if key not in filled and "default" in inner:
                filled[key] = _with_defaults(deepcopy(inner["default"]), inner)
        return filled
    if isinstance(value, list | tuple):
        return [_with_defaults(v, schema.get("items", {})) for v in value]
    if isinstance(value, str) and "number" in schema.get("type", ()) and _POWER.fullmatch(value):
        value = float(value)  # YAML 1.1 takes 1e-3 for text, 1.0e-3 for a number
    if isinstance(value, float) and value.is_integer() and _is_whole(schema):
        return int(value)  # the schema takes 1000.0 for a whole number, Python does not
    return value


def _is_whole(schema: dict[str, Any]) -> bool:
    """Whether numbers of this key are whole."""
    return "integer" in schema.get("type", ()) and "number" not in schema.get("type", ())


def _schema_mistakes(config: dict[str, Any], schema: dict[str, Any]) -> list[str]:
    """Return what the schema rejects, and numbers that are not finite."""
    from jsonschema import Draft202012Validator

    mistakes = describe(Draft202012Validator(schema).iter_errors(config), schema)
    for path, value in _leaves(config):
        if isinstance(value, float) and not isfinite(value):
            mistakes.append(f"{dotted(path)}: expected a finite number, found {value}")
    return mistakes


def _leaves(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[Any, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, (*path, key))
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from _leaves(inner, (*path, i))
    else:
        yield path, value


def _raise_all(place: str, files: list[str | Path], mistakes: list[str]) -> None:
    if not mistakes:
        return
    shown = mistakes[:MOST_MISTAKES]
    lines = [f"{place_of(mistake, files, place)}: {mistake}" for mistake in shown]
    if len(mistakes) > MOST_MISTAKES:
        more = len(mistakes) - MOST_MISTAKES
        lines.append(f"{place}: and {more} more mistake" + ("s" if more > 1 else ""))
    raise ConfigError("\n".join(lines))


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


def _missing_files(config: dict[str, Any]) -> Iterator[str]:
    for key, name in [*_recording_files(config), *external_files(config)]:
        file = Path(name)
        if file.is_file():
            continue
        found = f"the folder '{file}'" if file.is_dir() else f"no '{file}'{_near(file)}"
        yield f"{key}: expected a file, found {found}"


def _recording_files(config: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for i, recording in enumerate(config["recordings"]):
        for k, name in enumerate(files_of(recording)):
            which = f"[{k}]" if isinstance(recording["file"], list) else ""
            yield f"recordings[{i}].file{which}", name


def _repeated_files(config: dict[str, Any]) -> Iterator[str]:
    """Yield files that are named twice: their landings would count twice."""
    known: dict[str, str] = {}
    for key, name in _recording_files(config):
        first = known.setdefault(os.path.realpath(name), key)
        if first != key:
            yield f"{key}: expected each file once, found '{name}' in {first} as well"


def _braces(config: dict[str, Any]) -> Iterator[str]:
    """Yield files that the workflow cannot name: it takes what stands in braces for a wildcard."""
    for key, name in [*_recording_files(config), *external_files(config)]:
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


def _near(file: Path) -> str:
    """Say what there is instead: the nearest name, other recordings, or not even the folder."""
    folder = file.parent
    if not folder.is_dir():
        return f"; there is no folder '{folder}' in {Path.cwd()}"
    names = sorted(p.name for p in folder.iterdir() if p.is_file())
    if near := did_you_mean(file.name, names):
        return near
    same = [name for name in names if name.endswith(file.suffix)][:3]
    return f"; in that folder are {', '.join(same)}" if same else f" in {Path.cwd()}"


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
