"""How a stage is told: once, by its function, from which rules, steps and pages follow.

A stage is a plain function. Its definition is its record:

- a parameter without a default is a result of an earlier stage, or a wildcard;
- a parameter whose default is `key` is a setting of the configuration;
- a parameter whose default is `source_files` takes the files of a recording;
- the fields of the class that it returns are its results, each with its file.

`hopdata.stages` tells the stages of a study. `packaging/rules.py` writes Snakemake's
rules from them, and `hopdata.walk` runs them in one process.
"""

from __future__ import annotations

import inspect
import string
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache, wraps
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, ParamSpec, TypeVar, cast, dataclass_transform

Config = Mapping[str, Any]
Arguments = ParamSpec("Arguments")
Made = TypeVar("Made")
#: The wildcard of stages that run once for each recording.
RECORDING = "recording"


# Kinds of files.


@dataclass(frozen=True)
class Kind:
    """How results of one kind are kept in a file.

    Functions are named as ``module:function``.

    Attributes
    ----------
    write
        Takes a path and the result.
    read
        Takes a path; returns the content of the file.
    restore
        Takes this content; returns the result. Empty if they are the same.
    stored
        Takes the result; returns what a later stage would read: rounded as in the file.
        Empty if a file keeps the result exactly.
    """

    write: str
    read: str
    restore: str = ""
    stored: str = ""

    @property
    def modules(self) -> set[str]:
        """Names of the modules that write and read it."""
        functions = [self.write, self.read, self.restore, self.stored]
        return {function.partition(":")[0] for function in functions if function}

    def as_stored(self, result: Any) -> Any:
        """Return a result as a later stage of the workflow would read it."""
        if not self.stored:
            return result
        return resolve_name(self.stored)(result)


@dataclass(frozen=True)
class Result:
    """One result of a stage, and its file.

    Attributes
    ----------
    name
        Its name, by which later stages ask for it.
    path
        Its file, relative to the study's folder; ``{recording}`` and ``{method}`` are
        wildcards.
    kind
        How it is kept.
    """

    name: str
    path: str
    kind: Kind

    @property
    def wildcards(self) -> set[str]:
        """Names of the wildcards in the path."""
        parts = string.Formatter().parse(self.path)
        return {name for _, name, _, _ in parts if name}

    def write(self, path: str | Path, result: Any) -> None:
        """Write the result to a file."""
        resolve_name(self.kind.write)(path, result)

    def read(self, path: str | Path) -> Any:
        """Read the result from a file."""
        content = resolve_name(self.kind.read)(path)
        if not self.kind.restore:
            return content
        return resolve_name(self.kind.restore)(content)


def saved(path: str, kind: Kind) -> Any:
    """Describe a field of a stage's results; see `Result`."""
    return field(metadata={"path": path, "kind": kind})


@dataclass_transform(frozen_default=True, field_specifiers=(saved,))
def results(cls: type[Made]) -> type[Made]:
    """Make a class the results of a stage: a frozen dataclass of `saved` fields.

    It is shown in one line, not by all its tables.
    """
    made = dataclass(frozen=True, repr=False)(cls)
    made.__repr__ = _shown  # type: ignore[method-assign, assignment]
    return made


def _shown(made: Any) -> str:
    parts = [f"{one.name}: {in_short(getattr(made, one.name))}" for one in fields(made)]
    return f"<{type(made).__name__} {'; '.join(parts)}>"


#: Characters of a value that is shown as it is.
SHORT = 120


def in_short(value: Any) -> str:
    """Describe a value in a few words, however large it is."""
    if hasattr(value, "columns"):
        return f"a table of {len(value)} rows"
    if isinstance(value, dict):
        inner = [name for name in value if isinstance(name, str)]
        return f"of {', '.join(inner[:4])}{', ...' if len(inner) > 4 else ''}"
    if isinstance(value, list):
        return f"{len(value)} entries"
    words = repr(value)
    return words if len(words) <= SHORT else type(value).__name__


# Settings, and files that no stage makes.


