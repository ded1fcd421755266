"""The files that a configuration names, and whether they are there."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hopdata.config.external import external_files
from hopdata.config.recordings import files_of
from hopdata.errors import did_you_mean


def recording_files(config: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield key and file of each recording's files."""
    for i, recording in enumerate(config["recordings"]):
        for k, name in enumerate(files_of(recording)):
            which = f"[{k}]" if isinstance(recording["file"], list) else ""
            yield f"recordings[{i}].file{which}", name


def missing_files(config: dict[str, Any]) -> Iterator[str]:
    """Yield what is said of each file that does not exist."""
    for key, name in [*recording_files(config), *external_files(config)]:
        file = Path(name)
        if file.is_file():
            continue
        found = f"the folder '{file}'" if file.is_dir() else f"no '{file}'{_near(file)}"
        yield f"{key}: expected a file, found {found}"


def _near(file: Path) -> str:
    """Say what there is instead: the nearest name, other recordings, or not even the folder."""
    folder = file.parent
    if not folder.is_dir():
        return f"; there is no folder '{folder}' in {Path.cwd()}"
    names = sorted(p.name for p in folder.iterdir() if p.is_file())
    if near := did_you_mean(file.name, names):
        return near
    same = [name for name in names if name.endswith(file.suffix)][:3]
    return f"; in that folder are {', '.join(same)}" if same else f" in {Path.cwd()}"
