"""``hopdata run``, ``plan``, ``clean``, ``doctor``: the workflow, its results and its needs."""

import argparse
import filecmp
import os
import platform
import re
import shutil
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from statistics import fmean
from typing import Any

from hopdata.analysis import SNAKEFILE, planned
from hopdata.commands.owner import (
    LOCKS,
    is_locked,
    lock_is_dead,
    owners,
    recorded,
    release_dead,
    who_is_at_work,
)
from hopdata.commands.terminal import OK, PROBLEM
from hopdata.errors import ConfigError, counted, require
from hopdata.jobs import read_json
from hopdata.provenance import MISSING, REPORTED, package_digest, version_of
from hopdata.report.tables import quality_summary

GROUP = SNAKEFILE.parent / "workflow" / "group.smk"
SAMPLE, SAMPLE_CONFIG = Path("data/sample/hopper.h5"), Path("config/config.yaml")
OPTIONAL = {"xarray": "Recording.to_xarray", "qtm-rt": "hopdata drive --host"}
# Snakemake's messages on jobs: start, end and count.
_SAID = re.compile(
    r" +jobid: (\d+)|Finished jobid: (\d+) \(Rule: (\w+)\)|(\d+) of (\d+) steps \("
)
_LAST_LINES, _DRY = 12, {"-n", "--dry-run", "--dryrun"}


def run(options: argparse.Namespace) -> int:
    """Run a study or a group in the current folder; report its results and their place."""
    from hopdata.config.loading import load_config, read_yaml

    if options.provenance is not None:
        return _run_again(options)
    config = options.config
    if config is None:
        _bring(SAMPLE)
        config = SNAKEFILE.parent / SAMPLE_CONFIG
    else:
        bring_bundled(config)
    if isinstance(content := read_yaml(config), dict) and "samples" in content:
        from hopdata.group import read_group

        study, snakefile = read_group(config)["study"], GROUP
        answer, page = (
            Path("results", study, "group.json"),
            Path("results", study, "group.html"),
        )
    else:
        study, snakefile = load_config(config)["study"], SNAKEFILE
        answer, page = (
            Path("results", study, name) for name in ("verdict.json", "report.html")
        )
    chosen = {"--dry-run": options.dry_run, "--forceall": options.force}
    passed = [*(flag for flag, is_set in chosen.items() if is_set), *options.passed_on]
    if run_workflow(
        config, study, "--cores", options.cores, *passed, snakefile=snakefile
    ):
        return PROBLEM
    if page.exists() and answer.exists() and not _DRY & set(passed):
        print(read_json(answer)["sentence"])
        if (checks := answer.with_name("quality.json")).exists():
            good, others = quality_summary(read_json(checks))
            print(f"quality of the data: {good}{others and f'; {others}'}")
        print(page)
    return OK


def _run_again(options: argparse.Namespace) -> int:
    """Repeat the study of a ``provenance.json`` as ``STUDY_again``, and compare all tables."""
    import yaml

    from hopdata import __version__
    from hopdata.config.loading import load_config

    place = options.provenance
    record = _provenance(place)
    config = record["config"]
    try:
        load_config(
            config, check_files=False
        )  # before its values are used for anything
    except ConfigError as error:
        raise ConfigError(
            *(
                f"{place}: config: {line.removeprefix('configuration: ')}"
                for line in error.args
            )
        ) from None
    if record["code_sha256"] != package_digest():
        print(
            f"note: {place}: made by other code of version {__version__}",
            file=sys.stderr,
        )
    again = f"{config['study'][:94]}_again"
    copy = Path("results", again, "config.yaml")
    copy.parent.mkdir(parents=True, exist_ok=True)
    copy.write_text(yaml.safe_dump({**config, "study": again}), encoding="utf-8")
    if run_workflow(copy, again, "--cores", options.cores, *options.passed_on):
        return PROBLEM
    old, new = place.parent, copy.parent
    if read_json(new / place.name)["inputs"] != record["inputs"]:
        raise ConfigError.at(place, "the recordings that it names", "other content")
    names = [
        "verdict.json",
        *(f"tables/{one.name}" for one in sorted(old.glob("tables/*.csv"))),
    ]
    same, *others = filecmp.cmpfiles(old, new, names, shallow=False)
    print(f"{new}: {len(same)} of {len(names)} files are the same bytes")
    for name in sorted(others[0] + others[1]):
        print(f"  {name} differs" if (new / name).exists() else f"  {name} is missing")
    return PROBLEM if any(others) else OK


