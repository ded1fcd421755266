"""``hopdata run``: a study or a group, or a study again from its record."""

from __future__ import annotations

import argparse
import filecmp
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from hopdata import products
from hopdata.bundled import SNAKEFILE
from hopdata.commands import answers
from hopdata.commands.bringing import bring
from hopdata.commands.terminal import OK, PROBLEM, write_text
from hopdata.commands.values import values_of
from hopdata.commands.workflow import is_dry, run_workflow
from hopdata.errors import (
    NO_BREAK_SPACES,
    ConfigError,
    HopdataError,
    did_you_mean,
    require,
)
from hopdata.jobs import read_json
from hopdata.messages import Message
from hopdata.notes import Note
from hopdata.provenance import package_digest
from hopdata.report import verdict
from hopdata.report.tables import quality_summary
from hopdata.stages import LINE

GROUP = SNAKEFILE.parent / "workflow" / "group.smk"
SAMPLE = Path("data/sample/hopper.h5")
SAMPLE_CONFIG = Path("config/config.yaml")


@dataclass(frozen=True)
class _Run:
    """What is run, and the files with its answer and its page.

    A target is a rule of a product that makes something beside studies. It says itself
    what it found, so that no file with an answer is named here.
    """

    config: Path
    study: str
    snakefile: Path
    answer: Path | None = None
    page: Path | None = None
    target: str = ""


def run(options: argparse.Namespace) -> int:
    """Run a study or a group in this folder; report its results and their place."""
    if options.provenance is not None:
        return _run_again(options)
    asked = _asked(options.config)
    passed = []
    if asked.target:
        passed.append(asked.target)
    if options.dry_run:
        passed.append("--dry-run")
    if options.force:
        passed.append("--forceall")
    if options.until is not None:
        _require_stage(options.until, asked)
        passed += ["--until", options.until]
    passed += options.passed_on
    # A study of few landings gives their contacts, and that is no error.
    held: list[str] | None = None
    if _gives_contacts(asked, is_part=options.until is not None):
        held = []
    code = run_workflow(
        asked.config,
        asked.study,
        *("--cores", options.cores),
        *passed,
        snakefile=asked.snakefile,
        if_locked=options.if_locked,
        ended=partial(_tell_early, asked),
        held=held,
    )
    answers.give(study=asked.study, dry_run=is_dry(passed))
    if code:
        answers.give(log=Path("results", asked.study, "logs", "run.log"))
        return PROBLEM if held is None else _contacts_instead(asked, held)
    if is_dry(passed):
        return OK
    if options.until is not None:
        _print_results_of(options.until, asked.study)
    else:
        _print_answer(asked)
    return OK


def _tell_early(asked: _Run, stage: str) -> None:
    """Say that a study reaches no verdict as soon as this is known, before its page."""
    is_study = asked.snakefile == SNAKEFILE and not asked.target
    if stage != "verdict" or not is_study or asked.answer is None:
        return
    try:
        found = read_json(asked.answer)
    except (HopdataError, OSError):
        return  # the end of the run will tell
    if found.get("effect") is not None or found.get("jump") is not None:
        return
    reason = "; ".join(Note.from_dict(one).reason for one in found["notes"][-1:])
    said = Message("commands.verdict_not_reached", {"reason": reason})
    print(f"note: {asked.study}: {said}", file=sys.stderr, flush=True)


def _gives_contacts(asked: _Run, *, is_part: bool) -> bool:
    """Tell whether contacts may be given in place of a study's page."""
    return asked.snakefile == SNAKEFILE and not asked.target and not is_part


def _contacts_instead(asked: _Run, held: Sequence[str]) -> int:
    """Give the contacts of a study that stopped since its landings are too few.

    Return the exit code: 0 if they are given, 1 if something else stopped the study,
    which the errors that were held back tell.
    """
    from hopdata.commands.contacts_instead import write_few
    from hopdata.config.loading import load_config

    is_given = False
    try:
        is_given = write_few(load_config(asked.config), Path("results", asked.study))
    except HopdataError:
        pass  # the workflow has told the reason
    finally:
        if not is_given:
            print("".join(held), end="", file=sys.stderr, flush=True)
    return OK if is_given else PROBLEM


