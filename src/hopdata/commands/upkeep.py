"""``hopdata clean``: old results."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

from hopdata.commands.owner import (
    LOCKS,
    is_locked,
    release_dead,
    who_is_at_work,
)
from hopdata.commands.terminal import OK
from hopdata.commands.values import values_of
from hopdata.errors import ConfigError

#: In a clone, the folder of results holds this page, which stays.
PAGE_OF_RESULTS = "README.md"


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