def _provenance(file: Path) -> dict[str, Any]:
    """Return the content of a ``provenance.json`` of this version, with values of the right kinds.

    The version comes first, since other versions may record other things.
    """
    from hopdata import __version__

    name = "provenance.json"
    kinds: dict[type, str] = {dict: "keys with values", str: "text"}
    values: dict[str, Any] = {}

    def take(key: str, kind: type) -> None:
        values[key] = _values(file, name, key)[0]
        if not isinstance(values[key], kind):
            raise ConfigError.at(f"{file}: {key}", kinds[kind], f"{values[key]!r}"[:40])

    take("versions", dict)
    version = values["versions"].get("hopdata")
    if not isinstance(version, str):
        wanted = "the version of hopdata that made it"
        raise ConfigError.at(f"{file}: versions", wanted, f"{version!r}"[:40])
    found = f"those of {version}; to make them again: pip install hopdata=={version}"
    require(
        version == __version__, str(file), f"results of hopdata {__version__}", found
    )
    take("config", dict)
    take("inputs", dict)
    take("code_sha256", str)
    return values


def _values(file: Path, name: str, *keys: str) -> list[Any]:
    """Return values from a JSON file of a study's results."""
    try:
        content = read_json(file)
        return [content[key] for key in keys]
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, RecursionError):
        raise ConfigError.at(file, f"the {name} of a study", "another file") from None


def run_workflow(
    config: Path, study: str, *options: str, snakefile: Path = SNAKEFILE
) -> int:
    """Run Snakemake on a configuration, show progress, and return its exit code.

    Its stderr goes to ``results/<study>/logs/run.log``, which is named if it fails.
    """
    require(
        snakefile.exists(),
        str(snakefile),
        "the workflow",
        "no file; install hopdata anew",
    )
    log = Path("results", study, "logs", "run.log")
    # The order matters: --configfile takes any number of files, so a target would be
    # one.
    profile = SNAKEFILE.parent / "profiles" / "default"  # also that of a group
    places = [
        "--configfile",
        config,
        "--snakefile",
        snakefile,
        "--workflow-profile",
        profile,
    ]
    listed = ["--quiet", "rules", "host", "reason"] * ("--dry-run" in options)
    command = [
        sys.executable,
        "-m",
        "snakemake",
        *map(str, places),
        "--nocolor",
        *options,
        *listed,
    ]
    if said_of_lock := release_dead():
        print(f"hopdata: {said_of_lock}", file=sys.stderr, flush=True)
    if not os.access(
        os.path.expanduser("~"), os.W_OK
    ):  # Snakemake caches downloads there
        os.environ.setdefault("XDG_CACHE_HOME", os.path.abspath(".snakemake"))
    given = options[options.index("--cores") + 1]
    cores = int(given) if given.isdigit() else os.cpu_count() or 1
    said, begun, took, last = [], {"": time.monotonic()}, [], ""
    pipes: Any = {
        "stderr": subprocess.PIPE,
        "stdout": subprocess.PIPE if listed else None,
    }
    # Python would look for modules in the working folder first, for Snakemake and for
    # its jobs. That is a study's folder, into which anyone may have put files.
    pipes |= {"env": os.environ | {"PYTHONSAFEPATH": "1"}}
    with (
        subprocess.Popen(
            command, **pipes, encoding="utf-8", errors="replace"
        ) as snakemake,
        recorded(study, snakemake.pid),
    ):
        try:
            for line in snakemake.stderr or ():
                said.append(line)
                if line.startswith("hopdata:") and line not in said[:-1]:
                    print(line, end="", file=sys.stderr, flush=True)
                if not (found := _SAID.match(line)):
                    continue
                begins, ends, rule, done, number = found.groups()
                if begins:
                    begun[begins] = time.monotonic()
                elif ends:
                    took.append(time.monotonic() - begun.get(ends, begun[""]))
                    last = f"{rule} {took[-1]:.0f} s"
                else:
                    left = (int(number) - int(done)) * fmean(took or [0.0]) / cores
                    seconds = left or time.monotonic() - begun[""]
                    words = (
                        f"{seconds:.0f} s"
                        if seconds < 100
                        else f"{seconds / 60:.0f} min"
                    )
                    last = f"{last}, about {words} left" if left else f"after {words}"
                    print(
                        f"{study}: {done} of {number} jobs done, {last}",
                        file=sys.stderr,
                    )
            told, code = "".join(snakemake.stdout or ()), snakemake.wait()
        except (
            KeyboardInterrupt
        ):  # Snakemake receives it too, ends its jobs and unlocks the folder
            snakemake.wait()
            raise
    if not _DRY & set(options):
        with suppress(
            OSError
        ):  # Snakemake itself complains if a folder is not writable
            log.parent.mkdir(parents=True, exist_ok=True)
            log.write_text("".join(said), encoding="utf-8")
    if listed and not code:
        print(_stages(study, told))
    if code:
        if any("cannot be locked" in line for line in said):
            wanted = "expected files that are not locked"
            print(
                f"hopdata: error: {LOCKS}: {wanted}, found: {who_is_at_work()}",
                file=sys.stderr,
            )
        elif not any(line.startswith("hopdata:") for line in said):
            print("".join(said[-_LAST_LINES:]), end="", file=sys.stderr)
        print(
            f"hopdata: {log}: all that Snakemake said" * log.exists(), file=sys.stderr
        )
    return code