def _asked(config: Path | None) -> _Run:
    """Return what a configuration asks for; if none is given, the bundled one."""
    from hopdata.config.loading import load_config, read_yaml

    bundled = SNAKEFILE.parent / SAMPLE_CONFIG
    if config is not None and not config.is_file() and str(config) in _targets():
        bring(SAMPLE)
        return _Run(bundled, str(config), SNAKEFILE, target=str(config))
    if config is None:
        bring(SAMPLE)
        config = bundled
    else:
        bring_bundled(config)
    content = read_yaml(config)
    if isinstance(content, dict) and "samples" in content:
        from hopdata.samples import read_group

        study = read_group(config)["study"]
        folder = Path("results", study)
        return _Run(config, study, GROUP, folder / "group.json", folder / "group.html")
    study = load_config(config)["study"]
    folder = Path("results", study)
    answer = folder / "verdict.json"
    return _Run(config, study, SNAKEFILE, answer, folder / "report.html")


def _targets() -> set[str]:
    """Return what products make beside studies."""
    return {name for product in products.installed() for name in product.targets()}


def _require_stage(name: str, asked: _Run) -> None:
    """Refuse a name that is no stage, and what runs whole: a group, a target."""
    if asked.target:
        wanted = "the configuration of a study, as a target is made whole"
        raise ConfigError.at("--until", wanted, f"a target, {asked.target}")
    if asked.snakefile == GROUP:
        wanted = "the configuration of a study, as those of a group run whole"
        raise ConfigError.at("--until", wanted, f"a group, {asked.study}")
    if name not in LINE.stages:
        near = did_you_mean(name, [*LINE.stages])
        stages = ", ".join(LINE.stages)
        raise ConfigError.at("--until", f"one of {stages}", f"'{name}'{near}")


def _print_results_of(name: str, study: str) -> None:
    """Name the files that a stage has written."""
    for result in LINE.stages[name].results.values():
        pattern = re.sub(r"\{\w+\}", "*", result.path)
        for file in sorted(Path("results", study).glob(pattern)):
            answers.give_also("files", file=file)
            print(file)


def _print_answer(asked: _Run) -> None:
    """Print the answer and the place of the page, if the run has made both."""
    answer, page = asked.answer, asked.page
    if answer is None or page is None or not (page.exists() and answer.exists()):
        return
    found = read_json(answer)
    answers.give(answer=answer, page=page, verdict=_verdict_of(found))
    print(_answer_of(found))
    checks = answer.with_name("quality.json")
    if checks.exists():
        quality = read_json(checks)
        answers.give(quality=quality)
        good, others = quality_summary(quality)
        told = f"quality of the data: {good}"
        if others:
            told += f"; {others}"
        print(told)
    print(page)


def _answer_of(found: Mapping[str, Any]) -> str:
    """Return the answer of a study in the words of its page, or that of a group."""
    if "messages" not in found:
        return str(found["sentence"])
    said = " ".join(map(str, verdict.answer(found)))
    for blank in NO_BREAK_SPACES:
        said = said.replace(blank, " ")
    return said


