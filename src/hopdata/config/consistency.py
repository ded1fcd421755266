"""Checks beyond the schema: whether the parts of a configuration fit together."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import reduce
from inspect import signature
from itertools import islice, pairwise
from operator import getitem
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from hopdata.errors import ConfigError, did_you_mean, mismatch
from hopdata.scenes import STANDARD


def _unknown(
    what: str, known: list[str], places: Iterable[tuple[str, str]]
) -> Iterator[str]:
    """Yield an error for each name, given as (key, name), that is not among the known ones."""
    for key, name in places:
        if name not in known:
            found = f"'{name}'{did_you_mean(name, known)}"
            yield mismatch(key, f"{what} ({', '.join(known)})", found)


def _once(what: str, places: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Yield an error for each name, given as (key, name), that occurred before."""
    seen: dict[str, str] = {}
    for key, name in places:
        first = seen.setdefault(name, key)
        if first != key:
            yield mismatch(key, f"each {what} once", f"'{name}' in {first} as well")


# Mistakes in the blocks for external contacts and forces.

BLOCKS = ("contacts", "forces")


def _blocks(config: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield key and content of each such block."""
    for i, recording in enumerate(config["recordings"]):
        yield from ((f"recordings[{i}].{kind}", recording[kind]) for kind in BLOCKS)


def external_files(config: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield key and file of each block that names a file."""
    for key, block in _blocks(config):
        if block["file"] is not None:
            yield f"{key}.file", block["file"]


def external_mistakes(config: dict[str, Any]) -> Iterator[str]:
    """Yield mistakes in columns, feet and thresholds."""
    feet = feet_of(config)
    for key, block in _blocks(config):
        columns = list(enumerate(block["columns"]))
        if columns and block["file"] is None:
            yield mismatch(f"{key}.file", "a file beside the columns", "null (nothing)")
        yield from _once(
            "column", ((f"{key}.columns[{k}].name", c["name"]) for k, c in columns)
        )
        for k, column in columns:
            of, place = column["feet"] or [column["name"]], f"{key}.columns[{k}].feet"
            yield from _unknown(
                "feet of markers.feet", feet, ((place, foot) for foot in of)
            )
        if block.get("label_column") is not None and block["time_column"] is None:
            wanted = "the column of the instants beside label_column"
            yield mismatch(f"{key}.time_column", wanted, "null (nothing)")
        if block.get("threshold_n") is not None and block["unit"] == "body_weight":
            wanted = "threshold_share where forces are in body weights"
            yield mismatch(f"{key}.threshold_n", wanted, f"{block['threshold_n']:g} N")


# Configuration of a single recording.


def simulation_of(config: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the block ``simulation`` that applies to one recording.

    Parameters
    ----------
    config : dict
        As returned by `load_config`.
    name : str
        Name of the recording, whose own values override those of the block.
    """
    own = next(
        entry["simulation"] for entry in config["recordings"] if entry["name"] == name
    )
    given = {key: value for key, value in own.items() if value is not None}
    return {**config["simulation"], **given}


def files_of(entry: Mapping[str, Any]) -> list[str]:
    """Return the files of one entry of ``recordings``, in order; none if it is simulated."""
    file = entry.get("file")
    return [] if file is None else [file] if isinstance(file, str) else list(file)


# Settings that follow from several keys.


def contact_options(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the ``touchdowns`` keys that `find_landings` takes; others judge what it found."""
    taken = signature(
        resolve_name("hopdata.landings.contacts.find:find_landings")
    ).parameters
    return {key: value for key, value in config["touchdowns"].items() if key in taken}


def fills(config: Mapping[str, Any]) -> bool:
    """Tell whether gaps are filled; a marker's place needs three others."""
    return config["filling"]["longest_s"] != 0 and len(config["markers"]["body"]) > 3


def is_simulated(config: Mapping[str, Any]) -> bool:
    """Tell whether all recordings are simulated, so that scenes are known and can be integrated."""
    return not any(files_of(entry) for entry in config["recordings"])


# Formats with a place for a truth, and axes of the file for which it holds: see
# `import_recording`.
_WITH_TRUTH, _UPRIGHT = (".h5", ".hdf5"), ("z", "auto")


def knows_truth(config: Mapping[str, Any]) -> bool:
    """Tell whether the truth of any recording is known, so that the study is scored against it.

    That of a simulated recording is. That of a file is if it stands in the file and
    holds for the markers that the study takes; files that are joined to one recording
    lose theirs.
    """
    return any(_has_truth(config, files_of(entry)) for entry in config["recordings"])


def _has_truth(config: Mapping[str, Any], files: list[str]) -> bool:
    if len(files) != 1:
        return not files
    if Path(files[0]).suffix.lower() not in _WITH_TRUTH:
        return False  # so that h5py is not loaded, for which every start would pay
    if config["input"]["vertical_axis"] not in _UPRIGHT:
        return False
    holds_truth = resolve_name("hopdata.recordings.readers.hdf5:holds_truth")
    markers = config["markers"]
    return bool(holds_truth(files[0], body=markers["body"], feet=markers["feet"]))


def expected_noise_m(config: Mapping[str, Any]) -> float:
    """Return the marker noise that the quality is compared with, m."""
    simulated: float = config["motion_capture"]["noise_m"]
    expected: float = config["report"]["expected_noise_m"]
    return simulated if is_simulated(config) else expected


# Files named by a configuration, and whether they exist.

YAML = (".yaml", ".yml")  # not recordings; the only formats of a configuration


def recording_files(config: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield key and file of each recording's files."""
    for i, recording in enumerate(config["recordings"]):
        for k, name in enumerate(files_of(recording)):
            which = f"[{k}]" if isinstance(recording["file"], list) else ""
            yield f"recordings[{i}].file{which}", name


def missing_files(config: dict[str, Any]) -> Iterator[str]:
    """Yield a message for each file that does not exist."""
    for key, name in [*recording_files(config), *external_files(config)]:
        file = Path(name)
        if file.is_file():
            continue
        found = (
            f"the folder '{file}'"
            if file.is_dir()
            else f"no '{file}'{nearest_file(file)}"
        )
        yield mismatch(key, "a file", found)


def nearest_file(file: Path) -> str:
    """Suggest an existing file: nearby, of a similar name, or others; or report no folder."""
    for folder in (*Path.cwd().parents[:2], *sorted(Path.cwd().glob("*/"))):
        if os.path.isfile(folder / file):
            return f"; it is in {folder}: paths hold from where hopdata runs, so go there (cd)"
    folder = file.parent
    if not folder.is_dir():
        return f"; there is no folder '{folder}' in {Path.cwd()}"
    files = (p for p in sorted(folder.iterdir()) if p.is_file() and p.name[0] != ".")
    names = [p.name for p in files if (p.suffix in YAML) == (file.suffix in YAML)]
    if near := did_you_mean(file.name, names):
        return near
    same = [name for name in names if name.endswith(file.suffix)][:3]
    return f"; in that folder are {', '.join(same)}" if same else f" in {Path.cwd()}"


RESERVED_STUDIES = (
    "benchmarks",
    "both_sides",
)  # their folders hold other results already


def _repeated(config: dict[str, Any]) -> Iterator[str]:
    """Yield names that occur twice; the landings of a file would count twice."""
    named = enumerate(config["recordings"])  # some file systems ignore case
    yield from _once(
        "name", ((f"recordings[{i}].name", one["name"].lower()) for i, one in named)
    )
    roles = config["markers"].items()
    markers = (
        (f"markers.{role}[{k}]", one)
        for role, names in roles
        for k, one in enumerate(names)
    )
    yield from _once("marker", markers)
    files = ((key, os.path.realpath(name)) for key, name in recording_files(config))
    yield from _once("file", ((key, os.path.relpath(name)) for key, name in files))


def _left_out(config: dict[str, Any]) -> Iterator[str]:
    known = [*config["markers"]["body"], *config["markers"]["feet"]]
    for i, recording in enumerate(config["recordings"]):
        for k, entry in enumerate(recording["exclude"]):
            place, begin, end = (
                f"recordings[{i}].exclude[{k}]",
                entry["from_s"],
                entry["to_s"],
            )
            if begin is not None and end is not None and not end > begin:
                yield mismatch(
                    f"{place}.to_s", f"more than from_s ({begin:g} s)", f"{end:g} s"
                )
            others = [
                key
                for key in ("from_s", "to_s", "markers")
                if entry[key] not in (None, [])
            ]
            if entry["landings"] and others:
                yield mismatch(
                    f"{place}.landings", "no other choice beside them", others[0]
                )
            named = ((f"{place}.markers", name) for name in entry["markers"])
            yield from _unknown("a marker of body or feet", known, named)


MOST_FEET = 6


def feet_of(config: Mapping[str, Any]) -> list[str]:
    """Return the names of the feet, in order; the block ``feet`` joins several markers in one."""
    taken = {
        marker: foot["name"] for foot in config["feet"] for marker in foot["markers"]
    }
    return list(dict.fromkeys(taken.get(one, one) for one in config["markers"]["feet"]))


def _joined_feet(config: dict[str, Any]) -> Iterator[str]:
    known, joined = config["markers"]["feet"], list[tuple[str, str]]()
    others = [name for role in ("body", "boom") for name in config["markers"][role]]
    for i, foot in enumerate(config["feet"]):
        joined += [
            (f"feet[{i}].markers[{k}]", name) for k, name in enumerate(foot["markers"])
        ]
        named = ((f"feet[{i}].markers", name) for name in foot["markers"])
        yield from _unknown("a marker of markers.feet", known, named)
        if foot["name"] in [
            *known,
            *others,
            *(one["name"] for one in config["feet"][:i]),
        ]:
            yield mismatch(f"feet[{i}].name", "a name of its own", f"'{foot['name']}'")
    yield from _once("marker", joined)
    count = len(feet_of(config))
    if not 2 <= count <= MOST_FEET:
        yield mismatch(
            "markers.feet", f"2 to {MOST_FEET} feet", f"{count}; feet joins markers"
        )
    simulated = [entry["name"] for entry in config["recordings"] if not files_of(entry)]
    if config["feet"] and simulated:
        beside = (
            f"the simulated recording {simulated[0]}, whose feet have one marker each"
        )
        yield f"feet: expected none beside {beside}"


def _home_marker(config: dict[str, Any]) -> Iterator[str]:
    if (marker := config["home"]["marker"]) is not None:
        yield from _unknown(
            "a body marker", config["markers"]["body"], [("home.marker", marker)]
        )


DEFAULT_SIGMAS = 3.0  # of sections.threshold_sigmas in the schema

_IN_ORDER = (
    ("sections.pre_height_m", "more", "sections.post_height_m"),
    ("subspaces.components", "fewer", "subspaces.samples"),
)


def _in_order(config: dict[str, Any]) -> Iterator[str]:
    for key, side, other in _IN_ORDER:
        value: Any = reduce(getitem, key.split("."), config)
        limit: Any = reduce(getitem, other.split("."), config)
        if None not in (value, limit) and not (
            value > limit if side == "more" else value < limit
        ):
            yield mismatch(key, f"{side} than {other} ({limit:g})", f"{value:g}")


def _idle_section_keys(config: dict[str, Any]) -> Iterator[str]:
    """Yield keys of `sections` that would decide nothing beside the others."""
    sections = config["sections"]
    printed = sections["rule"] == "printed"
    both_given = None not in (sections["pre_height_m"], sections["post_height_m"])
    thresholds_given = None not in (
        sections["min_foot_threshold_m"],
        sections["max_foot_threshold_m"],
    )
    sigmas = sections["threshold_sigmas"]
    if printed and sigmas != DEFAULT_SIGMAS:
        expected = "none beside sections.rule: printed, whose thresholds are knees of densities"
        yield mismatch("sections.threshold_sigmas", expected, f"{sigmas:g}")
    bandwidth_m = sections["bandwidth_m"]
    idle = both_given and (thresholds_given or not printed)
    if bandwidth_m is not None and idle:
        expected = "none beside heights that are given, since it would choose nothing"
        yield mismatch("sections.bandwidth_m", expected, f"{bandwidth_m:g}")


def _scales_in_order(config: dict[str, Any]) -> Iterator[str]:
    for one, following in pairwise(config["scaling_study"]["scales"]):
        if not following < one:
            wanted = "the largest first and each smaller than the one before"
            yield mismatch(
                "scaling_study.scales", wanted, f"{following:g} after {one:g}"
            )
            return


def _simulated_markers(config: dict[str, Any]) -> Iterator[str]:
    """Yield the first configured marker that the simulation, if any, does not make."""
    if all(recording["file"] is not None for recording in config["recordings"]):
        return
    n_body = len(config["motion_capture"]["markers"]["body_m"])
    simulation = config["simulation"]
    if (
        simulation["scene"] == STANDARD
    ):  # not loaded, since every start would pay for it
        n_feet, has_boom = simulation[STANDARD]["n_legs"], True
    else:
        from hopdata.synthesis.simulate import Simulation

        try:
            scene = Simulation.of(simulation).scene
        except ConfigError as error:
            yield str(error)
            return
        n_feet, has_boom = scene.n_legs, scene.has_boom
    made = [f"body{i + 1}" for i in range(n_body)] + [
        f"foot{i + 1}" for i in range(n_feet)
    ]
    made += ["boom"] if has_boom else []
    roles = config["markers"].items()
    named = ((f"markers.{role}", name) for role, names in roles for name in names)
    yield from islice(_unknown("a marker of the simulation", made, named), 1)


def _simulated_files(config: dict[str, Any]) -> Iterator[str]:
    for i, recording in enumerate(config["recordings"]):
        given = [
            key for key, value in recording["simulation"].items() if value is not None
        ]
        if recording["file"] is not None and given:
            yield mismatch(
                f"recordings[{i}].simulation", "nothing beside a file", ", ".join(given)
            )


def _braces(config: dict[str, Any]) -> Iterator[str]:
    """Yield files with braces, which the workflow would take for wildcards."""
    for key, name in [*recording_files(config), *external_files(config)]:
        if "{" in name or "}" in name:
            yield mismatch(key, "a path without braces", f"'{name}'; rename the file")


def _reserved_study(config: dict[str, Any]) -> Iterator[str]:
    """Yield a study name whose folder holds the project's own results."""
    if config["study"] in RESERVED_STUDIES:
        taken = (
            f"{' and '.join(RESERVED_STUDIES)}, whose folders under results/ are taken"
        )
        yield mismatch("study", f"a name other than {taken}", f"'{config['study']}'")


def _enough_flips(config: dict[str, Any]) -> Iterator[str]:
    """Yield a number of sign flips too small for any p-value to be small enough."""
    flips, confidence = (config["verdict"][key] for key in ("flips", "confidence"))
    if (1 + flips) * (1 - confidence) <= 1:
        small = f"with fewer no p-value is below {1 - confidence:.3g}"
        yield mismatch(
            "verdict.flips", f"more than {1 / (1 - confidence) - 1:.0f}, {small}", flips
        )


CHECKS: list[Callable[[dict[str, Any]], Iterator[str]]] = [
    _repeated, _left_out, _joined_feet, _home_marker, _in_order, _idle_section_keys,
    _scales_in_order,
    _simulated_markers, _simulated_files, external_mistakes, _braces, _reserved_study,
    _enough_flips,
]  # fmt: skip