@dataclass(frozen=True)
class Key:
    """A setting of a stage.

    Attributes
    ----------
    of
        A dotted key, or a function that derives the setting from the configuration, and
        from the name of the recording if it has a second parameter.
    without
        Keys of this section that the stage does not take.
    """

    of: str | Callable[..., Any]
    without: tuple[str, ...] = ()

    @property
    def of_each_recording(self) -> bool:
        """Whether each recording has a value of its own."""
        if callable(self.of):
            return len(inspect.signature(self.of).parameters) > 1
        return self.of.startswith("recordings.")

    def value(self, config: Config, recording: str = "") -> Any:
        """Return the value of a study, or of one of its recordings."""
        if callable(self.of):
            if self.of_each_recording:
                return self.of(config, recording)
            return self.of(config)
        first, _, rest = self.of.partition(".")
        if first == "recordings":
            every = {entry["name"]: entry[rest] for entry in config["recordings"]}
            # A stage of the whole study takes the values of all recordings.
            return every[recording] if recording else every
        found: Any = config
        for part in self.of.split("."):
            found = found[part]
        if self.without:
            found = {k: v for k, v in found.items() if k not in self.without}
        return found


def key(of: str | Callable[..., Any], *, without: tuple[str, ...] = ()) -> Any:
    """Mark a parameter as a setting; a call without it takes the schema's default."""
    return Key(of, without)


@dataclass(frozen=True)
class SourceFiles:
    """The user's files of a recording.

    Attributes
    ----------
    otherwise
        Name of the result that takes their place if the user gives none.
    """

    otherwise: str


def source_files(*, otherwise: str) -> Any:
    """Mark a parameter that takes a recording's files; see `SourceFiles`."""
    return SourceFiles(otherwise)


@cache
def _defaults() -> Config:
    from hopdata.config.loading import load_config

    markers = {"body": ["body1", "body2", "body3"], "feet": ["foot1", "foot2"]}
    return load_config(
        {
            "study": "defaults",
            "recordings": [{"name": "recording"}],
            "markers": markers,
        }
    )


# Stages.


@dataclass(frozen=True)
class Needs:
    """What a job of a stage asks for on a cluster; each retry doubles time and memory.

    Attributes
    ----------
    minutes
        Longest time.
    mb_a_mb
        Memory for each MB of its files, MB.
    priority
        Jobs of higher priority start first, since more waits for them.
    """

    minutes: int = 20
    mb_a_mb: int = 10
    priority: int = 0


@dataclass(frozen=True)
class Stage:
    """The record of a stage.

    Attributes
    ----------
    function
        The function itself.
    per
        Wildcards: the stage runs once for each of their values.
    needs
        What a job of it asks for.
    inputs
        Names of the results of other stages that it takes.
    sources
        The parameters that take files that no stage makes.
    keys
        Its settings, by parameter.
    """

    function: Callable[..., Any]
    per: tuple[str, ...]
    needs: Needs
    inputs: tuple[str, ...]
    sources: Mapping[str, SourceFiles]
    keys: Mapping[str, Key]

    @property
    def name(self) -> str:
        """The name of the function, and of the workflow's rule."""
        return self.function.__name__

    @property
    def summary(self) -> str:
        """The first line of what the function says about itself."""
        return str(inspect.getdoc(self.function)).splitlines()[0]

    @property
    def takes(self) -> tuple[str, ...]:
        """Wildcards whose values the function takes as arguments."""
        parameters = inspect.signature(self.function).parameters
        return tuple(name for name in self.per if name in parameters)

    @property
    def returned(self) -> type[Any]:
        """The class of its results."""
        name = inspect.signature(self.function).return_annotation
        module = sys.modules[self.function.__module__]
        return cast(type[Any], getattr(module, name))

    @property
    def results(self) -> dict[str, Result]:
        """Its results by name, in order."""
        return {
            one.name: Result(one.name, **one.metadata) for one in fields(self.returned)
        }

    def makes_all(self, result: Result) -> bool:
        """Tell whether it makes a result of all recordings at once, by their names."""
        return RECORDING in result.wildcards - {*self.per}

    def settings(self, config: Config, recording: str = "") -> dict[str, Any]:
        """Return the values of its settings."""
        return {name: one.value(config, recording) for name, one in self.keys.items()}


