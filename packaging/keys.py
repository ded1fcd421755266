"""Which rules run again if a key changes, found by changing each."""

from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from typing import Any

from hopdata.config.consistency import files_of
from hopdata.config.loading import load_config
from hopdata.line import Line, Stage

MARKERS = {"body": ["body1", "body2", "body3"], "feet": ["foot1", "foot2"]}
#: No value of the schema, so that each key changes.
OTHER = "another value"
#: Keys that name all files of a study or of a recording: a new name is a new study.
NAMES = ("study", "recordings.name")


def studies() -> list[dict[str, Any]]:
    """Return a simulated and a recorded study: some keys concern only one."""
    simulated = {"name": "monday"}
    recorded = {"name": "monday", "file": "monday.c3d"}
    return [
        load_config(
            {"study": "keys", "markers": MARKERS, "recordings": [recording]},
            check_files=False,
        )
        for recording in (simulated, recorded)
    ]


def keys_of(config: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """Yield the path to each key that is no section."""
    for name, value in config.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            yield from ((name, *rest) for rest in keys_of(value[0]))
        elif isinstance(value, dict) and value:
            yield from ((name, *rest) for rest in keys_of(value))
        else:
            yield (name,)


def changed(config: Mapping[str, Any], key: tuple[str, ...]) -> dict[str, Any]:
    """Return a copy in which one key has another value."""
    copy = deepcopy(dict(config))
    section = copy
    for name in key[:-1]:
        section = section[name]
        if isinstance(section, list):
            section = section[0]
    section[key[-1]] = OTHER
    return copy


def takes(stage: Stage, config: Mapping[str, Any]) -> list[Any]:
    """Return all that a stage takes from the configuration, for the first recording."""
    entry = config["recordings"][0]
    taken = [stage.settings(config, entry["name"] if "recording" in stage.per else "")]
    if stage.sources:
        taken.append(files_of(entry))
    return taken


def repeated(line: Line) -> dict[str, list[str]]:
    """Return for each key the stages that take it, in order."""
    found: dict[str, list[str]] = {}
    for config in studies():
        for key in keys_of(config):
            name = ".".join(key)
            stages = found.setdefault(name, [])
            if name in NAMES:
                continue
            other = changed(config, key)
            for stage in line.stages.values():
                if takes(stage, config) != takes(stage, other):
                    stages.append(stage.name)
    in_order = [*line.stages]
    return {
        name: sorted({*stages}, key=in_order.index) for name, stages in found.items()
    }


def after(line: Line, stages: list[str]) -> list[str]:
    """Return the stages that run because these run, in order, without these."""
    reached = {*stages}
    for name in line.stages:  # each comes after those whose results it takes
        if reached.intersection(line.before(name)):
            reached.add(name)
    return [name for name in line.stages if name in reached and name not in stages]


def table(line: Line) -> str:
    """Return the keys that each rule takes as a table, for the page on results."""
    by_stages: dict[tuple[str, ...], list[str]] = {}
    found = repeated(line)
    for name, stages in found.items():
        if stages:
            by_stages.setdefault(tuple(stages), []).append(name)
    in_order = [*line.stages]
    rows = ["| keys | rules that take them | and run after these |", "|---|---|---|"]
    for stages in sorted(by_stages, key=lambda one: [in_order.index(x) for x in one]):
        names = _listed(_by_section(by_stages[stages], [*found]))
        then = after(line, [*stages])
        others = [one for one in line.stages if one not in (*stages, *then)]
        followers = _listed(then) or "-"
        if not others:
            followers = "all others"
        elif len(then) > len(others):
            followers = f"all others but {_listed(others)}"
        rows.append(f"| {names} | {_listed(stages)} | {followers} |")
    return "\n".join(rows)


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _by_section(names: list[str], every: list[str]) -> list[str]:
    """Write all the keys of a section as one, such as ``floor.*``."""
    found = []
    for name in names:
        short = name
        section = name
        while "." in section:
            section = section.rpartition(".")[0]
            whole = {one for one in every if one.startswith(f"{section}.")}
            if not whole <= {*names}:
                break
            short = f"{section}.*"
        found.append(short)
    return list(dict.fromkeys(found))
