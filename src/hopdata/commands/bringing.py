"""Bundled recordings, copied to where pages and configurations name them."""

from __future__ import annotations

import filecmp
import shutil
from pathlib import Path

from hopdata.bundled import SNAKEFILE
from hopdata.errors import ConfigError


def bring_recording(file: Path) -> None:
    """Copy a recording of the sample to the place by which pages name it."""
    is_of_sample = file.parent == Path("data/sample") and not file.is_absolute()
    if is_of_sample and not file.exists() and (SNAKEFILE.parent / file).is_file():
        bring(file)


def bring(file: Path) -> None:
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