def _stages(study: str, told: str) -> str:
    """List what would run, a line per stage, from Snakemake's table of a dry run."""
    table = re.findall(r"^(\w+) +(\d+)$", told.partition("\ntotal ")[0], re.MULTILINE)
    lines = [
        f"  {rule:18} {counted(int(n), 'job')}" for rule, n in table if rule != "all"
    ]
    return "\n".join([f"{study}: {'would run' if lines else 'nothing to do'}", *lines])


def bring_bundled(config: Path) -> None:
    """Copy a configuration that only the installation has, and the files that it names."""
    bundled = SNAKEFILE.parent / config
    if config.exists() or config.is_absolute() or not bundled.is_file():
        return
    named = re.findall(
        r"(?:config|data/sample)/\w+\.\w+", bundled.read_text(encoding="utf-8")
    )
    for file in dict.fromkeys([config, *map(Path, named)]):
        _bring(file)


def _bring(file: Path) -> None:
    """Copy a bundled file to the place named by its configuration."""
    source = SNAKEFILE.parent / file
    if not file.exists():
        print(f"{file}: copied from the installation", flush=True)
        file.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, file)
    elif not filecmp.cmp(source, file, shallow=False):
        raise ConfigError.at(
            file, "the bundled one", "another file; go to another folder"
        )


def plan(options: argparse.Namespace) -> int:
    """Print a table of differences and the landings that show them; draw the curve on request."""
    from hopdata.maps.verdict.effect import landings_needed

    pilot = options.pilot
    file = _verdict_of(pilot) if pilot.suffix in (".yaml", ".yml") else pilot
    keys = ("n_landings", "n_feet", "power", "effect")
    landings, feet, power, effect = _values(file, "verdict.json", *keys)
    if effect is None:
        raise ConfigError(
            f"{file}: the pilot has no answer: {_values(file, '', 'sentence')[0]}"
        )
    if "allowed" not in effect:
        raise ConfigError.at(
            file, "a verdict of this version", "an older one; run the pilot again"
        )
    seen, allowed = effect["detectable"], effect["allowed"]
    found = f"{100 * seen:.2g} % in {100 * power:g} % of studies"
    print(f"{landings:,} landings of {feet} feet find {found}\n")
    print("difference  landings")
    own = () if options.difference is None else (options.difference,)
    asked = sorted({*planned(allowed), *own})
    needed = {one: landings_needed(landings, seen, allowed, one, feet) for one in asked}
    for difference, number in needed.items():
        print(f"{100 * difference:8.2g} %  {int(float(f'{number:.1e}')):8,}")
    if options.figure is not None:
        from hopdata.figures.style import save_figure
        from hopdata.figures.verdict import plan_figure

        figure = plan_figure(needed, (landings, seen), power)
        base, suffix = (
            options.figure.with_suffix(""),
            options.figure.suffix.removeprefix("."),
        )
        print(f"\n{save_figure(figure, base, formats=(suffix or 'svg',))[0]}: written")
    return OK