def _verdict_of(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return what scripts read of a verdict, or of the answer of a group."""
    keys = ("conclusion", "sentence", "n_landings", "n_feet", "power", "effect")
    return {key: found[key] for key in keys if key in found}


# A study again.


def _run_again(options: argparse.Namespace) -> int:
    """Repeat the study of a ``provenance.json``, and compare all tables."""
    import yaml

    from hopdata import __version__

    place = options.provenance
    record = _provenance(place)
    config = record["config"]
    _require_sound(place, config)
    if record["code_sha256"] != package_digest():
        other = f"made by other code of version {__version__}"
        print(f"note: {place}: {other}", file=sys.stderr)
    # Names of studies have at most 100 characters.
    again = f"{config['study'][:94]}_again"
    copy = Path("results", again, "config.yaml")
    _require_inside(copy)
    write_text(copy, yaml.safe_dump({**config, "study": again}))
    passed = ("--cores", options.cores, *options.passed_on)
    if run_workflow(copy, again, *passed, if_locked=options.if_locked):
        return PROBLEM
    old = place.parent
    new = copy.parent
    made = read_json(new / place.name)["inputs"]
    if read_inputs(made, again) != read_inputs(record["inputs"], config["study"]):
        raise ConfigError.at(place, "the recordings that it names", "other content")
    tables = [f"tables/{one.name}" for one in sorted(old.glob("tables/*.csv"))]
    names = ["verdict.json", *tables]
    same, different, unreadable = filecmp.cmpfiles(old, new, names, shallow=False)
    print(f"{new}: {len(same)} of {len(names)} files are the same bytes")
    answers.give(results=new, same=same, different=sorted(different + unreadable))
    for name in sorted(different + unreadable):
        if (new / name).exists():
            print(f"  {name} differs")
        else:
            print(f"  {name} is missing")
    return PROBLEM if different or unreadable else OK


def read_inputs(inputs: Mapping[str, str], study: str) -> dict[str, str]:
    """Return digests by the names of files, without the folder of a study's own.

    A simulated recording lies in the folder of its study.
    """
    own = f"results/{study}/"
    return {name.removeprefix(own): digest for name, digest in inputs.items()}


def _require_inside(file: Path) -> None:
    """Refuse a file of results that links lead out of this folder's ``results``.

    The folder may come with the record from somebody else. That ``results`` itself is a
    link, say to a larger disk, is for the user to choose.
    """
    results = Path("results").resolve()
    if file.is_symlink() or not file.resolve().is_relative_to(results):
        found = f"a link to {file.resolve()}; remove it"
        raise ConfigError.at(file, "a file of this folder", found)


def _require_sound(place: Path, config: dict[str, Any]) -> None:
    """Check the configuration of a record before its values are used for anything."""
    from hopdata.config.loading import load_config

    try:
        load_config(config, check_files=False)
    except ConfigError as error:
        lines = [line.removeprefix("configuration: ") for line in error.args]
        raise ConfigError(*(f"{place}: config: {line}" for line in lines)) from None


def _provenance(file: Path) -> dict[str, Any]:
    """Return the content of a ``provenance.json`` of this version, once checked.

    The version comes first, since other versions may record other things.
    """
    from hopdata import __version__

    record: dict[str, Any] = {"versions": _value(file, "versions", dict)}
    version = record["versions"].get("hopdata")
    if not isinstance(version, str):
        wanted = "the version of hopdata that made it"
        raise ConfigError.at(f"{file}: versions", wanted, f"{version!r}"[:40])
    wanted = f"results of hopdata {__version__}"
    found = f"those of {version}; to make them again: pip install hopdata=={version}"
    require(version == __version__, str(file), wanted, found)
    record["config"] = _value(file, "config", dict)
    record["inputs"] = _value(file, "inputs", dict)
    record["code_sha256"] = _value(file, "code_sha256", str)
    return record


def _value(file: Path, key: str, kind: type) -> Any:
    """Return a value of a provenance, of the right kind."""
    value = values_of(file, "provenance.json", key)[0]
    if not isinstance(value, kind):
        wanted = "keys with values" if kind is dict else "text"
        raise ConfigError.at(f"{file}: {key}", wanted, f"{value!r}"[:40])
    return value


# Configurations and recordings that only the installation has.


def bring_bundled(config: Path) -> None:
    """Copy a configuration of the installation, and the files that it names."""
    bundled = SNAKEFILE.parent / config
    if config.exists() or config.is_absolute() or not bundled.is_file():
        return
    text = bundled.read_text(encoding="utf-8")
    named = re.findall(r"(?:config|data/sample)/\w+\.\w+", text)
    for file in dict.fromkeys([config, *map(Path, named)]):
        bring(file)
