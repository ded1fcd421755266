"""``hopdata doctor`` and ``clean``: what an installation needs; old results."""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from hopdata.bundled import SNAKEFILE
from hopdata.commands.owner import (
    LOCKS,
    is_locked,
    lock_is_dead,
    owners,
    release_dead,
    who_is_at_work,
)
from hopdata.commands.terminal import OK, PROBLEM, print_table
from hopdata.commands.values import values_of
from hopdata.errors import ConfigError
from hopdata.provenance import MISSING, REPORTED, version_of

#: Packages that one function needs alone, and this function.
OPTIONAL = {"xarray": "Recording.to_xarray", "qtm-rt": "hopdata drive --host"}
#: In a clone, the folder of results holds this page, which stays.
PAGE_OF_RESULTS = "README.md"


def doctor(_options: argparse.Namespace) -> int:
    """Report versions, cores, memory, caches and space; code 1 if any lacks."""
    here = Path.cwd()
    versions = {name: version_of(name) for name in REPORTED}
    compiled = _n_compiled()
    machine = f"{platform.system()} {platform.machine()}"
    facts = {
        "python": f"{platform.python_version()}, {machine}",
        **versions,
        **{
            name: f"{version_of(name)} (for {use} alone)"
            for name, use in OPTIONAL.items()
        },
        "cores": str(_n_cores()),
        "memory": _memory(),
        "workflow": str(SNAKEFILE),
        "compiled": f"{compiled} functions" if compiled else "none; once, some 20 s",
        "this folder": f"{here}, {shutil.disk_usage('.').free / 1e9:.1f} GB free",
    }
    problems = [
        f"{name}: expected it installed; install hopdata anew"
        for name, version in versions.items()
        if version == MISSING
    ]
    if not SNAKEFILE.exists():
        problems.append(
            f"{SNAKEFILE}: expected the workflow, found no file; install hopdata anew"
        )
    if not os.access(here, os.W_OK):
        problems.append(f"{here}: expected a folder that can be written; go to another")
    if is_locked():
        problems.append(f"{LOCKS}: {_why_locked()}")
    print_table(
        {"": "left", "this installation": "left"},
        facts.items(),
        plain="\n".join(f"{name:12} {what}" for name, what in facts.items()),
    )
    print("\n".join(problems) or "nothing is missing")
    return PROBLEM if problems else OK


def _n_compiled() -> int:
    """Return the number of functions whose machine code is kept."""
    import hopdata

    places = [Path(hopdata.__file__).parent, Path("~/.cache/hopdata").expanduser()]
    numba_cache = os.environ.get("NUMBA_CACHE_DIR")
    if numba_cache:
        places.append(Path(numba_cache))
    return sum(len([*place.rglob("*.nbi")]) for place in places)


def _n_cores() -> int | None:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count()


def _why_locked() -> str:
    if lock_is_dead():
        killed = " and ".join(map(str, owners().values()))
        return f"{killed} was killed; the next 'hopdata run' here removes its lock"
    return who_is_at_work()


def _memory() -> str:
    with suppress(ValueError, OSError, AttributeError):
        page = os.sysconf("SC_PAGE_SIZE")
        whole = page * os.sysconf("SC_PHYS_PAGES") / 1e9
        free = page * os.sysconf("SC_AVPHYS_PAGES") / 1e9
        return f"{whole:.1f} GB, {free:.1f} GB free"
    return "not known here"


def clean(options: argparse.Namespace) -> int:
    """Remove the results of a study; with ``--all`` all, and Snakemake's data."""
    if options.config is None and not options.all:
        raise ConfigError.at(
            "hopdata clean", "a CONFIG, or --all for every study", "none"
        )
    unlocked = release_dead()
    if unlocked:
        print(f"hopdata: {unlocked}", file=sys.stderr)
    if is_locked():
        raise ConfigError.at(LOCKS, "no run in this folder", who_is_at_work())
    if options.all:
        found = [Path("results"), Path(".snakemake")]
    else:
        found = [_results_of(options.config)]
    for folder in found:
        if folder.is_symlink():
            link = "a link, which may lead anywhere; remove it by hand"
            raise ConfigError.at(folder, "a folder of results", link)
        if not folder.is_dir():
            continue
        if options.dry_run:
            print(f"{folder}: would be removed")
        else:
            print(f"{folder}: removed")
            _remove(folder)
    return OK


def _results_of(file: Path) -> Path:
    """Return the folder of a study's results, unless they are of other recordings."""
    from hopdata.config.loading import read_yaml

    config = read_yaml(file)
    if not isinstance(config, Mapping):
        raise ConfigError.at(file, "a configuration", "another file")
    study = str(config.get("study") or "")
    if not study or Path(study).name != study or study.startswith("."):
        raise ConfigError.at(f"{file}: study", "a name", f"'{study}'")
    folder = Path("results", study)
    record = folder / "provenance.json"
    if not record.exists():
        return folder
    # Another study may have the same name by mistake.
    (recorded,) = values_of(record, "provenance.json", "config")
    known = _files_in(recorded)
    own = _files_in(config)
    if known and own != known:
        found = f"{own}; to remove it all the same: rm -r {folder}"
        raise ConfigError.at(file, f"the recordings of {folder} ({known})", found)
    return folder


def _files_in(config: object) -> str:
    """List the files of a configuration's recordings."""
    recordings = config.get("recordings") if isinstance(config, Mapping) else ()
    named = []
    for recording in recordings if isinstance(recordings, list) else ():
        if isinstance(recording, Mapping):
            named.append(str(recording.get("file")))
    return ", ".join(named)


def _remove(folder: Path) -> None:
    """Remove a folder, but not the page that says what a clone's results will be."""
    page = folder / PAGE_OF_RESULTS
    if folder != Path("results") or not page.exists():
        shutil.rmtree(folder)
        return
    for place in folder.iterdir():
        if place == page:
            continue
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place)
        else:
            place.unlink()