def _verdict_of(config: Path) -> Path:
    """Run a study, which may be simulated, up to its verdict, and return that file."""
    from hopdata.config.loading import load_config

    study = load_config(config)["study"]
    verdict = Path("results") / study / "verdict.json"
    print(f"{config}: as far as {verdict}", flush=True)
    if run_workflow(config, study, "--cores", "2", "--", str(verdict)):
        raise ConfigError(f"{config}: the study does not run to its verdict; see above")
    return verdict


def doctor(_options: argparse.Namespace) -> int:
    """Report versions, cores, memory, caches and space; exit code 1 if any is insufficient."""
    import hopdata

    places = [Path(hopdata.__file__).parent, os.environ.get("NUMBA_CACHE_DIR")]
    places.append(Path("~/.cache/hopdata").expanduser())
    compiled = [
        file for place in places if place for file in Path(place).rglob("*.nbi")
    ]
    lines = [
        (
            "python",
            f"{platform.python_version()}, {platform.system()} {platform.machine()}",
        )
    ]
    lines += [(name, version_of(name)) for name in REPORTED]
    problems = [f"{name}: expected it installed; install hopdata anew" for name, version in lines
                if version == MISSING]  # fmt: skip
    lines += [
        (name, f"{version_of(name)} (for {use} alone)")
        for name, use in OPTIONAL.items()
    ]
    cores = (
        len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else os.cpu_count()
    )
    lines += [
        ("cores", f"{cores}"),
        ("memory", _memory()),
        ("workflow", str(SNAKEFILE)),
    ]
    lines += [
        (
            "compiled",
            f"{len(compiled)} functions" if compiled else "none; once, some 20 s",
        )
    ]
    lines += [
        (
            "this folder",
            f"{Path.cwd()}, {shutil.disk_usage('.').free / 1e9:.1f} GB free",
        )
    ]
    if not SNAKEFILE.exists():
        problems.append(
            f"{SNAKEFILE}: expected the workflow, found no file; install hopdata anew"
        )
    if not os.access(Path.cwd(), os.W_OK):
        problems.append(
            f"{Path.cwd()}: expected a folder that can be written; go to another"
        )
    if is_locked():
        problems.append(f"{LOCKS}: {_why_locked()}")
    print("\n".join(f"{name:12} {what}" for name, what in lines))
    print("\n".join(problems) or "nothing is missing")
    return PROBLEM if problems else OK


def _why_locked() -> str:
    if lock_is_dead():
        killed = " and ".join(map(str, owners().values()))
        return f"{killed} was killed; the next 'hopdata run' here removes its lock"
    return who_is_at_work()


def _memory() -> str:
    with suppress(ValueError, OSError, AttributeError):
        size = os.sysconf("SC_PAGE_SIZE")
        whole, free = (
            size * os.sysconf(f"SC_{name}_PAGES") / 1e9 for name in ("PHYS", "AVPHYS")
        )
        return f"{whole:.1f} GB, {free:.1f} GB free"
    return "not known here"


def clean(options: argparse.Namespace) -> int:
    """Remove the results of a study, or with ``--all`` of all studies and Snakemake's data here."""
    from hopdata.config.loading import read_yaml

    if options.config is None and not options.all:
        raise ConfigError.at(
            "hopdata clean", "a CONFIG, or --all for every study", "none"
        )
    if said := release_dead():
        print(f"hopdata: {said}", file=sys.stderr)
    if is_locked():
        raise ConfigError.at(LOCKS, "no run in this folder", who_is_at_work())
    if options.all:
        found = [Path("results"), Path(".snakemake")]
    else:
        config = read_yaml(options.config) or {}
        study = str(config.get("study") or "")
        if not study or Path(study).name != study or study.startswith("."):
            raise ConfigError.at(f"{options.config}: study", "a name", f"'{study}'")
        found = [Path("results", study)]
        record = (
            found[0] / "provenance.json"
        )  # another study may have the same name by mistake
        known = read_json(record)["config"] if record.exists() else {}
        files = (
            [str(x.get("file")) for x in y.get("recordings") or ()]
            for y in (config, known)
        )
        own, others = map(", ".join, files)
        if others and own != others:
            own += f"; to remove it all the same: rm -r {found[0]}"
            raise ConfigError.at(
                options.config, f"the recordings of {found[0]} ({others})", own
            )
    for folder in (one for one in found if one.is_dir()):
        print(f"{folder}: " + ("would be removed" if options.dry_run else "removed"))
        if not options.dry_run:
            shutil.rmtree(folder)
    return OK
