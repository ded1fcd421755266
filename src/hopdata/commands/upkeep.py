"""``hopdata doctor``, ``clean`` and ``completion``: the installation and what it leaves behind."""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import sys
from importlib import metadata
from pathlib import Path

from hopdata.commands.run import SNAKEFILE
from hopdata.commands.terminal import OK, PROBLEM
from hopdata.errors import ConfigError
from hopdata.provenance import REPORTED_PACKAGES


def doctor(_options: argparse.Namespace) -> int:
    """Say what there is of versions, cores, memory, caches and space; exit code 1 if it lacks."""
    import hopdata

    places = [Path(hopdata.__file__).parent, os.environ.get("NUMBA_CACHE_DIR")]
    places.append(Path("~/.cache/hopdata").expanduser())
    compiled = [file for place in places if place for file in Path(place).rglob("*.nbi")]
    free_gb = shutil.disk_usage(Path.cwd()).free / 1e9
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
    lines += [("this folder", f"{Path.cwd()}, {free_gb:.1f} GB free")]
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
        study = str((read_yaml(options.config) or {}).get("study") or "")
        if not study or Path(study).name != study or study.startswith("."):
            raise ConfigError(f"{options.config}: study: expected a name, found '{study}'")
        found = [Path("results", study)]
    for folder in (one for one in found if one.is_dir()):
        print(f"{folder}: " + ("would be removed" if options.dry_run else "removed"))
        if not options.dry_run:
            shutil.rmtree(folder)
    return OK


def completion(_options: argparse.Namespace) -> int:
    """Print what makes a shell (bash; zsh after bashcompinit) complete the commands and files."""
    from hopdata.__main__ import COMMANDS

    print(f'complete -o default -W "{" ".join(COMMANDS)}" {Path(sys.argv[0]).name or "hopdata"}')
    return OK