def _recorded(
    function: Callable[..., Any], per: tuple[str, ...], needs: Needs
) -> Stage:
    inputs = []
    sources = {}
    keys = {}
    for one in inspect.signature(function).parameters.values():
        if isinstance(one.default, Key):
            keys[one.name] = one.default
        elif isinstance(one.default, SourceFiles):
            sources[one.name] = one.default
        elif one.name not in per:
            inputs.append(one.name)
    return Stage(function, per, needs, tuple(inputs), sources, keys)


class Line:
    """Stages, in order."""

    def __init__(self) -> None:
        #: The stages by name.
        self.stages: dict[str, Stage] = {}

    def stage(
        self,
        *,
        per: tuple[str, ...] = (),
        minutes: int = 20,
        mb_a_mb: int = 10,
        priority: int = 0,
    ) -> Callable[[Callable[Arguments, Made]], Callable[Arguments, Made]]:
        """Record a function as a stage, which runs once for each value of `per`.

        See `Needs` for the other parameters.
        """

        def record(function: Callable[Arguments, Made]) -> Callable[Arguments, Made]:
            stage = _recorded(function, per, Needs(minutes, mb_a_mb, priority))
            self.stages[stage.name] = stage

            @wraps(function)
            def called(*given: Arguments.args, **named: Arguments.kwargs) -> Made:
                recording = "recording" if RECORDING in per else ""
                for name, one in stage.keys.items():
                    if name not in named:
                        named[name] = one.value(_defaults(), recording)
                return function(*given, **named)

            return called

        return record

    @property
    def results(self) -> dict[str, Result]:
        """Every result by name, in order."""
        found = {}
        for stage in self.stages.values():
            found.update(stage.results)
        return found

    def maker_of(self, result: str) -> Stage:
        """Return the stage that makes a result."""
        return next(one for one in self.stages.values() if result in one.results)

    def before(self, name: str) -> list[str]:
        """Return the stages whose results a stage takes."""
        stage = self.stages[name]
        taken = [files.otherwise for files in stage.sources.values()]
        makers = [self.maker_of(one).name for one in [*taken, *stage.inputs]]
        return list(dict.fromkeys(makers))

    def sources(self, name: str) -> tuple[list[str], set[str]]:
        """Return the texts of a stage, and the modules that read and write for it.

        Its results depend on no other stage in the same file.
        """
        stage = self.stages[name]
        texts = [inspect.getsource(stage.returned), inspect.getsource(stage.function)]
        modules = set()
        for result in self.results.values():
            if result.name in stage.inputs or result.name in stage.results:
                modules |= result.kind.modules
        return texts, modules

    def run_on_files(
        self,
        name: str,
        read_from: Mapping[str, Any],
        write_to: Mapping[str, Any],
        *,
        settings: Mapping[str, Any],
        wildcards: Mapping[str, str],
    ) -> None:
        """Run a stage as a job: read its inputs, call it, write its results.

        Parameters
        ----------
        read_from
            File of each input, or its files: one a recording, named after it.
        write_to
            File of each result, or its files: one a recording, named after it.
        settings, wildcards
            Values that hold all its settings, and its wildcards.
        """
        stage = self.stages[name]
        given = {one: settings[one] for one in stage.keys}
        for one in stage.takes:
            given[one] = wildcards[one]
        for one in stage.sources:
            given[one] = _listed(read_from[one])
        for one in stage.inputs:
            given[one] = _read(self.results[one], read_from[one])
        made = stage.function(**given)
        for result in stage.results.values():
            _write(result, write_to[result.name], getattr(made, result.name), stage)


def _write(result: Result, place: str | Sequence[str], made: Any, stage: Stage) -> None:
    if not stage.makes_all(result):
        result.write(cast(str, place), made)
        return
    for file in place:
        result.write(file, made[Path(file).stem])


def _read(result: Result, place: str | Sequence[str]) -> Any:
    if isinstance(place, str):
        return result.read(place)
    return {Path(file).stem: result.read(file) for file in place}


def _listed(place: str | Sequence[str]) -> list[str]:
    if isinstance(place, str):
        return [place]
    return [*place]
