"""``hopdata run``, ``clean``, ``doctor``: the workflow, what it leaves behind, what it needs."""

import argparse
import filecmp
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path

from hopdata.analysis import SNAKEFILE
from hopdata.commands.terminal import OK, PROBLEM
from hopdata.errors import ConfigError
from hopdata.provenance import REPORTED_PACKAGES, package_digest
from hopdata.report.tables import quality_summary

GROUP = SNAKEFILE.parent / "workflow" / "group.smk"
SAMPLE, SAMPLE_CONFIG = Path("data/sample/hopper.h5"), Path("config/config.yaml")
# What Snakemake says of a job: that it begins, that it is done, and how many are.
_SAID = re.compile(r" +jobid: (\d+)|Finished jobid: (\d+) \(Rule: (\w+)\)|(\d+) of (\d+) steps \(")
_LAST_LINES = 12


def run(options: argparse.Namespace) -> int:
    """Run a study or a group in the current folder, and say what came out and where it stands."""
    from hopdata.config.loading import load_config, read_yaml

    if options.provenance is not None:
        return _run_again(options)
    config = options.config
    if config is None:
        _bring(SAMPLE)
        config = SNAKEFILE.parent / SAMPLE_CONFIG
    elif not config.exists() and (bundled := SNAKEFILE.parent / config).is_file():
        named = re.findall(r"(?:config|data/sample)/\w+\.\w+", bundled.read_text(encoding="utf-8"))
        for file in dict.fromkeys([config, *map(Path, named)]):
            _bring(file)
    if isinstance(content := read_yaml(config), dict) and "samples" in content:
        from hopdata.group import read_group

        study, snakefile = read_group(config)["study"], GROUP
        answer, page = Path("results", study, "group.json"), Path("results", study, "group.html")
    else:
        study, snakefile = load_config(config)["study"], SNAKEFILE
        answer, page = (Path("results", study, name) for name in ("verdict.json", "report.html"))
    chosen = {"--dry-run": options.dry_run, "--forceall": options.force}
    passed = [*(flag for flag, is_set in chosen.items() if is_set), *options.passed_on]
    passed += ["--quiet", "rules", "host", "reason"] * options.dry_run  # jobs without their files
    if run_workflow(config, study, "--cores", options.cores, *passed, snakefile=snakefile):
        return PROBLEM
    is_dry = {"-n", "--dry-run", "--dryrun"} & set(passed)
    if page.exists() and answer.exists() and not is_dry:
        print(json.loads(answer.read_text(encoding="utf-8"))["sentence"])
        if (checks := answer.with_name("quality.json")).exists():
            good, others = quality_summary(json.loads(checks.read_text(encoding="utf-8")))
            print(f"quality of the data: {good}{others and f'; {others}'}")
        print(page)
    return OK


def _run_again(options: argparse.Namespace) -> int:
    """Make the study of a ``provenance.json`` again, as ``STUDY_again``, and compare all tables."""
    import yaml

    from hopdata import __version__

    place = options.provenance
    try:
        record = json.loads(place.read_text(encoding="utf-8"))
        config, version = record["config"], record["versions"]["hopdata"]
        inputs = record["inputs"]
    except OSError as error:
        raise ConfigError(f"{place}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise ConfigError(f"{place}: expected the provenance.json of a study") from None
    if version != __version__:
        raise ConfigError(
            f"{place}: expected results of hopdata {__version__}, found those of {version}; to "
            f"make them again: pip install hopdata=={version}"
        )
    if record.get("code_sha256") != package_digest():
        print(f"note: {place}: made by other code of version {version}", file=sys.stderr)
    again = f"{config['study'][:94]}_again"
    copy = Path("results", again, "config.yaml")
    copy.parent.mkdir(parents=True, exist_ok=True)
    copy.write_text(yaml.safe_dump({**config, "study": again}), encoding="utf-8")
    if run_workflow(copy, again, "--cores", options.cores, *options.passed_on):
        return PROBLEM
    old, new = place.parent, copy.parent
    if json.loads((new / place.name).read_text(encoding="utf-8"))["inputs"] != inputs:
        raise ConfigError(f"{place}: expected the recordings that it names, found other content")
    names = ["verdict.json", *(f"tables/{one.name}" for one in sorted(old.glob("tables/*.csv")))]
    differ = filecmp.cmpfiles(old, new, names, shallow=False)
    other = sorted({*differ[1], *differ[2]})
    print(f"{new}: {len(differ[0])} of {len(names)} files are the same bytes")
    for name in other:
        print(f"  {name} differs" if (new / name).exists() else f"  {name} is missing")
    return PROBLEM if other else OK


def run_workflow(config: Path, study: str, *options: str, snakefile: Path = SNAKEFILE) -> int:
    """Run Snakemake on a configuration, show how far it is, and return its exit code.

    What it says on stderr goes to ``results/<study>/logs/run.log``, which is named if it fails.
    """
    if not snakefile.exists():
        raise ConfigError(
            f"{snakefile}: expected the workflow, found no file; install hopdata anew"
        )
    log = Path("results", study, "logs", "run.log")
    # In this order: any number of files may follow --configfile, and a target would be one.
    places = ["--configfile", str(config), "--snakefile", str(snakefile), "--nocolor"]
    command = [sys.executable, "-m", "snakemake", *places, *options]
    said, begun, last = [], {"": time.monotonic()}, ""
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, encoding="utf-8", errors="replace"
    ) as snakemake:
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
                    last = f"{rule} {time.monotonic() - begun.get(ends, begun['']):.0f} s"
                else:
                    far = _how_far(int(done), int(number), time.monotonic() - begun[""], last)
                    print(f"{study}: {far}", file=sys.stderr, flush=True)
            code = snakemake.wait()
        except KeyboardInterrupt:  # Snakemake got it too: it ends its jobs and unlocks the folder
            snakemake.wait()
            raise
    if not {"-n", "--dry-run", "--dryrun"} & set(options):
        _keep(log, said)
    if code:
        if not any(line.startswith("hopdata:") for line in said):
            print("".join(said[-_LAST_LINES:]), end="", file=sys.stderr)
        print(f"hopdata: {log}: all that Snakemake said" * log.exists(), file=sys.stderr)
    return code


