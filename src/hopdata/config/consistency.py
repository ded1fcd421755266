"""Checks beyond the schema: whether the parts of a configuration fit together."""

import errno
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import reduce
from inspect import signature
from itertools import pairwise
from math import sqrt
from operator import getitem
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from hopdata.errors import ConfigError, did_you_mean, mismatch
from hopdata.foreign.texts import kind_of
from hopdata.scenes import STANDARD, scene_class


def _unknown(
    what: str, known: list[str], places: Iterable[tuple[str, str]]
) -> Iterator[str]:
    """Yield an error for each name, given as (key, name), that is not a known one."""
    for key, name in places:
        if name not in known:
            found = f"'{name}'{did_you_mean(name, known)}"
            yield mismatch(key, f"{what} ({', '.join(known)})", found)


def _once(what: str, places: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Yield an error for each name, given as (key, name), that occurred before."""
    first_key: dict[str, str] = {}
    for key, name in places:
        if name in first_key:
            found = f"'{name}' in {first_key[name]} as well"
            yield mismatch(key, f"each {what} once", found)
        else:
            first_key[name] = key


# Mistakes in the blocks for external contacts and forces.

BLOCKS = ("contacts", "forces")


def _blocks(config: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield key and content of each such block."""
    for i, recording in enumerate(config["recordings"]):
        for kind in BLOCKS:
            yield f"recordings[{i}].{kind}", recording[kind]


def external_files(config: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield key and file of each block that names a file."""
    for key, block in _blocks(config):
        if block["file"] is not None:
            yield f"{key}.file", block["file"]


def external_blocks(config: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return where contacts are known from, for each recording that has any.

    These are its blocks ``contacts`` and ``forces``, and ``own`` with its file if that
    has force plates or events of its own. Files that are joined to one recording have
    clocks of their own, so theirs are left out.
    """
    found = {}
    for entry in config["recordings"]:
        blocks: dict[str, Any] = {kind: entry[kind] for kind in BLOCKS}
        files = files_of(entry)
        own_file = None
        if len(files) == 1 and _knows_contacts(files[0]):
            own_file = files[0]
        blocks["own"] = {"file": own_file}
        if any(block["file"] for block in blocks.values()):
            found[entry["name"]] = blocks
    return found


def _knows_contacts(file: str) -> bool:
    """Tell whether a file has force plates, or events that are contacts."""
    # The suffix is asked first, so that other formats load no reader.
    if Path(file).suffix.lower() != ".c3d":
        return False
    knows = resolve_name("hopdata.recordings.readers.c3d_plates:knows_contacts")
    return bool(knows(file))


def external_mistakes(config: dict[str, Any]) -> Iterator[str]:
    """Yield mistakes in columns, feet and thresholds."""
    feet = feet_of(config)
    for key, block in _blocks(config):
        columns = block["columns"]
        if columns and block["file"] is None:
            yield mismatch(f"{key}.file", "a file beside the columns", "null (nothing)")
        names = [
            (f"{key}.columns[{k}].name", column["name"])
            for k, column in enumerate(columns)
        ]
        yield from _once("column", names)
        for k, column in enumerate(columns):
            place = f"{key}.columns[{k}].feet"
            feet_of_column = column["feet"] or [column["name"]]
            named = [(place, foot) for foot in feet_of_column]
            yield from _unknown("feet of markers.feet", feet, named)
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
    entry = next(one for one in config["recordings"] if one["name"] == name)
    simulation = dict(config["simulation"])
    for key, value in entry["simulation"].items():
        if value is not None:
            simulation[key] = value
    return simulation


def files_of(entry: Mapping[str, Any]) -> list[str]:
    """Return the files of an entry of ``recordings``, in order; none if simulated."""
    file = entry.get("file")
    if file is None:
        return []
    if isinstance(file, str):
        return [file]
    return list(file)


# Settings that follow from several keys.


def contact_options(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the ``touchdowns`` keys that `find_study_landings` takes.

    The other keys judge what it found.
    """
    place = "hopdata.landings.contacts.find:find_study_landings"
    taken = signature(resolve_name(place)).parameters
    return {key: value for key, value in config["touchdowns"].items() if key in taken}


def fills(config: Mapping[str, Any]) -> bool:
    """Tell whether gaps are filled; a marker's place needs three others."""
    return config["filling"]["longest_s"] != 0 and len(config["markers"]["body"]) > 3


def effect_methods(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of `landings.effects.Methods`: those of the study."""
    of_sections = {k: v for k, v in config["sections"].items() if k != "grid_nodes"}
    return {
        "floor": config["floor"],
        "feet": config["feet"],
        "longest_s": config["filling"]["longest_s"],
        "fills": fills(config),
        "contacts": contact_options(config),
        "sections": of_sections,
        "touchdowns": config["touchdowns"],
        "states": config["states"],
        "home_marker": config["home"]["marker"],
    }


def is_simulated(config: Mapping[str, Any]) -> bool:
    """Tell whether all recordings are simulated, so that their scenes are known."""
    return not any(files_of(entry) for entry in config["recordings"])


# Formats with a place for a truth.
_FORMATS_WITH_TRUTH = (".h5", ".hdf5")

# Axes of the file for which its truth holds: see `import_recording`.
_UPRIGHT_AXES = ("z", "auto")


def knows_truth(config: Mapping[str, Any]) -> bool:
    """Tell whether the truth of any recording is known, to score the study against it.

    That of a simulated recording is. That of a file is if it stands in the file and
    holds for the markers that the study takes; files that are joined to one recording
    lose theirs.
    """
    return any(_has_truth(config, files_of(entry)) for entry in config["recordings"])


def _has_truth(config: Mapping[str, Any], files: list[str]) -> bool:
    if not files:
        return True
    if len(files) > 1:
        return False
    # The suffix is asked first: h5py takes time to load, which every start would pay.
    if Path(files[0]).suffix.lower() not in _FORMATS_WITH_TRUTH:
        return False
    if config["input"]["vertical_axis"] not in _UPRIGHT_AXES:
        return False
    holds_truth = resolve_name("hopdata.recordings.readers.hdf5:holds_truth")
    markers = config["markers"]
    return bool(holds_truth(files[0], body=markers["body"], feet=markers["feet"]))


def expected_noise_m(config: Mapping[str, Any]) -> float:
    """Return the noise of a coordinate that the quality is compared with, m."""
    noise_m: float = config["report"]["expected_noise_m"]
    if is_simulated(config):
        noise_m = config["motion_capture"]["noise_m"]
        if config["motion_capture"]["noise_of"] == "distance":
            noise_m /= sqrt(2)
    return noise_m


# Files named by a configuration, and whether they exist.

# Suffixes of configurations, which no recording has.
YAML = (".yaml", ".yml")


def recording_files(config: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield key and file of each recording's files."""
    for i, recording in enumerate(config["recordings"]):
        key = f"recordings[{i}].file"
        is_list = isinstance(recording["file"], list)
        for k, name in enumerate(files_of(recording)):
            yield f"{key}[{k}]" if is_list else key, name


def unnameable_files(config: dict[str, Any]) -> Iterator[str]:
    """Yield a message for each name that no file can have: the system refuses it."""
    for key, name in [*recording_files(config), *external_files(config)]:
        try:
            os.stat(name)
        except OSError as error:
            if error.errno == errno.ENAMETOOLONG:
                found = f"a name of {len(name)} characters"
                yield mismatch(key, "the name of a file", found)
        except ValueError:  # a zero byte, or half a character
            yield mismatch(key, "the name of a file", repr(name))


def missing_files(config: dict[str, Any]) -> Iterator[str]:
    """Yield a message for each file that does not exist, or is no plain file."""
    for key, name in [*recording_files(config), *external_files(config)]:
        file = Path(name)
        if file.is_file():
            continue
        if file.exists():
            found = f"'{file}', which is {kind_of(file.stat().st_mode)}"
        else:
            found = f"no '{file}'{nearest_file(file)}"
        yield mismatch(key, "a file", found)


def nearest_file(file: Path) -> str:
    """Suggest an existing file nearby or of a similar name, or report no folder."""
    here = Path.cwd()
    above = here.parents[:2]
    below = sorted(here.glob("*/"))
    for other_folder in (*above, *below):
        if os.path.isfile(other_folder / file):
            go = "paths hold from where hopdata runs, so go there (cd)"
            return f"; it is in {other_folder}: {go}"
    folder = file.parent
    if not folder.is_dir():
        return f"; there is no folder '{folder}' in {here}"
    # A configuration is not offered where a recording is meant, nor the reverse.
    names = [
        one.name
        for one in sorted(folder.iterdir())
        if one.is_file()
        and not one.name.startswith(".")
        and (one.suffix in YAML) == (file.suffix in YAML)
    ]
    near = did_you_mean(file.name, names)
    if near:
        return near
    same_format = [name for name in names if name.endswith(file.suffix)]
    if same_format:
        return f"; in that folder are {', '.join(same_format[:3])}"
    return f" in {here}"


# Names, markers and feet.

# Names under results/ whose folders hold other results already.
RESERVED_STUDIES = ("benchmarks", "both_sides")


def _repeated(config: dict[str, Any]) -> Iterator[str]:
    """Yield names that occur twice; the landings of a file would count twice."""
    # In lower case, since some file systems ignore case.
    recordings = [
        (f"recordings[{i}].name", entry["name"].lower())
        for i, entry in enumerate(config["recordings"])
    ]
    yield from _once("name", recordings)
    markers = [
        (f"markers.{role}[{k}]", name)
        for role, names in config["markers"].items()
        for k, name in enumerate(names)
    ]
    yield from _once("marker", markers)
    # By real path, so that a link to a file counts as that file.
    files = [
        (key, os.path.relpath(os.path.realpath(name)))
        for key, name in recording_files(config)
    ]
    yield from _once("file", files)


def _blocks_of_all(config: dict[str, Any]) -> Iterator[str]:
    """Yield recordings without a block beside others that have one."""
    recordings = config["recordings"]
    if all(recording["block"] is None for recording in recordings):
        return
    for i, recording in enumerate(recordings):
        if recording["block"] is None:
            place = f"recordings[{i}].block"
            yield mismatch(place, "a label, as others have one", "null (nothing)")


def _left_out(config: dict[str, Any]) -> Iterator[str]:
    known = [*config["markers"]["body"], *config["markers"]["feet"]]
    for i, recording in enumerate(config["recordings"]):
        for k, entry in enumerate(recording["exclude"]):
            place = f"recordings[{i}].exclude[{k}]"
            yield from _wrong_exclusion(place, entry)
            named = [(f"{place}.markers", name) for name in entry["markers"]]
            yield from _unknown("a marker of body or feet", known, named)


def _wrong_exclusion(place: str, entry: Mapping[str, Any]) -> Iterator[str]:
    """Yield mistakes in one entry of ``exclude``: times in no order, two choices."""
    begin = entry["from_s"]
    end = entry["to_s"]
    if begin is not None and end is not None and not end > begin:
        wanted = f"more than from_s ({begin:g} s)"
        yield mismatch(f"{place}.to_s", wanted, f"{end:g} s")
    others = [
        key for key in ("from_s", "to_s", "markers") if entry[key] not in (None, [])
    ]
    if entry["landings"] and others:
        yield mismatch(f"{place}.landings", "no other choice beside them", others[0])


#: Most feet of a study.
#: Unit: feet. Origin: chosen. Six feet have 720 contact orders.
MOST_FEET = 6


def feet_of(config: Mapping[str, Any]) -> list[str]:
    """Return the feet, in order; the block ``feet`` joins several markers in one."""
    foot_of_marker = {}
    for foot in config["feet"]:
        for marker in foot["markers"]:
            foot_of_marker[marker] = foot["name"]
    feet = [foot_of_marker.get(marker, marker) for marker in config["markers"]["feet"]]
    return list(dict.fromkeys(feet))


def _joined_feet(config: dict[str, Any]) -> Iterator[str]:
    markers = config["markers"]
    joined: list[tuple[str, str]] = []
    taken = [*markers["feet"], *markers["body"], *markers["boom"]]
    for i, foot in enumerate(config["feet"]):
        of_foot = enumerate(foot["markers"])
        joined += [(f"feet[{i}].markers[{k}]", name) for k, name in of_foot]
        named = [(f"feet[{i}].markers", name) for name in foot["markers"]]
        yield from _unknown("a marker of markers.feet", markers["feet"], named)
        if foot["name"] in taken:
            yield mismatch(f"feet[{i}].name", "a name of its own", f"'{foot['name']}'")
        taken.append(foot["name"])
    yield from _once("marker", joined)
    count = len(feet_of(config))
    if not 2 <= count <= MOST_FEET:
        found = f"{count}; feet joins markers"
        yield mismatch("markers.feet", f"2 to {MOST_FEET} feet", found)
    simulated = [entry["name"] for entry in config["recordings"] if not files_of(entry)]
    if config["feet"] and simulated:
        beside = f"the simulated recording {simulated[0]}"
        yield f"feet: expected none beside {beside}, whose feet have one marker each"


def _home_marker(config: dict[str, Any]) -> Iterator[str]:
    marker = config["home"]["marker"]
    if isinstance(marker, str):
        marker = [marker]
    if marker is not None:
        named = [("home.marker", one) for one in marker]
        yield from _unknown("a body marker", config["markers"]["body"], named)


# Keys that limit one another.

# The default of sections.threshold_sigmas in the schema.
DEFAULT_SIGMAS = 3.0

_IN_ORDER = (
    ("sections.pre_height_m", "more", "sections.post_height_m"),
    ("subspaces.components", "fewer", "subspaces.samples"),
)


def _in_order(config: dict[str, Any]) -> Iterator[str]:
    for key, side, other in _IN_ORDER:
        value: Any = reduce(getitem, key.split("."), config)
        limit: Any = reduce(getitem, other.split("."), config)
        if value is None or limit is None:
            continue
        holds = value > limit if side == "more" else value < limit
        if not holds:
            yield mismatch(key, f"{side} than {other} ({limit:g})", f"{value:g}")


def _idle_section_keys(config: dict[str, Any]) -> Iterator[str]:
    """Yield keys of `sections` that would decide nothing beside the others."""
    sections = config["sections"]
    is_printed = sections["rule"] == "printed"
    heights = (sections["pre_height_m"], sections["post_height_m"])
    thresholds = (sections["min_foot_threshold_m"], sections["max_foot_threshold_m"])
    sigmas = sections["threshold_sigmas"]
    if is_printed and sigmas != DEFAULT_SIGMAS:
        wanted = (
            "none beside sections.rule: printed, "
            "whose thresholds are knees of densities"
        )
        yield mismatch("sections.threshold_sigmas", wanted, f"{sigmas:g}")
    bandwidth_m = sections["bandwidth_m"]
    needs_thresholds = is_printed and None in thresholds
    chooses_nothing = None not in heights and not needs_thresholds
    if bandwidth_m is not None and chooses_nothing:
        wanted = "none beside heights that are given, since it would choose nothing"
        yield mismatch("sections.bandwidth_m", wanted, f"{bandwidth_m:g}")


def _scales_in_order(config: dict[str, Any]) -> Iterator[str]:
    for one, following in pairwise(config["scaling_study"]["scales"]):
        if not following < one:
            wanted = "the largest first and each smaller than the one before"
            found = f"{following:g} after {one:g}"
            yield mismatch("scaling_study.scales", wanted, found)
            return


def _enough_flips(config: dict[str, Any]) -> Iterator[str]:
    """Yield a number of sign flips too small for any p-value to be small enough."""
    flips = config["verdict"]["flips"]
    confidence = config["verdict"]["confidence"]
    # A p-value of n flips is at least 1 / (1 + n).
    if (1 + flips) * (1 - confidence) <= 1:
        least = 1 / (1 - confidence) - 1
        small = f"with fewer no p-value is below {1 - confidence:.3g}"
        yield mismatch("verdict.flips", f"more than {least:.0f}, {small}", flips)


# Simulated recordings.


def _simulated_markers(config: dict[str, Any]) -> Iterator[str]:
    """Yield the first configured marker that the simulation, if any, does not make."""
    if all(recording["file"] is not None for recording in config["recordings"]):
        return
    simulation = config["simulation"]
    # The standard scene is not loaded, since every start would pay for it.
    if simulation["scene"] == STANDARD:
        n_feet = simulation[STANDARD]["n_legs"]
        has_boom = True
    else:
        from hopdata.synthesis.simulate import Simulation

        # Whether the integrator suits is told by `_integrator`.
        by_driver = {**simulation, "integrator": "driver"}
        try:
            scene = Simulation.of(by_driver).scene
        except ConfigError as error:
            yield str(error)
            return
        n_feet = scene.n_legs
        has_boom = scene.has_boom
    n_body = len(config["motion_capture"]["markers"]["body_m"])
    made = [f"body{i + 1}" for i in range(n_body)]
    made += [f"foot{i + 1}" for i in range(n_feet)]
    if has_boom:
        made.append("boom")
    for role, names in config["markers"].items():
        for name in names:
            if name not in made:
                named = [(f"markers.{role}", name)]
                yield from _unknown("a marker of the simulation", made, named)
                return


def _integrator(config: dict[str, Any]) -> Iterator[str]:
    """Yield a printed integrator of what it cannot do: reset a state at an event."""
    simulation = config["simulation"]
    has_files = all(recording["file"] is not None for recording in config["recordings"])
    if has_files or simulation["integrator"] != "printed":
        return
    name = simulation["scene"]
    if simulation["control"]["impulse"] != 0:
        cause = "simulation.control.impulse"
    elif name != STANDARD and scene_class(name).resets_state:
        cause = f"simulation.scene: {name}"
    else:
        return
    wanted = f"driver beside {cause}, which resets states, as the printed method cannot"
    found = "printed"
    if config["printed"]:
        found = "printed, by printed: true; set simulation.integrator: driver"
    yield mismatch("simulation.integrator", wanted, found)


def _simulated_files(config: dict[str, Any]) -> Iterator[str]:
    for i, recording in enumerate(config["recordings"]):
        simulation = recording["simulation"]
        given = [key for key, value in simulation.items() if value is not None]
        if recording["file"] is not None and given:
            place = f"recordings[{i}].simulation"
            yield mismatch(place, "nothing beside a file", ", ".join(given))


# Names that the workflow cannot use.


def _braces(config: dict[str, Any]) -> Iterator[str]:
    """Yield files with braces, which the workflow would take for wildcards."""
    for key, name in [*recording_files(config), *external_files(config)]:
        if "{" in name or "}" in name:
            yield mismatch(key, "a path without braces", f"'{name}'; rename the file")


def _reserved_study(config: dict[str, Any]) -> Iterator[str]:
    """Yield a study name whose folder holds the project's own results."""
    if config["study"] in RESERVED_STUDIES:
        reserved = " and ".join(RESERVED_STUDIES)
        wanted = f"a name other than {reserved}, whose folders under results/ are taken"
        yield mismatch("study", wanted, f"'{config['study']}'")


CHECKS: list[Callable[[dict[str, Any]], Iterator[str]]] = [
    _repeated,
    _blocks_of_all,
    _left_out,
    _joined_feet,
    _home_marker,
    _in_order,
    _idle_section_keys,
    _scales_in_order,
    _simulated_markers,
    _integrator,
    _simulated_files,
    external_mistakes,
    _braces,
    _reserved_study,
    _enough_flips,
]
