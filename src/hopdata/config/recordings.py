"""What the configuration says of one recording."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def simulation_of(config: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the block ``simulation`` as it holds for one recording.

    Parameters
    ----------
    config : dict
        As returned by `load_config`.
    name : str
        Name of the recording; its own values take the place of the block's where they are given.
    """
    own = next(entry["simulation"] for entry in config["recordings"] if entry["name"] == name)
    given = {key: value for key, value in own.items() if value is not None}
    return {**config["simulation"], **given}


def files_of(entry: Mapping[str, Any]) -> list[str]:
    """Return the files of one entry of ``recordings``, in order; none if it is simulated."""
    file = entry.get("file")
    return [] if file is None else [file] if isinstance(file, str) else list(file)