def _how_far(done: int, number: int, seconds: float, last: str) -> str:
    """Say how many jobs are done, and how long the others take if they are like these."""
    left = seconds * (number - done) / done or seconds
    words = f"{left:.0f} s" if left < 100 else f"{left / 60:.0f} min"
    said = f"{last}, about {words} left" if done < number else f"after {words}"
    return f"{done} of {number} jobs done, {said}"


def _keep(log: Path, said: list[str]) -> None:
    """Write the log; a folder that cannot be written is Snakemake's to complain of."""
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        log.write_text("".join(said), encoding="utf-8")
    except OSError:
        pass


def _bring(file: Path) -> None:
    """Copy a bundled file to where its configuration, as any, names it."""
    source = SNAKEFILE.parent / file
    if not file.exists():
        print(f"{file}: copied from the installation", flush=True)
        file.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, file)
    elif not filecmp.cmp(source, file, shallow=False):
        raise ConfigError(
            f"{file}: expected the bundled one, found another file; go to another folder"
        )


def doctor(_options: argparse.Namespace) -> int:
    """Say what there is of versions, cores, memory, caches and space; exit code 1 if it lacks."""
    import hopdata

    places = [Path(hopdata.__file__).parent, os.environ.get("NUMBA_CACHE_DIR")]
    places.append(Path("~/.cache/hopdata").expanduser())
    compiled = [file for place in places if place for file in Path(place).rglob("*.nbi")]
    lines = [("python", f"{platform.python_version()}, {platform.system()} {platform.machine()}")]
    problems = []
    for name in REPORTED_PACKAGES:
        try:
            lines.append((name, metadata.version(name)))
        except metadata.PackageNotFoundError:
            problems.append(f"{name}: expected it installed; install hopdata anew")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    lines += [("cores", f"{cores}"), ("memory", _memory()), ("workflow", str(SNAKEFILE))]
    lines += [("compiled", f"{len(compiled)} functions" if compiled else "none; once, some 20 s")]
    lines += [("this folder", f"{Path.cwd()}, {shutil.disk_usage('.').free / 1e9:.1f} GB free")]
    if not SNAKEFILE.exists():
        problems.append(f"{SNAKEFILE}: expected the workflow, found no file; install hopdata anew")
    if not os.access(Path.cwd(), os.W_OK):
        problems.append(f"{Path.cwd()}: expected a folder that can be written; go to another")
    if any(Path(".snakemake/locks").glob("*")):
        problems.append(".snakemake/locks: a run is at work here, or one was killed")
    print("\n".join(f"{name:12} {what}" for name, what in lines))
    print("\n".join(problems) or "nothing is missing")
    return PROBLEM if problems else OK


def _memory() -> str:
    try:
        size = os.sysconf("SC_PAGE_SIZE")
        whole, free = (size * os.sysconf(f"SC_{name}_PAGES") / 1e9 for name in ("PHYS", "AVPHYS"))
    except (ValueError, OSError, AttributeError):
        return "not known here"
    return f"{whole:.1f} GB, {free:.1f} GB free"


def clean(options: argparse.Namespace) -> int:
    """Remove the results of a study, or with ``--all`` of all, and what Snakemake keeps here."""
    from hopdata.config.loading import read_yaml

    if options.config is None and not options.all:
        raise ConfigError("hopdata clean: expected a CONFIG, or --all for every study, found none")
    if any(Path(".snakemake/locks").glob("*")):
        raise ConfigError(
            ".snakemake/locks: expected no run in this folder, found the lock of one; if none is "
            "at work: rm -r .snakemake/locks"
        )
    if options.all:
        found = [Path("results"), Path(".snakemake")]
    else:
        config = read_yaml(options.config) or {}
        study = str(config.get("study") or "")
        if not study or Path(study).name != study or study.startswith("."):
            raise ConfigError(f"{options.config}: study: expected a name, found '{study}'")
        found = [Path("results", study)]
        record = found[0] / "provenance.json"  # another study may have the same name by mistake
        known = json.loads(record.read_text(encoding="utf-8"))["config"] if record.exists() else {}
        files = ([str(x.get("file")) for x in y.get("recordings") or ()] for y in (config, known))
        own, others = map(", ".join, files)
        if others and own != others:
            raise ConfigError(
                f"{options.config}: expected the recordings of {found[0]} ({others}), found {own}; "
                f"to remove it all the same: rm -r {found[0]}"
            )
    for folder in (one for one in found if one.is_dir()):
        print(f"{folder}: " + ("would be removed" if options.dry_run else "removed"))
        if not options.dry_run:
            shutil.rmtree(folder)
    return OK
